"""Whether an output that stays at one value is stuck, and not at rest.

At a steady input an output may stay at one value, more so a quantised one, and friction or a dead zone holds it while
the input changes a little. A linear model of the other rows answers that change by no more than it is wrong elsewhere,
since the same friction acts there. An output is stuck where the model's answer is far larger. At zero, where a drive
rests, the input must also be larger most of the time than where the output rests elsewhere, and than a part of where
it moves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.baseline import baseline
from emsid.first_look.columns import Stretch
from emsid.first_look.examined import response_of
from emsid.first_look.levels import CLEAR
from emsid.record import Record

Array = NDArray[np.float64]

AT_REST, IN_MOTION = 95, 25
"""In percent of the samples at rest the input is too small to move the output; in motion after a drive it often is."""


def is_stuck(u: Array, y: Array, stretch: Stretch) -> bool:
    """Whether the output should have changed in a stretch in which it did not.

    Args:
        u: (N,) the input; NaN where it is not known.
        y: (N,) the output; NaN where it is not known.
        stretch: of equal values of y.
    """
    rows = np.arange(stretch.start, stretch.start + stretch.length)
    known = np.isfinite(u) & np.isfinite(y)
    inside = np.isin(np.flatnonzero(known), rows)
    u, y = u[known], y[known]
    if not inside.any() or not np.ptp(u[inside]) or (stretch.value == 0 and not _is_driven(u, y, inside)):
        return False
    others = Record(input=u, output=y, dt=1.0).mask(inside)
    response = response_of(others)
    linear = baseline(others, response.delay if response else None)
    if linear is None:
        return False
    answer = linear.answer(u, [])[inside]
    return bool(np.ptp(answer) > CLEAR * float(np.std(linear.residual)))


def _is_driven(u: Array, y: Array, inside: NDArray[np.bool_]) -> bool:
    """Whether an input (N,) is mostly large enough in a stretch to move the output (N,)."""
    size, rests = np.abs(u), y == 0
    known = ((size[~inside & rests], AT_REST), (size[~inside & ~rests], IN_MOTION))
    return bool(all(np.median(size[inside]) >= np.percentile(x, share) for x, share in known if len(x)))
