"""Whether a command without a unit looks like the duty of a PWM."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FULL_DUTY = (100.0, 127.0, 255.0, 256.0, 400.0, 500.0, 511.0, 512.0, 999.0, 1000.0, 1023.0, 1024.0, 2047.0, 4095.0)
"""Where commands of microcontrollers end: percent, and counts of timers."""


def full_duty(command: Array) -> float:
    """The limit at which a command (N,) of whole numbers ends, as a duty does; 0 where it is no such command."""
    limit = float(np.max(np.abs(command), initial=0.0))
    return limit if limit in FULL_DUTY and not np.any(command % 1.0) else 0.0
