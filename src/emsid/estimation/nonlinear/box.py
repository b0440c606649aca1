"""The bounds within which a search varies its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from emsid.errors import ModelError
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


def bounded(start: ArrayLike, lower: ArrayLike, upper: ArrayLike, names: Sequence[str]) -> tuple[Array, Box]:
    """(p,) start values, and their bounds (p,) or a number each.

    Raises:
        ModelError: for start values that are not finite or outside their bounds, bounds that cross, or names of
            another number.
    """
    theta = np.array(start, dtype=float)
    if theta.ndim != 1:
        raise ModelError(f"start values of shape {theta.shape}; give (p,)")
    if names and len(names) != len(theta):
        raise ModelError(f"{len(names)} names for {len(theta)} parameters")
    low = np.broadcast_to(np.asarray(lower, dtype=float), theta.shape)
    high = np.broadcast_to(np.asarray(upper, dtype=float), theta.shape)
    for k, (value, a, b) in enumerate(zip(theta, low, high, strict=True)):
        what = names[k] if names else f"θ{k + 1}"
        if not np.isfinite(value):
            raise ModelError(f"start value of {what} is {value}; give a finite number")
        if not a <= b:
            raise ModelError(f"bounds of {what} are [{a:g}, {b:g}]; the lower one must not exceed the upper one")
        if not a <= value <= b:
            raise ModelError(f"start value {value:g} of {what} is outside its bounds [{a:g}, {b:g}]")
    return theta, Box(low, high, np.flatnonzero(low < high))
