"""The common base of motor and axis: one mass with a drive and a sensor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.drive import Bridge, Drive, Hold
from emsid.models.plants.initial_state import initial_motion, starts_at_rest
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import BEGINNING, Limits, Plant, Sampler, parameters_of
from emsid.models.plants.sampling import DrivenSampler
from emsid.models.plants.sensor import Sensor
from emsid.models.plants.state import HELD, NO_LOAD, RISE, PlantState
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


class DrivenPlant(Plant):
    """A plant with a drive before it and a sensor after it.

    An initial state is a speed, a position, the reading of a sensor with a lag, and whether the plant is held at rest.
    A record that begins at rest does not show the command before it, only that the plant did not move: until the delay
    of the drive has passed, its output balances the load. Elsewhere the first command acts before the record, too.
    """

    load_unit: ClassVar[str]
    """The unit of a load among the inputs."""
    drive: Drive
    sensor: Sensor
    steps: int

    @property
    def driven(self) -> Self:
        """The plant itself."""
        return self

    @property
    def states(self) -> int:
        """Speed, position, speed reading of the sensor, whether it is held at rest, and the rise of a resistance."""
        return RISE + 1

    @property
    @abstractmethod
    def friction_name(self) -> str:
        """The name that its friction parameters begin with."""

    @property
    @abstractmethod
    def load_name(self) -> str:
        """The name of its constant load."""

    @abstractmethod
    def holding(self, load: float, position: float) -> float:
        """The output of the drive that balances all loads at rest, among them one of the inputs."""

    def held_at(self, command: Array) -> float:
        """The position at which a constant command (nu,) holds the plant; zero where any position is as good."""
        return 0.0

    def before(self, state: Array, command: Array) -> float | None:
        """The output of the drive before a run from an initial state; None for that of the first command (nu,)."""
        if len(state) <= HELD or not state[HELD]:
            return None
        return self.holding(float(command[-1]) if self.drive.loaded else 0.0, float(state[1]))

    def for_load(self, record: Record) -> Self:
        """The plant with a load among its inputs where the last of several is in the unit of one."""
        loaded = len(record.input_units) > 1 and record.input_units[-1] == self.load_unit
        return self.with_drive(loaded=True) if loaded and not self.drive.loaded else self

    def for_command(self, record: Record) -> Self:
        """See `for_load`."""
        return self.for_load(record)

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
    def follows(self) -> bool:
        """Whether its command is a target for its position; no."""
        return False

    def commanded(self, segment: Record, position: Array, speed: Array) -> Array:
        """(N,) the command after codes and the knee of the drive, for regressions on positions and speeds (N,)."""
        plain = Drive(self.drive.gain, knee=self.drive.knee, beyond=self.drive.beyond)
        return plain.applied(self.drive.commands(segment.input)[:, None])[0] / plain.gain

    @property
    def turn(self) -> float:
        """The phase in rad per unit of a position with which a force on it repeats; 0 for none."""
        return 0.0

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

    def simulate(
        self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal], drift: Array = NO_LOAD
    ) -> Array:
        """The outputs (N, ny) for a command (N, 1), or with codes for the bridge (N, 2), from speed and position.

        Args:
            inputs, dt, state, signals: see `Plant.simulate`.
            drift: (N,) a load besides the others, as a part of the largest force.
        """
        plant = self.for_inputs(inputs)
        begun = plant.start(state, inputs[0], dt, signals, len(inputs))
        load = drift * self.largest_force(inputs) if len(drift) else drift
        self.drive.check(inputs)
        return plant._sampler(begun, signals).run(inputs, load)

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The outputs (N, ny) for a command (N, 1), or with codes for the bridge (N, 2), and the state after them."""
        self.drive.check(inputs)
        sampler = self._sampler(state, signals)
        return sampler.run(inputs), sampler.state

    def sampler(self, state: PlantState, signals: Sequence[Signal]) -> Sampler:
        """See `Plant.sampler`."""
        return self._sampler(state, signals)

    @abstractmethod
    def _sampler(self, state: PlantState, signals: Sequence[Signal]) -> DrivenSampler:
        """See `Plant.sampler`."""

    @property
    @abstractmethod
    def is_one_mass(self) -> bool:
        """Whether the fast loop of one mass can simulate it."""

    def reversed_drive(self) -> Self:
        """The same plant with the sign of its drive reversed."""
        return self.with_drive(gain=-self.drive.gain)

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """One sample for a speed; twenty for a position, or for a speed measured with a lag.

        More samples would exclude the response to a step at the start of a record from the free run.
        """
        return BEGINNING if Signal.POSITION in signals or self.sensor.lag > 0 else 1

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """(speed, position, speed reading, held, rise of the resistance) from the first samples."""
        state, sensor = np.zeros(self.states), self.sensor
        for k, signal in enumerate(signals):
            y = segment.output[:, k]
            if signal in (Signal.SPEED, Signal.ROTOR_SPEED):
                state[0] = (y[0] - sensor.offset) * sensor.scale
            elif signal is Signal.POSITION:
                seen = initial_motion(y, segment.dt)
                state[1] = (seen.position[0] - sensor.offset) * sensor.scale
                if not any(s in (Signal.SPEED, Signal.ROTOR_SPEED) for s in signals):
                    state[0] = 0.0 if starts_at_rest(y) else seen.speed[0] * sensor.scale
        state[1] += sensor.lag * state[0]
        state[2] = state[0]
        if set(signals) - {Signal.CURRENT}:
            state[HELD] = self._begins_at_rest(float(state[0]), segment)
        state[RISE] = self.begins_risen
        return state

    def _begins_at_rest(self, speed: float, segment: Record) -> bool:
        """Whether a first speed is nearer to zero than to what the first command reaches from rest in the delay.

        In less than a sample it reaches what it does in one, so that a delay of zero does not decide.
        """
        if speed == 0.0:
            return True
        samples = int(np.clip(np.ceil(self.drive.delay / segment.dt), 1, BEGINNING))
        command = np.repeat(segment.input[:1], samples + 1, axis=0)
        reached = self.with_drive(delay=0.0).motion(command, segment.dt, np.zeros(self.states))[-1]
        return bool(abs(speed) < 0.5 * abs(reached))

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """The states that the outputs show and that are not clearly at rest."""
        sensed = [k for k, signal in enumerate(signals) if signal is not Signal.CURRENT]
        moving = not any(starts_at_rest(segment.output[:, k], signals[k]) for k in sensed)
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
            **({"loaded": True} if self.drive.loaded else {}),
            **({} if self.hold is Hold.ZERO else {"hold": self.hold.value}),
            **({"friction": unusual} if unusual else {}),
        }

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant of this kind described by `to_data`."""
        codes = tuple((float(code), Bridge(bridge)) for code, bridge in data["codes"])
        plain = self.with_frictions({name: find_law(law)() for name, law in data.get("friction", {}).items()})
        sensor = Sensor(average=bool(data["average"]))
        drive = replace(plain.drive, codes=codes, hold=Hold(data.get("hold", Hold.ZERO.value)))
        drive = replace(drive, loaded=bool(data.get("loaded", False)))
        plain = plain._with(drive=drive, sensor=sensor, steps=data["steps"])
        parameters = dict(data["parameters"])
        late = {name: parameters.pop(name) for name in NEED_SUPPLY if name in parameters}
        return plain.with_values(parameters).with_values(late)

    def _with(self, **changes: Any) -> Self:
        return replace(self, **changes)  # type: ignore[type-var]


USUAL_LAW = "coulomb-stribeck"
"""The friction law if a file names none."""
