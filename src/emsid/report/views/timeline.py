"""The time axis of a figure of a record."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.report.document import Axis

if TYPE_CHECKING:
    from emsid.record import Record

Array = NDArray[np.float64]

TIME = Axis("Time", "s")


def timeline(record: Record) -> tuple[Array, NDArray[np.intp]]:
    """The time axis of a figure of a record, with gaps between its segments.

    Experiments that all begin at zero are placed one after the other.

    Returns:
        (M,) time in seconds, ascending, and (M,) the index of the sample there, −1 in a gap.
    """
    times: list[ArrayLike] = []
    samples: list[ArrayLike] = []
    offset, end = 0, -inf
    for segment in record.segments:
        t = segment.time
        if t[0] < end:
            t = t + (end - t[0])
        if offset:
            times.append([(end - record.dt + t[0]) / 2])
            samples.append([-1])
        times.append(t)
        samples.append(np.arange(offset, offset + len(segment)))
        offset, end = offset + len(segment), float(t[-1]) + record.dt
    return np.concatenate(times), np.concatenate(samples).astype(np.intp)


def with_gaps(values: Array, samples: NDArray[np.intp]) -> Array:
    """(M,) values (N,) in the order of `timeline`, NaN in its gaps."""
    return np.where(samples < 0, np.nan, values[samples])
