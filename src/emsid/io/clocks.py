"""Columns with times of their own, resampled to the times of one of them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from emsid.errors import DataError
from emsid.io.columns import Columns, as_numbers
from emsid.record.time_axis import held_at


def on_one_clock(columns: Columns, clock: str, held: Collection[str]) -> Columns:
    """All columns at the times of one clock, as far as each has times there.

    Args:
        columns: where each column may have a clock of its own.
        clock: the time column to bring them to.
        held: columns that keep their value until the next one, such as commands; others are interpolated linearly.

    Raises:
        DataError: where the columns have no time in common.
    """
    import polars as pl

    others = {name: each for name, each in columns.clocks.items() if each != clock and name != each}
    if not others:
        return columns
    times = as_numbers(columns.series[clock])
    own = {each: as_numbers(columns.series[each]) for each in set(others.values())}
    first, last = max(t[0] for t in own.values()), min(t[-1] for t in own.values())
    inside = (times >= first) & (times <= last)
    if not inside.any():
        raise DataError(f"the columns have no time in common with {clock!r}; take columns of one recording")
    series = {}
    step = float(np.median(np.diff(times[inside]))) if np.count_nonzero(inside) > 1 else 0.0
    for name, values in columns.series.items():
        if name in others:
            t, x = own[others[name]], as_numbers(values)
            at = held_at(t, times[inside], step)
            series[name] = pl.Series(name, x[at] if name in held else np.interp(times[inside], t, x))
        elif columns.clocks.get(name) == clock:
            series[name] = values.filter(pl.Series(inside))
    return replace(columns, series=series, clocks=dict.fromkeys(series, clock), lines=None)
