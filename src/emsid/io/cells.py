"""The cells of a text table as values: numbers in their spellings, moments, times of day, text.

Decimal commas and separators of thousands are recognised in each column, as are hexadecimal numbers (``0x1F``) and a
unit behind every number (``3.2 V``).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from emsid.units import known_unit

if TYPE_CHECKING:
    import polars as pl

MARK = "\x1f"
"""Stands between the cells of a line; a file that contains it is refused as binary."""

_MISSING = frozenset({"", "na", "n/a", "null", "none", "-", "--", "?"})
_NUMBER = re.compile(r"[+-]?(\d+\.?|\d*[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)|0x[0-9a-f]+", re.IGNORECASE)
_WITH_UNIT = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\s\d.,;:+-][^\s.,;:+-]*)")
# Only time differences are used, so the order of day and month does not matter.
_MOMENTS = [
    f"{date}{between}%H:%M:%S%.f{zone}"
    for date in ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%m/%d/%Y", "%d/%m/%Y")
    for between in ("T", " ")
    for zone in ("", "Z", "%z")
]
_MOMENTS += [f"{date} %I:%M:%S%.f %p" for date in ("%m/%d/%Y", "%d/%m/%Y", "%Y-%m-%d")]
_TIMES_OF_DAY = ("%H:%M:%S%.f", "%I:%M:%S%.f %p")


def cells_of(text: str) -> list[str]:
    """The cells of a line with marks."""
    return [cell.strip() for cell in text.split(MARK)]


def is_number(cell: str) -> bool:
    """Whether a cell holds a number."""
    return _NUMBER.fullmatch(cell) is not None


def is_missing(cell: str) -> bool:
    """Whether a cell holds nothing."""
    return cell.lower() in _MISSING


def has_unit(cell: str) -> bool:
    """Whether a cell holds a number and its unit."""
    return _unit_behind([cell]) != ""


def without_units(texts: Sequence[str], last: int) -> tuple[list[str], list[str]]:
    """The lines with marks, without the units behind their numbers, and the unit of each column.

    A column has a unit where every filled cell of it in the ``last`` lines (at most the second half) is a number with
    this unit. Where no column has one, there are no units.
    """
    rows = [cells_of(text) for text in texts[-max(1, min(last, len(texts) // 2)) :]]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    units = [_unit_behind(column) for column in zip(*(row for row in rows if len(row) == width), strict=True)]
    if not any(units):
        return list(texts), []
    return [_without_units(text, units) for text in texts], units


def _unit_behind(column: Sequence[str]) -> str:
    """The unit behind every number of a column; empty where a cell has none or another one."""
    found = [_WITH_UNIT.fullmatch(cell) for cell in column if not is_missing(cell)]
    units = {each[2] if each else "" for each in found}
    unit = units.pop() if len(units) == 1 else ""
    return unit if known_unit(unit) else ""


def _without_units(text: str, units: Sequence[str]) -> str:
    row = cells_of(text)
    if len(row) != len(units):
        return text
    found = [_WITH_UNIT.fullmatch(cell) if unit else None for cell, unit in zip(row, units, strict=True)]
    return MARK.join(
        each[1] if each and each[2] == unit else cell for cell, unit, each in zip(row, units, found, strict=True)
    )


def parse(texts: Sequence[str], names: Sequence[str]) -> dict[str, pl.Series]:
    """The columns of lines with marks: numbers and moments where all filled cells of a column are, else text."""
    import polars as pl

    frame = pl.read_csv(
        "\n".join(texts).encode() + b"\n",
        has_header=False,
        separator=MARK,
        quote_char=None,
        schema=dict.fromkeys(names, pl.String),
    )
    frame = frame.select(pl.all().str.strip_chars().replace("", None))
    numbers = frame.select(pl.all().cast(pl.Float64, strict=False))  # at once: a file may have thousands of columns
    empty, lost = frame.null_count().row(0), numbers.null_count().row(0)
    return {
        text.name: number if before == after else numbers_or_text(text)
        for text, number, before, after in zip(frame, numbers, empty, lost, strict=True)
    }


def numbers_or_text(column: pl.Series) -> pl.Series:
    """The column as numbers where every filled cell is one, as moments likewise, else as text with decimal points."""
    import polars as pl

    numbers = column.cast(pl.Float64, strict=False)
    if numbers.null_count() > column.null_count() and not column.str.contains(r"^[+-]?\d*\.\d").any():
        column = column.str.replace(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$", "${1}.${2}")
        numbers = column.cast(pl.Float64, strict=False)
    if numbers.null_count() > column.null_count():
        column = _without_groups(column)
        numbers = column.cast(pl.Float64, strict=False)
    if numbers.null_count() == column.null_count():
        return numbers
    if column.drop_nulls().str.contains(r"^0[xX][0-9a-fA-F]+$").all():
        return column.str.slice(2).str.to_integer(base=16).cast(pl.Float64)
    return _moments_or_text(column)


def _without_groups(column: pl.Series) -> pl.Series:
    """The column without separators of thousands, ``1,234.5`` or ``1.234,5``, if all its cells are such numbers."""
    for group, point in ((",", "."), (".", ",")):
        g, p = re.escape(group), re.escape(point)
        grouped = column.str.contains(rf"^[+-]?\d{{1,3}}({g}\d{{3}})+({p}\d*)?$")
        if grouped.any() and (grouped | column.str.contains(rf"^[+-]?\d*({p}\d*)?$")).all():
            return column.str.replace_all(group, "", literal=True).str.replace(point, ".", literal=True)
    return column


def _moments_or_text(column: pl.Series) -> pl.Series:
    """The column as times if its first filled cell is one; other cells become missing."""
    import polars as pl

    pointed = column.str.replace(",", ".", literal=True)
    pointed = pointed.str.replace(r"^(\d{1,2}:\d{2}\.\d+)$", "00:${1}")  # minutes and seconds
    first = pointed.drop_nulls()[:1]
    kinds: list[tuple[type[pl.Datetime | pl.Time], str]] = [(pl.Datetime, form) for form in _MOMENTS]
    kinds += [(pl.Time, form) for form in _TIMES_OF_DAY]
    # All formats in one query: a query takes longer than a cell.
    cells = (pl.lit(first).str.strptime(kind, form, strict=False) for kind, form in kinds)
    found = pl.select(cell.is_null().any().alias(str(k)) for k, cell in enumerate(cells)).row(0)
    for (kind, form), missed in zip(kinds, found, strict=True):
        if not missed:
            return pointed.str.strptime(kind, form, strict=False)
    return column
