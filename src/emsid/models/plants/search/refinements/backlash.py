"""Backlash: rotor and load turn against each other by an angle before they touch."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined, top_speed
from emsid.record import Record

BACKLASH = "shaft_backlash"
STARTS = (0.3, 1.0, 3.0, 10.0)
"""Widths to begin with, in angles that the load turns by in one sample at its top speed."""


def backlash(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The shaft has backlash; one mass has no shaft."""
    if BACKLASH not in plant.handles or BACKLASH in free:
        return []
    angle = top_speed(plant, record) * record.dt
    return [(plant.with_values({BACKLASH: part * angle}), (*free, BACKLASH)) for part in STARTS]
