"""Exports other than C, and what an export refuses."""

from dataclasses import replace
from math import pi, sqrt
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import emsid
from emsid import LinearAxis
from emsid.exports import FORMATS
from emsid.exports.verb import README, c_name
from emsid.models.plants.drive import Feed
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.diagnostics import friction_curve
from emsid.models.regression.narx import RegressionModel
from emsid.plant import Friction, Motor
from emsid.plant.gaussian_stribeck import GaussianStribeck
from model_examples import ALL, DT, cascades, inputs, processes, regressions, state_spaces

R, K, J, B, LEVEL = 1.5, 0.05, 4e-5, 2e-5, 0.004


def motor(dead_zone: float = 0.0, signals: tuple[Signal, ...] = (Signal.SPEED,)) -> GreyBox:
    values = {
        "resistance": R,
        "motor_constant": K,
        "rotor_inertia": J,
        "rotor_viscous": B,
        "rotor_friction.coulomb": LEVEL,
        "voltage_dead_zone.half_width": dead_zone,
    }
    return GreyBox(emsid.plants.rigid_motor().with_values(values), signals)


def texts(folder: Path, *arguments: object, **options: object) -> dict[str, str]:
    written = emsid.export(*arguments, folder, **options)  # type: ignore[arg-type]
    return {path.name: path.read_text("utf-8", "replace") for path in written}  # some formats are binary


def numbers(text: str) -> dict[str, float]:
    """The numbers of lines such as ``name: 1.0  # unit`` or ``name = 1.0``."""
    lines = (line.split("#")[0].replace("=", ":").split(":") for line in text.splitlines())
    return {line[0].split(".")[-1].strip(): float(line[1]) for line in lines if len(line) == 2 and line[1].strip()}


def test_every_format_writes_a_readme_with_the_equation(tmp_path: Path) -> None:
    for name, kind in FORMATS.items():
        if name == "fixed-point":  # of regressions only: test_export_fixed_point.py
            continue
        options = {"winding": "line", "pole_pairs": 7} if kind.options and "winding" in kind.options else {}
        found = texts(tmp_path / name, motor(0.3), name, dt=1e-3, **options)
        assert len(found) >= 2
        assert "motor_constant = 0.05 N·m/A" in found[README]
        assert found[README].endswith(".\n")


def test_the_constants_of_wpilib(tmp_path: Path) -> None:
    found = numbers(texts(tmp_path, motor(0.25), "wpilib")["rigid_motor.yaml"])
    assert found["kS"] == pytest.approx(R * LEVEL / K + 0.25)
    assert found["kV_radians"] == pytest.approx(K + R * B / K)
    assert found["kA_radians"] == pytest.approx(R * J / K)
    assert found["kV_rotations"] == pytest.approx(2 * pi * found["kV_radians"])


@pytest.mark.parametrize("winding", ["phase", "line", "q-axis"])
def test_the_constants_of_brushless_drives_agree(winding: str, tmp_path: Path) -> None:
    """A motor of 270 rpm/V with 7 pole pairs and 0.039 Ω a phase, described in three ways."""
    kv, pairs, phase = 270.0, 7, 0.039
    line = 60 / (2 * pi) / kv
    constant = {"phase": line / sqrt(3), "line": line, "q-axis": sqrt(3) / 2 * line}[winding]
    resistance = 2 * phase if winding == "line" else phase
    plant = motor().plant.with_values({"resistance": resistance, "motor_constant": constant})
    model, how = replace(motor(), plant=plant), {"winding": winding, "pole_pairs": pairs}
    odrive = numbers(texts(tmp_path / "o", model, "odrive", **how)["rigid_motor_odrive.py"])
    assert odrive["torque_constant"] == pytest.approx(8.27 / kv, rel=1e-3)
    assert odrive["phase_resistance"] == pytest.approx(phase)
    vesc = numbers(texts(tmp_path / "v", model, "vesc", **how)["rigid_motor_vesc.yaml"])
    assert vesc["foc_motor_flux_linkage"] == pytest.approx(5.513 / (pairs * kv), rel=1e-3)
    assert vesc["foc_motor_r"] == pytest.approx(phase)
    assert (
        f"BLDCMotor(7, {phase:.6g}, 270, NOT_SET)"
        in texts(tmp_path / "s", model, "simplefoc", **how)["rigid_motor_simplefoc.h"]
    )


def test_a_joint_has_the_parameters_of_the_motor(tmp_path: Path) -> None:
    found = texts(tmp_path, motor(0.3), "mujoco")
    tree = ElementTree.fromstring(found["rigid_motor.xml"])
    joint, actuator = tree.find(".//joint"), tree.find(".//general")
    assert joint is not None
    assert actuator is not None
    body = tree.find(".//inertial")
    assert body is not None
    assert float(joint.attrib["armature"]) + float(body.attrib["diaginertia"].split()[2]) == pytest.approx(J)
    assert [float(joint.attrib[name]) for name in ("damping", "frictionloss")] == pytest.approx([B, LEVEL])
    assert float(actuator.attrib["gainprm"]) == pytest.approx(K / R)
    assert float(actuator.attrib["biasprm"].split()[-1]) == pytest.approx(-(K**2) / R)
    scope: dict[str, object] = {}
    exec(found["rigid_motor_ctrl.py"], scope)  # the file that users import
    ctrl = scope["ctrl"]
    assert [ctrl(u) for u in (-1.0, 0.2, 1.0)] == pytest.approx([-0.7, 0.0, 0.7])  # type: ignore[operator]


def moved_in_mujoco(model: GreyBox, folder: Path, **options: object) -> float:
    """The fit in % of the free run in MuJoCo to that of the model, through stops and reversals."""
    library = pytest.importorskip("mujoco")
    dt = 2e-3
    u = np.repeat(np.random.default_rng(1).uniform(-4, 4, 30), 40)
    emsid.export(model, "mujoco", folder, name="joint", dt=dt, **options)  # type: ignore[arg-type]
    simulated = library.MjModel.from_xml_path(str(folder / "joint.xml"))
    steps = round(dt / simulated.opt.timestep)
    assert steps * simulated.opt.timestep == pytest.approx(dt, rel=1e-12)
    state, found = library.MjData(simulated), []
    scope: dict[str, object] = {"ctrl": float}
    if (folder / "joint_ctrl.py").exists():
        exec((folder / "joint_ctrl.py").read_text("utf-8"), scope)
    for command in u:
        found.append(float(state.qvel[0]))
        state.ctrl[0] = scope["ctrl"](command)  # type: ignore[operator]
        for _ in range(steps):
            library.mj_step(simulated, state)
    truth = emsid.simulate(model, u, dt=dt).output[:, 0]
    return float(100 * (1 - np.linalg.norm(truth - found) / np.linalg.norm(truth - truth.mean())))


def test_mujoco_moves_as_the_model(tmp_path: Path) -> None:
    assert moved_in_mujoco(motor(), tmp_path / "a") > 97
    assert moved_in_mujoco(motor(), tmp_path / "b", actuator="dcmotor") > 97
    plant = motor(0.5).plant.with_values({"drive.gain": 2.0})
    for actuator in ("general", "dcmotor"):
        assert moved_in_mujoco(replace(motor(), plant=plant), tmp_path / actuator, actuator=actuator) > 97


def test_a_dcmotor_carries_what_a_general_actuator_cannot(tmp_path: Path) -> None:
    """Inductance, cogging and friction with a Gaussian excess: each fits better, and is no longer named as left out."""
    cogging = {"cogging.cosine_1": 0.001, "cogging.sine_1": 0.0015, "cogging.period": 1.0}
    rigid = motor().plant
    excess = replace(rigid.motor, rotor_friction=GaussianStribeck(LEVEL, 0.006, 0.1))
    for name, plant in (
        ("inductance", rigid.with_values({"inductance": 0.005})),
        ("cogging.cosine_1", rigid.with_values(cogging)),
        ("rotor_friction.stribeck", replace(rigid, motor=excess)),
    ):
        model, general, better = replace(motor(), plant=plant), tmp_path / f"{name}-g", tmp_path / f"{name}-d"
        assert moved_in_mujoco(model, better, actuator="dcmotor") > max(moved_in_mujoco(model, general), 97.5)
        assert f"{name} = " in (general / README).read_text("utf-8").split("## What is not")[1]
        assert f"{name} = " not in (better / README).read_text("utf-8").split("## What is not")[1]


def test_curves_are_tables(tmp_path: Path) -> None:
    plant = motor(0.4).plant
    plant = replace(plant, motor=replace(plant.motor, rotor_friction=Friction(LEVEL, 0.002, 0.5)))
    found = texts(tmp_path, replace(motor(), plant=plant), "csv")
    assert set(found) == {"rigid_motor_friction.csv", "rigid_motor_dead_zone.csv", README}
    rows = np.array([[float(x) for x in line.split(",")] for line in found["rigid_motor_friction.csv"].split()[8:]])
    assert rows[-1, 1] == pytest.approx(LEVEL + 0.002 * np.exp(-0.5 * rows[-1, 0]) + B * rows[-1, 0], rel=1e-6)


def test_the_linear_part_is_a_script_of_python_control(tmp_path: Path) -> None:
    library = pytest.importorskip("control")
    found = texts(tmp_path, motor(), "python-control")
    scope: dict[str, object] = {}
    exec(found["rigid_motor.py"], scope)
    slow = scope["rigid_motor"](1e-4j)  # type: ignore[operator]
    assert isinstance(scope["rigid_motor"], library.StateSpace)
    assert abs(complex(np.squeeze(slow))) == pytest.approx(K / (K**2 + R * B), rel=1e-4)


def test_intervals_of_a_fit_are_in_the_readme(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    u = rng.standard_normal(400)
    y = np.convolve(u, [0.0, 1.0, 0.5])[:400] + 0.1 * rng.standard_normal(400)
    fit = emsid.fit(emsid.arx(na=0, nb=2), emsid.Record(u, y, 0.01, "voltage", "speed", "V", "rad/s"))
    emsid.save(fit, tmp_path / "arx.json")
    text = texts(tmp_path / "c", emsid.load(tmp_path / "arx.json"), "c99")[README]
    assert "Input 0: voltage, in V." in text
    low, high = fit["b1"].interval
    assert f"{low:.4g} … {high:.4g}" in text


def test_curves_of_a_fit_have_bands(tmp_path: Path) -> None:
    """Those that the report draws; the band of the dead zone is that of its half width times the slope."""
    rng, dt = np.random.default_rng(4), 2e-3
    u = np.repeat(rng.uniform(-4, 4, 40), 40)
    y = emsid.simulate(motor(0.4), u, dt=dt).output[:, 0] + 0.5 * rng.standard_normal(len(u))
    free = ["motor_constant", "rotor_inertia", "rotor_friction.coulomb", "voltage_dead_zone.half_width"]
    fit = emsid.fit(motor(0.4).plant, emsid.Record(u, y, dt, "u", "w", "V", "rad/s"), free=free)
    found = texts(tmp_path, fit, "csv")
    rows = np.array(
        [[float(v) for v in line.split(",")] for line in found["rigid_motor_dead_zone.csv"].splitlines()[1:]]
    )
    error = fit["voltage_dead_zone.half_width"].standard_error
    beyond = np.abs(rows[:, 0]) > 0.5
    assert rows[beyond, 3] - rows[beyond, 2] == pytest.approx(2 * 1.96 * error, rel=1e-3)
    assert "no bands" not in found[README]
    rows = np.array(
        [[float(v) for v in line.split(",")] for line in found["rigid_motor_friction.csv"].splitlines()[1:]]
    )
    curve = friction_curve(fit)
    half = np.interp(rows[-1, 0], curve.x, curve.high - curve.y)
    assert rows[-1, 3] - rows[-1, 1] == pytest.approx(half, rel=1e-3)


def test_maps_of_a_fitted_cascade_have_bands(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    u = rng.uniform(-2, 2, 600)
    y = np.convolve(np.tanh(u), [0.0, 0.5, 0.3])[:600] + 0.01 * rng.standard_normal(600)
    fit = emsid.fit(emsid.hammerstein(2, static="polynomial", size=3), emsid.Record(u, y, 0.01))
    found = next(text for name, text in texts(tmp_path, fit, "csv").items() if "map" in name)
    assert found.splitlines()[0] == "input,output,low,high"
    low, high = np.array([[float(v) for v in line.split(",")[2:]] for line in found.splitlines()[1:]]).T
    assert (high >= low).all()
    assert (high > low).any()


def test_the_readme_says_how_the_model_fits_unseen_data(tmp_path: Path) -> None:
    arx = emsid.RegressionModel(emsid.Structure.parse("y(t-1)", "u(t-1)"), np.array([0.5, 2.0]), dt=0.1)
    rng = np.random.default_rng(6)
    u = rng.standard_normal(500)
    y = emsid.simulate(arx, u, dt=0.1).output[:, 0] + 0.1 * rng.standard_normal(500)
    row = emsid.compare(arx, emsid.Record(u, y, 0.1)).rows[0]
    text = texts(tmp_path / "a", arx, "c99", unseen=emsid.Record(u, y, 0.1))[README]
    assert f"unseen data: {row.fit_percent:.4g} %, RMSE {row.simulation_rmse:.4g}" in text
    assert "Fit on unseen data: not known" in texts(tmp_path / "b", arx, "c99")[README]


@pytest.mark.parametrize(("name", "found"), [("rigid-motor", "rigid_motor"), ("ARX 2", "ARX_2")])
def test_names_of_c(name: str, found: str) -> None:
    assert c_name(name) == found


@pytest.mark.parametrize("name", ["2fast", "int", "", "x" * 32, "µ"])
def test_names_that_c_cannot_hold_are_refused(name: str) -> None:
    with pytest.raises(emsid.ModelError, match="name in C"):
        c_name(name)


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    arx = emsid.RegressionModel(emsid.Structure.parse("y(t-1)", "u(t-1)"), np.array([0.5, 2.0]), dt=0.1)
    unstable = emsid.RegressionModel(arx.structure, np.array([1.5, 2.0]), dt=0.1)
    shaft = GreyBox(replace(emsid.plants.motor(), motor=Motor()), (Signal.SPEED,))
    for model, format, options, words in (
        (unstable, "c99", {}, "unstable"),
        (arx, "c98", {}, "did you mean c99"),
        (arx, "c99", {"double": True}, "no option"),
        (arx, "c99", {"dt": 0.2}, "leave dt out"),
        (motor(), "c99", {}, "sample time"),
        (arx, "mujoco", {}, "inertia"),
        (arx, "wpilib", {}, "inertia"),
        (motor(), "vesc", {}, "winding"),
        (motor(), "vesc", {"winding": "delta", "pole_pairs": 7}, "phase"),
        (motor(), "vesc", {"winding": "line", "pole_pairs": "many"}, "whole number"),
        (shaft, "wpilib", {"dt": 0.01}, "inertia"),
        (arx, "csv", {}, "static curve"),
        (motor(), "mujoco", {"actuator": "servo"}, "general or dcmotor"),
        (LinearAxis(), "mujoco", {"actuator": "dcmotor"}, "no motor constant"),
    ):
        with pytest.raises(emsid.ModelError, match=words):
            emsid.export(model, format, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_files_are_replaced_only_on_request(tmp_path: Path) -> None:
    arx = emsid.RegressionModel(emsid.Structure.parse("y(t-1)", "u(t-1)"), np.array([0.5, 2.0]), dt=0.1)
    emsid.export(arx, "c99", tmp_path, name="plant")
    before = (tmp_path / "plant.c").read_bytes()
    with pytest.raises(emsid.FormatError, match="exists"):
        emsid.export(arx, "c99", tmp_path, name="plant")
    emsid.export(arx, "c99", tmp_path, name="plant", force=True)
    assert (tmp_path / "plant.c").read_bytes() == before


def geared(**values: float) -> GreyBox:
    """An arm behind a gear of 20 turns, whose friction differs by direction."""
    plant = emsid.plants.joint().with_values(
        {"resistance": R, "motor_constant": K, "rotor_inertia": J, "rotor_viscous": B, "inductance": 0.0}
        | {"rotor_friction.coulomb.forward": 0.002, "rotor_friction.coulomb.backward": 0.006, "sensor.ratio": 20.0}
        | {"gravity.torque": 0.4, "gravity.angle": 0.3, **values}
    )
    return GreyBox(replace(plant, feed=Feed.VOLTAGE), (Signal.POSITION,))


def test_the_firmware_of_a_geared_joint_has_the_values_of_its_motor(tmp_path: Path) -> None:
    how = {"winding": "phase", "pole_pairs": 7}
    found = texts(tmp_path / "w", geared(), "wpilib", name="arm")
    assert "motor, which turns 20 times per turn of the joint" in found[README]
    assert "mean of 0.06 V forward and 0.18 V backward" in found[README]
    gains = numbers(found["arm.yaml"])
    assert gains["kS"] == pytest.approx(0.5 * (gains["kS_forward"] + gains["kS_backward"]))
    assert gains["kS_forward"] == pytest.approx(R * 0.002 / K)
    assert gains["kS_backward"] == pytest.approx(R * 0.006 / K)
    assert gains["kG"] == pytest.approx(R * 0.4 / 20 / K)
    assert gains["kV_radians"] == pytest.approx(K + R * B / K)
    assert gains["kA_radians"] == pytest.approx(R * J / K)
    plain = replace(motor(), plant=motor().plant)
    for format, file in (("odrive", "arm_odrive.py"), ("vesc", "arm_vesc.yaml"), ("simplefoc", "arm_simplefoc.h")):
        geared_text = texts(tmp_path / format, geared(), format, name="arm", **how)
        assert geared_text[file] == texts(tmp_path / f"{format}1", plain, format, name="arm", **how)[file]
        assert "motor, which turns 20 times" in geared_text[README]
        assert "rotor_inertia = 4e-05 kg·m² is not carried" in geared_text[README]


def test_the_feedforward_of_wpilib_turns_a_motor_as_asked(tmp_path: Path) -> None:
    """kS, kG, kV and kA give the voltage at which the arm of the plant accelerates as asked, in both directions."""
    gains = numbers(texts(tmp_path, geared(), "wpilib", name="arm")["arm.yaml"])
    h = 1e-6
    for speed, angle, wanted in ((40.0, 1.0, 300.0), (-60.0, 2.5, 100.0)):
        friction = gains["kS_forward"] if speed > 0 else -gains["kS_backward"]
        arm = gains["kG"] * np.cos(angle - 0.3 - 0.5 * pi)
        volts = friction + arm + gains["kV_radians"] * speed + gains["kA_radians"] * wanted
        plant = geared().plant
        begin = np.array([speed, 20 * angle, 0.0, 0.0])
        found = plant.simulate(np.full((3, 1), volts), h, begin, (Signal.SPEED,))[:, 0] * 20
        assert (found[2] - found[0]) / (2 * h) == pytest.approx(wanted, rel=1e-3)


def test_current_loops_have_gains_where_the_inductance_is_known(tmp_path: Path) -> None:
    known = replace(motor(), plant=motor().plant.with_values({"inductance": 2e-3}))
    how = {"winding": "line", "pole_pairs": 7, "bandwidth": 500}
    odrive = numbers(texts(tmp_path / "o", known, "odrive", **how)["rigid_motor_odrive.py"])
    assert (odrive["current_control_bandwidth"], odrive["phase_inductance"]) == (500.0, 1e-3)
    vesc = numbers(texts(tmp_path / "v", known, "vesc", **how)["rigid_motor_vesc.yaml"])
    assert vesc["foc_current_kp"] == pytest.approx(500 * 1e-3)
    assert vesc["foc_current_ki"] == pytest.approx(500 * 0.5 * R)
    pole = vesc["foc_motor_r"] / vesc["foc_motor_l"]
    assert vesc["foc_current_ki"] / vesc["foc_current_kp"] == pytest.approx(pole)  # cancels the pole of the winding
    simple = texts(tmp_path / "s", known, "simplefoc", **how)["rigid_motor_simplefoc.h"]
    assert "PID_current_d.P = 0.5;" in simple
    for format in ("odrive", "vesc", "simplefoc"):
        found = texts(tmp_path / f"{format}-without", motor(), format, winding="line", pole_pairs=7)
        text = " ".join(value for name, value in found.items() if name != README)
        assert "inductance = " not in text.replace("phase inductance", "")
        assert "current" not in text
        assert "gains of the current loop are left out" in found[README]
    for wrong in ("fast", 0, -3):
        with pytest.raises(emsid.ModelError, match="in rad/s"):
            emsid.export(known, "vesc", tmp_path / "x", winding="line", pole_pairs=7, bandwidth=wrong)


def test_friction_holds_an_axis_in_mujoco_up_to_its_level(tmp_path: Path) -> None:
    library = pytest.importorskip("mujoco")
    axis = GreyBox(LinearAxis(2.0, 3.0, Friction(14.0, 0.0, 1.0)), (Signal.SPEED,))
    emsid.export(axis, "mujoco", tmp_path, name="axis", dt=1.5e-3)
    simulated = library.MjModel.from_xml_path(str(tmp_path / "axis.xml"))
    for force, moves in ((13.0, 0.0), (-13.0, 0.0), (20.0, 3.0)):
        state = library.MjData(simulated)
        state.ctrl[0] = force
        for _ in range(1000):
            library.mj_step(simulated, state)
        speed = (1 - np.exp(-3.0 / 2.0 * 1000 * simulated.opt.timestep)) * (20.0 - 14.0) / 3.0 * (moves > 0)
        assert float(state.qvel[0]) == pytest.approx(speed, abs=2e-3)


@pytest.mark.parametrize("dt", [1e-3, 1.5e-3, 2.7e-3])
def test_samples_are_whole_numbers_of_steps_in_mujoco(dt: float, tmp_path: Path) -> None:
    stribeck = replace(motor().plant.motor, rotor_friction=GaussianStribeck(LEVEL, 0.006, 0.1))
    model = replace(motor(), plant=replace(motor().plant, motor=stribeck))
    for actuator in ("general", "dcmotor"):
        text = texts(tmp_path / actuator, model, "mujoco", name="m", dt=dt, actuator=actuator)["m.xml"]
        option = ElementTree.fromstring(text).find("option")
        assert option is not None
        count = dt / float(option.attrib["timestep"])
        assert count == pytest.approx(round(count), rel=1e-9)
        assert count >= dt / 1e-3 - 1e-9


def test_a_hanging_joint_begins_at_rest(tmp_path: Path) -> None:
    """Without friction it stays where it begins: sample by sample, in C and in MuJoCo."""
    free = geared(**{"rotor_friction.coulomb.forward": 0.0, "rotor_friction.coulomb.backward": 0.0})
    for level in (0.0, 0.2, -0.3):
        running = emsid.start(free, level, dt=1e-3)
        found = np.array([running.step(level) for _ in range(500)])
        at = 0.3 + np.arcsin(level * K / R * 20 / 0.4)
        np.testing.assert_allclose(found, at, atol=1e-9)
    text = texts(tmp_path, free, "mujoco", name="arm")["arm.xml"]
    key = ElementTree.fromstring(text).find(".//key")
    assert key is not None
    assert float(key.attrib["qpos"]) == pytest.approx(0.3)


def test_words_of_python_and_static_cascades_are_refused_for_python_control(tmp_path: Path) -> None:
    pytest.importorskip("control")
    with pytest.raises(emsid.ModelError, match="'class' is a word of Python"):
        emsid.export(motor(), "python-control", tmp_path / "out", name="class")
    for name in ("u0", "control", "random"):  # its own offset, and libraries that it loads
        with pytest.raises(emsid.ModelError, match=f"'{name}' is a name that the script or a library it loads uses"):
            emsid.export(motor(), "python-control", tmp_path / "out", name=name)
    static = emsid.blocks.Cascade((emsid.blocks.DeadZone(),), dt=0.1)
    with pytest.raises(emsid.ModelError, match="no linear part"):
        emsid.export(static, "python-control", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_every_filter_of_a_cascade_is_in_the_script(tmp_path: Path) -> None:
    pytest.importorskip("control")
    filters = [emsid.blocks.Rational(np.array([b]), np.array([a])) for b, a in ((1.0, -0.5), (3.0, -0.2))]
    cascade = emsid.blocks.Cascade((filters[0], emsid.blocks.DeadZone(), filters[1]), dt=0.1)
    scope: dict[str, object] = {}
    exec(texts(tmp_path, cascade, "python-control")["cascade.py"], scope)
    gains = [float(np.squeeze(scope[f"cascade_{k}"].dcgain())) for k in (1, 2)]  # type: ignore[attr-defined]
    assert gains == pytest.approx([2.0, 3.75])


@pytest.mark.parametrize("name", [*dict(regressions()), *dict(state_spaces()), *dict(processes()), *dict(cascades())])
def test_the_script_of_python_control_gives_the_numbers_of_a_model(name: str, tmp_path: Path) -> None:
    """With its offsets, and of a cascade with its static maps between the filters."""
    control, model = pytest.importorskip("control"), ALL[name]
    rate = getattr(model, "oversampling", 1)
    if rate > 1 or not getattr(model, "is_linear", True) or name in ("static", "wiener-hammerstein, user"):
        return
    scope: dict[str, Any] = {}
    exec(texts(tmp_path, model, "python-control", name="m")["m.py"], scope)
    u = inputs()
    blocks = getattr(model, "blocks", ())
    systems = iter([scope["m"]] if "m" in scope else [scope["m_1"], scope["m_2"]])
    x = u - scope["u0"]
    begin = np.full(1000, -scope["u0"])  # the steady state of a zero input
    for block in blocks or [None]:
        if block is None or hasattr(block, "transfer"):
            past = begin if blocks else begin[:0]
            found = control.forced_response(next(systems), inputs=np.concatenate([past, x])).outputs
            found = np.atleast_2d(found)
            begin, x = found[0, : len(past)], found[:, len(past) :] if block is None else found[0, len(past) :]
        else:
            begin, x = block.value(begin), block.value(x)
    truth = model.run(model.at_rest(0.0, DT), u[:, None])[0]
    np.testing.assert_allclose((np.atleast_2d(x).T + scope["y0"])[20:], truth[20:], atol=1e-9 * truth.std())


def test_an_angle_that_is_not_read_is_no_state_of_the_linear_part() -> None:
    pytest.importorskip("control")
    assert motor().to_control().nstates == 1
    assert GreyBox(motor().plant, (Signal.POSITION,)).to_control().nstates == 2
    assert 0.0 not in motor().to_control().poles()
    assert geared().to_control().nstates == 2  # gravity moves it by its angle


def test_every_input_of_a_regression_is_in_its_linear_part_however_small(tmp_path: Path) -> None:
    control = pytest.importorskip("control")
    structure = emsid.Structure.parse("y(t-1)", "u1(t-1)", "u1(t-2)", "u2(t-3)")
    model = RegressionModel(structure, np.array([0.9, 1e-16, 0.2, 0.3]), 0.01)
    scope: dict[str, object] = {}
    exec(texts(tmp_path, model, "python-control", name="both")["both.py"], scope)
    for k, numerator in enumerate(([1e-16, 0.2, 0.0], [0.0, 0.0, 0.3])):
        z = np.exp(0.5j)
        wanted = sum(b * z ** -(j + 1) for j, b in enumerate(numerator))
        found = control.evalfr(scope["both"][0, k], z)  # type: ignore[index]
        np.testing.assert_allclose(found, wanted / (1 - 0.9 / z), rtol=1e-12)
    assert 1e-16 in scope["both"].B[:, 0]  # type: ignore[attr-defined]


def test_a_table_of_cogging_is_the_torque_over_one_period(tmp_path: Path) -> None:
    values = {"cogging.period": 0.5, "cogging.cosine_1": 2e-3, "cogging.sine_2": -1e-3}
    plant = motor().plant.with_values(values)
    text = texts(tmp_path, replace(motor(), plant=plant), "csv")["rigid_motor_cogging.csv"]
    assert text.splitlines()[0] == "Position [rad],Cogging [N*m]"
    x, torque = np.array([[float(v) for v in line.split(",")] for line in text.splitlines()[1:]]).T
    assert (x[0], x[-1]) == (0.0, 0.5)
    assert torque == pytest.approx(2e-3 * np.cos(4 * pi * x) - 1e-3 * np.sin(8 * pi * x), abs=1e-15)


def test_a_delay_for_robots_is_in_steps_of_the_physics(tmp_path: Path) -> None:
    plant = motor(0.3).plant.with_values({"drive.delay": 0.012})
    found = texts(tmp_path, replace(motor(), plant=plant), "isaac-lab", timestep=0.004)
    assert "max_delay=3," in found["rigid_motor_actuator.py"]
    assert "give the option timestep" not in found[README]
    found = texts(tmp_path, replace(motor(), plant=plant), "mjlab", force=True)
    assert "delay_max_lag=2," in found["rigid_motor_actuator.py"]
    assert "The delay of 0.012 s is 2 steps of 0.005 s" in found[README]
    with pytest.raises(emsid.ModelError, match="give a positive number of s"):
        emsid.export(motor(), "mjlab", tmp_path / "no", timestep="fast")
