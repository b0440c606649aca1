"""The motor of section IV as a plant: with the drive in front of it and the sensor behind it.

The general motor is simulated by `emsid.plant.simulate`. Its rigid form without inductance is one mass,

    M = J_m + J_L,   F = (K_m/R_a)·c·D_v(v) − T_d,   D = c·K_m²/R_a + B_m + B_L,

and takes the fast loop of `one_mass`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.drive import Drive, Feed, Sensor, outer_handles
from emsid.models.plants.one_mass import Motion, Sliding, moved
from emsid.models.plants.parameters import TINY, Handle, Parametrised, Quantity, Signal, handles_of
from emsid.models.plants.state import PlantState
from emsid.plant import DeadZoneLaw, Friction, Motor, State, Taylor, simulate
from emsid.plant.motor import Parameter

Array = NDArray[np.float64]

LONG_STEPS = Taylor(order=20)
"""Samples of a log are long beside electrical time constants and resonances: of a higher order, fewer steps do."""


_INSIDE = {
    name: handle
    for p in Motor.parameters()
    for name, handle in handles_of(("motor",), p.name, p.symbol, p.unit, p.description).items()
} | {
    "load_torque": Handle(
        Parameter("load_torque", "T_d", "N*m", "constant torque on the load"), ((("load_torque",), 1.0),)
    ),
}
_MADE = {
    Feed.VOLTAGE: ("V", "volts"),
    Feed.CURRENT: ("A", "amperes"),
    Feed.TORQUE: ("N*m", "newton metres"),
}
_MOTOR_HANDLES = {feed: {**_INSIDE, **outer_handles(*made, "rad/s")} for feed, made in _MADE.items()}
_RIGID_HANDLES = {
    feed: {name: handle for name, handle in handles.items() if not name.startswith("shaft_")}
    for feed, handles in _MOTOR_HANDLES.items()
}


@dataclass(frozen=True)
class DrivenMotor(Parametrised):
    """The motor (4.1)–(4.11) with its drive and its sensor; input a command, outputs speed, position or current.

    An initial state is a speed in rad/s and an angle in rad, of rotor and load alike, the current settled; after them
    may come the speed in rad/s that a sensor with a lag shows at the start, by default the true one.

    Args:
        motor: the motor; `Motor.rigid` with no inductance is by far the fastest.
        drive: what makes the voltage from the command.
        sensor: what makes the log from the motion.
        load_torque: constant torque T_d on the load in N·m.
        steps: steps in a sample for the Stribeck excess of a rigid motor.
        feed: what the drive makes; fed with a current or a torque, a rigid motor has no back electromotive force.

    Raises:
        ModelError: for a motor with an elastic shaft that is fed with anything but a voltage.
    """

    motor: Motor = field(default_factory=Motor)
    drive: Drive = Drive()  # noqa: RUF009  (frozen)
    sensor: Sensor = Sensor()  # noqa: RUF009  (frozen)
    load_torque: float = 0.0
    steps: int = 2
    feed: Feed = Feed.VOLTAGE

    def __post_init__(self) -> None:
        if self.feed is not Feed.VOLTAGE and not self.motor.is_rigid:
            raise ModelError(f"a motor fed with a {self.feed.value} is simulated as one mass only; give Motor.rigid()")

    @property
    def name(self) -> str:
        """``rigid-motor`` or ``motor``."""
        return "rigid-motor" if self.motor.is_rigid else "motor"

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Those of `Motor.parameters` by their names there, then load torque, drive and sensor."""
        return (_RIGID_HANDLES if self.motor.is_rigid else _MOTOR_HANDLES)[self.feed]

    @property
    def usual(self) -> tuple[str, ...]:
        """Electrical constants, inertia, viscous and Coulomb friction, dead zone; with a shaft, that and the load.

        Of these what makes a difference; a motor that is fed with a current or a torque has no dead zone of its own.
        """
        if self.feed is not Feed.VOLTAGE:
            constant = ("motor_constant",) if self.feed is Feed.CURRENT else ()
            return (*constant, "rotor_viscous", "rotor_inertia", "rotor_friction.coulomb")
        names = ["resistance", "rotor_viscous", "motor_constant", "rotor_inertia"]
        if not self.motor.is_rigid:
            names += ["load_inertia", "shaft_stiffness", "shaft_damping"]
        if self.motor.inductance > 0:
            names.append("inductance")
        return (*names, "rotor_friction.coulomb", "voltage_dead_zone.half_width")

    @property
    def fine(self) -> frozenset[str]:
        """What concerns the shaft, and the inductance: of a motor with an elastic shaft only."""
        late = ("shaft_stiffness", "shaft_damping", "load_inertia", "inductance")
        return frozenset() if self.motor.is_rigid else frozenset(late)

    @property
    def states(self) -> int:
        """Speed, angle, and the speed that the sensor shows."""
        return 3

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample: speed, angle and shown speed, under a command (nu,) that stood till then.

        Args:
            state: (2,) speed and angle, or (3,) with the speed that the sensor shows, by default the true one.
            command: the inputs of the first sample; a code is what the bridge did before.
            dt: sample time in s.
            signals: what the outputs are.
            samples: how long the run is going to be, if that is known; a delay beyond it is not kept.
        """
        speed, angle = float(state[0]), float(state[1])
        commands = self.drive.standing(command, dt, samples)
        motor, motion = self.motor, np.array([speed, angle])
        if not self._is_one_mass:
            volts = commands[:1, 0]
            across = volts[0] if motor.voltage_dead_zone is None else float(motor.voltage_dead_zone(volts)[0])
            current = (across - motor.motor_constant * speed) / motor.resistance
            motion = np.array([current, speed, speed, 0.0, angle])
        shown = float(state[2] if len(state) > 2 else state[0])
        begin = [self.sensor.begins(s is Signal.POSITION, np.array([speed, angle]), dt, shown) for s in signals]
        return PlantState(dt, motion, commands, np.array(begin))

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The outputs (N, ny) for a command (N, 1), or with codes for the bridge (N, 2), and the state after them."""
        dt, motor = state.dt, self.motor
        made, conducts, late, commands = self.drive.acting(inputs, state.commands, dt)
        if self._is_one_mass:
            torque, braking = self._torque(made, conducts)
            speeds, positions = moved(
                motor.rotor_inertia + motor.load_inertia,
                _together(motor.rotor_friction, motor.load_friction),
                torque - self.load_torque,
                braking + (motor.rotor_viscous + motor.load_viscous),
                dt,
                late,
                self.steps,
                float(state.motion[0]),
                float(state.motion[1]),
            )
            motion = np.array([speeds[-1], positions[-1]])
            speeds, positions = speeds[:-1], positions[:-1]
            rotor_speeds, rotor_positions = speeds, positions
            torque, braking = (late * each[:-1] + (1 - late) * each[1:] for each in (torque, braking))
            current = (torque - braking * speeds) / motor.motor_constant
        else:
            if np.any(conducts != 1.0):
                raise ModelError(
                    "a bridge that coasts is simulated for a rigid motor without inductance only; choose rigid-motor, "
                    "or leave out these samples with a mask",
                    arguments=("mask",),
                )
            pieces = _pieces(made, dt, late)
            start = State(*state.motion.tolist())
            whole = simulate(motor, *pieces, disturbance=self.load_torque, initial=start, method=LONG_STEPS)
            motion = np.array(astuple(whole.final))
            every = slice(None, None, 2 if 0 < late < 1 else 1)
            speeds, positions, current = whole.load_speed[every], whole.load_angle[every], whole.current[every]
            rotor_speeds, rotor_positions = whole.rotor_speed[every], whole.rotor_angle[every]
        sensor = self.sensor
        shown: dict[Signal, Callable[[Array], tuple[Array, Array]]] = {
            Signal.SPEED: lambda kept: sensor.speed(speeds, positions, dt, kept),
            Signal.POSITION: lambda kept: sensor.position(positions, dt, kept),
            Signal.ROTOR_SPEED: lambda kept: sensor.speed(rotor_speeds, rotor_positions, dt, kept),
            Signal.CURRENT: lambda kept: (current, kept),
        }
        columns = [shown[signal](kept) for signal, kept in zip(signals, state.sensed, strict=True)]
        sensed = np.array([kept for _, kept in columns])
        return np.column_stack([values for values, _ in columns]), PlantState(dt, motion, commands, sensed)

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The outputs (N, ny) for a command (N, 1), or with codes for the bridge (N, 2), from speed and angle."""
        return self.run(self.start(state, inputs[0], dt, signals, len(inputs)), inputs, signals)[0]

    @property
    def _is_one_mass(self) -> bool:
        """Whether the fast loop of one mass can move it."""
        motor = self.motor
        return self.feed is not Feed.VOLTAGE or (
            motor.is_rigid and motor.inductance == 0 and motor.torque_dead_zone is None
        )

    def _torque(self, made: Array, conducts: Array) -> tuple[Array, Array]:
        """What turns one mass at rest, and by how much less per rad/s when it moves, for what the drive makes."""
        motor = self.motor
        if self.feed is Feed.VOLTAGE:
            slope = motor.motor_constant / motor.resistance
            volts = made if motor.voltage_dead_zone is None else motor.voltage_dead_zone(made)
            return slope * volts, slope * motor.motor_constant * conducts
        torque = motor.motor_constant * made if self.feed is Feed.CURRENT else made
        return torque if motor.torque_dead_zone is None else motor.torque_dead_zone(torque), np.zeros(len(made))

    def put_motion(self, motion: Motion) -> Self:
        """The motor that moves like one mass, resistance, viscous friction and the ratio of inertias kept.

        With R_a given, K_m follows from the damping, J from K_m and the gain, and the friction from J. Fed with a
        current, K_m is kept and the rest follows from it.
        """
        motor = self.motor
        if self.feed is not Feed.VOLTAGE:
            per_unit = (motor.motor_constant if self.feed is Feed.CURRENT else 1.0) * self.drive.gain
            inertia = max(per_unit / motion.gain, 2 * TINY)
            return self.put(
                {
                    "rotor_inertia": max(inertia - motor.load_inertia, TINY),
                    "rotor_viscous": max(inertia * motion.damping - motor.load_viscous, 0.0),
                    "rotor_friction.coulomb": inertia * max(motion.coulomb, 0.0),
                }
            )
        share = motor.rotor_inertia / (motor.rotor_inertia + motor.load_inertia)
        gain = motion.gain / self.drive.gain  # rad/s² per volt
        constant = max(motion.damping / gain, 1e-6 * motor.motor_constant)
        inertia = constant / (motor.resistance * gain)
        found = replace(
            motor,
            motor_constant=constant,
            rotor_inertia=inertia * share,
            load_inertia=inertia * (1 - share),
            rotor_viscous=min(motor.rotor_viscous, 0.02 * inertia * motion.damping),
            load_viscous=min(motor.load_viscous, 0.02 * inertia * motion.damping),
            rotor_friction=replace(motor.rotor_friction, coulomb=inertia * max(motion.coulomb, 0.0)),
            voltage_dead_zone=None
            if motor.voltage_dead_zone is None
            else replace(
                motor.voltage_dead_zone,
                b_l=-motion.dead_zone * abs(self.drive.gain),
                b_r=motion.dead_zone * abs(self.drive.gain),
            ),
        )
        if not motor.is_rigid:
            factor = inertia / (motor.rotor_inertia + motor.load_inertia)
            found = replace(
                found, shaft_stiffness=motor.shaft_stiffness * factor, shaft_damping=motor.shaft_damping * factor
            )
        return replace(self, motor=found)

    def friction_torque(self, speed: Array) -> Array:
        """All mechanical friction (4.7) with the viscous part, in N·m, at speeds in rad/s."""
        m = self.motor
        viscous = (m.rotor_viscous + m.load_viscous) * speed
        return np.asarray(m.rotor_friction.torque(speed) + m.load_friction.torque(speed) + viscous)

    def quantities(self) -> tuple[Quantity, ...]:
        """What input and speed alone can tell of a motor."""
        m = self.motor
        r, k = m.resistance, m.motor_constant
        inertia, viscous = m.rotor_inertia + m.load_inertia, m.rotor_viscous + m.load_viscous
        if self.feed is not Feed.VOLTAGE:
            level = float(_together(m.rotor_friction, m.load_friction).coulomb[0])
            found = [Quantity("mechanical time constant", "J/B", "s", inertia / max(viscous, TINY))]
            if self.feed is Feed.CURRENT:
                found += [
                    Quantity("acceleration per ampere", "K/J", "rad/(A*s^2)", k / inertia),
                    Quantity("Coulomb current", "T_c/K", "A", level / k),
                ]
            return tuple(found)
        damping = k**2 / r + viscous
        slide = _together(m.rotor_friction, m.load_friction)
        found = [
            Quantity("mechanical time constant", "J/(B + K²/R)", "s", inertia / damping),
            Quantity("speed per volt", "K/(K² + R·B)", "rad/(V*s)", k / r / damping),
            Quantity("acceleration per volt", "K/(R·J)", "rad/(V*s^2)", k / (r * inertia)),
            Quantity("Coulomb voltage forward", "R·T_c/K", "V", r * float(slide.coulomb[0]) / k),
            Quantity("Coulomb voltage backward", "R·T_c/K", "V", r * float(slide.coulomb[1]) / k),
            Quantity("electromechanical time constant", "R·J/K²", "s", r * inertia / k**2),
        ]
        zone = m.voltage_dead_zone or DeadZoneLaw(0.0, 0.0)
        for k_side, side, edge, slope in ((0, "forward", zone.b_r, zone.m_r), (1, "backward", -zone.b_l, zone.m_l)):
            held = float(slide.coulomb[k_side] + slide.stribeck[k_side])
            found.append(
                Quantity(f"break-away voltage {side}", "b + R·(T_c + T_s)/(K·m)", "V", edge + r * held / (k * slope))
            )
        if m.inductance > 0:
            found.append(Quantity("electrical time constant", "L/R", "s", m.inductance / r))
        if not m.is_rigid:
            ring = m.shaft_stiffness * (1 / m.rotor_inertia + 1 / m.load_inertia)
            found += [
                Quantity("shaft resonance", "√(K_s·(1/J_m + 1/J_L))", "rad/s", float(np.sqrt(ring))),
                Quantity("inertia ratio", "J_L/J_m", "1", m.load_inertia / m.rotor_inertia),
            ]
        return tuple(found)


def _together(rotor: Friction, load: Friction) -> Sliding:
    """The friction of both sides of a rigid motor; the rates are the rotor's where it has an excess."""
    a, b = (np.array([f.forward, f.backward]) for f in (rotor, load))
    rate = np.where(a[:, 1] > 0, a[:, 2], b[:, 2])
    return Sliding(a[:, 0] + b[:, 0], a[:, 1] + b[:, 1], rate, np.zeros(2))


def _pieces(voltage: Array, dt: float, late: float) -> tuple[Array, Array]:
    """Voltages and how long each is held: two to a sample where the delay ends within it."""
    if late <= 0:
        return voltage[1:], np.full(len(voltage) - 1, dt)
    if late >= 1:
        return voltage[:-1], np.full(len(voltage) - 1, dt)
    held = np.column_stack([voltage[:-1], voltage[1:]]).ravel()
    return held, np.tile([late * dt, (1 - late) * dt], len(voltage) - 1)
