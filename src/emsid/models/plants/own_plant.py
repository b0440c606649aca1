"""A plant that a user defines by functions of state, input and parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf
from typing import Self

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import did_you_mean
from emsid.compiled import by_content
from emsid.errors import EmsidError, ModelError, listed
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.input_path import INTERPOLATION_REACH, between
from emsid.models.plants.drive import Hold
from emsid.models.plants.own_sampling import OwnSampler, compiled, compiled_runge_kutta, runge_kutta
from emsid.models.plants.parameters import Handle, Signal
from emsid.models.plants.plant import BEGINNING, Plant, Sampler
from emsid.models.plants.state import NO_ROWS, PlantState
from emsid.models.terms import check_whole
from emsid.plant.parameter import Measure, Parameter
from emsid.record import Record

Array = NDArray[np.float64]

# Samples on either side that an input between its samples depends on; None where it is held.
REACH: dict[str, int | None] = {"held": None, "linear": 0, "band-limited": INTERPOLATION_REACH}
# A difference of initial states is forgotten when this part of it is left; samples in which that is looked for.
FORGOTTEN, LONGEST = 0.02, 2_000

Derivative = Callable[[Array, Array, Array], Sequence[float] | Array]


@dataclass(frozen=True)
class OwnPlant(Plant):
    """A user's plant: dx/dt = derivative(x, u, p), y = output(x, u, p).

    It is integrated by the classical Runge–Kutta method. Functions compiled with ``numba.njit`` run in a compiled loop;
    they must return arrays.

    A continuous input that is simulated as held is half a sample late, which biases every parameter of an oscillator;
    ``between`` states the hold.

    Args:
        derivative: of the state (n,), a function of state, input (nu,) and parameters (p,).
        output: (ny,), a function of the same arguments.
        table: the parameters, in the order of p.
        values: (p,) their values.
        states: n, the number of states.
        bounds: (name, lower, upper) for every parameter that has bounds.
        steps: Runge–Kutta steps per sample.
        name: its name in tables.
        between: the hold of the input between its samples: ``held``, ``linear`` or ``band-limited``.
        first: (n,) where the search for the initial state of every record begins; zeros by default.
        beginning: the number of samples from which a free run estimates its initial state. By default as many as a
            difference of initial states lasts in the first record of a fit, at least twenty.

    Raises:
        ModelError: for as many values as the table does not have rows, bounds of no parameter or that do not ascend,
            numbers of states or steps that are not positive, or another ``between``; when simulated, for functions that
            fail or return a wrong shape.
    """

    derivative: Derivative
    output: Derivative
    table: tuple[Parameter, ...]
    values: tuple[float, ...]
    states: int
    bounds: tuple[tuple[str, float, float], ...] = ()
    steps: int = 1
    name: str = "plant"
    between: str = "held"
    first: tuple[float, ...] = ()
    beginning: int | None = None

    def __post_init__(self) -> None:
        by_content(self.derivative)
        by_content(self.output)
        if self.between not in REACH:
            raise ModelError(
                f"{self.name}: between is {self.between!r}; give one of {listed(list(REACH))}"
                f"{did_you_mean(str(self.between), list(REACH))}"
            )
        check_whole(f"{self.name}: states", self.states, 1, "a plant has at least one state")
        check_whole(f"{self.name}: steps", self.steps, 1, "these are Runge–Kutta steps per sample")
        if self.first and len(self.first) != self.states:
            raise ModelError(f"{self.name}: {len(self.first)} numbers in first for {self.states} states")
        if len(self.values) != len(self.table):
            raise ModelError(f"{self.name}: {len(self.values)} values for {len(self.table)} parameters")
        names = [each.name for each in self.table]
        for name, lower, upper in self.bounds:
            if name not in names:
                raise ModelError(
                    f"{self.name}: bounds of {name!r}, which is no parameter; there are {listed(names)}"
                    f"{did_you_mean(name, names)}"
                )
            if not lower <= upper:
                raise ModelError(f"{self.name}: bounds of {name} from {lower:g} to {upper:g}; they must ascend")

    @property
    def handles(self) -> Mapping[str, Handle]:
        """One handle for every row of the table."""
        limits = {name: (lower, upper) for name, lower, upper in self.bounds}
        return {
            p.name: Handle(p, ((("values", k), 1.0),), *limits.get(p.name, (-inf, inf)), _measure(p.unit))
            for k, p in enumerate(self.table)
        }

    def start(
        self, state: Array, command: Array, dt: float, signals: Sequence[Signal], samples: int | None = None
    ) -> PlantState:
        """The state (n,) before the first sample; signals are not used.

        Raises:
            Infeasible: for functions that fail.
            ModelError: for functions that return a wrong shape.
        """
        start, parameters = np.array(state, dtype=float), np.array(self.values)
        for what, function, shape in (
            ("derivative", self.derivative, (self.states,)),
            ("output", self.output, (len(signals),) if signals else None),
        ):
            with self._reporting(what):
                found = np.shape(function(start.copy(), command, parameters))
            if len(found) != 1 or (shape is not None and found != shape):
                wanted = "(ny,)" if shape is None else shape
                raise ModelError(f"{self.name}: its {what} has shape {found}; it must be {wanted}")
        return PlantState(dt, start, np.tile(command, (REACH[self.between] or 0, 1)), NO_ROWS)

    @contextmanager
    def _reporting(self, what: str) -> Iterator[None]:
        """Calls of the user's functions; what these raise becomes an error in one line.

        It is `Infeasible`, since a function may fail at some parameters only, such as a root of a negative number.
        """
        try:
            yield
        except EmsidError:
            raise
        except Exception as problem:  # whatever a user's code may raise
            raise Infeasible(f"{self.name}: its {what} failed: {type(problem).__name__}: {problem}") from problem

    @property
    def latency(self) -> int:
        """One sample for a linear input, which needs the next sample; seventeen for a band-limited one."""
        reach = REACH[self.between]
        return 0 if reach is None else reach + 1

    def simulate(self, inputs: Array, dt: float, state: Array, signals: Sequence[Signal]) -> Array:
        """The output (N, ny) driven by inputs (N, nu), from an initial state; see `Plant.simulate`."""
        start, late = self.start(state, inputs[0], dt, signals, len(inputs)), self.latency
        return self.run(start, np.concatenate([inputs, np.repeat(inputs[-1:], late, axis=0)]), signals)[0][late:]

    @property
    def hold(self) -> Hold:
        """``first`` for a linear input, else ``zero``."""
        return Hold.FIRST if self.between == "linear" else Hold.ZERO

    def with_hold(self, hold: Hold) -> Self:
        """The plant with a held or a linear input."""
        return replace(self, between="linear" if hold is Hold.FIRST else "held") if hold is not self.hold else self

    def interpolating(self) -> tuple[Self, ...]:
        """The plant with every smoother ``between``: band-limited is smoother than linear, and linear than held."""
        order = list(REACH)
        return tuple(replace(self, between=between) for between in order[order.index(self.between) + 1 :])

    def for_command(self, record: Record) -> Self:
        """The plant with as many samples for the initial state as a difference of initial states lasts in a record."""
        if self.beginning is not None:
            return self
        head = record[:LONGEST]
        with np.errstate(all="ignore"):  # a run that is not finite is refused where its error is
            one, other = (
                self.simulate(head.input, head.dt, state, ())
                for state in (self.first_state((), head), self.first_state((), head) * 1.05 + 0.01)
            )
            apart = np.abs(one - other).max(axis=1)
        lasting = np.flatnonzero(~(apart <= FORGOTTEN * apart.max(initial=0.0)))
        samples = int(lasting[-1]) + 1 if len(lasting) else 0
        return replace(self, beginning=int(np.clip(samples, BEGINNING, max(BEGINNING, len(record) // 8))))

    def start_samples(self, signals: Sequence[Signal]) -> int:
        """See ``beginning``."""
        return max(self.beginning or BEGINNING, self.latency + 1)

    def first_state(self, signals: Sequence[Signal], segment: Record) -> Array:
        """See ``first``."""
        return np.array(self.first) if self.first else np.zeros(self.states)

    def run(self, state: PlantState, inputs: Array, signals: Sequence[Signal]) -> tuple[Array, PlantState]:
        """The outputs (N, ny) for inputs (N, nu), `latency` samples late, and the state after them."""
        both = hasattr(self.derivative, "py_func") and hasattr(self.output, "py_func")
        moving = compiled_runge_kutta if both else runge_kutta
        parameters, x = np.array(self.values), state.motion.copy()
        inputs = np.ascontiguousarray(inputs)
        with self._reporting("output"):
            width = len(signals) or len(np.asarray(self.output(x.copy(), inputs[0], parameters)))
        out = np.empty((len(inputs), width))
        reach = REACH[self.between]
        if reach is None:
            with self._reporting("derivative or output"):
                moving(self.derivative, self.output, inputs, 0, parameters, x, state.dt, self.steps, out)
            return out, state._replace(motion=x)
        window = np.concatenate([state.commands, inputs])
        ready = max(len(window) - 2 * reach - 1, 0)
        waiting = len(inputs) - ready
        if waiting:  # the beginning of a run: what is not known yet repeats the first output
            out[:waiting] = np.asarray(self.output(x.copy(), inputs[0], parameters))
        fine = self._fine(window, reach)[: 2 * self.steps * ready + 1]
        with self._reporting("derivative or output"):
            moving(self.derivative, self.output, fine, 1, parameters, x, state.dt, self.steps, out[waiting:])
        return out, state._replace(motion=x, commands=window[max(len(window) - 2 * reach - 1, 0) :])

    def sampler(self, state: PlantState, signals: Sequence[Signal]) -> Sampler | None:
        """See `Plant.sampler`; the functions are compiled, which takes a second, if Numba can compile them."""
        inputs = max(state.commands.shape[1] if len(state.commands) else 1, 1)
        arguments = state.motion.copy(), np.zeros(inputs), np.array(self.values)
        f, g = (compiled(each, *arguments) for each in (self.derivative, self.output))
        if f is None or g is None:
            return None
        reach = REACH[self.between]
        taps = None
        if reach is not None:
            units = np.eye(2 * reach + 2)
            taps = np.column_stack([self._fine(each[:, None], reach)[: 2 * self.steps + 1, 0] for each in units])
        return OwnSampler(f, g, arguments[2], taps, self.steps, state, inputs)

    def _fine(self, window: Array, reach: int) -> Array:
        """(k, nu) the inputs at every half step, from the row ``reach`` of a window on."""
        parts = 2 * self.steps
        if not reach:
            at = np.arange((len(window) - 1) * parts + 1) / parts
            return np.stack([np.interp(at, np.arange(len(window)), each) for each in window.T], axis=1)
        if len(window) <= 2 * reach:
            return window[:0]
        return np.stack([between(np.ascontiguousarray(each), parts) for each in window.T], axis=1)


def _measure(unit: str) -> Measure:
    """The most likely measure of a parameter with this unit."""
    return next((each for each in Measure if unit and unit in each.value), Measure.OTHER)
