"""What a motor and an axis have in common: one mass seen through a drive and a sensor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.beginning import beginning
from emsid.models.plants.drive import Bridge, Drive
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import BEGINNING, BasePlant, DrivenPlant, Limits, Plant, parameters_of
from emsid.models.plants.sensor import Sensor
from emsid.plant.friction import find_law, law_name

if TYPE_CHECKING:
    from emsid.record import Record

Array = NDArray[np.float64]

KNEES, SLOPES = (0.45, 0.75, 1.0), (0.5, 0.8, 1.25, 2.0)
"""Where a knee is looked for, as a part of its usual start, and how the command may count beyond it: less, or more."""


class Driven(BasePlant):
    """A plant with a drive in front of it and a sensor behind it.

    An initial state is a speed, a position, and the speed that a sensor with a lag shows.
    """

    drive: Drive
    sensor: Sensor
    steps: int

    @property
    def states(self) -> int:
        """Speed, position, and the speed that the sensor shows."""
        return 3

    @property
    def driven(self) -> DrivenPlant:
        """The plant itself."""
        return self

    @property
    @abstractmethod
    def friction_name(self) -> str:
        """The name that its friction parameters begin with."""

    @property
    @abstractmethod
    def load_name(self) -> str:
        """The name of its constant load."""

    def largest_force(self, inputs: Array) -> float:
        """What the drive makes."""
        return self.drive.largest(inputs)

    @abstractmethod
    def put_motion(self, motion: Motion) -> Self:
        """The plant that moves like this."""

    def force_scale(self, command: float, output: float) -> float:
        """By what the command is: what turns it into a force stays as it is."""
        return command

    @property
    def can_coast(self) -> bool:
        """No."""
        return False

    def with_drive(self, **changes: Any) -> Self:
        """The plant with another drive."""
        return self._with(drive=replace(self.drive, **changes))

    def turned(self) -> Self:
        """The same plant with its drive the other way round."""
        return self.with_drive(gain=-self.drive.gain)

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """One sample shows the start of a speed; of a position, or of a speed that the sensor shows late, twenty.

        A command that is late is taken to have stood before: waiting for more would leave the answer to a step at the
        start of a record out of the free run.
        """
        return BEGINNING if Signal.POSITION in signals or self.sensor.lag > 0 else 1

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """(speed, position, speed shown) by the first samples."""
        state, sensor = np.zeros(self.states), self.sensor
        for k, signal in enumerate(signals):
            y = segment.output[:, k]
            if signal in (Signal.SPEED, Signal.ROTOR_SPEED):
                state[0] = (y[0] - sensor.offset) * sensor.ratio
            elif signal is Signal.POSITION:
                seen = beginning(y, segment.dt)
                state[1] = (seen.position[0] - sensor.offset) * sensor.ratio
                if not any(s in (Signal.SPEED, Signal.ROTOR_SPEED) for s in signals):
                    state[0] = 0.0 if starts_at_rest(y) else seen.speed[0] * sensor.ratio
        state[1] += sensor.lag * state[0]
        state[2] = state[0]
        return state

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """What the outputs show and what is not plainly at rest."""
        sensed = [k for k, signal in enumerate(signals) if signal is not Signal.CURRENT]
        moving = not any(starts_at_rest(segment.output[:, k]) for k in sensed)
        lags = moving and sensed and self.sensor.lag > 0
        return ((0,) if moving else ()) + ((1,) if Signal.POSITION in signals else ()) + ((2,) if lags else ())

    def ready(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The plant with a start for a supply, a knee or a lag that is asked for and has no effect at first."""
        dt = segments[0].dt
        largest = max(self.drive.largest(segment.input) for segment in segments)
        starts = {name: 0.8 * largest for name in asked if not isfinite(self.value(name))}
        if "drive.freewheel" in asked and not isfinite(self.drive.supply):
            starts.setdefault("drive.supply", largest)  # the largest command is full duty
        if "drive.knee" in starts and "drive.beyond" in asked and self.drive.beyond == 1.0:
            starts["drive.beyond"] = 0.8  # where it bends nothing, nobody can say where it is
        if "sensor.lag" in asked and self.sensor.lag == 0:
            starts["sensor.lag"] = min(dt, limits["sensor.lag"][1])  # what it shows at the start is then free too
        return self.put(starts)

    def bent(self, ready: Plant, asked: Sequence[str], limits: Limits) -> list[Plant]:
        """The plant made ready, or where a knee of which nothing is known is asked for, with it at several places.

        No search gets from a command that counts less beyond its knee to one that counts more: between them is one
        without a knee, which may be anywhere.
        """
        if "drive.knee" not in asked or isfinite(self.drive.knee):
            return [ready]
        knees = [knee * ready.value("drive.knee") for knee in KNEES]
        either = "drive.beyond" in asked and self.drive.beyond == 1.0
        slopes = SLOPES if either else (ready.value("drive.beyond"),)
        pairs = [{"drive.knee": knee, "drive.beyond": slope} for knee in knees for slope in slopes]
        return [ready.put({n: float(np.clip(v, *limits.get(n, (v, v)))) for n, v in pair.items()}) for pair in pairs]

    def motion(self, inputs: Array, dt: float, state: Array) -> Array:
        """(N,) how fast it moves itself: a sensor that lags or is off never shows a standstill."""
        return self._with(sensor=Sensor()).simulate(inputs, dt, state, (Signal.SPEED,))[:, 0]

    def to_data(self) -> dict[str, Any]:
        """Parameters, codes, and how it is measured and stepped; a friction law where it is not the usual one."""
        laws = {name: law_name(law) for name, law in self.frictions.items()}
        unusual = {name: law for name, law in laws.items() if law != USUAL_LAW}
        return {
            "parameters": parameters_of(self),
            "codes": [[code, bridge.value] for code, bridge in self.drive.codes],
            "average": self.sensor.average,
            "steps": self.steps,
            **({"friction": unusual} if unusual else {}),
        }

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant of this kind that `to_data` described."""
        codes = tuple((float(code), Bridge(bridge)) for code, bridge in data["codes"])
        plain = self.with_frictions({name: find_law(law)() for name, law in data.get("friction", {}).items()})
        sensor = Sensor(average=bool(data["average"]))
        plain = plain._with(drive=replace(plain.drive, codes=codes), sensor=sensor, steps=data["steps"])
        parameters = dict(data["parameters"])
        late = {name: parameters.pop(name) for name in ("drive.freewheel",) if name in parameters}  # needs the supply
        return plain.put(parameters).put(late)

    def _with(self, **changes: Any) -> Self:
        return replace(self, **changes)  # type: ignore[type-var]


USUAL_LAW = "coulomb-stribeck"
"""The friction law of a plant where a file names none."""


def starts_at_rest(y: Array) -> bool:
    """Whether an output stands still over its first three samples, at exactly zero or exactly the same value."""
    return len(y) > 3 and float(np.ptp(y[:3])) == 0.0
