"""Recursive estimation by single samples from Python, in a few microseconds each.

`RecursiveLeastSquares.update` takes records, which are made for many samples at once. `SampleBySample` keeps the state
in arrays that one compiled call changes in place. Both give the same numbers, and each continues from the other's
state.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.estimation.linear.recursive import RecursiveLeastSquares, RecursiveState
from emsid.estimation.linear.recursive_kernels import update
from emsid.models.regression.kernels import fill
from emsid.models.regression.narx import Narx
from emsid.models.regression.regressors import Integers, Tables
from emsid.record import Record

Array = NDArray[np.float64]


class SampleBySample:
    """A recursion that is given one sample after the other.

    >>> import emsid
    >>> online = emsid.SampleBySample(emsid.RecursiveLeastSquares(emsid.arx(na=1, nb=1), forgetting=0.99), dt=0.1)
    >>> predictions = [online.add(u, y) for u, y in ((1.0, 0.0), (0.0, 0.5), (2.0, 0.4), (1.0, 1.32))]
    >>> online.estimate.round(3), round(predictions[-1], 2)
    (array([-0.8,  0.5]), 1.32)

    Args:
        recursion: of a `Structure`.
        dt: sample time in s.
        state: where to begin; by default before the first sample.
    """

    def __init__(self, recursion: RecursiveLeastSquares[Narx], dt: float, state: RecursiveState | None = None) -> None:
        structure: Any = recursion.structure
        state = recursion.start() if state is None else state
        self._recursion, self._dt, self._like = recursion, dt, state.tail
        n, memory = len(structure), structure.memory
        self._rule, self._limits = recursion.adaptation.numbers(n), recursion.limits(state)
        self._window = np.array(state.window)
        self._tables: Tables = structure.tables
        # θ, D, Uᵀ, totals, the number of past samples, and the last samples of y and of every input
        self._sizes = np.cumsum([0, n, n, n * n, 7 + n, 1, memory + 1, structure.inputs * (memory + 1)])
        self._flat = np.zeros(self._sizes[-1])
        for k, part in enumerate((state.estimate, state.diagonal, state.factor.ravel(), state.totals)):
            self._part(k)[:] = part
        if state.tail is not None:
            past = state.tail[-memory:] if memory else None
            for u, y in () if past is None else zip(past.input, past.output[:, 0], strict=True):
                self._shift(u[: structure.inputs], float(y))
        self._u = np.zeros(structure.inputs)

    def add(self, u: ArrayLike, y: float) -> float:
        """Take one sample.

        Args:
            u: the input, or (nu,) the inputs.
            y: the output.

        Returns:
            Its prediction by the estimate before it; NaN while there are too few past samples.
        """
        self._u[:] = u
        signs, offsets, factors, parameters = self._tables
        return float(
            take(
                self._flat,
                self._window,
                signs,
                offsets,
                factors,
                parameters,
                self._rule,
                self._limits,
                self._u,
                y,
            )
        )

    def cut(self) -> None:
        """Forget the past samples, not the estimate: the next sample comes after a gap."""
        self._part(4)[0] = 0.0

    @property
    def estimate(self) -> Array:
        """(n,) the present estimate."""
        return self._part(0).copy()

    @property
    def state(self) -> RecursiveState:
        """The present state, as `RecursiveLeastSquares` takes it."""
        n, memory = len(self._part(0)), len(self._part(5)) - 1
        kept = min(int(self._part(4)[0]), memory)
        tail = None
        if kept:
            u = self._part(6).reshape(-1, memory + 1)[:, -kept:].T
            y = self._part(5)[-kept:]
            tail = Record(u, y, self._dt) if self._like is None else replace(self._like, input=u, output=y, times=())
        begun = replace(self._recursion.start(), tail=tail)
        arrays = (self._part(0).copy(), self._part(2).reshape(n, n).copy(), self._part(1).copy())
        return begun.after(*arrays, self._part(3), self._window.copy())

    def _part(self, k: int) -> Array:
        part: Array = self._flat[self._sizes[k] : self._sizes[k + 1]]
        return part

    def _shift(self, u: Array, y: float) -> None:
        past_y, past_u = self._part(5), self._part(6).reshape(len(u), -1)
        past_y[:-1], past_u[:, :-1] = past_y[1:].copy(), past_u[:, 1:].copy()
        past_y[-1], past_u[:, -1] = y, u
        self._part(4)[0] += 1.0


@njit(nogil=True)
def take(
    flat: Array,
    window: Array,
    signs: Array,
    offsets: Integers,
    factors: Integers,
    parameters: Array,
    rule: Array,
    limits: Array,
    u: Array,
    y: float,
) -> float:
    """Update the arrays of `SampleBySample` with one sample; returns its prediction."""
    n, inputs = len(signs), len(u)
    begun = 2 * n + n * n
    ends = begun + 7 + n
    memory = (len(flat) - ends - 1) // (1 + inputs) - 1
    totals, count = flat[begun:ends], flat[ends : ends + 1]
    past_y = flat[ends + 1 : ends + 2 + memory]
    past_u = flat[ends + 2 + memory :].reshape(inputs, memory + 1)
    for i in range(memory):
        past_y[i] = past_y[i + 1]
        for k in range(inputs):
            past_u[k, i] = past_u[k, i + 1]
    past_y[memory] = y
    for k in range(inputs):
        past_u[k, memory] = u[k]
    count[0] += 1.0
    if count[0] <= memory:
        return np.nan
    block, residuals = np.empty((n + 1, 1)), np.empty((1, 3))
    fill(block, Tables(signs, offsets, factors, parameters), past_y, past_u, memory, 1)
    factor = flat[2 * n : begun].reshape(n, n)
    update(flat[:n], factor, flat[n : 2 * n], totals, window, block, rule, limits, np.empty((0, n)), residuals)
    return float(y - residuals[0, 0])
