r"""Starts with friction that sticks: the speed of a linear model, which passes a dead zone in every step.

Coulomb friction takes a fixed amount of speed in a step, or all of it if there is less. With p, the speed that the
motor would have without friction at the end of a step, and a dead zone f whose half-width is that amount,

    y(t) = f(p(t))        p(t+1) = a·f(p(t)) + s(t)

where s is what drives the motor: f = 0 is a motor that stands still. A map beside a linear model cannot begin there, as
it acts a step later; it begins at a steep saturation of the speed, which creeps, and oscillates where it is steeper
than a step allows. But a linear model is the case of a dead zone without width: with its slowest real pole a,

    y(t+1) = a·y(t) + s(t),      s(t) = C(A − aI) x(t) + …

and s is the output of a system of the other states. So any linear model is a start, with the speed replaced by f(p).

**More steps.** Friction acts in each of them. With twice as many, the model is the square root of the one without
friction, A + B_w C_z, with half the width of the dead zone and again the speed replaced by f(p). The square root of A
itself does not exist: where the motor stands still nothing of its speed is left, so that A has a pole near zero.

References:
    Kikuuwe, Takesue, Sano, Mochiyama, Fujimoto, *Admittance and impedance representations of friction based on implicit
    Euler integration*, IEEE Transactions on Robotics 22 (2006).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.blocks.search.map_families import family_of
from emsid.models.blocks.static_maps import DeadZone
from emsid.models.feedback.coordinates import WORST_CONDITION, with_state
from emsid.models.feedback.fitting import Found
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.starts import with_steps_doubled

Array = NDArray[np.float64]

STICKING = family_of("dead-zone")
# The half-width of the dead zone that a fit begins with, over the root mean square change of the output in a step.
WIDTH = 0.3
# Beside a dead zone that a speed passes, the linear part has a pole whose size is smaller than this.
NOTHING_LEFT = 0.3
# A pole is real if its imaginary part is smaller than this.
REAL = 1e-9


def with_speed_that_sticks(linear: Found, measured: list[Array]) -> tuple[FeedbackModel, list[Array]]:
    """A linear model whose output passes a dead zone before it acts on the next step, and its states.

    Args:
        linear: with at least one state.
        measured: (N,) the output of every segment.

    Raises:
        ModelError: if it has no real pole, or its output does not show every state.
    """
    transform = _speed_and_drive(linear.model)
    model = with_state(linear.model, transform)
    n = model.states
    matrix = np.zeros((n + 2, n + 2))
    matrix[np.ix_([*range(n), n + 1], range(n + 1))] = model.matrix
    matrix[:, n + 1], matrix[:n, 0], matrix[n + 1, 0] = matrix[:, 0], 0.0, 0.0
    matrix[n, 0] = 1.0
    change = np.concatenate([np.diff(y) for y in measured])
    width = WIDTH * float(np.sqrt(np.mean(change**2))) / model.oversampling
    with_map = replace(
        model, matrix=matrix, maps=(DeadZone(-width, width),), map_offsets=np.zeros(1), factors=np.zeros(0)
    )
    return with_map, [transform @ x for x in linear.states]


def _speed_and_drive(model: FeedbackModel) -> Array:
    """(n, n) T to a state of the output C x and of the states that drive it, from which it takes nothing.

    Raises:
        ModelError: if there is no real pole, or the output does not show every state.
    """
    n = model.states
    a, c = model.matrix[:n, :n], model.matrix[-1, :n]
    poles = np.linalg.eigvals(a)
    real = poles[np.abs(poles.imag) < REAL].real
    if not len(real):
        raise ModelError(f"{model.name}: no speed that sticks, as the linear model only oscillates")
    rows = [c]
    driving = c @ a - real.max() * c
    for _ in range(n - 1):
        rows.append(driving)
        driving = driving @ a
    transform = np.array(rows)
    sizes = np.linalg.norm(transform[1:], axis=1, keepdims=True)
    transform[1:] /= np.where(sizes > 0, sizes, 1.0)
    if not np.linalg.cond(transform) < WORST_CONDITION:
        raise ModelError(f"{model.name}: no speed that sticks, as the output of the linear model hides a state")
    return transform


def sticking_map(model: FeedbackModel) -> int | None:
    """The dead zone that a speed passes in every step, so that the linear part beside it has a pole near zero.

    Returns:
        The map, from 0; None if there is none.
    """
    n = model.states
    if not n or _least_pole(model.matrix, n) > NOTHING_LEFT:
        return None
    for k, each in enumerate(model.maps):
        if isinstance(each, DeadZone) and _least_pole(_moving(model, each, k), n) > NOTHING_LEFT:
            return k
    return None


def with_sticking_steps_doubled(model: FeedbackModel, k: int, held: bool) -> FeedbackModel:
    """A start with twice as many steps per sample, in each of which the speed sticks.

    Args:
        model: with its maps.
        k: the dead zone that the speed passes.
        held: whether its input is held over the steps of a sample.

    Raises:
        ModelError: if a pole of the motion without friction is negative or zero.
    """
    n, zone, into = model.states, model.maps[k], model.matrix[model.states + k, : model.states + 1]
    assert isinstance(zone, DeadZone)
    faster = with_steps_doubled(replace(model, matrix=_moving(model, zone, k)), held)
    poles, directions = np.linalg.eig(model.matrix[:n, :n])
    speed = np.real(directions[:, np.argmin(np.abs(poles))])
    matrix = faster.matrix.copy()
    matrix[:n, n + 1 + k] = matrix[:n, :n] @ speed / (_slope(zone) * float(into[:n] @ speed))
    matrix[:n, : n + 1] -= _slope(zone) * np.outer(matrix[:n, n + 1 + k], into)
    still = float(model.map_offsets[k])  # z at standstill
    narrower = replace(zone, b_l=0.5 * (zone.b_l + still), b_r=0.5 * (zone.b_r + still))
    return replace(faster, matrix=matrix, maps=(*model.maps[:k], narrower, *model.maps[k + 1 :]))


def _moving(model: FeedbackModel, zone: DeadZone, k: int) -> Array:
    """M with the line of a dead zone of no width in place of the zone, in the rows of the state."""
    n, matrix = model.states, model.matrix.copy()
    matrix[:n, : n + 1] += _slope(zone) * np.outer(matrix[:n, n + 1 + k], matrix[n + k, : n + 1])
    return matrix


def _slope(zone: DeadZone) -> float:
    return 0.5 * (zone.m_l + zone.m_r)


def _least_pole(matrix: Array, n: int) -> float:
    return float(np.abs(np.linalg.eigvals(matrix[:n, :n])).min())
