"""Friction that grows with the square of the speed, as that of a fan or of air."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined, top_speed
from emsid.record import Record

QUADRATIC = "quadratic_viscous"
START = 0.05
"""Friction at the top speed to begin with, as a part of the largest force."""


def quadratic_viscous(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Friction has a part that is quadratic in the speed."""
    if QUADRATIC not in plant.handles or QUADRATIC in free:
        return []
    begun = START * plant.largest_force(record.input) / top_speed(plant, record) ** 2
    return [(plant.with_values({QUADRATIC: begun}), (*free, QUADRATIC))]
