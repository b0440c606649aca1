r"""How a sample is taken: structures that simulate the records as well, and what they add to the uncertainty.

At a long sample time, a delay of the command, a lag of the sensor, an inductance and a mean over the sample have nearly
the same effect: a short time between command and output. They affect the other parameters differently: if an inductance
is modelled as a delay, the mechanical time constant is too short by about L/R, and if the mean of an encoder is not
modelled at all, slow ramps show an inertia that is larger by a quarter. Where the data do not show which of them is
present, the covariance of the estimates θ includes the structures θ̂ᵢ that are as good. The addition has the
correlations of Σ (θ̂ᵢ − θ̂)(θ̂ᵢ − θ̂)ᵀ, and makes each interval as wide as the largest difference and the interval itself
together, so that it holds what every structure says.

These structures are tried, whatever the outputs are:

- each of the others in place of the one that a plant has;
- if it has none, each of them with half a sample, which is what a mean over the sample is late; and where the residual
  shows a delay that is missing, each of them at its best.

A structure is fitted only if the linearised free run says that it is as good and moves a parameter. A time that was
given is never changed.

References:
    Burnham, Anderson, *Model Selection and Multimodel Inference*, 2nd ed. (2002), ch. 4, on variance from the choice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search import continuation
from emsid.models.plants.search.between_samples import CLEAR
from emsid.models.plants.search.conditions import TOLERABLE
from emsid.models.plants.search.moves import may_have_inductance
from emsid.models.plants.search.task import Task
from emsid.record import concatenate
from emsid.record.holding_back import excerpt
from emsid.selection.improvement import NEGLIGIBLE, matters

Array = NDArray[np.float64]

AVERAGE = "sensor.average"
SHORT_TIMES = ("drive.delay", "sensor.lag", "inductance", AVERAGE)
"""Parameters that look alike; each has no effect at zero."""
LATE = 0.5
"""Of a mean over the sample, in samples."""
MANY = 12_000
"""Alternatives are fitted to an excerpt of this many samples; their differences exceed the noise of longer ones."""
PIECES = 3
"""Of this excerpt."""
SMALL = 0.1
"""The delay in samples whose effect on the free run is compared with the residual."""
ROUGHLY = 0.1
"""A structure whose cost is larger by more than this part, to first order, is not fitted: its refit gains less."""


class Addition(NamedTuple):
    """The uncertainty of estimates that comes from errors of the model.

    Attributes:
        covariance: (p, p) added to the covariance of the estimates.
        findings: why.
    """

    covariance: Array
    findings: tuple[Finding, ...]


class Structure(NamedTuple):
    """Another structure, where its search begins.

    Attributes:
        name: of the short time that it has.
        plant: with a start of it.
        free: the names of its parameters.
    """

    name: str
    plant: DrivenPlant
    free: tuple[str, ...]


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
    none, plant = nothing(len(names)), problem.plant
    driven = plant.of_record(0)
    if not isinstance(driven, DrivenPlant) or not isinstance(plant, DrivenPlant) or driven.secondary:
        return none
    mine = next((name for name in SHORT_TIMES if _has(task, plant, names, name)), None)
    found: dict[str, Array] = {}
    whole = minimum
    try:
        missing = _missing_delay(task, problem, names, minimum) if mine is None else 0.0
        task, problem, minimum = _on_fewer(task, problem, names, minimum)
        for other in _structures(task, plant, names, mine, missing):
            with suppress(EmsidError):
                shift = _shift(task, problem, names, minimum, other)
                if shift is not None and np.any(np.abs(shift) > np.abs(found.get(other.name, 0.0))):
                    found[other.name] = shift
    except Stopped:
        return none
    if not found:
        return none
    data = {"instead": list(found), "of": mine, "late": missing > 0}
    errors = np.sqrt(np.diag(whole.covariance)[: len(names)])
    return Addition(spread(list(found.values()), errors), (Finding("alternatives-fit-as-well", driven.name, data),))


def _has(task: Task, plant: DrivenPlant, names: Sequence[str], name: str) -> bool:
    """Whether a plant has a short time that nobody gave."""
    return name in plant.handles and name not in task.fixed and (name in names or plant.value(name) != 0)


def spread(shifts: Sequence[Array], errors: Array) -> Array:
    """(p, p) the covariance that makes the intervals of estimates, with these errors (p,), hold shifts (p,)."""
    products = np.sum([np.outer(shift, shift) for shift in shifts], axis=0)
    sizes = np.sqrt(np.diag(products))
    moved = np.max(np.abs(shifts), axis=0) / HALF_WIDTH
    wider = np.sqrt(moved**2 + 2 * moved * np.where(np.isfinite(errors), errors, 0.0))
    scale = np.divide(wider, sizes, out=np.zeros_like(sizes), where=sizes > 0)
    return np.asarray(products * np.outer(scale, scale))


# --- the structures that are tried -----------------------------------------------------------------------------------


def _structures(
    task: Task, plant: DrivenPlant, names: Sequence[str], mine: str | None, missing: float
) -> Iterator[Structure]:
    """The other structures; see the beginning of this file.

    Args:
        task: what was asked.
        plant: with the estimates.
        names: the parameters that were estimated.
        mine: the short time that the plant has.
        missing: a delay in s that the residual shows.
    """
    half = LATE * task.segments[0].dt
    kept = tuple(name for name in names if name != mine)
    without = plant if mine is None else plant.with_values({mine: 0.0})
    for other in (name for name in SHORT_TIMES if name != mine and _may_have(task, plant, name)):
        if mine is None:
            yield _with(without, other, half, kept)
            if missing and other != AVERAGE:
                yield _with(without, other, missing, (*kept, other))
        elif other == AVERAGE:
            yield _with(without, other, half, kept)
            rest = _duration(plant, mine) - half
            if mine in names and rest > 0:  # a mean, and the rest of the time as it was
                yield Structure(other, _with(_at(plant, mine, rest), other, half, ()).plant, tuple(names))
        else:
            yield _with(without, other, half if mine == AVERAGE else _duration(plant, mine), (*kept, other))


def _may_have(task: Task, plant: DrivenPlant, name: str) -> bool:
    """Whether a plant can have a short time that it does not have, and that was not given."""
    if name not in plant.handles or name in task.fixed or plant.value(name):
        return False
    if name == AVERAGE:
        return bool({Signal.SPEED, Signal.ROTOR_SPEED} & set(task.signals))
    if name == "inductance":
        return may_have_inductance(plant)
    return set(task.signals) != {Signal.CURRENT} or name != "sensor.lag"


def _with(plant: DrivenPlant, name: str, time: float, free: tuple[str, ...]) -> Structure:
    """A plant with a short time in s."""
    return Structure(name, _at(plant, name, time), free)


def _at(plant: DrivenPlant, name: str, time: float) -> DrivenPlant:
    value = time * plant.value("resistance") if name == "inductance" else 1.0 if name == AVERAGE else time
    return plant.with_values({name: value})


def _duration(plant: DrivenPlant, name: str) -> float:
    """A short time in s; that of an inductance is L/R."""
    value = plant.value(name)
    return value / plant.value("resistance") if name == "inductance" else value


def _missing_delay(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> float:
    """The delay in s that would lower the cost most, to first order; zero where that does not matter."""
    if "drive.delay" in task.fixed:
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


def _on_fewer(
    task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum
) -> tuple[Task, FreeRunError, Minimum]:
    """The same on an excerpt of long records; those of a position show their start in few samples, so they stay."""
    if sum(map(len, task.segments)) <= MANY or task.signals == (Signal.POSITION,):
        return task, problem, minimum
    few = replace(task, segments=excerpt(concatenate(task.segments), MANY, PIECES).segments)
    begun = few.problem(problem.plant, names)
    minimum = continuation.search_once(begun, few)
    return few, begun.begun_at(minimum.estimate), minimum


# --- whether they are as good ---------------------------------------------------------------------------------------


def _shift(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum, other: Structure) -> Array | None:
    """(p,) the change of the estimates with another structure; None where it is not as good, or moves none of them.

    A rate of another shape of friction is no shared parameter.
    """
    states = problem.states(problem.start)
    same = other.plant.frictions == problem.plant.frictions
    shared = [n for n in names if n in other.free and (same or ".stribeck_rate" not in n)]
    if not _promises(task, problem, names, minimum, other, shared):
        return None
    handles = other.plant.handles
    limits = {**{name: (handles[name].lower, handles[name].upper) for name in other.free}, **task.limits}
    begun = task.problem(other.plant, other.free, states)
    found = continuation.search_once(begun, replace(task, limits=limits))
    if found.cost == inf or not as_good(found.cost, minimum.cost, problem):
        return None
    shift = np.zeros(len(names))
    for k, name in enumerate(names):
        if name in shared and minimum.free[k]:
            shift[k] = found.estimate[other.free.index(name)] - minimum.estimate[k]
    return shift


def as_good(cost: float, least: float, problem: FreeRunError) -> bool:
    """Whether a cost is not larger by what matters, nor by more than noise explains."""
    if cost <= least:
        return True
    return (
        not matters(least, than=cost)
        and effective_samples(problem.residuals(problem.start)) * log(cost / least) < CLEAR
    )


def _promises(
    task: Task,
    problem: FreeRunError,
    names: Sequence[str],
    minimum: Minimum,
    other: Structure,
    shared: Sequence[str],
) -> bool:
    """Whether another structure is about as good and moves a shared parameter, by its free run linearised."""
    begun = task.problem(other.plant, other.free, problem.states(problem.start))
    residual = np.concatenate(begun.residuals(begun.start))
    slopes = np.concatenate([jacobian for _, jacobian in begun.linearised(begun.start)])
    sizes = np.linalg.norm(slopes, axis=0)
    sizes[sizes == 0] = 1.0
    step = -np.linalg.lstsq(slopes / sizes, residual, rcond=1e-9)[0]
    left = residual + slopes / sizes @ step
    moved = dict(zip(other.free, step / sizes, strict=False))
    errors = dict(zip(names, np.sqrt(np.diag(minimum.covariance)), strict=False))
    moves = any(abs(moved[name]) > TOLERABLE * errors[name] for name in shared)
    return moves and 0.5 * float(left @ left) <= (1 + ROUGHLY) * minimum.cost
