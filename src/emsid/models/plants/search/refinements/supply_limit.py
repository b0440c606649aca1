"""The supply limits the voltage: beyond some command it does not rise any more."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.record import Record

STARTS = (0.9, 0.7)
"""Limits to begin with, as parts of the largest voltage that the record commands."""


def supply_limit(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The voltage ends at the supply, below the largest one that is commanded."""
    if not plant.can_coast or isfinite(plant.drive.supply):
        return []
    largest = plant.drive.largest(record.input)
    return [(plant.with_drive(supply=part * largest), (*free, "drive.supply")) for part in STARTS]
