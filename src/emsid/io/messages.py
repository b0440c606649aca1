"""Logs in which the columns have times of their own: a row for every message, or a row for every value.

A log of a CAN bus has a row for every message, with values in the columns of that message only. It gets a clock for
every message.

Loggers and databases export tables with a row for every value of every signal (``time,signal,value``). Such a table
becomes one with a row for every time and a column for every signal. Signals that were logged at times of their own have
missing values in between, as in a table with a row for every message.

`on_one_clock` resamples columns to the times of one of them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.io.columns import Columns, as_numbers

if TYPE_CHECKING:
    import polars as pl


from emsid.errors import DataError
from emsid.record.time_axis import held_at

_VALUE = re.compile(r"_?(val(ue)?|wert|messwert|reading)s?(?![a-z])", re.IGNORECASE)
_NAME = re.compile(r"_?(signal|name|variable|channel|tag|field|sensor|parameter|metric|topic|kanal)", re.IGNORECASE)
_TIME = re.compile(r"_?(time|t(?![a-z])|zeit|date|datum|stamp|clock|millis|micros)", re.IGNORECASE)
_UNIT = re.compile(r"_?(unit|einheit)", re.IGNORECASE)
_REPETITION = "repetition"
MOST_SIGNALS = 1000
"""More different names are texts of another kind."""
FEWEST_VALUES = 3
"""Signals have at least this many values on average."""


def one_column_per_signal(columns: Columns) -> Columns:
    """The columns of a table in long form, one for each signal; other columns as they are.

    A table has this form where a column is called ``value`` or the like, another one holds the names of the signals,
    and a third one the times. A column of units gives those of the signals.
    """
    import polars as pl

    lengths = {len(series) for series in columns.series.values()}
    texts = [name for name, series in columns.series.items() if series.dtype == pl.String]
    value = _called(_VALUE, columns.series)
    time = _called(_TIME, [name for name in columns.series if name not in (value, *texts)])
    unit = _called(_UNIT, texts)
    names = [name for name in texts if name not in (value, unit)]
    signal = _called(_NAME, names) or (names[0] if len(names) == 1 else "")
    if not (value and time and signal) or columns.clocks or len(lengths) != 1:
        return columns
    rows = pl.DataFrame([columns.series[name] for name in dict.fromkeys((time, signal, value, *([unit] * bool(unit))))])
    rows = rows.drop_nulls([time, signal]).with_columns(pl.col(value).cast(pl.Float64, strict=False))
    count = rows[signal].n_unique()
    if not 2 <= count <= min(MOST_SIGNALS, len(rows) // FEWEST_VALUES):
        return columns
    wide = _pivoted(rows, time, signal, value)
    units = {} if not unit else dict(rows.drop_nulls(unit).group_by(signal).agg(pl.first(unit)).iter_rows())
    return replace(columns, series={each.name: each for each in wide}, units=units, lines=None, damaged=())


def _pivoted(rows: pl.DataFrame, time: str, signal: str, value: str) -> pl.DataFrame:
    """A row for every time and a column for every signal; a time that is repeated in a signal has several rows."""
    import polars as pl

    rows = rows.with_columns(pl.int_range(pl.len()).over(time, signal).alias(_REPETITION))
    by_signal = rows.group_by(signal).agg((pl.col(time) == pl.col(time).sort()).all().alias("ascends"))
    if not rows[time].is_sorted() and by_signal["ascends"].all():  # one signal after the other
        rows = rows.sort(time, maintain_order=True)
    wide = rows.pivot(on=signal, index=[time, _REPETITION], values=value, aggregate_function="first")
    return wide.drop(_REPETITION)


def _called(pattern: re.Pattern[str], names: Iterable[str]) -> str:
    """The first name that begins with the pattern; empty where none does."""
    return next((name for name in names if pattern.match(name)), "")


TOGETHER = 0.5
"""Columns are of different messages where fewer of the values of the rarer one than this part share a row."""

MOST_KINDS = 64
"""More different patterns of rows with a value are not those of messages."""


def with_clocks_of_messages(columns: Columns, time: str, used: Sequence[str]) -> Columns:
    """The columns with a clock for every message, where a row holds one message; else, or of an excerpt, as they are.

    Columns that have values in the same rows are of one message. Their clock is the time in these rows; that of the
    last column used has the name of the time column.

    Args:
        columns: of a file with one time column.
        time: its name.
        used: the columns to take; of these or of another and one of these, two must be of different messages.
    """
    if columns.clocks or columns.damaged or columns.excerpt is not None or time not in columns.series:
        return columns
    known = _known(columns, time)
    complete = all(known[name].all() for name in used if name in known)
    if complete or not set(used) <= set(known) or not _apart(known, used):
        return columns
    series, clocks, named = {}, {}, {known[used[-1]].tobytes(): time}
    for name in dict.fromkeys(used):
        clock = named.setdefault(known[name].tobytes(), f"{time} of {name}")
        series[name] = columns.series[name].filter(known[name])
        series[clock] = columns.series[time].filter(known[name]).alias(clock)
        clocks[name] = clocks[clock] = clock
    return replace(columns, series=series, clocks=clocks, lines=None)


def numeric_columns(columns: Columns, time: str) -> list[str]:
    """The columns with numbers beside the time, those with the most of them last."""
    known = _known(columns, time)
    return sorted(known, key=lambda name: int(known[name].sum()))


def _known(columns: Columns, time: str) -> dict[str, NDArray[np.bool_]]:
    """(N,) for every column of numbers that is as long as the time, the rows in which it has a value."""
    rows = len(columns.series[time])
    found = {}
    for name, series in columns.series.items():
        if name != time and len(series) == rows and series.dtype.is_numeric():
            found[name] = np.isfinite(as_numbers(series))
    return {name: where for name, where in found.items() if where.any()}


def _apart(known: dict[str, NDArray[np.bool_]], used: Collection[str]) -> bool:
    """Whether a column used is of another message than any other column."""
    kinds: dict[bytes, tuple[NDArray[np.bool_], bool]] = {}
    for name, where in known.items():
        key = where.tobytes()
        kinds[key] = (where, name in used or (key in kinds and kinds[key][1]))
    if len(kinds) > MOST_KINDS:
        return False
    return any(
        np.count_nonzero(a & b) < TOGETHER * min(np.count_nonzero(a), np.count_nonzero(b))
        for (a, first), (b, second) in combinations(kinds.values(), 2)
        if first or second
    )


# --- one clock --------------------------------------------------------------------------------------------------------


def on_one_clock(columns: Columns, clock: str, held: Collection[str]) -> Columns:
    """All columns at the times of one clock, as far as each has times there.

    Args:
        columns: where each column may have a clock of its own.
        clock: the time column to bring them to.
        held: columns that keep their value until the next one, such as commands; others are interpolated linearly.

    Raises:
        DataError: where the columns have no time in common.
    """
    import polars as pl

    others = {name: each for name, each in columns.clocks.items() if each != clock and name != each}
    if not others:
        return columns
    times = as_numbers(columns.series[clock])
    own = {each: as_numbers(columns.series[each]) for each in set(others.values())}
    first, last = max(t[0] for t in own.values()), min(t[-1] for t in own.values())
    inside = (times >= first) & (times <= last)
    if not inside.any():
        raise DataError(f"the columns have no time in common with {clock!r}; take columns of one recording")
    series = {}
    step = float(np.median(np.diff(times[inside]))) if np.count_nonzero(inside) > 1 else 0.0
    for name, values in columns.series.items():
        if name in others:
            t, x = own[others[name]], as_numbers(values)
            at = held_at(t, times[inside], step)
            series[name] = pl.Series(name, x[at] if name in held else np.interp(times[inside], t, x))
        elif columns.clocks.get(name) == clock:
            series[name] = values.filter(pl.Series(inside))
    return replace(columns, series=series, clocks=dict.fromkeys(series, clock), lines=None)
