"""The step of a linearised least-squares problem, and what it is worth.

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
    from scipy.optimize import lsq_linear  # takes a fifth of a second, and most searches meet no bound

    triangle, projected, length = _scaled(information)
    bounds = lower * length, upper * length
    found = lsq_linear(triangle, projected, bounds, method="bvls", tol=1e-15, max_iter=10 * len(length))
    bounded: Array = np.clip(found.x / length, lower, upper)
    return bounded


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
