"""The controller that runs: position, speed and current loop, load observer, notch filter, feed-forward, anti-windup.

`RunningCascade` is the same sequence of operations as the C of `emsid.controllers.c_source`, in double precision.

- Observer: position, speed and load of one mass follow its own equations, driven by the command that acts, and are
  corrected by the measured position (Luenberger). What the load observer finds is added to the command, in place of an
  integral; a limited command is known to it, so that it does not wind up. With ``model = (1, dt, 0, 0)`` and
  ``correction = (1, α/dt, 0)`` the speed is the smoothed difference of two positions, and there is no load.
- Feed-forward: ``per_speed·v + per_acceleration·a + load``, gravity and cogging at the reference, and the dry friction
  against the reference speed, from a table over the root of the speed. All are those of the instant at which the
  command acts. A reference at rest that begins to move gets the break-away level of the direction in which it will
  move.
- Level on line: with ``adapt`` the load is observed for each direction of the reference by itself. What the friction
  differs from its table is then known at a reversal. A reference at rest has a load of its own, which is forgotten when
  it moves: a drive that sticks does not show its friction.
- Arrival: when the reference comes to rest, or jumps, the friction acts towards it at its least level until the drive
  is there, and then no more.
- The inverse of the dead zone, whose jump is a straight line up to ``zone_width``.
- Anti-windup of an integral: it stands while the command is limited and the error would drive it further.
- Rest: while the reference rests within ``band`` of the position and the encoder moves by no more than a count, the
  drive counts as at rest on its reference, so that the command stands too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import copysign, cos, inf, sin, sqrt

import numpy as np

KNOTS = 33
"""Knots of the table of friction, at speeds that grow with the square; a Stribeck excess that fades over 2 % of the
largest speed is met within 3 % of it."""
WAVES = 3
"""Waves of a plant over its position: one of gravity, two of cogging."""
FRICTION = 0.3
"""The error of friction that margins and bench must bear: it changes with temperature and wear."""
HALF = 0.5 + 1e-3
"""The error at rest that counts as none, in counts: the encoder then shows the count nearest to the reference."""
LATE = 1e-4
"""A delay that is shorter than a multiple of the sample time by less than this part of it is that multiple, as single
precision is."""
MOST_DELAY = 100
"""The longest delay in samples, for which the commands are kept."""


@dataclass(frozen=True)
class Settings:
    """The numbers of a cascade, in SI units; u is the unit of what the speed loop commands: V, A, N·m or N.

    Attributes:
        dt: sample time of speed and position loop in s.
        position: gain of the position loop in 1/s; 0 for none.
        proportional, integral: of the speed loop, in u per rad/s (m/s) and u per rad (m).
        delay: from the sample of the position to the action of the command, in s, at most `MOST_DELAY` samples.
        model: of the observer over a sample: what is left of the speed, position per speed in s, speed and position per
            u.
        correction: by a position that is one larger than predicted: of the position, of the speed in 1/s, and of the
            load in u per rad (m).
        adapt: 1 for a load of each direction, 0 for one load.
        notch: numerator b₀, b₁, b₂ and denominator a₁, a₂ of the notch filter, of the powers of 1/z.
        prefilter: weight of the newest reference of the speed, without a position loop; 1 for none.
        per_speed, per_acceleration, load: the feed-forward.
        waves: (`WAVES`,) each of 1/rad (1/m), cosine and sine in u, the forces over position that the command bears.
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
    delay: float = 0.0
    model: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    correction: tuple[float, ...] = (1.0, 0.0, 0.0)
    adapt: float = 0.0
    notch: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 0.0)
    prefilter: float = 1.0
    per_speed: float = 0.0
    per_acceleration: float = 0.0
    load: float = 0.0
    waves: tuple[tuple[float, ...], ...] = ((0.0,) * 3,) * WAVES
    friction: tuple[tuple[float, ...], ...] = field(default=((0.0,) * KNOTS, (0.0,) * KNOTS))
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

    def feedback_only(self) -> Settings:
        """The same loop without feed-forward, friction and the inverse of the dead zone, with one load."""
        bare = Settings(self.dt, self.position, self.proportional, self.integral)
        kept = ("friction", "friction_speed", "speed_width", "adapt", "band", "waves", "load", "zone_width")
        none = {name: getattr(bare, name) for name in (*kept, "per_speed", "per_acceleration", "zone_low", "zone_high")}
        return replace(self, **none, slope_low=1.0, slope_high=1.0)

    @property
    def per_count(self) -> float:
        """What one count of the encoder more adds to the command, in u."""
        count = self.band / HALF
        return (self.proportional * (self.correction[1] + self.position) + self.correction[2]) * count

    @property
    def spare(self) -> float:
        """Half of what is left of the largest command beside friction, dead zone, load and gravity, in u."""
        most = self.current_limit if self.current_dt > 0 else abs(self.gain) * self.limit
        zone = 0.0 if self.current_dt > 0 else max(self.zone_high, -self.zone_low)
        held = abs(self.load) + sum(float(np.hypot(cosine, sine)) for _, cosine, sine in self.waves)
        held += zone + (1 + FRICTION) * max(self.friction[0][0], self.friction[1][0])
        return 0.5 * max(most - held, 0.1 * most)

    @property
    def late(self) -> tuple[int, float]:
        """The delay as whole samples and a part of one."""
        whole = int(self.delay / self.dt + LATE)
        return whole, max(self.delay / self.dt - whole, 0.0)


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
        self._before = self._shift = self._speed = self._load = self._total = self._reference = 0.0
        self._current_total = self._push = self._wanted = 0.0
        self._rests = False
        self._loads, self._notch = [0.0, 0.0], [0.0, 0.0]
        self._made = [0.0] * (self.settings.late[0] + 2)  # the latest first

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
        moved = position - self._before
        self._before = position
        if s.prefilter < 1.0:
            acceleration = s.prefilter * (speed - self._reference) / s.dt
            speed, self._reference = self._reference, self._reference + acceleration * s.dt
        still = speed == 0.0 and acceleration == 0.0
        away = wanted - position if s.position > 0.0 else 0.0
        near = s.position > 0.0 and still and abs(away) <= s.band
        stands = near and abs(moved) <= 2.0 * s.band
        way, level = self.friction(speed, acceleration)
        resists = way * level
        rests = still and s.position > 0.0 and s.adapt > 0.0
        if rests:
            if not self._rests or wanted != self._wanted:
                self._push = copysign(min(s.friction[away < 0.0]), away)
                if not self._rests:
                    self._load = self._loads[away < 0.0]
            if near or away * self._push <= 0.0:
                self._push = 0.0
            resists = self._push
        self._rests, self._wanted = rests, wanted
        dry = resists + s.load + self.waves(wanted if s.position > 0.0 else position, speed)

        found = 0.0 if stands else moved - self._shift
        self._speed = 0.0 if stands else self._speed + s.correction[1] * found
        if still:
            self._load -= s.correction[2] * found
        else:
            forward, backward = 0.5 * (1.0 + s.adapt * way), 0.5 * (1.0 - s.adapt * way)
            part = s.correction[2] * found / (forward * forward + backward * backward)
            self._loads[0] -= part * forward
            self._loads[1] -= part * backward
            self._load = forward * self._loads[0] + backward * self._loads[1]

        error = 0.0 if stands else speed + s.position * (0.0 if near else away) - self._speed
        ahead = s.per_speed * (speed + s.delay * acceleration) + s.per_acceleration * acceleration
        made = ahead + dry + s.proportional * error + self._total + self._load
        made, raw = s.notch[0] * made + self._notch[0], made
        self._notch[0] = s.notch[1] * raw - s.notch[3] * made + self._notch[1]
        self._notch[1] = s.notch[2] * raw - s.notch[4] * made
        if s.current_dt > 0.0:
            command, most = made, s.current_limit
        else:
            command, most = self.command(made), s.limit
        limited = min(max(command, -most), most)
        if limited != command:
            made = limited if s.current_dt > 0.0 else self.behind(limited)
        if limited == command or error * command < 0.0:
            self._total += s.integral * s.dt * error

        whole, part = s.late
        self._made.insert(0, made - dry)
        self._made.pop()
        net = (1.0 - part) * self._made[whole] + part * self._made[whole + 1] - self._load
        self._shift = (s.correction[0] - 1.0) * found + s.model[1] * self._speed + s.model[3] * net
        self._speed = s.model[0] * self._speed + s.model[2] * net
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

    def friction(self, speed: float, acceleration: float) -> tuple[float, float]:
        """The direction of the reference when the command acts, from −1 to 1, and the friction against it in u."""
        s = self.settings
        middle = speed + (s.delay + 0.5 * s.dt) * acceleration
        size = 0.0 if speed == 0.0 else abs(middle)
        table = s.friction[middle < 0.0]
        at = min(sqrt(size / s.friction_speed), 1.0) * (KNOTS - 1)
        low = min(int(at), KNOTS - 2)
        level = table[low] + (at - low) * (table[low + 1] - table[low])
        if s.speed_width > 0.0:
            return min(max(middle / s.speed_width, -1.0), 1.0), level
        return copysign(1.0, middle) if middle != 0.0 else 0.0, level

    def waves(self, position: float, speed: float) -> float:
        """What gravity and cogging take at a reference when the command acts, in u."""
        s, total = self.settings, 0.0
        for k, cosine, sine in s.waves:
            if cosine != 0.0 or sine != 0.0:
                angle = k * (position + (s.delay + 0.5 * s.dt) * speed)
                total += cosine * cos(angle) + sine * sin(angle)
        return total

    def command(self, wanted: float) -> float:
        """The command for a voltage (force) wanted behind the dead zone, without the limit."""
        s = self.settings
        jump = min(abs(wanted) / s.zone_width, 1.0) if s.zone_width > 0.0 else 1.0
        if wanted > 0.0:
            wanted = wanted / s.slope_high + jump * s.zone_high
        elif wanted < 0.0:
            wanted = wanted / s.slope_low + jump * s.zone_low
        return wanted / s.gain - s.offset

    def behind(self, command: float) -> float:
        """The voltage (force) behind the dead zone that a command gives."""
        s = self.settings
        volts = s.gain * (command + s.offset)
        return s.slope_high * max(volts - s.zone_high, 0.0) + s.slope_low * min(volts - s.zone_low, 0.0)


def knots(fastest: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(KNOTS,) the speeds of the table of friction, up to the fastest."""
    return np.asarray(fastest * np.linspace(0.0, 1.0, KNOTS) ** 2)
