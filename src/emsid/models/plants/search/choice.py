"""Which refinements a plant needs: those with which it simulates held-back data better.

A motor begins with what every motor has. Real drives add to that: a bridge that coasts, a delay, a lag of the sensor, a
Stribeck excess, friction that differs by direction, a constant torque. Every refinement is first tried alone, fitted to
a part of the record and judged by its free run over the rest. In the order of what they gain there they are then put
together, and each is kept if the free run improves by more than a little: taken in any fixed order, a refinement could
stand in for another one that would have explained more. The plant that is left is fitted to the whole record.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Activity, Control, Stopped
from emsid.findings import Finding
from emsid.models.free_run import free_run_error
from emsid.models.plants.datasheet import Given, applicable
from emsid.models.plants.free_run_error import Weighting, all_alike
from emsid.models.plants.parameters import full_name, parts, without_overlap
from emsid.models.plants.plant import BEGINNING, DrivenPlant, Plant
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit
from emsid.record import Record, hold_back
from emsid.selection.improvement import Gain, better

STARTS: Mapping[str, Plant] = {name: kind.start for name, kind in PLANTS.items()}
"""A plant of every kind to begin with where nothing is known."""

TRIAL_ITERATIONS = 15
"""Of the search for a trial: one that needs more follows a parameter that the record hardly tells."""

Refinement = Callable[[DrivenPlant, tuple[str, ...], Record], tuple[DrivenPlant, tuple[str, ...]]]


def coasting_bridge(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> tuple[DrivenPlant, tuple[str, ...]]:
    """The bridge leaves the armature open in its off-time; without a supply given, the largest command is full duty."""
    if not plant.can_coast:
        return plant, free
    supply = plant.drive.supply
    if not isfinite(supply):
        supply = plant.drive.largest(record.input)
    return plant.with_drive(supply=supply, freewheel=0.5), (*free, "drive.freewheel")


def late_command(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> tuple[DrivenPlant, tuple[str, ...]]:
    """The command takes its time."""
    return plant.put({"drive.delay": 0.5 * record.dt}), (*free, "drive.delay")


def slow_sensor(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> tuple[DrivenPlant, tuple[str, ...]]:
    """The sensor filters."""
    return plant.put({"sensor.lag": record.dt}), (*free, "sensor.lag")


def stribeck(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> tuple[DrivenPlant, tuple[str, ...]]:
    """Friction is larger near rest."""
    name = plant.friction_name
    if f"{name}.stribeck" not in plant.handles:  # another friction law
        return plant, free
    level = plant.value(f"{name}.coulomb")
    rate = plant.stribeck_rate(float(np.max(np.abs(record.output))) or 1.0)
    plant = plant.put({f"{name}.stribeck": 0.3 * level, f"{name}.stribeck_rate": rate})
    return plant, (*free, f"{name}.stribeck", f"{name}.stribeck_rate")


def by_direction(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> tuple[DrivenPlant, tuple[str, ...]]:
    """Coulomb levels, viscous friction of an axis and break points differ by direction.

    A constant load is the same thing as a difference of Coulomb levels, at rest as in motion: the levels take it over
    where both are free.
    """
    split: list[str] = []
    for name in free:
        apart = name == _level(plant) or name.endswith(("viscous_friction", ".half_width"))
        split += (parts(plant, name) if apart else ()) or (name,)
    load, levels = plant.load_name, parts(plant, _level(plant))
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


def constant_load(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> tuple[DrivenPlant, tuple[str, ...]]:
    """Something pulls all the time."""
    if set(parts(plant, _level(plant))) <= set(free):
        return plant, free  # a difference of levels already says it
    return plant, tuple(dict.fromkeys((*free, plant.load_name)))


REFINEMENTS: tuple[Refinement, ...] = (
    coasting_bridge, late_command, slow_sensor, stribeck, by_direction, constant_load,
)  # fmt: skip


def choose(
    plant: DrivenPlant,
    record: Record,
    *,
    fixed: Mapping[str, float] | None = None,
    datasheet: Mapping[str, Given] | None = None,
    weighting: Weighting = all_alike,
    held_back: float = 0.25,
    refinements: tuple[Refinement, ...] = REFINEMENTS,
    control: Control = FREE,
) -> GreyBoxFit:
    """The plant with those refinements that the held-back part of the record asks for, fitted to all of it.

    Args:
        plant: to begin with.
        record: what to identify from.
        fixed, weighting: as in `simulation_error`; they hold for every trial.
        datasheet: likewise, as far as it is `applicable` to the plant.
        held_back: fraction of the record that decides; see `emsid.record.hold_back`.
        refinements: what is tried.
        control: when to stop, and whom to tell what is tried; where it stops during the choice, the best plant so far
            is kept.

    Raises:
        Stopped: where it stops before the first trial has ended.
    """
    plant = plant.fed(record)
    sheet = applicable(datasheet or {}, plant)
    fixed = {full_name(plant, name): value for name, value in (fixed or {}).items()}
    unknown = (name for name, given in sheet.items() if given.value is None)
    usual = without_overlap(plant, (*plant.usual, *unknown), fixed)
    known: dict[str, Any] = {"fixed": fixed, "datasheet": sheet, "weighting": weighting, "control": control}
    if not refinements:
        return simulation_error(plant, record, free=usual, **known)
    trials = _Trials(*hold_back(record, held_back), known)
    control.doing(f"{plant.name}: fitting without refinements")
    best = trials.fitted(plant, usual)
    try:
        best = _refined(trials, best, refinements, control)
    except Stopped as stopped:
        findings = (Finding("choice-interrupted", plant.name), *best.fit.findings)
        return replace(best.fit, ending=stopped.ending, findings=findings)
    control.report(Activity(f"{plant.name}: fitting to the whole record"))
    return simulation_error(best.plant, record, free=best.free, look_around=False, **known)


def _refined(trials: _Trials, plain: _Trial, refinements: Sequence[Refinement], control: Control) -> _Trial:
    """The best of the trials where refinements are added one after the other, those first that gain most alone."""
    best, name = plain, plain.plant.name
    control.doing(f"{name}: trying {len(refinements)} refinements")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        alone = pool.map(lambda refine: (trials.refined(refine, plain, threads=1), refine), refinements)
        ranked = sorted(((trial, refine) for trial, refine in alone if trial), key=lambda one: one[0].error)
    for k, (trial, refine) in enumerate(ranked):
        control.doing(f"{name}: adding refinements", k, len(ranked))
        candidate = trial if best is plain else trials.refined(refine, best)
        if candidate is not None and better(candidate.error, best.error, Gain.PLANT):
            best = candidate
    return best


class _Trials(NamedTuple):
    """How a plant is tried: fitted to the first part of a record, and its free run compared with the rest.

    Attributes:
        train, rest: the two parts.
        known: arguments of `simulation_error` that hold for every trial.
    """

    train: Record
    rest: Record
    known: Mapping[str, Any]

    def fitted(self, start: DrivenPlant, free: tuple[str, ...], **how: Any) -> _Trial:
        """One trial.

        Raises:
            Stopped: where it was interrupted: a trial cut short decides nothing.
        """
        fit = simulation_error(start, self.train, free=free, max_iterations=TRIAL_ITERATIONS, **how, **self.known)
        if fit.ending is Ending.INTERRUPTED:
            raise Stopped(fit.ending)
        return _Trial(fit, free, _held_back_error(fit, self.rest))

    def refined(self, by: Refinement, base: _Trial, threads: int | None = None) -> _Trial | None:
        """A trial with one more refinement; None where that changes nothing or cannot be fitted."""
        plant, free = by(base.plant, base.free, self.train)
        free = without_overlap(plant, free, self.known["fixed"])
        try:
            return None if free == base.free else self.fitted(plant, free, look_around=False, threads=threads)
        except EmsidError:
            return None


class _Trial(NamedTuple):
    """A plant fitted to the first part of the record, and the mean square error of its free run over the rest."""

    fit: GreyBoxFit
    free: tuple[str, ...]
    error: float

    @property
    def plant(self) -> DrivenPlant:
        """The plant as it was fitted."""
        plant = self.fit.model.plant.driven
        assert plant is not None
        return plant


def _held_back_error(fit: GreyBoxFit, rest: Record) -> float:
    """All trials begin alike, whatever they need for it: a better beginning is no better plant."""
    longest = max(len(segment) for segment in rest.segments)
    if longest <= fit.model.memory:
        return np.inf
    return free_run_error(fit.model, [rest], BEGINNING if longest > 2 * BEGINNING else None)


def _level(plant: DrivenPlant) -> str:
    """The name of the level of its friction, the first parameter of the law."""
    return f"{plant.friction_name}.{plant.frictions[plant.friction_name].parameters[0].name}"
