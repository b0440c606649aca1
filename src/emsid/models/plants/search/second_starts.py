r"""Second starts of a search that may have ended on the wrong side of a kink.

A cost has kinks where a parameter becomes zero, where a delay is a whole number of samples, and where the knee of a
drive is at a command that the record keeps for long. It also has a second minimum where two parameters of nearly the
same effect are exchanged:

- a Coulomb level and a Stribeck excess that hardly fades are both a constant friction;
- a lag τ of the sensor and the time constant T of one mass commute in a linear system,

  1/(1 + sT) · 1/(1 + sτ) = 1/(1 + sτ) · 1/(1 + sT),

  so that only nonlinear effects such as friction distinguish them. All inertias times τ/T and a lag of T exchange the
  two, and do not change the steady state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite, log

import numpy as np

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.starts import RATE, usual_rates
from emsid.models.plants.search.task import Task

Values = dict[str, float]

INSIDE = (0.1, 0.5)
"""Second starts of a parameter that ended at zero, as parts of its plausible size."""
SLOWER = (0.2, 1.0)
"""Second starts of the rate of Stribeck friction, as parts of usual rates."""
FADES = log(2.0)
"""If rate times top speed is smaller, an excess keeps more than half of its size and acts as a Coulomb level."""
ASIDE = (-0.5, 0.5)
"""Changes of a delay in samples, for second starts."""
KNEES = ((0.9, 1.1), (0.5, 2.0))
"""Factors of a knee for second starts: across a kink, and to another minimum."""
INERTIA = ("kg*m^2", "kg")
"""Units of an inertia."""


def second_starts(task: Task, plant: DrivenPlant, names: Sequence[str]) -> Iterator[list[Values]]:
    """Start values for second searches, in groups; a search begins at the best start of each.

    They include parameters that were not estimated because they have no effect where the search ended: the rate of an
        excess that is zero, or an inertia that is too small.

    Args:
        task: what is asked.
        plant: where a search ended.
        names: the parameters that it estimated, and those that are zero.
    """
    friction = [*_excess_again(task, plant), *_friction_exchanged(task, plant)]
    yield [*_inside(task, plant, names), *friction]
    yield _other_delays(task, plant, names)
    yield from _other_knees(task, plant, names)
    yield _lag_exchanged(task, plant)


def _inside(task: Task, plant: DrivenPlant, names: Sequence[str]) -> list[Values]:
    """Values away from zero for every parameter that is zero, with usual rates of a Stribeck excess."""
    scales = zip(names, task.problem(plant, names).scales, strict=True)
    zero = [
        (name, scale)
        for name, scale in scales
        if plant.value(name) == task.limits[name][0] == 0 and not _is_excess(name)
    ]
    rates = usual_rates(task, names) if zero else {}
    return [_within(task, {**rates, name: part * scale}) for name, scale in zero for part in INSIDE]


def _excess_again(task: Task, plant: DrivenPlant) -> list[Values]:
    """Second starts of a Stribeck excess that is zero, or does not fade: slow, usual and the fastest resolved rates.

    One that does not fade is added to the Coulomb level. A search may have ceased to estimate it.
    """
    excesses, usual = [name for name in task.asked if _is_excess(name)], usual_rates(task, task.asked)
    fades = any(plant.value(rate) * RATE > FADES * value for rate, value in usual.items())
    if not (excesses and usual) or (fades and any(plant.value(name) for name in excesses)):
        return []
    levels = [name for name in task.asked if ".coulomb" in name]
    whole = {name: plant.value(name) + plant.value(name.replace(".coulomb", ".stribeck")) for name in levels}
    rates = [{rate: part * value for rate, value in usual.items()} for part in SLOWER]
    rates += [{rate: task.limits[rate][1] for rate in usual}] if all(isfinite(task.limits[r][1]) for r in usual) else []
    scales = task.problem(plant, excesses).scales.tolist()
    begun = [{name: part * scale for name, scale in zip(excesses, scales, strict=True)} for part in INSIDE]
    return [_within(task, {**whole, **rate, **excess}) for rate in rates for excess in begun]


def _is_excess(name: str) -> bool:
    return ".stribeck" in name and ".stribeck_rate" not in name


def _friction_exchanged(task: Task, plant: DrivenPlant) -> list[Values]:
    """Coulomb levels and Stribeck excesses exchanged if the excess is larger, which is rare."""
    levels = {name: name.replace(".coulomb", ".stribeck") for name in task.asked if ".coulomb" in name}
    pairs = [pair for pair in levels.items() if pair[1] in task.asked and plant.value(pair[1]) > plant.value(pair[0])]
    exchanged = {a: plant.value(b) for pair in pairs for a, b in (pair, pair[::-1])}
    return [_within(task, exchanged)] if exchanged else []


def _other_delays(task: Task, plant: DrivenPlant, names: Sequence[str]) -> list[Values]:
    """Delays beside that of a plant, where it is estimated."""
    here, dt = plant.value("drive.delay"), task.segments[0].dt
    return [_within(task, {"drive.delay": here + part * dt}) for part in ASIDE if "drive.delay" in names]


def _other_knees(task: Task, plant: DrivenPlant, names: Sequence[str]) -> list[list[Values]]:
    """Knees below and above that of a plant, where it is estimated.

    All parameters are estimated again: with a wrong knee, above which the motor hardly responds, its constant has no
        effect.
    """
    if "drive.knee" not in names:
        return []
    here = {name: plant.value(name) for name in task.asked}
    return [[_within(task, {**here, "drive.knee": factor * here["drive.knee"]}) for factor in pair] for pair in KNEES]


def _lag_exchanged(task: Task, plant: DrivenPlant) -> list[Values]:
    """The lag of the sensor and the time constant of the mass exchanged, where lag and inertia are estimated."""
    inertias = [name for name in task.asked if plant.handles[name].parameter.unit in INERTIA]
    lag = plant.value("sensor.lag")
    if "sensor.lag" not in task.asked or not inertias or lag == 0:
        return []
    linear = plant.with_values({"sensor.lag": 0.0}).linearised((Signal.SPEED,))
    rates = np.zeros(0) if linear is None else np.abs(np.linalg.eigvals(linear.a))
    if not np.any(rates > 0):
        return []
    slowest = float(np.min(rates[rates > 0]))
    changed = {name: plant.value(name) * lag * slowest for name in inertias}
    return [_within(task, {**changed, "sensor.lag": 1 / slowest})]


def _within(task: Task, values: Values) -> Values:
    return {name: float(np.clip(value, *task.limits[name])) for name, value in values.items()}
