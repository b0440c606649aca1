"""The bounds within which a search varies its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emsid.estimation.nonlinear.problem import Array, Indices


@dataclass(frozen=True, eq=False)
class Box:
    """Bounds of all parameters.

    Attributes:
        low, high: (p,) the smallest and the largest values.
        varied: (n,) indices of the parameters that are not fixed, of increasing size.
    """

    low: Array
    high: Array
    varied: Indices

    def limits(self, theta: Array) -> tuple[Array, Array]:
        """(n,) each: the steps of the varied parameters from θ (p,) to their lower and upper bounds."""
        return (self.low - theta)[self.varied], (self.high - theta)[self.varied]

    def moved(self, theta: Array, step: Array) -> Array:
        """(p,) θ after a step (n,) of the varied parameters; a step to a bound ends exactly on it."""
        down, up = self.limits(theta)
        new = theta.copy()
        new[self.varied] = np.where(
            step <= down,
            self.low[self.varied],
            np.where(step >= up, self.high[self.varied], theta[self.varied] + step),
        )
        return new
