"""State files: what no tracker can have written is refused, and a state knows its structure."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emsid import FormatError, RecursiveLeastSquares, arx
from emsid.estimation import Window
from emsid.io.state_file import load_state, load_structure, save_state
from emsid.live.protocol import LineParser
from emsid.models.regression.narx import Structure
from emsid.record import Record
from live_sessions import lines

Change = Callable[[dict[str, Any]], Any]


@pytest.fixture
def saved(tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    rows = LineParser().feed(lines(600))
    assert rows is not None
    recursion = RecursiveLeastSquares(arx(1, 1), forgetting=0.99)
    state = recursion.update(recursion.start(), Record(rows.input, rows.output, 1e-3))
    save_state(state, recursion.structure, tmp_path / "state.json")
    return tmp_path / "state.json", json.loads((tmp_path / "state.json").read_text())


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s.update(window=None),
        lambda s: s.update(window=5),
        lambda s: s.update(window=[[1, 2], [3, 4]]),
        lambda s: s.update(window=[[1, 2, 3]], filled=2),
        lambda s: s.update(window=[[[1, 2, 3]]]),
        lambda s: s.update(estimate=[[1, 2], [3, 4]]),
        lambda s: s.update(estimate=[]),
        lambda s: s.update(estimate=3.0),
        lambda s: s.update(estimate=["a", "b"]),
        lambda s: s.update(estimate=[1.0, 2.0, 3.0], factor=np.eye(3).tolist(), diagonal=[1] * 3, peak=[1] * 3),
        lambda s: s.update(factor=[[1.0, 5.0], [0.0, 1.0]]),
        lambda s: s.update(factor=[[2.0, 0.0], [0.0, 1.0]]),
        lambda s: s.update(diagonal=[1.0, -1.0]),
        lambda s: s.update(peak=[-1.0, 1.0]),
        lambda s: s.update(samples=-1e300),
        lambda s: s.update(samples=True),
        lambda s: s.update(samples="9"),
        lambda s: s.update(residual_sum_of_squares=-1e300),
        lambda s: s.update(squared_weights=-1e300),
        lambda s: s.update(squared_weights=1e300),
        lambda s: s.update(place=7),
        lambda s: s.update(filled=-1),
        lambda s: s.update(limited=1.5),
        lambda s: s.update(limited=10**400),
        lambda s: s.update(idle=None),
        lambda s: s.pop("idle"),
        lambda s: s.update(tail=3),
        lambda s: s["tail"].update(dt=-1),
        lambda s: s["tail"].update(input=[[1, 2], [3]]),
        lambda s: s["tail"].update(output=[["x"]]),
    ],
)
def test_a_state_that_no_recursion_can_have_is_refused(saved: tuple[Path, dict[str, Any]], change: Change) -> None:
    path, document = saved
    old = {name: document[name] for name in ("format", "structure", "state")} | {"schema": 1}
    path.write_text(json.dumps(old))
    load_state(path, arx(1, 1))
    change(old["state"])
    path.write_text(json.dumps(old))
    with pytest.raises(FormatError, match=r"state.json: (not a state|this is no state)") as caught:
        load_state(path, arx(1, 1))
    assert len(str(caught.value).splitlines()) == 1


def test_a_state_that_was_altered_is_refused(saved: tuple[Path, dict[str, Any]]) -> None:
    path, document = saved
    document["state"]["estimate"][0] += 1e-9
    path.write_text(json.dumps(document))
    with pytest.raises(FormatError, match="has been altered"):
        load_state(path, arx(1, 1))


def test_a_window_is_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    recursion = RecursiveLeastSquares(arx(1, 1), rule=Window(20))
    state = recursion.update(recursion.start(), Record(rng.standard_normal(50), rng.standard_normal(50), 0.1))
    save_state(state, recursion.structure, tmp_path / "state.json")
    restored = load_state(tmp_path / "state.json", recursion.structure)
    np.testing.assert_array_equal(restored.window, state.window)
    np.testing.assert_array_equal(restored.totals, state.totals)


def test_a_state_knows_its_structure(tmp_path: Path, run: Callable[..., tuple[int, str, str]]) -> None:
    (tmp_path / "log.csv").write_bytes(lines(600))
    log, out = tmp_path / "log.csv", tmp_path / "out"
    assert run("track", log, "--structure", "friction-narx", "--knots", "-0.5,0.5", "--out", out)[0] == 0
    structure = load_structure(out / "state.json")
    assert (structure.name, len(structure)) == ("friction-narx", 6)
    assert structure.labels == Structure.parse(*structure.labels).labels
    status, text, err = run("track", log, "--state", out / "state.json", "--out", tmp_path / "again")
    assert status == 0, err
    assert "friction-narx" in text
    status, _, err = run("track", log, "--state", out / "state.json", "--structure", "arx", "--out", tmp_path / "no")
    assert (status, err.count("\n")) == (2, 1)
    assert "other regressors" in err
