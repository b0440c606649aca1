"""Logs with a row for every message, as of a CAN bus: each row has values in the columns of its own message only."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from emsid.io.columns import Columns, as_numbers

TOGETHER = 0.5
"""Columns are of different messages where fewer of the values of the rarer one than this part share a row."""

MOST_KINDS = 64
"""More different patterns of rows with a value are not those of messages."""


def with_clocks_of_messages(columns: Columns, time: str, used: Sequence[str]) -> Columns:
    """The columns with a clock for every message, where a row holds one message; else, or of an excerpt, as they are.

    Columns that have values in the same rows are of one message. Their clock is the time in these rows; that of the
    last column used has the name of the time column.

    Args:
        columns: of a file with one time column.
        time: its name.
        used: the columns to take; of these or of another and one of these, two must be of different messages.
    """
    if columns.clocks or columns.damaged or columns.excerpt is not None or time not in columns.series:
        return columns
    known = _known(columns, time)
    complete = all(known[name].all() for name in used if name in known)
    if complete or not set(used) <= set(known) or not _apart(known, used):
        return columns
    series, clocks, named = {}, {}, {known[used[-1]].tobytes(): time}
    for name in dict.fromkeys(used):
        clock = named.setdefault(known[name].tobytes(), f"{time} of {name}")
        series[name] = columns.series[name].filter(known[name])
        series[clock] = columns.series[time].filter(known[name]).alias(clock)
        clocks[name] = clocks[clock] = clock
    return replace(columns, series=series, clocks=clocks, lines=None)


def numeric_columns(columns: Columns, time: str) -> list[str]:
    """The columns with numbers beside the time, those with the most of them last."""
    known = _known(columns, time)
    return sorted(known, key=lambda name: int(known[name].sum()))


def _known(columns: Columns, time: str) -> dict[str, NDArray[np.bool_]]:
    """(N,) for every column of numbers that is as long as the time, the rows in which it has a value."""
    rows = len(columns.series[time])
    found = {}
    for name, series in columns.series.items():
        if name != time and len(series) == rows and series.dtype.is_numeric():
            found[name] = np.isfinite(as_numbers(series))
    return {name: where for name, where in found.items() if where.any()}


def _apart(known: dict[str, NDArray[np.bool_]], used: Collection[str]) -> bool:
    """Whether a column used is of another message than any other column."""
    kinds: dict[bytes, tuple[NDArray[np.bool_], bool]] = {}
    for name, where in known.items():
        key = where.tobytes()
        kinds[key] = (where, name in used or (key in kinds and kinds[key][1]))
    if len(kinds) > MOST_KINDS:
        return False
    return any(
        np.count_nonzero(a & b) < TOGETHER * min(np.count_nonzero(a), np.count_nonzero(b))
        for (a, first), (b, second) in combinations(kinds.values(), 2)
        if first or second
    )
