"""Whether the knots of a fitted map are too few: what more of them would explain of the residual.

A map with few knots rounds its bends, and the residual r then depends on the input x of the map. Let F be the
derivative of the residual with respect to all parameters of the same cascade with another knot between each two. To
first order more knots lower the squares of r to min ‖r + Fp‖². Schwarz's criterion compares that with the same for the
parameters that the cascade has, both without penalties.

The bends of any curve matter less the smaller they are, and a long record shows all of them. So the error has to fall
by a part that matters. Where the number of knots is not given, those knots of a spline that have data around them are
added, as long as Schwarz's criterion prefers the fit with them: at little noise a kink needs more knots than most maps
do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, Unpack

import numpy as np

from emsid.estimation.nonlinear.control import FREE
from emsid.estimation.nonlinear.losses import SQUARES
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Array, Infeasible, linearised
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.fitting import FreeRun, Search, freedom
from emsid.models.blocks.search.orders import SAMPLES_PER_PARAMETER
from emsid.models.blocks.search.refinement import Found, searched
from emsid.models.blocks.static_maps import CubicSpline, StaticMap
from emsid.models.blocks.static_maps.through_points import with_data
from emsid.selection.improvement import matters, schwarz_gain

LEAST_FALL = 0.1
"""Too few knots are said where more of them lower the error by this part."""
ADDED_FALL = 0.03
"""Knots are added where they lower the error by this part, besides what as many parameters explain by chance."""
MOST_KNOTS = 160
"""A map gets no more knots than this."""


class Finer(NamedTuple):
    """A cascade with more knots in one map.

    Attributes:
        block: the index of the map.
        cascade: it has the same curves, and another knot between each two of this map.
        saved: by which part these knots lower the error, to first order.
        beyond_chance: the same without what as many parameters explain by chance.
        evident: whether Schwarz's criterion prefers them, without a penalty on either.
    """

    block: int
    cascade: Cascade
    saved: float
    beyond_chance: float
    evident: bool


def too_few_knots(minimum: Minimum, problem: FreeRun) -> tuple[Finding, ...]:
    """A finding for every map whose residual more knots would explain.

    Args:
        minimum, problem: of a fit, from `search`.
    """
    name = problem.cascade.name
    few = (each for each in _finer(minimum, problem) if each.evident and each.saved > LEAST_FALL)
    return tuple(Finding("too-few-knots", name, {"block": each.block + 1, "saved": each.saved}) for each in few)


def with_enough_knots(found: Found, **how: Unpack[Search]) -> Found:
    """The fit, or one whose splines have about twice the knots, and twice again, while Schwarz's criterion prefers it.

    Args:
        found: from `searched`.
        how: of further searches.
    """
    while (start := _with_finer_map(found)) is not None:
        larger = searched(start, found.records, **how)
        before, after = (2 * each.minimum.cost / each.minimum.samples for each in (found, larger))
        independent, more = effective_samples(larger.minimum.residuals), larger.determined - found.determined
        clear = schwarz_gain(after, before, independent, more) > 0
        if how.get("control", FREE).ending or not clear or not _less_noise(larger, found):
            break
        found = larger
    return found


def _less_noise(larger: Found, found: Found) -> bool:
    """Whether the variance of the noise falls by a part that matters: of a short record knots explain some of it."""
    return matters(larger.minimum.noise_variance, found.minimum.noise_variance)


def _with_finer_map(found: Found) -> Cascade | None:
    """The cascade with more knots in the spline where they lower the error most; None if they do in no map."""
    finer = (each for each in _finer(found.minimum, found.problem) if each.beyond_chance > ADDED_FALL)
    options = [each for each in finer if _has_room(each.cascade.blocks[each.block], found)]
    if not options:
        return None
    chosen = max(options, key=lambda option: option.saved)
    start, k = _where_data_are(chosen, found), chosen.block
    return start if len(start.blocks[k].parameters) > len(found.model.blocks[k].parameters) else None


def _where_data_are(finer: Finer, found: Found) -> Cascade:
    """The cascade with more knots, without those around which there are hardly any data."""
    k, spline = finer.block, finer.cascade.blocks[finer.block]
    assert isinstance(spline, CubicSpline)
    runs = zip(found.problem.segments, found.problem.states(found.minimum.estimate), strict=True)
    knots = with_data(spline.knots, np.concatenate([found.model.signals(u, states)[k] for (u, _), states in runs]))
    blocks = finer.cascade.blocks
    return replace(finer.cascade, blocks=(*blocks[:k], CubicSpline(knots, spline.value(knots)), *blocks[k + 1 :]))


def _has_room(block: object, found: Found) -> bool:
    """Whether a map is a spline of at most `MOST_KNOTS` knots, and has enough samples for each."""
    if not isinstance(block, CubicSpline):
        return False
    return block.size <= min(MOST_KNOTS, found.minimum.samples / SAMPLES_PER_PARAMETER)


def _finer(minimum: Minimum, problem: FreeRun) -> Iterator[Finer]:
    """For every map, the cascade with more knots in it, where they explain a part of the residual."""
    cascade = problem.model(minimum.estimate)
    maps = [(k, block) for k, block in enumerate(cascade.blocks) if isinstance(block, StaticMap)]
    finer = [(k, new) for k, block in maps if (new := block.with_more_knots()) is not block]
    if not finer:
        return
    square, rank = _remaining(problem, minimum.estimate)
    independent = effective_samples(minimum.residuals)
    for k, block in finer:
        larger = replace(cascade, blocks=(*cascade.blocks[:k], block, *cascade.blocks[k + 1 :]))
        same = replace(problem, cascade=larger, freedom=freedom(larger))
        theta = same.at_start(problem.states(minimum.estimate))
        try:
            least, more = _remaining(same, theta)
        except Infeasible:
            continue
        if 0 < least < square:
            added, left = more - rank, minimum.samples - rank
            by_chance = max(left - added, 1) / max(left, 1)
            saved, beyond = (1 - float(np.sqrt(part)) for part in (least / square, least / square / by_chance))
            yield Finer(k, larger, saved, beyond, schwarz_gain(least, square, independent, added) > 0)


def _remaining(problem: FreeRun, theta: Array) -> tuple[float, int]:
    """The least mean square of the linearised residual, and the rank of its derivative."""
    information = linearised(problem, theta, np.arange(len(theta)), SQUARES).information
    return float(information.factor[-1, -1] ** 2) / information.samples, information.solve().rank
