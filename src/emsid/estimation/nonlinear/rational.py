r"""A rational transfer function fitted to a frequency response.

B/A is fitted by least squares weighted with 1/√var. It starts from iterated linear problems
``min ‖(B − G·A)/A_previous‖`` (Sanathanan & Koerner 1963), with poles outside the unit circle mirrored inside, and
continues with `gauss_newton`. For a nonlinear system the response is its best linear approximation, and its variance
contains the nonlinear distortion as well as the noise (Pintelon & Schoukens 2012, ch. 3). A fit weighted with this
variance therefore ignores the frequencies where the nonlinearity dominates; a time-domain fit does not.

References:
    Pintelon, Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed. (2012). Sanathanan, Koerner,
    *Transfer function synthesis as a ratio of two complex polynomials*, IEEE TAC 8 (1963).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.frequency import EXCITED, from_powers, welch
from emsid.estimation.linear.filtering import is_stable
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.estimation.nonlinear.steps import least_squares_step
from emsid.record import FrequencyResponse

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# The most bands that the lines of a periodic input are averaged in, and the fewest lines of a band.
BANDS, LINES = 512, 8
# A standard deviation counts as this part of the largest value at least.
LEAST = 1e-9
# How many linear problems are iterated; they keep their poles inside this radius.
ITERATIONS, LARGEST_RADIUS = 20, 0.9995


def measured(
    segments: Sequence[tuple[Array, Array]], window: int | None = None, period: int | None = None
) -> FrequencyResponse:
    """The response from (u, y) segments by averaged spectra, with frequencies in cycles per sample.

    Args:
        segments: (u (Nᵢ,), y (Nᵢ,)); those shorter than the window are not used.
        window: samples; by default a sixteenth of the longest segment's, a power of two from 32 to 1024.
        period: of the input in samples. Segments of this length are whole periods in steady state, whose spectra have
            no leakage; if there are any, their excited lines are averaged over periods and neighbours.

    Raises:
        ModelError: where no segment is as long as the window, or the input is constant.
    """
    whole = [(u, y) for u, y in segments if len(u) == period]
    longest = max(len(u) for u, _ in segments)
    size = int(np.clip(2 ** int(np.log2(max(longest / 16, 1))), 32, 1024)) if window is None else window
    if not whole and longest < size:
        raise ModelError(f"a frequency response needs a segment of {size} samples; the longest has {longest}")
    if not any(np.ptp(u) for u, _ in whole or segments):
        raise ModelError("the input is constant and excites nothing; use a record in which it moves")
    if not whole:
        inputs, outputs = zip(*((u[:, None], y[:, None]) for u, y in segments), strict=True)
        found, _ = welch(inputs, outputs, size)
        return FrequencyResponse(np.arange(1, size // 2 + 1) / size, *found.plant(1, closed=False), dt=1.0)
    spectra = np.array([np.fft.rfft(np.stack(pair), axis=1)[:, 1:] for pair in whole])  # (K, 2, F)
    power = np.sum(np.abs(spectra[:, 0]) ** 2, axis=0)
    lines = np.flatnonzero(power > EXCITED * np.max(power))
    bands = np.array_split(lines, max(min(BANDS, len(lines) * len(whole) // LINES), 1))
    products = np.einsum("kif,kjf->fij", spectra, spectra.conj())
    means = np.array([products[band].mean(axis=0) for band in bands]) / complex(len(whole))
    averages = np.array([len(band) * len(whole) for band in bands], dtype=float)
    found, _ = from_powers(means, 1, averages)
    at = np.array([band.mean() + 1 for band in bands]) / len(whole[0][0])
    return FrequencyResponse(at, *found.plant(1, closed=False), dt=1.0)


@lru_cache(maxsize=32)
def fit_rational(
    response: FrequencyResponse, nb: int, na: int, oversampling: int = 1, vanishing: int = 0
) -> tuple[Array, Array, float]:
    """Fit B/A to a frequency response.

    The last fits are kept: a search asks for the same one to choose an order, and for each division of its poles.

    Args:
        response: of one input and one output, with frequencies in cycles per sample.
        nb, na: the number of coefficients of B, and of A without its leading one.
        oversampling: the filter runs at this many times the sampling rate.
        vanishing: B has this many further factors 1 + z⁻¹, which are not among its coefficients.

    Returns:
        (nb,) B, (na,) A without its leading one, and the sum of squared weighted errors, which is about
        2m − nb − na if the orders suffice.
    """
    problem = _Rational(response, nb, na, oversampling, vanishing)
    found = gauss_newton(problem, problem.iterated(), max_iterations=30, covariances=False)
    return read_only(found.estimate[:nb]), read_only(_inside(found.estimate[nb:])), 2 * found.cost


@dataclass(frozen=True, eq=False)
class _Rational:
    """Weighted error of B/A: real parts, then imaginary parts."""

    response: FrequencyResponse
    nb: int
    na: int
    oversampling: int
    vanishing: int = 0

    @cached_property
    def _value(self) -> ComplexArray:
        return self.response.response[:, 0, 0]

    @cached_property
    def _weight(self) -> Array:
        deviation, size = np.sqrt(self.response.total_or_relative[:, 0, 0]), np.max(np.abs(self._value))
        return np.asarray(1 / np.maximum(deviation, LEAST * size))

    @cached_property
    def _powers(self) -> ComplexArray:
        z = np.exp(-2j * np.pi * self.response.frequency / self.oversampling)
        return np.asarray(z[:, None] ** np.arange(max(self.nb, self.na + 1, 2)), dtype=complex)

    @cached_property
    def _above(self) -> ComplexArray:
        return np.asarray(self._powers[:, : self.nb] * (1 + self._powers[:, 1:2]) ** self.vanishing)

    def residuals(self, theta: Array) -> list[Array]:
        if not is_stable(theta[self.nb :].tolist()):
            raise Infeasible("a pole outside the unit circle")
        powers = self._powers
        b, a = self._above @ theta[: self.nb], 1 + powers[:, 1 : self.na + 1] @ theta[self.nb :]
        return [self._parts(b / a - self._value)]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        powers = self._powers
        b, a = self._above @ theta[: self.nb], 1 + powers[:, 1 : self.na + 1] @ theta[self.nb :]
        slope = np.column_stack([self._above / a[:, None], -(b / a**2)[:, None] * powers[:, 1 : self.na + 1]])
        return [(self._parts(b / a - self._value), self._parts(slope))]

    def iterated(self) -> Array:
        """Sanathanan and Koerner's solution: the best of `ITERATIONS`."""
        powers, value = self._powers, self._value
        a = np.ones(len(value), dtype=complex)
        best, least = np.zeros(self.nb + self.na), np.inf
        for _ in range(ITERATIONS):
            regression = np.column_stack([self._above, -value[:, None] * powers[:, 1 : self.na + 1]])
            rows, target = self._parts(regression / a[:, None]), self._parts(value / a)
            theta = least_squares_step(Information.from_rows(rows, target))
            theta[self.nb :] = _inside(theta[self.nb :])
            a = 1 + powers[:, 1 : self.na + 1] @ theta[self.nb :]
            cost = float(np.sum(self._parts(self._above @ theta[: self.nb] / a - value) ** 2))
            if cost < least:
                best, least = theta, cost
        return best

    def _parts(self, values: ComplexArray) -> Array:
        weight = self._weight
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
