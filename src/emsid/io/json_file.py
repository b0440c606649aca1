"""JSON and JSON Lines: arrays under keys, lists of records, lists of runs, and the files of WPILib's SysId.

- Arrays under keys are columns by their path, ``motor.speed``. A list of equally long lists is a matrix, ``name_1`` ….
- A list of objects with one value (or a short list) for each key is a table with a row for every object.
- A list of objects with arrays as long as there are samples is a list of *runs*. The arrays of all runs follow each
  other, with the number of the run in the column ``run``. Where the runs have no times, a column of times by the rate
  that the file states, or of the numbers of the samples, begins at zero in every run.
- SysId before 2024 wrote a matrix for each test, whose columns its program knows (WPILib, ``SysIdLogger``).
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from emsid.errors import FormatError
from emsid.io.columns import Columns, flat, from_arrays
from emsid.io.cut_off import marked, without_cut_line
from emsid.io.sampling import entry_with_sample_time
from emsid.io.table import read_table

if TYPE_CHECKING:
    import polars as pl

RUN, TIME, SAMPLE = "run", "time", "sample"
"""The names of the columns with the number of a run, and the times, or the number of the sample, in it."""
_TIMES = re.compile(r"(time|t|timestamp|stamp|secs?|seconds|millis|micros)(\W.*|_m?u?s)?", re.IGNORECASE)
DEEPEST = 12
"""Values inside so many lists and objects are not read."""

_SYSID = ("time [s]", "voltage [V]", "position", "velocity")
_SYSID_DRIVETRAIN = (
    *("time [s]", "left voltage [V]", "right voltage [V]", "left position", "right position"),
    *("left velocity", "right velocity", "angle [rad]", "angular velocity [rad/s]"),
)
_SYSID_UNITS = {
    "Meters": "m",
    "Feet": "ft",
    "Inches": "in",
    "Rotations": "rev",
    "Radians": "rad",
    "Degrees": "deg",
}


def read_json(content: bytes) -> Columns:
    """The columns of a JSON file, or of one with a JSON value in every line.

    Raises:
        FormatError: for other content.
    """
    is_cut = False
    try:
        data = json.loads(_text(content))
    except (ValueError, RecursionError) as problem:
        content, is_cut = without_cut_line(content)
        data = _lines(_text(content))
        if data is None:
            raise FormatError(f"this is no JSON file, or a damaged one ({problem}); export it again") from None
    return marked(_columns(data), is_cut)


def read_json_lines(content: bytes) -> Columns:
    """The columns of a file with a JSON object in every line; one with other lines is read as a table of text.

    Raises:
        FormatError: as `emsid.io.table.read_table`.
    """
    whole, is_cut = without_cut_line(content)
    lines = _lines(_text(whole))
    return read_table(content) if lines is None or not _is_nested(lines) else marked(_columns(lines), is_cut)


def _text(content: bytes) -> str:
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    return content.decode("utf-16" if wide else "utf-8-sig", errors="replace")


def _lines(text: str) -> list[Any] | None:
    """The values of all lines; None where one is no JSON object."""
    try:
        values = [json.loads(line) for line in text.splitlines() if line.strip()]
    except (ValueError, RecursionError):
        return None
    return values if len(values) > 1 and all(isinstance(value, dict) for value in values) else None


def _is_nested(lines: Sequence[Mapping[str, Any]]) -> bool:
    return any(isinstance(value, (list, dict)) for line in lines for value in line.values())


def _columns(data: Any) -> Columns:
    try:
        if isinstance(data, dict) and data.get("sysid") is True:
            return _sysid(data)
        return _Contents(data).columns()
    except RecursionError:
        raise FormatError("this JSON file has too many values inside others; export it in another form") from None


class _Contents:
    """The arrays and texts in a JSON value by their paths.

    Args:
        data: the value.
    """

    def __init__(self, data: Any) -> None:
        self.arrays: dict[str, Any] = {}
        self.texts: dict[str, pl.Series] = {}
        self.runs: list[int] = []
        self._walk(data, "", 0)

    def columns(self) -> Columns:
        """What was found, with the times of runs that have none."""
        found = from_arrays(self.arrays.items())
        series = {**found.series, **self.texts}
        if self.runs and not any(_TIMES.fullmatch(name.rpartition(".")[2]) for name in series):
            import polars as pl

            entry = entry_with_sample_time(found.numbers)
            name, step = (SAMPLE, 1.0) if entry is None else (f"{TIME} [{entry.unit or 's'}]", entry.number)
            series[name] = pl.Series(name, np.concatenate([step * np.arange(length) for length in self.runs]))
        return Columns(series, found.others, found.numbers)

    def _walk(self, value: Any, name: str, depth: int) -> None:
        import polars as pl

        if depth > DEEPEST:
            self.arrays[name] = "values inside many others"
        elif isinstance(value, dict):
            for key, inner in value.items():
                self._walk(inner, _path(name, key), depth + 1)
        elif isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
            if _are_runs(value):
                self._join_runs(value, name)
            else:
                self._add_records(value, name)
        elif isinstance(value, list) and len(value) > 1 and all(isinstance(each, str | None) for each in value):
            self.texts[name or "text"] = pl.Series(name or "text", value, dtype=pl.String)
        else:
            self.arrays[name or "values"] = _array(value)

    def _add_records(self, records: Sequence[Mapping[str, Any]], name: str) -> None:
        """A table with a row for every object."""
        import polars as pl

        try:
            frame = pl.DataFrame(records, infer_schema_length=None, strict=False)
        except (pl.exceptions.PolarsError, TypeError, ValueError, OverflowError):
            self.arrays[name or "values"] = "records of different kinds"
            return
        series, others = flat(frame)
        for key, column in series.items():
            path = _path(name, key)
            if column.dtype.is_numeric() or column.dtype == pl.Boolean:
                self.arrays[path] = column.cast(pl.Float64).fill_null(np.nan).to_numpy()
            else:
                self.texts[path] = column.cast(pl.String).alias(path)
        self.arrays |= {_path(name, key): reason for key, reason in others.items()}

    def _join_runs(self, runs: Sequence[Mapping[str, Any]], name: str) -> None:
        """The arrays that all runs have, one run after the other, and the number of the run."""
        tables = [{key: _array(value) for key, value in run.items() if isinstance(value, list)} for run in runs]
        lengths = [max((len(each) for each in table.values() if _is_array(each)), default=0) for table in tables]
        for key, value in tables[0].items():
            every: list[Any] = [table.get(key) for table in tables]
            alike = [
                _is_array(each) and len(each) == length and each.shape[1:] == value.shape[1:]
                for each, length in zip(every, lengths, strict=True)
            ]
            self.arrays[_path(name, key)] = np.concatenate(every) if all(alike) else "not equally long in every run"
        self.arrays[_path(name, RUN)] = np.repeat(np.arange(float(len(runs))), lengths)
        self.runs = lengths


def _path(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key


def _is_array(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim > 0


def _are_runs(records: Sequence[Mapping[str, Any]]) -> bool:
    """Whether objects hold arrays of samples, and are no rows of a table: their arrays are longer than the list."""
    lengths = [len(value) for value in records[0].values() if isinstance(value, list)]
    return max(lengths, default=0) > max(len(records), 1)


def _array(value: Any) -> Any:
    """A number, or a list or a matrix of numbers, as an array, NaN where there is none; else why it is none."""
    if isinstance(value, bool | int | float):
        return np.array(float(value))
    if not isinstance(value, list):
        return "text" if isinstance(value, str) else "no value"
    try:
        return np.array(value, dtype=float)
    except (ValueError, TypeError, OverflowError):
        return "lists of different lengths, or of something else than numbers"


def _sysid(data: Mapping[str, Any]) -> Columns:
    """The tests of SysId's JSON, one after the other; their times begin anew with each.

    Raises:
        FormatError: where there is no test.
    """
    import polars as pl

    tests = {name: _array(rows) for name, rows in data.items() if isinstance(rows, list)}
    tests = {name: rows for name, rows in tests.items() if _is_array(rows) and rows.ndim == 2 and len(rows)}
    widths = {rows.shape[1] for rows in tests.values()}
    names = next((names for names in (_SYSID, _SYSID_DRIVETRAIN) if widths == {len(names)}), None)
    if names is None:
        raise FormatError(
            f"this file of SysId has no tests of {len(_SYSID)} or {len(_SYSID_DRIVETRAIN)} columns; export it again"
        )
    unit = _SYSID_UNITS.get(str(data.get("units")), "")
    units = {name: unit + "/s" * name.endswith("velocity") for name in names if unit and not name.endswith("]")}
    values = np.concatenate([*tests.values()])
    series = {name: pl.Series(name, values[:, k]) for k, name in enumerate(names)}
    words = [name for name, rows in tests.items() for _ in rows]
    factor = data.get("unitsPerRotation")
    numbers = {"unitsPerRotation": float(factor)} if isinstance(factor, int | float) else {}
    return Columns(
        {**series, "test": pl.Series("test", words)},
        numbers=numbers,
        units=units,
        preamble=(str(data.get("test", "")),),
    )
