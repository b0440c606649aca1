"""The motor of section IV as a plant, with a drive and a sensor.

`emsid.plant.simulate` simulates the general motor. Its rigid form without inductance is one mass,

    M = J_m + J_L,   F = (K_m/R_a)·c·D_v(v) − T_d,   D = c·K_m²/R_a + B_m + B_L,

which the fast loop of `one_mass` simulates.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import copysign, inf
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import Estimate
from emsid.findings import Finding
from emsid.models.linear_parts import StateSpace
from emsid.models.plants.characteristics import dead_zone_over_command, friction_over_speed
from emsid.models.plants.cogging import Cogging, extra_terms, without_idle
from emsid.models.plants.drive import Drive, Feed
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.effects import (
    NEUTRAL,
    OF_ONE_MASS,
    ON_RESISTANCE,
    Effects,
    acting,
    acts_on_resistance,
    as_left,
    beside_nothing,
    check_effects,
    equation_of_rise,
    with_rows,
)
from emsid.models.plants.gravity import CONSTANTS, Gravity
from emsid.models.plants.lost_motion import apart, begun, check_gap, first_gap
from emsid.models.plants.motor_equations import LOST, WEIGHT, equations, linear_motor, of_joint, quantities, together
from emsid.models.plants.motor_handles import RADIUS, USUAL_RADIUS, ZONES, feed_in, motor_channels, motor_handles
from emsid.models.plants.motor_motion import in_steady_state, without_shaft
from emsid.models.plants.motor_start import at_motor, by_torque, check_one_mass, hung, usual_free, with_motion
from emsid.models.plants.one_mass import NO_WAVES, Motion, Sliding, check_steps
from emsid.models.plants.parameters import TINY, Handle, Signal
from emsid.models.plants.plant import Channels, Limits, Plant, Quantity, Sizes, StaticCharacteristic, plausible
from emsid.models.plants.sampling import DrivenSampler, Inside, Outer, motor_sampler, one_mass_sampler
from emsid.models.plants.sensor import Sensor
from emsid.models.plants.servo import NO_SERVO, SERVO, SERVO_STEPS, Servo
from emsid.models.plants.state import RISE, PlantState
from emsid.plant import FrictionLaw, Measure, Motor
from emsid.plant.constants import Extra

if TYPE_CHECKING:
    from emsid.record import Record

Array = NDArray[np.float64]
HALVINGS = 60
"""Halvings of a turn, to the last digit of an angle."""

QUICKEST = 0.02
"""The shortest electrical time constant in samples. A current that is sampled where the voltage steps still shows 0.04;
one of 0.01 takes so many steps that a search with it takes ten times as long."""


@dataclass(frozen=True)
class MotorPlant(DrivenPlant, Effects):
    """The motor (4.1)–(4.11) with its drive and its sensor; input a command, outputs speed, position or current.

    An initial state is a speed in rad/s and an angle in rad, equal for rotor and load, with the current in steady
    state, and optionally the initial reading in rad/s of a sensor with a lag, by default the true speed.

    Args:
        motor: the motor; `Motor.rigid` is by far the fastest.
        drive: converts the command to a voltage.
        sensor: between the motion and the log.
        load_torque: constant torque T_d on the load in N·m.
        steps: steps per sample for the Stribeck excess of a rigid motor.
        feed: the output of the drive; with a current or a torque, a rigid motor has no back electromotive force.
        cogging: torque over the angle of the rotor, in N·m and rad.
        gravity: the arm that a rigid motor moves as a joint; None for a motor.
        servo: the controller of a joint, for target positions; by default one with a gain of one.
        backlash: of a joint, the angle in rad that its motor crosses alone between the two flanks of its load.
        effects: by name, see `Effects`.

    Raises:
        ModelError: for a motor with an elastic shaft that is fed with anything but a voltage, or that has gravity, and
            for effects that are simulated for one mass only.
    """

    load_unit: ClassVar[str] = "N*m"
    motor: Motor = field(default_factory=Motor)
    drive: Drive = Drive()  # noqa: RUF009  (frozen)
    sensor: Sensor = Sensor()  # noqa: RUF009  (frozen)
    load_torque: float = 0.0
    steps: int = 2
    feed: Feed = Feed.VOLTAGE
    cogging: Cogging = Cogging()  # noqa: RUF009  (frozen)
    gravity: Gravity | None = None
    servo: Servo | None = None
    backlash: float = 0.0

    def __post_init__(self) -> None:
        check_effects(self.name, self)
        check_steps(self.name, self.steps)
        if self.gravity is not None and self.servo is None:
            object.__setattr__(self, "servo", Servo())
        check_gap(self)
        check_one_mass(self)

    @property
    def name(self) -> str:
        """``joint``, ``rigid-motor`` or ``motor``."""
        return "joint" if self.gravity is not None else "rigid-motor" if self.motor.is_rigid else "motor"

    @property
    def handles(self) -> Mapping[str, Handle]:
        """The handles of `Motor.parameters` by name, then load torque, drive and sensor."""
        motor = self.motor
        laws = type(motor.rotor_friction), type(motor.load_friction)
        return motor_handles(motor.is_rigid, self.feed, *laws, self.gravity is not None, self.sensor.reads_a_wheel)

    @property
    def default_free(self) -> tuple[str, ...]:
        """Electrical constants, inertia and Coulomb friction, the gravity of a joint, shaft and load if not rigid.

        Viscous friction, an inductance and a dead zone are included where the motor has them; viscous friction always
        with a current or a torque as input.
        """
        return usual_free(self.motor, self.feed, self._level, self.gravity is not None)

    @property
    def _level(self) -> str:
        """The name of its friction level."""
        return f"rotor_friction.{self.motor.rotor_friction.parameters[0].name}"

    @property
    def secondary(self) -> frozenset[str]:
        """The parameters of the shaft and the inductance, if the shaft is elastic."""
        late = ("shaft_stiffness", "shaft_damping", "load_inertia", "inductance")
        return frozenset() if self.motor.is_rigid else frozenset(late)

    @property
    def body(self) -> str:
        """``motor``, or ``joint``."""
        return "motor" if self.gravity is None else "joint"

    @property
    def channels(self) -> Channels:
        """Speed, position and current, for a voltage, current or torque."""
        load = self.load_unit if self.drive.loaded else ""
        return motor_channels(self.feed, self.sensor.reads_a_wheel, self.gravity is not None, self.drive.codes, load)

    def measured_by(self, known: Mapping[str, float], asked: Collection[str] = ()) -> Self:
        """The motor with the radius of a wheel that is known, or with a usual one where it is estimated."""
        radius = known.get(
            RADIUS, USUAL_RADIUS if RADIUS in asked and not self.sensor.reads_a_wheel else self.sensor.radius
        )
        return self if radius == self.sensor.radius else self.with_values({RADIUS: radius})

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """The friction on the rotor and on the load."""
        return {"rotor_friction": self.motor.rotor_friction, "load_friction": self.motor.load_friction}

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The motor with other friction laws, by name."""
        return replace(self, motor=replace(self.motor, **dict(laws)))  # type: ignore[arg-type]

    @property
    def friction_name(self) -> str:
        """``rotor_friction``."""
        return "rotor_friction"

    @property
    def load_name(self) -> str:
        """``load_torque``."""
        return "load_torque"

    @property
    def can_coast(self) -> bool:
        """True for one mass driven by a voltage."""
        return self.motor.is_rigid and self.feed is Feed.VOLTAGE

    def force_scale(self, command: float, output: float) -> float:
        """For a voltage, the scale that keeps the resistance."""
        return command**2 / output if self.feed is Feed.VOLTAGE else command

    @property
    def follows(self) -> bool:
        """Whether it is fed with target positions."""
        return self.feed is Feed.POSITION

    def commanded(self, segment: Record, position: Array, speed: Array) -> Array:
        """See `DrivenPlant.commanded`; that of a servo is its torque, per gain, where the joint is."""
        made, servo = super().commanded(segment, position, speed), self.servo
        return (
            made
            if servo is None or not self.follows
            else servo.torque(self.drive.gain * made, position, speed) / servo.proportional
        )

    @property
    def torque_per_unit(self) -> float:
        """The torque at rest per unit of the output of the drive."""
        motor = self.motor
        if self.servo is not None and self.follows:
            return self.servo.proportional / self.sensor.ratio
        if self.feed is Feed.VOLTAGE:
            return motor.motor_constant / self.warm().resistance
        return motor.motor_constant if self.feed is Feed.CURRENT else 1.0

    def largest_force(self, inputs: Array) -> float:
        """The torque at rest."""
        return self.torque_per_unit * self.drive.largest(inputs)

    def with_starts(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """See `DrivenPlant.with_starts`; a load that is estimated begins with the inertia of the rotor, a backlash with
        what the angle shows."""
        plant = super().with_starts(asked, segments, limits)
        if "backlash" in asked and not self.backlash:
            plant = plant.with_values({"backlash": float(np.clip(first_gap(segments), *limits["backlash"]))})
        if "load_inertia" not in asked or self.motor.load_inertia > TINY:
            return plant
        return plant.with_values({"load_inertia": plant.value("rotor_inertia")})

    @property
    def absent(self) -> tuple[str, ...]:
        """The inductance, for one mass without it; what only one mass has, for others."""
        of_one_mass = ("inductance",) if self.motor.inductance == 0 else ()
        return of_one_mass if self.motor.is_rigid else OF_ONE_MASS

    def without_effect(self, signals: Sequence[Signal]) -> tuple[str, ...]:
        """Electrical parameters, unless a voltage drives it; nobody questions the constants of gravity."""
        constants = () if self.gravity is None else (*CONSTANTS, *(() if self.follows else SERVO))
        constants += beside_nothing(self)
        if self.feed is Feed.VOLTAGE:
            return constants
        constant = self.feed is not Feed.CURRENT and Signal.CURRENT not in signals
        electrical = ("resistance", "inductance", "voltage_drop", *ON_RESISTANCE)
        return (*electrical, *(("motor_constant",) if constant else ()), *constants)

    def for_command(self, record: Record) -> Self:
        """A rigid motor driven by a current or a torque if the command is in A or N·m; see `for_load`."""
        self = self.for_load(record)
        unit = record.input_units[0]
        feed = feed_in(unit, self.gravity is not None)
        if self.feed is not Feed.VOLTAGE or feed is None:
            return self
        if not self.motor.is_rigid:
            raise ModelError(
                f"{record.name}: {record.input_names[0]!r} is in {unit}; a motor fed with a {feed.value} is one mass "
                "only: choose rigid-motor"
            )
        steps = SERVO_STEPS if feed is Feed.POSITION else self.steps
        return replace(self, feed=feed, motor=replace(self.motor, voltage_dead_zone=None), steps=steps)

    def plausible(self, measure: Measure, sizes: Sizes) -> float:
        """From the torque of the largest command."""
        return plausible(measure, sizes.command * abs(self.drive.gain) * self.torque_per_unit, sizes)

    def resolution_limits(self, asked: Sequence[str], dt: float) -> dict[str, tuple[float, float]]:
        """An inductance whose time constant is far below the sample time."""
        return {"inductance": (QUICKEST * dt * self.motor.resistance, inf)} if "inductance" in asked else {}

    def simpler(self, names: Sequence[str]) -> tuple[Plant, list[str]] | None:
        """One mass without inductance, if the names include a parameter of the shaft."""
        left = without_shaft(names)
        return (replace(self, motor=replace(self.motor, inductance=0.0).rigid()), left) if left else None

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample: speed, angle and reading, for a constant past command (nu,).

        Args:
            state: (2,) speed and angle; (3,) with the speed reading of the sensor, by default the true speed; (4,) with
                `HELD`; (5,) with `RISE`, by default that of the plant.
            command: the inputs of the first sample; a code gives the past state of the bridge.
            dt: sample time in s.
            signals: the signals of the outputs.
            samples: length of the run, if known; it limits the stored delay.
        """
        speed, angle = float(state[0]), float(state[1])
        commands = self.drive.standing(command, dt, samples, self.before(state, command))
        motion = np.array([speed, angle])
        rise = float(state[RISE]) if len(state) > RISE else self.winding_rise
        if self.backlash:
            motion = begun(self, speed, angle)
        elif not self.is_one_mass or self._lag:
            motion = in_steady_state(self.warm(rise), commands[:1, 0], speed, angle)
            if self.is_one_mass:
                motion = np.array([speed, angle, self.motor.motor_constant * motion[0]])
        if self.changes_resistance:
            motion = np.array([*motion[:2], motion[2] if len(motion) > 2 else 0.0, rise])
        return PlantState(dt, motion, commands, self.sensor.first(signals, state, dt))

    def _sampler(self, state: PlantState, signals: Sequence[Signal]) -> DrivenSampler:
        """See `Plant.sampler`."""
        outer, motor = Outer.of(self.drive, self.sensor, state, signals), self.motor
        if not (self.is_one_mass or self.backlash):
            return motor_sampler(outer, *self._general, state)
        volts, k = self.feed is Feed.VOLTAGE, motor.motor_constant
        slope = k / motor.resistance
        before, after = (1.0, slope) if volts else (k if self.feed is Feed.CURRENT else 1.0, 1.0)
        zone = Inside.numbers_of(motor.voltage_dead_zone if volts else motor.torque_dead_zone)
        numbers = before, after, slope * k if volts else 0.0, self.inertia_of_all, k, self._lag, self._force_dropped
        inside = Inside(zone, *(1.0 * each for each in numbers))
        both = apart(self, inside) if self.backlash else (inside, self._sliding)
        law = together(motor.rotor_friction, motor.load_friction)
        return one_mass_sampler(outer, both[0], type(law).level, both[1], self.steps, state)

    @property
    def _sliding(self) -> Sliding:
        """The friction and the load on motor and load as one mass."""
        law = together(self.motor.rotor_friction, self.motor.load_friction)
        hung = NO_WAVES if self.gravity is None else self.gravity.wave(self.sensor.ratio)
        waves = np.concatenate([hung, self.cogging.waves])
        servo = self.servo.numbers(self.sensor.ratio) if self.servo is not None and self.follows else NO_SERVO
        effects = acting(self, self._loss) if self.feed is Feed.VOLTAGE else NEUTRAL
        return Sliding.of(
            law, self._viscous, self.quadratic_viscous, waves, self.load_torque, servo, self._force_dropped, effects
        )

    @property
    def _loss(self) -> float:
        """Its copper loss in W for a torque of 1 N·m."""
        return self.motor.resistance / self.motor.motor_constant**2

    @property
    def changes_resistance(self) -> bool:
        """Whether effects change the resistance that a voltage meets; see `Effects`."""
        return self.feed is Feed.VOLTAGE and acts_on_resistance(self)

    @property
    def begins_risen(self) -> float:
        """ρ₀."""
        return self.winding_rise

    def rise_in(self, state: PlantState) -> float:
        """ρ."""
        return float(state.motion[3]) if self.changes_resistance else 0.0

    def as_left(self, state: PlantState) -> Self:
        """The motor that begins with the resistance of a state, and drifts no more."""
        return self.with_values(as_left(self.rise_in(state))) if self.changes_resistance else self

    def warm(self, rise: float | None = None) -> Motor:
        """The motor with the resistance after a rise ρ, by default that where a run begins."""
        rise = self.winding_rise if rise is None else rise
        return self.motor if rise == 0.0 else replace(self.motor, resistance=self.motor.resistance * (1.0 + rise))

    @property
    def _lag(self) -> float:
        """The electrical time constant in s of what a voltage drives."""
        return self.motor.inductance / self.motor.resistance if self.feed is Feed.VOLTAGE else 0.0

    @property
    def _viscous(self) -> tuple[float, float]:
        """Viscous friction (forward, backward) in N·m·s/rad."""
        both, back = self.motor.rotor_viscous + self.motor.load_viscous, self.viscous_backward
        return both + max(-back, 0.0), both + max(back, 0.0)

    @property
    def _force_dropped(self) -> float:
        """The torque that the voltage drop takes."""
        per_volt = self.motor.motor_constant / self.motor.resistance
        return self.voltage_drop * per_volt if self.feed is Feed.VOLTAGE else 0.0

    @property
    def _general(self) -> tuple[Motor, float, Extra]:
        """Motor, load torque, and what else acts: drag and gravity on the load, cogging on the rotor."""
        hung = NO_WAVES if self.gravity is None else self.gravity.wave(self.sensor.ratio)
        waves = [np.insert(each, 0, body, axis=1) for body, each in enumerate((self.cogging.waves, hung))]
        motor = replace(self.motor, load_inertia=self.motor.load_inertia + self._weight)
        return motor, self.load_torque, Extra(self.quadratic_viscous, np.concatenate(waves))

    def linearised(self, signals: Sequence[Signal]) -> StateSpace:
        """See `linear_motor`: the mean viscous friction of both directions, and a joint about the angle of rest."""
        spring, n = 0.0, self.sensor.scale
        if self.gravity is not None:
            spring = self.gravity.whole / n * self.gravity.per_unit(n)
        viscous = self.motor.rotor_viscous + 0.5 * abs(self.viscous_backward)
        motor, feed, gain = replace(self.warm(), rotor_viscous=viscous), self.feed, self.drive.gain
        if self.servo is not None and self.follows:
            motor, feed, gain, spring = self.servo.linear(motor, gain, spring, n)
        part = linear_motor(motor, feed, gain, n, signals, (spring, self._weight), loaded=self.drive.loaded)
        filtered = tuple(j for j, signal in enumerate(signals) if signal is not Signal.CURRENT)
        return part.with_lag(self.sensor.lag, filtered)

    @property
    def is_one_mass(self) -> bool:
        """True for a rigid motor without backlash, and for any other fed with a current or a torque."""
        plain = self.motor.is_rigid and self.motor.torque_dead_zone is None
        return not self.backlash and (plain or self.feed is not Feed.VOLTAGE)

    def holding(self, load: float, position: float) -> float:
        """The output of the drive that balances the load torque, one among the inputs, and the gravity on a joint."""
        motor, torque = self.motor, self.load_torque + load
        if self.gravity is not None:
            torque += self.gravity.against(position, self.sensor.ratio)
        if torque == 0.0 and not self.follows:  # as in most free runs of a search
            return 0.0
        if motor.torque_dead_zone is not None:
            torque = float(motor.torque_dead_zone.inverse(torque))
        made = torque / self.torque_per_unit + (position / self.sensor.ratio if self.follows else 0.0)
        if self.feed is not Feed.VOLTAGE:
            return made
        made += copysign(self.voltage_drop, made)
        return made if motor.voltage_dead_zone is None else float(motor.voltage_dead_zone.inverse(made))

    def held_at(self, command: Array) -> float:
        """See `DrivenPlant.held_at`: an arm between the angles at which it hangs and is pushed most, by bisection."""
        if self.gravity is None or not (self.gravity.whole or self.follows):
            return 0.0
        ratio, made = self.sensor.ratio, float(self.drive.applied(command[None, :])[0][0])
        hangs, quarter = self.gravity.angle * ratio, 0.25 * self.gravity.period * abs(ratio)
        low, high = (hangs, made * ratio) if self.follows else (hangs - quarter, hangs + quarter)
        if self.holding(0.0, low) > made:
            low, high = high, low
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.holding(0.0, middle) < made else (low, middle)
        return high

    @property
    def turn(self) -> float:
        """The phase of gravity per unit of the angle of the joint."""
        return 0.0 if self.gravity is None else self.gravity.per_unit(1.0)

    def with_motion(self, motion: Motion, fixed: Collection[str] = ()) -> Self:
        """The motor with this motion of one mass; resistance, viscous friction and the ratio of inertias are kept.
        A load inertia that is fixed is kept instead, and the rotor has the rest.

        With R_a given, K_m follows from the damping, J from K_m and the gain, and the friction from J. Where K_m or J
        is fixed, the other one follows from the gain, and the viscous friction from the damping. For a current
        input, K_m is kept, and J and the friction follow from it.
        """
        motion = at_motor(motion, self.sensor.ratio)
        if self.feed is Feed.VOLTAGE:
            moved = replace(self, motor=with_motion(self.motor, self.drive.gain, motion, fixed))
        else:
            per_unit = self.torque_per_unit * (1.0 if self.follows else self.drive.gain)
            apart = self.backlash > 0 and "load_inertia" not in fixed
            moved = self.with_values(by_torque(self.motor, self._level, per_unit, self._weight, motion, apart))
        if self.gravity is None:
            return moved
        known = hung(moved.motor, self.gravity, self._weight, self.sensor.ratio, motion)
        return moved.with_values({name: value for name, value in known.items() if name not in fixed})

    def unseen(self, rows: Sequence[Estimate], groups: Sequence[Sequence[str]], span: float) -> list[Finding]:
        """See `Plant.unseen`; the gravity of a joint."""
        return [] if self.gravity is None else self.gravity.unseen(rows, groups, span)

    @property
    def _weight(self) -> float:
        """The inertia of a known weight on the arm of a joint, at the motor."""
        return 0.0 if self.gravity is None else self.gravity.inertia / self.sensor.ratio**2

    @property
    def inertia_of_all(self) -> float:
        """All that turns, at the motor, in kg·m²."""
        return self.motor.rotor_inertia + self.motor.load_inertia + self._weight

    def friction_characteristic(self) -> StaticCharacteristic:
        """All mechanical friction over speed, with the viscous part."""
        laws = tuple(self.frictions.values())
        return friction_over_speed(laws, self._viscous, self.quadratic_viscous, "Speed ω", "rad/s", "torque")

    def dead_zone_characteristic(self) -> StaticCharacteristic | None:
        """The dead zone on the voltage."""
        return dead_zone_over_command(self.motor.voltage_dead_zone, "voltage")

    def equations(self) -> str:
        """(4.1)–(4.11) as far as they apply."""
        weight, rigid = "" if self.gravity is None else WEIGHT, self.motor.is_rigid
        cogging = extra_terms(0.0, self.cogging, "B_q", "ω", "θ" if rigid else "θ_m")
        drag = extra_terms(self.quadratic_viscous, Cogging(), "B_q", "ω" if rigid else "ω_L", "θ")
        by_sign = self.viscous_backward, self.voltage_drop
        rises = equation_of_rise(self, "R_a·(1 + ρ)·i²")
        whole = equations(self.motor, self.feed, cogging, weight + drag, by_sign, rises)
        return whole + (LOST if self.backlash else "")

    def to_data(self) -> dict[str, Any]:
        """Parameters and input quantity, and the dead zones that exist."""
        data = super().to_data()
        absent = tuple(f"{zone}." for zone in ZONES if getattr(self.motor, zone) is None)
        parameters = without_idle(data["parameters"])
        kept = {name: value for name, value in parameters.items() if not name.startswith(absent or ("\0",))}
        return {**data, "parameters": kept, "feed": self.feed.value}

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The motor described by `to_data`."""
        return super(MotorPlant, replace(self, feed=Feed(data.get("feed", Feed.VOLTAGE.value)))).with_data(data)

    def quantities(self) -> tuple[Quantity, ...]:
        """Quantities that input and speed alone identify."""
        found = quantities(self.warm(), self.feed, self.voltage_drop, self.load_torque)
        if self.gravity is None:
            return found
        return (*of_joint(self.motor, self.gravity.whole, self.inertia_of_all, self.sensor.ratio), *found)


MotorPlant.__doc__ = with_rows(MotorPlant.__doc__)
DrivenMotor = MotorPlant
