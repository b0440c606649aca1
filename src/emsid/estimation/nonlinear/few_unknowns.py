"""Nonlinear least squares with few unknowns, without bounds: the initial state of a free run.

A search over models estimates thousands of such states, each from some tens of samples. There `gauss_newton` spends
most of its time on what a state does not need: bounds, losses, penalties, findings, covariances, reports. The step and
the end are the same; the first trial of every step is undamped, which solves a linear problem at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.gauss_newton import MOST_DAMPING, ROUNDING
from emsid.estimation.nonlinear.problem import SQUARES, Block, Problem, trial_cost
from emsid.estimation.nonlinear.steps import least_squares_step, promised, relative_offset

Array = NDArray[np.float64]

# The damping after an undamped trial that fails; a smaller one is as good as none.
FIRST_DAMPING = 1e-3
# The sum of the squares of smaller numbers is finite, also with the largest damping.
SQUARABLE = 1e140


def few_unknowns(problem: Problem, start: Array, *, max_iterations: int, tolerance: float) -> tuple[Array, list[Array]]:
    """The θ (p,) that minimises ½Σ r(θ)² from a start, and the residuals there.

    Args:
        problem: as for `gauss_newton`.
        start: (p,) to start from.
        max_iterations: the largest number of steps.
        tolerance: length of the remaining step, in standard errors, at which the search ends.

    Raises:
        ModelError: by ``problem`` at the start, or where the residual or its derivative is not finite.
    """
    theta, damping, scale = start, 0.0, np.zeros(len(start))
    for step in range(max_iterations + 1):
        blocks = problem.linearised(theta)
        information = _information(blocks, len(theta))
        triangle = information.factor[:-1, :-1]
        remaining = least_squares_step(information)
        if step == max_iterations or relative_offset(information, remaining, 0.0) <= tolerance:
            break
        cost = 0.5 * float(sum(residual @ residual for residual, _ in blocks))
        scale = np.maximum(scale, np.sqrt(np.einsum("ij,ij->j", triangle, triangle)))
        following, damping = _lower(problem, theta, cost, information, remaining, scale, damping)
        if following is None:
            break
        theta = following
    return theta, [residual for residual, _ in blocks]


def _information(blocks: Sequence[Block], count: int) -> Information:
    columns = np.empty((count + 1, sum(len(residual) for residual, _ in blocks)))
    first = 0
    for residual, jacobian in blocks:
        rows = slice(first, first + len(residual))
        columns[:-1, rows], columns[-1, rows] = jacobian.T, -residual
        first = rows.stop
    if not np.abs(columns).max(initial=0.0) < SQUARABLE:  # nor for NaN
        raise ModelError("the residual or its derivative is not finite; check the data and the start values")
    return Information.empty(count).add_columns(columns)


def _lower(
    problem: Problem,
    theta: Array,
    cost: float,
    information: Information,
    undamped: Array,
    scale: Array,
    damping: float,
) -> tuple[Array | None, float]:
    """A θ with a lower cost and the next damping; None if no step lowers the cost."""
    growth, step = 2.0, undamped
    while damping < MOST_DAMPING:
        if damping:
            step = least_squares_step(information.with_prior(damping * scale**2))
        saving = promised(information, step)
        if saving <= ROUNDING * cost:
            break
        ratio = (cost - trial_cost(problem, theta + step, SQUARES)) / saving
        if ratio > 0:
            damping *= max(0.1, 1 - (2 * min(ratio, 1.0) - 1) ** 3)
            return theta + step, damping if damping >= FIRST_DAMPING else 0.0
        damping, growth = (damping * growth, 2 * growth) if damping else (FIRST_DAMPING, growth)
    return None, damping
