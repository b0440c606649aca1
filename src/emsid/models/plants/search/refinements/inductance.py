"""The armature has an inductance: the current, and with it the torque, follows the voltage after some time."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.models.plants.search.refinements.stribeck_shape import with_usual_shape
from emsid.record import Record

INDUCTANCE = "inductance"
STARTS = (0.5, 1.5)
"""Electrical time constants to begin with, in samples; much shorter ones have no visible effect."""
MOST = 5000
"""The most samples with which it is tried: a motor with inductance takes twenty times as long to simulate."""


def inductance(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The current follows the voltage after some time; for a motor driven by a voltage."""
    if not plant.can_coast or INDUCTANCE in free or plant.value(INDUCTANCE) or len(record) > MOST:
        return []
    plant = with_usual_shape(plant)
    henry_per_sample = plant.value("resistance") * record.dt
    return [(plant.with_values({INDUCTANCE: start * henry_per_sample}), (*free, INDUCTANCE)) for start in STARTS]
