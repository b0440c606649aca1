"""Losses of a residual: squares, and the losses of Huber and Cauchy, which are robust against outliers.

A loss ℓ is an object with three methods: ℓ itself, the weight ℓ′(r)/r and the curvature ℓ″(r). `gauss_newton`
accepts any object that has them.

References:
    Huber, *Robust Statistics* (1981). Holland, Welsch, *Robust regression using iteratively reweighted least-squares*,
    Communications in Statistics A6 (1977), for the scales that keep 95 % efficiency under Gaussian noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]


class Loss(Protocol):
    """The cost of a residual."""

    def cost(self, residual: Array) -> Array:
        """ℓ(r) ≥ 0, sample by sample."""
        ...

    def weight(self, residual: Array) -> Array:
        """ℓ′(r)/r ≥ 0, sample by sample."""
        ...

    def curvature(self, residual: Array) -> Array:
        """ℓ″(r), sample by sample."""
        ...


@dataclass(frozen=True)
class Squares:
    """ℓ(r) = ½r², maximum likelihood for Gaussian noise."""

    def cost(self, residual: Array) -> Array:
        """½r²."""
        return 0.5 * residual**2

    def weight(self, residual: Array) -> Array:
        """1."""
        return np.ones_like(residual)

    def curvature(self, residual: Array) -> Array:
        """1."""
        return np.ones_like(residual)


SQUARES = Squares()


@dataclass(frozen=True)
class Huber:
    """ℓ(r) = ½r² up to |r| = scale and scale·(|r| − ½scale) beyond: the influence of an outlier is limited.

    Args:
        scale: in the unit of the residual; 1.345 standard deviations of Gaussian noise keep 95 % efficiency.
    """

    scale: float

    def __post_init__(self) -> None:
        _check_positive(self, self.scale)

    def cost(self, residual: Array) -> Array:
        """½r² or scale·(|r| − ½scale)."""
        size = np.abs(residual)
        return np.where(size <= self.scale, 0.5 * residual**2, self.scale * (size - 0.5 * self.scale))

    def weight(self, residual: Array) -> Array:
        """min(1, scale/|r|)."""
        weight: Array = self.scale / np.maximum(np.abs(residual), self.scale)
        return weight

    def curvature(self, residual: Array) -> Array:
        """1 up to scale, 0 beyond."""
        return (np.abs(residual) <= self.scale).astype(float)


@dataclass(frozen=True)
class Cauchy:
    """ℓ(r) = ½scale²·ln(1 + (r/scale)²): the influence of a far outlier vanishes.

    Args:
        scale: in the unit of the residual; 2.385 standard deviations of Gaussian noise keep 95 % efficiency.
    """

    scale: float

    def __post_init__(self) -> None:
        _check_positive(self, self.scale)

    def cost(self, residual: Array) -> Array:
        """½scale²·ln(1 + (r/scale)²)."""
        cost: Array = 0.5 * self.scale**2 * np.log1p((residual / self.scale) ** 2)
        return cost

    def weight(self, residual: Array) -> Array:
        """1/(1 + (r/scale)²)."""
        return 1 / (1 + (residual / self.scale) ** 2)

    def curvature(self, residual: Array) -> Array:
        """(1 − (r/scale)²)/(1 + (r/scale)²)², negative in the tails."""
        square = (residual / self.scale) ** 2
        return (1 - square) / (1 + square) ** 2


def _check_positive(loss: object, scale: float) -> None:
    if not (np.isfinite(scale) and scale > 0):
        raise ModelError(f"{type(loss).__name__} loss with scale {scale}; give a positive number in the output's unit")
