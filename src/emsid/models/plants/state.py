"""The state of a plant between two samples, an argument and a result of `Plant.run`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PlantState(NamedTuple):
    """The state that determines the outputs of a plant together with the inputs that follow.

    Attributes:
        dt: sample time in s; delayed commands and sensor filters are in samples.
        motion: (n,) mechanical state: speed and position of one mass, the five numbers of `emsid.plant.State`, or the
            state of a user's plant.
        commands: (w + 1, 2) voltage (force) and conducting fraction of the delayed commands, the oldest first; with
            a third column of the load, if there is one among the inputs.
        sensed: (ny, 2) for every output the last position at its sensor (NaN before the first sample) and the state of
            its filter.
    """

    dt: float
    motion: Array
    commands: Array
    sensed: Array


HELD = 3
"""Index of an initial state: 1 where the plant is held at rest until its first command acts, else 0."""
RISE = 4
"""Index of an initial state: the rise of the resistance of a motor, as a part."""
NO_LOAD = np.empty(0)
"""No load among the inputs."""
NO_ROWS = np.empty((0, 2))
"""Neither delayed commands nor sensors."""
