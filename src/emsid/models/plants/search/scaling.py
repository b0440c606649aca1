"""Records and plants in units of their own size, so that a search does not depend on the units of channels.

Divide the command by its largest value a and the output by its largest value b. A plant has the same motion in these
units if every parameter is divided by the scale of its unit: a force (torque) by f, a speed or a position by b, a
voltage by a, an inertia or a damping by f/b, and so on; times do not change. For a motor driven by a voltage, f = a²/b
leaves the resistance unchanged; for any other plant, f = a leaves the factor from command to force unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import isfinite, prod

import numpy as np

from emsid.models.plants.datasheet import Given
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import Handle, Signal
from emsid.models.plants.plant import Limits, Plant
from emsid.record import Record

# Exponents of (command, output, force) of units, and of those that are no product of others.
_EXPONENTS = {
    "V": (1, 0, 0), "A": (1, 0, 0), "N*m": (0, 0, 1), "N": (0, 0, 1), "rad": (0, 1, 0), "m": (0, 1, 0), "J": (0, 1, 1),
    "kg*m^2": (0, -1, 1), "kg": (0, -1, 1), "V*s/rad": (-1, 0, 1), "m/s^2": (0, 2, 0),
    "s": (0, 0, 0), "ohm": (0, 0, 0), "H": (0, 0, 0), "K": (0, 0, 0), "1": (0, 0, 0),
}  # fmt: skip
# Parameters of the drive in units of the command, those per unit of it, and a weight m with a torque m·g·l, where l is
# scaled as the output; the speeds of a wheel and its motor are scaled alike.
_BY_NAME = {
    "drive.offset": (1, 0, 0), "drive.gain": (0, 0, 0), "gravity.mass": (0, -3, 1), "sensor.radius": (0, 0, 0),
}  # fmt: skip


def _exponents(name: str, handle: Handle) -> tuple[int, int, int] | None:
    return _BY_NAME.get(name) or _of_unit(handle.parameter.unit)


@cache
def _of_unit(unit: str) -> tuple[int, int, int] | None:
    """The exponents of a unit such as ``N*m*s/rad``; None where a part of it is not known."""
    if unit in _EXPONENTS:
        return _EXPONENTS[unit]
    above, _, below = unit.partition("/")
    found = np.zeros(3, dtype=int)
    for side, sign in ((above, 1), (below.strip("()"), -1)):
        torque = "N*m" if side.startswith("N*m") else ""
        for part in filter(None, (torque, *side.removeprefix(torque).split("*"))):
            name, _, power = part.partition("^")
            if name not in _EXPONENTS:
                return None
            found += sign * int(power or 1) * np.array(_EXPONENTS[name])
    return int(found[0]), int(found[1]), int(found[2])


@dataclass(frozen=True)
class Scaling:
    """The divisors of commands, outputs and forces.

    Args:
        command, output, force: the divisors; 1 for no change.
    """

    command: float = 1.0
    output: float = 1.0
    force: float = 1.0

    @classmethod
    def of(cls, plant: DrivenPlant, record: Record) -> Scaling:
        """The scaling of a record and a plant; no scaling if a parameter has a unit that is not known here."""
        known = all(_exponents(name, handle) for name, handle in plant.handles.items())
        command = float(np.max(np.abs(plant.drive.commands(record.input))))
        output = float(np.max(np.abs(record.output[:, 0])))
        command = output if plant.follows else command
        if not (known and command > 0 and output > 0):
            return cls()
        return cls(command, output, plant.force_scale(command, output))

    def factors(self, plant: Plant) -> Mapping[str, float]:
        """The divisor of every parameter of a plant."""
        sizes = (self.command, self.output, self.force)
        return {
            name: prod(size**power for size, power in zip(sizes, _exponents(name, handle) or (0, 0, 0), strict=True))
            for name, handle in plant.handles.items()
        }

    def values(self, plant: Plant, values: Mapping[str, float]) -> dict[str, float]:
        """Values of parameters of a plant in these units."""
        factors = self.factors(plant)
        return {name: value / factors[name] for name, value in values.items()}

    def datasheet(self, plant: Plant, sheet: Mapping[str, Given]) -> dict[str, Given]:
        """A datasheet of a plant in these units."""
        values = {name: given.value for name, given in sheet.items() if given.value is not None}
        scaled = self.values(plant, values)
        return {name: replace(given, value=scaled.get(name)) for name, given in sheet.items()}

    def limits(self, plant: Plant) -> Limits:
        """The physical bounds of every parameter of a plant in these units; no lower one gets smaller."""
        factors = self.factors(plant)
        return {
            name: (max(each.lower, each.lower / factors[name]), each.upper / factors[name])
            for name, each in plant.handles.items()
        }

    def record(self, record: Record, signals: Sequence[Signal], loaded: bool = False) -> Record:
        """A record in these units; a second input holds codes and stays as it is, but a load is a force."""
        outputs = [self.command if signal is Signal.CURRENT else self.output for signal in signals]
        inputs = [self.command, *[1.0] * (record.input.shape[1] - 1 - loaded), *[self.force] * loaded]
        return replace(record, input=record.input / inputs, output=record.output / outputs, before=())

    def to(self, plant: DrivenPlant, inputs: int) -> DrivenPlant:
        """A plant in these units.

        Args:
            plant: in SI units.
            inputs: how many the record has; codes among the commands of a single one become other numbers too.
        """
        alone = inputs == 1 + plant.drive.loaded
        codes = tuple((code / self.command if alone else code, bridge) for code, bridge in plant.drive.codes)
        return self._converted(plant.with_drive(codes=codes), -1)

    def back(self, plant: DrivenPlant, like: DrivenPlant) -> DrivenPlant:
        """A plant in these units converted to SI units, with the codes of the one that it was ``like``."""
        return self._converted(plant.with_drive(codes=like.drive.codes), 1)

    def _converted(self, plant: DrivenPlant, power: int) -> DrivenPlant:
        values = {name: plant.value(name) for name, handle in plant.handles.items() if len(handle.paths) == 1}
        factors = self.factors(plant)
        changed = {n: v * factors[n] ** power for n, v in values.items() if v and isfinite(v) and factors[n] != 1.0}
        return plant.with_values(changed)
