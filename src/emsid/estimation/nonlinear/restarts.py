"""Restarts around the end of a search that did not converge.

The free run of a model with kinks is not smooth, and its valleys are narrow and bent: a search may stall, or use up its
steps, near a minimum or at a point where the derivative predicts a descent that does not exist. Searches from points
drawn around that end, along its covariance, either find a minimum, or agree on where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import SQUARES, Problem, trial_cost
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding

Array = NDArray[np.float64]

RESTARTS = 6
"""How often a search that stalled begins again."""
SAME = 0.01
"""Ends of searches whose costs differ by less than this part are in the same minimum."""
CLOSE = 0.5
"""So are ends whose costs differ by less than a move by this many standard errors changes the cost."""
AGREEING = 3
"""How many searches must end in the same minimum as one that stalled, so that this counts as converged."""
TURNS = 3
"""The most rounds of restarts around the end of a search that has not converged, as long as too few ends agree."""
ITERATIONS, SLOW = 25, 1e-3
"""The most steps of a search that is begun again; it ends where several together lower the cost by less than this."""
FAR = 2.0
"""How many standard deviations away a search is begun again."""
HIGH, HALVED = 4.0, 8
"""The most that the cost at such a point may be over that of the end, and how often `nearer` halves the way to it."""


class Search(Protocol):
    """A search from θ, with options of `gauss_newton`."""

    def __call__(self, theta: Array, **options: Any) -> Minimum:
        """Where it ends."""
        ...


def drawn(slopes: Array, residuals: Sequence[Array], rng: np.random.Generator, most: ArrayLike = np.inf) -> Array:
    """(p,) a draw from `FAR` times the covariance of an estimate in coloured noise.

    Along what the data hardly determine, the covariance is that of a straight line that the residual does not follow
    so far. So no direction may move a parameter by more than is plausible.

    Args:
        slopes: (N, p) derivative of the residual, or its triangular factor.
        residuals: (Nᵢ,) of every experiment.
        rng: source of random numbers.
        most: (p,) by how much a parameter may be moved along one direction.
    """
    sizes = np.linalg.norm(slopes, axis=0)
    sizes[sizes == 0] = 1.0
    _, lengths, axes = np.linalg.svd(slopes / sizes, full_matrices=False)
    square = sum(float(residual @ residual) for residual in residuals)
    draw = rng.standard_normal(len(lengths)) / np.maximum(lengths, 1e-8 * lengths[0])
    moves = FAR * np.sqrt(square / effective_samples(residuals)) * (axes.T * draw) / sizes[:, None]
    beyond = np.max(np.abs(moves) / np.broadcast_to(most, sizes.shape)[:, None], axis=0)
    return np.asarray((moves / np.maximum(beyond, 1.0)).sum(axis=1))


def nearer(problem: Problem, theta: Array, minimum: Minimum) -> Array:
    """(p,) a point that a search begins at, or one on the way to it whose cost is not far above that of a minimum.

    Where the run is not smooth, or a valley narrow, it may diverge at a draw from the covariance.

    Args:
        problem: of the search.
        theta: (p,) the point.
        minimum: where the search ended.
    """
    for _ in range(HALVED):
        if trial_cost(problem, theta, SQUARES) <= HIGH * minimum.cost:
            break
        theta = 0.5 * (theta + minimum.estimate)
    return theta


Ends = Sequence[tuple[float, Array]]
"""The cost and the leading parameters of searches."""


def begun_again(minimum: Minimum, search: Search, own: int, control: Control = FREE) -> Minimum:
    """The end of a search that did not converge, or a better one of others that begin around it.

    If the best one does not converge either, others that end with the same cost make up for it, see `confirmed`. A
    search that converged, or that was stopped, is returned as it is. The arguments are those of `begun_around`.
    """
    return confirmed(*begun_around(minimum, search, own, control))


def begun_around(
    minimum: Minimum,
    search: Search,
    own: int,
    control: Control = FREE,
    *,
    around: Search | None = None,
    turns: int = 1,
) -> tuple[Minimum, Ends]:
    """The best end of a search that did not converge and of others that begin around it, and the ends of the others.

    The others are quick. From the best of them the search goes on in full.

    Args:
        minimum: the end of the search.
        search: a search from θ, with the options of `gauss_newton` that it is given.
        own: the number of parameters, before initial states, that ends are compared in.
        control: when to stop.
        around: how the others search, if not like ``search``.
        turns: the most rounds of others, each from the end of the one before, until enough of all end with one cost.
    """
    search_around, rng = around or search, np.random.default_rng(0)
    ends: list[tuple[float, Array]] = []
    for _ in range(turns):
        if minimum.ending not in (Ending.STALLED, Ending.OUT_OF_BUDGET) or control.ending is not None:
            break
        begin = best = minimum
        for _ in range(RESTARTS):
            if control.ending is not None or len(_same(best, ends)) >= AGREEING:
                break
            step = np.zeros(len(begin.estimate))
            step[begin.free] = drawn(begin.information.factor[:-1, :-1], begin.residuals, rng)
            with suppress(EmsidError):
                again = search_around(
                    begin.estimate + step, max_iterations=ITERATIONS, least_saving=SLOW, covariances=False
                )
                ends.append((again.cost, again.estimate[:own]))
                best = min(best, again, key=lambda each: each.cost)
        if control.ending is None and (best.cost < (1 - SLOW) * begin.cost or begin.ending is Ending.OUT_OF_BUDGET):
            minimum = min(minimum, search(best.estimate), key=lambda each: each.cost)
        if confirmed(minimum, ends).ending is Ending.CONVERGED:
            break
    return minimum, ends


def _same(minimum: Minimum, ends: Ends, part: float = SAME) -> list[Array]:
    """The ends in the same minimum: the cost is higher by no more than this part."""
    return [values for cost, values in ends if cost <= (1 + part) * minimum.cost]


def confirmed(minimum: Minimum, ends: Ends) -> Minimum:
    """A search that stalled, with how many of those that began around its end ended with the same cost.

    It counts as converged if there are enough of these, and none found a lower cost.

    The error of a free run is not smooth where the motion sticks for one value and slides for the next, so that the
    derivative predicts a descent that does not exist. The estimates of ends with the same cost differ by more than the
    derivative says; their spread is added to the covariance.

    Costs V count as equal if their difference is not significant. If the residual has n independent samples, V is
    higher by the share k²/n at k standard errors from the minimum. For a slow residual that is more than `SAME`.

    Args:
        minimum: the end of the search.
        ends: cost and leading parameters of the others.
    """
    if minimum.ending is not Ending.STALLED or not ends:
        return minimum
    same = _same(minimum, ends, max(SAME, CLOSE**2 / effective_samples(minimum.residuals)))
    agreement = {"starts": len(ends) + 1, "agreeing": len(same) + 1}

    def said(finding: Finding) -> tuple[Finding, ...]:
        return tuple(finding if each.code == "search-stalled" else each for each in minimum.findings)

    if len(same) < AGREEING or not np.isfinite(minimum.covariance).all():
        stalls = (each.data for each in minimum.findings if each.code == "search-stalled")
        return replace(minimum, findings=said(Finding("search-stalled", "", {**next(stalls, {}), **agreement})))
    count = len(same[0])
    apart = np.zeros((len(minimum.estimate), len(same)))
    apart[:count] = np.array(same).T - minimum.estimate[:count, None]
    apart[~minimum.free] = 0.0
    findings = said(Finding("minimum-not-smooth", "", agreement))
    spread = minimum.covariance + apart @ apart.T / len(same)
    return replace(minimum, ending=Ending.CONVERGED, covariance=spread, findings=findings)
