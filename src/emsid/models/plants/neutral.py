"""A plant without the effects that only some drives have.

The registered start of a plant has a dead zone and friction of a usual size, because a search begins there. Where they
are not estimated and nobody gave them, they must not act: they would bias the estimates unseen.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TypeVar

from emsid.errors import ModelError
from emsid.models.plants.plant import Plant
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
