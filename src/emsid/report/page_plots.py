"""Plots of the page: the values that the template writes as HTML and SVG, computed from a `Plot`.

The lines of a plot are SVG paths that stretch with the width of the page. Titles, ticks and legends are HTML, so their
letters keep their size on a phone. The same markup serves for screen and print, with and without scripts; a short
script adds zooming. Texts are not escaped here: the template escapes them.
"""

from __future__ import annotations

from dataclasses import dataclass

from emsid.report.document import Figure, Plot
from emsid.report.paths import Bar, Entry, Frame, Scale, Shape, bars, legends, names_of_points, shapes, x_scale, y_scale

# Points of a line: about two in every pixel of a wide screen, the lowest and the highest value of each stretch.
PAGE_POINTS = 1600

# Coordinates inside a plot are integers from 0 to these limits: paths are short and can be enlarged twenty times.
WIDTH, HEIGHT = 20_000, 10_000

_ROW = 210  # the height of an ordinary plot, in pixels
_LETTER = 7.0  # the width of a digit of a tick, in pixels
_MINUS = 0.4  # how much wider than a digit a minus sign is, in digits
_NARROW = 270.0  # the width of a plot on a phone, in pixels
_TICKS = 6  # at most


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
    """A figure as the template sets it: plots of one width, with one legend or one each."""
    shared, own = legends(figure)
    frames = [_frame(plot) for plot in figure.plots]
    room = max(_tick_room(frame.y) for frame in frames)
    plots = tuple(
        _page_plot(plot, frame, room, entries) for plot, frame, entries in zip(figure.plots, frames, own, strict=True)
    )
    return PageFigure(plots, shared)


def _frame(plot: Plot) -> Frame:
    return Frame(x_scale([plot], _TICKS, _NARROW / _LETTER), y_scale(plot, _TICKS), WIDTH, HEIGHT, PAGE_POINTS)


def _tick_room(y: Scale) -> int:
    letters = (len(text) + _MINUS * text.count("\N{MINUS SIGN}") for _, text in y.ticks)
    return round(max(letters, default=0) * _LETTER) + 12


def _page_plot(plot: Plot, frame: Frame, room: int, legend: tuple[Entry, ...]) -> PagePlot:
    x, y = frame.x, frame.y
    rows = tuple(bars(plot, x)) if plot.y.names else ()
    drawn = () if rows else tuple(each for mark in plot.marks for each in shapes(mark, frame) if each.path)
    y_title = "" if rows else plot.y.title
    height, notes = round(_ROW * plot.height), () if rows else tuple(names_of_points(plot, x, y))
    return PagePlot(plot.title, plot.x.title, y_title, x, y, drawn, height, room, legend, rows, plot.span, notes)
