r"""Inner products of every regressor of a dictionary with a signal, without its matrix.

Regressors of a dictionary share factors: ``y(t-1)*y(t-2)*u(t-1)`` and ``y(t-1)*y(t-2)*u(t-2)`` differ in the last one.
So a dictionary is a tree. A node is a product of factors; its parent is the product without the last factor. Then
``φⱼᵀx = Σₜ x(t)·(product of all factors but the last)·(last factor)``, and for a few hundred samples at a time every
node is computed once, from its parent, for all regressors below it. For n lagged signals and degree 3, n³/6 regressors
take n³/6 multiplications and additions per sample, and memory for n + 4 rows of a few hundred numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.regression.kernels import multiply
from emsid.models.regression.regressors import Integers, Regressor

Array = NDArray[np.float64]

# Samples of one factor that are processed at a time: those of a node and of four factors stay in the first-level cache.
WIDTH = 512
# Regressors of one node whose sums are computed together.
TOGETHER = 4
# The channel of the factor 1, which a constant regressor consists of.
ONE = -1


class Tree(NamedTuple):
    """The regressors of a dictionary as a tree of products, in the form that the kernel uses.

    Attributes:
        factors: (f, 3) channel, lag and transform of the different factors; channel `ONE` is the constant 1.
        parameters: (f,) of their transforms.
        nodes: (m, 2) depth in the tree and last factor of every product; a node follows its parent, and between them
            there are only others below that parent. The first node is the empty product.
        offsets: (m + 1,); the ends ``offsets[k]`` to ``offsets[k + 1]`` belong to node k.
        ends: (n, 2) regressor and last factor.
        signs: (n,) of the regressors.
    """

    factors: Integers
    parameters: Array
    nodes: Integers
    offsets: Integers
    ends: Integers
    signs: Array


def tree(regressors: Sequence[Regressor]) -> Tree:
    """The tree of these regressors; a power counts as equal factors."""
    factors: dict[tuple[float, ...], int] = {}
    products: dict[tuple[int, ...], list[tuple[int, int]]] = {(): []}
    for j, regressor in enumerate(regressors):
        codes = [
            factors.setdefault((f.channel, f.lag, f.transform, f.parameter), len(factors))
            for f in regressor.factors
            for _ in range(f.power)
        ] or [factors.setdefault((ONE, 0, 0, 0.0), len(factors))]
        *path, last = codes
        products.setdefault(tuple(path), []).append((j, last))
    for path_of in list(products):
        for length in range(1, len(path_of)):
            products.setdefault(path_of[:length], [])
    nodes = sorted(products)
    several = np.array(list(factors), dtype=float).reshape(-1, 4)
    return Tree(
        factors=several[:, :3].astype(np.int64),
        parameters=np.ascontiguousarray(several[:, 3]),
        nodes=np.array([(len(node), node[-1] if node else 0) for node in nodes], dtype=np.int64),
        offsets=np.cumsum([0] + [len(products[node]) for node in nodes]).astype(np.int64),
        ends=np.array([end for node in nodes for end in products[node]], dtype=np.int64).reshape(-1, 2),
        signs=np.array([-1.0 if r.negative else 1.0 for r in regressors]),
    )


@njit(nogil=True)
def correlate(result: Array, products: Tree, y: Array, u: Array, start: int, weight: Array, square: bool) -> None:
    """Add φⱼᵀx of samples ``start`` … to a result, or the sum of x·φⱼ².

    Args:
        result: (n,).
        products: the regressors.
        y, u: (N,) and (nu, N).
        start: the first sample.
        weight: (N − start,) x.
        square: whether to sum squares.
    """
    factors, parameters, nodes, offsets, ends, signs = products
    rows = np.empty((len(factors), WIDTH))
    path = np.empty((nodes[:, 0].max() + 1, WIDTH))
    sums = np.zeros(len(ends))
    for first in range(start, len(y), WIDTH):
        count = min(WIDTH, len(y) - first)
        for f in range(len(factors)):
            row = rows[f, :count]
            row[:] = 1.0
            channel, lag, code = factors[f]
            if channel != ONE:
                signal = y if channel == 0 else u[channel - 1]
                multiply(row, signal[first - lag : first - lag + count], code, parameters[f], 2 if square else 1)
        path[0, :count] = weight[first - start : first - start + count]
        for k in range(len(nodes)):
            depth = nodes[k, 0]
            if depth > 0:
                _multiplied(path[depth], path[depth - 1], rows[nodes[k, 1]], count)
            _add_sums(sums, path[depth], rows, ends, offsets[k], offsets[k + 1], count)
    for k in range(len(ends)):
        j = ends[k, 0]
        result[j] += sums[k] if square else signs[j] * sums[k]


_vectorised = njit(nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")


@_vectorised
def _multiplied(out: Array, a: Array, b: Array, count: int) -> None:
    """out = a·b in the first elements."""
    for i in range(count):
        out[i] = a[i] * b[i]


@_vectorised
def _add_sums(sums: Array, node: Array, rows: Array, ends: Integers, begin: int, end: int, count: int) -> None:
    """Add Σ node·row to the sum of every end ``begin`` … ``end``, four at a time."""
    k = begin
    while k + TOGETHER <= end:
        a, b, c, d = rows[ends[k, 1]], rows[ends[k + 1, 1]], rows[ends[k + 2, 1]], rows[ends[k + 3, 1]]
        of_a, of_b, of_c, of_d = 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            x = node[i]
            of_a += x * a[i]
            of_b += x * b[i]
            of_c += x * c[i]
            of_d += x * d[i]
        sums[k] += of_a
        sums[k + 1] += of_b
        sums[k + 2] += of_c
        sums[k + 3] += of_d
        k += TOGETHER
    while k < end:
        a = rows[ends[k, 1]]
        of_a = 0.0
        for i in range(count):
            of_a += node[i] * a[i]
        sums[k] += of_a
        k += 1
