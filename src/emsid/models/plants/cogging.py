r"""Cogging: a force that depends on position and repeats with it, as slots of a motor or turns of a screw make it.

    F_c(x) = Σₙ aₙ·cos(2πnx/P) + bₙ·sin(2πnx/P),      n = 1, 2,

acts against the direction of positive motion, moving or at rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, pi

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.effects import idle as rows_without_effect
from emsid.models.plants.parameters import TINY, Handle, scalar
from emsid.plant import Measure, Parameter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cogging:
    """A force over position, as a Fourier series of two harmonics.

    Args:
        period: P in rad or m.
        cosine_1, sine_1: a₁ and b₁ in N·m or N.
        cosine_2, sine_2: a₂ and b₂, likewise.

    Raises:
        ModelError: for a period that is not positive, or an amplitude that is not finite.
    """

    period: float = 2 * pi
    cosine_1: float = 0.0
    sine_1: float = 0.0
    cosine_2: float = 0.0
    sine_2: float = 0.0

    def __post_init__(self) -> None:
        if not (isfinite(self.period) and self.period > 0):
            raise ModelError(f"cogging with a period of {self.period}; it must be positive and finite")
        if not all(map(isfinite, (self.cosine_1, self.sine_1, self.cosine_2, self.sine_2))):
            raise ModelError("cogging with an amplitude that is not finite")

    @cached_property
    def waves(self) -> Array:
        """(n, 3) 2πn/P, aₙ and bₙ of every harmonic up to the last that has an effect."""
        first = 2 * pi / self.period
        rows = [(first, self.cosine_1, self.sine_1), (2 * first, self.cosine_2, self.sine_2)]
        while rows and not any(rows[-1][1:]):
            rows.pop()
        return np.array(rows).reshape(-1, 3)


def cogging_handles(force: str, position: str) -> dict[str, Handle]:
    """The handles of the cogging of a plant, with the units of its force and its position."""
    about = [("period", "P_c", position, "period of the cogging over position", Measure.OTHER)]
    for n, (cosine, sine) in ((1, ("a₁", "b₁")), (2, ("a₂", "b₂"))):
        about += [
            (f"cosine_{n}", cosine, force, f"cosine of the cogging, harmonic {n}", Measure.FORCE),
            (f"sine_{n}", sine, force, f"sine of the cogging, harmonic {n}", Measure.FORCE),
        ]
    found: dict[str, Handle] = {}
    for name, symbol, unit, description, measure in about:
        parameter = Parameter(f"cogging.{name}", symbol, unit, description)
        found |= scalar(("cogging", name), parameter, measure, TINY if name == "period" else -np.inf)
    return found


IDLE_AT_ZERO = ("shaft_backlash", "sensor.radius", "sensor.backlash", "backlash")


def without_idle(parameters: Mapping[str, float]) -> dict[str, float]:
    """Parameters of a plant without those of cogging, effects, backlash and wheel that have no effect."""
    idle = () if any(value for name, value in parameters.items() if name.startswith(("cogging.c", "cogging.s"))) else (
        "cogging.",
    )  # fmt: skip
    effectless = rows_without_effect(parameters)
    return {
        name: value
        for name, value in parameters.items()
        if not (idle and name.startswith(idle)) and (name not in IDLE_AT_ZERO or value) and name not in effectless
    }


def check_quadratic(what: str, value: float) -> None:
    """Refuse a quadratic friction that is negative or not finite.

    Raises:
        ModelError: naming ``what`` has it.
    """
    if not (isfinite(value) and value >= 0):
        raise ModelError(f"{what} with quadratic friction {value}; it cannot be negative and must be finite")


def extra_terms(quadratic: float, cogging: Cogging, symbol: str, speed: str, position: str) -> str:
    """The terms of an equation of motion for quadratic friction and cogging, as far as they have an effect."""
    drag = f" − {symbol}·|{speed}|·{speed}" if quadratic else ""
    return drag + (f" − F_c({position})" if len(cogging.waves) else "")
