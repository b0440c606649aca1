"""Which refinements of a fit are not supported by their own intervals.

Schwarz's criterion compares costs. If the residual is slow, or if parameters compensate for each other, it may accept a
refinement whose interval includes the value at which it has no effect. Such a refinement is to be removed, and also
Stribeck friction whose rate the record does not resolve.
"""

from __future__ import annotations

from collections.abc import Collection
from math import inf

import numpy as np

from emsid.estimation.uncertainty.intervals import HALF_WIDTH
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.search.refinements.catalogue import simplified, sizes
from emsid.models.plants.search.refinements.contract import Refined
from emsid.models.plants.search.result import Estimate, GreyBoxFit, Status


def unsupported(fit: GreyBoxFit, asked: tuple[str, ...], wanted: Collection[str]) -> list[frozenset[str]]:
    """The free names of each refinement whose intervals include the value without effect.

    Args:
        fit: converged, with its intervals.
        asked: its free parameters.
        wanted: the parameters that the user asked for; they are no refinements.
    """
    plant = fit.model.plant
    if not isinstance(plant, DrivenPlant):
        return []
    return [
        frozenset(asked) ^ frozenset(refined[1])
        for refined in simplified(plant, asked)
        if _is_idle(fit, asked, refined, wanted)
    ]


def _is_idle(fit: GreyBoxFit, asked: tuple[str, ...], refined: Refined, wanted: Collection[str]) -> bool:
    plain, names = refined
    rows = {row.name: row for row in fit.table}
    removed = [name for name in asked if name not in names]
    if not removed or any(name in wanted for name in removed):
        return False
    merged = [name for name in names if name not in asked]
    if merged:  # the two directions are one, or two factors of the load
        return len(removed) == 2 and set(removed) <= set(fit.names) and _alike(fit, removed)
    rates = [name for name in removed if name.endswith("_rate")]
    most = {name: fit.limits.get(name, (0.0, inf))[1] for name in rates}
    without_rate = any(_includes(rows[name], 0.0) or rows[name].value >= most[name] for name in rates)
    shown = sizes(removed, plain)
    return without_rate or (bool(shown) and all(_includes(rows[name], plain.value(name)) for name in shown))


def _includes(row: Estimate, value: float) -> bool:
    """Whether an interval includes a value, or is missing because the data do not determine the parameter."""
    if row.interval is None:
        return row.status is Status.KEPT or row.value == value
    return row.interval[0] <= value <= row.interval[1]


def _alike(fit: GreyBoxFit, sides: list[str]) -> bool:
    """Whether the interval of the difference of two sizes includes zero; the sides of a dead zone differ in sign."""
    places = [fit.names.index(name) for name in sides]
    estimates, covariance = fit.estimate[places], fit.covariance[np.ix_(places, places)]
    signs = np.where(estimates < 0, -1.0, 1.0) * (1.0, -1.0)
    difference, variance = float(signs @ estimates), float(signs @ covariance @ signs)
    return abs(difference) <= HALF_WIDTH * float(np.sqrt(max(variance, 0.0)))
