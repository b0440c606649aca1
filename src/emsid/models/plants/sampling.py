"""A plant with a drive and a sensor over some samples: the only place where one moves.

A free run, a live model and the texts in C and MATLAB are the same function, with many samples or one: first the drive,
then the motion, then the sensor.

- A command that is held: outputs are read, then the plant moves over the sample that follows.
- A straight command: the plant moves over the sample before, in `PIECES` pieces, then outputs are read. At the first
  sample it does not move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit, with_functions
from emsid.errors import ModelError
from emsid.models.plants.drive import PIECES, Drive, apply, apply_each
from emsid.models.plants.lost_motion import Apart, move_apart
from emsid.models.plants.motor_motion import LONG_STEPS, SHORT_STEPS, is_stiff
from emsid.models.plants.one_mass import Sliding, compiled_with_law, dropped, move
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor, sense
from emsid.models.plants.state import NO_LOAD, PlantState
from emsid.plant import DeadZoneLaw, Motor
from emsid.plant.constants import Extra, acting_laws, constants, flattened, from_flat
from emsid.plant.friction import Level
from emsid.plant.taylor import SPARE_STEPS, run, with_laws

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_kernel = njit(nogil=True, error_model="numpy")
_POSITION, _SPEED, _ROTOR_SPEED, _CURRENT = range(4)
_CODES = {
    Signal.POSITION: _POSITION,
    Signal.SPEED: _SPEED,
    Signal.ROTOR_SPEED: _ROTOR_SPEED,
    Signal.CURRENT: _CURRENT,
}
_PIECES = PIECES
NO_ZONE = DeadZoneLaw(0.0, 0.0)
"""A dead zone without width, which changes nothing."""


class Outer(NamedTuple):
    """Drive and sensor as numbers.

    Attributes:
        drive, codes, loaded: see `Drive.numbers`.
        timing: sample time in s; the part of a piece during which the row before still acts; the row that acts at the
            sample of a straight command.
        straight: whether the command is straight.
        signals: (ny,) what is read.
        sensor: see `Sensor.numbers`.
    """

    drive: Array
    codes: Array
    loaded: int
    timing: Array
    straight: bool
    signals: Integers
    sensor: Array

    @classmethod
    def of(cls, drive: Drive, sensor: Sensor, state: PlantState, signals: Sequence[Signal]) -> Outer:
        """The drive and the sensor of a plant in a state."""
        dt, delay = state.dt, drive.delay / state.dt
        straight = len(state.commands) > int(delay) + 1
        past = len(state.commands) - int(straight and bool(np.isnan(state.commands[-1, 0])))
        late = 0.0 if straight else min(delay - (past - 1), 1.0)
        read = np.array([_CODES[signal] for signal in signals], dtype=np.int64)
        return cls(*drive.numbers, np.array([dt, late, past - delay]), straight, read, sensor.numbers(dt))


class Inside(NamedTuple):
    """What is between the drive and the mass, as numbers.

    Attributes:
        zone: b_l, b_r, m_l and m_r of the dead zone.
        before, after: factors before and after it; together a force for the output of the drive.
        braking: force per speed where the bridge conducts.
        mass: in kg or kg·m².
        per_ampere: force per ampere, for a current.
        lag: the time constant in s with which the force of the drive follows.
        drop: the force that a voltage drop takes from that of the drive.
    """

    zone: Array
    before: float
    after: float
    braking: float
    mass: float
    per_ampere: float
    lag: float
    drop: float = 0.0

    @staticmethod
    def numbers_of(zone: DeadZoneLaw | None) -> Array:
        """A dead zone as numbers."""
        known = zone or NO_ZONE
        return np.array([known.b_l, known.b_r, known.m_l, known.m_r])


class DrivenSampler:
    """A plant with a drive and a sensor between two samples, in arrays that its kernel changes.

    Args:
        run: the kernel of a run.
        step: that of one sample, which moves the delayed rows first, for other languages.
        numbers: which they take first, drive and sensor before all.
        law: the friction law.
        state: where it begins.
    """

    __slots__ = ("_count", "_law", "_motion", "_numbers", "_rows", "_run", "_sensed", "_step")

    def __init__(
        self, run: Callable[..., None], step: Any, numbers: tuple[Any, ...], law: Any, state: PlantState
    ) -> None:
        begun = not np.isnan(state.commands[-1, 0])  # of a straight command, a row of NaN says that none has been
        kept = state.commands if begun else state.commands[:-1]
        self._run, self._step, self._numbers, self._law = run, step, numbers, law
        self._rows, self._count = np.concatenate([kept[:1], kept]), np.array([int(begun)])
        self._motion, self._sensed = state.motion.copy(), state.sensed.reshape(-1, 2).copy()

    @property
    def outer(self) -> Outer:
        """Drive and sensor."""
        outer: Outer = self._numbers[0]
        return outer

    @property
    def numbers(self) -> tuple[Any, ...]:
        """What the kernels take first – drive and sensor, what is between them, friction, steps per sample of one mass;
        drive and sensor, constants and what `_move_motor` takes beside them of another – and the friction law."""
        return (*self._numbers, self._law)

    @property
    def arrays(self) -> tuple[Array, Array, Array, Integers]:
        """The state: delayed rows, motion, the state of the sensor, whether a sample was simulated."""
        return self._rows.copy(), self._motion.copy(), self._sensed.copy(), self._count.copy()

    @property
    def of_one_mass(self) -> bool:
        """Whether its numbers are those of a friction law on one mass, which can be inverted and written elsewhere."""
        inside, outer = self._numbers[1], self.outer
        if not isinstance(inside, Inside) or outer.loaded or outer.sensor[7]:
            return False
        return not (self._numbers[2].servo.size or inside.lag)

    @property
    def motion(self) -> Array:
        """The present motion, see `move`; of a motor with a shaft its current, the speeds of rotor and load, the twist
        and the position. The next sample changes it."""
        return self._motion

    @property
    def state(self) -> PlantState:
        """The present state."""
        kept = self._rows[1:].copy()
        if self.outer.straight and not self._count[0]:
            kept = np.concatenate([kept, np.full((1, kept.shape[1]), np.nan)])
        return PlantState(float(self.outer.timing[0]), self._motion.copy(), kept, self._sensed.copy())

    def advance(self, u: Array, y: Array) -> None:
        """Write the outputs (ny,) for inputs (nu,), and change the state.

        Raises:
            ModelError: where the motor cannot be simulated, or a bridge coasts beside a shaft or an inductance.
        """
        self._rows[:-1] = self._rows[1:]
        moving = self._motion, self._sensed, self._count
        self._run(*self._numbers, self._rows, *moving, NO_LOAD, u[None, :], y[None, :])
        self._check()

    def run(self, inputs: Array, load: Array = NO_LOAD) -> Array:
        """The outputs (N, ny) for inputs (N, nu), after which the state is another one; under a further load (N,).

        Raises:
            ModelError: as `advance`.
        """
        width = len(self._rows)
        rows = np.concatenate([self._rows[1:], np.ones((len(inputs), self._rows.shape[1]))])
        outputs, given = np.empty((len(inputs), len(self.outer.signals))), np.array(inputs, dtype=float, order="C")
        moving = self._motion, self._sensed, self._count
        self._run(*self._numbers, rows, *moving, load, given, outputs)
        self._rows[-len(rows) :] = rows[-width:]
        self._check()
        return outputs

    def _check(self) -> None:
        if self._count[0] < 0:
            if (self._rows[:, 1] == 1.0).all():
                raise ModelError(UNMOVED)
            raise ModelError(COASTS, arguments=("mask",))

    def written(self, single: bool) -> tuple[Any, tuple[Any, ...], bool, tuple[tuple[str, NDArray[Any]], ...]]:
        """The kernel of a sample, the numbers that it takes first, whether the time that it takes varies, and the state
        by name.

        Args:
            single: whether it is computed in single precision.

        Raises:
            ModelError: for a motor with inductance or shaft whose bridge coasts or has codes among its commands.
        """
        numbers, general = self._numbers, len(self._motion) == 5 and isinstance(self._numbers[1], np.ndarray)
        if (general or numbers[1].lag) and (len(self.outer.codes) or self.outer.drive[7] > 0):
            raise ModelError("a motor with codes among its commands or a bridge that coasts has no form in C")
        if general and single:
            flat = numbers[1].copy()
            flat[5], flat[6] = SHORT_STEPS.order, SHORT_STEPS.tolerance
            numbers = numbers[0], flat
        rows, motion, sensed, begun = self.arrays
        named = ("rows", rows), ("motion", motion), ("sensed", sensed), ("begun", begun)
        return self._step, numbers, general, named


def one_mass_sampler(
    outer: Outer, inside: Inside | Apart, law: Level, friction: Sliding, steps: int, state: PlantState
) -> DrivenSampler:
    """One mass between two samples, or motor and load of a joint with backlash.

    Args:
        outer: drive and sensor.
        inside: between them and the mass, or the masses.
        law: the friction law.
        friction: its parameters.
        steps: steps per sample for a law that varies.
        state: where it begins.
    """
    apart = isinstance(inside, Apart)
    return DrivenSampler(*_of_one_mass(law, apart), (outer, inside, friction, steps), law, state)


@cache
def _of_one_mass(law: Level, apart: bool) -> tuple[Any, Any]:
    """The kernels of a run and of a sample with a friction law."""
    if not apart:
        return compiled_with_law(law, one_mass_run), compiled_with_law(law, one_mass_step)
    other = compiled_with_law(law, move_apart)
    return with_functions(one_mass_run, move=other), with_functions(one_mass_step, move=other)


def motor_sampler(outer: Outer, motor: Motor, load: float, extra: Extra, state: PlantState) -> DrivenSampler:
    """A motor with a shaft between two samples.

    Args:
        outer: drive and sensor.
        motor: the motor.
        load: constant torque on it in N·m.
        extra: what else acts on it.
        state: where it begins.
    """
    pieces, how = PIECES if outer.straight else 2, LONG_STEPS
    stiff = is_stiff(motor, state.dt / PIECES if outer.straight else state.dt)
    motor = motor.rigid() if stiff else motor
    budget = float(SPARE_STEPS + how.most_steps * pieces)
    method = [load, float(how.order), how.tolerance, how.longest_step, budget, float(stiff)]
    zone = Inside.numbers_of(motor.voltage_dead_zone)
    flat = np.concatenate([zone, method, flattened(constants(motor, extra))])
    kernels = with_laws(motor_run, motor), with_laws(motor_step, motor)
    return DrivenSampler(*kernels, (outer, flat), acting_laws(motor), state)


UNMOVED = (
    "the motor cannot be simulated over this sample: its time constants are out of all proportion to the sample time"
)
COASTS = (
    "a bridge that coasts is simulated for a rigid motor without inductance only; choose rigid-motor, or leave out "
    "these samples with a mask"
)


@_kernel
def _shift(rows: Array) -> None:
    """Move the delayed rows by one sample."""
    for k in range(len(rows) - 1):
        for column in range(rows.shape[1]):
            rows[k, column] = rows[k + 1, column]


@_kernel
def _read(rows: Array, k: int, last: int, at: float, column: int) -> float:
    """A row read between two of those from k to k + last; the first and the last go on."""
    below = int(np.floor(at))
    part = at - below
    here, after = rows[k + min(max(below, 0), last), column], rows[k + min(max(below + 1, 0), last), column]
    return float((1.0 - part) * here + part * after)


@_kernel
def _zoned(zone: Array, value: float) -> float:
    """The output of a dead zone."""
    return float(zone[3] * max(value - zone[1], 0.0) + zone[2] * min(value - zone[0], 0.0))


@_kernel
def one_mass_run(
    outer: Outer,
    inside: Any,
    friction: Sliding,
    steps: int,
    rows: Array,
    motion: Array,
    sensed: Array,
    count: Integers,
    load: Array,
    inputs: Array,
    outputs: Array,
) -> None:
    """Write the outputs (N, ny) of a plant for inputs (N, nu), and change the arrays of its state.

    Args:
        outer, inside: drive and sensor, and what is between them and the mass.
        friction, steps: as for `move`; for two masses `move_apart` takes its place.
        rows: (w + 1 + N, 2 or 3) delayed outputs of the drive, and the load among the inputs.
        motion: speed and position first; see `move`.
        sensed: (ny, 2) the state of the sensor.
        count: (1,) whether a sample has been simulated; −1 where a bridge coasts beside an inductance.
        load: (N,) a load besides the others; (0,) without one.
        inputs, outputs: (N, nu) and (N, ny).
    """
    dt, late, zero = outer.timing[0], outer.timing[1], outer.timing[2]
    newest, pieces, ahead = len(rows) - len(inputs), _PIECES if outer.straight else 1, 1 if outer.straight else 0
    apply_each(outer.drive, outer.codes, outer.loaded, inputs, rows[newest:])
    acting = np.empty((6, pieces * len(inputs) + 1))
    force, drag, loads, speeds, positions, made = acting[0], acting[1], acting[2], acting[3], acting[4], acting[5]
    if not outer.straight:
        force[0] = inside.after * _zoned(inside.zone, inside.before * rows[0, 0])
        drag[0] = inside.braking * rows[0, 1]
    for k in range(len(inputs)):
        for piece in range(pieces):
            n, into = pieces * k + piece, (piece + 0.5) / pieces - 1.0
            volts = _read(rows, k, newest, zero + into, 0) if outer.straight else rows[k + 1, 0]
            conducts = _read(rows, k, newest, zero + into, 1) if outer.straight else rows[k + 1, 1]
            if inside.lag > 0.0 and conducts != 1.0:
                count[0] = -1
                return
            force[n + 1] = inside.after * _zoned(inside.zone, inside.before * volts)
            drag[n + 1] = inside.braking * conducts
            loads[n] = load[k] if len(load) > 0 else 0.0
            if outer.loaded:
                loads[n] += _read(rows, k, newest, newest + into, 2) if outer.straight else rows[k + newest, 2]
    if outer.straight:
        force[0], drag[0] = force[1], drag[1]
    still = pieces if outer.straight and count[0] == 0 else 0
    move(inside, friction, force, drag, loads, dt / pieces, late, steps, still, motion, speeds, positions, made)
    for k in range(len(inputs)):
        at = pieces * (k + ahead)
        for n in range(len(outer.signals)):
            what = outer.signals[n]
            if what != _CURRENT:
                outputs[k, n] = sense(outer.sensor, dt, speeds[at], positions[at], what != _POSITION, sensed, n)
                continue
            if outer.straight:
                pull = inside.after * _zoned(inside.zone, inside.before * _read(rows, k, newest, zero, 0))
                brake = inside.braking * _read(rows, k, newest, zero, 1)
            else:
                pull = late * force[k] + (1.0 - late) * force[k + 1]
                brake = late * drag[k] + (1.0 - late) * drag[k + 1]
            easier = made[at] if friction.acting.loss > 0.0 and inside.lag == 0.0 else 1.0
            torque = made[at] if inside.lag > 0.0 else easier * (pull - brake * speeds[at])
            outputs[k, n] = (torque - dropped(torque, easier * inside.drop)) / inside.per_ampere
    count[0] = 1


@_kernel
def one_mass_step(
    outer: Outer, inside: Any, friction: Sliding, steps: int,
    rows: Array, motion: Array, sensed: Array, count: Integers, load: Array, inputs: Array, outputs: Array,
) -> None:  # fmt: skip
    """`one_mass_run` for one sample, after the delayed rows have moved by one."""
    _shift(rows)
    one_mass_run(outer, inside, friction, steps, rows, motion, sensed, count, load, inputs, outputs)


@_kernel
def _move_motor(flat: Array, volts: Array, holds: Array, loads: Array, pieces: int, motion: Array) -> bool:
    """Move a motor over some pieces of constant voltage; whether it could be simulated.

    Args:
        flat: the dead zone of the motor; load torque, order, tolerance, longest step, budget of steps and whether rotor
            and load begin together; and the constants of the motor.
        volts, holds, loads: (≥ pieces,) voltages, durations, and load torques besides the constant one.
        pieces: how many, at most `PIECES`.
        motion: (5,) the state of `emsid.plant.State`, which is changed.
    """
    zone, method, m = flat[:4], flat[4:10], from_flat(flat[10:])
    armature, torques = np.empty(_PIECES), np.empty(_PIECES)
    for k in range(pieces):
        armature[k], torques[k] = _zoned(zone, volts[k]), method[0] + loads[k]
    states = np.empty((_PIECES + 1, 5))
    for k in range(5):
        states[0, k] = motion[k]
    if method[5] > 0.0:
        states[0, 1], states[0, 3] = states[0, 2], 0.0
    spent, instant, events, counts = np.empty(0), np.empty(0), np.empty((0, 3), np.int64), np.zeros(2, np.int64)
    order, tolerance, longest, budget = int(method[1]), method[2], method[3], method[4]
    held = volts[:pieces], holds[:pieces]
    run(m, held[0], armature, torques, held[1], order, tolerance, longest, budget, False, states, spent, instant,
        events, counts)  # fmt: skip
    for k in range(5):
        motion[k] = states[pieces, k]
    return bool(counts[1] == pieces)


@_kernel
def motor_run(
    outer: Outer,
    flat: Array,
    rows: Array,
    motion: Array,
    sensed: Array,
    count: Integers,
    load: Array,
    inputs: Array,
    outputs: Array,
) -> None:
    """As `one_mass_run`, for the general motor; ``count`` becomes −1 where it cannot be simulated.

    Args:
        outer: drive and sensor.
        flat: of `_move_motor`.
        rows, motion, sensed, count: the state; motion (5,) is that of `emsid.plant.State`.
        load, inputs, outputs: as for one mass.
    """
    dt, late, zero = outer.timing[0], outer.timing[1], outer.timing[2]
    newest = len(rows) - len(inputs)
    volts, holds, loads = np.empty(_PIECES), np.empty(_PIECES), np.empty(_PIECES)
    for k in range(len(inputs)):
        apply(outer.drive, outer.codes, outer.loaded, inputs, k, rows, k + newest)
        done, pieces, more = True, 0, load[k] if len(load) > 0 else 0.0
        if outer.straight and count[0] > 0:
            for piece in range(_PIECES):
                into = (piece + 0.5) / _PIECES - 1.0
                volts[piece], holds[piece] = _read(rows, k, newest, zero + into, 0), dt / _PIECES
                loads[piece] = more + _read(rows, k, newest, newest + into, 2) if outer.loaded else more
                done = done and _read(rows, k, newest, zero + into, 1) == 1.0
            pieces = _PIECES
        elif not outer.straight:
            done = rows[k, 1] == 1.0 and rows[k + 1, 1] == 1.0
            loads[0] = more + rows[k + newest, 2] if outer.loaded else more
            loads[1] = loads[0]
            if late <= 0.0 or late >= 1.0:
                volts[0], holds[0], pieces = rows[k if late >= 1.0 else k + 1, 0], dt, 1
            else:
                volts[0], volts[1], pieces = rows[k, 0], rows[k + 1, 0], 2
                holds[0], holds[1] = late * dt, (1.0 - late) * dt
        if outer.straight and pieces and done:
            done = _move_motor(flat, volts, holds, loads, pieces, motion)
        for n in range(len(outer.signals)):
            what = outer.signals[n]
            if what == _CURRENT:
                outputs[k, n] = motion[0]
            elif what == _ROTOR_SPEED:
                outputs[k, n] = sense(outer.sensor, dt, motion[1], motion[4] + motion[3], True, sensed, n)
            else:
                outputs[k, n] = sense(outer.sensor, dt, motion[2], motion[4], what == _SPEED, sensed, n)
        if not outer.straight and done:
            done = _move_motor(flat, volts, holds, loads, pieces, motion)
        count[0] = 1 if done else -1
        if not done:
            return


@_kernel
def motor_step(
    outer: Outer, flat: Array,
    rows: Array, motion: Array, sensed: Array, count: Integers, load: Array, inputs: Array, outputs: Array,
) -> None:  # fmt: skip
    """`motor_run` for one sample, after the delayed rows have moved by one."""
    _shift(rows)
    motor_run(outer, flat, rows, motion, sensed, count, load, inputs, outputs)
