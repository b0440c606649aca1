"""Where an output is at rest, and the input that it takes to move it.

A speed is close to zero at rest, but also for a moment in every reversal and between two moves. At rest it stays at one
value; in a reversal it passes through, and the input at that moment brakes or accelerates and shows no dead zone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.levels import FEW, PART, SAME

Array = NDArray[np.float64]

FLAT = 0.05
"""The largest standard deviation in the middle of a rest, as a share of the limit of what is close to zero."""
NOISE = 1.5
"""The same, in standard deviations of the noise."""
FEWEST_RESTS, CONTRADICTIONS = 5, 0.15
"""Rests from which a break-away is found; the largest share of inputs that contradict it."""


def near_zero(y: Array) -> NDArray[np.bool_]:
    """Whether an output is close to zero, (N,).

    Args:
        y: (N,) the output.
    """
    return np.asarray(np.abs(y) <= SAME * np.max(np.abs(y)))


def returns_to_zero(y: Array) -> bool:
    """Whether an output (N,) comes back to zero several times and keeps its sign, as a magnitude does."""
    largest = float(y[np.argmax(np.abs(y))])
    height = y / largest if largest else y
    clear = height[(height < PART) | (height > 2 * PART)]
    returns = np.count_nonzero((clear[:-1] > PART) & (clear[1:] < PART))
    return bool(np.min(height) > -PART and returns >= FEW)


def at_rest(y: Array) -> NDArray[np.bool_]:
    """Whether an output stays close to zero at one value, noise apart, (N,).

    The first and the last quarter of every stretch close to zero may still move. In the middle half of a stretch in
    which the output turns around, its standard deviation is 8 % of the limit; in a constant passage it is 29 %.

    Args:
        y: (N,) the output.
    """
    close = near_zero(y)
    starts, ends = _stretches(close)
    quarter = (ends - starts) // 4
    deviation = _deviation(np.where(close, y, 0.0), starts + quarter, ends - quarter)
    largest = max(FLAT * SAME * float(np.max(np.abs(y))), NOISE * _noise(y))
    rests = (deviation <= largest) & (ends - starts >= FEW)
    edges = np.zeros(len(y) + 1, dtype=np.int64)
    edges[starts[rests]] += 1
    edges[ends[rests]] -= 1
    return np.asarray(np.cumsum(edges[:-1]) > 0)


def _stretches(where: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first sample of every stretch that is true, and the one after its last, (K,) each."""
    edges = np.diff(np.concatenate([[0], where.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _deviation(y: Array, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> Array:
    """The standard deviation in every stretch, (K,); each has a sample at least."""
    sums, squares = (np.concatenate([[0.0], np.cumsum(x)]) for x in (y, y**2))
    count = ends - starts
    mean = (sums[ends] - sums[starts]) / count
    return np.asarray(np.sqrt(np.maximum((squares[ends] - squares[starts]) / count - mean**2, 0.0)))


def _noise(y: Array) -> float:
    """The standard deviation of white noise in y (N,), by its second differences, robust against steps."""
    return float(np.median(np.abs(np.diff(y, 2)))) / (0.6745 * np.sqrt(6)) if len(y) > 2 else 0.0


def breakaway(u: Array, resting: NDArray[np.bool_], delay: int) -> float | None:
    """The largest input that does not move the output from rest; None where the data do not show it.

    In every rest, inputs that did not end it are below the limit, and the one that did is above. The limits with the
    fewest contradictions are possible, and the lowest is taken: steps to random levels seldom end just above it. A
    motor that coasts is at rest for a small part of the samples only, though its input passes the dead zone often.

    Args:
        u: (N,) the input.
        resting: (N,) whether the output is at rest.
        delay: samples from the input to its first effect.
    """
    below, above = [], []
    for start, end in zip(*_stretches(resting), strict=True):
        moved = end - delay
        if end - start < delay + FEW or end == len(u):
            continue
        below.append(float(np.max(np.abs(u[start:moved]))))
        above.append(float(abs(u[moved])))
    if len(below) < FEWEST_RESTS:
        return None
    held, passed = np.array(below), np.array(above)
    levels = np.unique(np.concatenate([[0.0], held, passed]))
    if len(levels) < 2:  # the output came to rest and left it without any input
        return None
    limits = (levels[1:] + levels[:-1]) / 2
    wrong = np.array([np.count_nonzero(held > x) + np.count_nonzero(passed < x) for x in limits])
    best = np.flatnonzero(wrong == wrong.min())
    low, high = levels[best[0]], levels[best[-1] + 1]
    clear = wrong.min() <= CONTRADICTIONS * 2 * len(held) and high - low <= low
    return float(f"{low:.3g}") if clear else None


def dead_zone(u: Array, resting: NDArray[np.bool_]) -> float | None:
    """The input below which the output mostly rests; None where no such limit is seen.

    Args:
        u: (N,) the input.
        resting: (N,) whether the output is at rest.
    """
    size = np.abs(u)
    edges = np.quantile(size, np.linspace(0, 1, 31))
    edges = np.unique(edges)
    if len(edges) < 4 or not 0.01 < resting.mean() < 0.95:
        return None
    which = np.clip(np.searchsorted(edges, size, side="right") - 1, 0, len(edges) - 2)
    counts = np.bincount(which, minlength=len(edges) - 1)
    share = np.bincount(which, weights=resting, minlength=len(edges) - 1) / np.maximum(counts, 1)
    known = counts > 0
    share, upper = share[known], edges[1:][known]
    inside = np.flatnonzero(share > 0.5)
    if not len(inside) or inside[-1] == len(share) - 1 or inside[0] > 1:
        return None
    last = int(inside[-1])
    zone = (float(size[size < upper[last]].max()) + float(size[size >= upper[last]].min())) / 2
    clear = share[: last + 1].mean() > 0.5 and share[last + 1 :].mean() < 0.2 and zone > 0.01 * size.max()
    return float(f"{zone:.3g}") if clear else None
