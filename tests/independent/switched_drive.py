"""A brushless drive in phase quantities, whose inverter switches and has dead time; it shares no code with emsid.

The motor: three windings in a star, whose inductances change with the angle,

    v_k − v_n = R·i_k + dλ_k/dt,      λ = L(φ)·i + ψ·(cos φ, cos(φ − 2π/3), cos(φ + 2π/3)),      φ = p·θ,
    L_jk = L_0·cos(2π/3·(j − k)) + L_2·cos(2φ − 2π/3·(j + k)),      L_d, L_q = 3/2·(L_0 ± L_2),
    T = p·(½·iᵀ·∂L/∂φ·i + iᵀ·∂ψ/∂φ)·(1 + r(θ)) − c(θ),

with the ripple r and the cogging c as sums of harmonics of the angle of the shaft.

The currents are those of two phases; nothing is transformed to the frame of the rotor but in the controller. The leg of
a phase is high for the commanded part of a period of the carrier, in its middle. After every edge both switches are off
for the dead time, when the current chooses the diode: a positive current finds the leg low, a negative one high.

The controller reads currents and angle where the carrier begins, at every ``ratio``-th one. Its voltages act from the
next reading on, as duties of the phases for one reading after the other.

Reference:
    Krause, Wasynczuk, Sudhoff, Pekarek, *Analysis of Electric Machinery and Drive Systems* (2013), ch. 4.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import emsid

Array = NDArray[np.float64]
FINE = 50
"""Steps in a period of the carrier; an edge within a step counts by its part of it."""
BEFORE = 20
"""Readings before the log begins, so that the voltage that acts at its start is not in it."""
NONE = (0.0, 0.0, 0.0)
NOISE = {"current": 0.05, "speed": 0.5, "angle": 1.1e-4}
"""Standard deviations in A, rad/s and rad; the last is that of the counts of an encoder of 14 bits."""


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
    bus: float = 24.0
    dead_time: float = 0.3e-6
    carrier: float = 5e-5
    ratio: int = 2
    switched: bool = True  # or the mean of it: a phase loses `dead` against its current
    advance: float = 1.5
    proportional: float = 0.12
    integral: float = 120.0
    limit: float = 12.0
    cogging: tuple[tuple[float, float, float], ...] = (NONE,)  # harmonics per turn, cosine and sine in N·m
    ripple: tuple[tuple[float, float, float], ...] = (NONE,)  # the same, as parts of the torque
    capacity: float = 1e9
    conductance: float = 0.0
    drift: float = 0.0  # of the resistance in 1/s, as a part of it, by heat from elsewhere

    @property
    def period(self) -> float:
        """Time between two readings in s."""
        return self.carrier * self.ratio

    @property
    def dead(self) -> float:
        """What a phase loses against its current in V, in the mean."""
        return self.bus * self.dead_time / self.carrier


@numba.njit(cache=True)
def _slopes(m, i_a, i_b, angle, speed, warmer, v_a, v_b, v_c, side):  # type: ignore[no-untyped-def]
    """The derivatives of two currents, of the speed and of the temperature, and the torque of the currents."""
    phi = m.pairs * angle
    third = 2.0 * np.pi / 3.0
    l_0, l_2 = (m.inductance_d + m.inductance_q) / 3.0, (m.inductance_d - m.inductance_q) / 3.0
    i = (i_a, i_b, -i_a - i_b)
    v = (v_a, v_b, v_c)
    resistance = m.resistance * (1.0 + 0.00393 * warmer)
    inductances = np.empty((3, 3))
    pull, torque = np.zeros(3), 0.0
    for j in range(3):
        pull[j] = v[j] - resistance * i[j] + m.pairs * speed * m.flux * np.sin(phi - third * j)
        torque -= i[j] * m.flux * np.sin(phi - third * j)
        for k in range(3):
            inductances[j, k] = l_0 * np.cos(third * (j - k)) + l_2 * np.cos(2.0 * phi - third * (j + k))
            slope = -2.0 * l_2 * np.sin(2.0 * phi - third * (j + k))
            pull[j] -= m.pairs * speed * slope * i[k]
            torque += 0.5 * i[j] * slope * i[k]
    # between the lines a–c and b–c, where the neutral point does not matter
    a, b = inductances[0, 0] - inductances[2, 0], inductances[0, 1] - inductances[2, 1]
    c, d = inductances[1, 0] - inductances[2, 0], inductances[1, 1] - inductances[2, 1]
    e, f = inductances[0, 2] - inductances[2, 2], inductances[1, 2] - inductances[2, 2]
    a, b, c, d = a - e, b - e, c - f, d - f
    x, y, of = pull[0] - pull[2], pull[1] - pull[2], a * d - b * c
    torque *= m.pairs
    whole = 1.0
    for n, cosine, sine in m.ripple:
        whole += cosine * np.cos(n * angle) + sine * np.sin(n * angle)
    torque *= whole
    for n, cosine, sine in m.cogging:
        torque -= cosine * np.cos(n * angle) + sine * np.sin(n * angle)
    heat = resistance * (i[0] ** 2 + i[1] ** 2 + i[2] ** 2) - m.conductance * warmer
    rate = (torque - m.viscous * speed - side * m.coulomb) / m.inertia
    return (d * x - b * y) / of, (a * y - c * x) / of, rate, heat / m.capacity + m.drift / 0.00393, torque


@numba.njit(cache=True)
def _axes(i_a, i_b, phi):  # type: ignore[no-untyped-def]
    third = 2.0 * np.pi / 3.0
    i_c = -i_a - i_b
    d = 2.0 / 3.0 * (i_a * np.cos(phi) + i_b * np.cos(phi - third) + i_c * np.cos(phi + third))
    q = -2.0 / 3.0 * (i_a * np.sin(phi) + i_b * np.sin(phi - third) + i_c * np.sin(phi + third))
    return d, q


@numba.njit(cache=True)
def _high(begin, end, at, step):  # type: ignore[no-untyped-def]
    """The part of a step in which a leg is high."""
    return max(min(end, at + step) - max(begin, at), 0.0) / step


@numba.njit(cache=True)
def _simulated(m, d_wanted, q_wanted, speed_wanted, added, noise, locked, table):  # type: ignore[no-untyped-def]
    """(N, 12) v_d, v_q, i_d, i_q, speed, read angle, warmer, readings of i_d, i_q and two phases, and the torque."""
    n, third = len(d_wanted), 2.0 * np.pi / 3.0
    out = np.empty((n, 12))
    i_a = i_b = angle = speed = warmer = 0.0
    sum_d = sum_q = 0.0
    acting, coming = np.zeros(3), np.zeros(3)
    period, h = m.carrier * m.ratio, m.carrier / FINE
    for k in range(n):
        phi = m.pairs * angle
        i_d, i_q = _axes(i_a, i_b, phi)
        read_a, read_b = i_a + noise[k, 0], i_b + noise[k, 1]
        seen = angle + noise[k, 2]
        seen_d, seen_q = _axes(read_a, read_b, m.pairs * seen)
        wanted = q_wanted[k]
        if not np.isnan(speed_wanted[k]):
            wanted = min(max(0.08 * (speed_wanted[k] - speed), -m.limit), m.limit)
        if len(table):
            row = int(np.floor(seen / (2.0 * np.pi) * len(table))) % len(table)
            wanted = wanted * table[row, 1] + table[row, 0]
        error_d, error_q = d_wanted[k] - seen_d, wanted - seen_q
        sum_d, sum_q = sum_d + error_d * period, sum_q + error_q * period
        v_d = m.proportional * error_d + m.integral * sum_d + added[k, 0]
        v_q = m.proportional * error_q + m.integral * sum_q + added[k, 1]
        out[k, :7] = v_d, v_q, i_d, i_q, speed, seen, warmer
        out[k, 7:11] = seen_d, seen_q, read_a, read_b
        out[k, 11] = _slopes(m, i_a, i_b, angle, speed, warmer, 0.0, 0.0, 0.0, 0.0)[4]
        turned = m.pairs * (seen + m.advance * period * speed)
        for j in range(3):
            coming[j] = v_d * np.cos(turned - third * j) - v_q * np.sin(turned - third * j)
        middle = 0.5 * (coming.max() + coming.min())  # space-vector modulation
        for _ in range(m.ratio):
            for step in range(FINE):
                at = step * h
                v = np.empty(3)
                i = (i_a, i_b, -i_a - i_b)
                for j in range(3):
                    if not m.switched:
                        v[j] = acting[j] - m.bus * m.dead_time / m.carrier * np.sign(i[j])
                        continue
                    width = m.carrier * min(max(0.5 + acting[j] / m.bus, 0.0), 1.0)
                    begin, end = 0.5 * (m.carrier - width), 0.5 * (m.carrier + width)
                    if i[j] >= 0.0:
                        begin += m.dead_time
                    else:
                        end += m.dead_time
                    v[j] = m.bus * _high(begin, end, at, h)
                side = np.sign(speed)
                first = _slopes(m, i_a, i_b, angle, speed, warmer, v[0], v[1], v[2], side)
                if speed == 0.0:
                    side = min(max(first[4] / max(m.coulomb, 1e-30), -1.0), 1.0)
                    first = _slopes(m, i_a, i_b, angle, speed, warmer, v[0], v[1], v[2], side)
                half_a, half_b = i_a + 0.5 * h * first[0], i_b + 0.5 * h * first[1]
                moves = 0.0 if locked else 1.0
                half_speed, half_angle = speed + moves * 0.5 * h * first[2], angle + 0.5 * h * speed
                s = _slopes(m, half_a, half_b, half_angle, half_speed, warmer, v[0], v[1], v[2], side)
                i_a, i_b, angle = i_a + h * s[0], i_b + h * s[1], angle + h * half_speed
                after = speed + moves * h * s[2]
                speed = 0.0 if speed * after < 0.0 else after
                warmer += h * s[3]
        acting[:] = coming - middle
    return out


class Log(NamedTuple):
    """What the drive logs, at every reading: (N,) each; ``before`` are the voltages of the reading before them."""

    v_d: Array
    v_q: Array
    i_d: Array
    i_q: Array
    i_a: Array
    i_b: Array
    speed: Array
    angle: Array
    warmer: Array
    period: float
    before: Array
    torque: Array

    def record(
        self, outputs: str = "i_d i_q speed", every: int = 1, inputs: str = "v_d v_q angle", name: str = "drive"
    ) -> emsid.Record:
        """Voltages and angle to some of the outputs, of every reading or fewer."""
        units = {"v_d": "V", "v_q": "V", "i_d": "A", "i_q": "A", "i_a": "A", "i_b": "A", "speed": "rad/s"}
        units |= {"angle": "rad", "warmer": "degC"}
        sides = {}
        for side, names in (("input", inputs.split()), ("output", outputs.split())):
            sides[side] = np.column_stack([getattr(self, each) for each in names])[::every]
            sides |= {f"{side}_names": tuple(names), f"{side}_units": tuple(units[each] for each in names)}
        return emsid.Record(sides.pop("input"), sides.pop("output"), dt=self.period * every, name=name, **sides)


def logged(
    drive: Drive,
    d: Array,
    q: Array,
    speed: Array,
    seed: int,
    added: Array | float = 0.5,
    locked: bool = False,
    noisy: bool = True,
    table: Array | None = None,
) -> Log:
    """The log of a drive that follows currents (N,), or a speed (N,) where that is not NaN.

    Args:
        drive: the drive.
        d, q, speed: what is wanted at every reading.
        seed: of noise and test signal.
        added: voltages (N, 2) that are added to those of the controller, or the size of random ones.
        locked: whether the rotor is held.
        noisy: whether the readings have noise.
        table: (M, 2) for M equal parts of a turn, what is added to the q-current in A, and by what it is multiplied.
    """
    rng = np.random.default_rng(seed)
    more = added * rng.choice([-1.0, 1.0], (len(d), 2)) if isinstance(added, float) else added
    d, q, speed = (np.concatenate([np.repeat(each[:1], BEFORE), each]) for each in (d, q, speed))
    more = np.concatenate([np.zeros((BEFORE, 2)), more])
    noise = noisy * rng.standard_normal((len(d), 3)) * [NOISE["current"], NOISE["current"], NOISE["angle"]]
    whole = _simulated(drive, d, q, speed, more, noise, locked, np.zeros((0, 2)) if table is None else table)
    found = whole[BEFORE:]
    speeds = found[:, 4] + noisy * NOISE["speed"] * rng.standard_normal(len(found))
    v_d, v_q, angle, warmer, i_d, i_q, i_a, i_b, torque = found[:, [0, 1, 5, 6, 7, 8, 9, 10, 11]].T
    return Log(v_d, v_q, i_d, i_q, i_a, i_b, speeds, angle, warmer, drive.period, whole[BEFORE - 1, :2], torque)


def driven(drive: Drive, seed: int, seconds: float = 1.0, top: float = 150.0, noisy: bool = True) -> Log:
    """A log with random steps of the speed and of the d-current, and random voltages of half a volt."""
    rng = np.random.default_rng(1000 + seed)
    n, hold = round(seconds / drive.period), round(0.04 / drive.period)
    speed = np.repeat(rng.uniform(-top, top, n // hold + 1), hold)[:n]
    d = np.repeat(rng.uniform(-5, 5, 2 * n // hold + 2), hold // 2)[:n]
    return logged(drive, d, np.zeros(n), speed, seed, noisy=noisy)


def turned(drive: Drive, seed: int, seconds: float = 0.5, noisy: bool = True, table: Array | None = None) -> Log:
    """A log with a turn forward and one back, with a speed that swings by 30 rad/s so that there is torque."""
    n = round(seconds / drive.period)
    t = drive.period * np.arange(n)
    phase = np.random.default_rng(2000 + seed).uniform(0.0, 2.0 * np.pi)
    speed = np.where(t < 0.5 * seconds, 1.0, -1.0) * 17.0 / seconds + 30.0 * np.sin(95.0 * t + phase)
    return logged(drive, np.zeros(n), np.zeros(n), speed, seed, noisy=noisy, table=table)


def on_flywheel(drive: Drive, speed: float, table: Array | None = None) -> Log:
    """A log of a turn at a speed that a brake and a large flywheel keep, at a constant wanted q-current; no noise.

    No loop of the speed acts, and the wanted torque of 0.06 N·m is constant: what changes with the angle is ripple.
    """
    brake = (0.06 - drive.coulomb) / speed
    machine = drive._replace(viscous=brake, inertia=0.05 / speed)
    constant, most = 1.5 * drive.pairs * drive.flux, 10.0
    run_up = round(machine.inertia * speed / (constant * most - 0.035) / drive.period)
    turn = round(1.02 * 2.0 * np.pi / speed / drive.period)
    q = np.concatenate([np.full(run_up, most), np.full(turn + 100, 0.06 / constant)])
    log = logged(machine, 0.0 * q, q, np.full(len(q), np.nan), 0, added=0.0, noisy=False, table=table)
    found = {name: value[-turn:] for name, value in log._asdict().items() if name not in ("period", "before")}
    return log._replace(**found)
