r"""The pulses of an encoder, counted: ``edges(A)`` and ``edges(A, B)`` are positions in counts.

Between its two levels a channel keeps its state until it is within a quarter of their distance from the other level, so
that noise on an edge is not counted. The edges of one channel have no direction. Two channels that are a
quarter of a period apart (quadrature) go through four states,

    A leads B:   (0, 0) → (1, 0) → (1, 1) → (0, 1) → (0, 0),      s = (A ⊕ B) + 2·B = 0, 1, 2, 3, 0,

and s changes by one for each edge, up while A leads and down while B leads. A change by two is no step of a shaft: an
edge is missed, because the samples are too far apart. It counts as two edges in the direction of the one before it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.io.columns import Columns, as_numbers
from emsid.units import column_of, edges_of

Array = NDArray[np.float64]

NEAR = 0.25
"""A value is at a level within this part of the distance between the two levels."""


def with_edges(columns: Columns, channels: Iterable[str]) -> tuple[Columns, tuple[Finding, ...]]:
    """The columns of a file with the counts that channels name, and a finding for each that missed edges.

    Args:
        columns: of the file.
        channels: names such as ``edges(A)``, ``edges(A, B)`` or ``d(edges(A))``; other names need nothing.
    """
    import polars as pl

    series, units, found = dict(columns.series), dict(columns.units), []
    for name in dict.fromkeys(column_of(channel, columns.series) for channel in channels):
        counted = () if name in series else sources(name, columns)
        if not counted:
            continue
        counts, missed = count(*(as_numbers(series[each]) for each in counted))
        series[name], units[name] = pl.Series(name, counts).fill_nan(None), "count"
        if missed:
            total = int(np.nansum(np.abs(np.diff(counts))))
            found.append(Finding("edges-missed", name, {"missed": missed, "edges": total}))
    return replace(columns, series=series, units=units), tuple(found)


def sources(name: str, columns: Columns) -> tuple[str, ...]:
    """The one or two columns whose edges a name such as ``edges(A, B)`` counts; none for other names."""
    inner = edges_of(name)
    commas = [comma.start() for comma in re.finditer(",", inner)]  # a name may have one
    readings = ((inner,), *((inner[:k].strip(), inner[k + 1 :].strip()) for k in commas))
    called = (tuple(map(columns.called, each)) for each in readings if inner)
    return next((each for each in called if all(part in columns.series for part in each)), ())


def levels(x: Array) -> tuple[float, float]:
    """The lower and the upper level of a channel (N,): the means of the values nearer to each of the two."""
    known = x[np.isfinite(x)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    while high > low:
        upper = known > (low + high) / 2
        means = float(known[~upper].mean()), float(known[upper].mean())
        if means == (low, high):
            break
        low, high = means
    return low, high


def scaled(x: Array) -> Array:
    """(N,) the values of a channel on a scale with its two levels at 0 and 1; 0 where it has only one."""
    low, high = levels(x)
    return (x - low) / (high - low) if high > low else np.zeros(len(x))


def states(x: Array) -> NDArray[np.bool_]:
    """(N,) whether a channel is at its upper level; between the levels, and where a value is missing, as before."""
    level = scaled(x)
    sure = np.where(np.abs(level - 0.5) > 0.5 - NEAR, np.arange(len(x)), 0)
    return np.asarray(level[np.maximum.accumulate(sure)] > 0.5)


def count(a: Array, b: Array | None = None) -> tuple[Array, int]:
    """The number of edges up to each row, and how many were missed.

    >>> square = np.array([0.0, 1, 1, 0, 0, 1])
    >>> count(square)[0], count(np.array([0.0, 1, 1, 0, 0]), np.array([0.0, 0, 1, 1, 0]))[0]
    (array([0., 1., 1., 2., 2., 3.]), array([0., 1., 2., 3., 4.]))

    Args:
        a: (N,) the values of a channel; NaN where there is none.
        b: (N,) those of the second channel of an encoder, which tells the direction: positive while the first leads.

    Returns:
        (N,) the counts, from 0, NaN where a value is missing; and the number of missed edges, which only two channels
        show.
    """
    known = np.isfinite(a) & (True if b is None else np.isfinite(b))
    if b is None:
        step, missed = np.abs(np.diff(states(a).astype(int))), 0
    else:
        second = states(b)
        step = np.diff((states(a) ^ second) + 2 * second)
        step = (step + 1) % 4 - 1
        single = np.abs(step) == 1
        rows = np.maximum.accumulate(np.where(single, np.arange(len(step)), -1))
        before = step[np.where(rows < 0, np.argmax(single), rows)] if len(step) else step
        missed = int(np.count_nonzero(step == 2))
        step = np.where(step == 2, 2 * before, step)
    return np.where(known, np.concatenate([[0], np.cumsum(step)])[: len(a)], np.nan), missed
