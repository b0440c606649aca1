"""Lines as braille letters, for a terminal: every letter shows two columns of four dots."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

# The bit of every dot of a braille letter, by row and column (Unicode 15, section 21.1).
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_BLANK = 0x2800


def braille(values: ArrayLike, width: int, height: int) -> list[str]:
    """A line through values (N,) as rows of braille letters; every column of dots spans the values that fall into it.

    >>> braille([0.0, 1.0, 2.0, 3.0], 2, 1)
    ['⡠⠊']

    Args:
        values: NaN leaves a gap.
        width: letters in a row.
        height: rows.
    """
    y = np.asarray(values, dtype=float)
    low, high = (float(f(y)) for f in (np.nanmin, np.nanmax))
    levels, columns = 4 * height, min(2 * width, max(len(y), 1))
    span = high - low or 1.0
    rows = (levels - 1) - np.rint((np.nan_to_num(y, nan=low) - low) / span * (levels - 1)).astype(int)
    dots: NDArray[np.bool_] = np.zeros((levels, 2 * width), dtype=bool)
    edges = np.linspace(0, len(y), columns + 1).astype(int)
    places = np.linspace(0, 2 * width - 1, columns).astype(int)
    for k, place in enumerate(places):
        part = slice(edges[k], max(edges[k + 1], edges[k] + 1))
        known = rows[part][np.isfinite(y[part])]
        if len(known):
            dots[known.min() : known.max() + 1, place] = True
    letters = (dots.reshape(height, 4, width, 2) * _DOTS[None, :, None, :]).sum(axis=(1, 3))
    return ["".join(chr(_BLANK + int(bits)) for bits in row) for row in letters]
