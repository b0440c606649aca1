"""Several static maps as tables of polynomials between break points, for compiled loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.blocks.static_maps.static_map import StaticMap

Array = NDArray[np.float64]


class Tables(NamedTuple):
    """The pieces of several maps, one after the other.

    Attributes:
        first: (m + 1,) the first piece of each map, and the number of pieces.
        edges, origins, coefficients: as in `Pieces`, of all maps.
        signs: (m, 2) jump and width of each map.
    """

    first: NDArray[np.int64]
    edges: Array
    origins: Array
    coefficients: Array
    signs: Array


def tables_of(maps: Sequence[StaticMap]) -> Tables | None:
    """The tables of maps; None if one of them is no polynomial between break points."""
    pieces = [each.pieces() for each in maps]
    known = [piece for piece in pieces if piece is not None]
    if len(known) < len(maps):
        return None
    first = np.zeros(len(known) + 1, dtype=np.int64)
    for k, each in enumerate(known):
        first[k + 1] = first[k] + len(each.edges)
    edges, origins = np.empty(first[-1]), np.empty(first[-1])
    coefficients = np.zeros((first[-1], max((each.coefficients.shape[1] for each in known), default=1)))
    signs = np.empty((len(known), 2))
    for k, each in enumerate(known):
        rows = slice(first[k], first[k + 1])
        edges[rows], origins[rows], signs[k] = each.edges, each.origins, (each.jump, each.width)
        coefficients[rows, : each.coefficients.shape[1]] = each.coefficients
    return Tables(first, edges, origins, coefficients, signs)


@njit(nogil=True)
def value_at(tables: Tables, k: int, z: float) -> float:
    """The map k at z."""
    first, edges, origins, coefficients, signs = tables
    low, high = first[k], first[k + 1] - 1
    while low < high:  # the last piece whose edge is not above z
        middle = (low + high + 1) // 2
        if edges[middle] <= z:
            low = middle
        else:
            high = middle - 1
    h, degree = z - origins[low], coefficients.shape[1] - 1
    value = coefficients[low, degree]
    for power in range(degree - 1, -1, -1):
        value = value * h + coefficients[low, power]
    jump, width = signs[k, 0], signs[k, 1]
    if jump != 0.0:
        value += jump * (np.tanh(z / width) if width > 0.0 else np.sign(z))
    return float(value)
