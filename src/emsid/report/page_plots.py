"""Plots of the page: the values that the template writes as HTML and SVG, computed from a `Plot`.

The lines of a plot are SVG paths that stretch with the width of the page. Titles, ticks and legends are HTML, so their
letters keep their size on a phone. The same markup serves for screen and print, with and without scripts; a short
script adds zooming. Texts are not escaped here: the template escapes them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import singledispatch
from math import ceil, floor, log10

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.report.document import (
    Axis,
    Band,
    Bars,
    Dash,
    Figure,
    Histogram,
    Level,
    Line,
    Mark,
    Plot,
    Points,
    Spans,
    Stroke,
    thin,
)
from emsid.report.numbers import tick

Array = NDArray[np.float64]

# Points of a line: about two in every pixel of a wide screen, the lowest and the highest value of each stretch.
PAGE_POINTS = 1600

# Coordinates inside a plot are integers from 0 to these limits: paths are short and can be enlarged twenty times.
WIDTH, HEIGHT = 20_000, 10_000

_ROW = 210  # the height of an ordinary plot, in pixels
_LETTER = 7.0  # the width of a digit of a tick, in pixels
_NARROW = 270.0  # the width of a plot on a phone, in pixels

_DASHES = {Dash.SOLID: "", Dash.DASHED: "7 4", Dash.DOTTED: "2 2.5", Dash.DASH_DOTTED: "8 3 2 3"}


@dataclass(frozen=True)
class Shape:
    """An SVG path.

    Attributes:
        path: its ``d``, in coordinates of the plot.
        stroke, width, dash: of its line; no line where the stroke is empty.
        fill, opacity: of its area; no area where the fill is empty.
        round: whether the ends of its lines are round, as of points.
    """

    path: str
    stroke: str = ""
    width: float = 1.0
    dash: str = ""
    fill: str = ""
    opacity: float = 1.0
    round: bool = False


@dataclass(frozen=True)
class Entry:
    """An entry of a legend.

    Attributes:
        label: its text.
        look: a sample of the mark, 24 by 10.
    """

    label: str
    look: Shape


@dataclass(frozen=True)
class Scale:
    """An axis between two values, which are logarithms to base ten where it is logarithmic.

    Attributes:
        low, high: its ends.
        log: whether it is logarithmic.
        ticks: where they stand, in percent of the length from the low end, and their labels.
    """

    low: float
    high: float
    log: bool
    ticks: tuple[tuple[float, str], ...]

    def place(self, values: ArrayLike, length: int) -> Array:
        """Positions of values on an axis of this length, from the low end."""
        x = np.asarray(values, dtype=float)
        if self.log:
            with np.errstate(divide="ignore", invalid="ignore"):
                x = np.log10(x)
        return length * (x - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Bar:
    """A bar of a chart of names.

    Attributes:
        name, remark: the text above it.
        length: in percent of the width; None for no bar.
        points: positions of points on it, in percent.
    """

    name: str
    remark: str
    length: float | None
    points: tuple[float, ...]


@dataclass(frozen=True)
class PagePlot:
    """A plot as the template sets it.

    Attributes:
        title, x_title, y_title: texts.
        x, y: its scales.
        shapes: what is drawn, the first at the bottom.
        height: in pixels.
        room: width for the tick labels at its left, in pixels.
        legend: its own; empty where the figure has one for all its plots.
        bars: for a chart of names, which has no y axis.
        span: its width in columns.
        notes: positions in percent of width and height, and the texts there.
    """

    title: str
    x_title: str
    y_title: str
    x: Scale
    y: Scale
    shapes: tuple[Shape, ...]
    height: int
    room: int
    legend: tuple[Entry, ...]
    bars: tuple[Bar, ...]
    span: int
    notes: tuple[tuple[float, float, str], ...] = ()


@dataclass(frozen=True)
class PageFigure:
    """A figure as the template sets it.

    Attributes:
        plots: row by row.
        legend: for all its plots; empty where each has its own.
    """

    plots: tuple[PagePlot, ...]
    legend: tuple[Entry, ...]


def page_figure(figure: Figure) -> PageFigure:
    """A figure as the template sets it: plots of one width and, where no two labels look alike, one legend."""
    legends = [tuple(_legend(plot.marks)) for plot in figure.plots]
    together = tuple(dict.fromkeys(entry for legend in legends for entry in legend))
    shared = len({entry.look for entry in together}) == len(together)
    scales = [_scales(plot) for plot in figure.plots]
    room = max(_tick_room(y) for _, y in scales)
    plots = tuple(
        _page_plot(plot, x, y, room, () if shared else legend)
        for plot, (x, y), legend in zip(figure.plots, scales, legends, strict=True)
    )
    return PageFigure(plots, together if shared else ())


def _page_plot(plot: Plot, x: Scale, y: Scale, room: int, legend: tuple[Entry, ...]) -> PagePlot:
    bars = tuple(_bars(plot, x)) if plot.y.names else ()
    shapes = () if bars else tuple(each for mark in plot.marks for each in _shapes(mark, x, y) if each.path)
    y_title = "" if bars else plot.y.title
    height, notes = round(_ROW * plot.height), () if bars else tuple(_notes(plot, x, y))
    return PagePlot(plot.title, plot.x.title, y_title, x, y, shapes, height, room, legend, bars, plot.span, notes)


def _notes(plot: Plot, x: Scale, y: Scale) -> Iterable[tuple[float, float, str]]:
    """The names of points."""
    for mark in plot.marks:
        if isinstance(mark, Points) and mark.names:
            places = zip(x.place(mark.x, 100), y.place(mark.y, 100), mark.names, strict=True)
            yield from ((round(float(a), 2), round(float(b), 2), text) for a, b, text in places if np.isfinite(b))


def _bars(plot: Plot, x: Scale) -> Iterable[Bar]:
    """The rows of a chart of names."""
    bars = next(mark for mark in plot.marks if isinstance(mark, Bars))
    points = [mark for mark in plot.marks if isinstance(mark, Points)]
    for k, (name, remark) in enumerate(zip(plot.y.names, bars.remarks, strict=True)):
        here = [float(x.place(v, 100)) for mark in points for v, row in zip(mark.x, mark.y, strict=True) if row == k]
        length = float(x.place(bars.values[k], 100)) if np.isfinite(bars.values[k]) else None
        yield Bar(
            name,
            remark,
            None if length is None else round(float(np.clip(length, 0, 100)), 2),
            tuple(round(place, 2) for place in here if 0 <= place <= 100),
        )


# --- scales -----------------------------------------------------------------------------------------------------------


def _scales(plot: Plot) -> tuple[Scale, Scale]:
    extents = [_extent(mark) for mark in plot.marks]
    x = _scale(plot.x, [x for x, _ in extents], 0.01, narrow=True)
    y = _scale(plot.y, [y for _, y in extents], 0.06, narrow=False)
    return x, y


def _scale(axis: Axis, values: Sequence[Array], margin: float, *, narrow: bool) -> Scale:
    """The scale of an axis: its range, or that of the values with a margin."""
    if axis.range is not None:
        low, high = (float(v) for v in (np.log10(axis.range) if axis.log else axis.range))
    else:
        known = np.concatenate([np.ravel(v) for v in values] or [np.zeros(0)])
        known = known[np.isfinite(known) & ((known > 0) | (not axis.log))]
        known = np.log10(known) if axis.log else known
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        room = margin * (high - low) or 0.05 * abs(high) or 1.0
        low, high = low - room, high + room
    if not high > low:  # a range that is one value
        low, high = low - 1.0, high + 1.0
    places = log_ticks(low, high) if axis.log else linear_ticks(low, high, 6)
    if narrow and not axis.log:  # fewer if their labels would touch on a phone
        most = 6
        while most > 2 and sum(_LETTER * (len(tick(v)) + 2) for v in places) > _NARROW:
            most -= 1
            places = linear_ticks(low, high, most)
    labelled = ((100 * ((log10(v) if axis.log else v) - low) / (high - low), tick(v)) for v in places)
    return Scale(low, high, axis.log, tuple((round(place, 3), text) for place, text in labelled))


def linear_ticks(low: float, high: float, most: int) -> list[float]:
    """At most this many round numbers, evenly spaced, between two values.

    >>> linear_ticks(-0.2, 20.2, 6), linear_ticks(0.0, 1.0, 3)
    ([0.0, 5.0, 10.0, 15.0, 20.0], [0.0, 0.5, 1.0])
    """
    smallest = (high - low) / most
    power = 10.0 ** floor(log10(smallest))
    for step in (f * power for f in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)):
        first, last = ceil(low / step - 1e-9), floor(high / step + 1e-9)
        if last - first + 1 <= most:
            digits = max(0, 1 - floor(log10(step)))
            return [round(k * step, digits) + 0.0 for k in range(first, last + 1)]
    return []


def log_ticks(low: float, high: float) -> list[float]:
    """Powers of ten between two logarithms, with twice and five times them where there are few.

    >>> log_ticks(-2.1, 1.0), log_ticks(0.0, 1.0)
    ([0.01, 0.1, 1.0, 10.0], [1.0, 2.0, 5.0, 10.0])
    """
    decades = range(floor(low), ceil(high) + 1)
    every = max(1, ceil(len(decades) / 7))
    factors = (1.0, 2.0, 5.0) if high - low < 1.7 else (1.0,)
    places = [float(f"{f:g}e{n}") for n in decades if n % every == 0 for f in factors]
    return [v for v in places if low - 1e-9 <= log10(v) <= high + 1e-9]


def _tick_room(y: Scale) -> int:
    return round(max((len(text) for _, text in y.ticks), default=0) * _LETTER) + 12


@singledispatch
def _extent(mark: Mark) -> tuple[Array, Array]:
    """The values of a mark that its axes must show."""
    raise TypeError(f"no extent of {type(mark).__name__}")


@_extent.register(Line)
@_extent.register(Points)
def _(mark: Line | Points) -> tuple[Array, Array]:
    return mark.x, mark.y


@_extent.register(Band)
def _(mark: Band) -> tuple[Array, Array]:
    return mark.x, np.concatenate([mark.lower, mark.upper])


@_extent.register(Histogram)
def _(mark: Histogram) -> tuple[Array, Array]:
    return mark.edges, np.zeros(0) if mark.backdrop else mark.heights


@_extent.register(Bars)
def _(mark: Bars) -> tuple[Array, Array]:
    return mark.values, np.arange(len(mark.values), dtype=float)


@_extent.register(Level)
def _(mark: Level) -> tuple[Array, Array]:
    return np.zeros(0), np.array([mark.value])


@_extent.register(Spans)
def _(mark: Spans) -> tuple[Array, Array]:
    return np.zeros(0), np.zeros(0)


# --- paths ------------------------------------------------------------------------------------------------------------


def path(x: ArrayLike, y: ArrayLike) -> str:
    """An SVG path through points in coordinates of the plot, with a gap where one is not a number.

    >>> path([0, 10, 20, 30, 40], [5, 6, float("nan"), 1, 2])
    'M0 5l10 1M30 1l10 1'
    """
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    known = np.isfinite(xs) & np.isfinite(ys)
    # A line far outside the plot is cut, because browsers cannot draw very large coordinates.
    whole = np.rint(
        np.stack([np.clip(xs, -WIDTH, 2 * WIDTH), np.clip(ys, -20 * HEIGHT, 20 * HEIGHT)])[:, known]
    ).astype(int)
    places = np.flatnonzero(known)
    pieces = np.split(whole, np.flatnonzero(np.diff(places) > 1) + 1, axis=1) if len(places) else []
    return "".join(map(_piece, pieces))


def _piece(points: NDArray[np.int_]) -> str:
    steps = np.diff(points, axis=1).T.ravel()
    along = f"l{' '.join(map(str, steps.tolist()))}" if len(steps) else "h0"
    return f"M{points[0, 0]} {points[1, 0]}{along}".replace(" -", "-")


def _stairs(x: Array, y: Array) -> tuple[Array, Array]:
    """A line that keeps every value until the next x."""
    return np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]


def _line(d: str, stroke: Stroke) -> Shape:
    return Shape(d, stroke.ink.value, round(1.25 * stroke.width, 2), _DASHES[stroke.dash])


@singledispatch
def _shapes(mark: Mark, x: Scale, y: Scale) -> list[Shape]:
    """The shapes of a mark."""
    raise TypeError(f"no shapes of {type(mark).__name__}")


@_shapes.register(Line)
def _(mark: Line, x: Scale, y: Scale) -> list[Shape]:
    xs, ys = thin(mark.x, mark.y, PAGE_POINTS)
    if mark.stairs:
        xs, ys = _stairs(xs, ys)
    return [_line(path(x.place(xs, WIDTH), HEIGHT - y.place(ys, HEIGHT)), mark.stroke)]


@_shapes.register(Points)
def _(mark: Points, x: Scale, y: Scale) -> list[Shape]:
    places = zip(x.place(mark.x, WIDTH), HEIGHT - y.place(mark.y, HEIGHT), strict=True)
    return [Shape("".join(path([a], [b]) for a, b in places), mark.ink.value, 6.0, round=True)]


@_shapes.register(Band)
def _(mark: Band, x: Scale, y: Scale) -> list[Shape]:
    known = np.isfinite(mark.lower) & np.isfinite(mark.upper)
    xs, low, high = mark.x[known], mark.lower[known], mark.upper[known]
    if not len(xs):
        return []
    around = path(
        x.place(np.concatenate([xs, xs[::-1]]), WIDTH), HEIGHT - y.place(np.concatenate([high, low[::-1]]), HEIGHT)
    )
    return [Shape(f"{around}z", fill=mark.ink.value, opacity=0.18)]


@_shapes.register(Histogram)
def _(mark: Histogram, x: Scale, y: Scale) -> list[Shape]:
    xs, ys = _stairs(mark.edges, np.append(mark.heights, mark.heights[-1:]))
    if not mark.backdrop:
        if y.log:  # a bar of height zero is not drawn
            ys = np.where(ys > 0, ys, 10.0 ** (y.low - 1))
        return [_line(path(x.place(xs, WIDTH), HEIGHT - y.place(ys, HEIGHT)), mark.stroke)]
    highest = 4 * float(np.max(mark.heights, initial=0)) or 1.0
    places = x.place(np.concatenate([xs[:1], xs, xs[-1:]]), WIDTH)
    area = path(places, HEIGHT * (1 - np.concatenate([[0.0], ys, [0.0]]) / highest))
    return [Shape(f"{area}z", fill=mark.stroke.ink.value, opacity=0.25)]


@_shapes.register(Bars)
def _(mark: Bars, x: Scale, y: Scale) -> list[Shape]:
    return []  # rows of the page, not shapes: see `_bars`


@_shapes.register(Level)
def _(mark: Level, x: Scale, y: Scale) -> list[Shape]:
    height = HEIGHT - y.place([mark.value] * 2, HEIGHT)
    return [_line(path([0, WIDTH], height), mark.stroke)]


@_shapes.register(Spans)
def _(mark: Spans, x: Scale, y: Scale) -> list[Shape]:
    edges = x.place(mark.edges, WIDTH)
    areas = "".join(f"M{round(a)}-{10 * HEIGHT}H{round(b)}V{11 * HEIGHT}H{round(a)}z" for a, b in edges)
    # With an edge, so that short ones are seen.
    return [Shape(areas, mark.ink.value, 0.5, fill=mark.ink.value, opacity=0.22)] if areas else []


# --- legends ----------------------------------------------------------------------------------------------------------


def _legend(marks: Sequence[Mark]) -> Iterable[Entry]:
    """The entries of the marks that have a label."""
    for mark in marks:
        if not mark.label:
            continue
        if isinstance(mark, Line | Level):
            look = _line("M0 5h24", mark.stroke)
        elif isinstance(mark, Histogram) and not mark.backdrop:
            look = _line("M0 9v-5h8v-3h8v4h8v4", mark.stroke)
        elif isinstance(mark, Points):
            look = Shape("M12 5h0", mark.ink.value, 6.0, round=True)
        else:
            ink = mark.stroke.ink if isinstance(mark, Histogram) else mark.ink
            look = Shape("M0 0h24v10h-24z", fill=ink.value, opacity=0.75 if isinstance(mark, Bars) else 0.25)
        yield Entry(mark.label, look)
