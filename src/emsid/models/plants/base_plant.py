"""The base class of plants: defaults for everything that `Plant` declares but ``handles`` and ``run``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.linear_parts import StateSpace
from emsid.models.plants.drive import Hold
from emsid.models.plants.parameters import Handle, Signal, find_handle, read_at, with_numbers
from emsid.models.plants.plant import Channels, DrivenPlant, Limits, Plant, Quantity, Sizes, StaticCharacteristic
from emsid.models.plants.state import NO_ROWS, PlantState
from emsid.plant.friction import FrictionLaw
from emsid.plant.parameter import Measure
from emsid.record import Record

Array = NDArray[np.float64]

BEGINNING = 20
"""Samples that give the initial state if one sample is not enough."""


class BasePlant(ABC):
    """The base class of a user's plant, with defaults for everything but parameters and motion.

    A plant is a frozen dataclass. Its fields, or their fields, hold the parameters that ``handles`` declares. It
    defines ``name`` and the number of ``states``.
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
        """The initial state itself, without delay or filter."""
        return PlantState(dt, np.array(state, dtype=float), NO_ROWS, NO_ROWS)

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu) held over ``dt`` seconds, from an initial state."""
        return self.run(self.start(state, inputs[0], dt, signals, len(inputs)), inputs, signals)[0]

    def at_once(self, signals: Sequence[Signal]) -> bool:
        """False: plants are simulated one after the other."""
        return False

    @staticmethod
    def simulate_each(
        plants: Sequence[Any],
        inputs: Sequence[Array],
        dt: float,
        states: Sequence[Sequence[Array]],
        signals: Sequence[Signal],
        loads: Sequence[Array] = (),
    ) -> list[Array]:
        """`simulate` for several plants of this kind and several inputs.

        Args:
            plants: P of them.
            inputs: (N, nu) each.
            dt: sample time in s.
            states: of every plant the initial state for every input.
            signals: of the outputs.
            loads: (N,) for every input, held over every sample, besides that of the plant; of one mass only.

        Returns:
            (P, N, ny) for every input.

        Raises:
            ModelError: for loads on a plant that is not one mass, or with a current.
        """
        if loads:
            raise ModelError(f"{plants[0].name}: a load that changes is simulated for one mass and its motion only")
        return [
            np.array([plant.simulate(u, dt, begin[k], signals) for plant, begin in zip(plants, states, strict=True)])
            for k, u in enumerate(inputs)
        ]

    def for_inputs(self, inputs: Array) -> Self:
        """The same plant."""
        return self

    def for_segment(self, segment: Record) -> Self:
        """The plant as it is with the inputs of a segment."""
        return self.for_inputs(segment.input)

    def record_of(self, segment: Record) -> int:
        """-1: no parameter differs by record."""
        return -1

    def of_record(self, number: int) -> Plant:
        """The same plant: no parameter differs by record."""
        return self

    def own_parameter(self, name: str) -> tuple[str, int] | None:
        """None: no parameter differs by record."""
        return None

    @property
    def body(self) -> str:
        """``plant``."""
        return "plant"

    @property
    def default_free(self) -> tuple[str, ...]:
        """All of them."""
        return tuple(self.handles)

    @property
    def secondary(self) -> frozenset[str]:
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
    def absent(self) -> tuple[str, ...]:
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
        """None: no regression gives its start values."""
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
        """The same plant for any drive."""
        return self

    @property
    def hold(self) -> Hold:
        """Zero order: they are held."""
        return Hold.ZERO

    def with_hold(self, hold: Hold) -> Self:
        """The same plant.

        Raises:
            ModelError: for inputs that are not held.
        """
        if hold is not Hold.ZERO:
            raise ModelError(f"{self.name} holds its inputs between the samples; give hold='zero'", arguments=("hold",))
        return self

    @property
    def latency(self) -> int:
        """Zero."""
        return 0

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
        """From force and speed, with a force as large as the input."""
        return plausible(measure, sizes.command, sizes)

    def resolution_limits(self, asked: Sequence[str], dt: float) -> dict[str, tuple[float, float]]:
        """No bounds."""
        return {}

    def with_starts(self, asked: Sequence[str], segments: Sequence[Record], limits: Limits) -> Self:
        """The same plant."""
        return self

    def simpler(self, names: Sequence[str]) -> tuple[Plant, list[str]] | None:
        """No simpler plant."""
        return None

    def interpolating(self) -> tuple[Plant, ...]:
        """None; a search tries whatever the drive can do."""
        return ()

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
        """The plant with the parameters described by `to_data`."""
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
    Measure.SPEED: lambda force, sizes: 0.1 * sizes.output,
    Measure.COMMAND: lambda force, sizes: 0.1 * sizes.command,
    Measure.TIME: lambda force, sizes: sizes.dt,
    Measure.FACTOR: lambda force, sizes: 1.0,
    Measure.OTHER: lambda force, sizes: 0.0,
}


def plausible(measure: Measure, force: float, sizes: Sizes) -> float:
    """The plausible size of a parameter for the largest force ``force``; 0 if unknown."""
    return _PLAUSIBLE[measure](force, sizes)
