"""What the choices of a cascade are made from: its topology and options, and seen and unseen data.

See `emsid.record.holding_back` on the latter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.problem import SQUARES, Loss
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.search.map_families import SPLINE, Family, family_of, tried_families
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.free_run import squared_errors
from emsid.models.terms import check_whole
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


# --- topologies and options -------------------------------------------------------------------------------------------

# Orders of the filters before and after the map; None if the topology has no such filter, or to choose the order.
Orders = tuple[int | None, int | None]


@dataclass(frozen=True)
class Topology:
    """The filters and maps of a structure.

    Attributes:
        name: the name of the structure.
        first, second: whether there is a filter before the map, and one after it.
        outer: whether a second map follows the second filter.
    """

    name: str
    first: bool
    second: bool
    outer: bool = False


WIENER_HAMMERSTEIN = Topology("wiener-hammerstein", first=True, second=True)
HAMMERSTEIN = Topology("hammerstein", first=False, second=True)
WIENER = Topology("wiener", first=True, second=False)
HAMMERSTEIN_WIENER = Topology("hammerstein-wiener", first=False, second=True, outer=True)


@dataclass(frozen=True, eq=False)
class CascadeSearch:
    """Options of the identification of a cascade; options that are None are chosen on unseen data.

    Attributes:
        static: the static map: a name such as ``dead-zone``, a map or its class, see `family_of`; None chooses one.
        size: its number of knots, or degree; if no static map is given, that of a spline.
        delay: from the input to its first effect, in samples.
        oversampling: steps of the blocks per sample; None tries 1 and 2.
        unseen: records for the comparison of choices, instead of the last quarter of the fitted records.
        transient: samples left out at the start of every segment; None estimates the initial states.
        period: of a periodic input in steady state, in samples: outputs are averaged over periods, and no starting
            state is estimated. None detects inputs that repeat exactly, 0 takes none for periodic.
        loss: the loss of the final fit.
        threads: number of threads for parallel trials.
        max_iterations: steps of the final fit.
        least_saving: the final fit ends where a few steps together lower its cost by less than this part, and does not
            begin again then; zero fits on to the minimum.
        rng: source of the random starts.
        rectified: whether a sensor rectifies the output; None decides by the records, if a filter precedes the map.

    Raises:
        ModelError: for invalid numbers, or an unknown static map.
    """

    static: Family | StaticMap | type[StaticMap] | str | None = None
    size: int | None = None
    delay: int | None = None
    oversampling: int | None = None
    unseen: Record | Sequence[Record] | None = None
    transient: int | None = None
    period: int | None = None
    loss: Loss = SQUARES
    threads: int = 2
    max_iterations: int = 150
    least_saving: float = 0.0
    rng: np.random.Generator | None = None
    rectified: bool | None = None

    def __post_init__(self) -> None:
        if self.static is not None:
            object.__setattr__(self, "static", family_of(self.static))
        for what, value, least, why in (
            ("delay", self.delay, 0, "a model cannot look ahead"),
            ("oversampling", self.oversampling, 1, "blocks run at least as fast as the record"),
            ("size", self.size, 0, "this is a number of knots, or a degree"),
            ("transient", self.transient, 0, "these are samples to be left out"),
            ("period", self.period, 0, "0 takes no input for periodic"),
            ("threads", self.threads, 1, "at least one thread is needed"),
        ):
            if value is not None:
                check_whole(what, value, least, why)

    @property
    def families(self) -> tuple[Family, ...]:
        """The families to choose the map from."""
        if self.static is None:
            return tried_families(bool(self.rectified)) if self.size is None else (SPLINE,)
        return (family_of(self.static),)


DEFAULTS = CascadeSearch()
