r"""The covariance of an estimate under stationary coloured noise, whose colour is estimated from the residual.

At a least-squares minimum ``cov θ̂ = (JᵀJ)⁻¹ JᵀΓJ (JᵀJ)⁻¹`` with Γ the covariance of the noise.
`robust_covariance` estimates JᵀΓJ from the products of residual and derivative. This assumes nothing, but needs many
samples in which the derivative is not zero; the edge of a dead zone, for example, affects only the few samples around
standstill. If the noise is stationary, its colour can be estimated from all samples. A residual

    A(q)e = (1 − c·q⁻¹)w,      var w = σ²,

has Γ = σ²HHᵀ with H = (1 − c·q⁻¹)/A(q), so that

    JᵀΓJ = σ²‖HᵀJ‖²,      HᵀJ: the columns of J through H, backwards in time.

The autoregression solves the Yule–Walker equations (it is stable by construction). The zero c is for differences: a
speed from the counts of an encoder has noise with c = 1, and no short autoregression has so little power at low
frequencies. It is the one of `ZEROS` whose residual through 1/(1 − c·q⁻¹) has the most likely autoregression; the
effect c^t of what was before the first sample is projected out. An estimate of a zero near one has an error of order
1/N, so a grid is enough. Schwarz's criterion gives the order and decides whether there is a zero.

References:
    Söderström, Stoica, *System Identification*, sec. 7.5 (the covariance of output-error estimates in coloured noise)
    and 3.3 (Yule–Walker). Schwarz, *Estimating the dimension of a model*, Annals of Statistics 6 (1978). Shephard,
    Harvey, *On the probability of estimating a deterministic component in the local level model*, Journal of Time
    Series Analysis 11 (1990) (zeros near one).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.robust_covariance import long_run_variance

Array = NDArray[np.float64]

MOST_POLES = 20
ZEROS = (0.5, 0.8, 0.9, 0.95, 0.98, 1.0)
"""The zeros of a residual that are tried."""


class Colour(NamedTuple):
    """A(q)e = (1 − zero·q⁻¹)w.

    Attributes:
        zero: of a moving average of order one; 0 without.
        polynomial: (n + 1,) A(q) = 1 + a₁q⁻¹ + …
        variance: of w.
    """

    zero: float
    polynomial: Array
    variance: float

    def backwards(self, jacobian: Array) -> Array:
        """(N, p), with a zero (N + 1, p): HᵀJ of derivatives (N, p), the last sample first."""
        from scipy.signal import lfilter

        if self.zero:  # w before the first sample is in the first residual
            jacobian = np.concatenate([np.zeros((1, jacobian.shape[1])), jacobian])
        through: Array = lfilter([1.0, -self.zero], self.polynomial, jacobian[::-1], axis=0)
        return through

    def whitened(self, signals: Array) -> Array:
        """(N, …) w of a residual (N,), or H⁻¹J of derivatives (N, p)."""
        from scipy.signal import lfilter

        white: Array = lfilter(self.polynomial, [1.0], _without_zero(signals, self.zero), axis=0)
        return white


def colour(pieces: Sequence[tuple[Array, Array]]) -> Colour:
    """The colour of the noise in one stationary residual.

    Args:
        pieces: as in `coloured_covariance`. A fit takes out of the residual what its derivatives describe, mostly low
            frequencies, so that any residual seems to have a zero. The restricted likelihood allows for that.
    """
    best, least = None, np.inf
    for zero in (0.0, *ZEROS):
        candidate = Colour(zero, *autoregression([_without_zero(residual, zero) for residual, _ in pieces]))
        if candidate.variance > 0 or zero == 0:
            criterion = _criterion(candidate, [jacobian for _, jacobian in pieces])
            if best is None or criterion < least:
                best, least = candidate, criterion
    assert best is not None
    return best


def _criterion(colour: Colour, jacobians: Sequence[Array]) -> float:
    """Schwarz's criterion by the restricted likelihood, without terms that all colours share.

    ``−2·log L = (N − p)·log σ² + log|H⁻¹H⁻ᵀ|⁻¹ + log|(H⁻¹J)ᵀH⁻¹J|``; the second term is that of what was before the
    first sample.
    """
    if not colour.variance > 0:
        return -np.inf
    samples = sum(len(jacobian) for jacobian in jacobians)
    whitened = [colour.whitened(jacobian) for jacobian in jacobians]
    size = np.abs(np.diag(np.linalg.qr(np.concatenate(whitened), mode="r")))
    restricted = 2 * float(np.sum(np.log(size, out=np.full(len(size), -np.inf), where=size > 0)))
    edges = sum(np.log1p(np.sum(colour.zero ** (2.0 * np.arange(1, len(j) + 1)))) for j in jacobians)
    parameters = len(colour.polynomial) - 1 + (colour.zero > 0)
    freedom = samples - len(size)
    return float(freedom * np.log(colour.variance) + restricted + edges + parameters * np.log(samples))


def _without_zero(signals: Array, zero: float) -> Array:
    """(N, …) signals through 1/(1 − c·q⁻¹), without the effect of what was before them."""
    from scipy.signal import lfilter

    if zero == 0:
        return signals
    through: Array = lfilter([1.0], [1.0, -zero], signals, axis=0)
    before = zero ** np.arange(len(signals))
    found: Array = through - np.multiply.outer(before, before @ through) / (before @ before)
    return found


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


def coloured_covariance(pieces: Sequence[tuple[Array, Array]], penalty: Array | None = None) -> Array:
    """(p, p) covariance of the estimate.

    Args:
        pieces: residual (Nᵢ,) and derivative (Nᵢ, p) of every segment and channel; the derivatives together, with the
            rows of the penalty, have full rank.
        penalty: (k, p) the rows of a penalty on roughness, with its weight.
    """
    noise = colour(pieces)
    rows = [jacobian for _, jacobian in pieces] + ([] if penalty is None else [penalty])
    triangle = np.linalg.qr(np.concatenate(rows), mode="r")
    inverse = np.linalg.inv(triangle)
    spread = np.zeros_like(triangle)
    for _, jacobian in pieces:
        backwards = noise.backwards(jacobian @ inverse)
        spread += noise.variance * backwards.T @ backwards
    samples = sum(len(residual) for residual, _ in pieces)
    freedom = samples / max(samples - len(triangle), 1)
    covariance: Array = freedom * inverse @ spread @ inverse.T
    return covariance


def whitened_sandwich(pieces: Sequence[tuple[Array, Array]]) -> Array | None:
    """(p, p) covariance of the estimate by `long_run_variance`, from scores without the zero of the residual.

    ``Σₜ Jₜeₜ = Σₜ (HᵀJ)ₜwₜ`` is one number in two sums; the terms of the second are hardly correlated, so that
    Bartlett's weights do not overestimate its variance.

    Args:
        pieces: as in `coloured_covariance`.

    Returns:
        None where the residual has no zero.
    """
    noise = colour(pieces)
    if noise.zero == 0:
        return None
    inverse = np.linalg.inv(np.linalg.qr(np.concatenate([jacobian for _, jacobian in pieces]), mode="r"))
    scores, before = [], []
    for residual, jacobian in pieces:
        backwards = noise.backwards(jacobian @ inverse)
        scores.append(backwards[-2::-1] * noise.whitened(residual)[:, None])
        before.append(backwards[-1])  # of w before the first sample, which no residual shows
    edges = noise.variance * np.array(before).T @ np.array(before)
    samples = sum(len(residual) for residual, _ in pieces)
    freedom = samples / max(samples - len(inverse), 1)
    covariance: Array = freedom * inverse @ (long_run_variance(scores) + edges) @ inverse.T
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
