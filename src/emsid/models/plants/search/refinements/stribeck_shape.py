"""The shape in which the excess of friction near rest fades: as an exponential of the speed, or as a Gaussian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

from emsid.models.plants.plant import DrivenPlant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.models.plants.search.refinements.usual import stribeck
from emsid.plant import Friction, GaussianStribeck
from emsid.record import Record

WIDER = 0.4
"""The rates to begin with, over those of the usual shape: a Gaussian lasts longer and then falls at once."""


def gaussian_stribeck(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Friction is larger near rest, and there it does not fall at once."""
    if type(plant.frictions[plant.friction_name]) is not Friction:
        return []
    rate = f"{plant.friction_name}.stribeck_rate"
    return [
        (_with_law(start, GaussianStribeck).with_values({rate: WIDER * start.value(rate)}), names)
        for start, names in stribeck(plant, free, record)
    ]


def usual_shape(plant: DrivenPlant, free: tuple[str, ...]) -> list[Refined]:
    """The plant with the usual shape, where it has the other one; the names stay."""
    if type(plant.frictions[plant.friction_name]) is not GaussianStribeck:
        return []
    return [(_with_law(plant, Friction), free)]


def _with_law(plant: DrivenPlant, law: type[Friction | GaussianStribeck]) -> DrivenPlant:
    old = plant.frictions[plant.friction_name]
    values = {each.name: getattr(old, each.name) for each in fields(old)}
    return plant.with_frictions({**plant.frictions, plant.friction_name: law(**values)})
