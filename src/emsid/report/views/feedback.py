"""Views of a feedback model: its static maps with bands, and the poles of the linear part at each level of their
inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from emsid.models.feedback.coordinates import free_lines
from emsid.models.feedback.model import FeedbackModel
from emsid.report.document import Axis, Band, Dash, Figure, Ink, Line, Mark, Plot, Points, Stroke
from emsid.report.views.bands import reach, with_band
from emsid.report.views.conventions import BAND
from emsid.report.views.map_marks import BEYOND, POINTS, map_curve, map_marks
from emsid.validation.feedback_curves import visited
from emsid.validation.map_bands import map_band

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.record import Record


# Levels at which the poles are computed: quantiles of the input of the map, in three groups, and the size of points:
# later ones are smaller, so that equal poles show as rings.
LEVELS = {
    "small z": (np.linspace(0.01, 0.25, 9), Ink.BLUE, 1.6),
    "middle": (np.array([0.5]), Ink.NAVY, 1.1),
    "large z": (np.linspace(0.75, 0.99, 9), Ink.RED, 0.6),
}


def maps_in_feedback(fit: Fit[Any], record: Record, prefix: str) -> Figure | None:
    """Every static map of a feedback model with its band, over a histogram of its input in the record.

    Returns:
        None for another kind of model, or one without maps.
    """
    model = fit.model
    if not isinstance(model, FeedbackModel) or not model.maps:
        return None
    seen, plots = visited(model, record), []
    z, w = model.numbered("z"), model.names_of_outputs
    for k, each in enumerate(model.maps):
        low, high = float(seen.z[:, k].min()), float(seen.z[:, k].max())
        room = BEYOND * (high - low) or 1.0
        x = np.unique(np.concatenate([np.linspace(low - room, high + room, POINTS), each.breaks(low, high)]))
        band = map_band(fit, record, k, x)
        below, above = (np.clip(edge, *reach(band)) for edge in (band.low, band.high))
        bands = [Band(x, below, above, BAND)] if band.known else []
        marks = map_marks(each, map_curve(x, band.value, each.kind), bands, seen.z[:, k])
        axes = Axis(f"{z[k]}, into the map", range=(float(x[0]), float(x[-1]))), Axis(f"{w[k]}, out of the map")
        plots.append(Plot(marks, *axes, f"Static map {k + 1}" if len(z) > 1 else "Static map", height=1.6))
    of = f"Static {'map' if len(plots) == 1 else 'maps'} in the feedback of {model.name}"
    text = of + with_band(fit)
    if fit.has_bands and any(free_lines(model, k, seen.z[:, k]).size for k in range(len(z))):
        text += " of the shape: a line beside a map is a part of the linear system"
    return Figure(f"{prefix}-maps", f"{text}; grey: histogram of its input in {record.name}.", tuple(plots), columns=2)


SQUARE = 1.83
"""Height of a plot that takes half the width of a figure and is as high as wide."""


def poles_by_level(fit: Fit[Any], record: Record, prefix: str) -> Figure | None:
    """The poles of a feedback model, linearised at the levels that the input of its first map has in the record.

    Returns:
        None for another kind of model, or one without maps or states.
    """
    model = fit.model
    if not isinstance(model, FeedbackModel) or not model.maps or not model.states:
        return None
    seen, n = visited(model, record), model.states
    z, g = np.median(seen.z, axis=0), np.median(model.factor(seen.x, seen.u), axis=0)
    turn = np.linspace(0, 2 * np.pi, 200)
    marks: list[Mark] = [Line(np.cos(turn), np.sin(turn), "unit circle", Stroke(Ink.GREY, Dash.DASHED, 0.8))]
    reach = 1.1
    for label, (quantiles, ink, size) in LEVELS.items():
        at = [np.append(each, z[1:]) for each in np.quantile(seen.z[:, 0], quantiles)]
        found = np.concatenate([np.linalg.eigvals(model.linearised(each, g)[:n, :n]) for each in at])
        marks.append(Points(found.real.copy(), found.imag.copy(), label, ink, size=size))
        reach = max(reach, 1.05 * float(np.abs(found).max()))
    real, imaginary = (Axis(part, "1", range=(-reach, reach)) for part in ("Real part", "Imaginary part"))
    step = "step" if model.oversampling > 1 else "sample"
    return Figure(
        f"{prefix}-poles",
        f"Poles of {model.name} per {step}, linearised at the levels of {model.numbered('z')[0]} in {record.name} "
        "(other maps at the middle of theirs).",
        (Plot(tuple(marks), real, imaginary, "Poles", height=SQUARE),),
        columns=2,
    )
