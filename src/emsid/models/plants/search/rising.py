r"""How the resistance of a winding rose during the records of a fit.

The finding has the rise over the longest segment with its interval, to first order from the covariance of the
parameters it depends on, and of a thermal mass the time constant 1/k and the rise at which it would end, ρ_∞ = q/k.
The mean heating q of the segment follows from the motion of ρ there, q = Δρ/t + k·ρ̄.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.estimates import HALF_WIDTH
from emsid.findings import Finding, finite
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.plant import Plant

Array = NDArray[np.float64]

PARTS = 50
"""Parts of the segment at whose ends the rise is looked at, for its mean."""
OF_RISE = ("heating", "cooling", "winding_drift")
"""The parameters that the rise depends on most."""
SMALL = 1e-3
"""Change of a parameter for derivatives, as a part of it."""


def rising(problem: FreeRunError, names: Sequence[str], covariance: Array) -> list[Finding]:
    """The finding about the resistance, of a plant that has one which changes.

    Args:
        problem: begun at the estimates.
        names: (p,) the parameters that were estimated.
        covariance: (p, p) of them.
    """
    if not problem.plant.changes_resistance or not set(OF_RISE) & {*names}:
        return []
    plant = problem.plant
    k = int(np.argmax([len(segment) for segment in problem.segments]))
    seconds = len(problem.segments[k]) * problem.segments[k].dt
    with suppress(EmsidError):
        rise = _rise(problem, plant, k)
        change = float(rise[-1] - rise[0])
        moving = [name for name in names if name in OF_RISE and plant.value(name)]
        own = [names.index(name) for name in moving]
        slopes = []
        for name in moving:
            value = plant.value(name)
            moved = _rise(problem, plant.with_values({name: (1 + SMALL) * value}), k)
            slopes.append((moved[-1] - moved[0] - change) / (SMALL * value))
        half = HALF_WIDTH * float(np.sqrt(np.array(slopes) @ covariance[np.ix_(own, own)] @ np.array(slopes)))
        heats, cooling = bool(plant.value("heating")), plant.value("cooling")
        final = (change / seconds / cooling + float(np.mean(rise))) if heats and cooling > 0 else None
        data = {
            "rise": change, "half": finite(half), "seconds": seconds, "heats": heats, "final": final,
            "time_constant": 1.0 / cooling if final is not None else None,
        }  # fmt: skip
        return [Finding("resistance-changes", plant.name, data)]
    return []


def _rise(problem: FreeRunError, plant: Plant, k: int) -> Array:
    """(PARTS + 1,) ρ over a segment, from its start."""
    segment, state = problem.segments[k], problem.states(problem.start)[k]
    plant = plant.for_segment(segment)
    now = plant.start(state, segment.input[0], segment.dt, problem.signals, len(segment))
    found = [plant.rise_in(now)]
    for inputs in np.array_split(segment.input, min(PARTS, len(segment))):
        now = plant.run(now, np.ascontiguousarray(inputs), problem.signals)[1]
        found.append(plant.rise_in(now))
    return np.array(found)
