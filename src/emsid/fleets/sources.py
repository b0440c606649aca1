"""What a fleet is read from: one `Batch` for every motor and period.

The motor of a file is a part of its path – a folder ``motor=M7`` of a hive-partitioned data set, or a field of a
pattern such as ``logs/{motor}/{period}.csv`` – or the name of the file. Where it is a column of a table, the tables
are first divided by motor: one streaming pass, which writes a Parquet file for every motor and never holds a table in
memory. Periods are folders or fields too, or stretches of the time column of a table.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from glob import glob
from itertools import product
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from emsid.errors import DataError, FormatError, some
from emsid.io import READERS
from emsid.io.files import not_written

if TYPE_CHECKING:
    import polars as pl

SCANNED = (".parquet", ".arrow", ".feather", ".csv")
"""Suffixes of tables that Polars scans without reading them whole."""
BINARY = SCANNED[:3]
"""Those that are always scanned: they have one reading only, where a CSV may have lines before its header."""
FIELD = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True)
class Batch:
    """The data of one motor in one period.

    Attributes:
        motor: its name.
        period: the period; empty where there is one only.
        files: the paths of its data, in order.
        time: the time column and where in it the period begins and ends; None for whole files. Times are numbers of
            the column, or microseconds since 1970 of a column of dates.
    """

    motor: str
    period: str
    files: tuple[str, ...]
    time: tuple[str, float, float] | None = None

    @property
    def key(self) -> tuple[str, str]:
        """What its row is found by."""
        return self.motor, self.period


@dataclass(frozen=True)
class Found:
    """A file and what its path says: ``{"motor": "M7"}``."""

    path: Path
    keys: dict[str, str]


def found_files(source: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> list[Found]:
    """The files of a source with the fields of their paths, sorted by path.

    Args:
        source: a folder, which is searched with its folders; a pattern with fields, ``logs/{motor}/{period}.csv``, or
            with the wildcards of a shell; or several of these.

    Raises:
        DataError: where there is no file that can be read.
    """
    if isinstance(source, str | os.PathLike):
        found = sorted(_of_one(str(source)), key=lambda each: str(each.path))
        if not found:
            raise DataError(f"{source}: no file that can be read; there are readers for {', '.join(READERS)}")
        return found
    return [file for one in source for file in found_files(one)]


def _of_one(source: str) -> list[Found]:
    if FIELD.search(source):
        return _of_pattern(source)
    path = Path(source)
    paths = path.rglob("*") if path.is_dir() else map(Path, glob(source, recursive=True))
    return [Found(each, _hive_keys(each, path)) for each in paths if each.is_file() and _readable(each)]


def _readable(path: Path) -> bool:
    return not path.name.startswith((".", "_")) and (
        path.suffix.lower() in READERS or path.with_suffix("").suffix.lower() in READERS
    )


def _hive_keys(path: Path, root: Path) -> dict[str, str]:
    """The keys of folders such as ``motor=M7`` below the folder of the source."""
    folders = path.parts[len(root.parts) : -1] if path.is_relative_to(root) else path.parts[:-1]
    pairs = (part.partition("=") for part in folders if "=" in part)
    return {key: unquote(value) for key, _, value in pairs}


def _of_pattern(pattern: str) -> list[Found]:
    """The files of a pattern with fields; a field stands for a part of the path without a separator."""
    parts = FIELD.split(pattern)  # texts and names of fields in turn
    shape, known = "", set[str]()
    for k, part in enumerate(parts):
        if k % 2 == 0:
            shape += re.escape(part)
        else:
            shape += f"(?P={part})" if part in known else f"(?P<{part}>[^{re.escape(os.sep)}]+?)"
            known.add(part)
    every = glob(FIELD.sub("*", pattern), recursive=True)
    matches = ((Path(each), re.fullmatch(shape, each)) for each in every)
    return [Found(path, match.groupdict()) for path, match in matches if match and path.is_file()]


def batches(files: Sequence[Found], motor: str | None, period: str | None, time: str | None) -> list[Batch]:
    """The batches of files whose paths name the motor, or hold one motor each.

    Args:
        files: the files.
        motor: the field of the paths that names it; by default ``motor``, or the names of the files without suffix,
            with as many of their folders as tell them apart.
        period: a field of the paths, or a duration such as ``1d``; None for one period.
        time: the time column that a duration divides.

    Raises:
        DataError: for a field that some paths lack, or a period that cannot be divided.
    """
    key = motor or "motor"
    if motor and any(motor not in file.keys for file in files):
        without = next(file.path for file in files if motor not in file.keys)
        raise DataError(f"{without}: the path names no {motor!r}", arguments=("motor",))
    of_path = period if period and any(period in file.keys for file in files) else None
    if of_path and any(of_path not in file.keys for file in files):
        raise DataError(f"some paths name no {period!r}; give a duration, such as 1d", arguments=("period",))
    groups: dict[tuple[str, str], list[str]] = {}
    names = _distinct([file for file in files if key not in file.keys], of_path)
    for file in files:
        name = file.keys.get(key) or names[file.path]
        groups.setdefault((name, file.keys[of_path] if of_path else ""), []).append(str(file.path))
    whole = [Batch(name, when, tuple(paths)) for (name, when), paths in groups.items()]
    if period is None or of_path:
        return whole
    return [part for batch in whole for part in by_period(batch, period, time)]


def _distinct(files: Sequence[Found], period: str | None) -> dict[Path, str]:
    """The shortest ends of paths that tell the files of one name in one period apart, without suffix if possible."""
    alike: dict[str, list[Found]] = {}
    for file in files:
        alike.setdefault(file.path.stem, []).append(file)
    found: dict[Path, str] = {}
    for several in alike.values():
        whens = [file.keys.get(period or "", "") for file in several]
        kept = [
            [part for part in file.path.parts if part != f"{period}={when}"]
            for file, when in zip(several, whens, strict=True)
        ]
        deepest = max(map(len, kept))
        for suffixed, count in product((False, True), range(1, deepest + 1)):
            ends = ["/".join([*parts[-count:-1], parts[-1] if suffixed else Path(parts[-1]).stem]) for parts in kept]
            if len(set(zip(ends, whens, strict=True))) == len({file.path for file in several}):
                break
        found |= {file.path: end for file, end in zip(several, ends, strict=True)}
    return found


def seconds(period: str) -> float:
    """A duration such as ``1d``, ``8h`` or ``90 min`` in seconds.

    Raises:
        DataError: for a text that is no duration.
    """
    from emsid.units import conversion

    number = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*([a-zµ]+)\s*", period)
    try:
        found = float(number[1]) * conversion(number[2], "s")[0] if number else 0.0
    except DataError:
        found = 0.0
    if not found > 0:
        raise DataError(
            f"a period of {period!r}; give a duration, such as 1d or 8h, or a field of the paths", arguments=("period",)
        )
    return found


def by_period(batch: Batch, period: str, time: str | None) -> list[Batch]:
    """A batch divided at the multiples of a period; a file that cannot be scanned stays one batch, which then fails.

    Raises:
        DataError: without a time column, or for files that are no tables.
    """
    length = seconds(period)
    if time is None:
        raise DataError("a period divides the time column of tables; name it", arguments=("time",))
    if not scanned(batch.files):
        kinds = ", ".join(SCANNED)
        raise DataError(f"{batch.files[0]}: a period divides tables only ({kinds})", arguments=("period",))
    import polars as pl

    try:
        numbers = time_number(batch.files, time)
        starts = scan(batch.files).select((numbers // _ticks(batch.files, time, length)).unique().sort())
        found = [float(each) for each in starts.collect(engine="streaming").to_series() if each is not None]
    except (pl.exceptions.PolarsError, OSError):
        return [batch]
    size = _ticks(batch.files, time, length)
    dated = is_dated(batch.files, time)
    return [Batch(batch.motor, _label(k * length, dated), batch.files, (time, k * size, (k + 1) * size)) for k in found]


def _label(start: float, dated: bool) -> str:
    """The beginning of a period, as a date or in seconds."""
    if not dated:
        return f"{start:.10g} s"
    from datetime import UTC, datetime

    when = datetime.fromtimestamp(start, UTC)
    return when.strftime("%Y-%m-%d" if when.hour == when.minute == when.second == 0 else "%Y-%m-%dT%H:%M:%S")


def _ticks(files: Sequence[str], time: str, length: float) -> float:
    """A length of time in the numbers of `time_number`."""
    return length * (1e6 if is_dated(files, time) else 1.0)


def is_dated(files: Sequence[str], time: str) -> bool:
    """Whether a time column holds dates."""
    return bool(_schema(files)[time].is_temporal())


def time_number(files: Sequence[str], time: str) -> pl.Expr:
    """A time column as a number: seconds, or microseconds of dates.

    Raises:
        DataError: where there is no such column.
    """
    import polars as pl

    schema = _schema(files)
    if time not in schema:
        raise DataError(f"{files[0]}: no column {time!r}; there are {some(schema)}", arguments=("time",))
    column = pl.col(time)
    return column.dt.epoch("us").cast(pl.Float64) if schema[time].is_temporal() else column.cast(pl.Float64)


def _schema(files: Sequence[str]) -> dict[str, Any]:
    return dict(scan(files).collect_schema())


def scanned(files: Iterable[str], kinds: Sequence[str] = SCANNED) -> bool:
    """Whether all files are tables that can be scanned."""
    return all(Path(file).suffix.lower() in kinds for file in files)


def scan(files: Sequence[str]) -> pl.LazyFrame:
    """Tables of one kind as one lazy frame, in order."""
    import polars as pl

    kind = Path(files[0]).suffix.lower()
    if kind == ".parquet":
        return pl.scan_parquet(list(files), hive_partitioning=False, glob=False)
    return pl.scan_csv(list(files), glob=False) if kind == ".csv" else pl.scan_ipc(list(files), glob=False)


def divided(files: Sequence[Found], motor: str, folder: Path) -> tuple[list[Found], dict[str, str]]:
    """Tables divided by their column ``motor`` into a Parquet file for every motor and table, and the failures.

    Args:
        files: the tables.
        motor: the column.
        folder: where to write; what an earlier run left there is removed.

    Returns:
        The new files with their motor, and by path the reason why a table cannot be divided.

    Raises:
        FormatError: for files that are no tables.
        NotWritten: where the new files cannot be written, such as on a full disk.
        DataError: where no table has the column.
    """
    import polars as pl

    others = [str(file.path) for file in files if not scanned([str(file.path)])]
    if others:
        raise FormatError(f"{others[0]}: the motor is a column of tables only ({', '.join(SCANNED)})")
    rmtree(folder, ignore_errors=True)  # of an earlier run, whose tables may be others
    failed: dict[str, str] = {}
    for k, file in enumerate(files):
        part = folder / f"{k:06d}"
        try:
            table = scan([str(file.path)])
            if motor not in (names := table.collect_schema().names()):
                failed[str(file.path)] = f"no column {motor!r}; there are {some(names)}"
                continue
            table.with_columns(pl.col(motor).cast(pl.String)).sink_parquet(
                pl.PartitionBy(part, key=motor), mkdir=True, engine="streaming"
            )
        except (pl.exceptions.PolarsError, OSError) as problem:
            with suppress(pl.exceptions.PolarsError, OSError):
                table.select(pl.all().null_count()).collect(engine="streaming")  # it can be read, so not written
                rmtree(folder, ignore_errors=True)
                raise not_written(folder, problem) from None
            failed[str(file.path)] = f"this table cannot be read ({' '.join(str(problem).split())[:120]})"
    if len(failed) == len(files):
        path, reason = next(iter(failed.items()))
        raise DataError(f"{path}: {reason}", arguments=("motor",))
    parts = sorted(folder.rglob("*.parquet"))
    return [Found(part, {"motor": _hive_keys(part, folder)[motor]}) for part in parts], failed
