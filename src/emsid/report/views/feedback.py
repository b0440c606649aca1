"""Views of a feedback model: its static maps with bands, and the poles of the linear part at each level of their
inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.models.feedback.coordinates import Visited, free_lines
from emsid.models.feedback.curves import visited_in_free_run
from emsid.models.feedback.map_bands import map_band
from emsid.report.document import Axis, Dash, Figure, Ink, Line, Mark, Plot, Points, Stroke
from emsid.report.views.bands import with_band
from emsid.report.views.map_marks import BEYOND, POINTS, map_marks

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.feedback.model import FeedbackModel
    from emsid.record import Record


# Levels at which the poles are computed: quantiles of the input of a map, in three groups, and the size of points:
# later ones are smaller, so that equal poles show as rings.
LEVELS = (
    (np.linspace(0.01, 0.25, 9), Ink.BLUE, 1.6),
    (np.array([0.5]), Ink.NAVY, 1.1),
    (np.linspace(0.75, 0.99, 9), Ink.RED, 0.6),
)


def maps_in_feedback(fit: Fit[Any], record: Record, prefix: str) -> Figure | None:
    """Every static map of a feedback model with its band, over a histogram of its input in the record.

    Returns:
        None for one without maps.
    """
    model = fit.model
    if not model.maps:
        return None
    seen, plots = visited_in_free_run(model, record), []
    z, w = model.numbered("z"), model.names_of_outputs
    for k, each in enumerate(model.maps):
        low, high = float(seen.z[:, k].min()), float(seen.z[:, k].max())
        room = BEYOND * (high - low) or 1.0
        x = np.unique(np.concatenate([np.linspace(low - room, high + room, POINTS), each.breaks(low, high)]))
        band = map_band(fit, record, k, x)
        marks = map_marks(each, band, each.kind, seen.z[:, k])
        axes = Axis(f"{z[k]}, into the map", range=(float(x[0]), float(x[-1]))), Axis(f"{w[k]}, out of the map")
        title = f"Static map {k + 1}" if len(z) > 1 else "Static map"
        title += " (sensor)" if model.sensor is not None and k == 0 else ""
        plots.append(Plot(marks, *axes, title, height=1.6))
    of = f"Static {'map' if len(plots) == 1 else 'maps'} in the feedback of {model.name}"
    text = of + with_band(fit)
    if fit.has_bands and any(free_lines(model, k, seen.z[:, k]).size for k in range(len(z))):
        text += " of the shape: a line beside a map is a part of the linear system"
    return Figure(f"{prefix}-maps", f"{text}; grey: histogram of its input in {record.name}.", tuple(plots), columns=2)


ROOM, NEAREST = 1.2, 1e-3
"""Half the axis as a multiple of that of the poles, and the least half: poles closer together are drawn as one."""
TURN = 2000
"""Points of the unit circle, of which the axes may show a small part."""
SQUARE = 1.83
"""Height of a plot that takes half the width of a figure and is as high as wide."""


def poles_by_level(fit: Fit[Any], record: Record, prefix: str) -> Figure | None:
    """The poles of a feedback model, linearised where the input of each of its maps has small, middle and large values.

    Returns:
        None for one without maps or states.
    """
    model = fit.model
    if not model.maps or not model.states:
        return None
    seen = visited_in_free_run(model, record)
    step = "step" if model.oversampling > 1 else "sample"
    plots = tuple(_poles_along(model, seen, k) for k in range(len(model.maps)))
    several = "its map" if len(plots) == 1 else "each map, in the samples that have them"
    text = f"Poles of {model.name} per {step}, linearised at levels of the input of {several}, in {record.name}."
    return Figure(f"{prefix}-poles", text, plots, columns=2)


def around(poles: NDArray[np.complex128]) -> tuple[Axis, Axis]:
    """Axes of one scale that show these poles with some room around them; the real axis is in the middle.

    >>> [axis.range for axis in around(np.array([0.9, 1.0]))]
    [(0.89, 1.01), (-0.06, 0.06)]
    """
    low, high = float(poles.real.min()), float(poles.real.max())
    reach = ROOM * max((high - low) / 2, float(np.abs(poles.imag).max()), NEAREST)
    middle = (low + high) / 2
    real = (round(middle - reach, 6), round(middle + reach, 6))
    return Axis("Real part", "1", range=real), Axis("Imaginary part", "1", range=(-round(reach, 6), round(reach, 6)))


def _poles_along(model: FeedbackModel, seen: Visited, k: int) -> Plot:
    """The poles in the samples of a run in which the input of one map has certain levels."""
    n, z, g = model.states, seen.z, model.factor(seen.x, seen.u)
    name, turn = model.numbered("z")[k], np.linspace(0, 2 * np.pi, TURN)
    marks: list[Mark] = [Line(np.cos(turn), np.sin(turn), "unit circle", Stroke(Ink.GREY, Dash.DASHED, 0.8))]
    order = np.argsort(z[:, k], kind="stable")
    drawn = []
    for quantiles, ink, size in LEVELS:
        at = order[np.round(quantiles * (len(order) - 1)).astype(int)]
        found = np.concatenate([np.linalg.eigvals(model.linearised(z[t], g[t])[:n, :n]) for t in at])
        ends = [f"{z[t, k]:.3g}" for t in (at[0], at[-1])]
        label = f"{name} = {' to '.join(dict.fromkeys(ends))}"
        marks.append(Points(found.real.copy(), found.imag.copy(), label, ink, size=size))
        drawn.append(found)
    real, imaginary = around(np.concatenate(drawn))
    title = "Poles" if len(model.maps) == 1 else f"Poles, by map {k + 1}"
    return Plot(tuple(marks), real, imaginary, title, height=SQUARE)
