"""What a cascade is asked to be: which filters stand beside its map, and what is given or left to be chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from emsid.errors import ModelError
from emsid.estimation.nonlinear.gauss_newton import Iteration
from emsid.estimation.nonlinear.losses import SQUARES, Loss
from emsid.models.blocks.search.map_families import (
    COULOMB,
    DEAD_ZONE,
    PIECEWISE_LINEAR,
    POLYNOMIAL,
    SATURATION,
    SPLINE,
    Family,
)
from emsid.models.terms import check_whole
from emsid.record import Record

Progress = Callable[[str, Iteration | None], None]
# Of the filters before and after the map; None where the layout has none, or it is to be chosen.
Orders = tuple[int | None, int | None]


@dataclass(frozen=True)
class Layout:
    """Which filters a structure has beside the map that is looked for.

    Attributes:
        name: of the structure.
        first, second: whether there is a filter before the map, and one after it.
        outer: whether a second map follows the second filter.
    """

    name: str
    first: bool
    second: bool
    outer: bool = False


WIENER_HAMMERSTEIN = Layout("wiener-hammerstein", first=True, second=True)
HAMMERSTEIN = Layout("hammerstein", first=False, second=True)
WIENER = Layout("wiener", first=True, second=False)
HAMMERSTEIN_WIENER = Layout("hammerstein-wiener", first=False, second=True, outer=True)

LAYOUTS: dict[str, Layout] = {
    layout.name: layout for layout in (WIENER_HAMMERSTEIN, HAMMERSTEIN, WIENER, HAMMERSTEIN_WIENER)
}


@dataclass(frozen=True, eq=False)
class Options:
    """What may be given to the estimation of a cascade; what is None is chosen on held-back data.

    Attributes:
        static: family of the static map, see `families`; None chooses among `CHOSEN_FAMILIES`.
        size: its number of knots, or degree; given without a family, it is one of a spline.
        delay: from the input to its first effect, in samples.
        oversampling: how many times faster than the record the blocks run; None tries 1 and 2.
        validation: records that judge the choices, in place of the last quarter of the identification records.
        skip: samples left out at the start of every segment; None estimates the starting states.
        loss: what the final fit minimises.
        workers: threads for what can be tried at the same time.
        max_iterations, max_seconds: budget of the final fit.
        rng: source of the random starts.
        progress: called with what is being done, and with every step of the final fit.

    Raises:
        ModelError: for numbers that are no counts, a static map that is no family.
    """

    static: Family | None = SPLINE
    size: int | None = None
    delay: int | None = None
    oversampling: int | None = None
    validation: Record | Sequence[Record] | None = None
    skip: int | None = None
    loss: Loss = SQUARES
    workers: int = 2
    max_iterations: int = 150
    max_seconds: float = np.inf
    rng: np.random.Generator | None = None
    progress: Progress | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.static, Family | None):
            raise ModelError(f"static {self.static!r} is no family of maps; give one of `map_families`")
        for what, value, least, why in (
            ("delay", self.delay, 0, "a model cannot look ahead"),
            ("oversampling", self.oversampling, 1, "blocks run at least as fast as the record"),
            ("size", self.size, 0, "this is a number of knots, or a degree"),
            ("skip", self.skip, 0, "these are samples to be left out"),
            ("workers", self.workers, 1, "somebody has to do the work"),
        ):
            if value is not None:
                check_whole(what, value, least, why)

    @property
    def families(self) -> tuple[Family, ...]:
        """Those that the map may be of."""
        if self.static is None:
            return CHOSEN_FAMILIES if self.size is None else (SPLINE,)
        return (self.static,)

    def tell(self, what: str, iteration: Iteration | None = None) -> None:
        """Report progress, if anybody listens."""
        if self.progress is not None:
            self.progress(what, iteration)


# What a map may be where nobody says; the spline leads, as trials are splines.
CHOSEN_FAMILIES = (SPLINE, PIECEWISE_LINEAR, POLYNOMIAL, DEAD_ZONE, SATURATION, COULOMB)

DEFAULTS = Options()
