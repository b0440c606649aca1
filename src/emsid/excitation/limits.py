"""The output of a generator of limited amplitude and slew rate, and the crest factor of a signal."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.excitation.checks import as_record, positive, vector
from emsid.record import Record

Array = NDArray[np.float64]


def limit(signal: ArrayLike, dt: float, amplitude: float | None = None, slew: float | None = None) -> Array:
    """The signal as a generator of limited amplitude and slew rate puts it out.

    v = clip(u, ±a), then the follower y(k) = y(k−1) + clip(v(k) − y(k−1), ±slew·dt), y(0) = v(0). In floating
    point |y(k)| ≤ a and |y(k) − y(k−1)| ≤ slew·dt hold exactly, and a signal within the limits is returned
    unchanged.

    Args:
        signal: (N,) samples.
        dt: sample time in seconds.
        amplitude: a > 0, largest absolute value; no limit where None.
        slew: largest rate of change per second, > 0; no limit where None. The first sample is free.

    Raises:
        DataError: for a signal of another shape or not finite, or a limit that is not positive.

    >>> limit([0.0, 9.0, 9.0, 9.0], dt=0.5, amplitude=5.0, slew=4.0)
    array([0., 2., 4., 5.])
    """
    u = vector(signal, "signal")
    step = positive(dt, "sample time")
    if amplitude is not None:
        a = positive(amplitude, "amplitude limit")
        u = np.clip(u, -a, a)
    if slew is None or not len(u):
        return u.copy()
    return np.fromiter(_follow(u, positive(slew, "slew limit") * step), dtype=np.float64, count=len(u))


def _follow(targets: Array, step: float) -> Iterator[float]:
    """Each target, or the value nearest to it whose computed distance from the previous value is within ``step``."""
    value = float(targets[0])
    for target in targets.tolist():
        before, value = value, target
        if abs(target - before) > step:
            value = before + step if target > before else before - step
            while abs(value - before) > step:
                value = float(np.nextafter(value, before))
        yield value


def crest_factor(signal: Record | ArrayLike) -> float:
    """C = max|u| / rms(u): 1 for a binary signal, √2 for a sine.

    Args:
        signal: (N,) samples, (N, nu) channels, or a record, whose inputs are used. With several channels, the largest
            factor is returned.

    Raises:
        DataError: for a signal without channels or samples, or a channel that is always zero.

    >>> round(crest_factor([3.0, -3.0, 3.0]), 12)
    1.0
    """
    u = as_record(signal).input
    peak = np.max(np.abs(u), axis=0, initial=0.0)
    if not (peak.size and np.all(peak > 0)):
        raise DataError("a missing input, or one that is zero throughout, has no crest factor; check that channel")
    return float(np.max(1.0 / np.sqrt(np.mean((u / peak) ** 2, axis=0))))
