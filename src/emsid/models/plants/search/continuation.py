"""The search itself: coarse parameters first, then all, then only those that the records identify.

The parameters that the records do not identify are found from the derivative of the free run (`identifiability`): at
the start without noise, and again every few steps with the noise estimated so far. They are kept at their start values
or those of the datasheet, and the search continues with the others. If a start value turns out to affect the cost, the
parameter is kept at the value that the search had reached.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Ending
from emsid.estimation.linear.information import inverse_triangle
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.threads import in_threads
from emsid.estimation.uncertainty.coloured_residuals import coloured_covariance, whitened_robust_covariance
from emsid.estimation.uncertainty.identifiability import Identifiability, identifiability
from emsid.estimation.uncertainty.rounding import clustered_covariance
from emsid.findings import Finding
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.rounding import prevails, readings_of
from emsid.models.plants.search.task import Limits, Task, cost_of

Array = NDArray[np.float64]

LOOK = 20
"""Steps after which identifiability is tested again: a search does not converge along unidentifiable directions."""
FLAT = 0.01
"""A search whose later steps have not lowered V by more than this part is at the bottom of a valley."""


class Reached(NamedTuple):
    """Where a search ended.

    Attributes:
        problem: begun at the estimate.
        names: the parameters that were estimated.
        minimum: there.
        steps: of the last stage, all its rounds together.
        ends: costs at which other searches of the same problem ended.
        compared: of how many starts the best was searched from.
    """

    problem: FreeRunError
    names: list[str]
    minimum: Minimum
    steps: int
    ends: tuple[float, ...] = ()
    compared: int = 1

    @property
    def cost(self) -> float:
        """Half the sum of squares of the weighted error."""
        return self.minimum.cost

    @property
    def states(self) -> list[Array]:
        """The initial state of every segment."""
        return self.problem.states(self.problem.start)

    @property
    def residuals(self) -> list[Array]:
        """The weighted error of every segment."""
        return self.problem.residuals(self.problem.start)

    @property
    def unended(self) -> bool:
        """Whether it was not ended early."""
        return self.minimum.ending is not Ending.INTERRUPTED

    def or_better(self, other: Reached) -> Reached:
        """The one of two searches of the same problem with the lower cost, with where the other ended."""
        best, rest = (other, self) if other.cost < self.cost else (self, other)
        return best._replace(ends=(*self.ends, *other.ends, rest.cost), compared=self.compared)

    def ended_by(self, ending: Ending) -> Reached:
        """The same, of a search that was stopped before its end."""
        code = "search-cancelled" if ending is Ending.INTERRUPTED else "time-used-up"
        finding = Finding(code, "", {"steps": self.steps, "offset": None})
        return self._replace(minimum=replace(self.minimum, ending=ending, findings=(finding,)))


def search(task: Task, start: Plant, max_iterations: int, states: Sequence[Array] | None = None) -> Reached:
    """The parameters that minimise the error of the free run, from a plant to begin with.

    Args:
        task: what is asked.
        start: the plant to begin with.
        max_iterations: of all rounds together; a parameter that is kept only in the end adds a few. Zero only evaluates
            the start.
        states: initial states to begin with, by default what the first samples show.
    """
    if not max_iterations and task.control.ending is Ending.INTERRUPTED:
        return _interrupted_at(task, start)
    problem = task.problem(start, task.asked, states)
    names = keep_identifiable(identified_by(problem, task.asked, None), task.asked, task.preference)
    if len(names) < len(task.asked):
        problem = task.problem(_put_back(start, task.asked, names, task.known), names, states)
    so_far: Reached | None = None
    coarse = [name for name in names if name not in start.secondary] if max_iterations else []
    if 0 < len(coarse) < len(names):
        rough = task.problem(problem.plant, coarse)
        minimum = _search(rough, task.limits, max_iterations, task.control)
        rough = rough.begun_at(minimum.estimate)
        if minimum.ending is Ending.INTERRUPTED:
            return Reached(rough, coarse, minimum, 0)
        problem = task.problem(_scan(rough, names, task), names, rough.states(rough.start))
        so_far = Reached(rough, coarse, minimum, 0)
    rounds = _Rounds(task, start, problem, names, max_iterations, so_far)
    try:
        while (found := rounds.next()) is None:
            pass
    except Stopped as stopped:  # at the start of a round
        if rounds.so_far is None:
            raise
        return rounds.so_far.ended_by(stopped.ending)
    return Reached(rounds.problem, rounds.names, found, rounds.steps)


def _interrupted_at(task: Task, start: Plant) -> Reached:
    """The end of a search that is interrupted before its first step, with derivatives that take little time."""
    whole = task.problem(start, task.asked)
    here = replace(_search(whole, task.limits, 0, FREE), ending=Ending.INTERRUPTED, findings=())
    names = keep_identifiable(identified_by(whole, task.asked, here), task.asked, task.preference)
    if len(names) == len(task.asked):
        return Reached(whole, names, here, 0)
    problem = task.problem(start, names, whole.states(whole.start))
    return Reached(problem, names, replace(_search(problem, task.limits, 0, FREE), ending=here.ending, findings=()), 0)


class _Rounds:
    """Rounds of a search, each with as many parameters as the records identify.

    Attributes:
        problem, names: of the round to come.
        steps: taken so far.
        bar: the cost above which the parameters kept in the last round must not be kept at their start.
        stayed: the problem with these parameters kept at the values that the search had reached.
        released: the parameters that were kept and are estimated again.
        dropped: the parameters that an end of the search did not identify.
        so_far: where the last round ended, None before the first.
    """

    def __init__(
        self,
        task: Task,
        start: Plant,
        problem: FreeRunError,
        names: list[str],
        max_iterations: int,
        so_far: Reached | None,
    ) -> None:
        self.task, self.start, self.max_iterations = task, start, max_iterations
        self.problem, self.names = problem, names
        self.steps, self.bar, self.stayed = 0, inf, problem
        self.released: set[str] = set()
        self.dropped: set[str] = set()
        self.so_far = so_far

    def next(self) -> Minimum | None:
        """One round; the minimum where it was the last."""
        left = self.max_iterations - self.steps
        share = min(LOOK, max(left, min(LOOK, self.max_iterations)))
        ended = _search(self.problem, self.task.limits, share, self.task.control)
        self.steps += ended.iterations
        self.so_far = Reached(self.problem.begun_at(ended.estimate), list(self.names), ended, self.steps)
        interrupted = ended.ending is Ending.INTERRUPTED
        under_way = (
            ended.ending is Ending.OUT_OF_BUDGET and ended.iterations == share and self.steps < self.max_iterations
        )
        if under_way and ended.costs[len(ended.costs) // 2] > (1 + FLAT) * ended.cost:
            self.problem = self.problem.begun_at(ended.estimate)
            return None
        if ended.cost > self.bar:  # the start of what is kept matters after all
            self.problem, self.bar = self.stayed, inf
            if not interrupted:
                return None
            back = _search(self.problem, self.task.limits, 0, self.task.control)
            ended = replace(back, ending=ended.ending, findings=ended.findings, iterations=ended.iterations)
        if interrupted:
            self.problem = self.problem.begun_at(ended.estimate)
            return replace(ended, findings=tuple(_after(self.steps, finding) for finding in ended.findings))
        ended = with_colour(self.problem, ended)
        self.problem = self.problem.begun_at(ended.estimate)
        inside = [name for name, free in zip(self.names, ended.free, strict=False) if free]
        kept = keep_identifiable(identified_by(self.problem, inside, ended), inside, self.task.preference)
        if not inside and 0 < len(self.names) < len(self.task.asked):  # only bounds are left
            self._keep(self.names, [], ended)
            return None
        if len(kept) == len(inside) and not under_way:
            may_free = self.max_iterations > 0 and len(self.names) < len(self.task.asked)
            if may_free and self._release(inside, ended):
                return None
            return replace(ended, findings=tuple(_after(self.steps, finding) for finding in ended.findings))
        if len(kept) < len(inside):
            self._keep(inside, kept, ended)
        return None

    def _release(self, inside: Sequence[str], ended: Minimum) -> bool:
        """Estimate kept parameters again if they are identifiable now; none is released twice.

        Otherwise their start values would decide where the search ends. Two parameters may compensate for each other
        only at the start, or until one of them, such as friction, is zero. In other cases, parameters that an end of
        the search did not identify stay kept; so they do beside a parameter at a bound that is not zero, since that
        bound may be what identifies them.
        """
        left = [name for name in self.task.asked if name not in self.names and name not in self.released]
        plant, states = self.problem.plant, self.problem.states(self.problem.start)
        if not left:
            return False
        whole = self.task.problem(plant, [*self.names, *left], states)
        absent = {name for name in self.names if name not in inside and plant.value(name) == 0}
        groups = [group for group in identified_by(whole, whole.free, ended).groups if not absent.isdisjoint(group)]
        bounded = {name for name in self.names if name not in inside}
        new = set(left) - self.dropped if bounded == absent else set()
        left = [name for name in left if name in new or any(name in group for group in groups)]
        free = [*inside, *left]
        kept = keep_identifiable(identified_by(whole, free, ended), free, self.task.preference)
        found = [name for name in left if name in kept]
        if not found or not set(inside) <= set(kept):
            return False
        self.names = [name for name in self.task.asked if name in self.names or name in found]
        self.released |= set(found)
        self.problem, self.bar = self.task.problem(plant, self.names, states), inf
        return True

    def _keep(self, inside: Sequence[str], kept: Sequence[str], ended: Minimum) -> None:
        """Estimate only ``kept`` of ``inside`` from now on; the rest goes back to its start, if that is as good."""
        self.dropped |= set(inside) - set(kept)
        self.names = [name for name in self.names if name not in inside or name in kept]
        bar = ended.cost + _tolerable(ended)
        states = self.problem.states(self.problem.start)
        given = _put_back(self.problem.plant, inside, kept, self.task.known)
        self.stayed = self.task.problem(given, self.names, states)
        begun = {name: self.start.value(name) for name in inside} | self.task.known
        back = self.task.problem(_put_back(given, inside, kept, begun), self.names, states)
        self.problem, self.bar = (back, bar) if isfinite(cost_of(back)) else (self.stayed, inf)


SCAN = (0.12, 0.18, 0.25, 0.35, 0.5, 0.7, 1.4, 2.0, 2.8, 4.0)
"""Factors of the fine parameters that are tried before the search: the error has many minima over a resonance."""


def _scan(rough: FreeRunError, names: Sequence[str], task: Task) -> Plant:
    """The plant of a problem with each of the other parameters, in turn, at the tried value that simulates best."""
    best, states = rough.plant, rough.states(rough.start)
    lowest = cost_of(rough)
    with in_threads(rough.threads) as in_turn:
        for name in (name for name in names if name not in rough.free):
            value = best.value(name)
            trials = [best.with_values({name: float(np.clip(factor * value, *task.limits[name]))}) for factor in SCAN]
            costs = list(in_turn(lambda trial: cost_of(task.problem(trial, (), states)), trials))
            k = int(np.argmin(costs))
            if costs[k] < lowest:
                best, lowest = trials[k], costs[k]
    return best


def _tolerable(minimum: Minimum) -> float:
    """The allowed rise of V if unidentifiable parameters are kept at their start: that of three standard deviations.

    Where the residual is coloured these are wider; then V may rise by `FLAT` of itself at most.
    """
    noise, colour = 4.5 * minimum.noise_variance, colour_of(minimum, len(minimum.free))
    return max(noise, min(noise * float(np.max(colour, initial=1.0)), FLAT * minimum.cost))


def colour_of(minimum: Minimum, parameters: int) -> Array:
    """(p,) how many times larger the variance of every parameter is than with a white residual."""
    coloured, white = (np.diag(c)[:parameters] for c in (minimum.covariance, minimum.white_covariance))
    return np.divide(coloured, white, out=np.ones(parameters), where=(white > 0) & np.isfinite(white))


def _put_back(plant: Plant, asked: Sequence[str], kept: Sequence[str], known: Mapping[str, float]) -> Plant:
    """Parameters that are no longer estimated, at the values of the datasheet if it has them."""
    return plant.with_values({name: known[name] for name in asked if name not in kept and name in known})


def identified_by(problem: FreeRunError, names: Sequence[str], minimum: Minimum | None) -> Identifiability:
    """Which of some parameters of a problem the records identify; without noise where nothing is known of that."""
    noise = 0.0 if minimum is None else float(np.sqrt(minimum.noise_variance))
    states = range(len(problem.free), len(problem.sizes))
    places = [problem.free.index(name) for name in names]
    in_a_hurry = minimum is not None and minimum.ending is Ending.INTERRUPTED
    blocks = (problem.linearised if in_a_hurry else problem.exactly)(problem.start)
    jacobians = [jacobian[:, [*places, *states]] for _, jacobian in blocks]
    return identifiability(jacobians, problem.scales[places], names, noise)


def keep_identifiable(identifiability: Identifiability, names: Sequence[str], preference: Sequence[str]) -> list[str]:
    """The parameters that remain if one after the other is kept at its start until the others are identifiable."""
    kept = list(names)
    while kept and (groups := identifiability.without([name for name in names if name not in kept]).groups):
        kept.remove(min(groups[0], key=preference.index))
    return kept


def search_once(problem: FreeRunError, task: Task) -> Minimum:
    """One round of a search, whatever is identifiable, which is enough for a start near the minimum."""
    return _search(problem, task.limits, LOOK, task.control)


def _search(problem: FreeRunError, limits: Limits, max_iterations: int, control: Control) -> Minimum:
    lower, upper = problem.within(limits)
    control = control if max_iterations else FREE  # a search of no steps only evaluates, and is not stopped
    with problem.under(control):
        return gauss_newton(
            problem,
            problem.start,
            lower=lower,
            upper=upper,
            max_iterations=max_iterations,
            tolerance=1e-2,
            noise=problem.precision,
            names=problem.names,
            control=control,
        )


def _after(steps: int, finding: Finding) -> Finding:
    """A finding of the last round of a search, with the steps of all rounds."""
    return replace(finding, data={**finding.data, "steps": steps}) if "steps" in finding.data else finding


def with_colour(problem: FreeRunError, minimum: Minimum) -> Minimum:
    """The covariance under coloured noise, with deviations no smaller than those of the robust covariance.

    Where rounding is most of the error, it is that of runs of one reading. The rounding errors of the free run are
    added. Where the data are exact, these are the only errors.
    """
    determined = np.isfinite(np.diag(minimum.covariance))
    columns = np.flatnonzero(minimum.free & determined)
    if minimum.rank < len(columns) or not len(columns):
        return minimum
    pieces, channels = [], len(problem.signals)
    for residual, jacobian in problem.exactly(minimum.estimate):
        parts = np.split(np.arange(len(residual)), channels)
        pieces += [(residual[part], jacobian[np.ix_(part, columns)]) for part in parts]
    try:
        if prevails(problem, minimum.residuals):
            readings = readings_of(problem)
            covariance = clustered_covariance([(*each, y) for each, y in zip(pieces, readings, strict=True)])
        else:
            covariance = coloured_covariance(pieces)
    except np.linalg.LinAlgError:  # without the smoothing of the search, one of the parameters has no effect here
        return minimum
    whitened = whitened_robust_covariance(pieces)
    within = np.ix_(columns, columns)
    robust, found = np.diag(minimum.covariance[within] if whitened is None else whitened), np.diag(covariance)
    ratio = np.divide(robust, found, out=np.ones(len(columns)), where=found > 0)  # zero for exact data
    wider = np.sqrt(np.maximum(ratio, 1.0))
    whole = minimum.covariance.copy()
    inverse = inverse_triangle(minimum.information.select(np.flatnonzero(determined[minimum.free])).factor[:-1, :-1])
    whole[within] = covariance * np.outer(wider, wider) + problem.precision**2 * (inverse @ inverse.T)
    return replace(minimum, covariance=whole)
