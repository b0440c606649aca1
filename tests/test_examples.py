"""The examples run from any folder, use public names only, find what they simulated, and write their figures."""

from __future__ import annotations

import ast
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emsid

EXAMPLES = {path.stem: path for path in sorted((Path(__file__).parents[1] / "examples").glob("*.py"))}


def run(name):
    """What an example defines."""
    return runpy.run_path(str(EXAMPLES[name]))


def assert_recovered(fit, truth):
    for name, value, error in zip(fit.names, fit.estimate, fit.standard_error, strict=True):
        assert abs(value - truth[name]) < 4 * error


@pytest.mark.parametrize("path", EXAMPLES.values(), ids=EXAMPLES)
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
    example = run("own_plant")
    fit, comparison = example["main"]()
    assert_recovered(fit, example["TRUTH"])
    assert comparison.best.row.simulation_rmse == pytest.approx(5e-3, rel=0.1)  # the noise
    assert (tmp_path / "own-plant.svg").read_bytes().lstrip().startswith(b"<?xml")


def test_a_cascade_built_block_by_block(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = run("cascade")
    fit, comparison = example["main"]()
    assert comparison.best.fit is fit
    assert comparison.best.row.fit_percent > 97.5  # of a record with 2 % of noise
    assert comparison.rows[-1].fit_percent < 90
    assert (tmp_path / "cascade.svg").exists()


def test_a_spring_that_hardens(tmp_path, monkeypatch):
    """Held, the correct equation misses by forty times the noise; band-limited it does not."""
    monkeypatch.chdir(tmp_path)
    example = run("hardening_spring")
    fit, comparison = example["main"]()
    assert_recovered(fit, example["TRUTH"])
    assert all(row.simulation_rmse < 1.1 * example["NOISE"] for row in comparison.rows)
    assert (tmp_path / "hardening-spring.svg").exists()
    held = emsid.fit(replace(example["SPRING"], between="held"), example["experiment"](1, 0.004, 600))
    assert np.sqrt(held.noise_variance) > 10 * example["NOISE"]
    (warning,) = (finding for finding in held.findings if finding.code == "input-taken-as-constant")
    assert warning.subject == "force"
    assert warning.data["between"] == "band-limited"
    assert warning.data["ratio"] > 10
    # What the user chose is no finding of the program.
    assert not {"input-taken-as-constant", "input-between-samples"} & {finding.code for finding in fit.findings}
    linear = emsid.fit(replace(example["SPRING"], between="linear"), example["experiment"](1, 0.004, 600))
    assert "input-between-samples" not in {finding.code for finding in linear.findings}
    (warning,) = (finding for finding in linear.findings if finding.code == "input-taken-as-linear")
    assert warning.data["between"] == "band-limited"
    assert warning.data["ratio"] > 1.5


def test_two_tanks(tmp_path, monkeypatch):
    """The free run is started from as many samples as a difference of levels lasts."""
    monkeypatch.chdir(tmp_path)
    example = run("two_tanks")
    fit, comparison = example["main"]()
    assert_recovered(fit, example["TRUTH"])
    assert fit.model.memory > 60
    assert comparison.best.fit is fit
    assert comparison.best.row.simulation_rmse < 1.1 * example["NOISE"]
    assert (tmp_path / "two-tanks.svg").exists()


def test_how_an_input_goes_on_is_one_of_three(tmp_path):
    example = run("two_tanks")
    with pytest.raises(emsid.ModelError, match="did you mean linear"):
        replace(example["TANKS"], between="linaer")
    with pytest.raises(emsid.ModelError, match="numbers in first"):
        replace(example["TANKS"], first=(1.0,))


@pytest.mark.parametrize("name", ["hardening_spring"])
def test_a_plant_is_about_ten_lines_of_own_code(name):
    """The statements of its two functions, the rows of its table, and the other options."""
    tree = ast.parse(EXAMPLES[name].read_text("utf-8"))
    functions = [
        each for each in tree.body if isinstance(each, ast.FunctionDef) and each.name in ("derivative", "output")
    ]
    assert len(functions) == 2
    (call,) = (each for each in ast.walk(tree) if isinstance(each, ast.Call) and ast.unparse(each.func) == "OwnPlant")
    lines = sum(len(function.body) - 1 for function in functions)  # without docstrings
    lines += sum(len(keyword.value.elts) if keyword.arg == "table" else 1 for keyword in call.keywords)
    assert lines <= 12
