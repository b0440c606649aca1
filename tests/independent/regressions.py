"""Records of difference equations with noise, and regressions, free runs and derivatives by their definitions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid import RegressionModel, Structure
from emsid.models.regression.regressors import Regressor
from emsid.record import Record

Array = NDArray[np.float64]

POLES, ZEROS, TAPS = (-1.5, 0.56), (0.04, 0.02), (0.5, 0.3, 0.2)
LEFT_OUT = 200
"""Samples before the record, in which transients die away."""


@dataclass(frozen=True)
class Equation:
    """A(q)y = B(q)u with noise.

    Attributes:
        equation: standard deviation of the noise in the equation, over that of the noise-free output.
        output: standard deviation of white noise on the output, over the same.
        pole: of the noise in the equation.
        poles: a₁, a₂, …; none for a filter of past inputs only.
        zeros: b₁, b₂, …
        free_run: whether it is fitted to the free run.
    """

    equation: float = 0.0
    output: float = 0.0
    pole: float = 0.0
    poles: tuple[float, ...] = POLES
    zeros: tuple[float, ...] = ZEROS
    free_run: bool = False

    @property
    def truth(self) -> tuple[float, ...]:
        """Poles, then zeros."""
        return (*self.poles, *self.zeros)

    def record(self, seed: int, samples: int = 500) -> Record:
        """One record, driven by coloured noise."""
        rng = np.random.default_rng([4, seed])
        u = lfilter([1], [1, -0.7], rng.standard_normal(samples + LEFT_OUT))
        white = rng.standard_normal((2, samples + LEFT_OUT))
        clean = lfilter([0, *self.zeros], [1, *self.poles], u)
        noise = lfilter([np.sqrt(1 - self.pole**2)], [1, -self.pole], white[0])
        y = clean + np.std(clean) * (self.equation * lfilter([1], [1, *self.poles], noise) + self.output * white[1])
        return Record(u[LEFT_OUT:], y[LEFT_OUT:], 0.01)


EQUATIONS: Mapping[str, Equation] = {
    "white": Equation(equation=0.02),
    "coloured": Equation(equation=0.02, pole=0.8),
    "output noise": Equation(output=0.05),
    "output noise, free run": Equation(output=0.05, free_run=True),
    "inputs only, coloured": Equation(equation=0.4, pole=0.9, poles=(), zeros=TAPS),
}
"""The settings by name."""


def regression_of(structure: Structure, y: Iterable[float], u: Array) -> Array:
    """Φ by its definition, sample by sample."""
    signals = [np.asarray(list(y)), *np.asarray(u, dtype=float).T]
    rows = []
    for t in range(structure.memory, len(signals[0])):
        row = []
        for regressor in structure.regressors:
            value = -1.0 if regressor.negative else 1.0
            for f in regressor.factors:
                value *= f.transform.definition(signals[f.channel][t - f.lag], f.parameter) ** f.power
            row.append(value)
        rows.append(row)
    return np.array(rows)


def free_run_of(model: RegressionModel, record: Record, start: int) -> Array:
    """The free run by its definition, one regression row at a time."""
    y = record.output[:, 0].copy()
    for t in range(start, len(record)):
        first = t - model.structure.memory
        y[t] = regression_of(model.structure, y[first : t + 1], record.input[first : t + 1])[-1] @ model.parameters
    return y


def derivative_of(regressors: Sequence[Regressor], theta: Array, y: Array, u: Array, start: int) -> Array:
    """∂ŷ/∂θ (n, N) by its definition, for regressors of outputs without transforms.

    Args:
        regressors: of the structure.
        theta: (n,).
        y: (N,) the free run itself, with the measured start.
        u: (nu, N).
        start: the first sample of the free run.
    """
    signals = [y, *u]
    derivative = np.zeros((len(regressors), len(y)))
    for t in range(start, len(y)):
        for j, regressor in enumerate(regressors):
            sign = -1.0 if regressor.negative else 1.0
            values = [signals[f.channel][t - f.lag] for f in regressor.factors]
            powers = [v**f.power for v, f in zip(values, regressor.factors, strict=True)]
            derivative[j, t] += sign * float(np.prod(powers))
            for k, f in enumerate(regressor.factors):
                if f.channel == 0:
                    others = float(np.prod(powers[:k] + powers[k + 1 :]))
                    inner = theta[j] * sign * others * f.power * values[k] ** (f.power - 1)
                    derivative[:, t] += inner * derivative[:, t - f.lag]
    return derivative
