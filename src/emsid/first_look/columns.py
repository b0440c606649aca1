"""Facts about the numbers of one column: range, quantisation, codes, saturation, stretches that do not change."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.rounding import quantisation, runs
from emsid.first_look.levels import FEW, FEWEST_SAMPLES
from emsid.first_look.names import ColumnQuantity, Meaning
from emsid.io.options_by_column import unwrapped
from emsid.io.selection import MOST_SKIPPED

Array = NDArray[np.float64]

MOST_CODES = 5
"""At most this many values beyond a wide gap are codes, and this many stretches at 0, the longest, may be stuck."""
FEWEST_LEVELS = 20
"""A column of fewer values is a command of steps, which is neither saturated nor stuck."""
PERIODS = (*(2.0**bits for bits in range(8, 33)), 360.0, 3600.0, 36000.0, 2 * np.pi, 1.0)
"""Counters of 8 to 32 bits, degrees with up to two decimals as whole numbers, radians, revolutions."""
LONGEST_STEP = 0.25
"""Steps longer than this part of a period could be steps the other way round."""


@dataclass(frozen=True)
class Stretch:
    """Rows with the same value.

    Attributes:
        start: the first row, counted from 0.
        length: the number of rows.
        value: of all of them.
    """

    start: int
    length: int
    value: float


@dataclass(frozen=True)
class Code:
    """A value far from the others, which may be a code and not a quantity.

    Attributes:
        value: the number.
        count: how often it occurs.
        share: of all samples.
        response: what the output does there: ``falls``, ``rises``, ``rests`` or ``moves``; empty where it is not known.
        before, after: the mean absolute output at the first and at the last of these samples in a row.
    """

    value: float
    count: int
    share: float
    response: str = ""
    before: float = 0.0
    after: float = 0.0


@dataclass(frozen=True)
class Column:
    """One column of a file.

    Attributes:
        name: in the file.
        kind: ``numbers``, ``text`` or ``times``.
        meaning: what its name says.
        rows: the number of rows; ``missing`` of them have no number.
        low, high: its range without codes.
        distinct: the number of different values.
        step: the quantisation step; None where there is none.
        codes: isolated values.
        stuck: stretches without change in which the value may be stuck: the longest one, if it is unusually long, and
            the longest ones at 0, where a drive rests too.
        period: after which a position starts again; None where it does not.
        values: (N,) its numbers, NaN where there is none; of a position with a period continuous. Of a file larger than
            memory they are an excerpt, and ``rows``, ``missing`` and the range are those of the file.
        breaks: the first row of every further stretch of an excerpt.
    """

    name: str
    kind: str
    meaning: Meaning
    rows: int
    missing: int = 0
    low: float = np.nan
    high: float = np.nan
    distinct: int = 0
    step: float | None = None
    codes: tuple[Code, ...] = ()
    stuck: tuple[Stretch, ...] = ()
    period: float | None = None
    values: Array = field(default_factory=lambda: np.zeros(0), repr=False, compare=False)
    breaks: tuple[int, ...] = ()

    @property
    def constant(self) -> bool:
        """Whether all of its numbers are the same, or there are none."""
        return not self.high > self.low

    @property
    def gaps(self) -> bool:
        """Whether more of its numbers are missing than may be skipped, though most are there."""
        return MOST_SKIPPED * self.rows < self.missing < self.rows / 2

    @property
    def signal(self) -> Array:
        """(N,) its numbers, NaN for missing ones and codes."""
        coded = np.isin(self.values, [code.value for code in self.codes])
        return np.where(coded, np.nan, self.values)

    @property
    def movement(self) -> Array:
        """(N,) its signal; of a position its change, which is what rests and answers an input."""
        is_position = self.meaning.quantity is ColumnQuantity.POSITION
        return np.gradient(self.signal) if is_position and len(self.values) > 1 else self.signal


def column_of_numbers(name: str, kind: str, meaning: Meaning, values: Array, *, codes: bool = True) -> Column:
    """The facts about a column of numbers (N,), NaN where there is none; isolated values are levels without codes."""
    finite = values[np.isfinite(values)]
    missing = len(values) - len(finite)
    if not len(finite):
        return Column(name, kind, meaning, len(values), missing, values=values)
    levels, counts = np.unique(finite, return_counts=True)
    isolated, ordinary = _codes(levels, counts) if codes else ((), np.ones(len(levels), dtype=bool))
    levels = levels[ordinary]
    period = wrap_period(values) if meaning.quantity is ColumnQuantity.POSITION and not isolated else None
    return Column(
        name=name,
        kind=kind,
        meaning=meaning,
        rows=len(values),
        missing=missing,
        low=float(levels[0]),
        high=float(levels[-1]),
        distinct=len(levels),
        step=quantisation(levels),
        codes=isolated,
        stuck=stretches_without_change(values, levels),
        period=period,
        values=values if period is None else unwrapped(values, period),
    )


def wrap_period(values: Array) -> float | None:
    """The period after which values (N,) start again; None where they do not.

    They start again where a step is longer than half their range, from one end of the range to the other: the period is
    longer than the range, by less than two of the other steps. All other steps are short. Of several periods, the one
    is taken with which the steps at these jumps are most like their neighbours.
    """
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    span = float(np.ptp(values)) if len(values) else 0.0
    jumps = np.abs(steps) > span / 2
    count = int(np.count_nonzero(jumps))
    if count == 0 or count == len(steps):
        return None
    longest = float(np.max(np.abs(steps[~jumps])))
    whole = bool(np.all(values == np.rint(values)))
    of_its_own = (span + 1,) if whole and count >= FEW else ()
    bend = {}
    for period in (*PERIODS, *of_its_own):
        if span < period <= span + 2 * longest and longest < LONGEST_STEP * period:
            within = np.diff(unwrapped(values, period))
            if np.max(np.abs(within)) <= 2 * longest:
                bend[period] = float(np.sum(np.diff(within) ** 2))
    return min(bend, key=bend.__getitem__, default=None)


def _codes(levels: Array, counts: NDArray[np.intp]) -> tuple[tuple[Code, ...], NDArray[np.bool_]]:
    """Whole numbers that occur repeatedly beyond a gap wider than half the range of the others."""
    total = int(counts.sum())
    ordinary = np.ones(len(levels), dtype=bool)
    while True:
        left = np.flatnonzero(ordinary)
        found = next((group for group in (_isolated(levels[left], counts[left], side) for side in (1, -1)) if group), 0)
        if not found:
            break
        ordinary[left[-found:] if found > 0 else left[:-found]] = False
    where = np.flatnonzero(~ordinary)
    codes = tuple(Code(float(levels[k]), int(counts[k]), float(counts[k] / total)) for k in where)
    return codes, ordinary


def _isolated(levels: Array, counts: NDArray[np.intp], side: int) -> int:
    """How many of the highest (side 1) or lowest (side −1) values are codes, negative for the lowest."""
    if len(levels) < 6:
        return 0
    up, number = (levels, counts) if side > 0 else (-levels[::-1], counts[::-1])
    for k in range(1, min(MOST_CODES, len(up) - 5) + 1):
        gap, rest = up[-k] - up[-k - 1], up[-k - 1] - up[0]
        codes, times = up[-k:], number[-k:]
        whole = bool(np.all(codes == np.rint(codes)) and np.all(np.abs(codes) >= 100))
        if gap > 0.5 * rest and whole and times.min() >= 2 and 2 * times.sum() < number.sum():
            return side * k
    return 0


def stretches_without_change(values: Array, levels: Array) -> tuple[Stretch, ...]:
    """The longest stretch without change, if it is ten times longer than nearly all others, and the longest at 0."""
    if len(levels) < FEWEST_LEVELS:
        return ()
    starts, lengths = runs(values)
    at_zero = np.where(values[starts] == 0.0, lengths, 0)
    moving = np.where(np.isin(values[starts], (levels[0], levels[-1], 0.0)), 0, lengths)
    k = int(np.argmax(moving))
    others = np.delete(lengths, k)
    unusual = len(others) >= 20 and moving[k] >= max(FEWEST_SAMPLES, 10 * np.percentile(others, 99))
    longest = np.argsort(-at_zero, kind="stable")[:MOST_CODES]
    found = [*([k] if unusual else []), *(int(each) for each in longest if at_zero[each] >= FEWEST_SAMPLES)]
    return tuple(Stretch(int(starts[k]), int(lengths[k]), float(values[starts[k]])) for k in found)
