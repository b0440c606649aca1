r"""The bend of a narrow valley, which damped Gauss–Newton steps follow.

Where few data distinguish two parameters, the minimum lies at the end of a narrow valley. A step along its tangent
leaves it where it bends, so that the damping keeps all steps short, and a search uses up its steps before the minimum.
The residual along a step p is r + Jp·s + ½r″s², with the second derivative from one residual more,

    r″ = (2/h)·((r(θ + hp) − r(θ))/h − Jp).

The step that lowers it most has a second part,

    q = −½(JᵀWJ + λD²)⁻¹ JᵀW r″,

the geodesic acceleration of Transtrum and Sethna. It is an extrapolation, of use while q is small beside p.

References:
    Transtrum, Sethna, *Improvements to the Levenberg–Marquardt algorithm for nonlinear least-squares minimization*,
    arXiv:1201.5885 (2012).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.losses import Loss
from emsid.estimation.nonlinear.problem import Block, Indices, Infeasible, Problem

Array = NDArray[np.float64]

# h, the part of a step that the second derivative is taken over, and the largest length of q over that of p.
ALONG, LONGEST = 0.1, 0.375


def acceleration(
    problem: Problem,
    theta: Array,
    blocks: Sequence[Block],
    loss: Loss,
    varied: Indices,
    triangle: Array,
    scale: Array,
    step: Array,
) -> Array | None:
    """(n,) q for a damped step; None where there is no residual along it, or q is not small.

    Args:
        problem: of the residuals.
        theta: (p,) θ.
        blocks: residual and derivative there, of every experiment.
        loss: with the weights W.
        varied: (n,) the parameters that the step moves.
        triangle: (n, n) the factor of JᵀWJ + λD².
        scale: (n,) D, in which lengths are compared.
        step: (n,) p.
    """
    from scipy.linalg.lapack import dtrtrs

    whole = np.zeros(len(theta))
    whole[varied] = step
    try:
        there = problem.residuals(theta + ALONG * whole)
    except Infeasible:
        return None
    slope = np.zeros(len(theta))
    with np.errstate(all="ignore"):
        for (residual, jacobian), after in zip(blocks, there, strict=True):
            second = 2 / ALONG * ((after - residual) / ALONG - jacobian @ whole)
            slope += jacobian.T @ (loss.weight(residual) * second)
        bend = -0.5 * dtrtrs(triangle, dtrtrs(triangle, slope[varied], trans=1)[0])[0]
        small = np.linalg.norm(scale * bend) <= LONGEST * np.linalg.norm(scale * step)
    return bend if small else None
