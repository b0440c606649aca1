"""Columns moved by whole rows, as a logger needs that writes a command into the row after the one where it acts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from emsid.errors import DataError
from emsid.io.columns import Columns
from emsid.io.selection import check_column


def shifted(columns: Columns, rows: Mapping[str, float], direction: Mapping[str, str]) -> Columns:
    """The columns of a file, some of them moved; their first or last value fills the rows without one, of an excerpt
    in each stretch.

    Args:
        columns: of the file.
        rows: by column, to later rows; negative to earlier ones.
        direction: by column, the column with its sign, which is moved along.

    Raises:
        DataError: for a column that does not exist, and a number that is not whole or too large.
    """
    import polars as pl

    series = dict(columns.series)
    for name, number in rows.items():
        check_column(name, columns)
        if not abs(number) < len(series[name]) or number != int(number):  # not a number is not less
            raise DataError(
                f"shift of {name!r} is {number:g}; give a whole number of rows, fewer than there are",
                arguments=("shift",),
            )
        for each in (name, *([direction[name]] if name in direction else [])):
            check_column(each, columns)
            parts = [series[each][there] for there in columns.stretches]
            edge = 0 if number > 0 else -1
            series[each] = pl.concat(part.shift(int(number), fill_value=part[edge]) for part in parts)
    return replace(columns, series=series) if rows else columns
