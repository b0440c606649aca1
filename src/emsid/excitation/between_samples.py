"""What the samples of an input show of its hold, and whether they look like the duty of a PWM.

An input that often repeats its value is held, as that of a digital output is. One that changes at every sample, and
much from sample to sample, was not sampled from a continuous signal: half of its power would lie above a
sixth of the sampling frequency. A smooth one may be either, and only the output shows which; where it has single jumps
it is more likely held.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HOLD_FRACTION = 0.5
"""An input that repeats its value at more than this fraction of the samples is held between samples."""
ROUGH = 0.5
"""The second differences of a smooth input have less than this part of its variance."""
JUMP = 5.0
"""A jump is larger than 95 % of the steps by this factor."""


def repeats(inputs: Sequence[Array]) -> bool:
    """Whether inputs (Nᵢ,) repeat their value so often that they are held."""
    return bool(np.mean(np.concatenate([np.diff(u) == 0 for u in inputs])) > HOLD_FRACTION)


def jumps(u: Array) -> bool:
    """Whether an input (N,) has single steps much larger than its usual changes, as between levels that are held."""
    steps = np.abs(np.diff(u))
    return bool(np.max(steps, initial=0.0) > JUMP * np.quantile(steps, 0.95)) if len(steps) else False


def may_be_continuous(inputs: Sequence[Array]) -> bool:
    """Whether inputs (Nᵢ,) may be samples of a continuous signal."""
    if repeats(inputs):
        return False
    power = sum(len(u) * float(np.var(u)) for u in inputs)
    bends = sum(float(np.sum(np.diff(u, 2) ** 2)) for u in inputs)
    return bends < ROUGH * power


FULL_DUTY = (100.0, 127.0, 255.0, 256.0, 400.0, 500.0, 511.0, 512.0, 999.0, 1000.0, 1023.0, 1024.0, 2047.0, 4095.0)
"""Where commands of microcontrollers end: percent, and counts of timers."""


def full_duty(command: Array) -> float:
    """The limit at which a command (N,) of whole numbers ends, as a duty does; 0 where it is no such command."""
    limit = float(np.max(np.abs(command), initial=0.0))
    return limit if limit in FULL_DUTY and not np.any(command % 1.0) else 0.0
