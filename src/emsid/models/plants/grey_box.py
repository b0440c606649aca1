r"""The grey box: a physical plant as a model of records.

For given parameters, the state at the start of a segment is the one whose free run fits the first samples best. After
them the model sees only the input. The parameters are estimated in `search.estimation`.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError, EmsidError, ModelError, listed
from emsid.estimation.nonlinear.few_unknowns import few_unknowns
from emsid.excitation.between_samples import full_duty
from emsid.findings import Finding
from emsid.models.free_run import RunMethods, continued
from emsid.models.linear_parts import python_control
from emsid.models.plants.cogging import without_idle
from emsid.models.plants.drive import Bridge
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.initial_state import at_rest
from emsid.models.plants.motor_handles import RADIUS
from emsid.models.plants.parameters import Signal, parts
from emsid.models.plants.plant import Channels, Plant
from emsid.models.plants.registry import plant_from_data, plant_to_data
from emsid.models.plants.state import HELD, RISE, PlantState
from emsid.record import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class PlantModel(RunMethods):
    """A plant as a model of records.

    Args:
        plant: with its parameters.
        signals: the signals of the outputs of a record, in their order.
    """

    plant: Plant
    signals: tuple[Signal, ...]

    models_noise: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """The name of the plant."""
        return self.plant.name

    @property
    def memory(self) -> int:
        """The number of samples that give the initial state."""
        return self.plant.start_samples(self.signals)

    @property
    def dt(self) -> None:
        """None: a plant runs at any sample time, which is part of its state."""
        return None

    @property
    def latency(self) -> int:
        """That of the plant: zero unless it needs the next input to interpolate."""
        return self.plant.latency

    def parameter_values(self) -> dict[str, float]:
        """The value of every parameter of the plant by name, in SI units."""
        return {name: self.plant.value(name) for name in self.plant.handles}

    def with_estimates(self, names: Sequence[str], values: Array) -> PlantModel:
        """The same with other values of some parameters of the plant, by name, in SI units."""
        return replace(self, plant=self.plant.with_values(dict(zip(names, map(float, values), strict=True))))

    @property
    def output_channels(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of every output."""
        units = {} if self.plant.channels is None else self.plant.channels.units
        return tuple((signal.value, units.get(signal, "")) for signal in self.signals)

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> PlantState:
        """The plant at standstill, with a constant command in the past: a joint where that holds it, others at zero.

        Args:
            level: of the command; the plant starts to move unless friction or a dead zone prevents it.
            dt: sample time in s.
        """
        if dt is None:
            raise ModelError(f"{self.name} runs at any sample time; give one, dt=… in s", arguments=("dt",))
        u = np.atleast_1d(np.asarray(level, dtype=float))
        if len(u) == 1 and self.plant.channels is not None and self.plant.channels.load:
            u = np.append(u, 0.0)  # one level is that of the command
        state = np.zeros(self.plant.states)
        if isinstance(self.plant, DrivenPlant):
            state[1] = self.plant.held_at(u)
        if self.plant.changes_resistance:
            state[RISE] = self.plant.begins_risen
        return self.plant.start(state, u, dt, self.signals)

    def initial(self, segment: Record, samples: int) -> PlantState:
        """The state after the first ``samples`` samples of a segment, estimated by `initial_state`."""
        plant = self.plant.for_segment(segment)  # the state keeps the record and the hold of its input
        start = plant.start(self.initial_state(segment, samples), segment.input[0], segment.dt, self.signals)
        with np.errstate(over="ignore", invalid="ignore"):
            return self.run(start, segment.input[:samples])[1]

    def run(self, state: PlantState, inputs: Array) -> tuple[Array, PlantState]:
        """The outputs (N, ny) for inputs (N, nu), and the state after them."""
        return self.plant.run(state, np.ascontiguousarray(inputs, dtype=float), self.signals)

    def advance(self, state: PlantState, u: ArrayLike) -> tuple[Array, PlantState]:
        """The output (ny,) for the input (nu,) of one sample, and the state after it."""
        outputs, state = self.run(state, np.atleast_1d(np.asarray(u, dtype=float))[None, :])
        return outputs[0], state

    def ahead(self, segment: Record, samples: int, horizon: int) -> Array:
        """ŷ(t | t − horizon) = ŷ(t) + [y − ŷ](t − horizon): the error of the free run is taken to stay as it is."""
        run = continued(self, self.initial(segment, samples), segment, samples)
        error = segment.output[samples:] - run
        run[horizon:] += error[: max(len(run) - horizon, 0)]
        return run

    def check_record(self, record: Record) -> None:
        """Refuse a record with other channels or units; its outputs may be missing."""
        check_channels(self.plant, self.signals, record)

    def to_control(self) -> Any:
        """The plant in motion as a continuous python-control state-space system, from its command to its outputs.

        Dry friction, dead zones, limits, constant loads and the delay of the drive are left out. Without the delay, the
        system describes small changes about a steady motion in one direction. States that no output depends on, as the
        angle where only the speed is read, are left out.

        Raises:
            ModelError: if python-control is not installed, or the linear part of the plant is not known.
        """
        control = python_control()
        part = self.plant.linearised(self.signals)
        if part is None:
            raise ModelError(f"{self.name} has no linear part that is known; linearise its functions yourself")
        part = part.observed()
        return control.StateSpace(
            *part[:4], name=self.name, states=list(part.states), outputs=[signal.value for signal in self.signals]
        )

    def initial_state(self, segment: Record, samples: int) -> Array:
        """The state at the first sample of a segment, estimated from its first ``samples`` samples.

        Several samples also show whether a plant at speed zero passes through zero, and whether a plant that seems to
        move begins at rest with a step.
        """
        head = segment[: max(samples, 1)]
        plant = self.plant.for_segment(segment)
        first, free = plant.first_state(self.signals, head), plant.free_states(self.signals, head)
        if len(head) * len(self.signals) < 4 * len(free) or not len(free):
            return first
        starts, ended = [first], []
        if isinstance(plant, DrivenPlant):
            moving = np.where(np.arange(len(first)) == HELD, 0.0, first)
            starts.append(moving if first[HELD] else at_rest(first, first[1]))
        for start in starts:
            problem = FreeRunError(plant, self.signals, (head,), (), (start,), (free,), all_alike, 1)
            with suppress(EmsidError):
                theta, residuals = few_unknowns(problem, problem.start, max_iterations=20, tolerance=1e-6)
                ended.append((sum(float(each @ each) for each in residuals), problem.states(theta)[0]))
        return min(ended, key=itemgetter(0), default=(0.0, first))[1]

    def equation(self) -> str:
        """Every parameter with an effect, with its unit; equal values of both directions are given once."""
        handles, value = self.plant.handles, self.plant.value
        shown = [
            f"{name} = {handles[name].with_unit(value(name), 6)}" for name in with_effect(self.plant, self.signals)
        ]
        return f"{self.name}: " + ", ".join(shown)

    def to_data(self) -> dict[str, Any]:
        """Kind of plant, its parameters, and the signals of the outputs."""
        return {"plant": plant_to_data(self.plant), "signals": [signal.value for signal in self.signals]}

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> PlantModel:
        """The model described by `to_data`."""
        try:
            signals = tuple(Signal(value) for value in data["signals"])
            if not signals:
                raise ModelError("a plant of which nothing is measured")
            model = cls(plant_from_data(data["plant"]), signals)
            with np.errstate(all="ignore"):
                model.plant.linearised(signals)  # raises where a number is so small that it cannot be divided by
            return model
        except (KeyError, TypeError, ValueError, AttributeError) as problem:
            raise ModelError(f"not a grey-box model: {problem!r}") from None


def with_effect(plant: Plant, signals: Sequence[Signal]) -> list[str]:
    """The parameters that have an effect on some signals, equal values of both directions once; no factor of one."""
    values = without_idle({name: plant.value(name) for name in plant.handles})
    alike = {
        whole: some
        for whole in values
        if (some := parts(plant, whole)) and len({abs(values[part]) for part in some}) == 1
    }
    said_so = {part for some in alike.values() for part in some}
    without_effect = plant.without_effect(signals)
    found = []
    for name, value in values.items():
        handle = plant.handles[name]
        once = name in alike or not (len(handle.paths) > 1 or name in said_so)
        nothing = value == 0.0 or 0.0 < value <= handle.lower
        if name not in without_effect and once and np.isfinite(value) and not nothing and value != 1.0:
            found.append(name)
    return found


def signals_of(plant: Plant, record: Record) -> tuple[Signal, ...]:
    """The signals of the outputs of a record: as given, else by units; without a unit, the default of the plant."""
    named = (record.signals.get(name, "").removeprefix("load ") for name in record.output_names)
    channels = zip(named, record.output_names, record.output_units, strict=True)
    return tuple(Signal(given) if given else plant.signal_of(name, unit) for given, name, unit in channels)


_NO_QUANTITY = ("", "1", "pwm", "%", "percent", "count", "counts")
_NO_VOLTAGE = ("A", "N*m")


def check_channels(plant: Plant, signals: Sequence[Signal], record: Record) -> None:
    """Refuse a record whose channels or units do not match the plant."""
    channels = plant.channels
    if channels is not None:
        _check_command(plant, channels, record)
    if not record.output.shape[1]:
        return
    if record.output.shape[1] != len(signals):
        raise DataError(f"{record.name}: {record.output.shape[1]} outputs and {len(signals)} signals given for them")
    twice = next((signal for signal in signals if signals.count(signal) > 1), None)
    if twice is not None:
        alike = [name for name, signal in zip(record.output_names, signals, strict=True) if signal is twice]
        raise DataError(
            f"{record.name}: {listed([*map(repr, alike)])} are read as the {twice.value} of {plant.name}; give the "
            "unit of each, say what each measures, such as rotor_speed and load_speed, or leave one out",
            arguments=("units", "signals"),
        )
    if channels is None:
        return
    for name, unit, signal in zip(record.output_names, record.output_units, signals, strict=True):
        if unit and unit != channels.units[signal]:
            wheel = unit in ("m", "m/s") and RADIUS in plant.handles
            way = f"give the radius of its wheel, {RADIUS}," if wheel else "convert it"
            raise DataError(
                f"{record.name}: output {name!r} is in {unit}, {plant.name} gives a {signal.value} in "
                f"{channels.units[signal]}; {way} or choose another model",
                arguments=("fixed",) if wheel else ("units",),
            )


def assumptions(plant: Plant, record: Record) -> list[Finding]:
    """Findings on the assumed units of channels without a unit."""
    channels = plant.channels
    if channels is None:
        return []
    findings = [
        Finding("unit-assumed", plant.name, {"channel": name, "signal": signal.value, "unit": channels.units[signal]})
        for name, unit, signal in zip(record.output_names, record.output_units, signals_of(plant, record), strict=True)
        if not unit
    ]
    if (given := record.input_units[0]).lower() in _NO_QUANTITY:
        data = {"channel": record.input_names[0], "unit": channels.default_unit, "given": given}
        findings.append(Finding("command-unit-assumed", plant.name, data))
        if channels.bridge and (full := _full_duty(record, channels)):
            findings.append(
                Finding("command-may-be-duty", plant.name, {"channel": record.input_names[0], "full": full})
            )
    if channels.codes and not _has_bridge(channels, record):
        codes = [code for code, _ in channels.codes]
        findings.append(
            Finding("codes-without-bridge", plant.name, {"codes": codes, "nothing": channels.zero_when_open})
        )
    return findings


def _full_duty(record: Record, channels: Channels) -> float:
    """The limit at which a command ends as a duty does, codes apart; 0 where it is no such command."""
    values = record.input[:, 0]
    return full_duty(values[~np.isin(values, [code for code, _ in channels.codes])])


def _has_bridge(channels: Channels, record: Record) -> bool:
    """Whether the source of a plant can short it or leave it open, as a voltage source can."""
    return channels.bridge and record.input_units[0] not in _NO_VOLTAGE


def _check_command(plant: Plant, channels: Channels, record: Record) -> None:
    """Refuse inputs that do not drive a plant."""
    if record.input.shape[1] > channels.inputs + bool(channels.codes) + bool(channels.load):
        codes = " and the one with its codes" if channels.codes else ", or say which values of a second are codes"
        load = plant.load_unit if isinstance(plant, DrivenPlant) and not channels.load else ""
        raise DataError(
            f"{record.name}: {record.input.shape[1]} inputs for {plant.name}; name the one that drives it{codes}"
            f"{f', or give a load as the last one, in {load}' if load else ''}",
            arguments=() if channels.codes else ("brake", "coast", "units"),
        )
    if channels.load and (record.input.shape[1] < 2 or record.input_units[-1] not in ("", channels.load)):
        raise DataError(
            f"{record.name}: {plant.name} has a load in {channels.load} as its last input; give it after the command",
            arguments=("input", "units"),
        )
    if not _has_bridge(channels, record):
        brakes = [f"{code:g}" for code, bridge in channels.codes if bridge is Bridge.BRAKE]
        if brakes:
            raise ModelError(
                f"{plant.name} has no bridge here that could brake with {listed(brakes)}; say that nothing drives it "
                "there, or leave these samples out with a mask",
                arguments=("coast", "mask"),
            )
    name, unit = record.input_names[0], record.input_units[0]
    if unit.lower() not in _NO_QUANTITY and unit not in channels.commands:
        raise DataError(
            f"{record.name}: input {name!r} is in {unit}, and {plant.name} takes {' or '.join(channels.commands)}; "
            "correct its unit or choose another column",
            arguments=("units",),
        )


GreyBox = PlantModel
"""The name of this class inside the package."""
