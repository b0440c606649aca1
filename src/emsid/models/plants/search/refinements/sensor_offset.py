"""A speed sensor that does not read zero at rest, as a tachogenerator with its amplifier.

In motion a constant load shifts the speed in the same way; at rest it does not.
"""

from __future__ import annotations

from collections.abc import Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.grey_box import signals_of
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.refinements.contract import Refined
from emsid.record import Record

OFFSET = "sensor.offset"


def sensor_offset(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """The sensor of a speed reads a constant at rest; that of a position is in the position at the start."""
    if OFFSET in free or Signal.POSITION in signals_of(plant, record):
        return []
    return [(plant, (*free, OFFSET))]
