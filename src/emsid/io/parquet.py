"""Parquet, Arrow and Feather files, parsed in a process of their own (see `emsid.io.sandbox`)."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from emsid.errors import FormatError
from emsid.io.columns import UNITS, Columns, flat, units_as_json, units_from_json
from emsid.io.files import looks_like
from emsid.io.large import LargeScan, scanned
from emsid.io.sandbox import in_sandbox

if TYPE_CHECKING:
    import polars as pl


_MAGIC = b"PAR1"
_DAMAGED = "this Parquet file is damaged or cut off; copy or write it again"


def read_parquet(content: bytes) -> Columns:
    """The columns of a Parquet file that hold numbers, text or times, or lists of them; binary ones are no columns.

    Raises:
        FormatError: for content that is no Parquet file, or a damaged one.
    """
    import polars as pl

    if not content.startswith(_MAGIC):
        raise FormatError(f"this is not a Parquet file; it looks like {looks_like(content)}: give it its right suffix")
    if not content.endswith(_MAGIC):
        raise FormatError(_DAMAGED)
    units, _, frame_as_ipc = in_sandbox(parsed, content, _DAMAGED).partition(b"\n")
    return columns_of(pl.read_ipc(BytesIO(frame_as_ipc)), units_from_json(units.decode()))


def large_parquet(path: Path) -> LargeScan | None:
    """The table in a Parquet file, after a pass over it; None where it fits into memory, or is damaged."""
    import polars as pl

    try:
        units = units_from_json(pl.read_parquet_metadata(path).get(UNITS, ""))
        return scanned(path, pl.scan_parquet, columns_of, units)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError):
        return None


def columns_of(frame: pl.DataFrame, units: Mapping[str, str]) -> Columns:
    """The columns of a frame that hold numbers, text or times, or lists of them; see `emsid.io.columns`."""
    import polars as pl

    series, others = flat(frame)
    others |= {name: "binary values" for name, column in series.items() if column.dtype in (pl.Binary, pl.Object)}
    return Columns(
        series={
            name: column.cast(pl.String) if column.dtype in (pl.Categorical, pl.Enum) else column
            for name, column in series.items()
            if name not in others
        },
        others=others,
        units=units,
    )


def parsed(content: bytes) -> bytes:
    """A Parquet file as a line with its units and Arrow IPC, for the process that parses it."""
    import polars as pl

    units = units_from_json(pl.read_parquet_metadata(BytesIO(content)).get(UNITS, ""))
    result = BytesIO()
    pl.read_parquet(BytesIO(content)).write_ipc(result)
    return units_as_json(units).encode(errors="replace") + b"\n" + result.getvalue()


# --- Arrow and Feather ----------------------------------------------------------------------------------------------

_ARROW = b"ARROW1"


def read_arrow(content: bytes) -> Columns:
    """The columns of an Arrow or Feather file (version 2) that hold numbers, text or times.

    Raises:
        FormatError: for content that is no Arrow file, or a damaged one.
    """
    import polars as pl

    if not content.startswith(_ARROW):
        raise FormatError(f"this is not an Arrow file; it looks like {looks_like(content)}: give it its right suffix")
    damaged = "this Arrow file is damaged or cut off; copy or write it again"
    return columns_of(pl.read_ipc(BytesIO(in_sandbox(parsed_arrow, content, damaged))), {})


def large_arrow(path: Path) -> LargeScan | None:
    """The table in an Arrow file, after a pass over it; None where it fits into memory, or is damaged."""
    import polars as pl

    try:
        return scanned(path, pl.scan_ipc, columns_of, {})
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError):
        return None


def parsed_arrow(content: bytes) -> bytes:
    """The table without compression, for the process that parses it."""
    import polars as pl

    result = BytesIO()
    pl.read_ipc(BytesIO(content)).write_ipc(result)
    return result.getvalue()
