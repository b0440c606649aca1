"""The controller that runs: position, speed and current loop, feed-forward, friction, dead zone, anti-windup.

`RunningCascade` is the same sequence of operations as the C of `emsid.controllers.c_source`, in double precision.

- Feed-forward: ``per_speed·v + per_acceleration·a + load``, and the dry friction against the reference speed, from a
  table over the root of the speed. A reference at rest that begins to move gets the break-away level of the direction
  in which it will move.
- The inverse of the dead zone, whose jump is a straight line up to ``zone_width``.
- Anti-windup: the integral stands while the command is limited and the error would drive it further.
- Rest: while the reference rests within ``band`` of the position and the encoder stands, the error counts as zero, so
  that the command stands too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import copysign, inf, sqrt

import numpy as np

KNOTS = 33
"""Knots of the table of friction, at speeds that grow with the square; a Stribeck excess that fades over 2 % of the
largest speed is met within 3 % of it."""


@dataclass(frozen=True)
class Settings:
    """The numbers of a cascade, in SI units; u is the unit of what the speed loop commands: V, A, N·m or N.

    Attributes:
        dt: sample time of speed and position loop in s.
        position: gain of the position loop in 1/s; 0 for none.
        proportional, integral: of the speed loop, in u per rad/s (m/s) and u per rad (m).
        smoothing: weight of the newest difference of positions in the speed, 0 to 1.
        prefilter: the same of the reference of the speed, without a position loop; 1 for none.
        per_speed, per_acceleration, load: the feed-forward.
        friction: forward and backward, (KNOTS,) each in u.
        friction_speed: the speed of the last knot in rad/s (m/s).
        speed_width: reference speed up to which the direction of friction is a straight line.
        zone_low, zone_high, slope_low, slope_high: the dead zone: ends in V, slopes beyond them.
        zone_width: V up to which its inverse is a straight line in place of the jump.
        gain, offset: of the drive: V = gain·(command + offset).
        limit: the largest command.
        band: error of the position that counts as none at rest, in rad (m).
        current_dt: sample time of the current loop in s; 0 for none.
        current_proportional, current_integral: in V/A and V/(A·s).
        current_limit: in A.
    """

    dt: float
    position: float
    proportional: float
    integral: float
    smoothing: float = 1.0
    prefilter: float = 1.0
    per_speed: float = 0.0
    per_acceleration: float = 0.0
    load: float = 0.0
    friction: tuple[tuple[float, ...], tuple[float, ...]] = field(default=((0.0,) * KNOTS, (0.0,) * KNOTS))
    friction_speed: float = 1.0
    speed_width: float = 0.0
    zone_low: float = 0.0
    zone_high: float = 0.0
    slope_low: float = 1.0
    slope_high: float = 1.0
    zone_width: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    limit: float = inf
    band: float = 0.0
    current_dt: float = 0.0
    current_proportional: float = 0.0
    current_integral: float = 0.0
    current_limit: float = inf

    def feedback_only(self, *, keep_zone: bool = False) -> Settings:
        """The same loop without feed-forward and friction, and without the inverse of the dead zone."""
        none = (0.0,) * KNOTS
        bare = replace(self, per_speed=0.0, per_acceleration=0.0, load=0.0, friction=(none, none))
        return bare if keep_zone else replace(bare, zone_low=0.0, zone_high=0.0, slope_low=1.0, slope_high=1.0)


class RunningCascade:
    """A cascade that runs; `step` once every sample, and `current` once every sample of the current loop.

    Args:
        settings: its gains.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.reset()

    def reset(self) -> None:
        """Begin again: the next position is where the drive stands."""
        self._begun = False
        self._before = self._speed = self._total = self._reference = self._current_total = 0.0

    def step(self, position: float, wanted: float, speed: float, acceleration: float) -> float:
        """The command of a sample; with a current loop, the current for `current`.

        Args:
            position: measured, in rad (m).
            wanted: reference position; without effect without a position loop.
            speed: reference speed in rad/s (m/s).
            acceleration: reference acceleration until the next sample; with a prefilter that of the filter is used.
        """
        s = self.settings
        if not self._begun:
            self._before, self._begun = position, True
        stands = position == self._before
        self._speed += s.smoothing * ((position - self._before) / s.dt - self._speed)
        self._before = position
        if s.prefilter < 1.0:
            acceleration = s.prefilter * (speed - self._reference) / s.dt
            speed, self._reference = self._reference, self._reference + acceleration * s.dt
        away = wanted - position if s.position > 0.0 else 0.0
        near = s.position > 0.0 and speed == 0.0 and acceleration == 0.0 and abs(away) <= s.band
        if near:
            away = 0.0
        error = 0.0 if near and stands else speed + s.position * away - self._speed
        made = self.feedforward(speed, acceleration) + s.proportional * error + self._total
        if s.current_dt > 0.0:
            command, most = made, s.current_limit
        else:
            command, most = self.command(made), s.limit
        limited = min(max(command, -most), most)
        if limited == command or error * command < 0.0:
            self._total += s.integral * s.dt * error
        return limited

    def current(self, wanted: float, current: float) -> float:
        """The command for a wanted current, both in A."""
        s = self.settings
        error = wanted - current
        command = self.command(s.current_proportional * error + self._current_total)
        limited = min(max(command, -s.limit), s.limit)
        if limited == command or error * command < 0.0:
            self._current_total += s.current_integral * s.current_dt * error
        return limited

    def feedforward(self, speed: float, acceleration: float) -> float:
        """What a reference takes, in u."""
        s = self.settings
        middle = speed + 0.5 * s.dt * acceleration
        size = 0.0 if speed == 0.0 else abs(middle)
        table = s.friction[middle < 0.0]
        at = min(sqrt(size / s.friction_speed), 1.0) * (KNOTS - 1)
        low = min(int(at), KNOTS - 2)
        level = table[low] + (at - low) * (table[low + 1] - table[low])
        if s.speed_width > 0.0:
            way = min(max(middle / s.speed_width, -1.0), 1.0)
        else:
            way = copysign(1.0, middle) if middle != 0.0 else 0.0
        return s.per_speed * speed + s.per_acceleration * acceleration + s.load + way * level

    def command(self, wanted: float) -> float:
        """The command for a voltage (force) wanted behind the dead zone, without the limit."""
        s = self.settings
        jump = min(abs(wanted) / s.zone_width, 1.0) if s.zone_width > 0.0 else 1.0
        if wanted > 0.0:
            wanted = wanted / s.slope_high + jump * s.zone_high
        elif wanted < 0.0:
            wanted = wanted / s.slope_low + jump * s.zone_low
        return wanted / s.gain - s.offset


def knots(fastest: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(KNOTS,) the speeds of the table of friction, up to the fastest."""
    return np.asarray(fastest * np.linspace(0.0, 1.0, KNOTS) ** 2)
