"""`Plant`, the base class of plants: a frozen value that simulates itself and declares its properties.

A plant declares its parameters, its channels, its initial state and its characteristics; the program does not test its
type or its name. A user's plant is an `OwnPlant`, or derives from `Plant`. `registry` lists the plants for files and
candidates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import Estimate
from emsid.findings import Finding
from emsid.models.linear_parts import StateSpace
from emsid.models.plants.drive import Bridge, Hold
from emsid.models.plants.parameters import Handle, Signal, find_handle, read_at, with_numbers
from emsid.models.plants.state import NO_ROWS, PlantState
from emsid.models.visited import RestsOn
from emsid.plant.friction import FrictionLaw
from emsid.plant.parameter import Measure
from emsid.record import Record

Array = NDArray[np.float64]

_BY_UNIT = {
    "rad/s": Signal.SPEED, "m/s": Signal.SPEED, "rpm": Signal.SPEED, "deg/s": Signal.SPEED,
    "rad": Signal.POSITION, "m": Signal.POSITION, "deg": Signal.POSITION,
    "A": Signal.CURRENT,
}  # fmt: skip
BEGINNING = 20
"""Samples that give the initial state if one sample is not enough."""


class Quantity(NamedTuple):
    """A combination of parameters with its own meaning, such as a time constant.

    Attributes:
        name: its name.
        formula: in the symbols of the parameters.
        unit: SI.
        value: in that unit.
        rests_on: what a record must visit to show it.
    """

    name: str
    formula: str
    unit: str
    value: float
    rests_on: RestsOn = RestsOn()


class Part(NamedTuple):
    """What a plant may have in addition, without effect where all of its parameters are zero.

    Attributes:
        of: the field of the plant that it is an item of.
        number: which item.
        names: of its parameters.
        prior: its probability before the data are seen; those of all parts of a field add up to one.
    """

    of: str
    number: int
    names: tuple[str, ...]
    prior: float


class Channels(NamedTuple):
    """The output signals and the command of a plant.

    Attributes:
        units: its output signals, each with its unit.
        default_signal: the assumed signal of an output without a unit.
        commands: possible units of its command.
        default_unit: the assumed unit of a command without a unit: ``volts``.
        source: the quantity that drives it: ``voltage``.
        codes: values of the input that are not commands.
        load: the unit of a load that is the last input; empty without one.
        bridge: whether the source can short it or leave it open.
        zero_when_open: the quantity that is zero when it is left open: ``torque``.
        inputs: how many inputs it takes, without codes and load.
    """

    units: Mapping[Signal, str]
    default_signal: Signal
    commands: tuple[str, ...]
    default_unit: str
    source: str
    codes: tuple[tuple[float, Bridge], ...] = ()
    bridge: bool = False
    zero_when_open: str = "torque"
    load: str = ""
    inputs: int = 1


class StaticCharacteristic(NamedTuple):
    """A static characteristic of a plant: its output over its input.

    Attributes:
        law: (n,) output for (n,) input.
        x, y: name and unit of input and output.
        breakaway: (forward, backward) break-away level of a friction.
        edge: the larger break point of a dead zone.
    """

    law: Callable[[Array], Array]
    x: tuple[str, str]
    y: tuple[str, str]
    breakaway: tuple[float, float] = (0.0, 0.0)
    edge: float = 0.0


class Sizes(NamedTuple):
    """The sizes of signals in records.

    Attributes:
        command: the largest input.
        output: the largest output.
        dt: sample time in s.
    """

    command: float
    output: float
    dt: float


Limits = Mapping[str, tuple[float, float]]


class Sampler(Protocol):
    """A plant between two samples, in arrays that a compiled call changes in place."""

    def advance(self, u: Array, y: Array) -> None:
        """Write the outputs (ny,) for inputs (nu,), and change the state."""
        ...

    @property
    def state(self) -> PlantState:
        """The present state."""
        ...


class Plant(ABC):
    """A physical model for a grey box: a value with named parameters that simulates itself.

    A plant is a frozen dataclass. Its fields, or their fields, hold the parameters that ``handles`` declares. It
    defines ``name``, the number of ``states``, and ``run``; the rest has defaults, which the docstrings name last.
    """

    if TYPE_CHECKING:  # fields or properties of the plant

        @property
        def name(self) -> str:
            """Its name in tables and files."""

        @property
        def states(self) -> int:
            """The number of elements of an initial state."""

    @property
    @abstractmethod
    def handles(self) -> Mapping[str, Handle]:
        """Every parameter by name."""

    @abstractmethod
    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The output (N, ny) for inputs (N, nu), and the state after them; blocks give the same as one run."""

    def sampler(self, state: PlantState, signals: Sequence[Signal]) -> Sampler | None:
        """The plant between two samples, for runs from Python sample by sample; None where `run` has to do."""
        return None

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample, from an initial state and a constant past command (nu,).

        Here it is the initial state itself, without delay or filter.
        """
        return PlantState(dt, np.array(state, dtype=float), NO_ROWS, NO_ROWS)

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu) held over ``dt`` seconds, from an initial state."""
        return self.run(self.start(state, inputs[0], dt, signals, len(inputs)), inputs, signals)[0]

    def for_inputs(self, inputs: Array) -> Self:
        """The plant as it is in a record with inputs (N, nu); the same."""
        return self

    def for_segment(self, segment: Record) -> Self:
        """The plant as it is in a segment: `for_inputs`, and with the parameters of its experiment if these differ."""
        return self.for_inputs(segment.input)

    def record_of(self, segment: Record) -> int:
        """The number of the fitted record that a segment is from; -1 unless parameters differ by record."""
        return -1

    def of_record(self, number: int) -> Plant:
        """The plant as it is in a fitted record, by `record_of`; itself unless parameters differ by record."""
        return self

    def own_parameter(self, name: str) -> tuple[str, int] | None:
        """Of a parameter that differs by record its name in every record, and the record; else None."""
        return None

    @property
    def driven(self) -> Any:
        """The plant with its drive and its sensor, to which parts can be added; None: it has neither."""
        return None

    @property
    def body(self) -> str:
        """The moving part in one word: ``motor``, ``axis``; by default ``plant``."""
        return "plant"

    @property
    def default_free(self) -> tuple[str, ...]:
        """The parameters estimated by default, those to fix first coming first; all of them."""
        return tuple(self.handles)

    @property
    def secondary(self) -> frozenset[str]:
        """Parameters with small effects, which join the search later; none."""
        return frozenset()

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """Its friction laws, by the prefix of their parameter names; none."""
        return {}

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The plant with other friction laws, by name; the same, as it has none.

        Raises:
            ModelError: for any law.
        """
        if laws:
            raise ModelError(f"{self.name} has no friction law {', '.join(laws)}")
        return self

    def signal_of(self, name: str, unit: str) -> Signal:
        """The signal of an output, from its unit; here not from its name."""
        return _BY_UNIT.get(unit, Signal.SPEED if self.channels is None else self.channels.default_signal)

    def suggested(self, segments: Sequence[Record], signals: Sequence[Signal]) -> Sequence[Plant]:
        """The plant with other values to begin a search with, as some records show them; none."""
        return ()

    @property
    def may_have_parts(self) -> bool:
        """Whether some records show `possible_parts`; none."""
        return False

    def possible_parts(self, segments: Sequence[Record], signals: Sequence[Signal]) -> Sequence[Part]:
        """What it may have in addition that some records can show, whether it has it or not; nothing."""
        return ()

    def with_parts(self, parts: Sequence[Part]) -> Self:
        """The plant with just these of its possible parts; values of those that it has already stay."""
        return self

    def effects_of_parts(
        self, groups: Sequence[Sequence[Part]], segment: Record, state: Array, signals: Sequence[Signal]
    ) -> Iterator[Array]:
        """Of every group of parts (N, ny, parts, k), derivatives by their k parameters, where these are zero; none."""
        return iter(())

    @property
    def tests(self) -> Mapping[str, tuple[str, ...]]:
        """Tests that show what a record does not: by code the inputs that they step, the simplest first; none."""
        return {}

    @property
    def test_names(self) -> tuple[str, ...]:
        """The names of the inputs that a test chooses; one, which has the name that a record gives it."""
        return ("",)

    @property
    def of_current(self) -> tuple[str, ...]:
        """Parameters that have no effect where no current flows; none."""
        return ()

    @property
    def open_circuit(self) -> Mapping[str, float]:
        """Values with which no current flows; none."""
        return {}

    @property
    def counted(self) -> tuple[str, ...]:
        """Parameters that no record shows and a user counts, which a design without a fit needs; none."""
        return ()

    def for_test(self) -> Self:
        """The plant with the inputs of a test; the same."""
        return self

    @property
    def absent(self) -> tuple[str, ...]:
        """Parameters of parts that this plant does not have; none."""
        return ()

    def without_effect(self, signals: Sequence[Signal]) -> tuple[str, ...]:
        """Parameters without effect on these signals for the present drive; none."""
        return ()

    @property
    def changes_resistance(self) -> bool:
        """Whether it has a winding whose resistance changes within a run; no."""
        return False

    @property
    def begins_risen(self) -> float:
        """The state `RISE` where a run begins, of a plant with such a winding; zero."""
        return 0.0

    def rise_in(self, state: PlantState) -> float:
        """By which part of it the resistance of the winding has risen in a state; not."""
        return 0.0

    def as_left(self, state: PlantState) -> Self:
        """The plant as a run over a record leaves it, with what does not go back before the next; the same."""
        return self

    @property
    def channels(self) -> Channels | None:
        """Its output signals and its command; None: it accepts any inputs and outputs."""
        return None

    def linearised(self, signals: Sequence[Signal]) -> StateSpace | None:
        """The linear plant in motion, without dry friction, dead zones and delay; None: not known."""
        return None

    def value(self, name: str) -> float:
        """The value of a parameter in SI units; for both directions, the forward value."""
        path, sign = self._handle(name).paths[0]
        return sign * read_at(self, path)

    def with_values(self, values: Mapping[str, float]) -> Self:
        """The same plant with other parameters, by name, in SI units.

        Raises:
            ModelError: for an unknown name or a value outside its physical bounds.
        """
        known = self.handles
        found_by_name = ((known.get(name) or self._handle(name), float(value)) for name, value in values.items())
        numbers = {path: sign * value for handle, value in found_by_name for path, sign in handle.paths}
        found: Self = with_numbers(self, numbers)
        return found

    def for_command(self, record: Record) -> Self:
        """The plant as the command of a record drives it; the same."""
        return self

    def measured_by(self, known: Mapping[str, float], asked: Collection[str] = ()) -> Self:
        """The plant with the known or estimated parameters that decide on the units of its outputs; the same.

        Args:
            known: values by name.
            asked: names of estimated parameters.
        """
        return self

    @property
    def hold(self) -> Hold:
        """The hold of its inputs between their samples; zero order: they are held."""
        return Hold.ZERO

    def with_hold(self, hold: Hold) -> Self:
        """The plant with this hold of its inputs; the same.

        Raises:
            ModelError: for inputs that are not held.
        """
        if hold is not Hold.ZERO:
            raise ModelError(f"{self.name} holds its inputs between the samples; give hold='zero'", arguments=("hold",))
        return self

    @property
    def latency(self) -> int:
        """The delay of `run` in samples; zero, as it does not need the next input to interpolate."""
        return 0

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """The number of samples that give its initial state."""
        return BEGINNING

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """Start values of the state at the first sample of a record; zeros."""
        return np.zeros(self.states)

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """The indices of the initial state to estimate; all of them."""
        return tuple(range(self.states))

    def plausible(self, measure: Measure, sizes: Sizes) -> float:
        """The plausible size of a parameter of this measure in records of these sizes; 0 if unknown.

        It follows from force and speed, with a force as large as the input.
        """
        return plausible(measure, sizes.command, sizes)

    def resolution_limits(self, asked: Sequence[str], dt: float) -> dict[str, tuple[float, float]]:
        """Bounds beyond which the sample time cannot resolve the effect of a parameter, by its name; none."""
        return {}

    def with_starts(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The plant with starts for estimated parameters without effect at their present values; the same."""
        return self

    def simpler(self, names: Sequence[str]) -> tuple[Plant, list[str]] | None:
        """A plant with fewer parameters to compare the fit with, and its part of the names; None: there is none."""
        return None

    def interpolating(self) -> tuple[Plant, ...]:
        """The plant with every smoother course of the input between samples that no search tries; none."""
        return ()

    def acting(self, inputs: int) -> tuple[int, ...]:
        """The columns, of this number of inputs, that act between samples; all of them."""
        return tuple(range(inputs))

    def driven_by_means(self) -> Plant:
        """The plant where a mean over rows of the input acts in a sample, and not a value that is held; the same."""
        return self

    def means_of(self, inputs: Array, rows: int) -> Array:
        """Inputs (N, nu), the acting ones as the means over an odd number of rows around each."""
        found, half = inputs.copy(), rows // 2
        for k in self.acting(inputs.shape[1]):
            found[:, k] = np.convolve(np.pad(inputs[:, k], half, mode="edge"), np.full(rows, 1 / rows), "valid")
        return found

    def motion(self, inputs: Array, dt: float, state: Array) -> Array | None:
        """(N,) the true speed, without the sensor, exactly 0 while friction holds it; None: not known."""
        return None

    def unseen(self, rows: Sequence[Estimate], groups: Sequence[Sequence[str]], span: float) -> list[Finding]:
        """Findings about parts of it that the records do not show, with a parameter of each as the subject; none.

        Args:
            rows: of its table of parameters.
            groups: of those that the records do not identify separately.
            span: the range of its position in the records.
        """
        return []

    def friction_characteristic(self) -> StaticCharacteristic | None:
        """All its friction over speed, including the viscous part; None: not known."""
        return None

    def dead_zone_characteristic(self) -> StaticCharacteristic | None:
        """The output of its dead zone; None: not known."""
        return None

    def cogging_characteristic(self) -> StaticCharacteristic | None:
        """Its cogging over a turn; None: it has none, or it is not known over a turn."""
        return None

    def remarks(self, segments: Sequence[Record], signals: Sequence[Signal]) -> list[Finding]:
        """Findings about its estimates that a reader of its table wants in a sentence; none."""
        return []

    def quantities(self) -> tuple[Quantity, ...]:
        """Combinations of parameters with a meaning, such as time constants, which data may determine better; none."""
        return ()

    def equations(self) -> str:
        """Its equations in symbols, one per line; empty: not known."""
        return ""

    def to_data(self) -> dict[str, Any]:
        """Its entries in a model file besides its kind, in built-in types: its finite parameters."""
        return {"parameters": parameters_of(self)}

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant of this kind described by `to_data`."""
        return self.with_values(data["parameters"])

    def _handle(self, name: str) -> Handle:
        return find_handle(self, name)


def parameters_of(plant: Plant) -> dict[str, float]:
    """Every finite single value of a plant by its name."""
    return {
        name: plant.value(name)
        for name, handle in plant.handles.items()
        if len(handle.paths) == 1 and isfinite(plant.value(name))
    }


_PLAUSIBLE: dict[Measure, Callable[[float, Sizes], float]] = {
    Measure.FORCE: lambda force, sizes: 0.1 * force,
    Measure.DAMPING: lambda force, sizes: 0.1 * force / sizes.output,
    Measure.QUADRATIC: lambda force, sizes: 0.1 * force / sizes.output**2,
    Measure.PER_SPEED: lambda force, sizes: 10 / sizes.output,
    Measure.PER_FORCE: lambda force, sizes: 0.1 / force if force else 0.0,
    Measure.SPEED: lambda force, sizes: 0.1 * sizes.output,
    Measure.COMMAND: lambda force, sizes: 0.1 * sizes.command,
    Measure.TIME: lambda force, sizes: sizes.dt,
    Measure.FACTOR: lambda force, sizes: 1.0,
    Measure.OTHER: lambda force, sizes: 0.0,
}


def plausible(measure: Measure, force: float, sizes: Sizes) -> float:
    """The plausible size of a parameter for the largest force ``force``; 0 if unknown."""
    return _PLAUSIBLE[measure](force, sizes)
