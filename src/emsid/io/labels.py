"""Header lines that begin with a label: ``Channel name,Force,Speed`` and ``Unit,N,m/s`` above the data.

Measuring systems write such lines, each with its label in the first cell, or before every channel. The column under
the label holds the times.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from emsid.io.cells import cells_of, is_missing, is_number

TIME = "time"
"""The name of a column under labels."""
MOST_LINES = 20
"""Header lines above the data that are searched."""
_NAMES = re.compile(r"(channel|signal|column|variable|kanal)?[ _]?names?|channels?|signals?|kan(al|äle)", re.IGNORECASE)
_UNITS = re.compile(r"(y_)?units?([ _](labels?|strings?|symbols?))?|einheit(en)?|dimensions?", re.IGNORECASE)


def labelled(texts: Sequence[str], start: int, width: int) -> tuple[int, list[str], list[str]] | None:
    """The first of such lines, the names and the units; None where there are none.

    Args:
        texts: the lines, with marks between cells.
        start: the first line with data.
        width: the number of its cells.
    """
    found: dict[re.Pattern[str], tuple[int, list[str]]] = {}
    for k in range(start - 1, max(start - 1 - MOST_LINES, -1), -1):
        cells = cells_of(texts[k])[:width]
        label = next((each for each in (_NAMES, _UNITS) if each.fullmatch(cells[0].rstrip(": "))), None)
        if label is not None and label not in found and len(cells) == width and not any(map(is_number, cells)):
            found[label] = k, cells
    first = cells_of(texts[start])[0]
    if _NAMES not in found or not (is_number(first) or is_missing(first)):
        return None
    at, names = found[_NAMES]
    _, units = found.get(_UNITS, (at, [""] * width))
    times = [k for k, name in enumerate(names) if name == names[0]]
    if len(times) == 1 and _UNITS not in found:  # a table with a column that is called so
        return None
    return (
        at,
        [TIME if k in times else name for k, name in enumerate(names)],
        ["" if k in times else unit for k, unit in enumerate(units)],
    )
