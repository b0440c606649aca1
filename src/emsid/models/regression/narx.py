"""Linear-in-the-parameters structures as data, and a structure with its parameters as a model.

A model that is linear in its parameters, ``y(t) = φᵀ(t)θ + e(t)`` (paper, eq. 3.6), is a list of regressors φᵢ. A
regressor is a product of powers of lagged channels, and a channel is an output, an input, or a static transform of one.
A `Structure` is such a list as a value: it can be printed, parsed and saved as text, and one compiled kernel builds the
regression of any structure. ARX, the paper's Wiener–Hammerstein regression and regressions with friction terms are
functions that return a structure.

Sign convention (the paper's and MATLAB's): ``A(q)y = B(q)u + e`` with ``A = 1 + a₁q⁻¹ + …``, so the regressor of a₁ is
−y(t−1).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.arguments import as_names
from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.nonlinear.few_unknowns import few_unknowns
from emsid.estimation.nonlinear.problem import Block, Infeasible
from emsid.models.free_run import RunMethods
from emsid.models.linear_parts import python_control
from emsid.models.model import levels
from emsid.models.regression.kernels import (
    Recursion,
    add_regression,
    fill,
    fill_rounding,
    predict_ahead,
    recursion,
    run_freely,
    weigh,
)
from emsid.models.regression.regressors import Regressor, Tables, parse_regressor, tables
from emsid.models.regression.sensitivities import Parts, largest_output_lag, parts, run_with_derivative
from emsid.record import Record

Array = NDArray[np.float64]


# Rows of a regression built at a time; they fit into the second-level cache.
BLOCK = 4096
# The most samples of the free run that finds the steady state of a nonlinear model, and how many are run at a time.
SETTLING, SETTLING_BLOCK = 100_000, 2_000
# A free run is in steady state if it changes by no more than this fraction of its largest output over its memory. It
# does not settle in time if it moves by more than this fraction of what it moved in the samples before.
SETTLED, SETTLES = 1e-12, 0.99


@dataclass(frozen=True)
class Structure:
    """A list of regressors: a linear-in-the-parameters model without its parameters.

    Args:
        regressors: the list, or from text: ``Structure.parse("y(t-1)", "u(t-1)^2")``.
        name: name in tables and files.
        parameter_names: a name for every parameter, θ1, θ2, … by default.
        inputs: number of input channels that a record must have; by default as many as are used.
    """

    regressors: tuple[Regressor, ...]
    name: str = "structure"
    parameter_names: tuple[str, ...] = ()
    inputs: int = 0

    def __post_init__(self) -> None:
        for each in as_names(self.regressors) if isinstance(self.regressors, str) else self.regressors:
            if not isinstance(each, Regressor):
                raise ModelError(f"{self.name}: {each!r} is no regressor; write texts as Structure.parse({each!r}, …)")
        if not self.regressors:
            raise ModelError(f"{self.name}: a structure needs at least one regressor")
        if len(set(self.regressors)) < len(self.regressors):
            twice = next(r for k, r in enumerate(self.regressors) if r in self.regressors[:k])
            raise ModelError(f"{self.name}: regressor {twice} stands twice in the list")
        used = max((f.channel for r in self.regressors for f in r.factors), default=0)
        if self.inputs < 0 or 0 < self.inputs < used:
            raise ModelError(
                f"{self.name}: {self.inputs} inputs, and its regressors use {used}; give that many or more, or none"
            )
        names = self.parameter_names or tuple(f"θ{k + 1}" for k in range(len(self)))
        if len(names) != len(self):
            raise ModelError(f"{self.name}: {len(names)} parameter names for {len(self)} regressors")
        object.__setattr__(self, "parameter_names", names)
        object.__setattr__(self, "inputs", max(self.inputs, used))

    @classmethod
    def parse(cls, *texts: str | Iterable[str], name: str = "structure") -> Structure:
        """Parse a structure from regressors as text, one by one or in a list.

        A regressor is made of products and powers of ``y(t-1)``, ``u(t-2)``, ``u2(t)``, ``sign(…)``, ``abs(…)``,
        ``tanh(…/0.1)``, ``exp(-abs(…)/0.1)``, ``max(…-0.3, 0)``, ``min(…+0.3, 0)``, a leading minus, and ``1``.

        >>> Structure.parse("y(t-1)*u(t-2)^2", "sign(y(t-1))", "max(u(t-1)-0.3, 0)").equation()
        'y(t) = θ1*y(t-1)*u(t-2)^2 + θ2*sign(y(t-1)) + θ3*max(u(t-1)-0.3, 0) + e(t)'

        Raises:
            ModelError: for a text that cannot be parsed, with the faulty part.
        """
        written = [text for each in texts for text in as_names(each)]
        return cls(tuple(parse_regressor(text) for text in written), name=name)

    def __len__(self) -> int:
        return len(self.regressors)

    def __add__(self, other: Structure) -> Structure:
        """Both lists of regressors, without duplicates."""
        known = set(self.regressors)
        new = [k for k, regressor in enumerate(other.regressors) if regressor not in known]
        return Structure(
            self.regressors + tuple(other.regressors[k] for k in new),
            name=self.name,
            inputs=max(self.inputs, other.inputs),
        )

    @cached_property
    def memory(self) -> int:
        """The largest lag: the number of past samples that a prediction needs."""
        return max((f.lag for r in self.regressors for f in r.factors), default=0)

    def equation(self, parameters: Sequence[float] | Array | None = None) -> str:
        """The difference equation, with names or numbers for the parameters, without terms of weight zero."""
        terms = []
        for k, regressor in enumerate(self.regressors):
            if parameters is not None and parameters[k] == 0:
                continue
            product = str(Regressor(regressor.factors))
            tail = "" if product == "1" else f"*{product}"
            if parameters is None:
                sign, weight = ("-" if regressor.negative else "+"), self.parameter_names[k]
            else:
                value = -parameters[k] if regressor.negative else parameters[k]
                sign, weight = ("-" if value < 0 else "+"), f"{abs(value):.6g}"
            terms.append(f"{sign} {weight}{tail}")
        text = " ".join(terms) or "0"
        return f"y(t) = {text.removeprefix('+ ')} + e(t)"

    @cached_property
    def tables(self) -> Tables:
        """The structure in the form that the kernels use."""
        return tables(self.regressors)

    def check(self, record: Record) -> None:
        """Refuse a record that this structure cannot be fitted to or run on.

        Raises:
            ModelError: if there is not one output, too few inputs, or no segment longer than the memory.
        """
        self.check_channels(record)
        longest = max(len(segment) for segment in record.segments)
        if longest <= self.memory:
            raise ModelError(
                f"{record.name}: its longest segment has {longest} samples; {self.name} looks back {self.memory}; "
                "record longer, leave out less, or choose fewer or smaller lags"
            )

    def check_channels(self, record: Record, outputs: Sequence[int] = (1,)) -> None:
        """Refuse a record of other channels.

        Args:
            record: a record.
            outputs: the allowed numbers of outputs.

        Raises:
            ModelError: for another number of outputs, or too few inputs.
        """
        if record.output.shape[1] not in outputs:
            raise ModelError(
                f"{self.name} has one output and {record.name} {record.output.shape[1]}; choose one of "
                f"{', '.join(record.output_names) or 'them'}"
            )
        if record.input.shape[1] < self.inputs:
            raise ModelError(f"{self.name} uses input u{self.inputs}; {record.name} has {record.input.shape[1]}")

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Every regressor as text."""
        return tuple(str(regressor) for regressor in self.regressors)

    def chunks(self, record: Record, size: int) -> Sequence[tuple[Record, int, int]]:
        """The samples with enough past, in pieces (segment, start, stop) of at most ``size``."""
        return [
            (segment, start, min(start + size, len(segment)))
            for segment in record.segments
            for start in range(self.memory, len(segment), size)
        ]

    def blocks(self, segment: Record, start: int, stop: int) -> Iterator[Array]:
        """[Φ y] of samples ``start`` to ``stop`` of a segment in blocks of columns (n + 1, ≤ `BLOCK`)."""
        for first in range(start, stop, BLOCK):
            count = min(BLOCK, stop - first)
            block = np.empty((len(self) + 1, count))
            fill(block, self.tables, *self.window(segment, first, first + count), self.memory, count)
            yield block

    def rounding(self, segment: Record, start: int, stop: int) -> Iterator[Array]:
        """The rounding errors of the products in `blocks`, (n, ≤ `BLOCK`) each; transforms count as exact."""
        for first in range(start, stop, BLOCK):
            count = min(BLOCK, stop - first)
            lost = np.empty((len(self), count))
            fill_rounding(lost, self.tables, *self.window(segment, first, first + count), self.memory)
            yield lost

    def add_rows(self, factor: Array, segment: Record, start: int, stop: int) -> None:
        """Update a factor (n + 1, n + 1) in place with [Φ y] of samples ``start`` to ``stop`` of a segment."""
        add_regression(factor, self.tables, *self.window(segment, start, stop), self.memory)

    def window(self, segment: Record, start: int, stop: int) -> tuple[Array, Array]:
        """y (m,) and u (nu, m) of these samples and of the past that they need, in the form that the kernels use."""
        seen = slice(start - self.memory, stop)
        return read_only(segment.output[seen, 0]), read_only(segment.input[seen].T)

    def model(self, parameters: Array, record: Record) -> RegressionModel:
        """The model with these parameters, at the sample time of this record."""
        return RegressionModel(self, parameters, record.dt)

    def regression(self, record: Record) -> tuple[Array, Array]:
        """Φ (N, n) and y (N,) of a whole record, for inspection."""
        self.check(record)
        stacked = np.hstack([b for chunk in self.chunks(record, len(record)) for b in self.blocks(*chunk)])
        return stacked[:-1].T, stacked[-1]


@dataclass(frozen=True, eq=False, repr=False)
class RegressionModel(RunMethods):
    """A model that is linear in its parameters.

    Args:
        structure: its regressors.
        parameters: (n,) their weights.
        dt: the sample time it was identified at, in seconds.
        start: samples of a segment from which the state at the start of a run is estimated, for a model whose noise is
            in its output (fitted to the free run); 0 if the last measured outputs are the state.
    """

    structure: Structure
    parameters: Array
    dt: float
    start: int = 0

    def __post_init__(self) -> None:
        values = np.array(self.parameters, dtype=float)
        if values.shape != (len(self.structure),):
            raise ModelError(f"{self.name}: {values.shape} parameters for {len(self.structure)} regressors")
        if not np.isfinite(values).all():
            raise ModelError(f"{self.name}: parameters must be finite")
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise ModelError(f"{self.name}: sample time {self.dt} s; it must be a positive number of seconds")
        values.flags.writeable = False
        object.__setattr__(self, "parameters", values)

    @property
    def name(self) -> str:
        """The name of its structure."""
        return self.structure.name

    @property
    def memory(self) -> int:
        """The number of samples of a segment that give its initial state, at least the largest lag."""
        return max(self.structure.memory, self.start)

    def equation(self) -> str:
        """The difference equation with numbers."""
        return self.structure.equation(self.parameters)

    @property
    def latency(self) -> int:
        """Zero: the model does not interpolate its input."""
        return 0

    def at_rest(self, level: ArrayLike = 0.0, dt: float | None = None) -> Array:
        """The steady state for a constant input, (memory, 1 + nu): output and inputs, the newest last.

        If the model is nonlinear in past outputs, it is the steady state of a free run from zero. A model without a
        steady state, such as an integrator, starts at an output of zero.
        """
        u = levels(self.name, level, self.structure.inputs)
        state = np.empty((self.structure.memory, 1 + len(u)))
        state[:, 1:] = u
        state[:, 0] = self._rest(u)
        return state

    def _rest(self, u: Array) -> float:
        """The output in steady state, or zero."""
        table = self._recursion
        coefficients = np.empty((2 + len(table.lags) + len(table.outputs.signs), 1))
        weigh(
            coefficients,
            read_only(np.repeat(u[:, None], self.structure.memory + 1, axis=1)),
            table,
            self.structure.memory,
            1,
        )
        free, linear = float(coefficients[0, 0]), coefficients[1 : 1 + len(table.lags), 0]
        if not len(table.outputs.signs):
            left = 1.0 - float(linear.sum())
            return free / left if abs(left) > SETTLED * (1.0 + float(np.abs(linear).sum())) else 0.0
        state = np.concatenate([np.zeros((self.structure.memory, 1)), np.tile(u, (self.structure.memory, 1))], axis=1)
        inputs = np.tile(u, (max(SETTLING_BLOCK, self.structure.memory + 1), 1))
        largest, before = 0.0, np.inf
        for _ in range(SETTLING // len(inputs)):
            with np.errstate(all="ignore"):
                outputs, state = self.run(state, inputs)
            end, moved = outputs[-self.structure.memory - 1 :, 0], float(np.ptp(outputs))
            largest = max(largest, float(np.max(np.abs(outputs))))
            if np.ptp(end) <= SETTLED * largest:
                return float(end[-1])
            if not moved < SETTLES * before:  # a cycle, or no number
                break
            before = moved
        return 0.0

    def initial(self, segment: Record, samples: int) -> Array:
        """The last outputs and inputs of these samples, (largest lag, 1 + nu); see ``start`` for estimated outputs."""
        lag, regressors, output = self.structure.memory, self.structure.regressors, segment.output[:samples, 0]
        if self.start and samples > lag:
            known = parts(regressors), self.parameters, lag, largest_output_lag(regressors)
            output = estimated_outputs(StartError(*known, read_only(output), read_only(segment.input[:samples].T)))
        here = slice(samples - lag, samples)
        return np.concatenate([output[here, None], segment.input[here]], axis=1)

    def run(self, state: Array, inputs: Array) -> tuple[Array, Array]:
        """The outputs (N, 1) for inputs (N, nu), and the state (memory, 1 + nu) after them."""
        memory, stop = self.structure.memory, self.structure.memory + len(inputs)
        y, u = np.empty(stop), np.empty((inputs.shape[1], stop))
        y[:memory], u[:, :memory], u[:, memory:] = state[:, 0], state[:, 1:].T, inputs.T
        reached = run_freely(y, read_only(u), self._recursion, memory)
        y[reached:] = np.nan
        after = np.concatenate([y[len(inputs) :, None], u[:, len(inputs) :].T], axis=1)
        return y[memory:, None], after

    def advance(self, state: Array, u: ArrayLike) -> tuple[Array, Array]:
        """The output (1,) for the input (nu,) of one sample, and the state after it."""
        outputs, state = self.run(state, levels(self.name, u, self.structure.inputs)[None, :])
        return outputs[0], state

    def ahead(self, segment: Record, samples: int, horizon: int) -> Array:
        """ŷ(t | t − horizon): simulated from measured outputs up to ``horizon`` samples before."""
        measured, start = segment.output[:, 0], samples
        values = np.empty(len(segment))
        if horizon == 1:
            for block in self.structure.blocks(segment, start, len(segment)):
                np.dot(self.parameters, block[:-1], out=values[start : start + block.shape[1]])
                start += block.shape[1]
        else:
            u = read_only(segment.input.T)
            predict_ahead(values, read_only(measured), u, self._recursion, self.structure.memory, samples, horizon)
        return values[samples:, None]

    def to_control(self) -> Any:
        """The terms that are linear in past outputs and inputs, as a python-control transfer function.

        For ARX these are all terms, B(q)/A(q) from every input; other terms of a nonlinear structure are left out.

        Raises:
            ModelError: if python-control is not installed, or the model has no linear term in an input.
        """
        control = python_control()
        below, above = self.linear_part()
        if not above.any():
            raise ModelError(f"{self.name} has no term that is linear in an input")
        return control.TransferFunction([[np.trim_zeros(b, "f") for b in above]], [[below] * len(above)], self.dt)

    @property
    def is_linear(self) -> bool:
        """Whether all regressors are past outputs, past inputs or a constant."""
        return all(regressor.is_linear or not regressor.factors for regressor in self.structure.regressors)

    def parameter_values(self) -> dict[str, float]:
        """The value of every parameter by its name in the structure."""
        return dict(zip(self.structure.parameter_names, self.parameters.tolist(), strict=True))

    def with_estimates(self, names: Sequence[str], values: Array) -> RegressionModel:
        """The same model with other parameters (n,), by name."""
        parameters = self.parameters.copy()
        parameters[[self.structure.parameter_names.index(name) for name in names]] = values
        return replace(self, parameters=parameters)

    def linear_part(self) -> tuple[Array, Array]:
        """A (memory + 1,) and B (nu, memory + 1) in powers of q⁻¹, of the terms linear in one past output or input."""
        rows = np.zeros((1 + self.structure.inputs, self.structure.memory + 1))
        for regressor, value in zip(self.structure.regressors, self.parameters, strict=True):
            if regressor.is_linear:
                only = regressor.factors[0]
                rows[only.channel, only.lag] += -value if regressor.negative else value
        below = -rows[0]
        below[0] = 1.0
        return below, rows[1:]

    def to_data(self) -> dict[str, Any]:
        """Regressors as text, parameters, sample time."""
        structure = self.structure
        return {
            "name": structure.name,
            "regressors": list(structure.labels),
            "parameter_names": list(structure.parameter_names),
            "parameters": [float(value) for value in self.parameters],
            "inputs": structure.inputs,
            "dt": self.dt,
        } | ({"start": self.start} if self.start else {})

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> RegressionModel:
        """The model described by `to_data`.

        Raises:
            ModelError: for data that do not describe a model.
        """
        try:
            stored = msgspec.convert(data, _Stored)
        except msgspec.ValidationError as problem:
            raise ModelError(f"not a regression model: {problem}") from None
        structure = Structure(
            tuple(parse_regressor(text) for text in stored.regressors),
            stored.name,
            tuple(stored.parameter_names),
            stored.inputs,
        )
        if structure.inputs != stored.inputs:  # 0 means "as many as are used" for a structure
            raise ModelError(
                f"{stored.name}: {stored.inputs} inputs, and its regressors use {structure.inputs}; identify it again"
            )
        return cls(structure, np.array(stored.parameters), stored.dt, stored.start)

    def check_record(self, record: Record) -> None:
        """Refuse a record of other channels; its output may be missing.

        Raises:
            ModelError: with the difference.
        """
        self.structure.check_channels(record, outputs=(0, 1))

    @cached_property
    def _recursion(self) -> Recursion:
        return recursion(self.structure.regressors, self.parameters)


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    regressors: list[str]
    parameter_names: list[str]
    parameters: list[float]
    inputs: int
    dt: float
    start: int = 0


Narx = RegressionModel
"""The name of this class inside the package."""


# Steps of the search; one is enough for a model that is linear in past outputs.
ITERATIONS = 10


class StartError:
    """Residuals ŷ − y over the samples before the start as functions of the first outputs; see `Problem`.

    Args:
        regressors: of the structure.
        theta: (p,) their parameters.
        memory: the largest lag of a channel.
        depth: the largest lag of the output, the number of outputs that are estimated.
        y: (N,) measured outputs.
        u: (nu, N) inputs.
    """

    def __init__(self, regressors: Parts, theta: Array, memory: int, depth: int, y: Array, u: Array) -> None:
        self.regressors, self.theta, self.memory, self.depth = regressors, theta, memory, depth
        self.y, self.u = y, u

    def residuals(self, first: Array) -> list[Array]:
        """(N − memory + depth,) ŷ − y."""
        return [self.run(first, np.empty((0, 0)))[self.memory - self.depth :] - self.y[self.memory - self.depth :]]

    def linearised(self, first: Array) -> list[Block]:
        """The residuals and their derivative (N − memory + depth, depth)."""
        count, begin = len(self.theta), self.memory - self.depth
        derivative = np.zeros((count + self.depth, len(self.y)))
        derivative[count:, begin : self.memory] = np.eye(self.depth)
        residual = self.run(first, derivative)[begin:] - self.y[begin:]
        return [(residual, derivative[count:, begin:].T)]

    def run(self, first: Array, derivative: Array) -> Array:
        """(N,) the model's outputs, from these first outputs on; before them, the measured ones."""
        y = self.y.copy()
        y[self.memory - self.depth : self.memory] = first
        memory = self.memory
        if run_with_derivative(y, derivative, self.u, self.regressors, self.theta, memory, memory, 1.0) < len(y):
            raise Infeasible("the free run over the start diverges")
        return y


def estimated_outputs(problem: StartError) -> Array:
    """(N,) the outputs over the samples before the start of a free run, the first ones estimated.

    A regression starts from as many past outputs as its largest lag. Measured ones carry noise. Where the sample time
    is short, the difference of two of them says little of the slope, and the error takes the longest time constant to
    decay. For a model whose noise is in its output, the first outputs ŷ₀ minimise Σ (y − ŷ)² over these samples.
    Where no run over these samples is finite, they are the measured outputs.
    """
    begin, memory = problem.memory - problem.depth, problem.memory
    try:
        found, _ = few_unknowns(problem, problem.y[begin:memory], max_iterations=ITERATIONS, tolerance=0.01)
    except ModelError:
        return problem.y
    return problem.run(found, np.empty((0, 0)))
