"""Arrow and Feather files, parsed in a process of their own (see `emsid.io.sandbox`)."""

from __future__ import annotations

from io import BytesIO

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.files import looks_like
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


def parsed(content: bytes) -> bytes:
    """The table without compression, for the process that parses it."""
    import polars as pl

    result = BytesIO()
    pl.read_ipc(BytesIO(content)).write_ipc(result)
    return result.getvalue()
