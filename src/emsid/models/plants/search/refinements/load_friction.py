"""Friction that grows with the load of the gear of a joint, which gravity and the command change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.plant import Friction, FrictionLaw, LoadFriction, PowerFriction, SquaredLoadFriction
from emsid.record import Record

STARTS = (0.05, 0.2)
"""Factors to begin with: a good gear loses 5 % of its load, a worm much more."""
SQUARED = ("motor_squared", "outside_squared")


def load_dependent(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The level of friction grows with the load."""
    if not plant.turn or type(plant.frictions[plant.friction_name]) is not Friction:
        return []
    name = f"{plant.friction_name}.load"
    changed = with_law(plant, LoadFriction)
    return [(changed.with_values({name: each}), (*free, name)) for each in STARTS]


def load_near_rest(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The Stribeck excess grows with the load too."""
    name = f"{plant.friction_name}.load_stribeck"
    rate = f"{plant.friction_name}.stribeck_rate"
    if name not in plant.handles or name in free or rate not in free:
        return []
    return [(plant.with_values({name: each}), (*free, name)) for each in STARTS]


def load_by_power(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """A gear that drives loses another part of its load than one that is driven."""
    law, prefix = plant.frictions[plant.friction_name], plant.friction_name
    if type(law) is not LoadFriction or f"{prefix}.load" not in free:
        return []
    factors, near = law.numbers[:, 3].tolist(), law.numbers[:, 4].tolist()
    changed = with_law(
        plant, PowerFriction, motor=tuple(factors), outside=tuple(factors), motor_stribeck=tuple(near),
        outside_stribeck=tuple(near),
    )  # fmt: skip
    pairs = {f"{prefix}.load": ("motor", "outside"), f"{prefix}.load_stribeck": ("motor_stribeck", "outside_stribeck")}
    names = [f"{prefix}.{each}" if name in pairs else each for name in free for each in pairs.get(name, (name,))]
    return [(changed, tuple(names))]


def load_squared(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Near rest the level grows with the square of the load too."""
    law, prefix = plant.frictions[plant.friction_name], plant.friction_name
    if type(law) is not PowerFriction or f"{prefix}.stribeck_rate" not in free:
        return []
    size = 0.1 / plant.largest_force(record.input)
    names = tuple(f"{prefix}.{each}" for each in SQUARED)
    changed = with_law(plant, SquaredLoadFriction)
    return [(changed.with_values(dict.fromkeys(names, size)), (*free, *names))]


LOADED = (load_dependent, load_near_rest, load_by_power, load_squared)


def as_one_factor(plant: DrivenPlant, free: tuple[str, ...]) -> list[Refined]:
    """The plant with one factor for the load where it has one for each direction of power."""
    law, prefix = plant.frictions[plant.friction_name], plant.friction_name
    if type(law) is not PowerFriction or f"{prefix}.motor" not in free:
        return []
    numbers = law.numbers
    load, near = (tuple((0.5 * (numbers[:, k] + numbers[:, k + 1])).tolist()) for k in (3, 5))
    names = {f"{prefix}.motor": f"{prefix}.load", f"{prefix}.motor_stribeck": f"{prefix}.load_stribeck"}
    left = [names.get(name, name) for name in free if not name.startswith(f"{prefix}.outside")]
    return [(with_law(plant, LoadFriction, load=load, load_stribeck=near), tuple(left))]


def with_law(plant: DrivenPlant, law: type[FrictionLaw], **values: Any) -> DrivenPlant:
    """The plant with another law, which has the values of the old one by the same names, and those given."""
    old = plant.frictions[plant.friction_name]
    known = {each.name for each in fields(law)}
    same = {each.name: getattr(old, each.name) for each in fields(old) if each.name in known}
    return plant.with_frictions({**plant.frictions, plant.friction_name: law(**{**same, **values})})
