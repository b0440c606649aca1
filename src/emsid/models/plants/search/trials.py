"""Fits of one structure among many, quick and without intervals: from several starts, thinned as they go on.

A trial begins with the free run of every start. The best few take a few steps, and the best of these continue to the
end of their budget (successive halving). A trial that has ended may be repeated from points around it, drawn from its
covariance, because the valleys of the cost are narrow and bent.

Two trials are compared by Schwarz's criterion (`schwarz_gain`). Its n is not the number of samples but that of
independent ones in the residual of the richer trial: the residual of a poor model is a slow signal, whose neighbouring
samples are nearly equal.

A sensor with a lag has an initial reading of its own, which explains the first speed even if the lag is nearly zero. So
in a segment that begins in motion the first speed counts in no trial, and a lag of zero is the limit of a small one.

References:
    Jamieson, Talwalkar, *Non-stochastic best arm identification and hyperparameter optimization*, AISTATS (2016), on
    successive halving.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import each_step, gauss_newton
from emsid.estimation.nonlinear.restarts import ITERATIONS, SAME, SLOW, drawn
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, Weighting, all_alike
from emsid.models.plants.initial_state import InitialState, begun
from emsid.models.plants.parameters import Signal, parts
from emsid.models.plants.plant import Limits
from emsid.models.plants.search.moves import Addition, level_name
from emsid.models.plants.search.rounding import independent_errors
from emsid.models.plants.search.task import cost_of
from emsid.record import Record
from emsid.selection.improvement import StretchErrors, schwarz_gain

Array = NDArray[np.float64]

KEPT, FINALISTS, FIRST_STEPS = 4, 2, 3
"""The number of starts that take a step, that of those that continue, and the steps after which only the best
continues."""
TOLERANCE = 0.02
"""Of a search, in standard errors: with 0.1 a motor with Stribeck friction ended where the interval of the excess was
2.4 times as long."""
MUCH_WORSE = 10.0
"""A start whose cost is more than this multiple of the best one takes no steps."""
SHORTER = 0.25 ** np.arange(8)
"""Parts of a draw from a covariance that are tried until the cost is not much larger: the covariance holds only
nearby."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A plant fitted by its free run.

    Attributes:
        plant: with its parameters.
        names: those that were estimated.
        states: the initial state of every segment.
        cost: half the sum of squares of the weighted free-run error.
        residuals: that error, segment by segment.
        ends: where searches ended that began around it, each as its cost and the values of ``names``.
        added: what it has in addition to the plant that the search began with.
        without: what was just taken out of it, if another addition may take its place.
        independent: the number of independent errors; None where only their colour shows it.
        problem: begun at it, with its derivatives.
    """

    plant: DrivenPlant
    names: tuple[str, ...]
    states: list[Array]
    cost: float
    residuals: list[Array]
    ends: tuple[tuple[float, Array], ...] = ()
    added: tuple[Addition, ...] = ()
    without: Addition | None = None
    independent: float | None = None
    problem: FreeRunError | None = None

    @property
    def errors(self) -> StretchErrors:
        """The weighted free-run error, stretch by stretch."""
        return StretchErrors.of(np.concatenate(self.residuals) ** 2)

    @property
    def mean_square(self) -> float:
        """Of the weighted free-run error."""
        return 2 * self.cost / sum(len(residual) for residual in self.residuals)


def gain(simple: Trial, rich: Trial) -> float:
    """By how much Schwarz's criterion prefers the richer of two trials; negative for the simpler."""
    samples = effective_samples(rich.residuals) if rich.independent is None else rich.independent
    return schwarz_gain(rich.mean_square, simple.mean_square, samples, len(rich.names) - len(simple.names))


def _first_equal(ranked: Sequence[tuple[float, int, FreeRunError]]) -> dict[int, int]:
    """The starts without repetitions of the same cost and values: two plants may give the same start."""
    first: dict[tuple[float, bytes], int] = {}
    return {k: first.setdefault((cost, problem.start.tobytes()), k) for cost, k, problem in ranked}


def has_load(trial: Trial) -> bool:
    """Whether a trial has a constant load, or levels by direction, which have the same effect."""
    load, sides = trial.plant.load_name, parts(trial.plant, level_name(trial.plant))
    return load in trial.names or set(sides) <= set(trial.names)


@dataclass(frozen=True, eq=False)
class Trials:
    """The settings that all trials of plants share.

    Args:
        segments: the records, in units of their own size.
        signals: what their outputs are.
        limits: bounds of parameters; others have the bounds of the plant.
        weighting: of errors by their age, or by the drift of the load.
        control: when to stop.
        complete: the segment with all samples of which ``segments`` are parts with fewer samples (`thinning`); it gives
            the initial states. None if the segments themselves do.
        begins: how the initial states are found; see `initial_state`.
    """

    segments: tuple[Record, ...]
    signals: tuple[Signal, ...]
    limits: Limits
    weighting: Weighting = all_alike
    control: Control = FREE
    complete: Record | None = None
    begins: InitialState = InitialState.SAMPLES

    def fitted(
        self, starts: Sequence[DrivenPlant], names: Sequence[str], states: Sequence[Array] | None = None
    ) -> Trial | None:
        """The best fit from several starts; None if none of them can be simulated.

        Args:
            starts: plants to begin with.
            names: the parameters to estimate.
            states: initial states to begin with, by default what the first samples show.
        """
        under_way = sorted(self._under_way(starts, names, states))
        ended = (self._searched(problem) for _, _, problem in under_way)
        best = next((problem for problem in ended if problem is not None), None)  # the first may have no derivative
        return None if best is None else self._trial(best)

    def promising(self, starts: Sequence[DrivenPlant], names: Sequence[str]) -> DrivenPlant:
        """The start with the lowest cost after a few steps; the first if none can be simulated."""
        under_way = self._under_way(starts, names, None)
        return starts[min(under_way)[1]] if under_way else starts[0]

    def by_cost(self, starts: Sequence[DrivenPlant], names: Sequence[str]) -> list[DrivenPlant]:
        """The starts that can be simulated, those with the smallest error first."""
        return [starts[k] for _, k, _ in self._ranked(starts, names, None)]

    def _under_way(
        self, starts: Sequence[DrivenPlant], names: Sequence[str], states: Sequence[Array] | None
    ) -> list[tuple[float, int, FreeRunError]]:
        """The best starts after a few steps, as (cost, index of the start, its problem)."""
        ranked = self._ranked(starts, names, states)[:KEPT]
        ranked = [each for each in ranked if each[0] <= MUCH_WORSE * ranked[0][0]]
        if len(ranked) == 1:
            return ranked
        first = _first_equal(ranked)  # starts that are equal move together
        searches = {k: self._each_step(problem) for _, k, problem in ranked if first[k] == k}
        for count in (1, FIRST_STEPS - 1):
            begun = {first[k]: problem for _, k, problem in ranked}
            moved = {k: self._after(problem, islice(searches[k], count)) for k, problem in begun.items()}
            again = ((k, moved[first[k]]) for _, k, _ in ranked)
            ranked = sorted((cost_of(problem), k, problem) for k, problem in again if problem is not None)[:FINALISTS]
        return ranked

    def _ranked(
        self, starts: Sequence[DrivenPlant], names: Sequence[str], states: Sequence[Array] | None
    ) -> list[tuple[float, int, FreeRunError]]:
        """The starts that can be simulated, as (cost, index of the start, its problem), in order of cost.

        No free run begins once the control has ended: those of a plant with a stiff shaft take seconds.
        """
        found = []
        for k, start in enumerate(starts):
            problem = self.problem(start, names, states)
            if problem is not None:
                with problem.under(self.control):
                    found.append((cost_of(problem), k, problem))
        return sorted(each for each in found if isfinite(each[0]))

    def around(self, trial: Trial, rng: np.random.Generator, most: int, agreeing: int) -> Trial:
        """The best of a trial and of further ones that begin around it, with the ends of these.

        It ends when enough of them have ended with the lowest cost. If the motion sticks for one value of a parameter
        and slides for the next, the cost has steps, and searches end at different points beside them.

        Args:
            trial: to begin around.
            rng: source of random numbers.
            most: the largest number of further trials.
            agreeing: how many with the lowest cost are enough.
        """
        ends: list[tuple[float, Array]] = []
        for _ in range(most):
            near = self._near(trial, rng)
            again = None if near is None else self._searched(near)
            if again is None:
                continue
            ends.append((0.5 * cost_of(again), again.start[: len(trial.names)]))
            if ends[-1][0] < trial.cost * (1 - SLOW):
                trial = self._trial(again)
            if sum(cost <= (1 + SAME) * trial.cost for cost, _ in ends) >= agreeing:
                break
        return replace(trial, ends=tuple(ends))

    def _near(self, trial: Trial, rng: np.random.Generator) -> FreeRunError | None:
        """The problem of a trial begun at a point around it; None where there is nothing to move or no such point.

        A trial need not be at a minimum, so its covariance may be meaningless: no parameter is moved further than is
            plausible, nor to points of a much larger cost.
        """
        problem = self.problem_of(trial)
        if problem is None or not len(problem.start):
            return None
        lower, upper = self._within(problem)
        try:
            slopes = np.vstack([jacobian for _, jacobian in problem.linearised(problem.start)])
            step = drawn(slopes, trial.residuals, rng, problem.plausible)
            moved = (problem.begun_at(np.clip(problem.start + part * step, lower, upper)) for part in SHORTER)
            return next((each for each in moved if 0.5 * cost_of(each) <= MUCH_WORSE * trial.cost), None)
        except EmsidError:
            return None

    def problem_of(self, trial: Trial) -> FreeRunError | None:
        """The problem of a trial, with the derivatives that its search ended with; None as of `problem`."""
        known = trial.problem
        if known is None or known.weighting is not self.weighting:
            return self.problem(trial.plant, trial.names, trial.states)
        return known

    def problem(
        self, plant: DrivenPlant, names: Sequence[str], states: Sequence[Array] | None = None
    ) -> FreeRunError | None:
        """The least-squares problem of some parameters; None for a plant that cannot have them."""
        bounds = self._bounds(plant, names)
        try:
            inside = plant.with_values({name: float(np.clip(plant.value(name), *bounds[name])) for name in names})
            first, free = begun(inside, self.signals, self.seen, self.begins, states)
            return FreeRunError(
                inside, self.signals, self.segments, names, first, free, self.weighting, 1, self._counted(inside)
            )
        except EmsidError:
            return None

    def _counted(self, plant: DrivenPlant) -> tuple[Array, ...] | None:
        """(N,) of every segment, 0 for the first speed in motion, whose error does not count, and 1 for others."""
        if Signal.POSITION in self.signals:
            return None
        return tuple(
            np.where((np.arange(len(segment)) == 0) & bool(plant.free_states(self.signals, segment)), 0.0, 1.0)
            for segment in self.segments
        )

    @property
    def seen(self) -> list[Record]:
        """The segments with all their samples."""
        whole = self.complete
        if whole is None:
            return list(self.segments)
        return [whole[round((segment.times[0] - whole.times[0]) / whole.dt) :] for segment in self.segments]

    def _bounds(self, plant: DrivenPlant, names: Sequence[str]) -> Limits:
        handles = plant.handles
        return {name: self.limits.get(name, (handles[name].lower, handles[name].upper)) for name in names}

    def _searched(self, problem: FreeRunError) -> FreeRunError | None:
        """The problem begun where a search ends; None where it cannot begin."""
        lower, upper = self._within(problem)
        self.control.check()
        try:
            with problem.under(self.control):
                found = gauss_newton(
                    problem, problem.start, lower=lower, upper=upper, max_iterations=ITERATIONS, tolerance=TOLERANCE,
                    least_saving=SLOW, names=problem.names, covariances=False, control=self.control,
                )  # fmt: skip
                return problem.begun_at(found.estimate)
        except EmsidError:
            return None

    def _each_step(self, problem: FreeRunError) -> Iterator[Array]:
        """θ after every step of a search."""
        lower, upper = self._within(problem)
        with problem.under(self.control):
            yield from each_step(
                problem, problem.start, lower=lower, upper=upper, tolerance=TOLERANCE, names=problem.names,
                control=self.control,
            )  # fmt: skip

    def _after(self, problem: FreeRunError, steps: Iterator[Array]) -> FreeRunError | None:
        """The problem begun after some more steps of its search; None where there is no step."""
        self.control.check()
        try:
            *_, theta = problem.start, *steps
            return problem.begun_at(theta)
        except EmsidError:
            return None

    def _within(self, problem: FreeRunError) -> tuple[Array, Array]:
        return problem.within(self._bounds(problem.plant, problem.free))  # type: ignore[arg-type]

    def _trial(self, problem: FreeRunError) -> Trial:
        residuals = problem.residuals(problem.start)
        cost = 0.5 * sum(float(residual @ residual) for residual in residuals)
        plant = problem.plant
        assert isinstance(plant, DrivenPlant)
        independent = independent_errors(problem, residuals)
        return Trial(
            plant, tuple(problem.free), problem.states(problem.start), cost, residuals, independent=independent,
            problem=problem,
        )  # fmt: skip
