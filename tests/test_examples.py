"""The examples run from any folder, use public names only, find what they simulated, and write their figures."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path

import pytest

import emsid

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_uses_public_names_only(path):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("emsid"):
            face = node.module.removeprefix("emsid.")
            assert face in emsid.__all__
            assert {alias.name for alias in node.names} <= set(getattr(emsid, face).__all__)
        elif isinstance(node, ast.Import):
            assert [alias.name for alias in node.names if alias.name.startswith("emsid.")] == []


def test_a_plant_of_your_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = runpy.run_path(str(next(path for path in EXAMPLES if path.stem == "own_plant")))
    fit, comparison = example["main"]()
    for name, value, error in zip(fit.names, fit.estimate, fit.standard_error, strict=True):
        assert abs(value - example["TRUTH"][name]) < 4 * error
    assert comparison.best.row.simulation_rmse == pytest.approx(5e-3, rel=0.1)  # the noise
    assert (tmp_path / "own-plant.svg").read_bytes().lstrip().startswith(b"<?xml")


def test_a_cascade_built_block_by_block(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = runpy.run_path(str(next(path for path in EXAMPLES if path.stem == "cascade")))
    fit, comparison = example["main"]()
    assert comparison.best.fit is fit
    assert comparison.best.row.fit_percent > 97.5  # of a record with 2 % of noise
    assert comparison.rows[-1].fit_percent < 90
    assert (tmp_path / "cascade.svg").exists()
