"""What a plant is: a frozen value that simulates itself and declares all that the rest of the program asks of it.

It declares its parameters, its channels, its start and its characteristics; nobody asks for its type or its name. A
plant of a user's derives from `BasePlant`, which answers everything but ``handles`` and ``run`` for a plant of which no
more is known, or is an `OwnPlant`. `registry` lists the plants that files and candidates know.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.linear_parts import StateSpace
from emsid.models.plants.drive import Bridge, Drive
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import Handle, Signal, find_handle, read_at, write_at
from emsid.models.plants.state import NOTHING, PlantState
from emsid.plant.friction import FrictionLaw
from emsid.plant.parameter import Measure
from emsid.record import Record

Array = NDArray[np.float64]


class Quantity(NamedTuple):
    """A combination of parameters that has a meaning of its own, such as a time constant.

    Attributes:
        name: what it is called.
        formula: of the parameters' symbols.
        unit: SI.
        value: in that unit.
    """

    name: str
    formula: str
    unit: str
    value: float


class Channels(NamedTuple):
    """What signals a plant gives and what command it takes.

    Attributes:
        units: the signals that it gives, each with its unit.
        usual: what an output without a unit is taken for.
        commands: units that its command may be in.
        made: what a command without a unit is taken for: ``volts``.
        source: what drives it, in a word: ``voltage``.
        codes: values of the input that are no command.
        bridge: whether what drives it can short it or leave it open.
        nothing: what is missing where it is left open: ``torque``.
    """

    units: Mapping[Signal, str]
    usual: Signal
    commands: tuple[str, ...]
    made: str
    source: str
    codes: tuple[tuple[float, Bridge], ...] = ()
    bridge: bool = False
    nothing: str = "torque"


class StaticCharacteristic(NamedTuple):
    """A static characteristic of a plant: what comes out over what goes in.

    Attributes:
        law: (n,) out of (n,) in.
        x, y: name and unit of what goes in and of what comes out.
        breakaway: (forward, backward) of a friction, what holds it at rest.
        edge: of a dead zone, the larger of its break points.
    """

    law: Callable[[Array], Array]
    x: tuple[str, str]
    y: tuple[str, str]
    breakaway: tuple[float, float] = (0.0, 0.0)
    edge: float = 0.0


class Sizes(NamedTuple):
    """How large things are in some records.

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
    """Anything the grey box can fit: a value with named parameters that simulates itself."""

    @property
    def name(self) -> str:
        """What it is called in tables and files."""
        ...

    @property
    def body(self) -> str:
        """What moves, in a word: ``motor``, ``axis``."""
        ...

    @property
    def handles(self) -> Mapping[str, Handle]:
        """Every parameter by name."""
        ...

    @property
    def usual(self) -> tuple[str, ...]:
        """The parameters estimated by default, those first that should rather be fixed."""
        ...

    @property
    def fine(self) -> frozenset[str]:
        """Parameters that matter only once the others are about right: they join the search later."""
        ...

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """Its friction laws, by the names that their parameters begin with."""
        ...

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The plant with other friction laws, by name."""
        ...

    @property
    def lacks(self) -> tuple[str, ...]:
        """Parameters of parts that this plant does not have."""
        ...

    def without_effect(self, signals: Sequence[Signal]) -> tuple[str, ...]:
        """Parameters that change none of these signals as the plant is driven now."""
        ...

    @property
    def states(self) -> int:
        """How many numbers an initial state has."""
        ...

    @property
    def channels(self) -> Channels | None:
        """What signals it gives and what command it takes; None for a plant that takes any inputs and outputs."""
        ...

    def linearised(self, signals: Sequence[Signal]) -> StateSpace | None:
        """The plant in motion, without dry friction, dead zones and delay; None where that is not known."""
        ...

    @property
    def driven(self) -> DrivenPlant | None:
        """The plant itself where a regression on the records can suggest its start, else None."""
        ...

    def value(self, name: str) -> float:
        """The value of a parameter in SI units."""
        ...

    def put(self, values: Mapping[str, float]) -> Self:
        """The plant with other parameters."""
        ...

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state before the first sample, from an initial state and a command (nu,) that stood until then."""
        ...

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The output (N, ny) driven by inputs (N, nu), and the state after them: blocks are as good as one run."""
        ...

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu) held over ``dt`` seconds, from an initial state."""
        ...

    def fed(self, record: Record) -> Self:
        """The plant as the command of a record drives it."""
        ...

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """How many samples show its state at the start."""
        ...

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """A first value of the state at the first sample of a record."""
        ...

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """Which numbers of the initial state are to be estimated."""
        ...

    def plausible(self, measure: Measure, sizes: Sizes) -> float:
        """How large a parameter that measures this plausibly is in records of these sizes; 0 where nobody knows."""
        ...

    def unresolved(self, asked: Sequence[str], dt: float) -> dict[str, tuple[float, float]]:
        """Bounds beyond which a sample time does not resolve what a parameter does, by its name."""
        ...

    def ready(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The plant with a start for those parameters asked for that would have no effect at their present values."""
        ...

    def simpler(self, names: Sequence[str]) -> tuple[Plant, list[str]] | None:
        """A plant with fewer parameters to compare the fit with, and which of the names it has; None without one."""
        ...

    def motion(self, inputs: Array, dt: float, state: Array) -> Array | None:
        """(N,) how fast it moves, whatever a sensor shows, exactly 0 where friction holds it; None if unknown."""
        ...

    def friction_characteristic(self) -> StaticCharacteristic | None:
        """All its friction over speed, the viscous part included; None where it has none that is known."""
        ...

    def dead_zone_characteristic(self) -> StaticCharacteristic | None:
        """What comes through its dead zone; None without one."""
        ...

    def quantities(self) -> tuple[Quantity, ...]:
        """Combinations of parameters with a meaning of their own, which may be known better than the parameters."""
        ...

    def equations(self) -> str:
        """Its equations in symbols, a line each; empty where they are not known."""
        ...

    def to_data(self) -> dict[str, Any]:
        """What a model file holds of it besides its kind, in built-in types."""
        ...

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant of this kind that `to_data` described."""
        ...


class DrivenPlant(Plant, Protocol):
    """A plant of one mass behind a drive: a regression on the records suggests its start, and refinements apply."""

    @property
    def drive(self) -> Drive:
        """What makes the force or voltage from the command."""
        ...

    @property
    def friction_name(self) -> str:
        """The name that its friction parameters begin with."""
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
        """By what forces are divided where commands and outputs are divided by these; see `scaling`."""
        ...

    def put_motion(self, motion: Motion) -> Self:
        """The plant that moves like this."""
        ...

    def turned(self) -> Self:
        """The same plant with its drive the other way round."""
        ...

    def bent(self, ready: Plant, asked: Sequence[str], limits: Limits) -> list[Plant]:
        """The plant made ready, or where a knee of which nothing is known is asked for, with it at several places."""
        ...

    def with_drive(self, **changes: Any) -> Self:
        """The plant with another drive."""
        ...


class BasePlant(ABC):
    """A plant of which nothing is known but its parameters and its motion: what a plant of a user's derives from.

    Such a plant is a frozen dataclass whose fields, or fields of its fields, hold the parameters that ``handles``
    declares. It has a ``name`` and says how many ``states`` it has.
    """

    if TYPE_CHECKING:  # fields or properties of the plant

        @property
        def name(self) -> str:
            """What it is called in tables and files."""

        @property
        def states(self) -> int:
            """How many numbers an initial state has."""

    @property
    @abstractmethod
    def handles(self) -> Mapping[str, Handle]:
        """Every parameter by name."""

    @abstractmethod
    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The output (N, ny) driven by inputs (N, nu), and the state after them."""

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The initial state itself: nothing is delayed or filtered."""
        return PlantState(dt, np.array(state, dtype=float), NOTHING, NOTHING)

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu) held over ``dt`` seconds, from an initial state."""
        return self.run(self.start(state, inputs[0], dt, signals, len(inputs)), inputs, signals)[0]

    @property
    def body(self) -> str:
        """``plant``."""
        return "plant"

    @property
    def usual(self) -> tuple[str, ...]:
        """All of them."""
        return tuple(self.handles)

    @property
    def fine(self) -> frozenset[str]:
        """None."""
        return frozenset()

    @property
    def frictions(self) -> Mapping[str, FrictionLaw]:
        """None."""
        return {}

    def with_frictions(self, laws: Mapping[str, FrictionLaw]) -> Self:
        """The same plant.

        Raises:
            ModelError: for any law.
        """
        if laws:
            raise ModelError(f"{self.name} has no friction law {', '.join(laws)}")
        return self

    @property
    def lacks(self) -> tuple[str, ...]:
        """None."""
        return ()

    def without_effect(self, signals: Sequence[Signal]) -> tuple[str, ...]:
        """None."""
        return ()

    @property
    def channels(self) -> Channels | None:
        """Any inputs and outputs."""
        return None

    def linearised(self, signals: Sequence[Signal]) -> StateSpace | None:
        """Not known."""
        return None

    @property
    def driven(self) -> DrivenPlant | None:
        """No regression suggests its start."""
        return None

    def value(self, name: str) -> float:
        """The value of a parameter in SI units; of one for both directions, the forward one."""
        path, sign = self._handle(name).paths[0]
        return sign * read_at(self, path)

    def put(self, values: Mapping[str, float]) -> Self:
        """The same plant with other parameters, by name, in SI units.

        Raises:
            ModelError: for a name it does not have or a value that is not physical.
        """
        plant = self
        for name, value in values.items():
            for path, sign in self._handle(name).paths:
                plant = write_at(plant, path, sign * float(value))
        return plant

    def fed(self, record: Record) -> Self:
        """The same, whatever drives it."""
        return self

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """Twenty."""
        return BEGINNING

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """Zeros."""
        return np.zeros(self.states)

    def free_states(self, signals: Sequence[Signal], segment: Record) -> tuple[int, ...]:
        """All of them."""
        return tuple(range(self.states))

    def plausible(self, measure: Measure, sizes: Sizes) -> float:
        """By force and speed, the force being as large as the input."""
        return plausible(measure, sizes.command, sizes)

    def unresolved(self, asked: Sequence[str], dt: float) -> dict[str, tuple[float, float]]:
        """No bounds."""
        return {}

    def ready(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The same plant."""
        return self

    def simpler(self, names: Sequence[str]) -> tuple[Plant, list[str]] | None:
        """No simpler plant."""
        return None

    def motion(self, inputs: Array, dt: float, state: Array) -> Array | None:
        """Not known."""
        return None

    def friction_characteristic(self) -> StaticCharacteristic | None:
        """Not known."""
        return None

    def dead_zone_characteristic(self) -> StaticCharacteristic | None:
        """Not known."""
        return None

    def quantities(self) -> tuple[Quantity, ...]:
        """None."""
        return ()

    def equations(self) -> str:
        """Not known."""
        return ""

    def to_data(self) -> dict[str, Any]:
        """Its parameters; infinite ones are left out."""
        return {"parameters": parameters_of(self)}

    def with_data(self, data: Mapping[str, Any]) -> Self:
        """The plant with the parameters that `to_data` described."""
        return self.put(data["parameters"])

    def _handle(self, name: str) -> Handle:
        return find_handle(self, name)


BEGINNING = 20
"""Samples that show the state at the start where one sample does not."""


def parameters_of(plant: Plant) -> dict[str, float]:
    """Every finite single value of a plant by its name."""
    return {
        name: plant.value(name)
        for name, handle in plant.handles.items()
        if len(handle.paths) == 1 and isfinite(plant.value(name))
    }


def plausible(measure: Measure, force: float, sizes: Sizes) -> float:
    """How large a parameter plausibly is where the largest force is ``force``; 0 where that says nothing."""
    return {
        Measure.FORCE: 0.1 * force,
        Measure.DAMPING: 0.1 * force / sizes.output,
        Measure.PER_SPEED: 10 / sizes.output,
        Measure.SPEED: 0.1 * sizes.output,
        Measure.COMMAND: 0.1 * sizes.command,
        Measure.TIME: sizes.dt,
        Measure.FACTOR: 1.0,
        Measure.OTHER: 0.0,
    }[measure]
