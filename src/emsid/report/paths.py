"""Scales of axes, and marks as paths in the coordinates of a plot, for the page and for print.

Coordinates are integers, x to the right and y downwards, so that paths are short and can be enlarged.

Fewer points for a line, for every module that draws one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import singledispatch
from math import ceil, floor, inf, log10
from typing import Any

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
)
from emsid.report.numbers import tick

Array = NDArray[np.float64]

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


# --- scales -----------------------------------------------------------------------------------------------------------


def x_scale(plots: Sequence[Plot], most: int, letters: float) -> Scale:
    """The x axis of the first of these plots, which shows the marks of all of them.

    Args:
        plots: one, or several that share their x axis.
        most: at most this many ticks.
        letters: how many letters have room beside each other below the plot.
    """
    values = [_extent(mark)[0] for plot in plots for mark in plot.marks]
    return _scale(plots[0].x, values, 0.01, most, letters)


def y_scale(plot: Plot, most: int) -> Scale:
    """The y axis of a plot, with at most `most` ticks."""
    return _scale(plot.y, [_extent(mark)[1] for mark in plot.marks], 0.06, most, inf)


def _scale(axis: Axis, values: Sequence[Array], margin: float, most: int, letters: float) -> Scale:
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
    if axis.names and letters < inf:  # so many of them that they do not touch
        step = ceil(len(axis.names) * (max(map(len, axis.names)) + 2) / letters)
        named = ((round(100 * (k - low) / (high - low), 3), axis.names[k]) for k in range(0, len(axis.names), step))
        return Scale(low, high, False, tuple(named))
    places = log_ticks(low, high) if axis.log else linear_ticks(low, high, most)
    while most > 2 and not axis.log and sum(len(tick(v)) + 2 for v in places) > letters:  # their labels would touch
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


@dataclass(frozen=True)
class Frame:
    """The area of a plot.

    Attributes:
        x, y: its axes.
        width, height: its size, in units of the coordinates.
        points: of a line at most; longer ones are thinned.
    """

    x: Scale
    y: Scale
    width: int
    height: int
    points: int

    def across(self, values: ArrayLike) -> Array:
        """Coordinates of values of x."""
        return self.x.place(values, self.width)

    def down(self, values: ArrayLike) -> Array:
        """Coordinates of values of y."""
        return self.height - self.y.place(values, self.height)

    def path(self, x: ArrayLike, y: ArrayLike) -> str:
        """A path through points. A line far outside the area is cut, because browsers cannot draw large coordinates."""
        return path(np.clip(x, -self.width, 2 * self.width), np.clip(y, -20 * self.height, 20 * self.height))


def path(x: ArrayLike, y: ArrayLike) -> str:
    """An SVG path through points, with a gap where one is not a number.

    >>> path([0, 10, 20, 30, 40], [5, 6, float("nan"), 1, 2])
    'M0 5l10 1M30 1l10 1'
    """
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    known = np.isfinite(xs) & np.isfinite(ys)
    whole = np.rint(np.stack([xs, ys])[:, known]).astype(int)
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
def shapes(mark: Mark, frame: Frame) -> list[Shape]:
    """The shapes of a mark."""
    raise TypeError(f"no shapes of {type(mark).__name__}")


@shapes.register(Line)
def _(mark: Line, frame: Frame) -> list[Shape]:
    x, y = thin(mark.x, mark.y, frame.points)
    if mark.stairs:
        x, y = _stairs(x, y)
    return [_line(frame.path(frame.across(x), frame.down(y)), mark.stroke)]


@shapes.register(Points)
def _(mark: Points, frame: Frame) -> list[Shape]:
    places = zip(frame.across(mark.x), frame.down(mark.y), strict=True)
    return [Shape("".join(frame.path([a], [b]) for a, b in places), mark.ink.value, 6.0 * mark.size, round=True)]


@shapes.register(Band)
def _(mark: Band, frame: Frame) -> list[Shape]:
    known = np.isfinite(mark.lower) & np.isfinite(mark.upper)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]])))
    areas = []
    for k in range(0, len(edges), 2):  # one area for each stretch without a gap
        part = slice(edges[k], edges[k + 1])
        x, low, high = mark.x[part], mark.lower[part], mark.upper[part]
        places = frame.across(np.concatenate([x, x[::-1]]))
        areas.append(f"{frame.path(places, frame.down(np.concatenate([high, low[::-1]])))}z")
    return [Shape("".join(areas), fill=mark.ink.value, opacity=0.18)] if areas else []


@shapes.register(Histogram)
def _(mark: Histogram, frame: Frame) -> list[Shape]:
    x, y = _stairs(mark.edges, np.append(mark.heights, mark.heights[-1:]))
    if not mark.backdrop:
        if frame.y.log:  # a bar of height zero is not drawn
            y = np.where(y > 0, y, 10.0 ** (frame.y.low - 1))
        return [_line(frame.path(frame.across(x), frame.down(y)), mark.stroke)]
    highest = 4 * float(np.max(mark.heights, initial=0)) or 1.0
    places = frame.across(np.concatenate([x[:1], x, x[-1:]]))
    area = frame.path(places, frame.height * (1 - np.concatenate([[0.0], y, [0.0]]) / highest))
    return [Shape(f"{area}z", fill=mark.stroke.ink.value, opacity=0.25)]


@shapes.register(Bars)
def _(mark: Bars, frame: Frame) -> list[Shape]:
    return []  # rows with names, not shapes: see `bars`


@shapes.register(Level)
def _(mark: Level, frame: Frame) -> list[Shape]:
    return [_line(frame.path([0, frame.width], frame.down([mark.value] * 2)), mark.stroke)]


@shapes.register(Spans)
def _(mark: Spans, frame: Frame) -> list[Shape]:
    top, foot = -10 * frame.height, 11 * frame.height
    areas = "".join(f"M{round(a)}{top}H{round(b)}V{foot}H{round(a)}z" for a, b in frame.across(mark.edges))
    # With an edge, so that short ones are seen.
    return [Shape(areas, mark.ink.value, 0.5, fill=mark.ink.value, opacity=0.22)] if areas else []


# --- texts ------------------------------------------------------------------------------------------------------------


def names_of_points(plot: Plot, x: Scale, y: Scale) -> Iterable[tuple[float, float, str]]:
    """The names of points, with their positions in percent of width and height."""
    for mark in plot.marks:
        if isinstance(mark, Points) and mark.names:
            places = zip(x.place(mark.x, 100), y.place(mark.y, 100), mark.names, strict=True)
            yield from ((round(float(a), 2), round(float(b), 2), text) for a, b, text in places if np.isfinite(b))


def bars(plot: Plot, x: Scale) -> Iterable[Bar]:
    """The rows of a chart of names."""
    drawn = next(mark for mark in plot.marks if isinstance(mark, Bars))
    points = [mark for mark in plot.marks if isinstance(mark, Points)]
    for k, (name, remark) in enumerate(zip(plot.y.names, drawn.remarks, strict=True)):
        here = [float(x.place(v, 100)) for mark in points for v, row in zip(mark.x, mark.y, strict=True) if row == k]
        length = float(x.place(drawn.values[k], 100)) if np.isfinite(drawn.values[k]) else None
        yield Bar(
            name,
            remark,
            None if length is None else round(float(np.clip(length, 0, 100)), 2),
            tuple(round(place, 2) for place in here if 0 <= place <= 100),
        )


def legend(marks: Sequence[Mark]) -> Iterable[Entry]:
    """The entries of the marks that have a label."""
    for mark in marks:
        if not mark.label:
            continue
        if isinstance(mark, Line | Level):
            look = _line("M0 5h24", mark.stroke)
        elif isinstance(mark, Histogram) and not mark.backdrop:
            look = _line("M0 9v-5h8v-3h8v4h8v4", mark.stroke)
        elif isinstance(mark, Points):
            look = Shape("M12 5h0", mark.ink.value, 6.0 * mark.size, round=True)
        else:
            ink = mark.stroke.ink if isinstance(mark, Histogram) else mark.ink
            look = Shape("M0 0h24v10h-24z", fill=ink.value, opacity=0.75 if isinstance(mark, Bars) else 0.25)
        yield Entry(mark.label, look)


def legends(figure: Figure) -> tuple[tuple[Entry, ...], list[tuple[Entry, ...]]]:
    """One legend for all plots of a figure, and one for each plot: all share one where no look has two labels.

    Args:
        figure: the figure.

    Returns:
        The legend of all plots, and those of the plots, of which either has no entries.
    """
    own = [tuple(dict.fromkeys(legend(plot.marks))) for plot in figure.plots]
    together = tuple(dict.fromkeys(entry for each in own for entry in each))
    if len({entry.look for entry in together}) == len(together):
        return together, [() for _ in own]
    return (), own


def thin(x: ArrayLike, y: ArrayLike, limit: int) -> tuple[Array, Array]:
    """Reduce a line to at most ``limit`` points that look the same: the lowest and highest of every bucket of samples.

    The first and the last point, the extremes and the gaps (NaN) are kept. Kept points are unchanged and in order. A
    line that is short enough is returned unchanged.

    Args:
        x, y: (n,) the line.
        limit: at least 6.
    """
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if len(ys) <= limit:
        return xs, ys
    gap = np.isnan(ys)
    kept_per_bucket = 4 if gap.any() else 2
    size = int(np.ceil(len(ys) / ((limit - 2) // kept_per_bucket)))
    count = int(np.ceil(len(ys) / size))
    padding = count * size - len(ys)

    def buckets(values: NDArray[Any], fill: float) -> NDArray[Any]:
        padded: NDArray[Any] = np.concatenate([values, np.full(padding, fill, dtype=values.dtype)])
        return padded.reshape(count, size)

    first = size * np.arange(count)
    chosen = [
        first + np.argmin(buckets(np.where(gap, np.inf, ys), np.inf), axis=1),
        first + np.argmax(buckets(np.where(gap, -np.inf, ys), -np.inf), axis=1),
    ]
    if gap.any():  # the first and the last gap of a bucket, so that no line is drawn across one
        in_bucket = buckets(gap, False)
        some = in_bucket.any(axis=1)
        chosen += [
            (first + np.argmax(in_bucket, axis=1))[some],
            (first + size - 1 - np.argmax(in_bucket[:, ::-1], axis=1))[some],
        ]
    kept = np.unique(np.concatenate([[0], *chosen, [len(ys) - 1]]))
    return xs[kept], ys[kept]
