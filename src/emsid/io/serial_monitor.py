"""Lines of a serial monitor or of a log as rows of a table: ``12:00:00.010 -> PWM:120, speed:3.4 rad/s``.

Boards print a label before each value, so that a plotter can name its curves, or a JSON object a line. Monitors print
the time of day and an arrow before each line, logs a time, a level and the name of a part. The labels become the
header, and the time becomes the first column. Rows of a list, ``[0.01, 12.0, 3.4]``, lose their brackets.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

LAST_LINES = 100
"""This many lines at the end of a file determine its structure."""

_TIMED = re.compile(r"\s*(\d{1,2}:\d{2}:\d{2}(?:\.\d+)?)\s*-?>[ \t]*(.*)")
_STAMPED = re.compile(
    r"""[^\d=:]*
        (?P<time>(?:\d{4}-\d{2}-\d{2}[T ])?\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?|\d+\.\d+)(?=[\])\s:,-])
        [^=]*?(?:[\])]:?|:|\s-)\s+
        (?P<rest>[^\W\d][^\s:=]*\s*[:=].*)""",
    re.VERBOSE,
)
_IN_BRACKETS = re.compile(r"\s*[\[({]+([^\[\](){}:=]*)[\])}]+\s*[,;]?\s*")
_LABELLED = re.compile(
    r"""\s*"?(?P<label>[^\W\d][^\s":=,;]*(?:[ ][^\s"\d:=,;][^\s":=,;]*)*)"?\s*[:=]\s*
        (?P<value>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?nan|[+-]?inf)
        (?:[ ]?(?P<unit>[^\s\d":=,;+-][^\s":=,;]*)(?=[ ]*(?:[,;\t]|$)))?
        \s*(?:[,;]|(?=\s)|$)""",
    re.VERBOSE | re.IGNORECASE,
)


class MonitorLines(NamedTuple):
    """The lines of a file, as far as a serial monitor wrote them.

    Attributes:
        texts: every line, with tabs between its values where it had labels, and without its time.
        times: the time of each line; empty where lines have none.
        labels: before the values of a line; empty where there are none.
        units: behind them, empty where there is none.
    """

    texts: list[str]
    times: list[str]
    labels: tuple[str, ...]
    units: tuple[str, ...]


def monitor_lines(texts: Sequence[str]) -> MonitorLines:
    """The lines of a file, without what a serial monitor adds; unchanged where they are from none.

    A line that has no such time, or other labels than most, is left as it is.
    """
    texts = list(texts)
    times: list[str] = []
    last = texts[-LAST_LINES:]
    for form in (_TIMED, _STAMPED):
        if not times and 2 * sum(form.fullmatch(text) is not None for text in last) > len(last):
            timed = [form.fullmatch(text) for text in texts]
            times = [found[1].replace(",", ".") if found else "" for found in timed]
            texts = [found[2] if found else text for found, text in zip(timed, texts, strict=True)]
    if 2 * sum(_IN_BRACKETS.fullmatch(text) is not None for text in last) > len(last):
        texts = [found[1] if (found := _IN_BRACKETS.fullmatch(text)) else text for text in texts]
    labels, count = Counter(_labels(_labelled(text)) for text in texts[-LAST_LINES:]).most_common(1)[0]
    if not labels or 2 * count <= len(last):
        return MonitorLines(texts, times, (), ())
    units = [""] * len(labels)
    for k, text in enumerate(texts):
        row = _labelled(text)
        if _labels(row) == labels:
            texts[k] = "\t".join(found["value"] for found in row)
            units = [known or found["unit"] or "" for known, found in zip(units, row, strict=True)]
    return MonitorLines(texts, times, labels, tuple(units))


def _labelled(text: str) -> list[re.Match[str]]:
    """Every label with its value in a line; nothing where something else is in the line."""
    text = text.strip().removeprefix("{").removesuffix("}")
    found: list[re.Match[str]] = []
    while not found or found[-1].end() < len(text):
        each = _LABELLED.match(text, found[-1].end() if found else 0)
        if each is None:
            return []
        found.append(each)
    return found


def _labels(row: Sequence[re.Match[str]]) -> tuple[str, ...]:
    return tuple(found["label"] for found in row)
