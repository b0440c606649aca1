"""Free runs with measured outputs, and models ranked by their free runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle
from math import floor, log10
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.errors import listed
from emsid.report.document import Axis, Band, Bars, Figure, Ink, Line, Mark, Plot, Points, Spans, Stroke
from emsid.report.numbers import capital, number, percent
from emsid.report.views.conventions import MEASURED, MODELS, channels, labels, of_output, output_axis
from emsid.report.views.timeline import TIME, timeline, with_gaps
from emsid.units import with_unit

if TYPE_CHECKING:
    from emsid.models.bands import Band as Computed
    from emsid.validation.comparison import Assessment, Comparison, OutputErrors, Row

Array = NDArray[np.float64]


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
