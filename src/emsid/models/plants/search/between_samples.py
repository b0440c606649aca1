"""The hold of a command between its samples, chosen by the free run if the samples do not show it.

A continuous command that is simulated as held is half a sample late, and the estimates of inertia, friction and dead
zone are biased by that. A command that repeats its values or jumps in one record is held there, whatever its hold in
the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from emsid.arguments import did_you_mean
from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.excitation.between_samples import may_be_continuous, repeats
from emsid.findings import Finding
from emsid.models.plants.drive import FEWEST, Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.continuation import Reached, search_once
from emsid.models.plants.search.task import Task
from emsid.record import Record
from emsid.selection.improvement import matters

CLEAR = 10.0
"""The logarithm of a ratio of likelihoods above which the records show the hold of the input."""


def as_hold(hold: Hold | str) -> Hold:
    """A `Hold`, or the one of this name.

    Raises:
        ModelError: for another name.
    """
    names = [each.value for each in Hold]
    if not isinstance(hold, Hold) and hold not in names:
        raise ModelError(
            f"hold is {hold!r}; give zero (held), first (straight from sample to sample) or record (as each one shows)"
            f"{did_you_mean(str(hold), names)}",
            arguments=("hold",),
        )
    return Hold(hold)


def is_open(plant: Plant, segments: Sequence[Record]) -> bool:
    """Whether the free run must decide on the hold of a command: it is smooth in some records."""
    driven = plant.of_record(0)
    if not isinstance(driven, DrivenPlant) or driven.drive.codes or plant.hold is not Hold.ZERO:
        return False
    commands = [driven.drive.commands(segment.input) for segment in segments]
    enough = [command for command in commands if len(command) >= FEWEST]
    return any(may_be_continuous([command]) for command in enough) if enough else may_be_continuous(commands)


def holds_in(plant: Plant, segments: Sequence[Record]) -> tuple[Hold, ...]:
    """The hold of the command of a plant in every segment."""
    return tuple(plant.for_inputs(segment.input).hold for segment in segments)


def promising(task: Task, problem: FreeRunError, cost: float) -> list[Plant]:
    """Plants with linearly interpolated commands in some or all records, if they may simulate better than a minimum.

    First with interpolation in records whose command never jumps, then in all, unless a command is clearly held.
    """
    open_to_all = all(is_open(problem.plant, (segment,)) for segment in task.segments)
    found: list[Plant] = []
    patterns = {(Hold.ZERO,) * len(task.segments)}
    for hold in (Hold.RECORD, Hold.FIRST) if open_to_all else (Hold.RECORD,):
        plant = problem.plant.with_hold(hold)
        pattern, names = holds_in(plant, task.segments), list(problem.free)
        if pattern not in patterns and promises_more(
            problem, task.problem(plant, names, problem.states(problem.start)), cost
        ):
            found.append(plant)
        patterns.add(pattern)
    return found


def promises_more(problem: FreeRunError, other: FreeRunError, cost: float) -> bool:
    """Whether another course of the input between its samples may simulate better than the minimum of a problem.

    The parameters can lower its free-run error by what they explain to first order, so no search is needed to rule it
    out.

    Args:
        problem: begun at its minimum.
        other: of the same parameters, begun there.
        cost: of the minimum.
    """
    try:
        residual = np.concatenate(other.residuals(other.start))
    except Infeasible:
        return False
    slopes = np.concatenate([jacobian for _, jacobian in problem.linearised(problem.start)])
    sizes = np.linalg.norm(slopes, axis=0)
    slopes = slopes / np.where(sizes > 0, sizes, 1.0)
    left = residual - slopes @ np.linalg.lstsq(slopes, residual, rcond=1e-9)[0]
    return bool(0.5 * float(left @ left) < cost)


def straight_if_better(task: Task, reached: Reached, max_iterations: int) -> Reached:
    """The end of a search with a linearly interpolated command, if that simulates better."""
    with suppress(Stopped):
        for straight in promising(task, reached.problem, reached.cost):
            again = continuation.search(task, straight, max_iterations)
            if again.cost < reached.cost:
                reached = again
    return reached


def taken_as_constant(task: Task, problem: FreeRunError, minimum: Minimum) -> list[Finding]:
    """A finding where a user's plant simulates better with an input that goes on more smoothly between its samples.

    The program does not change the hold itself, since the equations may be those of a sampled system. The parameters
    are fitted again in a few steps, because those of a held input compensate for some of the delay, and
    those of a linear one for some of its damping.

    Args:
        task: what was asked.
        problem, minimum: the last problem of the search, and its end.
    """
    others = () if task.hold_given else problem.plant.interpolating()
    if not others or all(repeats([segment.input[:, k]]) for segment in task.segments for k in range(_inputs(task))):
        return []
    states, least = problem.states(problem.start), minimum.cost
    found: list[Finding] = []
    for other in others:
        try:
            again = search_once(task.problem(other, list(problem.free), states), task)
        except (EmsidError, Stopped):
            continue
        gained = effective_samples(again.residuals) * np.log(minimum.cost / again.cost) if again.cost > 0 else np.inf
        if again.cost < least and matters(again.cost, minimum.cost) and gained > CLEAR:
            least = again.cost
            data = {"between": getattr(other, "between", ""), "ratio": float(np.sqrt(minimum.cost / again.cost))}
            code = "input-taken-as-constant" if problem.plant.hold is Hold.ZERO else "input-taken-as-linear"
            found = [Finding(code, task.segments[0].input_names[0], data)]
    return found


def _inputs(task: Task) -> int:
    return int(task.segments[0].input.shape[1])
