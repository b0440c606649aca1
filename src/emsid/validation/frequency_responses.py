r"""The frequency response of a model that is linear, or linearised where it rests at a constant input.

A regression y(t) = Σ θⱼ φⱼ is linearised by the slopes of its regressors at rest, ∂φⱼ/∂y(t−k) and ∂φⱼ/∂u(t−k), so that

    A(q) = 1 − Σⱼₖ θⱼ ∂φⱼ/∂y(t−k) q⁻ᵏ        B(q) = Σⱼₖ θⱼ ∂φⱼ/∂u(t−k) q⁻ᵏ

A feedback model is linearised by the slopes of its maps at rest. At L steps per sample, a held input passes the L steps
of a sample at once; an interpolated one is a sine at every step. The filters of a cascade are taken in a row, without
its maps. A plant is taken in motion, without friction that is constant.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.feedback.model import FeedbackModel
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.process_model import ProcessModel
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.plants.grey_box import GreyBox
from emsid.models.regression.narx import Narx
from emsid.models.regression.transforms import slope

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

AT_REST = 1e-6
"""A model is at rest where its output moves by less than this share of itself."""


def frequency_response(
    model: Any, f: Array, dt: float, *, output: int = 0, input: int = 0, around: float = 0.0
) -> Complex:
    """(m,) the frequency response of a model.

    Args:
        model: a regression, a polynomial or state-space model, a cascade, a feedback model or a plant.
        f: (m,) frequencies in Hz.
        dt: sample time in s.
        output, input: of a model with several, from 0.
        around: the constant input about which a nonlinear regression or a feedback model is linearised.

    Raises:
        ModelError: for a model without one, without these channels, or that does not rest at this input.
    """
    z = np.exp(-2j * np.pi * f * dt)
    if isinstance(model, StateSpaceModel | PolynomialModel | ProcessModel):
        found = model.response(f)
        check_channel(model, "output", output, found.shape[1])
        check_channel(model, "input", input, found.shape[2])
        return np.asarray(found[:, output, input])
    check_channel(model, "output", output, 1)
    if isinstance(model, Narx):
        check_channel(model, "input", input, model.structure.inputs)
        below, above = model.linear_part() if model.is_linear else linearised(model, around)[:2]
        polynomial = np.polynomial.polynomial.polyval
        return np.asarray(polynomial(z, above[input]) / polynomial(z, below), dtype=complex)
    check_channel(model, "input", input, 1)
    if isinstance(model, FeedbackModel):
        return _of_feedback(model, f, dt, around)
    if isinstance(model, Cascade):
        filters = [block for block in model.blocks if isinstance(block, Rational)]
        if filters:
            inside = dt / model.oversampling
            return np.asarray(z**model.delay * np.prod([block.response(f, inside) for block in filters], axis=0))
    if isinstance(model, GreyBox):
        part = model.plant.linearised(model.signals)
        if part is not None:
            s = np.asarray(2j * np.pi * f, dtype=complex)
            return _of_states(part.a, part.b[:, 0], part.c[0], float(part.d[0, 0]), s)
    raise ModelError(f"{model.name} has no frequency response: it is not linear")


def linearised(model: Narx, around: float) -> tuple[Array, Array, float]:
    """A (memory + 1,) and B (nu, memory + 1) of a regression in powers of q⁻¹ at its rest, and its output there.

    Raises:
        ModelError: where it does not come to rest at this input.
    """
    rest = _settled(model, around, model.structure.inputs)
    rows = np.zeros((1 + model.structure.inputs, model.structure.memory + 1))
    for regressor, value in zip(model.structure.regressors, model.parameters, strict=True):
        weight = -value if regressor.negative else value
        levels = [around if each.channel else rest for each in regressor.factors]
        factors = list(zip(regressor.factors, levels, strict=True))
        through = np.array([float(each.transform.definition(x, each.parameter)) for each, x in factors])
        powers = np.array([each.power for each in regressor.factors])
        for k, (each, x) in enumerate(factors):
            others = float(np.prod(np.delete(through**powers, k)))
            own = powers[k] * through[k] ** (powers[k] - 1) * slope(int(each.transform), x, each.parameter)
            rows[each.channel, each.lag] += weight * own * others
    below = -rows[0]
    below[0] = 1.0
    if np.abs(np.roots(below)).max(initial=0.0) >= 1.0:
        raise ModelError(f"{model.name} does not come to rest at an input of {around:g}: it is unstable there")
    return below, rows[1:], rest


def output_at_rest(model: Any, level: float) -> float:
    """The output of a model of one input and one output in its steady state at a constant input.

    Raises:
        ModelError: where it does not come to rest.
    """
    return linearised(model, level)[2] if isinstance(model, Narx) else _settled(model, level, 1)


def about_rest(model: FeedbackModel, level: float) -> tuple[Array, Array]:
    """The state (n,) at rest, and the linear part there, (n + 1, n + 1) from (x, u) to (x⁺, y)."""
    rest = model.resting(level)
    return rest, model.linearised_at(rest, level)[1]


def _settled(model: Any, level: float, inputs: int) -> float:
    """The first output in the steady state that a model reports, if it stays there.

    Raises:
        ModelError: where it does not.
    """
    late = model.latency
    out = model.run(model.at_rest(level), np.full((model.memory + late + 2, inputs), level))[0][late:, 0]
    if not np.isfinite(out).all() or np.ptp(out) > AT_REST * np.abs(out).max():
        raise ModelError(f"{model.name} does not come to rest at an input of {level:g}")
    return float(out[-1])


def check_channel(model: Any, what: str, number: int, count: int) -> None:
    """Refuse the number of an input or output that there is not.

    Raises:
        ModelError: with the numbers that there are.
    """
    if not 0 <= number < count:
        raise ModelError(f"{model.name}: {what} {number} of {count}; they count from 0", arguments=(what,))


def _of_feedback(model: FeedbackModel, f: Array, dt: float, around: float) -> Complex:
    """The response of a feedback model about the rest at an input."""
    n, steps = model.states, model.oversampling
    whole = about_rest(model, around)[1]
    a, b, c, d = whole[:n, :n], whole[:n, n], whole[n, :n], float(whole[n, n])
    rate = 1.0 if model.held else 1.0 / steps
    if model.held:
        powers = [np.linalg.matrix_power(a, k) for k in range(steps)]
        a, b = a @ powers[-1], np.sum(powers, axis=0) @ b
    shift = np.asarray(np.exp(2j * np.pi * f * dt * rate), dtype=complex)
    return np.asarray(np.exp(-2j * np.pi * f * dt * model.delay) * _of_states(a, b, c, d, shift))


def _of_states(a: Array, b: Array, c: Array, d: float, at: Complex) -> Complex:
    """(m,) C(sI − A)⁻¹B + D at complex numbers s (m,)."""
    n = len(a)
    states = np.linalg.solve(at[:, None, None] * np.eye(n) - a, np.broadcast_to(b[:, None], (len(at), n, 1)))
    return np.asarray((c @ states)[:, 0] + d)
