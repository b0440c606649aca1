"""What the plot of a static map shows, in a cascade as in a feedback model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.static_maps import StaticMap
from emsid.report.document import Band, Histogram, Ink, Line, Mark, Points, Stroke

Array = NDArray[np.float64]

BEYOND, POINTS = 0.04, 400
"""A map is drawn this fraction of the range beyond the data, through this many points."""
BINS = 80
"""Of the histogram of the input."""


def map_marks(shown: StaticMap, curve: Line, bands: Sequence[Band], entering: Array) -> tuple[Mark, ...]:
    """A histogram of the input of a map, its band, its curve, and its knots, break points or limits.

    Args:
        shown: the map.
        curve: of the map, over the range of the axis.
        bands: of the curve; none for a fit without intervals.
        entering: (K,) inputs of the map in a record.
    """
    low, high = curve.x[0], curve.x[-1]
    edges = np.linspace(low, high, BINS + 1)
    counts = np.histogram(entering, edges)[0].astype(float)
    corners, what = shown.marks()
    corners = corners[(corners >= low) & (corners <= high)]
    points = [Points(corners, shown.value(corners), what, Ink.NAVY)] if len(corners) else []
    return (Histogram(edges, counts, "signal in this record", backdrop=True), *bands, curve, *points)


def map_curve(x: Array, value: Array, label: str) -> Line:
    """The curve of a map."""
    return Line(x, value, label, Stroke(Ink.BLUE, width=1.4))
