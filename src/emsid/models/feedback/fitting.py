"""A feedback model fitted to its free run, from start values, by Gauss–Newton steps with exact derivatives.

The search runs in the coordinates of `coordinates`, chosen anew after every round, together with the initial state of
every segment. The result is brought into the normal form, which changes no output, and its covariance is that of the
parameters within this form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import check_excitation
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import LARGEST, Infeasible, LastRun, Mask, without
from emsid.estimation.nonlinear.restarts import TURNS, Ends, begun_around, confirmed, nearer
from emsid.estimation.nonlinear.smoothing import Penalty, Smoothing
from emsid.findings import Finding
from emsid.models.feedback.coordinates import (
    Visited,
    check_size,
    coordinates,
    coordinates_in_form,
    in_coordinates,
    whitened,
)
from emsid.models.feedback.kernels import LoopSignals
from emsid.models.feedback.model import BLOCK, FeedbackModel
from emsid.models.feedback.normal_form import normal_form
from emsid.models.initial_states import initial_state
from emsid.models.one_channel import Segments, segments_longer_than
from emsid.models.terms import check_whole
from emsid.record import Record

Array = NDArray[np.float64]
Refusal = Callable[[FeedbackModel, Segments, Sequence[Array]], bool]
"""Whether a model is out of the question, from its runs over segments (u, y) from states (n,) of each."""

# Steps in one choice of coordinates, and the number of choices.
ITERATIONS, ROUNDS = 25, 6
# The largest number of elements of initial states that are estimated with the model; of more, each is estimated alone.
MOST_STATES = 60
# What hardly any sample determines, such as the slope of a dead zone on a side that is not reached, may grow with every
# step. No step leads to parameters of this size.
LARGEST_PARAMETER = 1e12
# Less than this fraction of the cost saved in a round ends the search.
SAVED = 1e-3
# In records of at most this many samples, a search that does not converge is begun again.
BEGUN_AGAIN = 10_000
# A fit whose last steps raise the error by more than this factor keeps the parameters that it had before them.
WORSE = 1.05


@dataclass(frozen=True, eq=False)
class FreeRun:
    """The free-run residuals of a feedback model, as a `Problem` for `gauss_newton`.

    The parameters are φ (f,) in θ = θ₀ + Cφ, and then the initial state (n,) of every segment.

    Attributes:
        model: θ₀.
        spread: (p, f) C.
        segments: (u, y) of each.
        transient: samples at the start of every segment that are left out of the residual.
        check: called again and again while the derivative by a long segment is computed; what it raises ends that.
        refused: a step does not lead to a model that this refuses, if it is given.
    """

    model: FeedbackModel
    spread: Array
    segments: Segments
    transient: int
    check: Callable[[], None] = FREE.check
    refused: Refusal | None = None
    _last: LastRun[tuple[FeedbackModel, list[LoopSignals]]] = field(default_factory=LastRun, init=False, repr=False)

    def at(self, theta: Array) -> FeedbackModel:
        """The model with these parameters."""
        return self.model.with_parameters(self.model.parameters + self.spread @ theta[: self.spread.shape[1]])

    def state(self, theta: Array, k: int) -> Array:
        """(n,) the initial state of a segment."""
        first = self.spread.shape[1] + k * self.model.states
        return theta[first : first + self.model.states]

    @cached_property
    def penalties(self) -> tuple[Penalty, ...]:
        """On the roughness of every map that has one, in (φ, states)."""
        count, found = self.model.states * len(self.segments), []
        for map_, span in zip(self.model.maps, self.model.spans, strict=True):
            rows = map_.roughness()
            if rows is not None and len(rows):
                moved = np.pad(rows @ self.spread[span], ((0, 0), (0, count)))
                found.append(Penalty(moved, rows @ map_.parameters))
        return tuple(found)

    @cached_property
    def steepest(self) -> float:
        """The limit of the derivative: beyond it, rounding of a parameter changes the run by the range of the output.

        At such a point of an unstable model all columns of the derivative are the same but for rounding, so that no
        search goes on from there, and what the data determine cannot be seen.
        """
        extent = max(float(np.ptp(y)) for _, y in self.segments)
        return min(extent / np.finfo(float).eps, LARGEST) if extent else LARGEST

    def residuals(self, theta: Array) -> list[Array]:
        """Model minus measurement, per segment."""
        model, runs = self._run(theta)
        every = zip(runs, self.segments, strict=True)
        return [(run.y[:: model.oversampling] - y)[self.transient :] for run, (_, y) in every]

    def _run(self, theta: Array) -> tuple[FeedbackModel, list[LoopSignals]]:
        """The model and its runs.

        Raises:
            Infeasible: for maps outside their families, parameters without bound, a run that diverges, or a model that
                is refused.
        """

        def run() -> tuple[FeedbackModel, list[LoopSignals]]:
            model = self.at(theta)
            model.check()
            if not np.abs(model.parameters).max(initial=0.0) < LARGEST_PARAMETER:
                raise Infeasible(
                    f"parameters of {model.name} grow without bound; scale the channels, or choose fewer maps"
                )
            states = [self.state(theta, k) for k in range(len(self.segments))]
            runs = [model.trajectory(u, x) for (u, _), x in zip(self.segments, states, strict=True)]
            if self.refused is not None and self.refused(model, self.segments, states):
                raise Infeasible(f"{model.name} is refused")
            return model, runs

        return self._last.at(theta, run)

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        """Residual and derivative, per segment; the derivative by the states of other segments is zero.

        Raises:
            Infeasible: for a derivative that is too large, and as `residuals` does.
        """
        (model, runs), free, found = self._run(theta), self.spread.shape[1], []
        count = len(model.parameters)
        for k, ((u, y), passed) in enumerate(zip(self.segments, runs, strict=True)):
            derivative, own = np.zeros((len(theta), len(y))), free + k * model.states
            for samples, rows in model.gradients(u, passed):
                if samples.start:
                    self.check()
                with np.errstate(all="ignore"):
                    np.matmul(self.spread.T, rows[:, :count].T, out=derivative[:free, samples])
                derivative[own : own + model.states, samples] = rows[:, count:].T
            fitted = derivative[:, self.transient :]
            largest = max(fitted.max(), -fitted.min())
            if not largest < self.steepest:  # also if not a number
                raise Infeasible(f"the derivative of {model.name} is too large")
            found.append(((passed.y[:: model.oversampling] - y)[self.transient :], fitted.T))
        return found


@dataclass(frozen=True, eq=False)
class Found:
    """A model with its initial states, and how the last search ended.

    Attributes:
        model: with its parameters.
        states: (n,) for every segment.
        minimum: of the last round.
        settled: whether the search has converged.
    """

    model: FeedbackModel
    states: list[Array]
    minimum: Minimum
    settled: bool

    @property
    def error(self) -> float:
        """The root mean square of the residual."""
        return _root_mean_square(self.minimum)

    @property
    def parameters(self) -> int:
        """The number of free parameters of the model, without initial states."""
        return len(self.minimum.estimate) - sum(map(len, self.states))


def _root_mean_square(minimum: Minimum) -> float:
    return float(np.sqrt(np.mean(np.concatenate(minimum.residuals) ** 2)))


def fit_feedback(
    start: FeedbackModel,
    records: Record | Sequence[Record],
    *,
    transient: int | None = None,
    max_iterations: int = ITERATIONS * ROUNDS,
    tolerance: float = 0.05,
    control: Control = FREE,
) -> Fit[FeedbackModel]:
    """Fit a feedback model to the free-run error on one or several records, from start values.

    Args:
        start: a model whose free run on the records is finite.
        records: one input and one output each; every segment is an experiment.
        transient: samples at the start of every segment that are left out of the errors.
        max_iterations: the largest number of Gauss–Newton steps.
        tolerance: see `gauss_newton`.
        control: when to stop.

    Returns:
        The fit, in the normal form of `emsid.models.feedback.normal_form`.

    Raises:
        ModelError: for records with other channels or too few samples, or a start that diverges.
    """
    several = [records] if isinstance(records, Record) else list(records)
    if transient is not None:
        check_whole(f"{start.name}: transient", transient, 0, "these are samples to be left out")
    if several and start.dt is None:
        start = replace(start, dt=several[0].dt)
    segments = segments_longer_than(max(transient or 0, start.memory), start, several)
    for record in several:
        check_excitation(record)
    skipped = max(transient or 0, start.edge)
    return conclude(
        searched(start, segments, skipped, max_iterations, tolerance, control), segments, skipped, tolerance, control
    )


def searched(
    start: FeedbackModel,
    segments: Segments,
    transient: int,
    max_iterations: int = ITERATIONS * ROUNDS,
    tolerance: float = 0.05,
    control: Control = FREE,
    least_saving: float = 0.0,
    states: Sequence[Array] | None = None,
    hold_signals: bool = False,
    refused: Refusal | None = None,
    left_out: Sequence[Mask] | None = None,
) -> Found:
    """The minimum near a start, in rounds of new coordinates; no covariances.

    The initial states begin as given, if there is one for every segment, or else as the first samples show them. With
    ``hold_signals`` the z and g of maps that are multiplied remain the signals that they are, but for their offsets.
    The search keeps to models that are not refused, unless it begins at one that is. The run goes on through samples
    (N,) of every segment that are ``left_out``, but these are not fitted.

    Raises:
        Stopped: by ``control``, within a long segment.
    """
    model, cost, left = start, np.inf, max_iterations
    if states is None or len(states) != len(segments):
        quick = len(segments) * model.states <= MOST_STATES
        states = [initial_state(model, u, y[: model.memory], quick) for u, y in segments]
    found = None
    while found is None or (left > 0 and not found.settled):
        same = whitened(model, visited(model, segments, states))
        states = [same.state(x) for x in states]
        held = _signals_of_products(same.model) if hold_signals else None
        spread = coordinates(same.model, visited(same.model, segments, states), held)
        limit = _limit(refused, same.model, segments, states)
        problem = FreeRun(same.model, spread, segments, transient, control.check, limit)
        minimum = _gauss_newton(
            problem, states, min(ITERATIONS, left), tolerance, control, False, least_saving, left_out
        )
        left -= max(minimum.iterations, 1)
        model = problem.at(minimum.estimate)
        states = [problem.state(minimum.estimate, k) for k in range(len(segments))]
        converged = not minimum.ending.before_minimum
        short = minimum.iterations < ITERATIONS and not least_saving  # other coordinates may save more again
        slow = minimum.cost > (1 - SAVED) * cost or short
        found = Found(model, states, minimum, converged or slow or control.ending is not None)
        cost = minimum.cost
    return found


def _limit(
    refused: Refusal | None, model: FeedbackModel, segments: Segments, states: Sequence[Array]
) -> Refusal | None:
    """What a search from a model may refuse: nothing where it would refuse that."""
    return None if refused is None or refused(model, segments, states) else refused


def _signals_of_products(model: FeedbackModel) -> NDArray[np.bool_]:
    """(p,) the parameters from which z and g of the maps that are multiplied follow, without offsets."""
    rows = tuple(f"{model.numbered(letter)[k]}." for letter in "zg" for k in model.multiplied)
    return np.array([name.startswith(rows) and not name.endswith(".1") for name in model.names])


def conclude(
    found: Found,
    segments: Segments,
    transient: int,
    tolerance: float = 0.05,
    control: Control = FREE,
    max_iterations: int = 2 * ITERATIONS,
    refused: Refusal | None = None,
) -> Fit[FeedbackModel]:
    """The fit at a minimum, in the normal form, with covariances; the last steps keep to models that are not refused.

    Raises:
        Stopped: by ``control``, within a long segment.
    """
    last, others = found, list[Other]()
    if found.settled:
        last, others = _last_steps(found, segments, transient, max_iterations, tolerance, control, refused)
    ended = found.settled and last.error <= WORSE * found.error
    if not ended:  # also where the weights of the penalties began too heavy in other coordinates
        last, others = found, []
    form = normal_form(last.model, visited(last.model, segments, last.states))
    model, states = form.model, [form.state(x) for x in last.states]
    seen = visited(model, segments, states)
    model = replace(model, centre=seen.x.mean(axis=0))
    spread = coordinates_in_form(model, seen, form.fixed, form.conditions)
    problem = FreeRun(model, spread, segments, transient, control.check)
    minimum = replace(_gauss_newton(problem, states, 0, tolerance, control, True), ending=last.minimum.ending)
    if ended:
        end = last.minimum
        minimum = replace(minimum, findings=end.findings, iterations=end.iterations, costs=end.costs)
        minimum = confirmed(minimum, _in_form(others, model, seen, spread, segments, last.states)).judged()
    free = spread.shape[1]
    own = minimum.covariance[:free, :free]
    lost = np.isinf(np.diag(own))
    covariance = spread @ np.where(np.isfinite(own), own, 0.0) @ spread.T
    unknown = np.abs(spread[:, lost]).max(axis=1, initial=0.0) > 0
    covariance[unknown, unknown] = np.inf
    kept = np.flatnonzero(np.diag(covariance) > 0)
    fit = minimum.fit(model, [model.names[k] for k in kept])
    about_maps = [
        replace(each, data={"map": k + 1, **each.data})
        for k, map_ in enumerate(model.maps)
        for each in map_.findings(seen.z[:, k])
    ]
    return replace(
        fit,
        findings=(*_findings(minimum, [model.names[k] for k in np.flatnonzero(unknown)]), *about_maps),
        estimate=model.parameters[kept],
        covariance=covariance[np.ix_(kept, kept)],
        dependent=form.dependent,
    )


Other = tuple[float, FeedbackModel]
"""The cost of another search, and the model where it ends."""


def _last_steps(
    found: Found,
    segments: Segments,
    transient: int,
    iterations: int,
    tolerance: float,
    control: Control,
    refused: Refusal | None,
) -> tuple[Found, list[Other]]:
    """The minimum near one that has settled, and where others end around it.

    Others are begun if the search does not converge in a record that is not long.
    """
    same = whitened(found.model, visited(found.model, segments, found.states))
    states = [same.state(x) for x in found.states]
    spread = coordinates(same.model, visited(same.model, segments, states))
    limit = _limit(refused, same.model, segments, states)
    problem = FreeRun(same.model, spread, segments, transient, control.check, limit)
    minimum = _gauss_newton(problem, states, iterations, tolerance, control, False)
    ends: Ends = []
    if iterations and sum(len(y) for _, y in segments) <= BEGUN_AGAIN:

        def search(theta: Array, **options: Any) -> Minimum:
            given: dict[str, Any] = {
                "max_iterations": iterations,
                "tolerance": tolerance,
                "control": control,
                "covariances": False,
            }
            return _search(problem, theta, **(given | options))

        def around(theta: Array, **options: Any) -> Minimum:
            return search(nearer(problem, theta, minimum), **options)

        minimum, ends = begun_around(minimum, search, spread.shape[1], control, around=around, turns=TURNS)
    states = [problem.state(minimum.estimate, k) for k in range(len(segments))]
    others = [(cost, problem.at(own)) for cost, own in ends]
    return Found(problem.at(minimum.estimate), states, minimum, True), others


def _in_form(
    others: Sequence[Other], model: FeedbackModel, seen: Visited, spread: Array, segments: Segments, states: list[Array]
) -> Ends:
    """The costs of other models, and their parameters (f,) in the coordinates of a fitted one in the normal form.

    Args:
        others: in the coordinates of the last steps.
        model: the fitted one, in the normal form.
        seen: its signals.
        spread: (p, f) of its coordinates.
        segments: (u, y) of each.
        states: (n,) of each, in the coordinates of the last steps.
    """
    ends = []
    for cost, other in others:
        with suppress(EmsidError):
            form = normal_form(other, visited(other, segments, states)).model
            ends.append((cost, in_coordinates(model, seen, spread, form.parameters - model.parameters)))
    return ends


def _findings(minimum: Minimum, unknown: list[str]) -> tuple[Finding, ...]:
    """The findings of a minimum; coordinates without effect are named by the parameters that they move."""
    return tuple(
        Finding(each.code, data={"without_effect": unknown, "inseparable": []})
        if each.code == "parameters-undetermined"
        else each
        for each in minimum.findings
    )


def _gauss_newton(
    problem: FreeRun,
    states: Sequence[Array],
    iterations: int,
    tolerance: float,
    control: Control,
    covariances: bool,
    least_saving: float = 0.0,
    left_out: Sequence[Mask] | None = None,
) -> Minimum:
    theta = np.concatenate([np.zeros(problem.spread.shape[1]), *states])
    return _search(
        problem,
        theta,
        max_iterations=iterations,
        tolerance=tolerance,
        control=control,
        covariances=covariances,
        least_saving=least_saving,
        left_out=left_out,
    )


def _search(problem: FreeRun, theta: Array, *, left_out: Sequence[Mask] | None = None, **options: Any) -> Minimum:
    """`gauss_newton` from (φ, states), with these options of it."""
    free = problem.spread.shape[1]
    low, high = np.full(len(theta), -np.inf), np.full(len(theta), np.inf)
    if len(theta) - free > MOST_STATES:
        low[free:] = high[free:] = theta[free:]
    return gauss_newton(
        without(problem, left_out),
        theta,
        lower=low,
        upper=high,
        names=(
            *(f"coordinate {k + 1}" for k in range(free)),
            *("initial states" for _ in range(len(theta) - free)),
        ),
        interruptible=max(len(y) for _, y in problem.segments) > BLOCK,
        smoothing=Smoothing(problem.penalties),
        accelerated=True,
        **options,
    )


def visited(model: FeedbackModel, segments: Segments, states: Sequence[Array]) -> Visited:
    """The signals of a model over the segments.

    Raises:
        ModelError: if its run diverges, or its signals have no size.
    """
    seen = Visited.of(model, [u for u, _ in segments], states)
    check_size(model, seen)
    return seen
