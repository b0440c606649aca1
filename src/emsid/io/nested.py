"""Cells that hold several numbers: lists, arrays and tables of a data frame as columns of their own.

A list or array of n numbers in every row becomes ``name_1`` … ``name_n``, as a matrix does, and a table in a cell
``name.field``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import polars as pl

MOST_VALUES = 1_000
"""A longer list in a cell is a signal or a picture, and no row of channels."""
DEEPEST = 4
"""Tables and lists inside so many others are not read."""


def flat(frame: pl.DataFrame) -> tuple[dict[str, pl.Series], dict[str, str]]:
    """The columns of a frame without nested values, and why other columns are none.

    Args:
        frame: of any types.
    """
    series: dict[str, pl.Series] = {}
    others: dict[str, str] = {}
    waiting = [(column, 0) for column in reversed(frame.get_columns())]
    while waiting:
        column, depth = waiting.pop()
        if not column.dtype.is_nested():
            series[column.name] = column
            continue
        parts = "lists or tables inside others" if depth == DEEPEST else _parts(column)
        if isinstance(parts, str):
            others[column.name] = parts
        else:
            waiting += [(part, depth + 1) for part in reversed(parts)]
    return series, others


def _parts(column: pl.Series) -> list[pl.Series] | str:
    """The columns that a nested one is made of, or the reason why it is none."""
    import polars as pl

    if isinstance(column.dtype, pl.Struct):
        table = column.struct.unnest()
        return [table[field].alias(f"{column.name}.{field}") for field in table.columns]
    if isinstance(column.dtype, pl.Array):
        column = column.arr.to_list()
    lengths = column.list.len().drop_nulls().unique().to_list()
    if len(lengths) != 1:
        return "lists of different lengths" if lengths else "empty"
    length = int(lengths[0])
    if not 0 < length <= MOST_VALUES:
        return f"lists of {length:,} values" if length else "empty lists"
    return [column.list.get(k).alias(f"{column.name}_{k + 1}") for k in range(length)]
