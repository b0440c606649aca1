r"""The frequency response of a system, estimated from records, and a rational transfer function fitted to it.

The response is the ratio of spectra averaged over overlapping windows (Welch 1967),

    G(f) = S_yu(f)/S_uu(f),      var G = |G|² (1 − γ²)/(γ² M),      γ² = |S_yu|²/(S_uu S_yy),

where M is the number of independent averages. For a nonlinear system this is its best linear approximation, and the
variance contains the nonlinear distortion as well as the noise (Pintelon & Schoukens 2012, ch. 3). A fit weighted with
this variance therefore ignores the frequencies where the nonlinearity dominates; a time-domain fit does not.

The rational function B/A is fitted by least squares weighted with 1/√var. It starts from iterated linear problems
``min ‖(B − G·A)/A_previous‖`` (Sanathanan & Koerner 1963), with poles outside the unit circle
mirrored inside, and continues with `gauss_newton`.

References:
    Pintelon, Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed. (2012). Sanathanan, Koerner,
    *Transfer function synthesis as a ratio of two complex polynomials*, IEEE TAC 8 (1963). Welch, *The use of fast
    Fourier transform for the estimation of power spectra*, IEEE Trans. Audio Electroacoust. 15 (1967).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.linear.filtering import is_stable, spectrum
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.estimation.nonlinear.steps import least_squares_step

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# Independent averages per Hann window, at an overlap of one half.
INDEPENDENT = 0.95
# Lines of a periodic input that are excited, by their power relative to the strongest; the most bands that they are
# averaged in, and the fewest lines of a band.
EXCITED, BANDS, LINES = 1e-4, 512, 8
# How many linear problems are iterated; they keep their poles inside this radius.
ITERATIONS, LARGEST_RADIUS = 20, 0.9995


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """A frequency response estimated from data.

    Attributes:
        frequency: (m,) in cycles per sample, without zero.
        value: (m,) G.
        deviation: (m,) standard deviation of G, noise and nonlinear distortion together.
    """

    frequency: Array
    value: ComplexArray
    deviation: Array

    def ahead(self, samples: int) -> FrequencyResponse:
        """The response without a delay of this many samples."""
        if samples == 0:
            return self
        return replace(self, value=self.value * np.exp(2j * np.pi * self.frequency * samples))


def frequency_response(
    segments: Sequence[tuple[Array, Array]], window: int | None = None, period: int | None = None
) -> FrequencyResponse:
    """The response from (u, y) segments by averaged spectra.

    Args:
        segments: (u (Nᵢ,), y (Nᵢ,)); those shorter than the window are not used.
        window: samples; by default a sixteenth of the longest segment's, a power of two from 32 to 1024.
        period: of the input in samples. Segments of this length are whole periods in steady state, whose spectra have
            no leakage; if there are any, they are used without a window.

    Raises:
        ModelError: where no segment is as long as the window, or the input is constant.
    """
    whole = [(u, y) for u, y in segments if len(u) == period]
    if whole:
        return _periodic_response(whole)
    longest = max(len(u) for u, _ in segments)
    size = int(np.clip(2 ** int(np.log2(max(longest / 16, 1))), 32, 1024)) if window is None else window
    total, power, response, cross = 0.0, np.zeros(1), np.zeros(1), np.zeros(1, dtype=complex)
    frequency = np.asarray(np.fft.rfftfreq(size), dtype=float)
    for u, y in segments:
        if len(u) < size:
            continue
        power = power + len(u) * spectrum(u, u, size).real
        response = response + len(u) * spectrum(y, y, size).real
        cross = cross + len(u) * spectrum(u, y, size)
        total += len(u)
    if not total:
        raise ModelError(f"a frequency response needs a segment of {size} samples; the longest has {longest}")
    used = slice(1, None)
    suu, syy, suy = (np.asarray(s)[used] for s in (power, response, cross))
    if not np.all(suu > 0):
        raise ModelError("the input is constant and excites nothing; use a record in which it moves")
    return _from_powers(frequency[used], suu, syy, suy, 2 * total / size * INDEPENDENT)


def _from_powers(
    frequency: Array, suu: Array, syy: Array, suy: ComplexArray, averages: float | Array
) -> FrequencyResponse:
    """The response from spectra (m,) that are means of this many independent ones."""
    value = suy / suu
    coherence = np.clip(np.abs(suy) ** 2 / np.maximum(suu * syy, np.finfo(float).tiny), 1e-6, 1 - 1e-9)
    deviation = np.abs(value) * np.sqrt((1 - coherence) / (coherence * averages))
    return FrequencyResponse(frequency, value, np.maximum(deviation, 1e-9 * np.max(np.abs(value))))


def _periodic_response(periods: Sequence[tuple[Array, Array]]) -> FrequencyResponse:
    """The response at the excited lines of (u, y), each one period, averaged over neighbouring lines and periods."""
    spectra = [(np.fft.rfft(u)[1:], np.fft.rfft(y)[1:]) for u, y in periods]
    power = np.sum([np.abs(u) ** 2 for u, _ in spectra], axis=0)
    lines = np.flatnonzero(power > EXCITED * np.max(power))
    if not np.max(power) > 0:
        raise ModelError("the input is constant and excites nothing; use a record in which it moves")
    bands = np.array_split(lines, max(min(BANDS, len(lines) * len(periods) // LINES), 1))

    def mean(values: Array | ComplexArray) -> Any:
        return np.array([np.sum(values[band]) for band in bands])

    syy = np.sum([np.abs(y) ** 2 for _, y in spectra], axis=0)
    suy = np.sum([np.conj(u) * y for u, y in spectra], axis=0)
    averages = np.array([len(band) * len(periods) for band in bands], dtype=float)
    frequency = np.array([(band.mean() + 1) / len(periods[0][0]) for band in bands])
    return _from_powers(frequency, mean(power), mean(syy), mean(suy), averages)


@lru_cache(maxsize=32)
def fit_rational(response: FrequencyResponse, nb: int, na: int, oversampling: int = 1) -> tuple[Array, Array, float]:
    """Fit B/A to a frequency response.

    The last fits are kept: a search asks for the same one to choose an order, and for each division of its poles.

    Args:
        response: the response.
        nb, na: the number of coefficients of B, and of A without its leading one.
        oversampling: the filter runs at this many times the sampling rate.

    Returns:
        (nb,) B, (na,) A without its leading one, and the sum of squared weighted errors, which is about
        2m − nb − na if the orders suffice.
    """
    problem = _Rational(response, nb, na, oversampling)
    found = gauss_newton(problem, problem.iterated(), max_iterations=30, covariances=False)
    return read_only(found.estimate[:nb]), read_only(_inside(found.estimate[nb:])), 2 * found.cost


@dataclass(frozen=True, eq=False)
class _Rational:
    """Weighted error of B/A: real parts, then imaginary parts."""

    response: FrequencyResponse
    nb: int
    na: int
    oversampling: int

    @cached_property
    def _powers(self) -> ComplexArray:
        z = np.exp(-2j * np.pi * self.response.frequency / self.oversampling)
        return np.asarray(z[:, None] ** np.arange(max(self.nb, self.na + 1)), dtype=complex)

    def residuals(self, theta: Array) -> list[Array]:
        if not is_stable(theta[self.nb :].tolist()):
            raise Infeasible("a pole outside the unit circle")
        powers = self._powers
        b, a = powers[:, : self.nb] @ theta[: self.nb], 1 + powers[:, 1 : self.na + 1] @ theta[self.nb :]
        return [self._parts(b / a - self.response.value)]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        powers = self._powers
        b, a = powers[:, : self.nb] @ theta[: self.nb], 1 + powers[:, 1 : self.na + 1] @ theta[self.nb :]
        slope = np.column_stack([powers[:, : self.nb] / a[:, None], -(b / a**2)[:, None] * powers[:, 1 : self.na + 1]])
        return [(self._parts(b / a - self.response.value), self._parts(slope))]

    def iterated(self) -> Array:
        """Sanathanan and Koerner's solution: the best of `ITERATIONS`."""
        powers, value = self._powers, self.response.value
        a = np.ones(len(value), dtype=complex)
        best, least = np.zeros(self.nb + self.na), np.inf
        for _ in range(ITERATIONS):
            regression = np.column_stack([powers[:, : self.nb], -value[:, None] * powers[:, 1 : self.na + 1]])
            rows, target = self._parts(regression / a[:, None]), self._parts(value / a)
            theta = least_squares_step(Information.from_rows(rows, target))
            theta[self.nb :] = _inside(theta[self.nb :])
            a = 1 + powers[:, 1 : self.na + 1] @ theta[self.nb :]
            cost = float(np.sum(self._parts(powers[:, : self.nb] @ theta[: self.nb] / a - value) ** 2))
            if cost < least:
                best, least = theta, cost
        return best

    def _parts(self, values: ComplexArray) -> Array:
        weight = 1 / self.response.deviation
        weighted = values * (weight if values.ndim == 1 else weight[:, None])
        return np.concatenate([weighted.real, weighted.imag])


def _inside(denominator: Array) -> Array:
    """The denominator with poles outside the unit circle mirrored into it."""
    poles = np.roots(np.append(1.0, denominator))
    size = np.abs(poles)
    poles = np.where(size > 1, poles / np.maximum(size, 1e-300) ** 2, poles)
    size = np.abs(poles)
    poles = np.where(size > LARGEST_RADIUS, poles * LARGEST_RADIUS / np.maximum(size, 1e-300), poles)
    mirrored = np.real(np.atleast_1d(np.poly(poles)))[1:]  # np.poly of no poles is a scalar 1
    return np.concatenate([mirrored, np.zeros(len(denominator) - len(mirrored))])
