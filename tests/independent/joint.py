"""A joint with gravity, simulated by Runge–Kutta steps between the instants at which its friction sticks or slides.

    I·dv/dt = gear·u − damping·v − friction·sgn(v) − weight·sin(θ − angle),      u held over every sample

All values are on its side of the gear. It sticks where the other torques are below the friction.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from emsid.record import Record

Array = NDArray[np.float64]
DT, COUNTS, GEAR = 5e-3, 4096, 100.0
STEP = 2 * np.pi / COUNTS
FINE = 20
"""Steps in a sample."""


@dataclass(frozen=True)
class Joint:
    """A joint at rest where it hangs."""

    inertia: float
    damping: float
    friction: float
    weight: float
    angle: float

    @classmethod
    def drawn(cls, seed: int) -> Joint:
        """A random one."""
        rng = np.random.default_rng([7, seed])
        weight, swing = rng.uniform(0.5, 3.0), rng.uniform(5.0, 9.0)
        damping, friction = rng.uniform(0.3, 0.8) * weight / swing, rng.uniform(0.05, 0.2) * weight
        return cls(weight / swing**2, damping, friction, weight, rng.uniform(-0.5, 0.5))

    @property
    def truth(self) -> Mapping[str, float]:
        """By the names of estimates; what belongs to the motor is on its side of the gear."""
        return {
            "rotor_inertia": self.inertia / GEAR**2,
            "rotor_viscous": self.damping / GEAR**2,
            "rotor_friction.coulomb": self.friction / GEAR,
            "gravity.torque": self.weight,
            "gravity.angle": self.angle,
        }

    def command(self, samples: int, seed: int) -> Array:
        """(N,) torque of the motor: two sines."""
        rng, t = np.random.default_rng([8, seed]), DT * np.arange(samples)
        slow, fast = rng.uniform(0.2, 0.4), rng.uniform(0.8, 1.4)
        shape = 0.6 * np.sin(2 * np.pi * slow * t) + 0.4 * np.sin(2 * np.pi * fast * t)
        return (0.5 * self.weight + self.friction) / GEAR * shape

    def turned(self, u: Array) -> Array:
        """(N,) its angle at the samples of a command."""
        numbers = np.array([self.inertia, self.damping, self.friction, self.weight, self.angle])
        return _turned(u * GEAR, numbers, DT / FINE)

    def record(self, seed: int, samples: int = 1500, noise: float = 0.0, white: bool = False) -> tuple[Record, float]:
        """A record, and the angle at which its encoder has its zero.

        Args:
            seed: of the command, of the phase of the encoder and of the noise.
            samples: how many.
            noise: standard deviation of what is added to the angle, in counts.
            white: whether this noise takes the place of the counts.
        """
        u, rng = self.command(samples, seed), np.random.default_rng([9, seed])
        phase = float(rng.uniform(-0.5, 0.5)) * STEP
        angle = self.turned(u) - phase + noise * STEP * rng.standard_normal(samples)
        shown = angle if white else np.round(angle / STEP) * STEP
        return Record(u, shown, DT, input_units="N*m", output_units="rad", name=f"joint {seed}"), phase


@dataclass(frozen=True)
class Counts:
    """How random joints are recorded.

    Attributes:
        noise: standard deviation of what is added to the angle, in counts.
        white: whether this noise takes the place of the counts.
    """

    noise: float = 0.0
    white: bool = False


JOINTS: Mapping[str, Counts] = {
    "counts": Counts(),
    "counts and noise": Counts(noise=0.15),
    "white noise": Counts(noise=12**-0.5, white=True),
}
"""The settings by name."""


@numba.njit(cache=True)
def _pull(x, force, p):  # type: ignore[no-untyped-def]
    return force - p[3] * math.sin(x - p[4])


@numba.njit(cache=True)
def _step(x, v, force, side, p, h):  # type: ignore[no-untyped-def]
    k1 = (_pull(x, force, p) - p[1] * v - p[2] * side) / p[0]
    w2 = v + 0.5 * h * k1
    k2 = (_pull(x + 0.5 * h * v, force, p) - p[1] * w2 - p[2] * side) / p[0]
    w3 = v + 0.5 * h * k2
    k3 = (_pull(x + 0.5 * h * w2, force, p) - p[1] * w3 - p[2] * side) / p[0]
    w4 = v + h * k3
    k4 = (_pull(x + h * w3, force, p) - p[1] * w4 - p[2] * side) / p[0]
    return x + h / 6 * (v + 2 * w2 + 2 * w3 + w4), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@numba.njit(cache=True)
def _turned(forces, p, h):  # type: ignore[no-untyped-def]
    x, v = p[4], 0.0
    angles = np.empty(len(forces))
    for t in range(len(forces)):
        angles[t] = x
        for _ in range(FINE):
            left = h
            for _ in range(4):
                if left <= 0:
                    break
                pull = _pull(x, forces[t], p)
                if v == 0.0 and abs(pull) <= p[2]:
                    break  # it sticks; the pull changes with the next sample only
                side = math.copysign(1.0, v) if v != 0.0 else math.copysign(1.0, pull)
                nx, nv = _step(x, v, forces[t], side, p, left)
                if nv * side >= 0.0 or v == 0.0:
                    x, v, left = nx, nv, 0.0
                    continue
                low, high = 0.0, left  # the instant of standstill
                for _ in range(50):
                    middle = 0.5 * (low + high)
                    if _step(x, v, forces[t], side, p, middle)[1] * side > 0.0:
                        low = middle
                    else:
                        high = middle
                x, _ = _step(x, v, forces[t], side, p, high)
                v, left = 0.0, left - high
    return angles
