r"""How the resistance of a winding rose during the records of a fit.

The finding has the rise over the longest segment with its interval, to first order from the covariance of the
parameters it depends on, and of a thermal mass the time constant 1/k and the rise at which it would end, ρ_∞ = q/k.
The mean heating q of the segment follows from the motion of ρ there, q = Δρ/t + k·ρ̄.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding, finite
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.continuation import Reached
from emsid.models.plants.search.moves import COOLING
from emsid.models.plants.search.scored import bounds_of, effect_of, score_at
from emsid.models.plants.search.task import Task
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

PARTS = 50
"""Parts of the segment at whose ends the rise is looked at, for its mean."""
OF_RISE = ("heating", "cooling", "winding_drift")
"""The parameters that the rise depends on most."""
MOST = 60
"""Steps of the search with a changing resistance, as of every other."""
SMALL = 1e-3
"""Change of a parameter for derivatives, as a part of it."""


def with_rise(task: Task, start: Plant, reached: Reached) -> tuple[Task, Plant, Reached]:
    """The end of a search of a plant without a drive, or that with a changing resistance where this is better.

    Of the heating, at several rates of cooling, and of the drift, each is refitted if its score promises something, and
    Schwarz's criterion chooses among these ends and the one without either.
    """
    plant = reached.problem.plant
    known = {*task.asked, *task.fixed, *task.sheet}
    if not {*OF_RISE} <= plant.handles.keys() or not reached.unended or {*OF_RISE} & known:
        return task, start, reached
    if plant.changes_resistance or not plant.with_values({"heating": 1.0}).changes_resistance:
        return task, start, reached
    seconds = max(map(len, task.segments)) * task.segments[0].dt
    rates = [rate / seconds for rate in COOLING if rate / seconds <= plant.handles["cooling"].upper]
    cooled = [(plant.with_values({"cooling": rate}), ("heating", "cooling")[: 1 + bool(rate)]) for rate in rates]
    best = task, start, reached
    for several in (cooled, [(plant, ("winding_drift",))]):
        with suppress(EmsidError, Stopped):
            found = _refitted(task, reached, several)
            if found is not None and _preferred(found[1], best[2]):
                best = found[0], start, found[1]
    return best


def _preferred(found: Reached, other: Reached) -> bool:
    """Whether Schwarz's criterion prefers the end of a search to that of another one."""
    more = len(found.names) - len(other.names)
    return schwarz_gain(found.cost, other.cost, effective_samples(found.residuals), more) > 0


def _refitted(
    task: Task, reached: Reached, several: Sequence[tuple[Plant, tuple[str, ...]]]
) -> tuple[Task, Reached] | None:
    """The task and the end of a search with the addition, among plants with their new parameters, that promises most.

    None where none of them promises anything.
    """
    problem, score, best = reached.problem, score_at(reached.problem), None
    for begun, names in several:
        promise = score.promise(effect_of(problem, begun, names[:1]), *bounds_of(begun, names[:1]), least=1.0)
        if promise.gain > 0 and (best is None or promise.gain > best[0]):
            best = promise.gain, begun.with_values({names[0]: float(promise.step[0])}), names
    if best is None:
        return None
    _, begun, names = best
    limits = {name: (begun.handles[name].lower, begun.handles[name].upper) for name in names}
    wider = replace(task, asked=(*task.asked, *names), limits={**task.limits, **limits})
    return wider, continuation.search(wider, begun, MOST, reached.states)


def rising(problem: FreeRunError, names: Sequence[str], covariance: Array) -> list[Finding]:
    """The finding about the resistance, of a plant that has one which changes.

    Args:
        problem: begun at the estimates.
        names: (p,) the parameters that were estimated.
        covariance: (p, p) of them.
    """
    if not problem.plant.changes_resistance or not set(OF_RISE) & {*names}:
        return []
    plant = problem.plant
    k = int(np.argmax([len(segment) for segment in problem.segments]))
    seconds = len(problem.segments[k]) * problem.segments[k].dt
    with suppress(EmsidError):
        rise = _rise(problem, plant, k)
        change = float(rise[-1] - rise[0])
        moving = [name for name in names if name in OF_RISE and plant.value(name)]
        own = [names.index(name) for name in moving]
        slopes = []
        for name in moving:
            value = plant.value(name)
            moved = _rise(problem, plant.with_values({name: (1 + SMALL) * value}), k)
            slopes.append((moved[-1] - moved[0] - change) / (SMALL * value))
        half = HALF_WIDTH * float(np.sqrt(np.array(slopes) @ covariance[np.ix_(own, own)] @ np.array(slopes)))
        heats, cooling = bool(plant.value("heating")), plant.value("cooling")
        final = (change / seconds / cooling + float(np.mean(rise))) if heats and cooling > 0 else None
        data = {
            "rise": change, "half": finite(half), "seconds": seconds, "heats": heats, "final": final,
            "time_constant": 1.0 / cooling if final is not None else None,
        }  # fmt: skip
        return [Finding("resistance-changes", plant.name, data)]
    return []


def _rise(problem: FreeRunError, plant: Plant, k: int) -> Array:
    """(PARTS + 1,) ρ over a segment, from its start."""
    segment, state = problem.segments[k], problem.states(problem.start)[k]
    plant = plant.for_segment(segment)
    now = plant.start(state, segment.input[0], segment.dt, problem.signals, len(segment))
    found = [plant.rise_in(now)]
    for inputs in np.array_split(segment.input, min(PARTS, len(segment))):
        now = plant.run(now, np.ascontiguousarray(inputs), problem.signals)[1]
        found.append(plant.rise_in(now))
    return np.array(found)
