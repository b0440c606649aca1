"""What a test signal may do: command, slew rate, speed and travel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.excitation import limit
from emsid.models.plants.parameters import Signal

Array = NDArray[np.float64]

HALVINGS = 7
"""Bisections of the size of a signal that goes too fast or too far: to 1 %."""


@dataclass(frozen=True)
class Limits:
    """The limits of an experiment.

    Args:
        command: the largest command either way, in its unit.
        slew: its fastest change per second.
        speed: the largest speed in rad/s (m/s).
        travel: the largest distance between two positions in rad (m).

    Raises:
        DataError: for a limit that is not positive.
    """

    command: float
    slew: float = inf
    speed: float = inf
    travel: float = inf

    def __post_init__(self) -> None:
        names = {"command": "limit", "slew": "limit_slew", "speed": "limit_speed", "travel": "limit_travel"}
        for name, argument in names.items():
            value = getattr(self, name)
            if not value > 0 or (name == "command" and not isfinite(value)):
                raise DataError(f"a limit of {value:g}; give a positive one", arguments=(argument,))

    def put_out(self, signal: Array, dt: float) -> Array:
        """The signal as a generator with these limits puts it out, which begins at 0."""
        slew = self.slew if isfinite(self.slew) else None
        return limit(np.concatenate([[0.0], signal]), dt, self.command, slew)[1:]

    def scaled(self, model: Any, signal: Array, dt: float) -> Array | None:
        """The largest multiple up to 1 of a signal with which the model stays within the limits; None for none."""
        whole = self.put_out(signal, dt)
        if self.allows(model, whole, dt):
            return whole
        low, high, best = 0.0, 1.0, None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            tried = self.put_out(middle * signal, dt)
            if self.allows(model, tried, dt):
                low, best = middle, tried
            else:
                high = middle
        return best

    def allows(self, model: Any, u: Array, dt: float) -> bool:
        """Whether a model stays within the limits of speed and travel."""
        if not (isfinite(self.speed) or isfinite(self.travel)):
            return True
        speed, position = motion(model, u, dt)
        return bool(
            np.isfinite(speed).all()
            and np.max(np.abs(speed), initial=0.0) <= self.speed
            and np.ptp(position) <= self.travel
        )


def motion(model: Any, u: Array, dt: float) -> tuple[Array, Array]:
    """Speed and position (N,) of a model from rest; of a model other than a plant, its output is the speed."""
    inputs = np.ascontiguousarray(u[:, None])
    if hasattr(model, "plant"):
        moving = replace(model, signals=(Signal.SPEED, Signal.POSITION))
        try:
            y = moving.run(moving.at_rest(0.0, dt), inputs)[0]
        except (ModelError, KeyError):
            raise ModelError(f"{model.name} has no speed and position to limit", arguments=("limit_speed",)) from None
        return y[:, 0], y[:, 1]
    speed = model.run(model.at_rest(0.0, dt), inputs)[0][:, 0]
    return speed, dt * np.cumsum(speed)
