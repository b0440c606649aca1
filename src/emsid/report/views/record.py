"""Plots of inputs, and the critical intervals of a record, in which a linear model has its largest errors.

Plots of recursive estimates over time.

Free runs with measured outputs, and models ranked by their free runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle
from math import floor, log10
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, listed
from emsid.report.document import Axis, Band, Bars, Dash, Figure, Ink, Level, Line, Mark, Plot, Points, Spans, Stroke
from emsid.report.numbers import capital, number, percent
from emsid.report.views.conventions import (
    MEASURED,
    MODELS,
    TIME,
    channel_axis,
    channels,
    of_output,
    output_axis,
    timeline,
    with_gaps,
)
from emsid.units import with_unit
from emsid.validation.comparison import labels

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.bands import Band as Computed
    from emsid.record import Record
    from emsid.validation.comparison import Assessment, Comparison, OutputErrors, Row


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


Array = NDArray[np.float64]


_INKS = (Ink.BLUE, Ink.RED, Ink.GREEN, Ink.ORANGE, Ink.PURPLE, Ink.NAVY, Ink.GREY, Ink.BLACK)


def convergence(fit: Fit[Any], batch: Fit[Any] | None = None, *, name: str = "convergence") -> Figure:
    """Recursive estimates from the first sample to the last, with the batch estimates dashed.

    Parameters whose names have the same beginning share a plot. It shows the range of their later values.

    Args:
        fit: with its ``history``.
        batch: the same structure by batch least squares.
        name: of the figure.

    Raises:
        DataError: where the fit has no history.
    """
    if fit.history is None or not len(fit.history):
        raise DataError(f"{fit.model.name}: the fit has no history of its estimates; fit with history=True")
    steps = len(fit.history)
    shown = np.unique(np.geomspace(1, steps, min(steps, 1500)).round().astype(int)) - 1
    groups: dict[str, list[int]] = {}
    for k, parameter in enumerate(fit.names):
        groups.setdefault(parameter.rstrip("0123456789_"), []).append(k)
    plots = []
    for row, members in enumerate(groups.values()):
        drawn = members[: len(_INKS)]
        marks: list[Mark] = []
        for k, ink in zip(drawn, cycle(_INKS), strict=False):
            label = fit.names[k] if len(members) > 1 else ""
            marks.append(Line(shown + 1.0, fit.history[shown, k], label, Stroke(ink)))
            if batch is not None:
                marks.append(Level(float(batch.estimate[k]), stroke=Stroke(ink, Dash.DASHED, 0.8)))
        ends = fit.history[-1, drawn] if batch is None else np.append(fit.history[-1, drawn], batch.estimate[drawn])
        left_out = f" (and {len(members) - len(drawn)} more)" if len(members) > len(drawn) else ""
        first, last = fit.names[members[0]], fit.names[members[-1]]
        plots.append(
            Plot(
                tuple(marks),
                Axis("Sample", "1", log=True),
                Axis("Estimate", "SI", range=settled_range(fit.history[:, drawn], ends)),
                first if len(members) == 1 else f"{first} … {last}{left_out}",
                span=2 if row % 2 == 0 and row == len(groups) - 1 > 0 else 1,  # the last one, alone in its row
            )
        )
    dashed = "; dashed: batch least squares" if batch is not None else ""
    return Figure(
        name,
        f"Recursive estimates of {fit.model.name} over the samples{dashed}. The unit of each is the unit of the output "
        "divided by that of its regressor.",
        tuple(plots),
        columns=min(len(plots), 2),
        shared_x=True,
    )


def settled_range(history: Array, values: Array) -> tuple[float, float]:
    """The range of the last nine tenths of estimates (N, …) without outliers, and of further values, with a margin."""
    late = history[len(history) // 10 :]
    shown = np.append(np.quantile(late, (0.005, 0.995), axis=0), values)
    low, high = float(shown.min()), float(shown.max())
    room = 0.25 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def responses(assessments: Sequence[Assessment], intervals: Sequence[slice], *, name: str = "responses") -> Figure:
    """Measured outputs and free runs of several models on chosen intervals, as in Figures 5.2, 5.3, 5.6 and 5.7.

    Args:
        assessments: models run over one record, the linear one first: it is drawn in solid red, the next dotted.
        intervals: as `critical_intervals` gives them.
        name: of the figure.
    """
    record = assessments[0].record
    t, samples = timeline(record)
    place = np.flatnonzero(samples >= 0)  # position of a sample in the timeline
    plots = []
    for rows in intervals:
        x = t[place[rows]]
        for channel in channels(record):
            runs = [
                Line(x, values[rows, channel], label, stroke) for values, label, stroke in _measured_and(assessments)
            ]
            axis = _within_reach(output_axis(record, channel), record.output[rows, channel], runs)
            plots.append(Plot(tuple(runs), TIME, axis, f"{x[0]:.4g} s to {x[-1]:.4g} s{of_output(record, channel)}"))
    fits = [f"{label} {_fits(a)}" for label, a in zip(labels(assessments), assessments, strict=True)]
    return Figure(
        name,
        f"Free runs around critical intervals of the record {record.name}. Fit over the whole record: {listed(fits)}.",
        tuple(plots),
    )


def _fits(assessment: Assessment) -> str:
    """The fit of a free run, or of each of its outputs."""
    row = assessment.row
    several = [f"{percent(each.fit_percent)} of {each.output}" for each in row.outputs]
    return listed(several) if several else percent(row.fit_percent)


def _measured_and(assessments: Sequence[Assessment]) -> list[tuple[Array, str, Stroke]]:
    """The measured output and the free run of every model, with label and stroke."""
    runs = zip(assessments, labels(assessments), cycle(MODELS), strict=False)
    return [
        (assessments[0].record.output, "measured", MEASURED),
        *((_free_run(each), label, stroke) for each, label, stroke in runs),
    ]


def _free_run(assessment: Assessment) -> Array:
    """(N, ny) the free run, NaN where measured samples start the model."""
    return np.where(assessment.simulation.counted[:, None], assessment.simulation.output, np.nan)


def _within_reach(axis: Axis, measured: Array, marks: Sequence[Line]) -> Axis:
    """The axis, limited if the range of a bad free run would flatten the measured output."""
    low, high = float(np.min(measured)), float(np.max(measured))
    room = 1.5 * (high - low or 1.0)
    astray = any(np.nanmax(m.y, initial=low) > high + room or np.nanmin(m.y, initial=high) < low - room for m in marks)
    return Axis(axis.quantity, axis.unit, range=(low - room, high + room)) if astray else axis


def measured_and_simulated(assessment: Assessment, *, band: Computed | None = None, name: str = "free-run") -> Figure:
    """A whole record with the free run of one model and, below, the residual, for every output.

    Args:
        assessment: the model run over the record.
        band: of its free run, from `emsid.validation.free_run_band`.
        name: of the figure.
    """
    record, row = assessment.record, assessment.row
    t, samples = timeline(record)
    plots: list[Plot] = []
    errors = []
    for channel in channels(record):
        axis = output_axis(record, channel)
        measured = with_gaps(record.output[:, channel], samples)
        simulated = with_gaps(_free_run(assessment)[:, channel], samples)
        around = () if band is None else _around(band, channel, t, samples)
        plots += with_residual(t, measured, simulated, axis, f"{row.model}, free run", around)
        of: Row | OutputErrors = row.outputs[channel] if row.outputs else row
        rmse = f"RMSE {with_unit(number(of.simulation_rmse), axis.unit)}"
        errors.append(f"{of_output(record, channel, '')} fit {percent(of.fit_percent)}, {rmse}".lstrip())
    from_measured = np.count_nonzero(~assessment.simulation.counted)
    started = f" Measured samples that start the model: {from_measured}." if from_measured else ""
    return Figure(
        name,
        f"{capital(record.name)}: measured and simulated by {row.model}, {'; '.join(errors)}.{started}",
        tuple(plots),
        shared_x=True,
    )


def with_residual(
    t: Array, measured: Array, simulated: Array, axis: Axis, label: str, behind: Sequence[Mark] = ()
) -> tuple[Plot, Plot]:
    """A measured output with a simulated one, and their difference below.

    Args:
        t: (M,) time in s.
        measured, simulated: (M,) the output, NaN in gaps.
        axis: of the output.
        label: of the simulated output.
        behind: marks behind the outputs; spans of time are drawn behind the difference, too.
    """
    lines = (Line(t, measured, "measured", MEASURED), Line(t, simulated, label, Stroke(Ink.RED, width=0.9)))
    residual = Line(t, measured - simulated, stroke=Stroke(Ink.BLACK, width=0.7))
    shaded = (replace(each, label="") for each in behind if isinstance(each, Spans))
    known = measured[np.isfinite(measured)]
    return (
        Plot((*behind, *lines), TIME, _within_reach(axis, known, lines), height=1.2),
        Plot((*shaded, residual), TIME, Axis("Residual", axis.unit), height=0.7),
    )


def _around(band: Computed, channel: int, t: Array, samples: NDArray[np.intp]) -> tuple[Band, ...]:
    """The band of a free run, where it is known."""
    low, high = (with_gaps(edge[:, channel], samples) for edge in (band.low, band.high))
    known = np.isfinite(low) & np.isfinite(high)
    label = f"{100 * band.level:g} % band of its parameters"
    return (Band(t, np.where(known, low, np.nan), high, label, Ink.RED),) if known.any() else ()


def ranking(comparison: Comparison) -> Figure:
    """Models by free-run error, the best at the top, with the one-step error as a point, for every output.

    An axis is logarithmic where the errors differ by more than a factor of twenty.
    """
    comparison = comparison.by_error
    rows, record = comparison.rows, comparison.best.record
    several = len(channels(record)) > 1
    data = "the data used in the fit" if rows[0].data == "identification" else "unseen data"
    relative = "; with several outputs, by the mean of MSE divided by variance" * several
    return Figure(
        "ranking",
        f"Errors on {record.name}, {data}. Models are ranked by the free run{relative}.{_ahead(rows)}",
        tuple(_ranking_plot(comparison, channel) for channel in channels(record)),
    )


def _ahead(rows: Sequence[Row]) -> str:
    """How one-step errors compare with those of the free run, in these models."""
    pairs = [errors for row in rows for errors in (row.outputs or (row,))]
    shares = [float(np.sqrt(each.one_step_mse / each.simulation_mse)) for each in pairs if each.simulation_mse > 0]
    known = sorted(share for share in shares if np.isfinite(share))
    if not known:
        return ""
    low, high = (f"{share:.2g}" for share in (known[0], known[-1]))
    return f" The error one step ahead is {low if low == high else f'{low} to {high}'} times that of the free run."


def _ranking_plot(comparison: Comparison, channel: int) -> Plot:
    record = comparison.best.record
    rows = [row.outputs[channel] if row.outputs else row for row in comparison.rows]
    values = np.array([row.simulation_rmse for row in rows])
    one_step = np.sqrt([row.one_step_mse for row in rows])
    drawable = np.concatenate([values, one_step])
    drawable = drawable[np.isfinite(drawable) & (drawable > 0)]
    log = len(drawable) > 0 and bool(drawable.max() > 20 * drawable.min())
    remarks = tuple(
        f"{number(row.simulation_rmse)}  (fit {percent(row.fit_percent)})"
        if whole.diverged_at is None
        else f"diverged at sample {whole.diverged_at}"
        for row, whole in zip(rows, comparison.rows, strict=True)
    )
    known = np.flatnonzero(np.isfinite(one_step))
    ahead = (Points(one_step[known], known.astype(float), "one step ahead", Ink.RED),) if len(known) else ()
    return Plot(
        (Bars(values, remarks, "free run", Ink.BLUE), *ahead),
        Axis(
            f"RMSE{of_output(record, channel, ' of ')}",
            output_axis(record, channel).unit,
            log=log,
            range=_bar_range(drawable, log),
        ),
        Axis("Model", names=labels(comparison.assessments)),
        capital(of_output(record, channel, "")),
        height=0.17 + 0.19 * len(rows),
    )


def _bar_range(values: Array, log: bool) -> tuple[float, float]:
    """The range from the base of the bars to a little beyond their ends."""
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    return (10.0 ** floor(log10(low) - 0.05), 1.5 * high) if log else (0.0, 1.05 * high)
