"""Plots of inputs, and the critical intervals of a record, in which a linear model has its largest errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from emsid.errors import listed
from emsid.report.document import Figure, Ink, Line, Plot, Stroke
from emsid.report.numbers import capital
from emsid.report.views.conventions import channel_axis
from emsid.report.views.timeline import TIME, timeline, with_gaps

if TYPE_CHECKING:
    from emsid.record import Record


def inputs(records: Sequence[Record], *, name: str = "inputs") -> Figure:
    """The inputs of several records over time, as in Figures 5.1 and 5.5."""
    plots = []
    names = [record.name for record in records]
    for record in records:
        t, samples = timeline(record)
        title = capital(record.name)
        if names.count(record.name) > 1:
            title += f", {t[0]:.4g} s to {t[-1]:.4g} s"
        for k, channel in enumerate(record.input_names):
            line = Line(t, with_gaps(record.input[:, k], samples), stroke=Stroke(Ink.BLUE, width=0.9), stairs=True)
            plots.append(Plot((line,), TIME, channel_axis(channel, record.input_units[k]), title, height=0.8))
    return Figure(name, f"Input of {listed(list(dict.fromkeys(names)))}.", tuple(plots))


def critical_intervals(
    record: Record, width: float, error: ArrayLike | None = None, *, count: int = 2
) -> tuple[slice, ...]:
    """Intervals around reversals and standstills, in which a linear model has its largest errors.

    Candidates are intervals around the samples at which an output crosses zero or leaves rest (2 % of its largest
    value). The intervals with the largest mean square ``error`` are taken or, without ``error``, those with most rest.
    With several outputs, each error is divided by the variation of that output.

    Args:
        record: the data.
        width: length of an interval in seconds; shorter only if a whole segment is.
        error: (N,) or (N, ny) a model's error, such as the linear model's free-run residual; NaN counts as none.
        count: how many intervals at most; they do not overlap.

    Returns:
        Slices of the record, in the order of time: ``record[critical_intervals(record, 2.0)[0]]``.
    """
    y = record.output
    scale = np.max(np.abs(y), axis=0)
    scale[scale == 0] = 1.0
    if error is None:
        badness = 1 / (1 + (y / (0.02 * scale)) ** 2)
    else:
        badness = np.asarray(error, float).reshape(len(y), -1) ** 2
        if badness.shape[1] > 1:
            badness = badness / np.where(np.ptp(y, axis=0) > 0, np.var(y, axis=0), 1.0)
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(badness).sum(axis=1))])
    side = np.where(np.abs(y) <= 0.02 * scale, 0, np.sign(y))
    samples = max(2, round(width / record.dt))

    candidates = []
    for start, stop in zip((0, *record.breaks), (*record.breaks, len(record)), strict=True):
        length = min(samples, stop - start)
        turns = start + 1 + np.flatnonzero(np.diff(side[start:stop], axis=0).any(axis=1))
        centres = turns if len(turns) else np.arange(start, stop)
        first = np.unique(np.clip(centres - length // 2, start, stop - length))
        mean = (total[first + length] - total[first]) / length
        candidates += [(float(m), int(a), int(a) + length) for m, a in zip(mean, first, strict=True)]
    chosen: list[slice] = []
    for _, a, b in sorted(candidates, key=lambda each: (-each[0], each[1])):
        if all(b <= other.start or a >= other.stop for other in chosen):
            chosen.append(slice(a, b))
            if len(chosen) == count:
                break
    return tuple(sorted(chosen, key=lambda rows: rows.start))
