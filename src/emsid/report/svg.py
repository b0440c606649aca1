"""Figures for print as SVG, written directly: fifty times faster than with a plotting library.

The marks of a plot are those of the page (`emsid.report.paths`), 0.8 points for a pixel, at the positions of
`emsid.report.svg`. Texts are text, which can be searched and changed; the fonts named first are equally wide. The
same figure gives the same bytes.

Positions of the plots of a printed figure, computed from the sizes of its texts. All lengths are in points.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import pairwise
from typing import NamedTuple, TypeVar

from emsid.report.document import Axis, Box, Circle, Diagram, Figure, Ink, Plot, Points, Wire
from emsid.report.paths import (
    Entry,
    Frame,
    Scale,
    Shape,
    bars,
    legends,
    names_of_points,
    shapes,
    x_scale,
    y_scale,
)

_UNIT = 0.02  # a coordinate of a path, in points
_PIXEL = 0.8  # a pixel of the page, in points
_INK, _AXIS, _GRID = "#22262e", "#8a8f98", "#e4e7eb"
_FONTS = "DejaVu Sans, Bitstream Vera Sans, Verdana, sans-serif"
_X_TICKS, _ROW_OF_TICK = 9, 18.0  # the most ticks along x, and points of height for a tick along y


def svg(figure: Figure | Diagram) -> bytes:
    """The content of an SVG file."""
    drawn, width, height = _diagram(figure) if isinstance(figure, Diagram) else _figure(figure)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:g}pt" height="{_n(height * WIDTH / width)}pt" '
        f'viewBox="0 0 {_n(width)} {_n(height)}" font-family="{_FONTS}" fill="{_INK}">',
        f"<title>{_safe(figure.name)}</title>",
        f'<rect width="{_n(width)}" height="{_n(height)}" fill="#ffffff"/>',
        *drawn,
        "</svg>\n",
    ]
    return "\n".join(lines).encode()


def _figure(figure: Figure) -> tuple[list[str], float, float]:
    """The elements, width and height of a figure."""
    places, height, shared, top = layout(figure)
    ys = [y_scale(place.plot, max(3, int(place.height / _ROW_OF_TICK))) for place in places]
    rooms = [
        0.0 if place.plot.y.names else 6.0 + max((text_width(text) for _, text in y.ticks), default=0.0)
        for place, y in zip(places, ys, strict=True)
    ]
    across = sides(figure, places, rooms)
    drawn = [f'<g transform="translate({_n(across[0][0])} {_n(top)})">', *_legend(shared, LEGEND), "</g>"]
    for k, (place, y, (start, width, left)) in enumerate(zip(places, ys, across, strict=True)):
        shown = figure.plots if figure.shared_x else [place.plot]
        x = x_scale([place.plot, *shown], _X_TICKS, width / (0.65 * SMALL))
        frame = Frame(x, y, round(width / _UNIT), round(place.height / _UNIT), PRINT_POINTS)
        drawn.append(f'<g transform="translate({_n(start)} {_n(place.top)})">')
        drawn += _plot(place, frame, width, left, f"{figure.name}-{k}")
        drawn.append("</g>")
    return drawn, WIDTH, height


def _plot(place: Place, frame: Frame, width: float, left: float, name: str) -> Iterator[str]:
    """The elements of a plot, from its upper left corner."""
    plot, height = place.plot, place.height
    across = [(width * at / 100, text) for at, text in frame.x.ticks]
    down = [] if plot.y.names else [(height * (1 - at / 100), text) for at, text in frame.y.ticks]
    grid = "".join((*(f"M{_n(x)} 0v{_n(height)}" for x, _ in across), *(f"M0 {_n(y)}h{_n(width)}" for y, _ in down)))
    yield f'<path d="{grid}" stroke="{_GRID}" stroke-width="0.6"/>'
    yield f'<path d="M0 0V{_n(height)}H{_n(width)}" fill="none" stroke="{_AXIS}" stroke-width="0.6"/>'
    yield f'<clipPath id="{name}"><rect width="{_n(width)}" height="{_n(height)}"/></clipPath>'
    if plot.y.names:
        yield from _rows(plot, frame.x, width, height)
    else:
        drawn = [(each, isinstance(mark, Points)) for mark in plot.marks for each in shapes(mark, frame)]
        yield f'<g clip-path="url(#{name})">'
        yield from _marks((each for each, whole in drawn if not whole), _UNIT)
        yield "</g>"
        yield from _marks((each for each, whole in drawn if whole), _UNIT)
        for x, y, text in names_of_points(plot, frame.x, frame.y):
            yield _text(width * x / 100 + 4, height * (1 - y / 100) - 3, text, SMALL)
        title, size = beside(plot.y, height, SIZE)
        yield _text(LABEL - left - 4, height / 2, title, size, "middle", turned=True)
    yield from (_text(-TICK, y + 0.36 * SMALL, text, SMALL, "end") for y, text in down)
    if place.labelled:
        yield from (_text(x, height + TICK + 0.78 * SMALL, text, SMALL, "middle") for x, text in across)
        title, size = below(place, SIZE)
        yield _text(width / 2, height + TICK + 1.35 * SMALL + 3 + 0.8 * SIZE, title, size, "middle")
    if plot.title:
        title, size = above(place)
        yield _text(0, 11 - place.head, title, size, bold=True)
    yield from _legend(place.legend, place.room)


def _rows(plot: Plot, x: Scale, width: float, height: float) -> Iterator[str]:
    """A chart of names: bars, the points on them, and the texts above."""
    first, last = name_range(plot.y)
    pitch = height / (last - first)
    for k, bar in enumerate(bars(plot, x)):
        y = (k - first) * pitch
        if bar.length is not None:
            ink = next(mark.ink for mark in plot.marks if not isinstance(mark, Points) and hasattr(mark, "ink"))
            place = f'y="{_n(y - 0.15 * pitch)}" width="{_n(width * bar.length / 100)}" height="{_n(0.3 * pitch)}"'
            yield f'<rect {place} fill="{ink.value}" fill-opacity="0.75"/>'
        for at in bar.points:
            yield f'<circle cx="{_n(width * at / 100)}" cy="{_n(y)}" r="2.2" fill="{Ink.RED.value}"/>'
        above = y - max(7.0, 0.15 * pitch + 2.5)
        yield _text(2, above, bar.name, SIZE, bold=True)
        yield _text(8 + text_width(bar.name, SIZE, bold=True), above, bar.remark, SIZE)


def _legend(entries: Sequence[Entry], room: float) -> Iterator[str]:
    """The legend above a plot, column by column."""
    if not entries:
        return
    texts = [entry.label for entry in entries]
    columns = legend_columns(texts, room)
    lines, x = -(-len(entries) // columns), 2.0
    for column, width in zip(split(entries, columns), column_widths(texts, columns), strict=True):
        for k, entry in enumerate(column):
            y = -5.0 - 11.5 * (lines - 1 - k)
            yield f'<g transform="translate({_n(x)} {_n(y - 7)})">'
            yield from _marks([entry.look], _PIXEL)
            yield "</g>"
            yield _text(x + 23, y, entry.label, SMALL)
        x += width


def _marks(drawn: Iterable[Shape], unit: float) -> Iterator[str]:
    """Paths whose coordinates have this unit, in points."""
    pen = _PIXEL / unit
    yield f'<g transform="scale({unit:g})" fill="none">'
    for each in drawn:
        if each.path:
            line = f' stroke="{each.stroke}" stroke-width="{_n(pen * each.width)}"' if each.stroke else ""
            dash = " ".join(_n(pen * float(part)) for part in each.dash.split())
            line += f' stroke-dasharray="{dash}"' * bool(dash) + ' stroke-linecap="round"' * each.round
            area = f' fill="{each.fill}" fill-opacity="{each.opacity:g}"' if each.fill else ""
            yield f'<path d="{each.path}"{line}{area}/>'
    yield "</g>"


def _diagram(diagram: Diagram) -> tuple[list[str], float, float]:
    """The elements, width and height of a drawing of blocks and lines."""
    pen = 0.9 * diagram.width / WIDTH
    drawn = [f'<g stroke-width="{_n(pen)}">']

    def write(x: float, y: float, lines: Sequence[str]) -> Iterable[str]:
        rows = ((k - (len(lines) - 1) / 2, line) for k, line in enumerate(lines))
        return [_text(x, y + 4 + 15 * row, line, 12, "middle") for row, line in rows]

    for shape in diagram.shapes:
        if isinstance(shape, Box):
            place = f'x="{_n(shape.x)}" y="{_n(shape.y)}" width="{_n(shape.width)}" height="{_n(shape.height)}"'
            drawn.append(f'<rect {place} fill="#f3f7fb" stroke="#1c5d99"/>')
            drawn += write(shape.x + shape.width / 2, shape.y + shape.height / 2, shape.lines)
        elif isinstance(shape, Circle):
            place = f'cx="{_n(shape.x)}" cy="{_n(shape.y)}" r="{_n(shape.radius)}"'
            drawn.append(f'<circle {place} fill="#ffffff" stroke="{_INK}"/>')
            drawn += write(shape.x, shape.y, (shape.text,))
        elif isinstance(shape, Wire):
            drawn.append(f'<polyline points="{_points(shape.points)}" fill="none" stroke="{_INK}"/>')
            drawn += [f'<polygon points="{_points(shape.head)}"/>'] * shape.arrow
        else:
            drawn += write(shape.x, shape.y - 4, (shape.text,))
    return [*drawn, "</g>"], diagram.width, diagram.height


def _points(corners: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{_n(x)},{_n(y)}" for x, y in corners)


def _text(
    x: float, y: float, text: str, size: float, anchor: str = "start", *, bold: bool = False, turned: bool = False
) -> str:
    """A text whose baseline begins at a point, has its middle or ends there, read upwards where it is turned."""
    place = f'transform="translate({_n(x)} {_n(y)}) rotate(-90)"' if turned else f'x="{_n(x)}" y="{_n(y)}"'
    look = f' text-anchor="{anchor}"' * (anchor != "start") + ' font-weight="bold"' * bold
    return f'<text {place} font-size="{_n(size)}"{look} stroke="none">{_safe(text)}</text>'


def _safe(text: str) -> str:
    """A text without markup, and without characters that XML does not have."""
    return escape(re.sub(r"[^\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", " ", text))


def _n(value: float) -> str:
    """A length with two decimals at most."""
    return f"{round(value, 2):.8g}"


T = TypeVar("T")

# A printed figure: its width, the height of an ordinary plot, the space for labels below, left and right of it (without
# tick labels at the left), the size of letters, of small ones and of titles.
WIDTH, ROW, FOOT, LABEL, RIGHT, SIZE, SMALL, TITLE = 520.0, 120.0, 32.0, 16.0, 12.0, 8.0, 7.5, 8.5
LEGEND = WIDTH - 60.0
"""Largest width of a legend for all plots."""
TICK = 4.0
"""From an axis to the labels of its ticks."""
PRINT_POINTS = 2000
"""Points of a line: more than a printer's dots across it."""

_WIDTHS = {
    0.28: "'ijl",
    0.3: "IJ",
    0.33: " ,.·/:;\\f|",
    0.38: "-()[]rt",
    0.4: "!²³₀₁₂₃₄₅₆₇₈₉⁰¹",
    0.5: '"*_`°–sz?',
    0.55: "cεLν",
    0.59: "FkTvxyPYaoχγκλπτδθäö",
    0.66: "KαφψVΔBRXZ",
    0.71: "CAUÄÜ",
    0.77: "HNDGOQΩΦÖ&",
    0.83: "w#+<=>^~±×−≤≥≈→ω",
    0.95: "Mm%W@—…",
}
_WIDTH_OF = {letter: width for width, letters in _WIDTHS.items() for letter in letters}
_USUAL, _BOLD = 0.63, 1.12


def text_width(text: str, size: float = SMALL, *, bold: bool = False) -> float:
    """Width of a text in DejaVu Sans or Verdana, within some percent.

    >>> round(text_width("Speed [rad/s]", 10.0), 1)
    66.7
    """
    return size * sum(_WIDTH_OF.get(letter, _USUAL) for letter in text) * (_BOLD if bold else 1.0)


class Place(NamedTuple):
    """Position of a plot on the sheet, from the top."""

    plot: Plot
    column: int
    top: float
    height: float
    head: float  # height of the titles and legends above its row
    legend: tuple[Entry, ...]  # its own, above it
    room: float  # largest width of its legend
    labelled: bool  # whether the x axis has labels; otherwise the plot below has them


class Layout(NamedTuple):
    """Positions on the sheet, from the top."""

    places: list[Place]
    height: float  # of the sheet
    legend: tuple[Entry, ...]  # of all plots, above them
    start: float  # where that legend ends and the plots begin


def layout(figure: Figure) -> Layout:
    """Positions of the legend and the plots of a figure."""
    shared, own = legends(figure)
    found: list[Place] = []
    start = y = 2.0 + _legend_height(shared, LEGEND)
    for row in figure.rows:
        labelled = not figure.shared_x or figure.columns > 1 or row[-1] is figure.plots[-1]
        entries = own[len(found) : len(found) + len(row)]
        rooms = [WIDTH * plot.span / figure.columns - 60.0 for plot in row]
        heads = (
            12.5 * bool(plot.title) + _legend_height(each, room)
            for plot, each, room in zip(row, entries, rooms, strict=True)
        )
        head = max(heads) + 4.0
        height, column = ROW * max(plot.height for plot in row), 0
        y += head
        for plot, each, room in zip(row, entries, rooms, strict=True):
            found.append(Place(plot, column, y, height, head, each, room, labelled))
            column += plot.span
        y += height + (FOOT if labelled else 6.0)
    return Layout(found, y, shared, start)


def sides(figure: Figure, places: Sequence[Place], tick_rooms: Sequence[float]) -> list[tuple[float, float, float]]:
    """Left end and width of every plot, and from its left end to the left of its space; all of a column begin at one x.

    Args:
        figure: the figure.
        places: its plots.
        tick_rooms: the width of the tick labels of every plot.
    """
    left = [
        LABEL + max((room for room, place in zip(tick_rooms, places, strict=True) if place.column == c), default=0.0)
        for c in range(figure.columns)
    ]
    width = (WIDTH - sum(left)) / figure.columns - RIGHT
    found = []
    for place in places:
        c, span = place.column, place.plot.span
        start = sum(left[: c + 1]) + c * (width + RIGHT)
        found.append((start, span * width + (span - 1) * RIGHT + sum(left[c + 1 : c + span]), left[c]))
    return found


def _legend_height(entries: Sequence[Entry], room: float) -> float:
    """Height of a legend."""
    return 11.5 * -(-len(entries) // legend_columns([entry.label for entry in entries], room))


def legend_columns(texts: Sequence[str], room: float) -> int:
    """How many columns of legend entries fit into the room."""
    fitting = (n for n in range(len(texts), 1, -1) if sum(column_widths(texts, n)) <= room)
    return next(fitting, 1)


def column_widths(texts: Sequence[str], columns: int) -> list[float]:
    """The width of every column of legend entries, with line samples and spacing."""
    return [max(map(text_width, column)) + 34.0 for column in split(texts, columns)]


def split(texts: Sequence[T], columns: int) -> list[Sequence[T]]:
    """Texts by columns, downwards; the first columns have one more where the number is not a multiple.

    >>> split("abcde", 3)
    ['ab', 'cd', 'e']
    """
    each, more = divmod(len(texts), columns)
    starts = [k * each + min(k, more) for k in range(columns + 1)]
    return [texts[a:b] for a, b in pairwise(starts)]


def beside(axis: Axis, height: float, size: float) -> tuple[str, float]:
    """The title of an axis and its font size beside a plot of this height; a long name is cut."""
    return _fitted(axis.quantity, axis.title[len(axis.quantity) :], size, height + 10)


def below(place: Place, size: float) -> tuple[str, float]:
    """The title of the x axis and its font size in the width of the plot; a long name is cut."""
    axis = place.plot.x
    return _fitted(axis.quantity, axis.title[len(axis.quantity) :], size, place.room + RIGHT)


def above(place: Place) -> tuple[str, float]:
    """The title of a plot and its font size in the width of the plot; a long one is cut."""
    return _fitted(place.plot.title, "", TITLE, place.room + RIGHT, bold=True)


def _fitted(text: str, end: str, size: float, room: float, *, bold: bool = False) -> tuple[str, float]:
    """A text with its end, and its font size: down to three quarters of the usual one, then with a part left out."""
    smaller = size * room / max(text_width(text + end, size, bold=bold), 1e-9)
    if smaller >= 0.75 * size:
        return text + end, min(size, smaller)
    least = 0.75 * size
    cut = (f"{text[:k].rstrip()}…{end}" for k in range(len(text) - 1, 0, -1))
    return next((each for each in cut if text_width(each, least, bold=bold) <= room), end), least


def name_range(axis: Axis) -> tuple[float, float]:
    """Limits of an axis of names, from the top: half a place beyond the names, and space for the first one."""
    return -0.75, len(axis.names) - 0.5
