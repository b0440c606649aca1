"""Parquet files."""

from __future__ import annotations

from io import BytesIO

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.files import looks_like

_MAGIC = b"PAR1"


def read_parquet(content: bytes) -> Columns:
    """The columns of a Parquet file that hold numbers, text or times; nested ones are no columns.

    Raises:
        FormatError: for content that is no Parquet file, or a damaged one.
    """
    import polars as pl

    if not content.startswith(_MAGIC):
        raise FormatError(f"this is not a Parquet file; it looks like {looks_like(content)}: give it its right suffix")
    try:
        frame = pl.read_parquet(BytesIO(content))
    except (Exception, pl.exceptions.PanicException) as problem:  # a panic of the parser is no Exception
        raise FormatError(
            f"this Parquet file is damaged or cut off ({type(problem).__name__}); copy or write it again"
        ) from None
    nested = {name for name, kind in frame.schema.items() if kind.is_nested()}
    return Columns(
        series={column.name: column for column in frame if column.name not in nested},
        others=dict.fromkeys(nested, "nested values"),
    )
