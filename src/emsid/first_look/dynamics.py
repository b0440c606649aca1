"""How an input is related to an output besides its response: in the same row, by a controller, and by correlation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.levels import CLEAR, LAGS, PART, SAMPLES

Array = NDArray[np.float64]

LARGEST_STEP = 20.0
"""An input is held, with noise or without, where its largest step is larger than the median by this factor."""
ROUNDS = 5
"""Of a prediction without the steps of a signal; from the second on it changes little."""
UNDONE = 0.5
"""Two values undo the effect of each other where the sum of their coefficients is below this share of the sizes."""
LONG_PAST = 20
"""Past inputs from which an input is predicted, to see what is new in it."""


def at_once(u: Array, y: Array, sign: int) -> float:
    """The share of the one-step prediction error of y (N,), from the past of both, that u (N,) of the same row removes.

    It is zero where the coefficient of that value has another sign than the response, as that of a controller has, or
    where later inputs undo most of its effect, as those of an interference do.

    Args:
        u, y: the signals; rows with a missing value (NaN) are left out.
        sign: of the response of y to u.
    """
    u, y = _middle(u), _middle(y)
    rows = np.arange(LAGS, len(y))
    table = np.column_stack([u[rows], _past(u, rows, LAGS), _past(y, rows, LAGS), np.ones(len(rows)), y[rows]])
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) < 4 * table.shape[1] or not np.ptp(table[:, 0]) or not np.ptp(table[:, -1]):
        return 0.0
    estimate = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=1e-9)[0]
    effects = estimate[:2]
    if effects[0] * sign <= 0 or abs(effects.sum()) < UNDONE * np.abs(effects).sum():
        return 0.0
    without = _unexplained(table[:, 1:-1], table[:, -1])
    return 1 - float(np.mean((table[:, -1] - table[:, :-1] @ estimate) ** 2)) / without if without > 0 else 0.0


def acts_in_its_own_row(u: Array, y: Array, sign: int) -> bool:
    """Whether a held input u (N,) moves y (N,) in its own row already, so that it is written after it began to act.

    Args:
        u, y: the signals; rows with a missing value (NaN) are left out.
        sign: of the response of y to u.
    """
    steps = np.abs(np.diff(u[np.isfinite(u)]))
    return bool(np.max(steps, initial=0.0) > LARGEST_STEP * np.median(steps)) and at_once(u, y, sign) > PART


def feedback(u: Array, y: Array, sign: int) -> float:
    """The largest correlation of the unpredictable part of an input u (N,) with earlier errors of y (N,), from 0 to 1.

    Without feedback, what is new in the input has nothing to do with the disturbances of the output. In the same sample
    an output that answers at once has the sign of its response; a controller gives the input the other one.

    Args:
        u, y: the signals.
        sign: of the response, 0 where it is not known.
    """
    u, y = _middle(u), _middle(y)
    rows = np.arange(LONG_PAST, len(y))
    if len(rows) < 6 * LONG_PAST:
        return 0.0
    past_u, past_y = (_past(x, rows, LONG_PAST // 2) for x in (u, y))
    error = _residual(np.hstack([np.ones((len(rows), 1)), past_u, past_y]), y[rows])
    moving = np.mean(np.diff(u) == 0) < PART  # steps of a reference hide what answers the output in between
    new, error = (_new(u, ROUNDS), _clipped(error)) if moving else (_new(u), error)
    if new.std() < 1e-6 * u.std() or error.std() < 1e-9 * y.std():
        return 0.0
    lags = range(LONG_PAST // 2)
    found = [float(np.corrcoef(error[: len(error) - lag], new[lag:])[0, 1]) for lag in lags]
    if found[0] * sign >= 0:
        found[0] = 0.0
    largest = float(np.max(np.abs(found)))
    return largest if largest > CLEAR / np.sqrt(len(rows)) else 0.0


def _past(x: Array, rows: NDArray[np.int64], lags: int) -> Array:
    """(rows, lags) the values of a signal before these samples."""
    return np.column_stack([x[rows - lag] for lag in range(1, lags + 1)])


def _new(x: Array, rounds: int = 0) -> Array:
    """(N − `LONG_PAST`,) what the past of a signal (N,) does not predict.

    Args:
        x: the signal.
        rounds: of repeating the prediction without the samples that it misses most, whose errors are clipped then.
    """
    rows = np.arange(LONG_PAST, len(x))
    table = np.hstack([np.ones((len(rows), 1)), _past(x, rows, LONG_PAST)])
    new = _residual(table, x[rows])
    for _ in range(rounds):
        near = _clipped(new) == new
        new = x[rows] - table @ np.linalg.lstsq(table[near], x[rows][near], rcond=None)[0]
    return _clipped(new) if rounds else new


def _clipped(x: Array) -> Array:
    """A signal without its extremes, at four standard deviations of its middle."""
    limit = 4 * 1.4826 * float(np.median(np.abs(x - np.median(x))))
    return np.clip(x, -limit, limit) if limit > 0 else x


def correlation(u: Array, y: Array, breaks: Sequence[int], delay: int) -> float:
    """The correlation of y with u some samples earlier, or soon after that, whichever is largest."""
    best = 0.0
    pieces = list(zip(np.split(u, list(breaks)), np.split(y, list(breaks)), strict=True))
    for more in (0, 1, 2, 4, 8, 16, 32, 64, 128):
        lag = delay + more
        pairs = [(a[: len(a) - lag], b[lag:]) for a, b in pieces if len(a) > lag + 10]
        if not pairs:
            break
        a, b = (np.concatenate(side) for side in zip(*pairs, strict=True))
        if np.ptp(a) > 0 and np.ptp(b) > 0:
            found = float(np.corrcoef(a, b)[0, 1])
            best = found if abs(found) > abs(best) else best
    return best


def _middle(x: Array) -> Array:
    start = max(0, (len(x) - SAMPLES) // 2)
    return x[start : start + SAMPLES]


def _unexplained(regressors: Array, target: Array) -> float:
    """The mean square of what a least-squares fit leaves."""
    return float(np.mean(_residual(regressors, target) ** 2))


def _residual(regressors: Array, target: Array) -> Array:
    """What a least-squares fit leaves."""
    estimate = np.linalg.lstsq(regressors, target, rcond=1e-9)[0]
    return np.asarray(target - regressors @ estimate)
