r"""Parameters that are not the same in both halves of a long record, and what that adds to their uncertainty.

Friction and offset of a real axis change with its temperature. A free run over the whole record of a position takes
such a slow drift into all parameters, and residuals of one run do not show by how much. So the halves are fitted too,
each with its own initial state and its own offset. Where a parameter differs between them by more than `FAR` standard
errors, the covariance includes what the halves differ from the whole by, in the mean of both,

    C + ½·Σᵢ (θ̂ᵢ − θ̂)(θ̂ᵢ − θ̂)ᵀ,

which is half of what they differ from one another by, and what the drift has moved the estimates of the whole run by.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.findings import Finding
from emsid.models.plants.beginning import starts_from_samples
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.search import continuation
from emsid.models.plants.search.alternatives import Addition, nothing
from emsid.models.plants.search.task import Task

FAR = 3.0
"""How many standard errors of the difference two halves must differ by."""
LONG = 2000
"""Samples of a record whose halves are compared."""
STEPS = 20
"""Steps of the fit of a half."""


def slow_drift(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Addition:
    """What the halves of a single long record of a position say about its parameters.

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    plant, segments = problem.plant, task.segments
    looked_at = starts_from_samples(plant, task.signals) and task.weighting is all_alike
    if not looked_at or len(segments) != 1 or len(segments[0]) < LONG:
        return nothing(len(names))
    middle, whole = len(segments[0]) // 2, segments[0]
    halves = []
    for half in (whole[:middle], whole[middle:]):
        first, free = plant.first_state(task.signals, half), plant.free_states(task.signals, half)
        begun = FreeRunError(plant, task.signals, (half,), names, (first,), (free,), task.weighting, task.threads)
        try:
            halves.append(continuation.with_colour(begun, continuation.search_once(begun, task, STEPS)))
        except (EmsidError, Stopped):
            return nothing(len(names))
    own = slice(len(names))
    free = minimum.free[own] & np.logical_and(*(half.free[own] for half in halves))
    difference = np.where(free, halves[1].estimate[own] - halves[0].estimate[own], 0.0)
    variance = sum(np.diag(half.covariance)[own] for half in halves)
    far = free & np.isfinite(variance) & (np.abs(difference) > FAR * np.sqrt(variance))
    findings = tuple(
        Finding(
            "parameter-drifts",
            name,
            {"halves": [float(half.estimate[k]) for half in halves], "unit": plant.handles[name].parameter.unit},
        )
        for k, name in enumerate(names)
        if far[k]
    )
    if not findings:
        return nothing(len(names))
    moved = np.array([np.where(free, half.estimate[own] - minimum.estimate[own], 0.0) for half in halves])
    return Addition(moved.T @ moved / len(moved), findings)
