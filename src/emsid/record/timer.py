r"""Rows that a timer samples and that are stamped late: equidistant, although their stamps are not.

With nₖ the number of a row, counted with the rows that were lost, the stamps are tₖ = a + T·nₖ + rₖ. The slope T is
the median of the slopes between rows that are half a record apart (a Theil–Sen estimate with N/2 pairs): a minority of
late stamps does not move it. The rows are equidistant where every rₖ is within half a sample of a straight line, so
that no stamp belongs to another row, and the means of rₖ over some rows move by less than half a sample: a row that is
lost or written twice moves them by a whole one, and a clock that drifts moves them steadily.

References:
    Sen, P. K. (1968). Estimates of the regression coefficient based on Kendall's tau. Journal of the American
    Statistical Association 63(324), 1379–1389.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST = 8
"""Through the stamps of fewer rows, a straight line shows neither steps nor drift."""
MEANS = 25
"""Rows in a mean: noise of half a sample moves it by a tenth of a sample, and so 100 means by less than 0.3.
As many before and after a long step say by their medians whether rows were lost there, or one stamp was late."""
SLOWLY = 0.5
"""Means may move by less than this many samples: halfway to the sample by which a lost row moves them."""
_SPAN = 32
"""Rows over which the sample time is taken at first: few enough that most spans have no lost row."""


class Timer(NamedTuple):
    """The straight line of the stamps.

    Attributes:
        numbers: (N,) the number of every row on the timer, counted with the rows that were lost.
        dt: the sample time in seconds.
        error: the largest distance of a stamp from the line in seconds.
    """

    numbers: NDArray[np.intp]
    dt: float
    error: float


def timer_of(t: Array) -> Timer | None:
    """The timer that sampled the rows with these stamps (N,) in seconds; None where they are really irregular."""
    if len(t) < FEWEST or not t[-1] > t[0]:
        return None
    rows = np.arange(len(t))
    whole = _line(t, rows)
    if whole is not None:
        return whole
    span = min(_SPAN, len(t) // 2)
    dt = float(np.median(t[span:] - t[:-span])) / span
    for lost in (_rounded, _by_medians) if dt > 0 else ():
        line = _line(t, rows + np.append(0, np.cumsum(lost(t, dt))))
        if line is not None:
            return line
    return None


def on_timer(t: Array) -> Array:
    """(N,) the stamps where their timer puts them; the stamps themselves where they are really irregular."""
    timer = timer_of(t)
    return t if timer is None else t[0] + timer.dt * (timer.numbers - timer.numbers[0])


def _line(t: Array, numbers: NDArray[np.intp]) -> Timer | None:
    """The line of stamps over the numbers of their rows; None where they are not close to one."""
    half = len(t) // 2
    dt = float(np.median((t[half:] - t[:-half]) / (numbers[half:] - numbers[:-half])))
    away = t - dt * numbers
    error = float(np.ptp(away)) / 2
    size = max(min(MEANS, len(t) // 4), 1)
    means = away[: len(t) // size * size].reshape(-1, size).mean(axis=1)
    return Timer(numbers, dt, error) if error < dt / 2 * (1 - 1e-6) and np.ptp(means) < SLOWLY * dt else None


def _rounded(t: Array, dt: float) -> NDArray[np.intp]:
    """(N - 1,) the rows lost in every step, by the length of the step alone: for stamps of little jitter."""
    lost: NDArray[np.intp] = np.maximum(np.rint(np.diff(t) / dt) - 1, 0).astype(np.intp)
    return lost


def _by_medians(t: Array, dt: float) -> NDArray[np.intp]:
    """(N - 1,) the rows lost in every step, by the stamps of several rows before and after it, longest steps first."""
    away = t - dt * np.arange(len(t))
    lost = np.zeros(len(t) - 1, dtype=np.intp)
    steps = np.diff(t)
    for k in sorted(np.flatnonzero(steps > 1.5 * dt), key=lambda k: -steps[k]):
        moved = np.median(away[k + 1 : k + 1 + MEANS]) - np.median(away[max(k + 1 - MEANS, 0) : k + 1])
        lost[k] = max(int(np.rint(moved / dt)), 0)
        away[k + 1 :] -= lost[k] * dt
    return lost
