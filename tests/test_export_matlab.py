"""Models as functions of MATLAB, run in Octave beside the model, and linear parts in MAT files."""

import shutil
import subprocess
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

import emsid
from emsid.exports.matlab_source import translated
from model_examples import DT, EXPORTED, feedback, inputs, plants

MODELS: dict[str, Any] = {
    name: model
    for name, model in EXPORTED.items()
    if not any(word in name for word in ("user", "own plant", "elastic"))
}
needs_octave = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")


def exported(model: Any, folder: Path, name: str = "model") -> None:
    emsid.export(model, "matlab", folder, name=name, dt=None if model.dt else DT)


@needs_octave
def test_octave_gives_the_numbers_of_every_model(tmp_path: Path) -> None:
    """All models in one process, as Octave starts slowly."""
    program, truths = [f"cd {tmp_path}"], []
    for k, model in enumerate(MODELS.values()):
        exported(model, tmp_path, f"m{k}")
        (tmp_path / "README.md").unlink()
        u = np.column_stack([inputs(seed) for seed in range(emsid.start(model, dt=DT).inputs)])
        truths.append(model.run(model.at_rest(0.0, DT), u)[0])
        np.savetxt(tmp_path / f"u{k}.txt", u, fmt="%.17g")
        width = truths[-1].shape[1]
        program.append(
            f"u = load('u{k}.txt'); s = m{k}_init(); y = zeros(size(u, 1), {width}); "
            f"for i = 1:size(u, 1), [y(i, :), s] = m{k}_step(s, u(i, :)); end; "
            f"dlmwrite('y{k}.txt', y, 'precision', 17);"
        )
    (tmp_path / "run_all.m").write_text("\n".join(program))
    subprocess.run(["octave-cli", "--norc", "run_all.m"], cwd=tmp_path, check=True, timeout=120)
    for k, truth in enumerate(truths):
        found = np.loadtxt(tmp_path / f"y{k}.txt", delimiter=",", ndmin=2)
        assert np.abs(found - truth).max() <= 1e-9 * truth.std(), list(MODELS)[k]


@pytest.mark.parametrize("name", MODELS)
def test_every_statement_is_translated(name: str, tmp_path: Path) -> None:
    exported(MODELS[name], tmp_path)
    text = (tmp_path / "model_step.m").read_text("utf-8")
    assert text.startswith("function [y, s] = model_step(s, u)")
    assert not [sign for sign in ("->", "{", "K(", "+=", "[k]", "[0]", "?") if sign in text.replace("[0 ", "")]
    opened = sum(line.strip().startswith(("function", "for ", "if ", "while ")) for line in text.splitlines())
    assert opened == sum(line.strip() == "end" for line in text.splitlines())


FUNCTIONS = """
#define PAST 3

static void shift(real *values, int count)
{
    int i;
    for (i = 0; i + 1 < count; ++i) {
        values[i] = values[i + 1];
    }
}

static real unused(real x)
{
    return x;
}

static int half(int k, real *result_0)
{
    *result_0 = k > 1 ? K(1e-3) : -K(2.5);
    return (k + 1) / 2;
}
"""


def test_statements_become_those_of_matlab() -> None:
    lines = "    int k;\n    real x;\n    shift(s->past + 3, PAST);\n    k = half(4, &x);\n    y[0] += x * table[k];\n"
    found = translated(FUNCTIONS, lines, {"table": "[1 2 4]"}, set(), "function f()").splitlines()
    assert found[1:7] == [
        "  table = [1 2 4];",
        "  k = 0;",
        "  x = 0;",
        "  [made_1] = shift(s.past(4:end), 3);",
        "  s.past(4:end) = made_1;",
        "  [k, x] = half(4);",
    ]
    assert found[7] == "  y(1) = y(1) + (x * table(k + 1));"
    assert "  for i = 0:1:count - 2" in found
    assert "  value = floor(((k + 1)) / (2));" in found
    assert not any("unused" in line for line in found)
    for wrong in ("y[0] = x & 1;", "do_it(x);", "while (x > y ? 1 : 0) {"):
        with pytest.raises(emsid.ModelError, match="no form in MATLAB"):
            translated(FUNCTIONS, f"    {wrong}", {}, set(), "")


def test_linear_parts_are_in_a_mat_file(tmp_path: Path) -> None:
    pytest.importorskip("control")
    exported(dict(plants())["rigid motor"], tmp_path)
    found = loadmat(BytesIO((tmp_path / "model.mat").read_bytes()))
    slow = 1e-4 * np.eye(len(found["A1"])) - found["A1"]
    gain = (found["C1"] @ np.linalg.solve(slow, found["B1"]) + found["D1"]).item()
    assert gain == pytest.approx(0.05 / (0.05**2 + 2.0 * 1.5e-5), rel=1e-4)
    assert found["dt1"].item() == 0.0
    assert "have no dead zones, dry friction" in (tmp_path / "README.md").read_text("utf-8")


def test_a_model_without_step_and_linear_part_is_refused(tmp_path: Path) -> None:
    with pytest.raises(emsid.ModelError, match="neither"):
        exported(dict(feedback())["feedback, user"], tmp_path)
