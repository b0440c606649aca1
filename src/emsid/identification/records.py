"""The records of `identify`, given as records or as paths of files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from emsid.arguments import did_you_mean
from emsid.errors import DataError
from emsid.io.reading import common_step, read, read_columns
from emsid.record import Record, concatenate

Path = str | os.PathLike[str]
Records = Record | Path | Iterable[Record | Path]

NAMED = 4
"""Name at most this many records in a title; of more give the number."""

# The arguments of `emsid.read` that describe a file.
READING = tuple(name for name in read.__annotations__ if name not in ("path", "return"))


def given_records(records: Records, reading: Mapping[str, Any]) -> tuple[Record, ...]:
    """All given records, in SI; paths are read.

    Args:
        records: one record or path, or several.
        reading: arguments of `emsid.read`.

    Raises:
        DataError: for something else, a file without names of its columns, or an unknown argument of reading.
        FormatError: for a file that cannot be read.
    """
    strange = next((name for name in reading if name not in READING), None)
    if strange is not None:
        near = did_you_mean(strange, (*READING, "models", "options", "unseen", "transient", "control"))
        raise DataError(f"identify takes no {strange!r}; files are read with {', '.join(READING)}{near}")
    if isinstance(records, Record | str | os.PathLike):
        records = (records,)
    elif not isinstance(records, Iterable) or hasattr(records, "dtype"):
        raise DataError(f"a {type(records).__name__} is no record; give emsid.Record(input, output, dt=…), or a path")
    sources = tuple(records)
    reading = _with_columns(sources, reading)
    found = tuple(_record(each, reading) for each in sources)
    step = common_step(found, reading)
    return found if step is None else tuple(_record(each, {**reading, "dt": step}) for each in sources)


def _with_columns(sources: Sequence[Record | Path], reading: Mapping[str, Any]) -> Mapping[str, Any]:
    """How to read paths, with the columns that a first look is almost certain of where none are named.

    Raises:
        DataError: with the best hypotheses, where the columns are open.
        FormatError: where a file cannot be read.
    """
    paths = [each for each in sources if isinstance(each, str | os.PathLike)]
    if not paths or reading.get("input") or reading.get("output"):
        return reading
    from emsid.first_look.hypotheses import hypotheses  # its reading of files is not needed for records

    found, sure = hypotheses(paths, reading)
    if sure and len(found[0].looks) == len(paths):
        return found[0].reading
    if not found:
        return reading  # the message about missing names follows
    pairs = [f"input={each.reading['input']!r}, output={each.reading['output']!r}" for each in found]
    raise DataError(
        f"{paths[0]}: the columns are not certain; give {' or '.join(pairs)}; emsid.describe shows the evidence"
    )


def _record(given: Record | Path, reading: Mapping[str, Any]) -> Record:
    if isinstance(given, Record):
        return given.in_si()
    if not isinstance(given, str | os.PathLike):
        raise DataError(f"a {type(given).__name__} is no record; give emsid.Record(input, output, dt=…), or a path")
    missing = [name for name in ("input", "output") if name not in reading]
    if missing:
        columns = ", ".join(read_columns(given).series)
        raise DataError(f"{given}: name its columns with {' and '.join(missing)}; there are {columns}")
    return read(given, **reading)


def as_one(records: Sequence[Record]) -> Record:
    """The records joined to one, with all of their names; a single record unchanged."""
    if len(records) == 1:
        return records[0]
    names = dict.fromkeys(record.name for record in records)
    return concatenate(records, ", ".join(names) if len(names) <= NAMED else f"{len(names)} records")
