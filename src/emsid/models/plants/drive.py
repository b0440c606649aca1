"""The drive between the command in a log and a plant.

It converts the command to a voltage (or force): v = gain·(u(t − delay) + offset), limited by the supply. Beyond a knee
the gain may be larger: a bridge loses a part of every period to switching, except near full duty, where it does not
switch. A bridge that leaves the armature open in the off-time of its PWM brakes only while it conducts. With the duty
ρ = |v|/supply and the freewheel factor λ, the armature conducts during the fraction

    c = 1 − λ·(1 − ρ)

of a period, with ±supply across it. Its mean torque is K_m/R_a·(v − c·K_m·ω), so the effect of the back electromotive
force decreases with the duty. A bridge that switches loses a part ℓ of its on-time; at full duty it does not switch:

    ρ = (1 − ℓ)·|v|/supply  below the supply,      ρ = 1  at the supply.

The current of a bridge that coasts rises in every pulse as 1 − e^{−t/τ} with τ = L_a/R_a. After the pulse it flows on,
against the supply, until it is zero. With the rise time κ = τ/T, in periods T of the PWM, and the back electromotive
force ε in units of the supply, the mean current of a pulse of duty ρ is, in units of the supply over R_a,

    (1 − ε)·ρ − κ·f(ε),      f(ε) = (1 + ε)·ln(1 + (1 − e^{−ρ/κ})·(1 − ε)/(1 + ε)).

Below the supply, f is replaced by the line f₀ − f₁·ε through its values at the points of Gauss's rule for 0 < ε < 1,
which is nearly the best line in the mean square. Then ρ − κ·f₀ takes the place of ρ in v, and ρ − κ·f₁ in c. Short
pulses have little effect, as after a dead zone.

Codes among the commands stand for a bridge that brakes (c = 1, v = 0) or coasts (c = 0).

**Between the samples** a command is held, as that of a digital output is, or it goes straight from one sample to the
next, as a signal that was only sampled nearly does. A straight command is simulated in `PIECES` pieces of every sample,
each with the voltage at its middle. So dead zones, limits and a delay by any part of a sample act where they do, and
the force on a linear plant is exact in its mean over every piece. Which of the two it does may differ by record, as
where steps come from a digital output and sines were sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from math import inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.excitation.between_samples import jumps, may_be_continuous
from emsid.models.plants.parameters import TINY, Handle, scalar
from emsid.models.plants.state import NO_LOAD
from emsid.plant.parameter import Measure, Parameter

Array = NDArray[np.float64]

# The longest delay in samples that a state can store.
LONGEST_DELAY = 1_000_000
PIECES = 4
"""Pieces of a sample in which a straight command is simulated."""
LONGEST_RISE = 1.0
"""The longest rise of a current in periods of the PWM; a slower one does not fall to zero between the pulses."""
GAUSS = (0.5 - 0.5 / sqrt(3), 0.5 + 0.5 / sqrt(3))
"""Between 0 and 1, the points of Gauss's rule of two points."""
FULL = 1.0 - 1e-6
"""A command of this part of the supply is full duty."""
FEWEST = 30
"""With fewer samples a record does not show its hold; then it has the first-order hold, as the others do."""


class Feed(Enum):
    """The quantity that the drive applies to the motor."""

    VOLTAGE = "voltage"
    CURRENT = "current"
    TORQUE = "torque"
    POSITION = "target position"


class Bridge(Enum):
    """The state of the bridge for a code among the commands."""

    BRAKE = "brake"
    COAST = "coast"


class Hold(Enum):
    """The hold: the course of a command between its samples, as in zero-order and first-order hold."""

    ZERO = "zero"  # it keeps its value
    FIRST = "first"  # a straight line to the next sample
    RECORD = "record"  # straight in a record where it changes at every sample and never jumps, else held


class Acting(NamedTuple):
    """The output of a drive over a run of N samples, in M pieces in which it is constant.

    Attributes:
        voltage, conducts: (M + 1,) voltage and conducting fraction of every piece; the first acts before the first one.
        dt: duration of a piece in s.
        late: the part of a piece during which the value before it still acts.
        samples: which of the M + 1 ends of pieces are the N samples.
        now: (N,) voltage and conducting fraction at the samples; None where they keep their values after them.
        left: the commands that a state keeps after the run.
        load: (M + 1,) the load of the inputs in every piece, and a last value without meaning; (0,) without one.
    """

    voltage: Array
    conducts: Array
    dt: float
    late: float
    samples: slice
    now: tuple[Array, Array] | None
    left: Array
    load: Array


class ActingEach(NamedTuple):
    """What a drive does over S runs, one after the other.

    Attributes:
        voltage, conducts: (M,) as in `Acting`.
        ends: (S + 1,) where runs begin, and M.
        dt, late: (S,) as in `Acting`.
        samples: which of the M are the samples of every run.
        load: (M,) as in `Acting`, or (0,).
    """

    voltage: Array
    conducts: Array
    ends: NDArray[np.intp]
    dt: Array
    late: Array
    samples: list[slice]
    load: Array

    @classmethod
    def of(cls, runs: Sequence[Acting]) -> ActingEach:
        """The runs, one after the other."""
        voltage, conducts, dt, late, samples, _, _, load = zip(*runs, strict=True)
        ends = np.cumsum([0, *map(len, voltage)])
        inside = (range(a, b)[some] for a, b, some in zip(ends.tolist(), ends[1:].tolist(), samples, strict=False))
        slices = [slice(some.start, some.stop, some.step) for some in inside]
        return cls(
            np.concatenate(voltage), np.concatenate(conducts), ends, np.array(dt), np.array(late), slices,
            np.concatenate(load),
        )  # fmt: skip

    def held(self, values: Sequence[Array]) -> Array:
        """(M,) values (N,) of every run, which are held over its samples."""
        lengths = np.diff(self.ends).tolist()
        each = zip(values, lengths, strict=True)
        return np.concatenate([some[np.maximum(np.arange(n) - 1, 0) * len(some) // max(n - 1, 1)] for some, n in each])


@dataclass(frozen=True)
class Drive:
    """The drive between the command in a log and the terminals of the motor (or the force on an axis).

    Args:
        gain: volts (newtons) per unit of command.
        offset: added to the command, in its unit.
        supply: the largest voltage (force), in V (N); infinite for no limit.
        delay: from the command to the terminals, in s.
        knee: voltage (force) above which the gain changes, in V (N); infinite for none.
        beyond: factor of the gain beyond the knee.
        freewheel: λ, 0 for a bridge that always conducts and 1 for one that leaves the armature open in the off-time.
        codes: pairs of a code and the state of the bridge; codes are values of the command, or of the second input
            column if there is one.
        hold: the course of the command between its samples.
        loss: ℓ, the part of its on-time that the bridge loses below full duty, where it switches.
        rise: κ, the time constant of the armature current over the period of the PWM, for a bridge that coasts.
        loaded: whether the last input is no command but a load on the mass, a torque in N·m (a force in N) against the
            motion forward. It acts without delay, and between its samples it is held or straight as the command is.

    Raises:
        ModelError: for a value that is not physical, a bridge that coasts without a supply voltage, or codes in a
            command that is not held.
    """

    gain: float = 1.0
    offset: float = 0.0
    supply: float = inf
    delay: float = 0.0
    knee: float = inf
    beyond: float = 1.0
    freewheel: float = 0.0
    codes: tuple[tuple[float, Bridge], ...] = ()
    hold: Hold = Hold.ZERO
    loss: float = 0.0
    rise: float = 0.0
    loaded: bool = False

    def __post_init__(self) -> None:
        if self.codes and self.hold is not Hold.ZERO:
            raise ModelError("a command with codes is held between its samples; give hold='zero'", arguments=("hold",))
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
        if not 0 <= self.loss < 1:
            raise ModelError(f"drive with a loss of {self.loss} of its on-time; give 0 (none) to less than 1")
        if not 0 <= self.rise <= LONGEST_RISE:
            raise ModelError(f"drive with a rise of {self.rise} periods; give 0 (none) to {LONGEST_RISE:g}")
        if not 0 <= self.freewheel <= 1:
            raise ModelError(f"drive with freewheel {self.freewheel}; give 0 (always conducts) to 1 (open when off)")
        if (self.freewheel > 0 or self.rise > 0) and not isfinite(self.supply):
            raise ModelError("a bridge that coasts in its off-time needs its supply voltage: give drive.supply")

    def commands(self, inputs: Array) -> Array:
        """(N,) the commands in inputs (N, 1), or (N, 2) with the state of the bridge; zero for codes.

        Raises:
            DataError: for other inputs.
        """
        columns = 1 + bool(self.codes) + self.loaded
        if self.loaded and inputs.shape[1] < 2:
            raise DataError(
                "an input for a plant with a load torque or force is missing; give the command, then the load"
            )
        if inputs.shape[1] > columns:
            raise DataError(
                f"{inputs.shape[1]} inputs for a plant with one command; name the column that is the command, and "
                "after it at most one with codes for the state of the bridge, and what the codes mean, and a load last"
            )
        command = inputs[:, 0]
        if not self.codes:
            return command
        coded = np.isin(self._coded(inputs), [code for code, _ in self.codes])
        return np.where(coded, 0.0, command) if coded.any() else command

    def _coded(self, inputs: Array) -> Array:
        """(N,) the input that may hold codes: the last one that is no load."""
        return inputs[:, -1 - self.loaded]

    def loads(self, inputs: Array) -> Array:
        """(N,) the load in inputs (N, nu); (0,) without one."""
        return inputs[:, -1] if self.loaded else NO_LOAD

    def for_inputs(self, inputs: Array) -> Drive:
        """The drive as it is in a record with inputs (N, nu), where this differs by record."""
        if self.hold is not Hold.RECORD:
            return self
        command = self.commands(inputs)
        straight = len(command) < FEWEST or (may_be_continuous([command]) and not jumps(command))
        return replace(self, hold=Hold.FIRST if straight else Hold.ZERO)

    def largest(self, inputs: Array) -> float:
        """The largest voltage (force) that inputs (N, 1 or 2) command, in V (N), before any limit."""
        return float(np.max(np.abs(self.gain * (self.commands(inputs) + self.offset))))

    def after_knee(self, wanted: Array) -> Array:
        """Voltages (forces) after the knee, in V (N)."""
        if not isfinite(self.knee):
            return wanted
        extra = wanted - np.clip(wanted, -self.knee, self.knee)
        return wanted + (self.beyond - 1.0) * extra

    def applied(self, inputs: Array) -> tuple[Array, Array]:
        """Voltage (N,) and conducting fraction (N,) for inputs (N, nu), before the delay."""
        voltage, conducts = self.after_knee(self.gain * (self.commands(inputs) + self.offset)), np.ones(len(inputs))
        if isfinite(self.supply):
            switching = np.abs(voltage) < FULL * self.supply
            switched, open_ = self._switched(voltage)
            voltage = np.where(switching, switched, np.clip(voltage, -self.supply, self.supply))
            conducts = 1.0 - self.freewheel * (1.0 - np.where(switching, open_, 1.0))
        for code, bridge in self.codes:
            here = self._coded(inputs) == code
            voltage = np.where(here, 0.0, voltage)
            conducts = np.where(here, 1.0 if bridge is Bridge.BRAKE else 0.0, conducts)
        return voltage, conducts

    def _switched(self, voltage: Array) -> tuple[Array, Array]:
        """Voltages below full duty after the loss and the rise of the current, and what an open bridge conducts."""
        left = (1.0 - self.loss) * voltage
        duty = np.minimum(np.abs(left) / self.supply, 1.0)
        if not self.rise:
            return left, duty
        risen = -np.expm1(-duty / self.rise)
        first, second = ((1.0 + e) * np.log1p(risen * (1.0 - e) / (1.0 + e)) for e in GAUSS)
        slope = (first - second) / (GAUSS[1] - GAUSS[0])
        missing = first + GAUSS[0] * slope
        return np.sign(left) * self.supply * (duty - self.rise * missing), duty - self.rise * slope

    def standing(self, command: Array, dt: float, most: int | None = None, holding: float | None = None) -> Array:
        """(w + 1, 2) delayed voltages and conducting fractions for a constant command (nu,).

        For a straight command there are two rows more: one for the sample before, and last one of NaN, which says that
        no sample has been simulated yet; and with a load a third column with it.

        Args:
            command: the inputs of one sample.
            dt: sample time in s.
            most: number of samples of the run, which limits the stored delay.
            holding: the voltage before the first sample, where it is not that of the command.

        Raises:
            ModelError: for a delay of more than `LONGEST_DELAY` samples, if ``most`` is not given.
        """
        samples = self.delay / dt
        if most is None and samples > LONGEST_DELAY:
            raise ModelError(
                f"drive with a delay of {self.delay:g} s, {samples:.3g} samples of {dt:g} s; a model can keep "
                f"{LONGEST_DELAY:,} of them"
            )
        straight = self.hold is not Hold.ZERO
        whole = int(samples) if most is None else int(min(samples, most))
        on_their_way = np.empty((whole + 1 + 2 * straight, 2 + (straight and self.loaded)))
        on_their_way[:, :2] = np.ravel(self.applied(command[None, :])) if holding is None else (holding, 1.0)
        if straight and self.loaded:
            on_their_way[:, 2] = command[-1]
        if straight:
            on_their_way[-1] = np.nan
        return on_their_way

    def acting(self, inputs: Array, commands: Array, dt: float) -> Acting:
        """What the drive does over a run.

        Args:
            inputs: (N, nu).
            commands: the delayed commands before the first sample, the oldest first; see `standing`.
            dt: sample time in s.
        """
        if self.hold is Hold.FIRST or (self.hold is Hold.RECORD and len(commands) > int(self.delay / dt) + 1):
            return self._straight(inputs, commands, dt)
        voltage, conducts = self.applied(inputs)
        voltage, conducts = np.concatenate([commands[:, 0], voltage]), np.concatenate([commands[:, 1], conducts])
        late = min(self.delay / dt - (len(commands) - 1), 1.0)
        samples = len(inputs)
        left = np.column_stack([voltage[samples:], conducts[samples:]])
        kept = voltage[: samples + 1], conducts[: samples + 1]
        load = self.loads(inputs)
        return Acting(*kept, dt, late, slice(None, -1), None, left, np.append(load, load[-1:]))

    def acting_each(self, inputs: Sequence[Array], dt: float, holding: Sequence[float | None]) -> ActingEach:
        """What the drive does over several runs.

        Args:
            inputs: (N, nu) of every run.
            dt: sample time in s.
            holding: the voltage before every run; None for that of its first command.
        """
        whole = int(self.delay / dt)
        if self.hold is not Hold.ZERO or whole >= min(map(len, inputs)):
            runs = [(self.for_inputs(each), each, before) for each, before in zip(inputs, holding, strict=True)]
            return ActingEach.of([d.acting(u, d.standing(u[0], dt, len(u), before), dt) for d, u, before in runs])
        voltage, conducts = self.applied(np.concatenate(inputs))
        which, ends, samples = _delayed_rows(tuple(map(len, inputs)), whole)
        voltage, conducts = voltage[which], conducts[which]
        for begin, before in zip(ends.tolist(), holding, strict=False):
            if before is not None:
                voltage[begin : begin + whole + 1], conducts[begin : begin + whole + 1] = before, 1.0
        late = np.full(len(inputs), self.delay / dt - whole)
        load = np.concatenate([np.append(each, each[-1:]) for each in map(self.loads, inputs)])
        return ActingEach(voltage, conducts, ends, np.full(len(inputs), dt), late, samples, load)

    def _straight(self, inputs: Array, commands: Array, dt: float) -> Acting:
        """The same for a command that goes straight from sample to sample, simulated up to the last one."""
        first = bool(np.isnan(commands[-1, 0]))
        past = commands[:-1] if first else commands
        loads = (self.loads(inputs),) if self.loaded else ()
        rows = np.asfortranarray(np.concatenate([past, np.column_stack((*self.applied(inputs), *loads))]))
        begin = 0 if first else -1
        zero = len(past) - self.delay / dt  # the row that acts at the first sample
        conducting = bool(np.all(rows[:, 1] == 1.0))  # as a plain drive always does

        def at(instant: float, count: int) -> tuple[Array, Array]:
            voltage = _read(rows[:, 0], zero + instant, count)
            return voltage, np.ones(count) if conducting else _read(rows[:, 1], zero + instant, count)

        now = at(0.0, len(inputs))
        pieces = np.ones((2, 1 + (len(inputs) - 1 - begin) * PIECES))
        load = np.zeros(pieces.shape[1] * self.loaded)
        pieces[:, 0] = now[0][0], now[1][0]
        for piece in range(PIECES):
            into = pieces[:, 1 + piece :: PIECES]
            into[0], into[1] = at(begin + (piece + 0.5) / PIECES, into.shape[1])
            if self.loaded:  # without the delay of the drive
                load[piece:-1:PIECES] = _read(rows[:, 2], len(past) + begin + (piece + 0.5) / PIECES, into.shape[1])
        voltage, conducts = pieces
        samples = slice(None if first else PIECES, None, PIECES)
        return Acting(voltage, conducts, dt / PIECES, 0.0, samples, now, rows[len(rows) - len(past) :], load)

    def terminals(self, inputs: Array, dt: float) -> tuple[Array, Array, float]:
        """Voltage (M + 1,) and conducting fraction (M + 1,) of every piece, and their delay as a fraction of a piece.

        The first value acts before the first sample, where the first command is assumed.
        """
        drive = self.for_inputs(inputs)
        on = drive.acting(inputs, drive.standing(inputs[0], dt, len(inputs)), dt)
        return on.voltage, on.conducts, on.late


@lru_cache(maxsize=4)
def _delayed_rows(samples: tuple[int, ...], whole: int) -> tuple[NDArray[np.intp], NDArray[np.intp], list[slice]]:
    """Which command acts at every sample of runs after a delay of ``whole`` samples, and `ActingEach.ends, samples`."""
    firsts = np.cumsum([0, *samples[:-1]])
    rows = [k + np.maximum(np.arange(-whole - 1, n - whole), 0) for k, n in zip(firsts, samples, strict=True)]
    ends = np.cumsum([0, *(n + 1 for n in samples)])
    return np.concatenate(rows), ends, [slice(k, k + n) for k, n in zip(ends.tolist(), samples, strict=False)]


def _read(rows: Array, start: float, count: int) -> Array:
    """(count,) rows read at ``start``, ``start`` + 1, …, straight between two; the first and the last row go on."""
    start = max(start, -float(count + 1))  # long before the first row, all are equal to it
    below = int(np.floor(start))
    before, after = max(-below, 0), max(below + count + 1 - len(rows), 0)
    if before or after:
        rows = np.concatenate([np.full(before, rows[0]), rows, np.full(after, rows[-1])])
    part, here = start - below, below + before
    values: Array = (1.0 - part) * rows[here : here + count]
    values += part * rows[here + 1 : here + 1 + count]
    return values


def outer_handles(unit: str, word: str, measure: Measure, motion: str, reading: Measure) -> dict[str, Handle]:
    """The handles of drive and sensor.

    Args:
        unit, word, measure: of the output of the drive.
        motion, reading: unit and measure of the sensor reading.
    """

    def one(
        name: str,
        symbol: str,
        unit: str,
        description: str,
        measure: Measure,
        lower: float = 0.0,
        upper: float = inf,
    ) -> dict[str, Handle]:
        return scalar(tuple(name.split(".")), Parameter(name, symbol, unit, description), measure, lower, upper)

    factor, time = Measure.FACTOR, Measure.TIME
    return {
        **one("drive.gain", "k_u", unit, f"{word} per unit of command", measure),
        **one("drive.offset", "u₀", "1", "offset of the command, in its unit", factor, -inf),
        **one("drive.delay", "t_d", "s", "delay from the command to its effect", time),
        **one("drive.supply", "V_s", unit, f"limit of the supply in {word}", measure, TINY),
        **one("drive.knee", "V_k", unit, f"{word} above which the gain changes", measure, TINY),
        **one("drive.beyond", "γ", "1", "factor of the gain beyond the knee", factor),
        **one(
            "drive.loss",
            "ℓ",
            "1",
            "part of its on-time that a switching bridge loses",
            factor,
            0.0,
            0.9,
        ),
        **one("drive.rise", "κ", "1", "rise time of the current in periods of the PWM", factor, 0.0, LONGEST_RISE),
        **one("drive.freewheel", "λ", "1", "freewheeling in the off-time of the bridge, 0 to 1", factor, 0.0, 1.0),
        **one("sensor.lag", "t_s", "s", "time constant of the sensor", time),
        **one("sensor.offset", "y₀", motion, "sensor reading at rest", reading, -inf),
        **one("sensor.average", "ν", "1", "share of the mean over the sample before in a speed", factor, 0.0, 1.0),
        **one("sensor.ratio", "n", "1", "turns of the motor per turn measured", factor, -inf),
        **one(
            "sensor.radius", "r", "m", "radius of the wheel whose speed in m/s or way in m is measured", Measure.OTHER
        ),
    }
