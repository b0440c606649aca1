"""What a quantity of a plant rests on, and whether records visit that: a command, a direction, speeds.

A threshold is shown by commands on both of its sides, and a level of sliding friction by sliding slowly: it is what the
torque of a straight line over speed leaves at rest. Where a record has neither, the number is an extrapolation.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SLOW = 0.25
"""Sliding below this share of the largest speed shows a level of friction: from there on, a straight line over speed is
extrapolated by no more than a third of what was visited."""
MOVING = 0.05
"""Moving the other way at less than this share of the largest speed may be swinging back, or noise of a sensor."""


class Needs(Enum):
    """What a quantity rests on besides motion."""

    ANY = "any"
    THRESHOLD = "commands on both sides of it"
    SLIDING = "slow sliding"


class RestsOn(NamedTuple):
    """What a record must visit to show a quantity.

    Attributes:
        needs: besides motion.
        direction: in which it moves, or it must be visited: 1 forward, −1 backward, 0 either.
    """

    needs: Needs = Needs.ANY
    direction: int = 0


class Visited(NamedTuple):
    """What records visit.

    Attributes:
        commands: (N,) in the unit of a threshold.
        speeds: (N,) of the plant; empty where it is not known.
    """

    commands: Array
    speeds: Array

    def shows(self, rests: RestsOn, value: float) -> bool:
        """Whether the records show a quantity of this value."""
        directions = (rests.direction,) if rests.direction else (1, -1)
        return rests == RestsOn() or any(self._in_direction(rests.needs, way, value) for way in directions)

    def _in_direction(self, needs: Needs, way: int, value: float) -> bool:
        if needs is Needs.THRESHOLD:
            commands = way * self.commands
            return not len(commands) or bool(commands.min() <= max(value, 0.0) <= commands.max())
        speeds = way * self.speeds
        if not len(speeds):
            return True
        fastest = float(np.max(np.abs(speeds)))
        return bool(speeds.max() >= MOVING * fastest and (needs is Needs.ANY or speeds.min() <= SLOW * speeds.max()))
