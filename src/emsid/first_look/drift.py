"""A slow change of an output that its input does not explain.

The dynamics of a linear model are those of the record without its trends, so that no slow pole follows the drift. Gain,
offset and slope are then fitted together: a step of the input is a part of a trend, too. There is no drift where a
linear model without one is as good, as of a system that integrates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.baseline import Baseline
from emsid.first_look.levels import CLEAR, EXPLAINS, PART
from emsid.record import Record

Array = NDArray[np.float64]

BLOCKS = 12
"""The slope is that of the means of so many parts of the record."""


class Drift(NamedTuple):
    """The line that an output follows besides its input.

    Attributes:
        change: over the record.
        confidence: that it is a drift.
        at_rest: (N,) the output that a linear model with this drift has without an input.
    """

    change: float
    confidence: float
    at_rest: Array


def drift_of(record: Record, linear: Baseline | None, changing: Baseline | None) -> Drift | None:
    """The drift of the first output; None where there is none.

    Args:
        record: with an output.
        linear: a linear model of it.
        changing: a linear model of it without its trends.
    """
    if linear is None or linear.fit < EXPLAINS or changing is None:
        return None
    u, y = record.input[:, 0], record.output[:, 0]
    t = np.linspace(-0.5, 0.5, len(y))
    known = np.column_stack([changing.answer(u, record.breaks), np.ones(len(t))])
    ahead = t - known @ np.linalg.lstsq(known, t, rcond=None)[0]
    gain, offset, trend = np.linalg.lstsq(np.column_stack([known, t]), y, rcond=None)[0]
    drifting = y - known @ np.array([gain, offset])
    if np.linalg.norm(drifting - trend * t) > np.linalg.norm(linear.residual):
        return None
    blocks = [float(part.mean()) for part in np.array_split(drifting, BLOCKS)]
    k = np.arange(BLOCKS) - (BLOCKS - 1) / 2
    slope = float(k @ blocks / (k @ k))
    rest = np.array(blocks) - np.mean(blocks) - slope * k
    error = float(np.sqrt(rest @ rest / (BLOCKS - 2) / (k @ k) * (t @ t) / (ahead @ ahead)))
    change = BLOCKS * slope
    if not (abs(slope) > CLEAR * error and abs(change) > PART * y.std()):
        return None
    sure = round(min(0.95, 0.5 + abs(slope) / error / 20), 2)
    return Drift(change, sure, offset - gain * changing.gain * u.mean() + trend * t)
