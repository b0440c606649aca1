"""How one signal follows another: influence, delay, sign.

A signal u *influences* y if past values of u improve the one-step prediction of y from its own past (Granger, 1969).
The delay is the first lag at which the prewhitened input is correlated with the output, filtered in the same way
(Ljung, sec. 6.1). Where that is not clear and the input changes in steps, the delay is read from the steps, as an
engineer does: the time until the output leaves its band before the step. Otherwise means over several samples are
correlated. The delay has no upper limit but the length of the record.

References:
    Granger, C. W. J. (1969). Investigating causal relations by econometric models. Econometrica 37(3), 424–438.
    Ljung, L. (1999). System Identification: Theory for the User, 2nd ed., section 6.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.filtering import filtered
from emsid.estimation.rounding import runs
from emsid.first_look.levels import CLEAR, LAGS, PART, SAME, SAMPLES
from emsid.validation.correlation import cross_correlation

Array = NDArray[np.float64]

WHITENING, LONGEST_FILTER = 10, 100
"""Coefficients of the filter that whitens an input: for one that changes at every sample, and for one that is held. An
input that is held for the first number of samples on average changes in steps."""
LARGEST_STEP = 20.0
"""An input is held, with noise or without, where its largest step is larger than the median by this factor."""
ROUNDS = 5
"""Of a prediction without the steps of a signal; from the second on it changes little."""
UNDONE = 0.5
"""Two values undo the effect of each other where the sum of their coefficients is below this share of the sizes."""
LONG_PAST = 2 * WHITENING
"""Past inputs from which an input is predicted, to see what is new in it."""


@dataclass(frozen=True)
class Response:
    """How an output follows an input.

    Attributes:
        delay: samples from the input to the first effect; None where no effect is seen.
        sign: 1 or −1, that of the output for a positive input; 0 where it is not clear.
        correlation: of the output or of its change with the delayed input, whichever is larger.
        resolution: samples over which means were taken to see the delay.
    """

    delay: int | None
    sign: int
    correlation: float
    resolution: int = 1


def influence(u: Array, y: Array) -> float:
    """The share of the one-step prediction error of y (N,) that past values of u (N,) remove, from 0 to 1.

    Rows with a missing value (NaN) are left out.
    """
    u, y = _middle(u), _middle(y)
    rows = np.arange(LAGS, len(y))
    own, other = (_past(x, rows, LAGS) for x in (y, u))
    table = np.column_stack([np.ones(len(rows)), own, other, y[rows]])
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) < 4 * table.shape[1] or not np.ptp(table[:, -1]):
        return 0.0
    table[:, 1:] = (table[:, 1:] - table[:, 1:].mean(axis=0)) / np.where(np.ptp(table[:, 1:], axis=0) > 0, 1, np.inf)
    scale = table.std(axis=0)
    table = table / np.where(scale > 0, scale, 1.0)
    alone, both = (_unexplained(table[:, :n], table[:, -1]) for n in (1 + LAGS, 1 + 2 * LAGS))
    if alone < 1e-10:  # the past of y predicts it to rounding
        return 0.0
    gain = 1 - both / alone
    chance = LAGS / (len(table) - 2 * LAGS)
    return float(np.clip((gain - 3 * chance) / (1 - 3 * chance), 0.0, 1.0))


def at_once(u: Array, y: Array, sign: int) -> float:
    """The share of the one-step prediction error of y (N,), from the past of both, that u (N,) of the same row removes.

    It is zero where the coefficient of that value has another sign than the response, as that of a controller has, or
    where later inputs undo most of its effect, as those of an interference do.

    Args:
        u, y: the signals; rows with a missing value (NaN) are left out.
        sign: of the response of y to u.
    """
    u, y = _middle(u), _middle(y)
    rows = np.arange(LAGS, len(y))
    table = np.column_stack([u[rows], _past(u, rows, LAGS), _past(y, rows, LAGS), np.ones(len(rows)), y[rows]])
    table = table[np.isfinite(table).all(axis=1)]
    if len(table) < 4 * table.shape[1] or not np.ptp(table[:, 0]) or not np.ptp(table[:, -1]):
        return 0.0
    estimate = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=1e-9)[0]
    effects = estimate[:2]
    if effects[0] * sign <= 0 or abs(effects.sum()) < UNDONE * np.abs(effects).sum():
        return 0.0
    without = _unexplained(table[:, 1:-1], table[:, -1])
    return 1 - float(np.mean((table[:, -1] - table[:, :-1] @ estimate) ** 2)) / without if without > 0 else 0.0


def acts_in_its_own_row(u: Array, y: Array, sign: int) -> bool:
    """Whether a held input u (N,) moves y (N,) in its own row already, so that it is written after it began to act.

    Args:
        u, y: the signals; rows with a missing value (NaN) are left out.
        sign: of the response of y to u.
    """
    steps = np.abs(np.diff(u[np.isfinite(u)]))
    return bool(np.max(steps, initial=0.0) > LARGEST_STEP * np.median(steps)) and at_once(u, y, sign) > PART


def feedback(u: Array, y: Array, sign: int | None) -> float:
    """The largest correlation of the unpredictable part of an input u (N,) with earlier errors of y (N,), from 0 to 1.

    Without feedback, what is new in the input has nothing to do with the disturbances of the output. In the same sample
    an output that answers at once has the sign of its response; a controller gives the input the other one.

    Args:
        u, y: the signals.
        sign: of the response of an output that may answer at once, 0 where it is not known; None where it cannot.
    """
    u, y = _middle(u), _middle(y)
    rows = np.arange(LONG_PAST, len(y))
    if len(rows) < 6 * LONG_PAST:
        return 0.0
    past_u, past_y = (_past(x, rows, LONG_PAST // 2) for x in (u, y))
    error = _residual(np.hstack([np.ones((len(rows), 1)), past_u, past_y]), y[rows])
    moving = np.mean(np.diff(u) == 0) < PART  # steps of a reference hide what answers the output in between
    new, error = (_new(u, ROUNDS), _clipped(error)) if moving else (_new(u), error)
    if new.std() < 1e-6 * u.std() or error.std() < 1e-9 * y.std():
        return 0.0
    lags = range(LONG_PAST // 2)
    found = [float(np.corrcoef(error[: len(error) - lag], new[lag:])[0, 1]) for lag in lags]
    if sign is not None and found[0] * sign >= 0:
        found[0] = 0.0
    largest = float(np.max(np.abs(found)))
    return largest if largest > CLEAR / np.sqrt(len(rows)) else 0.0


def _past(x: Array, rows: NDArray[np.int64], lags: int) -> Array:
    """(rows, lags) the values of a signal before these samples."""
    return np.column_stack([x[rows - lag] for lag in range(1, lags + 1)])


def _new(x: Array, rounds: int = 0) -> Array:
    """(N − `LONG_PAST`,) what the past of a signal (N,) does not predict.

    Args:
        x: the signal.
        rounds: of repeating the prediction without the samples that it misses most, whose errors are clipped then.
    """
    rows = np.arange(LONG_PAST, len(x))
    table = np.hstack([np.ones((len(rows), 1)), _past(x, rows, LONG_PAST)])
    new = _residual(table, x[rows])
    for _ in range(rounds):
        near = _clipped(new) == new
        new = x[rows] - table @ np.linalg.lstsq(table[near], x[rows][near], rcond=None)[0]
    return _clipped(new) if rounds else new


def _clipped(x: Array) -> Array:
    """A signal without its extremes, at four standard deviations of its middle."""
    limit = 4 * 1.4826 * float(np.median(np.abs(x - np.median(x))))
    return np.clip(x, -limit, limit) if limit > 0 else x


def response(u: Array, y: Array, breaks: Sequence[int], integrates: bool = False) -> Response:
    """Delay and sign of the response of y (N,) to u (N,).

    Args:
        u, y: without missing values.
        breaks: the first sample of every segment but the first.
        integrates: whether y is a position, whose change answers the input.
    """
    if not (np.ptp(u) > 0 and np.ptp(y) > 0) or len(u) < 4 * WHITENING:
        return Response(None, 0, 0.0)
    change = np.concatenate([np.diff(piece, prepend=piece[:1]) for piece in np.split(y, list(breaks))])
    measured, y = y, change if integrates else y

    def related_at(delay: int) -> float:
        """A position lags behind its input by a quarter of a period, so that only its change has a sign."""
        return max((correlation(u, x, breaks, delay) for x in (measured, change)), key=abs)

    scale = 1
    while len(u) >= 8 * WHITENING * scale:
        found = _from_correlation(*_means(u, y, breaks, scale))
        if scale == 1:
            found = found or _from_steps(u, y, breaks)
        if found is not None:
            delay, sign = found
            delay *= scale
            related = related_at(delay)
            return Response(delay, int(np.sign(related)) if abs(related) > 0.2 else sign, related, scale)
        scale *= 2
    related = correlation(u, y, breaks, 0)
    if abs(related) < 0.5:
        return Response(None, 0, related)
    return Response(_best_lag(u, y), int(np.sign(related)), related)


def _best_lag(u: Array, y: Array) -> int:
    """The lag at which one past input improves the one-step prediction of y most; for short and smooth signals."""
    u, y = _middle(u), _middle(y)
    most = max(2, min(50, len(y) // 10))
    rows = np.arange(most, len(y))
    own = [np.ones(len(rows)), y[rows - 1], y[rows - 2]]
    errors = [_unexplained(np.column_stack([*own, u[rows - lag]]), y[rows]) for lag in range(most)]
    return int(np.argmin(errors))


def _from_steps(u: Array, y: Array, breaks: Sequence[int]) -> tuple[int, int] | None:
    """Delay and sign of the responses to steps of an input that is held in between; None where it is not.

    A response begins where the output leaves its range before the step for at least two samples. A step before which
    the output still moves is left out.
    """
    starts, lengths = runs(u)
    held = lengths >= WHITENING
    if float(lengths.mean()) < WHITENING or np.count_nonzero(held) < 2:
        return None
    smallest = 0.25 * float(np.max(np.abs(np.diff(u))))
    resolution = 1.01 * float(np.min(np.diff(np.unique(y))))
    delays, signs = [], []
    for k in np.flatnonzero(held[1:] & held[:-1]) + 1:
        start, stop = int(starts[k]), int(starts[k] + lengths[k])
        before = y[max(start - max(WHITENING, min(int(lengths[k - 1]) // 2, 50)), 0) : start]
        if abs(u[start] - u[start - 1]) < smallest or any(start - len(before) < b <= stop for b in breaks):
            continue
        early, late = np.array_split(before, 2)
        if abs(late.mean() - early.mean()) > max(resolution, 2 * PART * float(np.ptp(before))):
            continue
        slack = max(resolution, 0.5 * float(np.ptp(before)), SAME * float(np.ptp(y)))
        after = y[start:stop]
        away = np.where(after > before.max() + slack, 1, np.where(after < before.min() - slack, -1, 0))
        lasting = np.flatnonzero((away[:-1] == away[1:]) & (away[1:] != 0))
        if len(lasting):
            delays.append(int(lasting[0]))
            signs.append(int(away[lasting[0]] * np.sign(u[start] - u[start - 1])))
    if not delays or len(delays) < 0.2 * np.count_nonzero(held[1:] & held[:-1]):
        return None
    agreement = float(np.mean(signs))
    if abs(agreement) < 0.5:
        return None
    return int(np.median(delays)), int(np.sign(agreement))


def _from_correlation(u: Array, y: Array, breaks: Sequence[int]) -> tuple[int, int] | None:
    """Delay and sign by the prewhitened correlation; None where it is not clear."""
    filter = _whitening(u)
    white, filtered = (
        np.concatenate([_filtered(filter, piece) for piece in np.split(x, list(breaks))]) for x in (u, y)
    )
    longest = max(len(piece) for piece in np.split(u, list(breaks)))
    lags = max(min(longest // 4, SAMPLES), 1)
    shares = cross_correlation(filtered, white, breaks, lags)
    shares = shares[len(shares) // 2 :]
    peak = float(np.max(np.abs(shares), initial=0.0))
    if peak < CLEAR:
        return None
    first = int(np.flatnonzero(np.abs(shares) > max(CLEAR, PART * peak))[0])
    return first, int(np.sign(shares[first : first + 3].sum()))


def _means(u: Array, y: Array, breaks: Sequence[int], scale: int) -> tuple[Array, Array, list[int]]:
    """Means over ``scale`` samples of every segment, and the first mean of every segment but the first."""
    if scale == 1:
        return u, y, list(breaks)
    pieces = [
        [x[: len(x) // scale * scale].reshape(-1, scale).mean(axis=1) for x in np.split(signal, list(breaks))]
        for signal in (u, y)
    ]
    lengths = [len(piece) for piece in pieces[0] if len(piece)]
    edges = [int(edge) for edge in np.cumsum(lengths)[:-1]]
    return np.concatenate(pieces[0]), np.concatenate(pieces[1]), edges


def correlation(u: Array, y: Array, breaks: Sequence[int], delay: int) -> float:
    """The correlation of y with u some samples earlier, or soon after that, whichever is largest."""
    best = 0.0
    pieces = list(zip(np.split(u, list(breaks)), np.split(y, list(breaks)), strict=True))
    for more in (0, 1, 2, 4, 8, 16, 32, 64, 128):
        lag = delay + more
        pairs = [(a[: len(a) - lag], b[lag:]) for a, b in pieces if len(a) > lag + 10]
        if not pairs:
            break
        a, b = (np.concatenate(side) for side in zip(*pairs, strict=True))
        if np.ptp(a) > 0 and np.ptp(b) > 0:
            found = float(np.corrcoef(a, b)[0, 1])
            best = found if abs(found) > abs(best) else best
    return best


def _middle(x: Array) -> Array:
    start = max(0, (len(x) - SAMPLES) // 2)
    return x[start : start + SAMPLES]


def _unexplained(regressors: Array, target: Array) -> float:
    """The mean square of what a least-squares fit leaves."""
    return float(np.mean(_residual(regressors, target) ** 2))


def _residual(regressors: Array, target: Array) -> Array:
    """What a least-squares fit leaves."""
    estimate = np.linalg.lstsq(regressors, target, rcond=1e-9)[0]
    return np.asarray(target - regressors @ estimate)


def _whitening(u: Array) -> Array:
    """The coefficients 1, a₁, … of a filter that whitens u, an autoregression with a little regularisation."""
    x = np.diff(_middle(u))
    changes = max(int(np.count_nonzero(x)), 1)
    order = min(max(WHITENING, 5 * len(x) // changes), LONGEST_FILTER, len(x) // 4)  # five times as long as it is held
    rows = np.arange(order, len(x))
    past = np.column_stack([x[rows - lag] for lag in range(1, order + 1)])
    gram = past.T @ past
    ridge = 1e-4 * float(np.trace(gram)) / order
    if not ridge > 0:
        return np.ones(1)
    estimate = np.linalg.solve(gram + ridge * np.eye(order), past.T @ x[rows])
    return np.concatenate([[1.0], -estimate])


def _filtered(filter: Array, x: Array) -> Array:
    """The differences of a piece through the filter."""
    return filtered(filter, 1.0, np.diff(x, prepend=x[:1]))
