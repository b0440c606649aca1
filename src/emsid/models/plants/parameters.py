"""What a plant is: a frozen value that simulates itself, and whose physical parameters are read and written by name.

A parameter may stand for several values that move together, such as a friction level for both directions, or the two
break points of a dead zone; its `Handle` knows where they are kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import inf
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.state import PlantState
from emsid.plant import DeadZoneLaw
from emsid.plant.motor import Parameter
from emsid.units import with_unit

Array = NDArray[np.float64]

TINY = 1e-12
"""A parameter that is positive may get as small as this."""
POSITIVE = {"resistance", "motor_constant", "rotor_inertia", "load_inertia", "shaft_stiffness", "mass"}


class Signal(Enum):
    """What a channel of a record measures."""

    SPEED = "speed"
    POSITION = "position"
    CURRENT = "current"
    ROTOR_SPEED = "rotor speed"


class Handle(NamedTuple):
    """A parameter of a plant: what it is, where it is kept and what it may be.

    Attributes:
        parameter: name, symbol, SI unit and meaning.
        paths: where in the plant the value is kept, each with a sign; a parameter for both directions has two places.
        lower, upper: what is physical.
    """

    parameter: Parameter
    paths: tuple[tuple[tuple[str | int, ...], float], ...]
    lower: float = -inf
    upper: float = inf

    def with_unit(self, value: float, digits: int = 4) -> str:
        """A value of it as text."""
        return with_unit(f"{value:.{digits}g}", self.parameter.unit)

    @property
    def allowed(self) -> str:
        """The bounds in words."""
        if self.upper < inf:
            return f"it must be from {self.lower:g} to {self.upper:g} and finite"
        if self.lower == -inf:
            return "it must be finite"
        return "it must be positive and finite" if self.lower > 0 else "it cannot be negative and must be finite"


class Quantity(NamedTuple):
    """A combination of parameters that has a meaning of its own."""

    name: str
    formula: str
    unit: str
    value: float


class Plant(Protocol):
    """Anything the grey box can fit: a value with named parameters that simulates itself."""

    @property
    def name(self) -> str:
        """What it is called in tables and files."""
        ...

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Every parameter by name."""
        ...

    @property
    def usual(self) -> tuple[str, ...]:
        """The parameters that are estimated where nothing else is said, those first that should rather be held."""
        ...

    @property
    def fine(self) -> frozenset[str]:
        """Parameters that matter only once the others are about right: they join the search later."""
        ...

    @property
    def states(self) -> int:
        """How many numbers an initial state has."""
        ...

    def value(self, name: str) -> float:
        """The value of a parameter in SI units."""
        ...

    def put(self, values: Mapping[str, float]) -> Self:
        """The plant with other parameters."""
        ...

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample, from an initial state and a command (nu,) that stood until then."""
        ...

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The output (N, ny) driven by inputs (N, nu), and the state after them: blocks are as good as one run."""
        ...

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu) held over ``dt`` seconds, from an initial state."""
        ...

    def quantities(self) -> tuple[Quantity, ...]:
        """Combinations of parameters with a meaning of their own, which records may tell where the parameters hide."""
        ...


def read_at(thing: Any, path: tuple[str | int, ...]) -> float:
    """A number in a nested value."""
    for step in path:
        if thing is None:
            return 0.0 if path[-1] in ("b_l", "b_r") else 1.0  # of a dead zone that is not there
        thing = thing[step] if isinstance(step, int) else getattr(thing, step)
    return float(thing)


def write_at(thing: Any, path: tuple[str | int, ...], value: float) -> Any:
    """The same nested value with another number in it."""
    step, *rest = path
    if isinstance(step, int):
        return tuple(value if k == step else kept for k, kept in enumerate(thing))
    if thing is None:
        thing = DeadZoneLaw(0.0, 0.0)
    return replace(thing, **{step: write_at(getattr(thing, step), tuple(rest), value) if rest else value})


@dataclass(frozen=True)
class Parametrised:
    """What every plant made of nested dataclasses shares: parameters read and written by name."""

    def value(self, name: str) -> float:
        """The value of a parameter in SI units; of one for both directions, the forward one."""
        path, sign = self._handle(name).paths[0]
        return sign * read_at(self, path)

    def put(self, values: Mapping[str, float]) -> Self:
        """The same plant with other parameters, by name, in SI units.

        Raises:
            ModelError: for a name it does not have or a value that is not physical.
        """
        plant = self
        for name, value in values.items():
            for path, sign in self._handle(name).paths:
                plant = write_at(plant, path, sign * float(value))
        return plant

    def _handle(self, name: str) -> Handle:
        return find_handle(self, name)  # type: ignore[arg-type]


def find_handle(plant: Plant, name: str) -> Handle:
    """The handle of a parameter.

    Raises:
        ModelError: where the plant has no parameter of that name; the message says which it has.
    """
    if name not in plant.handles:
        raise ModelError(f"{plant.name} has no parameter {name!r}; it has {', '.join(plant.handles)}")
    return plant.handles[name]


def refuse_overlap(plant: Plant, names: Iterable[str]) -> None:
    """Refuse names that stand for the same value of a plant, such as a level for both directions and the forward one.

    Raises:
        ModelError: that names the two.
    """
    places: dict[tuple[str | int, ...], str] = {}
    for name in names:
        for path, _ in find_handle(plant, name).paths:
            if path in places:
                raise ModelError(f"{places[path]} and {name} are the same thing in part; choose one of them")
            places[path] = name


def parts(plant: Plant, name: str) -> tuple[str, ...]:
    """The names of the values that a parameter moves together, such as its two directions; none for a single value."""
    paths = [path for path, _ in find_handle(plant, name).paths]
    if len(paths) == 1:
        return ()
    return tuple(one for one, handle in plant.handles.items() if len(handle.paths) == 1 and handle.paths[0][0] in paths)


def without_overlap(plant: Plant, names: Iterable[str], taken: Iterable[str]) -> tuple[str, ...]:
    """The names, less what is taken; where one value of a name is taken or named itself, its other values are left.

    Raises:
        ModelError: for a name that the plant does not have.
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


def handles_of(prefix: tuple[str, ...], name: str, symbol: str, unit: str, description: str) -> dict[str, Handle]:
    """The handles of a scalar, or those of a pair and of a dead zone, which can be moved together or side by side."""
    path: tuple[str | int, ...] = (*prefix, *name.split("."))
    part, last = path[-2] if len(path) > 1 else "", path[-1]
    parameter = Parameter(name, symbol, unit, description)
    if last in ("b_l", "b_r"):
        side = (-inf, 0.0) if last == "b_l" else (0.0, inf)
        handles = {name: Handle(parameter, ((path, 1.0),), *side)}
        if last == "b_r":
            both = parameter._replace(
                name=name.replace("b_r", "half_width"),
                symbol="b",
                description=description.replace("right break point", "half the width"),
            )
            handles[both.name] = Handle(both, ((path, 1.0), ((*path[:-1], "b_l"), -1.0)), 0.0)
        return handles
    if "friction" in str(part) or last == "viscous_friction":
        handles = {name: Handle(parameter, (((*path, 0), 1.0), ((*path, 1), 1.0)), 0.0)}
        for k, side_name in enumerate(("forward", "backward")):
            one = parameter._replace(
                name=f"{name}.{side_name}",
                symbol=f"{symbol}{'⁺⁻'[k]}",
                description=f"{description}, {side_name}",
            )
            handles[one.name] = Handle(one, (((*path, k), 1.0),), 0.0)
        return handles
    lower = TINY if last in POSITIVE or last in ("m_l", "m_r") else 0.0
    return {name: Handle(parameter, ((path, 1.0),), lower)}
