r"""Structures that simulate the records as well, and what they add to the uncertainty of the shared parameters.

At a long sample time, a delay of the command, a lag of the sensor and an inductance have nearly the same effect: a
short time between command and speed. They affect the other parameters differently: if an inductance is modelled as a
delay, the mechanical time constant is too short by about L/R. The data do not show which of them is present. So the
covariance of the estimates θ includes their differences among the m structures θ̂ᵢ that are as good,

    C + 1/m·Σ (θ̂ᵢ − θ̂)(θ̂ᵢ − θ̂)ᵀ.

If the plant has none of them and the residual shows that one is missing, the fit with it is included.

References:
    Burnham, Anderson, *Model Selection and Multimodel Inference*, 2nd ed. (2002), ch. 4, on variance from the choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.findings import Finding
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search import continuation
from emsid.models.plants.search.refinements.stribeck_shape import with_usual_shape
from emsid.models.plants.search.task import Task
from emsid.record import concatenate
from emsid.record.excerpt import excerpt
from emsid.selection.improvement import NEGLIGIBLE, matters

Array = NDArray[np.float64]

SHORT_TIMES = ("drive.delay", "sensor.lag", "inductance")
"""Parameters that look alike; each has no effect at zero."""
STEPS = 20
"""Steps of the fit of an alternative."""
MANY = 12_000
"""Alternatives are fitted to an excerpt of this many samples; their differences exceed the noise of longer ones."""
PIECES = 3
"""Of this excerpt."""
SMALL = 0.1
"""The delay in samples whose effect on the free run is compared with the residual."""


class Addition(NamedTuple):
    """The uncertainty of estimates that comes from errors of the model.

    Attributes:
        covariance: (p, p) added to the covariance of the estimates.
        findings: why.
    """

    covariance: Array
    findings: tuple[Finding, ...]


def nothing(parameters: int) -> Addition:
    """No addition for this number of parameters."""
    return Addition(np.zeros((parameters, parameters)), ())


def alternatives(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Addition:
    """The structures that are as good as a minimum.

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    none = nothing(len(names))
    driven = problem.plant.of_record(0)
    if not isinstance(driven, DrivenPlant) or not driven.can_coast or driven.secondary:
        return none
    mine = next((name for name in SHORT_TIMES if name in names), None)
    try:
        time = _missing_delay(task, problem, names, minimum) if mine is None else _duration(problem, mine)
        if time == 0.0:
            return none
        task, problem, minimum = _on_fewer(task, problem, names, minimum)
        found = {
            other: moved
            for other in SHORT_TIMES
            if (moved := _moved(task, problem, names, minimum, mine, other, time)) is not None
        }
    except Stopped:
        return none
    if not found:
        return none
    shifts = np.array(list(found.values()))
    data = {"instead": list(found), "of": mine}
    return Addition(shifts.T @ shifts / len(found), (Finding("alternatives-fit-as-well", driven.name, data),))


def _on_fewer(
    task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum
) -> tuple[Task, FreeRunError, Minimum]:
    """The same on an excerpt of long records; those of a position show their start in few samples, so they stay."""
    if sum(map(len, task.segments)) <= MANY or task.signals == (Signal.POSITION,):
        return task, problem, minimum
    few = replace(task, segments=excerpt(concatenate(task.segments), MANY, PIECES).segments)
    begun = few.problem(problem.plant, names)
    minimum = continuation.search_once(begun, few, STEPS)
    return few, begun.begun_at(minimum.estimate), minimum


def _duration(problem: FreeRunError, name: str) -> float:
    """A short time in s; that of an inductance is L/R."""
    value = problem.plant.value(name)
    return value / problem.plant.value("resistance") if name == "inductance" else value


def _missing_delay(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> float:
    """The delay in s that would lower the cost most, to first order; zero where that does not matter."""
    if any(problem.plant.value(name) for name in SHORT_TIMES) or "drive.delay" in task.fixed:
        return 0.0
    step = SMALL * task.segments[0].dt
    late = task.problem(problem.plant.with_values({"drive.delay": step}), names, problem.states(problem.start))
    here, there = (np.concatenate(each.residuals(each.start)) for each in (problem, late))
    slopes = np.vstack([jacobian for _, jacobian in problem.exactly(problem.start)])
    sizes = np.linalg.norm(slopes, axis=0)
    slopes = slopes / np.where(sizes > 0, sizes, 1.0)
    effect = (there - here) / step
    effect = effect - slopes @ np.linalg.lstsq(slopes, effect, rcond=1e-9)[0]
    power = float(effect @ effect)
    delay = -float(effect @ here) / power if power > 0 else 0.0
    return delay if delay > 0 and 0.5 * delay**2 * power > NEGLIGIBLE * minimum.cost else 0.0


def _moved(
    task: Task,
    problem: FreeRunError,
    names: Sequence[str],
    minimum: Minimum,
    mine: str | None,
    other: str,
    time: float,
) -> Array | None:
    """(p,) the change of the estimates with another short time in place of one; None where that is not as good.

    A motor with an inductance has the usual shape of friction near rest. A rate of another shape is no shared
    parameter.
    """
    if other == mine or other in task.fixed or problem.plant.value(other) or other not in problem.plant.handles:
        return None
    value = time * problem.plant.value("resistance") if other == "inductance" else time
    kept = [name for name in names if name != mine]
    values = {other: value} if mine is None else {mine: 0.0, other: value}
    plant = with_usual_shape(problem.plant) if other == "inductance" else problem.plant
    not_shared = {mine, *(n for n in names if plant is not problem.plant and ".stribeck_rate" in n)}
    handle = problem.plant.handles[other]
    limits = {**task.limits, other: (handle.lower, handle.upper)}
    try:
        begun = task.problem(plant.with_values(values), [*kept, other], problem.states(problem.start))
        found = continuation.search_once(begun, replace(task, limits=limits), STEPS)
    except EmsidError:
        return None
    if found.cost == inf or matters(minimum.cost, than=found.cost):
        return None
    shift = np.zeros(len(names))
    for k, name in enumerate(names):
        if name not in not_shared and minimum.free[k]:
            shift[k] = found.estimate[kept.index(name)] - minimum.estimate[k]
    return shift
