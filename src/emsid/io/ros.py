"""MCAP files, read by mcap, and bags of ROS 1 and 2, read by rosbags. Every topic has its own times.

The numbers of a message are columns ``topic.field``, also those of nested messages, and ``topic.field_1`` … where the
field is a list. MCAP messages are JSON, or those of
ROS 2, which rosbags decodes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZipFile

import numpy as np

from emsid.io.columns import MOST_VALUES
from emsid.io.files import read_bytes
from emsid.io.sandbox import Packed, read_by

DESCRIPTION, DATABASES = "metadata.yaml", (".db3", ".mcap")
"""The file that describes a bag of ROS 2, and the suffixes of those with its messages."""
DEEPEST = 6
"""Messages in messages below this depth are left out."""


def is_bag_folder(path: Path) -> bool:
    """Whether a path is a bag of ROS 2, a folder with a description of its files."""
    return (path / DESCRIPTION).is_file()


def archived(path: Path) -> bytes:
    """The files of a bag of ROS 2 as a ZIP archive, since the process that parses has no other files.

    Raises:
        FormatError: for a file that cannot be read.
    """
    content = BytesIO()
    with ZipFile(content, "w") as archive:
        for file in sorted(path.iterdir()):
            if file.name == DESCRIPTION or file.suffix in DATABASES:
                archive.writestr(file.name, read_bytes(file))
    return content.getvalue()


def parsed_mcap(content: bytes) -> bytes:
    """The topics of an MCAP file, for the process that parses them."""
    from mcap.reader import make_reader

    samples: dict[str, list[tuple[float, float]]] = {}
    types: Any = None
    for schema, channel, message in make_reader(BytesIO(content)).iter_messages():
        if channel.message_encoding == "json":
            decoded = json.loads(message.data)
        elif channel.message_encoding == "cdr" and schema is not None:
            types = types or _types()
            if schema.name not in types.fielddefs:
                from rosbags.typesys import get_types_from_msg

                types.register(get_types_from_msg(schema.data.decode(), schema.name))
            decoded = types.deserialize_cdr(message.data, schema.name)
        else:
            continue
        _add(samples, channel.topic, 1e-9 * message.log_time, decoded)
    return _packed(samples)


def parsed_bag(content: bytes) -> bytes:
    """The topics of a bag, for the process that parses them."""
    from rosbags.highlevel import AnyReader

    with TemporaryDirectory() as folder:  # rosbags reads files only
        path = Path(folder, "log.bag")
        path.write_bytes(content)
        with AnyReader([path]) as reader:
            return _messages(reader)


def parsed_bag_folder(content: bytes) -> bytes:
    """The topics of a bag of ROS 2 in a ZIP archive, for the process that parses them."""
    from rosbags.highlevel import AnyReader

    with TemporaryDirectory() as folder:
        with ZipFile(BytesIO(content)) as archive:
            archive.extractall(folder)
        with AnyReader([Path(folder)], default_typestore=_types()) as reader:
            return _messages(reader)


def _messages(reader: Any) -> bytes:
    """The topics of an open bag."""
    samples: dict[str, list[tuple[float, float]]] = {}
    for connection, time, data in reader.messages():
        _add(samples, connection.topic, 1e-9 * time, reader.deserialize(data, connection.msgtype))
    return _packed(samples)


def _types() -> Any:
    """The messages that every ROS 2 has."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def _add(samples: dict[str, list[tuple[float, float]]], topic: str, time: float, message: Any) -> None:
    for name, value in _numbers(message, topic.strip("/").replace("/", ".")):
        samples.setdefault(name, []).append((time, value))


def _numbers(message: Any, name: str, depth: int = 0) -> Iterator[tuple[str, float]]:
    """The numbers in a message by the names of their fields."""
    if isinstance(message, (bool, int, float)):
        yield name, float(message)
    elif isinstance(message, (list, tuple, np.ndarray)):
        if depth < DEEPEST and len(message) <= MOST_VALUES:
            for k, value in enumerate(message.tolist() if isinstance(message, np.ndarray) else message, start=1):
                yield from _numbers(value, f"{name}_{k}", depth + 1)
    elif depth < DEEPEST:
        if isinstance(message, dict):
            fields = message
        else:
            fields = {field: getattr(message, field) for field in getattr(message, "__dataclass_fields__", ())}
        for field, value in fields.items():
            if not field.startswith("__"):
                yield from _numbers(value, f"{name}.{field}", depth + 1)


def _packed(samples: dict[str, list[tuple[float, float]]]) -> bytes:
    packed = Packed()
    first = min((times[0][0] for times in samples.values()), default=0.0)
    for name, pairs in samples.items():
        packed.add(name, [value for _, value in pairs], time=[time - first for time, _ in pairs])
    return packed.to_bytes()


read_mcap = read_by(parsed_mcap, "an MCAP file", "mcap", "ros")
"""The numbers in an MCAP file, with the time at which they were logged."""
read_bag = read_by(parsed_bag, "a bag of ROS 1", "rosbags", "ros")
"""The same of a bag of ROS 1."""
read_bag_folder = read_by(parsed_bag_folder, "a bag of ROS 2", "rosbags", "ros")
"""The same of a bag of ROS 2, as `archived` packs it."""
