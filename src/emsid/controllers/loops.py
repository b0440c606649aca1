r"""Frequency responses, margins and step responses of sampled loops, for many plants at once.

A plant is M·dv/dt = f·i − D·v − k·x, dx/dt = v, where the command is held over a sample and acts after a delay, and
i follows it with the lag of a current loop. Over a sample it is (Franklin, Powell, Workman, Digital control of dynamic
systems, 3rd ed., 4.3.4)

    s(t + 1) = Φ·s(t) + Γ₀·u(t − d) + Γ₁·u(t − d − 1).

The controller sees the position at the samples only. Its speed is the difference of two positions, smoothed:

    v̂(t) = v̂(t − 1) + α·((x(t) − x(t − 1))/h − v̂(t − 1)).

The speed loop is a PI controller of v̂, whose integral is that before the sample; the position loop is a gain before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

POINTS = 300
"""Frequencies of a response; with 1,200 the margins of the tests change by less than 0.5 %."""
LOWEST = 1e-4
"""The lowest frequency of a response, as a part of half the sampling frequency."""

BLOCK = 16
"""Samples of a step response that are computed by one product of matrices."""


@dataclass(frozen=True, eq=False)
class Plants:
    """P plants in SI units, the nominal one first.

    Attributes:
        mass: (P,) inertia or mass.
        damping: (P,) force per speed, with the braking of the armature where a voltage drives it.
        stiffness: (P,) force per position against it, of gravity and cogging; negative above the upright position.
        force: (P,) force per unit of what the speed loop commands: volts behind the dead zone, amperes, N·m or N.
        lag: time constant in s of a current loop between; 0 for none.
    """

    mass: Array
    damping: Array
    stiffness: Array
    force: Array
    lag: float = 0.0

    @property
    def nominal(self) -> Plants:
        """The first one alone."""
        return Plants(self.mass[:1], self.damping[:1], self.stiffness[:1], self.force[:1], self.lag)


@dataclass(frozen=True)
class Margins:
    """The worst margins of a loop over its plants.

    Attributes:
        gain: the factor that the gain of the loop can grow by.
        phase: in degrees.
        sensitivity: the peak of |1/(1 + L)|.
    """

    gain: float
    phase: float
    sensitivity: float

    def worse(self, other: Margins) -> Margins:
        """The worse of both, each by itself."""
        return Margins(
            min(self.gain, other.gain), min(self.phase, other.phase), max(self.sensitivity, other.sensitivity)
        )

    def hold(self, least: Margins) -> bool:
        """Whether each is at least that of ``least``."""
        return self.gain >= least.gain and self.phase >= least.phase and self.sensitivity <= least.sensitivity


def frequencies(dt: float) -> Array:
    """(F,) in rad/s, up to half the sampling frequency."""
    return np.asarray(np.geomspace(LOWEST, 1.0, POINTS) * np.pi / dt)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Plants over a sample: Φ (P, n, n), Γ₀ and Γ₁ (P, n), and the whole samples d of the delay."""

    transition: Array
    late: Array
    later: Array
    delay: int
    dt: float

    @classmethod
    def of(cls, plants: Plants, dt: float, delay: float) -> Sampled:
        """The plants with a sample time and a delay in s."""
        from scipy.linalg import expm

        count = len(plants.mass)
        n = 3 if plants.lag > 0 else 2
        whole = np.zeros((count, n + 1, n + 1))  # position, speed, (what acts), command
        whole[:, 0, 1] = 1.0
        whole[:, 1, 0], whole[:, 1, 1] = -plants.stiffness / plants.mass, -plants.damping / plants.mass
        whole[:, 1, 2] = plants.force / plants.mass
        if plants.lag > 0:
            whole[:, 2, 2], whole[:, 2, 3] = -1.0 / plants.lag, 1.0 / plants.lag
        samples = int(np.floor(delay / dt + 1e-9))
        part = max(delay - samples * dt, 0.0)
        first, second = expm(whole * part), expm(whole * (dt - part))
        after = second[:, :n, :n]
        return cls(after @ first[:, :n, :n], second[:, :n, n], (after @ first[:, :n, n:])[:, :, 0], samples, dt)

    def response(self, w: Array) -> Complex:
        """(P, F) from the command to the position at the samples."""
        z = np.exp(1j * w * self.dt)
        n = self.transition.shape[1]
        left = z[None, :, None, None] * np.eye(n) - self.transition[:, None]
        right = self.late[:, None, :] + self.later[:, None, :] / z[None, :, None]
        states = np.linalg.solve(left, right[..., None])[..., 0]
        return np.asarray(states[..., 0] * z ** -float(self.delay))


def speed_filter(w: Array, dt: float, alpha: float) -> Complex:
    """(F,) from the position to the speed that the controller forms."""
    back = np.exp(-1j * w * dt)
    return np.asarray((1 - back) / dt * alpha / (1 - (1 - alpha) * back))


def pi_response(w: Array, dt: float, proportional: float, integral: float) -> Complex:
    """(F,) of the PI controller."""
    back = np.exp(-1j * w * dt)
    return np.asarray(proportional + integral * dt * back / (1 - back))


def margins(loop: Complex) -> Margins:
    """The worst margins of loops (P, F)."""
    real, imaginary, size = loop.real, loop.imag, np.abs(loop)
    sensitivity = float(np.max(1 / np.abs(1 + loop)))
    part = _crossing(imaginary)
    at = real[:, :-1] + part * (real[:, 1:] - real[:, :-1])
    counted = np.isfinite(part) & (at < 0) & (at > -1)
    gain = float(1 / np.max(-at[counted])) if counted.any() else np.inf
    part = _crossing(np.log(size))
    angle = np.unwrap(np.angle(-loop), axis=1)  # from the critical point
    turned = angle[:, :-1] + part * (angle[:, 1:] - angle[:, :-1])
    turned = (turned[np.isfinite(turned)] + np.pi) % (2 * np.pi) - np.pi
    phase = float(np.degrees(np.min(np.abs(turned)))) if len(turned) else np.inf
    return Margins(gain, phase, sensitivity)


def _crossing(values: Array) -> Array:
    """(P, F − 1) where in an interval a value crosses zero, from 0 to 1; NaN where it does not."""
    left, right = values[:, :-1], values[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(left * right <= 0, left / (left - right), np.nan))


def bandwidth(w: Array, closed: Complex) -> float:
    """The lowest frequency in rad/s at which a closed loop (F,) has fallen by 3 dB."""
    fallen = np.flatnonzero(np.abs(closed) < np.sqrt(0.5))
    return float(w[fallen[0]]) if len(fallen) else float(w[-1])


def step_responses(sampled: Sampled, settings: Any, samples: int) -> Array:
    """(at least samples, P) position of the plants after a step of its reference; without a position loop, their speed.

    Args:
        sampled: the plants.
        settings: gains of the cascade, see `emsid.controllers.cascade.Settings`.
        samples: how many.
    """
    s, dt, d = settings, sampled.dt, sampled.delay
    count, n = sampled.late.shape
    follows = s.position > 0
    # state: the plant; position and speed of the sample before; integral; prefilter; commands, the latest first; 1
    before, speed, total, filtered, command = range(n, n + 5)
    size = command + d + 2
    one = size - 1
    row = np.zeros((size,))  # of the speed
    row[speed] = 1 - s.smoothing
    row[0], row[before] = s.smoothing / dt, -s.smoothing / dt
    error, fed = -row, np.zeros(size)
    if follows:
        error[0] -= s.position
        error[one] += s.position
    else:
        error[filtered] += 1.0
        fed[filtered] = s.per_speed - s.per_acceleration * s.prefilter / dt
        fed[one] = s.per_acceleration * s.prefilter / dt
    made = fed + s.proportional * error
    made[total] += 1.0
    step = np.zeros((count, size, size))
    step[:, :n, :n] = sampled.transition
    for late, gains in ((d, sampled.late), (d + 1, sampled.later)):
        acting = made if late == 0 else np.eye(size)[command + late - 1]
        step[:, :n] += gains[:, :, None] * acting
    step[:, before, 0] = step[:, one, one] = step[:, total, total] = 1.0
    step[:, speed] = row
    step[:, total] += s.integral * dt * error
    step[:, filtered, filtered], step[:, filtered, one] = 1 - s.prefilter, s.prefilter
    step[:, command] = made
    for k in range(1, d + 1):
        step[:, command + k, command + k - 1] = 1.0
    out = np.zeros((count, 1, size))
    out[:, 0, 0 if follows else 1] = 1.0
    rows = [out]
    for _ in range(BLOCK - 1):
        rows.append(rows[-1] @ step)
    reads, ahead = np.concatenate(rows, axis=1), np.linalg.matrix_power(step, BLOCK)
    state = np.zeros((count, size, 1))
    state[:, one] = 1.0
    found = []
    for _ in range(-(-samples // BLOCK)):
        found.append((reads @ state)[:, :, 0].T)
        state = ahead @ state
    return np.concatenate(found)
