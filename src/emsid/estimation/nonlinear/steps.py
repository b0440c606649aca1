"""The step of a linearised least-squares problem, and the reduction of the cost that it predicts.

The problem is the triangular factor [R z] of `Information`: min over p ‖z − Rp‖.
"""

from __future__ import annotations

from functools import partial
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.information import Information

Array = NDArray[np.float64]

# A singular value below this fraction (times n) of the largest is rounding; steps have no component along it.
RANK = 4 * float(np.finfo(float).eps)


def least_squares_step(information: Information) -> Array:
    """The shortest p, in units of the columns' lengths, that minimises ‖z − Rp‖; without covariance or rank."""
    from scipy.linalg.lapack import dtrcon, dtrtrs

    triangle, projected, length = _scaled(information)
    if not len(length):
        return length
    smallest = RANK * len(length)
    well_conditioned = dtrcon(triangle)[0] > smallest * len(length)  # the 1-norm estimate needs a margin of n
    solve = dtrtrs if well_conditioned else partial(np.linalg.lstsq, rcond=smallest)
    step: Array = solve(triangle, projected)[0] / length
    return step


def _scaled(information: Information) -> tuple[Array, Array, Array]:
    """R scaled to columns of unit length, z, and the lengths of the columns of R."""
    n = information.parameters
    triangle, projected = information.factor[:n, :n], information.factor[:n, n]
    length = np.sqrt(np.einsum("ij,ij->j", triangle, triangle))
    length[length == 0] = 1.0
    return triangle / length, projected, length


def bounded_step(information: Information, lower: Array, upper: Array) -> Array:
    """The p that minimises ‖z − Rp‖ within bounds, which contain zero."""
    step = least_squares_step(information)
    if (lower <= step).all() and (step <= upper).all():
        return step
    triangle, projected, length = _scaled(information)
    within = _within(triangle, projected, lower * length, upper * length, step * length)
    return np.clip(within / length, lower, upper)


def _within(triangle: Array, projected: Array, lower: Array, upper: Array, start: Array) -> Array:
    """The q that minimises ‖z − Rq‖ within bounds, by an active set; Stark and Parker, Comput. Stat. 10 (1995).

    The elements at a bound are fixed, and the others minimise. Where one of these leaves its bounds, q moves until the
    first one is at its bound. Where none does, the element at a bound with the steepest slope inwards is released.
    `scipy.optimize` has such a solver, but takes a tenth of a second to import.
    """
    q = np.clip(start, lower, upper)
    side = (q == upper).astype(int) - (q == lower)  # 1 at the upper bound, −1 at the lower one
    for _ in range(10 * len(q)):
        free = side == 0
        rest = projected - triangle[:, ~free] @ q[~free]
        minimum = q.copy()
        minimum[free] = np.linalg.lstsq(triangle[:, free], rest, rcond=None)[0]
        beyond = np.flatnonzero((minimum < lower) | (minimum > upper))
        if len(beyond):
            bound = np.where(minimum > upper, upper, lower)[beyond]
            shares = (bound - q[beyond]) / (minimum - q)[beyond]
            first = int(np.argmin(shares))
            q = np.clip(q + shares[first] * (minimum - q), lower, upper)
            q[beyond[first]] = bound[first]
            side[beyond[first]] = 1 if minimum[beyond[first]] > bound[first] else -1
            continue
        q = minimum
        slope = -side * (triangle.T @ (projected - triangle @ q))
        if slope.max() <= RANK * np.linalg.norm(projected):
            break
        side[np.argmax(slope)] = 0
    return q


def promised(information: Information, step: Array) -> float:
    """½‖z‖² − ½‖z − Rp‖²: the reduction of the linearised cost by the step."""
    n = information.parameters
    triangle, projected = information.factor[:n, :n], information.factor[:n, n]
    moved = triangle @ step
    return float(moved @ (projected - 0.5 * moved))


def relative_offset(information: Information, step: Array, noise: float) -> float:
    """Length of a step in standard errors, (‖Rp‖/√n)/(‖r‖/√(N − n)); infinite if only r is zero."""
    n = information.parameters
    moved, residual = information.factor[:n, :n] @ step, information.factor[:, n]
    length = sqrt(moved @ moved)
    if length == 0.0:
        return 0.0
    error = max(sqrt(residual @ residual) / sqrt(max(information.samples - n, 1)), noise)
    return length / sqrt(n) / error if error else inf
