r"""Two tanks above one another, as a plant written down by its equations.

    x₁′ = q − a − s        a = k₁·x₁^n₁        q = p·max(u − u₀, 0)^m
    x₂′ = a + c·s − b      b = k₂·x₂^n₂        y = min(x₂, full₂) + y₀

A pump fills the upper tank, which runs out into the lower one. A full tank stays full: what would raise its level
spills over. Of what the upper one spills, s, the share c falls into the lower one. Levels end over an edge of `EDGE` of
the full one: more and more spills on it, so that the free run has a derivative by all parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.plants.own_plant import OwnPlant
from emsid.plant.parameter import Parameter

Array = NDArray[np.float64]

EDGE = 0.02
"""The height of the edge of a tank, as a share of its full level."""


@njit(nogil=True)
def spilt(level: float, full: float, rise: float) -> float:
    """What spills over at a level, of what would raise it."""
    return min(max(1.0 + (level - full) / (EDGE * full), 0.0), 1.0) * max(rise, 0.0)


@njit(nogil=True)
def tank_change(x: Array, u: Array, p: Array) -> Array:
    """Change of the upper and the lower level."""
    inflow = p[0] * max(u[0] - p[1], 0.0) ** p[2]
    falls, leaves = p[3] * max(x[0], 0.0) ** p[4], p[7] * max(x[1], 0.0) ** p[8]
    over = spilt(x[0], p[5], inflow - falls)
    arrives = falls + p[6] * over
    return np.array([inflow - falls - over, arrives - leaves - spilt(x[1], p[9], arrives - leaves)])


@njit(nogil=True)
def lower_level(x: Array, u: Array, p: Array) -> Array:
    """The lower level as measured."""
    return np.array([min(x[1], p[9]) + p[10]])


def tanks(full: float = 10.0) -> OwnPlant:
    """Two tanks above one another with a pump, which overflow; the lower level is measured.

    Its values are a start for `emsid.fit`: flows by the square root of the level, as Torricelli's law has them, and no
    offsets. ``with_values`` gives it others.

    >>> tanks().with_values({"pump": 0.08}).value("pump")
    0.08

    Args:
        full: the level at which both tanks are full, in the unit of the record.
    """
    rows = (
        Parameter("pump", "p", "1/s", "rise of the upper level for one unit of the command"),
        Parameter("pump.offset", "u₀", "1", "command from which the pump delivers"),
        Parameter("pump.power", "m", "1", "power of the command in the flow of the pump"),
        Parameter("upper.outflow", "k₁", "1/s", "outflow of the upper tank at level one"),
        Parameter("upper.power", "n₁", "1", "power of the level in this outflow"),
        Parameter("upper.full", "full₁", "1", "level of the full upper tank"),
        Parameter("overflow", "c", "1", "share of what the upper tank spills that falls into the lower one"),
        Parameter("lower.outflow", "k₂", "1/s", "outflow of the lower tank at level one"),
        Parameter("lower.power", "n₂", "1", "power of the level in this outflow"),
        Parameter("lower.full", "full₂", "1", "level of the full lower tank"),
        Parameter("level.offset", "y₀", "1", "reading at an empty lower tank"),
    )
    positive = ("pump", "upper.outflow", "lower.outflow", "upper.full", "lower.full")
    return OwnPlant(
        tank_change,
        lower_level,
        table=rows,
        values=(0.05, 0.0, 1.0, 0.05, 0.5, full, 0.5, 0.05, 0.5, full, 0.0),
        states=2,
        bounds=(
            *((name, 1e-9, np.inf) for name in positive),
            *((name, 0.2, 2.0) for name in ("pump.power", "upper.power", "lower.power")),
            ("overflow", 0.0, 1.0),
        ),
        steps=2,
        name="tanks",
        first=(full / 2, full / 2),
    )
