"""Every argument of `read` and `Record` and of its methods × bad values: one of our errors in one line, or a record."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emsid import Record, read
from emsid.errors import EmsidError

ROWS = 60
GOOD: dict[str, Any] = {"input": "u", "output": "y", "dt": 0.1}
VALUES: list[Any] = [
    *(0, -1, 1, 3, 2**63, 10**400, -(10**400), 1.5, 1e-320, 1e-12, 1e308, float("nan"), float("inf"), -float("inf")),
    *("", "u", "no such", "\x00", "2", b"u", True, 1j, object(), len, [], (), [1], ["u", 1], [["u"]], {}, {"u": None}),
    *({"u": 1}, {"u": 1e308}, {"u": 10**400}, {"u": float("nan")}, {"u": "x"}, {1: 2}, {"u": 1.5}, {"u": 0}),
    *({"u": [1]}, {"no such": 1}, slice(1, 10), slice(1.5, 10), slice("a", None), slice(None, None, 0), slice(9, 3)),
    *(slice(None, 10**400), slice(None, None, -1), np.float64(0.1), np.int64(7), np.array([1.0, 2.0]), np.array(0.1)),
    *({"u": slice(1)}, range(3), Path("u"), {"u"}, (k for k in "u"), "a" * 300, np.nan, np.datetime64("NaT")),
]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "log.csv"
    rows = [f"{k / 10},{k % 7},{k * k % 11},{k % 2}" for k in range(ROWS)]
    path.write_text("t,u,y,d\n" + "\n".join(rows) + "\n")
    return path


def answer(work: Callable[[], object]) -> str:
    """What is wrong with an answer: nothing where it is a result or one of our errors in one line."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            work()
        except EmsidError as problem:
            lines = str(problem).splitlines()
            return "" if len(lines) == 1 and len(lines[0]) < 1200 else f"{len(lines)} lines: {problem}"
        except Exception as problem:
            return repr(problem)[:200]
    return ""


def text(value: object) -> str:
    try:
        return repr(value)[:60]
    except ValueError:
        return "a very long integer"


@pytest.mark.parametrize("name", [parameter for parameter in inspect.signature(read).parameters if parameter != "path"])
def test_every_argument_of_read(log: Path, name: str) -> None:
    found = {text(value): answer(lambda value=value: read(log, **(GOOD | {name: value}))) for value in VALUES}
    assert {value: problem for value, problem in found.items() if problem} == {}


@pytest.mark.parametrize("name", list(inspect.signature(Record).parameters))
def test_every_argument_of_a_record(name: str) -> None:
    good = {"input": np.arange(20.0), "output": np.arange(20.0) % 7, "dt": 0.1}
    found = {text(value): answer(lambda value=value: Record(**(good | {name: value}))) for value in VALUES}
    assert {value: problem for value, problem in found.items() if problem} == {}


METHODS: dict[str, dict[str, Any]] = {
    "split": {"fraction": 0.5},
    "part": {"first": 1, "stop": 9},
    "mask": {"leave_out": np.zeros(ROWS, bool)},
    "channel": {"name": "u"},
    "detrend": {"order": 1},
    "decimate": {"factor": 2},
    "resample": {"time": np.arange(ROWS) / 10.0, "dt": 0.1},
    "lowpass": {"cutoff": 1.0},
    "scale": {"name": "u", "gain": 2.0, "offset": 1.0, "unit": "V"},
    "convert": {"units": {"u": "V"}, "supply_voltage": 12.0},
    "__getitem__": {"rows": slice(3)},
}


@pytest.mark.parametrize(("method", "name"), [(m, n) for m, given in METHODS.items() for n in given])
def test_every_argument_of_a_method_of_a_record(method: str, name: str) -> None:
    rng = np.random.default_rng(1)
    record = Record(rng.standard_normal(ROWS), rng.standard_normal(ROWS), 0.1, "u", "y", "V", "rad/s")
    call = getattr(record, method)
    assert answer(lambda: call(**METHODS[method])) == ""
    found = {text(value): answer(lambda value=value: call(**(METHODS[method] | {name: value}))) for value in VALUES}
    assert {value: problem for value, problem in found.items() if problem} == {}
