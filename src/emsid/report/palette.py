"""The colours of the page, light and dark, and which of them stand on which.

A browser takes one of the two by the setting of the system; paper is light. The inks of figures are those of `Ink`,
which are chosen for white paper; in the dark each has a lighter one of the same hue. `PAIRS` are the pairs that must
contrast by WCAG 2.2: 4.5 to 1 for text (success criterion 1.4.3), 3 to 1 for lines and marks (1.4.11).
"""

from __future__ import annotations

from emsid.report.document import Ink

LIGHT = {
    "text": "#22262e",
    "quiet": "#5d6470",
    "line": "#e1e5ea",
    "paper": "#ffffff",
    "ground": "#f7f8fa",
    "accent": "#1c5d99",
    "best": "#eef6ef",
    "warn": "#c47500",
    "problem": "#d1242f",
    "shade": "#c3c9d2",
    "axis": "#858a93",
    "grid": "#e4e7eb",
    "box": "#f3f7fb",
    **{ink.name.lower(): ink.value for ink in Ink},
}
"""By name of the variable in the style sheet: text and secondary text; lines between rows; cards, tables and plots
(paper) on the ground; links; the row in bold; the edges of notices; the shadow at the edge of a table; axes, grid and
blocks of plots; inks."""
DARK = {
    "text": "#e3e6ea",
    "quiet": "#9aa3af",
    "line": "#343a44",
    "paper": "#1d2127",
    "ground": "#15181d",
    "accent": "#7fb6e8",
    "best": "#20332a",
    "warn": "#f0a030",
    "problem": "#ff6b6b",
    "shade": "#000000",
    "axis": "#868e9a",
    "grid": "#2b3038",
    "box": "#222a33",
    "blue": "#5aa9e6",
    "red": "#ff6b6b",
    "navy": "#b9c8f5",
    "green": "#3fbf8f",
    "orange": "#f0a030",
    "purple": "#d08fcd",
    "grey": "#9aa3af",
    "black": "#e3e6ea",
}
"""The same on a dark screen."""

TEXT, MARK = 4.5, 3.0
PAIRS = (
    *((front, back, TEXT) for front in ("text", "quiet", "accent") for back in ("ground", "paper", "box")),
    ("text", "best", TEXT),
    *((mark, "paper", MARK) for mark in ("axis", "warn", "problem", *(ink.name.lower() for ink in Ink))),
)
"""Foreground, background, and the least ratio of their contrast."""

_NAMES = {ink.value: ink.name.lower() for ink in Ink}


def variable(colour: str) -> str:
    """The colour of an ink as a variable of the style sheet.

    >>> variable(Ink.RED.value)
    'var(--red)'
    """
    return f"var(--{_NAMES[colour]})"
