"""Excel and OpenDocument spreadsheets, read by fastexcel: every sheet as a text table."""

from __future__ import annotations

import csv
import json
from contextlib import suppress
from io import BytesIO, StringIO
from typing import TYPE_CHECKING
from zipfile import BadZipFile, ZipFile

from emsid.errors import FormatError
from emsid.io.columns import Columns
from emsid.io.files import check_expansion
from emsid.io.sandbox import parsed_by
from emsid.io.table import read_table

if TYPE_CHECKING:
    import polars as pl


def read_spreadsheet(content: bytes) -> Columns:
    """The columns of a spreadsheet; header lines and units are recognised as in a text table.

    The columns of the first sheet with a table have their own names, those of further ones ``sheet.column``.

    Raises:
        FormatError: for content that is no spreadsheet, one without a table, or where fastexcel is not installed.
    """
    if content.startswith(b"PK"):
        with suppress(BadZipFile, NotImplementedError), ZipFile(BytesIO(content)) as archive:
            check_expansion(len(content), sum(member.file_size for member in archive.infolist()))
    sheets: dict[str, str] = json.loads(parsed_by(parsed, content, "a spreadsheet", "fastexcel", "excel"))
    tables: dict[str, Columns] = {}
    problems: list[FormatError] = []
    for name, text in sheets.items():
        try:
            tables[name] = read_table(text.encode())
        except FormatError as problem:
            problems.append(problem)
    if not tables:
        raise problems[0] if problems else FormatError("there is no sheet in this file")
    (_, first), *others = tables.items()
    if not others:
        return first
    series, units = dict(first.series), dict(first.units)
    for sheet, table in others:
        series |= {f"{sheet}.{name}": values.alias(f"{sheet}.{name}") for name, values in table.series.items()}
        units |= {f"{sheet}.{name}": unit for name, unit in table.units.items()}
    return Columns(series, units=units, preamble=first.preamble)


def parsed(content: bytes) -> bytes:
    """The cells of every sheet as a CSV table by the name of the sheet, for the process that parses them."""
    return json.dumps(
        {name: _as_csv(_with_times(content, name, frame)) for name, frame in _texts(content).items()}
    ).encode()


def _texts(content: bytes) -> dict[str, pl.DataFrame]:
    """The cells of every sheet as texts; times of day and durations of OpenDocument are missing."""
    import polars as pl

    return pl.read_excel(
        BytesIO(content),
        sheet_id=0,
        has_header=False,
        drop_empty_rows=False,
        raise_if_empty=False,
        read_options={"dtypes": "string"},
    )


def _with_times(content: bytes, sheet: str, texts: pl.DataFrame) -> pl.DataFrame:
    """The cells of a sheet that are not empty, with the times of day of OpenDocument in seconds.

    Args:
        content: of the file.
        sheet: its name.
        texts: its cells that are texts, numbers and dates.
    """
    import polars as pl

    few = [k for k, column in enumerate(texts) if 2 * column.null_count() > len(column)]
    if few and not content.startswith(b"\xd0\xcf"):
        kinds = {k: "duration" if k in few else "string" for k in range(texts.width)}
        again = pl.read_excel(
            BytesIO(content),
            sheet_name=sheet,
            has_header=False,
            drop_empty_rows=False,
            raise_if_empty=False,
            read_options={"dtypes": kinds},
        )
        seconds = [(again.to_series(k).dt.total_milliseconds() / 1e3).cast(pl.String) for k in few]
        texts = texts.with_columns(
            texts.to_series(k).fill_null(each).alias(texts.columns[k]) for k, each in zip(few, seconds, strict=True)
        )
    return texts.filter(~pl.all_horizontal(pl.all().is_null())) if texts.width else texts


def _as_csv(frame: pl.DataFrame) -> str:
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows([cell or "" for cell in row] for row in frame.rows())
    return text.getvalue()
