"""Physical parameters: name, symbol, unit, meaning and measured quantity."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Parameter(NamedTuple):
    """A physical parameter.

    Attributes:
        name: dotted inside a part, such as ``rotor_friction.coulomb``.
        symbol: in equations, such as ``R_a``.
        unit: SI, such as ``N*m``.
        description: its meaning, in a few words.
    """

    name: str
    symbol: str
    unit: str
    description: str


class Measure(Enum):
    """The quantity that a parameter measures, as (unit of a rotation, unit of a translation).

    It gives a search the plausible size of a parameter whose start is zero.
    """

    FORCE = ("N*m", "N")
    DAMPING = ("N*m*s/rad", "N*s/m")
    QUADRATIC = ("N*m*s^2/rad^2", "N*s^2/m^2")
    SPEED = ("rad/s", "m/s")
    PER_SPEED = ("s/rad", "s/m")
    PER_FORCE = ("1/(N*m)", "1/N")
    COMMAND = ("V", "V")
    TIME = ("s", "s")
    FACTOR = ("1", "1")
    OTHER = ("", "")

    def unit(self, linear: bool = False) -> str:
        """The SI unit, of a rotation or of a translation."""
        return str(self.value[linear])
