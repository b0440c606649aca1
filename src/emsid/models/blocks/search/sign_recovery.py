r"""Sign recovery: a linear model in front of a sensor that gives magnitudes only.

The signal w(t) = ±y(t) in front of the sensor is smooth, so its sign changes only where |w| is close to zero: at
low local minima of y, which cut the record into lobes of one unknown sign sₖ each. If w obeys A(q)w = B(q)u + c, then

    min over s, θ of   Σ over lobes k, t ∈ k of   (A(q)w(t) − B(q)u(t) − c)²,      w(t) = sₖ y(t) for t in lobe k,

is solved by turns: for given signs θ is a linear least-squares problem; for given θ a lobe's share of the cost depends
on its own sign and on the one before, so the best of all 2ᴷ sequences of signs is found by dynamic programming
(Viterbi 1967). Neither turn raises the cost, and the signs, being finitely many, settle. A few random beginnings
guard against a poor one.

References:
    Viterbi, *Error bounds for convolutional codes and an asymptotically optimum decoding algorithm*, IEEE Trans.
    Information Theory 13 (1967).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.gauss_newton import least_squares_step

Array = NDArray[np.float64]
Signs = NDArray[np.intp]

# A minimum is the least of this many samples on either side, and below the median.
REACH = 2
DRAWS, MOST_TURNS = 30, 50
# Two sequences of signs are different if they disagree on more than this part of the samples.
UNLIKE = 0.1


@dataclass(frozen=True, eq=False)
class Unfolded:
    """A signal with its signs, and the regression that they agree with best.

    Attributes:
        signal: (N,) w.
        numerator: (n + 1,) B, the first coefficient zero.
        denominator: (n,) A without its leading one.
        constant: c.
        cost: sum of squares of the regression.
    """

    signal: Array
    numerator: Array
    denominator: Array
    constant: float
    cost: float


def unfoldings(u: Array, y: Array, order: int, rng: np.random.Generator, draws: int = DRAWS) -> list[Unfolded]:
    """Signs of y, and the linear regressions of this order that suit them, where the turns end; the cheapest first.

    Of those that are much alike only the cheapest is given. The truth need not come first, as the regression knows no
    filter behind the sensor.

    Args:
        u: (N,) input.
        y: (N,) output of a sensor that gives magnitudes.
        order: n of A and B.
        rng: source of the random beginnings.
        draws: how many of them.

    Raises:
        ModelError: for fewer samples than the regression needs.
    """
    if len(y) < 4 * (order + 1):
        raise ModelError(f"{len(y)} samples are too few to recover the signs with a model of order {order}")
    lobes = lobe_of_sample(y)
    found = [_settled(u, y, order, lobes, rng.choice([-1, 1], lobes[-1] + 1)) for _ in range(draws)]
    unlike: list[Unfolded] = []
    for each in sorted(found, key=lambda each: each.cost):
        if all(_disagreement(each.signal, other.signal) > UNLIKE for other in unlike):
            unlike.append(each)
    return unlike


def _disagreement(one: Array, other: Array) -> float:
    """The part of the samples on which the signs differ; all of them turned are the same system turned."""
    part = float(np.mean(one * other < 0))
    return min(part, 1 - part)


def lobe_of_sample(y: Array) -> Signs:
    """(N,) which lobe, counted from 0, every sample belongs to; a lobe begins at a low local minimum.

    The zero is between the minimum and the smaller of its neighbours, so the minimum belongs with the larger one.
    """
    padded = np.pad(y, REACH, constant_values=-np.inf)
    least = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH + 1).min(axis=1)
    low = np.flatnonzero((y == least) & (y < np.median(y)))
    low = low[(low > 0) & (low < len(y) - 1)]
    begins = np.zeros(len(y), dtype=bool)
    begins[np.where(y[low - 1] < y[low + 1], low, low + 1)] = True
    return np.cumsum(begins).astype(np.intp)


def best_signs(costs: Array) -> Signs:
    """(K,) signs of the cheapest sequence.

    Args:
        costs: (K, 2, 2) of lobe k by the sign of the one before and its own, plus first; for the first lobe the
            diagonal counts.
    """
    total, ways = costs[0].diagonal().copy(), np.zeros(costs.shape[:2], dtype=np.intp)
    for k, cost in enumerate(costs[1:], start=1):
        reached = total[:, None] + cost
        ways[k], total = reached.argmin(axis=0), reached.min(axis=0)
    path = [int(total.argmin())]
    for way in ways[:0:-1]:
        path.append(int(way[path[-1]]))
    return 1 - 2 * np.array(path[::-1], dtype=np.intp)


def _settled(u: Array, y: Array, order: int, lobes: Signs, signs: Signs) -> Unfolded:
    """The end of the turns that begin with these signs."""
    now = np.arange(order, len(y))
    past = now[:, None] - np.arange(1, order + 1)
    driven = np.column_stack([u[past], np.ones(len(now))])
    # Samples of the past that lie in another lobe than the present one change side when its sign does.
    side = np.where(lobes[past] == lobes[now][:, None], 1.0, -1.0)
    for _ in range(MOST_TURNS):
        w = signs[lobes] * y
        theta = least_squares_step(Information.from_rows(np.column_stack([-w[past], driven]), w[now]))
        a, forced = theta[:order], driven @ theta[order:]
        same, turned = y[now] + y[past] @ a, y[now] + (side * y[past]) @ a
        costs = np.empty((lobes[-1] + 1, 2, 2))
        for own, sign in enumerate((1, -1)):
            for before in (0, 1):
                error = sign * (same if own == before else turned) - forced
                costs[:, before, own] = np.bincount(lobes[now], error**2, minlength=len(costs))
        settled, signs = signs, best_signs(costs)
        if np.array_equal(settled, signs):
            break
    cost = float(np.sum((w[now] + w[past] @ a - forced) ** 2))
    return Unfolded(w, np.concatenate([[0.0], theta[order : 2 * order]]), a, float(theta[-1]), cost)
