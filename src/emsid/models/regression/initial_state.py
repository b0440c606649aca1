"""The state at the start of a free run, estimated from several measured outputs.

A regression starts from as many past outputs as its largest lag. Measured ones carry noise. Where the sample time is
short, the difference of two of them says little of the slope, and the error takes the longest time constant to decay.
For a model whose noise is in its output, the first outputs ŷ₀ minimise Σ (y − ŷ)² over the samples before the start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.few_unknowns import few_unknowns
from emsid.estimation.nonlinear.problem import Block, Infeasible
from emsid.models.regression.sensitivities import Parts, run_with_derivative

Array = NDArray[np.float64]

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
    """(N,) the outputs over the samples before the start, the first ones estimated.

    Where no run over these samples is finite, they are the measured outputs.
    """
    begin, memory = problem.memory - problem.depth, problem.memory
    try:
        found, _ = few_unknowns(problem, problem.y[begin:memory], max_iterations=ITERATIONS, tolerance=0.01)
    except ModelError:
        return problem.y
    return problem.run(found, np.empty((0, 0)))
