r"""A plant with some parameters that differ by record, such as the load that one motor turned in each experiment.

One vector θ = (shared, own₁, own₂, …) describes all records, so a fit has one covariance. In record k the plant has the
shared parameters and own_k. The derivative of the free run with respect to own_k is zero in every other record.

In other records than the fitted ones, which it recognises by their names, an own parameter has its median.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.linear_parts import StateSpace
from emsid.models.plants.drive import Hold
from emsid.models.plants.parameters import Handle, Signal, refuse_overlap
from emsid.models.plants.plant import Channels, Limits, Plant, Quantity, Sampler, Sizes, StaticCharacteristic
from emsid.models.plants.state import PlantState
from emsid.plant.friction import FrictionLaw
from emsid.plant.parameter import Measure
from emsid.record import Record

Array = NDArray[np.float64]

NEW = -1
"""The number of a record that is none of those fitted."""


@dataclass(frozen=True)
class PlantByRecord(Plant):
    """A plant whose ``own`` parameters have a value for every record.

    The parameter ``load_inertia`` of the record ``b.csv`` is ``load_inertia[b.csv]``.

    Args:
        shared: the plant with the parameters that all records share.
        own: (m,) the names of those that differ.
        records: (k,) the names of the records, each its own.
        values: (k, m) the own parameters in every record, in SI units.
        present: the number of the record that it runs in, `NEW` for any other.

    Raises:
        ModelError: for no own parameter, an unknown one, two that overlap, or records with the same name.
    """

    shared: Plant
    own: tuple[str, ...]
    records: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    present: int = NEW
    _places: Mapping[str, tuple[str, int]] = field(default_factory=dict, repr=False, compare=False)
    _handles: Mapping[str, Handle] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self._handles:  # the same plant with other values
            return
        if not self.own:
            raise ModelError(f"{self.shared.name}: no parameter differs by record; give the plant itself")
        refuse_overlap(self.shared, self.own)
        if len(set(self.records)) < len(self.records) or len(self.values) != len(self.records):
            raise ModelError(f"{self.shared.name}: every record needs a name of its own and its own values")
        places = {in_record(name, each): (name, k) for k, each in enumerate(self.records) for name in self.own}
        object.__setattr__(self, "_places", places)
        object.__setattr__(self, "_handles", _handles(self.shared, self.own, self.records))

    @classmethod
    def of(cls, plant: Plant, own: Sequence[str], records: Sequence[str]) -> PlantByRecord:
        """A plant whose own parameters have its values in every record.

        Args:
            plant: with its parameters.
            own: names of those that differ by record.
            records: names of the records.
        """
        values = tuple(plant.value(name) for name in own)
        return cls(plant, tuple(own), tuple(records), (values,) * len(records))

    # --- parameters ---

    @property
    def handles(self) -> Mapping[str, Handle]:
        """The shared parameters, then every own parameter of every record."""
        return self._handles

    def value(self, name: str) -> float:
        """The value of a parameter in SI units; of an own parameter without a record, its median."""
        place = self._places.get(name)
        if place is not None:
            return self.values[place[1]][self.own.index(place[0])]
        return self._typical[name] if name in self.own else self.shared.value(name)

    @property
    def _typical(self) -> dict[str, float]:
        """The medians of the own parameters."""
        return dict(zip(self.own, np.median(np.array(self.values), axis=0).tolist(), strict=True))

    def with_values(self, values: Mapping[str, float]) -> Self:
        """The same plant with other parameters, by name; an own parameter without a record has one value in all.

        Raises:
            ModelError: for an unknown name or a value outside its physical bounds.
        """
        own = [list(each) for each in self.values]
        shared = {}
        for name, value in values.items():
            if name in self._places:
                base, k = self._places[name]
                own[k][self.own.index(base)] = float(value)
            elif name in self.own:
                for each in own:
                    each[self.own.index(name)] = float(value)
            else:
                shared[name] = value
        return replace(self, shared=self.shared.with_values(shared), values=tuple(map(tuple, own)))

    def of_record(self, number: int) -> Plant:
        """The plant as it is in a record, by its place; with medians for `NEW`."""
        if number == NEW:
            return self.shared.with_values(self._typical)
        return self.shared.with_values(dict(zip(self.own, self.values[number], strict=True)))

    def own_parameter(self, name: str) -> tuple[str, int] | None:
        """Name and record of an own parameter."""
        return self._places.get(name)

    def expanded(self, names: Sequence[str]) -> tuple[str, ...]:
        """The names with every own parameter replaced by that of each record."""
        found: list[str] = []
        for name in names:
            found += [in_record(name, each) for each in self.records] if name in self.own else [name]
        return tuple(found)

    def expanded_values(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """What belongs to every parameter by name, with that of an own parameter for each record."""
        return {each: value for name, value in values.items() for each in self.expanded([name])}

    # --- what it shares with the plant ---

    @property
    def typical(self) -> Plant:
        """The plant in a record that it was not fitted to."""
        return self.of_record(NEW)

    @property
    def name(self) -> str:
        """That of the plant."""
        return self.shared.name

    @property
    def body(self) -> str:
        """That of the plant."""
        return self.shared.body

    @property
    def default_free(self) -> tuple[str, ...]:
        """Those of the plant, the own parameters last and in every record."""
        rest = (name for name in self.shared.default_free if name not in self.own)
        return (*rest, *self.expanded(self.own))

    @property
    def secondary(self) -> frozenset[str]:
        """Those of the plant."""
        return frozenset(self.expanded(sorted(self.shared.secondary)))

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """Those of the plant."""
        return self.shared.frictions

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The plant with other friction laws."""
        return replace(self, shared=self.shared.with_frictions(laws), _handles={})

    @property
    def absent(self) -> tuple[str, ...]:
        """Those of the plant."""
        return self.shared.absent

    def without_effect(self, signals: Sequence[Signal]) -> tuple[str, ...]:
        """Those of the plant."""
        return self.expanded(self.typical.without_effect(signals))

    @property
    def states(self) -> int:
        """As many as those of the plant."""
        return self.shared.states

    @property
    def channels(self) -> Channels | None:
        """Those of the plant."""
        return self.shared.channels

    def linearised(self, signals: Sequence[Signal]) -> StateSpace | None:
        """The linear plant in a new record."""
        return self.typical.linearised(signals)

    @property
    def hold(self) -> Hold:
        """That of the plant."""
        return self.shared.hold

    def with_hold(self, hold: Hold) -> Self:
        """The plant with this hold of its inputs."""
        return replace(self, shared=self.shared.with_hold(hold))

    def for_command(self, record: Record) -> Self:
        """The plant as the command of a record drives it."""
        return replace(self, shared=self.shared.for_command(record), _handles={})

    def for_inputs(self, inputs: Array) -> Self:
        """The plant as it is in a record with inputs (N, nu)."""
        return replace(self, shared=self.shared.for_inputs(inputs))

    def for_segment(self, segment: Record) -> Self:
        """The plant in a segment, with the own parameters of the experiment that it is from, if it was fitted to it."""
        return replace(self.for_inputs(segment.input), present=self.record_of(segment))

    def record_of(self, segment: Record) -> int:
        """The number of the record with the name of a segment's experiment; `NEW` without one."""
        name = segment.experiments[0]
        return self.records.index(name) if name in self.records else NEW

    @property
    def latency(self) -> int:
        """That of the plant."""
        return self.shared.latency

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """Those of the plant."""
        return self.typical.start_samples(signals)

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """That of the plant."""
        return self.of_record(self.present).first_state(signals, segment)

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """Those of the plant."""
        return self.of_record(self.present).free_states(signals, segment)

    def plausible(self, measure: Measure, sizes: Sizes) -> float:
        """Those of the plant."""
        return self.typical.plausible(measure, sizes)

    def resolution_limits(self, asked: Sequence[str], dt: float) -> dict[str, tuple[float, float]]:
        """Those of the plant, in every record."""
        names = dict.fromkeys(self._places.get(name, (name, 0))[0] for name in asked)
        found = self.expanded_values(self.typical.resolution_limits(tuple(names), dt))
        return {name: limits for name, limits in found.items() if name in asked}

    def with_starts(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The same plant: it begins where the records were fitted together."""
        return self

    def friction_characteristic(self) -> StaticCharacteristic | None:
        """That in a new record."""
        return self.typical.friction_characteristic()

    def dead_zone_characteristic(self) -> StaticCharacteristic | None:
        """That in a new record."""
        return self.typical.dead_zone_characteristic()

    def quantities(self) -> tuple[Quantity, ...]:
        """Those of the plant; what depends on an own parameter is there for every record."""
        plain = self.shared.quantities()
        moved = [self.shared.with_values({name: self._beside(name)}).quantities() for name in self.own]
        by_record = [self.of_record(k).quantities() for k in range(len(self.records))]
        found: list[Quantity] = []
        for n, (each, *some) in enumerate(zip(plain, *by_record, strict=True)):
            differs = any(beside[n].value != each.value for beside in moved)
            found += [q._replace(name=in_record(q.name, k)) for q, k in zip(some, self.records, strict=True)] * differs
            found += some[:1] * (not differs)
        return tuple(found)

    def _beside(self, name: str) -> float:
        """A value of an own parameter close to the present one, within its bounds."""
        value, upper = self.shared.value(name), self.shared.handles[name].upper
        return 0.99 * value if value else 1e-6 if upper > 0 else -1e-6

    def equations(self) -> str:
        """Those of the plant."""
        return self.shared.equations()

    # --- runs ---

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample; its last number is the record that the plant runs in."""
        begun = self.of_record(self.present).start(state, command, dt, signals, samples)
        return begun._replace(motion=np.append(begun.motion, self.present))

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The output (N, ny) for inputs (N, nu) with the parameters of the record in the state, and the state after."""
        present = state.motion[-1:]
        output, after = self.of_record(int(present[0])).run(state._replace(motion=state.motion[:-1]), inputs, signals)
        return output, after._replace(motion=np.append(after.motion, present))

    def sampler(self, state: PlantState, signals: Sequence[Signal]) -> Sampler | None:
        """That of the plant with the parameters of the record in the state, which it keeps."""
        present = state.motion[-1:]
        own = self.of_record(int(present[0])).sampler(state._replace(motion=state.motion[:-1]), signals)
        return None if own is None else _SamplerOfRecord(own, present)

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) from an initial state."""
        return self.of_record(self.present).simulate(inputs, dt, state, signals)

    def motion(self, inputs: Array, dt: float, state: Array) -> Array | None:
        """(N,) the true speed, see `Plant.motion`."""
        return self.of_record(self.present).motion(inputs, dt, state)

    # --- files ---

    def to_data(self) -> dict[str, Any]:
        """The plant in a new record, and the own parameters of every record."""
        own = {each: dict(zip(self.own, row, strict=True)) for each, row in zip(self.records, self.values, strict=True)}
        return {**self.typical.to_data(), "by_record": own}

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant described by `to_data`, of the same records and names."""
        found = from_data(self.shared, data)
        assert isinstance(found, type(self))
        return found


def in_record(name: str, record: str) -> str:
    """The name of a parameter in one of several records."""
    return f"{name}[{record}]"


def from_data(plain: Plant, data: Mapping[str, Any]) -> Plant:
    """The plant described by data of this kind of plant, with own parameters where they have some.

    Raises:
        ModelError: for records with different own parameters.
    """
    rest = {name: value for name, value in data.items() if name != "by_record"}
    plant = plain.with_data(rest)
    by_record = data.get("by_record")
    if by_record is None:
        return plant
    own = tuple(next(iter(by_record.values())))
    if any(tuple(sorted(each)) != tuple(sorted(own)) for each in by_record.values()):
        raise ModelError(f"{plain.name}: the records do not have the same parameters of their own")
    values = tuple(tuple(float(each[name]) for name in own) for each in by_record.values())
    for row in values:
        plant.with_values(dict(zip(own, row, strict=True)))
    return PlantByRecord(plant, own, tuple(by_record), values)


def _handles(plant: Plant, own: Sequence[str], records: Sequence[str]) -> dict[str, Handle]:
    """The handles of what is shared, and of the own parameters in every record."""
    taken = {path for name in own for path, _ in plant.handles[name].paths}
    found = {
        name: handle
        for name, handle in plant.handles.items()
        if not taken.intersection(path for path, _ in handle.paths)
    }
    for k, record in enumerate(records):
        for name in own:
            handle = plant.handles[name]
            parameter = handle.parameter._replace(
                name=in_record(name, record),
                symbol=in_record(handle.parameter.symbol, record),
                description=f"{handle.parameter.description}, in {record}",
            )
            paths = tuple(((f"record {k}", *path), sign) for path, sign in handle.paths)
            found[parameter.name] = handle._replace(parameter=parameter, paths=paths)
    return found


def names_of(records: Sequence[str]) -> tuple[str, ...]:
    """A name for every record: its own, or its number where some have the same name."""
    if len(set(records)) == len(records):
        return tuple(records)
    return tuple(str(number) for number in range(1, len(records) + 1))


class _SamplerOfRecord:
    """A sampler whose state has the number of its record."""

    __slots__ = ("_own", "_present", "advance")

    def __init__(self, own: Sampler, present: Array) -> None:
        self._own, self._present, self.advance = own, present, own.advance

    @property
    def state(self) -> PlantState:
        state = self._own.state
        return state._replace(motion=np.append(state.motion, self._present))
