"""The dead zone (4.9): the output is zero between two break points.

D(v) = m_r·(v − b_r)   v ≥ b_r
       0               b_l < v < b_r
       m_l·(v − b_l)   v ≤ b_l
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DeadZoneLaw:
    """The dead zone (4.9), with a break point and a slope on either side.

    >>> zone = DeadZoneLaw(-1.0, 0.5, m_r=2.0)
    >>> zone([-3.0, 0.2, 1.5])
    array([-2.,  0.,  2.])

    Args:
        b_l: left break point b_l ≤ 0, in the unit of the input.
        b_r: right break point b_r ≥ 0, in the unit of the input.
        m_l: slope left of b_l, positive.
        m_r: slope right of b_r, positive.

    Raises:
        ModelError: where the break points do not enclose 0 or a slope is not positive.
    """

    b_l: float
    b_r: float
    m_l: float = 1.0
    m_r: float = 1.0

    def __post_init__(self) -> None:
        for name in ("b_l", "b_r", "m_l", "m_r"):
            if not isfinite(getattr(self, name)):
                raise ModelError(f"dead zone {name} is {getattr(self, name)}; give a finite number")
        if not self.b_l <= 0 <= self.b_r:
            raise ModelError(f"dead zone from b_l = {self.b_l} to b_r = {self.b_r}; it must enclose 0")
        if min(self.m_l, self.m_r) <= 0:
            raise ModelError(f"dead zone slopes m_l = {self.m_l}, m_r = {self.m_r}; both must be positive")

    def __call__(self, value: ArrayLike) -> Array:
        """D(v) (4.9) of an input of any shape."""
        v = np.asarray(value, dtype=float)
        return self.m_r * np.maximum(v - self.b_r, 0.0) + self.m_l * np.minimum(v - self.b_l, 0.0)

    def derivative(self, value: ArrayLike) -> Array:
        """dD/dv; at a break point the slope outside the zone."""
        v = np.asarray(value, dtype=float)
        return np.where(v >= self.b_r, self.m_r, np.where(v <= self.b_l, self.m_l, 0.0))

    def inverse(self, value: ArrayLike) -> Array:
        """The input whose output is ``value``; 0 for the output 0.

        The inverse before a drive compensates its dead zone.
        """
        w = np.asarray(value, dtype=float)
        return np.where(w > 0, w / self.m_r + self.b_r, np.where(w < 0, w / self.m_l + self.b_l, 0.0))
