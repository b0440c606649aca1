"""A small linear model for the first look: ARX with an offset, whose free run shows what a linear model leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.filtering import filtered, filtered_from, past_state
from emsid.record import Record

Array = NDArray[np.float64]

ORDER = 4
"""Past inputs and past outputs."""
MOST_DELAY = 0.25
"""A delay above this share of the longest segment is no delay of the system."""


@dataclass(frozen=True)
class Baseline:
    """A linear model and its free run.

    Attributes:
        fit: 1 − ‖y − ŷ‖/‖y − ȳ‖ of the free run; it may be negative.
        residual: (N,) y − ŷ.
        simulated: (N,) ŷ.
        time_constant: in samples, until the step response first reaches 63 % of its change; infinite where it never
            does.
        gain: of the model at rest.
    """

    fit: float
    residual: Array
    simulated: Array
    time_constant: float
    gain: float


def baseline(record: Record, delay: int | None) -> Baseline | None:
    """A linear model of the first output by the first input; None where there are too few samples or it is unstable.

    Args:
        record: the data.
        delay: samples from the input to its first effect; None for one sample.
    """
    delay = max(1, delay or 1)
    first = ORDER + delay - 1
    tables = []
    for piece in record.segments:
        u, y = piece.input[:, 0], piece.output[:, 0]
        rows = np.arange(first, len(y))
        if len(rows):
            past = [y[rows - lag] for lag in range(1, ORDER + 1)] + [u[rows - delay - k] for k in range(ORDER)]
            tables.append(np.column_stack([*past, np.ones(len(rows)), y[rows]]))
    table = np.concatenate(tables) if tables else np.zeros((0, 2 * ORDER + 2))
    if len(table) < 10 * ORDER or delay > MOST_DELAY * max(map(len, record.segments)):
        return None
    estimate = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=1e-10)[0]
    a = np.concatenate([[1.0], -estimate[:ORDER]])
    b = np.concatenate([np.zeros(delay), estimate[ORDER : 2 * ORDER]])
    if np.max(np.abs(np.roots(a)), initial=0.0) >= 1:
        return None
    simulated = np.concatenate([_free_run(piece, a, b, float(estimate[-1])) for piece in record.segments])
    y = record.output[:, 0]
    residual = y - simulated
    fit = 1 - float(np.linalg.norm(residual) / np.linalg.norm(y - y.mean()))
    step = filtered(b, a, np.ones(min(len(record), 20_000)))
    gain = float(b.sum() / a.sum())
    reached = np.flatnonzero(np.abs(step) >= 0.632 * abs(gain))
    constant = float(max(reached[0] - delay + 1, 0.5)) if len(reached) and np.isfinite(gain) else np.inf
    return Baseline(fit, residual, simulated, constant, gain)


def _free_run(piece: Record, a: Array, b: Array, offset: float) -> Array:
    """The output of the model on a segment, from its first measured outputs on."""
    u, y = piece.input[:, 0], piece.output[:, 0]
    start = len(b)
    if len(y) <= start:
        return y
    rest = offset / a.sum()
    run, _ = filtered_from(b, a, u[start:], past_state(b, a, y[:start] - rest, u[:start]))
    return np.concatenate([y[:start], run + rest])
