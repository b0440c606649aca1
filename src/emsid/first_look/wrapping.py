"""The period of a counter or an angle that starts again, as an encoder of 16 bits does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.io.wrapping import unwrapped

PERIODS = (*(2.0**bits for bits in range(8, 33)), 360.0, 3600.0, 36000.0, 2 * np.pi, 1.0)
"""Counters of 8 to 32 bits, degrees with up to two decimals as whole numbers, radians, revolutions."""
LONGEST_STEP = 0.25
"""Steps longer than this part of a period could be steps the other way round."""
FEWEST = 3
"""A period that is none of `PERIODS` must show this often."""


def wrap_period(values: NDArray[np.float64]) -> float | None:
    """The period after which values (N,) start again; None where they do not.

    They start again where a step is longer than half their range, from one end of the range to the other: the period is
    longer than the range, by less than two of the other steps. All other steps are short. Of several periods, the one
    is taken with which the steps at these jumps are most like their neighbours.
    """
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    span = float(np.ptp(values)) if len(values) else 0.0
    jumps = np.abs(steps) > span / 2
    count = int(np.count_nonzero(jumps))
    if count == 0 or count == len(steps):
        return None
    longest = float(np.max(np.abs(steps[~jumps])))
    whole = bool(np.all(values == np.rint(values)))
    of_its_own = (span + 1,) if whole and count >= FEWEST else ()
    bend = {}
    for period in (*PERIODS, *of_its_own):
        if span < period <= span + 2 * longest and longest < LONGEST_STEP * period:
            within = np.diff(unwrapped(values, period))
            if np.max(np.abs(within)) <= 2 * longest:
                bend[period] = float(np.sum(np.diff(within) ** 2))
    return min(bend, key=bend.__getitem__, default=None)
