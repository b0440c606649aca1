r"""One mass under a held force and dry friction, sample by sample: the fast motion behind the grey-box models.

A rigid motor without inductance and a linear axis are the same thing, one mass M with a speed v and a position x,

    M·dv/dt = F − D·v − T_f(v),      dx/dt = v.                     (4.4) with (4.1)–(4.3) and (4.10) put into it

F is all that does not depend on speed (drive, gravity, offsets), D all that brakes in proportion to it (viscous
friction, and the armature with K²/R), T_f is (4.7). F and D are held from sample to sample. While the mass slides in
direction s the friction is s·c, and with c constant everything has a closed form over any time h:

    v(h) = v₀ + (a − r·v₀)·φ₁(h),     x(h) = x₀ + v₀·h + (a − r·v₀)·φ₂(h),       r = D/M,   a = (F − s·c)/M,
    φ₁(h) = (1 − e^{−rh})/r,          φ₂(h) = (h − φ₁(h))/r,

as has the instant at which the mass comes to rest, t = ln(1 − r·v₀/a)/r. There, friction either holds it, its speed
being exactly zero until |F| exceeds the break-away level, or it slides back. So with Coulomb friction the motion is
exact, stick included. A Stribeck excess changes with speed and is taken from the middle of the step, which is of
second order in h; `emsid.plant.simulate` is what the tests compare it with.

A command that arrives late by a fraction of a sample splits each sample in two, each part with its own force: the
delay enters exactly too, and every output is a continuous function of every parameter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """One mass as a regression sees it: dv/dt = gain·D(u) − damping·v − c·sgn(v) − offset, all divided by the mass.

    Attributes:
        gain: acceleration per unit of command beyond the dead zone.
        damping: in 1/s.
        coulomb: Coulomb level, the same in both directions.
        offset: constant deceleration.
        dead_zone: half its width, in units of the command.
    """

    gain: float
    damping: float
    coulomb: float
    offset: float
    dead_zone: float


class Sliding(NamedTuple):
    """What resists motion, forward in the first place of every pair and backward in the second.

    Attributes:
        coulomb: (2,) α₀ in N or N·m.
        stribeck: (2,) α₁, the excess at standstill.
        rate: (2,) α₂ in s/m or s/rad, how fast the excess fades.
        viscous: (2,) what is added to D in that direction, in N·s/m or N·m·s/rad.
    """

    coulomb: Array
    stribeck: Array
    rate: Array
    viscous: Array


@njit(cache=True, nogil=True, error_model="numpy")
def move(
    mass: float,
    friction: Sliding,
    force: Array,
    damping: Array,
    dt: float,
    late: float,
    steps: int,
    speed: float,
    position: float,
    speeds: Array,
    positions: Array,
) -> None:
    """Fill ``speeds`` and ``positions`` (N,) with the motion at every sample, before the force of that sample acts.

    Args:
        mass: M.
        friction: what T_f and the direction-dependent part of D are made of.
        force: (N + 1,) F; the first is what acted before the first sample.
        damping: (N + 1,) D, likewise.
        dt: sample time in s.
        late: which part of a sample the force before still acts, 0 to 1.
        steps: steps in a sample, for the Stribeck excess.
        speed: v at the first sample.
        position: x at the first sample.
        speeds, positions: written to; where they have N + 1 places, the last gets the end of the last sample.
    """
    v, x = speed, position
    known_rate, known_time, first, second = -1.0, -1.0, 0.0, 0.0
    for k in range(len(force) - 1):
        speeds[k], positions[k] = v, x
        for part in range(2):
            whole = late * dt if part == 0 else (1.0 - late) * dt
            if whole <= 0.0:
                continue
            drive, drag = force[k + part], damping[k + part]
            for _ in range(steps):
                left = whole / steps
                while left > 0.0:
                    if v == 0.0:
                        side = 0 if drive > 0.0 else 1
                        if abs(drive) <= friction.coulomb[side] + friction.stribeck[side]:
                            break
                    else:
                        side = 0 if v > 0.0 else 1
                    direction = 1.0 - 2.0 * side
                    r = (drag + friction.viscous[side]) / mass
                    level = friction.coulomb[side]
                    excess = friction.stribeck[side]
                    if excess > 0.0:
                        fading = friction.rate[side]
                        a = (drive - direction * (level + excess * np.exp(-fading * abs(v)))) / mass
                        half = 0.5 * left
                        middle = max(direction * (v + (a - r * v) * half / (1.0 + 0.5 * r * half)), 0.0)
                        level += excess * np.exp(-fading * middle)
                    a = (drive - direction * level) / mass
                    if r != known_rate or left != known_time:
                        known_rate, known_time = r, left
                        first, second = _phi(r, left)
                    pull = a - r * v
                    after = v + pull * first
                    if direction * after > 0.0:
                        x += v * left + pull * second
                        v = after
                        break
                    if v == 0.0:  # a step that did not get going: rounding, or an excess that is gone at once
                        break
                    time = min(np.log1p(-r * v / a) / r if abs(r * left) > 1e-9 else -v / a, left)
                    _, integral = _phi(r, time)
                    x += v * time + pull * integral
                    v = 0.0
                    left -= time
    if len(speeds) == len(force):
        speeds[-1], positions[-1] = v, x


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _phi(r: float, h: float) -> tuple[float, float]:
    """φ₁ and φ₂ of the module docstring, by their series where rh is small."""
    z = r * h
    if abs(z) < 1e-3:
        one = h * (1.0 - z / 2.0 * (1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0))))
        two = h * h / 2.0 * (1.0 - z / 3.0 * (1.0 - z / 4.0 * (1.0 - z / 5.0 * (1.0 - z / 6.0))))
        return one, two
    one = -np.expm1(-z) / r
    return one, (h - one) / r


def moved(
    mass: float,
    friction: Sliding,
    force: Array,
    damping: Array,
    dt: float,
    late: float,
    steps: int,
    speed: float,
    position: float,
) -> tuple[Array, Array]:
    """Speeds and positions (N + 1,) at every sample and at the end; the arguments are those of `move`."""
    speeds, positions = np.empty(len(force)), np.empty(len(force))
    steps = steps if friction.stribeck.any() else 1
    move(mass, friction, force, damping, dt, late, steps, speed, position, speeds, positions)
    return speeds, positions
