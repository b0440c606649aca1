"""Text tables in which channels have times of their own: in blocks one under the other, or side by side.

PLC traces (CODESYS, ctrlX) and oscilloscopes write one signal after the other, each under lines that name it. The
times begin anew with each *block*, and the cell above it in which all blocks differ, apart from their numbers, is the
name of the signal. Runs of one table after another have the same names and are no such blocks.

Exports of measuring systems (DIAdem, NI, LabVIEW) have the times of every channel beside it, under a name that is
*repeated*. Equal times become one column.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from emsid.io.cells import MARK, cells_of, is_number, parse
from emsid.io.columns import Columns, as_numbers

if TYPE_CHECKING:
    import polars as pl

TIME = "time"
"""The name of a time column that the file does not name."""
FEWEST_ROWS = 10
"""A block has at least this many rows; fewer numbers between lines of text are settings."""
MOST_ABOVE = 200
"""The first block begins within this many lines."""
_WORD = re.compile(r"[^\W\d_]{2,}")
_NUMBERS = re.compile(r"\d+")


class _Block(NamedTuple):
    above: list[str]  # lines that name the signal
    rows: list[str]


def stacked(texts: Sequence[str]) -> Columns | None:
    """The signals of a file with one block for each, with their clocks; None for another file.

    Args:
        texts: the lines, with marks between cells.
    """
    blocks = _blocks(texts)
    names = _names([block.above for block in blocks]) if len(blocks) > 1 else []
    if not names:
        return None
    tables: dict[str, dict[str, pl.Series]] = {}
    for name, block in zip(names, blocks, strict=True):
        places = [k for k, cell in enumerate(cells_of(block.rows[0])) if cell]
        rows = parse(block.rows, [str(k) for k in range(len(cells_of(block.rows[0])))])
        values = [rows[str(k)] for k in places]
        if len(values) < 2 or not all(column.dtype.is_numeric() for column in values):
            return None
        keys = [name] if len(values) == 2 else [f"{name}_{k}" for k in range(1, len(values))]
        tables[name] = dict(zip((TIME, *keys), values, strict=True))
    times = [table[TIME] for table in tables.values()]
    if any(later[0] > earlier[-1] for earlier, later in pairwise(times)):
        return None  # one signal with messages in between
    series: dict[str, pl.Series] = {}
    clocks: dict[str, str] = {}
    for table in tables.values():
        clock = f"{TIME} {len(series)}"
        series |= {key if key != TIME else clock: values for key, values in table.items()}
        clocks |= dict.fromkeys([clock, *(key for key in table if key != TIME)], clock)
    return _with_clocks(Columns(series, preamble=tuple(text.replace(MARK, " ") for text in blocks[0].above)), clocks)


def _blocks(texts: Sequence[str]) -> list[_Block]:
    """The parts of a file that begin with lines like those above its first rows; empty where it has one table."""
    first = next((k for k in range(min(MOST_ABOVE, len(texts) - 1)) if _is_row(texts[k]) and _is_row(texts[k + 1])), 0)
    word = _WORD.search(texts[first - 1]) if first else None
    if word is None:
        return []
    ends = [k for k in range(first - 1, len(texts) - 1) if word[0] in texts[k] and _is_row(texts[k + 1])]
    begins = [first - 1]
    for end in ends[1:]:
        begin = end
        while not _is_row(texts[begin - 1]):
            begin -= 1
        begins.append(begin)
    height = (ends[1] - begins[1] + 1) if len(ends) > 1 else 0
    begins[0] = max(first - height, 0)
    blocks = [
        _Block(list(texts[begin : end + 1]), list(texts[end + 1 : after]))
        for begin, end, after in zip(begins, ends, [*begins[1:], len(texts)], strict=True)
    ]
    alike = all(len(block.above) == height and len(block.rows) >= FEWEST_ROWS for block in blocks)
    return blocks if alike else []


def _is_row(text: str) -> bool:
    """Whether a line has two numbers or more, and nothing else."""
    filled = [cell for cell in cells_of(text) if cell]
    return len(filled) >= 2 and all(map(is_number, filled))


def _names(above: Sequence[Sequence[str]]) -> list[str]:
    """The cells above the blocks in which these differ: without their digits if possible, else behind a label."""
    rows = [[cells_of(text) for text in lines] for lines in above]
    places = [(k, j) for k, cells in enumerate(rows[0]) for j in range(len(cells))]
    found = {
        (k, j): [lines[k][j] for lines in rows] for k, j in places if all(len(lines[k]) > j for lines in rows)
    }  # the cell in every block
    distinct = {place: cells for place, cells in found.items() if all(cells) and len(set(cells)) == len(cells)}
    bare = [cells for cells in distinct.values() if len({_NUMBERS.sub("", cell) for cell in cells}) == len(cells)]
    behind = [cells for (_, j), cells in distinct.items() if j > 0 and all(map(_WORD.search, cells))]
    first = [cells for (_, j), cells in distinct.items() if j == 0 and all(map(_WORD.search, cells))]
    return next(iter([*bare, *behind, *first]), [])


def side_by_side(columns: Columns, repeated: Sequence[str]) -> Columns:
    """The columns with the clock of each, where a file repeats the name of its first column before every channel.

    Args:
        columns: of a table, in its order.
        repeated: the names of the columns that have one name in the file; the first is the first column.
    """
    names = list(columns.series)
    times = [columns.series[name] for name in repeated if name in columns.series]
    if len(times) < 2 or len(times) < len(repeated) or names[0] != repeated[0] or columns.damaged:
        return columns
    if not all(_ascends(time) for time in times) or any(a in repeated and b in repeated for a, b in pairwise(names)):
        return columns
    clocks: dict[str, str] = {}
    clock = names[0]
    for name in names:
        clock = name if name in repeated else clock
        clocks[name] = clock
    known = {each: columns.series[each].is_not_null() for each in repeated}
    series = {name: columns.series[name].filter(known[clock]) for name, clock in clocks.items()}
    if any(series[name].null_count() for name in names if series[name].dtype.is_numeric()):
        return columns
    return _with_clocks(replace(columns, series=series, lines=None), clocks)


def _with_clocks(columns: Columns, clocks: Mapping[str, str]) -> Columns:
    """The columns with their clocks; those with equal times have one, and a single one is an ordinary time column."""
    kept: list[str] = []
    same: dict[str, str] = {}
    for clock in dict.fromkeys(clocks.values()):
        times = columns.series[clock]
        equal = next((each for each in kept if columns.series[each].equals(times)), clock)
        same[clock] = equal
        kept += [clock] * (equal == clock)
    channels = [name for name in columns.series if name not in same]
    title = TIME if kept[0].startswith(f"{TIME} ") else kept[0]
    if len(kept) == 1:
        called = {kept[0]: title}
    else:
        firsts = {clock: next(name for name in channels if same[clocks[name]] == clock) for clock in kept}
        called = {clock: f"{title} of {name}" for clock, name in firsts.items()}
    series = {
        called.get(name, name): values.alias(called.get(name, name))
        for name, values in columns.series.items()
        if name in kept or name in channels
    }
    units = {called.get(name, name): unit for name, unit in columns.units.items() if name in kept or name in channels}
    own = {} if len(kept) == 1 else {called.get(name, name): called[same[clocks[name]]] for name in (*kept, *channels)}
    return replace(columns, series=series, units=units, clocks=own)


def _ascends(times: pl.Series) -> bool:
    """Whether a column has times: numbers or moments that never go back, with nothing missing but at the end."""
    import numpy as np

    if not (times.dtype.is_numeric() or times.dtype.is_temporal()):
        return False
    known = times.drop_nulls()
    complete = len(known) == len(times) or times[: len(known)].null_count() == 0
    numbers = as_numbers(known)
    return complete and len(known) > 1 and bool(np.all(numbers[1:] > numbers[:-1]))
