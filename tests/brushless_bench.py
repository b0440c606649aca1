"""A brushless drive that shares no code with emsid: flux linkages of the stator, inverter with dead time, controller.

The state is the flux linkage in the frame of the stator, the angle, the speed and the temperature of the winding. All
are integrated together by the classical Runge–Kutta method, ``FINE`` steps in every period of the controller. The
controller reads currents and angle at the start of a period. Its voltages act over the next period, at the angle of the
reading plus ``advance`` periods, and every phase loses ``dead`` volts in the direction of its current.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import emsid

Array = NDArray[np.float64]
FINE = 20
BEFORE = 20
"""Periods before the log begins, so that the voltage that acts at its start is not in it."""


class Drive(NamedTuple):
    """A motor with inverter and controller; units are SI, amplitudes those of a phase."""

    resistance: float = 0.12
    inductance_d: float = 0.9e-4
    inductance_q: float = 1.2e-4
    flux: float = 5e-3
    pairs: float = 7.0
    inertia: float = 8e-5
    viscous: float = 4e-5
    coulomb: float = 0.01
    dead: float = 0.15
    advance: float = 1.5
    period: float = 1e-4
    proportional: float = 0.12
    integral: float = 120.0
    cogging: tuple[float, float, float] = (0.0, 0.0, 0.0)  # harmonic per turn, cosine and sine in N·m
    ripple: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the same, as parts of the torque
    capacity: float = 1e9
    conductance: float = 0.0
    limit: float = 12.0


@numba.njit(cache=True)
def _slope(m, flux_a, flux_b, angle, speed, warmer, va, vb, side):  # type: ignore[no-untyped-def]
    electrical = m.pairs * angle
    c, s = np.cos(electrical), np.sin(electrical)
    i_d = (c * flux_a + s * flux_b - m.flux) / m.inductance_d
    i_q = (c * flux_b - s * flux_a) / m.inductance_q
    i_a, i_b = c * i_d - s * i_q, s * i_d + c * i_q
    phase_b, phase_c = -0.5 * i_a + np.sqrt(0.75) * i_b, -0.5 * i_a - np.sqrt(0.75) * i_b
    drop_a, drop_b, drop_c = m.dead * np.sign(i_a), m.dead * np.sign(phase_b), m.dead * np.sign(phase_c)
    lost_a, lost_b = (2 * drop_a - drop_b - drop_c) / 3, (drop_b - drop_c) / np.sqrt(3.0)
    resistance = m.resistance * (1 + 0.00393 * warmer)
    torque = 1.5 * m.pairs * (m.flux + (m.inductance_d - m.inductance_q) * i_d) * i_q
    n, a, b = m.ripple
    torque *= 1 + a * np.cos(n * angle) + b * np.sin(n * angle)
    n, a, b = m.cogging
    torque -= a * np.cos(n * angle) + b * np.sin(n * angle)
    rate = (torque - m.viscous * speed - side * m.coulomb) / m.inertia
    heat = (1.5 * resistance * (i_d**2 + i_q**2) - m.conductance * warmer) / m.capacity
    return va - lost_a - resistance * i_a, vb - lost_b - resistance * i_b, speed, rate, heat, i_d, i_q, torque


@numba.njit(cache=True)
def _simulated(m, d_wanted, q_wanted, speed_wanted, added, noise, locked):  # type: ignore[no-untyped-def]
    """(N, 9) v_d, v_q, i_d, i_q, speed, measured angle, warmer, reading of i_d and of i_q at every period."""
    n = len(d_wanted)
    out = np.empty((n, 9))
    flux_a, flux_b, angle, speed, warmer = m.flux, 0.0, 0.0, 0.0, 0.0
    sum_d = sum_q = acting_a = acting_b = 0.0
    h = m.period / FINE
    for k in range(n):
        electrical = m.pairs * angle
        c, s = np.cos(electrical), np.sin(electrical)
        i_d = (c * flux_a + s * flux_b - m.flux) / m.inductance_d
        i_q = (c * flux_b - s * flux_a) / m.inductance_q
        off = m.pairs * noise[k, 2]  # of the angle that the controller reads
        seen_d = np.cos(off) * i_d + np.sin(off) * i_q + noise[k, 0]
        seen_q = np.cos(off) * i_q - np.sin(off) * i_d + noise[k, 1]
        wanted = q_wanted[k]
        if not np.isnan(speed_wanted[k]):
            wanted = min(max(0.08 * (speed_wanted[k] - speed), -m.limit), m.limit)
        error_d, error_q = d_wanted[k] - seen_d, wanted - seen_q
        sum_d, sum_q = sum_d + error_d * m.period, sum_q + error_q * m.period
        electrical_speed = m.pairs * speed
        v_d = m.proportional * error_d + m.integral * sum_d + added[k, 0]
        v_q = m.proportional * error_q + m.integral * sum_q + added[k, 1]
        out[k] = v_d, v_q, i_d, i_q, speed, angle + noise[k, 2], warmer, seen_d, seen_q
        turned = electrical + off + m.advance * m.period * electrical_speed
        next_a = np.cos(turned) * v_d - np.sin(turned) * v_q
        next_b = np.sin(turned) * v_d + np.cos(turned) * v_q
        for _ in range(FINE):
            side = np.sign(speed)
            if speed == 0.0:
                torque = _slope(m, flux_a, flux_b, angle, speed, warmer, acting_a, acting_b, 0.0)[7]
                side = np.sign(torque) * min(abs(torque) / max(m.coulomb, 1e-30), 1.0)
            x = np.array([flux_a, flux_b, angle, speed, warmer])
            total, kept = np.zeros(5), x
            for stage in range(4):
                a = _slope(m, kept[0], kept[1], kept[2], kept[3], kept[4], acting_a, acting_b, side)
                rates = np.array([a[0], a[1], a[2], a[3], a[4]])
                if locked:
                    rates[2] = rates[3] = 0.0
                total += rates * (1.0 if stage in (0, 3) else 2.0)
                kept = x + h * rates * (1.0 if stage == 2 else 0.5)
            x = x + h / 6 * total
            if speed * x[3] < 0:
                x[3] = 0.0
            flux_a, flux_b, angle, speed, warmer = x
        acting_a, acting_b = next_a, next_b
    return out


class Log(NamedTuple):
    """What the drive logs, in every period: (N,) each."""

    v_d: Array
    v_q: Array
    i_d: Array
    i_q: Array
    speed: Array
    angle: Array
    warmer: Array
    period: float
    before: Array

    def record(self, outputs: str = "i_d i_q speed", every: int = 1, name: str = "drive") -> emsid.Record:
        """Voltages and angle to some of the outputs, of every sample or fewer."""
        units = {"i_d": "A", "i_q": "A", "speed": "rad/s", "angle": "rad"}
        chosen = outputs.split()
        return emsid.Record(
            np.column_stack([self.v_d, self.v_q, self.angle])[::every],
            np.column_stack([getattr(self, each) for each in chosen])[::every],
            dt=self.period * every,
            input_names=("v_d", "v_q", "angle"),
            input_units=("V", "V", "rad"),
            output_names=tuple(chosen),
            output_units=tuple(units[each] for each in chosen),
            name=name,
        )


NOISE = {"current": 0.05, "speed": 0.5, "angle": 1.1e-4}
"""Standard deviations in A, rad/s and rad; the last is that of the counts of an encoder of 14 bits."""


def logged(
    drive: Drive,
    d: Array,
    q: Array,
    speed: Array,
    seed: int,
    added: float = 0.5,
    locked: bool = False,
    noisy: bool = True,
) -> Log:
    """The log of a drive that follows currents (N,), or a speed (N,) where that is not NaN."""
    rng = np.random.default_rng(seed)
    d, q, speed = (np.concatenate([np.repeat(each[:1], BEFORE), each]) for each in (d, q, speed))
    n = len(d)
    noise = noisy * rng.standard_normal((n, 3)) * [NOISE["current"], NOISE["current"], NOISE["angle"]]
    more = added * rng.choice([-1.0, 1.0], (n, 2))
    whole = _simulated(drive, d, q, speed, more, noise, locked)
    found = whole[BEFORE:]
    n = len(found)
    speeds = found[:, 4] + noisy * NOISE["speed"] * rng.standard_normal(n)
    v_d, v_q, angle, warmer, i_d, i_q = found[:, [0, 1, 5, 6, 7, 8]].T
    return Log(v_d, v_q, i_d, i_q, speeds, angle, warmer, drive.period, whole[BEFORE - 1, :2])


def driven(drive: Drive, seed: int, seconds: float = 1.0, top: float = 150.0, noisy: bool = True) -> Log:
    """A log with random steps of the speed and of the d-current."""
    rng = np.random.default_rng(1000 + seed)
    n, hold = round(seconds / drive.period), round(0.04 / drive.period)
    speed = np.repeat(rng.uniform(-top, top, n // hold + 1), hold)[:n]
    d = np.repeat(rng.uniform(-5, 5, 2 * n // hold + 2), hold // 2)[:n]
    return logged(drive, d, np.zeros(n), speed, seed, noisy=noisy)
