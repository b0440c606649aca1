"""The type of a refinement: a function that returns starts of a refined plant and its free parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.grey_box import signals_of
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search import speeds
from emsid.record import Record

Refined = tuple[DrivenPlant, tuple[str, ...]]
Refinement = Callable[[DrivenPlant, tuple[str, ...], Record], Sequence[Refined]]
"""From a plant, what is free of it and a record to starts of a refined plant; all of them have the same free names.

None if the plant cannot be refined like this, or already is.
"""


def level_name(plant: DrivenPlant) -> str:
    """The name of the level of its friction, the first parameter of the law."""
    return f"{plant.friction_name}.{plant.frictions[plant.friction_name].parameters[0].name}"


def top_speed(plant: DrivenPlant, record: Record) -> float:
    """Its largest speed, without a few samples."""
    return speeds.top_speed(record.segments, 0, signals_of(plant, record)[0] is Signal.POSITION)
