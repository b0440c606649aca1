"""The step to which numbers are rounded, and runs of one number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quantisation(levels: Array) -> float | None:
    """The step of which all differences between ascending values (M,) are multiples; None where there is none.

    >>> quantisation(np.array([0.0, 0.25, 1.0, 1.75])), quantisation(np.array([0.0, 0.3, 1.0, 1.75, 1.99]))
    (0.25, None)
    """
    steps = np.diff(levels)
    if not len(steps):
        return None
    span = float(levels[-1] - levels[0])
    for candidate in (float(steps.min()), float(np.percentile(steps, 5))):
        multiples = np.rint((levels - levels[0]) / candidate)
        if not 0 < multiples[-1] < 1e6:
            continue
        step = float(multiples @ (levels - levels[0]) / (multiples @ multiples))
        rest = np.abs((levels - levels[0]) / step - multiples)
        if rest.max() < 0.05 and (len(levels) > 2 or span):
            few = multiples[-1] > 50 * len(levels)  # too few values to tell multiples from chance
            return None if few else float(f"{step:.6g}")
    return None


def runs(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first place and the length of every run of equal values (N,)."""
    starts = np.concatenate([[0], 1 + np.flatnonzero(values[1:] != values[:-1])]).astype(np.intp)
    return starts, np.diff(starts, append=len(values)).astype(np.intp)
