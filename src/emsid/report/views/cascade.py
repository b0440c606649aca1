"""Views of a cascade: its static maps with histograms of their inputs, and the frequency responses of its filters.

Views of a feedback model: its static maps with bands, and the poles of the linear part at each level of their
inputs.

What the plot of a static map shows, in a cascade as in a feedback model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import listed
from emsid.models.bands import Band as Computed
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import static_band
from emsid.models.blocks.gain import fixed_gains
from emsid.models.blocks.static_maps import Scaling, StaticMap
from emsid.models.feedback.coordinates import Visited, free_lines
from emsid.models.feedback.curves import map_band, visited_in_free_run
from emsid.models.one_channel import check_one_channel
from emsid.report.document import Axis, Dash, Figure, Histogram, Ink, Line, Mark, Plot, Points, Stroke
from emsid.report.numbers import capital, slug
from emsid.report.views.bands import curve_with_band, limited, with_band

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.feedback.model import FeedbackModel
    from emsid.record import Record


Array = NDArray[np.float64]

# A response is drawn at this many frequencies, over at least this many decades.
FREQUENCIES, DECADES = 500, 3.0
# A response has no band if its relative error is larger than this at all frequencies.
TOO_WIDE = 5.0
# Unit of signals between blocks, whose scale is a convention.
CONVENTIONAL = "normalised"
_STROKES = (Stroke(Ink.BLUE, width=1.4), Stroke(Ink.RED, Dash.DASHED, 1.3), Stroke(Ink.GREEN, Dash.DASH_DOTTED, 1.3))


def static_maps(fit: Fit[Cascade], record: Record, *, name: str = "") -> Figure | None:
    """Every static map of a cascade with its confidence band and a histogram of its input signal.

    The axis is a little wider than the range of the signal in this record. Dots mark knots, break points and limits.

    Args:
        fit: of a cascade, in the normalisation it was fitted in.
        record: of one input and one output, whose signal is shown.
        name: of the figure, by default after the model.

    Returns:
        None for a cascade without a static map.

    Raises:
        ModelError: for a record of other channels.
    """
    model = fit.model
    at = list(model.maps)
    if not at:
        return None
    check_one_channel(model.name, record)
    entering = _entering(model, record, at)
    plots = [_map_plot(fit, k, x, record) for k, x in zip(at, entering, strict=True)]
    spread = zip(fit.names, np.diag(fit.covariance) if fit.has_intervals else (), strict=fit.has_intervals)
    lost = [n for n, v in spread if n[0] == "f" and not np.isfinite(v)]
    unknown = f" The band excludes {listed(lost)}, which the data do not determine." if lost else ""
    return Figure(
        name or f"{slug(model.name)}-static-maps",
        f"Static {'map' if len(at) == 1 else 'maps'} of {model.name}{with_band(fit)}; grey: "
        f"histogram of the input signal of the map in {record.name}.{unknown}",
        tuple(plots),
        columns=min(len(at), 2),
    )


def frequency_responses(fit: Fit[Cascade], dt: float, *, name: str = "") -> Figure | None:
    """Magnitude and phase of every filter of a cascade, up to half the sampling rate of the record.

    Args:
        fit: of a cascade.
        dt: sample time of the record in seconds; the blocks may run faster.
        name: of the figure, by default after the model.

    Returns:
        None for a cascade without a filter.
    """
    model = fit.model
    inside = dt / model.oversampling
    filters = model.filters
    if not filters:
        return None
    f = _frequencies(list(filters.values()), dt, inside, fit.samples * dt)
    magnitudes, phases, unknown = zip(*(_filter_response(fit, k, f, inside) for k in filters), strict=True)
    late = (
        f" The input delay of {model.delay} {'sample' if model.delay == 1 else 'samples'} is not included."
        if model.delay
        else ""
    )
    names = [block_name(model, k) for k in filters]
    undetermined = [each for each, without in zip(names, unknown, strict=True) if without]
    if undetermined:
        late += f" {' and '.join(undetermined)} without band: the data do not determine the parameters separately."
    labels = [f"filter {each} (block {k + 1})" for each, k in zip(names, filters, strict=True)]
    frequency = Axis("Frequency", "Hz", log=True, range=(float(f[0]), float(f[-1])))
    return Figure(
        name or f"{slug(model.name)}-filters",
        f"Frequency {'response of the filter' if len(filters) == 1 else 'responses of the filters'} of {model.name}"
        f"{with_band(fit)}, up to half the sampling rate.{late}",
        (
            _response_plot(magnitudes, labels, frequency, Axis("Magnitude", "dB"), 20.0),
            _response_plot(phases, [""] * len(labels), frequency, Axis("Phase", "deg"), 45.0),
        ),
        shared_x=True,
    )


def _filter_response(fit: Fit[Cascade], k: int, f: Array, inside: float) -> tuple[Computed, Computed, bool]:
    """Magnitude and phase of a filter, and whether the data do not determine it, so that it has no band."""
    response, relative = fit.model.filters[k].response(f, inside), _relative_error(fit, k, f, inside)
    undetermined = fit.has_bands and bool(np.all(relative[0] > TOO_WIDE))  # the rest is only rounding
    if undetermined or not fit.has_bands:
        relative = np.full_like(relative, np.nan)
    with np.errstate(divide="ignore"):
        size = 20 * np.log10(np.abs(response))
    magnitude = Computed(f, size, 20 / np.log(10) * relative[0], 0.95)
    phase = Computed(f, np.degrees(np.unwrap(np.angle(response))), np.degrees(relative[1]), 0.95)
    return magnitude, phase, undetermined


def _response_plot(bands: Sequence[Computed], labels: Sequence[str], frequency: Axis, axis: Axis, least: float) -> Plot:
    """One quantity of every filter with its band, over frequency; the axis spans ``least`` at least."""
    curves = zip(bands, labels, cycle(_STROKES), strict=False)
    marks = tuple(mark for band, label, stroke in curves for mark in curve_with_band(band, label, "", stroke))
    return Plot(marks, frequency, limited(axis, *bands, least=least))


def cascade_equations(model: Cascade) -> str:
    """One line per block, as `Cascade.equation`, with the number of knots in place of a long list of them."""
    lines = model.equation().split("\n")
    first = len(lines) - len(model.blocks)
    for k, block in model.maps.items():
        entering = lines[first + k - 1].partition(" = ")[0] if first + k else "u(t)"
        long = block.expression(entering)
        lines[first + k] = lines[first + k].replace(long, block.summary(entering))
    return "\n".join(lines)


def block_column(fit: Fit[Cascade]) -> dict[str, tuple[str, ...]]:
    """A column of `parameter_table`: the meaning of every parameter of a cascade."""
    model = fit.model
    explained: dict[int, Callable[[str], str]] = {k: each.meaning for k, each in model.filters.items()}
    explained |= {k: each.meaning for k, each in model.maps.items()}
    meaning: dict[str, str] = {"u0": "input offset", "y0": "output offset"}
    for k, (block, span) in enumerate(zip(model.blocks, model.spans, strict=True)):
        for own, name in zip(block.names, model.names[span], strict=True):
            meaning[name] = f"{explained[k](own) if k in explained else 'own block'} (block {k + 1})"
    return {"Meaning": tuple(meaning.get(name, "") for name in fit.names)}


def block_name(model: Cascade, k: int) -> str:
    """The prefix of the parameter names of a block: G1, f."""
    names = model.names[model.spans[k]]
    return names[0].split(".")[0] if names else "f"


def _entering(model: Cascade, record: Record, at: Sequence[int]) -> list[Array]:
    """The input signals of the blocks ``at`` over all segments, without transients if possible."""
    seen: list[list[Array]] = [[] for _ in at]
    long = [segment for segment in record.segments if len(segment) > model.memory]
    for segment in long or record.segments:
        u, y = segment.input[:, 0], segment.output[:, 0]
        start = model.initial_state(u[: model.memory], y[: model.memory]) if long else model.resting(float(u[0]))
        signals = model.signals(u, start)
        for pieces, k in zip(seen, at, strict=True):
            pieces.append(signals[k][model.memory * model.oversampling if long else 0 :])
    whole = [np.concatenate(pieces) for pieces in seen]
    return [x[np.isfinite(x)] if np.isfinite(x).any() else np.zeros(1) for x in whole]


def _map_plot(fit: Fit[Cascade], k: int, seen: Array, record: Record) -> Plot:
    model = fit.model
    block = model.maps[k]
    low, high = float(seen.min()), float(seen.max())
    room = BEYOND * (high - low) or 0.05 * abs(high) or 1.0
    low, high = low - room, high + room
    corners = block.marks()[0]
    corners = corners[(corners >= low) & (corners <= high)]
    x = np.unique(np.concatenate([np.linspace(low, high, POINTS), corners, block.breaks(low, high)]))
    value, error = static_band(fit, k, x).T
    band = Computed(x, value, error if fit.has_bands else np.full_like(error, np.nan), 0.95)
    label = f"{block_name(model, k)}: {block.kind}"
    into, out = _units(model, k, record)
    first, last = k == 0, k == len(model.blocks) - 1
    return Plot(
        map_marks(block, band, label, seen),
        Axis(f"{capital(record.input_names[0]) if first else f'x{k}'}, into the map", into, range=(low, high)),
        limited(Axis(f"{capital(record.output_names[0]) if last else f'x{k + 1}'}, out of the map", out), band),
        f"Static map, block {k + 1}" if len(model.blocks) > 1 else "Static map",
        height=1.6,
    )


def _units(model: Cascade, k: int, record: Record) -> tuple[str, str]:
    """Units of the input and output of a map: those of the record, if only unit gains stand between."""
    fixed = set(fixed_gains(model))

    def carries(j: int) -> bool:
        return j in fixed or (j in model.maps and model.maps[j].scaling is Scaling.JOINT)

    into = record.input_units[0] if all(carries(j) for j in range(k)) else CONVENTIONAL
    out = record.output_units[0] if all(carries(j) for j in range(k + 1, len(model.blocks))) else CONVENTIONAL
    if model.maps[k].scaling is Scaling.JOINT:
        out = into if out == CONVENTIONAL else out
        into = out if into == CONVENTIONAL else into
    return into, out


def _frequencies(filters: Sequence[Rational], dt: float, inside: float, seconds: float) -> Array:
    """(FREQUENCIES,) to half the sampling rate, from a decade below the slowest corner, three decades at least.

    Frequencies whose period is longer than ten records are left out.
    """
    top = 0.5 / dt
    poles = np.concatenate([block.poles for block in filters])
    slow = np.abs(np.log(poles[np.abs(poles) > 0])) / (2 * np.pi * inside)
    slowest = max(0.1 * float(np.min(slow[slow > 0], initial=top)), 0.1 / max(seconds, dt))
    first = min(top / 10**DECADES, slowest)
    return np.asarray(np.geomspace(max(first, 1e-7 * top), top, FREQUENCIES), dtype=float)


def _relative_error(fit: Fit[Cascade], k: int, f: Array, inside: float) -> Array:
    """(2, m) standard errors of log magnitude and phase (rad) of a filter, to first order.

    With H = B/A in z⁻¹ = exp(−j2πfΔt), δH/H = Σ z⁻ʲ δbⱼ/B − Σ z⁻ʲ δaⱼ/A.
    """
    model = fit.model
    block, span = model.filters[k], model.spans[k]
    z = np.exp(-2j * np.pi * f * inside)
    nb, na = len(block.numerator), len(block.denominator)
    above = np.polynomial.polynomial.polyval(z, block.numerator)
    below = np.polynomial.polynomial.polyval(z, np.concatenate([[1.0], block.denominator]))
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.array([z**j / above for j in range(nb)] + [-(z**j) / below for j in range(1, na + 1)])
    columns = [j for j, name in enumerate(fit.names) if name in model.names[span]]
    rows = slopes[[model.names.index(fit.names[j]) - span.start for j in columns]]
    covariance = fit.covariance[np.ix_(columns, columns)]
    covariance = np.where(np.isfinite(covariance), covariance, 0.0)
    variances = [np.einsum("im,ij,jm->m", part, covariance, part) for part in (rows.real, rows.imag)]
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


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


def around(poles: NDArray[np.complex128], least: float = NEAREST) -> tuple[Axis, Axis]:
    """Axes of one scale that show these poles with some room around them; the real axis is in the middle.

    Args:
        poles: what they show.
        least: from their middle to their ends, without the room.

    >>> [axis.range for axis in around(np.array([0.9, 1.0]))]
    [(0.89, 1.01), (-0.06, 0.06)]
    """
    low, high = float(poles.real.min()), float(poles.real.max())
    reach = ROOM * max((high - low) / 2, float(np.abs(poles.imag).max()), least)
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


BEYOND, POINTS = 0.04, 400
"""A map is drawn this fraction of the range beyond the data, through this many points."""
BINS = 80
"""Of the histogram of the input."""


def map_marks(shown: StaticMap, curve: Computed, label: str, entering: Array) -> tuple[Mark, ...]:
    """A histogram of the input of a map, its band, its curve, and its knots, break points or limits.

    Args:
        shown: the map.
        curve: of the map with its band, over the range of the axis.
        label: of the curve.
        entering: (K,) inputs of the map in a record.
    """
    low, high = curve.x[0], curve.x[-1]
    edges = np.linspace(low, high, BINS + 1)
    counts = np.histogram(entering, edges)[0].astype(float)
    corners, what = shown.marks()
    corners = corners[(corners >= low) & (corners <= high)]
    points = [Points(corners, shown.value(corners), what, Ink.NAVY)] if len(corners) else []
    return (Histogram(edges, counts, "signal in this record", backdrop=True), *curve_with_band(curve, label), *points)
