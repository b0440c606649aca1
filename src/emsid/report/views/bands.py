"""Curves of models with confidence bands: frequency response, static map and friction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from emsid.report.document import Axis, Band, Figure, Ink, Line, Mark, Plot, Stroke
from emsid.report.views.conventions import BAND, channel_axis

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.bands import Band as Computed
    from emsid.record import Record
    from emsid.validation.responses import BodeCurve


CURVE = Stroke(Ink.BLUE, width=1.4)
WIDEST = 1.0
"""Bands are drawn to this multiple of the range of their curve beyond it."""


def with_band(fit: Fit[Any]) -> str:
    """The part of a caption about the band."""
    if fit.has_bands:
        return f" with {BAND}"
    why = "the search ended before a minimum" if fit.has_intervals else "this fit has no intervals"
    return f" (no band, as {why})"


def magnitude_and_phase(
    several: Sequence[BodeCurve], labels: Sequence[str], strokes: Iterable[Stroke], of_band: str = ""
) -> tuple[Plot, Plot]:
    """Frequency responses in one axes for the magnitude and one for the phase.

    Args:
        several: responses.
        labels: for the legend, of every one.
        strokes: of them.
        of_band: for the legend.
    """
    f, inks = np.concatenate([each.magnitude.x for each in several]), list(islice(strokes, len(several)))
    frequency = Axis("Frequency", "Hz", log=True, range=(float(f.min()), float(f.max())))

    def plot(axis: Axis, bands: Sequence[Computed], named: Sequence[str], of_band: str) -> Plot:
        marks = (
            mark
            for band, label, stroke in zip(bands, named, inks, strict=True)
            for mark in curve_with_band(band, label, of_band, stroke)
        )
        return Plot(tuple(marks), frequency, limited(axis, *bands))

    return (
        plot(Axis("Magnitude", "dB"), [each.magnitude for each in several], labels, of_band),
        plot(Axis("Phase", "deg"), [each.phase for each in several], [""] * len(several), ""),
    )


def static_map(fit: Fit[Any], record: Record, *, name: str = "static-map") -> Figure:
    """The output of a model at rest over a constant input, with its band.

    Raises:
        ModelError: for a model that does not come to rest.
    """
    from emsid.validation.bands import static_map_band

    band = static_map_band(fit, record)
    x, y = (channel_axis(record.input_names[0], record.input_units[0]), _output(record))
    frictionless = hasattr(fit.model, "structure")
    without = f", without friction{',' * fit.has_bands}" if frictionless else ""
    caption = f"Output of {fit.model.name} at rest over a constant input{without}{with_band(fit)}."
    return Figure(name, caption, (Plot(curve_with_band(band, fit.model.name), x, limited(y, band), height=1.4),))


def regression_friction(fit: Fit[Any], record: Record, *, name: str = "friction") -> Figure:
    """Friction of a regression over the output, in units of the input, with its band.

    Raises:
        ModelError: for a model without terms that are nonlinear in past outputs.
    """
    from emsid.validation.bands import friction_band

    band = friction_band(fit, record)
    u = channel_axis(record.input_names[0], record.input_units[0])
    taken = replace(u, quantity=f"{u.quantity} that friction takes up")
    caption = f"Friction of {fit.model.name}{with_band(fit)}: what its terms in past outputs take of the input."
    plot = Plot(curve_with_band(band, fit.model.name), _output(record), limited(taken, band), height=1.4)
    return Figure(name, caption, (plot,))


def _output(record: Record) -> Axis:
    return channel_axis(record.output_names[0], record.output_units[0])


def curve_with_band(band: Computed, label: str, of_band: str = BAND, stroke: Stroke = CURVE) -> tuple[Mark, ...]:
    """The curve over its band.

    Args:
        band: with the curve.
        label, of_band: for the legend, of the curve and of the band.
        stroke: of the curve.
    """
    value = np.where(np.isfinite(band.value), band.value, np.nan)
    line = Line(band.x, value, label, stroke)
    known = np.isfinite(value) & np.isfinite(band.half)
    if not known.any():
        return (line,)
    return Band(band.x[known], band.low[known], band.high[known], of_band, stroke.ink), line


def limited(axis: Axis, *bands: Computed, least: float = 0.0) -> Axis:
    """The axis with a range that shows the curves and no more of their bands than fits beside them.

    Args:
        axis: of the values; it needs no range where it shows all of every band.
        bands: with the curves.
        least: the range spans this at least; 0 for any.
    """
    lows, highs = zip(*map(_reach, bands), strict=True)
    ends = np.concatenate([each[np.isfinite(each)] for band in bands for each in (band.value, band.low, band.high)])
    low, high = (max(min(lows), float(ends.min())), min(max(highs), float(ends.max()))) if len(ends) else (0.0, 0.0)
    cut = len(ends) > 0 and (low > ends.min() or high < ends.max())
    room = 0.06 * (high - low) + max(least - (high - low), 0.0) / 2
    return replace(axis, range=(low - room, high + room)) if cut or (room and least) else axis


def _reach(band: Computed) -> tuple[float, float]:
    """The largest range of the second axis that is drawn."""
    value = band.value[np.isfinite(band.value)]
    low, high = (float(value.min()), float(value.max())) if len(value) else (0.0, 0.0)
    room = WIDEST * (high - low or abs(high) or 1.0)
    return low - room, high + room
