"""A simulated board: a motor that is sampled at a constant rate and takes voltage commands.

The state is an argument and a result. A sample has the time, the voltage from then on, and the speed as the sensor
reads it. The motor may change while it runs, as a load that is put on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import did_you_mean
from emsid.errors import DataError, ModelError
from emsid.plant import Bench, Motor, State, Tachometer, simulate
from emsid.plant.motor import read_number

Array = NDArray[np.float64]

DISTURBANCE = "disturbance"
"""The name of the torque on the load, which is no parameter of the motor."""


@dataclass(frozen=True)
class MotorChange:
    """A parameter of the motor that changes while it runs.

    Args:
        time: in s.
        name: of the parameter, such as ``load_inertia``, or ``disturbance`` for a torque on the load.
        value: from then on, in SI units; a friction has the same value in both directions.
    """

    time: float
    name: str
    value: float


@dataclass(frozen=True)
class BoardState:
    """The state of a board: of the motor, of its noise, and the number of samples so far."""

    motor: State
    noise: np.random.Generator
    samples: int = 0


@dataclass(frozen=True)
class Board:
    """A motor with a sensor and an amplifier, sampled at a constant rate.

    Args:
        motor: the motor at the beginning.
        dt: sample time in s.
        bench: amplifier and sensor; its delay is left out.
        changes: of the motor, in order of time.
        seed: of the noise.

    Raises:
        DataError: for a sample time that is not positive.
        ModelError: for a change of a parameter that the motor does not have.
    """

    motor: Motor
    dt: float = 1e-3
    bench: Bench = field(default_factory=lambda: Bench(sensor=Tachometer(noise=0.02)))
    changes: tuple[MotorChange, ...] = ()
    seed: int = 1

    def __post_init__(self) -> None:
        if not self.dt > 0:
            raise DataError(f"a sample time of {self.dt:g} s; give a positive one", arguments=("dt",))
        for k in range(len(self.changes)):
            changed(self.motor, self.changes[: k + 1])

    def start(self) -> BoardState:
        """The motor at rest."""
        return BoardState(State(), np.random.default_rng(self.seed))

    def advance(self, state: BoardState, voltage: Array) -> tuple[Array, BoardState]:
        """Samples (m, 3) of time, voltage and speed for commanded voltages (m,), and the state after them."""
        rows = np.empty((len(voltage), 3))
        volts = self.bench.source.drive(np.asarray(voltage, dtype=float), self.dt)
        done = 0
        while done < len(volts):
            now = (state.samples + 0.5) * self.dt
            active = [change for change in self.changes if change.time <= now]
            later = [change.time for change in self.changes if change.time > now]
            stop = min(len(volts), done + round(later[0] / self.dt) - state.samples) if later else len(volts)
            stop = max(stop, done + 1)
            motor, torque = changed(self.motor, active)
            path = simulate(motor, volts[done:stop], self.dt, disturbance=torque, initial=state.motor)
            rows[done:stop, 0] = (state.samples + np.arange(stop - done)) * self.dt
            rows[done:stop, 1] = volts[done:stop]
            rows[done:stop, 2] = self.bench.sensor.read(path.load_speed, path.load_angle, self.dt, state.noise)
            state = BoardState(path.final, state.noise, state.samples + stop - done)
            done = stop
        return rows, state


def changed(motor: Motor, changes: Sequence[MotorChange]) -> tuple[Motor, float]:
    """A motor after changes, and the torque on its load.

    Raises:
        ModelError: for a parameter that the motor does not have.
    """
    torque = 0.0
    for change in changes:
        if change.name == DISTURBANCE:
            torque = change.value
        else:
            motor = _put(motor, change.name.split("."), change)
    return motor, torque


def read_change(text: str) -> MotorChange:
    """A change from text: ``load_inertia=0.003 kg*m^2@30``, with the time in s.

    Raises:
        ModelError: for another text, parameter or unit.
    """
    name, _, rest = text.partition("=")
    value, _, time = rest.rpartition("@")
    units = {parameter.name: parameter.unit for parameter in Motor.parameters()} | {DISTURBANCE: "N*m"}
    if name not in units:
        raise ModelError(f"change {text!r}: no parameter {name!r} of the motor{did_you_mean(name, units)}")
    if not value:
        raise ModelError(f"change {text!r}: write it as NAME=VALUE@SECONDS, such as disturbance=0.05@30")
    when = read_number(f"the time of the change of {name}", time, "s")
    return MotorChange(when, name, read_number(name, value, units[name]))


def _put(part: Any, names: list[str], change: MotorChange) -> Any:
    """A part with one of its parameters changed."""
    old = getattr(part, names[0], None)
    if old is None:
        raise ModelError(f"the motor has no {change.name} to change; put it into its file")
    if len(names) > 1:
        return replace(part, **{names[0]: _put(old, names[1:], change)})
    if is_dataclass(old):
        raise ModelError(f"{change.name} has several parameters; name one of them")
    return replace(part, **{names[0]: (change.value,) * 2 if isinstance(old, tuple) else change.value})
