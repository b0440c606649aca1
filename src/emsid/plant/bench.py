"""A virtual bench: a motor with a signal generator and a sensor.

The generator limits the amplitude and slew rate of the commanded voltage and holds it. After a transport delay the
voltage acts on the motor. A tachometer or an encoder on the load shaft is read at every sample instant. A reading at t
depends on the voltage up to t only, so y(t) depends on u(t − 1) and earlier. The record contains the output of the
generator, before the delay, and the readings of the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, pi
from typing import Protocol

import numpy as np
from numpy.random import Generator as Random
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, ModelError
from emsid.plant.motor import Motor
from emsid.plant.simulation import AT_REST, STANDARD, State, Taylor, check_inputs, simulate
from emsid.record import Record

Array = NDArray[np.float64]


def _check_sizes(part: object, where: str, *names: str) -> None:
    for name in names:
        value = getattr(part, name)
        if not (isfinite(value) and value >= 0):
            raise ModelError(f"{where} {name} is {value}; it must be zero or positive")


class SpeedSensor(Protocol):
    """Anything that measures the speed of a shaft."""

    def read(self, speed: Array, angle: Array, dt: float, rng: Random) -> Array:
        """(N,) reading in rad/s of a shaft at ``speed`` (N,) in rad/s and ``angle`` (N,) in rad, every dt seconds."""


@dataclass(frozen=True)
class VoltageSource:
    """The signal generator with its amplifier.

    Args:
        limit: largest voltage either way in V.
        slew_rate: fastest change in V/s, from one update to the next.
        period: time from one update to the next in s; None to update with every sample.
        resolution: step of its digital output in V; 0 for a continuous one.

    Raises:
        ModelError: for a value that is not positive (for ``resolution``, negative).
    """

    limit: float = inf
    slew_rate: float = inf
    period: float | None = None
    resolution: float = 0.0

    def __post_init__(self) -> None:
        for name in ("limit", "slew_rate", "period"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ModelError(f"voltage source {name} is {value}; it must be positive")
        _check_sizes(self, "voltage source", "resolution")

    def drive(self, command: Array, interval: float) -> Array:
        """(M,) its output in V for commands (M,) at an interval of ``interval`` seconds, starting at 0 V."""
        voltage = np.clip(command, -self.limit, self.limit)
        if isfinite(self.slew_rate):
            change, last = self.slew_rate * interval, 0.0
            for k, target in enumerate(voltage.tolist()):
                last = min(max(target, last - change), last + change)
                voltage[k] = last
        return _quantise(voltage, self.resolution)


@dataclass(frozen=True)
class Tachometer:
    """A tachogenerator on the load shaft: y = round[(1 + ε + a·cos(n·θ_L + φ))·ω_L + offset + noise].

    Ripple and gain noise are proportional to the speed; the ripple is periodic in the angle.

    Args:
        noise: standard deviation of the additive noise in rad/s.
        gain_noise: standard deviation of the relative error ε, drawn for every sample.
        ripple: relative amplitude a of the commutation ripple.
        ripples_per_turn: its number n of periods per turn.
        ripple_phase: its phase φ in rad.
        offset: in rad/s.
        resolution: step of the analogue-to-digital converter in rad/s; 0 for a continuous reading.

    Raises:
        ModelError: for a negative size.
    """

    noise: float = 0.0
    gain_noise: float = 0.0
    ripple: float = 0.0
    ripples_per_turn: int = 11
    ripple_phase: float = 0.0
    offset: float = 0.0
    resolution: float = 0.0

    def __post_init__(self) -> None:
        _check_sizes(self, "tachometer", "noise", "gain_noise", "ripple", "resolution")

    def read(self, speed: Array, angle: Array, dt: float, rng: Random) -> Array:
        """(N,) speed read in rad/s."""
        ripple = self.ripple * np.cos(self.ripples_per_turn * angle + self.ripple_phase)
        gain = 1.0 + ripple + self.gain_noise * rng.standard_normal(len(speed))
        noise = self.noise * rng.standard_normal(len(speed))
        return _quantise(gain * speed + self.offset + noise, self.resolution)


@dataclass(frozen=True)
class Encoder:
    """An incremental encoder on the load shaft: the speed is the difference of two counts over the sample time.

    Args:
        counts_per_turn: counts per turn, with all edges.

    Raises:
        ModelError: for fewer than one count per turn.
    """

    counts_per_turn: int

    def __post_init__(self) -> None:
        if not self.counts_per_turn >= 1:
            raise ModelError(f"encoder with {self.counts_per_turn} counts per turn; give at least 1")

    def read(self, speed: Array, angle: Array, dt: float, rng: Random) -> Array:
        """(N,) speed read in rad/s; the first reading, which has no count before it, is 0."""
        counts = np.floor(angle * self.counts_per_turn / (2 * pi))
        return np.diff(counts, prepend=counts[:1]) * (2 * pi / (self.counts_per_turn * dt))


@dataclass(frozen=True)
class Bench:
    """A generator, a transport delay and a sensor; the default is ideal and returns the simulation itself.

    Args:
        source: the generator.
        sensor: a `Tachometer`, an `Encoder` or another object with a method ``read``.
        delay: transport delay from the generator to the armature in s; need not be a multiple of the sample time.

    Raises:
        ModelError: for a negative delay.
    """

    source: VoltageSource = VoltageSource()
    sensor: SpeedSensor = Tachometer()
    delay: float = 0.0

    def __post_init__(self) -> None:
        _check_sizes(self, "bench", "delay")

    @classmethod
    def typical(cls) -> Bench:
        """A teaching laboratory: ±15 V generator, 12-bit converters, a noisy tachogenerator, a delay of 0.5 ms.

        The tachogenerator has a ripple of 0.5 % with eleven periods per turn, an offset of 0.05 rad/s, noise of
        0.02 rad/s and of 0.1 %, and a converter with a range of ±200 rad/s.
        """
        return cls(
            VoltageSource(limit=15.0, slew_rate=5e3, resolution=30.0 / 4096),
            Tachometer(noise=0.02, gain_noise=1e-3, ripple=5e-3, offset=0.05, resolution=400.0 / 4096),
            delay=0.5e-3,
        )

    def run(
        self,
        motor: Motor,
        voltage: ArrayLike,
        dt: float,
        rng: Random,
        *,
        disturbance: float = 0.0,
        initial: State = AT_REST,
        method: Taylor = STANDARD,
        name: str = "virtual bench",
    ) -> Record:
        """Drive the motor with a commanded voltage and record what is measured.

        Args:
            motor: the motor on the bench.
            voltage: (N,) commanded voltage in V.
            dt: sample time in s.
            rng: source of the noise; the same state gives the same record.
            disturbance: constant disturbance torque T_d on the load in N·m.
            initial: the state of the motor at the first sample.
            method: order and tolerance of the simulation.
            name: the name of the record.

        Returns:
            N samples with the input "voltage" in V and the output "speed" in rad/s.

        Raises:
            DataError: for a voltage of another shape or not finite, for a sample time that is not positive.
        """
        command, _, _ = check_inputs(voltage, dt, disturbance)
        if len(command) == 0:
            raise DataError("voltage has no sample; the bench needs at least one")
        # Time is in samples, so that whole samples are exact.
        n, period = len(command), (self.source.period or dt) / dt
        updates = _snap(period * np.arange(np.ceil(n / period)))
        given = self.source.drive(command[np.minimum(updates.astype(int), n - 1)], period * dt)
        acts = _snap(updates + self.delay / dt)
        samples = np.arange(n, dtype=np.float64)
        edges = np.union1d(samples, acts[acts < n])
        trajectory = simulate(
            motor,
            _held(given, acts, edges),
            np.diff(edges, append=float(n)) * dt,
            disturbance=disturbance,
            initial=initial,
            method=method,
        )
        rows = np.searchsorted(edges, samples)
        speed = self.sensor.read(trajectory.load_speed[rows], trajectory.load_angle[rows], dt, rng)
        return Record(
            _held(given, updates, samples),
            speed,
            dt,
            input_names=("voltage",),
            output_names=("speed",),
            input_units=("V",),
            output_units=("rad/s",),
            name=name,
        )


def _snap(instants: Array) -> Array:
    """Instants in samples; those that differ from a whole number by rounding only are rounded to it."""
    whole = np.rint(instants)
    return np.where(np.abs(instants - whole) < 1e-9, whole, instants)


def _held(values: Array, since: Array, instants: Array) -> Array:
    """Zero-order hold of ``values`` given at instants ``since``, at other instants; 0 before the first."""
    latest = np.searchsorted(since, instants, side="right") - 1
    return np.where(latest >= 0, values[np.maximum(latest, 0)], 0.0)


def _quantise(values: Array, step: float) -> Array:
    return np.rint(values / step) * step if step > 0 else values
