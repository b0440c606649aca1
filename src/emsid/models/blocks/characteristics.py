"""Gain, time constants and dead zone of a cascade."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.characteristics import Characteristic, by_estimate, gain_unit, modes
from emsid.models.visited import Needs, RestsOn, Visited
from emsid.record import Record

Array = NDArray[np.float64]


def of_cascade(fit: Fit[Cascade], record: Record) -> tuple[Characteristic, ...]:
    """Gain and slowest time constant, and the break points of a dead zone."""
    model = fit.model
    inside = record.dt / model.oversampling
    found = [_quantity(fit, "gain", _gain, gain_unit(record))]
    found += modes(partial(_quantity, fit), _poles_of_cascade, model, inside)
    found += _edges(fit, record)
    return tuple(each for each in found if isfinite(each.value) or not each.shown)


def _poles_of_cascade(model: Cascade) -> NDArray[Any]:
    return np.concatenate([np.empty(0), *(block.poles for block in model.blocks if isinstance(block, Rational))])


def _edges(fit: Fit[Cascade], record: Record) -> list[Characteristic]:
    """The break points of the first static map, where that is a dead zone, as levels of the input."""
    blocks = fit.model.blocks
    k = next((k for k, block in enumerate(blocks) if isinstance(block, StaticMap)), None)
    if k is None or not {"b_l", "b_r"} <= set(blocks[k].names) or not _gain_before(fit.model, k):
        return []
    sides = ("b_l", "b_r") if _gain_before(fit.model, k) > 0 else ("b_r", "b_l")
    names = zip(("backward", "forward"), sides, strict=True)
    found = (
        (
            way,
            _quantity(fit, f"dead zone {name}", partial(_edge, k, blocks[k].names.index(side)), record.input_units[0]),
        )
        for way, (name, side) in zip((-1, 1), names, strict=True)
    )
    visited = Visited(record.input[:, 0], np.empty(0))
    judged = [(each, visited.shows(RestsOn(Needs.THRESHOLD, way), way * each.value)) for way, each in found]
    return [each if approached else each.unknown() for each, approached in judged]


def _edge(block: int, number: int, model: Cascade) -> float:
    """The constant input at which a static map meets one of its break points."""
    edge = float(model.blocks[block].parameters[number])
    return edge / (_gain_before(model, block) or np.nan) + model.input_offset


def _gain_before(model: Cascade, block: int) -> float:
    """The gain at DC from the input to a static map; zero where a filter between them blocks DC or is unknown."""
    gain = 1.0
    for each in model.blocks[:block]:
        if not isinstance(each, Rational):
            return 0.0
        numerator = float(np.sum(each.numerator))
        rounding = 1e-9 * float(np.sum(np.abs(each.numerator)))
        gain *= numerator / (1 + float(np.sum(each.denominator))) if abs(numerator) > rounding else 0.0
    return gain


def _gain(model: Cascade) -> float:
    """Slope from input to output, in a stretch where the maps are straight."""
    factors = [
        block.gain if isinstance(block, Rational) else block.steepness
        for block in model.blocks
        if isinstance(block, Rational | StaticMap)
    ]
    return float(np.prod(factors))


def _quantity(fit: Fit[Cascade], name: str, quantity: Callable[[Cascade], float], unit: str) -> Characteristic:
    """A quantity of the model, whose free parameters are a part of its parameters."""
    model = fit.model
    at = [model.names.index(each) for each in fit.names]

    def of(theta: Array) -> float:
        whole = np.array(model.parameters, dtype=float)
        whole[at] = theta
        return quantity(model.with_parameters(whole))

    return by_estimate(fit, name, of, unit)
