"""Refinements that delay the output with similar effects in many records: one in place of another.

They are added while other refinements are missing, so the first one that helps may be the wrong one, and another one
then compensates for the difference: a mean over the sample and a short lag for a longer lag. When nothing more is
added, each is compared with the others in its place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.catalogue import INSTEAD, LOOK_ALIKE
from emsid.models.plants.search.refinements.contract import Refined, Refinement
from emsid.record import Record


def in_place(
    plant: DrivenPlant, free: tuple[str, ...], start: DrivenPlant, refinements: Sequence[Refinement], record: Record
) -> Iterator[Sequence[Refined]]:
    """Groups of starts, each with another refinement in place of one that a plant has.

    A mean over the sample has no parameter, so `simplified` does not remove it; one of the groups does if there is also
    a delay or a lag. Refinements that are slow to simulate only replace a parameter.

    Args:
        plant: with its refinements.
        free: its free parameters.
        start: the plant that the search began with.
        refinements: what is tried.
        record: what to identify from.
    """
    present = [each for each, name in LOOK_ALIKE.items() if _has(plant, free, start, name)]
    others = [each for each in LOOK_ALIKE if each in refinements and each not in present]
    for name in (LOOK_ALIKE[each] for each in present):
        plain, kept = plant.with_values({name: 0.0}), tuple(each for each in free if each != name)
        yield from (other(plain, kept, record) for other in others if kept != free or other not in INSTEAD)
        if kept == free and len(present) > 1:
            yield [(plain, kept)]


def _has(plant: DrivenPlant, free: tuple[str, ...], start: DrivenPlant, name: str) -> bool:
    """Whether a parameter that is zero without its refinement is free, or no longer zero."""
    return name in free or (name in plant.handles and plant.value(name) != 0 and start.value(name) == 0)
