"""Joints of robots: gravity, gears, and friction that depends on the load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid import DataError, ModelError, Record
from emsid.identification.candidates import usual_for
from emsid.models.plants.drive import Feed
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.one_mass import Sliding
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.plant import Friction, LoadFriction, Motor, PowerFriction
from emsid.plants import Gravity, MotorPlant

DT = 5e-3
POSITION = (Signal.POSITION,)
TRUTH = {
    "rotor_inertia": 0.02,
    "rotor_viscous": 0.05,
    "rotor_friction.coulomb": 0.15,
    "gravity.torque": 1.2,
    "gravity.angle": 0.3,
}


def joint(feed: Feed = Feed.TORQUE, **values: float) -> MotorPlant:
    motor = Motor(inductance=0.0, load_inertia=1e-15, load_viscous=0.0, voltage_dead_zone=None).rigid()
    motor = replace(motor, rotor_friction=Friction(), load_friction=Friction())
    return MotorPlant(motor, gravity=Gravity(), feed=feed).with_values({**TRUTH, **values})


def torque(samples: int, seed: int, size: float = 0.8) -> np.ndarray:
    """A slow command that lifts the arm, with steps."""
    rng = np.random.default_rng(seed)
    slow = np.sin(2 * np.pi * 0.4 * DT * np.arange(samples)) + 0.5 * np.sin(2 * np.pi * 1.1 * DT * np.arange(samples))
    return size * (slow + 0.3 * np.repeat(rng.standard_normal(samples // 40 + 1), 40)[:samples])


def recorded(plant: MotorPlant, u: np.ndarray, seed: int = 0, counts: int = 4096, name: str = "arm") -> Record:
    """The angle of a joint that begins at rest where it hangs, in counts of an encoder."""
    start = np.zeros(plant.states)
    start[1] = plant.value("gravity.angle") * plant.sensor.ratio
    angle = plant.simulate(u[:, None], DT, start, POSITION)
    size = 2 * np.pi / counts
    return Record(u, np.round(angle / size) * size, DT, input_units="N*m", output_units="rad", name=name)


def test_gravity_swings_as_a_pendulum_does() -> None:
    from scipy.integrate import solve_ivp

    plant = joint(**{"rotor_friction.coulomb": 0.0})
    drag, weight, inertia = 0.05, 1.2, 0.02
    exact = solve_ivp(
        lambda t, x: [x[1], (-weight * np.sin(x[0] - 0.3) - drag * x[1]) / inertia],
        (0, 2), [2.0, 0.0], t_eval=DT * np.arange(400), rtol=1e-10, atol=1e-12,
    ).y[0]  # fmt: skip
    errors = []
    for steps in (1, 2, 4):
        run = replace(plant, steps=steps).simulate(np.zeros((400, 1)), DT, np.array([0.0, 2.0]), POSITION)[:, 0]
        errors.append(float(np.max(np.abs(run - exact))))
    assert errors[0] < 0.02
    assert errors[1] < 0.3 * errors[0]
    assert errors[2] < 0.3 * errors[1]  # of second order


def test_the_steps_of_a_joint_are_fine_enough_for_its_intervals() -> None:
    u = torque(500, 1)
    fine = replace(joint(), steps=64).simulate(u[:, None], DT, np.array([0.0, 0.3]), POSITION)
    record = Record(u, fine, DT, input_units="N*m", output_units="rad")
    free = list(emsid.plants.joint().for_command(record).default_free)
    wrong = {}
    for steps in (2, emsid.plants.joint().steps):
        fit = emsid.fit(replace(emsid.plants.joint(), steps=steps), record, free=free)
        wrong[steps] = abs(fit["rotor_inertia"].value / 0.02 - 1)
    assert wrong[emsid.plants.joint().steps] < 5e-5
    assert wrong[emsid.plants.joint().steps] < 0.35 * wrong[2]  # of second order


def test_behind_a_gear_the_motor_turns_against_the_torque_over_its_ratio() -> None:
    plain = joint()
    ratio = 50.0
    geared = replace(plain, sensor=Sensor(ratio=ratio)).with_values(
        {
            "rotor_inertia": 0.02 / ratio**2,
            "rotor_viscous": 0.05 / ratio**2,
            "rotor_friction.coulomb": 0.15 / ratio,
        }
    )
    u = torque(600, 1)
    angle = plain.simulate(u[:, None], DT, np.array([0.0, 0.3]), POSITION)
    behind = geared.simulate(u[:, None] / ratio, DT, np.array([0.0, 0.3 * ratio]), POSITION)
    np.testing.assert_allclose(behind, angle, rtol=1e-7, atol=1e-7)
    at_joint = {each.name: each.value for each in geared.quantities()}
    assert at_joint["inertia at the joint"] == pytest.approx(0.02)
    assert at_joint["damping at the joint"] == pytest.approx(0.05)
    assert at_joint["friction at the joint"] == pytest.approx(0.15)


def test_a_weight_adds_its_torque_and_its_inertia() -> None:
    loaded = joint(**{"gravity.mass": 0.5, "gravity.length": 0.2, "gravity.acceleration": 9.81})
    alike = joint(**{"gravity.torque": 1.2 + 0.5 * 9.81 * 0.2, "rotor_inertia": 0.02 + 0.5 * 0.2**2})
    u = torque(400, 2, 2.5)[:, None]
    start = np.array([0.0, 0.3])
    np.testing.assert_allclose(
        loaded.simulate(u, DT, start, POSITION), alike.simulate(u, DT, start, POSITION), rtol=1e-9, atol=1e-9
    )


def test_a_joint_at_rest_is_held_by_its_drive_until_the_first_command_acts() -> None:
    plant = joint(**{"rotor_friction.coulomb": 0.0}).with_drive(delay=3.5 * DT)
    held = np.array([0.0, 1.5, 0.0, 1.0])
    run = plant.simulate(np.zeros((30, 1)), DT, held, POSITION)[:, 0]
    assert np.max(np.abs(run[:4] - 1.5)) < 1e-12
    assert run[-1] < 1.4  # it falls when the command acts


# --- friction that depends on the load -------------------------------------------------------------------------------

LAWS = {
    "M1": (LoadFriction(0.4), lambda v, m, e: 0.4),
    "M2": (LoadFriction(0.4, 0.05, 2.0), lambda v, m, e: 0.4 + 0.05 * np.exp(-2 * v)),
    "M3": (LoadFriction(0.4, load=0.2), lambda v, m, e: 0.4 + 0.2 * abs(m - e)),
    "M4": (
        LoadFriction(0.4, 0.05, 2.0, 0.2, 0.1),
        lambda v, m, e: 0.4 + 0.2 * abs(m - e) + np.exp(-2 * v) * (0.05 + 0.1 * abs(m - e)),
    ),
    "M5": (
        PowerFriction(0.4, 0.05, 2.0, 0.1, 0.3, 0.05, 0.02),
        lambda v, m, e: 0.4 + abs(0.1 * m - 0.3 * e) + np.exp(-2 * v) * (0.05 + abs(0.05 * m - 0.02 * e)),
    ),
    "M6": (
        PowerFriction(0.4, 0.05, 2.0, 0.1, 0.3, 0.05, 0.02, 0.01, 0.03),
        lambda v, m, e: (
            0.4
            + abs(0.1 * m - 0.3 * e)
            + np.exp(-2 * v)
            * (0.05 + abs(0.05 * m - 0.02 * e) + (m * e < 0) * (0.03 * e * e if abs(m) > abs(e) else 0.01 * m * m))
        ),
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_the_models_of_the_paper(name: str) -> None:
    law, equation = LAWS[name]
    level = type(law).level
    for v, m, e in np.random.default_rng(0).uniform(-2, 2, (50, 3)):
        assert level(abs(v), law.numbers, 0, m, e) == pytest.approx(equation(abs(v), m, e), rel=1e-12)


def slowly(law, equation, force, load, waves, dt, steps, mass, drag):
    """One mass under a law that sees the load, in small steps in which friction never turns the motion."""
    speed = position = 0.0
    h, found = dt / steps, np.empty((len(force) - 1, 2))
    for k in range(len(found)):
        found[k] = speed, position
        for _ in range(steps):
            ripple = sum(c * np.cos(n * position) + s * np.sin(n * position) for n, c, s in waves)
            made, outside = force[k + 1] + load - drag * speed, -load - ripple
            level = equation(abs(speed), made, outside)
            pushed = speed + h * (made + outside) / mass
            speed = np.sign(pushed) * max(abs(pushed) - h * level / mass, 0.0)
            position += h * speed
    return found


@pytest.mark.parametrize("name", LAWS)
def test_a_mass_moves_under_them_as_in_small_steps(name: str) -> None:
    from emsid.models.plants.lost_motion import Body
    from emsid.models.plants.one_mass import compiled_with_law, move

    law, equation = LAWS[name]
    force = np.repeat(np.random.default_rng(3).uniform(-2, 2, 20) * (np.arange(20) % 2), 6) - 0.2
    waves = np.array([[1.0, 0.1, 1.0]])
    friction, none = Sliding.of(law, waves=waves, load=0.2), np.zeros(len(force))
    found = np.zeros((2, len(force)))
    compiled_with_law(type(law).level, move)(
        Body(0.5, 0.0), friction, force + 0.2, none + 0.3, none[1:], 0.02, 0.0, 8, 0, np.zeros(2), *found, none
    )
    found = found.T
    errors = []
    for steps in (20, 80):
        slow = slowly(law, equation, force, 0.2, waves, 0.02, steps, 0.5, 0.3)
        errors.append(float(np.max(np.abs(found[:-1] - slow))))
    assert errors[1] < 0.01 * np.max(np.abs(found[:, 0]))
    assert errors[1] < 0.4 * errors[0]
    assert np.count_nonzero(found[:, 0] == 0.0) > 3  # it sticks, exactly


def test_without_load_they_are_the_law_of_the_paper() -> None:
    plain, loaded = Friction(0.4, 0.05, 2.0), LoadFriction(0.4, 0.05, 2.0)
    u = torque(300, 4)[:, None]
    runs = [
        joint().with_frictions({"rotor_friction": law}).simulate(u, DT, np.array([0.0, 0.3]), POSITION)
        for law in (plain, loaded, PowerFriction(0.4, 0.05, 2.0))
    ]
    for run in runs[1:]:
        np.testing.assert_allclose(run, runs[0], rtol=1e-10, atol=1e-10)


def test_a_self_locking_gear_holds_its_arm_at_any_angle() -> None:
    plant = joint().with_frictions({"rotor_friction": LoadFriction(0.0, load=1.1)})
    run = plant.simulate(np.zeros((50, 1)), DT, np.array([0.0, 0.3 + np.pi / 2]), (Signal.SPEED,))
    assert np.all(run == 0.0)
    driven = plant.simulate(np.full((50, 1), 40.0), DT, np.array([0.0, 0.3]), (Signal.SPEED,))
    assert np.all(driven == 0.0)  # a factor above one holds what the motor does, too


@pytest.mark.parametrize("name", ["M4", "M5", pytest.param("M6", marks=pytest.mark.long)])  # as M5, compiled anew
def test_sample_by_sample_and_in_files_they_are_the_same(name: str, tmp_path) -> None:
    law, _ = LAWS[name]
    plant = joint(Feed.VOLTAGE).with_frictions({"rotor_friction": law}).with_drive(delay=0.4 * DT)
    plant = plant.with_values({"resistance": 2.0, "motor_constant": 0.8, "load_torque": 0.05})
    model = GreyBox(plant, (Signal.POSITION, Signal.SPEED))
    u = 6.0 * torque(200, 5)
    expected, _ = model.run(model.at_rest(0.0, DT), u[:, None])
    running = emsid.start(model, dt=DT)
    np.testing.assert_allclose([running.step(each) for each in u], expected, rtol=1e-9, atol=1e-9)
    again = GreyBox.from_data(model.to_data())
    assert again.plant == plant


# --- identification --------------------------------------------------------------------------------------------------


def test_a_joint_is_found_in_counts_of_its_encoder() -> None:
    records = [recorded(joint(), torque(1000, seed), name=f"{seed}") for seed in (1, 2)]
    fit = emsid.fit(emsid.plants.joint(), records, search=False)
    for name, true in TRUTH.items():
        row = fit[name]
        assert row.interval[1] - row.interval[0] < 0.01 * true
        assert row.value == pytest.approx(true, rel=2e-3)


def test_friction_by_load_is_found_where_it_is() -> None:
    truth = joint().with_frictions({"rotor_friction": LoadFriction(0.1, load=0.1)})
    record = recorded(truth, torque(1000, 1))
    fit = emsid.plants.choose(emsid.plants.joint(), record, effects=("load-friction",))
    assert fit.names[-1] == "rotor_friction.load"
    assert fit["rotor_friction.load"].value == pytest.approx(0.1, rel=0.02)
    assert fit["rotor_friction.coulomb"].value == pytest.approx(0.1, rel=0.02)


# --- beside MuJoCo ---------------------------------------------------------------------------------------------------


def moved_by_mujoco(library, path, u):
    """The angle of an exported joint at the samples, for its commands, from 0.3 rad."""
    simulated = library.MjModel.from_xml_path(str(path))
    state, found = library.MjData(simulated), []
    state.qpos[0] = 0.3
    for command in u:
        found.append(float(state.qpos[0]))
        state.ctrl[0] = command
        for _ in range(round(DT / simulated.opt.timestep)):
            library.mj_step(simulated, state)
    return found


def test_an_exported_joint_moves_in_mujoco_as_its_model(tmp_path) -> None:
    library = pytest.importorskip("mujoco")
    geared = {"rotor_inertia": 2e-4, "rotor_viscous": 5e-4, "rotor_friction.coulomb": 0.015}
    model = GreyBox(replace(joint(), sensor=Sensor(ratio=10.0)).with_values(geared), POSITION)
    emsid.export(model, "mujoco", tmp_path, dt=DT)
    u = torque(600, 1) / 10.0
    found = moved_by_mujoco(library, tmp_path / "joint.xml", u)
    start = np.zeros(model.plant.states)
    start[1] = 3.0
    truth = model.plant.simulate(u[:, None], DT, start, POSITION)[:, 0]
    assert np.sqrt(np.mean((truth - found) ** 2)) < 0.01 * np.std(truth)


def test_an_exported_servo_moves_in_mujoco_as_its_model(tmp_path) -> None:
    library = pytest.importorskip("mujoco")
    model = GreyBox(servo(), POSITION)
    emsid.export(model, "mujoco", tmp_path, dt=DT)
    u = targets(400, 3)
    found = moved_by_mujoco(library, tmp_path / "joint.xml", u)
    truth = model.plant.simulate(u[:, None], DT, np.array([0.0, 0.3]), POSITION)[:, 0]
    assert np.sqrt(np.mean((truth - found) ** 2)) < 0.02 * np.std(truth)


def test_a_joint_of_mujoco_is_identified(monkeypatch) -> None:
    pytest.importorskip("mujoco")
    from pathlib import Path

    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "bench"))
    import joints

    monkeypatch.setattr(joints, "SAMPLES", 1200)
    truth = joints.Joint.drawn(3)
    records = [joints.simulated(truth, kind)[0] for kind in (0, 1)]
    fit = emsid.fit(emsid.plants.joint(), records, fixed={"sensor.ratio": joints.GEAR}, search=False)
    for name, true in truth.truth.items():
        assert fit[name].value == pytest.approx(true, rel=5e-3)


# --- a servo ---------------------------------------------------------------------------------------------------------

SERVO = {"servo.proportional": 8.0, "servo.derivative": 0.1, "servo.limit": 3.0}


def servo() -> MotorPlant:
    record = Record([0.0, 1.0], [0.0, 1.0], DT, input_units="rad", output_units="rad")
    plant = emsid.plants.joint().for_command(record)
    return plant.with_values({**TRUTH, **SERVO})


def targets(samples: int, seed: int) -> np.ndarray:
    return 0.3 + np.repeat(np.random.default_rng(seed).uniform(-1.2, 1.2, samples // 80 + 1), 80)[:samples]


def test_a_servo_holds_its_arm_where_friction_lets_it() -> None:
    plant = servo()
    run = plant.simulate(np.full((600, 1), 1.3), DT, np.array([0.0, 0.3]), POSITION)[:, 0]
    error = 8.0 * (1.3 - run[-1]) - 1.2 * np.sin(run[-1] - 0.3)
    assert run[-1] == run[-2]  # at rest, exactly
    assert abs(error) <= 0.15 + 1e-12
    assert abs(1.3 - run[-1]) > 0.05  # below its target, as gravity pulls


def test_a_servo_is_a_torque_of_what_it_makes_in_every_step() -> None:
    plant = replace(servo(), steps=1)
    target, angle = targets(300, 0), np.array([0.0, 0.3])
    run = plant.simulate(target[:, None], DT, angle, (Signal.POSITION, Signal.SPEED))
    made = np.clip(8.0 * (target - run[:, 0]) - 0.1 * run[:, 1], -3.0, 3.0)
    again = replace(joint(), steps=1).simulate(made[:, None], DT, angle, POSITION)
    np.testing.assert_allclose(again, run[:, :1], atol=1e-9)


def test_a_servo_is_identified_from_its_targets() -> None:
    truth, records = servo(), []
    for seed in (1, 2):
        u, start = targets(800, seed), np.zeros(truth.states)
        start[1] = 0.3
        y = truth.simulate(u[:, None], DT, start, POSITION)
        counted = 2 * np.pi / 4096 * np.round(4096 / (2 * np.pi) * y)
        records.append(Record(u, counted, DT, input_units="rad", output_units="rad"))
    fit = emsid.fit(emsid.plants.joint(), records, fixed=SERVO, search=False)
    for name, true in TRUTH.items():
        assert fit[name].value == pytest.approx(true, rel=0.05)
    assert GreyBox.from_data(fit.model.to_data()).plant == fit.model.plant


@pytest.mark.parametrize(
    ("wrong", "value"),
    [
        pytest.param("servo.proportional", 2.0, marks=pytest.mark.long),
        ("servo.derivative", 0.5),
        pytest.param("servo.limit", 20.0, marks=pytest.mark.long),
        ("servo.limit", 1.5),
    ],
)
def test_gains_that_contradict_the_record_are_named_with_better_ones(wrong: str, value: float) -> None:
    u, start = targets(800, 1), np.zeros(servo().states)
    start[1] = 0.3
    y = servo().simulate(u[:, None], DT, start, POSITION)
    record = Record(u, 2 * np.pi / 4096 * np.round(4096 / (2 * np.pi) * y), DT, input_units="rad", output_units="rad")
    fit = emsid.fit(emsid.plants.joint(), record, fixed={**SERVO, wrong: value}, search=False)
    found = {each.subject: each.data["better"] for each in fit.findings if each.code == "value-contradicted"}
    assert found[wrong] == pytest.approx(SERVO[wrong], rel=0.01)


# --- several records -------------------------------------------------------------------------------------------------


def loaded_records() -> list[Record]:
    """Two records with weights that are known, driven by a voltage."""
    records = []
    for name, mass in (("light", 0.1), ("heavy", 0.5)):
        plant = joint(Feed.VOLTAGE, **{"resistance": 2.0, "motor_constant": 1.0, "gravity.torque": 0.4})
        plant = plant.with_values({"gravity.mass": mass, "gravity.length": 0.3})
        record = recorded(plant, 4.0 * torque(700, 1), name=name)
        records.append(replace(record, input_units=("V",)))
    return records


def test_known_weights_separate_what_one_load_does_not() -> None:
    known = {"gravity.mass[light]": 0.1, "gravity.mass[heavy]": "500 g", "gravity.length": 0.3}
    plant = emsid.plants.joint()
    fit = emsid.fit(plant, loaded_records(), fixed=known, free=[*plant.default_free, "rotor_viscous"])
    true = {"gravity.torque": 0.4, "rotor_inertia": 0.02, "motor_constant": 1.0, "resistance": 2.0}
    for name, value in true.items():
        assert fit[name].value == pytest.approx(value, rel=0.05), name
    alone = emsid.fit(plant, loaded_records()[0], fixed={"gravity.mass": 0.1, "gravity.length": 0.3}, search=False)
    assert len(alone.names) < len(fit.names)  # one load leaves the scale of all torques open


def test_a_weight_of_no_record_is_refused() -> None:
    with pytest.raises(ModelError, match="there is no record medium; the records are light and heavy"):
        emsid.fit(emsid.plants.joint(), loaded_records(), fixed={"gravity.mass[medium]": 0.1})
    with pytest.raises(ModelError, match="it is missing for heavy"):
        emsid.fit(emsid.plants.joint(), loaded_records(), fixed={"gravity.mass[light]": 0.1})


# --- by default ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_is_tried_by_default_where_an_angle_hangs(seed: int) -> None:
    record = recorded(joint(), torque(1500, seed))
    assert "joint" in usual_for(record)
    free = recorded(joint(**{"gravity.torque": 0.0}), torque(1500, seed) - np.mean(torque(1500, seed)))
    assert "joint" not in usual_for(free)
    assert "rigid-motor" in usual_for(free)


# --- bad input -------------------------------------------------------------------------------------------------------


def test_an_arm_that_never_moves_against_gravity_is_refused() -> None:
    still = Record(0.1 * np.sin(np.arange(500)), np.full(500, 0.3), DT, input_units="N*m", output_units="rad")
    with pytest.raises(DataError, match="nothing moves"):
        emsid.fit(emsid.plants.joint(), still)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"servo.proportional": -8.0}, "servo with gains -8 and 0"),
        ({"servo.limit": -1.0}, "servo with a torque limit of -1"),
        ({"gravity.torque": -1.0}, "gravity with torque -1"),
        ({"gravity.period": 0.0}, "gravity with period 0"),
    ],
)
def test_impossible_joints_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        joint().with_values(values)


def test_an_angle_in_ticks_shows_a_turn_of_its_encoder() -> None:
    record = recorded(joint(), torque(1500, 1))
    ticks = replace(record, output=record.output * 4096 / (2 * np.pi))
    free = ["rotor_viscous", "rotor_inertia", "rotor_friction.coulomb", "gravity.torque", "gravity.angle"]
    start = emsid.plants.joint().with_values({"gravity.period": 4000.0, "gravity.angle": 0.3 * 4000 / 2 / np.pi})
    fit = emsid.fit(start, ticks, free=[*free, "gravity.period"])
    assert fit["gravity.period"].value == pytest.approx(4096, rel=0.01)


# --- what rounding explains ------------------------------------------------------------------------------------------


def test_an_error_above_that_of_rounding_is_one_of_the_model() -> None:
    own = emsid.fit(emsid.plants.joint(), recorded(joint(), torque(800, 1, 0.3)), search=False)
    assert not [each for each in own.findings if each.code == "error-above-rounding"]
    gear = joint().with_frictions({"rotor_friction": PowerFriction(0.1, motor=0.1, outside=0.02)})
    record = recorded(gear, torque(800, 1, 0.3))
    fit = emsid.fit(emsid.plants.joint(), record, search=False)
    (found,) = (each for each in fit.findings if each.code == "error-above-rounding")
    rounding = 2 * np.pi / 4096 / np.sqrt(12)
    assert found.data["ratio"] == pytest.approx(np.sqrt(fit.noise_variance) / rounding, rel=1e-3)
    noise = 0.002 * np.random.default_rng(0).standard_normal(record.output.shape)
    noisy = replace(record, output=np.round((record.output + noise) * 4096 / (2 * np.pi)) * 2 * np.pi / 4096)
    other = emsid.fit(emsid.plants.joint(), noisy, search=False)
    assert not [each for each in other.findings if each.code == "error-above-rounding"]  # the rest is noise


@pytest.mark.parametrize("seed", [1, 2])
def test_intervals_hold_the_truth_where_an_effect_is_missing_and_the_reading_has_no_noise(seed) -> None:
    """A gear loses a part of the torque; least squares is off by two of its own half widths in inertia."""
    gear = joint().with_frictions({"rotor_friction": PowerFriction(0.1, motor=0.1, outside=0.02)})
    fit = emsid.fit(emsid.plants.joint(), recorded(gear, torque(1500, seed, 0.3)), search=False)
    for name in ("rotor_viscous", "rotor_inertia", "gravity.torque", "gravity.angle"):
        low, high = fit[name].interval
        assert low <= joint().value(name) <= high
        assert high - low < 0.5 * abs(joint().value(name)) or name == "rotor_viscous"


# --- gravity that a record does not show -----------------------------------------------------------------------------


def unseen(record: Record) -> list[dict[str, float]]:
    fit = emsid.fit(emsid.plants.joint(), record, search=False)
    return [each.data for each in fit.findings if each.code == "gravity-not-seen"]


@pytest.mark.parametrize("feed", [Feed.TORQUE, Feed.VOLTAGE])
def test_gravity_that_a_record_does_not_show_is_said(feed: Feed) -> None:
    size, unit = (1.0, "N*m") if feed is Feed.TORQUE else (4.0, "V")
    u = size * (torque(1200, 1) - torque(1200, 1).mean())
    known = {"resistance": 2.0, "motor_constant": 1.0} if feed is Feed.VOLTAGE else {}
    (level,) = unseen(replace(recorded(joint(feed, **known, **{"gravity.torque": 0.0}), u), input_units=(unit,)))
    assert level["moved"] > 30.0
    assert level["most"] < 0.01 * 1.2
    assert not unseen(replace(recorded(joint(feed, **known), u), input_units=(unit,)))  # only its size is unknown


def test_a_record_that_hardly_moves_against_gravity_is_to_be_a_lift() -> None:
    plant = joint(**{"rotor_friction.coulomb": 0.3})
    k = np.arange(700)
    pushes = 1.2 * np.sin(0.9) + 0.45 * np.sign(np.sin(2 * np.pi * k / 37)) * (k % 7 < 3)
    angle = plant.simulate(pushes[:, None], DT, np.array([0.0, 1.2, 0.0, 1.0]), POSITION)
    step = 2 * np.pi / 400
    record = Record(pushes, np.round(angle / step) * step, DT, input_units="N*m", output_units="rad")
    (small,) = unseen(record)
    assert small["moved"] == pytest.approx(0.9)
    assert small["most"] > 10 * 1.2  # nothing is known of it


def test_a_servo_that_steps_at_the_first_sample_is_followed_from_where_its_arm_hangs() -> None:
    """A polynomial through the first samples cannot follow the step: it shows a speed where the arm is at rest."""
    count, hangs = 2 * np.pi / 4096, 0.3
    servo = emsid.plants.Servo(proportional=8.0, derivative=0.1, limit=3.0)
    gravity = emsid.plants.Gravity(torque=1.2, angle=hangs)
    truth = replace(emsid.plants.joint(), gravity=gravity, servo=servo, feed=emsid.plants.Feed.POSITION)
    truth = truth.with_values({"rotor_inertia": 0.02, "rotor_viscous": 0.05, "rotor_friction.coulomb": 0.1})
    target = hangs + np.repeat(np.random.default_rng(2).uniform(-1.3, 1.3, 8), 75)
    angle = truth.simulate(target[:, None], 5e-3, np.array([0.0, hangs, 0.0, 1.0]), (Signal.POSITION,))
    record = Record(target, count * np.round(angle / count), 5e-3, input_units="rad", output_units="rad")
    free = ["rotor_inertia", "rotor_viscous", "rotor_friction.coulomb", "gravity.torque"]
    fit = emsid.fit(truth, record, free=free, fixed={"servo.proportional": 8.0})
    assert fit.states[0][0] == pytest.approx(0.0, abs=1e-3)  # the set that the counts allow is refined from rest
    assert fit.states[0][1] == pytest.approx(hangs, abs=count / 2)
    assert fit.noise_variance < 1.5 * count**2 / 12
    assert "error-above-rounding" not in {finding.code for finding in fit.findings}
