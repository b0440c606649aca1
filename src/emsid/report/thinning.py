"""Fewer points for a line, for every module that draws one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def thin(x: ArrayLike, y: ArrayLike, limit: int) -> tuple[Array, Array]:
    """Reduce a line to at most ``limit`` points that look the same: the lowest and highest of every bucket of samples.

    The first and the last point, the extremes and the gaps (NaN) are kept. Kept points are unchanged and in order. A
    line that is short enough is returned unchanged.

    Args:
        x, y: (n,) the line.
        limit: at least 6.
    """
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if len(ys) <= limit:
        return xs, ys
    gap = np.isnan(ys)
    kept_per_bucket = 4 if gap.any() else 2
    size = int(np.ceil(len(ys) / ((limit - 2) // kept_per_bucket)))
    count = int(np.ceil(len(ys) / size))
    padding = count * size - len(ys)

    def buckets(values: NDArray[Any], fill: float) -> NDArray[Any]:
        padded: NDArray[Any] = np.concatenate([values, np.full(padding, fill, dtype=values.dtype)])
        return padded.reshape(count, size)

    first = size * np.arange(count)
    chosen = [
        first + np.argmin(buckets(np.where(gap, np.inf, ys), np.inf), axis=1),
        first + np.argmax(buckets(np.where(gap, -np.inf, ys), -np.inf), axis=1),
    ]
    if gap.any():  # the first and the last gap of a bucket, so that no line is drawn across one
        in_bucket = buckets(gap, False)
        some = in_bucket.any(axis=1)
        chosen += [
            (first + np.argmax(in_bucket, axis=1))[some],
            (first + size - 1 - np.argmax(in_bucket[:, ::-1], axis=1))[some],
        ]
    kept = np.unique(np.concatenate([[0], *chosen, [len(ys) - 1]]))
    return xs[kept], ys[kept]
