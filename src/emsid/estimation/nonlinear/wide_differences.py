r"""Derivatives by differences over the uncertainty of an estimate, for residuals that jump.

A free run with a jump inside, such as friction by the sign of a speed, jumps wherever the sign of a sample changes.
Between such places its derivative is exact, and does not contain how the samples at which signs change move with θ. The
cost has a minimum of its own in many of the pieces, and a search by this derivative ends in one of those near its
start: estimates that are worse than their covariance says, as that is of a piece. Over a range in which many signs
change, the mean derivative contains these moves. With J = U S Vᵀ and the standard deviation σ of the residual, one
standard error in the direction wᵢ = Vᵢ/sᵢ is σ, and

    ∂r/∂θ ≈ Σᵢ (r(θ + hσwᵢ) − r(θ − hσwᵢ)) / (2hσ) · sᵢVᵢᵀ

is the mean derivative over h standard errors to both sides. A search with h from large to small passes the minima of
single pieces, as graduated optimisation does (Blake, Zisserman, *Visual Reconstruction*, 1987); from its end, one by
the exact derivative goes to the minimum of the last piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from emsid.estimation.nonlinear.problem import Array, Block, Infeasible, Problem
from emsid.estimation.uncertainty.coloured_residuals import effective_samples

WIDTHS = (8.0, 4.0, 2.0, 1.0)
"""h of one search after another, in standard errors."""
BEYOND = 10.0
"""A residual on either side that is larger by this factor than the linearised one is that of a run that diverges."""
LEAST = 1e-8
"""Directions with a singular value below this part of the largest keep their exact derivative."""


@dataclass(frozen=True, eq=False)
class Widened:
    """A problem with the mean derivative over ``width`` standard errors to both sides.

    Attributes:
        problem: with residuals and the exact derivative between jumps.
        width: h.
    """

    problem: Problem
    width: float

    def residuals(self, theta: Array) -> Sequence[Array]:
        """Those of the problem."""
        return self.problem.residuals(theta)

    def linearised(self, theta: Array) -> list[Block]:
        """The residuals with the mean derivatives; exact ones in directions without a residual on either side."""
        blocks = list(self.problem.linearised(theta))
        residual = np.concatenate([r for r, _ in blocks])
        _, sizes, axes = np.linalg.svd(np.linalg.qr(np.concatenate([j for _, j in blocks]), mode="r"))
        reach = self.width * float(np.sqrt(residual @ residual / effective_samples([r for r, _ in blocks])))
        found = [jacobian.copy() for _, jacobian in blocks]
        for size, axis in zip(sizes, axes, strict=True):
            if not (reach > 0 and size > LEAST * sizes[0]):
                continue
            step = reach / size * axis
            try:
                with np.errstate(over="ignore"):
                    sides = [self.problem.residuals(theta + step), self.problem.residuals(theta - step)]
                    most = max(np.sqrt(sum(r @ r for r in side)) for side in sides)
            except Infeasible:
                continue
            if not most <= BEYOND * (np.linalg.norm(residual) + reach):
                continue
            for jacobian, (_, exact), ahead, behind in zip(found, blocks, *sides, strict=True):
                mean = (ahead - behind) * (size / (2 * reach))
                if np.isfinite(mean).all():
                    jacobian += np.outer(mean - exact @ axis, axis)
        return [(r, jacobian) for (r, _), jacobian in zip(blocks, found, strict=True)]
