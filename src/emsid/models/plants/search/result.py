"""A fitted grey box: its table of parameters, the combinations its records tell, and what they cannot tell in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import listed
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.gauss_newton import Minimum
from emsid.estimation.uncertainty.identifiability import Identifiability
from emsid.models.plants.datasheet import Given
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant, Quantity
from emsid.models.plants.search.problem import Weighting, all_alike
from emsid.record import Record

Array = NDArray[np.float64]

STANDARD_ERRORS = 1.96
"""Half the width of a 95 % interval."""


@dataclass(frozen=True)
class Estimate:
    """A row of the table of parameters.

    Attributes:
        name, symbol, unit, description: of the parameter.
        value: in that unit.
        standard_error: of it; None for one that was not estimated.
        status: ``estimated`` from the record; ``conditional`` on what was held, because the record tells only
            combinations; ``held`` because of that; ``fixed`` by the user; ``at a bound``.
        start: the value the search began with.
        datasheet: what the datasheet says, None without.
    """

    name: str
    symbol: str
    unit: str
    description: str
    value: float
    standard_error: float | None
    status: str
    start: float
    datasheet: float | None


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that the record tells whatever was held.

    Attributes:
        quantity: its name, formula, unit and value.
        standard_error: of it.
        parameters: of those asked for, the ones that make it up.
    """

    quantity: Quantity
    standard_error: float
    parameters: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class GreyBoxFit(Fit[GreyBox]):
    """A `Fit` that knows its physics.

    Attributes:
        table: every parameter that was asked for or fixed.
        combinations: what the record tells although some parameters had to be held; all the quantities of the plant
            that it tells.
        words: what cannot be told apart, what was done about it, and what to do where a bound holds, one sentence each;
            empty where all is told.
        identifiability: of the parameters that were asked for, at the estimate.
        segments: the records it was fitted to, without gaps.
        states: their initial states.
        weighting: how errors counted by their age.
        limits: bounds of the free parameters, those of a datasheet and of physics included.
        cost: V at the minimum, half the weighted sum of squares.
        colour: (p,) how many times larger the variance of every parameter is than with a white residual.
    """

    table: tuple[Estimate, ...] = ()
    combinations: tuple[Combination, ...] = ()
    words: tuple[str, ...] = ()
    identifiability: Identifiability | None = None
    segments: tuple[Record, ...] = ()
    states: tuple[Array, ...] = ()
    weighting: Weighting = all_alike
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    cost: float = float("nan")
    colour: Array = field(default_factory=lambda: np.ones(0))

    @property
    def ended(self) -> str:
        """What the search itself has to say, without the words on its parameters."""
        return self.message.removesuffix("; ".join(self.words)).removesuffix("; ")

    def simulated(self) -> tuple[Array, ...]:
        """The free run (Nᵢ, ny) of every segment from its estimated initial state."""
        model = self.model
        return tuple(
            model.plant.simulate(segment.input, segment.dt, state, model.signals)
            for segment, state in zip(self.segments, self.states, strict=True)
        )


def in_words(
    told: Identifiability,
    names: Sequence[str],
    plant: Plant,
    signals: Sequence[Signal],
    known: Sequence[Combination],
) -> list[str]:
    """What the records cannot tell, what they can tell instead and what was done about it, a sentence for each group.

    Args:
        told: of the parameters that were asked for.
        names: those of them that were estimated, the others being held.
        plant, signals: what was fitted to what.
        known: the combinations that the records tell.
    """
    held = [name for name in told.names if name not in names]
    driven = "" if plant.channels is None else plant.channels.source
    channels = " and ".join([driven or "the input", *(signal.value for signal in signals)])
    current = driven == "voltage" and Signal.CURRENT not in signals
    advice = f"fix what you know, or add {'the current' if current else 'a channel'}"
    if not names:
        return [
            f"from {channels} alone, no parameter of {plant.name} can be told: the output hardly "
            "answers the input; check the columns, or fix what you know"
        ]
    words = []
    for group in told.groups:
        mine = [name for name in group if name in held]
        kept = ", ".join(f"{n} = {plant.handles[n].with_unit(plant.value(n))}" for n in mine)
        formulas = [each.quantity.formula for each in known if len(set(each.parameters) & set(group)) > 1]
        together = listed(tuple(dict.fromkeys(formulas))[:4]) if formulas else "combinations of them"
        if len(group) == 1 and not mine:
            words.append(f"from {channels} alone, {group[0]} is not known to better than 100 %")
        elif len(group) == 1:
            words.append(f"from {channels} alone, {group[0]} is not told at all; held: {kept}; fix what you know")
        elif mine:
            words.append(
                f"from {channels} alone, {listed(group)} cannot be told apart, only {together}; held: {kept}; {advice}"
            )
        else:
            words.append(
                f"from {channels} alone, {listed(group)} can hardly be told apart, {together} can; see their "
                f"intervals, and {advice}"
            )
    return words


def hardly_told(rows: Sequence[Estimate], plant: Plant) -> list[str]:
    """A sentence on what was estimated and may as well be nothing, of what cannot be negative."""
    names = [
        row.name
        for row in rows
        if row.status in ("estimated", "conditional") and row.standard_error is not None
        if plant.handles[row.name].lower >= 0 and abs(row.value) < STANDARD_ERRORS * row.standard_error
    ]
    if not names:
        return []
    have, them = ("intervals of", "them") if len(names) > 1 else ("interval of", "it")
    reach = "reach" if len(names) > 1 else "reaches"
    return [f"the 95 % {have} {listed(names)} {reach} down to nothing: fix {them} if you can, or leave {them} out"]


def at_bounds(
    minimum: Minimum,
    names: Sequence[str],
    plant: Plant,
    limits: Mapping[str, tuple[float, float]],
    hidden: Mapping[str, tuple[float, float]],
    sheet: Mapping[str, Given],
) -> list[str]:
    """What to do about every parameter that is held by a bound: that depends on where the bound is from."""
    words = []
    for name, value, free in zip(names, minimum.estimate, minimum.free, strict=False):
        low, high = limits[name]
        if free or low == high:
            continue
        given, handle = sheet.get(name), plant.handles[name]
        wanted = f"the records ask for {'a smaller' if value <= low else 'a larger'} {name} than"
        if given is not None and given.limits is not None and value in given.limits:
            words.append(f"{wanted} the datasheet allows: widen its tolerance, or check units and what is fixed")
        elif value in hidden.get(name, ()):
            words.append(f"{wanted} their sample time shows: fix it at 0")
        elif value in (handle.lower, handle.upper):
            words.append(
                f"{wanted} is physical: fix it there, or check units, signs and what else is fixed; how far off it "
                "may be, its profile says (--profile)"
            )
        else:
            words.append(f"{wanted} its bounds allow: widen them, or check units and what is fixed")
    return words


def table(
    plant: Plant,
    start: Plant,
    names: Sequence[str],
    asked: Sequence[str],
    fixed: Mapping[str, float],
    sheet: Mapping[str, Given],
    minimum: Minimum,
    told: Identifiability,
) -> tuple[Estimate, ...]:
    rows = []
    errors = np.sqrt(np.diag(minimum.covariance))
    for name in (*asked, *(n for n in fixed if n not in asked)):
        parameter = plant.handles[name].parameter
        error: float | None = None
        if name in fixed:
            status = "fixed"
        elif name not in names:
            status = "held"
        else:
            k = names.index(name)
            error = float(errors[k])
            alone = told.tells(np.array([1.0 if n == name else 0.0 for n in told.names]))
            status = "at a bound" if not minimum.free[k] else "estimated" if alone else "conditional"
        given = sheet.get(name)
        datasheet = None if given is None else given.value
        rows.append(Estimate(*_described(parameter), plant.value(name), error, status, start.value(name), datasheet))
    return tuple(rows)


def _described(parameter: Any) -> tuple[str, str, str, str]:
    return parameter.name, parameter.symbol, parameter.unit, parameter.description


def combinations(
    plant: Plant, names: Sequence[str], asked: Sequence[str], minimum: Minimum, told: Identifiability
) -> tuple[Combination, ...]:
    """The quantities of the plant that the record tells, with standard errors to first order."""

    def gradients(which: Sequence[str]) -> Array:
        columns = []
        for name in which:
            value = plant.value(name)
            step = 1e-6 * max(abs(value), 1e-12) * (1 if value < plant.handles[name].upper else -1)
            above = plant.put({name: value + step}).quantities()
            columns.append([(a.value - q.value) / step for a, q in zip(above, plant.quantities(), strict=True)])
        return np.array(columns).T.reshape(len(plant.quantities()), len(which))

    quantities = plant.quantities()
    if not quantities:
        return ()
    relative = gradients(asked) * np.array([max(abs(plant.value(n)), 1e-12) for n in asked])
    direct = gradients(names)
    covariance = minimum.covariance[: len(names), : len(names)]
    found = []
    for quantity, whole, part in zip(quantities, relative, direct, strict=True):
        if np.any(whole) and told.tells(whole) and isfinite(quantity.value):
            moving = tuple(name for name, slope in zip(asked, whole, strict=True) if slope != 0)
            found.append(Combination(quantity, float(np.sqrt(max(part @ covariance @ part, 0.0))), moving))
    return tuple(found)
