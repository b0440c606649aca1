r"""The free run of a structure together with its derivative with respect to the parameters, compiled.

A free run ŷ(t) = Σⱼ θⱼ φⱼ(t; x) uses its own past, x = ŷ, so its derivative obeys a recursion of its own::

    ∂ŷ(t)/∂θⱼ = φⱼ(t) + Σₗ gₗ(t) ∂x(t − l)/∂θⱼ        gₗ(t) = Σᵢ θᵢ ∂φᵢ(t)/∂x(t − l)

The kernel also runs between prediction and simulation, with the past x = y + s·(ŷ − y), where y is measured. With a
share s = 0 it is the one-step prediction, which is linear in θ, and with s = 1 the free run. A search that goes from
one to the other has a start even where the free run of the first estimate diverges.

References:
    Ljung, *System Identification*, 2nd ed., sec. 10.3 (derivatives of output-error models). Farina, Piroddi,
    *Simulation error minimization identification based on multi-stage prediction*, IJACSP 25 (2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.estimation.linear.information import TILE
from emsid.models.regression.kernels import multiply
from emsid.models.regression.regressors import Integers, Regressor, Tables, tables
from emsid.models.regression.transforms import slope, transformed

Array = NDArray[np.float64]


class Parts(NamedTuple):
    """Every regressor as the product of its part in the inputs, which has its sign, and its part ψ in the outputs."""

    inputs: Tables
    outputs: Tables  # every ψ once
    places: Integers  # (p,) the ψ of each regressor


def parts(regressors: Sequence[Regressor]) -> Parts:
    """The regressors of a structure in the form that `run_with_derivative` uses."""
    of_outputs = [tuple(f for f in r.factors if not f.channel) for r in regressors]
    different = list(dict.fromkeys(of_outputs))
    return Parts(
        tables([Regressor(tuple(f for f in r.factors if f.channel), r.negative) for r in regressors]),
        tables([Regressor(part) for part in different]),
        np.array([different.index(part) for part in of_outputs], dtype=np.int64),
    )


@njit(nogil=True)
def run_with_derivative(
    y: Array, derivative: Array, u: Array, regressors: Parts, theta: Array, memory: int, start: int, share: float
) -> int:
    """Overwrite y (N,) from ``start`` on with the free run, and ``derivative`` (n, N) with its derivative.

    Args:
        y: measured; its samples before ``start`` give the initial state.
        derivative: zero before ``start``, except in rows after the first p: these are derivatives with respect to the
            initial outputs, and have what they are before ``start``.
        u: (nu, N).
        regressors: of the structure.
        theta: (p,) parameters of all regressors. The derivative has n ≥ p rows; with no rows, only the run is computed.
        memory: the largest lag.
        start: at least ``memory``.
        share: s of the past x = y + s·(ŷ − y).

    Returns:
        The first sample that is not finite, where the run ends, or the number of samples.
    """
    count, rows, turns = len(theta), len(derivative), memory + 1
    _, offsets, factors, parameters = regressors.outputs  # no tuple and no view in a loop: each would count references
    places, products = regressors.places, len(offsets) - 1
    past = y.copy()
    product, block = np.empty((TILE, count)), np.empty((TILE, rows))
    weight, psi, gain = np.empty((TILE, products)), np.empty(products), np.empty(turns)
    recent = np.zeros((turns, rows))  # derivatives of the last outputs, in turn
    if rows:
        for t in range(start - memory, start):
            recent[t % turns] = derivative[:, t]
    for first in range(start, len(y), TILE):
        height = min(TILE, len(y) - first)
        _input_parts(product, weight, u, regressors, theta, first, height)
        for i in range(height):
            t = first + i
            total = 0.0
            for k in range(products):
                value = 1.0
                for f in range(offsets[k], offsets[k + 1]):
                    value *= _power(past[t - factors[f, 1]], factors[f, 2], factors[f, 3], parameters[f])
                psi[k] = value
                total += weight[i, k] * value
            if not np.isfinite(total):
                return t
            if rows:
                _output_gains(gain, weight, i, past, t, offsets, factors, parameters)
            past[t] += share * (total - past[t])
            y[t] = total
            if rows:
                newest = t % turns
                for j in range(count):
                    recent[newest, j] = product[i, j] * psi[places[j]]
                for j in range(count, rows):
                    recent[newest, j] = 0.0
                for lag in range(1, turns):
                    if gain[lag] != 0.0:
                        by, older = share * gain[lag], (t - lag) % turns
                        for j in range(rows):
                            recent[newest, j] += by * recent[older, j]
                for j in range(rows):
                    block[i, j] = recent[newest, j]
        for j in range(rows):
            for i in range(height):
                derivative[j, first + i] = block[i, j]
    return len(y)


@njit(nogil=True)
def _input_parts(
    product: Array, weight: Array, u: Array, regressors: Parts, theta: Array, first: int, height: int
) -> None:
    """Write the input part of every regressor, and the weight Σ θⱼ·(input part) of every ψ, for some samples."""
    signs, offsets, factors, parameters = regressors.inputs
    row = np.empty(height)
    weight[:] = 0.0
    for j in range(len(theta)):
        row[:] = signs[j]
        for f in range(offsets[j], offsets[j + 1]):
            channel, lag, power, code = factors[f]
            multiply(row, u[channel - 1, first - lag : first - lag + height], code, parameters[f], power)
        place = regressors.places[j]
        for i in range(height):
            product[i, j] = row[i]
            weight[i, place] += theta[j] * row[i]


@njit(nogil=True, inline="always")
def _output_gains(
    gain: Array, weight: Array, i: int, past: Array, t: int, offsets: Integers, factors: Integers, parameters: Array
) -> None:
    """Write the gains gₗ(t) = ∂(Σ weightₖψₖ)/∂x(t − l), with the weights of row i."""
    for lag in range(len(gain)):
        gain[lag] = 0.0
    for k in range(len(offsets) - 1):
        if weight[i, k] == 0.0:
            continue
        for f in range(offsets[k], offsets[k + 1]):
            power, code, x = factors[f, 2], factors[f, 3], past[t - factors[f, 1]]
            inner = power * slope(code, x, parameters[f])
            if power > 1:
                inner *= _power(x, power - 1, code, parameters[f])
            for other in range(offsets[k], offsets[k + 1]):
                if other != f:
                    inner *= _power(
                        past[t - factors[other, 1]], factors[other, 2], factors[other, 3], parameters[other]
                    )
            gain[factors[f, 1]] += weight[i, k] * inner


@njit(nogil=True, inline="always")
def _power(x: float, power: int, code: int, parameter: float) -> float:
    """A power of a transform of x."""
    base = transformed(code, x, parameter)
    value = base
    for _ in range(power - 1):
        value *= base
    return value


def largest_output_lag(regressors: Sequence[Regressor]) -> int:
    """The number of past outputs that a run starts from."""
    return max((f.lag for r in regressors for f in r.factors if f.channel == 0), default=0)
