"""The rows of the table of a fit: what was found of every parameter, where its value is from, and its interval."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from statistics import NormalDist


class Status(StrEnum):
    """The source of the value of a parameter."""

    ESTIMATED = "estimated"
    CONDITIONAL = "depends on kept values"  # the data identify only combinations of it with what was given
    ASSUMING = "depends on assumed values"  # with what nobody gave or measured
    KEPT = "not identifiable: kept at start"
    FIXED = "fixed"  # by the user
    AT_BOUND = "at a bound"
    BUILT_IN = "built in"  # neither estimated nor given
    OF_PLANT = "of the plant given"
    CHOSEN = "chosen by the search"
    UNDETERMINED = "not determined by these data"
    PREDICTOR = "of the one-step predictor"  # which is not the system


INCLUDES_ZERO = "interval includes zero"
"""The status of an estimate that may be zero: the data give a bound of it, and no value."""


@dataclass(frozen=True, repr=False)
class Estimate:
    """A row of the table of parameters.

    Attributes:
        name, symbol, unit, description: of the parameter.
        value: in that unit.
        standard_error: of it; None for one that was not estimated.
        status: the source of the value.
        start: the value the search began with; None without a search.
        datasheet: the value in the datasheet; None without one.
        given: the fixed and kept values that the estimate depends on, by name; its interval holds only if they are
            right.
        interval: its 95 % interval, None without one; at a bound that of the likelihood profile.
        record: of a parameter that differs by record, the record; else empty.
    """

    name: str
    symbol: str
    unit: str
    description: str
    value: float
    standard_error: float | None
    status: Status
    start: float | None = None
    datasheet: float | None = None
    given: tuple[str, ...] = ()
    interval: tuple[float, float] | None = None
    record: str = ""

    def __repr__(self) -> str:
        ends = f", 95 %: {self.interval[0]:.4g} … {self.interval[1]:.4g}" if self.interval else ""
        return f"Estimate({self.name} = {self.value:.4g}{self.unit and f' {self.unit}'}{ends}; {self.status})"

    @property
    def asked(self) -> bool:
        """Whether it was to be estimated."""
        return self.status not in (Status.FIXED, Status.BUILT_IN, Status.OF_PLANT, Status.CHOSEN)

    @property
    def how(self) -> str:
        """The source of the value, and whether it may be zero, in a few words for a table."""
        words = str(self.status)
        if self.given:
            words = f"{'assuming' if self.status is Status.ASSUMING else 'given'} {', '.join(self.given)}"
        return f"{words}, {INCLUDES_ZERO}" if self.may_be_zero else words

    @property
    def may_be_zero(self) -> bool:
        """Whether it is an estimate, and zero lies inside its interval."""
        return self.estimated and self.interval is not None and self.interval[0] < 0 < self.interval[1]

    @property
    def estimated(self) -> bool:
        """Whether it is an estimate, whatever it depends on."""
        return self.status in (Status.ESTIMATED, Status.CONDITIONAL, Status.ASSUMING)


BY_NOBODY = (Status.KEPT, Status.BUILT_IN, Status.AT_BOUND, Status.UNDETERMINED)
"""Values that nobody gave, unless a datasheet has them, and that no data determine."""


def assumed_in(table: Sequence[Estimate], more: Iterable[str] = ()) -> tuple[Estimate, ...]:
    """The rows whose values nobody gave or measured, and on which others of the table depend.

    Args:
        table: the parameters of a fit.
        more: names on which other results of the fit depend.
    """
    needed = {*(name for row in table for name in row.given), *more}
    return tuple(row for row in table if row.name in needed and row.status in BY_NOBODY and row.datasheet is None)


HALF_WIDTH = NormalDist().inv_cdf(0.975)
"""Half the width of a 95 % interval, in standard errors."""
