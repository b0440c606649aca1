r"""Sign recovery: a linear model before a sensor that rectifies.

The signal w(t) = ±y(t) before the sensor is smooth, so its sign changes only where |w| is close to zero: at low local
minima of y. These cut the record into lobes, each with one unknown sign sₖ. If w obeys A(q)w = B(q)u + c, then

    min over s, θ of   Σ over lobes k, t ∈ k of   (A(q)w(t) − B(q)u(t) − c)²,      w(t) = sₖ y(t) for t in lobe k,

is solved by alternating minimisation. For given signs θ is a linear least-squares problem. For given θ the cost of a
lobe depends on its own sign and on the previous one, so dynamic programming finds the best of all 2ᴷ sign sequences
(Viterbi 1967). No step raises the cost, and the number of sequences is finite, so the signs converge. Several random
starts reduce the risk of a poor local minimum.

References:
    Viterbi, *Error bounds for convolutional codes and an asymptotically optimum decoding algorithm*, IEEE Trans.
    Information Theory 13 (1967).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.steps import least_squares_step
from emsid.record import Record

Array = NDArray[np.float64]
Signs = NDArray[np.intp]

# A local minimum is the least of this many samples on either side, and below the median.
REACH = 2
DRAWS, MOST_TURNS = 30, 50
# Two sign sequences are different if they disagree on more than this fraction of the samples.
DIFFERENT = 0.1
# An output is close to zero within this fraction of its largest value.
CLOSE = 0.05


@dataclass(frozen=True, eq=False)
class SignedSignal:
    """A signal with recovered signs, and its regression.

    Attributes:
        signal: (N,) w.
        numerator: (n + 1,) B, with a first coefficient of zero.
        denominator: (n,) A without its leading one.
        constant: c.
        cost: sum of squares of the regression.
    """

    signal: Array
    numerator: Array
    denominator: Array
    constant: float
    cost: float


def keeps_its_sign(output: Array) -> bool:
    """Whether a signal may be an absolute value with noise: it ends close to zero on one side."""
    low, high = abs(float(output.min())), abs(float(output.max()))
    return min(low, high) < CLOSE * max(low, high)


def may_be_rectified(records: Sequence[Record]) -> bool:
    """Whether outputs come close to zero without a change of sign, although the inputs have both signs."""
    u, y = (np.concatenate(each) for each in zip(*((r.input[:, 0], r.output[:, 0]) for r in records), strict=True))
    return bool(u.min() < 0 < u.max()) and keeps_its_sign(y)


def recovered_signals(u: Array, y: Array, order: int, rng: np.random.Generator) -> list[SignedSignal]:
    """Signed versions of y with their linear regressions of this order, in ascending order of cost.

    Of similar sign sequences only the one of least cost is returned. The true one need not come first, because the
    regression has no filter after the sensor.

    Args:
        u: (N,) input.
        y: (N,) output of a sensor that rectifies.
        order: n of A and B.
        rng: source of the random starts.

    Raises:
        ModelError: for fewer samples than the regression needs.
    """
    if len(y) < 4 * (order + 1):
        raise ModelError(f"{len(y)} samples are too few to recover the signs with a model of order {order}")
    lobes = lobe_of_sample(y)
    found = [_alternated(u, y, order, lobes, rng.choice([-1, 1], lobes[-1] + 1)) for _ in range(DRAWS)]
    different: list[SignedSignal] = []
    for each in sorted(found, key=lambda each: each.cost):
        if all(_disagreement(each.signal, other.signal) > DIFFERENT for other in different):
            different.append(each)
    return different


def _disagreement(one: Array, other: Array) -> float:
    """The fraction of samples with different signs; a change of all signs is no difference."""
    part = float(np.mean(one * other < 0))
    return min(part, 1 - part)


def lobe_of_sample(y: Array) -> Signs:
    """(N,) the index of the lobe of every sample, from 0; a lobe begins at a low local minimum.

    The zero is between the minimum and its smaller neighbour, so the minimum belongs to the larger one.
    """
    padded = np.pad(y, REACH, constant_values=-np.inf)
    least = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH + 1).min(axis=1)
    low = np.flatnonzero((y == least) & (y < np.median(y)))
    low = low[(low > 0) & (low < len(y) - 1)]
    begins = np.zeros(len(y), dtype=bool)
    begins[np.where(y[low - 1] < y[low + 1], low, low + 1)] = True
    return np.cumsum(begins).astype(np.intp)


def best_signs(costs: Array) -> Signs:
    """(K,) the sign sequence of least cost.

    Args:
        costs: (K, 2, 2) cost of lobe k by the previous sign and its own, plus first; the first lobe uses the diagonal.
    """
    total, predecessors = costs[0].diagonal().copy(), np.zeros(costs.shape[:2], dtype=np.intp)
    for k, cost in enumerate(costs[1:], start=1):
        reached = total[:, None] + cost
        predecessors[k], total = reached.argmin(axis=0), reached.min(axis=0)
    path = [int(total.argmin())]
    for way in predecessors[:0:-1]:
        path.append(int(way[path[-1]]))
    return 1 - 2 * np.array(path[::-1], dtype=np.intp)


def _alternated(u: Array, y: Array, order: int, lobes: Signs, signs: Signs) -> SignedSignal:
    """The result of the alternating minimisation from these signs."""
    now = np.arange(order, len(y))
    past = now[:, None] - np.arange(1, order + 1)
    driven = np.column_stack([u[past], np.ones(len(now))])
    # Past samples of another lobe have a sign of their own.
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
    return SignedSignal(w, np.concatenate([[0.0], theta[order : 2 * order]]), a, float(theta[-1]), cost)
