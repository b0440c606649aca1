"""Plants that the grey box fits: the motor of section IV, a linear axis, and whatever a user writes down.

A plant is a frozen value with named physical parameters that can simulate itself. The motor is (4.1)–(4.11) with what
real logs put in front of it and behind it; its rigid form without inductance is one mass, and so is a linear axis:

    motor       M = J_m + J_L,   F = (K_m/R_a)·c·D_v(v) − T_d,    D = c·K_m²/R_a + B_m + B_L
    linear axis M = mass,        F = D_F(f) − offset,              D = viscous friction

so that one fast loop, `emsid.models.one_mass`, moves both, and `emsid.plant.simulate` the general motor.

**The drive** makes the voltage (or force) from the command: v = gain·(u(t − delay) + offset), limited by the supply.
Beyond a knee the command may count more: a bridge loses a part of every period to switching, and gets it back near full
duty, where it no longer switches.
A bridge that leaves the armature open in the off-time of its PWM brakes only while it conducts. With ρ = |v|/supply
the duty and λ how far it does so, the armature conducts during

    c = 1 − λ·(1 − ρ)

of a period, with ±supply across it: its mean torque is K_m/R_a·(v − c·K_m·ω) for λ = 1 as for λ = 0, while the back
electromotive force counts for less the smaller the duty is. Codes among the commands stand for a bridge that brakes
(c = 1, v = 0) or coasts (c = 0).

**The sensor** may lag (first order), be off by a constant, count on the other side of a gear, or average over the
sample before it, as counting encoder edges does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from math import inf, isfinite
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.models.one_mass import Sliding, move
from emsid.plant import DeadZone, Friction, Motor, State, simulate
from emsid.plant.motor import Parameter

Array = NDArray[np.float64]


class Signal(Enum):
    """What a channel of a record measures."""

    SPEED = "speed"
    POSITION = "position"
    CURRENT = "current"
    ROTOR_SPEED = "rotor speed"


class Bridge(Enum):
    """What a code among the commands tells the bridge to do."""

    BRAKE = "brake"
    COAST = "coast"


class Handle(NamedTuple):
    """A parameter of a plant: what it is, where it is kept and what it may be.

    Attributes:
        parameter: name, symbol, SI unit and meaning.
        paths: where in the plant the value is kept, each with a sign; a parameter for both directions has two places.
        lower, upper: what is physical.
    """

    parameter: Parameter
    paths: tuple[tuple[tuple[str | int, ...], float], ...]
    lower: float = -inf
    upper: float = inf

    def with_unit(self, value: float, digits: int = 4) -> str:
        """A value of it as text."""
        unit = self.parameter.unit
        return f"{value:.{digits}g}" if unit == "1" else f"{value:.{digits}g} {unit}"

    @property
    def allowed(self) -> str:
        """The bounds in words."""
        if self.upper < inf:
            return f"it must be from {self.lower:g} to {self.upper:g} and finite"
        if self.lower == -inf:
            return "it must be finite"
        return "it must be positive and finite" if self.lower > 0 else "it cannot be negative and must be finite"


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


class Quantity(NamedTuple):
    """A combination of parameters that has a meaning of its own."""

    name: str
    formula: str
    unit: str
    value: float


class Plant(Protocol):
    """Anything the grey box can fit: a value with named parameters that simulates itself."""

    @property
    def name(self) -> str:
        """What it is called in tables and files."""
        ...

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Every parameter by name."""
        ...

    @property
    def usual(self) -> tuple[str, ...]:
        """The parameters that are estimated where nothing else is said, those first that should rather be held."""
        ...

    @property
    def fine(self) -> frozenset[str]:
        """Parameters that matter only once the others are about right: they join the search later."""
        ...

    @property
    def states(self) -> int:
        """How many numbers an initial state has."""
        ...

    def value(self, name: str) -> float:
        """The value of a parameter in SI units."""
        ...

    def put(self, values: Mapping[str, float]) -> Self:
        """The plant with other parameters."""
        ...

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu) held over ``dt`` seconds, from an initial state."""
        ...

    def quantities(self) -> tuple[Quantity, ...]:
        """Combinations of parameters with a meaning of their own, which records may tell where the parameters hide."""
        ...


# --- parameters in nested values ------------------------------------------------------------------------------------


def _get(thing: Any, path: tuple[str | int, ...]) -> float:
    for step in path:
        if thing is None:
            return 0.0 if path[-1] in ("b_l", "b_r") else 1.0  # of a dead zone that is not there
        thing = thing[step] if isinstance(step, int) else getattr(thing, step)
    return float(thing)


def _set(thing: Any, path: tuple[str | int, ...], value: float) -> Any:
    step, *rest = path
    if isinstance(step, int):
        return tuple(value if k == step else kept for k, kept in enumerate(thing))
    if thing is None:
        thing = DeadZone(0.0, 0.0)
    return replace(thing, **{step: _set(getattr(thing, step), tuple(rest), value) if rest else value})


@dataclass(frozen=True)
class _Parametrised:
    """What every plant made of nested dataclasses shares: parameters read and written by name."""

    def value(self, name: str) -> float:
        """The value of a parameter in SI units; of one for both directions, the forward one."""
        path, sign = self._handle(name).paths[0]
        return sign * _get(self, path)

    def put(self, values: Mapping[str, float]) -> Self:
        """The same plant with other parameters, by name, in SI units.

        Raises:
            ModelError: for a name it does not have or a value that is not physical.
        """
        plant = self
        for name, value in values.items():
            for path, sign in self._handle(name).paths:
                plant = _set(plant, path, sign * float(value))
        return plant

    def _handle(self, name: str) -> Handle:
        return find_handle(self, name)  # type: ignore[arg-type]


def find_handle(plant: Plant, name: str) -> Handle:
    """The handle of a parameter.

    Raises:
        ModelError: where the plant has no parameter of that name; the message says which it has.
    """
    if name not in plant.handles:
        raise ModelError(f"{plant.name} has no parameter {name!r}; it has {', '.join(plant.handles)}")
    return plant.handles[name]


def refuse_overlap(plant: Plant, names: Iterable[str]) -> None:
    """Refuse names that stand for the same value of a plant, such as a level for both directions and the forward one.

    Raises:
        ModelError: that names the two.
    """
    places: dict[tuple[str | int, ...], str] = {}
    for name in names:
        for path, _ in find_handle(plant, name).paths:
            if path in places:
                raise ModelError(f"{places[path]} and {name} are the same thing in part; choose one of them")
            places[path] = name


def parts(plant: Plant, name: str) -> tuple[str, ...]:
    """The names of the values that a parameter moves together, such as its two directions; none for a single value."""
    paths = [path for path, _ in find_handle(plant, name).paths]
    if len(paths) == 1:
        return ()
    return tuple(one for one, handle in plant.handles.items() if len(handle.paths) == 1 and handle.paths[0][0] in paths)


def without_overlap(plant: Plant, names: Iterable[str], taken: Iterable[str]) -> tuple[str, ...]:
    """The names, less what is taken; where one value of a name is taken or named itself, its other values are left.

    Raises:
        ModelError: for a name that the plant does not have.
    """
    wanted, spoken_for = tuple(dict.fromkeys(names)), set(taken)
    gone = spoken_for.union(*(parts(plant, name) for name in spoken_for))
    left: list[str] = []
    for name in wanted:
        sides = parts(plant, name)
        if any(side in gone or side in wanted for side in sides):
            left += [side for side in sides if side not in gone and side not in wanted]
        elif name not in gone:
            left.append(name)
    return tuple(left)


_POSITIVE = {"resistance", "motor_constant", "rotor_inertia", "load_inertia", "shaft_stiffness", "mass"}
_TINY = 1e-12  # a positive parameter may get as small as this


def _leaf(prefix: tuple[str, ...], name: str, symbol: str, unit: str, description: str) -> dict[str, Handle]:
    """The handles of a scalar, or those of a pair and of a dead zone, which can be moved together or side by side."""
    path: tuple[str | int, ...] = (*prefix, *name.split("."))
    part, last = path[-2] if len(path) > 1 else "", path[-1]
    parameter = Parameter(name, symbol, unit, description)
    if last in ("b_l", "b_r"):
        side = (-inf, 0.0) if last == "b_l" else (0.0, inf)
        handles = {name: Handle(parameter, ((path, 1.0),), *side)}
        if last == "b_r":
            both = parameter._replace(
                name=name.replace("b_r", "half_width"),
                symbol="b",
                description=description.replace("right break point", "half the width"),
            )
            handles[both.name] = Handle(both, ((path, 1.0), ((*path[:-1], "b_l"), -1.0)), 0.0)
        return handles
    if "friction" in str(part) or last == "viscous_friction":
        handles = {name: Handle(parameter, (((*path, 0), 1.0), ((*path, 1), 1.0)), 0.0)}
        for k, side_name in enumerate(("forward", "backward")):
            one = parameter._replace(
                name=f"{name}.{side_name}",
                symbol=f"{symbol}{'⁺⁻'[k]}",
                description=f"{description}, {side_name}",
            )
            handles[one.name] = Handle(one, (((*path, k), 1.0),), 0.0)
        return handles
    lower = _TINY if last in _POSITIVE or last in ("m_l", "m_r") else 0.0
    return {name: Handle(parameter, ((path, 1.0),), lower)}


@dataclass(frozen=True)
class Drive:
    """What is between the command in a log and the terminals of the motor (or the force on an axis).

    Args:
        gain: volts (newtons) per unit of command.
        offset: what is added to the command, in its unit.
        supply: the largest voltage (force) there is, in V (N); infinite for no limit.
        delay: from the command to the terminals, in s.
        knee: voltage (force) above which the command counts differently, in V (N); infinite for none.
        beyond: how many times more it counts there.
        freewheel: λ, 0 for a bridge that always conducts and 1 for one that leaves the armature open in the off-time.
        codes: commands that are none: pairs of a value and what the bridge then does.

    Raises:
        ModelError: for a value that is not physical, or a bridge that coasts without a supply voltage.
    """

    gain: float = 1.0
    offset: float = 0.0
    supply: float = inf
    delay: float = 0.0
    knee: float = inf
    beyond: float = 1.0
    freewheel: float = 0.0
    codes: tuple[tuple[float, Bridge], ...] = ()

    def __post_init__(self) -> None:
        if not (isfinite(self.gain) and self.gain != 0 and isfinite(self.offset)):
            raise ModelError(f"drive with gain {self.gain} and offset {self.offset}; give finite ones, the gain not 0")
        if not (isfinite(self.delay) and self.delay >= 0):
            raise ModelError(f"drive with a delay of {self.delay} s; it cannot be negative and must be finite")
        if not self.supply > 0:
            raise ModelError(f"drive with a supply of {self.supply} V; it must be positive")
        if not (self.knee > 0 and isfinite(self.beyond) and self.beyond >= 0):
            raise ModelError(
                f"drive with a knee at {self.knee} V and {self.beyond} times beyond; the first must be positive, the "
                "second not negative and finite"
            )
        if not 0 <= self.freewheel <= 1:
            raise ModelError(f"drive with freewheel {self.freewheel}; give 0 (always conducts) to 1 (open when off)")
        if self.freewheel > 0 and not isfinite(self.supply):
            raise ModelError("a bridge that coasts in its off-time needs its supply voltage: give drive.supply")

    def terminals(self, command: Array, dt: float) -> tuple[Array, Array, float]:
        """Voltage (N + 1,) and conducting part (N + 1,) of every sample, and the part of a sample they come late by.

        The first value is what acted before the first sample; a command is taken to have stood there for ever.
        """
        wanted = self.gain * (command + self.offset)
        extra = wanted - np.clip(wanted, -self.knee, self.knee)
        voltage = np.clip(wanted + (self.beyond - 1.0) * extra, -self.supply, self.supply)
        duty = np.abs(voltage) / self.supply if isfinite(self.supply) else 1.0
        conducts = np.broadcast_to(1.0 - self.freewheel * (1.0 - duty), voltage.shape)
        for code, bridge in self.codes:
            here = command == code
            voltage = np.where(here, 0.0, voltage)
            conducts = np.where(here, 1.0 if bridge is Bridge.BRAKE else 0.0, conducts)
        samples = self.delay / dt
        whole = min(int(samples), len(command))
        return _shifted(voltage, whole), _shifted(np.asarray(conducts), whole), min(samples - whole, 1.0)


def _shifted(values: Array, by: int) -> Array:
    """(N + 1,) values that come ``by`` samples later, begun with what came before them."""
    return np.concatenate([np.full(by + 1, values[0]), values[: len(values) - by]])


@dataclass(frozen=True)
class Sensor:
    """What is between the motion and the log.

    Args:
        ratio: turns of the motor per turn of what is measured.
        lag: time constant of its filter in s.
        offset: what it shows at rest, in the unit of the output; not applied to a current.
        average: whether a speed is the mean over the sample before, as counting encoder edges gives it.

    Raises:
        ModelError: for a ratio of zero or a lag that is negative.
    """

    ratio: float = 1.0
    lag: float = 0.0
    offset: float = 0.0
    average: bool = False

    def __post_init__(self) -> None:
        if not (isfinite(self.ratio) and self.ratio != 0 and isfinite(self.offset)):
            raise ModelError(
                f"sensor with ratio {self.ratio} and offset {self.offset}; give finite ones, the ratio not 0"
            )
        if not (isfinite(self.lag) and self.lag >= 0):
            raise ModelError(f"sensor with a lag of {self.lag} s; it cannot be negative and must be finite")

    def speed(self, speeds: Array, positions: Array, dt: float) -> Array:
        """(N,) what it shows of a speed."""
        seen = speeds
        if self.average:
            seen = np.concatenate([speeds[:1], np.diff(positions) / dt])
        return self._lagging(seen, dt) / self.ratio + self.offset

    def position(self, positions: Array, dt: float) -> Array:
        """(N,) what it shows of a position."""
        return self._lagging(positions, dt) / self.ratio + self.offset

    def _lagging(self, values: Array, dt: float) -> Array:
        """Through 1/(1 + lag·s), the value taken to be a straight line between samples, and settled at the start."""
        if self.lag < 1e-6 * dt:
            return values
        from scipy.signal import lfilter

        z = dt / self.lag
        decay, gain = np.exp(-z), -np.expm1(-z) / z
        newest, before = 1.0 - gain, gain - decay
        start = values[0] * (decay + before)
        lagging: Array = lfilter([newest, before], [1.0, -decay], values, zi=[start])[0]
        return lagging


def _outside(volt: str, volts: str, motion: str) -> dict[str, Handle]:
    """The handles of drive and sensor, given what the drive makes (unit and word) and what the sensor shows."""
    return {
        **_leaf((), "drive.gain", "k_u", volt, f"{volts} per unit of command"),
        "drive.offset": Handle(
            Parameter("drive.offset", "u₀", "1", "offset of the command, in its unit"), ((("drive", "offset"), 1.0),)
        ),
        **_leaf((), "drive.delay", "t_d", "s", "delay from the command to what it does"),
        "drive.supply": Handle(
            Parameter("drive.supply", "V_s", volt, f"most {volts} that there are"), ((("drive", "supply"), 1.0),), _TINY
        ),
        "drive.knee": Handle(
            Parameter("drive.knee", "V_k", volt, f"{volts} above which the command counts differently"),
            ((("drive", "knee"), 1.0),),
            _TINY,
        ),
        **_leaf((), "drive.beyond", "γ", "1", "how many times more the command counts beyond the knee"),
        "drive.freewheel": Handle(
            Parameter("drive.freewheel", "λ", "1", "how far the bridge coasts in its off-time"),
            ((("drive", "freewheel"), 1.0),),
            0.0,
            1.0,
        ),
        **_leaf((), "sensor.lag", "t_s", "s", "time constant of the sensor"),
        "sensor.offset": Handle(
            Parameter("sensor.offset", "y₀", motion, "what the sensor shows at rest"), ((("sensor", "offset"), 1.0),)
        ),
        "sensor.ratio": Handle(
            Parameter("sensor.ratio", "n", "1", "turns of the motor per turn measured"), ((("sensor", "ratio"), 1.0),)
        ),
    }


_MOTOR_HANDLES = {
    name: handle
    for p in Motor.parameters()
    for name, handle in _leaf(("motor",), p.name, p.symbol, p.unit, p.description).items()
} | {
    "load_torque": Handle(
        Parameter("load_torque", "T_d", "N*m", "constant torque on the load"), ((("load_torque",), 1.0),)
    ),
    **_outside("V", "volts", "rad/s"),
}


_RIGID_HANDLES = {name: handle for name, handle in _MOTOR_HANDLES.items() if not name.startswith("shaft_")}


@dataclass(frozen=True)
class DrivenMotor(_Parametrised):
    """The motor (4.1)–(4.11) with its drive and its sensor; input a command, outputs speed, position or current.

    An initial state is a speed in rad/s and an angle in rad, of rotor and load alike, the current settled.

    Args:
        motor: the motor; `Motor.rigid` with no inductance is by far the fastest.
        drive: what makes the voltage from the command.
        sensor: what makes the log from the motion.
        load_torque: constant torque T_d on the load in N·m.
        steps: steps in a sample for the Stribeck excess of a rigid motor.
    """

    motor: Motor = field(default_factory=Motor)
    drive: Drive = Drive()
    sensor: Sensor = Sensor()
    load_torque: float = 0.0
    steps: int = 2

    @property
    def name(self) -> str:
        """``rigid-motor`` or ``motor``."""
        return "rigid-motor" if self.motor.is_rigid else "motor"

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Those of `Motor.parameters` by their names there, then load torque, drive and sensor."""
        return _RIGID_HANDLES if self.motor.is_rigid else _MOTOR_HANDLES

    @property
    def usual(self) -> tuple[str, ...]:
        """Electrical constants, inertia, viscous and Coulomb friction, dead zone; with a shaft, that and the load."""
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
        """Speed and angle."""
        return 2

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The outputs (N, ny) for a command (N, 1), from a speed and an angle."""
        voltage, conducts, late = self.drive.terminals(_only(inputs), dt)
        motor, speed, angle = self.motor, float(state[0]), float(state[1])
        armature = voltage if motor.voltage_dead_zone is None else motor.voltage_dead_zone(voltage)
        if motor.is_rigid and motor.inductance == 0 and motor.torque_dead_zone is None:
            slope = motor.motor_constant / motor.resistance
            friction = _together(motor.rotor_friction, motor.load_friction)
            speeds, positions = _one_mass(
                motor.rotor_inertia + motor.load_inertia,
                friction,
                slope * armature - self.load_torque,
                slope * motor.motor_constant * conducts + (motor.rotor_viscous + motor.load_viscous),
                dt,
                late,
                self.steps,
                speed,
                angle,
            )
            rotor_speeds, rotor_positions = speeds, positions
            mean = late * conducts[:-1] + (1 - late) * conducts[1:]
            volts = late * armature[:-1] + (1 - late) * armature[1:]
            current = (volts - mean * motor.motor_constant * speeds) / motor.resistance
        else:
            if np.any(conducts != 1.0):
                raise ModelError("a bridge that coasts is simulated for a rigid motor without inductance only")
            start = State((armature[0] - motor.motor_constant * speed) / motor.resistance, speed, speed, 0.0, angle)
            whole = simulate(motor, *_pieces(voltage, dt, late), disturbance=self.load_torque, initial=start)
            every = slice(None, None, 2 if 0 < late < 1 else 1)
            speeds, positions, current = whole.load_speed[every], whole.load_angle[every], whole.current[every]
            rotor_speeds, rotor_positions = whole.rotor_speed[every], whole.rotor_angle[every]
        shown = {
            Signal.SPEED: lambda: self.sensor.speed(speeds, positions, dt),
            Signal.POSITION: lambda: self.sensor.position(positions, dt),
            Signal.ROTOR_SPEED: lambda: self.sensor.speed(rotor_speeds, rotor_positions, dt),
            Signal.CURRENT: lambda: current,
        }
        return np.column_stack([shown[signal]() for signal in signals])

    def put_motion(self, motion: Motion) -> Self:
        """The motor that moves like one mass, resistance, viscous friction and the ratio of inertias kept.

        With R_a given, K_m follows from the damping, J from K_m and the gain, and the friction from J.
        """
        motor = self.motor
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
        """What voltage and speed alone can tell of a motor."""
        m = self.motor
        r, k = m.resistance, m.motor_constant
        inertia, viscous = m.rotor_inertia + m.load_inertia, m.rotor_viscous + m.load_viscous
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
    **_leaf((), "mass", "M", "kg", "moving mass"),
    **_leaf((), "viscous_friction", "F_v", "N*s/m", "viscous friction"),
    **_leaf((), "friction.coulomb", "F_c", "N", "Coulomb level"),
    **_leaf((), "friction.stribeck", "F_s", "N", "Stribeck excess at standstill"),
    **_leaf((), "friction.stribeck_rate", "α₂", "s/m", "Stribeck rate"),
    "offset": Handle(Parameter("offset", "F₀", "N", "constant force against the motion"), ((("offset",), 1.0),)),
    **_leaf((), "dead_zone.b_l", "b_l", "N", "left break point of the dead zone on the force"),
    **_leaf((), "dead_zone.b_r", "b_r", "N", "right break point of the dead zone on the force"),
    **_leaf((), "dead_zone.m_l", "m_l", "1", "left slope of the dead zone on the force"),
    **_leaf((), "dead_zone.m_r", "m_r", "1", "right slope of the dead zone on the force"),
    **{
        name: handle
        for name, handle in _outside("N", "newtons", "m").items()
        if name not in ("drive.freewheel", "sensor.ratio")
    },
}


@dataclass(frozen=True)
class LinearAxis(_Parametrised):
    """A mass on a guide: M·dv/dt = D_F(f) − F_v·v − T_f(v) − offset; input a force, output position or speed.

    An initial state is a speed in m/s and a position in m.

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
    drive: Drive = Drive()
    sensor: Sensor = Sensor()
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
        """Speed and position."""
        return 2

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The outputs (N, ny) for a command (N, 1), from a speed and a position."""
        force, _, late = self.drive.terminals(_only(inputs), dt)
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
        shown = {
            Signal.SPEED: lambda: self.sensor.speed(speeds, positions, dt),
            Signal.POSITION: lambda: self.sensor.position(positions, dt),
        }
        missing = [signal.value for signal in signals if signal not in shown]
        if missing:
            raise ModelError(f"linear-axis has no {missing[0]} to compare with; it has position and speed")
        return np.column_stack([shown[signal]() for signal in signals])

    def put_motion(self, motion: Motion) -> Self:
        """The axis that moves like this: the mass follows from the gain, and the rest from the mass."""
        mass = max(self.drive.gain / motion.gain, _TINY)
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
            Quantity("time constant", "M/F_v", "s", self.mass / max(float(np.mean(viscous)), _TINY)),
            Quantity("acceleration per command", "k_u/M", "m/(V*s^2)", self.drive.gain / self.mass),
            Quantity("Coulomb command", "F_c/k_u", "V", level / self.drive.gain),
        )


Derivative = Callable[[Array, Array, Array], Sequence[float] | Array]


@dataclass(frozen=True)
class OwnPlant:
    """A plant of the user's: dx/dt = derivative(x, u, p), y = output(x, u, p).

    Classical Runge–Kutta steps take it through every sample. Functions compiled with ``numba.njit`` run in a compiled
    loop; they then have to return arrays.

    Args:
        derivative: of the state (n,), given state, input (nu,) held over the sample and parameters (p,).
        output: (ny,) of the same.
        table: the parameters, in the order in which the functions get them.
        values: (p,) their values.
        states: n.
        bounds: (lower, upper) for every parameter that has bounds, by name.
        steps: Runge–Kutta steps in a sample.
        name: what it is called in tables.
    """

    derivative: Derivative
    output: Derivative
    table: tuple[Parameter, ...]
    values: tuple[float, ...]
    states: int
    bounds: tuple[tuple[str, float, float], ...] = ()
    steps: int = 1
    name: str = "plant"

    def __post_init__(self) -> None:
        if len(self.values) != len(self.table):
            raise ModelError(f"{self.name}: {len(self.values)} values for {len(self.table)} parameters")

    @property
    def handles(self) -> Mapping[str, Handle]:
        """One for every row of the table."""
        limits = {name: (lower, upper) for name, lower, upper in self.bounds}
        return {
            p.name: Handle(p, ((("values", k), 1.0),), *limits.get(p.name, (-inf, inf)))
            for k, p in enumerate(self.table)
        }

    @property
    def usual(self) -> tuple[str, ...]:
        """All of them."""
        return tuple(p.name for p in self.table)

    @property
    def fine(self) -> frozenset[str]:
        """None that emsid would know of."""
        return frozenset()

    def value(self, name: str) -> float:
        """The value of a parameter."""
        return _get(self, find_handle(self, name).paths[0][0])

    def put(self, values: Mapping[str, float]) -> Self:
        """The plant with other parameters."""
        plant = self
        for name, value in values.items():
            plant = _set(plant, find_handle(self, name).paths[0][0], float(value))
        return plant

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The outputs (N, ny) for inputs (N, nu), from an initial state (n,); its outputs need no signal."""
        parameters = np.array(self.values)
        compiled = hasattr(self.derivative, "py_func") and hasattr(self.output, "py_func")
        loop = _compiled_runge_kutta if compiled else _runge_kutta
        out: Array = loop(
            self.derivative,
            self.output,
            np.ascontiguousarray(inputs),
            parameters,
            np.array(state, dtype=float),
            dt,
            self.steps,
        )
        return out

    def quantities(self) -> tuple[Quantity, ...]:
        """None that emsid would know of."""
        return ()


def _runge_kutta(f: Any, g: Any, inputs: Array, p: Array, start: Array, dt: float, steps: int) -> Array:
    x = start.copy()
    first = np.asarray(g(x, inputs[0], p))
    out = np.empty((len(inputs), len(first)))
    h = dt / steps
    for k in range(len(inputs)):
        u = inputs[k]
        out[k] = np.asarray(g(x, u, p))
        for _ in range(steps):
            k1 = np.asarray(f(x, u, p))
            k2 = np.asarray(f(x + 0.5 * h * k1, u, p))
            k3 = np.asarray(f(x + 0.5 * h * k2, u, p))
            k4 = np.asarray(f(x + h * k3, u, p))
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out


_compiled_runge_kutta = njit(nogil=True)(_runge_kutta)


def _only(inputs: Array) -> Array:
    if inputs.shape[1] != 1:
        raise DataError(f"{inputs.shape[1]} inputs for a plant with one; name the column that is the command")
    return inputs[:, 0]


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
