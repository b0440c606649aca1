"""Channels that are columns of other files: ``x.csv:1``, the first column of ``x.csv``.

Files with other times are columns with clocks of their own; the time column of the record is that of its last output.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from emsid.errors import DataError, some
from emsid.findings import Finding
from emsid.io.columns import Columns, errors_of, nearest
from emsid.units import column_of

if TYPE_CHECKING:
    import polars as pl


def file_and_column(name: str, beside: Path | None = None) -> tuple[Path, str] | None:
    """The file and the column in a name such as ``x.csv:1``; None where there is no such file.

    Args:
        name: of a channel.
        beside: a file, in whose folder the other one may be.
    """
    file, colon, column = name.rpartition(":")
    if not (colon and file and column):
        return None
    places = [Path(file), *([beside.parent / file] if beside is not None else [])]
    found = next((place for place in places if place.is_file()), None)
    return None if found is None else (found, column)


def with_other_files(
    columns: Columns, path: Path, names: Sequence[str], time: str | None, read_columns: Callable[[Path], Columns]
) -> tuple[Columns, dict[str, str]]:
    """The columns of a file with those that the names take from other files, and the new name of each of these.

    A column is called as in its file, or after the file if that has no header. It has its full name, ``x.csv:1``,
    where another column has that name.

    Args:
        columns: of the file ``path``.
        path: the file.
        names: of channels.
        time: the time column; None where there is none.
        read_columns: reads the columns of another file.

    Raises:
        DataError: for a column that the other file does not have, where its times are other dates, and for a time
            column that is named with its file.
    """
    if time is not None and time not in columns.series and (elsewhere := file_and_column(time, path)):
        raise DataError(
            f"{path}: {time!r}: the time is a column of every file that channels are taken from; give its name alone, "
            f"{elsewhere[1]!r}",
            arguments=("time",),
        )
    series, units = dict(columns.series), dict(columns.units)
    renamed: dict[str, str] = {}
    own_names: dict[str, str] = {}
    apart: dict[str, tuple[str, pl.Series]] = {}
    for given in dict.fromkeys(names):
        name = column_of(given, series)
        found = None if name in series or name in own_names else file_and_column(name, path)
        if found is not None:
            file, wanted = found
            others = columns if file.resolve() == path.resolve() else read_columns(file)
            column = _column(others, wanted, file)
            times = _other_times(others, file, columns, path, time)
            own = file.stem if column == f"c{list(others.series).index(column) + 1}" else column  # only numbered
            if own in own_names.values() or (own in series and others is not columns):
                own = name
            own_names[name], series[own] = own, others.series[column].alias(own)
            units[own] = others.unit(column)
            if times is not None:
                apart[own] = (f"{time} of {file.name}", times)
        if name in own_names:
            renamed[given] = own_names[name] if name == given else f"d({own_names[name]})"
    joined = replace(columns, series=series, units=units)
    if not apart or time is None:
        return joined, renamed
    last = column_of(renamed.get(names[-1], names[-1]))
    return _with_clocks(joined, time, f"{time} of {path.name}", apart, last), renamed


def _other_times(others: Columns, file: Path, columns: Columns, path: Path, time: str | None) -> pl.Series | None:
    """The times of a file, if they differ from those of the first one.

    Raises:
        DataError: where they are dates, which begin at zero in each file, or where rows of a file are damaged.
    """
    if time is None or time not in others.series or time not in columns.series:
        return None
    times = others.series[time]
    if times.equals(columns.series[time]):
        return None
    if not times.dtype.is_numeric() or columns.clocks or columns.damaged or others.damaged:
        raise DataError(
            f"the times in {time!r} of {file.name} and {path.name} differ; bring both to the same times first"
        )
    return times


def _with_clocks(
    columns: Columns, time: str, first: str, apart: Mapping[str, tuple[str, pl.Series]], last: str
) -> Columns:
    """The columns with the clock of each.

    Args:
        columns: of the first file, and channels of others.
        time: the name of the time column of all files; that of the last channel keeps it.
        first: the name of the time column of the first file where it loses its own.
        apart: for each channel with other times, the name of its clock, and the times.
        last: the last channel.
    """
    leading = apart[last][0] if last in apart else first
    renamed = {clock: time if clock == leading else clock for clock in (first, *(clock for clock, _ in apart.values()))}
    series, units = dict(columns.series), dict(columns.units)
    clocks = {name: renamed[apart[name][0] if name in apart else first] for name in series if name != time}
    times = {first: series.pop(time)} | dict(apart.values())
    for clock, values in times.items():
        name = renamed[clock]
        series[name], clocks[name], units[name] = values.alias(name), name, units.get(time, "")
    return replace(columns, series=series, units=units, clocks=clocks, lines=None)


def about_files(own: Columns, columns: Columns, names: Sequence[str], record: str) -> list[Finding]:
    """Findings about the files of a record: what is missing of one that is cut off, and what `about_clocks` finds.

    Args:
        own: the columns of the first file.
        columns: these and those of others, with the clock of each.
        names: of channels.
        record: its name.
    """
    cut = {column: list(lengths) for column, lengths in own.cut.items()}
    found = [Finding("file-cut-off", record, {"columns": cut})] if cut else []
    return found if own.clocks else [*found, *about_clocks(columns, names, record)]


def about_clocks(columns: Columns, names: Sequence[str], record: str) -> list[Finding]:
    """A finding where channels have the times of different files: nothing shows that these clocks began together.

    Args:
        columns: as `with_other_files` returns them, with the clock of each.
        names: of channels.
        record: its name.
    """
    channels = [column_of(name, columns.series) for name in names]
    clocks = dict.fromkeys(columns.clocks[channel] for channel in channels if channel in columns.clocks)
    times = [columns.series[clock] for clock in clocks]
    if len(times) < 2:
        return []
    begins, ends = ([float(time[k]) for time in times] for k in (0, -1))
    share = (min(ends) - max(begins)) / (max(ends) - min(begins))
    return [Finding("clocks-of-files", record, {"columns": channels, "share": share})]


def _column(columns: Columns, wanted: str, file: Path) -> str:
    """A column by its name, or by its number, counted from 1."""
    with errors_of(file):
        called = columns.called(wanted)
    if called in columns.series:
        return called
    if wanted.isdigit() and 1 <= int(wanted) <= len(columns.series):
        return list(columns.series)[int(wanted) - 1]
    raise DataError(
        f"{file}: there is no column {wanted!r}{nearest(wanted, columns.series)}; there are {some(columns.series)}"
    )
