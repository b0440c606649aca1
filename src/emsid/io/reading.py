"""Reading of a file to a `Record`: selection of columns and samples, sample time, units.

The steps have a fixed order. ``rows`` are selected. ``mask`` is evaluated on the columns of the file. A column becomes
``scale·x + offset``. Masked samples are removed; the others are checked and divided into segments. Derivatives are
computed within each segment. Units are converted to SI.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, FormatError, some
from emsid.findings import Finding
from emsid.io.arrow import read_arrow
from emsid.io.clocks import on_one_clock
from emsid.io.columns import MOST_SHOWN, Columns, DamagedRow, as_numbers, nearest
from emsid.io.derivative import check_window, derivative
from emsid.io.files import read_bytes
from emsid.io.mask import left_out
from emsid.io.mat import read_mat
from emsid.io.mdf import read_mdf
from emsid.io.npz import read_npz
from emsid.io.other_files import with_other_files
from emsid.io.parquet import read_parquet
from emsid.io.ros import archived, is_bag_folder, read_bag, read_bag_folder, read_mcap
from emsid.io.spreadsheet import read_spreadsheet
from emsid.io.table import read_table
from emsid.io.tdms import read_tdms
from emsid.io.wpilog import read_wpilog
from emsid.record import Record, concatenate, time_axis
from emsid.record import resample as resampled
from emsid.units import SI

Array = NDArray[np.float64]

READERS: dict[str, Callable[[bytes], Columns]] = {
    ".csv": read_table,
    ".tsv": read_table,
    ".dat": read_table,
    ".txt": read_table,
    ".mat": read_mat,
    ".parquet": read_parquet,
    ".npz": read_npz,
    **dict.fromkeys((".feather", ".arrow", ".ipc"), read_arrow),
    **dict.fromkeys((".xlsx", ".xls", ".ods"), read_spreadsheet),
    ".tdms": read_tdms,
    **dict.fromkeys((".mf4", ".mdf"), read_mdf),
    ".wpilog": read_wpilog,
    ".mcap": read_mcap,
    ".bag": read_bag,
}
"""The reader for each suffix: from the content of a file to its columns."""

BRIDGED = 10
"""Resampling interpolates over gaps shorter than this many sample times; a longer gap ends a segment."""

MOST_SKIPPED = 0.02
"""At most this share of the rows of a file are skipped as bad."""

SHORTEST, LONGEST = 1e-6, 1.0
"""Sample times in seconds outside this range are questioned."""

_RESET = 10
"""A time column that goes back has been reset if at least this many rows follow each other between the resets."""

_AGREEMENT = 0.01  # allowed relative difference between a given sample time and that of the time column

SECONDS = {
    "ns": 1e-9,
    "us": 1e-6,
    "µs": 1e-6,  # the micro sign
    "μs": 1e-6,  # the Greek letter
    "ms": 1e-3,
    "msec": 1e-3,
    "s": 1.0,
    "sec": 1.0,
    "seconds": 1.0,
    "min": 60.0,
    "h": 3600.0,
}
_UNIT_IN_NAME = re.compile(r"[\s_]*(?:[(\[{]\s*(?P<bracketed>[^)\]}]+?)\s*[)\]}]|_(?P<suffix>ns|us|ms|s))$")
_LIKE_TIME = re.compile(r"t|time|timestamp|zeit|sec|seconds", re.IGNORECASE)
_DERIVATIVE = re.compile(r"d\((?P<column>.+)\)")


@dataclass(frozen=True)
class _Signal:
    """The source of a channel: a column, or the derivative of one."""

    name: str
    column: str
    is_derivative: bool


def read_columns(path: str | os.PathLike[str]) -> Columns:
    """The columns of a file, by the reader for its suffix.

    Raises:
        FormatError: where the file cannot be read, has an unknown suffix, or is not what the suffix says.
    """
    path = Path(path)
    reader: Callable[[bytes], Columns] | None
    if is_bag_folder(path):
        reader, content = read_bag_folder, archived(path)
    else:
        reader, content = READERS.get(path.suffix.lower()), read_bytes(path)
    if reader is None:
        raise FormatError(f"{path}: no reader for the suffix {path.suffix!r}; there are {', '.join(READERS)}")
    try:
        columns = reader(content)
    except FormatError as problem:
        raise FormatError(f"{path}: {problem}") from None
    if not columns.series:
        raise FormatError(f"{path}: there is no column in this file{_besides(columns)}; name another")
    return columns


@dataclass(frozen=True)
class ParsedFile:
    """A file whose columns are read already, for `read`.

    Args:
        path: the file.
        columns: what `read_columns` returns for it.
    """

    path: Path
    columns: Columns

    def __fspath__(self) -> str:
        """The file, as any path."""
        return str(self.path)


def read(
    path: str | os.PathLike[str],
    *,
    input: str | Sequence[str],
    output: str | Sequence[str],
    dt: float | None = None,
    time: str | None = None,
    time_unit: str | None = None,
    rows: slice | None = None,
    mask: str | None = None,
    scale: Mapping[str, float] | None = None,
    offset: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
    counts_per_revolution: float | None = None,
    supply_voltage: float | None = None,
    pwm_full_scale: float = 255.0,
    resample: bool = False,
    derivative_window: int = 9,
    skip_bad_rows: bool = False,
    filter: float | None = None,
    decimate: int = 1,
    detrend: int | None = None,
) -> Record:
    """Read a record from a file.

    Args:
        path: a CSV, TSV, ``.dat`` or ``.txt`` table, a MAT file (version 5 to 7.3), Parquet, Arrow, Feather or NPZ;
            with an optional package a spreadsheet, TDMS, MDF, WPILOG, MCAP or a bag of ROS 1 or 2 (a folder); or a
            file that is parsed already.
        input: the column, or columns, that drive the system. ``d(name)`` is the derivative of column
            ``name``, see `emsid.io.derivative.derivative`, unless a column has that very name. ``x.csv:1`` is the first
            column of another file, and ``x.csv:name`` one by name.
        output: the column, or columns, that answer; likewise.
        dt: sample time in seconds (the first data row of the file is then at time 0); with ``resample``, the sample
            time to bring the record to.
        time: the time column, from which the sample time is taken if it is regular; numbers, or dates and times. In a
            file whose columns have times of their own, by default that of the output; other columns are brought to it,
            inputs held and outputs interpolated.
        time_unit: unit of the time column; by default the one in its header (``Timestamp(ms)``), else seconds.
        rows: the data rows to take, counted from 0, as in ``slice(5200, 105200)``.
        mask: an SQL condition on the columns of the file, true for the samples to leave out, as in ``abs(PWM) > 255``;
            the others form segments. A sample with a missing value, for which it cannot be evaluated, is left out.
        scale, offset: by column; ``scale·x + offset`` replaces x.
        units: by column, the unit it is in after that; the channel is then converted to SI. A derivative has
            the unit of its column per second, if not given under its own name.
        counts_per_revolution, supply_voltage, pwm_full_scale: define the units ``count`` and ``pwm``.
        resample: resample an irregular time axis to a regular one (zero-order hold of inputs, linear interpolation of
            outputs). A gap of 10 sample times or more ends a segment.
        derivative_window: number of samples (odd) of the derivative's filter; segments shorter than it are
            left out of a record with a derivative.
        skip_bad_rows: leave out rows that are no numbers: damaged lines, messages of the logger, texts and missing
            values in the columns used. At most `MOST_SKIPPED` of all rows are left out; the record has a finding about
            them.
        filter: the cutoff frequency in Hz of a low-pass filter without delay for every channel, `Record.lowpass`.
        decimate: keep every n-th sample after an anti-alias filter, `Record.decimate`.
        detrend: subtract a polynomial in time of this order from every channel, 0 for the mean, `Record.detrend`.

    Raises:
        FormatError: where the file cannot be read.
        DataError: where a column, sample, sample time, mask or unit cannot be used; the message says which.
    """
    parsed = path if isinstance(path, ParsedFile) else ParsedFile(Path(path), read_columns(path))
    file = parsed.path
    columns, rename = with_other_files(parsed.columns, file, [*_as_tuple(input), *_as_tuple(output)], read_columns)
    try:
        record = _record(
            columns,
            name=file.name,
            inputs=[rename.get(name, name) for name in _as_tuple(input)],
            outputs=[rename.get(name, name) for name in _as_tuple(output)],
            clock=_Clock(dt, time, time_unit, resample),
            rows=rows or slice(None),
            mask=mask,
            skip_bad_rows=skip_bad_rows,
            scale=scale or {},
            offset=offset or {},
            units=units or {},
            derivative_window=derivative_window,
            meanings={
                "counts_per_revolution": counts_per_revolution,
                "supply_voltage": supply_voltage,
                "pwm_full_scale": pwm_full_scale,
            },
        )
        if filter is not None:
            record = record.lowpass(filter)
        record = record.decimate(decimate)
        if filter is not None or decimate > 1:
            data = {"cutoff": filter, "factor": decimate}
            record = replace(record, findings=(*record.findings, Finding("data-filtered", file.name, data)))
        return record if detrend is None else record.detrend(detrend)
    except DataError as problem:
        message = str(problem)
        message = message.removeprefix(f"{file.name}: ")
        raise DataError(f"{file}: {message}", arguments=problem.arguments) from None


@dataclass(frozen=True)
class _Clock:
    """The options of `read` that determine the sample time."""

    dt: float | None
    time: str | None
    time_unit: str | None
    resample: bool


@dataclass(frozen=True)
class _Selection:
    """The selected rows of a file: ``start … start + N − 1`` without the rows left out.

    Attributes:
        columns: the file.
        start: the first data row, counted from 0.
        kept: (N,) true for the rows to use.
        findings: about rows that were skipped.
    """

    columns: Columns
    start: int
    kept: NDArray[np.bool_]
    findings: tuple[Finding, ...] = ()

    @property
    def rows(self) -> NDArray[np.intp]:
        """The data rows used, counted from 0."""
        return self.start + np.flatnonzero(self.kept)

    @property
    def follows(self) -> NDArray[np.bool_]:
        """For every row used but the first, whether the row before it is used as well."""
        follows: NDArray[np.bool_] = np.diff(self.rows) == 1
        return follows

    def number(self, row: int | np.intp) -> int:
        """The number under which the user finds a row used, counted from 0."""
        return self.columns.number(int(self.rows[row]))

    def numbers(self, name: str) -> Array:
        """The values of a column in the rows used.

        Raises:
            DataError: at the first text, missing value, NaN or infinity among them.
        """
        series = self.columns.series[name].gather(self.rows)
        values = as_numbers(series)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            found = "no value" if series[int(bad[0])] is None else repr(series[int(bad[0])])
            raise DataError(
                f"column {name!r} has {found} in {self.columns.place(int(self.rows[bad[0]]))}, not a number; repair "
                "it or leave it out with rows, a mask or skip_bad_rows",
                arguments=("skip_bad_rows",),
            )
        return values

    def scaled(self, name: str, gain: float, offset: float) -> Array:
        """The values of a column as gain·x + offset."""
        values = gain * self.numbers(name) + offset
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise DataError(
                f"column {name!r} becomes {values[bad[0]]} in {self.columns.place(int(self.rows[bad[0]]))} by its "
                f"scale {gain:g} and offset {offset:g}; give others"
            )
        return values


def _record(
    columns: Columns,
    *,
    name: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    clock: _Clock,
    rows: slice,
    mask: str | None,
    skip_bad_rows: bool,
    scale: Mapping[str, float],
    offset: Mapping[str, float],
    units: Mapping[str, str],
    derivative_window: int,
    meanings: Mapping[str, float | None],
) -> Record:
    """The record in ``columns`` with the options of `read`; the module docstring has the order of the steps."""
    signals = _signals(inputs, outputs, columns)
    used = [s.column for s in signals]
    if columns.clocks and clock.dt is None and clock.time is None:
        clock = replace(clock, time=columns.clocks.get(used[-1]))
    if clock.time is not None and clock.time in columns.clocks.values():
        wanted = {*used, clock.time, *(columns.clocks[name] for name in used if name in columns.clocks)}
        few = replace(columns, clocks={name: each for name, each in columns.clocks.items() if name in wanted})
        columns = on_one_clock(few, clock.time, used[: len(inputs)])
    _check_options({"scale": scale, "offset": offset, "units": units}, signals)
    used = [*(s.column for s in signals), *([clock.time] if clock.time else [])]
    selection = _select(columns, used, rows, mask, skip_bad_rows, name)
    with np.errstate(all="ignore"):  # a number that overflows is refused below, or by the record
        values = [selection.scaled(s.column, scale.get(s.column, 1.0), offset.get(s.column, 0.0)) for s in signals]
        record = _sampled(
            selection,
            clock,
            Record(
                input=np.column_stack(values[: len(inputs)]),
                output=np.column_stack(values[len(inputs) :]) if outputs else np.empty((len(values[0]), 0)),
                dt=1.0,
                input_names=tuple(inputs),
                output_names=tuple(outputs),
                input_units=tuple(_unit(s, units, columns.units) for s in signals[: len(inputs)]),
                output_units=tuple(_unit(s, units, columns.units) for s in signals[len(inputs) :]),
                name=name,
                findings=selection.findings,
                conversions={s.name: (scale.get(s.column, 1.0), offset.get(s.column, 0.0)) for s in signals},
            ),
        )
        record = _differentiated(record, [s.name for s in signals if s.is_derivative], derivative_window)
        record = record.convert(None, **{key: value for key, value in meanings.items() if value is not None})
        return replace(record, findings=(*record.findings, *about_sample_time(record.dt, name)))


def about_sample_time(dt: float, name: str) -> list[Finding]:
    """A finding where a sample time is implausible for an electromechanical system."""
    if SHORTEST <= dt <= LONGEST:
        return []
    return [Finding("sample-time-implausible", name, {"dt": float(dt)})]


def _signals(inputs: Sequence[str], outputs: Sequence[str], columns: Columns) -> list[_Signal]:
    """The source of every channel, inputs first."""
    names = [*inputs, *outputs]
    if not inputs:
        raise DataError("no input column; name at least one")
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"column {name!r} is named twice among inputs and outputs; every channel is one column")
    signals = []
    for name in names:
        inner = _DERIVATIVE.fullmatch(name)
        is_derivative = inner is not None and name not in columns.series
        column = inner["column"] if inner is not None and is_derivative else name
        _check_column(column, columns)
        signals.append(_Signal(name, column, is_derivative))
    return signals


def _check_column(name: str, columns: Columns) -> None:
    if name in columns.others:
        raise DataError(f"{name!r} is no column: it is {columns.others[name]}; columns are {some(columns.series)}")
    if name not in columns.series:
        raise DataError(
            f"there is no column {name!r}{nearest(name, columns.series)}; there are {some(columns.series)}"
            f"{_besides(columns)}"
        )


def _check_options(options: Mapping[str, Mapping[str, object]], signals: Sequence[_Signal]) -> None:
    """Refuse an option for a column that is not a channel: the name is misspelt."""
    known = dict.fromkeys(s.column for s in signals)
    for option, by_column in options.items():
        allowed = [*known, *(s.name for s in signals if s.is_derivative)] if option == "units" else [*known]
        for name in by_column:
            if name not in allowed:
                raise DataError(
                    f"{option} is given for {name!r}, which is neither input nor output{nearest(name, allowed)}; "
                    f"these are {', '.join(allowed)}"
                )


def _select(
    columns: Columns, used: Sequence[str], rows: slice, mask: str | None, skip_bad_rows: bool, file: str
) -> _Selection:
    for name in used:
        _check_column(name, columns)
    lengths = {name: len(columns.series[name]) for name in used}
    length = lengths[used[0]]
    for name, other in lengths.items():
        if other != length:
            raise DataError(f"column {used[0]!r} has {length} samples and {name!r} {other}; they must agree")
    if rows.step not in (None, 1):
        raise DataError(
            f"rows {rows.start}:{rows.stop}:{rows.step}; rows are taken without a step, decimate the record instead"
        )
    start, stop, _ = rows.indices(length)
    if stop <= start:
        first, last = ("" if edge is None else edge for edge in (rows.start, rows.stop))
        raise DataError(f"rows {first}:{last} select nothing of {length} rows; give A:B with 0 ≤ A < B ≤ {length}")
    damaged = [row for row in columns.damaged if start <= row.row < stop + (not row.is_sample and stop == length)]
    if damaged and not skip_bad_rows:
        raise DataError(
            f"{damaged[0]}; the file is cut off or damaged there: repair or delete that row, or leave it out with "
            "rows or skip_bad_rows",
            arguments=("skip_bad_rows",),
        )
    kept = np.ones(stop - start, dtype=bool)
    if mask is not None:
        same = {name: series[start:stop] for name, series in columns.series.items() if len(series) == length}
        kept = ~left_out(mask, same)
        if not kept.any():
            raise DataError(f"the mask {mask!r} leaves none of {len(kept)} samples; relax it")
    if skip_bad_rows:
        good = np.all([np.isfinite(as_numbers(columns.series[name][start:stop])) for name in used], axis=0)
        findings = _skipped(columns, start, kept & ~good, [row for row in damaged if not row.is_sample], file)
        return _Selection(columns, start, kept & good, findings)
    return _Selection(columns, start, kept)


def _skipped(
    columns: Columns, start: int, bad: NDArray[np.bool_], messages: Sequence[DamagedRow], file: str
) -> tuple[Finding, ...]:
    """The finding about rows that are skipped: those that are bad, and messages between the rows.

    Raises:
        DataError: where these are too many.
    """
    count, rows = int(np.count_nonzero(bad)) + len(messages), len(bad) + len(messages)
    if not count:
        return ()
    if count > max(1, MOST_SKIPPED * rows):
        raise DataError(
            f"{count} of {rows} rows are no numbers ({100 * count / rows:.2g} %); at most {100 * MOST_SKIPPED:g} % are "
            "skipped: check how the file was exported, or select rows"
        )
    texts = {row.line: row.text[:MOST_SHOWN] for row in columns.damaged}
    first = min([*(columns.number(start + int(k)) for k in np.flatnonzero(bad)[:1]), *(row.line for row in messages)])
    data = {"count": count, "rows": rows, "line": first, "text": texts.get(first, ""), "messages": len(messages)}
    return (Finding("rows-skipped", file, data),)


def _sampled(selection: _Selection, clock: _Clock, record: Record) -> Record:
    """Determine sample time and segments of the record."""
    breaks = 1 + np.flatnonzero(~selection.follows)
    if clock.time is None:
        if clock.dt is None:
            raise DataError(_no_sample_time(selection.columns), arguments=("dt", "time"))
        if clock.resample:
            raise DataError("resampling needs a time column; name it", arguments=("time",))
        starts = selection.rows[[0, *breaks]] * clock.dt
        return replace(record, dt=clock.dt, breaks=tuple(map(int, breaks)), times=tuple(map(float, starts)))

    column = f"time column {clock.time!r}"
    seconds = _time_unit(clock, selection.columns) * selection.numbers(clock.time)
    resets = clock_resets(seconds)
    breaks = np.union1d(breaks, resets).astype(int)
    follows = selection.follows & ~np.isin(np.arange(1, len(seconds)), resets)
    rows = np.arange(1, len(seconds))[follows]  # rows whose time step is used
    try:
        axis = time_axis(
            seconds if len(rows) == len(seconds) - 1 else np.append(0.0, np.cumsum(np.diff(seconds)[follows]))
        )
    except DataError as problem:
        raise DataError(f"{column}: {problem}", arguments=problem.arguments) from None
    axis = axis._replace(
        samples=len(seconds),
        gaps=tuple(selection.number(rows[k - 1]) for k in axis.gaps),
        duplicates=tuple(selection.number(rows[k - 1]) for k in axis.duplicates),
        place=selection.columns.placed,
    )

    if len(resets):
        data = {"count": len(resets), "column": clock.time, "line": selection.number(resets[0])}
        record = replace(record, findings=(*record.findings, Finding("clock-reset", record.name, data)))
    if clock.resample:
        return replace(_resampled(record, seconds, breaks, axis.dt, clock.dt), time_axis=axis)
    if not axis.regular:
        raise DataError(
            f"{column} is not regular: {axis}; give resample to interpolate it to an equidistant one, or "
            "dt in its place to take the samples as equidistant",
            arguments=("resample", "dt"),
        )
    if clock.dt is not None and abs(clock.dt - axis.dt) > _AGREEMENT * axis.dt:
        raise DataError(
            f"{column} says a sample time of {axis.dt:.6g} s and dt is {clock.dt:g} s; leave one of them out, or "
            "give the unit of the column with time_unit",
            arguments=("time_unit",),
        )
    starts = seconds[[0, *breaks]]
    return replace(
        record,
        dt=axis.dt if clock.dt is None else clock.dt,
        breaks=tuple(map(int, breaks)),
        times=tuple(map(float, starts)),
        time_axis=axis,
    )


def _resampled(record: Record, seconds: Array, breaks: NDArray[np.intp], step: float, dt: float | None) -> Record:
    """The samples at the given times (N,), brought to equidistant ones; a long gap ends a segment."""
    gaps = 1 + np.flatnonzero(np.diff(seconds) >= BRIDGED * step)
    breaks = np.union1d(breaks, gaps)
    edges = (0, *breaks, len(seconds))
    pieces = replace(record, breaks=tuple(map(int, breaks)), times=()).segments
    return concatenate(
        resampled(seconds[a:b], piece, dt or step) for (a, b), piece in zip(pairwise(edges), pieces, strict=True)
    )


def clock_resets(time: Array) -> NDArray[np.intp]:
    """The samples (M,) at which a time column (N,) begins again; none where it goes back for another reason."""
    resets = 1 + np.flatnonzero(np.diff(time) < 0)
    pieces = np.diff([0, *resets, len(time)])
    return resets if np.all(pieces >= _RESET) else resets[:0]


def _differentiated(record: Record, names: Collection[str], window: int) -> Record:
    """The record with the channels ``names`` differentiated, without the segments too short for that."""
    if not names:
        return record
    check_window(window)
    pieces = [piece for piece in record.segments if len(piece) >= window]
    if not pieces:
        longest = max(map(len, record.segments))
        raise DataError(
            f"the longest segment has {longest} samples, too few for a derivative over {window}; take more rows, relax "
            "the mask or give a shorter derivative_window",
            arguments=("derivative_window",),
        )

    def differentiated(values: Array, channels: Sequence[str]) -> Array:
        result = values.copy()
        which = [k for k, channel in enumerate(channels) if channel in names]
        if which:
            result[:, which] = derivative(values[:, which], record.dt, window)
        return result

    return concatenate(
        replace(
            piece,
            input=differentiated(piece.input, piece.input_names),
            output=differentiated(piece.output, piece.output_names),
        )
        for piece in pieces
    )


def _as_tuple(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _unit(signal: _Signal, units: Mapping[str, str], in_file: Mapping[str, str]) -> str:
    """The unit given for a channel, else the one under the name of its column where that is an SI unit."""
    if not signal.is_derivative or signal.name in units:
        return units.get(signal.name) or (in_file.get(signal.column, "") if in_file.get(signal.column) in SI else "")
    unit = units.get(signal.column, "")
    return unit and f"{unit}/s"


def _time_unit(clock: _Clock, columns: Columns) -> float:
    """Seconds in one unit of the time column."""
    assert clock.time is not None
    if columns.series[clock.time].dtype.is_temporal():
        return 1.0
    if clock.time_unit is not None:
        if clock.time_unit not in SECONDS:
            raise DataError(f"time unit {clock.time_unit!r} is not understood; give one of {', '.join(SECONDS)}")
        return SECONDS[clock.time_unit]
    written = _UNIT_IN_NAME.search(clock.time)
    unit = columns.units.get(clock.time) or (written and (written["bracketed"] or written["suffix"])) or "s"
    return SECONDS.get(unit, 1.0)


def _no_sample_time(columns: Columns) -> str:
    """The error for a missing sample time, with a hint from the file."""
    candidates = [name for name in columns.series if _LIKE_TIME.fullmatch(_UNIT_IN_NAME.sub("", name))]
    hint = f"; {candidates[0]!r} looks like the time column" if candidates else ""
    for k, line in enumerate(columns.preamble):
        if re.search(r"\bdt\b", line):
            says = line if re.search(r"\bdt\W*\d", line) else " / ".join(columns.preamble[k : k + 2])
            hint += f"; the file says {' '.join(says.split())!r} above its header (mind the unit)"
            break
    return f"no sample time; give dt in seconds, or time, the column that holds it{hint}"


def _besides(columns: Columns) -> str:
    if not columns.others:
        return ""
    return f" (and, no columns: {some(f'{name}, {reason}' for name, reason in columns.others.items())})"
