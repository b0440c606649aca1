"""The shape in which the excess of friction near rest fades: as an exponential of the speed, or as a Gaussian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TypeVar

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.refinements.contract import Refined
from emsid.models.plants.search.refinements.usual import stribeck
from emsid.plant import Friction, FrictionLaw, GaussianStribeck
from emsid.record import Record

AnyPlant = TypeVar("AnyPlant", bound=Plant)

WIDER = 0.4
"""The rates to begin with, relative to those of the usual shape: a Gaussian is flat near rest and then falls fast."""


def gaussian_stribeck(plant: DrivenPlant, free: tuple[str, ...], record: Record) -> Sequence[Refined]:
    """Friction is larger near rest, where it is flat over the speed."""
    if type(plant.frictions[plant.friction_name]) is not Friction:
        return []
    rate = f"{plant.friction_name}.stribeck_rate"
    return [
        (_with_law(start, GaussianStribeck).with_values({rate: WIDER * start.value(rate)}), names)
        for start, names in stribeck(plant, free, record)
    ]


def usual_shape(plant: DrivenPlant, free: tuple[str, ...]) -> list[Refined]:
    """The plant with the usual shape, where it has the other one; the names stay."""
    usual = with_usual_shape(plant)
    return [] if usual is plant else [(usual, free)]


def with_usual_shape(plant: AnyPlant) -> AnyPlant:
    """The plant with the usual shape, the only one that a motor with an inductance is simulated with."""
    gaussian = {name: law for name, law in plant.frictions.items() if type(law) is GaussianStribeck}
    usual = {name: _as_law(law, Friction) for name, law in gaussian.items()}
    return plant.with_frictions({**plant.frictions, **usual}) if usual else plant


def _with_law(plant: DrivenPlant, law: type[Friction | GaussianStribeck]) -> DrivenPlant:
    changed = _as_law(plant.frictions[plant.friction_name], law)
    return plant.with_frictions({**plant.frictions, plant.friction_name: changed})


def _as_law(old: FrictionLaw, law: type[Friction | GaussianStribeck]) -> FrictionLaw:
    return law(**{each.name: getattr(old, each.name) for each in fields(old)})
