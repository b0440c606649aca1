"""Logs of a CAN bus – candump, Vector (ASC, BLF), PEAK (TRC) – read by python-can and decoded by cantools.

The signals of the database are columns under their names, or ``message.signal`` where several messages have one of that
name. Every message has its own times, from the first frame on.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.files import read_bytes
from emsid.io.sandbox import Packed, parsed_by, unpacked

LOGS = (".log", ".asc", ".blf", ".trc")
"""The suffixes of logs."""


def parsed(content: bytes) -> bytes:
    """The signals, for the process that parses them.

    Args:
        content: the database, the suffix of the log, and the log, with a byte 0 between them.
    """
    from can import LogReader
    from cantools.database import DecodeError, load_string

    database, suffix, log = content.split(b"\0", 2)
    try:
        text = database.decode()
    except UnicodeDecodeError:
        text = database.decode("cp1252")  # as Vector's editor writes DBC files
    known: Any = load_string(text)
    names = Counter(signal.name for message in known.messages for signal in message.signals)
    messages = {(message.frame_id, message.is_extended_frame): message for message in known.messages}
    samples: dict[str, list[tuple[float, float]]] = {}
    with TemporaryDirectory() as folder:
        path = Path(folder, f"log{suffix.decode()}")
        path.write_bytes(log)
        begun: float | None = None
        with LogReader(path) as frames:
            for frame in frames:
                begun = frame.timestamp if begun is None else begun
                message = messages.get((frame.arbitration_id, frame.is_extended_id))
                if message is None or frame.is_error_frame or frame.is_remote_frame:
                    continue
                try:
                    decoded = message.decode(bytes(frame.data), decode_choices=False, allow_truncated=True)
                except DecodeError:  # a multiplexer that the database does not know
                    continue
                for name, value in decoded.items():
                    name = name if names[name] == 1 else f"{message.name}.{name}"
                    samples.setdefault(name, []).append((frame.timestamp - begun, float(value)))
    packed = Packed()
    for message in known.messages:
        for signal in message.signals:
            name = signal.name if names[signal.name] == 1 else f"{message.name}.{signal.name}"
            if name in samples:
                times, values = zip(*samples[name], strict=True)
                packed.add(name, values, signal.unit or "", times)
    return packed.to_bytes()


def read_can(content: bytes, suffix: str, database: Path) -> Columns:
    """The signals of a database in a log of a CAN bus, each with its times.

    Args:
        content: of the log.
        suffix: one of `LOGS`.
        database: a DBC, KCD, SYM or ARXML file.

    Raises:
        FormatError: where a file cannot be read, a package is missing, or no frame is in the database.
    """
    if suffix not in LOGS:
        raise FormatError(f"a database describes logs of a CAN bus, {', '.join(LOGS)}; this file is {suffix or 'none'}")
    given = b"\0".join([read_bytes(database), suffix.encode(), content])
    what = f"a log of a CAN bus with the database {database.name}"
    columns = unpacked(parsed_by(parsed, given, what, "cantools", "can"))
    if not columns.series:
        raise FormatError(f"no frame of this log is a message of {database}; give the database of this bus")
    return columns


def without_database(content: bytes) -> Columns:
    """Refuse a log of a CAN bus that came without its database.

    Raises:
        FormatError: always.
    """
    raise FormatError(
        "this is a log of CAN frames, whose bytes do not say which signals they hold; give the DBC file of the bus",
        arguments=("dbc",),
    )
