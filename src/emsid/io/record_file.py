"""Writing of records to files, from which `emsid.io.read` reads the same numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import ZipFile

import numpy as np

from emsid.errors import DataError, FormatError
from emsid.io.columns import UNITS, units_as_json
from emsid.io.files import atomic_write
from emsid.io.table import read_table
from emsid.record import Record
from emsid.units import name_and_unit, unit_in_name

if TYPE_CHECKING:
    import polars as pl


def write_record(record: Record, path: str | os.PathLike[str]) -> str:
    """Write a record of one segment as a table of time, inputs and outputs.

    Numbers and SI units are read back exactly. The names in the one header line of a CSV file end with their units,
    ``voltage [V]``; Parquet has them in its metadata, NPZ in an additional array. A name with another unit in brackets
    loses that.

    Args:
        record: the record.
        path: the file; its suffix ``.csv``, ``.parquet`` or ``.npz`` selects the format.

    Returns:
        The name of the time column (in seconds): ``t``, or ``time`` … where a channel is called so.

    Raises:
        FormatError: for another suffix, or where the file cannot be written.
        DataError: for a record of several segments, or with names that a CSV file cannot hold.
    """
    import polars as pl

    path = Path(path)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FormatError(f"{path}: no writer for the suffix {path.suffix!r}; there are {', '.join(WRITERS)}")
    if record.breaks:
        raise DataError(
            f"{record.name}: a table holds one segment and this record has {len(record.breaks) + 1}; write each of "
            "record.segments to a file of its own"
        )
    channel_units = (*record.input_units, *record.output_units)
    names = _in_units((*record.input_names, *record.output_names), channel_units)
    time = next(name for name in ("t", "time", "time_s", *(f"time{k}" for k in range(len(names)))) if name not in names)
    values = np.column_stack([record.time, record.input, record.output])
    columns = (time, *names)
    units = dict(zip(columns, ("s", *channel_units), strict=True))
    atomic_write(path, writer(pl.DataFrame(dict(zip(columns, values.T, strict=True))), units))
    return time


def _in_units(names: tuple[str, ...], units: tuple[str, ...]) -> tuple[str, ...]:
    """The names without units in brackets that are not those of the channels; as they are where two would be alike."""
    bare = tuple(
        name_and_unit(name)[0] if unit and name_and_unit(name)[1] != unit else name
        for name, unit in zip(names, units, strict=True)
    )
    return bare if len(set(bare)) == len(bare) else names


def _csv(frame: pl.DataFrame, units: Mapping[str, str]) -> bytes:
    named = {
        name: name if name_and_unit(name)[1] or not unit_in_name(short) else f"{name} [{short}]"
        for name, short in ((name, "-" if unit == "1" else unit) for name, unit in units.items())
    }
    frame = frame.rename(named)
    start = frame.head(2).write_csv().encode()
    if list(read_table(start).series) != frame.columns:
        raise DataError(f"the names {', '.join(frame.columns[1:])} cannot head a CSV file; write Parquet, or rename")
    return frame.write_csv().encode()


def _parquet(frame: pl.DataFrame, units: Mapping[str, str]) -> bytes:
    content = BytesIO()
    frame.write_parquet(content, metadata={UNITS: units_as_json(units)})
    return content.getvalue()


def _npz(frame: pl.DataFrame, units: Mapping[str, str]) -> bytes:
    arrays = {column.name: column.to_numpy() for column in frame}
    content = BytesIO()
    with ZipFile(content, "w") as archive:  # as numpy.savez does, but for channels of any name
        for name, values in {UNITS: np.array(units_as_json(units)), **arrays}.items():
            with archive.open(f"{name}.npy", "w") as member:
                np.save(member, values)
    return content.getvalue()


WRITERS: dict[str, Callable[[pl.DataFrame, Mapping[str, str]], bytes]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".npz": _npz,
}
"""The writer for each suffix: from a table and the units of its columns to the content of a file."""
