"""The line protocol between a board and the program: text lines of numbers with a header (``docs/line-protocol.md``).

::

    n,t[us],u[V],y[rad/s]
    0,0,0.000,0.00
    1,1000,5.000,0.31*4A

``t`` is the time and ``n`` a sequence number; both are recognised by their names, and one of them may be missing. The
first other column is the input and the second the output, unless names are given. ``*4A`` is an optional checksum: the
exclusive or of all bytes before it. Lines that begin with ``#`` are comments.

`LineParser` takes bytes in pieces of any size and returns rows of numbers; what is no row is counted.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from math import nan
from operator import xor

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import as_names
from emsid.errors import DataError, some
from emsid.units import Conversion, conversion

Array = NDArray[np.float64]

SEPARATORS = (b",", b";", b"\t", None)
"""Between the columns; None for blanks."""
USUAL = {2: "u,y", 3: "t,u,y", 4: "n,t,u,y"}
"""The columns of lines without a header, by their number."""
LARGEST = 1e60
"""Larger numbers are treated as a fault of the source: their powers would overflow."""
LONGEST_LINE = 4096
TOGETHER = 1000
"""Lines that are read at once where all of them are rows, which is several times faster than one by one."""
_TIMES, _NUMBERS = ("t", "time", "time_s"), ("n", "seq", "sample")
_COLUMN = re.compile(r"\s*(\w[\w.*/^²·()%-]*?)\s*(?:\[(.*?)\])?\s*")
_NOT_FINITE = re.compile(rb"[-+]?(nan|inf|infinity|ovf)", re.IGNORECASE)


@dataclass(frozen=True)
class Columns:
    """What the columns of the lines are.

    Attributes:
        names, units: of every column; the unit is empty where it is not known.
        time, number: the column of the time and of the sequence number, or None.
        inputs, output: the columns of the inputs and of the output.
        gains, offsets: conversion of every column to SI.
        checked: whether every line has a checksum.
        separator: between the columns.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: int | None
    number: int | None
    inputs: tuple[int, ...]
    output: int
    gains: tuple[float, ...]
    offsets: tuple[float, ...]
    checked: bool = False
    separator: bytes | None = b","

    @property
    def channels(self) -> tuple[tuple[str, ...], str, tuple[str, ...], str]:
        """Names of the inputs and the output, and their units."""
        return (
            tuple(self.names[k] for k in self.inputs),
            self.names[self.output],
            tuple(self.units[k] for k in self.inputs),
            self.units[self.output],
        )


@dataclass(frozen=True, eq=False)
class Rows:
    """Samples of a source, in order.

    Attributes:
        time: (m,) in s; NaN without a time column.
        number: (m,) sequence numbers; NaN without that column.
        input: (m, nu) in SI units.
        output: (m,) in SI units.
        broken: (m,) whether lines between this sample and the one before were not usable.
    """

    time: Array
    number: Array
    input: Array
    output: Array
    broken: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.output)

    def __getitem__(self, rows: slice | NDArray[np.bool_]) -> Rows:
        return Rows(self.time[rows], self.number[rows], self.input[rows], self.output[rows], self.broken[rows])


def read_header(
    text: str,
    inputs: Sequence[str] = (),
    output: str = "",
    time: str = "",
    *,
    units: Sequence[str] = (),
    checked: bool = False,
) -> Columns:
    """The columns that a header names: ``t[ms],voltage[V],speed[rpm]``.

    Args:
        text: the header.
        inputs, output: names of the columns of inputs and output; by default the first and the second of those that
            are neither time nor sequence number.
        time: name of the column of the time, where that is not one that is recognised.
        units: of every column, where they stand in a row of their own.
        checked: whether every line has a checksum.

    Raises:
        DataError: for a header without such columns, or a unit that is not known.
    """
    separator = next((s for s in SEPARATORS[:-1] if s and s.decode() in text), None)
    names, given = _names_and_units(text, separator)
    lower = [name.lower() for name in names]
    clock = names.index(time) if time in names else next((lower.index(name) for name in _TIMES if name in lower), None)
    number = next((lower.index(name) for name in _NUMBERS if name in lower), None)
    rest = [k for k in range(len(names)) if k not in (clock, number)]
    for name in (*as_names(inputs), *(each for each in (output, time) if each)):
        if name not in names:
            option = ("time",) if name == time else ("input", "output")
            raise DataError(f"the source has no column {name!r}; it has {some(names)}", arguments=option)
    wanted = tuple(names.index(name) for name in as_names(inputs)) or tuple(rest[:1])
    last = names.index(output) if output else next((k for k in rest if k not in wanted), None)
    if not wanted or last is None:
        raise DataError(f"header {text[:80]!r} has no input and output; it needs two columns besides t and n")
    to_si = [
        conversion(unit, "s" if k == clock else None) if unit and k != number else Conversion(1.0, 0.0, "")
        for k, unit in enumerate(units or given)
    ]
    return Columns(
        names,
        tuple(each.unit for each in to_si),
        clock,
        number,
        wanted,
        last,
        tuple(each.gain for each in to_si),
        tuple(each.offset for each in to_si),
        checked,
        separator,
    )


def _names_and_units(header: str, separator: bytes | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names in a header and their units, empty where none is given.

    Raises:
        DataError: for text that is no header, or a name used twice.
    """
    found = [_COLUMN.fullmatch(part) for part in (header.split(separator.decode()) if separator else header.split())]
    if not all(found):
        raise DataError(f"header {header[:80]!r} is not understood; write names with commas, such as t[ms],u[V],y[rpm]")
    names = tuple(match[1] for match in found if match)
    if len(set(names)) < len(names):
        raise DataError(f"header {header[:80]!r} has a name twice; every column needs its own name")
    return names, tuple(match[2] or "" for match in found if match)


class LineParser:
    """Reads lines of a source that come in pieces.

    Attributes:
        columns: what the columns are; None before a header or the first line of numbers.
        malformed: the number of lines that are no row.
        not_finite: the number of rows with NaN, infinity or an overflow.
        example: the last malformed line.
        problem: why the last header could not be used; None where there was no such header.
        implies: whether rows of numbers before any header are taken for the usual columns, or left out.

    Args:
        header: the columns, for a source without a header.
        inputs, output, time: as in `read_header`.
        columns: what the columns are, where that is known already.
    """

    def __init__(
        self,
        header: str = "",
        inputs: Sequence[str] = (),
        output: str = "",
        time: str = "",
        *,
        columns: Columns | None = None,
    ) -> None:
        self._channels = as_names(inputs), output, time
        self.columns = read_header(header, *self._channels) if header else columns
        self._given = self.columns is not None
        self.problem: DataError | None = None
        self.implies = True
        self.malformed = self.not_finite = self.lines = 0
        self.example = ""
        self._rest, self._broken = b"", False

    def feed(self, data: bytes) -> Rows | None:
        """The rows that are complete with these bytes; None where there are none."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            self._refuse(self._rest)
            self._rest = b""
        parts = [self._block(lines[first : first + TOGETHER]) for first in range(0, len(lines), TOGETHER)]
        parts = [(rows, broken) for rows, broken in parts if len(rows)]
        if not parts or not self.columns:
            return None
        return self._made(*map(np.concatenate, zip(*parts, strict=True)))

    def _block(self, lines: list[bytes]) -> tuple[Array, NDArray[np.bool_]]:
        """(m, k) the numbers of lines, and (m,) whether there were unusable lines before each."""
        rows = self._plain_rows(lines)
        if rows is not None:
            broken = np.zeros(len(rows), dtype=bool)
            broken[0], self._broken = self._broken, False
            return rows, broken
        found, after = [], []
        for line in lines:
            row = self._row(line)
            if row is not None:
                found.append(row)
                after.append(self._broken)
                self._broken = False
        return np.array(found), np.array(after, dtype=bool)

    def flush(self) -> Rows | None:
        """The last row of a file without a line break at its end."""
        return self.feed(b"\n") if self._rest else None

    def forget_rest(self) -> None:
        """Drop an incomplete line, as after the connection broke."""
        if self._rest:
            self._refuse(self._rest)
        self._rest = b""

    def _plain_rows(self, lines: list[bytes]) -> Array | None:
        """(m, k) the numbers of lines that are rows like any other; None where one of them needs a closer look."""
        columns = self.columns
        if columns is None or columns.checked:
            return None
        text, separator = b"\n".join(lines), columns.separator
        fields = {len(line.split()) if separator is None else line.count(separator) + 1 for line in lines}
        if fields != {len(columns.names)} or b"_" in text:
            return None
        parts = text.split() if separator is None else text.replace(b"\n", separator).split(separator)
        try:
            rows = np.fromiter(map(float, parts), float, len(parts)).reshape(len(lines), -1)
        except ValueError:
            return None
        if not np.all(np.abs(rows) < LARGEST):
            return None
        self.lines += len(rows)
        return rows

    def _row(self, line: bytes) -> list[float] | None:
        """The numbers of a line, or None for what is no row."""
        line = line.strip()
        if not line or line[:1] == b"#":
            return None
        self.lines += 1
        body = self._without_checksum(line)
        if self.columns is None or not body[:1].isascii() or body[:1].isalpha() or body[:1] == b"[":
            if self._heading(body, body is not line and bool(body)):
                return None
            if self.columns is None:
                if self.implies:
                    self._refuse(line)
                return None
        parts = body.split(self.columns.separator)
        row = [value for part in parts if (value := _number(part)) is not None]
        if not len(row) == len(parts) == len(self.columns.names) or b"_" in body:
            self._refuse(line)
            return None
        if not all(-LARGEST < value < LARGEST for value in row):
            self.not_finite += 1
            self._broken = True
            return None
        return row

    def _without_checksum(self, line: bytes) -> bytes:
        """A line without its checksum; empty where that is wrong, or missing although every line should have one."""
        if b"*" not in line:
            return b"" if self.columns is not None and self.columns.checked else line
        body, _, sum_ = line.rpartition(b"*")
        if sum_.upper() == b"%02X" % reduce(xor, body, 0):
            return body
        return line if self.columns is None else b""

    def _heading(self, body: bytes, checked: bool) -> bool:
        """Take a line as header or as a row of units, if it is one; before a header, a row of numbers implies one."""
        text = body.decode("ascii", "replace")
        if "\ufffd" in text:
            return False
        if self.columns is not None and text[:1] == "[":
            return self._take_units(text, self.columns)
        if re.match(r"[A-Za-z]", text) and not _NOT_FINITE.match(body):
            return self._take_header(text, checked)
        if self.columns is None and self.implies and self.problem is None:
            self._imply_usual_columns(body, checked)
        return False

    def _take_units(self, text: str, columns: Columns) -> bool:
        """Take a row of units such as ``[s],[V],[rpm]``; whether it has one for every column."""
        units = [each.strip().strip("[]") for each in text.split((columns.separator or b" ").decode())]
        if len(units) != len(columns.names):
            return False
        self.columns = self._header(",".join(columns.names), units, columns.checked, columns.separator)
        return True

    def _take_header(self, text: str, checked: bool) -> bool:
        """Take a line of names as the header, unless one is known; whether it is one that fits what is known."""
        columns = self.columns
        try:
            new = read_header(text, *self._channels, checked=checked)
        except DataError as problem:
            if re.search(r"[,;\t]", text):
                self.problem = problem
            return False
        if self._given or (columns is not None and new.names != columns.names):
            return self._given and columns is not None and len(new.names) == len(columns.names)
        self.columns = columns or new
        return True

    def _imply_usual_columns(self, body: bytes, checked: bool) -> None:
        """Take the usual columns for a row of numbers, if there are as many."""
        separator = next((s for s in SEPARATORS if s is None or s in body), None)
        parts = body.split(separator)
        if len(parts) in USUAL and all(_number(part) is not None for part in parts):
            try:
                self.columns = self._header(USUAL[len(parts)], (), checked, separator)
            except DataError as problem:
                self.problem = problem

    def _header(self, text: str, units: Sequence[str], checked: bool, separator: bytes | None) -> Columns:
        return replace(read_header(text, *self._channels, units=units, checked=checked), separator=separator)

    def _refuse(self, line: bytes) -> None:
        self.malformed += 1
        self._broken = True
        self.example = line[:24].decode("ascii", "replace")

    def _made(self, rows: Array, broken: NDArray[np.bool_]) -> Rows:
        columns = self.columns
        assert columns is not None
        values = rows * columns.gains + columns.offsets
        nothing = np.full(len(rows), np.nan)
        return Rows(
            nothing if columns.time is None else values[:, columns.time],
            nothing if columns.number is None else values[:, columns.number],
            values[:, columns.inputs],
            values[:, columns.output],
            broken,
        )


def _number(part: bytes) -> float | None:
    """The number in a part of a line, NaN for a word such as ``ovf``; None where there is no number."""
    try:
        return float(part)
    except ValueError:
        return nan if _NOT_FINITE.fullmatch(part.strip()) else None


def joined(parts: Sequence[Rows]) -> Rows:
    """Rows that follow each other."""
    if len(parts) == 1:
        return parts[0]
    return Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in Rows.__annotations__))
