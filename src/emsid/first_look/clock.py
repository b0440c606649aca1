"""The sample time of a file: from a time column, from what the file states besides its columns, or from its name.

It is stated in the lines above the header of a table, or as a single number of a MAT or NPZ file, such as ``fs``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.first_look.columns import Column, column_of_numbers
from emsid.first_look.levels import SAME
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.io.columns import Columns, as_numbers
from emsid.io.sampling import clock_resets, counted_on, entry_with_sample_time, running_rows
from emsid.record.time_axis import SECONDS, TimeAxis, seconds_of, time_axis

Array = NDArray[np.float64]

PLAUSIBLE = (20e-6, 0.3)
"""Sample times in seconds of ordinary logs of drives."""
NEAR_ZERO = 10
"""Median steps within which a clock without a name begins."""
ASSUMED = 1.0
"""The sample time in seconds where nothing says one."""
FORWARD = 0.75
"""A column without a name increases in at least this share of its rows, also where it begins again or overflows."""
FEWEST = 10
"""A column of fewer steps is no clock unless its name says so."""
STATED, SUREST = 2.0, 0.98
"""The log-odds of a stated sample time, against which a column has to be likelier, and the largest confidence."""
_NAMES = {
    ColumnQuantity.TIME: 4.0,
    ColumnQuantity.UNKNOWN: 0.0,
    ColumnQuantity.OTHER: -2.0,
    ColumnQuantity.POSITION: -3.0,
}
"""Log-odds by what the name of a column says; a clear name says the opposite in one of fifty files."""

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
        unit: of the time column or of the number found, or the rate of its ticks (``8kHz``); empty for dates and times.
        unit_confidence: of the unit.
        axis: the regularity of the time column, in seconds and without resets.
        rows: in which the time column increases; None for all.
        evidence: log-odds that the column is the time, by reason.
    """

    dt: float
    source: str
    confidence: float
    column: str = ""
    unit: str = "s"
    unit_confidence: float = 1.0
    axis: TimeAxis | None = None
    rows: slice | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)


def find_clock(columns: Sequence[Column], stated: Clock | None, wanted: str = "") -> Clock:
    """The likeliest clock of a file.

    Args:
        columns: of the file.
        stated: the clock that the file states besides its columns.
        wanted: the time column, where the user gives it.
    """
    found = []
    for place, column in enumerate(columns):
        if wanted not in ("", column.name):
            continue
        reasons = _evidence(column, columns, place, stated)
        total = sum(reasons.values())
        if reasons and (wanted or total > (STATED if stated else 0.0)):
            sure = 1.0 if wanted else min(1 / (1 + np.exp(-total)), SUREST)
            clock = _of_column(column, float(sure), stated)
            found += [(total, -place, replace(clock, evidence=reasons))] if clock is not None else []
    return max(found, key=lambda each: each[:2])[2] if found else stated or Clock(ASSUMED, "nothing", 0.0)


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
    number = clock.dt / seconds_of(clock.unit)
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


def _evidence(column: Column, columns: Sequence[Column], place: int, stated: Clock | None) -> dict[str, float]:
    """Log-odds of a column to be the time, by reason; empty where it cannot be."""
    if column.kind == "text" or column.constant or column.rows < 3 or column.missing > 0.02 * column.rows:
        return {}
    said = column.meaning.quantity if column.kind == "numbers" else ColumnQuantity.TIME
    unnamed = said is not ColumnQuantity.TIME
    if unnamed and np.mean(np.diff(column.values[np.isfinite(column.values)]) > 0) < FORWARD:
        return {}
    rows = running_rows(column.values)
    values = counted_on(column.values[rows])
    steps = np.diff(values[np.isfinite(values)])
    resets = clock_resets(values)
    back = np.count_nonzero(steps <= 0) - len(resets)
    forward = steps[steps > 0]
    if not len(forward) or (column.kind == "numbers" and len(forward) < len(steps) / 2):
        return {}
    if unnamed and (len(steps) < FEWEST or back > 0.02 * len(steps)):
        return {}
    step = float(np.median(forward))
    even = float(np.mean(np.abs(forward - step) < 0.2 * step))
    begins = values[[0, *resets]]
    reasons = {
        "few columns are times": -1.0,
        "its name": _NAMES.get(said, -6.0),
        "its steps are even": 3 * even,
        "it is the first column": float(place == 0),
        "it begins near zero": float(bool(np.all((begins >= 0) & (begins < NEAR_ZERO * step)))),
    }
    if unnamed:
        others = [x for x in columns if x is not column and x.meaning.quantity is not ColumnQuantity.TIME]
        smooth = (1 - even) * _alike(steps[1:], steps[:-1])
        of_others = [_follows(x.values[rows], values) for x in others if len(x.values) == len(column.values)]
        reasons["its steps follow each other or another column, as those of a position do"] = -8 * max(
            [smooth, *of_others]
        )
        reasons["it repeats"] = -2.0 * (back > 0)
        reasons["it begins below zero"] = -3.0 * bool(np.any(begins < 0))
        reasons["it counts the rows"] = -6.0 * bool(step == 1)
        reasons["it counts ticks of the stated rate"] = 3.0 * bool(_ticks(column, step, stated))
    return {reason: weight for reason, weight in reasons.items() if weight}


def _follows(other: Array, values: Array) -> float:
    """How well the steps of a column (N,) follow another one, from 0 to 1."""
    steps = np.diff(values)
    forward = steps > 0
    return max(_alike(steps[forward], other[1:][forward]), _alike(steps[forward], other[:-1][forward]))


def _alike(a: Array, b: Array) -> float:
    """The squared correlation of two series, where both are known; zero where one hardly changes."""
    known = np.isfinite(a) & np.isfinite(b)
    a, b = a[known], b[known]
    if len(a) < FEWEST or any(np.ptp(x) <= 1e-6 * np.max(np.abs(x)) for x in (a, b)):
        return 0.0
    return float(np.corrcoef(a, b)[0, 1] ** 2)


def _ticks(column: Column, step: float, stated: Clock | None) -> str:
    """The unit of a column that counts ticks of a stated rate; empty for another column.

    The rate is that of the rows where the column agrees with it in a unit of time.
    """
    known = column.values[np.isfinite(column.values)]
    if stated is None or step == 1 or column.meaning.unit in SECONDS or not np.array_equal(known, np.rint(known)):
        return ""
    of_rows = any(abs(step * size - stated.dt) < 0.2 * stated.dt for size in SECONDS.values())
    rate = 1 / stated.dt
    shown = f"{rate / 1e3:.12g}kHz" if rate >= 1e3 else f"{rate:.12g}Hz"
    return "" if of_rows or not PLAUSIBLE[0] <= step * stated.dt <= PLAUSIBLE[1] else shown


def _of_column(column: Column, confidence: float, stated: Clock | None) -> Clock | None:
    """The clock of a time column, with a plausible unit."""
    rows = running_rows(column.values)
    values = counted_on(column.values[rows])
    resets = clock_resets(values)
    first = 0 if rows.start is None else rows.start
    edges = np.union1d(resets, [each - first for each in column.breaks if first < each < first + len(values)])
    steps = np.delete(np.diff(values), edges.astype(int) - 1)
    steps = steps[np.isfinite(steps)]
    forward = steps[steps > 0]
    if not len(forward):
        return None
    unit, sure = _unit(column, float(np.median(forward)), stated)
    try:
        axis = time_axis(seconds_of(unit) * np.append(0.0, np.cumsum(steps)))
    except DataError:
        return None
    axis = axis._replace(samples=column.rows - column.missing)
    return Clock(axis.dt, "column", confidence, column.name, unit, sure, axis, None if rows == slice(None) else rows)


def _unit(column: Column, step: float, stated: Clock | None) -> tuple[str, float]:
    """The unit of a time column, and how sure it is."""
    if column.kind == "times":
        return "", 1.0
    if column.meaning.unit in SECONDS:
        return column.meaning.unit, 1.0
    ticks = _ticks(column, step, stated)
    return (ticks, 0.8) if ticks else plausible_unit(step)


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
