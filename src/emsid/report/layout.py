"""Positions of the plots of a printed figure, computed from the sizes of its texts. All lengths are in points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple, TypeVar

from emsid.report.document import Axis, Figure, Plot
from emsid.report.paths import Entry, legends

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
