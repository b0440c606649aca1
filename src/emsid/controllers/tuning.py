r"""Gains for loops: the fastest cascade that keeps its margins for every plant of a region.

One number is searched, the crossover ω of the speed loop, for a few shapes of the cascade each:

- integral time T_i = β/ω, where β = 4 is that of the symmetric optimum with a phase lead of 76°, and a larger one gives
  less overshoot and a weaker integral;
- gain of the position loop ω/ρ;
- time constant of the smoothing of the speed a tenth of 1/ω, which costs 6° of phase.

Each shape is made as fast as margins and overshoot allow. Of the shapes, that with the largest product of the integral
gain and the position gain is taken: the integral of the error after a step of the load is its inverse (Åström,
Hägglund, Advanced PID control, 2006, 4.2). Where a bandwidth is wanted, only the shapes that reach it count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from emsid.controllers.cascade import Settings
from emsid.controllers.loops import (
    Array,
    Complex,
    Margins,
    Plants,
    Sampled,
    bandwidth,
    frequencies,
    margins,
    pi_response,
    speed_filter,
    step_responses,
)

LEAST = Margins(2.0, 45.0, 2.0)
"""The margins that are kept: gain 2, phase 45°, sensitivity 2 (Åström, Hägglund, 2006, 4.3: from 2 to 5, from 30° to
60°, from 1.2 to 2)."""
INTEGRAL = (4.0, 7.0, 12.0, 20.0, 35.0)
"""β: the integral time in units of 1/ω."""
RATIOS = (2.0, 3.0, 4.0, 6.0)
"""ρ: crossover of the speed loop over that of the position loop."""
SMOOTHING = 0.1
"""Time constant of the smoothing of the speed in units of 1/ω."""
STEPS = 9
"""Halvings of a range of one decade and a half: 0.7 % of the bandwidth."""
ALIKE = 0.95
"""Bandwidths within this factor of the largest one are taken for the same."""
HORIZON = 40.0
"""Length of a step response in units of 1/ω, times ρ."""
MOST_SAMPLES = 2000
"""Of a step response; a slower loop is judged by its first so many."""


@dataclass(frozen=True, eq=False)
class LoopResponses:
    """The loops of a cascade at the frequencies ``w``, for P plants.

    Attributes:
        w: (F,) in rad/s.
        speed: (P, F) the speed loop, without position loop.
        whole: (P, F) opened at the plant's command: position and speed loop together.
        position: (P, F) the position loop, opened at its gain.
        closed: (P, F) from the reference to the position; without a position loop to the measured speed, without the
            feed-forward.
    """

    w: Array
    speed: Complex
    whole: Complex
    position: Complex
    closed: Complex

    @classmethod
    def of(cls, response: Complex, w: Array, settings: Settings) -> LoopResponses:
        """From the response (P, F) of the plants."""
        pi = pi_response(w, settings.dt, settings.proportional, settings.integral)
        path = speed_filter(w, settings.dt, settings.smoothing)
        speed = response * pi * path
        position = settings.position * response * pi / (1 + speed)
        whole = speed + settings.position * response * pi
        if settings.position > 0:
            return cls(w, speed, whole, position, position / (1 + position))
        back, weight = np.exp(-1j * w * settings.dt), settings.prefilter
        filtered = np.ones(1) if weight == 1 else weight * back / (1 - (1 - weight) * back)
        return cls(w, speed, whole, position, filtered * speed / (1 + speed))

    @property
    def margins(self) -> Margins:
        """The worst of all."""
        worst = margins(self.speed)
        return worst.worse(margins(self.whole)).worse(margins(self.position)) if self.position.any() else worst


@dataclass(frozen=True, eq=False)
class Tuned:
    """A cascade, and what it reaches with its plants.

    Attributes:
        settings: its gains.
        bandwidth: of the nominal closed loop in rad/s.
        margins: the worst.
        overshoot: the largest overshoot of a step, as a part of it.
    """

    settings: Settings
    bandwidth: float
    margins: Margins
    overshoot: float


def shaped(response: Complex, w: Array, base: Settings, crossover: float, beta: float, ratio: float) -> Settings:
    """The cascade of a shape, whose nominal speed loop has this crossover."""
    alpha = base.dt / (SMOOTHING / crossover + base.dt)
    unit = response[0] * pi_response(w, base.dt, 1.0, crossover / beta) * speed_filter(w, base.dt, alpha)
    size = np.exp(np.interp(np.log(crossover), np.log(w), np.log(np.abs(unit))))
    gain = float(1 / size)
    return replace(
        base,
        position=0.0 if ratio == inf else crossover / ratio,
        proportional=gain,
        integral=gain * crossover / beta,
        smoothing=float(alpha),
    )


def judged(sampled: Sampled, response: Complex, w: Array, settings: Settings) -> Tuned:
    """What a cascade reaches."""
    loops = LoopResponses.of(response, w, settings)
    found = loops.margins
    width = bandwidth(w, loops.closed[0])
    overshoot = inf
    if found.hold(LEAST):
        horizon = HORIZON / width
        samples = int(min(max(horizon / settings.dt, 50), MOST_SAMPLES))
        after = step_responses(sampled, settings, samples)
        with np.errstate(invalid="ignore"):
            overshoot = float(np.nan_to_num(np.max(after) - 1.0, nan=inf))
            if not np.max(np.abs(after[-1] - 1.0)) < 0.5:  # it does not come to rest: unstable
                overshoot = inf
    return Tuned(settings, width, found, max(overshoot, 0.0))


def fastest(
    plants: Plants,
    base: Settings,
    delay: float,
    overshoot: float,
    *,
    position: bool = True,
    wanted: float = inf,
) -> Tuned | None:
    """The fastest cascade whose margins and overshoot hold for all plants, or that of a wanted bandwidth.

    Args:
        plants: all, the nominal one first.
        base: sample time, feed-forward.
        delay: from the sample of the position to the action of the command, in s.
        overshoot: the largest part of a step.
        position: whether there is a position loop.
        wanted: bandwidth in rad/s.

    Returns:
        The cascade; None where no bandwidth holds.
    """
    w, sampled = frequencies(base.dt), Sampled.of(plants, base.dt, delay)
    response = sampled.response(w)
    shapes = [(beta, ratio) for ratio in (RATIOS if position else (inf,)) for beta in INTEGRAL]
    each = (_of_shape(sampled, response, w, base, *shape, overshoot, wanted) for shape in shapes)
    found = [tuned for tuned in each if tuned is not None]
    if wanted < inf and found:
        best = max(tuned.bandwidth for tuned in found)
        found = [tuned for tuned in found if tuned.bandwidth >= ALIKE * best]
    return max(found, key=lambda tuned: tuned.settings.integral * (tuned.settings.position or 1.0), default=None)


def _of_shape(
    sampled: Sampled,
    response: Complex,
    w: Array,
    base: Settings,
    beta: float,
    ratio: float,
    overshoot: float,
    wanted: float,
) -> Tuned | None:
    """The fastest cascade of a shape, not faster than wanted, by bisection of the logarithm of its crossover."""

    def good(crossover: float) -> Tuned | None:
        settings = shaped(response, w, base, crossover, beta, ratio)
        for prefilter in (1.0,) if ratio < inf else prefilters(crossover, base.dt):
            tuned = judged(sampled, response, w, replace(settings, prefilter=prefilter))
            if tuned.bandwidth > wanted * 1.005 or not tuned.margins.hold(LEAST):
                return None
            if tuned.overshoot <= overshoot:
                return tuned
        return None

    high = np.log(min(1.0 / base.dt, 1e6))
    low, best = high - np.log(10.0), None
    while (best := good(float(np.exp(low)))) is None:
        high, low = low, low - np.log(10.0)
        if low < np.log(w[0]):
            return None
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        tuned = good(float(np.exp(middle)))
        if tuned is None:
            high = middle
        else:
            low, best = middle, tuned
    return best


def prefilters(crossover: float, dt: float) -> Sequence[float]:
    """Weights of the prefilter of a speed reference, from none to four times 1/ω."""
    return [1.0, *(dt / (part / crossover + dt) for part in (0.25, 0.5, 1.0, 2.0, 4.0))]


CURRENT_DELAY = 1.0
"""Delay of the current loop in its samples, for conversion and computing; holding the voltage adds half a sample."""


def current_loop(resistance: Array, inductance: Array, dt: float) -> tuple[float, float, Margins]:
    """Gains in V/A and V/(A·s) of the fastest PI controller of the current that keeps the margins, and these.

    Its zero cancels the pole of the winding, Kp = ω·L and Ki = ω·R.

    Args:
        resistance, inductance: (P,) of the winding in Ω and H, the nominal one first.
        dt: sample time of the loop in s.
    """
    w = frequencies(dt)
    back = np.exp(-1j * w * dt)
    pole = np.exp(-resistance / inductance * dt)[:, None]
    winding = (1 - pole) / resistance[:, None] * back / (1 - pole * back) * back**CURRENT_DELAY

    def tried(crossover: float) -> tuple[float, float, Margins]:
        gains = crossover * float(inductance[0]), crossover * float(resistance[0])
        return *gains, margins(winding * pi_response(w, dt, *gains))

    high = np.log(np.pi / dt)
    low = high - np.log(1000.0)
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if tried(float(np.exp(middle)))[2].hold(LEAST) else (low, middle)
    return tried(float(np.exp(low)))
