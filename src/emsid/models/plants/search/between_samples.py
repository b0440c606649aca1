"""How the command of some records goes on between its samples, decided by the free run where the command may do either.

A command that is taken for held although it goes on is half a sample late, and the inertia, the friction and the dead
zone are bent to make up for it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.arguments import did_you_mean
from emsid.errors import ModelError
from emsid.estimation.nonlinear.gauss_newton import Infeasible
from emsid.excitation.between_samples import may_be_continuous
from emsid.models.plants.drive import Hold
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.plant import Plant
from emsid.models.plants.search.task import Task
from emsid.record import Record


def as_hold(hold: Hold | str) -> Hold:
    """A `Hold`, or the one of this name.

    Raises:
        ModelError: for another name.
    """
    names = [each.value for each in Hold]
    if not isinstance(hold, Hold) and hold not in names:
        raise ModelError(
            f"hold is {hold!r}; give zero (held) or first (straight from sample to sample)"
            f"{did_you_mean(str(hold), names)}",
            arguments=("hold",),
        )
    return Hold(hold)


def is_open(plant: Plant, segments: Sequence[Record]) -> bool:
    """Whether the records must show how the command of a plant goes on: it changes smoothly at every sample."""
    driven = plant.driven
    if driven is None or driven.drive.codes or plant.hold is not Hold.ZERO:
        return False
    return may_be_continuous([driven.drive.commands(segment.input) for segment in segments])


def promises_more(task: Task, problem: FreeRunError, cost: float) -> Plant | None:
    """The plant with a straight command, if that may simulate better than the minimum of a problem with a held one.

    The error of its free run may be lowered by what the parameters can explain to first order, so no search is needed
    to see that it does not.
    """
    straight = problem.plant.with_hold(Hold.FIRST)
    names = list(problem.free)
    other = task.problem(straight, names, problem.states(problem.start))
    try:
        residual = np.concatenate(other.residuals(other.start))
    except Infeasible:
        return None
    slopes = np.concatenate([jacobian for _, jacobian in problem.linearised(problem.start)])
    sizes = np.linalg.norm(slopes, axis=0)
    slopes = slopes / np.where(sizes > 0, sizes, 1.0)
    left = residual - slopes @ np.linalg.lstsq(slopes, residual, rcond=1e-9)[0]
    return straight if 0.5 * float(left @ left) < cost else None
