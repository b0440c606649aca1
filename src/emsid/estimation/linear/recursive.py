"""Recursive least squares: the paper's update as printed, and the factored form that the program uses.

The paper updates (section III.B), with forgetting factor λ and prediction error ε(t) = y(t) − φᵀ(t)θ(t−1)::

    P(t) = (1/λ) P(t−1) [I − φφᵀP(t−1) / (λ + φᵀP(t−1)φ)]        θ(t) = θ(t−1) + P(t)φ(t)ε(t)

In this form rounding makes P lose symmetry and finally positiveness. The factored form applies the same update to
P = U D Uᵀ, with U unit upper triangular and D diagonal (Bierman, *Factorization Methods for Discrete Sequential
Estimation*, 1977, ch. V; with forgetting, Ljung, *System Identification*, 2nd ed., sec. 11.7). D stays positive by
construction, at n²·3/2 multiplications per sample. In a direction without excitation, forgetting would let D grow
without bound; D is limited to a multiple of its initial value, which already stands for no knowledge.

If only the last estimate is needed, samples can be processed in tiles: P⁻¹ = RᵀR with ``R = D^(−1/2) U⁻¹`` is a
triangular factor like that of `information`. A tile of samples, each with its weight at the end of the tile, is
reflected into it at a fraction of the cost, and U, D and θ follow from the new factor.

The state is an argument and a result, so samples one by one, in blocks, or all at once give the same numbers.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Generic

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.information import TILE, add_multiple, copy_square, reflect, workspace
from emsid.estimation.linear.least_squares import LinearStructure, M_co, check_excitation
from emsid.record import Record, check_same_channels, concatenate

Array = NDArray[np.float64]

# The largest ratio of D to its initial value; ordinary data never reach it.
WINDUP = 1e4


@dataclass(frozen=True, eq=False)
class RecursiveState:
    """The state of the recursion.

    Attributes:
        estimate: (n,) θ.
        factor: (n, n) Uᵀ, unit lower triangular.
        diagonal: (n,) of D; P = U D Uᵀ.
        samples: effective number of samples, Σ λᵏ.
        residual_sum_of_squares: Σ λᵏ of the squared residuals of the present estimate.
        tail: the last samples, as many as the largest lag of the structure.
    """

    estimate: Array
    factor: Array
    diagonal: Array
    samples: float = 0.0
    residual_sum_of_squares: float = 0.0
    tail: Record | None = None

    @property
    def normalised_covariance(self) -> Array:
        """(n, n) P, the covariance of the estimate for noise of variance one."""
        p: Array = self.factor.T @ (self.diagonal[:, None] * self.factor)
        return p

    @property
    def noise_variance(self) -> float:
        """The noise variance, from the weighted sum of squared residuals."""
        freedom = self.samples - len(self.estimate)
        return self.residual_sum_of_squares / freedom if freedom > 0 else float("nan")

    def cut(self) -> RecursiveState:
        """The state with its estimate but without past samples: the next samples come after a gap."""
        return replace(self, tail=None)


@dataclass(frozen=True)
class RecursiveLeastSquares(Generic[M_co]):
    """Recursive least squares for one structure.

    >>> import emsid
    >>> rls = emsid.RecursiveLeastSquares(emsid.arx(na=1, nb=1), forgetting=0.99)
    >>> state = rls.start()
    >>> state = rls.update(state, emsid.Record([1.0, 0.0, 2.0, 1.0], [0.0, 0.5, 0.4, 1.32], dt=0.1))
    >>> state.estimate.round(3)
    array([-0.8,  0.5])

    Args:
        structure: whose parameters are tracked.
        forgetting: λ, 0 < λ ≤ 1; a sample k steps back has weight λᵏ.
        initial_covariance: P(0), a number for a multiple of the identity or (n,) for a diagonal; a large one gives the
            initial estimate no weight.
        initial_estimate: θ(0), zero by default.
    """

    structure: LinearStructure[M_co]
    forgetting: float = 1.0
    initial_covariance: float | tuple[float, ...] = 1e8
    initial_estimate: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not 0 < self.forgetting <= 1:
            raise ModelError(f"forgetting factor {self.forgetting}; it lies above 0 and is at most 1")
        shape, n = np.shape(self.initial_covariance), len(self.structure.parameter_names)
        if shape not in ((), (n,)):
            raise ModelError(f"initial covariance of shape {shape}; give a number or one for each of {n} parameters")
        if not np.all((self._prior > 0) & np.isfinite(self._prior)):
            raise ModelError(f"initial covariance {self.initial_covariance}; it must be positive and finite")

    @property
    def _prior(self) -> Array:
        return np.broadcast_to(
            np.asarray(self.initial_covariance, dtype=float), len(self.structure.parameter_names)
        ).copy()

    def start(self) -> RecursiveState:
        """The state before the first sample.

        Raises:
            ModelError: if the number of initial values is not the number of parameters.
        """
        n = len(self.structure.parameter_names)
        estimate = np.asarray(self.initial_estimate or np.zeros(n), dtype=float)
        if estimate.shape != (n,):
            raise ModelError(f"{len(estimate)} initial values for the {n} parameters of {self.structure.name}")
        return RecursiveState(estimate, np.eye(n), self._prior)

    def update(self, state: RecursiveState, record: Record, history: list[Array] | None = None) -> RecursiveState:
        """The state after the samples of ``record``, which follow the earlier samples.

        Args:
            state: from `start` or an earlier update.
            record: further samples, one or many; its later segments start without past samples.
            history: a list to which the estimates after every sample, (m, n), are appended.

        Raises:
            DataError: for other channels than before, or where the recursion overflows.
        """
        ceiling = WINDUP * self._prior
        for k, piece in enumerate(record.segments):
            if k:
                state = state.cut()
            if state.tail is not None:
                check_same_channels(state.tail, piece)
            joined = piece if state.tail is None else replace(concatenate([state.tail, piece]), breaks=(), times=())
            estimate, factor, diagonal = (np.array(values) for values in (state.estimate, state.factor, state.diagonal))
            totals = np.array([state.samples, state.residual_sum_of_squares])
            for _, start, stop in self.structure.chunks(joined, len(joined)):
                trace = np.empty((0 if history is None else stop - start, len(estimate)))
                if history is not None:
                    history.append(trace)
                for block in self.structure.blocks(joined, start, stop):
                    if history is None:
                        update_by_tiles(estimate, factor, diagonal, totals, block, self.forgetting, ceiling)
                    else:
                        now, trace = np.split(trace, [block.shape[1]])
                        update(estimate, factor, diagonal, totals, block, self.forgetting, ceiling, now)
            if not np.isfinite(estimate).all():
                raise DataError(f"{record.name}: the recursion overflowed; scale the channels or raise the forgetting")
            memory = self.structure.memory
            tail = joined[max(0, len(joined) - memory) :] if memory else None
            state = RecursiveState(estimate, factor, diagonal, float(totals[0]), float(totals[1]), tail)
        return state

    def fit(self, state: RecursiveState, like: Record, history: Array | None = None) -> Fit[M_co]:
        """The state as a fit, with a model for records like ``like``."""
        scaled = np.sqrt(state.diagonal)[:, None] * state.factor
        length = np.linalg.norm(scaled, axis=0)
        singular = np.linalg.svd(scaled / length, compute_uv=False)
        return Fit(
            model=self.structure.model(state.estimate, like),
            names=self.structure.parameter_names,
            estimate=state.estimate,
            covariance=state.noise_variance * state.normalised_covariance,
            noise_variance=state.noise_variance,
            samples=state.samples,
            condition=float(singular[0] / singular[-1]),
            rank=len(state.estimate),
            method="rls",
            history=history,
        )


def recursive_least_squares(
    structure: LinearStructure[M_co],
    records: Record | Iterable[Record],
    *,
    forgetting: float = 1.0,
    initial_covariance: float | tuple[float, ...] = 1e8,
    initial_estimate: tuple[float, ...] = (),
    history: bool = False,
) -> Fit[M_co]:
    """Recursive least squares over one or several records, from the first sample to the last.

    Args:
        structure: what to fit.
        records: a record, or several experiments in the order of their use.
        forgetting, initial_covariance, initial_estimate: see `RecursiveLeastSquares`.
        history: keep the estimate after every sample in the fit's ``history``; memory grows with the record.

    Raises:
        ModelError, DataError: for records that the structure cannot be fitted to.
    """
    recursion = RecursiveLeastSquares(structure, forgetting, initial_covariance, initial_estimate)
    state, first = recursion.start(), None
    trace: list[Array] | None = [] if history else None
    for record in (records,) if isinstance(records, Record) else records:
        structure.check(record)
        check_excitation(record)
        first = first or record
        check_same_channels(first, record)
        state = recursion.update(state.cut(), record, trace)
    if first is None:
        raise DataError("no record to identify from")
    kept = None if not trace else trace[0] if len(trace) == 1 else np.concatenate(trace)
    return recursion.fit(state, first, kept)


def paper_recursion(regression: ArrayLike, target: ArrayLike, forgetting: float, covariance: Array) -> Array:
    """The recursion exactly as in the paper: a slow and simple reference for `update`.

    Args:
        regression: Φ (N, n).
        target: y (N,).
        forgetting: λ.
        covariance: P(0), (n, n).

    Returns:
        (N, n) the estimate after every sample, from θ(0) = 0.
    """
    lam, p = forgetting, np.array(covariance, dtype=float)
    theta = np.zeros(len(p))
    identity = np.eye(len(p))
    history = []
    for phi, y in zip(np.asarray(regression), np.asarray(target), strict=True):
        error = y - phi @ theta
        p = (1 / lam) * p @ (identity - np.outer(phi, phi) @ p / (lam + phi @ p @ phi))
        theta = theta + p @ phi * error
        history.append(theta)
    return np.array(history)


# NumPy's error model: a division that may raise would prevent vectorisation of the inner loops.
@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def update(
    estimate: Array,
    factor: Array,
    diagonal: Array,
    totals: Array,
    block: Array,
    forgetting: float,
    ceiling: Array,
    trace: Array,
) -> None:
    """Bierman's update of θ, Uᵀ and D, in place, by every row of a block of columns [Φ y].

    Args:
        estimate, factor, diagonal: θ (n,), Uᵀ (n, n), D (n,).
        totals: (2,) effective samples and residual sum of squares.
        block: (n + 1, m).
        forgetting: λ.
        ceiling: (n,) the limit of D.
        trace: (m, n) to be filled with the estimates, or (0, n).
    """
    n, rows = len(estimate), block.shape[1]
    phi, gain = np.empty(n), np.empty(n)
    for t in range(rows):
        error = block[n, t]
        for i in range(n):
            phi[i] = block[i, t]
            error -= phi[i] * estimate[i]
        alpha = forgetting
        for j in range(n):
            row = factor[j]
            f = phi[j]
            for i in range(j):
                f += row[i] * phi[i]
            g = diagonal[j] * f
            before = alpha
            alpha += f * g
            diagonal[j] = min(diagonal[j] * before / (alpha * forgetting), ceiling[j])
            # Column j of U moves along the gain of the columns before it, and adds to that gain.
            step = -f / before
            for i in range(j):
                u = row[i]
                row[i] = u + step * gain[i]
                gain[i] += g * u
            gain[j] = g
        weight = error / alpha
        for i in range(n):
            estimate[i] += weight * gain[i]
        totals[0] = forgetting * totals[0] + 1.0
        totals[1] = forgetting * (totals[1] + error * weight)
        if len(trace):
            for i in range(n):
                trace[t, i] = estimate[i]


@numba.njit(cache=True, nogil=True)
def update_by_tiles(
    estimate: Array, factor: Array, diagonal: Array, totals: Array, block: Array, forgetting: float, ceiling: Array
) -> None:
    """Like `update` without a trace, up to rounding; by tiles where that is faster and D stays below its ceiling.

    A sample raises D by a factor of at most 1/λ, so it is known before a tile whether D can reach the ceiling.
    """
    n, rows = len(estimate), block.shape[1]
    top, tile = workspace(np.empty((n + 1, n + 1)))
    weight = np.sqrt(forgetting) ** np.arange(TILE - 1, -1, -1)
    none = np.empty((0, n))
    for first in range(0, rows, TILE):
        height = min(TILE, rows - first)
        for j in range(n + 1):
            for i in range(height):
                tile[j, i] = block[j, first + i]
        if height > n and np.all(diagonal <= ceiling * forgetting**height):
            _add_tile(estimate, factor, diagonal, totals, tile, height, weight[TILE - height :], forgetting, top)
        else:
            update(estimate, factor, diagonal, totals, tile[: n + 1, :height].copy(), forgetting, ceiling, none)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_tile(
    estimate: Array,
    factor: Array,
    diagonal: Array,
    totals: Array,
    tile: Array,
    height: int,
    weight: Array,
    forgetting: float,
    top: Array,
) -> None:
    """The state after the first ``height`` rows of a tile of [Φ y], by reflections of ``[R 0; 0 ρ]``.

    The unknown is the change of θ, so y is replaced by its prediction error, and Rθ by zero. ρ² is the sum of squares
    so far, and ``weight`` the square root of the weight of each row at the end of the tile.
    """
    n = len(estimate)
    remembered = np.sqrt(forgetting) * weight[0]
    inverse = _inverse(factor)
    for i in range(n):
        scale = remembered / np.sqrt(diagonal[i])
        for j in range(i, n):
            top[i, j] = scale * inverse[j, i]
        top[i, n] = 0.0
        add_multiple(tile[n], -estimate[i], tile[i], height)
    top[n, n] = remembered * np.sqrt(totals[1])
    for j in range(n + 1):
        row = tile[j]
        for i in range(height):
            row[i] *= weight[i]
    for _ in range(height):
        totals[0] = forgetting * totals[0] + 1.0
    reflect(top, tile, height)

    change = top[:n, n].copy()
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            change[i] -= top[i, j] * change[j]
        change[i] /= top[i, i]
        diagonal[i] = 1.0 / top[i, i] ** 2
        for j in range(i, n):
            inverse[j, i] = top[i, j] / top[i, i]
        estimate[i] += change[i]
    copy_square(_inverse(inverse), factor, n)
    totals[1] = top[n, n] ** 2


@numba.njit(cache=True, nogil=True)
def _inverse(lower: Array) -> Array:
    """The inverse of a unit lower triangular matrix."""
    n = len(lower)
    inverse = np.eye(n)
    for i in range(n):
        for k in range(i):
            for j in range(k + 1):
                inverse[i, j] -= lower[i, k] * inverse[k, j]
    return inverse
