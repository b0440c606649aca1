"""Tables larger than memory: blocks of their rows are read one after the other, and an excerpt is held.

One pass over a table gives facts about each column and the number of rows. The excerpt has stretches of consecutive
rows, so that clock and dynamics are intact: `STRETCHES` at equal distances from the first row to the last one, and
a short one around each extreme of a column that these do not come near. Everything but least squares works on the
excerpt; least squares may take every row, block by block (`emsid.io.reading.Blocks`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from emsid.errors import FormatError
from emsid.io.cells import numbers_or_text
from emsid.io.columns import Columns, Excerpt, as_numbers
from emsid.record.holding_back import REACHED

if TYPE_CHECKING:
    import polars as pl

MOST, MOST_ROWS = 10_000_000, 1 << 20
"""Numbers of a file that are held in memory, and rows of an excerpt of a larger one: a first look takes about 70 bytes
for each number, and an identification about 400 for each row."""
STRETCHES, PART = 16, 8
"""Stretches of an excerpt, and the part of one that is read around an extreme."""
BLOCK = 1 << 21
"""Numbers that are read at a time: 16 MB."""


@dataclass(frozen=True)
class Facts:
    """What one pass over a table shows.

    Attributes:
        missing: by column, the rows without a number; of a text without a text.
        ranges: by column of numbers, the smallest and the largest one, each with its row; infinities are no numbers.
    """

    missing: dict[str, int] = field(default_factory=dict)
    ranges: dict[str, tuple[tuple[float, int], tuple[float, int]]] = field(default_factory=dict)

    def add(self, frame: pl.DataFrame, first: int) -> None:
        """Add rows, of which ``first`` is the number of the first one."""
        for column in frame:
            missing = column.null_count()
            if column.dtype.is_numeric() and missing < len(column):
                x = as_numbers(column)
                known = np.isfinite(x)
                missing = len(x) - int(np.count_nonzero(known))
                low, high = (
                    int(np.argmin(sign * x) if not missing else np.argmin(np.where(known, sign * x, np.inf)))
                    for sign in (1, -1)
                )
                if known[low]:
                    here = (float(x[low]), first + low), (float(x[high]), first + high)
                    before = self.ranges.get(column.name, here)
                    self.ranges[column.name] = min(before[0], here[0]), max(before[1], here[1], key=lambda at: at[0])
            self.missing[column.name] = self.missing.get(column.name, 0) + missing


class LargeTable(Protocol):
    """A table in a file, of which any rows can be read."""

    @property
    def sample(self) -> Columns:
        """Some of its rows, with its names and units; ``lines`` are those of all rows."""
        ...

    @property
    def rows(self) -> int:
        """The number of its rows."""
        ...

    @property
    def facts(self) -> Facts:
        """What a pass over all of them has shown."""
        ...

    def part(self, first: int, stop: int, names: Sequence[str]) -> pl.DataFrame:
        """The rows ``first`` to ``stop`` of some columns; cells of a text table that are no numbers stay texts."""
        ...


@dataclass(frozen=True)
class LargeScan:
    """A file that Polars scans: Parquet or Arrow."""

    path: Path
    scan: Callable[[Path], pl.LazyFrame]
    sample: Columns
    rows: int
    facts: Facts = field(default_factory=Facts)

    def part(self, first: int, stop: int, names: Sequence[str]) -> pl.DataFrame:
        """See `LargeTable`."""
        import polars as pl

        part = self.scan(self.path).slice(first, stop - first).select(names).collect()
        return part.with_columns(pl.col(pl.Categorical, pl.Enum).cast(pl.String))


@dataclass(frozen=True)
class HeldTable:
    """A table that is in memory, of which an excerpt is wanted all the same: a look at fewer rows takes less time."""

    sample: Columns
    rows: int
    facts: Facts = field(default_factory=Facts)

    def part(self, first: int, stop: int, names: Sequence[str]) -> pl.DataFrame:
        """See `LargeTable`."""
        import polars as pl

        return pl.DataFrame([self.sample.series[name].slice(first, stop - first).alias(name) for name in names])


def held_excerpt(columns: Columns, most: int) -> Columns:
    """An excerpt of about so many rows of columns in memory; the columns themselves where they are no longer table."""
    import polars as pl

    lengths = {len(series) for series in columns.series.values()}
    nested = any(series.dtype.is_nested() for series in columns.series.values())
    if columns.excerpt is not None or columns.clocks or nested or len(lengths) != 1 or max(lengths) <= most:
        return columns
    table = HeldTable(columns, max(lengths))
    table.facts.add(pl.DataFrame([series.alias(name) for name, series in columns.series.items()]), 0)
    return excerpt(table, most=most)


def scanned(
    path: Path,
    scan: Callable[[Path], pl.LazyFrame],
    columns_of: Callable[[pl.DataFrame, Mapping[str, str]], Columns],
    units: Mapping[str, str],
) -> LargeScan | None:
    """A file that Polars scans, after a pass over it; None where it fits into memory, or a column holds lists.

    Args:
        path: the file.
        scan: opens it.
        columns_of: the columns in a frame.
        units: of its columns.
    """
    import polars as pl

    schema = scan(path).collect_schema()
    rows = int(scan(path).select(pl.len()).collect().item())
    if rows * len(schema) <= MOST or any(kind.is_nested() for kind in schema.dtypes()):
        return None
    table = LargeScan(path, scan, columns_of(scan(path).head(1).collect(), units), rows)
    size = max(BLOCK // len(schema), 1)
    for first in range(0, rows, size):
        table.facts.add(table.part(first, min(first + size, rows), list(table.sample.series)), first)
    return table


def columns_in(table: LargeTable, stretches: Sequence[range], names: Sequence[str] = ()) -> Columns:
    """Some rows of a table as columns; without names, of all columns."""
    import polars as pl

    names = list(names or table.sample.series)
    frame = as_typed(pl.concat([table.part(each.start, each.stop, names) for each in stretches], rechunk=True))
    held = Excerpt(table, tuple(stretches), table.rows)
    return replace(table.sample, series={column.name: column for column in frame}, excerpt=held)


def as_typed(frame: pl.DataFrame) -> pl.DataFrame:
    """The frame with the texts that are numbers or moments as such."""
    import polars as pl

    texts = [column for column in frame if column.dtype == pl.String]
    return frame.with_columns([numbers_or_text(text.str.strip_chars().replace("", None)) for text in texts])


def excerpt(table: LargeTable, rows: slice = slice(None), most: int = MOST_ROWS) -> Columns:
    """An excerpt of a table.

    Args:
        table: any.
        rows: of which it is; few are taken completely.
        most: rows of the excerpt, about; of wide tables fewer.

    Raises:
        FormatError: where the file cannot be read any more.
    """
    first, stop, _ = rows.indices(table.rows)
    most = max(min(MOST // len(table.sample.series), most), STRETCHES)
    if stop - first <= most:
        return columns_in(table, [range(first, max(stop, first + 1))])
    length = most // STRETCHES
    starts = np.linspace(first, stop - length, STRETCHES).round().astype(int).tolist()
    stretches = [range(start, start + length) for start in starts]
    held = columns_in(table, stretches)
    reach = Facts()
    for series in held.series.values():
        reach.add(series.to_frame(), 0)
    extremes = set[int]()
    for name, ends in table.facts.ranges.items():
        near = REACHED * (ends[1][0] - ends[0][0])
        found = reach.ranges.get(name, ((np.inf, 0), (-np.inf, 0)))
        away = (row for (value, row), (other, _) in zip(ends, found, strict=True) if abs(value - other) > near)
        extremes |= {row for row in away if first <= row < stop}
    half = length // PART // 2
    more = [range(max(row - half, first), min(row + half + 1, stop)) for row in sorted(extremes)]
    joined: list[range] = []
    for each in sorted([*stretches, *more[: 2 * STRETCHES]], key=lambda each: each.start):
        if joined and each.start <= joined[-1].stop:
            before = joined.pop()
            each = range(before.start, max(before.stop, each.stop))
        joined.append(each)
    return columns_in(table, joined) if more else held


def check_wide(before: Columns, after: Columns) -> Columns:
    """The columns of an excerpt, unless they are those of a table with a row for every value of a signal.

    Raises:
        FormatError: for such a table.
    """
    if before.excerpt is not None and after is not before:
        raise FormatError(
            f"this table of {before.excerpt.rows:,} rows has a row for every value of a signal; one of this size is "
            "read with a column for every signal only: rearrange it, or take a part"
        )
    return after
