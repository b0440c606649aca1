"""Noise that changes as slowly as the record is long: what it adds to the uncertainty, and that this is a guess.

The colour of the noise is estimated from the residual (`coloured_residuals`). A residual that hardly changes during a
record is only a few independent values, and shows its own deviation as badly as a sample of that size: the intervals
are those of Student's t, and a finding says how few values there are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.alternatives import Addition, nothing
from emsid.models.plants.search.task import Task

ENOUGH = 30.0
"""With as many independent values, Student's intervals are 4 % wider than normal ones, and the estimate of the colour
is unbiased to a few percent."""


def slow_noise(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Addition:
    """The uncertainty of the parameters where the residual has few independent values.

    Errors of a position add up, so that a slow residual is usual there (`slow_drift`, `load_drift`).

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    p = len(names)
    if Signal.POSITION in task.signals or isinstance(task.weighting, tuple) or not p:
        return nothing(p)
    if np.sqrt(minimum.noise_variance) <= problem.precision:
        return nothing(p)
    residuals = [part for each in problem.residuals(problem.start) for part in np.split(each, len(task.signals))]
    values = min(effective_samples(residuals[k :: len(task.signals)]) for k in range(len(task.signals)))
    if values >= min(ENOUGH, sum(map(len, task.segments))):
        return nothing(p)
    wider = float(stdtrit(max(values - p, 1.0), 0.975)) / HALF_WIDTH
    own = slice(p)
    data = {"values": values, "samples": sum(map(len, task.segments))}
    return Addition(
        (wider**2 - 1) * minimum.covariance[own, own], (Finding("residual-slow", problem.plant.name, data),)
    )
