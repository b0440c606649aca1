r"""Autocorrelation of a residual and its correlation with an input, without products across a gap between segments.

**Nonlinear tests** correlate the residual of a free run with nonlinear functions of its inputs. The correlation with
the input itself is blind to what a nonlinearity leaves after the best linear model. An even characteristic shows in u²
and |u|, an odd one (a dead zone, Coulomb friction) in u³, a gain that depends on the motion in the product of the input
and the simulated output. Of every function only that part is taken that lower ones, and the signals themselves, do not
have in common with it.

**Whiteness** of the one-step errors of a model: with autocorrelations r(k) of N errors, ``Q = N(N + 2) Σ r(k)²/(N −
k)`` follows χ² of as many degrees of freedom as lags if they are white (Ljung & Box, *On a measure of lack of fit in
time series models*, Biometrika 65, 1978).

References:
    Ljung, *System Identification*, 2nd ed. (1999), sec. 16.6 on residual analysis. Billings, Voon, *Correlation based
    model validity tests for non-linear models*, Int. J. Control 44 (1986).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.models.model import Run
from emsid.record import Record
from emsid.units import name_and_unit

Array = NDArray[np.float64]
SIGNIFICANCE = 0.01
"""The probability that a test of whiteness rejects a white residual, or one of independence an independent residual."""
LAGS = 50
"""Lags of the tests against functions of the inputs, in samples."""
EXCITED = 1e-2
"""Directions of lagged inputs with less than this part of the largest variance are not tested together."""
# The length of every segment of a signal, and its Fourier transform.
Spectra = list[tuple[int, NDArray[np.complex128]]]


def autocorrelation(error: Array, breaks: Sequence[int], lags: int) -> Array:
    """(≤ lags + 1,) autocorrelation after removal of the mean, over pairs that are known and lie in one segment.

    Args:
        error: (N,) NaN where it is not known.
        breaks: the first sample of every segment but the first.
        lags: largest lag in samples.
    """
    lags = _longest_lag(error, breaks, lags)
    spectra = _spectra(np.nan_to_num(error - np.nanmean(error)), breaks)
    products = _lagged_products(spectra, spectra, lags)[lags:]
    return products / (products[0] or 1.0)


def cross_correlation(error: Array, u: Array, breaks: Sequence[int], lags: int) -> Array:
    """(≤ 2·lags + 1,) correlation of the error with the input τ samples earlier, τ = −lags … lags.

    It is divided by its standard deviation for independent signals: the sum of N products then has the variance
    N·Σ R_e(k)·R_u(k), in autocovariances (Ljung, eq. 16.68), here with a triangular window. All values are zero where
    one of the signals is zero.

    Args:
        error: (N,) NaN where it is not known.
        u: (N,) input.
        breaks: the first sample of every segment but the first.
        lags: largest lag in samples, in both directions.
    """
    lags = _longest_lag(error, breaks, lags)
    known = np.isfinite(error)
    nothing = np.zeros(2 * lags + 1)
    if not known.any():
        return nothing
    e, v = _about_their_means(error, u, breaks)
    own_e, own_v = (_lagged_products(x, x, lags)[lags:] for x in (e, v))
    weights = (2.0 - (np.arange(lags + 1) == 0)) * (1 - np.arange(lags + 1) / (lags + 1))
    variance = float(np.sum(weights * own_e * own_v)) / int(np.count_nonzero(known))
    if not variance > 0:
        return nothing
    shares = _lagged_products(e, v, lags) / np.sqrt(variance)
    return shares if np.isfinite(shares).all() else nothing


def limit_over(values: int) -> float:
    """The size, in standard deviations, that all of so many independent normal values stay below in 99 of 100 cases."""
    from scipy.special import ndtri

    return float(-ndtri(SIGNIFICANCE / 2 / values))


class InputTest(NamedTuple):
    """Whether a residual is independent of the past of an input, with 99 % bands.

    Attributes:
        lags: how many were tested, from 0.
        largest: the largest correlation in absolute value, in standard deviations, with its sign.
        at_lag: the input is this many samples earlier.
        limit: that 99 of 100 independent residuals do not reach at any lag.
        p_value: of the portmanteau test, the chance of correlations at all lags as large together as these.
    """

    lags: int
    largest: float
    at_lag: int
    limit: float
    p_value: float

    @property
    def depends(self) -> bool:
        """Whether the residual depends on the input, by one lag or by all of them together."""
        return abs(self.largest) > self.limit or self.p_value < SIGNIFICANCE


def input_test(error: Array, u: Array, breaks: Sequence[int], lags: int) -> InputTest | None:
    """Test a residual against the past of an input, lag by lag and by a portmanteau test over all lags.

    The correlations r (lags + 1,) of independent signals have the covariance P, a Toeplitz matrix of
    Σ R_e(k)·R_u(k + τ) (Ljung, eq. 16.68), so that rᵀP⁻¹r follows χ². Directions of P that a smooth input hardly
    excites are left out.

    Args:
        error: (N,) NaN where it is not known.
        u: (N,) input.
        breaks: the first sample of every segment but the first.
        lags: the largest lag in samples.

    Returns:
        None where one of the signals is constant.
    """
    from scipy.linalg import toeplitz
    from scipy.special import chdtrc

    both = cross_correlation(error, u, breaks, lags)
    past = both[len(both) // 2 :]
    if not past.any():
        return None
    k, most = int(np.argmax(np.abs(past))), len(past) - 1
    e, v = _about_their_means(error, u, breaks)
    own_e = _lagged_products(e, e, most) * (1 - np.abs(np.arange(-most, most + 1)) / (most + 1))
    own_u = _lagged_products(v, v, 2 * most)
    covariance = np.correlate(own_u, own_e, "valid")[most:]
    size, axes = np.linalg.eigh(toeplitz(covariance / covariance[0]))
    kept = size > EXCITED * size[-1]
    statistic = float(np.sum((axes.T[kept] @ past) ** 2 / size[kept]))
    p_value = float(chdtrc(int(np.count_nonzero(kept)), statistic))
    return InputTest(len(past), float(past[k]), k, limit_over(len(past)), p_value)


def _longest_lag(signal: Array, breaks: Sequence[int], lags: int) -> int:
    """The largest lag up to ``lags`` at which a segment has a pair of samples."""
    return min(lags, max(map(len, np.split(signal, list(breaks)))) - 1)


def _about_their_means(error: Array, u: Array, breaks: Sequence[int]) -> tuple[Spectra, Spectra]:
    """The spectra of an error, zero where it is not known, and of an input, both about their means where it is."""
    known = np.isfinite(error)
    centred = np.where(known, error - float(np.mean(error[known])), 0.0)
    return _spectra(centred, breaks), _spectra(u - float(np.mean(u[known])), breaks)


def _spectra(signal: Array, breaks: Sequence[int]) -> Spectra:
    pieces = np.split(signal, list(breaks))
    # Padded to at least twice the length, so that the correlation is not circular.
    return [(len(piece), np.fft.rfft(piece, 1 << (2 * len(piece) - 1).bit_length())) for piece in pieces]


def _lagged_products(a: Spectra, b: Spectra, lags: int) -> Array:
    """(2·lags + 1,) Σₜ a(t)·b(t − τ) for τ = −lags … lags, over pairs that lie in one segment."""
    sums = np.zeros(2 * lags + 1)
    for (samples, x), (_, y) in zip(a, b, strict=True):
        reach = min(lags, samples - 1)
        sums[lags - reach : lags + reach + 1] += np.fft.irfft(x * np.conj(y))[np.arange(-reach, reach + 1)]
    return sums


NOTHING = 1e-6
"""A function with a smaller deviation, of signals whose largest value is one, is what the others have in common."""


class Term(NamedTuple):
    """A nonlinear function of the inputs.

    Attributes:
        name: for tables and sentences, ``u³``.
        kind: ``even``, ``odd`` or ``product``.
        signal: (N,) what is its own.
    """

    name: str
    kind: str
    signal: Array


class NonlinearTest(NamedTuple):
    """The correlation of a residual with a nonlinear function of its inputs.

    Attributes:
        term, kind: of the function.
        curve: (≤ lags + 1,) correlation with the function 0, 1, … samples earlier, in standard deviations.
        limit: that 99 of 100 independent residuals do not reach at any lag in any of their tests.
        share: of the variance of the residual that the function explains at the lag of its largest correlation.
    """

    term: str
    kind: str
    curve: Array
    limit: float
    share: float = 1.0

    @property
    def at_lag(self) -> int:
        """Where the correlation is largest in absolute value."""
        return int(np.argmax(np.abs(self.curve)))

    @property
    def largest(self) -> float:
        """The largest correlation in absolute value, with its sign."""
        return float(self.curve[self.at_lag])

    @property
    def depends(self) -> bool:
        """Whether the residual depends on this function."""
        return abs(self.largest) > self.limit


def nonlinear_terms(inputs: Array, names: Sequence[str]) -> list[Term]:
    """u², u³ and |u| of every input (N, nu), and the products of two; an input of two values has no powers."""
    scaled = [_scaled(u) for u in inputs.T]
    terms = []
    for u, x, name in zip(inputs.T, scaled, names, strict=True):
        powers = _powers(x)
        terms += [
            Term(f"{name}²", "even", _own(powers[:, 2], powers[:, :2])),
            Term(f"{name}³", "odd", _own(powers[:, 3], powers[:, :3])),
            Term(f"|{name}|", "even", _own(_scaled(np.abs(u)), powers)),
        ]
    terms += [_product(scaled[i], scaled[k], f"{names[i]}·{names[k]}") for i, k in combinations(range(len(names)), 2)]
    return [term for term in terms if float(np.std(term.signal)) > NOTHING]


def nonlinear_tests(
    error: Array, terms: Sequence[Term], breaks: Sequence[int], lags: int = LAGS
) -> tuple[NonlinearTest, ...]:
    """The tests of a residual.

    Args:
        error: (N,) NaN where it is not known.
        terms: of N samples.
        breaks: the first sample of every segment but the first.
        lags: the largest lag in samples.
    """
    tests = []
    for term in terms:
        correlation = cross_correlation(error, term.signal, breaks, lags)
        past = correlation[len(correlation) // 2 :]
        limit = limit_over(len(past) * len(terms))
        lag = int(np.argmax(np.abs(past)))
        tests.append(NonlinearTest(term.name, term.kind, past, limit, _share(error, term.signal, breaks, lag)))
    return tuple(tests)


def _share(error: Array, signal: Array, breaks: Sequence[int], lag: int) -> float:
    """The squared correlation of a residual with a signal some samples earlier, in the same segment."""
    starts = np.zeros(len(error), dtype=int)
    starts[list(breaks)] = list(breaks)
    own = np.arange(len(error)) - lag >= np.maximum.accumulate(starts)
    earlier = np.roll(signal, lag)
    both = own & np.isfinite(error)
    r, x = (each[both] - each[both].mean() for each in (error, earlier)) if both.any() else (np.zeros(1), np.zeros(1))
    power = float(r @ r) * float(x @ x)
    return float(r @ x) ** 2 / power if power > 0 else 0.0


def free_run_tests(record: Record, simulation: Run) -> tuple[tuple[NonlinearTest, ...], ...]:
    """The tests of every output of a free run, the products of the inputs and that output among them."""
    inputs = [name_and_unit(name)[0] for name in record.input_names]
    of_inputs, tests = nonlinear_terms(record.input, inputs), []
    for output, measured, simulated in zip(record.output_names, record.output.T, simulation.output.T, strict=True):
        terms = of_inputs
        if np.isfinite(simulated).all():
            y = _scaled(simulated)
            names = [f"{name}·{name_and_unit(output)[0]} (simulated)" for name in inputs]
            products = [_product(_scaled(u), y, name) for u, name in zip(record.input.T, names, strict=True)]
            terms = [*terms, *(term for term in products if float(np.std(term.signal)) > NOTHING)]
        error = np.where(simulation.counted, measured - simulated, np.nan)
        tests.append(nonlinear_tests(error, terms, record.breaks))
    return tuple(tests)


def _scaled(u: Array) -> Array:
    """(N,) a signal about its mean, with a largest value of one."""
    centred = u - u.mean()
    return np.asarray(centred / (float(np.max(np.abs(centred))) or 1.0))


def _own(signal: Array, others: Array) -> Array:
    """(N,) the part of a signal that no combination of others (N, m) explains."""
    own: Array = signal - others @ np.linalg.lstsq(others, signal, rcond=1e-9)[0]
    return own


def _product(a: Array, b: Array, name: str) -> Term:
    powers = np.column_stack([_powers(a), _powers(b)[:, 1:]])
    return Term(name, "product", _own(a * b, powers))


def _powers(x: Array) -> Array:
    """(N, 4) 1, x, x², x³."""
    return np.stack([np.ones_like(x), x, x**2, x**3], axis=1)


LAGS_OF_WHITENESS = 25
"""Lags that are tested, in samples."""
NOTABLE = 0.1
"""Smaller autocorrelations are accepted, even if they are significant in a long record."""


@dataclass(frozen=True)
class ResidualTest:
    """Test of the one-step errors of one output.

    Attributes:
        output: its name.
        lags: how many lags were tested.
        p_value: the chance of autocorrelations as large as these, if the one-step errors are white.
        largest_autocorrelation, at_lag: of the one-step errors, in absolute value.
    """

    output: str
    lags: int
    p_value: float
    largest_autocorrelation: float
    at_lag: int

    @property
    def white(self) -> bool:
        """Whether the one-step errors are white, or nearly white."""
        return self.p_value >= SIGNIFICANCE or self.largest_autocorrelation < NOTABLE


def residual_tests(record: Record, prediction: Run) -> list[ResidualTest]:
    """Test every output; no test for a record of few samples, or a prediction that diverged.

    Args:
        record: the measured data.
        prediction: the one-step prediction.
    """
    counted = prediction.counted
    if np.count_nonzero(counted) < 4 * LAGS_OF_WHITENESS or not np.isfinite(prediction.output[counted]).all():
        return []
    errors = np.where(counted[:, None], record.output - prediction.output, np.nan)
    return [
        _of_one_output(name, error, record)
        for name, error in zip(record.output_names, errors.T, strict=True)
        if np.nanstd(error) > 0
    ]


def _of_one_output(name: str, error: Array, record: Record) -> ResidualTest:
    from scipy.special import chdtrc

    r = np.asarray(autocorrelation(error, record.breaks, LAGS_OF_WHITENESS))[1:]
    lags, n = len(r), int(np.count_nonzero(np.isfinite(error)))
    q = n * (n + 2) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    k = int(np.argmax(np.abs(r)))
    return ResidualTest(name, lags, float(chdtrc(lags, q)), float(abs(r[k])), k + 1)
