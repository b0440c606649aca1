"""The gain of the drive differs by direction, as that of the two halves of a bridge does.

At constant speed a smaller gain has the same effect as more friction. If both differ by direction, one of them alone
may explain nothing, so they are also tried together.
"""

from __future__ import annotations

from collections.abc import Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.models.plants.search.refinements.usual import by_direction
from emsid.record import Record

SLOPE = "voltage_dead_zone.m_l"
"""The slope for negative voltages, over that for positive ones."""
STARTS = (0.95, 1.05)


def gain_by_direction(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """A negative voltage acts more, or less, than a positive one."""
    if SLOPE not in plant.handles or SLOPE in free:
        return []
    return [(plant.with_values({SLOPE: slope}), (*free, SLOPE)) for slope in STARTS]


def gain_and_friction_by_direction(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Each direction has its own gain and its own friction."""
    return [start for split in by_direction(plant, free, record) for start in gain_by_direction(*split, record)]
