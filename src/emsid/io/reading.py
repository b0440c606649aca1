"""Reading of a file to a `Record`: selection of columns and samples, sample time, units.

The steps have a fixed order. Columns with a ``wrap`` are made continuous, and those with a ``shift`` are moved.
``rows`` are selected. ``mask`` is evaluated on the columns of the file. A column takes the sign of its ``direction``
and becomes ``scale·x + offset``. Masked samples are removed; the others are checked and divided into segments.
Derivatives are computed within each segment. Units are converted to SI.

A column may be named without the unit in brackets of its header; its channel has the name of the column. A unit that is
given decides; else the channel has the unit that the file gives, and is converted from it to SI. Only counts and PWM
whose size is not given, and units that are not of a drive, remain as they are, with their unit.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, FormatError
from emsid.findings import Finding
from emsid.io.axes import with_axes
from emsid.io.can import read_can, without_database
from emsid.io.columns import Columns, columns_of_frame, errors_of
from emsid.io.edges import with_edges
from emsid.io.files import gunzipped, is_large, looks_like, read_bytes
from emsid.io.flight import read_dataflash, read_ulog
from emsid.io.json_file import read_json, read_json_lines
from emsid.io.large import BLOCK, LargeTable, check_wide, columns_in, excerpt
from emsid.io.mat import read_mat
from emsid.io.mdf import read_mdf
from emsid.io.messages import on_one_clock, one_column_per_signal, with_clocks_of_messages
from emsid.io.npz import read_npz
from emsid.io.options_by_column import check_options, check_window, continuous, derivative, shifted, surplus_units
from emsid.io.other_files import about_files, with_other_files
from emsid.io.parquet import large_arrow, large_parquet, read_arrow, read_parquet
from emsid.io.regular_table import LARGE
from emsid.io.ros import archived, is_bag_folder, read_bag, read_bag_folder, read_mcap
from emsid.io.sampling import SampleTime, about_sample_time, sampled
from emsid.io.selection import OVER_ALL_ROWS, NothingLeft, check_column, select
from emsid.io.spreadsheet import read_spreadsheet
from emsid.io.table import large_text, read_table
from emsid.io.tdms import read_tdms
from emsid.io.wpilog import read_wpilog
from emsid.record import FileRows, Record, argument_types, concatenate
from emsid.units import column_of, edges_of

Array = NDArray[np.float64]

READERS: dict[str, Callable[[bytes], Columns]] = {
    ".csv": read_table,
    ".tsv": read_table,
    ".dat": read_table,
    ".txt": read_table,
    ".log": read_table,
    ".lvm": read_table,
    ".json": read_json,
    **dict.fromkeys((".jsonl", ".ndjson"), read_json_lines),
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
    ".ulg": read_ulog,
    ".bin": read_dataflash,
    **dict.fromkeys((".blf", ".trc"), without_database),
}
"""The reader for each suffix: from the content of a file to its columns."""
LARGE_READERS: dict[Callable[[bytes], Columns], Callable[[Path], Columns | LargeTable | None]] = {
    read_table: large_text,
    read_parquet: large_parquet,
    read_arrow: large_arrow,
}
"""The readers of tables that may be larger than memory; None where the ordinary reader is needed."""

MOST_EXACT = 2**53
"""Whole numbers up to this one are floats without rounding; NumPy refuses larger ones than 2⁶³."""
_BY_COLUMN = ("wrap", "shift", "direction", "scale", "offset", "units", "signals")
"""The arguments of `read` that are given by column."""

_KINDS = {
    **dict.fromkeys(("input", "output"), argument_types.NAMES),
    "time": argument_types.NAME,
    "time_unit": argument_types.TEXT,
    "dbc": argument_types.TEXT,
    "rotor_angle": argument_types.NAME,
    "mask": argument_types.CONDITION,
    **dict.fromkeys(
        ("dt", "counts_per_revolution", "pole_pairs", "supply_voltage", "pwm_full_scale", "filter"),
        argument_types.NUMBER,
    ),
    **dict.fromkeys(("resample", "skip_bad_rows", "electrical_angle", "power_invariant"), argument_types.SWITCH),
    **dict.fromkeys(("derivative_window", "decimate", "detrend"), argument_types.WHOLE),
    **dict.fromkeys(("wrap", "shift", "scale", "offset"), argument_types.NUMBERS),
    **dict.fromkeys(("direction", "units", "signals", "phases"), argument_types.TEXTS),
    "rows": argument_types.SLICE,
}
"""The types of the arguments of `read`."""


@dataclass(frozen=True)
class _Signal:
    """The source of a channel: a column, or the derivative of one."""

    name: str
    column: str
    is_derivative: bool


def read_columns(path: str | os.PathLike[str], *, in_part: bool = False, dbc: str | None = None) -> Columns:
    """The columns of a file, by the reader for its suffix, or for the one before ``.gz``; a text of another as a table.

    Args:
        path: the file.
        in_part: whether an excerpt is enough of a table of more than `emsid.io.large.MOST` numbers, which is then read
            in blocks: a text whose lines are all alike, Parquet or Arrow.
        dbc: the database of a log of a CAN bus, see `read`.

    Raises:
        DataError: where ``dbc`` is no text.
        FormatError: where the file cannot be read, has an unknown suffix, or is not what the suffix says.
    """
    path = Path(path)
    argument_types.check_types({"dbc": dbc}, {"dbc": argument_types.TEXT}, f"{path}: ")
    packed = path.suffix.lower() == ".gz"
    suffix = Path(path.stem).suffix.lower() if packed else path.suffix.lower()
    reader = READERS.get(suffix) if dbc is None else partial(read_can, suffix=suffix, database=Path(dbc))
    in_blocks = LARGE_READERS.get(reader) if reader is not None and in_part and not packed else None
    try:
        found = in_blocks(path) if in_blocks is not None and is_large(path, LARGE) else None
        if found is None:
            is_bag = is_bag_folder(path)
            content = archived(path) if is_bag else read_bytes(path)
            reader = read_bag_folder if is_bag else reader
            if reader is None and looks_like(content) == "text":
                reader = read_table
            if reader is None:
                known = ", ".join(READERS)
                raise FormatError(f"no reader for the suffix {suffix!r}; there are {known}, also packed (.csv.gz)")
            found = reader(gunzipped(content) if packed else content)
        columns = found if isinstance(found, Columns) else excerpt(found)
        columns = check_wide(columns, one_column_per_signal(columns))
    except FormatError as problem:
        message = str(problem).removeprefix(f"{path}: ")
        raise FormatError(f"{path}: {message}", arguments=problem.arguments) from None
    if not columns.series:
        raise FormatError(f"{path}: there is no column in this file{columns.besides}; name another")
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


def parsed_file(source: Any, *, in_part: bool = False, dbc: str | None = None) -> ParsedFile:
    """The columns of a file; a data frame is taken as a file of the name ``frame``.

    Args:
        source: a path, a file that is parsed already, a pandas or Polars frame, or a dictionary of arrays.
        in_part: whether an excerpt of a very large file is enough.
        dbc: the database of a log of a CAN bus, see `read`.

    Raises:
        FormatError: where a file cannot be read.
        DataError: for something else.
    """
    if isinstance(source, ParsedFile):
        return source
    if isinstance(source, str | os.PathLike):
        return ParsedFile(Path(source), read_columns(source, in_part=in_part, dbc=dbc))
    return ParsedFile(Path("frame"), columns_of_frame(source))


def read(
    path: Any,
    *,
    input: str | Sequence[str],
    output: str | Sequence[str],
    dt: float | None = None,
    time: str | None = None,
    time_unit: str | None = None,
    dbc: str | None = None,
    rows: slice | None = None,
    mask: str | None = None,
    wrap: Mapping[str, float] | None = None,
    shift: Mapping[str, float] | None = None,
    direction: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
    offset: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
    signals: Mapping[str, str] | None = None,
    counts_per_revolution: float | None = None,
    phases: Mapping[str, str] | None = None,
    rotor_angle: str | None = None,
    pole_pairs: float | None = None,
    electrical_angle: bool = False,
    power_invariant: bool = False,
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
        path: a table (CSV, TSV, ``.dat``, ``.txt``, ``.log``), JSON or JSON lines, a MAT file (version 5 to 7.3),
            Parquet, Arrow, Feather or NPZ, each also packed by gzip (``.csv.gz``); with an optional package a
            spreadsheet, TDMS, MDF, WPILOG, MCAP, a bag of ROS 1 or 2 (a folder), or a log of a CAN bus; ULog;
            DataFlash; a file that is parsed already; or a pandas or Polars frame, or a dictionary of arrays.
        input: the column, or columns, that drive the system. A unit in brackets may be left out, here and in all
            other arguments: ``speed`` is the column ``speed [rad/s]``. ``d(name)`` is the derivative of column
            ``name``, see `emsid.io.options_by_column.derivative`, unless a column has that very name. ``edges(A)`` is
            the number of edges of a column of pulses, and ``edges(A, B)`` the position of an encoder with two channels,
            in counts of a quarter of a period, see `emsid.io.edges`. ``x.csv:1`` is the first column of another file,
            and ``x.csv:name`` one by name.
        output: the column, or columns, that answer; likewise.
        dt: sample time in seconds (the first data row of the file is then at time 0); with ``resample``, the sample
            time to bring the record to.
        time: the time column, from which the sample time is taken if it is regular; numbers, or dates and times. In a
            file whose columns have times of their own, by default that of the output; other columns are brought to it,
            inputs held and outputs interpolated. A table with a row for every message is such a file: its input and its
            output have values in different rows, and ``rows`` then counts those of the output.
        time_unit: unit of the time column; by default the one in its header (``Timestamp(ms)``), else seconds. For a
            column of ticks it is their rate, ``8kHz``. It may also be given in ``units``.
        dbc: the database (DBC, KCD, SYM or ARXML) with which the frames of a log of a CAN bus are decoded; every signal
            is a column.
        rows: the data rows to take, counted from 0, as in ``slice(5200, 105200)``.
        mask: an SQL condition on the columns of the file, true for the samples to leave out, as in ``abs(PWM) > 255``;
            the others form segments. A sample with a missing value, for which it cannot be evaluated, is left out.
            ``row`` is the number of the data row, counted from 0 as in ``rows``, unless a column has that name.
        wrap: by column of a counter or an angle that starts again, the period after which it does, such as 65536 or
            360; whole periods are added so that it is continuous.
        shift: by column, the rows by which it is moved to later ones; −1 for a command that is written into the row
            after the one where it acts.
        direction: by column without sign, such as the duty of a bridge, the column that says its direction: the sign is
            negative where that is not above 0 (0 and 1, or −1 and 1).
        scale, offset: by column; ``scale·x + offset`` replaces x.
        units: by column, the unit it is in after that; the channel is then converted to SI. By default the unit that
            the file gives, in a row of units or in brackets in the name of the column, unless ``scale`` changes it. A
            derivative has the unit of its column per second, if not given under its own name.
        signals: by output, what it measures, see `emsid.Record`; by default its unit says it.
        counts_per_revolution, supply_voltage, pwm_full_scale: define the units ``count`` and ``pwm``.
        phases: of a brushless motor, by the letter of its axes two or three columns with commas between them, such as
            ``{"v": "va,vb,vc", "i": "ia,ib"}``; further columns are then ``v_d``, ``v_q``, ``i_d`` and ``i_q``, with
            the amplitude of a phase, and ``rotor``, the angle of the shaft in rad. See `emsid.plants.park`.
        rotor_angle: the column of the angle that turns them, of the shaft.
        pole_pairs: of the motor, for phases and for the unit ``erpm``, electrical turns in a minute.
        electrical_angle: whether that angle is electrical: it turns once for every pole pair in a turn of the shaft.
        power_invariant: whether the phases are scaled for axes that keep the power, not the amplitude.
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
    given, parsed = locals(), parsed_file(path, dbc=dbc)
    file = parsed.path
    with errors_of(file):
        argument_types.check_types(given, _KINDS)
        columns, missed = with_edges(parsed.columns, (*_as_tuple(input), *_as_tuple(output)))
        turned = pole_pairs, electrical_angle, power_invariant
        columns, unchecked = with_axes(columns, phases or {}, rotor_angle, *turned, units or {}, file.name)
        parsed = replace(parsed, columns=columns)
        named = with_names_of(parsed.columns, {name: given[name] for name in ("input", "output", "time", *_BY_COLUMN)})
    if named["time"] in (named["units"] or {}) and named["time"] not in (*_as_tuple(input), *_as_tuple(output)):
        named["units"] = dict(named["units"])
        time_unit = named["units"].pop(named["time"])
    sides = [_as_tuple(named[side]) for side in ("input", "output")]
    own = parsed.columns if rows is None or parsed.columns.excerpt is None else _of_rows(parsed.columns, rows)
    columns, rename = with_other_files(own, file, [*sides[0], *sides[1]], named["time"], read_columns)
    inputs, outputs = ([rename.get(name, name) for name in side] for side in sides)
    with errors_of(file):
        record = _record(
            columns,
            name=file.name,
            inputs=inputs,
            outputs=outputs,
            clock=SampleTime(
                dt if dt is None or abs(dt) < MOST_EXACT else float(dt), named["time"], time_unit, resample
            ),
            rows=rows or slice(None),
            mask=mask,
            skip_bad_rows=skip_bad_rows,
            **with_names_of(columns, {option: named[option] for option in _BY_COLUMN}),  # also those of other files
            derivative_window=derivative_window,
            meanings={
                "counts_per_revolution": counts_per_revolution,
                "pole_pairs": pole_pairs,
                "supply_voltage": supply_voltage,
                "pwm_full_scale": pwm_full_scale,
            },
        )
        found = (
            *missed,
            *unchecked,
            *about_files(parsed.columns, columns, (*inputs, *outputs), file.name),
            *record.findings,
        )
        record = prepared(replace(record, findings=found), filter, decimate, detrend)
        return record if columns.excerpt is None else _of_blocks(record, columns, file, given, bool(rename))


def _of_rows(columns: Columns, rows: slice) -> Columns:
    """An excerpt of these rows of a table in place of that of all; the same where there are none."""
    assert columns.excerpt is not None
    first, stop, _ = rows.indices(columns.excerpt.rows)
    return excerpt(columns.excerpt.table, rows) if first < stop else columns


def _of_blocks(record: Record, columns: Columns, file: Path, given: Mapping[str, Any], several: bool) -> Record:
    """The record of an excerpt, with the way to all rows of its table where each of them can be read by itself.

    Args:
        record: as read.
        columns: of the excerpt.
        file: the table.
        given: the arguments of `read`.
        several: whether other files were read, too.
    """
    assert columns.excerpt is not None
    reading = {name: value for name, value in given.items() if name not in ("path", "rows")}
    wide = [name for name in ("wrap", "phases", "resample", "filter", "detrend", "other files") if given.get(name)]
    wide += ["edges(…)"] * any(map(edges_of, (*_as_tuple(given["input"]), *_as_tuple(given["output"]))))
    wide += ["decimate"] * (given["decimate"] != 1) + ["detrend"] * (given["detrend"] == 0)
    wide += ["mask"] * bool(given["mask"] and OVER_ALL_ROWS.search(given["mask"])) + ["other files"] * several
    data = {"rows": sum(map(len, columns.excerpt.stretches)), "of": columns.excerpt.rows, "whole": wide}
    found = (*record.findings, Finding("read-in-part", file.name, data))
    if wide or not record.excerpt_of:
        return replace(record, findings=found, excerpt_of=())
    blocks = Blocks(columns.excerpt.table, file, reading)
    return replace(record, findings=found, excerpt_of=tuple(each._replace(read=blocks) for each in record.excerpt_of))


@dataclass(frozen=True, eq=False)
class Blocks:
    """Reads all rows of a large table as records, block by block.

    Args:
        table: in the file.
        file: its path.
        reading: arguments of `read`.
    """

    table: LargeTable
    file: Path
    reading: Mapping[str, Any]

    def __call__(self, first: int, stop: int, lead: int, dt: float) -> Iterator[Record]:
        """The samples in the rows ``first`` to ``stop`` of the file, segment by segment in each block.

        Args:
            first, stop: rows of the file.
            lead: the samples before those of a block that are repeated at its start, as far as they are in its segment.
            dt: the sample time in s.

        Raises:
            DataError: for a row that cannot be read.
        """
        sample = self.table.sample
        named = with_names_of(sample, {name: self.reading[name] for name in ("input", "output", "time", *_BY_COLUMN)})
        channels = [*_as_tuple(named["input"]), *_as_tuple(named["output"])]
        used = [column_of(name, sample.series) for name in channels] + list(named["direction"].values())
        used = list(sample.series) if self.reading["mask"] else [*used, *([named["time"]] if named["time"] else [])]
        margin = lead + self.reading["derivative_window"] + int(max(map(abs, named["shift"].values()), default=0))
        for begin in range(first, stop, max(BLOCK // len(sample.series), 1)):
            end = min(begin + max(BLOCK // len(sample.series), 1), stop)
            rows = range(max(begin - margin, 0), min(end + margin, self.table.rows))
            columns = columns_in(self.table, [rows], list(dict.fromkeys(used)))
            try:
                record = read(ParsedFile(self.file, columns), **{**self.reading, "dt": dt})
            except NothingLeft:
                continue
            for segment in record.segments:
                row = segment.excerpt_of[0].at
                low, high = max(max(first, begin - lead) - row, 0), min(end - row, len(segment))
                if low < high:
                    yield segment[low:high]


def common_step(records: Sequence[Record], reading: Mapping[str, Any]) -> float | None:
    """The sample time in s to which several files have to be resampled, the longest of all: a shorter one would add
    samples that were not measured. None where they agree, are not to be resampled, or have one that is given.

    Args:
        records: of the files, as read.
        reading: the arguments of `read`.
    """
    if not reading.get("resample") or reading.get("dt") is not None:
        return None
    steps = [record.dt for record in records]
    return None if np.allclose(steps, steps[0], rtol=1e-6, atol=0.0) else max(steps)


def with_names_of(columns: Columns, reading: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `read` in which every column has its name in the file, also where it was given without its unit.

    Of an option that is given twice for a column, once with its unit and once without it, the last value is taken.

    Args:
        columns: of the file.
        reading: the arguments.

    Raises:
        DataError: where several columns differ only by their units.
    """

    def channel(name: str) -> str:
        column = column_of(name, columns.series)
        return columns.called(name) if column == name else f"d({columns.called(column)})"

    named = dict(reading)
    for side in [each for each in ("input", "output") if reading.get(each)]:
        names = [channel(each) for each in _as_tuple(reading[side])]
        named[side] = names[0] if isinstance(reading[side], str) else names
    if reading.get("time"):
        named["time"] = columns.called(reading["time"])
    for option in set(_BY_COLUMN) & set(reading):
        named[option] = {channel(name): value for name, value in (reading[option] or {}).items()}
    if named.get("direction"):
        named["direction"] = {name: columns.called(sign) for name, sign in named["direction"].items()}
    return named


def prepared(record: Record, filter: float | None = None, decimate: int = 1, detrend: int | None = None) -> Record:
    """The record filtered, decimated and without a polynomial in time, in this order; each adds a finding.

    Args:
        record: as read without these three arguments of `read`.
        filter, decimate, detrend: as of `read`.
    """
    if filter is not None:
        record = record.lowpass(filter)
    record, notes = record.decimate(decimate), list[Finding]()
    if filter is not None or decimate != 1:
        notes.append(Finding("data-filtered", record.name, {"cutoff": filter, "factor": decimate}))
    if detrend is not None:
        record = record.detrend(detrend)
        notes.append(Finding("data-detrended", record.name, {"order": detrend}))
    return replace(record, findings=(*record.findings, *notes)) if notes else record


def _record(
    columns: Columns,
    *,
    name: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    clock: SampleTime,
    rows: slice,
    mask: str | None,
    skip_bad_rows: bool,
    wrap: Mapping[str, float],
    shift: Mapping[str, float],
    direction: Mapping[str, str],
    scale: Mapping[str, float],
    offset: Mapping[str, float],
    units: Mapping[str, str],
    signals: Mapping[str, str],
    derivative_window: int,
    meanings: Mapping[str, float | None],
) -> Record:
    """The record in ``columns`` with the options of `read`; the module docstring has the order of the steps."""
    channels = _signals(inputs, outputs, columns)
    used = [s.column for s in channels]
    by_column: dict[str, Any] = {"wrap": wrap, "shift": shift, "direction": direction, "scale": scale, "offset": offset}
    sources = {s.name: s.column for s in channels}
    unused = surplus_units(units, sources, columns)
    check_options({**by_column, "units": {unit: units[unit] for unit in units if unit not in unused}}, sources)
    apart = shifted(continuous(columns, wrap), shift, direction)
    columns, clock = _on_one_clock(apart, clock, used, {*used[: len(inputs)], *direction.values()})
    used = [*(s.column for s in channels), *direction.values(), *([clock.time] if clock.time else [])]
    selection = select(columns, used, rows, mask, skip_bad_rows, name)
    with np.errstate(all="ignore"):  # a number that overflows is refused below, or by the record
        values = [
            selection.scaled(s.column, scale.get(s.column, 1.0), offset.get(s.column, 0.0), direction.get(s.column))
            for s in channels
        ]
        record = sampled(
            selection,
            clock,
            Record(
                input=np.column_stack(values[: len(inputs)]),
                output=np.column_stack(values[len(inputs) :]) if outputs else np.empty((len(values[0]), 0)),
                dt=1.0,
                input_names=tuple(inputs),
                output_names=tuple(outputs),
                input_units=tuple(_unit(s, units, scale, columns) for s in channels[: len(inputs)]),
                output_units=tuple(_unit(s, units, scale, columns) for s in channels[len(inputs) :]),
                name=name,
                findings=selection.findings,
                signals=signals,
                conversions={s.name: (scale.get(s.column, 1.0), offset.get(s.column, 0.0)) for s in channels},
            ),
        )
        if columns.excerpt is not None and not clock.resample:
            begins, held = selection.file_rows[[0, *record.breaks]].tolist(), columns.excerpt.stretches
            edges = pairwise([held[0].start, *begins[1:], held[-1].stop])
            rows_of = (FileRows(None, first, at, stop) for (first, stop), at in zip(edges, begins, strict=True))
            record = replace(record, excerpt_of=tuple(rows_of))
        record = _differentiated(record, [s.name for s in channels if s.is_derivative], derivative_window)
        sizes = {key: value for key, value in meanings.items() if value is not None}
        given = {s.name: None for s in channels if units.get(s.name) or units.get(s.column)}
        record = replace(record.convert(given, **sizes).in_si(**sizes), excerpt_of=record.excerpt_of)
        moved = [Finding("data-resampled", name, {"dt": record.dt})] if columns is not apart else []
        notes = [*unused.values(), *about_sample_time(record.dt, name)]
        return replace(record, findings=(*moved, *record.findings, *notes))


def _on_one_clock(
    columns: Columns, clock: SampleTime, used: Sequence[str], held: Collection[str]
) -> tuple[Columns, SampleTime]:
    """The columns at the times of the last one used, where they have times of their own, and that time column.

    Args:
        columns: of the file.
        clock: as given.
        used: the columns of inputs and outputs.
        held: those of inputs and directions, which keep their value until the next one.
    """
    if clock.time is not None:
        columns = with_clocks_of_messages(columns, clock.time, [*sorted(held), *used])
    elif columns.clocks and clock.dt is None:
        clock = replace(clock, time=columns.clocks.get(used[-1]))
    if clock.time is None or clock.time not in columns.clocks.values():
        return columns, clock
    wanted = {*used, *held, clock.time, *(columns.clocks[name] for name in used if name in columns.clocks)}
    few = replace(columns, clocks={name: each for name, each in columns.clocks.items() if name in wanted})
    return on_one_clock(few, clock.time, held), clock


def _signals(inputs: Sequence[str], outputs: Sequence[str], columns: Columns) -> list[_Signal]:
    """The source of every channel, inputs first."""
    names = [*inputs, *outputs]
    if not inputs:
        raise DataError("no input column; name at least one")
    for name in names:
        if names.count(name) > 1:
            again = f"; there is also {name}_2" * (f"{name}_2" in columns.series)
            raise DataError(
                f"column {name!r} is named twice among inputs and outputs; every channel is one column{again}"
            )
    signals = []
    for name in names:
        column = column_of(name, columns.series)
        check_column(column, columns)
        signals.append(_Signal(name, column, column != name))
    return signals


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


def _unit(signal: _Signal, units: Mapping[str, str], scale: Mapping[str, float], columns: Columns) -> str:
    """The unit given for a channel, else the one that the file gives for its column.

    A scale other than −1 may change the unit, so that the one in the file is no longer known to be right.
    """
    if units.get(signal.name):
        return units[signal.name]
    in_file = columns.unit(signal.column) if abs(scale.get(signal.column, 1.0)) == 1 else ""
    unit = units.get(signal.column) or in_file
    return f"{unit}/s" if unit and signal.is_derivative else unit
