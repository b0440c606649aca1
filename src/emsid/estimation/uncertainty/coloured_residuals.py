r"""The covariance of an estimate under stationary coloured noise, whose colour is estimated from the residual.

At a least-squares minimum ``cov θ̂ = (JᵀJ)⁻¹ JᵀΓJ (JᵀJ)⁻¹`` with Γ the covariance of the noise.
`robust_covariance` estimates JᵀΓJ from the products of residual and derivative. This assumes nothing, but needs many
samples in which the derivative is not zero; the edge of a dead zone, for example, affects only the few samples around
standstill. If the noise is stationary, its colour can be estimated from all samples. An autoregression A(q)e = w of
the residual, var w = σ², has Γ = σ²HHᵀ with H = 1/A(q), so that

    JᵀΓJ = σ²‖HᵀJ‖²,      HᵀJ: the columns of J through 1/A(q), backwards in time.

The autoregression solves the Yule–Walker equations (it is stable by construction); Schwarz's criterion gives its order.

References:
    Söderström, Stoica, *System Identification*, sec. 7.5 (the covariance of output-error estimates in coloured noise)
    and 3.3 (Yule–Walker). Schwarz, *Estimating the dimension of a model*, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_POLES = 20


def autoregression(pieces: Sequence[Array], most: int = MOST_POLES) -> tuple[Array, float]:
    """A(q) = 1 + a₁q⁻¹ + … and the variance of its innovations, from pieces (Nᵢ,) of one stationary signal."""
    samples = sum(len(piece) for piece in pieces)
    most = min(most, *(len(piece) - 1 for piece in pieces), samples // 20)
    lags = np.array([sum(float(p[k:] @ p[: len(p) - k]) for p in pieces) for k in range(max(most, 0) + 1)]) / samples
    polynomial, variance = np.ones(1), float(lags[0])
    if not variance > 0:
        return polynomial, 0.0
    best = (samples * np.log(variance), polynomial, variance)
    for order in range(1, most + 1):  # Levinson and Durbin
        reflection = -float(polynomial @ lags[order:0:-1]) / variance
        longer = np.append(polynomial, 0.0)
        polynomial = longer + reflection * longer[::-1]
        variance *= 1 - reflection**2
        if not variance > 0:
            break
        criterion = samples * np.log(variance) + order * np.log(samples)
        if criterion < best[0]:
            best = (criterion, polynomial, variance)
    return best[1], best[2]


def coloured_covariance(pieces: Sequence[tuple[Array, Array]]) -> Array:
    """(p, p) covariance of the estimate.

    Args:
        pieces: residual (Nᵢ,) and derivative (Nᵢ, p) of every segment and channel; the derivatives together have full
            rank.
    """
    from scipy.signal import lfilter

    polynomial, variance = autoregression([residual for residual, _ in pieces])
    triangle = np.linalg.qr(np.concatenate([jacobian for _, jacobian in pieces]), mode="r")
    inverse = np.linalg.inv(triangle)
    spread = np.zeros_like(triangle)
    for _, jacobian in pieces:
        backwards = lfilter([1.0], polynomial, (jacobian @ inverse)[::-1], axis=0)
        spread += variance * backwards.T @ backwards
    samples = sum(len(residual) for residual, _ in pieces)
    freedom = samples / max(samples - len(triangle), 1)
    covariance: Array = freedom * inverse @ spread @ inverse.T
    return covariance


def effective_samples(pieces: Sequence[Array]) -> float:
    """How many independent samples stretches (Nᵢ,) of a residual are worth to its mean: N·var e/(σ²/A(1)²).

    Never more than there are, and at least `FEWEST`.
    """
    samples = sum(len(piece) for piece in pieces)
    centre = sum(float(np.sum(piece)) for piece in pieces) / samples
    centred = [piece - centre for piece in pieces]
    polynomial, driving = autoregression(centred)
    variance = sum(float(piece @ piece) for piece in centred) / samples
    if not (variance > 0 and driving > 0):
        return float(samples)
    return float(np.clip(samples * variance * polynomial.sum() ** 2 / driving, min(FEWEST, samples), samples))


FEWEST = 10.0
"""However much a residual hangs together, it is taken for this many independent samples."""
