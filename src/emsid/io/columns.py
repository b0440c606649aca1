"""The result of every reader: the columns of a file, and information about the rest of it for messages.

**Cells that hold several numbers** become columns of their own. A list or array of n numbers in every row becomes
``name_1`` … ``name_n``, as a matrix does, and a table in a cell ``name.field``.

A data frame is given the same form.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, listed, some
from emsid.units import SI, called, known_unit, name_and_unit

if TYPE_CHECKING:
    import polars as pl


from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import polars as pl


from typing import TYPE_CHECKING

from emsid.record.frames import column_names, numbers

if TYPE_CHECKING:
    import polars as pl

MOST_SHOWN = 60
"""Characters of a damaged line that a message shows."""

HALF_A_DAY = 12 * 3600 * 10**9
"""In nanoseconds, in which times of day are counted."""

ONE_NUMBER = "a single number"
"""Why such an entry is no column."""

UNITS = "emsid.units"
"""Under this name, formats without a header line hold the units of their columns, a JSON table by name."""


def units_as_json(units: Mapping[str, str]) -> str:
    """The units that are known, for a file to hold them."""
    return json.dumps({name: unit for name, unit in units.items() if unit}, ensure_ascii=False)


def units_from_json(text: str) -> dict[str, str]:
    """The units in a file; nothing where that is no table of texts."""
    try:
        units = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(units, dict):
        return {}
    return {name: unit for name, unit in units.items() if isinstance(unit, str)}


@dataclass(frozen=True)
class DamagedRow:
    """A line among the data with another number of values than the rest.

    Attributes:
        row: the data row that it is, or before which it stands, counted from 0.
        line: of the file, 1-based.
        text: the line.
        values: the number of its values, and ``expected``, that of the rest.
        is_sample: whether it takes the place of a sample, as a line that was cut off does. A line without any number,
            such as a message of the logger, does not.
    """

    row: int
    line: int
    text: str
    values: int
    expected: int
    is_sample: bool

    def __str__(self) -> str:
        return (
            f"row {self.line} of the file has {self.values} value{'s' * (self.values != 1)} where the others have "
            f"{self.expected} ({self.text[:MOST_SHOWN]!r})"
        )


@dataclass(frozen=True)
class Excerpt:
    """Which rows of a table columns hold.

    Attributes:
        table: the table, an `emsid.io.large.LargeTable`.
        stretches: the rows of the file that are held, ascending, counted from 0.
        rows: the number of rows in the file.
    """

    table: Any
    stretches: tuple[range, ...]
    rows: int


@dataclass(frozen=True)
class Columns:
    """The content of one file.

    Attributes:
        series: every column by name, one value per sample; they need not be equally long (a MAT file may hold
            two experiments). Numbers are numeric series; a column holding any text stays text.
        others: the other entries of the file by name, and why each is not a column (``"a single number"``).
        numbers: those of them that are single numbers, such as ``fs``.
        units: the unit of a column, from a row under the header or from `UNITS`, if the file has one.
        preamble: the lines above the header, for hints.
        lines: the line of the file that each row was read from, 1-based, of an excerpt for each row of the file; None
            for formats without lines.
        damaged: the lines among the data that are no row of the table. Where such a line takes the place of a sample,
            every column has a missing value there.
        clocks: the time column of each column, for formats in which columns have times of their own.
        cut: by column of a file that is cut off, how many samples are there and how many there should be, or 0 where
            the file ends in the middle of a sample and does not say what follows; the name '' is every column.
        excerpt: the rows that are held of a file that is larger than memory; None for the columns of a whole file.
    """

    series: Mapping[str, pl.Series]
    others: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    preamble: tuple[str, ...] = ()
    lines: Sequence[int] | None = None
    damaged: tuple[DamagedRow, ...] = ()
    clocks: Mapping[str, str] = field(default_factory=dict)
    cut: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    excerpt: Excerpt | None = None

    def file_rows(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """The rows of the file, counted from 0, that rows of the columns are; these themselves but in an excerpt."""
        if self.excerpt is None:
            return rows
        stretches = self.excerpt.stretches
        edges = np.cumsum([0, *map(len, stretches)])
        shift = np.array([each.start for each in stretches]) - edges[:-1]
        return np.asarray(rows + shift[np.searchsorted(edges, rows, side="right") - 1])

    def unit(self, name: str) -> str:
        """The unit that the file gives for a column: in `units`, else in its name; empty where none is known."""
        given = self.units.get(name, "")
        return (given if given in SI else known_unit(given)) if given else name_and_unit(name)[1]

    def called(self, name: str) -> str:
        """The column that a name means, with or without its unit in brackets; the name itself where there is none.

        Raises:
            DataError: where several columns differ only by their units.
        """
        if name in self.series or name in self.others:
            return name
        found = called(name, {each: self.unit(each) for each in self.series})
        if len(found) > 1:
            names = listed([*map(repr, found)])
            raise DataError(f"several columns are called {name!r}: {names}; give the name with its unit")
        return found[0] if found else name

    def number(self, row: int) -> int:
        """The number under which the user finds row ``row`` (counted from 0)."""
        row = int(self.file_rows(np.array(row)))
        return row + 1 if self.lines is None else self.lines[row]

    @property
    def stretches(self) -> list[slice]:
        """The parts of consecutive rows of the file; one but in an excerpt."""
        if self.excerpt is None:
            return [slice(None)]
        edges = np.cumsum([0, *map(len, self.excerpt.stretches)]).tolist()
        return [slice(*each) for each in pairwise(edges)]

    @property
    def placed(self) -> str:
        """The words for the place of such a number: ``row {} of the file`` where lines are counted, else ``row {}``."""
        return "row {}" if self.lines is None else "row {} of the file"

    @property
    def besides(self) -> str:
        """What else is in the file, in brackets, for the end of a sentence; empty where there is nothing."""
        if not self.others:
            return ""
        return f" (and, no columns: {some(f'{name}, {reason}' for name, reason in self.others.items())})"

    def place(self, row: int) -> str:
        """Where the user finds row ``row`` (counted from 0)."""
        return self.placed.format(self.number(row))


WORDS = (
    *(("true", "false"), ("on", "off"), ("yes", "no"), ("cw", "ccw"), ("fwd", "rev"), ("forward", "reverse")),
    *(("forward", "backward"), ("forwards", "backwards"), ("right", "left"), ("up", "down"), ("high", "low")),
)
"""Pairs of words for 1 and 0, as of a direction."""


def as_numbers(series: pl.Series) -> NDArray[np.float64]:
    """(N,) the values as real numbers, NaN where there is none; dates and durations become seconds.

    Times of day that fall by more than half a day have passed midnight. A pair of words, such as ``CW`` and ``CCW``, is
    1 and 0.
    """
    import polars as pl

    if series.dtype == pl.String:
        words = series.str.to_lowercase()
        found = words.drop_nulls().unique().to_list()
        pair = next((pair for pair in WORDS if found and set(found) <= set(pair)), None)
        series = series if pair is None else words.replace(dict(zip(pair, ("1", "0"), strict=True)))
    if series.dtype == pl.Date:
        series = series.cast(pl.Datetime("ms"))
    if series.dtype.is_temporal():
        physical = series.to_physical()
        if series.dtype == pl.Time:
            nights = (physical.diff() < -HALF_A_DAY).fill_null(False).cum_sum()
            physical = physical + 2 * HALF_A_DAY * nights.cast(pl.Int64)
        per_second = {"ms": 1e3, "us": 1e6, "ns": 1e9}[getattr(series.dtype, "time_unit", None) or "ns"]
        series = (physical - physical.min()).cast(pl.Float64) / per_second
    return series.cast(pl.Float64, strict=False).fill_null(np.nan).to_numpy().astype(np.float64)


@contextmanager
def errors_of(file: Path) -> Iterator[None]:
    """Begin the message of an error about the data with the file."""
    try:
        yield
    except DataError as problem:
        message = str(problem).removeprefix(f"{file.name}: ")
        raise type(problem)(f"{file}: {message}", arguments=problem.arguments) from None


def nearest(name: str, candidates: Iterable[str]) -> str:
    """``"; did you mean 'speed'?"``, or nothing where no candidate resembles ``name``."""
    candidates = list(candidates)
    by_lower = {candidate.lower(): candidate for candidate in candidates}
    close = get_close_matches(name, candidates, n=1) or [
        by_lower[match] for match in get_close_matches(name.lower(), by_lower, n=1)
    ]
    return f"; did you mean {close[0]!r}?" if close else ""


def from_arrays(variables: Iterable[tuple[str, object]]) -> Columns:
    """The columns of named arrays in a MAT or NPZ file.

    A vector (N,), (N, 1) or (1, N) is a column; a matrix (N, k) with k ≤ N becomes ``name_1`` … ``name_k``. Everything
    else is listed among `Columns.others`; a variable that could not be read is a text with the reason.
    """
    import polars as pl

    series: dict[str, pl.Series] = {}
    others: dict[str, str] = {}
    numbers: dict[str, float] = {}
    for name, value in variables:
        if isinstance(value, np.ndarray) and value.ndim > 2:  # (1, 1, N), as Simulink logs a signal
            value = value.squeeze()
        reason = reason_against(value)
        if reason:
            others[name] = reason
            if reason == ONE_NUMBER and isinstance(value, np.ndarray):
                numbers[name] = float(value.item())
            continue
        assert isinstance(value, np.ndarray)
        values = _plain(value)
        if 1 in values.shape or values.ndim == 1:
            series[name] = pl.Series(name, values.ravel())
        else:
            for k in range(values.shape[1]):
                series[f"{name}_{k + 1}"] = pl.Series(f"{name}_{k + 1}", np.ascontiguousarray(values[:, k]))
    return Columns(series, others, numbers)


def reason_against(value: object) -> str:
    """Why ``value`` is not one or several columns; empty where it is."""
    if isinstance(value, str):
        return value
    if not isinstance(value, np.ndarray):
        return f"a {type(value).__name__}"
    if value.dtype.kind == "c":
        return "complex numbers"
    if value.dtype.kind not in "biuf":
        return "text" if value.dtype.kind in "US" else "not numbers"
    if value.size == 0:
        return "empty"
    if value.size == 1:
        return ONE_NUMBER
    if value.ndim > 2:
        return f"a {value.ndim}-dimensional array"
    if value.ndim == 2 and value.shape[0] != 1 and value.shape[1] > value.shape[0]:
        return f"a matrix of {value.shape[0]} rows by {value.shape[1]} columns (samples go down: transpose it)"
    return ""


def _plain(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """The numbers in a type and byte order that Polars accepts."""
    if values.dtype.kind == "f":
        return values.astype(np.float64, copy=False)
    return values.astype(values.dtype.newbyteorder("="), copy=False)


# --- cells that hold several numbers ----------------------------------------------------------------------------------

MOST_VALUES = 1_000
"""A longer list in a cell is a signal or a picture, and no row of channels."""
DEEPEST = 4
"""Tables and lists inside so many others are not read."""


def flat(frame: pl.DataFrame) -> tuple[dict[str, pl.Series], dict[str, str]]:
    """The columns of a frame without nested values, and why other columns are none.

    Args:
        frame: of any types.
    """
    series: dict[str, pl.Series] = {}
    others: dict[str, str] = {}
    waiting = [(column, 0) for column in reversed(frame.get_columns())]
    while waiting:
        column, depth = waiting.pop()
        if not column.dtype.is_nested():
            series[column.name] = column
            continue
        parts = "lists or tables inside others" if depth == DEEPEST else _parts(column)
        if isinstance(parts, str):
            others[column.name] = parts
        else:
            waiting += [(part, depth + 1) for part in reversed(parts)]
    return series, others


def _parts(column: pl.Series) -> list[pl.Series] | str:
    """The columns that a nested one is made of, or the reason why it is none."""
    import polars as pl

    if isinstance(column.dtype, pl.Struct):
        table = column.struct.unnest()
        return [table[field].alias(f"{column.name}.{field}") for field in table.columns]
    if isinstance(column.dtype, pl.Array):
        column = column.arr.to_list()
    lengths = column.list.len().drop_nulls().unique().to_list()
    if len(lengths) != 1:
        return "lists of different lengths" if lengths else "empty"
    length = int(lengths[0])
    if not 0 < length <= MOST_VALUES:
        return f"lists of {length:,} values" if length else "empty lists"
    return [column.list.get(k).alias(f"{column.name}_{k + 1}") for k in range(length)]


# --- data frames ------------------------------------------------------------------------------------------------------

INDEX = "time"
"""The name of the column that an index without a name becomes."""


def columns_of_frame(frame: Any) -> Columns:
    """The columns of a pandas frame, a Polars frame or a dictionary of arrays; an index that is no row number is one.

    Raises:
        DataError: for something without columns.
    """
    found = {str(name): _series(str(name), frame[name], frame) for name in column_names(frame)}
    index = getattr(frame, "index", None)
    if index is not None and not callable(index) and type(index).__name__ != "RangeIndex":
        name = str(getattr(index, "name", None) or INDEX)
        if name not in found:
            found = {name: _series(name, index, {name: index}), **found}
    if not found:
        raise DataError("there is no column in this frame")
    return Columns(found)


def _series(name: str, values: Any, frame: Any) -> pl.Series:
    """A column as numbers, times or texts."""
    import polars as pl

    if isinstance(values, pl.Series):
        return values
    if str(getattr(values, "dtype", "")).lower().startswith(("datetime", "timedelta")):
        kind = "datetime64[ns]" if "date" in str(values.dtype).lower() else "timedelta64[ns]"
        return pl.Series(name, np.asarray(values, dtype=kind))
    try:
        return pl.Series(name, numbers(frame, [name])[:, 0]).fill_nan(None)
    except DataError:
        return pl.Series(name, [text if isinstance(text, str) else None for text in values], dtype=pl.String)
