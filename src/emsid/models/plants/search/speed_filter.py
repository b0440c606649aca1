r"""The filter of a measured speed, in the search for a plant without a drive.

Firmware of drives logs a speed that a phase-locked loop or a low-pass takes from the angle: that of an ODrive by
default follows with 1/(1 + s/ω₀)², ω₀ = 1,000 rad/s, 2 ms late. A motor without the filter explains it by more inertia,
less friction and more resistance: of a servo of 1 Ω, simulated in the frame of its stator with a loop of 942 rad/s, the
resistance was 1.16 ± 0.08 Ω and the inertia 6.6 % too large; with a lag of first order they are 1.05 ± 0.04 Ω and 1.3 %
too small.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.continuation import Reached
from emsid.models.plants.search.scored import bounds_of, effect_of, score_at
from emsid.models.plants.search.task import Task
from emsid.selection.improvement import schwarz_gain

LAG = "sensor_lag"
LATE = (1.0, 10.0, 100.0)
"""Lags in samples at which the score is taken: a lag without effect has no derivative, and one that is a decade off has
one of nearly the same form."""
MOST = 60
"""Steps of the search with the filter, as of every other."""


def with_filter(task: Task, start: Plant, reached: Reached) -> tuple[Task, Plant, Reached]:
    """The end of a search, or that with a filter of the speed where Schwarz's criterion prefers it.

    The lag is refitted if its score promises something.
    """
    problem, plant = reached.problem, reached.problem.plant
    known = {*task.asked, *task.fixed, *task.sheet, *plant.without_effect(task.signals)}
    if LAG not in plant.handles or LAG in known or plant.value(LAG) or not reached.unended:
        return task, start, reached
    with suppress(EmsidError, Stopped):
        score, lags = score_at(problem), [late * task.segments[0].dt for late in LATE]
        effects = [effect_of(problem, plant.with_values({LAG: lag}), (LAG,)) for lag in lags]
        promises = [score.promise(effect, *bounds_of(plant, (LAG,)), least=1.0) for effect in effects]
        best = max(promises, key=lambda each: each.gain)
        if best.gain <= 0:
            return task, start, reached
        limits = {**task.limits, LAG: (plant.handles[LAG].lower, plant.handles[LAG].upper)}
        wider = replace(task, asked=(*task.asked, LAG), limits=limits)
        found = continuation.search(wider, plant.with_values({LAG: float(best.step[0])}), MOST, reached.states)
        more = len(found.names) - len(reached.names)
        if schwarz_gain(found.cost, reached.cost, effective_samples(found.residuals), more) > 0:
            return wider, start, found
    return task, start, reached
