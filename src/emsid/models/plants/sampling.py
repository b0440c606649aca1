"""A plant with a drive and a sensor sample by sample: the whole sample in one compiled call.

The kernels repeat `Drive`, `Sensor` and the motion of one mass or of a motor with shaft and inductance for one sample;
the tests hold them to the same numbers.

- A command that is held: outputs are read, then the plant moves over the sample that follows.
- A straight command: the plant moves over the sample before, in `PIECES` pieces, then outputs are read. At the first
  sample it does not move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit, with_functions
from emsid.errors import ModelError
from emsid.models.plants.drive import FULL, GAUSS, PIECES, Bridge, Drive
from emsid.models.plants.lost_motion import Apart, advance_apart
from emsid.models.plants.motor_motion import LONG_STEPS, SHORT_STEPS, is_stiff
from emsid.models.plants.one_mass import Sliding, compiled_with_law, dropped, move
from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.models.plants.state import NO_LOAD, PlantState
from emsid.plant import DeadZoneLaw, Motor
from emsid.plant.constants import Constants, Extra, acting_laws, constants, flattened, from_flat
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
_EARLIER, _LATER = GAUSS
_FULL = FULL
_PIECES = PIECES
_NO_LOAD = NO_LOAD
NO_ZONE = DeadZoneLaw(0.0, 0.0)
"""A dead zone without width, which changes nothing."""


class Outer(NamedTuple):
    """Drive and sensor as numbers.

    Attributes:
        drive: gain, offset, knee, factor beyond it, supply, loss, rise and freewheeling.
        codes: (n, 2) the codes among the commands, and what the bridge then conducts.
        timing: sample time in s; the part of a piece during which the row before still acts; the row that acts at the
            sample of a straight command.
        straight: whether the command is straight.
        signals: (ny,) what is read.
        sensor: motion per reading, offset, average, and of its lag 1 or 0 and the three weights.
    """

    drive: Array
    codes: Array
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
        numbers = (drive.gain, drive.offset, drive.knee, drive.beyond, drive.supply, drive.loss, drive.rise)
        codes = [(code, 1.0 if bridge is Bridge.BRAKE else 0.0) for code, bridge in drive.codes]
        lag = sensor.weights(dt) if sensor.lag else (0.0, 0.0, 0.0)
        return cls(
            np.array([*numbers, drive.freewheel]),
            np.array(codes).reshape(-1, 2),
            np.array([dt, late, past - delay]),
            straight,
            np.array([_CODES[signal] for signal in signals], dtype=np.int64),
            np.array([sensor.scale, sensor.offset, sensor.average, float(sensor.lag > 0), *lag]),
        )


class Inside(NamedTuple):
    """What is between the drive and the mass, as numbers.

    Attributes:
        zone: b_l, b_r, m_l and m_r of the dead zone.
        before, after: factors before and after it; together a force for the output of the drive.
        braking: force per speed where the bridge conducts.
        viscous: force per speed besides.
        load: constant force against the motion.
        mass: in kg or kg·m².
        per_ampere: force per ampere, for a current.
        lag: the time constant in s with which the force of the drive follows.
        drop: the force that a voltage drop takes from that of the drive.
    """

    zone: Array
    before: float
    after: float
    braking: float
    viscous: float
    load: float
    mass: float
    per_ampere: float
    lag: float
    drop: float = 0.0

    @staticmethod
    def numbers_of(zone: DeadZoneLaw | None) -> Array:
        """A dead zone as numbers."""
        known = zone or NO_ZONE
        return np.array([known.b_l, known.b_r, known.m_l, known.m_r])


class _DrivenSampler:
    """A plant with a drive and a sensor between two samples, in arrays that its kernel changes."""

    __slots__ = ("_count", "_kernel", "_motion", "_outer", "_rows", "_sensed")
    _kernel: Callable[..., None]

    def __init__(self, outer: Outer, state: PlantState) -> None:
        self._outer, self._rows, self._count = outer, _rows(state), np.array([_begun(state)])
        self._motion, self._sensed = state.motion.copy(), state.sensed.reshape(-1, 2).copy()

    @property
    def arrays(self) -> tuple[Array, Array, Array, Integers]:
        """The state: delayed rows, motion, the state of the sensor, whether a sample was simulated."""
        return self._rows.copy(), self._motion.copy(), self._sensed.copy(), self._count.copy()

    @property
    def _named(self) -> tuple[tuple[str, NDArray[Any]], ...]:
        """The arrays of the state by name, as the kernels take them."""
        rows, motion, sensed, begun = self.arrays
        return ("rows", rows), ("motion", motion), ("sensed", sensed), ("begun", begun)

    def _check_conducting(self) -> None:
        """Refuse a bridge that may coast.

        Raises:
            ModelError: for such a bridge.
        """
        if len(self._outer.codes) or self._outer.drive[7] > 0:
            raise ModelError("a motor with codes among its commands or a bridge that coasts has no form in C")

    @property
    def motion(self) -> Array:
        """The present motion, see `advance`; of a motor with a shaft its current, the speeds of rotor and load, the
        twist and the position. The next sample changes it."""
        return self._motion

    @property
    def state(self) -> PlantState:
        """The present state."""
        kept = self._rows[1:].copy()
        if self._outer.straight and not self._count[0]:
            kept = np.concatenate([kept, np.full((1, 2), np.nan)])
        return PlantState(float(self._outer.timing[0]), self._motion.copy(), kept, self._sensed.copy())


class OneMassSampler(_DrivenSampler):
    """One mass between two samples, or motor and load of a joint with backlash."""

    __slots__ = ("_arrays", "_inside", "_law", "_level", "_steps")

    def __init__(
        self, outer: Outer, inside: Inside | Apart, law: Level, friction: Sliding, steps: int, state: PlantState
    ) -> None:
        """
        Args:
            outer: drive and sensor.
            inside: between them and the mass, or the masses.
            law: the friction law.
            friction: its parameters.
            steps: steps per sample for a law that varies.
            state: where it begins.
        """
        super().__init__(outer, state)
        if isinstance(inside, Apart):
            self._kernel = with_functions(one_mass_sample, advance=compiled_with_law(law, advance_apart))
        else:
            self._kernel = compiled_with_law(law, one_mass_sample)
        self._level, self._inside, self._law = law, inside, friction
        self._steps = steps if friction.varies.any() or not self.of_one_mass else 1
        self._arrays = np.empty((6, 2))

    @property
    def of_one_mass(self) -> bool:
        """Whether its numbers are those of a friction law on one mass, which can be inverted and written elsewhere."""
        return not (self._law.servo.size or self._inside.lag or isinstance(self._inside, Apart))

    def advance(self, u: Array, y: Array) -> None:
        """Write the outputs (ny,) for inputs (nu,), and change the state."""
        self._kernel(
            self._outer,
            self._inside,
            self._law,
            self._steps,
            self._rows,
            self._motion,
            self._sensed,
            self._count,
            self._arrays,
            u,
            y,
        )
        if self._count[0] < 0:
            raise ModelError(UNMOVED)

    def written(
        self, single: bool
    ) -> tuple[Any, tuple[Any, ...], tuple[int, ...], tuple[tuple[str, NDArray[Any]], ...]]:
        """The kernel, the numbers that it takes first, the shape of its work array, and the state by name.

        Raises:
            ModelError: for a motor with inductance, whose bridge coasts or has codes among its commands.
        """
        if self._inside.lag:
            self._check_conducting()
        numbers = self._outer, self._inside, self._law, self._steps
        return self._kernel, numbers, self._arrays.shape, self._named

    @property
    def numbers(self) -> tuple[Outer, Inside | Apart, Sliding, int, Level]:
        """Drive and sensor, what is between them, the friction, steps per sample, and the friction law."""
        return self._outer, self._inside, self._law, self._steps, self._level


UNMOVED = (
    "the motor cannot be simulated over this sample: its bridge coasts, or its time constants are out of all "
    "proportion to the sample time"
)


class MotorSampler(_DrivenSampler):
    """A motor with a shaft between two samples."""

    __slots__ = ("_constants", "_laws", "_motor")

    def __init__(
        self,
        outer: Outer,
        motor: Motor,
        load: float,
        extra: Extra,
        state: PlantState,
    ) -> None:
        """
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
        super().__init__(outer, state)
        self._motor, self._laws = constants(motor, extra), acting_laws(motor)
        self._constants = np.concatenate([zone, method, flattened(self._motor)])
        self._kernel = with_laws(motor_sample, motor)

    def advance(self, u: Array, y: Array) -> None:
        """Write the outputs (ny,) for inputs (nu,), and change the state.

        Raises:
            ModelError: where the motor cannot be simulated, or a bridge coasts.
        """
        self._kernel(
            self._outer,
            self._constants,
            self._rows,
            self._motion,
            self._sensed,
            self._count,
            u,
            y,
        )
        if self._count[0] < 0:
            raise ModelError(UNMOVED)

    def written(
        self, single: bool
    ) -> tuple[Any, tuple[Any, ...], tuple[int, ...], tuple[tuple[str, NDArray[Any]], ...]]:
        """See `OneMassSampler.written`.

        Raises:
            ModelError: for a bridge that coasts or codes among the commands.
        """
        self._check_conducting()
        numbers = self._constants.copy()
        if single:
            numbers[5], numbers[6] = SHORT_STEPS.order, SHORT_STEPS.tolerance
        return self._kernel, (self._outer, numbers), (), self._named

    @property
    def numbers(self) -> tuple[Outer, Constants, Array, list[Level]]:
        """Drive and sensor, the motor, what `_move_motor` takes beside it, and the friction laws of rotor and load."""
        return self._outer, self._motor, self._constants[:10], [type(law).level for law in self._laws]


def _begun(state: PlantState) -> int:
    """Whether a sample has been simulated: of a straight command, a row of NaN says that none has."""
    return int(not np.isnan(state.commands[-1, 0]))


def _rows(state: PlantState) -> Array:
    """The delayed rows behind a first one that the next step drops."""
    kept = state.commands if _begun(state) else state.commands[:-1]
    return np.concatenate([kept[:1], kept])


@_kernel
def _apply(outer: Outer, u: Array, row: Array) -> None:
    """Write voltage (force) and conducting fraction for the inputs of a sample; see `Drive.applied`."""
    drive = outer.drive
    gain, offset, knee, beyond = drive[0], drive[1], drive[2], drive[3]
    supply, loss, rise, freewheel = drive[4], drive[5], drive[6], drive[7]
    command, last = u[0], u[-1]
    for k in range(len(outer.codes)):
        if last == outer.codes[k, 0]:
            row[0], row[1] = 0.0, outer.codes[k, 1]
            return
    voltage, conducts = gain * (command + offset), 1.0
    if np.isfinite(knee):
        voltage += (beyond - 1.0) * (voltage - min(max(voltage, -knee), knee))
    if np.isfinite(supply):
        if abs(voltage) < _FULL * supply:
            left = (1.0 - loss) * voltage
            duty = open_ = min(abs(left) / supply, 1.0)
            if rise > 0.0:
                risen = -np.expm1(-duty / rise)
                first = (1.0 + _EARLIER) * np.log1p(risen * (1.0 - _EARLIER) / (1.0 + _EARLIER))
                second = (1.0 + _LATER) * np.log1p(risen * (1.0 - _LATER) / (1.0 + _LATER))
                slope = (first - second) / (_LATER - _EARLIER)
                missing = first + _EARLIER * slope
                left = np.sign(left) * supply * (duty - rise * missing)
                open_ = duty - rise * slope
            voltage, conducts = left, 1.0 - freewheel * (1.0 - open_)
        else:
            voltage = min(max(voltage, -supply), supply)
    row[0], row[1] = voltage, conducts


@_kernel
def _put(outer: Outer, u: Array, rows: Array) -> None:
    """Move the delayed rows by one sample, and put the inputs of a sample behind them."""
    for k in range(len(rows) - 1):
        rows[k, 0], rows[k, 1] = rows[k + 1, 0], rows[k + 1, 1]
    _apply(outer, u, rows[-1])


@_kernel
def _read(rows: Array, at: float, column: int) -> float:
    """A row read between two; the first and the last go on."""
    below = int(np.floor(at))
    part = at - below
    last = len(rows) - 1
    here, after = rows[min(max(below, 0), last), column], rows[min(max(below + 1, 0), last), column]
    return float((1.0 - part) * here + part * after)


@_kernel
def _zoned(zone: Array, value: float) -> float:
    """The output of a dead zone."""
    return float(zone[3] * max(value - zone[1], 0.0) + zone[2] * min(value - zone[0], 0.0))


@_kernel
def _sense(outer: Outer, value: float, mean_of: bool, position: float, kept: Array) -> float:
    """The reading of a position or a speed, see `Sensor`; ``kept`` (2,) is its state."""
    ratio, offset, average, lags = outer.sensor[0], outer.sensor[1], outer.sensor[2], outer.sensor[3]
    if mean_of and average > 0.0:
        mean = value if np.isnan(kept[0]) else (position - kept[0]) / outer.timing[0]
        value = mean if average == 1.0 else average * mean + (1.0 - average) * value
    if lags > 0.0:
        reading = outer.sensor[4] * value + kept[1]
        kept[1] = outer.sensor[5] * value + outer.sensor[6] * reading
        value = reading
    kept[0] = position
    return float(value / ratio + offset)


@_kernel
def advance(inside: Inside, friction: Sliding, dt: float, late: float, steps: int, work: Array, motion: Array) -> None:
    """Move one mass over a time ``dt``; `emsid.models.plants.lost_motion.advance_apart` takes its place for two.

    Args:
        inside: what is between the drive and the mass.
        friction, steps: as for `move`.
        dt, late: the time in s, and the part of it in which the earlier output of the drive still acts.
        work: (6, 2) in its first rows the earlier and the later force of the drive, and what it brakes per speed.
        motion: (2,) speed and position, or (3,) with the force of a drive that lags.
    """
    for k in range(2):
        work[0, k] -= inside.load
        work[1, k] += inside.viscous
    there = work[2], work[3], work[4]
    move(inside.mass, friction, work[0], work[1], _NO_LOAD, dt, late, steps, inside.lag, motion, *there)
    _keep(motion, *there)


@_kernel
def one_mass_sample(
    outer: Outer,
    inside: Any,
    friction: Sliding,
    steps: int,
    rows: Array,
    motion: Array,
    sensed: Array,
    count: Integers,
    work: Array,
    u: Array,
    y: Array,
) -> None:
    """Write the outputs (ny,) of a plant for inputs (nu,), and change the arrays of its state.

    Args:
        outer, inside: drive and sensor, and what is between them and the mass.
        friction, steps: as for `advance`.
        rows: (w + 2, 2) delayed outputs of the drive.
        motion: speed and position first; see `advance`.
        sensed: (ny, 2) the state of the sensor.
        count: (1,) whether a sample has been simulated; −1 where a bridge coasts beside an inductance.
        work: (6, 2) work array.
        u, y: inputs and outputs.
    """
    _put(outer, u, rows)
    dt, late, zero = outer.timing[0], outer.timing[1], outer.timing[2]
    force, drag = work[0], work[1]
    if inside.lag > 0.0 and (rows[0, 1] != 1.0 or rows[1, 1] != 1.0):
        count[0] = -1
        return
    if outer.straight:
        if count[0] > 0:
            for piece in range(_PIECES):
                at = zero - 1.0 + (piece + 0.5) / _PIECES
                volts = _zoned(inside.zone, inside.before * _read(rows, at, 0))
                force[:] = inside.after * volts
                drag[:] = inside.braking * _read(rows, at, 1)
                advance(inside, friction, dt / _PIECES, 0.0, steps, work, motion)
        pull = inside.after * _zoned(inside.zone, inside.before * _read(rows, zero, 0))
        brake = inside.braking * _read(rows, zero, 1)
    else:
        for k in range(2):
            force[k] = inside.after * _zoned(inside.zone, inside.before * rows[k, 0])
            drag[k] = inside.braking * rows[k, 1]
        pull = late * force[0] + (1.0 - late) * force[1]
        brake = late * drag[0] + (1.0 - late) * drag[1]
    for k in range(len(outer.signals)):
        what = outer.signals[k]
        if what == _CURRENT:
            made = motion[2] if inside.lag > 0.0 else pull - brake * motion[0]
            y[k] = (made - dropped(made, inside.drop)) / inside.per_ampere
        else:
            value = motion[1] if what == _POSITION else motion[0]
            y[k] = _sense(outer, value, what != _POSITION, motion[1], sensed[k])
    if not outer.straight:
        advance(inside, friction, dt, late, steps, work, motion)
    count[0] = 1


@_kernel
def _keep(motion: Array, speeds: Array, positions: Array, made: Array) -> None:
    """Go on from the ends of a sample."""
    motion[0], motion[1] = speeds[1], positions[1]
    if len(motion) > 2:
        motion[2] = made[1]


@_kernel
def _move_motor(flat: Array, volts: Array, holds: Array, pieces: int, motion: Array) -> bool:
    """Move a motor over some pieces of constant voltage; whether it could be simulated.

    Args:
        flat: the dead zone of the motor; load torque, order, tolerance, longest step, budget of steps and whether rotor
            and load begin together; and the constants of the motor.
        volts, holds: (≥ pieces,) voltages and durations.
        pieces: how many, at most `PIECES`.
        motion: (5,) the state of `emsid.plant.State`, which is changed.
    """
    zone, method, m = flat[:4], flat[4:10], from_flat(flat[10:])
    armature, torques = np.empty(_PIECES), np.full(_PIECES, method[0])
    for k in range(pieces):
        armature[k] = _zoned(zone, volts[k])
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
def motor_sample(
    outer: Outer, flat: Array, rows: Array, motion: Array, sensed: Array, count: Integers, u: Array, y: Array
) -> None:
    """As `one_mass_sample`, for the general motor; ``count`` becomes −1 where it cannot be simulated.

    Args:
        outer: drive and sensor.
        flat: of `_move_motor`.
        rows, motion, sensed, count: the state; motion (5,) is that of `emsid.plant.State`.
        u, y: inputs and outputs.
    """
    _put(outer, u, rows)
    dt, late, zero = outer.timing[0], outer.timing[1], outer.timing[2]
    volts, holds = np.empty(_PIECES), np.empty(_PIECES)
    done, pieces = True, 0
    if outer.straight and count[0] > 0:
        for piece in range(_PIECES):
            at = zero - 1.0 + (piece + 0.5) / _PIECES
            volts[piece], holds[piece] = _read(rows, at, 0), dt / _PIECES
            done = done and _read(rows, at, 1) == 1.0
        pieces = _PIECES
    elif not outer.straight:
        done = rows[0, 1] == 1.0 and rows[1, 1] == 1.0
        if late <= 0.0 or late >= 1.0:
            volts[0], holds[0], pieces = rows[0 if late >= 1.0 else 1, 0], dt, 1
        else:
            volts[0], volts[1], holds[0], holds[1], pieces = rows[0, 0], rows[1, 0], late * dt, (1.0 - late) * dt, 2
    if outer.straight and pieces and done:
        done = _move_motor(flat, volts, holds, pieces, motion)
    for k in range(len(outer.signals)):
        what = outer.signals[k]
        if what == _CURRENT:
            y[k] = motion[0]
        elif what == _ROTOR_SPEED:
            y[k] = _sense(outer, motion[1], True, motion[4] + motion[3], sensed[k])
        else:
            y[k] = _sense(outer, motion[4] if what == _POSITION else motion[2], what == _SPEED, motion[4], sensed[k])
    if not outer.straight and done:
        done = _move_motor(flat, volts, holds, pieces, motion)
    count[0] = 1 if done else -1
