"""Parsing of binary files in a separate process, which gives their columns as bytes.

A damaged file can make the libraries for these formats allocate very much memory or crash. In a separate process this
ends only the parser, and its memory is limited where the system can do so.

**Columns as bytes.** The first line is a JSON table of names, units, clocks and of what is no column; the rest is Arrow
IPC, one file for the columns of each length, with their sizes in the first line.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from emsid.errors import FormatError
from emsid.io.columns import Columns, from_arrays
from emsid.io.files import looks_like

LONGEST = 120.0
"""Seconds after which a parser is stopped."""
MEMORY, EXPANSION = 1 << 33, 64
"""Bytes of memory that a parser may have, and how many for each byte of the file, if that is more."""


def in_sandbox(parser: Callable[[bytes], bytes], content: bytes, damaged: str) -> bytes:
    """Run a parser on the content of a file in a separate process.

    Args:
        parser: a function of a module; the process imports it.
        content: of the file.
        damaged: the message where the parser fails, crashes or does not end.

    Raises:
        FormatError: with that message.
    """
    most = max(MEMORY, EXPANSION * len(content))
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({most}, {most})); " if os.name == "posix" else ""
    program = (
        f"{limit}import os, sys; result = os.fdopen(os.dup(1), 'wb'); os.dup2(2, 1); "  # libraries print what they miss
        f"from {parser.__module__} import {parser.__name__} as parser; "
        "result.write(parser(sys.stdin.buffer.read())); result.flush()"
    )
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", program], input=content, capture_output=True, check=True, timeout=LONGEST
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
        raise FormatError(damaged) from None
    return done.stdout


# --- columns as bytes -------------------------------------------------------------------------------------------------


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

    def columns(self) -> Columns:
        """All columns; what is no column becomes a reason."""
        columns = from_arrays((name, np.asarray(values)) for name, values in self.arrays.items())
        known = columns.series
        clocks = {name: clock for name, clock in self.clocks.items() if name in known and clock in known}
        return replace(columns, units=self.units, clocks=clocks, cut=self.cut)

    def to_bytes(self) -> bytes:
        """The same for another process."""
        import polars as pl

        columns = self.columns()
        lengths = {name: len(series) for name, series in columns.series.items()}
        files = []
        for length in dict.fromkeys(lengths.values()):
            files.append(BytesIO())
            pl.DataFrame([each for each in columns.series.values() if len(each) == length]).write_ipc(files[-1])
        contents = [file.getvalue() for file in files]
        head = {
            "units": columns.units,
            "clocks": columns.clocks,
            "names": list(lengths),
            "sizes": list(map(len, contents)),
            "cut": columns.cut,
            "others": dict(columns.others),
            "numbers": dict(columns.numbers),
        }
        return b"".join([json.dumps(head).encode(), b"\n", *contents])


def unpacked(content: bytes) -> Columns:
    """The columns in what `Packed.to_bytes` made."""
    import polars as pl

    line, _, body = content.partition(b"\n")
    head: Mapping[str, Any] = json.loads(line)
    ends = accumulate(head["sizes"], initial=0)
    frames = [pl.read_ipc(BytesIO(body[begin:end])) for begin, end in pairwise(ends)]
    found = {series.name: series for frame in frames for series in frame}
    return Columns(
        series={name: found[name] for name in head["names"]},
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
