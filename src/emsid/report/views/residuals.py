"""Plots of the residuals of free runs and of their correlations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.report.document import Axis, Dash, Figure, Histogram, Level, Line, Mark, Plot, Stroke
from emsid.report.views.conventions import MODELS, TIME, channels, of_output, output_axis, timeline, with_gaps
from emsid.units import name_and_unit
from emsid.validation.comparison import labels
from emsid.validation.correlation import LAGS, autocorrelation, cross_correlation, limit_over

if TYPE_CHECKING:
    from emsid.record import Record
    from emsid.validation.comparison import Assessment

Array = NDArray[np.float64]


def residuals(assessments: Sequence[Assessment], *, name: str = "residuals") -> Figure:
    """Free-run residuals of several models for every output: over time, as a histogram, and their correlations.

    The dashed lines are the limits of the residual tests: all lags of 99 of 100 independent residuals lie between them.
    The residual of the free run of a good model need not be white, because measurement noise is often coloured. It
    should be independent of the input: the cross-correlation with every input is shown in standard deviations for
    independent signals of the same colour, see `cross_correlation`.

    Args:
        assessments: models run over one record.
        name: of the figure.
    """
    record = assessments[0].record
    plots = [plot for channel in channels(record) for plot in _residual_plots(assessments, channel)]
    note = (
        " Correlation with inputs later than the residual (negative lags) shows feedback, with earlier ones what the "
    )
    crossed = any("correlation with" in plot.title for plot in plots)
    return Figure(
        name,
        f"Residuals of the free run on {record.name}.{f'{note}model has missed.' if crossed else ''}",
        tuple(plots),
        columns=2,
    )


Errors = Sequence[tuple[str, Stroke, Array]]
"""The label, the stroke, and the residual (N,) of every model, NaN where it does not count."""


def _residual_plots(assessments: Sequence[Assessment], channel: int) -> list[Plot]:
    """The plots of one output: over time, and where a residual is known, its distribution and its correlations."""
    record = assessments[0].record
    unit, whose = output_axis(record, channel).unit, of_output(record, channel)
    residuals = (
        np.where(each.simulation.counted, (record.output - each.simulation.output)[:, channel], np.nan)
        for each in assessments
    )
    errors = list(zip(labels(assessments), cycle(MODELS), residuals, strict=False))
    t, samples = timeline(record)
    over_time = tuple(Line(t, with_gaps(error, samples), label, _thin(stroke)) for label, stroke, error in errors)
    plots = [Plot(over_time, TIME, Axis("Residual", unit), f"Residual{whose}" if whose else "", span=2)]
    known = [each for each in errors if np.isfinite(each[2]).any()]
    if known:
        counted = [int(np.count_nonzero(each.simulation.counted)) for each in assessments]
        deviation = 1 / sqrt(max(counted[0], 1))
        plots += [_distribution(known, max(counted), unit, whose), _autocorrelations(known, record, deviation, whose)]
    return plots + _cross_correlations(known, record, whose)


def _thin(stroke: Stroke) -> Stroke:
    return Stroke(stroke.ink, Dash.SOLID, 0.8)


def _distribution(errors: Errors, samples: int, unit: str, whose: str) -> Plot:
    """Histograms with common edges; the axis begins below the share of a single sample."""
    edges = _histogram_edges([error for _, _, error in errors])
    marks = []
    for _, stroke, error in errors:
        known = error[np.isfinite(error)]
        share = 100 * np.histogram(np.clip(known, edges[0], edges[-1]), edges)[0] / len(known)
        marks.append(Histogram(edges, share, stroke=_thin(stroke)))
    share_axis = Axis("Share of samples", "%", log=True, range=(0.7 * (100 / samples), 130.0))
    return Plot(tuple(marks), Axis("Residual", unit), share_axis, f"Distribution{whose}")


def _autocorrelations(errors: Errors, record: Record, deviation: float, whose: str) -> Plot:
    """With the limits of white noise, whose correlations have this deviation."""
    marks: list[Mark] = []
    for _, stroke, error in errors:
        found = autocorrelation(error, record.breaks, LAGS)
        lag = record.dt * np.arange(len(found), dtype=np.float64)
        marks.append(Line(lag, found, stroke=Stroke(stroke.ink, stroke.dash)))
    limit = deviation * limit_over(len(found) - 1)
    marks += [Level(limit, "99 % limit of white noise"), Level(-limit)]
    return Plot(tuple(marks), Axis("Lag", "s"), Axis("Autocorrelation", "1"), f"Autocorrelation{whose}")


def _cross_correlations(errors: Errors, record: Record, whose: str) -> list[Plot]:
    """A plot for every input that is not constant; the last one is wide if it stands alone in its row."""
    drawn = []
    for name, u in zip(record.input_names, record.input.T, strict=True):
        marks = []
        for _, stroke, error in errors:
            found = cross_correlation(error, u, record.breaks, LAGS)
            lag = record.dt * np.arange(-(len(found) // 2), len(found) // 2 + 1, dtype=np.float64)
            if found.any():
                marks.append(Line(lag, found, stroke=Stroke(stroke.ink, stroke.dash)))
        if marks:
            drawn.append((name_and_unit(name)[0], limit_over(len(found) // 2 + 1), marks))
    wide = len(drawn) - 1 if len(drawn) % 2 else None
    return [
        _over_lags(marks, limit, f"Cross-correlation with {name}{whose}", 2 if k == wide else 1)
        for k, (name, limit, marks) in enumerate(drawn)
    ]


def _over_lags(marks: Sequence[Mark], limit: float, title: str, span: int = 1) -> Plot:
    """Correlations in standard deviations, with their limits for independent signals."""
    shown = (*marks, Level(limit, "99 % limit, all lags"), Level(-limit))
    return Plot(shown, Axis("Lag", "s"), Axis("In standard deviations", "1"), title, height=0.8, span=span)


def nonlinear_correlations(assessments: Sequence[Assessment]) -> Figure | None:
    """The residuals of free runs against u², u³, |u| and products, with the band of `nonlinear_tests`.

    Args:
        assessments: models run over one record.

    Returns:
        None where there is nothing to draw, as for inputs of two values.
    """
    record = assessments[0].record
    plots = [plot for channel in channels(record) for plot in _nonlinear_plots(assessments, channel)]
    if not plots:
        return None
    return Figure(
        "nonlinear-correlations",
        f"Residuals of the free run on {record.name} against nonlinear functions of the inputs, at samples before. A "
        "linear model passes the test against the input itself even where it lacks a nonlinearity: an even one shows "
        "in the square and the absolute value, an odd one such as a dead zone or dry friction in the cube, a gain that "
        "depends on the motion in the product with the simulated output.",
        tuple(plots),
        columns=2,
    )


def _nonlinear_plots(assessments: Sequence[Assessment], channel: int) -> list[Plot]:
    record = assessments[0].record
    marks: dict[str, list[Mark]] = {}
    limit = 0.0
    for label, stroke, each in zip(labels(assessments), cycle(MODELS), assessments, strict=False):
        for k, test in enumerate(each.nonlinear_tests[channel]):
            limit = max(limit, test.limit)
            lag = record.dt * np.arange(len(test.curve), dtype=np.float64)
            marks.setdefault(test.term, []).append(Line(lag, test.curve, "" if k else label, stroke))
    whose = of_output(record, channel, " of ")
    return [_over_lags(drawn, limit, f"Residual{whose} against {term}") for term, drawn in marks.items()]


def _histogram_edges(errors: Sequence[Array]) -> Array:
    """Common edges, symmetric about zero, for all residuals except the most extreme."""
    known = np.abs(np.concatenate(errors))
    known = known[np.isfinite(known)]
    reach = float(np.quantile(known, 0.999)) if len(known) else 1.0
    return np.linspace(-reach or -1.0, reach or 1.0, 62)
