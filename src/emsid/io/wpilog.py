"""WPILOG files of robots, read by the WPILib utilities. Every entry has its own times."""

from __future__ import annotations

from typing import Any

from emsid.io.columns import Columns
from emsid.io.packing import Packed, read_by

_NUMBERS = {"double": "getDouble", "float": "getFloat", "int64": "getInteger", "boolean": "getBoolean"}


def read_wpilog(content: bytes) -> Columns:
    """The entries of a WPILOG file that hold numbers or booleans, each with its times.

    Raises:
        FormatError: for content that is no WPILOG file, or where wpiutil is not installed.
    """
    return read_by(parsed, content, "a WPILOG file", "wpiutil", "wpilog")


def parsed(content: bytes) -> bytes:
    """The entries, for the process that parses them."""
    from wpiutil.log import DataLogReader

    reader = DataLogReader(content, "log")
    if not reader.isValid():
        raise ValueError("no WPILOG file")
    entries: dict[int, tuple[str, str]] = {}
    values: dict[str, list[tuple[float, Any]]] = {}
    for record in reader:
        if record.isStart():
            start = record.getStartData()
            entries[start.entry] = (start.name, start.type)
        elif not record.isControl() and record.getEntry() in entries:
            name, kind = entries[record.getEntry()]
            if kind in _NUMBERS:
                value = getattr(record, _NUMBERS[kind])()
                values.setdefault(name, []).append((1e-6 * record.getTimestamp(), value))
    packed = Packed()
    for name, samples in values.items():
        packed.add(name, [value for _, value in samples], time=[time for time, _ in samples])
    return packed.to_bytes()
