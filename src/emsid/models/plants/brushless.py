r"""A brushless motor with its inverter, in the frame of its rotor.

    L_d·di_d/dt = v_d − R_s·i_d + ω_e·L_q·i_q,      L_q·di_q/dt = v_q − R_s·i_q − ω_e·(L_d·i_d + ψ),      ω_e = p·ω,
    J·dω/dt = T·(1 + T_r(θ)) − B·ω − T_f(ω) − T_c(θ) − (T_a + m·g·l)·sin(θ − θ₀) − T_d,
    T = 3/2·p·(ψ + (L_d − L_q)·i_d)·i_q.

Voltages and currents have the amplitudes of the phases; a drive that logs power-invariant ones is converted when it
is read (`emsid.models.plants.park`). T_c is cogging and T_r the ripple of the torque by current, both sums of cosines
and sines of whole multiples n of the angle.

A record with the angle shows which n there are (`Brushless.possible_parts`). Poles pass every slot alike, so that
cogging has multiples of 2·p, and of the number of slots where magnets differ; flux and currents of the windings make
multiples of 6·p by current. Half of the prior probability is theirs, the other half that of all other numbers.

Between two samples a step consists of half a step of the currents at constant speed, a step of the motion under
constant currents, and half a step of the currents (Strang). Each part is exact: the currents by the exponential of a
matrix of two by two, the motion by `one_mass.move` with sticking. What is left is of second order in the step.

The inverter: a voltage acts after the delay, so that a controller that computes for one period and holds its voltage
for the next one is one and a half periods late on average. An inverter holds the voltage in the frame of the stator,
where the rotor turns on: in its frame the voltage turns back by ω_e times the age of the angle, less the time by which
the controller advances that angle. At each of the two edges in a period of the carrier, dead time takes ½·U_t against
the current of the phase at that edge. With the ripple of the carrier these currents are i − i_t and i + i_t, so that a
phase loses U_t·½·(sign(i − i_t) + sign(i + i_t)): nothing where |i| < i_t, and a constant voltage against the current
beyond. The ripple i_t is taken as constant, although it grows with the voltage. Where no angle is measured, 4/π·U_t
along the current stands for the three phases, beyond the same i_t.

The resistance may change, R = R_s·(1 + ρ), as that of any winding (`emsid.models.plants.effects`): by its copper loss
P = 3/2·R·(i_d² + i_q²), by a drift, or with a temperature that is logged, which is an input.

References:
    Strang, SIAM J. Numer. Anal. 5 (1968), on the splitting. Krishnan, *Permanent Magnet Synchronous and Brushless DC
    Motor Drives* (2010), ch. 3, on the equations. Jeong, Park, IEEE Trans. Ind. Electron. 38 (1991), on dead time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from math import ceil, inf
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import did_you_mean
from emsid.compiled import njit
from emsid.errors import DataError, EmsidError, ModelError, listed
from emsid.findings import Finding
from emsid.models.plants.drive import Hold
from emsid.models.plants.effects import (
    REFERENCE,
    TEMPERATURES,
    Winding,
    acting,
    acts_on_resistance,
    as_left,
    beside_nothing,
    check_effects,
    effect_handles,
    equation_of_rise,
    resistance,
    risen,
    with_rows,
)
from emsid.models.plants.gravity import Gravity, gravity_handles
from emsid.models.plants.lost_motion import Body
from emsid.models.plants.one_mass import Sliding, compiled_with_law, move
from emsid.models.plants.parameters import TINY, Handle, Signal, law_handles, scalar
from emsid.models.plants.plant import (
    Channels,
    Limits,
    Part,
    Plant,
    Quantity,
    Sampler,
    Sizes,
    StaticCharacteristic,
    plausible,
)
from emsid.models.plants.state import NO_LOAD, NO_ROWS, PlantState
from emsid.plant.friction import Friction, FrictionLaw, find_law, law_name
from emsid.plant.parameter import Measure, Parameter
from emsid.record import Record

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

LONGEST_STEP = 2.5e-5
"""Longest step in s. With twice as long ones, L_q from a second at 10 kHz is 0.6 standard errors too large (the mean
of eight records of a drive simulated in the frame of its stator); the error falls with the square of the step."""
FOLLOWING = 2e-3
"""Time constant in s with which the angle follows a measured one: noise of the measured angle must not become noise of
the torque, which adds up in the speed. Without it, 14 of 18 intervals of the Coulomb friction had the truth."""
INPUTS = {
    "dq": ("v_d", "v_q"),
    "q": ("v_q",),
    "duty": ("duty", "bus"),
}
"""The inputs by name. A duty of one is the largest amplitude of space-vector modulation, bus/√3, on the q-axis."""
INVERTERS = (("rotor", 1.0, 0.0), ("stator", 1.0, 0.0), ("stator", 1.0, 1.5))
"""Frame, delay and advance in samples of usual controllers: voltages act in the next sample, as they were transformed
or where the rotor turns on, with the angle of the reading or that of the middle of the next sample."""
SMALL = 1e-5
"""Changes of the state for a derivative, in SI units. The effects of harmonics differ from differences of whole runs by
0.02 to 0.2 % with it or a tenth of it, by 0.5 to 0.8 % with 1e-3 (the current of a phase changes its sign within more
samples)."""
MOST_PERIODS = 360
"""The most periods in a turn: the first harmonic of cogging has the least common multiple of slots and poles, 84 of 12
and 14, 264 of 24 and 22."""
SLOWEST = 0.1
"""The part of the samples in motion that must be so slow that a period has six samples or more."""
ANGLE, TEMPERATURE = "angle", "temperature"

_kernel = njit(nogil=True, error_model="numpy")
_CODES = {Signal.POSITION: 0, Signal.SPEED: 1, Signal.D_CURRENT: 2, Signal.Q_CURRENT: 3}
_SPEED, _ANGLE, _D, _Q, _RISE, _READING, _BEGUN = range(7)
"""The state: speed in rad/s, angle in rad, currents in A, rise of the resistance, reading of the speed, and whether a
sample has been simulated."""
_ROWS: tuple[tuple[str, str, str, str, Measure, float], ...] = (
    ("resistance", "R_s", "ohm", "resistance of a phase", Measure.OTHER, TINY),
    ("inductance_d", "L_d", "H", "inductance on the d-axis", Measure.OTHER, TINY),
    ("inductance_q", "L_q", "H", "inductance on the q-axis", Measure.OTHER, TINY),
    ("flux", "ψ", "Wb", "flux linkage of the magnets, amplitude of a phase", Measure.OTHER, 0.0),
    ("pole_pairs", "p", "1", "pole pairs", Measure.OTHER, 1.0),
    ("inertia", "J", "kg*m^2", "inertia of rotor and load", Measure.OTHER, TINY),
    ("viscous_friction", "B", "N*m*s/rad", "viscous friction", Measure.DAMPING, 0.0),
    ("quadratic_viscous", "B_q", "N*m*s^2/rad^2", "quadratic viscous friction", Measure.QUADRATIC, 0.0),
    ("load_torque", "T_d", "N*m", "constant load torque", Measure.FORCE, -inf),
    ("delay", "t_d", "s", "time until a voltage acts, without the half period for which it is held", Measure.TIME, 0.0),
    ("advance", "t_a", "s", "time by which the controller advances the angle of its voltage", Measure.TIME, 0.0),
    ("dead_time_voltage", "U_t", "V", "voltage that a phase loses to dead time", Measure.COMMAND, 0.0),
    ("dead_time_current", "i_t", "A", "half the ripple of its current; below, it loses nothing", Measure.OTHER, 0.0),
    ("sensor_lag", "t_s", "s", "time constant of the filter of the speed", Measure.TIME, 0.0),
    ("slots", "Q", "1", "slots of the stator, 0 where they are not known", Measure.OTHER, 0.0),
)  # fmt: skip


class Harmonic(NamedTuple):
    """One harmonic of a torque over the angle.

    Attributes:
        number: n, periods per turn.
        cosine, sine: amplitudes in N·m, or of the ripple by current as parts of the torque.
    """

    number: int
    cosine: float = 0.0
    sine: float = 0.0


@dataclass(frozen=True)
class Brushless(Plant, Winding):
    """A brushless motor, from voltages in the frame of its rotor to currents, speed and angle.

    Args:
        resistance, inductance_d, inductance_q, flux: of a phase, in Ω, H and Wb.
        pole_pairs, slots: p, and the slots of the stator, which only say what harmonics are likely.
        inertia, viscous_friction, quadratic_viscous, load_torque: of the motion, in SI units.
        friction: dry friction.
        gravity: of an arm on the motor.
        cogging: harmonics of a torque over the angle.
        torque_ripple: harmonics of the torque by current, as parts of it.
        delay, advance: in s, see the module.
        dead_time_voltage, dead_time_current: in V and A.
        sensor_lag: in s.
        winding: by name, see `Winding`.
        inputs: ``dq``, ``q`` (v_d is zero) or ``duty`` (of the q-axis, and the bus voltage).
        placed: whether the measured angle in rad is a further input. The angle of the motor follows it, so that errors
            of the motion do not add up. The controller acts at the measured angle, and the currents are those in its
            frame, with its noise.
        warmed: whether the temperature of the winding in °C is a further input, behind it.
        held_in: ``rotor`` or ``stator``: the frame in which a voltage is constant.
        between: how voltages go on between samples: held, or straight to the next.
        steps: per sample, at least; none is longer than `LONGEST_STEP`.

    Raises:
        ModelError: for a value outside its bounds, or unknown inputs or frames.
    """

    resistance: float = 0.1
    inductance_d: float = 1e-4
    inductance_q: float = 1e-4
    flux: float = 0.005
    pole_pairs: float = 7.0
    inertia: float = 1e-4
    viscous_friction: float = 0.0
    quadratic_viscous: float = 0.0
    load_torque: float = 0.0
    friction: FrictionLaw = Friction()  # noqa: RUF009  (frozen)
    gravity: Gravity = Gravity()  # noqa: RUF009  (frozen)
    cogging: tuple[Harmonic, ...] = ()
    torque_ripple: tuple[Harmonic, ...] = ()
    delay: float = 0.0
    advance: float = 0.0
    dead_time_voltage: float = 0.0
    dead_time_current: float = 0.0
    sensor_lag: float = 0.0
    slots: float = 0.0
    inputs: str = "dq"
    placed: bool = False
    warmed: bool = False
    held_in: str = "rotor"
    between: Hold = Hold.ZERO
    steps: int = 1

    def __post_init__(self) -> None:
        for what, value, known in (("inputs", self.inputs, list(INPUTS)), ("held_in", self.held_in, [*_FRAMES])):
            if value not in known:
                raise ModelError(f"brushless: {what} is {value!r}; give {listed(known)}{did_you_mean(value, known)}")
        for name, symbol, _, _, _, lower in _ROWS:
            value = getattr(self, name)
            if not lower <= value < inf:
                raise ModelError(f"brushless with {name} ({symbol}) {value}; it must be at least {lower:g} and finite")
        check_effects(self.name, self)

    name = "brushless"
    states = 7
    body = "motor"
    friction_name = "friction"
    load_name = "load_torque"

    @property
    def handles(self) -> Mapping[str, Handle]:
        """The rows of the table, friction, gravity and harmonics."""
        harmonics = tuple(tuple(each.number for each in some) for some in (self.cogging, self.torque_ripple))
        return _handles(type(self.friction), *harmonics)

    @property
    def default_free(self) -> tuple[str, ...]:
        """Electrical constants, inertia, friction, what has an effect besides, and all harmonics."""
        level = f"friction.{self.friction.parameters[0].name}"
        electrical = ("resistance", "inductance_d", "inductance_q", "flux")
        usual = (*electrical, "inertia", "viscous_friction", level, "dead_time_voltage")
        winding = ("heating", "cooling", "winding_drift") if self.changes_resistance else ()
        more = tuple(name for name in (*winding, "gravity.torque") if self.value(name))
        return (*usual, *more, *(name for name in self.handles if name.startswith(("cogging.", "torque_ripple."))))

    @property
    def channels(self) -> Channels:
        """Currents, speed and angle, for voltages."""
        units = {Signal.SPEED: "rad/s", Signal.POSITION: "rad", Signal.D_CURRENT: "A", Signal.Q_CURRENT: "A"}
        commands = ("1",) if self.inputs == "duty" else ("V",)
        return Channels(units, Signal.SPEED, commands, "volts", "voltage", inputs=len(self.roles))

    @property
    def roles(self) -> tuple[str, ...]:
        """The names of its inputs, in order."""
        return (*INPUTS[self.inputs], *[ANGLE] * self.placed, *[TEMPERATURE] * self.warmed)

    @property
    def tests(self) -> Mapping[str, tuple[str, ...]]:
        """Steps on the d-axis leave the rotor at rest; those on the q-axis turn it."""
        return {"d-axis": ("v_d",), "q-axis": ("v_q",), "both-axes": ("v_d", "v_q")}

    @property
    def test_names(self) -> tuple[str, ...]:
        """Both voltages."""
        return INPUTS["dq"]

    @property
    def of_current(self) -> tuple[str, ...]:
        """What drops a voltage along a current."""
        return ("resistance", "inductance_d", "inductance_q", "dead_time_voltage")

    @property
    def open_circuit(self) -> Mapping[str, float]:
        """A resistance of 1 MΩ: a microampere for a volt."""
        return {"resistance": 1e6}

    @property
    def counted(self) -> tuple[str, ...]:
        """The pole pairs, which flux and inertia are proportional to."""
        return ("pole_pairs",)

    def for_test(self) -> Self:
        """With both voltages; its angle is that of the model, and the winding as warm as at its start."""
        return replace(self, inputs="dq", placed=False, warmed=False)

    def signal_of(self, name: str, unit: str) -> Signal:
        """A current with a d before any q in its name is that of the d-axis."""
        if unit != "A":
            return super().signal_of(name, unit)
        letters = [each for each in name.lower().replace("_", "") if each in "dq"]
        return Signal.D_CURRENT if letters[:1] == ["d"] else Signal.Q_CURRENT

    def acting(self, inputs: int) -> tuple[int, ...]:
        """The voltages, or the duty."""
        return tuple(k for k, name in enumerate(self.roles) if name in ("v_d", "v_q", "duty"))

    def driven_by_means(self) -> Self:
        """The motor with voltages that turn with its rotor: controller and inverter act many times in a sample."""
        return replace(self, held_in="rotor")

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """Its dry friction."""
        return {"friction": self.friction}

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The motor with another friction law."""
        return replace(self, **dict(laws))  # type: ignore[arg-type]

    @property
    def hold(self) -> Hold:
        """How voltages go on between samples."""
        return self.between

    @property
    def changes_resistance(self) -> bool:
        """Whether its resistance changes by itself, and not with a temperature that is logged."""
        return acts_on_resistance(self) and not self.warmed

    @property
    def begins_risen(self) -> float:
        """ρ₀."""
        return self.winding_rise

    def rise_in(self, state: PlantState) -> float:
        """ρ."""
        return float(state.motion[_RISE]) if self.changes_resistance else 0.0

    def as_left(self, state: PlantState) -> Self:
        """The motor that begins with the resistance of a state, and drifts no more."""
        return self.with_values(as_left(self.rise_in(state))) if self.changes_resistance else self

    def with_hold(self, hold: Hold) -> Self:
        """The motor with this hold of its voltages."""
        return replace(self, between=hold)

    def for_command(self, record: Record) -> Self:
        """The motor with the inputs that a record has, by their number and units.

        Raises:
            DataError: for inputs that are none of `INPUTS`.
        """
        units = list(record.input_units)
        warmed = units[-1] in TEMPERATURES and len(units) > 1
        placed = units[-1 - warmed] == "rad" and len(units) > 1 + warmed
        volts = tuple(unit in ("V", "") for unit in units[: len(units) - warmed - placed])
        found = {(True, True): "dq", (True,): "q", (False, True): "duty"}.get(volts)
        if found is None or (found == "duty" and units[0] not in ("1", "")):
            raise DataError(
                f"{record.name}: inputs in {listed(units)}; a brushless motor takes v_d and v_q in V, v_q alone, or "
                "duty and bus voltage, and after them an angle in rad and a temperature in degC",
                arguments=("units",),
            )
        return replace(self, inputs=found, placed=placed, warmed=warmed)

    def without_effect(self, signals: Sequence[Signal]) -> tuple[str, ...]:
        """What acts only beside something that is absent; constants that nobody questions."""
        found = ["pole_pairs", "slots", "gravity.acceleration", "gravity.period", *beside_nothing(self, self.warmed)]
        found += [] if self.held_in == "stator" else ["advance"]
        found += [] if self.dead_time_voltage else ["dead_time_current"]
        return (*found, *([] if Signal.SPEED in signals else ["sensor_lag"]))

    def with_starts(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The motor with a lag of a sample where one is estimated: without any, its derivative is zero."""
        if "sensor_lag" not in asked or self.sensor_lag:
            return self
        return replace(self, sensor_lag=min(segments[0].dt, limits["sensor_lag"][1]))

    def plausible(self, measure: Measure, sizes: Sizes) -> float:
        """From the torque of a rotor that the largest voltage holds at rest."""
        return plausible(measure, 1.5 * self.pole_pairs * self.flux * sizes.command / self.resistance, sizes)

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample: speed, angle, currents, rise of the resistance, and voltages before it.

        Raises:
            ModelError: for a signal that it does not have.
        """
        missing = [signal.value for signal in signals if signal not in _CODES]
        if missing:
            raise ModelError(
                f"brushless has no {missing[0]} to compare with; it has {listed([s.value for s in _CODES])}"
            )
        late = min(self.delay / dt, samples or inf)
        age = np.arange(max(ceil(late - 1e-9), 1) + (self.between is Hold.FIRST), 0, -1.0)
        motion = np.zeros(7)
        motion[:5] = state[:5]
        motion[_READING] = motion[_SPEED]
        v_d, v_q = state[5:]
        angles = self.pole_pairs * (motion[_ANGLE] + (self.advance - age * dt) * motion[_SPEED])
        rows = np.column_stack([np.full(len(age), v_d), np.full(len(age), v_q), angles])
        return PlantState(dt, motion, rows, NO_ROWS)

    def _voltages(self, command: Array) -> tuple[float, float]:
        at = dict(zip(self.roles, command.tolist(), strict=False))
        q = at["duty"] * at["bus"] / np.sqrt(3.0) if self.inputs == "duty" else at["v_q"]
        return at.get("v_d", 0.0), float(q)

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The outputs (N, ny) for inputs (N, nu), and the state after them.

        Raises:
            ModelError: for another number of inputs than that of its `roles`.
        """
        if inputs.shape[1] != len(self.roles):
            raise ModelError(f"brushless: {inputs.shape[1]} inputs; it takes {listed([*self.roles])}")
        sampler = self._between(state, signals)
        outputs = np.empty((len(inputs), len(signals)))
        sampler.run(np.ascontiguousarray(inputs), outputs)
        return outputs, sampler.state

    def sampler(self, state: PlantState, signals: Sequence[Signal]) -> Sampler:
        """See `Plant.sampler`."""
        return self._between(state, signals)

    def _between(self, state: PlantState, signals: Sequence[Signal]) -> BrushlessSampler:
        dt, straight = state.dt, self.between is Hold.FIRST
        late, kept = self.delay / dt, len(state.commands) - straight
        waves = np.array([*self.gravity.wave(1.0), *((1.0 * n, c, s) for n, c, s in self.cogging)]).reshape(-1, 3)
        friction = Sliding.of(
            self.friction, (self.viscous_friction,) * 2, self.quadratic_viscous, waves, self.load_torque
        )  # fmt: skip
        columns = [self.roles.index(name) if name in self.roles else -1 for name in _COLUMNS]
        machine = Machine(
            self.resistance, self.inductance_d, self.inductance_q, self.flux, self.pole_pairs,
            self.inertia + self.gravity.inertia, self.advance, self.dead_time_voltage,
            self.dead_time_current, 1.0 - np.exp(-dt / self.sensor_lag) if self.sensor_lag else 1.0,
            1.0 - np.exp(-dt / FOLLOWING), acting(self, 1.5 * self.resistance, self.warmed), dt,
            0.0 if straight else min(late - (kept - 1), 1.0),
            len(state.commands) - late if straight else 0.0, late * dt,
            np.array([(1.0 * n, c, s) for n, c, s in self.torque_ripple]).reshape(-1, 3),
            np.array(columns, dtype=np.int64), np.array([_CODES[each] for each in signals], dtype=np.int64),
            max(self.steps, ceil(dt / LONGEST_STEP - 1e-9)), straight, self.held_in == "stator",
            Signal.POSITION in signals or self.placed,
        )  # fmt: skip
        return BrushlessSampler(machine, type(self.friction).level, friction, state)

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """The first samples; a speed that is not measured is zero, or the slope of the angle."""
        state = np.zeros(self.states)
        state[_RISE], state[5:] = self.begins_risen, self._voltages(segment.input[0])
        for k, signal in enumerate(signals):
            state[_STATE_OF[signal]] = segment.output[0, k]
        if Signal.SPEED not in signals and Signal.POSITION in signals and len(segment) > 2:
            angle = segment.output[:20, signals.index(Signal.POSITION)]
            state[_SPEED] = np.polyfit(np.arange(len(angle)) * segment.dt, angle, 1)[0]
        return state

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """Those that are measured, the speed of a measured angle, and voltages before the start that still act."""
        found = {_STATE_OF[signal] for signal in signals} | ({_SPEED} if Signal.POSITION in signals else set())
        return (*sorted(found), *((5, 6) if self.delay > 0 and found & {_D, _Q} else ()))

    def suggested(self, segments: Sequence[Record], signals: Sequence[Signal]) -> list[Self]:
        """With the constants from regressions on the equations, integrated over windows of some samples.

        Where neither a delay nor the frame of the inverter is given, with each of `INVERTERS`.
        """
        inverters = [self]
        if self.delay == 0.0 and self.held_in == "rotor" and self.between is Hold.ZERO:
            dt = segments[0].dt
            inverters += [replace(self, held_in=frame, delay=d * dt, advance=a * dt) for frame, d, a in INVERTERS]
        plants = []
        for plant in inverters:
            with suppress(EmsidError, np.linalg.LinAlgError):
                found = plant.with_values(plant._by_voltages(segments, signals))
                plants.append(found.with_values(found._by_torque(segments, signals)))
        return plants

    def _by_voltages(self, segments: Sequence[Record], signals: Sequence[Signal]) -> dict[str, float]:
        """Resistance, inductances, flux and dead-time voltage from measured currents."""
        if not {Signal.D_CURRENT, Signal.Q_CURRENT} <= {*signals}:
            return {}
        rows, values = [], []
        for segment in segments:
            d, q, speed = (_measured(signals, segment, each) for each in _MEASURED)
            late = round((self.delay + 0.5 * segment.dt * (self.between is Hold.ZERO)) / segment.dt)
            v = np.array([self._voltages(u) for u in segment.input])
            v = np.concatenate([np.repeat(v[:1], late, axis=0), v])[: len(v)]
            along = np.column_stack([d, q]) / np.maximum(np.hypot(d, q), 1e-9)[:, None] * 4 / np.pi
            dt, e, none = segment.dt, self.pole_pairs * speed, np.zeros(len(d))
            dd, dq = np.gradient(d, dt), np.gradient(q, dt)
            for lines, target in (
                ((d, dd, -e * q, none, along[:, 0]), v[:, 0]),
                ((q, e * d, dq, e, along[:, 1]), v[:, 1]),
            ):
                rows.append(_windowed(np.column_stack(lines), 8))
                values.append(_windowed(target[:, None], 8)[:, 0])
        names = ("resistance", "inductance_d", "inductance_q", "flux", "dead_time_voltage")
        return _positive(names, np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0])

    def _by_torque(self, segments: Sequence[Record], signals: Sequence[Signal]) -> dict[str, float]:
        """Inertia and friction from measured currents and speed."""
        if Signal.Q_CURRENT not in signals or not {Signal.SPEED, Signal.POSITION} & {*signals}:
            return {}
        rows, values = [], []
        for segment in segments:
            d, q, speed = (_measured(signals, segment, each) for each in _MEASURED)
            torque = 1.5 * self.pole_pairs * (self.flux + (self.inductance_d - self.inductance_q) * d) * q
            slope = np.gradient(speed, segment.dt)
            lines = np.column_stack([slope, speed, np.sign(speed), np.ones(len(speed)), torque])
            rows.append(_windowed(lines, max(len(speed) // 100, 2))[:, :4])
            values.append(_windowed(lines, max(len(speed) // 100, 2))[:, 4])
        inertia, viscous, level, _ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
        names = ("inertia", "viscous_friction", f"friction.{self.friction.parameters[0].name}")
        return _positive(names, (inertia, viscous, level))

    @property
    def may_have_parts(self) -> bool:
        """Yes: harmonics of its torque."""
        return True

    def possible_parts(self, segments: Sequence[Record], signals: Sequence[Signal]) -> Sequence[Part]:
        """Harmonics of cogging and of the torque by current, where the records have the angle, of a turn at least."""
        angles = self._angles(segments, signals)
        if angles is None:
            return ()
        travel = max(float(np.ptp(each)) for each in angles)
        if travel < 2 * np.pi:  # neighbouring numbers look alike
            return ()
        steps = np.abs(np.concatenate([np.diff(each) for each in angles]))
        slow = float(np.quantile(steps[steps > 0], SLOWEST)) if (steps > 0).any() else inf
        numbers, poles = range(1, int(min(MOST_PERIODS, 1.0 / slow)) + 1), 2 * round(self.pole_pairs)
        found: list[Part] = []
        for of, usual in (("cogging", (poles, round(self.slots))), ("torque_ripple", (3 * poles,))):
            likely = [n for n in numbers if any(each and n % each == 0 for each in usual)]
            rest = len(numbers) - len(likely)
            for n in numbers:
                share = (0.5 if rest else 1.0) / len(likely) if n in likely else (0.5 if likely else 1.0) / rest
                found.append(Part(of, n, (f"{of}.{n}.cosine", f"{of}.{n}.sine"), share))
        return found

    def _angles(self, segments: Sequence[Record], signals: Sequence[Signal]) -> list[Array] | None:
        """(N,) the measured angle of every segment; None without one."""
        if self.placed:
            return [segment.input[:, self.roles.index(ANGLE)] for segment in segments]
        if Signal.POSITION in signals:
            return [segment.output[:, signals.index(Signal.POSITION)] for segment in segments]
        return None

    def with_parts(self, parts: Sequence[Part]) -> Self:
        """With these harmonics."""
        changes = {}
        for of in ("cogging", "torque_ripple"):
            known = {each.number: each for each in getattr(self, of)}
            numbers = sorted(part.number for part in parts if part.of == of)
            changes[of] = tuple(known.get(n, Harmonic(n)) for n in numbers)
        return replace(self, **changes)  # type: ignore[arg-type]

    def effects_of_parts(
        self, groups: Sequence[Sequence[Part]], segment: Record, state: Array, signals: Sequence[Signal]
    ) -> Iterator[Array]:
        """Of every group of harmonics (N, ny, n, 2), derivatives by cosine and sine.

        All of them are torques along one motion, so that they need one run, linearised from sample to sample.
        """
        begun = self.start(state, segment.input[0], segment.dt, signals, len(segment))
        ways, path = self._between(begun, signals).differentiated(np.ascontiguousarray(segment.input), SMALL)
        for parts in groups:
            numbers = np.array([part.number for part in parts], dtype=float)
            by_current = np.array([part.of == "torque_ripple" for part in parts])
            out = np.empty((len(segment), len(signals), len(parts), 2))
            _spread(ways, path, numbers, by_current, out)
            yield out

    def cogging_characteristic(self) -> StaticCharacteristic | None:
        """Its cogging torque over the angle."""
        if not self.cogging:
            return None
        return StaticCharacteristic(
            lambda angle: over_angle(self.cogging, angle), ("Angle", "rad"), ("Cogging torque", "N*m")
        )

    def remarks(self, segments: Sequence[Record], signals: Sequence[Signal]) -> list[Finding]:
        """How large cogging and the ripple by current are, beside the largest torque, and their largest harmonics."""
        turn, found = np.linspace(0.0, 2 * np.pi, 10 * MOST_PERIODS), []
        largest = 0.0
        for segment in segments if self.cogging else ():
            if Signal.Q_CURRENT in signals:
                current = segment.output[:, signals.index(Signal.Q_CURRENT)]
            else:
                state = self.first_state(signals, segment)
                current = self.simulate(segment.input, segment.dt, state, (Signal.Q_CURRENT,))
            largest = max(largest, 1.5 * self.pole_pairs * self.flux * float(np.max(np.abs(current))))
        for code, harmonics in (("cogging-over-angle", self.cogging), ("torque-ripple-over-angle", self.torque_ripple)):
            if harmonics:
                size = float(np.ptp(over_angle(harmonics, turn)))
                most = max(harmonics, key=lambda each: np.hypot(each.cosine, each.sine)).number
                data: dict[str, Any] = {"size": size, "number": most}
                data |= {"unit": "N*m", "share": size / max(largest, TINY)} if harmonics is self.cogging else {}
                found.append(Finding(code, self.name, data))
        return found

    def quantities(self) -> tuple[Quantity, ...]:
        """Torque constant, time constants, and the motor constant."""
        torque, ohms = 1.5 * self.pole_pairs * self.flux, self.resistance * (1.0 + self.winding_rise)
        return (
            Quantity("torque constant", "3/2·p·ψ", "N*m/A", torque),
            Quantity("electrical time constant", "L_q/R_s", "s", self.inductance_q / ohms),
            Quantity(
                "mechanical time constant", "R_s·J/(3/2·p²·ψ²)", "s",
                ohms * self.inertia / max(torque * self.pole_pairs * self.flux, TINY),
            ),
            Quantity("motor constant", "√(3/2)·p·ψ/√R_s", "N*m/W^0.5", torque / np.sqrt(1.5 * ohms)),
        )  # fmt: skip

    def equations(self) -> str:
        """Those of currents, resistance and motion."""
        rises = equation_of_rise(self, "3/2·R_s·(1 + ρ)·(i_d² + i_q²)", self.warmed)
        ohms = "R_s·(1 + ρ)" if rises else "R_s"
        return (
            f"L_d·di_d/dt = v_d − {ohms}·i_d + p·ω·L_q·i_q\n"
            f"L_q·di_q/dt = v_q − {ohms}·i_q − p·ω·(L_d·i_d + ψ)\n"
            f"{rises}{bool(rises) * chr(10)}"
            "J·dω/dt = 3/2·p·(ψ + (L_d − L_q)·i_d)·i_q − B·ω − T_f(ω) − T_d"
        )

    def to_data(self) -> dict[str, Any]:
        """Parameters, and what is not usual of the rest."""
        data, plain = super().to_data(), Brushless()
        rest = {name: getattr(self, name) for name in _PLAIN}
        rest |= {"between": self.between.value} if self.between is not plain.between else {}
        rest |= {name: [each.number for each in getattr(self, name)] for name in ("cogging", "torque_ripple")}
        rest |= {} if law_name(self.friction) == law_name(plain.friction) else {"friction": law_name(self.friction)}
        return data | {name: value for name, value in rest.items() if value != getattr(plain, name) and value != []}

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The motor described by `to_data`."""
        rest = {name: data[name] for name in _PLAIN if name in data}
        if "between" in data:
            rest["between"] = Hold(data["between"])
        for name in ("cogging", "torque_ripple"):
            rest[name] = tuple(Harmonic(int(number)) for number in data.get(name, ()))
        if "friction" in data:
            rest["friction"] = find_law(data["friction"])()
        return replace(self, **rest).with_values(data["parameters"])


Brushless.__doc__ = with_rows(Brushless.__doc__)
_PLAIN = ("inputs", "placed", "warmed", "held_in", "steps")
_FRAMES = ("rotor", "stator")
_COLUMNS = ("v_d", "v_q", "duty", "bus", ANGLE, TEMPERATURE)
_MEASURED = (Signal.D_CURRENT, Signal.Q_CURRENT, Signal.SPEED)
_STATE_OF = {Signal.SPEED: _SPEED, Signal.POSITION: _ANGLE, Signal.D_CURRENT: _D, Signal.Q_CURRENT: _Q}


@cache
def _handles(law: type[FrictionLaw], cogging: tuple[int, ...], ripple: tuple[int, ...]) -> Mapping[str, Handle]:
    found: dict[str, Handle] = {}
    for name, symbol, unit, description, measure, lower in _ROWS:
        found |= scalar((name,), Parameter(name, symbol, unit, description), measure, lower)
    found |= effect_handles(Winding)
    found |= law_handles(("friction",), "friction", law) | gravity_handles()
    for part, letters, unit, of, measure, numbers in (
        ("cogging", "ab", "N*m", "the cogging", Measure.FORCE, cogging),
        ("torque_ripple", "cs", "1", "the torque by current, as a part of it", Measure.FACTOR, ripple),
    ):
        for k, number in enumerate(numbers):
            for field, (wave, letter) in enumerate(zip(("cosine", "sine"), letters, strict=True), 1):
                name = f"{part}.{number}.{wave}"
                parameter = Parameter(name, f"{letter}_{number}", unit, f"{wave} of {of}, {number} periods per turn")
                found |= scalar((part, k, field), parameter, measure, -inf)
    return found


def over_angle(harmonics: Sequence[Harmonic], angle: Array) -> Array:
    """The sum of harmonics at angles in rad, of any shape."""
    total = np.zeros(angle.shape)
    for number, cosine, sine in harmonics:
        total += cosine * np.cos(number * angle) + sine * np.sin(number * angle)
    return total


def _measured(signals: Sequence[Signal], segment: Record, signal: Signal) -> Array:
    """(N,) an output; a speed that is not measured is the slope of the angle, or zero."""
    if signal in signals:
        return np.asarray(segment.output[:, signals.index(signal)])
    if signal is Signal.SPEED and Signal.POSITION in signals:
        return np.asarray(np.gradient(segment.output[:, signals.index(Signal.POSITION)], segment.dt))
    return np.zeros(len(segment))


def _windowed(lines: Array, samples: int) -> Array:
    """The means over windows of so many samples, times the root of their number."""
    whole = len(lines) // samples * samples
    return np.asarray(lines[:whole].reshape(-1, samples, lines.shape[1]).mean(axis=1) * np.sqrt(samples))


def _positive(names: Sequence[str], values: Sequence[float] | Array) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True) if TINY < value < inf}


class Machine(NamedTuple):
    """A brushless motor as numbers; see `Brushless` for the parameters.

    Attributes:
        settles: the part of a change of speed that its filter follows in a sample.
        follows: the part of an error of its angle that is corrected in a sample, where the angle is measured.
        acting: the parameters of its winding, see `emsid.models.plants.effects.Acting`.
        dt, late, at: sample time; the part of it during which the row before still acts; the row that acts at the
            sample of a straight voltage.
        wait: the delay in s.
        ripple: (n, 3) periods per turn, cosine and sine of the ripple by current.
        columns: of v_d, v_q, duty, bus voltage, angle and temperature among the inputs; −1 for none.
        signals: (ny,) what is read.
        steps: per sample.
        straight, stator: see `Brushless`.
        placed: whether the angle is known.
    """

    resistance: float
    inductance_d: float
    inductance_q: float
    flux: float
    pairs: float
    inertia: float
    advance: float
    dead: float
    width: float
    settles: float
    follows: float
    acting: Any
    dt: float
    late: float
    at: float
    wait: float
    ripple: Array
    columns: Integers
    signals: Integers
    steps: int
    straight: bool
    stator: bool
    placed: bool


class BrushlessSampler:
    """A brushless motor between two samples."""

    __slots__ = ("_friction", "_law", "_machine", "_motion", "_rows")

    def __init__(self, machine: Machine, law: Callable[..., Any], friction: Sliding, state: PlantState) -> None:
        """
        Args:
            machine: the motor as numbers.
            law: the friction law.
            friction: its parameters.
            state: where it begins.
        """
        self._machine, self._law, self._friction = machine, law, friction
        self._rows = np.concatenate([state.commands[:1], state.commands])
        self._motion = state.motion.copy()

    def advance(self, u: Array, y: Array) -> None:
        """Write the outputs (ny,) for inputs (nu,), and change the state."""
        self.run(u[None], y[None])

    def run(self, inputs: Array, outputs: Array) -> None:
        """Fill outputs (N, ny) for inputs (N, nu), and change the state."""
        kernel = compiled_with_law(self._law, brushless_run)
        kernel(self._machine, self._friction, self._rows, self._motion, NO_LOAD, inputs, outputs)

    def differentiated(self, inputs: Array, size: float) -> tuple[Array, Array]:
        """``ways`` and ``path`` of `brushless_differentiate`."""
        states = 5 + len(self._rows)
        ways = np.empty((len(inputs), len(self._machine.signals) + states, states + 1))
        path = np.empty((len(inputs), 3))
        kernel = compiled_with_law(self._law, brushless_differentiate)
        kernel(self._machine, self._friction, self._rows.copy(), self._motion.copy(), inputs, size, ways, path)
        return ways, path

    def written(self, single: bool) -> tuple[Any, tuple[Any, ...], bool, tuple[tuple[str, NDArray[Any]], ...]]:
        """See `emsid.models.plants.sampling.DrivenSampler.written`."""
        named = ("rows", self._rows.copy()), ("motion", self._motion.copy())
        return compiled_with_law(self._law, brushless_run), (self._machine, self._friction), False, named

    @property
    def state(self) -> PlantState:
        """The present state."""
        return PlantState(self._machine.dt, self._motion.copy(), self._rows[1:].copy(), NO_ROWS)


@_kernel
def brushless_run(
    m: Machine, friction: Sliding, rows: Array, motion: Array, load: Array, inputs: Array, out: Array
) -> None:
    """`brushless_sample` for every row of inputs (N, nu) and outputs (N, ny); there is no ``load``, which is (0,)."""
    work = np.empty((7, 2))
    for k in range(len(inputs)):
        brushless_sample(m, friction, rows, motion, work, inputs[k], out[k])


@_kernel
def brushless_sample(
    m: Machine, friction: Sliding, rows: Array, motion: Array, work: Array, u: Array, y: Array
) -> None:
    """Write the outputs (ny,) of a sample for inputs (nu,), and change its state.

    Args:
        m: the motor.
        friction: as for `move`.
        rows: (w + 1, 3) voltages, and the electrical angles at which the controller gave them, the oldest first.
        motion: (7,) the state.
        work: (7, 2) work array.
        u, y: inputs and outputs.
    """
    c, last = m.columns, len(rows) - 1
    for k in range(last):
        rows[k, 0], rows[k, 1], rows[k, 2] = rows[k + 1, 0], rows[k + 1, 1], rows[k + 1, 2]
    rows[last, 0] = u[c[0]] if c[0] >= 0 else 0.0
    rows[last, 1] = u[c[1]] if c[1] >= 0 else u[c[2]] * u[c[3]] / np.sqrt(3.0)
    if c[5] >= 0:
        motion[_RISE] = m.acting.temperature_coefficient * (u[c[5]] - _REFERENCE)
    if m.straight and motion[_BEGUN] > 0.0:
        for piece in range(m.steps):
            at = min(max(m.at - 1.0 + (piece + 0.5) / m.steps, 0.0), 1.0 * last)
            below = int(np.floor(at))
            after, part = min(below + 1, last), at - below
            v_d = (1.0 - part) * rows[below, 0] + part * rows[after, 0]
            v_q = (1.0 - part) * rows[below, 1] + part * rows[after, 1]
            _step(m, friction, v_d, v_q, 0.0, m.dt / m.steps, work, motion)
    seen = u[c[4]] if c[4] >= 0 else motion[_ANGLE]
    motion[_ANGLE] += (seen - motion[_ANGLE]) * (m.follows if motion[_BEGUN] > 0.0 else 1.0)
    rows[last, 2] = m.pairs * (seen + m.advance * motion[_SPEED])
    off = m.pairs * (seen - motion[_ANGLE])
    cosine, sine = np.cos(off), np.sin(off)
    for k in range(len(m.signals)):
        what = m.signals[k]
        if what == _AT_ANGLE:
            y[k] = motion[_ANGLE]
        elif what == _AT_SPEED:
            y[k] = motion[_READING] if m.settles < 1.0 else motion[_SPEED]
        elif what == _AT_D:
            y[k] = cosine * motion[_D] + sine * motion[_Q]
        else:
            y[k] = cosine * motion[_Q] - sine * motion[_D]
    before = motion[_SPEED]
    if not m.straight:
        for part in range(2):
            whole = m.late * m.dt if part == 0 else (1.0 - m.late) * m.dt
            if whole > 0.0:
                pieces = int(np.ceil(whole / m.dt * m.steps - 1e-9))
                for _ in range(pieces):
                    _step(m, friction, rows[part, 0], rows[part, 1], rows[part, 2], whole / pieces, work, motion)
    motion[_READING] += m.settles * (0.5 * (before + motion[_SPEED]) - motion[_READING])
    if m.acting.loss > 0.0:
        over = resistance(m.acting, abs(motion[_SPEED]), motion[_RISE])
        loss = m.acting.loss * over * (motion[_D] ** 2 + motion[_Q] ** 2)
        motion[_RISE] = risen(m.acting, motion[_RISE], loss, m.dt)
    motion[_BEGUN] = 1.0


@_kernel
def brushless_differentiate(
    m: Machine, friction: Sliding, rows: Array, motion: Array, inputs: Array, size: float, ways: Array, path: Array
) -> None:
    """What a small change of the state, or a torque, changes within every sample of a run.

    The state is that of the motion, and the w electrical angles at which the controller gave the voltages that still
    act: they hang on angle and speed at that time.

    Args:
        m, friction, rows, motion: as for `brushless_run`.
        inputs: (N, nu).
        size: the change of the state, in SI units; a torque is as large as that of the speed.
        ways: (N, ny + 6 + w, 7 + w) derivatives of outputs and of the next state by the state and by a torque in the
            sample.
        path: (N, 3) the angle in the middle of every sample, half of the way, and the torque of the currents.
    """
    work, outputs, states = np.empty((7, 2)), len(m.signals), 5 + len(rows)
    y, z = np.empty(outputs), np.empty(outputs)
    moved, past = np.empty(7), np.empty(rows.shape)
    push = size * m.inertia / m.dt
    pushed = Sliding(
        friction.numbers, friction.breakaway, friction.varies, friction.viscous, friction.quadratic, friction.waves,
        friction.load - push, friction.drop, friction.servo, friction.acting,
    )  # fmt: skip
    for k in range(len(inputs)):
        for j in range(states + 1):
            moved[:], past[:] = motion, rows
            if j < 6:
                moved[j] += size
            elif j < states:
                past[j - 5, 2] += size
            brushless_sample(m, friction if j < states else pushed, past, moved, work, inputs[k], z)
            ways[k, :outputs, j], ways[k, outputs : outputs + 6, j] = z, moved[:6]
            ways[k, outputs + 6 :, j] = past[1:, 2]
        before, torque = motion[_SPEED], motion[_Q] * (m.flux + (m.inductance_d - m.inductance_q) * motion[_D])
        brushless_sample(m, friction, rows, motion, work, inputs[k], y)
        torque += motion[_Q] * (m.flux + (m.inductance_d - m.inductance_q) * motion[_D])
        half = 0.25 * m.dt * (before + motion[_SPEED])
        path[k, 0], path[k, 1], path[k, 2] = motion[_ANGLE] - half, half, 0.75 * m.pairs * torque
        for j in range(states + 1):
            by = size if j < states else push
            for i in range(outputs):
                ways[k, i, j] = (ways[k, i, j] - y[i]) / by
            for i in range(states):
                now = motion[i] if i < 6 else rows[i - 5, 2]
                ways[k, outputs + i, j] = (ways[k, outputs + i, j] - now) / by


@_kernel
def _spread(ways: Array, path: Array, numbers: Array, by_current: NDArray[np.bool_], out: Array) -> None:
    """Fill out (N, ny, n, 2) with the effects of torques that are cosines and sines of the angle.

    Args:
        ways, path: of `brushless_differentiate`.
        numbers: (n,) periods per turn.
        by_current: (n,) whether the torque is a part of that of the currents; or it is one against the motion.
    """
    outputs, count, states = out.shape[1], len(numbers), ways.shape[2] - 1
    state, after, force = np.zeros((states, 2 * count)), np.zeros((states, 2 * count)), np.empty(2 * count)
    for k in range(len(ways)):
        for n in range(count):
            middle, half = numbers[n] * path[k, 0], numbers[n] * path[k, 1]
            mean = np.sin(half) / half if abs(half) > 1e-4 else 1.0
            mean *= path[k, 2] if by_current[n] else -1.0
            force[2 * n], force[2 * n + 1] = mean * np.cos(middle), mean * np.sin(middle)
        for i in range(outputs + states):
            row = ways[k, i, states] * force
            for j in range(states):
                if ways[k, i, j] != 0.0:
                    row += ways[k, i, j] * state[j]
            if i < outputs:
                out[k, i] = row.reshape((count, 2))
            else:
                after[i - outputs] = row
        state[:] = after


_REFERENCE = REFERENCE
_AT_ANGLE, _AT_SPEED, _AT_D, _AT_Q = range(4)
_ALONG = 4.0 / np.pi


@_kernel
def _step(
    m: Machine, friction: Sliding, v_d: float, v_q: float, angle: float, h: float, work: Array, motion: Array
) -> None:
    """Move the motor by h: half the step of the currents, the motion, and the other half.

    Args:
        m, friction, work, motion: as for `brushless_sample`.
        v_d, v_q: the voltages in V.
        angle: the electrical angle at which they were given, where an inverter holds them.
        h: in s.
    """
    for half in range(2):
        speed = m.pairs * motion[_SPEED]
        turn = 0.25 * h * speed
        place = m.pairs * motion[_ANGLE] + (turn if half == 0 else -turn)
        u_d, u_q = v_d, v_q
        if m.stator:
            back = (m.wait - m.advance) * speed if m.straight else place - angle
            whole = 1.0 - turn * turn / 6.0
            c, s = whole * np.cos(back), whole * np.sin(back)
            u_d, u_q = c * v_d + s * v_q, c * v_q - s * v_d
        motion[_D], motion[_Q] = _currents(m, motion, speed, u_d, u_q, 0.5 * h, place, turn, work)
        if half == 0:
            torque = 1.5 * m.pairs * (m.flux + (m.inductance_d - m.inductance_q) * motion[_D]) * motion[_Q]
            middle = motion[_ANGLE] + 0.5 * h * motion[_SPEED]
            more = 1.0
            for k in range(len(m.ripple)):
                phase = m.ripple[k, 0] * middle
                more += m.ripple[k, 1] * np.cos(phase) + m.ripple[k, 2] * np.sin(phase)
            for k in range(2):
                work[0, k], work[1, k] = torque * more, 0.0
            work[6, 0] = 0.0
            alone = Body(m.inertia, 0.0)
            move(alone, friction, work[0], work[1], work[6], h, 0.0, 1, 0, motion, work[2], work[3], work[4])


@_kernel
def _currents(
    m: Machine, motion: Array, speed: float, v_d: float, v_q: float, h: float, place: float, turn: float, work: Array
) -> tuple[float, float]:
    """The currents after a time h at constant speed and voltages: i∞ + e^{Ah}·(i − i∞), less what dead time takes.

    Args:
        m, motion, work: as for `brushless_sample`; rows 4 and 5 of ``work`` hold the shares in the phases.
        speed: ω_e in rad/s.
        v_d, v_q: in V.
        h: in s.
        place, turn: the electrical angle in the middle, and half of the way.
    """
    r = m.resistance * resistance(m.acting, abs(motion[_SPEED]), motion[_RISE])
    a, b = -r / m.inductance_d, speed * m.inductance_q / m.inductance_d
    c, d = -speed * m.inductance_d / m.inductance_q, -r / m.inductance_q
    of = a * d - b * c
    mean, square = 0.5 * (a + d), 0.25 * (a - d) ** 2 + b * c
    size, grown = square * h * h, np.exp(mean * h)
    if abs(size) < 1e-6:
        even, odd = grown * (1.0 + 0.5 * size), grown * h * (1.0 + size / 6.0)
    else:
        root = np.sqrt(abs(square))
        if square < 0.0:
            even, odd = grown * np.cos(root * h), grown * np.sin(root * h) / root
        else:
            slow, fast = np.exp((mean + root) * h), np.exp((mean - root) * h)
            even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / root
    e_dd, e_dq, e_qd, e_qq = even + odd * (a - mean), odd * b, odd * c, even + odd * (d - mean)
    p_d, p_q, s_d, s_q = -d / of, c / of, b / of, -a / of  # where the currents end, by the slopes that voltages give
    by_dd, by_qd = (p_d - e_dd * p_d - e_dq * p_q) / m.inductance_d, (p_q - e_qd * p_d - e_qq * p_q) / m.inductance_d
    by_dq, by_qq = (s_d - e_dd * s_d - e_dq * s_q) / m.inductance_q, (s_q - e_qd * s_d - e_qq * s_q) / m.inductance_q
    i_d, i_q, e_q = motion[_D], motion[_Q], v_q - speed * m.flux
    j_d, j_q = (
        e_dd * i_d + e_dq * i_q + by_dd * v_d + by_dq * e_q,
        e_qd * i_d + e_qq * i_q + by_qd * v_d + by_qq * e_q,
    )
    if m.dead <= 0.0:
        return j_d, j_q
    if not m.placed:
        x, y = i_d + j_d, i_q + j_q
        whole = np.sqrt(x * x + y * y) + 1e-30
        x, y = _ALONG * m.dead * x / whole, _ALONG * m.dead * y / whole
        way_d, way_q, length = by_dd * x + by_dq * y, by_qd * x + by_qq * y, _ALONG * m.dead
        most, i, j = (way_d * x + way_q * y) / length, (i_d * x + i_q * y) / length, (j_d * x + j_q * y) / length
        side = _mean_side(i, j, most, m.width)
        return j_d - way_d * side, j_q - way_q * side
    cosine, sine, c, s = np.cos(place), np.sin(place), np.cos(turn), np.sin(turn)
    begin_c, begin_s = cosine * c + sine * s, sine * c - cosine * s
    end_c, end_s = cosine * c - sine * s, sine * c + cosine * s
    for k in range(3):
        work[4 + k // 2, k % 2] = 0.0
    for n in range(6):  # phases have an effect on each other
        k = n % 3
        c, s, side = _PHASES[k, 0], _PHASES[k, 1], work[4 + k // 2, k % 2]
        x, y = m.dead * (cosine * c + sine * s) / 1.5, m.dead * (cosine * s - sine * c) / 1.5
        way_d, way_q = by_dd * x + by_dq * y, by_qd * x + by_qq * y
        j_d, j_q = j_d + way_d * side, j_q + way_q * side
        c_end, s_end = end_c * c + end_s * s, end_s * c - end_c * s
        i = i_d * (begin_c * c + begin_s * s) - i_q * (begin_s * c - begin_c * s)
        side = _mean_side(i, j_d * c_end - j_q * s_end, way_d * c_end - way_q * s_end, m.width)
        j_d, j_q = j_d - way_d * side, j_q - way_q * side
        work[4 + k // 2, k % 2] = side
    return j_d, j_q


_PHASES = np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]])
"""Cosine and sine of the places of the phases."""


@_kernel
def _mean_side(i: float, free: float, most: float, ripple: float) -> float:
    """The mean of ½·(sign(i − Δ) + sign(i + Δ)) over a straight way from i to j = ``free`` − ``most`` · mean.

    The mean is (F(j) − F(i))/(j − i) with F(i) = max(|i|, Δ), so that j is the root of a square on each side of Δ and
    of −Δ. A current stays where the voltage is less than what dead time takes.
    """
    way = 1.0 if i >= 0.0 else -1.0
    i, free = way * i, way * free
    if i >= ripple and free - most >= ripple:
        return way
    if i < ripple and abs(free) <= ripple:
        return 0.0
    side = -1.0
    if i < ripple < free:  # j > Δ
        half, rest, side = 0.5 * (free + i - most), free * i - most * ripple, 1.0
    elif i >= ripple and (ripple + free) * (ripple + i) + most * (ripple - i) >= 0.0:  # |j| ≤ Δ
        half, rest = 0.5 * (free + i), free * i + most * (ripple - i)
    else:  # j < −Δ
        half, rest = 0.5 * (free + i + most), free * i - most * max(i, ripple)
    j = half + side * np.sqrt(max(half * half - rest, 0.0))
    return float(way * max(min((free - j) / most, 1.0), -1.0))
