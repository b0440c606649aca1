"""`Information`, the triangular factor that every least-squares problem is solved from.

A least-squares problem ``min ‖y − Φθ‖²`` (paper, eq. 3.9) needs of its data only the triangular factor of
``[Φ y]``::

    [Φ y] = Q [R  z]        ‖y − Φθ‖² = ‖z − Rθ‖² + ρ²
              [0  ρ]

Householder reflections, applied to the factor stacked on a tile of new rows, add rows (Golub & Van Loan, *Matrix
Computations*, 4th ed., sec. 5.2 and 6.5.3). So memory is constant, and normal equations, which would square the
condition number, are never formed. Two factors are merged in the same way, whether they come from blocks, experiments,
cores or machines. A factor scaled by √λ implements forgetting. A subset of its columns is the factor of the smaller
problem. The factor is unique up to the signs of its rows, so the order of the rows affects only rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.errors import ModelError

Array = NDArray[np.float64]

# Rows added at a time; a tile of a dozen columns stays in the first-level cache.
TILE = 192
# A pivoted unit column of R depends on the others if its diagonal is below this many times n roundings of the largest.
RANK_ROUNDINGS = 8.0


@dataclass(frozen=True)
class Solution:
    """The least-squares solution computed from a factor.

    Attributes:
        estimate: (n,) θ; parameters that the data do not determine are zero.
        covariance: (n, n) of θ under white noise, σ²(RᵀR)⁻¹; infinite on the diagonal of undetermined parameters.
        noise_variance: σ² = RSS/(N − rank).
        residual_sum_of_squares: ‖y − Φθ‖².
        rank: numerical rank of Φ.
        condition: 2-norm condition number of Φ with its columns scaled to unit length; infinite with a column of zeros.
        aliases: for every dependent column, in order, the column itself and the columns that it is a combination of.
    """

    estimate: Array
    covariance: Array
    noise_variance: float
    residual_sum_of_squares: float
    rank: int
    condition: float
    aliases: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Information:
    """The information of a set of equations ``y = Φθ + e`` about θ.

    Attributes:
        factor: (n + 1, n + 1) upper triangular factor of [Φ y].
        samples: the number of rows; with forgetting, the effective number.
    """

    factor: Array
    samples: float = 0.0

    @classmethod
    def empty(cls, parameters: int) -> Information:
        """No rows yet, for this many parameters."""
        return cls(np.zeros((parameters + 1, parameters + 1)))

    @classmethod
    def from_rows(cls, regression: ArrayLike, target: ArrayLike) -> Information:
        """The information in Φ (N, n) and y (N,).

        Raises:
            ModelError: for arrays of other shapes.
        """
        phi = np.asarray(regression, dtype=float)
        if phi.ndim != 2:
            raise ModelError(f"a regression of shape {phi.shape}; give (N, n)")
        return cls.empty(phi.shape[1]).add(phi, target)

    @property
    def parameters(self) -> int:
        """n, the number of parameters."""
        return len(self.factor) - 1

    def add(self, regression: ArrayLike, target: ArrayLike) -> Information:
        """With further rows Φ (m, n) and y (m,).

        Raises:
            ModelError: for arrays of other shapes.
        """
        phi, y = np.asarray(regression, dtype=float), np.asarray(target, dtype=float)
        if phi.ndim != 2 or phi.shape[1] != self.parameters or y.shape != (len(phi),):
            raise ModelError(
                f"rows of shape {phi.shape} and {y.shape} for {self.parameters} parameters; give (m, n) and (m,)"
            )
        return self.add_columns(np.vstack([phi.T, y]))

    def add_columns(self, columns: Array) -> Information:
        """With further rows given as the C-contiguous columns of [Φ y], (n + 1, m); fast, without checks."""
        factor = self.factor.copy()
        add_rows(factor, columns)
        return Information(factor, self.samples + columns.shape[1])

    def add_part(self, parameters: ArrayLike, columns: Array) -> Information:
        """With further rows that depend on these parameters alone; their number counts, not that of all.

        Args:
            parameters: m positions among the n.
            columns: (m + 1, k) C-contiguous columns of [Φ y] for them.
        """
        own = np.asarray(parameters, dtype=int)
        part = Information.empty(len(own)).add_columns(columns).factor
        rows = np.zeros((self.parameters + 1, len(part)))
        rows[np.append(own, self.parameters)] = part.T
        return replace(self.add_columns(rows), samples=self.samples + columns.shape[1])

    def merge(self, other: Information) -> Information:
        """The information of both."""
        factor = self.factor.copy()
        add_rows(factor, np.ascontiguousarray(other.factor.T))
        return Information(factor, self.samples + other.samples)

    def forget(self, factor: float) -> Information:
        """All rows so far weighted by ``factor``, 0 < factor ≤ 1."""
        return Information(self.factor * np.sqrt(factor), self.samples * factor)

    def select(self, columns: ArrayLike) -> Information:
        """The problem with only these regressors: a nested structure needs no further pass over the data."""
        kept = np.append(np.asarray(columns, dtype=int), self.parameters)
        factor = np.zeros((len(kept), len(kept)))
        add_rows(factor, np.ascontiguousarray(self.factor[:, kept].T))
        return Information(factor, self.samples)

    def with_prior(self, weight: ArrayLike, mean: ArrayLike = 0.0) -> Information:
        """With a prior √weight·(θ − mean) = 0 for each parameter: ridge regression where ``mean`` is zero.

        Args:
            weight: (n,) or a number, not negative.
            mean: (n,) or a number.
        """
        n, root = self.parameters, np.sqrt(weight)
        columns = np.zeros((n + 1, n))
        columns.flat[:: n + 1] = root
        columns[n] = root * mean
        return Information(self.add_columns(columns).factor, self.samples)

    def solve(self, rank_tolerance: float | None = None) -> Solution:
        """The least-squares estimate (3.10) with covariance, rank and condition.

        Args:
            rank_tolerance: relative size below which a pivoted column counts as dependent on the others; by default
                a few roundings.
        """
        from scipy.linalg import qr, solve_triangular, svdvals

        n = self.parameters
        triangle, projected = self.factor[:n, :n], self.factor[:n, n]
        length = np.linalg.norm(triangle, axis=0)
        unit = np.divide(triangle, length, out=np.zeros_like(triangle), where=length > 0)
        orthogonal, pivoted, order = qr(unit, pivoting=True)
        size = np.abs(np.diag(pivoted))
        tolerance = RANK_ROUNDINGS * n * np.finfo(float).eps if rank_tolerance is None else rank_tolerance
        rank = int(np.count_nonzero(size > tolerance * size[0])) if n and size[0] > 0 else 0
        leading, rest = pivoted[:rank, :rank], pivoted[:rank, rank:]
        rotated = orthogonal.T @ projected
        kept, left = order[:rank], order[rank:]

        estimate = np.zeros(n)
        estimate[kept] = solve_triangular(leading, rotated[:rank]) / length[kept]
        residual = float(np.sum(rotated[rank:] ** 2) + self.factor[n, n] ** 2)
        freedom = self.samples - rank
        variance = residual / freedom if freedom > 0 else np.nan

        inverse = inverse_triangle(leading)
        with np.errstate(over="ignore"):  # of a column of hardly any length the variance is infinite
            spread = inverse @ inverse.T / np.outer(length[kept], length[kept])
        covariance = np.zeros((n, n))
        covariance[np.ix_(kept, kept)] = variance * spread
        covariance[left, left] = np.inf

        weights = np.abs(inverse @ rest)
        in_order = np.argsort(left)  # the pivots' order may hang on rounding
        aliases = tuple((int(left[j]), *(int(k) for k in np.sort(kept[weights[:, j] > 1e-6]))) for j in in_order)
        singular = svdvals(unit) if n else np.ones(1)
        return Solution(
            estimate=estimate,
            covariance=covariance,
            noise_variance=float(variance),
            residual_sum_of_squares=residual,
            rank=rank,
            condition=float(singular[0] / singular[-1]) if length.all() and singular[-1] > 0 else np.inf,
            aliases=aliases,
        )


def inverse_triangle(triangle: Array) -> Array:
    """R⁻¹ of an upper triangular R with no zero on its diagonal.

    A triangular solve for the identity would start BLAS threads, which takes milliseconds even for a small triangle.
    """
    from scipy.linalg.lapack import dtrtri

    return np.asarray(dtrtri(triangle)[0]) if len(triangle) else triangle


def add_rows_reference(factor: Array, columns: Array) -> Array:
    """The factor with new rows, by NumPy: a slow and simple reference for `add_rows`."""
    return np.asarray(np.linalg.qr(np.vstack([factor, columns.T]), mode="r"))


@njit(nogil=True)
def add_rows(factor: Array, columns: Array) -> None:
    """Update a triangular factor (k, k) in place with the rows of [Φ y], given as columns (k, m).

    `columns` is not changed: its tiles are copied to an array that fits into the first-level cache.
    """
    width, rows = columns.shape
    top, tile = workspace(factor)
    for first in range(0, rows, TILE):
        height = min(TILE, rows - first)
        for j in range(width):
            for i in range(height):
                tile[j, i] = columns[j, first + i]
        reflect(top, tile, height)
    copy_square(top, factor, width)


@njit(nogil=True)
def workspace(factor: Array) -> tuple[Array, Array]:
    """The factor and a tile for `reflect`, both padded with two columns of zeros."""
    width = len(factor)
    top = np.zeros((width, width + 2))
    copy_square(factor, top, width)
    return top, np.zeros((width + 2, TILE))


@njit(nogil=True)
def copy_square(source: Array, target: Array, width: int) -> None:
    """Copy the first rows and columns; a slice assignment, with its shape check, takes seconds to compile."""
    for i in range(width):
        for j in range(width):
            target[i, j] = source[i, j]


# The compiler vectorises an inner loop only in a small function with few arrays.
_compiled = njit(nogil=True, fastmath={"reassoc", "contract", "nsz"}, error_model="numpy")


@_compiled
def reflect(top: Array, tile: Array, height: int) -> None:
    """Reflect the first ``height`` rows of a tile, stored by columns, against the factor; see `workspace`.

    Columns v and w define two reflections H = I − τ (1, v/p)(1, v/p)ᵀ. Both are applied together to the remaining
    columns, two at a time, to halve the memory traffic: with g the product of the two reflectors, the second one acts
    on the result of the first, ``s₂ = τ₂ (d₂ − g s₁)``. The columns of zeros make the number of columns even.
    """
    width = len(top)
    for k in range(0, width, 2):
        v, w = tile[k], tile[k + 1]
        square, product = _square_and_product(v, w, height)
        top[k, k], p, tau_v = _reflector(top[k, k], square)
        step = tau_v * (top[k, k + 1] + product / p)
        top[k, k + 1] -= step
        if k + 1 == width:
            break
        add_multiple(w, -step / p, v, height)
        square, product = _square_and_product(w, v, height)
        top[k + 1, k + 1], q, tau_w = _reflector(top[k + 1, k + 1], square)
        g = product / (p * q)
        for j in range(k + 2, width, 2):
            a, b = tile[j], tile[j + 1]
            va, vb, wa, wb = _products(v, w, a, b, height)
            va = tau_v * (top[k, j] + va / p)
            vb = tau_v * (top[k, j + 1] + vb / p)
            wa = tau_w * (top[k + 1, j] + wa / q - g * va)
            wb = tau_w * (top[k + 1, j + 1] + wb / q - g * vb)
            top[k, j] -= va
            top[k, j + 1] -= vb
            top[k + 1, j] -= wa
            top[k + 1, j + 1] -= wb
            _add_multiples(a, -va / p, v, -wa / q, w, height)
            _add_multiples(b, -vb / p, v, -wb / q, w, height)


@_compiled
def _reflector(head: float, square: float) -> tuple[float, float, float]:
    """The reflection of (head, v) with ‖v‖² = square: its result, p and τ; the identity if v is zero."""
    if square == 0.0:
        return head, 1.0, 0.0
    norm = -np.copysign(np.sqrt(head * head + square), head)
    p = head - norm
    return norm, p, -p / norm


@_compiled
def _square_and_product(v: Array, w: Array, height: int) -> tuple[float, float]:
    """vᵀv and vᵀw."""
    square, product = 0.0, 0.0
    for i in range(height):
        square += v[i] * v[i]
        product += v[i] * w[i]
    return square, product


@_compiled
def _products(v: Array, w: Array, a: Array, b: Array, height: int) -> tuple[float, float, float, float]:
    """vᵀa, vᵀb, wᵀa, wᵀb."""
    va, vb, wa, wb = 0.0, 0.0, 0.0, 0.0
    for i in range(height):
        va += v[i] * a[i]
        vb += v[i] * b[i]
        wa += w[i] * a[i]
        wb += w[i] * b[i]
    return va, vb, wa, wb


@_compiled
def add_multiple(a: Array, by_v: float, v: Array, height: int) -> None:
    """a + by_v·v in the first rows, in place."""
    for i in range(height):
        a[i] += by_v * v[i]


@_compiled
def _add_multiples(a: Array, by_v: float, v: Array, by_w: float, w: Array, height: int) -> None:
    """a + by_v·v + by_w·w in the first rows, in place."""
    for i in range(height):
        a[i] += by_v * v[i] + by_w * w[i]
