"""The current of a bridge that coasts rises anew in every pulse, which has the effect of a dead zone."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import parts
from emsid.models.plants.search.refinements.contract import Refined
from emsid.record import Record

DEAD_ZONE, RISE = "voltage_dead_zone.half_width", "drive.rise"
STARTS = (0.05, 0.2)
"""Rise times to begin with, in periods of the PWM."""


def current_rise(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The armature current takes a part of every pulse to rise; this replaces an estimated dead zone."""
    if not plant.can_coast or not plant.drive.freewheel or RISE in free:
        return []
    zone = {name for name in (DEAD_ZONE, *parts(plant, DEAD_ZONE)) if name in free}
    plain = plant.with_values(dict.fromkeys(zone, 0.0))
    kept = tuple(name for name in free if name not in zone)
    return [(plain.with_drive(rise=part), (*kept, RISE)) for part in STARTS]
