r"""The covariance of an estimate whose residual is not white.

At the minimum of a least-squares cost the estimate moves with the noise as ``δ = −(JᵀJ)⁻¹Jᵀr``, where J
(N, p) is the derivative of the residual r (N,). Its covariance is (Huber 1967; White 1980)

    cov θ̂ = (JᵀJ)⁻¹ Ω (JᵀJ)⁻¹,      Ω = var Σₜ sₜ,      sₜ = Jₜ rₜ  the score of sample t.

For white noise Ω = σ²JᵀJ, and the covariance simplifies to σ²(JᵀJ)⁻¹. For model error or coloured noise this simple
form can be wrong by any factor. Ω is the long-run variance of the scores (Hjalmarsson
& Ljung 1992, who derive this for undermodelled systems), estimated with Bartlett's weights (Newey & West 1987)

    Ω = Σₖ (1 − |k|/L) Σₜ sₜ sₜ₊ₖᵀ,      |k| < L.

That double sum is never formed: with the scores padded by zeros it is identically ``(1/L) Σₜ bₜbₜᵀ`` with the
overlapping batch sums ``bₜ = sₜ + … + sₜ₊ₗ₋₁``, which a running sum gives at a cost that does not depend on L.

The window L follows Andrews (1991): ``L = 1.1447 (αN)^⅓`` where α = 4ρ²/((1 − ρ)²(1 + ρ)²) comes from an AR(1) model
with pole ρ of each score, averaged over the scores with their variances squared. Scores are first transformed to
coordinates in which J has orthonormal columns, so that L does not depend on units or on linear combinations of the
parameters. A window of one keeps the variances only; this is White's form, for white residuals.

Bartlett's weights alone underestimate a long correlation. The scores are therefore first whitened by a vector
autoregression of order one, ``sₜ = A sₜ₋₁ + wₜ``, Ω is estimated for w, and coloured again, ``(I − A)⁻¹ Ω_w (I − A)⁻ᵀ``
(Andrews & Monahan 1992), with the singular values of A limited to 0.97.

References:
    Hjalmarsson, Ljung, *Estimating model variance in the case of undermodeling*, IEEE TAC 37 (1992).
    Newey, West, *A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent
    covariance matrix*, Econometrica 55 (1987). Andrews, *Heteroskedasticity and autocorrelation consistent
    covariance matrix estimation*, Econometrica 59 (1991).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# The largest pole of a score; a longer correlation looks like a trend.
LARGEST_POLE = 0.97
# With fewer samples for every score an autoregression would be fitted to noise.
SAMPLES_PER_DIRECTION = 20


def long_run_variance(scores: Sequence[Array], check: Callable[[], None] = lambda: None) -> Array:
    """Ω, the variance of the sum of all scores: whitened, weighted and coloured again.

    Args:
        scores: (Nᵢ, p) of every experiment, in coordinates where J has orthonormal columns; experiments are
            independent of each other.
        check: called between steps; what it raises ends the computation.
    """
    size = scores[0].shape[1]
    memory = _autoregression(scores)
    check()
    white = [np.concatenate([block[:1], block[1:] - block[:-1] @ memory.T]) for block in scores]
    colour = np.linalg.inv(np.eye(size) - memory)
    check()
    coloured: Array = colour @ weighted_variance(white, automatic_window(white)) @ colour.T
    return coloured


def weighted_variance(scores: Sequence[Array], window: int) -> Array:
    """Newey and West's estimate with Bartlett's weights.

    Args:
        scores: (Nᵢ, p) of every experiment.
        window: L in samples.
    """
    total = np.zeros((scores[0].shape[1],) * 2)
    for block in scores:
        batches = _batch_sums(block, min(window, max(len(block), 1)))
        total += batches.T @ batches
    return total


def _autoregression(scores: Sequence[Array]) -> Array:
    """(p, p) A of the vector autoregression; zero if there are too few samples."""
    size = scores[0].shape[1]
    if sum(max(len(block) - 1, 0) for block in scores) < SAMPLES_PER_DIRECTION * size:
        return np.zeros((size, size))
    # Scores have orthonormal directions, so that the products of many rows are exact enough.
    square, lagged = (sum(block[:-1].T @ block[first : len(block) - 1 + first] for block in scores) for first in (0, 1))
    left, singular, right = np.linalg.svd(np.linalg.lstsq(square, lagged, rcond=None)[0].T)
    stable: Array = (left * np.minimum(singular, LARGEST_POLE)) @ right
    return stable


def automatic_window(scores: Sequence[Array]) -> int:
    """Andrews' window L for Bartlett's weights, in samples.

    Args:
        scores: (Nᵢ, p) of every experiment, in coordinates where J has orthonormal columns.
    """
    now = np.sum([np.einsum("ij,ij->j", s, s) for s in scores], axis=0)
    next_ = np.sum([np.einsum("ij,ij->j", s[1:], s[:-1]) for s in scores], axis=0)
    pole = np.clip(np.divide(next_, now, out=np.zeros_like(now), where=now > 0), -LARGEST_POLE, LARGEST_POLE)
    innovation = now * (1 - pole**2)
    weight = np.sum(innovation**2 / (1 - pole) ** 4)
    if not weight > 0:
        return 1
    slope = np.sum(4 * pole**2 * innovation**2 / ((1 - pole) ** 6 * (1 + pole) ** 2)) / weight
    samples = sum(len(s) for s in scores)
    return max(1, int(np.ceil(1.1447 * (slope * samples) ** (1 / 3))))


def _batch_sums(scores: Array, window: int) -> Array:
    """Sums over every ``window`` samples that touch the data, over √window; (N + window − 1, p)."""
    padded = np.concatenate([np.zeros((window, scores.shape[1])), np.cumsum(scores, axis=0)])
    tail = np.broadcast_to(padded[-1], (window - 1, scores.shape[1]))
    running = np.concatenate([padded, tail])
    sums: Array = (running[window:] - running[:-window]) / np.sqrt(window)
    return sums
