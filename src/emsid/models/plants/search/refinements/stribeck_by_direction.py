"""The Stribeck excess differs by direction."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import parts
from emsid.models.plants.search.refinements.contract import Refined
from emsid.models.plants.search.refinements.usual import stribeck
from emsid.record import Record


def stribeck_by_direction(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Each direction has its own excess of friction near rest; it fades with speed at the same rate."""
    excess = f"{plant.friction_name}.stribeck"
    starts = [(plant, free)] if excess in free else stribeck(plant, free, record)
    return [(start, _split(start, names, excess)) for start, names in starts]


def _split(plant: DrivenPlant, free: tuple[str, ...], whole: str) -> tuple[str, ...]:
    """The names with one of both directions replaced by one for each."""
    found: list[str] = []
    for name in free:
        found += parts(plant, name) if name == whole else (name,)
    return tuple(found)
