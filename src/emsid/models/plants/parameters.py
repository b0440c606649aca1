"""The physical parameters of a plant, read and written by name.

A parameter may stand for several values that change together, such as a friction level for both directions, or the two
break points of a dead zone. Its `Handle` has their paths in the plant.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from enum import Enum
from functools import cache, lru_cache
from math import inf
from typing import Any, NamedTuple, Protocol

from emsid.arguments import did_you_mean
from emsid.errors import ModelError
from emsid.plant import DeadZoneLaw
from emsid.plant.friction import FrictionLaw
from emsid.plant.motor import law_parameters
from emsid.plant.parameter import Measure, Parameter
from emsid.units import with_unit

Path = tuple[str | int, ...]

TINY = 1e-12
"""The lower bound of positive parameters."""


class Signal(Enum):
    """The quantity that a channel of a record measures."""

    SPEED = "speed"
    POSITION = "position"
    CURRENT = "current"
    ROTOR_SPEED = "rotor speed"
    D_CURRENT = "d-axis current"
    Q_CURRENT = "q-axis current"


CURRENTS = (Signal.CURRENT, Signal.D_CURRENT, Signal.Q_CURRENT)
DISSIPATED = (Measure.FORCE, Measure.DAMPING, Measure.QUADRATIC)
"""What a plant loses by friction and damping."""


class Handle(NamedTuple):
    """A parameter of a plant: its meaning, its paths and its bounds.

    Attributes:
        parameter: name, symbol, SI unit and meaning.
        paths: paths of the value in the plant, each with a sign; a parameter for both directions has two.
        lower, upper: physical bounds.
        measure: the measured quantity, which gives its plausible size.
    """

    parameter: Parameter
    paths: tuple[tuple[tuple[str | int, ...], float], ...]
    lower: float = -inf
    upper: float = inf
    measure: Measure = Measure.OTHER

    def with_unit(self, value: float, digits: int = 4) -> str:
        """A value with its unit as text."""
        return with_unit(f"{value:.{digits}g}", self.parameter.unit)

    @property
    def allowed(self) -> str:
        """The bounds in words."""
        if self.upper < inf:
            return f"it must be from {self.lower:g} to {self.upper:g} and finite"
        if self.lower == -inf:
            return "it must be finite"
        return "it must be positive and finite" if self.lower > 0 else "it cannot be negative and must be finite"


class Named(Protocol):
    """An object with parameters by name."""

    @property
    def name(self) -> str:
        """Its name in messages."""
        ...

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Every parameter by name."""
        ...


def read_at(thing: Any, path: tuple[str | int, ...]) -> float:
    """A number in a nested value."""
    for step in path:
        if thing is None:
            return 0.0 if path[-1] in ("b_l", "b_r") else 1.0  # without a dead zone
        thing = thing[step] if isinstance(step, int) else getattr(thing, step)
    return float(thing)


def with_numbers(thing: Any, numbers: Mapping[Path, float]) -> Any:
    """The nested value with numbers replaced, each at its path; every part is made anew once."""
    return _made_anew(thing, _by_step(tuple(numbers)), numbers)


def _made_anew(thing: Any, changed: Mapping[str | int, Any], numbers: Mapping[Path, float]) -> Any:
    """A part with what is ``changed`` in it, by step: the path of a number, or the same of a part of the part."""
    if isinstance(thing, tuple):
        made = [_replaced(kept, changed[k], numbers) if k in changed else kept for k, kept in enumerate(thing)]
        return type(thing)(*made) if hasattr(thing, "_fields") else tuple(made)
    if thing is None:
        thing = DeadZoneLaw(0.0, 0.0)
    values = {name: getattr(thing, name) for name in _field_names(type(thing))}  # type: ignore[arg-type]
    for step, below in changed.items():
        values[step] = _replaced(values[step], below, numbers)  # type: ignore[index]
    return type(thing)(**values)


def _replaced(part: Any, below: Any, numbers: Mapping[Path, float]) -> Any:
    return numbers[below] if isinstance(below, tuple) else _made_anew(part, below, numbers)


@lru_cache(maxsize=1024)
def _by_step(paths: tuple[Path, ...]) -> dict[str | int, Any]:
    """Paths by their first step, then by their second, and so on, with the whole path at the end."""
    found: dict[str | int, Any] = {}
    for path in paths:
        inner = found
        for step in path[:-1]:
            inner = inner.setdefault(step, {})
        inner[path[-1]] = path
    return found


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    """What `dataclasses.replace` asks for anew at every call, which takes longer than the rest of it."""
    return tuple(field.name for field in fields(kind) if field.init)


def full_name(plant: Named, name: str) -> str:
    """The full name of a parameter, given by its name or by a unique symbol.

    A symbol may be written without its index, ``R`` for ``R_a``, if it is unique.

    Raises:
        ModelError: if the plant has no such parameter, or several; with a list of its parameters.
    """
    if name in plant.handles:
        return name
    symbols = {other: handle.parameter.symbol for other, handle in plant.handles.items()}
    whole = [other for other, symbol in symbols.items() if symbol == name]
    for same in (whole, [other for other, symbol in symbols.items() if symbol.partition("_")[0] == name]):
        if len(same) == 1:
            return same[0]
        if same:
            raise ModelError(f"{plant.name} has several parameters {name!r}: {', '.join(same)}; give one of them")
    near = did_you_mean(name, plant.handles, most=3) or f"; it has {', '.join(plant.handles)}"
    raise ModelError(f"{plant.name} has no parameter {name!r}{near}")


def find_handle(plant: Named, name: str) -> Handle:
    """The handle of a parameter, by its name or its symbol.

    Raises:
        ModelError: for an unknown name, with a list of the parameters.
    """
    known = plant.handles.get(name)
    return plant.handles[full_name(plant, name)] if known is None else known


def refuse_overlap(plant: Named, names: Iterable[str]) -> None:
    """Refuse names that stand for the same value of a plant, such as a level for both directions and the forward one.

    Raises:
        ModelError: with both names.
    """
    places: dict[tuple[str | int, ...], str] = {}
    for name in names:
        for path, _ in find_handle(plant, name).paths:
            if path in places:
                raise ModelError(f"{places[path]} and {name} overlap: both set one value; choose one of them")
            places[path] = name


def parts(plant: Named, name: str) -> tuple[str, ...]:
    """The names of the values that a parameter changes together, such as its two directions; empty for one value."""
    paths = [path for path, _ in find_handle(plant, name).paths]
    if len(paths) == 1:
        return ()
    return tuple(one for one, handle in plant.handles.items() if len(handle.paths) == 1 and handle.paths[0][0] in paths)


def bounds_of_parts(plant: Named, bounds: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """The bounds of the values that parameters change together, mirrored for the left side of a dead zone."""
    found = {}
    for name, (low, high) in bounds.items():
        signs = dict(find_handle(plant, name).paths)
        for part in parts(plant, name):
            found[part] = (low, high) if signs[plant.handles[part].paths[0][0]] > 0 else (-high, -low)
    return found


def without_overlap(plant: Named, names: Iterable[str], taken: Iterable[str]) -> tuple[str, ...]:
    """The names without those taken; if one value of a name is taken or listed itself, its other values remain.

    Raises:
        ModelError: for an unknown name.
    """
    wanted, spoken_for = tuple(dict.fromkeys(names)), set(taken)
    gone = spoken_for.union(*(parts(plant, name) for name in spoken_for))
    left: list[str] = []
    for name in wanted:
        sides = parts(plant, name)
        if any(side in gone or side in wanted for side in sides):
            left += [side for side in sides if side not in gone and side not in wanted]
        elif name not in gone:
            left.append(name)
    return tuple(left)


def scalar(
    path: Path, parameter: Parameter, measure: Measure = Measure.OTHER, lower: float = 0.0, upper: float = inf
) -> dict[str, Handle]:
    """The handle of one value, which cannot be negative unless ``lower`` allows it.

    Args:
        path: path of the value in the plant.
        parameter: name, symbol, unit and meaning.
        measure: the measured quantity.
        lower, upper: physical bounds.
    """
    return {parameter.name: Handle(parameter, ((path, 1.0),), lower, upper, measure)}


def by_direction(path: Path, parameter: Parameter, measure: Measure) -> dict[str, Handle]:
    """The handles of a pair (forward, backward): one for both, and one for each direction.

    Args:
        path: path of the pair in the plant.
        parameter: name, symbol, unit and meaning.
        measure: the measured quantity.
    """
    name, symbol, unit, description = parameter
    both = tuple(((*path, k), 1.0) for k in (0, 1))
    sides = {
        f"{name}.{side}": Handle(
            Parameter(f"{name}.{side}", f"{symbol}{'⁺⁻'[k]}", unit, f"{description}, {side}"),
            (((*path, k), 1.0),),
            0.0,
            measure=measure,
        )
        for k, side in enumerate(("forward", "backward"))
    }
    return {name: Handle(parameter, both, 0.0, measure=measure), **sides}


def law_handles(
    path: Path, name: str, law: type[FrictionLaw], where: str = "", index: str = "", linear: bool = False
) -> dict[str, Handle]:
    """The handles of a friction law at a path of a plant; their names begin with ``name``."""
    found: dict[str, Handle] = {}
    for parameter, each in zip(law_parameters(law, where, index, linear), law.parameters, strict=True):
        found |= by_direction((*path, each.name), parameter._replace(name=f"{name}.{each.name}"), each.measure)
    return found


def dead_zone_handles(path: Path, name: str, where: str, unit: str, measure: Measure) -> dict[str, Handle]:
    """The handles of a dead zone: its two break points, half its width, which changes both, and its slopes."""
    on = f"of the dead zone on the {where}"
    right, left = (*path, "b_r"), (*path, "b_l")
    half = Parameter(f"{name}.half_width", "b", unit, f"half the width {on}")
    return {
        **scalar(left, Parameter(f"{name}.b_l", "b_l", unit, f"left break point {on}"), measure, -inf, 0.0),
        **scalar(right, Parameter(f"{name}.b_r", "b_r", unit, f"right break point {on}"), measure),
        half.name: Handle(half, ((right, 1.0), (left, -1.0)), 0.0, measure=measure),
        **scalar((*path, "m_l"), Parameter(f"{name}.m_l", "m_l", "1", f"left slope {on}"), Measure.FACTOR, TINY),
        **scalar((*path, "m_r"), Parameter(f"{name}.m_r", "m_r", "1", f"right slope {on}"), Measure.FACTOR, TINY),
    }
