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

from emsid.estimation.linear.filtering import filtered
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
        if self.zero:  # w before the first sample is in the first residual
            jacobian = np.concatenate([np.zeros((1, jacobian.shape[1])), jacobian])
        through: Array = filtered([1.0, -self.zero], self.polynomial, jacobian[::-1].T).T
        return through

    def whitened(self, residual: Array) -> Array:
        """(N,) w of a residual (N,)."""
        white: Array = filtered(self.polynomial, 1.0, _without_zero(residual, self.zero))
        return white

    def begun_at_rest(self, signals: Array) -> Array:
        """(N, p) signals through H⁻¹, with nothing before the first sample."""
        through: Array = filtered(self.polynomial, [1.0, -self.zero], signals.T).T
        return through


def colour(pieces: Sequence[tuple[Array, Array]]) -> Colour:
    """The colour of the noise in one stationary residual.

    Args:
        pieces: as in `coloured_covariance`. A fit takes out of the residual what its derivatives describe, mostly low
            frequencies, so that any residual seems to have a zero. The restricted likelihood allows for that.
    """
    residuals = [residual for residual, _ in pieces]
    plain = Colour(0.0, *autoregression(residuals))
    if not plain.variance > 0:
        return plain
    zeros = [Colour(c, *autoregression([_without_zero(residual, c) for residual in residuals])) for c in ZEROS]
    return min((plain, *(each for each in zeros if each.variance > 0)), key=lambda each: _criterion(each, pieces))


def _criterion(colour: Colour, pieces: Sequence[tuple[Array, Array]]) -> float:
    """Schwarz's criterion by the restricted likelihood, without terms that all colours share.

    ``−2·log L = (N − p)·log min‖w − Zb‖² + log|ZᵀZ| + log|HHᵀ|`` with w and Z the residual and the derivatives through
    H⁻¹; the last term is that of what was before the first sample.
    """
    p = pieces[0][1].shape[1]
    gram, samples, edges = np.zeros((p + 1, p + 1)), 0, 0.0
    for residual, jacobian in pieces:
        white = colour.begun_at_rest(np.column_stack([jacobian, residual]))
        gram += white.T @ white
        if colour.zero:  # what was before the first sample, eliminated
            before = colour.zero ** np.arange(1.0, len(white) + 1)
            size, shared = 1.0 + float(before @ before), before @ white
            gram -= np.outer(shared, shared) / size
            edges += float(np.log(size))
        samples += len(white)
    parameters = len(colour.polynomial) - 1 + (colour.zero > 0)
    try:
        sizes = 2 * np.log(np.diag(np.linalg.cholesky(gram)))  # the last is that of the sum of squares that is left
    except np.linalg.LinAlgError:  # derivatives that are alike after the filter
        return np.inf if colour.zero else 0.0
    return float((samples - p) * sizes[-1] + sizes[:-1].sum() + edges + parameters * np.log(samples))


def _without_zero(residual: Array, zero: float) -> Array:
    """(N,) a residual through 1/(1 − c·q⁻¹), without the effect of what was before it."""
    if zero == 0:
        return residual
    through: Array = filtered(1.0, [1.0, -zero], residual)
    before = zero ** np.arange(len(residual))
    return through - before * (before @ through) / (before @ before)


def autoregression(pieces: Sequence[Array]) -> tuple[Array, float]:
    """A(q) = 1 + a₁q⁻¹ + … and the variance of its innovations, from pieces (Nᵢ,) of one stationary signal."""
    samples = sum(len(piece) for piece in pieces)
    most = min(MOST_POLES, *(len(piece) - 1 for piece in pieces), samples // 20)
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


def whitened_robust_covariance(pieces: Sequence[tuple[Array, Array]]) -> Array | None:
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
    """The independent samples whose mean varies as that of a residual in stretches (Nᵢ,): N·var e/(σ²/A(1)²).

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
"""A residual counts as at least this many independent samples, however correlated it is."""
