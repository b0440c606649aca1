"""What of the records the choices of a cascade are made from, and what judges them; see `emsid.record.holding_back`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.search.topologies import CascadeSearch
from emsid.record import Record, concatenate
from emsid.record.holding_back import Split, is_series, validation_splits

Array = NDArray[np.float64]
# How much of each record judges while choices are made.
JUDGES = 0.25
# Refinements for a choice see no more samples than this.
CHOICE_SAMPLES = 8_000
# Of a series of experiments every so many are shown or held back.
SERIES = 4


def held_back(records: Sequence[Record], settings: CascadeSearch) -> tuple[list[Record], list[Split]]:
    """What choices may be made from, and the rounds in which they are judged, each on data that it does not fit."""
    if settings.unseen is not None:
        judge = [settings.unseen] if isinstance(settings.unseen, Record) else list(settings.unseen)
        return list(records), [(records, [record[:CHOICE_SAMPLES] for record in judge])]
    identify, judged = validation_splits(records, JUDGES)
    return identify, [(known, [record[:CHOICE_SAMPLES] for record in unseen]) for known, unseen in judged]


def shortened(records: Sequence[Record]) -> list[Record]:
    """The start of every record, or every few experiments of a series, together about as long as a choice needs."""
    share = max(CHOICE_SAMPLES // len(records), 1)
    return [
        concatenate(record.segments[:: -(-len(record) // share)])
        if is_series(record, SERIES)
        else record[: max(share, min(len(record), 500))]
        for record in records
    ]


def as_arrays(records: Sequence[Record]) -> list[tuple[Array, Array]]:
    return [(piece.input[:, 0], piece.output[:, 0]) for record in records for piece in record.segments]


def delayed(records: Sequence[Record], delay: int) -> list[tuple[Array, Array]]:
    """(u, y) of every segment with the delay taken off."""
    return [(u[: len(u) - delay], y[delay:]) for u, y in as_arrays(records) if len(u) > delay]
