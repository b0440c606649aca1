"""Signals of a feedback model that are multiples of one another.

A force that adds to the input acts as the input does: its column of B_w and D_yw is a multiple of that of u. A spring
depends on the position that is measured: its row of C_z and D_zu is a multiple of that of the output.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.feedback.equations import numbered

Array = NDArray[np.float64]
Pair = tuple[str, str]
"""Two signals, of which the first is a multiple of the second."""


def shared_signals(name: str, matrix: Array, maps: int, shared: Iterable[Pair]) -> tuple[tuple[Pair, ...], Array]:
    """The pairs, earlier signals first, and M with the elements of the first of each made the closest multiple.

    Args:
        name: of the model.
        matrix: (n + m + 1, n + 1 + m) M.
        maps: m.
        shared: pairs of signals.

    Raises:
        ModelError: for pairs of other signals.
    """
    z, w = numbered("z", maps), numbered("w", maps)
    order = {signal: k for signals in (("y", *z), ("u", *w)) for k, signal in enumerate(signals)}
    pairs = [(str(first), str(second)) for first, second in shared]
    once = len({first for first, _ in pairs}) == len(pairs)
    for first, second in pairs:
        alike = (first in z and second in ("y", *z)) or (first in w and second in ("u", *w))
        if not (once and alike and order[second] < order[first]):
            raise ModelError(
                f"{name}: {first} of {second} is no shared signal; give one pair for a z or w of its {maps} maps, and "
                "y, u or that of an earlier map"
            )
    if pairs:
        matrix = matrix.copy()
        pairs.sort(key=lambda pair: order[pair[0]])
        for of, like in ((entries(matrix, maps, first), entries(matrix, maps, second)) for first, second in pairs):
            matrix[of] = multiple(matrix[of], matrix[like]) * matrix[like]
        matrix.flags.writeable = False
    return tuple(pairs), matrix


def entries(matrix: Array, maps: int, signal: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(n + 1,) rows and columns of M: the factors of x and u in a z or in y, or of a w or of u in x⁺ and y."""
    last = len(matrix) - 1
    n = last - maps
    if signal[0] in "zy":
        row = last if signal == "y" else n + numbered("z", maps).index(signal)
        return np.full(n + 1, row), np.arange(n + 1)
    column = n if signal == "u" else n + 1 + numbered("w", maps).index(signal)
    return np.append(np.arange(n), last), np.full(n + 1, column)


def multiple(row: Array, of: Array) -> float:
    """The factor c with which c·``of`` is closest to a row; 0 where that is zero."""
    size = float(of @ of)
    return float(row @ of) / size if size else 0.0
