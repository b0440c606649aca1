"""Arrow and Feather files, parsed in a process of their own (see `emsid.io.sandbox`)."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.files import looks_like
from emsid.io.large import LargeScan, scanned
from emsid.io.parquet import columns_of
from emsid.io.sandbox import in_sandbox

_MAGIC = b"ARROW1"


def read_arrow(content: bytes) -> Columns:
    """The columns of an Arrow or Feather file (version 2) that hold numbers, text or times.

    Raises:
        FormatError: for content that is no Arrow file, or a damaged one.
    """
    import polars as pl

    if not content.startswith(_MAGIC):
        raise FormatError(f"this is not an Arrow file; it looks like {looks_like(content)}: give it its right suffix")
    damaged = "this Arrow file is damaged or cut off; copy or write it again"
    return columns_of(pl.read_ipc(BytesIO(in_sandbox(parsed, content, damaged))), {})


def large_arrow(path: Path) -> LargeScan | None:
    """The table in an Arrow file, after a pass over it; None where it fits into memory, or is damaged."""
    import polars as pl

    try:
        return scanned(path, pl.scan_ipc, columns_of, {})
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError):
        return None


def parsed(content: bytes) -> bytes:
    """The table without compression, for the process that parses it."""
    import polars as pl

    result = BytesIO()
    pl.read_ipc(BytesIO(content)).write_ipc(result)
    return result.getvalue()
