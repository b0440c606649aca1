r"""Parameters that differ between the halves of a long record, and the uncertainty that this adds.

Friction and offset of a real axis change with its temperature. In a free run over the whole record of a position, such
a slow drift biases all parameters, and the residuals do not show by how much. So the halves are fitted too, each with
its own initial state and its own offset. If a parameter differs between them by more than `FAR` standard errors, the
covariance includes the differences between the halves and the whole, in the mean of both,

    C + ½·Σᵢ (θ̂ᵢ − θ̂)(θ̂ᵢ − θ̂)ᵀ,

which contains half of their difference from each other, and the shift of the estimates of the whole run by the drift.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.findings import Finding
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.initial_state import starts_from_samples
from emsid.models.plants.search import continuation
from emsid.models.plants.search.alternatives import Addition, nothing
from emsid.models.plants.search.task import Task

FAR = 3.0
"""The halves differ if their difference is more than this many of its standard errors."""
LONG = 2000
"""Samples of a record whose halves are compared."""


def slow_drift(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Addition:
    """The uncertainty of the parameters of a single long record of a position, from its halves.

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
            halves.append(continuation.with_colour(begun, continuation.search_once(begun, task)))
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
