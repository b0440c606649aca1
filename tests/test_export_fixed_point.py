"""Regressions in whole numbers, compiled, beside the same numbers in Python and beside double precision."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.exports.fixed_point import FixedPoint
from test_export_c import FLAGS

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
MAIN = """\
#include <stdio.h>
#include "model.h"

int main(void)
{
    static model_state state;
    model_word u[MODEL_INPUTS], y[1];
    long value;
    model_init(&state);
    while (scanf("%ld", &value) == 1) {
        u[0] = (model_word)value;
        model_step(&state, u, y);
        printf("%ld\\n", (long)y[0]);
    }
    return 0;
}
"""
LINEAR = emsid.RegressionModel(emsid.arx(na=2, nb=2), np.array([-1.6, 0.63, 0.9, 0.6]), dt=0.01)
FRICTION = emsid.RegressionModel(
    emsid.Structure.parse(
        "-y(t-1)", "u(t-1)", "sign(y(t-1))", "max(u(t-1)-2,0)", "y(t-1)^2", "u(t-1)*abs(y(t-1))", "1"
    ),
    np.array([-0.9, 0.8, -0.1, 0.3, -0.0003, 0.002, 0.05]),
    dt=0.01,
)


def record(model: emsid.RegressionModel, seed: int, samples: int = 3000) -> emsid.Record:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-10, 10, samples // 20), 20)
    return emsid.simulate(model, u, dt=0.01)


def in_c(model: emsid.RegressionModel, data: emsid.Record, bits: int, folder: Path) -> tuple[np.ndarray, FixedPoint]:
    """The output of the C, and the form that it was made from."""
    emsid.export(model, "fixed-point", folder, name="model", unseen=data, bits=bits)
    (folder / "main.c").write_text(MAIN)
    subprocess.run(["gcc", *FLAGS, "-o", folder / "program", folder / "main.c", folder / "model.c"], check=True)
    assert "double" not in (folder / "model.c").read_text()
    sizes = [np.max(np.abs(data.output)), np.max(np.abs(data.input))]
    form = FixedPoint(model, bits - 1, tuple(2.0 ** np.ceil(np.log2(2 * size)) for size in sizes))
    text = "\n".join(map(str, form.words(data.input[:, 0], 1)))
    done = subprocess.run([folder / "program"], input=text, capture_output=True, text=True, check=True)
    return np.array([int(line) for line in done.stdout.split()]) * form.scales[0] / (1 << (bits - 1)), form


@pytest.mark.parametrize("model", [LINEAR, FRICTION], ids=["linear", "friction"])
@pytest.mark.parametrize(("bits", "bound"), [(32, 1e-6), (16, 2e-2)])
def test_c_gives_the_numbers_of_python_and_nearly_those_of_double_precision(
    model: emsid.RegressionModel, bits: int, bound: float, tmp_path: Path
) -> None:
    data = record(model, bits)
    found, form = in_c(model, data, bits, tmp_path)
    np.testing.assert_array_equal(found, form.run(data.input))
    assert np.max(np.abs(found - data.output[:, 0])) < bound * np.std(data.output)
    assert "differs from double precision by at most" in (tmp_path / "README.md").read_text()


def test_a_signal_beyond_its_words_is_clipped() -> None:
    form = FixedPoint(LINEAR, 31, (2.0, 8.0))
    assert np.max(form.run(np.full((500, 1), 8.0))) == pytest.approx(2.0)


def test_what_has_no_form_is_refused(tmp_path: Path) -> None:
    smooth = emsid.RegressionModel(emsid.Structure.parse("-y(t-1)", "tanh(u(t-1)/2)"), np.array([-0.5, 1.0]), dt=0.01)
    squared = emsid.RegressionModel(emsid.Structure.parse("y(t-1)", "u(t-1)^2"), np.array([0.5, 1.0]), dt=0.01)
    for model, options, message in (
        (smooth, {"largest": "1,1"}, "tanh.* has no form in whole numbers"),
        (LINEAR, {}, "the largest size of the output and of each input: 2 positive numbers"),
        (LINEAR, {"largest": "1"}, "2 positive numbers"),
        (LINEAR, {"largest": "1,1", "bits": 8}, "words of 8 bits"),
        (
            emsid.RegressionModel(emsid.arx(1, 1), np.array([-0.5, 1e9]), dt=0.01),
            {"largest": "1,1", "bits": 16},
            "do not fit",
        ),
        (emsid.plants.rigid_motor(), {"largest": "1,1"}, "no regression"),
        (squared, {"largest": "1,1e300"}, "do not fit"),
        (squared, {"largest": "1e-310,1"}, "do not fit"),
        (LINEAR, {"largest": "1,1e301"}, "positive numbers up to 1e"),
        (LINEAR, {"largest": "1,inf"}, "positive numbers up to 1e"),
        (emsid.RegressionModel(emsid.Structure.parse("y(t-1)"), np.array([0.5]), dt=0.01), {"largest": 1}, "no input"),
    ):
        with pytest.raises(emsid.ModelError, match=message):
            emsid.export(model, "fixed-point", tmp_path, dt=None if model is not LINEAR else 0.01, **options)
