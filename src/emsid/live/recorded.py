"""Samples of a source, or of the log of one, as a record."""

from __future__ import annotations

from pathlib import Path

from emsid.errors import DataError
from emsid.live.log import read_from
from emsid.live.protocol import Columns, LineParser
from emsid.live.timeline import Stretch, Timeline
from emsid.record import Record, concatenate


def record_of(
    stretch: Stretch, channels: tuple[tuple[str, ...], str, tuple[str, ...], str], dt: float, name: str
) -> Record:
    """A stretch of samples as a record."""
    inputs, output, input_units, output_unit = channels
    units = (input_units, (output_unit,))
    return Record(stretch.input, stretch.output, dt, inputs, (output,), *units, times=(stretch.time,), name=name)


def read_log(
    path: str | Path,
    begin: int = 0,
    header: str = "",
    inputs: tuple[str, ...] = (),
    output: str = "",
    time: str = "",
    dt: float | None = None,
    whole: bool = False,
    columns: Columns | None = None,
) -> Record:
    """The samples of a log as a record, with a segment for every stretch without a gap.

    Args:
        path: of the log, or of any file of lines.
        begin: the byte to begin at.
        header: the columns, where the file has no header.
        inputs, output, time: names of the columns.
        dt: sample time in s; by default from the time column.
        whole: whether a last line without its line break is complete; in a log it may be cut off.
        columns: what the columns are, where that is known already.

    Raises:
        FormatError: where the file cannot be read.
        DataError: where it has no samples.
    """
    parser, timeline = LineParser(header, inputs, output, time, columns=columns), Timeline(dt)
    data = read_from(path, begin)
    rows = parser.feed(data + b"\n" if whole else data[: data.rfind(b"\n") + 1])
    if parser.columns is None and parser.problem is not None:
        raise parser.problem
    if rows is None or parser.columns is None:
        raise DataError(f"{path}: there are no samples in this log")
    stretches = timeline.place(rows, last=True)
    if timeline.dt is None or not stretches:
        raise DataError(f"{path}: there are too few samples in this log to find its sample time", arguments=("dt",))
    step = timeline.dt
    records = [record_of(stretch, parser.columns.channels, step, Path(path).name) for stretch in stretches]
    return concatenate(records)
