"""After how long the error of the free run of a position is forgotten.

The free run of a position keeps for ever what a slow disturbance did to it, and a fit to the plain error bends its
parameters to make up for that. Errors that are forgotten (`Recent`) do not, but lose what the record shows over longer
times. Least squares is efficient where its residual is white. Of a model that is exact but for a slow disturbance, the
forgotten error is white if it is forgotten soon enough. So the longest time is taken that leaves nearly as many
independent errors as there are samples. Where not even the shortest does, the error is no slow disturbance in noise,
and all errors count alike.

References:
    Söderström, Stoica, *System Identification*, sec. 7.4, on the loss of accuracy by a filter that is not that of the
    noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.plants.free_run_error import Recent, Weighting, all_alike
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import DrivenPlant
from emsid.models.plants.search.trials import Trials

Array = NDArray[np.float64]

PARTS = (20, 40, 80, 160, 320)
"""Errors are forgotten after one of these parts of the longest segment, if they are."""
SHORTEST = 10
"""Samples after which errors are forgotten at least."""
LONG = 800
"""Samples of a segment that can show whether errors should be forgotten."""
WHITE = 0.5
"""A residual is white if it is worth at least this part of its samples."""


def forgetting(trials: Trials) -> list[Recent]:
    """What may be taken instead of errors that count alike, from long to short; nothing but for a long position."""
    longest = max(len(segment) for segment in trials.segments)
    if trials.signals != (Signal.POSITION,) or longest < LONG:
        return []
    dt = trials.segments[0].dt
    return [Recent(longest * dt / part, 2) for part in PARTS if longest >= SHORTEST * part]


def chosen(
    trials: Trials, starts: Sequence[DrivenPlant], names: Sequence[str], states: Sequence[Array] | None = None
) -> Weighting:
    """The weighting for a structure.

    Args:
        trials: what all fits share.
        starts: plants with the structure, to begin with.
        names: the parameters to estimate.
        states: initial states to begin with, by default what the first samples show.
    """

    def leaves_noise(weighting: Weighting) -> bool:
        trial = replace(trials, weighting=weighting).fitted(starts, names, states)
        if trial is None:
            return False
        return effective_samples(trial.residuals) >= WHITE * sum(len(residual) for residual in trial.residuals)

    some = forgetting(trials)
    if not some or leaves_noise(all_alike) or not leaves_noise(some[-1]):
        return all_alike
    return next((weighting for weighting in some[:-1] if leaves_noise(weighting)), some[-1])
