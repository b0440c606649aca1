"""Logs of flight controllers that describe themselves: ULog (PX4) and DataFlash (ArduPilot).

Every topic has its own times. Its numbers are columns ``topic.field``, and ``topic.field_1`` … where the field is a
list. Where a topic has several instances, as one for each motor, their number stands between: ``ESC.0.RPM``.

A ULog file (PX4, *ULog File Format*) has messages with their size and a letter: ``F`` gives the fields of a format,
``A`` a number to each instance of a topic, and ``D`` are values. A message of a DataFlash log (ArduPilot,
*libraries/AP_Logger*) begins with two bytes and its kind; messages ``FMT`` give the length, the types and the names of
the fields of each kind, and ``FMTU``, ``UNIT`` and ``MULT`` their units and multipliers.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import FormatError
from emsid.io.columns import DEEPEST, Columns
from emsid.io.files import looks_like
from emsid.io.sandbox import Packed

ULOG, SYNC = b"ULog\x01\x12\x35", bytes.fromhex("2f731320250cbb12")
"""The first bytes of a ULog file, and those of its messages that mark a place after which reading can begin again."""
KINDS = b"BFIMPQALCDRSO"
"""The letters of messages of ULog."""
ULOG_TYPES = {
    **{f"{sign}int{8 * size}_t": f"{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4, 8)},
    "float": "f4",
    "double": "f8",
    "bool": "?",
    "char": "S1",
}
"""The types of values by their names."""
MOST_BYTES = 1 << 16
"""Of a message of ULog, which is longer than this in no case."""
HEAD, FMT, DEFINITION = b"\xa3\x95", 128, (89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
"""The bytes with which a message of DataFlash begins, the kind of those that define the others, and their definition:
the length in bytes with three in front, name, types of the fields by letters, and their names."""
TYPES = {letter: letter for letter in "bBhHfdqQ"} | {"i": "i4", "I": "u4", "M": "u1", "g": "f2", "L": "i4", "c": "i2"}
TYPES |= {"C": "u2", "e": "i4", "E": "u4", "n": "S4", "N": "S16", "Z": "S64", "a": "(32,)i2"}
FACTORS = {"L": 1e-7, **dict.fromkeys("cCeE", 0.01)}
"""The types of fields by their letters, as NumPy names them, and what numbers of some are multiplied with."""
TIMES = {"TimeUS": 1e-6, "TimeMS": 1e-3}
"""The fields that are times, and their units in s."""


def read_ulog(content: bytes) -> Columns:
    """The topics of a ULog file.

    Raises:
        FormatError: for another file.
    """
    if content[:7] != ULOG:
        raise FormatError(f"this is not a ULog file; it looks like {looks_like(content)}")
    formats, topics, places, cut = _topics(content)
    packed = Packed()
    instances = Counter(name for _, name in topics.values())
    for number, (instance, name) in sorted(topics.items(), key=lambda each: (each[1][1], each[1][0])):
        fields = list(islice(_fields(formats, name), MOST_BYTES))
        while fields and fields[-1][0].rpartition(".")[2].startswith("_padding"):  # that at the end is not in the file
            fields.pop()
        rows = _rows(content, places.get(number, []), fields)
        if rows is None or "timestamp" not in dict(fields):
            continue
        topic = name if instances[name] == 1 else f"{name}.{instance}"
        for field, letter in fields:
            if letter != "S1" and field != "timestamp" and not field.rpartition(".")[2].startswith("_padding"):
                packed.add(f"{topic}.{field}", rows[field], time=1e-6 * rows["timestamp"])
    if cut:
        packed.cut[""] = (max(map(len, places.values()), default=0), 0)
    return packed.columns()


def _topics(
    content: bytes,
) -> tuple[dict[str, list[tuple[str, int, str]]], dict[int, tuple[int, str]], dict[int, list[tuple[int, int]]], bool]:
    """What is in a ULog file, and whether its last message is cut off.

    Returns:
        The fields of each format, with type and number of values (0 for one that is no list); by number of the
        subscription, instance and name of the topic; and where the messages of each begin and end.
    """
    formats: dict[str, list[tuple[str, int, str]]] = {}
    topics: dict[int, tuple[int, str]] = {}
    places: dict[int, list[tuple[int, int]]] = {}
    at, ends, cut, message = 16, [len(content)], False, struct.Struct("<HBH")
    while at + message.size <= ends[-1]:
        size, kind, number = message.unpack_from(content, at)
        body, stop = at + 3, at + 3 + size
        if stop > ends[-1] and kind in KINDS:
            cut, stop = len(ends) == 1, ends[-1]
        elif kind == ord("D"):
            places.setdefault(number, []).append((at + message.size, stop))
        elif kind not in KINDS or not size:  # damaged: go on behind the next message that marks a place
            found = content.find(SYNC, at, ends[-1])
            stop = ends[-1] if found < 0 else found + len(SYNC)
        elif kind == ord("B") and size >= 40 and content[body + 8] & 1:  # parts that were appended after a crash
            offsets = struct.unpack_from("<3Q", content, body + 16)
            ends += sorted((each for each in offsets if stop < each < ends[0]), reverse=True)
        elif kind == ord("F"):
            name, _, fields = content[body:stop].decode("latin-1").partition(":")
            parts = re.findall(r"(\w+)(?:\[(\d+)\])? (\w+)(?:;|$)", fields)
            formats[name] = [(type, int(count or 0), field) for type, count, field in parts]
        elif kind == ord("A"):
            instance, number = struct.unpack_from("<BH", content, body)
            topics[number] = (instance, content[body + 3 : stop].decode("latin-1"))
        at = stop
        if at + message.size > ends[-1] and len(ends) > 1:
            at = ends.pop()
    return formats, topics, places, cut


def _fields(
    formats: Mapping[str, Sequence[tuple[str, int, str]]], name: str, depth: int = 0
) -> Iterator[tuple[str, str]]:
    """The names of the values of a ULog format in their order, those of nested ones with a dot, and their types.

    The type is empty where the file does not say it.
    """
    for kind, count, field in formats.get(name, ()):
        for each in (f"{field}_{k}" for k in range(1, count + 1)) if count else [field]:
            if kind in ULOG_TYPES:
                yield each, ULOG_TYPES[kind]
            elif kind in formats and depth < DEEPEST:
                yield from ((f"{each}.{inner}", letter) for inner, letter in _fields(formats, kind, depth + 1))
            else:
                yield each, ""


def _rows(content: bytes, places: Sequence[tuple[int, int]], fields: Sequence[tuple[str, str]]) -> Any:
    """The messages at some places as a table (N,) with these fields; None where there are none or they do not fit."""
    if not places or not fields or len(dict(fields)) < len(fields) or not all(map(all, fields)):
        return None
    layout = np.dtype(list(fields)).newbyteorder("<")
    begins = [begin for begin, end in places if end - begin >= layout.itemsize]
    if not begins:
        return None
    data = np.frombuffer(content, np.uint8)
    return data[np.add.outer(begins, np.arange(layout.itemsize))].view(layout)[:, 0]


def read_dataflash(content: bytes) -> Columns:
    """The messages of a DataFlash log that have times and no texts, in the units that it names.

    Raises:
        FormatError: for another file.
    """
    tables, rest = _messages(content)
    named = {definition[1]: (table, definition) for definition, table in tables.items()}
    if not named:
        raise FormatError(f"this is not a DataFlash log, or it is damaged; it looks like {looks_like(content)}")

    def rows(name: str, types: str) -> list[Any]:
        table, definition = named.get(name, (None, None))
        return table.tolist() if table is not None and definition is not None and definition[2] == types else []

    labels = {letter: label.decode("latin-1") for _, letter, label in rows("UNIT", "QbZ")}
    factors = {letter: factor for _, letter, factor in rows("MULT", "Qbd")}
    kinds = {kind: name.decode("latin-1") for kind, _, name, _, _ in rows("FMT", "BBnNZ")}
    letters = {kinds.get(kind): letters for _, kind, *letters in rows("FMTU", "QBNN")}
    packed = Packed()
    if rest:
        packed.cut[""] = (max(map(len, tables.values())), 0)
    for name, (table, (_, _, types, fields)) in named.items():
        time = next((each for each in TIMES if each in fields.split(",")), None)
        if time is None or set(types) & set("nNZ"):
            continue
        units, multipliers = letters.get(name, (b"", b""))
        by_instance = {"": table}
        if 0 <= (at := units.find(b"#")) < len(types):
            numbers = table[fields.split(",")[at]]
            by_instance = {f".{number}": table[numbers == number] for number in np.unique(numbers)}
        for instance, part in by_instance.items():
            seconds = TIMES[time] * part[time]
            for k, (field, letter) in enumerate(zip(fields.split(","), types, strict=True)):
                if field != time and k != at:
                    factor = factors.get(multipliers[k] if k < len(multipliers) else 0, 1.0)
                    values = part[field] * (factor if factor not in (0.0, 1.0) else FACTORS.get(letter, 1.0))
                    unit = labels.get(units[k], "") if k < len(units) else ""
                    packed.add(f"{name}{instance}.{field}", values, unit, seconds)
    return packed.columns()


def _messages(content: bytes) -> tuple[dict[tuple[int, str, str, str], NDArray[np.void]], bool]:
    """The messages of a DataFlash log as tables by the definition of their kind, and whether the last one is cut off.

    Bytes that are no message of a kind that is defined are left out.
    """
    definitions, places = {FMT: DEFINITION}, dict[int, list[tuple[int, int]]]()
    at, end = content.find(HEAD), len(content)
    while 0 <= at < end - 3:
        kind = content[at + 2]
        length = definitions[kind][0] if kind in definitions else 0
        if length and at + length <= end:
            places.setdefault(kind, []).append((at + 3, at + length))
            if kind == FMT:
                new, size, *texts = struct.unpack_from("<BB4s16s64s", content, at + 3)
                name, types, fields = (text.partition(b"\0")[0].decode("latin-1") for text in texts)
                definitions[new] = (size, name, types, fields)
            at = content.find(HEAD, at + length)
        elif length:
            break
        else:
            at = content.find(HEAD, at + 1)
    tables = {}
    for kind, found in places.items():
        _, _, types, fields = definitions[kind]
        if len(fields.split(",")) == len(types) and set(types) <= set(TYPES):
            layout = [(name, TYPES[letter]) for name, letter in zip(fields.split(","), types, strict=True)]
            rows = _rows(content, found, layout)
            if rows is not None:
                tables[definitions[kind]] = rows
    return tables, 0 <= at < end
