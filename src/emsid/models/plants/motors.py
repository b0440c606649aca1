"""The plants that emsid knows: the motor of section IV and a linear axis, with what drives them and what measures them.

A plant is a frozen value with named physical parameters that can simulate itself. The motor is (4.1)–(4.11) with what
real logs put in front of it and behind it; its rigid form without inductance is one mass, and so is a linear axis:

    motor       M = J_m + J_L,   F = (K_m/R_a)·c·D_v(v) − T_d,    D = c·K_m²/R_a + B_m + B_L
    linear axis M = mass,        F = D_F(f) − offset,              D = viscous friction

so that one fast loop, `one_mass`, moves both, and `emsid.plant.simulate` the general motor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.drive import Bridge, Drive, Feed, Sensor, outer_handles
from emsid.models.plants.one_mass import Sliding, move
from emsid.models.plants.parameters import TINY, Handle, Parametrised, Plant, Quantity, Signal, handles_of
from emsid.plant import DeadZone, Friction, Motor, State, Taylor, simulate
from emsid.plant.motor import Parameter

Array = NDArray[np.float64]

LONG_STEPS = Taylor(order=20)
"""Samples of a log are long beside electrical time constants and resonances: of a higher order, fewer steps do."""


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

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The outputs (N, ny) for a command (N, 1), or with codes for the bridge (N, 2), from speed and angle."""
        made, conducts, late = self.drive.terminals(inputs, dt)
        motor, speed, angle = self.motor, float(state[0]), float(state[1])
        if self.feed is not Feed.VOLTAGE or (
            motor.is_rigid and motor.inductance == 0 and motor.torque_dead_zone is None
        ):
            torque, braking = self._torque(made, conducts)
            speeds, positions = _one_mass(
                motor.rotor_inertia + motor.load_inertia,
                _together(motor.rotor_friction, motor.load_friction),
                torque - self.load_torque,
                braking + (motor.rotor_viscous + motor.load_viscous),
                dt,
                late,
                self.steps,
                speed,
                angle,
            )
            rotor_speeds, rotor_positions = speeds, positions
            torque, braking = (late * each[:-1] + (1 - late) * each[1:] for each in (torque, braking))
            current = (torque - braking * speeds) / motor.motor_constant
        else:
            if np.any(conducts != 1.0):
                raise ModelError(
                    "a bridge that coasts is simulated for a rigid motor without inductance only; choose rigid-motor, "
                    "or leave out where it does (--mask)"
                )
            across = made[0] if motor.voltage_dead_zone is None else float(motor.voltage_dead_zone(made[:1])[0])
            start = State((across - motor.motor_constant * speed) / motor.resistance, speed, speed, 0.0, angle)
            pieces = _pieces(made, dt, late)
            whole = simulate(motor, *pieces, disturbance=self.load_torque, initial=start, method=LONG_STEPS)
            every = slice(None, None, 2 if 0 < late < 1 else 1)
            speeds, positions, current = whole.load_speed[every], whole.load_angle[every], whole.current[every]
            rotor_speeds, rotor_positions = whole.rotor_speed[every], whole.rotor_angle[every]
        first = float(state[2] if len(state) > 2 else state[0])
        shown = {
            Signal.SPEED: lambda: self.sensor.speed(speeds, positions, dt, first),
            Signal.POSITION: lambda: self.sensor.position(positions, dt, first),
            Signal.ROTOR_SPEED: lambda: self.sensor.speed(rotor_speeds, rotor_positions, dt, first),
            Signal.CURRENT: lambda: current,
        }
        return np.column_stack([shown[signal]() for signal in signals])

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
        zone = m.voltage_dead_zone or DeadZone(0.0, 0.0)
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


_AXIS_HANDLES = {
    **handles_of((), "mass", "M", "kg", "moving mass"),
    **handles_of((), "viscous_friction", "F_v", "N*s/m", "viscous friction"),
    **handles_of((), "friction.coulomb", "F_c", "N", "Coulomb level"),
    **handles_of((), "friction.stribeck", "F_s", "N", "Stribeck excess at standstill"),
    **handles_of((), "friction.stribeck_rate", "α₂", "s/m", "Stribeck rate"),
    "offset": Handle(Parameter("offset", "F₀", "N", "constant force against the motion"), ((("offset",), 1.0),)),
    **handles_of((), "dead_zone.b_l", "b_l", "N", "left break point of the dead zone on the force"),
    **handles_of((), "dead_zone.b_r", "b_r", "N", "right break point of the dead zone on the force"),
    **handles_of((), "dead_zone.m_l", "m_l", "1", "left slope of the dead zone on the force"),
    **handles_of((), "dead_zone.m_r", "m_r", "1", "right slope of the dead zone on the force"),
    **{
        name: handle
        for name, handle in outer_handles("N", "newtons", "m").items()
        if name not in ("drive.freewheel", "sensor.ratio")
    },
}


@dataclass(frozen=True)
class LinearAxis(Parametrised):
    """A mass on a guide: M·dv/dt = D_F(f) − F_v·v − T_f(v) − offset; input a force, output position or speed.

    An initial state is a speed in m/s and a position in m; after them may come the speed in m/s that a sensor with a
    lag shows at the start, by default the true one.

    Args:
        mass: in kg.
        viscous_friction: in N·s/m; a number, or a pair (forward, backward).
        friction: Coulomb and Stribeck friction (4.7), its levels in N and its rate in s/m.
        offset: constant force in N, such as gravity on an inclined axis.
        dead_zone: on the force, break points in N.
        drive: what makes the force from the command; its gain is in N per unit.
        sensor: what makes the log from the motion.
        steps: steps in a sample for the Stribeck excess.

    Raises:
        ModelError: for a value that is not physical.
    """

    mass: float = 1.0
    viscous_friction: float | tuple[float, float] = 1.0
    friction: Friction = Friction(0.1)  # noqa: RUF009
    offset: float = 0.0
    dead_zone: DeadZone | None = None
    drive: Drive = Drive()  # noqa: RUF009  (frozen)
    sensor: Sensor = Sensor()  # noqa: RUF009  (frozen)
    steps: int = 1

    def __post_init__(self) -> None:
        pair = self.viscous_friction
        pair = (float(pair[0]), float(pair[1])) if isinstance(pair, (tuple, list)) else (float(pair), float(pair))
        object.__setattr__(self, "viscous_friction", pair)
        if not (isfinite(self.mass) and self.mass > 0):
            raise ModelError(f"linear axis with a mass of {self.mass} kg; it must be positive")
        if not (min(pair) >= 0 and isfinite(max(pair))):
            raise ModelError(f"linear axis with viscous friction {pair}; it cannot be negative and must be finite")
        if not isfinite(self.offset):
            raise ModelError(f"linear axis with an offset of {self.offset} N; it must be finite")

    @property
    def name(self) -> str:
        """``linear-axis``."""
        return "linear-axis"

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Mass, frictions, offset, dead zone, drive and sensor."""
        return _AXIS_HANDLES

    @property
    def usual(self) -> tuple[str, ...]:
        """Mass, viscous and Coulomb friction, offset."""
        return ("mass", "viscous_friction", "friction.coulomb", "offset")

    @property
    def fine(self) -> frozenset[str]:
        """None."""
        return frozenset()

    @property
    def states(self) -> int:
        """Speed, position, and the speed that the sensor shows."""
        return 3

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The outputs (N, ny) for a command (N, 1), from a speed and a position."""
        force, _, late = self.drive.terminals(inputs, dt)
        if self.dead_zone is not None:
            force = self.dead_zone(force)
        levels = np.array([self.friction.forward, self.friction.backward])
        coulomb, excess, rate = np.ascontiguousarray(levels.T)
        friction = Sliding(coulomb, excess, rate, np.array(self.viscous_friction))
        speeds, positions = _one_mass(
            self.mass,
            friction,
            force - self.offset,
            np.zeros(len(force)),
            dt,
            late,
            self.steps,
            float(state[0]),
            float(state[1]),
        )
        first = float(state[2] if len(state) > 2 else state[0])
        shown = {
            Signal.SPEED: lambda: self.sensor.speed(speeds, positions, dt, first),
            Signal.POSITION: lambda: self.sensor.position(positions, dt, first),
        }
        missing = [signal.value for signal in signals if signal not in shown]
        if missing:
            raise ModelError(f"linear-axis has no {missing[0]} to compare with; it has position and speed")
        return np.column_stack([shown[signal]() for signal in signals])

    def put_motion(self, motion: Motion) -> Self:
        """The axis that moves like this: the mass follows from the gain, and the rest from the mass."""
        mass = max(self.drive.gain / motion.gain, TINY)
        zone = motion.dead_zone * abs(self.drive.gain)
        return replace(
            self,
            mass=mass,
            viscous_friction=max(mass * motion.damping, 0.0),
            friction=replace(self.friction, coulomb=mass * max(motion.coulomb, 0.0)),
            offset=mass * motion.offset,
            dead_zone=None if self.dead_zone is None else replace(self.dead_zone, b_l=-zone, b_r=zone),
        )

    def friction_torque(self, speed: Array) -> Array:
        """All friction with the viscous part, in N, at speeds in m/s."""
        forward, backward = self.viscous_friction  # type: ignore[misc]
        return np.asarray(self.friction.torque(speed) + np.where(speed < 0, backward, forward) * speed)

    def quantities(self) -> tuple[Quantity, ...]:
        """What is known even where the gain of the drive is not."""
        viscous, (level, _) = self.viscous_friction, self.friction.coulomb  # type: ignore[misc]
        return (
            Quantity("time constant", "M/F_v", "s", self.mass / max(float(np.mean(viscous)), TINY)),
            Quantity("acceleration per unit of command", "k_u/M", "m/s^2", self.drive.gain / self.mass),
            Quantity("Coulomb friction in units of command", "F_c/k_u", "1", level / self.drive.gain),
        )


def _together(rotor: Friction, load: Friction) -> Sliding:
    """The friction of both sides of a rigid motor; the rates are the rotor's where it has an excess."""
    a, b = (np.array([f.forward, f.backward]) for f in (rotor, load))
    rate = np.where(a[:, 1] > 0, a[:, 2], b[:, 2])
    return Sliding(a[:, 0] + b[:, 0], a[:, 1] + b[:, 1], rate, np.zeros(2))


def _one_mass(
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
    samples = len(force) - 1
    speeds, positions = np.empty(samples), np.empty(samples)
    steps = steps if friction.stribeck.any() else 1
    move(mass, friction, force, damping, dt, late, steps, speed, position, speeds, positions)
    return speeds, positions


def _pieces(voltage: Array, dt: float, late: float) -> tuple[Array, Array]:
    """Voltages and how long each is held: two to a sample where the delay ends within it."""
    if late <= 0:
        return voltage[1:], np.full(len(voltage) - 1, dt)
    if late >= 1:
        return voltage[:-1], np.full(len(voltage) - 1, dt)
    held = np.column_stack([voltage[:-1], voltage[1:]]).ravel()
    return held, np.tile([late * dt, (1 - late) * dt], len(voltage) - 1)


# --- plants as data -------------------------------------------------------------------------------------------------


def plant_to_data(plant: Plant) -> dict[str, Any]:
    """Kind and parameters in built-in types; infinite ones are left out, as are parts that are not there.

    Raises:
        ModelError: for a plant made of functions, which no file can hold.
    """
    if not isinstance(plant, (DrivenMotor, LinearAxis)):
        raise ModelError(f"{plant.name} is made of functions and cannot be saved; save its parameters instead")
    parameters = {
        name: plant.value(name)
        for name, handle in plant.handles.items()
        if len(handle.paths) == 1 and isfinite(plant.value(name))
    }
    zones = ("motor.voltage_dead_zone", "motor.torque_dead_zone") if isinstance(plant, DrivenMotor) else ("dead_zone",)
    for zone in zones:
        if _part(plant, zone) is None:
            parameters = {n: v for n, v in parameters.items() if not n.startswith(zone.removeprefix("motor.") + ".")}
    return {
        "kind": plant.name,
        "parameters": parameters,
        "codes": [[code, bridge.value] for code, bridge in plant.drive.codes],
        "feed": plant.feed.value if isinstance(plant, DrivenMotor) else Feed.VOLTAGE.value,
        "average": plant.sensor.average,
        "steps": plant.steps,
    }


def plant_from_data(data: Mapping[str, Any]) -> Plant:
    """The plant that `plant_to_data` described.

    Raises:
        ModelError: for data that describe none.
    """
    kinds: dict[str, Callable[[], DrivenMotor | LinearAxis]] = {
        "motor": lambda: DrivenMotor(Motor(voltage_dead_zone=None)),
        "rigid-motor": lambda: DrivenMotor(Motor(inductance=0.0, voltage_dead_zone=None).rigid()),
        "linear-axis": LinearAxis,
    }
    if data["kind"] not in kinds:
        raise ModelError(f"no plant of kind {data['kind']!r}; there are {', '.join(kinds)}")
    plain = kinds[data["kind"]]()
    if isinstance(plain, DrivenMotor):
        plain = replace(plain, feed=Feed(data.get("feed", Feed.VOLTAGE.value)))
    codes = tuple((float(code), Bridge(bridge)) for code, bridge in data["codes"])
    plain = replace(
        plain,
        drive=replace(plain.drive, codes=codes),
        sensor=Sensor(average=bool(data["average"])),
        steps=data["steps"],
    )
    parameters = dict(data["parameters"])
    late = {name: parameters.pop(name) for name in ("drive.freewheel",) if name in parameters}  # needs the supply
    return plain.put(parameters).put(late)


def _part(plant: Plant, path: str) -> Any:
    part: Any = plant
    for step in path.split("."):
        part = getattr(part, step)
    return part
