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
from emsid.estimation.linear.filtering import filtered_from
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

    def first(self, signals: Sequence[Signal], states: Array, dt: float) -> Array:
        """(ny, …, 2) its state before the first sample, for initial states (…, 2 or 3).

        Args:
            signals: of the outputs.
            states: speed, position, and the speed reading, by default the true speed.
            dt: sample time in s.
        """
        reading, motion = states[..., 2 if states.shape[-1] > 2 else 0], states[..., :2]
        return np.array([self._first(signal is Signal.POSITION, motion, dt, reading) for signal in signals])

    def read(
        self, signals: Sequence[Signal], speeds: Array, positions: Array, dt: float, kept: Array
    ) -> tuple[Array, Array]:
        """(…, N, ny) its readings of motions (…, N), and its state (ny, …, 2) after them; ``kept`` is that before."""
        columns = [
            self.position(positions, dt, before)
            if signal is Signal.POSITION
            else self.speed(speeds, positions, dt, before)
            for signal, before in zip(signals, kept, strict=True)
        ]
        return np.stack([values for values, _ in columns], axis=-1), np.array([after for _, after in columns])

    def _first(self, position: bool, motion: Array, dt: float, reading: Array) -> Array:
        """(…, 2) its state before the first sample: the last position (NaN) and the state of its filter.

        Args:
            position: whether it measures a position, not a speed.
            motion: (…, 2) speed and position at the first sample.
            dt: sample time in s.
            reading: (…) its speed reading at the first sample, before ratio and offset; a position reading lags by
                lag·reading.
        """
        kept = np.full(motion.shape, np.nan)
        kept[..., 1] = 0.0
        if self.lag:
            seen = motion[..., 1 if position else 0]
            kept[..., 1] = (seen - self.lag * reading if position else reading) - self.weights(dt)[0] * seen
        return kept

    def speed(self, speeds: Array, positions: Array, dt: float, kept: Array) -> tuple[Array, Array]:
        """(…, N) its readings of a speed, and its state (…, 2) after them; ``kept`` is the state before."""
        seen, positions = speeds, self._behind_gap(positions, kept)
        if self.average:
            before = kept[..., :1]
            start = np.where(np.isnan(before), speeds[..., :1], (positions[..., :1] - before) / dt)
            mean = np.concatenate([start, np.diff(positions) / dt], axis=-1)
            seen = mean if self.average == 1 else self.average * mean + (1 - self.average) * speeds
        return self._shown(seen, positions, dt, kept)

    def position(self, positions: Array, dt: float, kept: Array) -> tuple[Array, Array]:
        """(…, N) its readings of a position, and its state (…, 2) after them; ``kept`` is the state before."""
        positions = self._behind_gap(positions, kept)
        return self._shown(positions, positions, dt, kept)

    def _behind_gap(self, positions: Array, kept: Array) -> Array:
        """(…, N) the positions of a load behind the backlash; where it was before is a part of its state (…, 2)."""
        if not self.backlash:
            return positions
        flat = np.array(positions, dtype=float).reshape(-1, positions.shape[-1])
        before = np.broadcast_to(kept[..., 0], positions.shape[:-1]).ravel()
        follow(flat, np.where(np.isnan(before), flat[:, 0], before), 0.5 * self.backlash * abs(self.scale))
        return flat.reshape(positions.shape)

    def _shown(self, values: Array, positions: Array, dt: float, kept: Array) -> tuple[Array, Array]:
        lagging, after = values, kept.copy()
        if self.lag:
            newest, before, decay = self.weights(dt)
            lagging, after[..., 1:] = filtered_from([newest, before], [1.0, -decay], values, kept[..., 1:])
        after[..., 0] = positions[..., -1]
        return lagging / self.scale + self.offset, after

    def weights(self, dt: float) -> tuple[float, float, float]:
        """The discrete 1/(1 + lag·s) for a piecewise linear signal: weights of the newest value, the previous one, and
        the previous reading."""
        z = dt / self.lag
        decay, gain = float(np.exp(-z)), float(-np.expm1(-z) / z)
        return 1.0 - gain, gain - decay, decay


@njit(nogil=True, error_model="numpy")
def follow(positions: Array, before: Array, half: float) -> None:
    """Replace positions (P, N) by those of loads behind a gap of this half width, which were ``before`` (P,)."""
    for p in range(positions.shape[0]):
        load = before[p]
        for k in range(positions.shape[1]):
            load = min(max(load, positions[p, k] - half), positions[p, k] + half)
            positions[p, k] = load
