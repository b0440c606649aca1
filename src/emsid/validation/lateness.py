r"""Whether a record is later or earlier than the free run of a model: another delay, or other time stamps.

The error y(t) − ŷ(t − τ) is minimised over τ by Gauss–Newton: to first order, a change δ of τ changes it by
δ dŷ(t − τ)/dt, so that δ = −Σ e·x/Σ x·x with x = dŷ(t − τ)/dt. The free run is interpolated between its samples.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding
from emsid.models.model import Run
from emsid.record import Record
from emsid.validation.agreement import NOTABLE
from emsid.validation.metrics import FEWEST

Array = NDArray[np.float64]

ITERATIONS = 8
"""Of Gauss–Newton."""
LEAST_SHIFT = 0.1
"""A smaller shift, in samples, does not matter."""
MOST_SHIFT = 10.0
"""A larger one, in samples, is not found reliably by first-order steps."""


def lateness(record: Record, run: Run) -> Iterable[Finding]:
    """The shift in time of the outputs against a free run, where it makes a notable share of the squared error.

    Args:
        record: the data.
        run: the free run of a model over them.
    """
    resampled = any(each.code == "data-resampled" for each in record.findings)  # by up to a sample
    if run.diverged_at is not None or np.count_nonzero(run.counted) < FEWEST:
        return
    edges = list(pairwise((0, *record.breaks, len(record))))
    for channel, (name, unit) in enumerate(zip(record.output_names, record.output_units, strict=True)):
        y, free = record.output[:, channel], run.output[:, channel]
        shift = _best_shift(y, free, run.counted, edges)
        before, after = (_mean_square(y - _shifted(free, by, edges), run.counted) for by in (0.0, shift))
        if (1.0 if resampled else LEAST_SHIFT) <= abs(shift) <= MOST_SHIFT and after < (1 - NOTABLE) * before:
            errors = {"rmse": float(np.sqrt(before)), "shifted": float(np.sqrt(after)), "unit": unit}
            data = {"output": name, "delay": shift * record.dt, "samples": shift, **errors}
            yield Finding("record-shifted", record.name, data)


def _best_shift(y: Array, free: Array, counted: NDArray[np.bool_], edges: list[tuple[int, int]]) -> float:
    """The shift of the free run (N,) that is closest to y (N,), in samples; later is positive."""
    shift = 0.0
    for _ in range(ITERATIONS):
        moved = _shifted(free, shift, edges)
        slope = np.concatenate([np.gradient(moved[a:b]) if b > a + 1 else np.zeros(b - a) for a, b in edges])[counted]
        square = float(slope @ slope)
        if not square > 0:
            return 0.0
        shift = float(np.clip(shift - (y - moved)[counted] @ slope / square, -2 * MOST_SHIFT, 2 * MOST_SHIFT))
    return shift


def _shifted(free: Array, shift: float, edges: list[tuple[int, int]]) -> Array:
    """The free run (N,) later by ``shift`` samples, segment by segment; before its first sample it is constant."""
    pieces = [np.interp(np.arange(b - a) - shift, np.arange(b - a), free[a:b]) for a, b in edges if b > a]
    return np.concatenate(pieces)


def _mean_square(error: Array, counted: NDArray[np.bool_]) -> float:
    return float(np.mean(error[counted] ** 2))
