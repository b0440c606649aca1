"""The loops of recursive least squares, compiled: sample by sample for any rule of adaptation, and in tiles.

The equations are in `emsid.estimation.linear.recursive`. Divisions follow NumPy's error model: one that may raise would
prevent vectorisation of the inner loops.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.estimation.linear.adaptation import Code, correct, diffuse, excitation
from emsid.estimation.linear.information import TILE, add_multiple, copy_square, reflect, workspace

Array = NDArray[np.float64]

WINDUP = 1e16
"""The largest D_j·φ_j²: directions that are excited 1e8 times less than the regressor's peak are not forgotten."""
GROWTH = 1e4
"""The largest ratio of D to its initial value, where that allows more."""
HIGHEST = 1e150
"""The largest D, so that its products do not overflow."""

SAMPLES, SQUARES, WEIGHTS, IDLE, PLACE, FILLED, LIMITED, PEAKS = range(8)
"""Where the totals of the recursion are in their array; the largest values of the regressors follow."""


@njit(nogil=True, fastmath={"contract"}, error_model="numpy")
def update(
    estimate: Array,
    factor: Array,
    diagonal: Array,
    totals: Array,
    window: Array,
    block: Array,
    rule: Array,
    limits: Array,
    trace: Array,
    residuals: Array,
) -> None:
    """Update θ, Uᵀ and D, in place, by every row of a block of columns [Φ y]: the loop of every rule.

    Args:
        estimate, factor, diagonal: θ (n,), Uᵀ (n, n), D (n,).
        totals: (7 + n,) of `RecursiveState.totals`.
        window: (m, n + 1) past rows, for a sliding window.
        block: (n + 1, m).
        rule: of `Rule.numbers`.
        limits: (2, n) of `RecursiveLeastSquares.limits`; the second row follows the peaks of the regressors.
        trace: (m, n) to be filled with the estimates, or (0, n).
        residuals: (m, 3) to be filled, see `RecursiveLeastSquares.update`, or (0, 3).
    """
    n, code, ceiling = len(estimate), int(rule[0]), limits[1]
    phi, gain = np.empty(n), np.empty(n)
    for t in range(block.shape[1]):
        error = block[n, t]
        for i in range(n):
            phi[i] = block[i, t]
            error -= phi[i] * estimate[i]
            if abs(phi[i]) > totals[PEAKS + i]:
                totals[PEAKS + i] = abs(phi[i])
                ceiling[i] = max(limits[0, i], min(WINDUP / phi[i] ** 2, HIGHEST))
        alpha, zeta, used = 1.0, 0.0, True
        if code == Code.FORGETTING:
            alpha = correct(factor, diagonal, phi, gain, rule[1], rule[1], ceiling)
            zeta = alpha - rule[1]
        elif code == Code.DIRECTIONAL:
            zeta = excitation(factor, diagonal, phi)
            used = zeta > rule[2]
            if used:
                kept = rule[1] - (1.0 - rule[1]) / zeta
                correct(factor, diagonal, phi, gain, 1.0 / kept if kept != 0.0 else 1e300, 1.0, ceiling)
                alpha = 1.0 + zeta
        elif code == Code.DRIFT:
            diffuse(factor, diagonal, rule[5:], gain)
            alpha = correct(factor, diagonal, phi, gain, 1.0, 1.0, ceiling)
            zeta = alpha - 1.0
        elif code == Code.WINDOW:
            zeta = excitation(factor, diagonal, phi)
            slide(estimate, factor, diagonal, totals, window, phi, block[n, t], gain, limits)
        elif code == Code.GRADIENT:
            alpha = _gradient(phi, rule, gain)
        else:
            zeta, used = excitation(factor, diagonal, phi), False
        if used and code != Code.WINDOW:
            weight = error / alpha
            for i in range(n):
                estimate[i] += weight * gain[i]
            totals[SAMPLES] = rule[3] * totals[SAMPLES] + 1.0
            totals[SQUARES] = rule[3] * (totals[SQUARES] + error * (error if code == Code.GRADIENT else weight))
            totals[WEIGHTS] = rule[4] * totals[WEIGHTS] + 1.0
        totals[IDLE] = 0.0 if used else totals[IDLE] + 1.0
        totals[LIMITED] += _is_limited(diagonal, ceiling)
        if len(residuals):
            after = block[n, t]
            for i in range(n):
                after -= phi[i] * estimate[i]
            residuals[t, 0], residuals[t, 1], residuals[t, 2] = error, after, zeta
        if len(trace):
            trace[t] = estimate


@njit(nogil=True, error_model="numpy", inline="always")
def _gradient(phi: Array, rule: Array, gain: Array) -> float:
    """Fill the gain (n,) of the normalised gradient rule; the divisor of the error."""
    alpha = float(rule[2])
    for i in range(len(phi)):
        alpha += phi[i] * phi[i]
        gain[i] = rule[1] * phi[i]
    return alpha


@njit(nogil=True, error_model="numpy", inline="always")
def _is_limited(diagonal: Array, ceiling: Array) -> bool:
    """Whether any of D is at its limit."""
    limited = False
    for i in range(len(diagonal)):
        limited |= diagonal[i] >= ceiling[i]
    return limited


@njit(nogil=True, error_model="numpy")
def slide(
    estimate: Array,
    factor: Array,
    diagonal: Array,
    totals: Array,
    window: Array,
    phi: Array,
    output: float,
    gain: Array,
    limits: Array,
) -> None:
    """Add a row to a sliding window and subtract the one that leaves it; compute anew after every full window."""
    n, place, ceiling = len(estimate), int(totals[PLACE]), limits[1]
    if totals[FILLED] == len(window):
        add_row(estimate, factor, diagonal, totals, window[place, :n].copy(), window[place, n], -1.0, gain, ceiling)
    else:
        totals[FILLED] += 1.0
    for i in range(n):
        window[place, i] = phi[i]
    window[place, n] = output
    place = (place + 1) % len(window)
    totals[PLACE] = place
    if place:
        add_row(estimate, factor, diagonal, totals, phi, output, 1.0, gain, ceiling)
        return
    totals[:3] = 0.0
    for j in range(n):
        diagonal[j] = limits[0, j] / GROWTH
        for i in range(n):
            factor[j, i] = 1.0 if i == j else 0.0
    for k in range(len(window)):
        add_row(estimate, factor, diagonal, totals, window[k, :n].copy(), window[k, n], 1.0, gain, ceiling)


@njit(nogil=True, error_model="numpy")
def add_row(
    estimate: Array,
    factor: Array,
    diagonal: Array,
    totals: Array,
    phi: Array,
    output: float,
    sign: float,
    gain: Array,
    ceiling: Array,
) -> None:
    """Add a row of weight 1 (sign 1), or subtract it again (sign −1)."""
    error = output
    for i in range(len(phi)):
        error -= phi[i] * estimate[i]
    alpha = correct(factor, diagonal, phi, gain, sign, 1.0, ceiling)
    weight = error / alpha
    for i in range(len(phi)):
        estimate[i] += weight * gain[i]
    totals[SAMPLES] += sign
    totals[SQUARES] = max(totals[SQUARES] + error * weight, 0.0)
    totals[WEIGHTS] += sign


@njit(nogil=True)
def update_by_tiles(
    estimate: Array, factor: Array, diagonal: Array, totals: Array, block: Array, forgetting: float, limits: Array
) -> None:
    """Like `update` without a trace, up to rounding; by tiles where that is faster and D stays below its limit.

    A sample raises D by a factor of at most 1/λ, so it is known before a tile whether D can reach the limit.
    """
    n, rows = len(estimate), block.shape[1]
    top, tile = workspace(np.empty((n + 1, n + 1)))
    weight = np.sqrt(forgetting) ** np.arange(TILE - 1, -1, -1)
    rule = np.array([0.0, forgetting, 0.0, forgetting, forgetting**2])  # of `Forgetting`
    none, unwatched, peak = np.empty((0, n)), np.empty((0, 3)), np.empty(n)
    for first in range(0, rows, TILE):
        height = min(TILE, rows - first)
        for j in range(n + 1):
            for i in range(height):
                tile[j, i] = block[j, first + i]
        below = height > n
        for j in range(n):
            peak[j] = max(totals[PEAKS + j], np.max(np.abs(tile[j, :height])))
            limit = max(limits[0, j], min(WINDUP / peak[j] ** 2, HIGHEST)) if peak[j] > 0 else limits[0, j]
            below = below and diagonal[j] < limit * forgetting**height
        if below:
            for j in range(n):
                if peak[j] > totals[PEAKS + j]:
                    totals[PEAKS + j] = peak[j]
                    limits[1, j] = max(limits[0, j], min(WINDUP / peak[j] ** 2, HIGHEST))
            _add_tile(estimate, factor, diagonal, totals, tile, height, weight[TILE - height :], forgetting, top)
        else:
            block_now = tile[: n + 1, :height].copy()
            update(estimate, factor, diagonal, totals, none, block_now, rule, limits, none, unwatched)


@njit(nogil=True, error_model="numpy")
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
    top[n, n] = remembered * np.sqrt(totals[SQUARES])
    for j in range(n + 1):
        row = tile[j]
        for i in range(height):
            row[i] *= weight[i]
    for _ in range(height):
        totals[SAMPLES] = forgetting * totals[SAMPLES] + 1.0
        totals[WEIGHTS] = forgetting**2 * totals[WEIGHTS] + 1.0
    totals[IDLE] = 0.0
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
    totals[SQUARES] = top[n, n] ** 2


@njit(nogil=True)
def _inverse(lower: Array) -> Array:
    """The inverse of a unit lower triangular matrix."""
    n = len(lower)
    inverse = np.eye(n)
    for i in range(n):
        for k in range(i):
            for j in range(k + 1):
                inverse[i, j] -= lower[i, k] * inverse[k, j]
    return inverse
