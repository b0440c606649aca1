"""Models as C: compiled without a warning, and run beside the model."""

import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit

import emsid
from emsid import MotorPlant
from emsid.models.model import Model
from emsid.models.plants.cogging import Cogging
from emsid.models.plants.drive import Bridge, Drive, Hold
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.plant import DeadZoneLaw, Friction, GaussianStribeck, Motor, PowerFriction
from emsid.plants import FrictionLaw, LawParameter, Measure, friction_law
from model_examples import DT, EXPORTED, inputs, joints, plants

FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]
ALL: dict[str, Any] = EXPORTED
NO_FORM = {name for name in ALL if "user" in name or name.startswith("own plant")}
"""Functions in Python."""
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

MAIN = """\
#include <stdio.h>
#include "model.h"

int main(void)
{
    model_state state;
    model_real u[MODEL_INPUTS];
    model_real y[MODEL_OUTPUTS];
    model_init(&state);
    for (;;) {
        int k;
        for (k = 0; k < MODEL_INPUTS; ++k) {
            double value;
            if (scanf("%lf", &value) != 1) {
                return 0;
            }
            u[k] = (model_real)value;
        }
        model_step(&state, u, y);
        for (k = 0; k < MODEL_OUTPUTS; ++k) {
            printf("%.17g ", (double)y[k]);
        }
        printf("\\n");
    }
}
"""


def in_c(model: Any, u: np.ndarray, folder: Path, **options: Any) -> np.ndarray:
    """The outputs (N, ny) of the exported model for inputs (N, nu)."""
    emsid.export(model, "c99", folder, name="model", dt=None if model.dt else DT, **options)
    (folder / "main.c").write_text(MAIN)
    program = folder / "program"
    subprocess.run(["gcc", *FLAGS, "-o", program, folder / "main.c", folder / "model.c", "-lm"], check=True)
    text = "\n".join(" ".join(f"{value!r}" for value in row) for row in u.tolist())
    done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    return np.array([[float(value) for value in line.split()] for line in done.stdout.splitlines()])


def expected(model: Model, u: np.ndarray) -> np.ndarray:
    return model.run(model.at_rest(0.0, DT), u)[0]


def width(model: Model) -> int:
    return emsid.start(model, dt=DT).inputs


@needs_gcc
@pytest.mark.parametrize("name", [name for name in ALL if name not in NO_FORM])
def test_c_gives_the_numbers_of_the_model(name: str, tmp_path: Path) -> None:
    model = ALL[name]
    u = np.column_stack([inputs(seed) for seed in range(width(model))])
    found = in_c(model, u, tmp_path)
    truth = expected(model, u)
    assert np.abs(found - truth).max() <= (1e-13 if isinstance(model, GreyBox) else 1e-12) * truth.std()


SHAFT = Motor(shaft_stiffness=2.0, shaft_damping=0.004)
GEAR = PowerFriction(4e-3, 2e-3, 0.3, 0.1, 0.05, 0.02, 0.01)
MOTORS = {
    "shaft": (MotorPlant(SHAFT), (Signal.SPEED, Signal.ROTOR_SPEED, Signal.POSITION, Signal.CURRENT)),
    "backlash": (MotorPlant(replace(SHAFT, shaft_backlash=0.02)), (Signal.SPEED,)),
    "friction by load": (MotorPlant(replace(SHAFT, rotor_friction=GEAR)), (Signal.SPEED,)),
    "other laws": (
        MotorPlant(
            replace(SHAFT, rotor_friction=GaussianStribeck(8e-3, 2e-3, 0.3)),
            quadratic_viscous=1e-6,
            cogging=Cogging(sine_1=1e-3),
            load_torque=1e-3,
        ),
        (Signal.SPEED, Signal.CURRENT),
    ),
    "stiff shaft": (MotorPlant(Motor(shaft_stiffness=1e9)), (Signal.SPEED,)),
    "inductance": (
        MotorPlant(replace(Motor(inductance=0.002), shaft_stiffness=np.inf), steps=8),
        (Signal.SPEED, Signal.CURRENT),
    ),
    "heating beside an inductance": (
        MotorPlant(Motor(inductance=0.002).rigid(), steps=8, heating=200.0, winding_drift=0.2, drift_end=0.5),
        (Signal.SPEED, Signal.CURRENT),
    ),
    "no inductance": (MotorPlant(replace(SHAFT, inductance=0.0)), (Signal.SPEED, Signal.CURRENT)),
    "load": (MotorPlant(SHAFT, Drive(gain=2.0, offset=0.1, delay=1.3 * DT), load_torque=0.01), (Signal.SPEED,)),
    "straight": (MotorPlant(SHAFT, Drive(hold=Hold.FIRST)), (Signal.SPEED,)),
    "loads among the inputs": (MotorPlant(SHAFT, Drive(loaded=True, delay=1.3 * DT)), (Signal.SPEED,)),
    "loads on one mass": (MotorPlant(Motor().rigid(), Drive(loaded=True, hold=Hold.FIRST)), (Signal.SPEED,)),
    "encoder behind a gap": (MotorPlant(Motor().rigid(), sensor=Sensor(backlash=0.1)), (Signal.POSITION,)),
    "torque dead zone": (MotorPlant(replace(SHAFT, torque_dead_zone=DeadZoneLaw(-0.01, 0.02))), (Signal.SPEED,)),
}


@needs_gcc
@pytest.mark.parametrize("name", MOTORS)
def test_a_motor_with_shaft_or_inductance_gives_the_numbers_of_the_model(name: str, tmp_path: Path) -> None:
    """Through stops, reversals and impacts; in single precision with another order."""
    model = GreyBox(*MOTORS[name])
    u = np.repeat(np.column_stack([0.5 * inputs(3), 1e-3 * inputs(4)])[::8], 8, axis=0)[:, : width(model)]
    found, truth = in_c(model, u, tmp_path / "double"), expected(model, u)
    assert (np.abs(found - truth).max(axis=0) <= 1e-13 * truth.std(axis=0)).all()
    found = in_c(model, u, tmp_path / "single", single=True)
    assert (np.abs(found - truth).max(axis=0) <= 1e-5 * truth.std(axis=0)).all()
    varies = "The time that a sample takes varies" in (tmp_path / "single/README.md").read_text("utf-8")
    assert varies is not model.plant.is_one_mass  # which moves in steps of a fixed length


@needs_gcc
@pytest.mark.parametrize(
    "name",
    [name for kind in (plants, joints) for name, _ in kind() if not name.startswith("own") and name != "elastic motor"],
)
def test_a_plant_of_one_mass_is_within_single_precision(name: str, tmp_path: Path) -> None:
    model = ALL[name]
    u = inputs(0)[:, None]
    truth = expected(model, u)
    assert (np.abs(in_c(model, u, tmp_path, single=True) - truth).max(axis=0) <= 1e-5 * truth.std(axis=0)).all()


@njit(nogil=True)
def square_root(speed: float, numbers: np.ndarray, side: int) -> float:
    return float(numbers[side, 0] + numbers[side, 1] * np.sqrt(1.0 + abs(speed)))


@needs_gcc
def test_a_friction_law_of_a_user_is_written_where_it_is_compiled(tmp_path: Path) -> None:
    """Its source becomes C; a law in plain Python is refused with the reason."""
    for name, level in (("test-root", square_root), ("test-plain", square_root.py_func)):

        @friction_law(name)
        @dataclass(frozen=True)
        class Law(FrictionLaw):
            parameters = (
                LawParameter("coulomb", "c", Measure.FORCE, "level"),
                LawParameter("root", "r", Measure.FORCE, "of the root"),
            )
            coulomb: float = 0.002
            root: float = 0.001

        Law.level = level
        plant = ALL["rigid motor"].plant
        motor = replace(plant.motor, rotor_friction=Law(), load_friction=Friction())
        model, u = GreyBox(replace(plant, motor=motor), (Signal.SPEED,)), 0.5 * inputs(1)[:, None]
        if level is square_root:
            found, truth = in_c(model, u, tmp_path / name), expected(model, u)
            assert "SQRT" in (tmp_path / name / "model.c").read_text("utf-8")
            assert np.abs(found - truth).max() <= 1e-13 * truth.std()
        else:
            with pytest.raises(emsid.ModelError, match="is not compiled, which has no form in C"):
                emsid.export(model, "c99", tmp_path / name, dt=DT)


@needs_gcc
def test_codes_among_the_commands_let_a_bridge_coast_in_c(tmp_path: Path) -> None:
    drive = Drive(codes=((99.0, Bridge.COAST), (98.0, Bridge.BRAKE)))
    rigid = GreyBox(replace(ALL["rigid motor"].plant, drive=drive), (Signal.SPEED,))
    u = np.where(np.arange(160) % 40 < 20, inputs(0), np.where(np.arange(160) % 80 < 40, 99.0, 98.0))[:, None]
    truth = expected(rigid, u)
    assert np.abs(in_c(rigid, u, tmp_path / "rigid") - truth).max() <= 1e-13 * truth.std()
    with pytest.raises(emsid.ModelError, match="coasts has no form in C"):
        emsid.export(GreyBox(MotorPlant(SHAFT, drive), (Signal.SPEED,)), "c99", tmp_path / "c", dt=DT)


@pytest.mark.parametrize("name", sorted(NO_FORM))
def test_what_has_no_form_in_c_says_so(name: str, tmp_path: Path) -> None:
    model = ALL[name]
    with pytest.raises(emsid.ModelError, match="no form in C"):
        emsid.export(model, "c99", tmp_path / "c", name="model", dt=None if model.dt else DT)
    assert not (tmp_path / "c").exists()


@needs_gcc
def test_single_precision_is_within_its_rounding(tmp_path: Path) -> None:
    for k, name in enumerate(["arx", *(name for name in ALL if "rigid" in name)][:2]):
        model = ALL[name]
        u = np.column_stack([inputs(seed) for seed in range(width(model))])
        truth = expected(model, u)
        assert np.abs(in_c(model, u, tmp_path / str(k), single=True) - truth).max() <= 2e-4 * truth.std()
