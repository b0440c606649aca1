"""Findings on what the records do not determine in a fitted cascade, and on maps with too few knots.

A map with few knots rounds its bends, and the residual r then depends on the input x of the map. Let F be the
derivative of the residual with respect to all parameters of the same cascade with another knot between each two. To
first order more knots lower the squares of r to min ‖r + Fp‖². Schwarz's criterion compares that with the same for the
parameters that the cascade has, both without penalties. The bends of any curve matter less the smaller they are, and a
long record shows all of them. So the error has to fall by a part that matters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.losses import SQUARES
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Array, Infeasible, linearised
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import FreeRun, freedom
from emsid.models.blocks.search.cross_validation import as_arrays
from emsid.models.blocks.static_maps import StaticMap
from emsid.record import Record
from emsid.selection.improvement import schwarz_gain

# A zero cancels a pole if their distance is below this fraction of the distance of the pole to the unit circle.
CANCELS = 0.05
# Too few knots are said where more of them lower the error by this part.
LEAST_FALL = 0.1


def advice(fit: Fit[Cascade], records: Record | Sequence[Record]) -> tuple[Finding, ...]:
    """Findings on what the records do not determine in a fitted cascade.

    Args:
        fit: the fitted cascade.
        records: the records that it was fitted to.
    """
    several = [records] if isinstance(records, Record) else list(records)
    model = fit.model
    pairs = as_arrays(several)
    findings: list[Finding] = []
    for k, block in enumerate(model.blocks):
        found: Sequence[Finding] = ()
        if isinstance(block, Rational):
            found = list(_cancellations(block))
        elif isinstance(block, StaticMap):
            found = block.findings(np.concatenate([model.signals_from_rest(u)[k] for u, _ in pairs]))
        findings += [replace(each, subject=model.name, data={"block": k + 1, **each.data}) for each in found]
    lost = [n for n, variance in zip(fit.names, np.diag(fit.covariance), strict=True) if not np.isfinite(variance)]
    if lost and fit.ending is not Ending.RANK_DEFICIENT:  # which has a finding of its own
        findings.append(Finding("parameters-without-interval", model.name, {"parameters": lost}))
    return tuple(findings)


def _cancellations(block: Rational) -> Iterator[Finding]:
    for pole in block.poles:
        if pole.imag < 0 or abs(pole) < 1e-6:
            continue
        if any(abs(zero - pole) < CANCELS * max(1 - abs(pole), 1e-3) for zero in block.zeros):
            yield Finding("zero-cancels-pole", data={"pole": [float(pole.real), float(pole.imag)]})


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
