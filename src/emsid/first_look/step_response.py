"""The response to an input that is constant, and not zero, from the first sample on: one step from rest.

A response of first order with the sample time T and the time constant τ rests at r, and moves from a time δ on:

    y[k] = y∞ − (y∞ − r)·a^(k − δ),   a = exp(−T/τ),   so that y[k] = a·y[k−1] + b with y∞ = b/(1 − a).

The regression takes the samples after those at rest, whose number has the smallest error of a simulation from rest. Its
own simulation is the instrument, so that noise does not make the response faster.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.least_squares import settles
from emsid.record import Record

Array = NDArray[np.float64]

PLACES = 32
"""Numbers of samples at rest that are compared at first; then the best one by halved distances."""
ITERATIONS = 3
"""Of the instruments."""
CHANCE = 3.84
"""Times the variance of the noise, what one more parameter saves by chance in 5 % (χ²)."""


@dataclass(frozen=True)
class Step:
    """The response of the first output.

    Attributes:
        gain: per unit of the first input.
        time_constant: in s.
        resting: the samples at the beginning of each segment before the output moves; 0 where none is seen.
        begins: the time in s, on the clock of the record, when it begins to move.
    """

    gain: float
    time_constant: float
    resting: int
    begins: float


def step_response(record: Record) -> Step | None:
    """The response of first order to inputs that are constant from the first sample on; None where it is none.

    Args:
        record: with an output.
    """
    u = record.input
    if not u.shape[1] or np.ptp(u, axis=0).any() or not u[0, 0] or not settles(record):
        return None
    pieces = [piece.output[:, 0] for piece in record.segments]
    first = min(pieces, key=len)
    half = int(np.argmax(np.abs(first - first[0]) >= np.abs(first[-1] - first[0]) / 2))
    known: dict[int, tuple[float, float, float]] = {}

    def error(resting: int) -> float:
        if resting not in known:
            known[resting] = _fitted(pieces, resting)
        return known[resting][2] if 0 <= resting <= half else np.inf

    distance = max(half // PLACES, 1)
    best = min(range(0, half + 1, distance), key=error)
    while distance > 1:
        distance = (distance + 1) // 2
        best = min((best, best - distance, best + distance), key=error)
    if error(0) <= error(best) * (1 + CHANCE / sum(map(len, pieces))):
        best = 0
    a, end, _ = known[best]
    if not 0 < a < 1:
        return None
    lasting, rest = -1 / np.log(a), _rest(pieces[0], best)
    scale = _scale(pieces[0], best, a, end) / (end - rest)
    begins = lasting * np.log(scale) if scale > 0 else best
    return Step(end / float(u[0, 0]), float(lasting * record.dt), best, float(record.times[0] + record.dt * begins))


def _rest(y: Array, resting: int) -> float:
    """The level before the response."""
    return float(y[: resting + 1].mean())


def _fitted(pieces: list[Array], resting: int) -> tuple[float, float, float]:
    """a and y∞ of the responses after some samples at rest, and the mean squared error of their simulation."""
    ends = [piece[resting + 1 :] if resting else piece for piece in pieces]
    past, now = (np.concatenate([end[part] for end in ends]) for part in (slice(-1), slice(1, None)))
    instrument, a, b, error = past, 0.0, 0.0, np.inf
    for _ in range(ITERATIONS):
        table = np.column_stack([past, np.ones(len(past))])
        other = np.column_stack([instrument, np.ones(len(past))])
        try:
            a, b = np.linalg.solve(other.T @ table, other.T @ now)
        except np.linalg.LinAlgError:
            break
        if not 0 < a < 1:
            return float(a), 0.0, np.inf
        runs = [_simulated(piece, resting, float(a), float(b)) for piece in pieces]
        error = float(np.mean(np.concatenate([y - run for y, run in zip(pieces, runs, strict=True)]) ** 2))
        instrument = np.concatenate([run[len(run) - len(end) : -1] for run, end in zip(runs, ends, strict=True)])
    return float(a), float(b / (1 - a)), error


def _simulated(y: Array, resting: int, a: float, b: float) -> Array:
    """(N,) at rest, and then the response."""
    end = b / (1 - a)
    first = resting + 1 if resting else 0
    response = end - _scale(y, resting, a, end) * a ** np.arange(len(y), dtype=float)
    return np.where(np.arange(len(y)) < first, _rest(y, resting), response)


def _scale(y: Array, resting: int, a: float, end: float) -> float:
    """What the response y∞ − scale·a^k has left at k = 0 to the level y∞ where it ends."""
    k = np.arange(resting + 1 if resting else 0, len(y), dtype=float)
    powers = a ** (k - k[0])
    return float((end - y[len(y) - len(k) :]) @ powers / (powers @ powers) * a ** -k[0])
