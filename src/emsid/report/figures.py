"""Figures for print and in Python. Only this module uses Matplotlib: for PDF, and for figures that can be changed.

`emsid.report.document` defines figures; here is a function that draws each kind of mark. Global settings of Matplotlib
are not changed. The same figure gives the same bytes. Text is never read as mathematics, so a column may be called
``$u$``. SVG is written without a library, see `emsid.report.svg`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial, singledispatch
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from emsid.report.document import (
    Band,
    Bars,
    Box,
    Circle,
    Dash,
    Diagram,
    Figure,
    Histogram,
    Level,
    Line,
    Mark,
    Plot,
    Points,
    Spans,
    Stroke,
    Wire,
)
from emsid.report.numbers import tick
from emsid.report.paths import Entry, legend, thin, x_scale
from emsid.report.svg import (
    LABEL,
    LEGEND,
    PRINT_POINTS,
    SIZE,
    SMALL,
    WIDTH,
    Place,
    above,
    below,
    beside,
    layout,
    legend_columns,
    name_range,
    sides,
    svg,
    text_width,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis as MplAxis
    from matplotlib.container import BarContainer
    from matplotlib.figure import Figure as Sheet


_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # part of Matplotlib, so that figures are the same on all machines
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.edgecolor": "#8a8f98",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "axes.ymargin": 0.06,
    "axes.labelcolor": "#22262e",
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.6,
    "xtick.color": "#8a8f98",
    "ytick.color": "#8a8f98",
    "xtick.labelcolor": "#22262e",
    "ytick.labelcolor": "#22262e",
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "legend.handlelength": 2.2,
    "legend.columnspacing": 1.4,
    "legend.borderaxespad": 0.3,
    "legend.borderpad": 0.0,
    "legend.labelspacing": 0.25,
    "lines.solid_capstyle": "butt",
    "text.color": "#22262e",
    "text.parse_math": False,
    "pdf.fonttype": 3,
}


def draw(figure: Figure | Diagram, formats: Collection[str] = ("svg",)) -> dict[str, bytes]:
    """Draw a figure or a diagram in these vector formats. The same figure gives the same bytes.

    Args:
        figure: what to draw.
        formats: ``svg``, ``pdf`` or both.

    Returns:
        By format, the content of a file.
    """
    return {name: _WRITERS[name](figure) for name in formats}


def _pdf(figure: Figure | Diagram) -> bytes:
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    file = BytesIO()
    with rc_context(_SETTINGS):
        sheet = _diagram(figure) if isinstance(figure, Diagram) else _sheet(figure)
        # The canvas writes directly: Figure.savefig would draw everything twice for automatic layouts.
        about = {"Creator": "emsid", "Title": figure.name, "CreationDate": None}
        FigureCanvasPdf(sheet).print_pdf(file, metadata=about)  # type: ignore[no-untyped-call]
    return file.getvalue()


_WRITERS: dict[str, Callable[[Figure | Diagram], bytes]] = {"svg": svg, "pdf": _pdf}


def sheet(figure: Figure) -> Sheet:
    """The Matplotlib figure, to be changed or saved."""
    from matplotlib import rc_context

    with rc_context(_SETTINGS):
        drawn = _sheet(figure)
    drawn.set_dpi(144)
    return drawn


def _diagram(diagram: Diagram) -> Sheet:
    """A drawing of blocks and lines."""
    from matplotlib.figure import Figure as Sheet
    from matplotlib.patches import Circle as Disc
    from matplotlib.patches import Polygon, Rectangle

    scale = WIDTH / diagram.width / 72
    sheet = Sheet(figsize=(diagram.width * scale, diagram.height * scale), dpi=72)
    axes = sheet.add_axes((0, 0, 1, 1), xlim=(0, diagram.width), ylim=(diagram.height, 0))
    axes.set_axis_off()
    size, ink = 12 * 72 * scale, "#22262e"

    def write(x: float, y: float, lines: Sequence[str]) -> None:
        for k, line in enumerate(lines):
            axes.text(x, y + 4 + 15 * (k - (len(lines) - 1) / 2), line, ha="center", va="baseline", size=size)

    for shape in diagram.shapes:
        if isinstance(shape, Box):
            axes.add_patch(Rectangle((shape.x, shape.y), shape.width, shape.height, fc="#f3f7fb", ec="#1c5d99", lw=0.9))
            write(shape.x + shape.width / 2, shape.y + shape.height / 2, shape.lines)
        elif isinstance(shape, Circle):
            axes.add_patch(Disc((shape.x, shape.y), shape.radius, fc="white", ec=ink, lw=0.9))
            write(shape.x, shape.y, (shape.text,))
        elif isinstance(shape, Wire):
            axes.plot(*zip(*shape.points, strict=True), color=ink, linewidth=0.9)
            if shape.arrow:
                axes.add_patch(Polygon(shape.head, fc=ink, ec="none"))
        else:
            write(shape.x, shape.y - 4, (shape.text,))
    return sheet


_LINE_STYLES: dict[Dash, Any] = {
    Dash.SOLID: "-",
    Dash.DASHED: (0, (5, 2.5)),
    Dash.DOTTED: (0, (1.1, 1.3)),
    Dash.DASH_DOTTED: (0, (5, 1.6, 1.1, 1.6)),
}


def _sheet(figure: Figure) -> Sheet:
    """Draw all plots of a figure.

    Positions are computed from the sizes of the texts. This is several times faster than Matplotlib's layout engines.
    All plots of a column begin at the same x.
    """
    from matplotlib.figure import Figure as Sheet

    places, height, shared, top = layout(figure)
    sheet = Sheet(figsize=(WIDTH / 72, height / 72), dpi=72)
    drawn: list[Axes] = []
    handles: dict[Entry, Artist | BarContainer] = {}
    for place in places:
        bottom, share = 1 - (place.top + place.height) / height, place.height / height
        axes = sheet.add_axes((0.1, bottom, 0.8, share), sharex=drawn[0] if figure.shared_x and drawn else None)
        marks = [(mark, _draw(mark, axes)) for mark in place.plot.marks]
        handles |= zip(legend(place.plot.marks), (handle for mark, handle in marks if mark.label), strict=True)
        _set_axes(axes, place)
        _put_title(axes, place)
        _put_legend(axes, place.legend, handles, place.room, (0, 1))
        drawn.append(axes)
    across = sides(figure, places, [_tick_room(axes) for axes in drawn])
    _put_legend(sheet, shared, handles, LEGEND, (across[0][0] / WIDTH, 1 - top / height))
    for axes, place, (start, length, left) in zip(drawn, places, across, strict=True):
        bottom = height - place.top - place.height
        axes.set_position((start / WIDTH, bottom / height, length / WIDTH, place.height / height))
        axes.yaxis.set_label_coords((LABEL - left - 2) / length, 0.5)
    return sheet


def _tick_room(axes: Axes) -> float:
    """Width of the tick labels of the y axis, in points."""
    low, high = sorted(axes.get_ylim())
    formatter = axes.yaxis.get_major_formatter()
    texts = formatter.format_ticks([tick for tick in axes.get_yticks() if low <= tick <= high])
    return max((text_width(text) for text in texts), default=0.0) + 6.0


def _set_axes(axes: Axes, place: Place) -> None:
    """Scales, ranges, ticks and labels."""
    from matplotlib.ticker import FuncFormatter, NullLocator

    plot = place.plot
    for axis, side, set_scale in ((plot.x, axes.xaxis, axes.set_xscale), (plot.y, axes.yaxis, axes.set_yscale)):
        if axis.log:
            set_scale("log")
            side.set_minor_locator(NullLocator())
        side.set_major_formatter(FuncFormatter(partial(_tick, side)))
    if plot.x.range:
        axes.set_xlim(plot.x.range)
    if plot.y.range:
        axes.set_ylim(plot.y.range)
    if plot.x.names:
        x = x_scale([plot], len(plot.x.names), place.room / (0.65 * SMALL))
        axes.set_xticks([x.low + (x.high - x.low) * at / 100 for at, _ in x.ticks], [text for _, text in x.ticks])
    if plot.y.names:
        axes.yaxis.set_major_locator(NullLocator())
        axes.set_ylim(name_range(plot.y)[::-1])
        _name_bars(axes, plot)
    else:
        title, size = beside(plot.y, place.height, SIZE)
        axes.set_ylabel(title, size=size)
    if place.labelled:
        title, size = below(place, SIZE)
        axes.set_xlabel(title, size=size)
    else:
        axes.tick_params(labelbottom=False)


def _name_bars(axes: Axes, plot: Plot) -> None:
    """The name of every bar and its remark, above it."""
    for mark in plot.marks:
        if isinstance(mark, Bars):
            for k, (name, remark) in enumerate(zip(plot.y.names, mark.remarks, strict=True)):
                end = 2 + text_width(name, 8.0, bold=True)
                for text, x, weight in ((name, 2.0, "bold"), (remark, end + 6, "normal")):
                    axes.annotate(text, (0, k), (x, 7), ("axes fraction", "data"), "offset points", weight=weight)


def _put_title(axes: Axes, place: Place) -> None:
    """Draw the title above the plot, aligned with those of the row."""
    if place.plot.title:
        offset = (0, place.head - 11.0)
        title, size = above(place)
        axes.annotate(title, (0, 1), offset, "axes fraction", "offset points", weight="bold", size=size)


def _put_legend(
    above: Axes | Sheet,
    entries: Sequence[Entry],
    handles: Mapping[Entry, Artist | BarContainer],
    room: float,
    corner: tuple[float, float],
) -> None:
    """Draw a legend in this width; ``corner`` is its lower left one, in parts of the plot or of the sheet."""
    if entries:
        texts = [entry.label for entry in entries]
        shown = [handles[entry] for entry in entries]
        columns = legend_columns(texts, room)
        above.legend(shown, texts, loc="lower left", bbox_to_anchor=corner, ncols=columns)  # type: ignore[call-overload]


def _tick(side: MplAxis, value: float, _: int | None = None) -> str:
    """The label of a tick; a value that differs from zero only by rounding is zero."""
    low, high = side.get_view_interval()
    linear = side.get_scale() != "log"
    return "0" if linear and abs(value) < 1e-9 * abs(high - low) else tick(value)


@singledispatch
def _draw(mark: Mark, axes: Axes) -> Artist | BarContainer:
    """Draw a mark and return its handle for the legend."""
    raise TypeError(f"no drawing of {type(mark).__name__}")


def _style(stroke: Stroke) -> dict[str, Any]:
    return {"color": stroke.ink.value, "linestyle": _LINE_STYLES[stroke.dash], "linewidth": stroke.width}


@_draw.register(Line)
def _(mark: Line, axes: Axes) -> Artist | BarContainer:
    x, y = thin(mark.x, mark.y, PRINT_POINTS)
    return axes.plot(x, y, drawstyle="steps-post" if mark.stairs else "default", **_style(mark.stroke))[0]


@_draw.register(Points)
def _(mark: Points, axes: Axes) -> Artist | BarContainer:
    for x, y, name in zip(mark.x, mark.y, mark.names, strict=False):
        axes.annotate(name, (x, y), xytext=(4, 3), textcoords="offset points", fontsize=SMALL)
    return axes.plot(mark.x, mark.y, "o", color=mark.ink.value, markersize=3.5 * mark.size, clip_on=False, zorder=4)[0]


@_draw.register(Band)
def _(mark: Band, axes: Axes) -> Artist | BarContainer:
    return axes.fill_between(mark.x, mark.lower, mark.upper, color=mark.ink.value, alpha=0.18, linewidth=0)


@_draw.register(Histogram)
def _(mark: Histogram, axes: Axes) -> Artist | BarContainer:
    if mark.backdrop:
        from matplotlib.patches import StepPatch

        shares = mark.heights / (4 * float(np.max(mark.heights, initial=0)) or 1.0)
        foot = axes.get_xaxis_transform()  # x of the data, y as a part of the height of the plot
        colour = mark.stroke.ink.value
        return axes.add_artist(StepPatch(shares, mark.edges, fill=True, color=colour, alpha=0.25, transform=foot))
    return axes.stairs(mark.heights, mark.edges, baseline=None, **_style(mark.stroke))


@_draw.register(Bars)
def _(mark: Bars, axes: Axes) -> Artist | BarContainer:
    known = np.flatnonzero(np.isfinite(mark.values))
    return axes.barh(known, mark.values[known], height=0.3, color=mark.ink.value, alpha=0.75)


@_draw.register(Level)
def _(mark: Level, axes: Axes) -> Artist | BarContainer:
    return axes.axhline(mark.value, **_style(mark.stroke))


@_draw.register(Spans)
def _(mark: Spans, axes: Axes) -> Artist | BarContainer:
    stretches = [(float(a), float(b - a)) for a, b in mark.edges]
    over_all = axes.get_xaxis_transform()  # x of the data, y as a part of the height of the plot
    # With an edge, so that short ones are seen.
    return axes.broken_barh(stretches, (0, 1), transform=over_all, color=mark.ink.value, alpha=0.22, linewidth=0.5)
