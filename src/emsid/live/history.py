"""The estimate of a tracking session over time, in constant memory."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REMEMBERED = 2000
"""Points of the history of the estimate."""


@dataclass(eq=False)
class History:
    """The estimate over time, with at most `REMEMBERED` points: when it is full, every second point is dropped."""

    time: list[float] = field(default_factory=list)
    estimate: list[Array] = field(default_factory=list)
    half_width: list[Array] = field(default_factory=list)
    step: int = 1
    _count: int = 0

    def add(self, time: float, estimate: Array, half_width: Array) -> None:
        """Remember a point."""
        self._count += 1
        if self._count % self.step:
            return
        self.time.append(time)
        self.estimate.append(estimate)
        self.half_width.append(half_width)
        if len(self.time) >= REMEMBERED:
            for each in (self.time, self.estimate, self.half_width):
                del each[::2]
            self.step *= 2
