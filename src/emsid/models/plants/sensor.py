"""The sensor, which is between the motion of a plant and the log.

It may lag (first order), be off by a constant, count on the other side of a gear, or average over the sample before it,
as counting encoder edges does.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """What is between the motion and the log.

    Args:
        ratio: turns of the motor per turn of what is measured.
        lag: time constant of its filter in s.
        offset: what it shows at rest, in the unit of the output; not applied to a current.
        average: whether a speed is the mean over the sample before, as counting encoder edges gives it.

    Raises:
        ModelError: for a ratio of zero or a lag that is negative.
    """

    ratio: float = 1.0
    lag: float = 0.0
    offset: float = 0.0
    average: bool = False

    def __post_init__(self) -> None:
        if not (isfinite(self.ratio) and self.ratio != 0 and isfinite(self.offset)):
            raise ModelError(
                f"sensor with ratio {self.ratio} and offset {self.offset}; give finite ones, the ratio not 0"
            )
        if not (isfinite(self.lag) and self.lag >= 0):
            raise ModelError(f"sensor with a lag of {self.lag} s; it cannot be negative and must be finite")

    def begins(self, position: bool, motion: Array, dt: float, shown: float) -> Array:
        """(2,) what it keeps before the first sample: no position seen yet, and the state of its filter.

        Args:
            position: whether it shows a position, not a speed.
            motion: (2,) speed and position at the first sample.
            dt: sample time in s.
            shown: the speed that it shows at the first sample, before ratio and offset; of a position it is
                lag·shown behind.
        """
        if self.lag < 1e-6 * dt:
            return np.array([np.nan, 0.0])
        first = float(motion[1]) - self.lag * shown if position else shown
        return np.array([np.nan, first - self._weights(dt)[0] * float(motion[1 if position else 0])])

    def speed(self, speeds: Array, positions: Array, dt: float, kept: Array) -> tuple[Array, Array]:
        """(N,) what it shows of a speed, and what it keeps (2,) then, from what it kept before."""
        seen = speeds
        if self.average:
            before = float(kept[0])
            start = speeds[:1] if np.isnan(before) else (positions[:1] - before) / dt
            seen = np.concatenate([start, np.diff(positions) / dt])
        return self._shown(seen, positions, dt, kept)

    def position(self, positions: Array, dt: float, kept: Array) -> tuple[Array, Array]:
        """(N,) what it shows of a position, and what it keeps (2,) then, from what it kept before."""
        return self._shown(positions, positions, dt, kept)

    def _shown(self, values: Array, positions: Array, dt: float, kept: Array) -> tuple[Array, Array]:
        lagging, state = values, float(kept[1])
        if self.lag >= 1e-6 * dt:
            from scipy.signal import lfilter

            newest, before, decay = self._weights(dt)
            lagging, (state,) = lfilter([newest, before], [1.0, -decay], values, zi=[state])
        return lagging / self.ratio + self.offset, np.array([float(positions[-1]), state])

    def _weights(self, dt: float) -> tuple[float, float, float]:
        """1/(1 + lag·s) for a value that is a straight line between samples: of the newest value, the one before, and
        what was shown before."""
        z = dt / self.lag
        decay, gain = float(np.exp(-z)), float(-np.expm1(-z) / z)
        return 1.0 - gain, gain - decay, decay
