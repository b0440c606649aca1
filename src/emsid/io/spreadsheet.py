"""Excel and OpenDocument spreadsheets, read by fastexcel: the first sheet, as a text table."""

from __future__ import annotations

import csv
from io import BytesIO, StringIO

from emsid.io.columns import Columns
from emsid.io.packing import parsed_by
from emsid.io.table import read_table


def read_spreadsheet(content: bytes) -> Columns:
    """The columns of the first sheet of a spreadsheet; header lines and units are recognised as in a text table.

    Raises:
        FormatError: for content that is no spreadsheet, or where fastexcel is not installed.
    """
    return read_table(parsed_by(parsed, content, "a spreadsheet", "fastexcel", "excel"))


def parsed(content: bytes) -> bytes:
    """The cells of the first sheet as a CSV table, for the process that parses them."""
    import polars as pl

    frame = pl.read_excel(BytesIO(content), has_header=False, drop_empty_rows=True, read_options={"dtypes": "string"})
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([cell or "" for cell in row] for row in frame.rows())
    return text.getvalue().encode()
