"""An identification of files without named columns: what is almost certain is taken, what is open is asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.signal import lfilter

import emsid
from emsid.first_look import describe_files, groups
from emsid.first_look.together import hypotheses

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")

T = 0.01 * np.arange(600)


def motor(u: np.ndarray) -> np.ndarray:
    return np.asarray(lfilter([0.0, 0.5], [1.0, -0.9], u))


def written(path: Path, seed: int = 0, *, named: bool = True, two: bool = False) -> Path:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-5, 5, 30), 20)
    y = motor(u) + 0.05 * rng.standard_normal(600)
    names = ("time [s]", "voltage [V]", "speed [rad/s]") if named else ("a", "b", "c")
    columns = dict(zip(names, (T, u, y), strict=True))
    if two:
        columns["d"] = motor(u) + 0.05 * rng.standard_normal(600)
    pl.DataFrame(columns).write_csv(path)
    return path


def test_columns_that_are_almost_certain_are_taken_as_describe_proposes_them(run, tmp_path: Path) -> None:
    path = written(tmp_path / "log.csv")
    (group,) = groups(describe_files([path])[0])
    found, sure = hypotheses([path], {})
    assert sure
    assert [each.reading for each in found] == [group.reading]
    status, out, said = run("identify", path, "--models", "arx", "--out", tmp_path / "out")
    _, described, _ = run("describe", path)
    assert status == 0
    command = described.strip().splitlines()[-1].strip()
    assert command.startswith("emsid identify")
    assert said.strip().endswith(command)
    assert "arx" in out


def test_a_clear_response_is_worth_a_name(tmp_path: Path) -> None:
    (found, *_), sure = hypotheses([written(tmp_path / "log.csv", named=False)], {})
    assert sure
    assert (found.reading["time"], found.reading["input"], found.reading["output"]) == ("a", "b", "c")


def test_open_columns_are_listed_with_a_command_and_what_it_leaves(run, tmp_path: Path) -> None:
    path = written(tmp_path / "log.csv", named=False, two=True)
    found, sure = hypotheses([path], {})
    assert not sure
    assert [(each.reading["input"], each.reading["output"]) for each in found[:2]] == [("b", "c"), ("b", "d")]
    assert found[0].left < 0.05
    status, out, said = run("identify", path, "--models", "arx", "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    lines = said.strip().splitlines()
    assert "--input b --output c" in lines[0]
    assert "% of the output's variance" in lines[0]
    assert len(lines) == len(found) + 1 <= 4
    assert not (tmp_path / "out").exists()


def test_identify_of_a_path_takes_the_same_columns(tmp_path: Path) -> None:
    path = written(tmp_path / "log.csv")
    result = emsid.identify(path, models="arx")
    assert (result.record.input_names, result.record.output_names) == (("voltage [V]",), ("speed [rad/s]",))
    with pytest.raises(emsid.DataError, match="input='b', output='c'"):
        emsid.identify(written(tmp_path / "unnamed.csv", named=False, two=True), models="arx")
