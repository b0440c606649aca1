"""Columns as bytes, for readers that parse a file in a process of their own (see `emsid.io.sandbox`).

The first line is a JSON table of units, clocks, lengths and of what is no column; the rest is Arrow IPC. Shorter
columns are padded with missing values.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from io import BytesIO
from typing import Any

import numpy as np

from emsid.errors import FormatError
from emsid.io.columns import Columns, from_arrays
from emsid.io.files import looks_like
from emsid.io.sandbox import in_sandbox


class Packed:
    """What a parser collects: arrays by name, with units and clocks.

    Attributes:
        arrays: columns by name.
        units: by column.
        clocks: the time column of each column.
        cut: see `Columns`.
    """

    def __init__(self) -> None:
        self.arrays: dict[str, Any] = {}
        self.units: dict[str, str] = {}
        self.clocks: dict[str, str] = {}
        self.cut: dict[str, tuple[int, int]] = {}

    def add(self, name: str, values: Any, unit: str = "", time: Any = None, clock: str = "time") -> None:
        """Add a column, and its times in seconds under the name of its clock.

        A clock that has this name and other times gets the name of the column in front.
        """
        self.arrays[name] = values
        if unit:
            self.units[name] = unit
        if time is None:
            return
        time = np.asarray(time, dtype=float)
        known = next((each for each in self._clocks() if np.array_equal(self.arrays[each], time)), None)
        if known is None:
            known = clock if clock not in self.arrays else f"{name}.time"
            self.arrays[known] = time
            self.units[known] = "s"
        self.clocks[name] = self.clocks[known] = known

    def _clocks(self) -> list[str]:
        return list(dict.fromkeys(self.clocks.values()))

    def to_bytes(self) -> bytes:
        """All columns; what is no column becomes a reason."""
        import polars as pl

        columns = from_arrays((name, np.asarray(values)) for name, values in self.arrays.items())
        lengths = {name: len(series) for name, series in columns.series.items()}
        longest = max(lengths.values(), default=0)
        padded = {name: series.extend_constant(None, longest - len(series)) for name, series in columns.series.items()}
        head = {
            "units": self.units,
            "clocks": {name: clock for name, clock in self.clocks.items() if name in lengths and clock in lengths},
            "lengths": lengths,
            "cut": self.cut,
            "others": dict(columns.others),
            "numbers": dict(columns.numbers),
        }
        body = BytesIO()
        pl.DataFrame(padded).write_ipc(body)
        return json.dumps(head).encode() + b"\n" + body.getvalue()


def unpacked(content: bytes) -> Columns:
    """The columns in what `Packed.to_bytes` made."""
    import polars as pl

    line, _, body = content.partition(b"\n")
    head: Mapping[str, Any] = json.loads(line)
    frame = pl.read_ipc(BytesIO(body))
    return Columns(
        series={name: frame[name][:length] for name, length in head["lengths"].items()},
        others=head["others"],
        numbers=head["numbers"],
        units=head["units"],
        clocks=head["clocks"],
        cut={name: (read, whole) for name, (read, whole) in head["cut"].items()},
    )


def read_by(parser: Callable[[bytes], bytes], what: str, package: str, extra: str) -> Callable[[bytes], Columns]:
    """A reader, from the content of a file to its columns, by a parser that needs an optional package.

    It raises `FormatError` where the package is not installed, or the file cannot be parsed.

    Args:
        parser: a function of a module, which makes bytes by `Packed.to_bytes`.
        what: the kind of file, for messages: ``a TDMS file``.
        package: the module that the parser imports.
        extra: of this package, with which that is installed.
    """
    return lambda content: unpacked(parsed_by(parser, content, what, package, extra))


def parsed_by(parser: Callable[[bytes], bytes], content: bytes, what: str, package: str, extra: str) -> bytes:
    """What the parser makes of a file; arguments and errors as for `read_by`."""
    if find_spec(package) is None:
        raise FormatError(f"to read {what}, install {package}: pip install 'emsid[{extra}]'")
    damaged = f"this is not {what}, or it is damaged or cut off; it looks like {looks_like(content)}"
    return in_sandbox(parser, content, damaged)
