"""Families of static maps, each able to start itself from a curve.

A `Family` knows what its maps are called, of what sizes they come, what linear trial shows whether a pair of filters
suits them, and how one is started from points (x, z) of the curve that the trial found. The list `FAMILIES` is what the
command line offers; a new family is one entry, and a user's own map needs none: `given(map)`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import did_you_mean
from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.models.blocks.search.starts import spline_trial, spread_knots
from emsid.models.blocks.static_maps import (
    Abs,
    CoulombLinear,
    CubicSpline,
    DeadZone,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    StaticMap,
)

Array = NDArray[np.float64]
M = TypeVar("M", bound=StaticMap)

# A start needs a curve, not all its points.
POINTS = 2_000
# Edges of a dead zone are looked for among so many quantiles on either side.
EDGES = 16


@dataclass(frozen=True, eq=False)
class Family:
    """A family of static maps.

    Attributes:
        name: as the command line has it.
        start: the map of a size that is closest to points x (m,), z (m,), a constant level left free.
        sizes: numbers of knots (or the degrees) to choose from; empty where the family has one size. Where the trial
            is of this family, its size is the first.
        folds: whether its maps lose the sign, so that signs must be given back before there is a linear start.
        trial: for the signal that enters the map, maps linear in their parameters that show whether filters suit it.
    """

    name: str
    start: Callable[[Array, Array, int], StaticMap]
    sizes: tuple[int, ...] = ()
    folds: bool = False
    trial: Callable[[Array], tuple[StaticMap, ...]] = spline_trial

    @property
    def direct(self) -> bool:
        """Whether the trial is already of this family, not a spline that stands for it."""
        return self.trial is not spline_trial


def start_spline(x: Array, z: Array, size: int) -> CubicSpline:
    """A spline with ``size`` knots between quantiles and even spacing."""
    return _closest(CubicSpline(spread_knots(x, size), np.zeros(size)), x, z)


def start_piecewise_linear(x: Array, z: Array, size: int) -> PiecewiseLinear:
    """Straight lines between ``size`` knots."""
    return _closest(PiecewiseLinear(spread_knots(x, size), np.zeros(size)), x, z)


def start_polynomial(x: Array, z: Array, size: int) -> Polynomial:
    """A polynomial of degree ``size`` on the range of x."""
    return _closest(Polynomial(np.zeros(size + 1), float(x.min()), float(x.max())), x, z)


def start_dead_zone(x: Array, z: Array, size: int) -> DeadZone:
    """The best edges among quantiles of x, with the best slopes for them."""
    x, z = _thinned(x, z)
    grid = np.quantile(x, np.linspace(0.02, 0.98, EDGES))
    best, least = DeadZone(float(grid[0]), float(grid[-1])), np.inf
    for i, left in enumerate(grid):
        for right in grid[i:]:
            rows = np.stack([np.minimum(x - left, 0), np.maximum(x - right, 0), np.ones_like(x)])
            theta = _least_squares(rows, z)
            error = float(np.sum((theta @ rows - z) ** 2))
            if error < least and theta[0] * theta[1] > 0:
                best, least = DeadZone(float(left), float(right), float(theta[0]), float(theta[1])), error
    return best


def start_saturation(x: Array, z: Array, size: int) -> Saturation:
    """The slope of the middle half, with limits inside the extremes of the curve."""
    low, high = np.quantile(x, [0.25, 0.75])
    middle = (x >= low) & (x <= high)
    slope, level = _least_squares(np.stack([x[middle], np.ones(int(middle.sum()))]), z[middle])
    floor, ceiling = np.quantile(z - level, [0.02, 0.98])
    return Saturation(float(slope), float(floor), float(ceiling))


def start_coulomb(x: Array, z: Array, size: int) -> CoulombLinear:
    """A sign that is smooth over a twentieth of the spread of x, and x."""
    return _closest(CoulombLinear(0.0, 1.0, width=0.05 * float(np.std(x))), x, z)


def start_abs(x: Array, z: Array, size: int) -> Abs | CubicSpline:
    """|x|, or a spline with ``size`` knots through the curve: real sensors round the kink, and bend."""
    return start_spline(x, z, size) if size else Abs()


def given(map_: StaticMap, name: str = "given") -> Family:
    """The family of one map, a user's own for instance, which starts with the parameters that it has."""
    return Family(name, lambda x, z, size: map_, trial=lambda x: (map_,))


SPLINE = Family("spline", start_spline, (8, 12, 18, 25, 35))
PIECEWISE_LINEAR = Family("piecewise-linear", start_piecewise_linear, (6, 10, 16, 25))
POLYNOMIAL = Family("polynomial", start_polynomial, (2, 3, 5, 7))
DEAD_ZONE = Family("dead-zone", start_dead_zone)
SATURATION = Family("saturation", start_saturation)
COULOMB = Family("coulomb", start_coulomb)
ABS = Family("abs", start_abs, (0, 6, 9, 13), folds=True, trial=lambda x: (Abs(),))

FAMILIES: dict[str, Family] = {
    family.name: family for family in (SPLINE, PIECEWISE_LINEAR, POLYNOMIAL, DEAD_ZONE, SATURATION, COULOMB, ABS)
}


def family_named(name: str) -> Family:
    """The family of this name.

    Raises:
        ModelError: that lists the names.
    """
    if name not in FAMILIES:
        raise ModelError(f"no static map {name!r}; there are {', '.join(FAMILIES)}{did_you_mean(name, FAMILIES)}")
    return FAMILIES[name]


def _closest(blank: M, x: Array, z: Array) -> M:
    """The map of this family, which is linear in its parameters, that comes closest to the points up to a constant."""
    rows = blank.parameter_gradient(x)
    if not blank.owns_level:
        rows = np.vstack([rows, np.ones_like(x)])
    return blank.with_parameters(_least_squares(rows, z)[: len(blank.parameters)])


def _least_squares(rows: Array, z: Array) -> Array:
    """(k,) the θ for which θ·rows (k, m) comes closest to z (m,)."""
    information = Information.empty(len(rows)).add_columns(np.ascontiguousarray(np.vstack([rows, z])))
    return information.solve(1e-9).estimate


def _thinned(x: Array, z: Array) -> tuple[Array, Array]:
    step = max(1, len(x) // POINTS)
    return x[::step], z[::step]
