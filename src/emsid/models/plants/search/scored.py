"""The score of parameters of a plant at a fit of it: the derivative of its free run by them, and what they promise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.plant import Plant
from emsid.models.search.score import Score

Array = NDArray[np.float64]


def by_channel(problem: FreeRunError, rows: Array) -> list[Array]:
    """The rows of a segment, channel by channel."""
    return np.split(rows, len(problem.signals))


def score_at(
    problem: FreeRunError,
    free: NDArray[np.bool_] | None = None,
    beside: Sequence[tuple[list[Array], Array, Array]] = (),
) -> Score:
    """The score at the start of a problem.

    Args:
        problem: begun where a search ended.
        free: (p,) whether each parameter is not held by a bound; None: all of them.
        beside: columns of further parameters with bounds of their change, which count as present and are taken at
            their best.
    """
    blocks = problem.linearised(problem.start)
    residuals = [part for residual, _ in blocks for part in by_channel(problem, residual)]
    jacobians = [
        part
        for _, jacobian in blocks
        for part in by_channel(problem, jacobian if free is None else jacobian[:, np.flatnonzero(free)])
    ]
    channels = [k % len(problem.signals) for k in range(len(residuals))]
    for columns, lower, upper in beside:
        promise = Score(residuals, jacobians, channels).promise(columns, lower, upper, least=1.0)
        residuals = [each + column @ promise.step for each, column in zip(residuals, columns, strict=True)]
        jacobians = [np.column_stack(each) for each in zip(jacobians, columns, strict=True)]
    return Score(residuals, jacobians, channels)


def effect_of(
    problem: FreeRunError, plant: Plant, names: Sequence[str], probe: Mapping[str, float] | None = None
) -> list[Array]:
    """(Nᵢ, k) the derivative of the residual by some parameters, of every segment and channel.

    Args:
        problem: that is fitted; it gives segments, initial states and weighting.
        plant: with the values at which the derivative is taken.
        names: of the parameters.
        probe: the value of one parameter to which a difference is taken, of a plant that moves as that of the problem
            without it; none for the derivative itself.

    Raises:
        EmsidError: where the plant cannot be simulated with them.
    """
    states = problem.states(problem.start)
    fixed: list[tuple[int, ...]] = [() for _ in states]

    def run(plant: Plant, free: Sequence[str]) -> FreeRunError:
        return FreeRunError(
            plant, problem.signals, problem.segments, free, states, fixed, problem.weighting, problem.threads
        )

    if not probe:
        other = run(plant, names)
        return [part for _, jacobian in other.linearised(other.start) for part in by_channel(problem, jacobian)]
    ((name, value),) = probe.items()
    there, way = run(plant.with_values(probe), ()), value - plant.value(name)
    both = zip(problem.residuals(problem.start), there.residuals(there.start), strict=True)
    return [part for a, b in both for part in by_channel(problem, ((b - a) / way)[:, None])]


def bounds_of(plant: Plant, names: Sequence[str]) -> tuple[Array, Array]:
    """(k,) the physical bounds of the change of some parameters."""
    ends = [(plant.handles[name].lower, plant.handles[name].upper) for name in names]
    low, high = np.array(ends).T - np.array([plant.value(name) for name in names])
    return low, high
