"""The topology of a cascade, and the options of its identification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from emsid.estimation.nonlinear.losses import SQUARES, Loss
from emsid.models.blocks.search.map_families import SPLINE, Family, family_of, tried_families
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.terms import check_whole
from emsid.record import Record

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
