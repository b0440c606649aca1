"""Which plant, when nobody says: refinements are kept only if they simulate held-back data better.

A motor begins with what every motor has. Then, one after the other, come what real drives add: a bridge that coasts, a
delay, a lag of the sensor, a Stribeck excess, levels that differ by direction, a constant torque. Each is fitted to
the first part of the record and kept if the free run over the rest improves by more than a little. The plant that is
left is fitted to the whole record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np

from emsid.errors import EmsidError
from emsid.models.grey_box_datasheet import Given
from emsid.models.grey_box_estimation import simulation_error
from emsid.models.grey_box_fit import GreyBoxFit
from emsid.models.plants import DrivenMotor, LinearAxis
from emsid.record import Record

LEAST_GAIN = 0.01
"""A refinement has to lower the mean square error of the held-back free run by this part."""

Mechanical = DrivenMotor | LinearAxis
Refinement = Callable[[Mechanical, tuple[str, ...], Record], tuple[Mechanical, tuple[str, ...]]]


def coasting_bridge(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """The bridge leaves the armature open in its off-time; without a supply given, the largest command is full duty."""
    if not isinstance(plant, DrivenMotor) or not plant.motor.is_rigid:
        return plant, free
    supply = plant.drive.supply
    if not isfinite(supply):
        supply = abs(plant.drive.gain) * float(np.max(np.abs(record.input)))
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
    """Coulomb levels, viscous friction of an axis and break points differ by direction."""
    split: list[str] = []
    for name in free:
        if name.endswith((".coulomb", "viscous_friction")):
            split += [f"{name}.forward", f"{name}.backward"]
        elif name.endswith(".half_width"):
            split += [name.replace("half_width", "b_l"), name.replace("half_width", "b_r")]
        else:
            split.append(name)
    return plant, tuple(split)


def constant_load(plant: Mechanical, free: tuple[str, ...], record: Record) -> tuple[Mechanical, tuple[str, ...]]:
    """Something pulls all the time."""
    name = "load_torque" if isinstance(plant, DrivenMotor) else "offset"
    return plant, tuple(dict.fromkeys((*free, name)))


REFINEMENTS: tuple[Refinement, ...] = (
    coasting_bridge, late_command, slow_sensor, stribeck, by_direction, constant_load,
)  # fmt: skip


def choose(
    plant: Mechanical,
    record: Record,
    *,
    fixed: Mapping[str, float] | None = None,
    datasheet: Mapping[str, Given] | None = None,
    held_back: float = 0.25,
    refinements: tuple[Refinement, ...] = REFINEMENTS,
    progress: Callable[[float], None] = lambda fraction: None,
) -> GreyBoxFit:
    """The plant with those refinements that the held-back part of the record asks for, fitted to all of it.

    Args:
        plant: to begin with.
        record: what to identify from.
        fixed, datasheet: as in `simulation_error`; they hold for every trial.
        held_back: fraction of the record, at its end, that decides.
        refinements: what is tried, in this order.
        progress: called with the fraction done.
    """
    train, rest = record.split(1 - held_back)
    known: dict[str, Any] = {"fixed": fixed or {}, "datasheet": datasheet or {}}
    free = tuple(name for name in plant.usual if name not in known["fixed"])
    fit = simulation_error(plant, train, free=free, **known)
    error = _held_back_error(fit, rest)
    chosen = _mechanical(fit)
    for k, refine in enumerate(refinements):
        progress((k + 1) / (len(refinements) + 2))
        trial, wider = refine(chosen, free, train)
        wider = tuple(name for name in wider if name not in known["fixed"])
        if wider == free:
            continue
        try:
            candidate = simulation_error(trial, train, free=wider, **known)
        except EmsidError:
            continue  # a refinement that cannot be fitted is none
        achieved = _held_back_error(candidate, rest)
        if achieved < (1 - LEAST_GAIN) * error:
            free, error, chosen = wider, achieved, _mechanical(candidate)
    return simulation_error(chosen, record, free=free, **known)


def _held_back_error(fit: GreyBoxFit, rest: Record) -> float:
    run = fit.model.simulate(rest)
    error = float(np.mean((rest.output - run.output)[run.counted] ** 2)) if run.counted.any() else np.inf
    return error if isfinite(error) else np.inf


def _mechanical(fit: GreyBoxFit) -> Mechanical:
    plant = fit.model.plant
    assert isinstance(plant, (DrivenMotor, LinearAxis))
    return plant


def _friction(plant: Mechanical) -> str:
    return "rotor_friction" if isinstance(plant, DrivenMotor) else "friction"
