"""The interface of a plant: a frozen value that simulates itself and declares its properties.

A plant declares its parameters, its channels, its initial state and its characteristics; the program does not test its
type or its name. A user's plant is an `OwnPlant`, or derives from `BasePlant`. `registry` lists the plants for files
and candidates.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from emsid.models.linear_parts import StateSpace
from emsid.models.plants.drive import Bridge, Drive, Hold
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Handle, Signal
from emsid.models.plants.state import PlantState
from emsid.plant.friction import FrictionLaw
from emsid.plant.parameter import Measure
from emsid.record import Record

Array = NDArray[np.float64]


class Quantity(NamedTuple):
    """A combination of parameters with its own meaning, such as a time constant.

    Attributes:
        name: its name.
        formula: in the symbols of the parameters.
        unit: SI.
        value: in that unit.
    """

    name: str
    formula: str
    unit: str
    value: float


class Channels(NamedTuple):
    """The output signals and the command of a plant.

    Attributes:
        units: its output signals, each with its unit.
        default_signal: the assumed signal of an output without a unit.
        commands: possible units of its command.
        default_unit: the assumed unit of a command without a unit: ``volts``.
        source: the quantity that drives it: ``voltage``.
        codes: values of the input that are not commands.
        bridge: whether the source can short it or leave it open.
        zero_when_open: the quantity that is zero when it is left open: ``torque``.
    """

    units: Mapping[Signal, str]
    default_signal: Signal
    commands: tuple[str, ...]
    default_unit: str
    source: str
    codes: tuple[tuple[float, Bridge], ...] = ()
    bridge: bool = False
    zero_when_open: str = "torque"


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


class Plant(Protocol):
    """A physical model for a grey box: a value with named parameters that simulates itself."""

    @property
    def name(self) -> str:
        """What it is called in tables and files."""
        ...

    @property
    def body(self) -> str:
        """The moving part in one word: ``motor``, ``axis``."""
        ...

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Every parameter by name."""
        ...

    @property
    def default_free(self) -> tuple[str, ...]:
        """The parameters estimated by default; those to fix first come first."""
        ...

    @property
    def secondary(self) -> frozenset[str]:
        """Parameters with small effects; they join the search later."""
        ...

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """Its friction laws, by the prefix of their parameter names."""
        ...

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The plant with other friction laws, by name."""
        ...

    @property
    def absent(self) -> tuple[str, ...]:
        """Parameters of parts that this plant does not have."""
        ...

    def without_effect(self, signals: Sequence[Signal]) -> tuple[str, ...]:
        """Parameters without effect on these signals for the present drive."""
        ...

    @property
    def states(self) -> int:
        """How many numbers an initial state has."""
        ...

    @property
    def channels(self) -> Channels | None:
        """Its output signals and its command; None for a plant that accepts any inputs and outputs."""
        ...

    def linearised(self, signals: Sequence[Signal]) -> StateSpace | None:
        """The linear plant in motion, without dry friction, dead zones and delay; None if not known."""
        ...

    @property
    def driven(self) -> DrivenPlant | None:
        """The plant itself if a regression on the records can give its start values, else None."""
        ...

    def value(self, name: str) -> float:
        """The value of a parameter in SI units."""
        ...

    def with_values(self, values: Mapping[str, float]) -> Self:
        """The plant with other parameters."""
        ...

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample, from an initial state and a constant past command (nu,)."""
        ...

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The output (N, ny) for inputs (N, nu), and the state after them; blocks give the same as one run."""
        ...

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu) held over ``dt`` seconds, from an initial state."""
        ...

    def at_once(self, signals: Sequence[Signal]) -> bool:
        """Whether `simulate_each` computes the runs of several plants at once, not one after the other."""
        ...

    @staticmethod
    def simulate_each(
        plants: Sequence[Any],
        inputs: Sequence[Array],
        dt: float,
        states: Sequence[Sequence[Array]],
        signals: Sequence[Signal],
        loads: Sequence[Array] = (),
    ) -> list[Array]:
        """(P, N, ny) of every input: `simulate` for P plants of this kind, each with its initial states.

        Loads (N,) of every input are held over every sample, besides that of the plant.

        Raises:
            ModelError: for loads on a plant that is not one mass, or with a current.
        """
        ...

    def for_command(self, record: Record) -> Self:
        """The plant as the command of a record drives it."""
        ...

    @property
    def hold(self) -> Hold:
        """The hold of its inputs between their samples."""
        ...

    def with_hold(self, hold: Hold) -> Self:
        """The plant with this hold of its inputs."""
        ...

    def for_inputs(self, inputs: Array) -> Self:
        """The plant as it is in a record with inputs (N, nu)."""
        ...

    def for_segment(self, segment: Record) -> Self:
        """The plant as it is in a segment of a record: `for_inputs`, and with the parameters of its experiment."""
        ...

    def record_of(self, segment: Record) -> int:
        """The number of the fitted record that a segment is from; -1 unless parameters differ by record."""
        ...

    def of_record(self, number: int) -> Plant:
        """The plant as it is in a fitted record, by `record_of`; itself unless parameters differ by record."""
        ...

    def own_parameter(self, name: str) -> tuple[str, int] | None:
        """Of a parameter that differs by record its name in every record, and the record; else None."""
        ...

    @property
    def latency(self) -> int:
        """The delay of `run` in samples; zero unless it needs the next input to interpolate."""
        ...

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """The number of samples that give its initial state."""
        ...

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """Start values of the state at the first sample of a record."""
        ...

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """The indices of the initial state to estimate."""
        ...

    def plausible(self, measure: Measure, sizes: Sizes) -> float:
        """The plausible size of a parameter of this measure in records of these sizes; 0 if unknown."""
        ...

    def resolution_limits(self, asked: Sequence[str], dt: float) -> dict[str, tuple[float, float]]:
        """Bounds beyond which the sample time cannot resolve the effect of a parameter, by its name."""
        ...

    def with_starts(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The plant with start values for estimated parameters that have no effect at their present values."""
        ...

    def simpler(self, names: Sequence[str]) -> tuple[Plant, list[str]] | None:
        """A plant with fewer parameters to compare the fit with, and its part of the names; None without one."""
        ...

    def interpolating(self) -> tuple[Plant, ...]:
        """The plant with every hold that interpolates between samples and that no search tries."""
        ...

    def motion(self, inputs: Array, dt: float, state: Array) -> Array | None:
        """(N,) the true speed, without the sensor, exactly 0 while friction holds it; None if unknown."""
        ...

    def friction_characteristic(self) -> StaticCharacteristic | None:
        """All its friction over speed, including the viscous part; None if unknown."""
        ...

    def dead_zone_characteristic(self) -> StaticCharacteristic | None:
        """The output of its dead zone; None without one."""
        ...

    def quantities(self) -> tuple[Quantity, ...]:
        """Meaningful combinations of parameters, which may be better determined than the parameters."""
        ...

    def equations(self) -> str:
        """Its equations in symbols, one per line; empty if not known."""
        ...

    def to_data(self) -> dict[str, Any]:
        """Its entries in a model file besides its kind, in built-in types."""
        ...

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant of this kind described by `to_data`."""
        ...


class DrivenPlant(Plant, Protocol):
    """A plant of one mass with a drive: a regression on the records gives its start values, and refinements apply."""

    @property
    def drive(self) -> Drive:
        """The drive that converts the command to a force or voltage."""
        ...

    @property
    def friction_name(self) -> str:
        """The prefix of its friction parameters."""
        ...

    @property
    def load_name(self) -> str:
        """The name of its constant load."""
        ...

    @property
    def can_coast(self) -> bool:
        """Whether its bridge may leave it open in the off-time."""
        ...

    def largest_force(self, inputs: Array) -> float:
        """The largest force (torque) that inputs (N, nu) make."""
        ...

    def force_scale(self, command: float, output: float) -> float:
        """The divisor of forces when commands and outputs are divided by these; see `scaling`."""
        ...

    def with_motion(self, motion: Motion, fixed: Collection[str] = ()) -> Self:
        """The plant with this motion; other parameters follow from those of ``fixed`` as they are."""
        ...

    def reversed_drive(self) -> Self:
        """The same plant with the sign of its drive reversed."""
        ...

    def knee_starts(self, start: Plant, asked: Sequence[str], limits: Limits) -> list[Plant]:
        """The start plant, or several with different starts of an unknown knee that is estimated."""
        ...

    def with_drive(self, **changes: Any) -> Self:
        """The plant with another drive."""
        ...
