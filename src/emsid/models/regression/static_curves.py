"""Curves of a regression of one input at rest: its static map, and its friction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.models.bands import POINTS, Band, banded
from emsid.models.regression.narx import Narx
from emsid.models.regression.regressors import Regressor
from emsid.record import Record

Array = NDArray[np.float64]


def static_map(fit: Fit[Narx], record: Record, level: float) -> Band:
    """The output at rest over the input, from all terms but those that are nonlinear in past outputs (friction).

    Raises:
        ModelError: for products of input and output.
    """
    terms = _of_one_side(fit.model)
    x = np.linspace(float(record.input.min()), float(record.input.max()), POINTS)

    def at_rest(moved: Narx) -> Array:
        inputs = _sum(moved, terms[1], x) + _sum(moved, terms[None], x)
        return np.asarray(inputs / (1.0 - _sum(moved, _linear(terms[0]), np.ones(1))))

    return banded(fit, at_rest, x, level)


def friction(fit: Fit[Narx], record: Record, level: float) -> Band:
    """What the terms that are nonlinear in past outputs do at a constant output, over the slope of the input.

    Raises:
        ModelError: for a model without such terms, or with products of input and output.
    """
    terms = _of_one_side(fit.model)
    bent = [k for k in terms[0] if k not in _linear(terms[0])]
    if not bent:
        raise ModelError(f"{fit.model.name} has no term that is nonlinear in past outputs")
    low, high = np.quantile(record.input, (0.01, 0.99))
    x = np.linspace(float(record.output.min()), float(record.output.max()), POINTS)

    def taken_up(moved: Narx) -> Array:
        slope = np.diff(_sum(moved, terms[1], np.array([low, high])))[0] / (high - low)
        return np.asarray(-_sum(moved, {k: terms[0][k] for k in bent}, x) / slope)

    return banded(fit, taken_up, x, level)


def _of_one_side(model: Narx) -> dict[int | None, dict[int, Regressor]]:
    """The regressors of past outputs (0), of past inputs (1) and constants (None), by their places.

    Raises:
        ModelError: for several inputs, or products of input and output.
    """
    if model.structure.inputs != 1:
        raise ModelError(f"{model.name} is no regression of one input")
    sides: dict[int | None, dict[int, Regressor]] = {0: {}, 1: {}, None: {}}
    if has_products(model):
        raise ModelError(f"{model.name} has products of input and output, so its friction is not one curve")
    for k, regressor in enumerate(model.structure.regressors):
        sides[next((factor.channel for factor in regressor.factors), None)][k] = regressor
    return sides


def has_products(model: Narx) -> bool:
    """Whether a term of a regression is a product of input and output."""
    return any(len({factor.channel for factor in regressor.factors}) > 1 for regressor in model.structure.regressors)


def _linear(regressors: dict[int, Regressor]) -> dict[int, Regressor]:
    """Those that are a past signal itself."""
    return {k: regressor for k, regressor in regressors.items() if regressor.is_linear}


def _sum(model: Narx, regressors: dict[int, Regressor], x: Array) -> Array:
    """(m,) what regressors add to the output where their signal has been constant at x (m,)."""
    total = np.zeros(len(x))
    for k, regressor in regressors.items():
        value = np.full(len(x), -model.parameters[k] if regressor.negative else model.parameters[k])
        for factor in regressor.factors:
            value = value * factor.transform.definition(x, factor.parameter) ** factor.power
        total += value
    return total
