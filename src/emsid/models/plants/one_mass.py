r"""One mass under a sampled force and dry friction: the fast simulation of the grey-box models.

A rigid motor without inductance and a linear axis have the same equations, one mass M with speed v and position x,

    M·dv/dt = F − D·v − T_f(v),      dx/dt = v.                     (4.4) with (4.1)–(4.3) and (4.10) inserted

F contains all forces that do not depend on speed (drive, gravity, offsets), D all damping (viscous friction, and K²/R
of the armature), and T_f is (4.7). F and D are constant between samples. While the mass slides in direction s the
friction is s·c, and for constant c the solution over any time h is

    v(h) = v₀ + (a − r·v₀)·φ₁(h),     x(h) = x₀ + v₀·h + (a − r·v₀)·φ₂(h),       r = D/M,   a = (F − s·c)/M,
    φ₁(h) = (1 − e^{−rh})/r,          φ₂(h) = (h − φ₁(h))/r,

The mass comes to rest at t = ln(1 − r·v₀/a)/r. Then friction holds it, at exactly zero speed until |F| exceeds the
break-away level, or it slides back. So with Coulomb friction the motion is exact, including sticking. A law that
depends on speed, such as a Stribeck excess, is evaluated at the speed in the middle of the step, which is of second
order in h; the tests compare it with `emsid.plant.simulate`.

The loop is the same for every friction law: `loop_for` replaces ``level``.

A delay by a fraction of a sample splits each sample in two parts, each with its own force. So the delay is exact too,
and every output is a continuous function of every parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from emsid.plant.friction import FrictionLaw, Level
from emsid.plant.friction import coulomb_stribeck as level

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """The motion of one mass, divided by the mass: dv/dt = gain·D(u) − damping·v − c·sgn(v) − offset.

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
    """Friction in both directions; every pair is (forward, backward).

    Attributes:
        numbers: (2, n) the parameters of the friction law.
        breakaway: (2,) break-away level, in N or N·m.
        varies: (2,) whether the law depends on speed.
        viscous: (2,) added to D in that direction, in N·s/m or N·m·s/rad.
    """

    numbers: Array
    breakaway: Array
    varies: NDArray[np.bool_]
    viscous: Array

    @classmethod
    def of(cls, law: FrictionLaw, viscous: Sequence[float] = (0.0, 0.0)) -> Sliding:
        """A friction law, and viscous friction (forward, backward)."""
        return cls(law.numbers, np.array(law.breakaway), law.varies, np.array(viscous))


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
        friction: T_f and the direction-dependent part of D.
        force: (N + 1,) F; the first value acts before the first sample.
        damping: (N + 1,) D, in the same order.
        dt: sample time in s.
        late: the fraction of a sample during which the previous force still acts, 0 to 1.
        steps: steps per sample for the Stribeck excess.
        speed: v at the first sample.
        position: x at the first sample.
        speeds, positions: the results; with N + 1 elements, the last one is the end of the last sample.
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
                        if abs(drive) <= friction.breakaway[side]:
                            break
                    else:
                        side = 0 if v > 0.0 else 1
                    direction = 1.0 - 2.0 * side
                    r = (drag + friction.viscous[side]) / mass
                    if friction.varies[side]:
                        a = (drive - direction * level(abs(v), friction.numbers, side)) / mass
                        half = 0.5 * left
                        middle = max(direction * (v + (a - r * v) * half / (1.0 + 0.5 * r * half)), 0.0)
                        a = (drive - direction * level(middle, friction.numbers, side)) / mass
                    else:
                        a = (drive - direction * friction.breakaway[side]) / mass
                    if r != known_rate or left != known_time:
                        known_rate, known_time = r, left
                        first, second = _phi(r, left)
                    pull = a - r * v
                    after = v + pull * first
                    if direction * after > 0.0:
                        x += v * left + pull * second
                        v = after
                        break
                    if v == 0.0:  # no motion in this step: rounding, or an excess that vanishes at once
                        break
                    time = min(np.log1p(-r * v / a) / r if abs(r * left) > 1e-9 else -v / a, left)
                    _, integral = _phi(r, time)
                    x += v * time + pull * integral
                    v = 0.0
                    left -= time
    if len(speeds) == len(force):
        speeds[-1], positions[-1] = v, x


@cache
def loop_for(law: Level) -> Callable[..., None]:
    """`move` with another friction law: compiled if the law is, otherwise in plain Python."""
    if law is level:
        return move
    compiled = hasattr(law, "py_func")
    names = {**move.py_func.__globals__, "level": law, "_phi": _phi if compiled else _phi.py_func}
    with_law = FunctionType(move.py_func.__code__, names, "move_with_law")
    if compiled:
        loop: Callable[..., None] = njit(nogil=True, error_model="numpy")(with_law)
        return loop

    def slow(*arguments: Any) -> None:
        with np.errstate(all="ignore"):
            with_law(*arguments)

    return slow


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
    law: Level,
    friction: Sliding,
    force: Array,
    damping: Array,
    dt: float,
    late: float,
    steps: int,
    speed: float,
    position: float,
) -> tuple[Array, Array]:
    """Speeds and positions (N + 1,) at every sample and at the end; the arguments after ``law`` are those of `move`."""
    speeds, positions = np.empty(len(force)), np.empty(len(force))
    steps = steps if friction.varies.any() else 1
    run = loop_for(law)
    run(mass, friction, force, damping, dt, late, steps, speed, position, speeds, positions)
    return speeds, positions
