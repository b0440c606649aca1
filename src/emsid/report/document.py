"""Reports and what they hold: figures of marks on axes, diagrams, tables, terms and notices."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from math import hypot

import numpy as np
from numpy.typing import NDArray

from emsid.units import readable_unit

Array = NDArray[np.float64]


class Ink(Enum):
    """Colours for white paper that people with any colour vision can distinguish (after Okabe and Ito)."""

    BLUE = "#3d8fd1"
    RED = "#d1242f"
    NAVY = "#0b2f6b"
    GREEN = "#00875a"
    ORANGE = "#c47500"
    PURPLE = "#9a4f96"
    GREY = "#8a8f98"
    BLACK = "#22262e"


class Dash(Enum):
    """How a line is broken."""

    SOLID = "solid"
    DASHED = "dashed"
    DOTTED = "dotted"
    DASH_DOTTED = "dash-dotted"


@dataclass(frozen=True)
class Stroke:
    """How a line looks.

    Attributes:
        ink: its colour.
        dash: how it is broken.
        width: in points.
    """

    ink: Ink = Ink.BLUE
    dash: Dash = Dash.SOLID
    width: float = 1.2


@dataclass(frozen=True, eq=False)
class Line:
    """A line through points; NaN leaves a gap.

    Attributes:
        x, y: (n,) in the units of the axes, x ascending.
        label: for the legend, empty for none.
        stroke: how it looks.
        stairs: whether every value is drawn constant until the next one, as by a zero-order hold.
    """

    x: Array
    y: Array
    label: str = ""
    stroke: Stroke = Stroke()
    stairs: bool = False


@dataclass(frozen=True, eq=False)
class Points:
    """Points without a line.

    Attributes:
        x, y: (n,) in the units of the axes.
        label: for the legend, empty for none.
        ink: their colour.
        names: short texts beside them, one each; empty for none.
        size: of one, as a multiple of the usual.
    """

    x: Array
    y: Array
    label: str = ""
    ink: Ink = Ink.BLUE
    names: tuple[str, ...] = ()
    size: float = 1.0


@dataclass(frozen=True, eq=False)
class Band:
    """The area between two lines: an interval at every x.

    Attributes:
        x, lower, upper: (n,) in the units of the axes; a gap where a limit is NaN.
        label: for the legend, empty for none.
        ink: its colour, drawn pale.
    """

    x: Array
    lower: Array
    upper: Array
    label: str = ""
    ink: Ink = Ink.BLUE


@dataclass(frozen=True, eq=False)
class Histogram:
    """A histogram.

    Attributes:
        edges: (n + 1,) ascending, on the x axis.
        heights: (n,) on the y axis.
        label: for the legend, empty for none.
        stroke: of the outline; the area is pale in the same colour.
        backdrop: whether it is drawn behind the other marks, a quarter as high as the plot and without ticks, to show
            where the data are.
    """

    edges: Array
    heights: Array
    label: str = ""
    stroke: Stroke = Stroke(Ink.GREY, width=0.8)
    backdrop: bool = False


@dataclass(frozen=True, eq=False)
class Bars:
    """Horizontal bars, the first at the top. Above each bar stand its name (from `Axis.names` of y) and a remark.

    Attributes:
        values: (n,) on the x axis; no bar is drawn where one is not finite.
        remarks: (n,) text beside every name.
        label: for the legend, empty for none.
        ink: their colour.
    """

    values: Array
    remarks: tuple[str, ...]
    label: str = ""
    ink: Ink = Ink.BLUE


@dataclass(frozen=True)
class Level:
    """A straight line across the plot at one value of y.

    Attributes:
        value: on the y axis.
        label: for the legend, empty for none.
        stroke: how it looks.
    """

    value: float
    label: str = ""
    stroke: Stroke = Stroke(Ink.BLACK, Dash.DASHED, 0.8)


@dataclass(frozen=True, eq=False)
class Spans:
    """Stretches of the x axis, shaded over the whole height of the plot.

    Attributes:
        edges: (n, 2) where each begins and ends, on the x axis.
        label: for the legend, empty for none.
        ink: its colour, drawn pale.
    """

    edges: Array
    label: str = ""
    ink: Ink = Ink.ORANGE


Mark = Line | Points | Band | Histogram | Bars | Level | Spans


@dataclass(frozen=True)
class Axis:
    """An axis.

    Attributes:
        quantity: what it shows.
        unit: in which unit; "1" for a number without one, empty where it is not known.
        log: whether it is logarithmic.
        range: first and last value; from the data where None.
        names: the labels at 0, 1, 2, … of an axis of names, which has no unit.
    """

    quantity: str
    unit: str = ""
    log: bool = False
    range: tuple[float, float] | None = None
    names: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Quantity and unit.

        >>> Axis("Torque", "N*m").title, Axis("Gain", "1").title, Axis("y1").title
        ('Torque [N·m]', 'Gain [–]', 'y1')
        """
        return f"{self.quantity} [{readable_unit(self.unit)}]" if self.unit and not self.names else self.quantity


@dataclass(frozen=True)
class Plot:
    """Marks on two axes.

    Attributes:
        marks: what is drawn, the first at the bottom.
        x, y: the axes.
        title: difference to the other plots of its figure, may be empty.
        height: in rows of ordinary height.
        span: its width in columns of the figure.
    """

    marks: tuple[Mark, ...]
    x: Axis
    y: Axis
    title: str = ""
    height: float = 1.0
    span: int = 1


@dataclass(frozen=True)
class Figure:
    """Plots that belong together.

    Attributes:
        name: of its files and its place in the page: small letters, digits and hyphens.
        caption: what the figure shows, in one or two sentences.
        plots: row by row.
        columns: how many stand beside each other where there is room.
        shared_x: whether all have the same x axis and are zoomed together.
    """

    name: str
    caption: str
    plots: tuple[Plot, ...]
    columns: int = 1
    shared_x: bool = False

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", self.name):
            raise ValueError(f"figure name {self.name!r}; use small letters, digits and hyphens")
        if not self.plots or any(not plot.marks for plot in self.plots):
            raise ValueError(f"figure {self.name} has nothing to show; leave it or its empty plot out")
        if any(plot.span > self.columns for plot in self.plots):
            raise ValueError(f"figure {self.name} has {self.columns} columns and a wider plot")

    @property
    def rows(self) -> tuple[tuple[Plot, ...], ...]:
        """The plots by rows."""
        rows: list[list[Plot]] = [[]]
        for plot in self.plots:
            if sum(each.span for each in rows[-1]) + plot.span > self.columns:
                rows.append([])
            rows[-1].append(plot)
        return tuple(tuple(row) for row in rows)


@dataclass(frozen=True)
class Box:
    """A block of a diagram: a rectangle with lines of text in its middle.

    Attributes:
        x, y, width, height: its left upper corner and size.
        lines: the text.
    """

    x: float
    y: float
    width: float
    height: float
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Circle:
    """A circle of a diagram with a short text, such as a sum.

    Attributes:
        x, y, radius: its centre and radius.
        text: in its middle.
    """

    x: float
    y: float
    radius: float
    text: str = ""


@dataclass(frozen=True)
class Wire:
    """A line of a diagram.

    Attributes:
        points: (x, y) of its corners.
        arrow: whether it ends in an arrow.
    """

    points: tuple[tuple[float, float], ...]
    arrow: bool = True

    @property
    def head(self) -> tuple[tuple[float, float], ...]:
        """The corners of its arrow."""
        (x0, y0), (x1, y1) = self.points[-2:]
        length = hypot(x1 - x0, y1 - y0)
        dx, dy = (x1 - x0) / length, (y1 - y0) / length
        sides = ((x1 - 8 * dx + s * dy, y1 - 8 * dy - s * dx) for s in (3.2, -3.2))
        return ((x1, y1), *((round(x, 2), round(y, 2)) for x, y in sides))


@dataclass(frozen=True)
class Text:
    """A text of a diagram, centred at a point of its baseline.

    Attributes:
        x, y: the point.
        text: what it says.
    """

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class Diagram:
    """A drawing of blocks and lines.

    Attributes:
        name: of its files and its place in the page, as that of a `Figure`.
        caption: what it shows.
        width, height: of the drawing; all coordinates are in these units, y downwards.
        shapes: what is drawn, the first at the bottom.
    """

    name: str
    caption: str
    width: float
    height: float
    shapes: tuple[Box | Circle | Wire | Text, ...]


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        header: a head for every column.
        rows: as many cells each.
        caption: what it shows.
        note: explanation below the table.
        text_columns: how many columns at the left are text; the others are numbers.
        ends_in_text: whether the last column is text too.
        emphasised: rows in bold.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    note: str = ""
    text_columns: int = 1
    ends_in_text: bool = False
    emphasised: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.header) for row in self.rows):
            raise ValueError(f"table {self.caption!r}: every row needs {len(self.header)} cells")

    def is_text(self, column: int) -> bool:
        """Whether a column is text, counted from 0."""
        return column < self.text_columns or (self.ends_in_text and column == len(self.header) - 1)


@dataclass(frozen=True)
class Term:
    """Definition of a term.

    Attributes:
        word: the term in the tables and figures that follow.
        meaning: in a sentence.
    """

    word: str
    meaning: str


@dataclass(frozen=True)
class Notice:
    """A finding as a sentence.

    Attributes:
        text: the sentence.
        severity: ``info``, ``warning`` or ``problem``.
    """

    text: str
    severity: str = "info"


@dataclass(frozen=True)
class Section:
    """A part of a report, in this order: paragraphs, remarks, terms, equations, diagrams, tables, figures.

    Attributes:
        title: its heading.
        paragraphs: plain text.
        equations: plain text, set in a fixed width.
        tables, figures: what it shows.
        remarks: a list of remarks of one or two sentences each.
        terms: definitions of its terms.
        diagrams: drawings of blocks and lines.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    equations: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    remarks: tuple[str, ...] = ()
    terms: tuple[Term, ...] = ()
    diagrams: tuple[Diagram, ...] = ()


@dataclass(frozen=True)
class Fact:
    """A key figure for the first screen.

    Attributes:
        value: with its unit.
        meaning: in a few words.
        interval: of the value, empty where there is none.
    """

    value: str
    meaning: str
    interval: str = ""


@dataclass(frozen=True)
class Report:
    """A report.

    Attributes:
        title: its heading.
        summary: paragraphs of plain text that say what was found.
        sections: its parts.
        facts: key figures of the first screen.
        imprint: a line at the bottom: the command and its data.
        opening: equations, tables and figures of the first screen, before the contents; without a title.
        notices: warnings and problems, beside the opening.
        advice: what to do next, in sentences.
    """

    title: str
    summary: tuple[str, ...]
    sections: tuple[Section, ...]
    facts: tuple[Fact, ...] = ()
    imprint: str = ""
    opening: Section = Section("")
    notices: tuple[Notice, ...] = ()
    advice: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        drawn: list[Figure | Diagram] = [*self.figures, *self.diagrams]
        names = [each.name for each in drawn]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise ValueError(f"two figures are called {twice!r}; their files need names of their own")

    @property
    def figures(self) -> Iterator[Figure]:
        """All figures of all sections, in order."""
        return (figure for section in (self.opening, *self.sections) for figure in section.figures)

    @property
    def diagrams(self) -> Iterator[Diagram]:
        """All diagrams of all sections, in order."""
        return (diagram for section in (self.opening, *self.sections) for diagram in section.diagrams)

    def with_figures(self, names: Collection[str]) -> Report:
        """The same with only the figures of these names."""

        def kept(section: Section) -> Section:
            return replace(section, figures=tuple(each for each in section.figures if each.name in names))

        return replace(self, opening=kept(self.opening), sections=tuple(map(kept, self.sections)))
