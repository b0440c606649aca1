"""The data that the choices of a cascade are made from, and the unseen data; see `emsid.record.holding_back`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.search.topologies import CascadeSearch
from emsid.models.free_run import squared_errors
from emsid.record import Record, concatenate
from emsid.record.holding_back import FOLDS, Split, every, is_series, validation_splits

Array = NDArray[np.float64]
# The unseen fraction of each record while choices are made.
UNSEEN = 0.25
# The largest number of samples in a refinement for a choice.
CHOICE_SAMPLES = 8_000
# In a series of experiments every k-th is used or held back.
SERIES = 4


class Round(NamedTuple):
    """A split into fitted and unseen data.

    Attributes:
        known: the records to fit.
        unseen: records to run; a part of a record has everything before it ahead, so that the run has settled there.
        ahead: how many samples of each of these are not unseen.
    """

    known: Sequence[Record]
    unseen: Sequence[Record]
    ahead: Sequence[int]

    @property
    def longest(self) -> int:
        """The number of samples of the longest unseen segment."""
        parts = [record[ahead:] for record, ahead in zip(self.unseen, self.ahead, strict=True) if ahead < len(record)]
        return max((len(segment) for part in parts for segment in part.segments), default=0)

    def squared_errors(self, model: Cascade) -> Array:
        """(N,) the squared free-run error of a model at every unseen sample, NaN where none counts."""
        runs = zip(self.unseen, self.ahead, strict=True)
        return np.concatenate([squared_errors(model, [record])[ahead:] for record, ahead in runs])


def held_back(records: Sequence[Record], settings: CascadeSearch) -> tuple[list[Record], list[Round]]:
    """The records that choices are made from, and the splits into fitted and unseen data that compare them.

    Of several records of a period each, every k-th is unseen, so that the others stay whole.
    """
    fitted, splits = _splits(records, settings)
    if len(splits) == 1:
        ((known, unseen),) = splits
        return fitted, [Round(known, unseen, [0] * len(unseen))]
    edges = [[int(len(record) * k / FOLDS) for k in range(FOLDS + 1)] for record in records]
    rounds = []
    for k, (known, _) in enumerate(splits):
        upto = [record[: edge[k + 1]] for record, edge in zip(records, edges, strict=True)]
        rounds.append(Round(known, upto, [edge[k] for edge in edges]))
    return fitted, rounds


def _splits(records: Sequence[Record], settings: CascadeSearch) -> tuple[list[Record], list[Split]]:
    if settings.period and settings.unseen is None and len(records) >= SERIES:
        known, unseen = every(records, SERIES)
        return known, [(known, [record[:CHOICE_SAMPLES] for record in unseen])]
    if settings.unseen is not None:
        unseen = [settings.unseen] if isinstance(settings.unseen, Record) else list(settings.unseen)
        return list(records), [(records, [record[:CHOICE_SAMPLES] for record in unseen])]
    fitted, splits = validation_splits(records, UNSEEN)
    return fitted, [(known, [record[:CHOICE_SAMPLES] for record in unseen]) for known, unseen in splits]


def shortened(records: Sequence[Record]) -> list[Record]:
    """The start of every record, or some experiments of a series, with about `CHOICE_SAMPLES` samples in total."""
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
    """(u, y) of every segment without the delay."""
    return [(u[: len(u) - delay], y[delay:]) for u, y in as_arrays(records) if len(u) > delay]
