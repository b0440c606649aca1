"""A bridge loses a part of its on-time wherever it switches, and nothing at full duty."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from emsid.models.plants.drive import FULL
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.record import Record

STARTS = (0.01, 0.05, 0.2)
"""Losses to begin with; the smallest one has hardly an effect, so its trial is no worse than that without."""
SEEN = 0.05
"""At least this part of the samples is at full duty, and as many move below it."""


def switching_loss(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Below full duty the bridge switches and loses a part of its on-time; both must be in the record.

    Full duty is known if the supply is known, as for a bridge that coasts. In any other record the largest command
    would count as a limit that need not exist.
    """
    drive = plant.drive
    if not plant.can_coast or "drive.loss" in free or not isfinite(drive.supply):
        return []
    wanted = np.abs(drive.gain * (drive.commands(record.input) + drive.offset))
    full = wanted >= FULL * drive.supply
    if min(np.mean(full), np.mean(~full & (wanted > 0))) < SEEN:
        return []
    return [(plant.with_drive(loss=part), (*free, "drive.loss")) for part in STARTS]
