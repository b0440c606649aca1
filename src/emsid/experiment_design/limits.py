"""What a test signal may do: command, slew rate, speed, travel and current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.excitation import limit
from emsid.models.plants.parameters import CURRENTS, Signal

Array = NDArray[np.float64]

HALVINGS = 7
"""Bisections of the size of a signal that goes too fast or too far: to 1 %."""


@dataclass(frozen=True)
class Limits:
    """The limits of an experiment.

    Args:
        command: the largest command either way, in its unit; of every input that a test chooses.
        slew: its fastest change per second.
        speed: the largest speed in rad/s (m/s).
        travel: the largest distance between two positions in rad (m).
        current: the largest current in A; of a brushless motor the amplitude of both axes.

    Raises:
        DataError: for a limit that is not positive.
    """

    command: float
    slew: float = inf
    speed: float = inf
    travel: float = inf
    current: float = inf

    def __post_init__(self) -> None:
        names = {"command": "limit", "slew": "limit_slew", "speed": "limit_speed", "travel": "limit_travel"}
        names["current"] = "limit_current"
        for name, argument in names.items():
            value = getattr(self, name)
            if not value > 0 or (name == "command" and not isfinite(value)):
                raise DataError(f"a limit of {value:g}; give a positive one", arguments=(argument,))

    def put_out(self, signal: Array, dt: float) -> Array:
        """The signals (N, nc) as a generator with these limits puts them out, which begins at 0."""
        slew = self.slew if isfinite(self.slew) else None
        return np.column_stack([limit(np.concatenate([[0.0], each]), dt, self.command, slew)[1:] for each in signal.T])

    def scaled(self, models: Sequence[Any], signal: Array, dt: float) -> Array | None:
        """The largest multiple up to 1 of signals (N, nc) with which all models stay within the limits; None for none.

        Args:
            models: that the plant may be.
            signal: the commands.
            dt: in s.
        """
        whole = self.put_out(signal, dt)
        if self.allows(models, whole, dt):
            return whole
        low, high, best = 0.0, 1.0, None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            tried = self.put_out(middle * signal, dt)
            if self.allows(models, tried, dt):
                low, best = middle, tried
            else:
                high = middle
        return best

    def allows(self, models: Sequence[Any], u: Array, dt: float) -> bool:
        """Whether models stay within the limits of speed, travel and current."""
        return all(self._holds(model, u, dt) for model in models)

    def _holds(self, model: Any, u: Array, dt: float) -> bool:
        moves, flows = isfinite(self.speed) or isfinite(self.travel), isfinite(self.current)
        if not (moves or flows):
            return True
        if moves:
            speed, position = motion(model, u, dt)
            within = np.max(np.abs(speed), initial=0.0) <= self.speed and np.ptp(position) <= self.travel
            if not (np.isfinite(speed).all() and within):
                return False
        return not flows or bool(np.max(current(model, u, dt), initial=0.0) <= self.current)


def motion(model: Any, u: Array, dt: float) -> tuple[Array, Array]:
    """Speed and position (N,) of a model from rest; of a model other than a plant, its output is the speed."""
    if hasattr(model, "plant"):
        y = _outputs(model, (Signal.SPEED, Signal.POSITION), "limit_speed", u, dt)
        return y[:, 0], y[:, 1]
    speed = model.run(model.at_rest(0.0, dt), np.ascontiguousarray(u))[0][:, 0]
    return speed, dt * np.cumsum(speed)


def current(model: Any, u: Array, dt: float) -> Array:
    """(N,) the size of the current of a plant from rest.

    Raises:
        ModelError: for a model without a current.
    """
    channels = model.plant.channels if hasattr(model, "plant") else None
    known = () if channels is None else tuple(each for each in CURRENTS if each in channels.units)
    if not known:
        raise ModelError(f"{model.name} has no current to limit", arguments=("limit_current",))
    return np.asarray(np.linalg.norm(_outputs(model, known, "limit_current", u, dt), axis=1))


def _outputs(model: Any, signals: tuple[Signal, ...], argument: str, u: Array, dt: float) -> Array:
    moving = replace(model, signals=signals)
    try:
        return np.asarray(moving.run(moving.at_rest(np.zeros(u.shape[1]), dt), np.ascontiguousarray(u))[0])
    except (ModelError, KeyError):
        what = " and ".join(signal.value for signal in signals)
        raise ModelError(f"{model.name} has no {what} to limit", arguments=(argument,)) from None
