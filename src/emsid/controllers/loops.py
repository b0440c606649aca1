r"""Frequency responses, margins and step responses of sampled loops, for many plants at once.

A plant is M·dv/dt = f·i − D·v − k·x, dx/dt = v, where the command is held over a sample and acts after a delay, and
i follows it with the lag of a current loop. Over a sample it is (Franklin, Powell, Workman, Digital control of dynamic
systems, 3rd ed., 4.3.4)

    s(t + 1) = Φ·s(t) + Γ₀·u(t − d) + Γ₁·u(t − d − 1).

The controller is a linear system too, `controller_of`, from the position at the samples and the references to the
command.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.controllers.cascade import Settings

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

POINTS = 300
"""Frequencies of a response; with 1,200 the margins of the tests change by less than 0.5 %."""
LOWEST = 1e-4
"""The lowest frequency of a response, as a part of half the sampling frequency."""

BLOCK = 64
"""Samples of a step response that are computed by one product of matrices; a power of two."""


@dataclass(frozen=True, eq=False)
class Plants:
    """P plants in SI units, the nominal one first.

    Attributes:
        mass: (P,) inertia or mass, of rotor and load together.
        damping: (P,) force per speed, with the braking of the armature where a voltage drives it.
        stiffness: (P,) force per position against it, of gravity and cogging; negative above the upright position.
        force: (P,) force per unit of what the speed loop commands: volts behind the dead zone, amperes, N·m or N.
        shaft: (P, 3) inertia of the load, stiffness and damping of a shaft before it; None for one mass.
        at_load: whether the position is that of the load, not of the rotor.
        lag: time constant in s of a current loop between; 0 for none.
    """

    mass: Array
    damping: Array
    stiffness: Array
    force: Array
    shaft: Array | None = None
    at_load: bool = False
    lag: float = 0.0

    @property
    def nominal(self) -> Plants:
        """The first one alone."""
        return self._those([0])

    @property
    def different(self) -> Plants:
        """Without those that are equal to an earlier one, as plants are that differ in dry friction only."""
        rows = np.column_stack([self.mass, self.damping, self.stiffness, self.force, *self._shafts])
        return self._those(np.sort(np.unique(rows, axis=0, return_index=True)[1]).tolist())

    @property
    def _shafts(self) -> list[Array]:
        return [] if self.shaft is None else [self.shaft]

    def _those(self, which: list[int]) -> Plants:
        arrays = {name: getattr(self, name)[which] for name in ("mass", "damping", "stiffness", "force")}
        return replace(self, **arrays, shaft=None if self.shaft is None else self.shaft[which])

    def with_mode(self, resonance: tuple[Array, Array], antiresonance: Array) -> Plants:
        """The same plants of one mass with a measured mode, as two masses.

        Args:
            resonance: (k,) frequencies in rad/s and damping ratios; plants take them in turn, the first is nominal.
            antiresonance: (k,) in rad/s, below those of the resonance.
        """
        turn = np.arange(len(self.mass)) % len(antiresonance)
        frequency, ratio, below = resonance[0][turn], resonance[1][turn], antiresonance[turn]
        load = self.mass * (1 - (below / frequency) ** 2)
        reciprocal = 1 / load + 1 / (self.mass - load)
        return replace(self, shaft=np.column_stack([load, load * below**2, 2 * ratio * frequency / reciprocal]))

    @property
    def mode(self) -> tuple[float, float] | None:
        """Frequency in rad/s and damping ratio of the flexible mode of the nominal plant; None for one mass."""
        if self.shaft is None:
            return None
        load, stiffness, damping = self.shaft[0].tolist()
        reciprocal = 1 / load + 1 / (float(self.mass[0]) - load)
        frequency = float(np.sqrt(stiffness * reciprocal))
        return frequency, 0.5 * damping * reciprocal / frequency


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
    """Plants over a sample: Φ (P, n, n), Γ₀ and Γ₁ (P, n), the whole samples d of the delay, and the command (P,) that
    bears the stiffness of a position of 1."""

    transition: Array
    late: Array
    later: Array
    delay: int
    dt: float
    bearing: Array

    @classmethod
    def of(cls, plants: Plants, dt: float, delay: float) -> Sampled:
        """The plants with a sample time and a delay in s."""
        from scipy.linalg import expm

        count, lagging = len(plants.mass), plants.lag > 0
        n = (2 if plants.shaft is None else 4) + lagging
        acting = n - 1 if lagging else n
        whole = np.zeros(
            (count, n + 1, n + 1)
        )  # measured position and speed, (those of the other mass), (acting), command
        rotor, load = (0, 2) if plants.shaft is None or not plants.at_load else (2, 0)
        inertia = plants.mass if plants.shaft is None else plants.mass - plants.shaft[:, 0]
        whole[:, rotor, rotor + 1] = 1.0
        whole[:, rotor + 1, rotor], whole[:, rotor + 1, rotor + 1] = (
            -plants.stiffness / inertia,
            -plants.damping / inertia,
        )
        whole[:, rotor + 1, acting] = plants.force / inertia
        if plants.shaft is not None:
            whole[:, load, load + 1] = 1.0
            for here, there, mass in ((rotor, load, inertia), (load, rotor, plants.shaft[:, 0])):
                for k, each in enumerate(plants.shaft[:, 1:].T):
                    whole[:, here + 1, here + k] -= each / mass
                    whole[:, here + 1, there + k] += each / mass
        if lagging:
            whole[:, acting, acting], whole[:, acting, n] = -1.0 / plants.lag, 1.0 / plants.lag
        samples = int(np.floor(delay / dt + 1e-9))
        part = max(delay - samples * dt, 0.0)
        first, second = expm(whole * part), expm(whole * (dt - part))
        after = second[:, :n, :n]
        later = (after @ first[:, :n, n:])[:, :, 0]
        return cls(after @ first[:, :n, :n], second[:, :n, n], later, samples, dt, plants.stiffness / plants.force)

    def alone(self, k: int) -> Sampled:
        """The plant with this number."""
        one = slice(k, k + 1)
        return replace(
            self, transition=self.transition[one], late=self.late[one], later=self.later[one], bearing=self.bearing[one]
        )

    def response(self, w: Array) -> Complex:
        """(P, F) from the command to the position at the samples."""
        z = np.exp(1j * w * self.dt)
        n = self.transition.shape[1]
        left = z[None, :, None, None] * np.eye(n) - self.transition[:, None]
        right = self.late[:, None, :] + self.later[:, None, :] / z[None, :, None]
        states = np.linalg.solve(left, right[..., None])[..., 0]
        return np.asarray(states[..., 0] * z ** -float(self.delay))


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


INPUTS = ("position", "wanted", "speed", "acceleration")
"""What a controller reads: the measured position and the reference."""


def controller_of(settings: Settings) -> tuple[Array, Array, Array, Array]:
    """The linear part of a cascade as a discrete system: A (m, m), B (m, 4), C (m,) and D (4,), from `INPUTS` to u.

    Limits, friction, dead zone, gravity and the rule at rest are left out, and the load is one of both directions.
    """
    s, (whole, part) = settings, settings.late
    follows = s.position > 0
    # state: position, shift, speed, load of the observer; integral; prefilter; notch; commands, the latest first
    before, shift, speed, load, total, filtered, first, second, made = range(9)
    m = made + whole + 1
    row = np.eye(m + len(INPUTS))
    measured, wanted, reference, acceleration = row[m:]
    found = measured - row[before] - row[shift]
    v, d = row[speed] + s.correction[1] * found, row[load] - s.correction[2] * found
    if s.prefilter < 1:
        acceleration = s.prefilter / s.dt * (reference - row[filtered])
        reference = row[filtered]
    error = reference + s.position * (wanted - measured) * follows - v
    raw = s.per_speed * (reference + s.delay * acceleration) + s.per_acceleration * acceleration
    raw = raw + s.proportional * error + row[total] + d
    command = s.notch[0] * raw + row[first]
    late = [command, *row[made:m]]
    net = (1 - part) * late[whole] + part * late[whole + 1] - d
    after = np.zeros((m, m + len(INPUTS)))
    after[before], after[load] = measured, d
    after[shift] = (s.correction[0] - 1) * found + s.model[1] * v + s.model[3] * net
    after[speed] = s.model[0] * v + s.model[2] * net
    after[total] = row[total] + s.integral * s.dt * error
    after[filtered] = row[filtered] + s.dt * acceleration if s.prefilter < 1 else 0.0
    after[first] = s.notch[1] * raw - s.notch[3] * command + row[second]
    after[second] = s.notch[2] * raw - s.notch[4] * command
    after[made:] = late[:-1]
    return after[:, :m], after[:, m:], command[:m], command[m:]


def controller_response(w: Array, settings: Settings) -> tuple[Complex, Complex]:
    """(F,) from the position, against its sign, and from the reference to the command."""
    a, b, c, d = controller_of(settings)
    z = np.exp(1j * w * settings.dt)
    columns = [0, 1 if settings.position > 0 else 2]
    states = np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, b[None, :, columns].astype(complex))
    position, reference = (states.transpose(0, 2, 1) @ c + d[columns]).T
    return -position, reference


def step_responses(sampled: Sampled, settings: Settings, samples: int) -> Array:
    """(samples, P) position of the plants after a step of its reference; without a position loop, their speed.

    Gravity and cogging are borne at the reference by the feed-forward.

    Args:
        sampled: the plants, delayed no more than the settings say.
        settings: gains of the cascade.
        samples: how many.
    """
    a, b, c, d = controller_of(settings)
    count, n = sampled.late.shape
    follows, m, late = settings.position > 0, len(a), sampled.delay
    size = n + m + 1
    reads = slice(n, n + m)
    made = np.zeros(size)
    made[0], made[reads], made[-1] = d[0], c, d[1 if follows else 2]
    kept = n + m - settings.late[0] - 1
    step = np.zeros((count, size, size))
    step[:, :n, :n], step[:, -1, -1] = sampled.transition, 1.0
    for samples_late, gains in ((late, sampled.late), (late + 1, sampled.later)):
        acting = made if samples_late == 0 else np.eye(size)[kept + samples_late - 1]
        step[:, :n] += gains[:, :, None] * acting
    if follows:
        step[:, :n, -1] += (sampled.late + sampled.later) * sampled.bearing[:, None]
    step[:, reads, reads], step[:, reads, 0], step[:, reads, -1] = a, b[:, 0], b[:, 1 if follows else 2]
    reading, ahead = np.zeros((count, 1, size)), step
    reading[:, 0, 0 if follows else 1] = 1.0
    while reading.shape[1] < BLOCK:
        reading, ahead = np.concatenate([reading, reading @ ahead], axis=1), ahead @ ahead
    state = np.zeros((count, size, 1))
    state[:, -1] = 1.0
    found = []
    for _ in range(-(-samples // BLOCK)):
        found.append((reading @ state)[:, :, 0].T)
        state = ahead @ state
    return np.asarray(np.concatenate(found)[:samples])
