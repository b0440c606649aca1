"""Simulation of the motor for a voltage that is held from sample to sample, with the energy balance and the events.

`emsid.plant.taylor` has the method: Taylor series between the instants at which friction begins or ceases to hold.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, ModelError
from emsid.plant.constants import NOTHING, Extra, constants, stored
from emsid.plant.motor import Motor
from emsid.plant.taylor import SPARE_EVENTS, SPARE_STEPS, run, with_laws

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """The state of a motor; at a speed of exactly 0 friction may hold the body.

    Args:
        current: armature current i in A.
        rotor_speed: ω_m in rad/s.
        load_speed: ω_L in rad/s.
        twist: θ_m − θ_L in rad.
        load_angle: θ_L in rad.
    """

    current: float = 0.0
    rotor_speed: float = 0.0
    load_speed: float = 0.0
    twist: float = 0.0
    load_angle: float = 0.0


@dataclass(frozen=True)
class Taylor:
    """Order and tolerance of the time steps.

    Args:
        order: order of the Taylor series, 2 to 40.
        tolerance: error allowed in one step, relative to the state plus the effect of one volt; infinite for steps
            of fixed length.
        longest_step: the longest step in s.
        most_steps: the largest number of steps per sample, on average; a simulation that needs more is refused.
    """

    order: int = 14
    tolerance: float = 1e-11
    longest_step: float = inf
    most_steps: float = inf

    def __post_init__(self) -> None:
        if not 2 <= self.order <= 40:
            raise ModelError(f"Taylor series of order {self.order}; give 2 to 40")
        if not self.tolerance > 0 or not self.longest_step > 0:
            raise ModelError(
                f"tolerance {self.tolerance} and longest step {self.longest_step} s; both must be positive"
            )


AT_REST = State()
STANDARD = Taylor()


class Events(NamedTuple):
    """The instants at which friction begins or ceases to hold a body, in order of time.

    A motion is 1 forward, −1 backward, 0 held. A body that reverses without being held changes between 1 and −1.

    Attributes:
        time: (E,) in s.
        body: (E,) 0 for the rotor, and for both masses of a rigid motor, 1 for the load.
        before: (E,) motion before the event.
        after: (E,) motion after it.
    """

    time: Array
    body: NDArray[np.int64]
    before: NDArray[np.int64]
    after: NDArray[np.int64]

    @property
    def transitions(self) -> int:
        """The number of times a body stuck or broke away."""
        return int(np.count_nonzero((self.before == 0) | (self.after == 0)))


@dataclass(frozen=True)
class Energy:
    """The energy balance in J, from the first sample to the end of the last.

    Args:
        electrical: taken from the supply, ∫ v_a·i dt.
        stored: increase of magnetic, kinetic and elastic energy.
        resistance: heat in the armature, ∫ R_a·i² dt.
        rotor_viscous, load_viscous: heat in the viscous friction of either side.
        rotor_friction, load_friction: heat in the friction (4.7) of either side.
        shaft: heat in the damping of the shaft.
        dead_zones: loss in the dead zones, ∫ (v_a − D_v)·i dt + ∫ (K_m·i − D_T)·ω_m dt.
        disturbance: work done against the disturbance torque, ∫ T_d·ω_L dt.
    """

    electrical: float
    stored: float
    resistance: float
    rotor_viscous: float
    load_viscous: float
    rotor_friction: float
    load_friction: float
    shaft: float
    dead_zones: float
    disturbance: float

    @property
    def imbalance(self) -> float:
        """Electrical energy minus all other terms, in J: zero up to the error of the simulation."""
        spent = [getattr(self, part.name) for part in fields(self)]
        return float(2 * self.electrical - sum(spent))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motor at every sample instant, before the input of that sample acts.

    Args:
        time: (N,) in s, from 0.
        current: (N,) in A.
        rotor_speed: (N,) in rad/s, exactly 0 where the rotor is held.
        load_speed: (N,) in rad/s, exactly 0 where the load is held.
        twist: (N,) θ_m − θ_L in rad.
        load_angle: (N,) θ_L in rad.
        final: the state at the end of the last sample, for a following simulation.
        events: the instants at which bodies stick and break away.
        energy: the energy balance, if requested.
    """

    time: Array
    current: Array
    rotor_speed: Array
    load_speed: Array
    twist: Array
    load_angle: Array
    final: State
    events: Events
    energy: Energy | None

    @property
    def rotor_held(self) -> NDArray[np.bool_]:
        """(N,) whether friction holds the rotor."""
        return np.asarray(self.rotor_speed == 0)

    @property
    def load_held(self) -> NDArray[np.bool_]:
        """(N,) whether friction holds the load."""
        return np.asarray(self.load_speed == 0)


def simulate(
    motor: Motor,
    voltage: ArrayLike,
    dt: ArrayLike,
    *,
    disturbance: ArrayLike = 0.0,
    initial: State = AT_REST,
    method: Taylor = STANDARD,
    energy: bool = False,
    extra: Extra = NOTHING,
) -> Trajectory:
    """Simulate the motor for a voltage that is held from sample to sample.

    A simulation in pieces, each from the `Trajectory.final` of the previous one, gives the same numbers.

    >>> simulate(Motor(), [0.2] * 100, 1e-3).final == State()  # too little to break away
    True

    Args:
        motor: the motor.
        voltage: (N,) applied voltage v_a in V.
        dt: duration of a sample in s, one number or (N,).
        disturbance: disturbance torque T_d on the load in N·m, one number or (N,), held like the voltage.
        initial: the state at the first sample.
        method: order and tolerance of the integration.
        energy: whether to compute the energy balance.
        extra: what else acts on the motor.

    Raises:
        DataError: for inputs of other shapes or with values that are not finite, for a dt that is not
            positive.
        ModelError: for an impossible initial state, or time constants that are much too small for dt.
    """
    volts, holds, torques = check_inputs(voltage, dt, disturbance)
    start = np.array([getattr(initial, f.name) for f in fields(State)], dtype=float)
    if not np.isfinite(start).all():
        raise ModelError(f"initial {initial} is not finite")
    if motor.is_rigid and (initial.rotor_speed != initial.load_speed or initial.twist != 0):
        raise ModelError(f"initial {initial}: a rigid motor has one speed and no twist")

    known, simulated = constants(motor, extra), with_laws(run, motor)
    armature = volts if motor.voltage_dead_zone is None else motor.voltage_dead_zone(volts)
    states = np.empty((len(volts) + 1, len(start)))
    states[0] = start
    spent = np.zeros(len(fields(Energy)))
    steps = (method.order, method.tolerance, method.longest_step, _budget(method, len(volts)))
    happened, capacity = SPARE_EVENTS + len(volts), 0
    while happened > capacity:  # again, if the arrays were too short
        capacity, spent[:] = happened, 0.0
        instant, events, counts = np.empty(capacity), np.empty((capacity, 3), np.int64), np.empty(2, np.int64)
        simulated(known, volts, armature, torques, holds, *steps, energy, states, spent, instant, events, counts)
        happened, reached = counts.tolist()
    instant, events = instant[:happened].copy(), events[:happened].copy()
    time = np.concatenate([[0.0], np.cumsum(holds)])
    if reached < len(volts):
        raise ModelError(
            f"the motor cannot be simulated beyond {time[reached]:g} s: its time constants are out of all "
            "proportion to the sample time; check inductance, inertias and stiffness"
        )
    spent[1] = stored(known, states[-1]) - stored(known, states[0])
    return Trajectory(
        time[:-1],
        **{part.name: np.ascontiguousarray(states[:-1, k]) for k, part in enumerate(fields(State))},
        final=State(*states[-1].tolist()),
        events=Events(instant, events[:, 0], events[:, 1], events[:, 2]),
        energy=Energy(*spent.tolist()) if energy else None,
    )


def _budget(method: Taylor, samples: int) -> float:
    """The number of steps that a simulation may take; the kernel would be compiled again for an integer."""
    return float(SPARE_STEPS + method.most_steps * samples)


def check_inputs(voltage: ArrayLike, dt: ArrayLike, disturbance: ArrayLike) -> tuple[Array, Array, Array]:
    """Voltage, hold times and disturbance as (N,) each, checked."""
    volts = np.array(voltage, dtype=float)
    if volts.ndim != 1:
        raise DataError(f"voltage has shape {volts.shape}; give one value per sample, shape (N,)")
    columns = [volts]
    for name, values in (("dt", dt), ("disturbance", disturbance)):
        column = np.asarray(values, dtype=float)
        if column.shape not in ((), volts.shape):
            raise DataError(f"{name} has shape {column.shape} for a voltage of shape {volts.shape}")
        columns.append(np.array(np.broadcast_to(column, volts.shape)))
    for name, column in zip(("voltage", "dt", "disturbance"), columns, strict=True):
        if not np.isfinite(column).all():
            bad = int(np.flatnonzero(~np.isfinite(column))[0])
            raise DataError(f"{name} is {column[bad]} at sample {bad}; give finite values")
    if len(volts) and columns[1].min() <= 0:
        raise DataError(f"dt is {columns[1].min():g} s; it must be positive")
    return volts, columns[1], columns[2]
