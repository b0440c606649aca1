"""WPILOG files of robots, read by the WPILib utilities. Every entry has its own times."""

from __future__ import annotations

from typing import Any

from emsid.io.sandbox import Packed, read_by

HEADER = 12
"""Bytes before an additional header: the name of the format, its version, and the length of that header."""
_NUMBERS = {"double": "getDouble", "float": "getFloat", "int64": "getInteger", "boolean": "getBoolean"}


def parsed(content: bytes) -> bytes:
    """The entries, for the process that parses them."""
    from wpiutil.log import DataLogReader

    end, begun = _whole_records(content)
    reader = DataLogReader(content[:end], "log")
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
    if end < len(content):
        name = entries[begun][0] if begun in entries else ""
        packed.cut[name] = (len(values.get(name, ())) or max(map(len, values.values()), default=0), 0)
    for name, samples in values.items():
        packed.add(name, [value for _, value in samples], time=[time for time, _ in samples])
    return packed.to_bytes()


def _whole_records(content: bytes) -> tuple[int, int]:
    """Where the last whole record ends, and the entry of one that is cut off behind it; −1 where none is.

    The reader of wpiutil gives the last whole record twice in place of one that is cut off. A record begins with the
    lengths of three numbers: entry, size of the payload and time (WPILib, *WPILOG File Format*, version 1.0).
    """
    at = HEADER + int.from_bytes(content[8:HEADER], "little")
    while at < len(content):
        lengths = content[at]
        entry, size, time = 1 + (lengths & 3), 1 + (lengths >> 2 & 3), 1 + (lengths >> 4 & 7)
        payload = at + 1 + entry + size + time
        end = payload + int.from_bytes(content[at + 1 + entry : at + 1 + entry + size], "little")
        if payload > len(content) or end > len(content):
            return at, int.from_bytes(content[at + 1 : at + 1 + entry], "little")
        at = end
    return len(content), -1


read_wpilog = read_by(parsed, "a WPILOG file", "wpiutil", "wpilog")
"""The entries of a WPILOG file that hold numbers or booleans, each with its times."""
