"""Figures of analyses of one or several models: responses over time and frequency, poles and zeros."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.models.verbs import as_model
from emsid.report.document import Axis, Dash, Figure, Ink, Line, Mark, Plot, Points, Stroke
from emsid.report.views.bands import curve_with_band, limited, magnitude_and_phase
from emsid.report.views.cascade import NEAREST, SQUARE, around
from emsid.report.views.conventions import MEASURED, MODELS, TIME, channel_axis
from emsid.units import name_and_unit, with_unit
from emsid.validation.analysis import bode, pole_map, step
from emsid.validation.responses import BodeCurve, PoleMap, Several, TimeResponse

LEVELS = (Dash.DASHED, Dash.DOTTED, Dash.DASH_DOTTED)
"""Of noise, distortion and even distortion."""

if TYPE_CHECKING:
    from emsid.record import Record


def over_time(several: Sequence[TimeResponse], labels: Sequence[str], strokes: Sequence[Stroke] = MODELS) -> Figure:
    """Responses of the same quantity in one axes for every output."""
    first = several[0]
    plots: list[Plot] = []
    for k, (name, unit) in enumerate(first.outputs):
        marks: list[Mark] = []
        ones = [
            replace(each, value=_column(each.value, k), standard_error=_column(each.standard_error, k))
            for each in several
        ]
        for one, label, stroke in zip(ones, labels, cycle(strokes), strict=False):
            marks += curve_with_band(one, label, "", stroke)
        axis = channel_axis(name, unit)
        noisy = first.quantity == "Forecast"  # its band is the noise, which is to be seen
        plots.append(Plot(tuple(marks), TIME, axis if noisy else limited(axis, *ones)))
    return Figure("response", f"{first.quantity} of {_listed(labels)}{_bands(several)}.", tuple(plots), shared_x=True)


def over_frequency(several: Sequence[BodeCurve], labels: Sequence[str], strokes: Sequence[Stroke] = MODELS) -> Figure:
    """Frequency responses in one axes for the magnitude and one for the phase, and the coherence of records below."""
    plots: list[Plot] = [*magnitude_and_phase(several, labels, cycle(strokes))]
    levels = tuple(
        Line(each.magnitude.x, values, f"{name} of {label}", replace(stroke, dash=dash, width=0.8))
        for each, label, stroke in zip(several, labels, cycle(strokes), strict=False)
        for (name, values), dash in zip(each.levels.items(), LEVELS, strict=False)
    )
    if levels:  # below the response, which the limits of the axis are made for
        lowest = min(float(np.quantile(line.y[np.isfinite(line.y)], 0.1)) for line in levels)
        low, high = plots[0].y.range or (lowest, max(float(each.magnitude.value.max()) for each in several))
        y = replace(plots[0].y, range=(min(low, lowest - 5.0), high))
        plots[0] = replace(plots[0], marks=(*plots[0].marks, *levels), y=y)
    coherent = tuple(
        Line(each.magnitude.x, each.coherence, "", stroke)
        for each, stroke in zip(several, cycle(strokes), strict=False)
        if each.coherence is not None
    )
    if coherent:
        plots.append(Plot(coherent, plots[0].x, Axis("Coherence", "1", range=(0.0, 1.05)), height=0.6))
    bands = [each.magnitude for each in several]
    return Figure(
        "frequency-response", f"Frequency response of {_listed(labels)}{_bands(bands)}.", tuple(plots), shared_x=True
    )


def poles_and_zeros(several: Sequence[PoleMap], labels: Sequence[str], strokes: Sequence[Stroke] = MODELS) -> Figure:
    """Poles with their 95 % intervals and zeros, beside the limit of stability; zeros far away are left out."""
    discrete = several[0].dt is not None
    turn = np.linspace(0, 2 * np.pi, 361)
    grey = Stroke(Ink.GREY, Dash.DASHED, 0.8)
    marks: list[Mark] = [Line(np.cos(turn), np.sin(turn), "unit circle", grey)] if discrete else []
    poles = np.concatenate([each.poles for each in several])
    errors = np.nan_to_num(1.96 * np.concatenate([each.standard_error for each in several]))
    size = 0.0 if discrete else 0.5 * float(np.abs(poles).max(initial=0.0))
    least = max(NEAREST, size, float(np.abs(errors).max(initial=0.0)))
    x, y = around(poles if len(poles) else np.zeros(1, dtype=complex), least)
    for each, label, stroke in zip(several, labels, cycle(strokes), strict=False):
        ink = stroke.ink
        for pole, error in zip(each.poles, 1.96 * each.standard_error, strict=True):
            if np.isfinite(error):
                side = np.array([-1.0, 1.0])
                marks.append(Line(pole.real + side * error.real, np.full(2, pole.imag), "", Stroke(ink)))
                marks.append(Line(np.full(2, pole.real), pole.imag + side * error.imag, "", Stroke(ink)))
        marks.append(Points(each.poles.real.copy(), each.poles.imag.copy(), f"poles of {label}", ink))
        near = each.zeros[_within(x, each.zeros.real) & _within(y, each.zeros.imag)]
        if len(near):
            marks.append(Points(near.real.copy(), near.imag.copy(), f"zeros of {label}", ink, size=0.5))
    if not discrete:
        x, y = replace(x, unit="1/s"), replace(y, unit="1/s")
    known = any(np.isfinite(each.standard_error).any() for each in several)
    crosses = ", with 95 % intervals" if known else ""
    caption = f"Poles{crosses} and zeros (small) of {_listed(labels)}."
    return Figure("poles", caption, (Plot(tuple(marks), x, y, height=SQUARE),))


def _within(axis: Axis, values: NDArray[np.float64]) -> NDArray[np.bool_]:
    low, high = axis.range or (-np.inf, np.inf)
    return np.asarray((low < values) & (values < high))


def _column(values: np.ndarray, k: int) -> np.ndarray:
    return values if values.ndim == 1 else values[:, k]


def _listed(labels: Sequence[str]) -> str:
    return labels[0] if len(labels) == 1 else f"{', '.join(labels[:-1])} and {labels[-1]}"


def _bands(bands: Sequence[TimeResponse] | Sequence[object]) -> str:
    known = [getattr(band, "known", False) for band in bands]
    return f", with {100 * bands[known.index(True)].level:.0f} % bands" if any(known) else ""  # type: ignore[attr-defined]


def model_figures(
    models: Sequence[Any], steps: Sequence[tuple[float, float]], record: Record | None = None
) -> tuple[Figure, ...]:
    """Responses to steps beside the poles, and frequency responses, of several models as far as they have them.

    Models of other outputs, or in continuous and in discrete time, have axes of their own. Models are linearised where
    they rest after the step.

    Args:
        models: models or fits.
        steps: the levels before and after a step of every input.
        record: its frequency responses by averaged windows are drawn, too, with their coherence.
    """
    of = [*zip(models, cycle(MODELS), strict=False)]
    measured = [] if record is None else [(record, MEASURED)]
    outputs = 1 if record is None else record.output.shape[1]
    beside, over = list[Figure](), list[Figure]()
    linear = all(getattr(as_model(each), "is_linear", not hasattr(as_model(each), "maps")) for each in models)
    for k, (before, after) in enumerate(steps):
        to_step = partial(step, size=after - before, at=before, input=k)
        u, unit = ("", "") if record is None else (record.input_names[k], record.input_units[k])
        at, name = with_unit(f"{after:.4g}", unit), f" of {name_and_unit(u)[0]}" * bool(u)
        beside += _alike(of, to_step, over_time, lambda each: each.outputs, f" Step{name} from {before:.4g} to {at}.")
        for i in range(outputs):
            path = partial(bode, at=after, output=i, input=k)
            note = "" if record is None or len(steps) * outputs == 1 else f" From {u} to {record.output_names[i]}."
            note += "" if linear else f" Nonlinear models are linearised where they rest after the step, at {at}."
            over += _alike([*of, *measured], path, over_frequency, lambda each: None, note)
    beside += _alike(of, partial(pole_map, at=steps[0][1]), poles_and_zeros, lambda each: each.dt is None)
    plots = [replace(plot, height=SQUARE) for figure in beside for plot in figure.plots]
    columns = len(plots) if len(plots) in (1, 3) else 2
    captions = " ".join(dict.fromkeys(figure.caption for figure in beside))
    return (
        *([Figure("steps-and-poles", captions, tuple(plots), columns)] if plots else []),
        *(replace(each, name=f"{each.name}-{k}" if k else each.name) for k, each in enumerate(over)),
    )


def _alike(
    of: Sequence[tuple[Any, Stroke]],
    analyse: Callable[[Any], Any],
    drawn: Callable[..., Figure],
    kind: Callable[[Any], object],
    note: str = "",
) -> list[Figure]:
    """Figures of an analysis of the models that have it, those with results of one kind in one figure."""
    alike: dict[object, list[tuple[Any, Stroke]]] = {}
    for model, stroke in of:
        with suppress(EmsidError):  # without a linear part, or a sample time
            found = analyse(model)
            alike.setdefault(kind(found), []).append((found, stroke))
    figures = []
    for group in alike.values():
        several: Several[Any] = Several(each for each, _ in group)
        figure = drawn(several, several.labels, [stroke for _, stroke in group])
        figures.append(replace(figure, caption=figure.caption + note))
    return figures
