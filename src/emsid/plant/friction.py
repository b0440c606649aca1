"""Friction of a sliding body: the interface of a friction law, and the law of the paper.

A law gives the torque against the motion at a speed, ``level(|ω|)``, and declares its parameters. The simulation,
datasheets, tables, curves and model files use only these. To add a law, define a frozen dataclass that derives from
`FrictionLaw` and register it under a name with `friction_law`.

The law of the paper: the friction torque on a body turning at ω is, with sgn(0) = 0 (4.8),

    T_f(ω) = [α₀ + α₁·exp(−α₂·|ω|)]·sgn(ω)                                (4.7)

a Coulomb level α₀ and a Stribeck excess α₁ that decays with speed at the rate α₂. At ω = 0 the law is set-valued:
friction balances any torque up to the break-away level α₀ + α₁. The laws below give the sliding value; in simulations
a body stays at rest up to `FrictionLaw.breakaway`.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import isfinite
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit, with_functions
from emsid.errors import ModelError
from emsid.plant.parameter import Measure

Array = NDArray[np.float64]


def sign(speed: ArrayLike) -> Array:
    """sgn(ω) (4.8): 1 forward, −1 backward, 0 at rest."""
    return np.asarray(np.sign(np.asarray(speed, dtype=float)))


def coulomb(speed: ArrayLike, level: ArrayLike) -> Array:
    """α₀·sgn(ω): the first part of (4.7), in N·m.

    Args:
        speed: ω in rad/s.
        level: α₀ in N·m.
    """
    return np.asarray(level, dtype=float) * sign(speed)


def stribeck(speed: ArrayLike, excess: ArrayLike, rate: ArrayLike) -> Array:
    """α₁·exp(−α₂·|ω|)·sgn(ω): the second part of (4.7), in N·m.

    Args:
        speed: ω in rad/s.
        excess: α₁ in N·m, the torque at standstill above the Coulomb level.
        rate: α₂ in s/rad; 1/α₂ is the speed at which the excess has fallen to 37 %.
    """
    w = np.asarray(speed, dtype=float)
    fading: Array = np.exp(-np.asarray(rate, dtype=float) * np.abs(w))
    return np.asarray(excess, dtype=float) * fading * sign(w)


def viscous(speed: ArrayLike, coefficient: ArrayLike) -> Array:
    """B·ω: the viscous part, which (4.4) and (4.5) keep apart from (4.7), in N·m.

    Args:
        speed: ω in rad/s.
        coefficient: B in N·m·s/rad.
    """
    torque: Array = np.asarray(coefficient, dtype=float) * np.asarray(speed, dtype=float)
    return torque


class OneDirection(NamedTuple):
    """The three numbers of (4.7) in one direction of motion.

    Attributes:
        coulomb: α₀ in N·m.
        stribeck: α₁ in N·m, the excess near rest.
        stribeck_rate: α₂ in s/rad, its decay rate with speed.
    """

    coulomb: float
    stribeck: float
    stribeck_rate: float


class LawParameter(NamedTuple):
    """A parameter of a friction law; it has a value for each direction of motion.

    Attributes:
        name: the field of the law.
        symbol: in equations and tables.
        measure: the measured quantity, which gives the unit.
        description: its meaning in a few words.
        linear_symbol: the symbol for linear motion; empty for the same one.
    """

    name: str
    symbol: str
    measure: Measure
    description: str
    linear_symbol: str = ""


Level = Callable[..., Any]
"""(speed ≥ 0, numbers (2, n), side) → the torque or force that opposes the motion; side 0 is forward, 1 backward. For a
law that depends on the load, (speed, numbers, side, torque of the drive, torque from outside)."""
LOADED = 5
"""How many arguments the level of a law that depends on the load takes."""


def sees_load(level: Level) -> bool:
    """Whether a level depends on the load."""
    code = getattr(getattr(level, "py_func", level), "__code__", None)
    return code is not None and code.co_argcount == LOADED


@dataclass(frozen=True)
class FrictionLaw(ABC):
    """The base class of friction laws: a frozen dataclass whose fields are its parameters, in order.

    A field is one number for both directions or a pair (forward, backward); it is stored as a pair.

    Attributes:
        parameters: the description of each field.
        level: the torque against the motion at a speed. A function compiled with ``numba.njit`` is as fast as the
            built-in law; a plain Python function is some hundred times slower.

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    parameters: ClassVar[tuple[LawParameter, ...]]
    level: ClassVar[Level]

    def __post_init__(self) -> None:
        for each in self.parameters:
            object.__setattr__(self, each.name, _pair(each.name, getattr(self, each.name)))

    @cached_property
    def numbers(self) -> Array:
        """(2, n) the parameters of each direction, in order."""
        return np.array([getattr(self, each.name) for each in self.parameters]).T.copy()

    @cached_property
    def varies(self) -> NDArray[np.bool_]:
        """(2,) whether the level depends on speed, by direction; a constant level is simulated exactly."""
        return np.ones(2, dtype=bool)

    @property
    def reach(self) -> float:
        """The largest speed in rad/s in a figure of the law."""
        return 100.0

    @cached_property
    def breakaway(self) -> tuple[float, float]:
        """(forward, backward) in N·m: the net torque up to which a body without load stays at rest."""
        return self._against(0.0, 0), self._against(0.0, 1)

    def torque(self, speed: ArrayLike) -> Array:
        """T_f(ω) in N·m while sliding without load at ``speed`` in rad/s, of any shape; 0 at ω = 0."""
        w = np.asarray(speed, dtype=float)
        flat = [np.sign(one) * self._against(abs(float(one)), int(one < 0)) for one in w.ravel()]
        return np.array(flat).reshape(w.shape)

    def _against(self, speed: float, side: int) -> float:
        """The torque against the motion in N·m, without load."""
        level = type(self).level
        return float(level(speed, self.numbers.astype(float), side, *(0.0, 0.0) * sees_load(level)))

    @property
    def symmetric(self) -> bool:
        """Whether both directions are equal."""
        return bool(np.array_equal(*self.numbers))

    @property
    def base(self) -> tuple[float, float]:
        """(forward, backward) the first parameter, a friction level."""
        forward, backward = getattr(self, self.parameters[0].name)
        return forward, backward

    def sliding_at(self, level: float) -> Self:
        """The same law with its first parameter, a friction level, set to this value in both directions."""
        return replace(self, **{self.parameters[0].name: level})


L = TypeVar("L", bound=type[FrictionLaw])
FRICTION_LAWS: dict[str, type[FrictionLaw]] = {}
"""Every friction law, by its name in files."""


def friction_law(name: str) -> Callable[[L], L]:
    """Register a class as a friction law under this name.

    Args:
        name: in datasheets and model files: ``law = "exponential"``.

    Raises:
        ModelError: if another law has this name.
    """

    def register(law: L) -> L:
        if FRICTION_LAWS.get(name, law).__qualname__ != law.__qualname__:
            raise ModelError(f"there is a friction law {name!r} already; choose another name")
        FRICTION_LAWS[name] = law
        return law

    return register


def find_law(name: object) -> type[FrictionLaw]:
    """The friction law with this name.

    Raises:
        ModelError: for an unknown name.
    """
    if not isinstance(name, str) or name not in FRICTION_LAWS:
        raise ModelError(f"no friction law {name!r}; there are {', '.join(FRICTION_LAWS)}")
    return FRICTION_LAWS[name]


def law_name(law: FrictionLaw) -> str:
    """The registered name of a law.

    Raises:
        ModelError: for a law that is not registered.
    """
    for name, kind in FRICTION_LAWS.items():
        if kind is type(law):
            return name
    raise ModelError(f"the friction law {type(law).__name__} is not registered; put @friction_law(NAME) above it")


@njit(nogil=True, error_model="numpy", inline="always")
def coulomb_stribeck(speed: float, numbers: Array, side: int) -> float:
    """α₀ + α₁·exp(−α₂·|ω|): (4.7) for one direction."""
    return float(numbers[side, 0] + numbers[side, 1] * np.exp(-numbers[side, 2] * speed))


@njit(nogil=True, error_model="numpy", inline="always")
def of_motion(speed: float, numbers: Array, side: int, made: float, outside: float) -> float:
    """(4.7) for one direction, as a function of the forces of the drive and from outside too, on which it does not
    depend."""
    return float(coulomb_stribeck(speed, numbers, side))


@cache
def of_forces(level: Level) -> Level:
    """A level as a function of speed, numbers, side and the forces of the drive and from outside, whatever it takes."""
    made: Level = level if sees_load(level) else with_functions(of_motion, coulomb_stribeck=level)
    return made


@friction_law("coulomb-stribeck")
@dataclass(frozen=True)
class Friction(FrictionLaw):
    """Coulomb and Stribeck friction (4.7), with levels that may differ by direction.

    >>> Friction(0.02, stribeck=(0.01, 0.015), stribeck_rate=0.5).breakaway
    (0.03, 0.035)

    Args:
        coulomb: Coulomb level α₀ in N·m; one number for both directions or a pair (forward, backward).
        stribeck: Stribeck excess α₁ in N·m at standstill; a number or a pair.
        stribeck_rate: Stribeck rate α₂ in s/rad; a number or a pair.

    Raises:
        ModelError: for a value that is negative or not finite.
    """

    coulomb: float | tuple[float, float] = 0.0
    stribeck: float | tuple[float, float] = 0.0
    stribeck_rate: float | tuple[float, float] = 0.0

    parameters: ClassVar[tuple[LawParameter, ...]] = (
        LawParameter("coulomb", "α₀", Measure.FORCE, "Coulomb level", "F_c"),
        LawParameter("stribeck", "α₁", Measure.FORCE, "Stribeck excess at standstill", "F_s"),
        LawParameter("stribeck_rate", "α₂", Measure.PER_SPEED, "Stribeck rate"),
    )
    level: ClassVar[Level] = coulomb_stribeck

    @cached_property
    def varies(self) -> NDArray[np.bool_]:
        """(2,) whether there is a Stribeck excess, by direction."""
        return np.asarray(np.array(self.stribeck) > 0)

    @property
    def reach(self) -> float:
        """Five times the speed at which the slowest Stribeck excess has fallen to 37 %; 10 rad/s without one."""
        slowest = min((s.stribeck_rate for s in (self.forward, self.backward) if s.stribeck > 0), default=0.0)
        return 5 / slowest if slowest > 0 else 10.0

    @property
    def forward(self) -> OneDirection:
        """The parameters for ω > 0."""
        return self._sliding(0)

    @property
    def backward(self) -> OneDirection:
        """The parameters for ω < 0."""
        return self._sliding(1)

    @cached_property
    def breakaway(self) -> tuple[float, float]:
        """α₀ + α₁ (forward, backward) in N·m: the net torque up to which a body stays at rest."""
        forward, backward = self.forward, self.backward
        return forward.coulomb + forward.stribeck, backward.coulomb + backward.stribeck

    def torque(self, speed: ArrayLike) -> Array:
        """T_f(ω) (4.7) in N·m while sliding at ``speed`` in rad/s, of any shape; 0 at ω = 0."""
        w = np.asarray(speed, dtype=float)
        level, excess, rate = (
            np.where(w < 0, backward, forward) for forward, backward in zip(self.forward, self.backward, strict=True)
        )
        return coulomb(w, level) + stribeck(w, excess, rate)

    def _sliding(self, direction: int) -> OneDirection:
        return OneDirection(*(getattr(self, each.name)[direction] for each in self.parameters))


def _pair(name: str, value: object) -> tuple[float, float]:
    """A number for both directions, or (forward, backward), as two checked numbers."""
    pair = tuple(value) if isinstance(value, (tuple, list)) else (value, value)
    if len(pair) != 2 or not all(isinstance(v, (int, float, np.number)) for v in pair):
        raise ModelError(f"friction {name} is {value!r}; give a number or a pair (forward, backward)")
    forward, backward = (v if isinstance(v, float) else float(v) for v in pair)
    if not (isfinite(forward) and isfinite(backward) and min(forward, backward) >= 0):
        raise ModelError(f"friction {name} is {value!r}; it cannot be negative and must be finite")
    return forward, backward
