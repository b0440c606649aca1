"""The characteristics of a fitted plant: the quantities that the data determine, and the dead zone."""

from __future__ import annotations

import numpy as np

from emsid.estimation.estimates import Status
from emsid.models.characteristics import Characteristic, half_of
from emsid.models.plants.plant import Quantity
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.visited import Needs, RestsOn

LEFT_OUT = ("acceleration", "electromechanical", "electrical", "inertia ratio")
"""Quantities that repeat others and are left out of a short list."""
FEEDFORWARD = "(kS)"
"""Of quantities that are equal, the one with this in its name is listed."""


def of_plant(fit: GreyBoxFit) -> tuple[Characteristic, ...]:
    """The quantities that the data determine, and the dead zone, unless they depend on values that nobody gave."""
    model = fit.model.name
    zones = (
        (
            Quantity(row.description, "", row.unit, row.value * way, RestsOn(Needs.THRESHOLD, way)),
            row.standard_error,
            row.given,
        )
        for row in fit.table
        if "dead_zone" in row.name and row.status in (Status.ESTIMATED, Status.CONDITIONAL)
        for way in [-1 if row.name.endswith("b_l") else 1]
    )
    combined = (
        (each.quantity, each.standard_error, each.given)
        for each in fit.known_combinations
        if not each.quantity.name.startswith(LEFT_OUT)
    )
    found = (
        (Characteristic(each.name, float(each.value), half_of(error), each.unit, model, given=given), fit.shows(each))
        for each, error, given in combined
    )
    ends = (
        (
            Characteristic(each.name, abs(float(each.value)), half_of(error), each.unit, model, given=given),
            fit.shows(each),
        )
        for each, error, given in zones
    )
    known: list[tuple[Characteristic, bool]] = []
    for each, shown in (*found, *ends):
        k = next((k for k, (other, as_well) in enumerate(known) if shown == as_well and _repeats(each, other)), None)
        if k is None:
            known.append((each, shown))
        elif FEEDFORWARD in each.name:
            known[k] = each, shown
    return tuple(each if shown else each.unknown() for each, shown in known)


def _repeats(each: Characteristic, other: Characteristic) -> bool:
    """Whether a quantity is another one of the same direction, as a break-away voltage where no level is higher."""
    sides = [[way in one.name for way in ("forward", "backward")] for one in (each, other)]
    own, others = ((one.value, one.half_width or 0.0) for one in (each, other))
    return each.unit == other.unit and sides[0] == sides[1] and np.allclose(own, others, rtol=1e-6, atol=0.0)
