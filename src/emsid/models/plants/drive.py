"""The drive, which is between the command in a log and a plant.

It makes the voltage (or force) from the command: v = gain·(u(t − delay) + offset), limited by the supply.
Beyond a knee the command may count more: a bridge loses a part of every period to switching, and gets it back near full
duty, where it no longer switches.
A bridge that leaves the armature open in the off-time of its PWM brakes only while it conducts. With ρ = |v|/supply
the duty and λ how far it does so, the armature conducts during

    c = 1 − λ·(1 − ρ)

of a period, with ±supply across it: its mean torque is K_m/R_a·(v − c·K_m·ω) for λ = 1 as for λ = 0, while the back
electromotive force counts for less the smaller the duty is. Codes among the commands stand for a bridge that brakes
(c = 1, v = 0) or coasts (c = 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError, ModelError
from emsid.models.plants.parameters import TINY, Handle, scalar
from emsid.plant.parameter import Measure, Parameter

Array = NDArray[np.float64]

# A delay of more samples than this is not kept between samples.
LONGEST_DELAY = 1_000_000


class Feed(Enum):
    """What a command is when it has been through the drive."""

    VOLTAGE = "voltage"
    CURRENT = "current"
    TORQUE = "torque"


class Bridge(Enum):
    """What a code among the commands tells the bridge to do."""

    BRAKE = "brake"
    COAST = "coast"


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
        codes: pairs of a value and what the bridge then does: commands that are none; where the input has a second
            column, values of that one.

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

    def commands(self, inputs: Array) -> Array:
        """(N,) what the inputs (N, 1), or (N, 2) with the state of the bridge, command; nothing where they are codes.

        Raises:
            DataError: for other inputs.
        """
        columns = 2 if self.codes else 1
        if inputs.shape[1] > columns:
            raise DataError(
                f"{inputs.shape[1]} inputs for a plant with one command; name the column that is the command, and "
                "after it at most one with codes for the state of the bridge, and what the codes mean"
            )
        command = inputs[:, 0]
        if not self.codes:
            return command
        coded = np.isin(inputs[:, -1], [code for code, _ in self.codes])
        return np.where(coded, 0.0, command) if coded.any() else command

    def largest(self, inputs: Array) -> float:
        """The largest voltage (force) that inputs (N, 1 or 2) command, in V (N), whatever limits it."""
        return float(np.max(np.abs(self.gain * (self.commands(inputs) + self.offset))))

    def bent(self, wanted: Array) -> Array:
        """What becomes of voltages (forces) beyond the knee, in V (N)."""
        if not isfinite(self.knee):
            return wanted
        extra = wanted - np.clip(wanted, -self.knee, self.knee)
        return wanted + (self.beyond - 1.0) * extra

    def made(self, inputs: Array) -> tuple[Array, Array]:
        """Voltage (N,) and conducting part (N,) that inputs (N, nu) command, before the delay."""
        voltage, conducts = self.bent(self.gain * (self.commands(inputs) + self.offset)), np.ones(len(inputs))
        if isfinite(self.supply):
            voltage = np.clip(voltage, -self.supply, self.supply)
            conducts = 1.0 - self.freewheel * (1.0 - np.abs(voltage) / self.supply)
        for code, bridge in self.codes:
            here = inputs[:, -1] == code
            voltage = np.where(here, 0.0, voltage)
            conducts = np.where(here, 1.0 if bridge is Bridge.BRAKE else 0.0, conducts)
        return voltage, conducts

    def standing(self, command: Array, dt: float, most: int | None = None) -> Array:
        """(w + 1, 2) voltage and conducting part that are on their way while one command (nu,) stands.

        Args:
            command: the inputs of one sample.
            dt: sample time in s.
            most: samples that the run is going to have; a longer delay is all the same to it.

        Raises:
            ModelError: for a delay of more than `LONGEST_DELAY` samples, where ``most`` is not given.
        """
        samples = self.delay / dt
        if most is None and samples > LONGEST_DELAY:
            raise ModelError(
                f"drive with a delay of {self.delay:g} s, {samples:.3g} samples of {dt:g} s; a model can keep "
                f"{LONGEST_DELAY:,} of them"
            )
        whole = int(samples) if most is None else int(min(samples, most))
        voltage, conducts = self.made(command[None, :])
        on_their_way = np.empty((whole + 1, 2))
        on_their_way[:, 0], on_their_way[:, 1] = voltage[0], conducts[0]
        return on_their_way

    def acting(self, inputs: Array, commands: Array, dt: float) -> tuple[Array, Array, float, Array]:
        """Voltage (N + 1,) and conducting part (N + 1,) of every sample, the part of a sample they come late by, and
        the commands (w + 1, 2) that are on their way after the last sample.

        Args:
            inputs: (N, nu).
            commands: (w + 1, 2) those that were on their way before the first sample; the first of them acted last.
            dt: sample time in s.
        """
        voltage, conducts = self.made(inputs)
        voltage, conducts = np.concatenate([commands[:, 0], voltage]), np.concatenate([commands[:, 1], conducts])
        late = min(self.delay / dt - (len(commands) - 1), 1.0)
        samples = len(inputs)
        left = np.column_stack([voltage[samples:], conducts[samples:]])
        return voltage[: samples + 1], conducts[: samples + 1], late, left

    def terminals(self, inputs: Array, dt: float) -> tuple[Array, Array, float]:
        """Voltage (N + 1,) and conducting part (N + 1,) of every sample, and the part of a sample they come late by.

        The first value is what acted before the first sample; the first command is taken to have stood until then.
        """
        return self.acting(inputs, self.standing(inputs[0], dt, len(inputs)), dt)[:3]


def outer_handles(unit: str, word: str, measure: Measure, motion: str, shown: Measure) -> dict[str, Handle]:
    """The handles of drive and sensor.

    Args:
        unit, word, measure: of what the drive makes.
        motion, shown: unit and measure of what the sensor shows.
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
        **one("drive.delay", "t_d", "s", "delay from the command to what it does", time),
        **one("drive.supply", "V_s", unit, f"most {word} that there are", measure, TINY),
        **one("drive.knee", "V_k", unit, f"{word} above which the command counts differently", measure, TINY),
        **one("drive.beyond", "γ", "1", "how many times more the command counts beyond the knee", factor),
        **one("drive.freewheel", "λ", "1", "how far the bridge coasts in its off-time", factor, 0.0, 1.0),
        **one("sensor.lag", "t_s", "s", "time constant of the sensor", time),
        **one("sensor.offset", "y₀", motion, "what the sensor shows at rest", shown, -inf),
        **one("sensor.ratio", "n", "1", "turns of the motor per turn measured", factor, -inf),
    }
