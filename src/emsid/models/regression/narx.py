"""`Narx`: a structure with its parameters, run one step, several steps or freely.

The free run puts the model's own past outputs where the regressors ask for measured ones. Every regressor is a product
of lagged inputs times one of lagged outputs, so with the regressors gathered by the latter::

    y(t) = c₀(t) + Σₖ cₖ(t) ψₖ(y(t − 1), y(t − 2), …)        cₖ(t) = Σ of θᵢ · (products of inputs)

the coefficients cₖ are computed for many samples at once, and only the sum is left to the loop from sample to sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import msgspec
import numba
import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import TILE, add_multiple
from emsid.models.model import RUNAWAY, Run, check_samples
from emsid.models.regression.kernels import fill, multiply, transformed
from emsid.models.regression.regressors import Factor, Integers, Regressor, Tables, parse_regressor, tables
from emsid.models.regression.structures import Structure
from emsid.record import Record

Array = NDArray[np.float64]


class Recursion(NamedTuple):
    """A model as the kernels read it."""

    weights: Array  # (n,) θ with the signs of the regressors
    coefficients: Integers  # (n,) k of the cₖ that each belongs to
    inputs: Tables  # the input part of each regressor
    lags: Integers  # (p,) ψ₁ … ψₚ are y(t − lag), the newest last: only it has to be waited for
    outputs: Tables  # ψₚ₊₁ …, products of outputs


@dataclass(frozen=True, eq=False)
class Narx:
    """A model that is linear in its parameters.

    Args:
        structure: its regressors.
        parameters: (n,) their weights.
        dt: the sample time it was identified at, in seconds.
    """

    structure: Structure
    parameters: Array
    dt: float

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
        """The largest lag."""
        return self.structure.memory

    def equation(self) -> str:
        """The difference equation with numbers."""
        return self.structure.equation(self.parameters)

    def simulate(self, record: Record, transient: int | None = None) -> Run:
        """Free run over every segment, started by its first ``transient`` measured samples (at least the memory)."""
        # Where nothing was measured, as in a run over an input alone, only an overflow tells a divergence.
        bound = RUNAWAY * float(np.max(np.abs(record.output))) or np.finfo(float).max

        def advance(run: Array, segment: Record, start: int) -> int:
            return int(free_run(run, _channels(segment), self._recursion, start, bound))

        return self._run(record, transient, advance)

    def predict(self, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
        """ŷ(t | t − horizon): simulated from measured outputs up to ``horizon`` samples before."""
        check_samples(self.name, "a horizon", horizon, 1)

        def advance(run: Array, segment: Record, start: int) -> int:
            if horizon == 1:
                for block in self.structure.blocks(segment, start, len(segment)):
                    np.dot(self.parameters, block[:-1], out=run[start : start + block.shape[1]])
                    start += block.shape[1]
            else:
                measured = segment.output[:, 0]
                predict_ahead(run, measured, _channels(segment), self._recursion, self.memory, start, horizon)
            return len(segment)

        return self._run(record, transient, advance)

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
        }

    @classmethod
    def from_data(cls, data: dict[str, Any]) -> Narx:
        """The model that `to_data` described.

        Raises:
            ModelError: for data that describe none.
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
        if structure.inputs != stored.inputs:  # 0, which a structure alone takes for "as many as are used"
            raise ModelError(
                f"{stored.name}: {stored.inputs} inputs, and its regressors use {structure.inputs}; identify it again"
            )
        return cls(structure, np.array(stored.parameters), stored.dt)

    def _run(self, record: Record, transient: int | None, advance: Callable[[Array, Record, int], int]) -> Run:
        """Let ``advance`` overwrite every segment from its start on, up to the sample that it returns."""
        self.check(record)
        check_samples(self.name, "a transient", transient, 0)
        start = max(self.memory, transient or 0)
        output, counted = record.output.copy(), np.zeros(len(record), dtype=bool)
        diverged_at, offset = None, 0
        for segment in record.segments:
            stop = offset + len(segment)
            if len(segment) > start:
                reached = offset + advance(output[offset:stop, 0], segment, start)
                if reached < stop:
                    output[reached:stop] = np.nan
                    diverged_at = reached if diverged_at is None else diverged_at
                counted[offset + start : stop] = True
            offset = stop
        return Run(output, counted, diverged_at)

    def check(self, record: Record) -> None:
        """Refuse a record of other channels or another sample time.

        Raises:
            ModelError: saying what is different.
        """
        self.structure.check(record)
        if not np.isclose(self.dt, record.dt, rtol=1e-3, atol=0.0):
            raise ModelError(
                f"{self.name} was identified at {self.dt:g} s and {record.name} is sampled every {record.dt:g} s; "
                "resample the record"
            )

    @cached_property
    def _recursion(self) -> Recursion:
        regressors = self.structure.regressors
        parts = [tuple(f for f in regressor.factors if f.channel == 0) for regressor in regressors]
        plain = sorted({p for p in parts if p and p == (Factor(0, p[0].lag),)}, key=lambda p: -p[0].lag)
        others = sorted({p for p in parts if p}.difference(plain))
        place = {part: k for k, part in enumerate([(), *plain, *others])}
        return Recursion(
            np.where([regressor.negative for regressor in regressors], -self.parameters, self.parameters),
            np.array([place[part] for part in parts]),
            tables([Regressor(tuple(f for f in regressor.factors if f.channel)) for regressor in regressors]),
            np.array([part[0].lag for part in plain], dtype=np.int64),
            tables([Regressor(part) for part in others]),
        )


def _channels(segment: Record) -> Array:
    """u (nu, N), each channel in one piece."""
    return np.ascontiguousarray(segment.input.T)


class _Stored(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    regressors: list[str]
    parameter_names: list[str]
    parameters: list[float]
    inputs: int
    dt: float


def free_run_reference(model: Narx, record: Record, start: int) -> Array:
    """The free run by the definition, one regression row at a time: slow, obvious, compared with `free_run`."""
    y = record.output[:, 0].copy()
    for t in range(start, len(record)):
        row = np.empty((len(model.structure) + 1, 1))
        fill(row, model.structure.tables, y, record.input.T, t, 1)
        y[t] = row[:-1, 0] @ model.parameters
    return y


@numba.njit(cache=True, nogil=True)
def free_run(y: Array, u: Array, recursion: Recursion, start: int, bound: float) -> int:
    """Overwrite y (N,) from ``start`` on by the model's own output, driven by u (nu, N).

    Returns the first sample that is not within ±``bound``, where the run ends, or the number of samples.
    """
    coefficient = _room(recursion, TILE)
    for first in range(start, len(y), TILE):
        count = min(TILE, len(y) - first)
        _weigh(coefficient, u, recursion, first, count)
        reached = _advance(y, coefficient, recursion, first, 0, count, bound)
        if reached < first + count:
            return reached
    return len(y)


@numba.njit(cache=True, nogil=True)
def predict_ahead(
    result: Array, y: Array, u: Array, recursion: Recursion, memory: int, start: int, horizon: int
) -> None:
    """ŷ(t | t − horizon) for every t from ``start`` on: a free run of ``horizon`` steps begun anew for each."""
    window = np.empty(memory + horizon)
    coefficient = _room(recursion, TILE + horizon)
    for first in range(start, len(y), TILE):
        begin, end = max(first - horizon + 1, memory), min(first + TILE, len(y))
        _weigh(coefficient, u, recursion, begin, end - begin)
        for t in range(first, end):
            origin = max(t - horizon + 1, memory)
            for i in range(memory):
                window[i] = y[origin - memory + i]
            _advance(window, coefficient, recursion, memory, origin - begin, t - origin + 1, np.inf)
            result[t] = window[memory + t - origin]


@numba.njit(cache=True, nogil=True)
def _room(recursion: Recursion, samples: int) -> Array:
    """For c₀, c₁, … at so many samples, and one row to work in."""
    return np.empty((1 + len(recursion.lags) + len(recursion.outputs.signs) + 1, samples))


@numba.njit(cache=True, nogil=True)
def _weigh(coefficient: Array, u: Array, recursion: Recursion, start: int, count: int) -> None:
    """Write the cₖ of samples ``start`` … into the first columns of ``coefficient``."""
    _, offsets, factors, parameters = recursion.inputs
    coefficient[:, :count] = 0.0
    product = coefficient[-1, :count]
    for j in range(len(recursion.weights)):
        product[:] = recursion.weights[j]
        for f in range(offsets[j], offsets[j + 1]):
            channel, lag, power, code = factors[f]
            multiply(product, u[channel - 1, start - lag : start - lag + count], code, parameters[f], power)
        add_multiple(coefficient[recursion.coefficients[j]], 1.0, product, count)


@numba.njit(cache=True, nogil=True)
def _advance(
    y: Array, coefficient: Array, recursion: Recursion, start: int, column: int, count: int, bound: float
) -> int:
    """Overwrite ``count`` samples of y from ``start`` on; their cₖ begin at ``column``.

    Returns the sample after the last, or the first that is not within ±``bound``.
    """
    lags = recursion.lags
    _, offsets, factors, parameters = recursion.outputs
    for i in range(count):
        t = start + i
        total = coefficient[0, column + i]
        for k in range(len(offsets) - 1):
            product = coefficient[1 + len(lags) + k, column + i]
            for f in range(offsets[k], offsets[k + 1]):
                _, lag, power, code = factors[f]
                value = transformed(code, y[t - lag], parameters[f])
                for _ in range(power):
                    product *= value
            total += product
        for k in range(len(lags)):
            total += coefficient[1 + k, column + i] * y[t - lags[k]]
        y[t] = total
        if not abs(total) <= bound:
            return t
    return start + count
