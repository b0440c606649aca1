r"""What a search adds to a plant that has no table of moves: a filter of its speed, and a resistance that changes.

Firmware of drives logs a speed that a phase-locked loop or a low-pass takes from the angle: that of an ODrive by
default follows with 1/(1 + s/ω₀)², ω₀ = 1,000 rad/s, 2 ms late. A motor without the filter explains it by more inertia,
less friction and more resistance: of a servo of 1 Ω, simulated in the frame of its stator with a loop of 942 rad/s, the
resistance was 1.16 ± 0.08 Ω and the inertia 6.6 % too large; with a lag of first order they are 1.05 ± 0.04 Ω and 1.3 %
too small.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.continuation import Reached
from emsid.models.plants.search.moves import COOLING
from emsid.models.plants.search.rising import OF_RISE
from emsid.models.plants.search.scored import bounds_of, effect_of, score_at
from emsid.models.plants.search.task import Task
from emsid.selection.improvement import schwarz_gain

LAG = "sensor_lag"
LATE = (1.0, 10.0, 100.0)
"""Lags in samples at which the score is taken: a lag without effect has no derivative, and one that is a decade off has
one of nearly the same form."""
MOST = 60
"""Steps of a search with an addition, as of every other."""

Searched = tuple[Task, Plant, Reached]
Names = tuple[str, ...]


def with_filter(task: Task, start: Plant, reached: Reached) -> Searched:
    """The end of a search, or that with a filter of the speed where this is better."""
    plant = reached.problem.plant
    if LAG in plant.handles and LAG not in plant.without_effect(task.signals) and not plant.value(LAG):
        lags = [late * task.segments[0].dt for late in LATE]
        return _better(task, start, reached, (LAG,), [[(plant.with_values({LAG: lag}), (LAG,)) for lag in lags]])
    return task, start, reached


def with_rise(task: Task, start: Plant, reached: Reached) -> Searched:
    """The end of a search, or that with a changing resistance where this is better: by heating, or with time."""
    plant = reached.problem.plant
    if not {*OF_RISE} <= plant.handles.keys() or plant.changes_resistance:
        return task, start, reached
    if not plant.with_values({"heating": 1.0}).changes_resistance:
        return task, start, reached
    seconds = max(map(len, task.segments)) * task.segments[0].dt
    rates = [rate / seconds for rate in COOLING if rate / seconds <= plant.handles["cooling"].upper]
    cooled = [(plant.with_values({"cooling": rate}), ("heating", "cooling")[: 1 + bool(rate)]) for rate in rates]
    return _better(task, start, reached, OF_RISE, [cooled, [(plant, ("winding_drift",))]])


def _better(
    task: Task, start: Plant, reached: Reached, new: Names, additions: Iterable[Sequence[tuple[Plant, Names]]]
) -> Searched:
    """The end of a search, or the one with an addition that Schwarz's criterion prefers.

    Of every addition, the form that promises most is refitted, if its score promises something.

    Args:
        task, start, reached: the search.
        new: all parameters that are added; nothing is where one of them is asked for or known.
        additions: the forms of each, as a plant at which its effect is taken, and its parameters, the first of which is
            zero without it.
    """
    best = task, start, reached
    if not reached.unended or {*new} & {*task.asked, *task.fixed, *task.sheet}:
        return best
    for forms in additions:
        with suppress(EmsidError, Stopped):
            problem, score, most = reached.problem, score_at(reached.problem), None
            for plant, names in forms:
                bounds = bounds_of(problem.plant, names[:1])
                promise = score.promise(effect_of(problem, plant, names[:1]), *bounds, least=1.0)
                if promise.gain > 0 and (most is None or promise.gain > most[0]):
                    most = promise.gain, plant.with_values({names[0]: float(promise.step[0])}), names
            if most is None:
                continue
            _, plant, names = most
            limits = {name: (plant.handles[name].lower, plant.handles[name].upper) for name in names}
            wider = replace(task, asked=(*task.asked, *names), limits={**task.limits, **limits})
            found = continuation.search(wider, plant, MOST, reached.states)
            more = len(found.names) - len(best[2].names)
            if schwarz_gain(found.cost, best[2].cost, effective_samples(found.residuals), more) > 0:
                best = wider, start, found
    return best
