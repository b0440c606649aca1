"""A library of identified actuators: a folder with a model file of each, and what makes it reproducible beside it.

Of the actuator NAME there are ``NAME.json``, a model file, and ``NAME.motor.json``::

    {"format": "emsid motor", "schema": 1, "model_sha256": "…", "records": [{"file": "lift.csv", "sha256": "…"}],
     "command": "emsid identify lift.csv …"}

============  =========================================================================================================
format        ``emsid motor``
schema        version of this layout, a whole number
model_sha256  checksum of the model file, byte by byte
records       names and checksums of the files that it was identified from, byte by byte; files of one name in several
              folders have the shortest ends of their paths that differ, ``M1/log.csv`` and ``M2/log.csv``
command       the command line that made it, to be run beside these records
============  =========================================================================================================
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from pathlib import Path

import msgspec

from emsid.errors import DataError, FormatError, listed
from emsid.io.files import atomic_write, indented_json, read_bytes, together
from emsid.io.model_file import load

FORMAT, SCHEMA = "emsid motor", 1
ENDING = ".motor.json"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]*")


class Recorded(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file that an actuator was identified from.

    Attributes:
        file: its name.
        sha256: its checksum.
    """

    file: str
    sha256: str


class Actuator(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What makes an actuator of a library reproducible; see the layout above."""

    format: str
    schema: int
    model_sha256: str
    records: tuple[Recorded, ...]
    command: str


def add_actuator(
    folder: str | os.PathLike[str],
    name: str,
    model: str | os.PathLike[str],
    records: Sequence[str | os.PathLike[str]],
    command: str,
    *,
    force: bool = False,
) -> None:
    """Add an actuator to a library.

    Args:
        folder: of the library; it is made if it is not there.
        name: of the actuator: letters, digits, dots, plus and minus.
        model: its model file.
        records: the files that it was identified from.
        command: the command line that made it.
        force: whether an actuator, or another file, of this name is replaced.

    Raises:
        DataError: for an impossible name, one that the library has, one of another file there, without a record, or for
            a record that is given twice.
        FormatError: for a file that cannot be read or is no model file.
    """
    if not _NAME.fullmatch(name) or name.endswith((".motor", ".json")):
        raise DataError(f"{name!r} is no name of an actuator; use letters, digits, dots, plus and minus")
    if not records:
        raise DataError(f"{name}: name the records that it was identified from, so that it can be identified again")
    home = Path(folder)
    if not force and (home / f"{name}{ENDING}").exists():
        raise DataError(
            f"{home} has an actuator {name} already; give this one another name, or replace it", arguments=("force",)
        )
    if not force and (home / f"{name}.json").exists():
        raise DataError(
            f"{home / name}.json exists and is not of this library; give another name, or replace it",
            arguments=("force",),
        )
    load(model)
    content = read_bytes(model)
    known = tuple(
        Recorded(file, _sha256(read_bytes(record))) for file, record in zip(_named(records), records, strict=True)
    )
    entry = Actuator(FORMAT, SCHEMA, _sha256(content), known, command)
    with together():
        atomic_write(home / f"{name}.json", content)
        atomic_write(home / f"{name}{ENDING}", indented_json(entry))


def _named(records: Sequence[str | os.PathLike[str]]) -> list[str]:
    """The names of files; of one name in several folders, the shortest ends of their paths that differ.

    Raises:
        DataError: for a file that is given twice.
    """
    paths = [Path(os.path.abspath(record)) for record in records]
    found = []
    for path, given in zip(paths, records, strict=True):
        alike = [other for other in paths if other.name == path.name]
        count = next(
            (k for k in range(1, len(path.parts)) if sum(_end(each, k) == _end(path, k) for each in alike) == 1), 0
        )
        if not count:
            raise DataError(f"{given} is given twice as a record; leave one of them out")
        found.append(_end(path, count))
    return found


def _end(path: Path, count: int) -> str:
    return "/".join(path.parts[-count:])


def actuators(folder: str | os.PathLike[str]) -> dict[str, Actuator]:
    """The actuators of a library by name, in alphabetical order.

    Raises:
        FormatError: for a folder that is not there, an entry that is none, or a model file that was altered.
    """
    home = Path(folder)
    if not home.is_dir():
        raise FormatError(f"{home}: there is no such folder; add an actuator to make it")
    return {path.name.removesuffix(ENDING): _read(path) for path in sorted(home.glob(f"*{ENDING}"))}


def model_of(folder: str | os.PathLike[str], name: str) -> Path:
    """The model file of an actuator.

    Raises:
        DataError: for an actuator that the library does not have.
        FormatError: as `actuators` does.
    """
    known = actuators(folder)
    if name not in known:
        raise DataError(f"{folder} has no actuator {name}; it has {listed(list(known)) or 'none'}")
    return Path(folder) / f"{name}.json"


def check_records(
    folder: str | os.PathLike[str], name: str, records: Sequence[str | os.PathLike[str]]
) -> tuple[Recorded, ...]:
    """The records of an actuator, where the given files are the same, byte by byte.

    Raises:
        DataError: for a file that it was not identified from, or that has changed since, and for one that is missing.
        FormatError: as `actuators` does.
    """
    model_of(folder, name)
    known = actuators(folder)[name].records
    given = {_sha256(read_bytes(path)): Path(path) for path in records}
    for checksum, path in given.items():
        if checksum in {record.sha256 for record in known}:
            continue
        if path.name in {Path(record.file).name for record in known}:
            raise DataError(f"{path} is not the file that {name} was identified from: its checksum differs")
        raise DataError(f"{path}: {name} was identified from {listed([record.file for record in known])}")
    missing = [record.file for record in known if record.sha256 not in given]
    if missing:
        raise DataError(f"{name} was identified from {listed(missing)} too; give it as a record")
    return known


def _read(path: Path) -> Actuator:
    try:
        entry = msgspec.json.decode(read_bytes(path), type=Actuator)
    except (msgspec.MsgspecError, RecursionError, ValueError):
        raise FormatError(f"{path}: this is no actuator of a library; add it again") from None
    if entry.format != FORMAT or entry.schema != SCHEMA:
        raise FormatError(f"{path}: this is {entry.format!r} of schema {entry.schema}, not {FORMAT!r} of {SCHEMA}")
    model = path.with_name(path.name.removesuffix(ENDING) + ".json")
    if _sha256(read_bytes(model)) != entry.model_sha256:
        raise FormatError(f"{model}: the model has been altered since it was added; restore the file, or add it again")
    return entry


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
