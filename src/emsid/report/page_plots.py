"""Plots for the page, as the JSON that Plotly draws in a browser. The only module that knows Plotly.

A trace or a shape for each kind of mark; everything else about a figure is said once, in `emsid.report.document`. No
text is ever read as markup, so a column may be called ``<b>``.
"""

from __future__ import annotations

from base64 import b64encode
from functools import singledispatch
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from emsid.report.document import (
    Axis,
    Band,
    Bars,
    Dash,
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
from emsid.report.figures import beside, name_range

Trace = dict[str, Any]

# Points of a line, which can be zoomed.
PAGE_POINTS = 4000

_ROW = 250  # an ordinary plot, in pixels

_DASHES = {Dash.SOLID: "solid", Dash.DASHED: "dash", Dash.DOTTED: "2px,2px", Dash.DASH_DOTTED: "dashdot"}


def interactive(plot: Plot) -> Trace:
    """A plot as Plotly's JSON: ``data`` and ``layout``, in built-in types."""
    named = any(mark.label for mark in plot.marks)
    above, below = 30 if named else 10, 48
    layout: Trace = {
        "height": round(_ROW * plot.height) + above + below - 30,
        "margin": {"l": 76, "r": 16, "t": above, "b": below},
        "font": {"family": "Segoe UI, system-ui, Helvetica Neue, Arial, sans-serif", "size": 12, "color": "#22262e"},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "hovermode": "closest" if plot.y.names else "x",
        "dragmode": False if plot.y.names else "zoom",
        "showlegend": named,
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "y": 1.02, "yanchor": "bottom"},
        "xaxis": _axis(plot.x),
        "yaxis": _axis(plot.y, _ROW * plot.height - 30) | {"automargin": "left"},  # for numbers of many digits
        "hoverlabel": {"font": {"size": 11}},
        "shapes": [shape for mark in plot.marks for shape in _shapes(mark)],
        "annotations": _bar_names(plot),
    }
    if plot.y.names:
        layout["margin"] |= {"l": 26}  # half the first number below
    traces = [trace for mark in plot.marks for trace in _trace(mark)]
    backdrop = next((m for m in plot.marks if isinstance(m, Histogram) and m.backdrop), None)
    if backdrop is not None:
        reach = 4 * float(np.max(backdrop.heights, initial=0)) or 1.0
        layout["yaxis2"] = {"overlaying": "y", "visible": False, "range": [0, reach], "fixedrange": True}
    return {"data": traces, "layout": layout}


def _axis(axis: Axis, length: float = np.inf) -> Trace:
    title, letters = (axis.title, 12.5) if np.isinf(length) or axis.names else beside(axis, length, 12.5)
    settings: Trace = {
        "title": {"text": escape(title), "standoff": 8, "font": {"size": round(letters, 1)}},
        "gridcolor": "#e4e7eb",
        "linecolor": "#8a8f98",
        "showline": True,
        "zeroline": False,
        "ticks": "outside",
        "tickcolor": "#8a8f98",
        "ticklen": 4,
        "exponentformat": "power",
    }
    if axis.log:
        settings |= {"type": "log", "dtick": 1, "tickformat": "~g"}
    if axis.range:
        settings["range"] = [float(v) for v in (np.log10(axis.range) if axis.log else axis.range)]
    if axis.names:
        hidden = {"showgrid": False, "showticklabels": False, "ticks": "", "title": {"text": ""}}
        settings |= {"range": list(name_range(axis)[::-1])} | hidden
    return settings


def _bar_names(plot: Plot) -> list[Trace]:
    """Names and remarks of bars, above each and not beside it, so that they have room on a phone too."""
    place = {"xref": "paper", "x": 0, "xanchor": "left", "yshift": 17, "showarrow": False}
    return [
        {"text": f"<b>{escape(name)}</b>&nbsp; {escape(remark)}", "y": k} | place
        for mark in plot.marks
        if isinstance(mark, Bars)
        for k, (name, remark) in enumerate(zip(plot.y.names, mark.remarks, strict=True))
    ]


def _packed(values: ArrayLike, precision: str = "f8") -> Trace:
    """An array as Plotly reads it fastest: its bytes, in double precision where single would show."""
    array = np.asarray(values).astype(f"<{precision}")
    return {"dtype": precision, "bdata": b64encode(array.tobytes()).decode("ascii")}


def _named(label: str) -> Trace:
    return {"name": escape(label), "showlegend": True} if label else {"name": "", "showlegend": False}


def _stroke(stroke: Stroke) -> Trace:
    return {"color": stroke.ink.value, "width": 1.25 * stroke.width, "dash": _DASHES[stroke.dash]}


def _faint(colour: str, opacity: float) -> str:
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"


@singledispatch
def _trace(mark: Mark) -> list[Trace]:
    """What Plotly draws of a mark."""
    raise TypeError(f"no trace of {type(mark).__name__}")


@_trace.register(Line)
def _(mark: Line) -> list[Trace]:
    x, y = thin(mark.x, mark.y, PAGE_POINTS)
    line = _stroke(mark.stroke) | {"shape": "hv" if mark.held else "linear", "simplify": False}
    trace = {"type": "scatter", "mode": "lines", "x": _packed(x), "y": _packed(y, "f4"), "line": line}
    return [trace | _named(mark.label) | {"connectgaps": False, "hovertemplate": "%{y:.5g}"}]


@_trace.register(Points)
def _(mark: Points) -> list[Trace]:
    marker = {"color": mark.ink.value, "size": 7}
    trace = {"type": "scatter", "mode": "markers", "x": _packed(mark.x), "y": _packed(mark.y), "marker": marker}
    return [trace | _named(mark.label) | {"cliponaxis": False, "hovertemplate": "%{x:.5g}, %{y:.5g}"}]


@_trace.register(Band)
def _(mark: Band) -> list[Trace]:
    x = np.concatenate([mark.x, mark.x[::-1]])
    y = np.concatenate([mark.upper, mark.lower[::-1]])
    fill = {"fill": "toself", "fillcolor": _faint(mark.ink.value, 0.18), "line": {"width": 0}, "hoverinfo": "skip"}
    return [{"type": "scatter", "mode": "lines", "x": _packed(x), "y": _packed(y)} | fill | _named(mark.label)]


@_trace.register(Histogram)
def _(mark: Histogram) -> list[Trace]:
    trace: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": _packed(mark.edges),
        "y": _packed(np.append(mark.heights, mark.heights[-1:])),
        "line": _stroke(mark.stroke) | {"shape": "hv"},
        "hovertemplate": "%{y:.3g}",
    }
    if mark.backdrop:
        trace |= {"yaxis": "y2", "fill": "tozeroy", "fillcolor": _faint(mark.stroke.ink.value, 0.25)}
        trace |= {"line": {"width": 0, "shape": "hv"}, "hoverinfo": "skip"}
        del trace["hovertemplate"]
    return [trace | _named(mark.label)]


@_trace.register(Bars)
def _(mark: Bars) -> list[Trace]:
    return [
        {
            "type": "bar",
            "orientation": "h",
            "x": [float(value) if np.isfinite(value) else None for value in mark.values],
            "y": list(range(len(mark.values))),
            "marker": {"color": mark.ink.value, "opacity": 0.75},
            "width": 0.3,
            "hoverinfo": "skip",
        }
        | _named(mark.label)
    ]


@_trace.register(Level)
@_trace.register(Spans)
def _(mark: Level | Spans) -> list[Trace]:
    return []  # shapes, not traces: see `_shapes`


def _shapes(mark: Mark) -> list[Trace]:
    """What of a mark Plotly wants as shapes on the layout; the first of them stands in the legend."""
    if isinstance(mark, Level):
        ends = {"xref": "paper", "x0": 0, "x1": 1, "y0": mark.value, "y1": mark.value}
        return [{"type": "line", "layer": "below"} | ends | {"line": _stroke(mark.stroke)} | _named(mark.label)]
    if isinstance(mark, Spans):
        fill = {"fillcolor": _faint(mark.ink.value, 0.22), "line": {"width": 1, "color": _faint(mark.ink.value, 0.22)}}
        area = {"type": "rect", "layer": "below", "yref": "paper", "y0": 0, "y1": 1} | fill
        return [
            area | {"x0": float(a), "x1": float(b)} | _named("" if k else mark.label)
            for k, (a, b) in enumerate(mark.edges)
        ]
    return []


def plotly_source() -> str:
    """The library that draws the page's plots, as JavaScript."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())
