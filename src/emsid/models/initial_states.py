"""The states that a free run begins with, estimated from the first samples of a segment.

A few samples hardly determine the state of a slow pole, and its error would last long. So the estimate has a prior,
mean m and covariance C of the states that this input produces, weighted by the variance σ² of the residual:

    Σ (y − ŷ(x))² + σ² (x − m)ᵀ C⁻¹ (x − m).

The variance σ² is not known in advance, and the sum has several minima for a model that does not depend on the sign of
a signal. Short searches therefore begin at those reachable states that fit best and differ from each other. Their σ² is
the error of the best of these states, which is too large. One more search begins at the best state with a very small
σ². The least residual of all searches gives σ²; every search continues with it, and the least sum is the estimate.
Where its residual is much smaller, σ² was too large, and the search continues from there with the smaller one.

A record can begin in a state that its input never leads to again, such as the level of a tank that overflows from then
on. There a limit may hide the state, so that no search leads away from the reachable ones; where states farther from
their mean fit far better than each of them, the searches begin at these. A normal distribution also all but excludes
such a state. So the estimate is compared with the minimum x₀ of a search with a weak prior, by the likelihood of the f
samples that the states leave and Student's distribution, ν = 4, of the distance d in standard deviations,

    f log Σ (y − ŷ)² + (n + ν) log(1 + d²/ν);

where x₀ is better, the prior is multiplied by (n + ν)/(ν + d₀²) and the search continues from there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.few_unknowns import few_unknowns

Array = NDArray[np.float64]

# Weight of the state at rest where the prior is weak, relative to the samples of the start; the second one where the
# result only says which σ² the samples allow.
REST, HARDLY = 1e-2, 1e-5
# The degrees of freedom ν of Student's distribution of a state: few make distant ones possible.
TAILS = 4
# Effort: within half a standard error for the first searches, and then within a twentieth; with a weak prior within a
# twentieth from the start, since σ² follows from its residual.
LOOSE: dict[str, Any] = {"max_iterations": 30, "tolerance": 0.05}
FIRST_LOOK: dict[str, Any] = {"max_iterations": 6, "tolerance": 0.5}
START_BUDGET: dict[str, Any] = {"max_iterations": 8, "tolerance": 0.05}
# Rounds of searches, and the share of the squared residual before above which one is the last.
ROUNDS, SETTLED = 6, 0.8
# At most this many reachable states are compared; the searches begin at this many of them.
TRIAL_STATES, STARTS = 64, 3
# Reachable states are collected over this many samples; the least relative spread of them in any direction.
REACHABLE_SAMPLES, LEAST_SPREAD = 10_000, 1e-12
# By how much states are farther from the mean that are compared too, and the share of the least squared error of the
# reachable ones below which they are begun at.
FARTHER, FAR_BETTER = (4.0, 16.0, 64.0, 256.0), 0.5


class Startable(Protocol):
    """What the estimation of states needs of a model."""

    @property
    def states(self) -> int:
        """How many there are, n."""
        ...

    @property
    def edge(self) -> int:
        """Samples at the start of a segment that do not count, as the input before them is not known."""
        ...

    def resting(self, level: float) -> Array:
        """(n,) the states at rest with a constant input."""
        ...

    def reachable(self, u: Array) -> Array:
        """(K, n) states that an input (N,) produces."""
        ...

    def output(self, u: Array, states: Array) -> Array:
        """(N,) the free run from an input (N,) and states (n,)."""
        ...

    def outputs(self, u: Array, states: Array) -> Array:
        """(k, N) the free runs from several states (k, n); not finite from where a run diverges."""
        ...

    def with_state_gradient(self, u: Array, states: Array) -> tuple[Array, Array]:
        """(N,) the free run, and (N, n) its derivative with respect to the states."""
        ...


@dataclass(frozen=True, eq=False)
class _Start:
    """The least-squares problem for the states of one segment, with a prior ‖firmness·(states − centre)‖."""

    model: Startable
    u: Array
    y: Array
    centre: Array
    firmness: Array

    def residuals(self, theta: Array) -> list[Array]:
        error = self.model.output(self.u, theta) - self.y
        return [error[self.model.edge :], self.firmness @ (theta - self.centre)]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        (y, rows), edge = self.model.with_state_gradient(self.u, theta), self.model.edge
        return [((y - self.y)[edge:], rows[edge:]), (self.firmness @ (theta - self.centre), self.firmness)]


Found = tuple[Array, list[Array]]
"""States, and their residuals: of the samples and of the prior."""


@np.errstate(over="ignore", invalid="ignore")  # a state whose run overflows is found by its error, and left out
def initial_state(model: Startable, u: Array, y: Array, quick: bool = False) -> Array:
    """(n,) the states at the first sample of a segment.

    Args:
        model: with parameters.
        u: (N,) input of the segment.
        y: (m ≤ N,) measured output of its first samples; without it, the states at rest are returned.
        quick: search from the best reachable state only, at first with a weak prior, in a quarter of the time: for
            a fit, which goes on to estimate the states.
    """
    rest = model.resting(float(u[0])) if len(u) else np.zeros(model.states)
    if not (model.states and len(y)):
        return rest
    u = np.ascontiguousarray(u)
    begin, cloud = u[: len(y)], model.reachable(u[:REACHABLE_SAMPLES])
    trials = np.vstack([rest, cloud[:: -(-len(cloud) // TRIAL_STATES) or 1]])
    missed = _missed(model, begin, y, trials)
    finite = np.isfinite(missed)
    if not finite.any():
        return rest
    starts, least = _apart(trials[finite], missed[finite]), float(missed[finite].min())
    if not quick:
        starts = [*_far_starts(model, begin, y, trials, least), *starts]
    freedom = len(y) - model.edge - model.states
    centre, size, axes = _prior(cloud)
    known = freedom > 0 and size[-1] > 0

    def weighted(variance: float) -> _Start:
        firmness = np.sqrt(variance / np.maximum(size, LEAST_SPREAD * size[-1]))[:, None] * axes.T
        return _Start(model, begin, y, centre, firmness)

    rows = model.with_state_gradient(begin, starts[0])[1][model.edge :]
    weight, effort = (HARDLY, LOOSE) if known and not quick else (REST, FIRST_LOOK)
    loose = _Start(model, begin, y, rest, np.diag(weight * np.linalg.norm(rows, axis=0)))
    found = list(_searched(loose, starts[:1], effort))
    if known and not quick:
        found += _searched(weighted(least / freedom), starts, FIRST_LOOK)
    if not found:
        return starts[0]
    if not known:
        return min(found, key=_of_samples)[0]
    estimate = _agreeing(weighted, found, freedom)
    return estimate[0] if quick else _or_far(weighted, estimate, found[0], freedom)


def _or_far(weighted: Callable[[float], _Start], estimate: Found, loose: Found, freedom: int) -> Array:
    """(n,) the estimate, or the states near the minimum with a weak prior if a heavy-tailed prior prefers these."""
    prior, count = weighted(1.0), len(estimate[0])

    def distance(found: Found) -> float:
        return float(np.sum((prior.firmness @ (found[0] - prior.centre)) ** 2))

    def unlikely(found: Found) -> float:
        least = max(_of_samples(found), np.finfo(float).tiny)
        return float(freedom * np.log(least) + (count + TAILS) * np.log1p(distance(found) / TAILS))

    if unlikely(loose) >= unlikely(estimate):
        return estimate[0]
    softer = _of_samples(loose) / freedom * (count + TAILS) / (TAILS + distance(loose))
    return next(_searched(weighted(softer), [loose[0]], START_BUDGET), loose)[0]


def _far_starts(model: Startable, u: Array, y: Array, trials: Array, least: float) -> list[Array]:
    """The best states farther from the mean than some trials (k, n), if they fit far better than these.

    Args:
        model: with parameters.
        u, y: (m,) the first samples.
        trials: reachable states.
        least: the squared error of the best of them.
    """
    middle = trials.mean(axis=0)
    states = np.vstack([middle + times * (trials - middle) for times in FARTHER])
    missed = _missed(model, u, y, states)
    finite = np.isfinite(missed)
    if not np.min(missed, where=finite, initial=np.inf) < FAR_BETTER * least:
        return []
    return _apart(states[finite], missed[finite])


def _missed(model: Startable, u: Array, y: Array, states: Array) -> Array:
    """(k,) the squared error over the first samples from states (k, n); not finite where a run diverges."""
    errors = (model.outputs(u, states) - y)[:, model.edge :]
    return np.asarray(np.einsum("ij,ij->i", errors, errors))


def _agreeing(weighted: Callable[[float], _Start], found: list[Found], freedom: int) -> Found:
    """The states of the least sum for the σ² of their own residual.

    Args:
        weighted: the problem with a σ².
        found: where the first searches have ended.
        freedom: the number of samples minus that of states.
    """
    least, begun = min(found, key=_of_samples), [states for states, _ in found]
    for _ in range(ROUNDS):
        before = _of_samples(least)
        if before == 0:
            break
        ends = _searched(weighted(before / freedom), begun, START_BUDGET)
        least = min(ends, key=lambda end: sum(float(part @ part) for part in end[1]), default=least)
        if _of_samples(least) > SETTLED * before:
            break
        begun = [least[0]]
    return least


def _prior(cloud: Array) -> tuple[Array, Array, Array]:
    """The mean (n,) of states (K, n), and the eigenvalues (n,) and -vectors (n, n) of their covariance; else zeros."""
    spread = np.atleast_2d(np.cov(cloud.T)) if len(cloud) > 1 else np.full((1, 1), np.inf)
    if not np.isfinite(spread).all():
        return np.zeros(1), np.zeros(1), np.zeros((1, 1))
    return cloud.mean(axis=0), *np.linalg.eigh(spread)


def _searched(problem: _Start, starts: list[Array], effort: dict[str, Any]) -> Iterator[Found]:
    """The minima from several starts, without those that diverge."""
    for start in starts:
        with suppress(ModelError):
            yield few_unknowns(problem, start, **effort)


def _of_samples(found: Found) -> float:
    """The squared residual of the samples."""
    residual = found[1][0]
    return float(residual @ residual)


def _apart(states: Array, missed: Array) -> list[Array]:
    """The best states that differ by the standard deviation of all of them, at most `STARTS`."""
    size = np.std(states, axis=0)
    size[size == 0] = 1.0
    chosen: list[Array] = []
    for k in np.argsort(missed):
        if all(np.abs((states[k] - each) / size).max() > 1 for each in chosen):
            chosen.append(states[k])
        if len(chosen) == STARTS:
            break
    return chosen
