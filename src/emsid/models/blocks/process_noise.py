r"""Noise before the static map of a cascade: whether it is there, how large it is, and a fit that allows for it.

    x = G₁u,      y = G₂ f(x + w) + v

The output error of a fit then shows the mean map E f(x + w), which is smoother than f. Around it, with its slope
d(t) at x(t), the error is to first order

    e = G₂(d·w) + v,

and its variance follows the slope of the map, which the variance of noise v on the output alone does not.

**The test.** e is divided by G₂ as far as the noise allows (Wiener's filter, with the lowest power in the spectrum of
e for that of v), which gives z ≈ d·w. The covariance of \|z\| and d² is compared with its long-run standard error, so
that colour does not matter; \|z\| instead of z² keeps the standard error finite for noise with heavy tails. What the
squared output explains is removed from d² first, so noise in proportion to the output does not count.

**The size.** With w and v autoregressive, of order two and one, e is the output of a linear system that d makes vary
with time. A Kalman filter gives its likelihood, which is maximised over the two variances and the three coefficients.
The correlation of successive values of w is not negative: noise at high frequencies that G₂ stops is not seen.

**The fit.** The same filter makes the residual white. The fit minimises the squares of that white residual for the
model with the map E f(x + w): least squares weighted with the covariance of the noise. The parameters of f and of the
filters are then those of the system without the noise.

References:
    Hagenblad, Ljung, Wills, *Maximum likelihood identification of Wiener models*, Automatica 44 (2008) (the bias).
    Giordano, Sjöberg, *Maximum likelihood identification of Wiener-Hammerstein system with process noise*, IFAC
    SYSID (2018). Schoukens, Tiels, *Identification of block-oriented nonlinear systems starting from linear
    approximations: a survey*, Automatica 85 (2017). Anderson, Moore, *Optimal Filtering* (1979).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.estimation.uncertainty.robust_covariance import long_run_variance
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import StaticMap

Array = NDArray[np.float64]

# Samples that the size of the noise is estimated from, and the most segments that they are taken from.
NOISE_SAMPLES, NOISE_SEGMENTS = 8_000, 4
# Bands of the spectrum of the error whose lowest is that of the noise on the output.
BANDS = 32
# Frequencies at which the filter passes less than this part of its largest power are not divided by it.
WEAK = 1e-2
# The smallest standard deviation of a noise, relative to that of the error that it explains.
LEAST = 1e-4
# Of the coordinates of the correlations of noise; tanh is 1 to rounding from 19 on, where the noise has no variance.
FARTHEST = 15.0


@dataclass(frozen=True, eq=False)
class ErrorPiece:
    """The output error of a cascade over one segment, and what its variance may depend on.

    Attributes:
        error: (N,) e, the measured output minus the modelled one.
        slope: (NL,) d, the slope of the map at its input.
        output: (N,) the modelled output.
    """

    error: Array
    slope: Array
    output: Array


def map_index(cascade: Cascade) -> int | None:
    """The index of the map of a cascade that has one map with at most one filter on either side; otherwise None."""
    maps = [k for k, block in enumerate(cascade.blocks) if isinstance(block, StaticMap)]
    others = all(isinstance(block, Rational | StaticMap) for block in cascade.blocks)
    return maps[0] if others and len(maps) == 1 and len(cascade.blocks) - maps[0] <= 2 else None


def error_pieces(
    cascade: Cascade, segments: Sequence[tuple[Array, Array]], states: Sequence[Array], skipped: int = 0
) -> list[ErrorPiece]:
    """The error of a cascade over segments (u, y) from their initial states.

    Args:
        cascade: with one map, see `map_index`.
        segments: (u, y) of each.
        states: (s,) of each.
        skipped: samples at the start of every segment that are left out.
    """
    at = map_index(cascade)
    assert at is not None
    map_ = cascade.blocks[at]
    assert isinstance(map_, StaticMap)
    pieces = []
    for (u, y), state in zip(segments, states, strict=True):
        signals = cascade.signals(u, state)
        modelled = cascade.sampled(signals)
        slope = map_.slope(signals[at])[skipped * cascade.oversampling :]
        pieces.append(ErrorPiece((y - modelled)[skipped:], slope, modelled[skipped:]))
    return pieces


def after_map(cascade: Cascade) -> Rational:
    """The filter after the map, or one that passes everything."""
    last = cascade.blocks[-1]
    return last if isinstance(last, Rational) else Rational(np.ones(1))


def dependence(pieces: Sequence[ErrorPiece], behind: Rational, oversampling: int) -> float:
    """How many standard errors the size of the error rises with the slope of the map; normal if it does not.

    Args:
        pieces: of the fitted cascade.
        behind: the filter after the map.
        oversampling: steps of the filter per sample.
    """
    sizes, squares, levels = [], [], []
    whole = np.concatenate([piece.output for piece in pieces])
    powers = _band_powers([piece.error for piece in pieces])
    for piece in pieces:
        sizes.append(np.abs(_divided(piece.error, behind, oversampling, powers)))
        squares.append(piece.slope[::oversampling] ** 2)
        levels.append((piece.output - whole.mean()) ** 2)
    square, level, size = (np.concatenate(each) for each in (squares, levels, sizes))
    known = np.column_stack([np.ones_like(level), level])
    coefficients, _, rank, _ = np.linalg.lstsq(known, square, rcond=None)
    own = square - known @ coefficients
    if rank < 2 or not np.sum(own**2) > 1e-6 * np.sum((square - square.mean()) ** 2) > 0:
        return 0.0
    size = size - known @ np.linalg.lstsq(known, size, rcond=None)[0]
    scores = (own * size)[:, None]
    edges = np.cumsum([len(piece.error) for piece in pieces])[:-1]
    variance = float(long_run_variance(np.split(scores / np.std(scores), edges))[0, 0])
    return float(np.sum(scores) / np.std(scores) / np.sqrt(variance)) if variance > 0 else 0.0


def _band_powers(errors: Sequence[Array]) -> Array:
    """(`BANDS`,) the mean power of errors (Nᵢ,) in bands of equal width from zero to half the sampling frequency."""
    total, count = np.zeros(BANDS), np.zeros(BANDS)
    for e in errors:
        spectrum = np.abs(np.fft.rfft(e - e.mean()))[1:] ** 2 / len(e)
        band = np.arange(len(spectrum)) * BANDS // len(spectrum)
        total += np.bincount(band, spectrum, BANDS)
        count += np.bincount(band, minlength=BANDS)
    filled = count > 0
    mean: Array = np.interp(np.arange(BANDS), np.flatnonzero(filled), total[filled] / count[filled])
    return mean


def _divided(error: Array, behind: Rational, oversampling: int, powers: Array) -> Array:
    """(N,) the error (N,) divided by the filter, where its power in a band is above the lowest of all bands."""
    frequency = np.fft.rfftfreq(len(error))
    smooth = np.exp(np.interp(frequency * 2 * BANDS - 0.5, np.arange(BANDS), np.log(np.maximum(powers, 1e-300))))
    share = np.clip(1 - powers.min() / smooth, 0.0, 1.0)
    response = behind.response(frequency / oversampling, 1.0)
    gain = np.abs(response) ** 2
    inverse = share * np.conj(response) / np.maximum(gain + WEAK * np.max(gain) * (1 - share), 1e-300)
    return np.fft.irfft(np.fft.rfft(error) * inverse, len(error))


@dataclass(frozen=True, eq=False)
class ProcessNoise:
    """Noise w before the map and v on the output.

    Attributes:
        spread: standard deviation of w, in the unit of the input of the map.
        reflections: (2,) the partial correlations of w, of order one and two.
        output: standard deviation of v, in the unit of the output.
        pole: of v.
    """

    spread: float
    reflections: tuple[float, float]
    output: float
    pole: float

    def weighting(self, slope: Array, behind: Rational, oversampling: int) -> Weighting:
        """The filter that makes an error white over a segment whose map has these slopes (NL,)."""
        b, a = behind.transfer
        first, second = self.reflections
        w = np.array([first * (1 - second), second, self.spread**2])
        gains, spreads = (
            np.empty((-(-len(slope) // oversampling), len(b) + 2)),
            np.empty(-(-len(slope) // oversampling)),
        )
        start = float(self.spread**2 * np.max(slope**2) * np.sum(b**2) + self.output**2)
        kalman_gains(b, a, slope, oversampling, w, np.array([self.pole, self.output**2]), start, gains, spreads)
        return Weighting(b, a, slope, oversampling, w, self.pole, gains, spreads)


@dataclass(frozen=True, eq=False)
class Weighting:
    """A Kalman filter with known gains, which makes the error of a cascade over one segment white."""

    b: Array
    a: Array
    slope: Array
    oversampling: int
    w: Array
    pole: float
    gains: Array
    spreads: Array

    def whitened(self, rows: Array) -> Array:
        """(k, m) signals (k, m) over the first m samples of the segment, as white as the error becomes."""
        assert rows.shape[1] <= len(self.spreads)
        out = np.empty(rows.shape)
        kalman_rows(
            self.b, self.a, self.slope, self.oversampling, self.w, self.pole, self.gains, self.spreads, rows, out
        )
        return out


def estimated_noise(pieces: Sequence[ErrorPiece], behind: Rational, oversampling: int) -> ProcessNoise:
    """The most likely noise before the map, on a part of the error.

    Args:
        pieces: of the fitted cascade.
        behind: the filter after the map.
        oversampling: steps of the filter per sample.
    """
    from scipy.optimize import minimize

    longest = sorted(pieces, key=lambda piece: -len(piece.error))[:NOISE_SEGMENTS]
    share = NOISE_SAMPLES // len(longest)
    parts = [(piece.error[:share], piece.slope[: share * oversampling]) for piece in longest]
    size = float(np.sqrt(np.mean(np.concatenate([error for error, _ in parts]) ** 2)))
    steepest = max(float(np.sqrt(np.mean(slope**2))) for _, slope in parts)
    powers = _band_powers([error for error, _ in parts])
    through = float(np.sqrt(np.mean(np.abs(behind.response(np.linspace(0, 0.5, 257), 1.0)) ** 2)))
    scale = size / max(steepest * through, 1e-300)

    def noise(theta: Array) -> ProcessNoise:
        inside = np.clip(theta[2:], -FARTHEST, FARTHEST)
        first, (second, pole) = 1 / (1 + np.exp(-inside[0])), np.tanh(inside[1:])
        spread, output = np.exp(np.clip(theta[:2], np.log(LEAST), 5.0))
        return ProcessNoise(float(spread * scale), (float(first), float(second)), float(output * size), float(pole))

    def cost(theta: Array) -> float:
        total = 0.0
        for error, slope in parts:
            weighting = noise(theta).weighting(slope, behind, oversampling)
            white = weighting.whitened(error[None])[0]
            total += float(np.sum(np.log(weighting.spreads) + 0.5 * white**2))
        return total if np.isfinite(total) else 1e300

    start = np.array([0.0, 0.5 * np.log(max(powers.min() / powers.mean(), LEAST)), -1.0, 0.0, 0.0])
    return noise(minimize(cost, start, method="BFGS", options={"gtol": 1e-4 * len(parts) * share, "maxiter": 40}).x)


@njit(nogil=True)
def kalman_gains(
    b: Array, a: Array, slope: Array, rate: int, w: Array, v: Array, start: float, gains: Array, spreads: Array
) -> None:
    """The gains (N, n + 3) and innovation deviations (N,) of the filter for e = G(d·w) + v.

    The state is w(t), w(t − 1), v(t) and that of G in transposed direct form (see `Rational`).

    Args:
        b, a: (n + 1,) coefficients of G.
        slope: (NL,) d.
        rate: L, steps per sample.
        w: c₁, c₂ and variance of w.
        v: pole and variance of v.
        start: variance of the state of G before the first sample.
        gains, spreads: the results.
    """
    n = len(b) - 1
    size = n + 3
    within = w[2] * (1 - w[1]) * (1 + w[1]) * (1 - (w[0] / (1 - w[1])) ** 2)
    cov = np.zeros((size, size))
    moved = np.zeros((size, size))
    seen = np.zeros(size)
    cov[0, 0] = cov[1, 1] = w[2]
    cov[0, 1] = cov[1, 0] = w[2] * w[0] / (1 - w[1])
    cov[2, 2] = v[1]
    for i in range(n):
        cov[3 + i, 3 + i] = start
    for t in range(len(slope)):
        d = slope[t]
        if t % rate == 0:
            for i in range(size):
                seen[i] = b[0] * d * cov[i, 0] + cov[i, 2]
                if n:
                    seen[i] += cov[i, 3]
            total = b[0] * d * seen[0] + seen[2]
            if n:
                total += seen[3]
            total = max(total, 1e-300)
            spreads[t // rate] = np.sqrt(total)
            for i in range(size):
                gains[t // rate, i] = seen[i] / total
                for j in range(size):
                    cov[i, j] -= seen[i] * seen[j] / total
        for j in range(size):  # every column one step ahead, then every row
            moved[0, j] = w[0] * cov[0, j] + w[1] * cov[1, j]
            moved[1, j] = cov[0, j]
            moved[2, j] = v[0] * cov[2, j]
            for i in range(n):
                ahead = cov[4 + i, j] if i + 1 < n else 0.0
                moved[3 + i, j] = ahead + (b[i + 1] - a[i + 1] * b[0]) * d * cov[0, j] - a[i + 1] * cov[3, j]
        for i in range(size):
            first, before, own = moved[i, 0], moved[i, 1], moved[i, 2]
            tail = moved[i, 3] if n else 0.0
            cov[i, 0] = w[0] * first + w[1] * before
            cov[i, 1] = first
            cov[i, 2] = v[0] * own
            for k in range(n):
                ahead = moved[i, 4 + k] if k + 1 < n else 0.0
                cov[i, 3 + k] = ahead + (b[k + 1] - a[k + 1] * b[0]) * d * first - a[k + 1] * tail
        cov[0, 0] += within
        cov[2, 2] += v[1] * (1 - v[0] ** 2)


@njit(nogil=True)
def kalman_rows(
    b: Array,
    a: Array,
    slope: Array,
    rate: int,
    w: Array,
    pole: float,
    gains: Array,
    spreads: Array,
    x: Array,
    out: Array,
) -> None:
    """Every row of x (k, m) through the filter of `kalman_gains`: its innovations over their deviations, into out."""
    n = len(b) - 1
    state = np.zeros(n + 3)
    for row in range(len(x)):
        state[:] = 0.0
        for t in range(x.shape[1] * rate):
            d = slope[t]
            if t % rate == 0:
                k = t // rate
                surprise = x[row, k] - b[0] * d * state[0] - state[2]
                if n:
                    surprise -= state[3]
                out[row, k] = surprise / spreads[k]
                for i in range(n + 3):
                    state[i] += gains[k, i] * surprise
            first = state[0]
            state[0] = w[0] * first + w[1] * state[1]
            state[1] = first
            state[2] *= pole
            if n:
                head = state[3]
                for i in range(n):
                    ahead = state[4 + i] if i + 1 < n else 0.0
                    state[3 + i] = ahead + (b[i + 1] - a[i + 1] * b[0]) * d * first - a[i + 1] * head
