"""`Narx`: a structure with its parameters, run one step, several steps or freely.

The free run puts the model's own past outputs where the regressors ask for measured ones. What depends on inputs only
is computed beforehand, block by block; only regressors that contain y need the loop from sample to sample.
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
from emsid.models.model import RUNAWAY, Run
from emsid.models.regressors import (
    Factor,
    Integers,
    Structure,
    Transform,
    fill,
    parse_regressor,
    tables,
    transformed,
)
from emsid.record import Record

Array = NDArray[np.float64]


class Feedback(NamedTuple):
    """The regressors that contain y, as the kernels read them."""

    linear: Array  # (memory,) weights of y(t−1), y(t−2), …
    weights: Array  # of all others, with `regressors.Tables` for what they are
    offsets: Integers
    factors: Integers
    parameters: Array


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
            return int(free_run(run, segment.input, self._exogenous(segment, start), self._feedback, start, bound))

        return self._run(record, transient, advance)

    def predict(self, record: Record, horizon: int = 1, transient: int | None = None) -> Run:
        """ŷ(t | t − horizon): simulated from measured outputs up to ``horizon`` samples before."""
        if horizon < 1:
            raise ModelError(f"{self.name}: a horizon of {horizon}; predictions look at least one sample ahead")

        def advance(run: Array, segment: Record, start: int) -> int:
            if horizon == 1:
                self._weigh(self.structure, self.parameters, segment, start, run[start:])
            else:
                exogenous = self._exogenous(segment, self.memory)
                measured = segment.output[:, 0]
                predict_ahead(run, measured, segment.input, exogenous, self._feedback, self.memory, start, horizon)
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
        """The model that `to_data` described."""
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
        return cls(structure, np.array(stored.parameters), stored.dt)

    def _run(self, record: Record, transient: int | None, advance: Callable[[Array, Record, int], int]) -> Run:
        """Let ``advance`` overwrite every segment from its start on, up to the sample that it returns."""
        self.check(record)
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
        """Refuse a record of other channels or another sample time."""
        self.structure.check(record)
        if not np.isclose(self.dt, record.dt, rtol=1e-3, atol=0.0):
            raise ModelError(
                f"{self.name} was identified at {self.dt:g} s and {record.name} is sampled every {record.dt:g} s; "
                "resample the record"
            )

    @cached_property
    def _feedback(self) -> Feedback:
        """The regressors that contain y."""
        linear, others, weights = np.zeros(self.memory), [], []
        for regressor, parameter in zip(self.structure.regressors, self.parameters, strict=True):
            weight = -parameter if regressor.negative else parameter
            match regressor.factors:
                case (Factor(0, lag, 1, Transform.VALUE),):
                    linear[lag - 1] += weight
                case _ if regressor.uses_output:
                    others.append(regressor)
                    weights.append(weight)
        _, offsets, factors, parameters = tables(others)
        return Feedback(linear, np.array(weights, dtype=float), offsets, factors, parameters)

    @cached_property
    def _outside(self) -> tuple[Structure, Array] | None:
        """The regressors that contain inputs only, with their parameters."""
        chosen = [k for k, regressor in enumerate(self.structure.regressors) if not regressor.uses_output]
        if not chosen:
            return None
        regressors = tuple(self.structure.regressors[k] for k in chosen)
        return Structure(regressors, inputs=self.structure.inputs), self.parameters[chosen]

    def _exogenous(self, segment: Record, start: int) -> Array:
        """The part of φᵀ(t)θ that contains inputs only, for every sample from ``start`` on."""
        total = np.zeros(len(segment) - start)
        if self._outside is not None:
            self._weigh(*self._outside, segment, start, total)
        return total

    @staticmethod
    def _weigh(structure: Structure, parameters: Array, segment: Record, start: int, result: Array) -> None:
        """Write φᵀ(t)θ with measured outputs, for every sample from ``start`` on, into ``result``."""
        done = 0
        for block in structure.blocks(segment, start, len(segment)):
            np.dot(parameters, block[:-1], out=result[done : done + block.shape[1]])
            done += block.shape[1]


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
        fill(row, *model.structure.tables, y, record.input, t)
        y[t] = row[:-1, 0] @ model.parameters
    return y


@numba.njit(cache=True, nogil=True)
def free_run(y: Array, u: Array, exogenous: Array, feedback: Feedback, start: int, bound: float) -> int:
    """Overwrite y from ``start`` on by the model's own output; ``exogenous[t − start]`` is the rest of φᵀ(t)θ.

    Returns the first sample that is not within ±``bound``, where the run ends, or the number of samples.
    """
    linear, weights, offsets, factors, parameters = feedback
    for t in range(start, len(y)):
        total = exogenous[t - start]
        for j in range(len(weights)):
            product = weights[j]
            for f in range(offsets[j], offsets[j + 1]):
                channel, lag = factors[f, 0], factors[f, 1]
                power, code = factors[f, 2], factors[f, 3]
                x = y[t - lag] if channel == 0 else u[t - lag, channel - 1]
                value = x if code == 0 else transformed(code, x, parameters[f])
                for _ in range(power):
                    product *= value
            total += product
        for k in range(len(linear), 0, -1):  # the newest last: only it has to be waited for
            total += linear[k - 1] * y[t - k]
        y[t] = total
        if not abs(total) <= bound:
            return t
    return len(y)


@numba.njit(cache=True, nogil=True)
def predict_ahead(
    result: Array,
    y: Array,
    u: Array,
    exogenous: Array,
    feedback: Feedback,
    memory: int,
    start: int,
    horizon: int,
) -> None:
    """ŷ(t | t − horizon) for every t from ``start`` on: a free run of ``horizon`` steps begun anew for each."""
    window = np.empty(memory + horizon)
    for t in range(start, len(y)):
        first = max(t - horizon + 1, memory)
        length = memory + t - first + 1
        window[:memory] = y[first - memory : first]
        free_run(window[:length], u[first - memory : t + 1], exogenous[first - memory :], feedback, memory, np.inf)
        result[t] = window[length - 1]
