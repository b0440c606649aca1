"""Which plant, when nobody says: refinements are kept only if they simulate held-back data better.

A motor begins with what every motor has. Real drives add to that: a bridge that coasts, a delay, a lag of the sensor, a
Stribeck excess, friction that differs by direction, a constant torque. Every refinement is first tried alone, fitted to
a part of the record and judged by its free run over the rest. In the order of what they gain there they are then put
together, and each is kept if the free run improves by more than a little: taken in any fixed order, a refinement could
stand in for another one that would have explained more. The plant that is left is fitted to the whole record.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending
from emsid.models.plants.datasheet import Given, applicable
from emsid.models.plants.drive import Feed
from emsid.models.plants.grey_box import BEGINNING, fed
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import parts, without_overlap
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.problem import Weighting, all_alike
from emsid.models.plants.search.result import GreyBoxFit
from emsid.plant import Friction, Motor
from emsid.record import Record

_PLAIN = replace(Motor(), rotor_friction=Friction(8e-3), load_friction=Friction())

STARTS: Mapping[str, Mechanical] = {
    "rigid-motor": DrivenMotor(replace(_PLAIN, inductance=0.0, load_inertia=1e-15, load_viscous=0.0).rigid()),
    "motor": DrivenMotor(_PLAIN),
    "linear-axis": LinearAxis(),
}
"""A plant of every kind to begin with where nothing is known: the regression on the record finds its scale, and nothing
in it that is not estimated, such as a Stribeck excess or the load's share of one inertia, has a scale of its own."""

LEAST_GAIN = 0.1
"""A refinement has to lower the mean square error of the held-back free run by this part.

A free run drifts, so its errors hang together over seconds and the held-back part holds few independent ones: a gain of
a few percent is chance.
"""

TRIAL_ITERATIONS = 15
"""Of the search for a trial: one that needs more follows a parameter that the record hardly tells."""

Mechanical = DrivenMotor | LinearAxis
Refinement = Callable[[Mechanical, tuple[str, ...], Record], tuple[Mechanical, tuple[str, ...]]]


def coasting_bridge(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """The bridge leaves the armature open in its off-time; without a supply given, the largest command is full duty."""
    if not isinstance(plant, DrivenMotor) or not plant.motor.is_rigid or plant.feed is not Feed.VOLTAGE:
        return plant, free
    supply = plant.drive.supply
    if not isfinite(supply):
        supply = plant.drive.largest(record.input)
    return replace(plant, drive=replace(plant.drive, supply=supply, freewheel=0.5)), (*free, "drive.freewheel")


def late_command(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """The command takes its time."""
    return plant.put({"drive.delay": 0.5 * record.dt}), (*free, "drive.delay")


def slow_sensor(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """The sensor filters."""
    return plant.put({"sensor.lag": record.dt}), (*free, "sensor.lag")


def stribeck(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """Friction is larger near rest."""
    name = _friction(plant)
    fastest = float(np.max(np.abs(record.output))) or 1.0
    level = plant.value(f"{name}.coulomb")
    rate = 10 / fastest if plant.name != "linear-axis" else 50.0
    plant = plant.put({f"{name}.stribeck": 0.3 * level, f"{name}.stribeck_rate": rate})
    return plant, (*free, f"{name}.stribeck", f"{name}.stribeck_rate")


def by_direction(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """Coulomb levels, viscous friction of an axis and break points differ by direction.

    A constant load is the same thing as a difference of Coulomb levels, at rest as in motion: the levels take it over
    where both are free.
    """
    split: list[str] = []
    for name in free:
        apart = name.endswith((".coulomb", "viscous_friction", ".half_width"))
        split += (parts(plant, name) if apart else ()) or (name,)
    load, levels = _load(plant), parts(plant, f"{_friction(plant)}.coulomb")
    if load in free and set(levels) <= set(split):  # a level that is known leaves the load what it is
        pull, (forward, backward) = plant.value(load), levels
        plant = plant.put(
            {
                forward: max(plant.value(forward) + pull, 0.0),
                backward: max(plant.value(backward) - pull, 0.0),
                load: 0.0,
            }
        )
        split.remove(load)
    return plant, tuple(split)


def constant_load(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """Something pulls all the time."""
    if set(parts(plant, f"{_friction(plant)}.coulomb")) <= set(free):
        return plant, free  # a difference of levels already says it
    return plant, tuple(dict.fromkeys((*free, _load(plant))))


REFINEMENTS: tuple[Refinement, ...] = (
    coasting_bridge, late_command, slow_sensor, stribeck, by_direction, constant_load,
)  # fmt: skip


def choose(
    plant: Mechanical,
    record: Record,
    *,
    fixed: Mapping[str, float] | None = None,
    datasheet: Mapping[str, Given] | None = None,
    weighting: Weighting = all_alike,
    held_back: float = 0.25,
    refinements: tuple[Refinement, ...] = REFINEMENTS,
    progress: Callable[[float], None] = lambda fraction: None,
) -> GreyBoxFit:
    """The plant with those refinements that the held-back part of the record asks for, fitted to all of it.

    Args:
        plant: to begin with.
        record: what to identify from.
        fixed, weighting: as in `simulation_error`; they hold for every trial.
        datasheet: likewise, as far as it is `applicable` to the plant.
        held_back: fraction of the record that decides; see `Record.hold_back`.
        refinements: what is tried.
        progress: called with the fraction done.
    """
    driven = fed(plant, record)
    assert isinstance(driven, (DrivenMotor, LinearAxis))
    plant = driven
    sheet = applicable(datasheet or {}, plant)
    known: dict[str, Any] = {"fixed": fixed or {}, "datasheet": sheet, "weighting": weighting}
    unknown = (name for name, given in sheet.items() if given.value is None)
    usual = without_overlap(plant, (*plant.usual, *unknown), known["fixed"])
    if not refinements:
        return simulation_error(plant, record, free=usual, **known)
    train, rest = record.hold_back(held_back)

    def tried(start: Mechanical, free: tuple[str, ...], **how: Any) -> _Trial:
        fit = simulation_error(start, train, free=free, max_iterations=TRIAL_ITERATIONS, **how, **known)
        if fit.ending is Ending.INTERRUPTED:  # a trial cut short decides nothing
            raise KeyboardInterrupt
        return _Trial(fit, free, _held_back_error(fit, rest))

    def refined(by: Refinement, base: _Trial, threads: int | None = None) -> _Trial | None:
        plant, free = by(base.plant, base.free, train)
        free = without_overlap(plant, free, known["fixed"])
        try:
            return None if free == base.free else tried(plant, free, look_around=False, threads=threads)
        except EmsidError:
            return None  # a refinement that cannot be fitted is none

    plain = tried(plant, usual)
    best = plain
    try:
        progress(0.2)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            alone = pool.map(lambda refine: (refined(refine, plain, threads=1), refine), refinements)
            ranked = sorted(((trial, refine) for trial, refine in alone if trial), key=lambda one: one[0].error)
        progress(0.5)
        for k, (trial, refine) in enumerate(ranked):
            progress(0.5 + 0.4 * k / len(ranked))
            candidate = trial if best is plain else refined(refine, best)
            if candidate is not None and candidate.error < (1 - LEAST_GAIN) * best.error:
                best = candidate
    except KeyboardInterrupt:
        words = "interrupted during the choice of refinements; the best so far is kept, fitted to a part of the record"
        return replace(best.fit, ending=Ending.INTERRUPTED, message="; ".join(filter(None, [words, best.fit.message])))
    return simulation_error(best.plant, record, free=best.free, look_around=False, **known)


class _Trial(NamedTuple):
    """A plant fitted to the first part of the record, and the mean square error of its free run over the rest."""

    fit: GreyBoxFit
    free: tuple[str, ...]
    error: float

    @property
    def plant(self) -> Mechanical:
        """The plant as it was fitted."""
        plant = self.fit.model.plant
        assert isinstance(plant, (DrivenMotor, LinearAxis))
        return plant


def _held_back_error(fit: GreyBoxFit, rest: Record) -> float:
    """All trials begin alike, whatever they need for it: a better beginning is no better plant."""
    longest = max(len(segment) for segment in rest.segments)
    run = fit.model.simulate(rest, BEGINNING if longest > 2 * BEGINNING else None)
    error = float(np.mean((rest.output - run.output)[run.counted] ** 2)) if run.counted.any() else np.inf
    return error if isfinite(error) else np.inf


def _friction(plant: Mechanical) -> str:
    return "rotor_friction" if isinstance(plant, DrivenMotor) else "friction"


def _load(plant: Mechanical) -> str:
    return "load_torque" if isinstance(plant, DrivenMotor) else "offset"
