r"""Gains for loops: the fastest cascade that keeps its margins for every plant of a region.

One number is searched, the bandwidth ω of the speed loop, for a few shapes of the cascade each:

- with a load observer: Kp = ω·M/f, the poles of position and speed at κ·ω, that of the load at λ·ω: larger ones reject
  a load faster and leave less margin;
- without one: a PI controller of the smoothed difference of the positions, integral time T_i = β/ω, where β = 4 is that
  of the symmetric optimum with a phase lead of 76°, and a smoothing of a tenth of 1/ω, which costs 6° of phase;
- gain of the position loop ω/ρ;
- where the plant has a flexible mode, a notch filter at it, whose poles have one of a few damping ratios.

Each shape is made as fast as margins, overshoot and encoder allow: one count more may not command more than half of
what is left of the largest command beside friction and dead zone. Of the fastest shapes, or those that reach the wanted
bandwidth, that which moves least under a constant load at the lowest frequency is taken (Åström, Hägglund, Advanced PID
control, 2006, 4.2: the integral of the error after a step of the load).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

import numpy as np

from emsid.controllers.cascade import Settings
from emsid.controllers.loops import (
    Array,
    Complex,
    Margins,
    Plants,
    Sampled,
    bandwidth,
    controller_response,
    frequencies,
    margins,
    pi_response,
    step_responses,
)

LEAST = Margins(2.0, 45.0, 2.0)
"""The margins that are kept: gain 2, phase 45°, sensitivity 2 (Åström, Hägglund, 2006, 4.3: from 2 to 5, from 30° to
60°, from 1.2 to 2)."""
INTEGRAL = (4.0, 7.0, 12.0, 20.0, 35.0)
"""β: the integral time in units of 1/ω."""
OBSERVERS = (2.0, 4.0, 8.0)
"""κ: the poles of position and speed of the observer in units of ω."""
LOADS = (0.1, 0.25, 0.5, 1.0)
"""λ: the pole of its load in units of ω."""
NOTCHES = (0.3, 0.7)
"""Damping ratios of the poles of a notch filter."""
RATIOS = (2.0, 3.0, 4.0, 6.0)
"""ρ: crossover of the speed loop over that of the position loop."""
SMOOTHING = 0.1
"""Time constant of the smoothing of the speed in units of 1/ω."""
STEPS = 9
"""Halvings of a range of one decade and a half: 0.7 % of the bandwidth."""
ALIKE = 0.9
"""Bandwidths within this factor of the largest one are taken for the same."""
HORIZON = 40.0
"""Length of a step response in units of 1/ω, times ρ."""
MOST_SAMPLES = 2000
"""Of a step response; a slower loop is judged by its first so many."""


class Shape(NamedTuple):
    """ρ, the damping of the notch filter (0 for none), and κ and λ of an observer or β of an integral."""

    ratio: float
    notch: float
    observer: float = 0.0
    load: float = 0.0
    integral: float = 0.0


@dataclass(frozen=True, eq=False)
class LoopResponses:
    """The loop of a cascade at the frequencies ``w``, for P plants.

    Attributes:
        w: (F,) in rad/s.
        whole: (P, F) opened at the plant's command: position and speed loop together.
        closed: (P, F) from the reference to the position; without a position loop to the speed, without the
            feed-forward of the acceleration.
    """

    w: Array
    whole: Complex
    closed: Complex

    @classmethod
    def of(cls, response: Complex, w: Array, settings: Settings) -> LoopResponses:
        """From the response (P, F) of the plants from the command to the position."""
        back, ahead = responses(w, settings)
        whole = response * back
        return cls(w, whole, response * ahead / (1 + whole))

    @property
    def margins(self) -> Margins:
        """The worst of all."""
        return margins(self.whole)


def responses(w: Array, settings: Settings) -> tuple[Complex, Complex]:
    """(F,) from the position, against its sign, to the command, and from the reference to the command; without a
    position loop from the speed of a reference position, without the feed-forward of the acceleration."""
    back, ahead = controller_response(w, settings)
    if not settings.position > 0:
        speed = controller_response(w, replace(settings, per_acceleration=0.0))[1]
        ahead = speed * (1 - np.exp(-1j * w * settings.dt)) / settings.dt
    return back, ahead


@dataclass(frozen=True, eq=False)
class Tuned:
    """A cascade, and what it reaches with its plants.

    Attributes:
        settings: its gains.
        bandwidth: of the nominal closed loop in rad/s.
        margins: the worst.
        overshoot: the largest overshoot of a step, as a part of it.
        shape: of the search.
    """

    settings: Settings
    bandwidth: float
    margins: Margins
    overshoot: float
    shape: Shape


def observer(plants: Plants, dt: float, speed: float, load: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The model of the nominal plant over a sample, and the correction that gives its observer two poles at −speed and
    one at −load, in rad/s, by Ackermann's formula (Franklin, Powell, Workman, 3rd ed., 8.2)."""
    mass, damping, force = (float(each[0]) for each in (plants.mass, plants.damping, plants.force))
    rate = damping / mass
    left = float(np.exp(-rate * dt))
    way = dt if rate * dt < 1e-6 else (1 - left) / rate
    fall = 0.5 * dt * dt if rate * dt < 1e-6 else (dt - way) / rate
    model = (left, way, force / mass * way, force / mass * fall)
    a, one = np.array([[1.0, way, -model[3]], [0.0, left, -model[2]], [0.0, 0.0, 1.0]]), np.eye(3)
    seen = np.array([one[0], a[0], (a @ a)[0]])
    placed = np.linalg.matrix_power(a - np.exp(-speed * dt) * one, 2) @ (a - np.exp(-load * dt) * one)
    gains = np.linalg.solve(a, placed @ np.linalg.solve(seen, one[2]))
    return model, (float(gains[0]), float(gains[1]), -float(gains[2]))


def notch_of(mode: tuple[float, float], damping: float, dt: float) -> tuple[float, ...]:
    """The notch filter whose zeros are the poles of a mode, and whose poles have its frequency and this damping."""

    def factors(ratio: float) -> Array:
        size, angle = np.exp(-ratio * mode[0] * dt), mode[0] * np.sqrt(max(1 - ratio * ratio, 0.0)) * dt
        return np.array([1.0, -2 * size * np.cos(angle), size * size])

    zeros, poles = factors(min(mode[1], 1.0)), factors(damping)
    return (*(zeros * (poles.sum() / zeros.sum())).tolist(), *poles[1:].tolist())


def shaped(response: Complex, w: Array, base: Settings, plants: Plants, crossover: float, shape: Shape) -> Settings:
    """The cascade of a shape, whose nominal speed loop has this bandwidth."""
    position = 0.0 if shape.ratio == inf else crossover / shape.ratio
    notch = base.notch
    if shape.notch > 0 and plants.mode is not None:
        notch = notch_of(plants.mode, shape.notch, base.dt)
    if shape.observer > 0:
        model, correction = observer(plants, base.dt, shape.observer * crossover, shape.load * crossover)
        gain = crossover * float(plants.mass[0] / plants.force[0])
        return replace(
            base, position=position, proportional=gain, model=model, correction=correction, notch=notch, adapt=1.0
        )
    alpha = base.dt / (SMOOTHING / crossover + base.dt)
    integral = crossover / shape.integral
    made = by_difference(replace(base, position=0.0, proportional=1.0, integral=integral, notch=notch), alpha)
    unit = response[0] * controller_response(w, made)[0]
    gain = float(1 / np.exp(np.interp(np.log(crossover), np.log(w), np.log(np.abs(unit)))))
    return replace(made, position=position, proportional=gain, integral=gain * integral)


def by_difference(settings: Settings, alpha: float) -> Settings:
    """The cascade with the difference of two positions, smoothed by this weight of the newest, for its speed."""
    return replace(settings, model=(1.0, settings.dt, 0.0, 0.0), correction=(1.0, alpha / settings.dt, 0.0), adapt=0.0)


def fastest(
    plants: Plants,
    base: Settings,
    delay: float,
    overshoot: float,
    *,
    position: bool = True,
    wanted: float = inf,
    observer: bool = True,
    shapes: Sequence[Shape] | None = None,
) -> Tuned | None:
    """The fastest cascade whose margins and overshoot hold for all plants, or that of a wanted bandwidth.

    Args:
        plants: all, the nominal one first.
        base: sample time, feed-forward.
        delay: from the sample of the position to the action of the command, in s.
        overshoot: the largest part of a step.
        position: whether there is a position loop.
        wanted: bandwidth in rad/s.
        observer: whether a load observer is in it, in place of an integral.
        shapes: those that are tried; by default all.

    Returns:
        The cascade; None where no bandwidth holds.
    """
    base, plants = replace(base, delay=delay + plants.lag), plants.different
    w, sampled = frequencies(base.dt), Sampled.of(plants, base.dt, delay)
    response = sampled.response(w)
    reached = plants.mode is not None and plants.mode[0] < np.pi / base.dt
    shapes = shapes or [
        Shape(ratio, notch, *each)
        for ratio in (RATIOS if position else (inf,))
        for notch in ((0.0, *NOTCHES) if reached else (0.0,))
        for each in ([(k, n, 0.0) for k in OBSERVERS for n in LOADS] if observer else [(0.0, 0.0, b) for b in INTEGRAL])
    ]
    asked = _Asked(plants, base, sampled, response, w, overshoot, wanted)
    found = [tuned for tuned in map(asked.fastest, shapes) if tuned is not None]
    best = max((tuned.bandwidth for tuned in found), default=0.0)
    found = [tuned for tuned in found if tuned.bandwidth >= ALIKE * best]
    return max(found, key=lambda tuned: abs(controller_response(w[:1], tuned.settings)[0][0]), default=None)


@dataclass(eq=False)
class _Asked:
    """The plants of a cascade, and what it has to keep with all of them.

    Most cascades that a search tries fail with the plant that the last one has failed with. It is tried first, alone.

    Attributes:
        plants, base: see `fastest`.
        sampled, response: the plants over a sample, and their responses (P, F) at the frequencies ``w``.
        overshoot, wanted: see `fastest`.
        least_stable, most_overshooting: the plants whose margins or whose overshoot was the worst of the last cascade
            that failed.
    """

    plants: Plants
    base: Settings
    sampled: Sampled
    response: Complex
    w: Array
    overshoot: float
    wanted: float
    least_stable: int = 0
    most_overshooting: int = 0

    def fastest(self, shape: Shape) -> Tuned | None:
        """The fastest cascade of a shape, not faster than wanted, by bisection of the logarithm of its crossover."""
        high = np.log(min(1.0 / self.base.dt, 1e6))
        low, best = high - np.log(10.0), None
        while (best := self.judged(float(np.exp(low)), shape)) is None:
            high, low = low, low - np.log(10.0)
            if low < np.log(self.w[0]):
                return None
        for _ in range(STEPS):
            middle = 0.5 * (low + high)
            tuned = self.judged(float(np.exp(middle)), shape)
            if tuned is None:
                high = middle
            else:
                low, best = middle, tuned
        return best

    def judged(self, crossover: float, shape: Shape) -> Tuned | None:
        """What a cascade of a shape reaches; None where it does not keep what it has to."""
        settings = shaped(self.response, self.w, self.base, self.plants, crossover, shape)
        if settings.per_count > settings.spare:
            return None
        for prefilter in (1.0,) if shape.ratio < inf else prefilters(crossover, self.base.dt):
            tried = replace(settings, prefilter=prefilter)
            back, ahead = responses(self.w, tried)
            width = bandwidth(self.w, self.response[0] * ahead / (1 + self.response[0] * back))
            if width > self.wanted * 1.005 or (found := self._margins(back)) is None:
                return None
            overshoot = self._overshoot(tried, width)
            if overshoot <= self.overshoot:
                return Tuned(tried, width, found, overshoot, shape)
        return None

    def _margins(self, back: Complex) -> Margins | None:
        """The worst margins of all; None where they do not hold."""
        first = slice(self.least_stable, self.least_stable + 1)
        if not margins(self.response[first] * back).hold(LEAST):
            return None
        loops = self.response * back
        found = margins(loops)
        if found.hold(LEAST):
            return found
        self.least_stable = int(np.argmin(np.min(np.abs(1 + loops), axis=1)))
        return None

    def _overshoot(self, settings: Settings, width: float) -> float:
        """The largest overshoot of a step, or one that is too large; infinite where a loop does not come to rest."""
        samples = int(min(max(HORIZON / width / settings.dt, 50), MOST_SAMPLES))
        found = overshoot_of(step_responses(self.sampled.alone(self.most_overshooting), settings, samples))
        if found > self.overshoot:
            return found
        after = step_responses(self.sampled, settings, samples)
        found = overshoot_of(after)
        if found > self.overshoot:
            self.most_overshooting = int(np.argmax(np.max(after, axis=0)))
        return found


def overshoot_of(after: Array) -> float:
    """The largest overshoot of positions (N, P) after a step; infinite where one does not come to rest."""
    with np.errstate(invalid="ignore"):
        if not np.max(np.abs(after[-1] - 1.0)) < 0.5:  # unstable
            return inf
        return max(float(np.nan_to_num(np.max(after) - 1.0, nan=inf)), 0.0)


def prefilters(crossover: float, dt: float) -> Sequence[float]:
    """Weights of the prefilter of a speed reference, from none to four times 1/ω."""
    return [1.0, *(dt / (part / crossover + dt) for part in (0.25, 0.5, 1.0, 2.0, 4.0))]


CURRENT_DELAY = 1.0
"""Delay of the current loop in its samples, for conversion and computing; holding the voltage adds half a sample."""


HALVINGS = 14
"""Of a range of three decades: 0.04 % of the crossover."""


def margins_of_winding(resistance: Array, inductance: Array, dt: float) -> Callable[[float], Margins]:
    """The worst margins of the PI controller of a current, Kp = ω·L and Ki = ω·R, as a function of ω in rad/s.

    Args:
        resistance, inductance: (P,) of the winding in Ω and H; the gains are those of the first.
        dt: sample time of the loop in s.
    """
    w = frequencies(dt)
    back = np.exp(-1j * w * dt)
    pole = np.exp(-resistance / inductance * dt)[:, None]
    winding = (1 - pole) / resistance[:, None] * back / (1 - pole * back) * back**CURRENT_DELAY

    def found(crossover: float) -> Margins:
        gains = crossover * float(inductance[0]), crossover * float(resistance[0])
        return margins(winding * pi_response(w, dt, *gains))

    return found


def highest(found: Callable[[float], Margins], high: float) -> float:
    """The largest frequency in the three decades below one in rad/s with which the margins hold, by bisection."""
    above = np.log(high)
    low = above - np.log(1000.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + above)
        low, above = (middle, above) if found(float(np.exp(middle))).hold(LEAST) else (low, middle)
    return float(np.exp(low))


def current_loop(resistance: Array, inductance: Array, dt: float) -> tuple[float, float, Margins]:
    """Gains in V/A and V/(A·s) of the fastest PI controller of the current that keeps the margins, and these.

    Its zero cancels the pole of the winding.

    Args:
        resistance, inductance: (P,) of the winding in Ω and H, the nominal one first.
        dt: sample time of the loop in s.
    """
    found = margins_of_winding(resistance, inductance, dt)
    crossover = highest(found, np.pi / dt)
    return crossover * float(inductance[0]), crossover * float(resistance[0]), found(crossover)
