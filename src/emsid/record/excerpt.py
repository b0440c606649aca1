"""An excerpt of a long record: fewer samples that show what the whole record does.

Structures are compared, and searches begun, on an excerpt where a record has more samples than that takes. An estimate
from N samples has errors of a size 1/√N, so many samples more change little but the time. What an excerpt must not lose
is the range of the record: a model is not asked about inputs that it has not seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.record.record import Record, concatenate

Indices = NDArray[np.intp]

PIECES = 8
"""Pieces of a record without gaps."""
SHORT = 500
"""A record with more segments has as many pieces, where they have no fewer samples than these."""
REACHED = 0.02
"""An excerpt reaches an extreme of a channel if it comes as near as this share of the channel's range."""


def excerpt(record: Record, most: int, least: int = PIECES) -> Record:
    """Pieces of a record at equal distances, with at most this many samples in all; a shorter record itself.

    Where these do not reach the smallest or the largest value of a channel, the piece next to it is moved there.

    Args:
        record: of any length.
        most: samples of the excerpt.
        least: number of its pieces, where the record has no more segments.
    """
    if len(record) <= most:
        return record
    starts, length = _pieces(record, most, least)
    return concatenate([record[first : first + length] for first in starts], name=record.name)


def outside_excerpt(record: Record, most: int, least: int = PIECES) -> Record | None:
    """The samples that `excerpt` leaves out; None where it leaves out none."""
    if len(record) <= most:
        return None
    starts, length = _pieces(record, most, least)
    inside = np.zeros(len(record), dtype=bool)
    for first in starts:
        inside[first : first + length] = True
    return record.mask(inside) if not inside.all() else None


def _pieces(record: Record, most: int, least: int) -> tuple[Indices, int]:
    """The first sample of every piece, and the length of all."""
    pieces = max(least, min(len(record.segments), most // SHORT))
    length = max(most // pieces, 1)
    starts = _within_segments(np.linspace(0, len(record) - length, pieces).astype(int), length, record)
    moved: set[int] = set()
    for signal in (*record.input.T, *record.output.T):
        near = REACHED * float(np.ptp(signal))
        for values in (signal, -signal):
            place = int(np.argmax(values))
            if any(values[first : first + length].max() >= values[place] - near for first in starts):
                continue
            k = int(np.argmin(np.abs(starts + length // 2 - place)))
            if k not in moved:
                before = starts[k - 1] + length if k else 0
                after = starts[k + 1] if k + 1 < pieces else len(record)
                starts[k] = np.clip(place - length // 2, before, after - length)
                moved.add(k)
    return starts, length


def _within_segments(starts: Indices, length: int, record: Record) -> Indices:
    """Pieces moved so that none crosses a gap, as far as segments are long enough and the pieces stay apart."""
    edges = np.array([0, *record.breaks, len(record)])
    k = np.searchsorted(edges, starts + length // 2, side="right") - 1
    inside = np.clip(starts, edges[k], np.maximum(edges[k + 1] - length, edges[k]))
    return inside if np.all(np.diff(inside) >= length) and inside[-1] + length <= len(record) else starts
