"""The state of a plant between two samples, as `Plant.run` takes it and hands it on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PlantState(NamedTuple):
    """All that the outputs of a plant from one sample on depend on, besides its input from there on.

    Attributes:
        dt: sample time in s; commands on their way and filters of sensors are counted in samples.
        motion: (n,) what moves: speed and position of one mass, the five numbers of `emsid.plant.State`, or the state
            of a user's own plant.
        commands: (w + 1, 2) voltage (force) and conducting part of the commands that the drive still delays, the
            oldest first.
        sensed: (ny, 2) for every output the position that its sensor saw last (NaN before the first sample) and the
            state of its filter.
    """

    dt: float
    motion: Array
    commands: Array
    sensed: Array


NOTHING = np.empty((0, 2))
"""Neither delayed commands nor sensors."""
