"""Figures: plots of marks on two axes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

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
