r"""A regression near its rest at a constant input.

A regression y(t) = Σ θⱼ φⱼ is linearised by the slopes of its regressors at rest, ∂φⱼ/∂y(t−k) and ∂φⱼ/∂u(t−k), so that

    A(q) = 1 − Σⱼₖ θⱼ ∂φⱼ/∂y(t−k) q⁻ᵏ        B(q) = Σⱼₖ θⱼ ∂φⱼ/∂u(t−k) q⁻ᵏ
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.regression.narx import Narx
from emsid.models.regression.transforms import slope
from emsid.models.steady_state import settled

Array = NDArray[np.float64]


def linearised(model: Narx, around: float) -> tuple[Array, Array, float]:
    """A (memory + 1,) and B (nu, memory + 1) of a regression in powers of q⁻¹ at its rest, and its output there.

    Raises:
        ModelError: where it does not come to rest at this input.
    """
    rest = settled(model, around, model.structure.inputs)
    rows = np.zeros((1 + model.structure.inputs, model.structure.memory + 1))
    for regressor, value in zip(model.structure.regressors, model.parameters, strict=True):
        weight = -value if regressor.negative else value
        levels = [around if factor.channel else rest for factor in regressor.factors]
        factors = list(zip(regressor.factors, levels, strict=True))
        through = np.array([float(each.transform.definition(x, each.parameter)) for each, x in factors])
        powers = np.array([factor.power for factor in regressor.factors])
        for k, (each, x) in enumerate(factors):
            others = float(np.prod(np.delete(through**powers, k)))
            own = powers[k] * through[k] ** (powers[k] - 1) * slope(int(each.transform), x, each.parameter)
            rows[each.channel, each.lag] += weight * own * others
    below = -rows[0]
    below[0] = 1.0
    if np.abs(np.roots(below)).max(initial=0.0) >= 1.0:
        raise ModelError(f"{model.name} does not come to rest at an input of {around:g}: it is unstable there")
    return below, rows[1:], rest


def about(model: Narx, level: float) -> tuple[Array, Array]:
    """A (memory + 1,) and B (nu, memory + 1) of a regression, near its rest at a constant input unless it is linear.

    Raises:
        ModelError: where it does not come to rest at this input.
    """
    return model.linear_part() if model.is_linear else linearised(model, level)[:2]
