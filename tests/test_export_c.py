"""Models as C: compiled without a warning, and run beside the model."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emsid
from emsid import MotorPlant
from emsid.models.model import Model
from emsid.models.plants.cogging import Cogging
from emsid.models.plants.drive import Drive, Hold
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.plant import DeadZoneLaw, GaussianStribeck, Motor, PowerFriction
from model_examples import DT, cascades, feedback, inputs, plants, polynomials, processes, regressions, state_spaces

FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]
ALL: dict[str, Any] = {
    name: model
    for kind in (regressions, state_spaces, polynomials, processes, cascades, feedback, plants)
    for name, model in kind()
}
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
    assert np.abs(found - truth).max() <= (1e-4 if name == "elastic motor" else 1e-9) * truth.std()


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
    "no inductance": (MotorPlant(replace(SHAFT, inductance=0.0)), (Signal.SPEED, Signal.CURRENT)),
    "load": (MotorPlant(SHAFT, Drive(gain=2.0, offset=0.1, delay=1.3 * DT), load_torque=0.01), (Signal.SPEED,)),
    "straight": (MotorPlant(SHAFT, Drive(hold=Hold.FIRST)), (Signal.SPEED,)),
    "torque dead zone": (MotorPlant(replace(SHAFT, torque_dead_zone=DeadZoneLaw(-0.01, 0.02))), (Signal.SPEED,)),
}


@needs_gcc
@pytest.mark.parametrize("name", MOTORS)
def test_a_motor_with_shaft_or_inductance_is_within_its_step(name: str, tmp_path: Path) -> None:
    """Fixed steps with events located in them, beside Taylor series of any order: through stops and reversals."""
    model = GreyBox(*MOTORS[name])
    u = 0.5 * np.repeat(inputs(3)[::8], 8)[:, None]
    found, truth = in_c(model, u, tmp_path), expected(model, u)
    bound = 1e-3 if name == "backlash" else 5e-5
    assert (np.abs(found - truth).max(axis=0) <= bound * truth.std(axis=0)).all()
    assert "steps of" in (tmp_path / "README.md").read_text("utf-8")


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
