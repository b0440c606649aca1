"""Diagrams: blocks, circles, texts and the lines between them."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot


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
