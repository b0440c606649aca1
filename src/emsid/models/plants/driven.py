"""The common base of motor and axis: one mass with a drive and a sensor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.base_plant import BEGINNING, BasePlant, parameters_of
from emsid.models.plants.beginning import beginning
from emsid.models.plants.drive import Bridge, Drive, Hold
from emsid.models.plants.one_mass import Motion, OneMass, moved
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import DrivenPlant, Limits, Plant
from emsid.models.plants.sensor import Sensor
from emsid.plant.friction import find_law, law_name

if TYPE_CHECKING:
    from emsid.record import Record

Array = NDArray[np.float64]

KNEES, SLOPES = (0.45, 0.75, 1.0), (0.5, 0.8, 1.25, 2.0)
"""Starts of a search for a knee: fractions of its usual start, and gain factors beyond it."""

FIRST_RISE = 0.05
"""Start of a search for the rise time of a current, in periods of the PWM."""
NEED_SUPPLY = ("drive.freewheel", "drive.rise")
"""Parameters of a drive that must have a supply."""


class Driven(BasePlant):
    """A plant with a drive before it and a sensor after it.

    An initial state is a speed, a position, and the reading of a sensor with a lag.
    """

    drive: Drive
    sensor: Sensor
    steps: int

    @property
    def states(self) -> int:
        """Speed, position, and speed reading of the sensor."""
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
        """The largest output of the drive."""
        return self.drive.largest(inputs)

    @abstractmethod
    def with_motion(self, motion: Motion, fixed: Collection[str] = ()) -> Self:
        """The plant with this motion; other parameters follow from those of ``fixed`` as they are."""

    def force_scale(self, command: float, output: float) -> float:
        """The scale of the command; the gain from command to force does not change."""
        return command

    @property
    def can_coast(self) -> bool:
        """No."""
        return False

    def with_drive(self, **changes: Any) -> Self:
        """The plant with another drive."""
        return self._with(drive=replace(self.drive, **changes))

    @property
    def hold(self) -> Hold:
        """That of its drive."""
        return self.drive.hold

    def with_hold(self, hold: Hold) -> Self:
        """The plant with this hold of its command."""
        return self.with_drive(hold=hold)

    def for_inputs(self, inputs: Array) -> Self:
        """The plant as it is in a record with inputs (N, nu), where its drive differs by record."""
        return self if self.hold is not Hold.RECORD else self.with_drive(hold=self.drive.for_inputs(inputs).hold)

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The outputs (N, ny) for a command (N, 1), or with codes for the bridge (N, 2), from speed and position."""
        plant = self.for_inputs(inputs)
        return plant.run(plant.start(state, inputs[0], dt, signals, len(inputs)), inputs, signals)[0]

    def simulate_each(
        self, inputs: Sequence[Array], dt: float, states: Sequence[Array], signals: Sequence[Signal]
    ) -> list[Array]:
        """See `BasePlant.simulate_each`; drive and forces of one mass are computed for all runs at once."""
        on = None if Signal.CURRENT in signals else self.drive.acting_each(inputs, dt)
        sliding = None if on is None else self._as_one_mass(on[0].voltage, on[0].conducts)
        if on is None or sliding is None:
            return super().simulate_each(inputs, dt, states, signals)
        outputs = []
        for piece, state in zip(on[1], states, strict=True):
            begin = self.sensed_first(state, dt, signals)
            whole = (*sliding[:3], sliding.force[piece], sliding.damping[piece])
            speeds, positions = moved(*whole, dt, on[0].late, self.steps, float(state[0]), float(state[1]))
            outputs.append(self.read(speeds[:-1], positions[:-1], dt, signals, begin)[0])
        return outputs

    def simulate_under(self, load: Array, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """`simulate` with a load (N,) that is held over every sample, besides that of the plant, on one mass."""
        plant = self.for_inputs(inputs)
        at = plant.start(state, inputs[0], dt, signals, len(inputs))
        on = plant.drive.acting(inputs, at.commands, dt)
        sliding = plant._as_one_mass(on.voltage, on.conducts)
        if sliding is None or Signal.CURRENT in signals:
            raise ModelError(f"{self.name}: a load that changes is simulated for one mass and its motion only")
        instants = np.maximum(np.arange(len(sliding.force)) - 1, 0) * len(load) // max(len(sliding.force) - 1, 1)
        whole = (*sliding[:3], sliding.force - load[instants], sliding.damping)
        speeds, positions = moved(*whole, on.dt, on.late, self.steps, float(state[0]), float(state[1]))
        return self.read(speeds[on.samples], positions[on.samples], dt, signals, at.sensed)[0]

    @abstractmethod
    def _as_one_mass(self, voltage: Array, conducts: Array) -> OneMass | None:
        """The forces on one mass for an output of the drive (M,); None where it is not one mass."""

    def sensed_first(self, state: Array, dt: float, signals: Sequence[Signal]) -> Array:
        """(ny, 2) the sensor before the first sample, for an initial state: speed, position, and the speed reading."""
        shown = float(state[2] if len(state) > 2 else state[0])
        motion = np.array([float(state[0]), float(state[1])])
        return np.array([self.sensor.begins(signal is Signal.POSITION, motion, dt, shown) for signal in signals])

    def read(
        self, speeds: Array, positions: Array, dt: float, signals: Sequence[Signal], kept: Array
    ) -> tuple[Array, Array]:
        """(N, ny) what the sensor shows of a motion, and its state (ny, 2) after it; ``kept`` is that before."""
        columns = [
            self.sensor.position(positions, dt, before)
            if signal is Signal.POSITION
            else self.sensor.speed(speeds, positions, dt, before)
            for signal, before in zip(signals, kept, strict=True)
        ]
        return np.column_stack([values for values, _ in columns]), np.array([after for _, after in columns])

    def reversed_drive(self) -> Self:
        """The same plant with the sign of its drive reversed."""
        return self.with_drive(gain=-self.drive.gain)

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """One sample for a speed; twenty for a position, or for a speed measured with a lag.

        A delayed command is assumed to be constant before the record. More samples would exclude the response to a
        step at the start of a record from the free run.
        """
        return BEGINNING if Signal.POSITION in signals or self.sensor.lag > 0 else 1

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """(speed, position, speed reading) from the first samples."""
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
        """The states that the outputs show and that are not clearly at rest."""
        sensed = [k for k, signal in enumerate(signals) if signal is not Signal.CURRENT]
        moving = not any(starts_at_rest(segment.output[:, k]) for k in sensed)
        lags = moving and sensed and self.sensor.lag > 0
        return ((0,) if moving else ()) + ((1,) if Signal.POSITION in signals else ()) + ((2,) if lags else ())

    def with_starts(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The plant with a start for a supply, a knee or a lag that is estimated and has no effect yet."""
        dt = segments[0].dt
        largest = max(self.drive.largest(segment.input) for segment in segments)
        starts = {name: 0.8 * largest for name in asked if not isfinite(self.value(name))}
        if set(NEED_SUPPLY) & set(asked) and not isfinite(self.drive.supply):
            starts.setdefault("drive.supply", largest)  # the largest command is full duty
        if "drive.rise" in asked and self.drive.rise == 0.0:
            starts["drive.rise"] = FIRST_RISE
        if "drive.knee" in starts and "drive.beyond" in asked and self.drive.beyond == 1.0:
            starts["drive.beyond"] = 0.8  # with a factor of one the knee has no effect
        if "sensor.lag" in asked and self.sensor.lag == 0:
            starts["sensor.lag"] = min(dt, limits["sensor.lag"][1])  # the initial reading is then estimated too
        return self.with_values(starts)

    def knee_starts(self, start: Plant, asked: Sequence[str], limits: Limits) -> list[Plant]:
        """The start plant, or several with different starts of an unknown knee that is estimated.

        A search cannot pass from a smaller gain beyond the knee to a larger one: at an equal gain the knee has no
        effect and is undetermined.
        """
        if "drive.knee" not in asked or isfinite(self.drive.knee):
            return [start]
        knees = [knee * start.value("drive.knee") for knee in KNEES]
        either = "drive.beyond" in asked and self.drive.beyond == 1.0
        slopes = SLOPES if either else (start.value("drive.beyond"),)
        pairs = [{"drive.knee": knee, "drive.beyond": slope} for knee in knees for slope in slopes]
        return [
            start.with_values({n: float(np.clip(v, *limits.get(n, (v, v)))) for n, v in pair.items()}) for pair in pairs
        ]

    def motion(self, inputs: Array, dt: float, state: Array) -> Array:
        """(N,) the true speed: a sensor with lag or offset never reads zero at standstill."""
        return self._with(sensor=Sensor()).simulate(inputs, dt, state, (Signal.SPEED,))[:, 0]

    def to_data(self) -> dict[str, Any]:
        """Parameters, codes, sensor, steps, and what is not usual: a command that is not held, a friction law."""
        laws = {name: law_name(law) for name, law in self.frictions.items()}
        unusual = {name: law for name, law in laws.items() if law != USUAL_LAW}
        return {
            "parameters": parameters_of(self),
            "codes": [[code, bridge.value] for code, bridge in self.drive.codes],
            "average": bool(self.sensor.average),
            "steps": self.steps,
            **({} if self.hold is Hold.ZERO else {"hold": self.hold.value}),
            **({"friction": unusual} if unusual else {}),
        }

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant of this kind described by `to_data`."""
        codes = tuple((float(code), Bridge(bridge)) for code, bridge in data["codes"])
        plain = self.with_frictions({name: find_law(law)() for name, law in data.get("friction", {}).items()})
        sensor = Sensor(average=bool(data["average"]))
        drive = replace(plain.drive, codes=codes, hold=Hold(data.get("hold", Hold.ZERO.value)))
        plain = plain._with(drive=drive, sensor=sensor, steps=data["steps"])
        parameters = dict(data["parameters"])
        late = {name: parameters.pop(name) for name in NEED_SUPPLY if name in parameters}
        return plain.with_values(parameters).with_values(late)

    def _with(self, **changes: Any) -> Self:
        return replace(self, **changes)  # type: ignore[type-var]


USUAL_LAW = "coulomb-stribeck"
"""The friction law if a file names none."""


def starts_at_rest(y: Array) -> bool:
    """Whether the first three samples of an output are exactly zero or exactly equal."""
    return len(y) > 3 and float(np.ptp(y[:3])) == 0.0
