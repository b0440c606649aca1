"""Plots of the residuals of free runs and of their correlations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from emsid.report.document import Axis, Dash, Figure, Histogram, Level, Line, Mark, Plot, Stroke
from emsid.report.views.conventions import MODELS, channels, labels, of_output, output_axis
from emsid.report.views.timeline import TIME, timeline, with_gaps
from emsid.validation.correlation import autocorrelation, cross_correlation

if TYPE_CHECKING:
    from emsid.validation.comparison import Assessment

Array = NDArray[np.float64]


# 99 of 100 normal deviates are smaller.
WHITE = 2.5758


def residuals(assessments: Sequence[Assessment], *, name: str = "residuals") -> Figure:
    """Free-run residuals of several models for every output: over time, as a histogram, and their correlations.

    For white noise, 99 of 100 autocorrelations lie between the dashed lines, ±2.58/√N. The residual of the free run
    of a good model need not be white, because measurement noise is often coloured. It should be independent of the
    input: the cross-correlation with every input is shown in standard deviations for independent signals of the same
    colour, see `cross_correlation`.

    Args:
        assessments: models run over one record.
        name: of the figure.
    """
    record = assessments[0].record
    most = int(np.clip(round(1 / record.dt), 20, 400))  # lags in samples: a second, within limits
    plots = [plot for channel in channels(record) for plot in _residual_plots(assessments, channel, most)]
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


def _residual_plots(assessments: Sequence[Assessment], channel: int, most: int) -> list[Plot]:
    record = assessments[0].record
    unit, whose = output_axis(record, channel).unit, of_output(record, channel)
    t, samples = timeline(record)
    over_time: list[Mark] = []
    shares: list[Mark] = []
    correlations: list[Mark] = []
    crossed: list[list[Mark]] = [[] for _ in record.input_names]
    counted = [each.simulation.counted for each in assessments]
    errors = [
        np.where(c, (record.output - each.simulation.output)[:, channel], np.nan)
        for each, c in zip(assessments, counted, strict=True)
    ]
    edges = _histogram_edges(errors)
    for label, stroke, error in zip(labels(assessments), cycle(MODELS), errors, strict=False):
        thinner = Stroke(stroke.ink, Dash.SOLID, 0.8)
        over_time.append(Line(t, with_gaps(error, samples), label, thinner))
        known = error[np.isfinite(error)]
        if not len(known):
            continue
        share = 100 * np.histogram(np.clip(known, edges[0], edges[-1]), edges)[0] / len(known)
        shares.append(Histogram(edges, share, stroke=thinner))
        broken = Stroke(stroke.ink, stroke.dash)
        correlation = autocorrelation(error, record.breaks, most)
        correlations.append(Line(record.dt * np.arange(len(correlation), dtype=np.float64), correlation, stroke=broken))
        for marks, u in zip(crossed, record.input.T, strict=True):
            with_input = cross_correlation(error, u, record.breaks, most)
            lag = record.dt * np.arange(-(len(with_input) // 2), len(with_input) // 2 + 1, dtype=np.float64)
            if with_input.any():
                marks.append(Line(lag, with_input, stroke=broken))
    band = WHITE / sqrt(max(int(np.count_nonzero(counted[0])), 1))
    correlations += [Level(band, "99 % of white noise"), Level(-band)]
    title = f"Residual{whose}" if whose else ""
    plots = [Plot(tuple(over_time), TIME, Axis("Residual", unit), title, span=2)]
    if shares:
        rarest = 100 / max(int(np.count_nonzero(each)) for each in counted)
        share_axis = Axis("Share of samples", "%", log=True, range=(0.7 * rarest, 130.0))
        plots += [
            Plot(tuple(shares), Axis("Residual", unit), share_axis, f"Distribution{whose}"),
            Plot(tuple(correlations), Axis("Lag", "s"), Axis("Autocorrelation", "1"), f"Autocorrelation{whose}"),
        ]
    drawn = [(name, marks) for name, marks in zip(record.input_names, crossed, strict=True) if marks]
    for k, (name, marks) in enumerate(drawn):
        title, last_alone = f"Cross-correlation with {name}{whose}", k % 2 == 0 and k == len(drawn) - 1
        plots.append(_over_lags(marks, WHITE, "99 % if independent", title, span=2 if last_alone else 1))
    return plots


def _over_lags(marks: Sequence[Mark], limit: float, label: str, title: str, span: int = 1) -> Plot:
    """Correlations in standard deviations, with their limits for independent signals."""
    shown = (*marks, Level(limit, label), Level(-limit))
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
    whose, label = of_output(record, channel, " of "), "99 % if independent, all lags"
    return [_over_lags(drawn, limit, label, f"Residual{whose} against {term}") for term, drawn in marks.items()]


def _histogram_edges(errors: Sequence[Array]) -> Array:
    """Common edges, symmetric about zero, for all residuals except the most extreme."""
    known = np.abs(np.concatenate(errors))
    known = known[np.isfinite(known)]
    reach = float(np.quantile(known, 0.999)) if len(known) else 1.0
    return np.linspace(-reach or -1.0, reach or 1.0, 62)
