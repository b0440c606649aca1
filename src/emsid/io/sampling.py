"""The sample time of a record, and where its segments begin: from a time column, or as it is given.

A column that goes back begins again there, in a new segment, unless it is a counter of 16 or 32 bits whose numbers are
used up: such a counter goes on from zero, and so does the segment.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.findings import Finding
from emsid.io.columns import Columns
from emsid.io.selection import Selection
from emsid.record import Record, TimeAxis, concatenate, time_axis
from emsid.record.time_axis import BRIDGED, SECONDS, UNIT_IN_NAME, about_time, on_timer, seconds_in_unit

Array = NDArray[np.float64]

SHORTEST, LONGEST = 1e-6, 1.0
"""Sample times in seconds outside this range are questioned."""

_RESET = 10
"""A time column that goes back has been reset if at least this many rows follow each other between the resets."""

MOST_STALE = 3
"""Rows at the start of a file that a logger may have kept in its buffer from before."""

COUNTERS = (2.0**16, 2.0**32)
"""Where counters of 16 and 32 bits, such as the milliseconds or microseconds of a board, begin at zero again."""

_AGREEMENT = 0.01  # allowed relative difference between a given sample time and that of the time column

_ENTRY = re.compile(
    r"(?:.*\.)?(?:(?P<rate>f_?s|fps|f_?sample|(?:sampl|log|rec|act|contr|loop)\w*?_?(?:rate|freq|frequency|(?=_k?hz)))|"
    r"(?P<time>dt|t_?s|delta_?t|sampl\w*?_?(?:time|interval|period)))(?:_?(?P<unit>k?hz|ns|us|ms|s))?",
    re.IGNORECASE,
)
"""The name of an entry with the sampling frequency in Hz, or the sample time, perhaps with its unit."""

_LIKE_TIME = re.compile(r"t|time|timestamp|zeit|sec|seconds", re.IGNORECASE)


@dataclass(frozen=True)
class SampleTime:
    """The options of `read` that determine the sample time."""

    dt: float | None
    time: str | None
    time_unit: str | None
    resample: bool


def about_sample_time(dt: float, name: str) -> list[Finding]:
    """A finding where a sample time is implausible for an electromechanical system."""
    if SHORTEST <= dt <= LONGEST:
        return []
    return [Finding("sample-time-implausible", name, {"dt": float(dt)})]


def sampled(selection: Selection, clock: SampleTime, record: Record) -> Record:
    """Determine sample time and segments of the record."""
    breaks = 1 + np.flatnonzero(~selection.follows)
    if clock.time is None:
        if clock.dt is None:
            raise DataError(_no_sample_time(selection.columns), arguments=("dt", "time"))
        if clock.resample:
            raise DataError("resampling needs a time column; name it", arguments=("time",))
        starts = selection.file_rows[[0, *breaks]] * clock.dt
        return replace(record, dt=clock.dt, breaks=tuple(map(int, breaks)), times=tuple(map(float, starts)))

    seconds = _time_unit(clock, selection.columns) * counted_on(selection.numbers(clock.time))
    resets = clock_resets(seconds)
    breaks = np.union1d(breaks, resets).astype(int)
    follows = selection.follows & ~np.isin(np.arange(1, len(seconds)), resets)
    rows = np.arange(1, len(seconds))[follows]  # rows whose time step is used
    try:
        axis = time_axis(
            seconds if len(rows) == len(seconds) - 1 else np.append(0.0, np.cumsum(np.diff(seconds)[follows]))
        )
    except DataError as problem:
        hint = _running(seconds)
        raise DataError(
            f"time column {clock.time!r}: {problem}{hint}", arguments=("rows",) if hint else problem.arguments
        ) from None
    axis = axis._replace(
        samples=len(seconds),
        gaps=tuple(selection.number(rows[k - 1]) for k in axis.gaps),
        duplicates=tuple(selection.number(rows[k - 1]) for k in axis.duplicates),
        place=selection.columns.placed,
    )

    if len(resets):
        data = {"count": len(resets), "column": clock.time, "line": selection.number(resets[0])}
        record = replace(record, findings=(*record.findings, Finding("clock-reset", record.name, data)))
    record = replace(record, findings=(*record.findings, *about_time(axis, record.name, clock.dt, clock.resample)))
    if clock.resample:
        return replace(_resampled(record, seconds, breaks, axis, clock.dt), time_axis=axis)
    _check_axis(axis, clock, seconds)
    starts = seconds[[0, *breaks]]
    return replace(
        record,
        dt=axis.dt if clock.dt is None else clock.dt,
        breaks=tuple(map(int, breaks)),
        times=tuple(map(float, starts)),
        time_axis=axis,
    )


def _running(seconds: Array) -> str:
    """What to say about rows before or after the times (N,); empty where there are none."""
    part = "{0.start}:{0.stop}".format(running_rows(seconds)).replace("None", "")
    return f"; it increases in the rows {part}: take only these with rows" if part != ":" else ""


def _check_axis(axis: TimeAxis, clock: SampleTime, seconds: Array) -> None:
    """Refuse an irregular time column, and one that contradicts a given sample time.

    Args:
        axis: of the time column.
        clock: as given.
        seconds: (N,) the times.

    Raises:
        DataError: with what may be given in its place.
    """
    column = f"time column {clock.time!r}"
    if not axis.regular:
        hint = _running(seconds)
        raise DataError(
            f"{column} is not regular: {axis}; give resample to interpolate it to an equidistant one, or "
            f"dt in its place to take the samples as equidistant{hint}",
            arguments=(*(("rows",) if hint else ()), "resample", "dt"),
        )
    if clock.dt is not None and abs(clock.dt - axis.dt) > _AGREEMENT * axis.dt:
        raise DataError(
            f"{column} says a sample time of {axis.dt:.6g} s and dt is {clock.dt:g} s; leave one of them out, or "
            "give the unit of the column with time_unit",
            arguments=("time_unit",),
        )


def _resampled(record: Record, seconds: Array, breaks: NDArray[np.intp], axis: TimeAxis, dt: float | None) -> Record:
    """The samples at the given times (N,), resampled to equidistant times; a long gap ends a segment.

    Where a timer lost rows, the others are first put where it sampled them: their stamps may jitter.
    """
    gaps = 1 + np.flatnonzero(np.diff(seconds) >= BRIDGED * axis.dt)
    breaks = np.union1d(breaks, gaps)
    edges = (0, *breaks, len(seconds))
    pieces = replace(record, breaks=tuple(map(int, breaks)), times=()).segments
    stamps = [on_timer(seconds[a:b]) if axis.gaps else seconds[a:b] for a, b in pairwise(edges)]
    return concatenate(piece.resample(t, dt or axis.dt) for t, piece in zip(stamps, pieces, strict=True))


def counted_on(counter: Array) -> Array:
    """A time column (N,) that increases throughout, where it is a counter that overflowed and began at zero again.

    >>> counted_on(np.array([65533.0, 65535.0, 1.0, 3.0]))
    array([65533., 65535., 65537., 65539.])
    """
    steps = np.diff(counter)
    forward, back = steps[steps > 0], steps < 0
    known = counter[np.isfinite(counter)]
    if not (back.any() and len(forward) and known.min() >= 0 and np.array_equal(known, np.floor(known))):
        return counter
    longest = BRIDGED * float(np.median(forward))
    for turn in COUNTERS:
        if known.max() < turn and np.all((steps[back] + turn > 0) & (steps[back] + turn < longest)):
            return counter + turn * np.concatenate(([0], np.cumsum(back)))
    return counter


def clock_resets(time: Array) -> NDArray[np.intp]:
    """The samples (M,) at which a time column (N,) begins again; none where it goes back for another reason.

    A board that is reset twice leaves a few rows between, which begin where the column does.
    """
    steps = np.diff(time)
    resets = 1 + np.flatnonzero(steps < 0)
    pieces = np.diff(resets, prepend=0, append=len(time))
    forward = steps[steps > 0]
    if np.all(pieces >= _RESET) or not len(forward):
        return resets
    from_start = np.all(np.abs(time[resets] - time[0]) <= np.median(forward))
    return resets if from_start else resets[:0]


def running_rows(time: Array) -> slice:
    """The rows of a time column (N,) without a few first ones of an earlier record, and last ones after its end.

    After the end, a column goes back once and stays there.

    >>> running_rows(np.array([1.074, 0.008, 0.018, 0.028, 0.038])), running_rows(np.array([0.0, 0.1, 0.2]))
    (slice(1, None, None), slice(None, None, None))
    >>> running_rows(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 0.0]))
    slice(None, 5, None)
    """
    known = np.flatnonzero(np.isfinite(time))
    steps = np.diff(time[known])
    changes = np.flatnonzero(steps)
    stop = int(changes[-1]) + 1 if len(changes) and steps[changes[-1]] < 0 and steps[-1] == 0 else len(known)
    steps = steps[: max(stop - 1, 0)]
    back = np.flatnonzero(steps <= 0)
    last = int(back[-1]) + 1 if len(back) else 0
    stale = last <= MOST_STALE < stop - last and np.any(steps[:last] < 0)
    return slice(int(known[last]) if stale else None, int(known[stop - 1]) + 1 if stop < len(known) else None)


def _time_unit(clock: SampleTime, columns: Columns) -> float:
    """Seconds in one unit of the time column."""
    assert clock.time is not None
    if columns.series[clock.time].dtype.is_temporal():
        return 1.0
    return seconds_in_unit(clock.time, clock.time_unit, columns.units.get(clock.time, ""))


class EntryWithSampleTime(NamedTuple):
    """A single number of a file that is its sample time.

    Attributes:
        name: of the entry.
        number: the sample time.
        unit: of the number; empty where the name does not say it.
    """

    name: str
    number: float
    unit: str


def entry_with_sample_time(numbers: Mapping[str, float]) -> EntryWithSampleTime | None:
    """The first single number that is named as a sample time, or as a sampling frequency, whose inverse it is then.

    >>> entry_with_sample_time({"period": 1024, "fs_kHz": 2})
    EntryWithSampleTime(name='fs_kHz', number=0.0005, unit='s')

    Args:
        numbers: single numbers of a file by name.
    """
    for name, number in numbers.items():
        said = _ENTRY.fullmatch(name)
        if said is None or not 0 < number < np.inf:
            continue
        unit = (said["unit"] or "").lower()
        if said["rate"] and unit in ("", "hz", "khz"):
            return EntryWithSampleTime(name, 1 / (number * (1e3 if unit == "khz" else 1.0)), "s")
        if said["time"] and unit in ("", *SECONDS):
            return EntryWithSampleTime(name, number, unit)
    return None


def _no_sample_time(columns: Columns) -> str:
    """The error for a missing sample time, with a hint from the file."""
    candidates = [name for name in columns.series if _LIKE_TIME.fullmatch(UNIT_IN_NAME.sub("", name))]
    hint = f"; {candidates[0]!r} looks like the time column" if candidates else ""
    entry = entry_with_sample_time(columns.numbers)
    if entry is not None:
        hint += f"; the entry {entry.name!r} of the file gives {entry.number:g} {entry.unit or '(mind the unit)'}"
    for k, line in enumerate(columns.preamble):
        if re.search(r"\bdt\b", line):
            says = line if re.search(r"\bdt\W*\d", line) else " / ".join(columns.preamble[k : k + 2])
            hint += f"; the file says {' '.join(says.split())!r} above its header (mind the unit)"
            break
    return f"no sample time; give dt in seconds, or time, the column that holds it{hint}"
