"""A plant without the effects that only some drives have, and the usual sizes of those that are to be estimated.

The registered start of a plant has a dead zone and friction of a usual size, because a search begins there. Where they
are not estimated and nobody gave them, they must not act: they would bias the estimates unseen.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import TypeVar

from emsid.errors import ModelError
from emsid.models.plants.plant import Plant
from emsid.models.plants.registry import PLANTS
from emsid.plant.parameter import Measure

AnyPlant = TypeVar("AnyPlant", bound=Plant)


def neutral(plant: AnyPlant) -> AnyPlant:
    """A plant without friction and dead zones; what any plant must have (inertia, resistance) stays."""
    levels = [f"{name}.{each.name}" for name, law in plant.frictions.items() for each in law.parameters]
    viscous = [
        name for name, handle in plant.handles.items() if handle.measure is Measure.DAMPING and "viscous" in name
    ]
    zones = [name for name in plant.handles if name.endswith("dead_zone.half_width")]
    for name in (*levels, *(each for each in viscous if "." not in each), *zones):
        if name in plant.handles and plant.value(name):
            with suppress(ModelError):  # a friction law of the user's own may need its value
                plant = plant.with_values({name: 0.0})
    return plant


def with_usual_sizes(plant: AnyPlant, asked: Sequence[str], known: Collection[str]) -> AnyPlant:
    """A plant with the usual size of every parameter that is to be estimated and is zero: a search begins there."""
    kind = PLANTS.get(plant.name)
    if kind is None or type(kind.start) is not type(plant):
        return plant
    usual = kind.start
    names = [name for name in asked if name not in known and name in usual.handles and plant.value(name) == 0.0]
    return plant.with_values({name: usual.value(name) for name in names if usual.value(name)})
