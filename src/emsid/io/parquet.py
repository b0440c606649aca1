"""Parquet files.

They are parsed in a process of their own: the parser allocates what a file says it needs, and a damaged file can say
anything, which would end this process with no more than a stack trace.
"""

from __future__ import annotations

import subprocess
import sys
from io import BytesIO

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.files import looks_like

_MAGIC = b"PAR1"
_PARSER = """
import io, sys
import polars as pl
frame = pl.read_parquet(io.BytesIO(sys.stdin.buffer.read()))
frame.write_ipc(sys.stdout.buffer)
"""


def read_parquet(content: bytes) -> Columns:
    """The columns of a Parquet file that hold numbers, text or times; nested ones are no columns.

    Raises:
        FormatError: for content that is no Parquet file, or a damaged one.
    """
    import polars as pl

    if not content.startswith(_MAGIC):
        raise FormatError(f"this is not a Parquet file; it looks like {looks_like(content)}: give it its right suffix")
    damaged = FormatError("this Parquet file is damaged or cut off; copy or write it again")
    if not content.endswith(_MAGIC):
        raise damaged
    parsed = subprocess.run([sys.executable, "-P", "-c", _PARSER], input=content, capture_output=True, check=False)
    if parsed.returncode:
        raise damaged
    frame = pl.read_ipc(BytesIO(parsed.stdout))
    nested = {name for name, kind in frame.schema.items() if kind.is_nested()}
    return Columns(
        series={column.name: column for column in frame if column.name not in nested},
        others=dict.fromkeys(nested, "nested values"),
    )
