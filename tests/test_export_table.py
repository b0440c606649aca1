"""Every kind of model in every format: exported, run by another program, and compared with its free run.

`TABLE` has for every kind and format the largest difference of the outputs over their deviation; a format that is not
there refuses the kind in one line, and writes no file. `test_export_c.py` and `test_export_matlab.py` run every model
in C and in Octave within the same bounds.
"""

from __future__ import annotations

import ast
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emsid
from emsid.exports import FORMATS
from emsid.exports.verb import README
from emsid.models.plants.drive import Drive
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from model_examples import ALL, DT, inputs, joints
from test_export_c import in_c, width


def at_once(model: Any) -> GreyBox:
    """A plant without delay, lag and Stribeck friction, which MuJoCo does not have, in steps as fine as its own."""
    plant = replace(model.plant, drive=Drive(), sensor=replace(model.plant.sensor, lag=0.0), steps=20)
    return replace(model, plant=plant.with_values({f"{plant.friction_name}.stribeck": 0.0}))


KINDS = {
    "regression": ALL["friction"],
    "linear regression": ALL["arx"],
    "state space": ALL["state space, two outputs"],
    "polynomials": ALL["armax"],
    "process": ALL["process, late"],
    "cascade": ALL["wiener-hammerstein, saturation"],
    "static map": ALL["static"],
    "feedback": ALL["feedback, spline"],
    "motor": ALL["rigid motor"],
    "motor with shaft": ALL["elastic motor"],
    "axis": ALL["linear axis"],
    "joint": ALL["joint"],
    "axis at once": at_once(ALL["linear axis"]),
    "joint at once": at_once(ALL["joint"]),
    "servo at once": at_once(dict(joints())["servo"]),
    **dict(joints()),
}
EXACT, FLOAT = 1e-12, 1e-4
BLOCKS = {"c99": EXACT, "fmu": EXACT, "arduino": FLOAT, "matlab": 1e-9}
PLANT = {"c99": EXACT, "fmu": EXACT, "arduino": FLOAT, "matlab": 1e-9}
LINEAR = {"python-control": 1e-9}
ROBOT = {"isaac-lab": 0.03, "mjlab": 0.03}
TABLE: dict[str, dict[str, float]] = {
    "regression": BLOCKS,
    "linear regression": {**BLOCKS, **LINEAR, "fixed-point": 1e-7},
    **{kind: {**BLOCKS, **LINEAR} for kind in ("state space", "polynomials", "process", "cascade")},
    **dict.fromkeys(("static map", "feedback"), BLOCKS),
    # dry friction and the dead zone of these plants are not linear, and Modelica has no delay and no lag of the sensor
    "motor": {**PLANT, "modelica": 5e-4, "mujoco": 0.05, **ROBOT},
    "motor with shaft": {format: bound for format, bound in PLANT.items() if format != "matlab"},
    **dict.fromkeys(("axis", "joint", *dict(joints())), PLANT),
    "axis at once": {"modelica": 5e-4, "mujoco": 0.05, **ROBOT},
    "joint at once": {"modelica": 5e-4, "mujoco": 0.05, **ROBOT},
    "servo at once": ROBOT,
}
ROBOTS = {"mujoco", "isaac-lab", "mjlab"}
JOINT = {"python-control", "csv", *ROBOTS, "wpilib", "odrive", "vesc", "moteus", "simplefoc"}
WRITTEN = {
    "regression": {"python-control"},
    **{kind: {"csv"} for kind in ("cascade", "static map", "feedback")},
    "motor": JOINT | {"modelica"},
    "joint": JOINT | {"modelica"},
    **{name: JOINT for name, _ in joints()},
    "motor with shaft": {"matlab", "python-control", "csv"},
    "axis": {"python-control", "csv", "modelica", *ROBOTS},
}
"""Formats that carry a part of a kind only: its README says what is left out."""


def commands(model: Any) -> np.ndarray:
    return np.column_stack([inputs(seed) for seed in range(width(model))])


def exported(model: Any, format: str, folder: Path) -> None:
    options: dict[str, Any] = {}
    if format in ("odrive", "vesc", "moteus", "simplefoc"):
        options = {"winding": "line", "pole_pairs": 7}
    if format in ROBOT:
        options = {"timestep": DT / 20}
    if format == "fixed-point":
        truth = model.run(model.at_rest(0.0, DT), commands(model))[0]
        sizes = [np.abs(truth).max(), *np.abs(commands(model)).max(axis=0)]
        options = {"largest": ",".join(map(str, sizes))}
    emsid.export(model, format, folder, name="plant", dt=None if model.dt else DT, **options)


def by_arduino(model: Any, u: np.ndarray, folder: Path) -> np.ndarray:
    return in_c(model, u, folder / "c", single=True)


def by_fmu(model: Any, u: np.ndarray, folder: Path) -> np.ndarray:
    from test_export_fmu import stepped

    return stepped(folder / "plant.fmu", "3.0", u, model.dt or DT)


def by_fixed_point(model: Any, u: np.ndarray, folder: Path) -> np.ndarray:
    from test_export_fixed_point import in_c as in_words

    truth = model.run(model.at_rest(0.0, DT), u)[0]
    return in_words(model, emsid.Record(u, truth, DT), 32, folder / "words")[0][:, None]


def by_python_control(model: Any, u: np.ndarray, folder: Path) -> np.ndarray:
    """The systems of the script, and between those of a cascade its static maps."""
    control = pytest.importorskip("control")
    scope: dict[str, Any] = {}
    exec((folder / "plant.py").read_text("utf-8"), scope)
    blocks, systems = (
        getattr(model, "blocks", [None]),
        [scope[name] for name in ("plant", "plant_1", "plant_2") if name in scope],
    )
    x = np.vstack([np.zeros((1000, u.shape[1])), u]) - scope["u0"]  # the steady state of a zero input
    for block in blocks:
        if block is None or hasattr(block, "transfer"):
            x = np.atleast_2d(control.forced_response(systems.pop(0), inputs=x.T).outputs).T
        else:
            x = block.value(x)
    return np.asarray(x[1000:] + scope["y0"])


def by_modelica(model: Any, u: np.ndarray, folder: Path) -> np.ndarray:
    from test_export_modelica import simulated

    return simulated(model, u[:, 0].tolist(), folder / "m", dt=DT, held=1)[0]


def by_mujoco(model: Any, u: np.ndarray, folder: Path) -> np.ndarray:
    library = pytest.importorskip("mujoco")
    simulated = library.MjModel.from_xml_path(str(folder / "plant.xml"))
    scope: dict[str, Any] = {"ctrl": float}
    if (folder / "plant_ctrl.py").exists():
        exec((folder / "plant_ctrl.py").read_text("utf-8"), scope)
    state, found = library.MjData(simulated), []
    if simulated.nkey:
        library.mj_resetDataKeyframe(simulated, state, 0)
    for command in u[:, 0]:
        there = {Signal.POSITION: state.qpos, Signal.SPEED: state.qvel}
        found.append([float(there[signal][0]) for signal in model.signals])
        state.ctrl[0] = scope["ctrl"](command)
        for _ in range(round(DT / simulated.opt.timestep)):
            library.mj_step(simulated, state)
    return np.array(found)


def by_robot(model: Any, u: np.ndarray, folder: Path) -> np.ndarray:
    """A joint with the actuator of the file, whose equations are written here as both programs document them."""
    text = (folder / "plant_actuator.py").read_text("utf-8")
    (call,) = [
        node.value for node in ast.parse(text).body if isinstance(node, ast.Assign) and node.targets[0].id == "ACTUATOR"
    ]
    of = {each.arg: ast.literal_eval(each.value) for each in call.keywords}
    scope: dict[str, Any] = {}
    if call.func.id not in ("DelayedPDActuatorCfg", "BuiltinPositionActuatorCfg") or "def effort" in text:
        exec(text[text.index("GAIN =") :], scope)
    moving, viscous = (
        of.get(new, of.get(old))
        for new, old in (("dynamic_friction", "frictionloss"), ("viscous_friction", "viscous_damping"))
    )
    late, limit = of.get("max_delay", of.get("delay_max_lag")), of.get("effort_limit", np.inf)
    gravity, h = getattr(model.plant, "gravity", None), DT / 20
    q, v, found, sent = (
        (0.0 if gravity is None else float(model.at_rest(0.0, DT).motion[1]) / model.plant.sensor.ratio),
        0.0,
        [],
        [None] * late,
    )
    for command in u[:, 0]:
        there = {Signal.POSITION: q, Signal.SPEED: v}
        found.append([there[signal] for signal in model.signals])
        for _ in range(20):
            sent.append(command)
            now = sent[-1 - late] or 0.0
            target, more = (0.0, scope["effort"](now)) if scope else (now, 0.0)
            effort = of["stiffness"] * (target - q) - of["damping"] * v + more
            for _ in range(8):  # a physics engine holds the effort over its step
                weight = 0.0 if gravity is None else gravity.whole * np.sin(q - gravity.angle)
                force = np.clip(effort, -limit, limit) - viscous * v - weight
                level = moving if v else of.get("friction", moving)
                free = v + h / 8 * force / of["armature"]
                v = np.sign(free) * max(abs(free) - h / 8 * level / of["armature"], 0.0)
                q += h / 8 * v
    return np.array(found)


by_isaac_lab = by_mjlab = by_robot
RUN: dict[str, Callable[[Any, np.ndarray, Path], np.ndarray]] = {
    name.removeprefix("by_").replace("_", "-"): run for name, run in list(globals().items()) if name.startswith("by_")
}


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize(
    ("kind", "format"), [(kind, format) for kind in TABLE for format in TABLE[kind] if format in RUN]
)
def test_an_export_gives_the_free_run(kind: str, format: str, tmp_path: Path) -> None:
    model = KINDS[kind]
    u = commands(model)
    exported(model, format, tmp_path)
    truth = model.run(model.at_rest(0.0, model.dt or DT), u)[0]
    found = RUN[format](model, u, tmp_path)
    error = (np.abs(found - truth).max(axis=0) / truth.std(axis=0)).max()
    print(f"\n{kind} | {format} | {error:.1e}")
    assert error <= TABLE[kind][format]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.endswith("at once")])
def test_what_a_format_cannot_carry_is_in_its_readme_or_refused(kind: str, tmp_path: Path) -> None:
    for format in FORMATS:
        folder = tmp_path / format
        if format in TABLE[kind] or format in WRITTEN.get(kind, ()):
            exported(KINDS[kind], format, folder)
            left_out = (folder / README).read_text("utf-8").split("## What is not carried\n\n")[1].splitlines()
            assert left_out
            assert all(line.startswith("- ") and line.endswith(".") for line in left_out)
            if format not in TABLE[kind]:
                assert len(left_out) > 1, format  # beside noise and intervals
        else:
            with pytest.raises(emsid.ModelError):
                exported(KINDS[kind], format, folder)
            assert not folder.exists()
