"""The sensor between the motion of a plant and the log.

It may have a first-order lag, an offset, a gear ratio, the radius of a wheel whose rim it measures, or an average over
the previous sample, as from counting encoder edges.

An encoder on the load side of a gear with backlash 2β reads a load that friction holds while the motor crosses the gap:

    y_k = min(max(y_{k−1}, x_k − β), x_k + β),

the friction-driven hysteresis of Nordin and Gutman, *Controlling mechanical systems with backlash – a survey*,
Automatica 38 (2002). An encoder on the motor side reads x.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.models.plants.parameters import Signal

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """The sensor between the motion and the log.

    Args:
        ratio: turns of the motor per measured turn.
        lag: time constant of its filter in s.
        offset: its reading at rest, in the unit of the output; not applied to a current.
        average: the share of the mean over the previous sample in a speed: 1 (True) where it comes from counting
            encoder edges, 0 (False) for a tachometer. A mean is half a sample late.
        backlash: 2β, the whole gap between the motor and the load whose position it reads, in the unit of the output; 0
            for a sensor on the motor side. The load is in the middle of the gap at the beginning.
        radius: in m, of a wheel whose way in m or speed in m/s it reads; 0 where it reads an angle or its rate.

    Raises:
        ModelError: for a ratio of zero, a negative lag, backlash or radius, or a share outside 0 to 1.
    """

    ratio: float = 1.0
    lag: float = 0.0
    offset: float = 0.0
    average: float = 0.0
    radius: float = 0.0
    backlash: float = 0.0

    def __post_init__(self) -> None:
        if not (isfinite(self.ratio) and self.ratio != 0 and isfinite(self.offset)):
            raise ModelError(
                f"sensor with ratio {self.ratio} and offset {self.offset}; give finite ones, the ratio not 0"
            )
        if not (isfinite(self.lag) and self.lag >= 0):
            raise ModelError(f"sensor with a lag of {self.lag} s; it cannot be negative and must be finite")
        if not (isfinite(self.backlash) and self.backlash >= 0):
            raise ModelError(f"sensor behind a backlash of {self.backlash}; it cannot be negative and must be finite")
        if not 0 <= self.average <= 1:
            raise ModelError(f"sensor with average {self.average}; give 0 (a tachometer) to 1 (an encoder)")
        if not (isfinite(self.radius) and self.radius >= 0):
            raise ModelError(f"sensor of a wheel with a radius of {self.radius} m; give a positive one, or 0 for none")

    @property
    def reads_a_wheel(self) -> bool:
        """Whether it reads the way or the speed of a wheel, and not an angle."""
        return self.radius > 0

    @property
    def scale(self) -> float:
        """The motion per reading: the turns of the motor per turn measured, or per m of the way of a wheel."""
        return self.ratio / self.radius if self.radius else self.ratio

    def first(self, signals: Sequence[Signal], state: Array, dt: float) -> Array:
        """(ny, 2) its state before the first sample, for every output: the last position (NaN), and the state of its
        filter, where a position reading lags by lag·reading.

        Args:
            signals: of the outputs.
            state: speed, position, and the speed reading, by default the true speed.
            dt: sample time in s.
        """
        kept = np.full((len(signals), 2), [np.nan, 0.0])
        if self.lag:
            speed, position = float(state[0]), float(state[1])
            reading = float(state[2]) if len(state) > 2 else speed
            for k, signal in enumerate(signals):
                of_position = signal is Signal.POSITION
                seen, shown = (position, position - self.lag * reading) if of_position else (speed, reading)
                kept[k, 1] = shown - self.weights(dt)[0] * seen
        return kept

    def numbers(self, dt: float) -> Array:
        """(8,) what `sense` takes: scale, offset, average, 1 with a lag, its weights, half the backlash."""
        lag = self.weights(dt) if self.lag else (0.0, 0.0, 0.0)
        gap = 0.5 * self.backlash * abs(self.scale) if self.backlash else 0.0
        return np.array([self.scale, self.offset, self.average, float(self.lag > 0), *lag, gap])

    def weights(self, dt: float) -> tuple[float, float, float]:
        """The discrete 1/(1 + lag·s) for a piecewise linear signal: weights of the newest value, the previous one, and
        the previous reading."""
        z = dt / self.lag
        decay, gain = float(np.exp(-z)), float(-np.expm1(-z) / z)
        return 1.0 - gain, gain - decay, decay


@njit(nogil=True, error_model="numpy")
def sense(sensor: Array, dt: float, speed: float, position: float, of_speed: bool, kept: Array, n: int) -> float:
    """The reading of a speed or a position.

    Args:
        sensor, dt: `Sensor.numbers`, and the sample time in s.
        speed, position: of the motor.
        of_speed: whether it reads a speed.
        kept, n: (ny, 2) its state, see `Sensor.first`, and the output, whose state is changed.
    """
    if sensor[7] > 0.0 and not np.isnan(kept[n, 0]):
        position = min(max(kept[n, 0], position - sensor[7]), position + sensor[7])
    value = speed if of_speed else position
    if of_speed and sensor[2] > 0.0:
        mean = value if np.isnan(kept[n, 0]) else (position - kept[n, 0]) / dt
        value = mean if sensor[2] == 1.0 else sensor[2] * mean + (1.0 - sensor[2]) * value
    if sensor[3] > 0.0:
        reading = sensor[4] * value + kept[n, 1]
        kept[n, 1] = sensor[5] * value + sensor[6] * reading
        value = reading
    kept[n, 0] = position
    return float(value / sensor[0] + sensor[1])
