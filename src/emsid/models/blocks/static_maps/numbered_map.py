"""Maps whose parameters are a few named numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.static_maps.static_map import StaticMap

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NumberedMap(StaticMap):
    """A map whose first fields are its parameters.

    Attributes:
        letters: the letters of the parameters in formulas and files.
        slope_letter: the letter of the characteristic slope; empty if that slope is one and not a parameter.
        meanings: the meaning of each letter in a few words.
        ends: the letters of a lower and an upper end, of which the lower one must not exceed the upper one; or empty.
    """

    letters: ClassVar[tuple[str, ...]]
    slope_letter: ClassVar[str]
    meanings: ClassVar[Mapping[str, str]] = {}
    ends: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            if not np.isfinite(getattr(self, name)):
                raise ModelError(f"{self.kind} with {name} = {getattr(self, name)}; give finite numbers")

    @property
    def names(self) -> tuple[str, ...]:
        """The letters."""
        return self.letters

    @property
    def parameters(self) -> Array:
        """(p,) the first fields."""
        return np.array([getattr(self, name) for name in self._first_fields()])

    @property
    def anchors(self) -> tuple[int, ...]:
        """The characteristic slope."""
        return (self.letters.index(self.slope_letter),) if self.slope_letter else ()

    @property
    def steepness(self) -> float:
        """The characteristic slope."""
        return float(self.parameters[self.anchors[0]]) if self.slope_letter else 1.0

    def with_parameters(self, theta: Array) -> Self:
        """The map with other parameters; ends that would cross meet halfway."""
        values = dict(zip(self.letters, theta.tolist(), strict=True))
        if self.ends and values[self.ends[0]] > values[self.ends[1]]:
            values |= dict.fromkeys(self.ends, 0.5 * sum(values[letter] for letter in self.ends))
        return replace(self, **dict(zip(self._first_fields(), values.values(), strict=True)))

    def check(self) -> None:
        """Refuse ends that have crossed.

        Raises:
            Infeasible: with the ends.
        """
        values = dict(zip(self.letters, self.parameters.tolist(), strict=True))
        if self.ends and not values[self.ends[0]] <= values[self.ends[1]]:
            low, high = (f"{letter} = {values[letter]:.6g}" for letter in self.ends)
            raise Infeasible(f"{self.kind} from {low} to {high}; {self.ends[0]} must not exceed {self.ends[1]}")

    def meaning(self, name: str) -> str:
        """The meaning of its letter."""
        return f"{self.kind}: {self.meanings[name]}" if name in self.meanings else self.kind

    def to_data(self) -> dict[str, Any]:
        """All fields, parameters by their letters."""
        values = (getattr(self, field.name) for field in fields(self))
        return {"kind": self.kind, **dict(zip(self._keys(), values, strict=True))}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Self:
        """The map described by `to_data`."""
        return cls(*(float(data[key]) for key in cls._keys()))

    @classmethod
    def _first_fields(cls) -> list[str]:
        return [field.name for field in fields(cls)[: len(cls.letters)]]

    @classmethod
    def _keys(cls) -> tuple[str, ...]:
        return (*cls.letters, *(field.name for field in fields(cls)[len(cls.letters) :]))
