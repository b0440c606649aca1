"""An excerpt of a long record: fewer samples that show what the whole record does.

Of a long record, structures are compared, and searches begun, on an excerpt. An estimate from N samples has errors in
proportion to 1/√N, so in a long record more samples cost time and change little. An excerpt has to keep the range of
the record, because a model extrapolates beyond the range that it was fitted to.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.record.joining import concatenate
from emsid.record.record import Record

Piece = tuple[int, int]
"""The first sample, and the one after the last."""

PIECES = 8
"""Pieces of a record without gaps."""
SHORT = 500
"""A record with more segments has as many pieces, where they have no fewer samples than these."""
REACHED = 0.02
"""An excerpt reaches an extreme of a channel if it comes as near as this share of the channel's range."""


def excerpt(record: Record, most: int, least: int = PIECES) -> Record:
    """Pieces of a record at equal distances, with at most this many samples in all; a shorter record itself.

    No piece contains a gap; where segments are shorter than pieces, whole segments are taken. Where the pieces do not
    reach the smallest or the largest value of a channel, the piece next to it is moved there.

    Args:
        record: of any length.
        most: samples of the excerpt.
        least: number of its pieces, where the record has no more segments and these are long enough.
    """
    if len(record) <= most:
        return record
    return concatenate([record[first:stop] for first, stop in _pieces(record, most, least)], name=record.name)


def outside_excerpt(record: Record, most: int, least: int = PIECES) -> Record | None:
    """The samples that `excerpt` leaves out; None where it leaves out none."""
    if len(record) <= most:
        return None
    inside = np.zeros(len(record), dtype=bool)
    for first, stop in _pieces(record, most, least):
        inside[first:stop] = True
    return record.mask(inside) if not inside.all() else None


def _pieces(record: Record, most: int, least: int) -> list[Piece]:
    """The pieces of an excerpt, in the order of time."""
    pieces = _at_equal_distances(record, most, least)
    kept: set[Piece] = set()  # those that reach an extreme
    for signal in (*record.input.T, *record.output.T):
        near = REACHED * float(np.ptp(signal))
        for values in (signal, -signal):
            place = int(np.argmax(values))
            reach = [(a, b) for a, b in pieces if values[a:b].max() >= values[place] - near]
            free = [piece for piece in pieces if piece not in kept]
            if not reach and free:
                nearest = min(free, key=lambda piece: abs(sum(piece) // 2 - place))
                pieces.remove(nearest)
                there, rest = _moved(nearest, place, pieces, record)
                pieces, reach = sorted([*pieces, there, *rest]), [there]
            if kept.isdisjoint(reach):
                kept |= set(reach[:1])
    return pieces


def _moved(piece: Piece, place: int, others: Sequence[Piece], record: Record) -> tuple[Piece, list[Piece]]:
    """The piece around a sample of its segment, between the others; and the rest, where there is no room for all."""
    k = int(np.searchsorted(record.breaks, place, side="right"))
    edges = (0, *record.breaks, len(record))
    low = max([edges[k], *(stop for _, stop in others if stop <= place)])
    high = min([edges[k + 1], *(first for first, _ in others if first > place)])
    first, stop = piece
    left = stop - first - (high - low)
    if left > 0:
        return (low, high), [(first, first + left)]
    begin = min(max(place - (stop - first) // 2, low), high - (stop - first))
    return (begin, begin + stop - first), []


def _at_equal_distances(record: Record, most: int, least: int) -> list[Piece]:
    """Pieces of equal length in every long segment; of a segment that has no room for its pieces, all of it."""
    edges = np.array([0, *record.breaks, len(record)])
    sizes = np.sort(np.diff(edges))
    half = int(sizes[np.searchsorted(np.cumsum(sizes), len(record) / 2)])  # half of the samples: in segments this long
    length = max(min(most // max(least, min(len(sizes), most // SHORT)), half), 1)
    starts = np.linspace(0, len(record) - length, most // length).astype(int)
    owners = np.searchsorted(edges, starts + length // 2, side="right") - 1
    pieces: list[Piece] = []
    for k in np.unique(owners):
        low, high = int(edges[k]), int(edges[k + 1])
        own = np.maximum(starts[owners == k], low)
        if high - low <= length * len(own):
            pieces.append((low, high))
            continue
        after = length * np.arange(len(own))  # pieces that do not overlap, from the first one on, end in the segment
        own = np.minimum(np.maximum.accumulate(own - after), high - length * len(own)) + after
        pieces += [(int(first), int(first) + length) for first in own]
    return pieces
