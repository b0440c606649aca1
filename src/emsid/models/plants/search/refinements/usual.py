"""Refinements that many drives need: delay, sensor, Stribeck excess, directions, load, a bridge that coasts."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.grey_box import signals_of
from emsid.models.plants.parameters import Signal, parts
from emsid.models.plants.search.refinements.contract import Refined, level_name, top_speed
from emsid.record import Record


def coasting_bridge(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The bridge leaves the armature open in its off-time.

    Without a supply given, the largest command is taken for full duty.
    """
    if not plant.can_coast or "drive.freewheel" in free:
        return []
    supply = plant.drive.supply if isfinite(plant.drive.supply) else plant.drive.largest(record.input)
    return [(plant.with_drive(supply=supply, freewheel=part), (*free, "drive.freewheel")) for part in (0.3, 0.9)]


def late_command(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The command acts after a delay."""
    if "drive.delay" in free:
        return []
    return [(plant.with_values({"drive.delay": late * record.dt}), (*free, "drive.delay")) for late in (0.3, 1.0, 2.5)]


def slow_sensor(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The sensor filters."""
    if "sensor.lag" in free:
        return []
    return [(plant.with_values({"sensor.lag": lag * record.dt}), (*free, "sensor.lag")) for lag in (0.5, 2.0, 6.0)]


def averaging_sensor(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The speed is the mean over the sample before it, as from counting the edges of an encoder."""
    shown = signals_of(plant, record)
    if not {Signal.SPEED, Signal.ROTOR_SPEED} & set(shown) or "sensor.average" in free or plant.value("sensor.average"):
        return []
    return [(plant.with_values({"sensor.average": 1.0}), free)]


def stribeck(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Friction is larger near rest."""
    excess, rate = f"{plant.friction_name}.stribeck", f"{plant.friction_name}.stribeck_rate"
    if excess not in plant.handles or rate in free:
        return []
    largest = 0.3 * max(plant.value(level_name(plant)), 0.03 * plant.largest_force(record.input))
    fast = top_speed(plant, record)
    return [
        (plant.with_values({excess: largest, rate: times / fast}), (*free, excess, rate))
        for times in (5.0, 20.0, 60.0, 200.0)
    ]


def by_direction(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Coulomb levels, viscous friction of an axis and break points differ by direction.

    A constant load has the same effect as a difference of Coulomb levels, at rest and in motion; if both are free, the
    levels include it.
    """
    split: list[str] = []
    for name in free:
        apart = name == level_name(plant) or name.endswith(("viscous_friction", ".half_width"))
        split += (parts(plant, name) if apart else ()) or (name,)
    load, levels = plant.load_name, parts(plant, level_name(plant))
    if load in free and set(levels) <= set(split):  # with a known level, the load stays
        pull, (forward, backward) = plant.value(load), levels
        plant = plant.with_values(
            {
                forward: max(plant.value(forward) + pull, 0.0),
                backward: max(plant.value(backward) - pull, 0.0),
                load: 0.0,
            }
        )
        split.remove(load)
    return [(plant, tuple(split))] if tuple(split) != free else []


def viscous_by_direction(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Only the viscous friction of an axis differs by direction."""
    split: list[str] = []
    for name in free:
        split += (parts(plant, name) if name.endswith("viscous_friction") else ()) or (name,)
    return [(plant, tuple(split))] if tuple(split) != free else []


def constant_load(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """A constant load acts on the mass."""
    if plant.load_name in free or set(parts(plant, level_name(plant))) <= set(free):
        return []  # a difference of levels already stands for it
    pull = 0.1 * plant.value(level_name(plant))
    return [(plant.with_values({plant.load_name: load}), (*free, plant.load_name)) for load in (0.0, pull, -pull)]
