r"""How much of one column another one explains: the evidence for a pair of input and output.

Every column u drives a bank of simple responses: static and of first order with time constants τ over three decades,
each also integrated, from a steady start and from rest, at several delays, and the sizes of responses without their
sign. Only a gain of any sign, and a drift of what is integrated, are fitted to a column y, on half of `STRETCHES`
stretches; the response on the other half, a free run, leaves a share λ of the variance of y. The evidence that u drives
y is, in nats,

    E = W/2 · log(λ₀/λ),      λ₀ what a straight line leaves,

where W (`BLOCKS`) counts the independent errors: all these models are wrong in detail, so more rows say no more.
A slow system is seen in means over several rows, a fast one in the rows themselves; both are tried (`SCALES`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.linear.filtering import filtered

Array = NDArray[np.float64]

MOST, FEWEST = 2000, 24
"""Rows of an excerpt: twenty time constants of a hundred. With fewer than the second, no response is fitted."""
AVERAGED, COARSEST = 8, 512
"""Rows to average for the next scale, up to so many; the time constants span a factor of 300: none falls between."""
WINDOWS = 50
"""The excerpt is one of about so many, evenly spaced."""
TIME_CONSTANTS = (0, 0.5, 1, 1.8, 3, 5.6, 10, 18, 30, 56, 100, 180, 300)
"""In rows, four a decade: one between two of them loses less than 1 % of the variance."""
DELAYS, AHEAD = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32), (-1, -2, -4, -8, -16)
"""In rows; no cause acts ahead of itself, so that a response ahead speaks for the other order."""
BLOCKS, STRETCHES = 8, 32
"""A level is free in every block, as offsets add up in a position, and each counts as one independent error; odd
stretches judge even ones, and the reverse."""
SEEN = 3.0
"""From this evidence, in nats, a response is seen: by chance one of twenty exceeds it."""
ANSWERED = 12.0
"""Of 300 columns that have nothing to do with one another, with levels held for 1 to 40 rows, 5 % were clearer; of 300
responses with as much noise as motion, 4 % were not as clear."""
FEWER = 1.0
"""Evidence, in nats, from which an output is the size of a response, as outputs without a sign are fewer. With 0, noise
without a sign responds in one record of twenty; with 3, an output about the middle of a range was lost. Of 300 columns
that have nothing to do with one another, 5.0 % are clear with sizes among the responses, and 4.7 % without."""
SAME_MOTION, LEADS = 0.95, 4
"""The share of displacements that the speed of a motion explains, and rows by which clocks of the two may differ."""
WITHIN, WITHIN_PERIODIC = 0.15, 0.5
"""Errors that differ by less are equal: the grids are coarse and records short; a periodic input shows the shape of a
response less well than the delay that is nearest to it."""
ROUGH = 0.003
"""Of the variance: what dry friction leaves of a linear model of first order at the right delay."""
EXACT = (0.03, 0.001)
"""The same two between delays of neighbouring rows, at the other one of which the noise is nearly the same."""
PERIODIC = 0.85
"""The correlation of a periodic column with itself one period later."""


@dataclass(frozen=True)
class Answer:
    """How one column answers another one.

    Attributes:
        evidence: that the other one drives it, in nats.
        left: share of its variance that the best response leaves.
        ahead: the same evidence, in nats, for the best response ahead of time over the best later one.
        integral: the evidence, in nats, that it is an integral of the response, as a position is.
        static: whether it follows without lag or delay.
        delay: the shortest delay in rows of the responses that are as good.
        gain: of that response.
        ambiguous: whether a response of the other sign is as good, or only the size of a response is seen.
        size: the evidence, in nats, that it is the size of a response, as a speed without its sign is.
        periodic: whether the other one is periodic, so that later delays are as good.
        scale: the rows that were averaged, of which the delay is a multiple.
        clear: twice the evidence by all independent rows, where the inputs are given; from `ANSWERED` on no chance.
    """

    evidence: float
    left: float
    ahead: float
    integral: float
    static: bool
    delay: int
    gain: float
    ambiguous: bool
    size: float
    periodic: bool
    scale: int
    clear: float

    @property
    def integrates(self) -> bool:
        """Whether it is rather an integral of the response than a response."""
        return self.integral > 0

    @property
    def sign(self) -> int:
        """Of its gain: 1 or −1."""
        return int(np.sign(self.gain))


def answers(
    table: Array, starts: Sequence[int] = (0,), inputs: Collection[int] | None = None
) -> Mapping[tuple[int, int], Answer]:
    """For pairs (u, y) of the columns of a table (N, k), how y answers u.

    Args:
        table: numbers without gaps, a row for each sample.
        starts: the first row of every run.
        inputs: the columns u, whose delays are found to a row and may be long; by default all columns, at `DELAYS`.
    """
    found: dict[tuple[int, int], Answer] = {}
    scale = 1
    while len(table) >= (MOST // 4 if scale > 1 else FEWEST) and scale <= COARSEST and table.shape[1] > 1:
        for pair, answer in _at_scale(*_excerpt(table, starts), scale, inputs).items():
            # a coarser scale has to be clearly better
            if pair not in found or answer.evidence > found[pair].evidence + log(1 + scale) / 2:
                found[pair] = answer
        rows = len(table) // AVERAGED
        table = table[: rows * AVERAGED].reshape(rows, AVERAGED, -1).mean(axis=1)
        starts = sorted({start // AVERAGED for start in starts if start < rows * AVERAGED})
        scale *= AVERAGED
    return found


def same_motion(speed: Array, position: Array, starts: Sequence[int], times: Array | None = None) -> bool:
    """Whether the displacements of a column (N,), within runs, are the sums of another one that does not lead them.

    Args:
        speed, position: the two columns; rows with a missing value (NaN) are left out.
        starts: the first row of every run but the first.
        times: of the rows; by default they are equidistant.
    """
    run = np.searchsorted(starts, _middle(np.arange(len(speed))), "right")
    speed, position = _middle(speed), _middle(position)
    speed = speed if times is None else speed * np.diff(_middle(times), append=np.nan)
    for width in (1, 2, 4, 8, 16, 32):  # more rows have less of the steps of an encoder
        if len(speed) <= width + FEWEST:
            break
        inside = (run[width:] == run[:-width])[LEADS:-LEADS]
        moved = (position[width:] - position[:-width])[LEADS:-LEADS]
        sums = np.convolve(speed, np.ones(width), "valid")
        pairs = [(moved, sums[LEADS + lag :][: len(moved)]) for lag in range(1 - LEADS, LEADS)]
        shares = [_correlation(a[inside], b[inside]) ** 2 for a, b in pairs]
        if max(shares) > SAME_MOTION:
            return int(np.argmax(shares)) >= LEADS - 1
    return False


def _middle(x: NDArray[Any]) -> NDArray[Any]:
    """At most `MOST` rows from the middle of a column (N,)."""
    start = max((len(x) - MOST) // 2, 0)
    return x[start : start + MOST]


def _correlation(a: Array, b: Array) -> float:
    """Of two columns, where both are known; zero where one is constant."""
    known = np.isfinite(a) & np.isfinite(b)
    if known.sum() < FEWEST or not np.ptp(a[known]) or not np.ptp(b[known]):
        return 0.0
    return float(np.corrcoef(a[known], b[known])[0, 1])


def _excerpt(table: Array, starts: Sequence[int]) -> tuple[Array, NDArray[np.intp], bool]:
    """At most `MOST` rows where most columns change most, the first rows of its runs, and whether one is the first."""
    if len(table) <= MOST:
        return table, np.asarray(starts, dtype=np.intp), True
    windows = np.arange(0, len(table) - MOST + 1, max(MOST // 2, (len(table) - MOST) // WINDOWS))
    parts = [table[k : k + MOST] for k in windows]
    spread = np.array([np.r_[part.std(axis=0), np.diff(part, axis=0).std(axis=0)] for part in parts])
    usual = np.sqrt(np.mean(spread**2, axis=0))  # of levels and of changes
    best = int(windows[np.argmax(np.minimum(spread / np.where(usual > 0, usual, 1.0), 1.0).sum(axis=1))])
    inside = [start - best for start in starts if best < start < best + MOST]
    return table[best : best + MOST], np.array([0, *inside], dtype=np.intp), best in starts


def _bank(
    u: Array, starts: NDArray[np.intp], whole: bool, delays: Sequence[int], kind: NDArray[np.void] | None = None
) -> tuple[Array, NDArray[np.void]]:
    """(A, N) the responses to a column (N,), and what each of them is.

    Args:
        u: the column.
        starts: the first row of every run.
        whole: whether the first run is there from its start, where it may be at rest while the input is not zero.
        delays: in rows; none is longer than a sixth of the rows.
        kind: of one response: only those that differ from it by time constant and delay; by default all.
    """
    run = np.searchsorted(starts, np.arange(len(u)), "right") - 1
    steady = u - u[starts][run]
    driving = {"steady": steady, "from rest": u, "square": steady * np.abs(steady)}  # a propeller answers the square
    driving["size"] = u - (u.min() + u.max()) / 2  # an output without a sign, about the middle of the input
    if not (whole and np.any(u[starts])):
        del driving["from rest"]
    rows, kinds = [], []
    delays = [delay for delay in delays if abs(delay) <= len(u) / 6]
    source = np.arange(len(u)) - np.array(delays)[:, None]
    near = np.clip(source, 0, len(u) - 1)
    inside = (source == near) & (run[near] == run)  # before that, a later response rests
    for name, v in driving.items():
        for tau in (each for each in TIME_CONSTANTS if np.any(v) and each <= len(u) / 3):
            pole = np.exp(-1 / tau) if tau else 0.0
            pieces = np.split(v, starts[1:])
            lagged = np.concatenate([filtered([1 - pole], [1, -pole], piece) for piece in pieces])
            lagged = np.abs(lagged) if name == "size" else lagged
            for integrates in (False, True)[: 1 + (name in ("steady", "from rest"))]:
                if kind is not None and not (kind["driving"] == name and kind["integrates"] == integrates):
                    continue
                x = (
                    np.concatenate([np.cumsum(piece) for piece in np.split(lagged, starts[1:])])
                    if integrates
                    else lagged
                )
                rows.append(np.where(inside, x[near], 0.0))
                kinds += [(name, integrates, tau, delay) for delay in delays]
    fields = [("driving", "U9"), ("integrates", bool), ("tau", float), ("delay", int)]
    return np.array(rows).reshape(-1, len(u)), np.array(kinds, dtype=fields)


def _edges(starts: NDArray[np.intp], n: int) -> NDArray[np.intp]:
    """The first rows of about `BLOCKS` blocks, none of which reaches over the end of a run."""
    count = max(1, round(BLOCKS / len(starts)))
    pieces = [np.linspace(a, b, count + 1)[:-1] for a, b in zip(starts, [*starts[1:], n], strict=True)]
    return np.unique(np.concatenate(pieces).astype(np.intp))


def _centred(x: Array, edges: NDArray[np.intp]) -> Array:
    """Rows (A, N) without their mean in every block."""
    sizes = np.diff([*edges, x.shape[1]])
    return np.asarray(x - np.repeat(np.add.reduceat(x, edges, axis=1) / sizes, sizes, axis=1))


def _left(x: Array, y: Array, edges: NDArray[np.intp], drifts: Array) -> tuple[Array, Array, Array]:
    """What responses leave of columns on the stretches that they were not fitted to.

    Args:
        x: (A, N) responses.
        y: (N, m) columns, centred.
        edges: the first rows of the blocks.
        drifts: (A, 1) one for a response that has a drift besides, as that of an input with an offset, else zero.

    Returns:
        (A, m) shares of the variance that are left, (m,) those that a straight line alone leaves where there is a drift
        (the same for all others), and (A, m) the gains of the fits to all rows.
    """
    x = _centred(x, edges)
    size = np.sqrt((x * x).sum(axis=1, keepdims=True)) + 1e-300
    x = x / size
    line = _centred(np.arange(len(y), dtype=float)[None] / len(y), edges)[0]
    odd = np.arange(len(y)) * STRETCHES // len(y) % 2 == 1
    sums = []
    for part in (odd, ~odd):
        xp, yp, d = x[:, part], y[part], line[part]
        sums.append(((xp * xp).sum(1)[:, None], (xp @ d)[:, None], d @ d + 1e-12, xp @ yp, d @ yp, (yp * yp).sum(0)))

    def fitted(xx: Array, xd: Array, dd: float, xy: Array, dy: Array, _: Array) -> tuple[Array, Array]:
        slope = drifts * (xx * dy - xd * xy) / (xx * dd - xd**2 + 1e-12)
        return slope, (xy - slope * xd) / (xx + 1e-12)

    left, alone = np.zeros((len(x), y.shape[1])), np.zeros(y.shape[1])
    total = sums[0][5] + sums[1][5] + 1e-300
    for own, other in (sums, sums[::-1]):
        slope, gain = fitted(*own)
        xx, xd, dd, xy, dy, yy = other
        left += yy - 2 * gain * xy - 2 * slope * dy + gain**2 * xx + 2 * gain * slope * xd + slope**2 * dd
        of_line = own[4] / own[2]
        alone += yy - 2 * of_line * dy + of_line**2 * dd
    whole = fitted(*(a + b for a, b in zip(*sums, strict=True)))[1] / size
    return np.clip(left / total, 1e-6, 1.0), np.clip(alone / total, 1e-6, 1.0), whole


def _at_scale(
    table: Array, starts: NDArray[np.intp], whole: bool, scale: int, inputs: Collection[int] | None
) -> Mapping[tuple[int, int], Answer]:
    """How the columns of an excerpt (n, k) answer each other."""
    n, count = table.shape
    edges = _edges(starts, n)
    y_all = _centred(table.T, edges).T
    moving = [k for k in range(count) if np.abs(y_all[:, k]).max() > 1e-9 * (1 + np.abs(table[:, k]).max())]
    found = {}
    for u in range(count) if inputs is None else inputs:
        others = [each for each in moving if each != u]
        longer = [] if inputs is None else _long_delays(table[:, u], y_all[:, others], starts, whole)
        x, kinds = _bank(table[:, u], starts, whole, (*DELAYS, *AHEAD, *longer))
        if not len(kinds):
            continue
        periodic = _is_periodic(y_all[:, u])
        errors, lines, gains = _left(x, y_all, edges, _drifts(kinds))
        later, sizes = kinds["delay"] >= 0, kinds["driving"] == "size"
        for y in others:
            left, gain, said = errors[:, y], gains[:, y], kinds
            signed, without_sign = (left[later & (sizes == each)].min(initial=1.0) for each in (False, True))
            size = BLOCKS / 2 * log(signed / without_sign)
            without, within = (float(left[later & (kinds["integrates"] == each)].min()) for each in (False, True))
            left = np.where(sizes == (size > FEWER), left, np.inf)
            k, equal = _shortest(said, left, periodic)
            ahead = float(left.min())
            turned = equal & (said["delay"] == said["delay"][k]) & (gain * gain[k] < 0)
            if inputs is not None:  # to a row, between the delays that were tried
                tried = np.append(np.unique(kinds["delay"]), 1 + kinds["delay"].max())
                last = k if periodic else int(np.argmin(np.where(kinds["delay"] >= 0, left, np.inf)))
                low, high = np.searchsorted(tried, kinds["delay"][[k, last]])
                near = range(max(tried[low - 1] + 1, 0), tried[max(low, high) + 1])
                x, said = _bank(table[:, u], starts, whole, near, kinds[last])
                (left,), _, (gain,) = (each.T for each in _left(x, y_all[:, [y]], edges, _drifts(said)))
                k, _ = _shortest(said, left, periodic, exact=True)
            first = int(np.argmin(np.where(said["delay"] >= 0, left, np.inf)))
            best = float(left[first])
            found[u, y] = Answer(
                evidence=BLOCKS / 2 * log(max(float(lines[y]), best) / best),
                integral=BLOCKS / 2 * log(without / within),
                left=best,
                ahead=BLOCKS / 2 * log(best / min(best, ahead)),
                static=bool(said["tau"][k] == 0 == said["delay"][k]),
                delay=int(said["delay"][k]) * scale,
                gain=float(gain[k]),
                ambiguous=bool(turned.any()) or size > FEWER,
                size=size,
                periodic=periodic,
                scale=scale,
                clear=log(max(float(lines[y]), best) / best) * _independent(x[first], y_all[:, y], edges),
            )
    return found


def _independent(x: Array, y: Array, edges: NDArray[np.intp]) -> float:
    """The number of independent rows of two columns (n,), by Bartlett's formula for their correlation."""
    n = len(x)
    one, other = (np.fft.irfft(np.abs(np.fft.rfft(each, 2 * n)) ** 2)[:n] for each in _centred(np.stack([x, y]), edges))
    alike = float(2 * (one @ other) / (one[0] * other[0] + 1e-300) - 1)
    return n / max(alike, 1.0)


def _drifts(kinds: NDArray[np.void]) -> Array:
    """(A, 1) one for a response that has a drift besides, as that of an input with an offset, else zero."""
    return np.asarray((kinds["integrates"] & (kinds["driving"] != "from rest")).astype(float)[:, None])


def _shortest(
    kinds: NDArray[np.void], left: Array, periodic: bool, *, exact: bool = False
) -> tuple[int, NDArray[np.bool_]]:
    """Of the responses (A,) as good as the best one, the best at the shortest delay, and which all of these are."""
    delay = kinds["delay"]
    within, rough = (WITHIN_PERIODIC, ROUGH) if periodic else EXACT if exact else (WITHIN, ROUGH)
    equal = (delay >= 0) & (left <= float(left[delay >= 0].min()) * (1 + within) + rough)
    # an input acts after its row, unless its own row is clearly better
    soonest = min(delay[equal].tolist(), key=lambda d: {0: 1.5, 1: 0.5}.get(d, d))
    return int(min(np.flatnonzero(equal & (delay == soonest)), key=left.__getitem__)), equal


def _long_delays(u: Array, others: Array, starts: NDArray[np.intp], whole: bool) -> list[int]:
    """Of each other column (n, m), the delay beyond `DELAYS` at which a response to u (n,) is most like it."""
    n, first = len(u), DELAYS[-1] + 1
    x = _bank(u, starts, whole, [0])[0]
    x = x - x.mean(axis=1, keepdims=True)
    spectra = np.fft.rfft(x / (np.linalg.norm(x, axis=1, keepdims=True) + 1e-300), 2 * n)
    found = []
    for y in others.T if n // 6 > first and len(x) else ():  # a bank is empty where u stays
        alike = np.abs(np.fft.irfft(np.conj(spectra) * np.fft.rfft(y, 2 * n), 2 * n)[:, first : n // 6])
        found.append(first + int(alike.max(axis=0).argmax()))
    return found


def _is_periodic(x: Array) -> bool:
    """Whether a centred column (n,) repeats itself at least three times."""
    n = len(x)
    itself = np.correlate(x, x, "full")[n - 1 :] / (x @ x + 1e-300)
    again = (itself[k] * n / (n - k) for k in range(n // 100 + 4, n // 3))
    return bool(np.any(itself[: n // 8] < 0)) and max(again, default=0.0) > PERIODIC


def share_of_controller(u: Array, r: Array, y: Array) -> float:
    """The share of what a reference r (N,) alone leaves of u (N,) that its error r − y, with sum and change, explains.

    It is 0 where y acts on u as r does. Rows with a missing value (NaN), or with u at one of its limits, are left out.
    """
    x = np.column_stack([_middle(each) for each in (u, r, y)])
    u, r, y = x[np.isfinite(x).all(axis=1)].T
    if len(u) < FEWEST:
        return 0.0
    error, free, best = r - y, (u > u.min()) & (u < u.max()), 0.0
    terms = (np.ones(len(u)), r, np.gradient(r), y, np.cumsum(error), np.gradient(error))
    scaled = np.column_stack([each / max(float(np.abs(each).max()), 1e-300) for each in terms])
    for lag in (0, 1) if np.count_nonzero(free) >= FEWEST else ():
        rows, target = np.roll(scaled, lag, axis=0)[2:][free[2:]], u[2:][free[2:]]
        alone, both = (np.linalg.lstsq(rows[:, :k], target, rcond=1e-9)[0] for k in (3, 6))
        before, after = (float(np.sum((target - rows[:, : len(c)] @ c) ** 2)) for c in (alone, both))
        if both[1] * both[3] < 0 and before > 0.01 * float(np.sum((target - target.mean()) ** 2)):
            best = max(best, 1 - after / before)
    return best
