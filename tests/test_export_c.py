"""Models as C: compiled without a warning, and run beside the model."""

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emsid
from emsid.models.model import Model
from model_examples import DT, cascades, feedback, inputs, plants, polynomials, processes, regressions, state_spaces

FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-Wshadow"]
ALL: dict[str, Any] = {
    name: model
    for kind in (regressions, state_spaces, polynomials, processes, cascades, feedback, plants)
    for name, model in kind()
}
NO_FORM = {name for name in ALL if "user" in name or name.startswith(("own plant", "elastic motor"))}
"""Functions in Python, and a shaft."""
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
    assert np.abs(found - truth).max() <= 1e-9 * truth.std()


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
