"""Recursive least squares in C beside that of emsid."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import emsid
from test_export_c import FLAGS

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
MAIN = """\
#include <stdio.h>
#include "model_rls.h"

int main(void)
{
    static model_rls_state state;
    model_real theta[MODEL_PARAMETERS];
    double u, y;
    int k;
    model_rls_init(&state, (model_real)WEIGHT);
    while (scanf("%lf %lf", &u, &y) == 2) {
        const model_real one = (model_real)u;
        model_rls_update(&state, &one, (model_real)y, (model_real)FORGETTING);
    }
    model_rls_parameters(&state, theta);
    for (k = 0; k < MODEL_PARAMETERS; ++k) {
        printf("%.17g\\n", (double)theta[k]);
    }
    return 0;
}
"""
STRUCTURE = emsid.Structure.parse("-y(t-1)", "-y(t-2)", "u(t-1)", "sign(y(t-1))", "u(t-1)*abs(y(t-1))")
THETA = np.array([-1.2, 0.4, 0.5, -0.1, 0.02])


def record(seed: int = 1, samples: int = 800) -> emsid.Record:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(samples)
    y = emsid.simulate(emsid.RegressionModel(STRUCTURE, THETA, dt=0.1), u, dt=0.1).output[:, 0]
    return emsid.Record(u, y + 0.01 * rng.standard_normal(samples), 0.1)


def in_c(
    data: emsid.Record, start: np.ndarray, folder: Path, weight: float, forgetting: float, **options: object
) -> np.ndarray:
    """The parameters after all samples."""
    model = emsid.RegressionModel(STRUCTURE, start, dt=0.1)
    emsid.export(model, "c99", folder, name="model", recursive=True, **options)  # type: ignore[arg-type]
    (folder / "main.c").write_text(MAIN.replace("WEIGHT", repr(weight)).replace("FORGETTING", repr(forgetting)))
    files = [folder / "main.c", folder / "model_rls.c", folder / "model.c"]
    subprocess.run(["gcc", *FLAGS, "-o", folder / "program", *files, "-lm"], check=True)
    rows = np.column_stack([data.input[:, 0], data.output[:, 0]]).tolist()
    text = "\n".join(f"{u!r} {y!r}" for u, y in rows)
    done = subprocess.run([folder / "program"], input=text, capture_output=True, text=True, check=True)
    return np.array([float(line) for line in done.stdout.split()])


def test_without_a_start_it_is_the_least_squares_of_all_samples(tmp_path: Path) -> None:
    data = record()
    found = in_c(data, np.zeros(5), tmp_path, 1e-14, 1.0)
    assert found == pytest.approx(emsid.fit(STRUCTURE, data).estimate, rel=1e-9)


def test_with_forgetting_it_is_that_of_emsid(tmp_path: Path) -> None:
    data = record(2)
    found = in_c(data, np.zeros(5), tmp_path, 1e-14, 0.98)
    assert found == pytest.approx(emsid.fit(STRUCTURE, data, forgetting=0.98).estimate, rel=1e-6)


def test_a_heavy_start_stays_and_single_precision_is_enough(tmp_path: Path) -> None:
    data = record(3)
    assert in_c(data, THETA + 0.1, tmp_path / "a", 1e12, 1.0) == pytest.approx(THETA + 0.1, abs=1e-6)
    found = in_c(data, np.zeros(5), tmp_path / "b", 1e-6, 0.99, single=True)
    assert found == pytest.approx(in_c(data, np.zeros(5), tmp_path / "c", 1e-6, 0.99), abs=2e-5)


def test_other_models_have_no_recursion(tmp_path: Path) -> None:
    with pytest.raises(emsid.ModelError, match="no regression"):
        emsid.export(emsid.LinearAxis(), "c99", tmp_path / "x", dt=0.01, recursive=True)
    model = emsid.RegressionModel(STRUCTURE, THETA, dt=0.1)
    with pytest.raises(emsid.ModelError, match="yes or no"):
        emsid.export(model, "c99", tmp_path / "x", recursive="maybe")
    assert not (tmp_path / "x").exists()
    emsid.export(model, "c99", tmp_path / "x", name="model", recursive="no")
    assert not (tmp_path / "x" / "model_rls.c").exists()
