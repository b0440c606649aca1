"""Families of static maps for a search, made from the registry of static maps.

A `Family` gives a search the start of a map from points (x, z) of a curve, its sizes, and a linear trial that tests
a pair of filters. `family_of` makes a family of the argument ``static``: a name, a class or a map.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import did_you_mean
from emsid.errors import ModelError
from emsid.models.blocks.static_maps import STATIC_MAPS, CubicSpline, Polynomial, StaticMap
from emsid.models.blocks.static_maps.through_points import spread_knots

Array = NDArray[np.float64]

# Knots of the spline that tests a pair of filters.
TRIAL_KNOTS = 12


def spline_trial(x: Array) -> tuple[StaticMap, ...]:
    """A spline with knots between the ends and the quantiles of x."""
    knots = spread_knots(x, TRIAL_KNOTS)
    return (CubicSpline(knots, knots),)


@dataclass(frozen=True, eq=False)
class Family:
    """A family of static maps.

    Attributes:
        name: the value of ``static``.
        start: the map of a given size that is closest to points x (m,), z (m,), up to a constant level.
        sizes: numbers of knots (or degrees) to choose from; empty if the family has one size. If the trial is of this
            family, its size is the first.
        smooth: whether a penalty keeps its maps smooth, so that choices use the first size and the last fit the last.
        loses_sign: whether its maps are even (lose the sign), so that signs must be recovered before a linear start.
        trial: for the input of the map, maps that are linear in their parameters and test the filters.
        direct: whether the trial maps are of this family, and not others in their place.
        plain: the family of the trial map, if it is a map of this family without its bends.
    """

    name: str
    start: Callable[[Array, Array, int], StaticMap]
    sizes: tuple[int, ...] = ()
    smooth: bool = False
    loses_sign: bool = False
    trial: Callable[[Array], tuple[StaticMap, ...]] = spline_trial
    direct: bool = False
    plain: Family | None = None


@cache
def family(map_: type[StaticMap]) -> Family:
    """The family of a class of maps.

    Args:
        map_: the class.
    """
    own_trials = map_.trials.__func__ is not StaticMap.trials.__func__  # type: ignore[attr-defined]
    trial = map_.trials if own_trials else spline_trial
    made = Family(map_.kind, map_.started, map_.sizes, map_.smooth, map_.loses_sign, trial)
    tried = {type(each) for each in trial(np.linspace(-1.0, 1.0, 2 * TRIAL_KNOTS))} if own_trials else set()
    if tried <= {map_}:
        return replace(made, direct=own_trials)
    return replace(made, plain=family(tried.pop()))


def given(map_: StaticMap, name: str = "given") -> Family:
    """The family of one map, for example a user's own, which starts with its own parameters."""
    return Family(name, lambda x, z, size: map_, trial=lambda x: (map_,), direct=True)


def families() -> dict[str, Family]:
    """Every registered family by name."""
    return {kind: family(map_) for kind, map_ in STATIC_MAPS.items()}


def tried_families(rectified: bool = False) -> tuple[Family, ...]:
    """The families that a search tries if no static map is given; the spline is first, because trials are splines.

    Args:
        rectified: whether the output is rectified; then maps that lose the sign are tried, and the spline.
    """
    found = tuple(family(map_) for map_ in STATIC_MAPS.values() if map_.tried and map_.loses_sign == rectified)
    return (*found, SPLINE) if rectified else found


def family_of(static: Any) -> Family:
    """The family for the argument ``static``.

    Args:
        static: a family, the name of a registered map, its class, or a map. A map stands for its family, with its
            number of knots or its degree; a map that has no start from data starts with its own parameters.

    Raises:
        ModelError: for anything else, with a list of the maps.
    """
    if isinstance(static, Family):
        return static
    if isinstance(static, str):
        if static in STATIC_MAPS:
            return family(STATIC_MAPS[static])
        near = did_you_mean(static, STATIC_MAPS)
        raise ModelError(f"no static map {static!r}; there are {', '.join(STATIC_MAPS)}{near}", arguments=("static",))
    if isinstance(static, type) and issubclass(static, StaticMap) and hasattr(static, "kind"):
        return family(static)
    if isinstance(static, StaticMap):
        if type(static).started.__func__ is StaticMap.started.__func__:  # type: ignore[attr-defined]
            return given(static, static.kind)
        return replace(family(type(static)), sizes=(static.size,)) if static.size else family(type(static))
    called = static.__name__ if isinstance(static, type) else f"a {type(static).__name__}"
    raise ModelError(
        f"{called} is no static map; give a name ({', '.join(STATIC_MAPS)}), or one of emsid.blocks such as DeadZone()",
        arguments=("static",),
    )


POLYNOMIAL = family(Polynomial)
SPLINE = family(CubicSpline)
