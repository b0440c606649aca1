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

from dataclasses import dataclass, replace
from enum import Enum
from math import inf, isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import DataError, ModelError
from emsid.excitation.between_samples import jumps, may_be_continuous
from emsid.models.plants.parameters import TINY, Handle, scalar
from emsid.plant.parameter import Measure, Parameter

Array = NDArray[np.float64]

# The longest delay in samples that a state can store.
LONGEST_DELAY = 1_000_000
PIECES = 4
"""Pieces of a sample in which a straight command is simulated."""
LONGEST_RISE = 1.0
"""The longest rise of a current in periods of the PWM; a slower one does not fall to zero between the pulses."""
_EARLIER, _LATER = GAUSS = (0.5 - 0.5 / sqrt(3), 0.5 + 0.5 / sqrt(3))
"""Between 0 and 1, the points of Gauss's rule of two points."""
FULL = _FULL = 1.0 - 1e-6
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
            DataError: as `check`.
        """
        self.check(inputs)
        command = inputs[:, 0]
        if not self.codes:
            return command
        coded = np.isin(inputs[:, -1 - self.loaded], [code for code, _ in self.codes])
        return np.where(coded, 0.0, command) if coded.any() else command

    def check(self, inputs: Array) -> None:
        """Refuse inputs (N, nu) of another number than command, codes and load have.

        Raises:
            DataError: for such inputs.
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

    @property
    def numbers(self) -> tuple[Array, Array, int]:
        """What `apply` takes: gain, offset, knee, factor beyond it, supply, loss, rise and freewheeling; (n, 2) the
        codes, and what the bridge then conducts; 1 with a load among the inputs, else 0."""
        switching = self.supply, self.loss, self.rise, self.freewheel
        codes = [(code, 1.0 if bridge is Bridge.BRAKE else 0.0) for code, bridge in self.codes]
        shape = np.array([self.gain, self.offset, self.knee, self.beyond, *switching])
        return shape, np.array(codes).reshape(-1, 2), int(self.loaded)

    def applied(self, inputs: Array) -> tuple[Array, Array]:
        """Voltage (N,) and conducting fraction (N,) for inputs (N, nu), before the delay."""
        self.check(inputs)
        rows = np.empty((len(inputs), 2 + self.loaded))
        apply_each(*self.numbers, np.array(inputs, dtype=float, order="C"), rows)
        return rows[:, 0], rows[:, 1]

    def standing(self, command: Array, dt: float, most: int | None = None, holding: float | None = None) -> Array:
        """(w + 1, 2) delayed voltages and conducting fractions for a constant command (nu,), and a third column of the
        load where there is one.

        For a straight command there are two rows more: one for the sample before, and last one of NaN, which says that
        no sample has been simulated yet.

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
        on_their_way = np.empty((whole + 1 + 2 * straight, 2 + self.loaded))
        apply_each(*self.numbers, np.array(command, dtype=float)[None, :], on_their_way[:1])
        on_their_way[1:] = on_their_way[0]
        if holding is not None:
            on_their_way[:, :2] = holding, 1.0
        if straight:
            on_their_way[-1] = np.nan
        return on_their_way


@njit(nogil=True, error_model="numpy")
def apply(shape: Array, codes: Array, loaded: int, inputs: Array, k: int, rows: Array, at: int) -> None:
    """Write voltage (force), conducting fraction and load, if there is one, for the inputs of a sample.

    Args:
        shape, codes, loaded: `Drive.numbers`.
        inputs, k: (N, nu), of which those of the sample.
        rows, at: (M, 2), or (M, 3) with a load, and the row that is written.
    """
    gain, offset, knee, beyond = shape[0], shape[1], shape[2], shape[3]
    supply, loss, rise, freewheel = shape[4], shape[5], shape[6], shape[7]
    if loaded:
        rows[at, 2] = inputs[k, inputs.shape[1] - 1]
    for code in range(len(codes)):
        if inputs[k, inputs.shape[1] - 1 - loaded] == codes[code, 0]:
            rows[at, 0], rows[at, 1] = 0.0, codes[code, 1]
            return
    voltage, conducts = gain * (inputs[k, 0] + offset), 1.0
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
    rows[at, 0], rows[at, 1] = voltage, conducts


@njit(nogil=True, error_model="numpy")
def apply_each(shape: Array, codes: Array, loaded: int, inputs: Array, rows: Array) -> None:
    """`apply` for the inputs (N, nu) of every sample."""
    for k in range(len(inputs)):
        apply(shape, codes, loaded, inputs, k, rows, k)


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
