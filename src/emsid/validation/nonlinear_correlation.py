"""The nonlinear cross-correlation tests: the residual of a free run against nonlinear functions of its inputs.

The correlation with the input itself is blind to what a nonlinearity leaves after the best linear model. An even
characteristic shows in u² and |u|, an odd one (a dead zone, Coulomb friction) in u³, a gain that depends on the motion
in the product of the input and the simulated output. Of every function only that part is taken that lower ones, and the
signals themselves, do not have in common with it.

References:
    Billings, Voon, *Correlation based model validity tests for non-linear models*, Int. J. Control 44 (1986).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.models.model import Run
from emsid.record import Record
from emsid.validation.correlation import LAGS, SIGNIFICANCE, cross_correlation

Array = NDArray[np.float64]

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
    from scipy.special import ndtri

    tests = []
    for term in terms:
        correlation = cross_correlation(error, term.signal, breaks, lags)
        past = correlation[len(correlation) // 2 :]
        limit = float(-ndtri(SIGNIFICANCE / 2 / len(past) / len(terms)))
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
    of_inputs, tests = nonlinear_terms(record.input, record.input_names), []
    for output, measured, simulated in zip(record.output_names, record.output.T, simulation.output.T, strict=True):
        terms = of_inputs
        if np.isfinite(simulated).all():
            y = _scaled(simulated)
            names = [f"{name}·{output} (simulated)" for name in record.input_names]
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
