"""What the plot of a static map shows, in a cascade as in a feedback model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.models.bands import Band as Computed
from emsid.models.blocks.static_maps import StaticMap
from emsid.report.document import Histogram, Ink, Mark, Points
from emsid.report.views.bands import curve_with_band

Array = NDArray[np.float64]

BEYOND, POINTS = 0.04, 400
"""A map is drawn this fraction of the range beyond the data, through this many points."""
BINS = 80
"""Of the histogram of the input."""


def map_marks(shown: StaticMap, curve: Computed, label: str, entering: Array) -> tuple[Mark, ...]:
    """A histogram of the input of a map, its band, its curve, and its knots, break points or limits.

    Args:
        shown: the map.
        curve: of the map with its band, over the range of the axis.
        label: of the curve.
        entering: (K,) inputs of the map in a record.
    """
    low, high = curve.x[0], curve.x[-1]
    edges = np.linspace(low, high, BINS + 1)
    counts = np.histogram(entering, edges)[0].astype(float)
    corners, what = shown.marks()
    corners = corners[(corners >= low) & (corners <= high)]
    points = [Points(corners, shown.value(corners), what, Ink.NAVY)] if len(corners) else []
    return (Histogram(edges, counts, "signal in this record", backdrop=True), *curve_with_band(curve, label), *points)
