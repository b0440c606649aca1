"""Whether the knots of a fitted map are too few: what more of them would explain of the residual.

A map with few knots rounds its bends, and the residual r then depends on the input x of the map. Let F be the
derivative of the residual with respect to all parameters of the same cascade with another knot between each two. To
first order more knots lower the squares of r to min ‖r + Fp‖². Schwarz's criterion compares that with the same for the
parameters that the cascade has, both without penalties.

The bends of any curve matter less the smaller they are, and a long record shows all of them. So the error has to fall
by a part that matters.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emsid.estimation.nonlinear.losses import SQUARES
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Array, Infeasible, linearised
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.blocks.fitting import FreeRun, freedom
from emsid.models.blocks.static_maps import StaticMap
from emsid.selection.improvement import schwarz_gain

LEAST_FALL = 0.1
"""Too few knots are said where more of them lower the error by this part."""


def too_few_knots(minimum: Minimum, problem: FreeRun) -> tuple[Finding, ...]:
    """A finding for every map whose residual more knots would explain.

    Args:
        minimum, problem: of a fit, from `search`.
    """
    cascade = problem.model(minimum.estimate)
    maps = [(k, block) for k, block in enumerate(cascade.blocks) if isinstance(block, StaticMap)]
    finer = [(k, new) for k, block in maps if (new := block.with_more_knots()) is not block]
    found: list[Finding] = []
    if not finer:
        return ()
    square, rank = _remaining(problem, minimum.estimate)
    independent = effective_samples(minimum.residuals)
    for k, block in finer:
        larger = replace(cascade, blocks=(*cascade.blocks[:k], block, *cascade.blocks[k + 1 :]))
        same = replace(problem, cascade=larger, freedom=freedom(larger))
        try:
            least, more = _remaining(same, same.at_start(problem.states(minimum.estimate)))
        except Infeasible:
            continue
        if 0 < least < square:
            saved = 1 - float(np.sqrt(least / square))
            if saved > LEAST_FALL and schwarz_gain(least, square, independent, more - rank) > 0:
                found.append(Finding("too-few-knots", problem.cascade.name, {"block": k + 1, "saved": saved}))
    return tuple(found)


def _remaining(problem: FreeRun, theta: Array) -> tuple[float, int]:
    """The least mean square of the linearised residual, and the rank of its derivative."""
    information = linearised(problem, theta, np.arange(len(theta)), SQUARES).information
    return float(information.factor[-1, -1] ** 2) / information.samples, information.solve().rank
