r"""The time for which the free run of a position, whose errors add up, stays near the record.

A position keeps the effect of every past disturbance, so errors of a free run add up. In a window of n samples that has
an initial position of its own, the error is the residual e without its mean there. Its mean square over all windows,

    W²(n) = mean (eₜ − ē)²,

is about the power of the residual at frequencies above 1/(n·dt). For white noise, and for errors that repeat with every
motion forth and back, W is nearly the same for all windows longer than a motion in one direction. A drift has most of
its power at low frequencies, and W grows. The free run is trusted for the longest windows whose W² is at most twice
that of the noise, or, if a single motion already has a larger error, twice that of windows as long as a motion. In
longer windows, most of the error has added up since the start. The noise is the change from sample to sample, of
variance ½·mean (eₜ₊₁ − eₜ)².

References:
    Percival, *On estimation of the wavelet variance*, Biometrika 82 (1995), on such variances and the spectrum.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.initial_state import starts_from_samples
from emsid.models.plants.search.task import Task
from emsid.record import Record

Array = NDArray[np.float64]

TURNED = 0.05
"""A motion ends where the position has returned by this part of its range."""
POINTS = 20_000
"""In longer segments, reversals are searched in at most this many samples."""
WINDOWS = 3
"""The longest segment has at least this many of the longest windows."""
LENGTHS = 1.1
"""Ratio of successive lengths of windows."""


def trusted_length(task: Task, problem: FreeRunError) -> list[Finding]:
    """The time for which the free run of a fit is trusted; nothing if its error does not grow with its length.

    If the fit has taken a drift of the load into account, the finding ``load-drifts`` has this time.

    Args:
        task: what was asked.
        problem: begun at the minimum.
    """
    if not starts_from_samples(problem.plant, task.signals) or task.weighting is not all_alike:
        return []
    return _findings(problem.plant.name, task.segments, problem.residuals(problem.start))


def trusted_length_over(model: GreyBox, record: Record) -> list[Finding]:
    """The time for which the free run of a plant is trusted in a record; nothing if its error does not grow.

    Args:
        model: whose only output is a position.
        record: with its channels.
    """
    if not starts_from_samples(model.plant, model.signals):
        return []
    run = model.simulate(record)
    if run.diverged_at is not None:
        return []
    ends = np.cumsum([len(segment) for segment in record.segments])[:-1]
    return _findings(model.name, record.segments, np.split((run.output - record.output)[:, 0], ends))


def _findings(model: str, segments: Sequence[Record], residuals: Sequence[Array]) -> list[Finding]:
    """The finding from the residuals ŷ − y (Nᵢ,) of segments."""
    runs = [segment.output[:, 0] + residual for segment, residual in zip(segments, residuals, strict=True)]
    found = longest_trusted(residuals, motion(runs))
    if found is None:
        return []
    samples, error = found
    whole = sqrt(float(np.mean(np.concatenate(residuals) ** 2)))
    data = {"seconds": samples * segments[0].dt, "error": error, "whole": whole, "unit": segments[0].output_units[0]}
    return [Finding("free-run-drifts", model, data)]


def motion(runs: Sequence[Array]) -> int | None:
    """The samples of a typical motion in one direction: the median time between reversals.

    Args:
        runs: (Nᵢ,) the position in every segment, without noise.

    Returns:
        None without two reversals in one segment.
    """
    paths = [run - np.linspace(run[0], run[-1], len(run)) for run in runs]
    least = TURNED * max(float(np.ptp(path)) for path in paths)
    gaps = np.concatenate([np.diff(reversals(path, least)) for path in paths])
    return int(np.median(gaps)) if len(gaps) else None


def reversals(path: Array, least: float) -> NDArray[np.int64]:
    """The samples at which a position (N,) has returned by this distance from its last turning point."""
    every = 1 + len(path) // POINTS
    found, direction = [], 0
    high = low = float(path[0])
    for k, value in enumerate(path[::every].tolist()):
        high, low = max(high, value), min(low, value)
        turned = 1 if value > low + least else -1 if value < high - least else 0
        if turned and turned != direction:
            found += [k] * (direction != 0)
            direction, high, low = turned, value, value
        elif direction > 0:
            low = high
        elif direction < 0:
            high = low
    return every * np.array(found, dtype=np.int64)


def longest_trusted(residuals: Sequence[Array], shortest: int | None) -> tuple[int, float] | None:
    """The samples of the longest windows whose error has not yet grown, and their error W.

    Args:
        residuals: (Nᵢ,) of every segment.
        shortest: samples of a single motion, in which errors have not yet added up.

    Returns:
        None where the error does not grow.
    """
    longest = max(map(len, residuals)) // WINDOWS
    if shortest is None or not 2 <= shortest < longest:
        return None
    count = int(np.log(longest / shortest) / np.log(LENGTHS)) + 2
    lengths = np.unique(np.geomspace(shortest, longest, count).astype(int))
    powers = [within(residuals, n) for n in lengths]
    noise = 0.5 * float(np.mean(np.concatenate([np.diff(each) for each in residuals]) ** 2))
    least = noise if powers[0] <= 2 * noise else powers[0]
    near = list(takewhile(lambda power: power <= 2 * least, powers))
    if len(near) == len(powers):
        return None
    return int(lengths[len(near) - 1]), sqrt(near[-1])


def within(residuals: Sequence[Array], n: int) -> float:
    """W²(n) of residuals (Nᵢ,): the mean square of windows of n samples, each without its mean."""
    total, windows = 0.0, 0
    for residual in residuals:
        if len(residual) >= n:
            centred = residual - residual.mean()
            sums, squares = (np.concatenate([[0.0], np.cumsum(each)]) for each in (centred, centred**2))
            mean, power = ((each[n:] - each[:-n]) / n for each in (sums, squares))
            total, windows = total + float(np.sum(power - mean**2)), windows + len(mean)
    return total / windows
