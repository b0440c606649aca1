r"""Whether the error of a free run is what the rounding of an encoder makes.

Rounding to steps Δ makes errors of variance Δ²/12. Where an output stays at exactly one value while it rests, it has
hardly any other noise. A larger error of the free run is then one of the model, which is the same in every part of the
record, and which intervals from the spread of the errors do not include.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.rounding import quantisation
from emsid.findings import Finding
from emsid.models.plants.free_run_error import all_alike
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.task import Task

Array = NDArray[np.float64]

ABOVE = 1.3
"""The error is above that of rounding by this factor; noise of a fifth of a step makes 1.2, unseen at rest."""
STILL = 20
"""Samples at one value, while the input changes, that show an output without noise at rest."""


def above_rounding(task: Task, model: str, minimum: Minimum) -> list[Finding]:
    """A finding where the error of a position is larger than rounding explains; none where it has other noise.

    Args:
        task: with the records.
        model: its name.
        minimum: where the search ended.
    """
    if task.signals != (Signal.POSITION,) or task.weighting is not all_alike:
        return []
    step = quantisation(np.unique(np.concatenate([segment.output[:, 0] for segment in task.segments])))
    if step is None or not any(_rests_exactly(segment.input[:, 0], segment.output[:, 0]) for segment in task.segments):
        return []
    ratio = sqrt(12.0 * minimum.noise_variance) / step
    unit = task.segments[0].output_units[0]
    return (
        [Finding("error-above-rounding", model, {"ratio": ratio, "step": step, "unit": unit})] if ratio > ABOVE else []
    )


def _rests_exactly(u: Array, y: Array) -> bool:
    """Whether an output (N,) stays at one value for a while, in which its input changes."""
    ends = np.flatnonzero(np.diff(y, prepend=np.nan, append=np.nan) != 0)
    return any(np.ptp(u[a:b]) > 0 for a, b in pairwise(ends) if b - a >= STILL)
