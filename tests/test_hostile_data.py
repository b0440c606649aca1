"""Searches over hostile but legal data: a result or one of our errors, and no warning, which is made an error here."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import emsid
from emsid.errors import EmsidError
from emsid.record import Record

RNG = np.random.default_rng(0)
N = 300
LEVELS = np.repeat(RNG.choice([-1.0, 1.0], N // 10), 10)


def first_order(u: np.ndarray) -> np.ndarray:
    y = np.zeros(len(u))
    for t in range(1, len(u)):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1]
    return y


Y = first_order(LEVELS)
RECORDS = {
    "zeros": Record(np.zeros(N), np.zeros(N), 0.01),
    "zero input": Record(np.zeros(N), Y, 0.01),
    "zero output": Record(LEVELS, np.zeros(N), 0.01),
    "constant": Record(np.ones(N), np.full(N, 7.0), 0.01),
    "huge": Record(1e300 * LEVELS, 1e300 * Y, 0.01),
    "tiny": Record(1e-300 * LEVELS, 1e-300 * Y, 0.01),
    "huge output": Record(LEVELS, 1e300 * Y, 0.01),
    "tiny output": Record(LEVELS, 1e-300 * Y, 0.01),
    "subnormal": Record(5e-324 * LEVELS, 5e-324 * np.round(Y), 0.01),
    "limits of integers": Record(float(2**63 - 1) * LEVELS, float(2**31) * np.round(10 * Y), 0.01),
    "one pulse": Record(np.eye(1, N, 5)[0], first_order(np.eye(1, N, 5)[0]), 0.01),
    "one outlier": Record(LEVELS, Y + 1e200 * np.eye(1, N, 150)[0], 0.01),
    "short times": Record(LEVELS, Y, 1e-300),
    "long times": Record(LEVELS, Y, 1e300),
    "many segments": Record(LEVELS, Y, 0.01, breaks=tuple(range(10, N, 10))),
    "an unstable rise": Record(LEVELS, np.exp(np.linspace(0, 600, N)), 0.01),
    "64 inputs": Record(RNG.choice([-1.0, 1.0], (N, 64)), Y, 0.01),
    "equal inputs": Record(np.column_stack([LEVELS, LEVELS]), Y, 0.01),
}
QUICK = ("arx",)
WHOLE = (
    *("friction-narx", "wiener-hammerstein-regression", "output-error", "rigid-motor", "linear-axis", "wiener"),
    *("feedback", "armax"),
)


def check_search(name: str, models: tuple[str, ...]) -> None:
    """A search ends in a result or in one line, without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            result = emsid.identify(RECORDS[name], models=models)
        except EmsidError as problem:
            assert len(str(problem).splitlines()) == 1  # noqa: PT017  (either is right)
        else:
            assert result.rows


@pytest.mark.parametrize("name", RECORDS)
def test_a_quick_search_of_hostile_data_warns_of_nothing(name: str) -> None:
    check_search(name, QUICK)


@pytest.mark.long
@pytest.mark.parametrize("name", RECORDS)
def test_a_whole_search_of_hostile_data_warns_of_nothing(name: str) -> None:
    check_search(name, WHOLE)
