"""A mass with friction behind a drive, simulated by Runge–Kutta steps with friction that is smooth around standstill.

It shares no code and no method with `emsid.plant`, which locates where friction sticks and solves the pieces exactly:

    dv/dt = gain·D(u(t − delay)) − damping·c(u)·v − T(v) − quadratic·|v|·v − a·cos(2πx/P) − b·sin(2πx/P) − offset(t)
    T(v)  = tanh(v/ε)·(coulomb + stribeck·exp(−|v|/v_s)) + viscous·v,      by direction of v

With a drop U, T = gain·D − damping·c·v becomes T − U·sgn(T), or nothing where |T| < U. All forces are divided by the
mass. D is a dead zone, c(u) the part of the time that a bridge conducts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pair = tuple[float, float]

FINE = 20
"""Parts of a sample, in which a delay is counted."""


@dataclass(frozen=True)
class OneMass:
    """The parameters; a pair is (forward, backward).

    Args:
        gain: acceleration per unit of command.
        damping: in 1/s, while the bridge conducts.
        coulomb, stribeck: levels of friction; the second fades over ``stribeck_speed``.
        gaussian: whether it fades as exp(−(v/v_s)²), and not as exp(−|v|/v_s).
        viscous: in 1/s.
        quadratic: friction by the square of the speed.
        cogging: period P, a and b.
        dead_zone: half its width, in units of the command.
        offset: constant deceleration.
        coasting: the part of the damping that is missing in the off-time of the bridge.
        full: the command at which the bridge conducts all the time.
        limit: the largest command that acts.
        knee, beyond: command above which the gain is another one, by this factor.
        backward_gain: factor of the gain for negative commands.
        delay: in s.
        drop: U.
        smooth: ε, a speed.
    """

    gain: float = 1.0
    damping: float = 0.0
    coulomb: Pair = (0.0, 0.0)
    stribeck: Pair = (0.0, 0.0)
    stribeck_speed: float = 1.0
    gaussian: bool = False
    viscous: Pair = (0.0, 0.0)
    quadratic: float = 0.0
    cogging: tuple[float, float, float] = (1.0, 0.0, 0.0)
    dead_zone: float = 0.0
    offset: float = 0.0
    coasting: float = 0.0
    full: float = 1.0
    limit: float = np.inf
    knee: float = np.inf
    beyond: float = 1.0
    backward_gain: float = 1.0
    delay: float = 0.0
    drop: float = 0.0
    smooth: float = 1e-3

    def run(self, u: Array, dt: float, drift: Array | float = 0.0, state: Pair = (0.0, 0.0)) -> tuple[Array, Array]:
        """Speed and position (N + 1,) from a state, for a command (N,) held over every sample.

        Args:
            u: (N,) command, or (N, FINE) its values within every sample.
            dt: sample time in s.
            drift: (N,) deceleration besides the offset.
            state: speed and position at the start.
        """
        late = round(self.delay / dt * FINE)
        within = np.repeat(u, FINE) if u.ndim == 1 else u.ravel()
        command = np.concatenate([np.full(late, within[0]), within])[: len(u) * FINE]
        size = np.abs(command)
        size = np.minimum(size + (self.beyond - 1.0) * np.maximum(size - self.knee, 0.0), self.limit)
        through = np.sign(command) * np.maximum(size - self.dead_zone, 0.0)
        through = np.where(command < 0, self.backward_gain, 1.0) * through
        conducting = 1.0 - self.coasting * (1.0 - np.minimum(np.abs(command) / self.full, 1.0))
        offset = np.repeat(self.offset + np.broadcast_to(drift, len(u)), FINE)
        friction = np.array([self.coulomb, self.stribeck, self.viscous])
        steepest = friction[:2].sum(axis=0).max() / self.smooth + self.damping + max(self.viscous)
        steps = max(1, int(np.ceil(steepest * dt / FINE / 1.5)))  # well within what the method is stable for
        speed, position = np.empty(len(command) + 1), np.empty(len(command) + 1)
        speed[0], position[0] = state
        _integrate(
            self.gain * through, self.damping * conducting, offset, friction,
            np.array([self.stribeck_speed, 1.0 + self.gaussian]), self.smooth, np.array([self.quadratic, self.drop]),
            np.array(self.cogging),
            dt / FINE / steps, steps, speed, position,
        )  # fmt: skip
        return speed[::FINE], position[::FINE]


@numba.njit(cache=True)
def _acceleration(v, x, force, damping, offset, friction, fading, smooth, extra, cogging):  # type: ignore[no-untyped-def]
    side = 0 if v >= 0 else 1
    ratio = abs(v) / fading[0]
    level = friction[0, side] + friction[1, side] * np.exp(-ratio * ratio if fading[1] == 2.0 else -ratio)
    turn = 2 * np.pi * x / cogging[0]
    force -= damping * v
    force -= min(max(force, -extra[1]), extra[1])
    force -= cogging[1] * np.cos(turn) + cogging[2] * np.sin(turn) + extra[0] * abs(v) * v
    return force - friction[2, side] * v - np.tanh(v / smooth) * level - offset


@numba.njit(cache=True)
def _integrate(force, damping, offset, friction, fading, smooth, q, cogging, h, steps, speed, position):  # type: ignore[no-untyped-def]
    v, x = speed[0], position[0]
    for t in range(len(force)):
        f, d, o = force[t], damping[t], offset[t]
        for _ in range(steps):
            k1 = _acceleration(v, x, f, d, o, friction, fading, smooth, q, cogging)
            middle = x + 0.5 * h * v
            k2 = _acceleration(v + 0.5 * h * k1, middle, f, d, o, friction, fading, smooth, q, cogging)
            k3 = _acceleration(v + 0.5 * h * k2, middle, f, d, o, friction, fading, smooth, q, cogging)
            k4 = _acceleration(v + h * k3, x + h * v, f, d, o, friction, fading, smooth, q, cogging)
            after = v + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            x += 0.5 * h * (v + after)
            v = after
        speed[t + 1], position[t + 1] = v, x
