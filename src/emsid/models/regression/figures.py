"""Gain, time constants and friction of a nonlinear regression, with intervals.

Each is a function g(θ) of the estimate; its variance to first order is ∇gᵀ P ∇g, with the covariance P of the estimate
(the delta method).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite, prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Fit
from emsid.models.characteristics import oscillation, time_constants
from emsid.models.regression.narx import Narx
from emsid.models.regression.regressors import Regressor
from emsid.models.regression.transforms import Transform
from emsid.record import Record
from emsid.units import per_unit

Array = NDArray[np.float64]


STATIC_GAIN = "static gain over the range of the input"
"""Difference of the outputs at rest for two constant inputs, divided by the difference of the inputs."""


COULOMB = "Coulomb friction in units of the input"
SHORTEST = 1 / 3
"""In samples; a pole that decays to a twentieth within a sample is no dynamics that the samples show."""


@dataclass(frozen=True)
class Figure:
    """A characteristic number of a model.

    Attributes:
        name: what it is.
        value: in its unit.
        unit: of it; empty where the record names no units.
        standard_error: None where the data do not give one.
    """

    name: str
    value: float
    unit: str = ""
    standard_error: float | None = None


def of_regression(fit: Fit[Narx], record: Record) -> tuple[Figure, ...]:
    """The figures of a regression with one input and one output.

    Args:
        fit: the model with its covariance.
        record: what it was fitted to, for sample time, units and range of the input.
    """
    return _with_errors(fit, lambda theta: _of_a_regression(replace(fit.model, parameters=theta), record))


def _of_a_regression(model: Narx, record: Record) -> list[Figure]:
    """Static gain, time constants of the linear part; friction from the coefficient of the sign of the output."""
    a: dict[int, float] = {}
    coulomb = 0.0
    inputs: list[tuple[float, Regressor]] = []
    for regressor, value in zip(model.structure.regressors, model.parameters, strict=True):
        coefficient = -float(value) if regressor.negative else float(value)
        channels = {factor.channel for factor in regressor.factors}
        first = regressor.factors[0] if len(regressor.factors) == 1 else None
        if channels == {1}:
            inputs.append((coefficient, regressor))
        elif first is not None and first.transform is Transform.VALUE and first.power == 1:
            a[first.lag] = coefficient
        elif first is not None and first.transform is Transform.SIGN:
            coulomb += coefficient
    low, high = _range(record)
    figures = []
    slope = (_of_inputs(inputs, high) - _of_inputs(inputs, low)) / (high - low) if high > low else 0.0
    rest = 1 - sum(a.values())
    if slope and rest > 1e-9:
        figures.append(Figure(STATIC_GAIN, slope / rest, per_unit(record.output_units[0], record.input_units[0])))
    if a:
        denominator = np.zeros(max(a) + 1)
        denominator[0] = 1.0
        for lag, value in a.items():
            denominator[lag] = -value
        figures += _time_constants(np.roots(denominator), record.dt)
    if coulomb < 0 and slope:  # a sign that pushes along is no friction
        figures.append(Figure(COULOMB, -coulomb / abs(slope), record.input_units[0]))
    return figures


def _range(record: Record) -> tuple[float, float]:
    """The range of the input without its extremes."""
    low, high = np.quantile(record.input[:, 0], (0.01, 0.99))
    return float(low), float(high)


def _of_inputs(terms: list[tuple[float, Regressor]], level: float) -> float:
    """What a constant input adds to the next output."""
    return sum(
        coefficient
        * float(
            prod(factor.transform.definition(level, factor.parameter) ** factor.power for factor in regressor.factors)
        )
        for coefficient, regressor in terms
    )


def _time_constants(poles: NDArray[Any], dt: float) -> list[Figure]:
    """The slowest time constants, and natural frequency and damping ratio of the slowest pair of complex poles."""
    real = [constant for constant in time_constants(poles, dt) if constant > SHORTEST * dt]
    pair = oscillation(poles, dt)
    names = ("time constant", "second time constant")
    found = [Figure(name, each, "s") for name, each in zip(names, real, strict=False)]
    if pair is not None:
        found += [Figure("natural frequency", pair.frequency, "rad/s"), Figure("damping ratio", pair.damping, "1")]
    return found


def _with_errors(fit: Fit[Any], figures_at: Callable[[Array], list[Figure]]) -> tuple[Figure, ...]:
    """Figures with standard errors to first order; none for a figure that vanishes after a small change."""
    estimate = np.asarray(fit.estimate, dtype=float)
    try:
        figures = figures_at(estimate)
    except (EmsidError, ValueError, ArithmeticError):
        return ()
    values = {figure.name: figure.value for figure in figures}
    gradient = {name: np.zeros(len(estimate)) for name in values}
    known = np.isfinite(np.diag(fit.covariance))
    for k in np.flatnonzero(known):
        step = 1e-6 * max(abs(estimate[k]), 1e-6)
        moved = estimate.copy()
        moved[k] += step
        try:
            there = {figure.name: figure.value for figure in figures_at(moved)}
        except (EmsidError, ValueError, ArithmeticError):
            there = {}
        for name, value in values.items():
            gradient[name][k] = (there.get(name, np.nan) - value) / step
    covariance = fit.covariance[np.ix_(known, known)]
    found = []
    for figure in figures:
        slope = gradient[figure.name][known]
        variance = float(slope @ covariance @ slope)
        certain = isfinite(variance) and variance >= 0
        found.append(replace(figure, standard_error=float(np.sqrt(variance)) if certain else None))
    return tuple(found)
