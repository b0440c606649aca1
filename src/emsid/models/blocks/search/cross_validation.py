"""What of the records choices are made from, and what judges them.

Held back is the last quarter of every record, or the records given for that. A quarter of a short record says little;
there each quarter is held back in turn. In a series of experiments, such as steps of ascending height, none stands for
the rest, so that every few of them are held back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.search.topologies import CascadeSearch
from emsid.record import Record, concatenate

Array = NDArray[np.float64]
# What identifies and what judges.
Round = tuple[Sequence[Record], Sequence[Record]]

# How much of each record serves to identify while choices are made; the rest judges them.
IDENTIFY = 0.75
# Records of fewer samples together are short: each of so many parts judges once.
SHORT, FOLDS = 4_000, 4
# Refinements for a choice see no more samples than this.
CHOICE_SAMPLES = 8_000
# So many segments of about one length are a series of experiments.
SERIES = 8


def held_back(records: Sequence[Record], settings: CascadeSearch) -> tuple[list[Record], list[Round]]:
    """What choices may be made from, and the rounds in which they are judged, each on data that it does not fit."""
    if settings.unseen is not None:
        judge = [settings.unseen] if isinstance(settings.unseen, Record) else list(settings.unseen)
        return list(records), [(records, [record[:CHOICE_SAMPLES] for record in judge])]
    if sum(len(record) for record in records) < SHORT:
        return list(records), [_without_fold(records, k) for k in range(FOLDS)]
    halves = [record.hold_back(1 - IDENTIFY) if _is_series(record) else record.split(IDENTIFY) for record in records]
    identify = [first for first, _ in halves]
    return identify, [(identify, [second[:CHOICE_SAMPLES] for _, second in halves])]


def _without_fold(records: Sequence[Record], k: int) -> Round:
    """Every record without its k-th part, and those parts."""
    rest, parts = [], []
    for record in records:
        first, last = (int(len(record) * edge / FOLDS) for edge in (k, k + 1))
        gone = np.zeros(len(record), dtype=bool)
        gone[first:last] = True
        rest.append(record.mask(gone))
        parts.append(record[first:last])
    return rest, parts


def _is_series(record: Record) -> bool:
    """Whether a record is of many experiments, such as steps of ascending height, none of which stands for the rest."""
    return len(record.segments) >= SERIES and max(map(len, record.segments)) * SERIES <= 2 * len(record)


def shortened(records: Sequence[Record]) -> list[Record]:
    """The start of every record, or every few experiments of a series, together about as long as a choice needs."""
    share = max(CHOICE_SAMPLES // len(records), 1)
    return [
        concatenate(record.segments[:: -(-len(record) // share)])
        if _is_series(record)
        else record[: max(share, min(len(record), 500))]
        for record in records
    ]


def as_arrays(records: Sequence[Record]) -> list[tuple[Array, Array]]:
    return [(piece.input[:, 0], piece.output[:, 0]) for record in records for piece in record.segments]


def delayed(records: Sequence[Record], delay: int) -> list[tuple[Array, Array]]:
    """(u, y) of every segment with the delay taken off."""
    return [(u[: len(u) - delay], y[delay:]) for u, y in as_arrays(records) if len(u) > delay]
