"""The sample time of a file: from a time column, from what the file states besides its columns, or from its name.

It is stated in the lines above the header of a table, or as a single number of a MAT or NPZ file, such as ``fs``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.first_look.columns import Column, column_of_numbers
from emsid.first_look.levels import SAME
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.io.columns import Columns, as_numbers
from emsid.io.sampling import clock_resets, counted_on, entry_with_sample_time, stale_rows
from emsid.record.time_axis import TimeAxis, time_axis
from emsid.record.time_units import SECONDS

PLAUSIBLE = (20e-6, 0.3)
"""Sample times in seconds of ordinary logs of drives."""
ALIKE = 0.5
"""Steps of this correlation with another column are those of its integral: those of a position had 0.97, of uneven
clocks up to 0.34."""
NEAR_ZERO = 10
"""Median steps within which a clock without a name begins."""
ASSUMED = 1.0
"""The sample time in seconds where nothing says one."""

_DT = re.compile(
    r"\b(?:dt|Ts|sample[ _]?(?:time|interval)|x?increment|period)\b\W{0,3}(\d+(?:\.\d+)?(?:[eE]-?\d+)?)\s*"
    r"(ns|us|µs|ms|s)?",
    re.IGNORECASE,
)
_RATE = re.compile(r"(\d+(?:\.\d+)?)\s*(k?)(?:Hz|Sa/s|S/s)\b", re.I)
_IN_NAME = re.compile(
    r"(?:^|[^A-Za-z0-9])(?:dt)?_?(\d+(?:\.\d+)?)(ns|us|ms|Hz|kHz)(?![A-Za-z])|(?<![A-Za-z])dt_?(\d+)()"
)


@dataclass(frozen=True)
class Clock:
    """The times of the samples.

    Attributes:
        dt: sample time in seconds.
        source: ``column``, ``preamble``, the name of an entry, ``file name``, or ``nothing``, where it is assumed.
        confidence: of the sample time, from 0 to 1.
        column: the time column; empty where there is none.
        unit: of the time column or of the number found; empty for dates and times.
        unit_confidence: of the unit.
        axis: the regularity of the time column, in seconds and without resets.
    """

    dt: float
    source: str
    confidence: float
    column: str = ""
    unit: str = "s"
    unit_confidence: float = 1.0
    axis: TimeAxis | None = None


def find_clock(columns: Sequence[Column], stated: Clock | None, wanted: str = "") -> Clock:
    """The clock of a file.

    Args:
        columns: of the file.
        stated: the clock that the file states besides its columns.
        wanted: the time column, where the user gives it.
    """
    scored = sorted(((_like_time(column), -k) for k, column in enumerate(columns)), reverse=True)
    for score, k in scored:
        column = columns[-k]
        if column.name == wanted or (not wanted and score > 0.3 and not _goes_with_another(column, columns)):
            clock = _of_column(column, 1.0 if wanted else score)
            if clock is not None:
                return clock
    for column in () if wanted or stated else columns:
        clock = _of_column(column, 0.4) if _is_uneven_clock(column, columns) else None
        if clock is not None:
            return clock
    return stated or Clock(ASSUMED, "nothing", 0.0)


def clock_of_file(raw: Columns, besides: Collection[str] = ()) -> Clock | None:
    """The clock in a time column of a file; None where it has no such column, or one that is not regular.

    Args:
        raw: the columns of the file.
        besides: columns that are no time, such as inputs and outputs.
    """
    table = []
    for name, series in raw.series.items():
        if name not in besides and (series.dtype.is_numeric() or series.dtype.is_temporal()):
            kind = "times" if series.dtype.is_temporal() else "numbers"
            table.append(column_of_numbers(name, kind, meaning(name, raw.units.get(name, "")), as_numbers(series)))
    clock = find_clock(table, None)
    return clock if clock.axis is not None and clock.axis.regular else None


def differs(clock: Clock, dt: float) -> bool:
    """Whether the sample time of a clock is another one, in any unit that the clock may have."""
    units = (clock.unit,) if clock.unit_confidence == 1 or clock.unit not in SECONDS else SECONDS
    number = clock.dt / SECONDS.get(clock.unit, 1.0)
    return all(abs(number * SECONDS.get(unit, 1.0) - dt) > SAME * dt for unit in units)


def contradiction(stated: Clock | None, file: str, dt: float) -> Iterable[Finding]:
    """A finding where a file states another sample time.

    Args:
        stated: the clock that the file states besides its columns.
        file: its name.
        dt: the sample time in s with which it is read.
    """
    if stated is not None and abs(stated.dt - dt) > SAME * dt:
        yield Finding("sample-time-contradicted", file, {"dt": dt, "said": stated.dt, "source": stated.source})


def _like_time(column: Column) -> float:
    """How sure it is that a column is the time."""
    if column.kind == "text" or column.constant or column.rows < 3 or column.missing > 0.02 * column.rows:
        return 0.0
    values = column.values[np.isfinite(column.values)]
    steps = np.diff(values)
    forward = float(np.mean(steps > 0))
    if column.kind == "times":
        return 0.95 if forward > 0.5 else 0.5
    is_time = column.meaning.quantity is ColumnQuantity.TIME
    if forward < (0.5 if is_time else 0.98):
        return 0.0
    if is_time:
        return 0.95 if forward > 0.95 else 0.7
    named = column.meaning.quantity is not ColumnQuantity.UNKNOWN
    middle = float(np.median(steps))
    even = float(np.mean(np.abs(steps - middle) < 0.2 * middle))
    return 0.0 if named or even < 0.9 or middle == 1 else 0.6


def _is_uneven_clock(column: Column, others: Sequence[Column]) -> bool:
    """Whether a column without a name increases throughout, in seconds of uneven steps that no other column goes with.

    The steps of a position go with its speed. Where it goes back, a clock begins again near zero.
    """
    values = column.values
    if column.kind != "numbers" or column.meaning.quantity is not ColumnQuantity.UNKNOWN or column.missing:
        return False
    steps = np.diff(values)
    forward, resets = steps[steps > 0], clock_resets(values)
    if column.rows < 10 or len(forward) + len(resets) < len(steps) or np.array_equal(values, np.rint(values)):
        return False
    middle = float(np.median(forward))
    begins = values[[0, *resets]]
    if not PLAUSIBLE[0] <= middle <= PLAUSIBLE[1] or not np.all((begins >= 0) & (begins < NEAR_ZERO * middle)):
        return False
    return not _goes_with_another(column, others)


def _goes_with_another(column: Column, others: Sequence[Column]) -> bool:
    """Whether the steps forward of a column without a name go with another column, as those of a position do."""
    steps = np.diff(column.values)
    within = steps > 0
    if column.meaning.quantity is not ColumnQuantity.UNKNOWN or column.kind != "numbers" or within.sum() < 10:
        return False
    for other in others:
        if other is column or other.constant or other.missing or other.rows != column.rows or other.kind != "numbers":
            continue
        size = np.abs(other.values[1:][within])
        alike = np.ptp(size) > 0 and np.ptp(steps[within]) > 1e-6 * np.median(steps[within])
        if alike and abs(np.corrcoef(size, steps[within])[0, 1]) > ALIKE:
            return True
    return False


def _of_column(column: Column, confidence: float) -> Clock | None:
    """The clock of a time column, with a plausible unit."""
    values = counted_on(column.values[stale_rows(column.values) :])
    resets = clock_resets(values)
    steps = np.delete(np.diff(values), resets - 1)
    steps = steps[np.isfinite(steps)]
    forward = steps[steps > 0]
    if not len(forward):
        return None
    unit, sure = _unit(column, float(np.median(forward)))
    factor = SECONDS.get(unit, 1.0)
    try:
        axis = time_axis(factor * np.append(0.0, np.cumsum(steps)))
    except DataError:
        return None
    axis = axis._replace(samples=column.rows - column.missing)
    return Clock(axis.dt, "column", confidence, column.name, unit, sure, axis)


def _unit(column: Column, step: float) -> tuple[str, float]:
    """The unit of a time column, and how sure it is."""
    if column.kind == "times":
        return "", 1.0
    if column.meaning.unit in SECONDS:
        return column.meaning.unit, 1.0
    return plausible_unit(step)


def plausible_unit(step: float) -> tuple[str, float]:
    """The unit in which a sample time is plausible, and how sure it is.

    >>> plausible_unit(0.01), plausible_unit(10.0)
    (('s', 0.9), ('ms', 0.7))
    """
    low, high = PLAUSIBLE
    for unit, sure in (("s", 0.9), ("ms", 0.7), ("us", 0.6), ("ns", 0.5)):
        if low <= step * SECONDS[unit] <= high:
            return unit, sure
    return "s", 0.3


def stated_clock(raw: Columns, file: str) -> Clock | None:
    """The sample time in a single number of the file, in the lines above the header, or in the name of the file."""
    written = _in_lines(raw.preamble)
    entry = entry_with_sample_time(raw.numbers)
    if entry is not None:
        return _of_number(entry.number, entry.unit, entry.name)
    return (_of_number(*written[0], "preamble") if written else None) or _of_name(file)


def _of_name(file: str) -> Clock | None:
    """The sample time in the name of a file."""
    found = _IN_NAME.search(file)
    if not found:
        return None
    number, unit = (found[1], found[2]) if found[1] else (found[3], "")
    if unit.lower() in ("hz", "khz"):
        rate = float(number) * (1e3 if unit.lower() == "khz" else 1.0)
        return Clock(1 / rate, "file name", 0.7) if rate else None
    return _of_number(float(number), unit, "file name")


def _of_number(number: float, unit: str, source: str) -> Clock | None:
    if not number > 0:
        return None
    unit, sure = (unit, 1.0) if unit else plausible_unit(number)
    return Clock(number * SECONDS[unit], source, 0.8, unit=unit, unit_confidence=sure)


def _in_lines(lines: Sequence[str]) -> list[tuple[float, str]]:
    """Sample times in lines of text: ``dt=10``, ``Ts 0.01 s``, ``100 Hz``, or dt above 10 in a small table."""
    found = []
    for k, line in enumerate(lines):
        written = _DT.search(line)
        if written:
            found.append((float(written[1]), written[2] or ""))
            continue
        rate = _RATE.search(line)
        if rate and float(rate[1]):
            found.append((1 / (float(rate[1]) * (1e3 if rate[2] else 1.0)), "s"))
            continue
        words = line.split()
        below = lines[k + 1].split() if k + 1 < len(lines) else []
        if "dt" in words and len(below) == len(words):
            number = re.fullmatch(r"\d+(\.\d+)?", below[words.index("dt")])
            found += [(float(number[0]), "")] if number else []
    return found
