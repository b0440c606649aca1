"""The gain of the drive changes at a voltage, as that of a bridge does near full duty, where it switches no more."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import isfinite

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.record import Record

KNEES, GAINS = (0.4, 0.7), (0.6, 1.6)
"""Starts: parts of the largest voltage at which the gain changes, and its factors beyond; one above 1, one below."""


def knee(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Beyond some voltage the gain is another one."""
    if not plant.can_coast or isfinite(plant.drive.knee):
        return []
    largest = min(plant.drive.largest(record.input), plant.drive.supply)
    return [
        (plant.with_drive(knee=part * largest, beyond=gain), (*free, "drive.knee", "drive.beyond"))
        for part, gain in product(KNEES, GAINS)
    ]
