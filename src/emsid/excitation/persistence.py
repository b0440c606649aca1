"""The order of persistent excitation: how many coefficients of a linear model a signal can determine.

A signal determines n input coefficients only if no FIR filter of length n makes its output zero: u is *persistently
exciting of order n* when the rows [u(t), …, u(t−n+1)] span n dimensions [Ljung, def. 13.2]. A constant has order 1, a
sine 2, a sum of m sines 2m, a maximal-length sequence of period M order M. The order is computed from the singular
values of these rows.

References:
    Ljung, *System Identification*, 2nd ed. (1999), ch. 13.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import DataError
from emsid.excitation.checks import as_record, whole
from emsid.record import Record, segments

Array = NDArray[np.float64]

# The parts of a record, and how many of them are left out as transient.
_PARTS, _TRANSIENTS = 8, 2
# Above this tolerance the covariance of the rows is accurate enough.
_COARSE = 1e-6
# Rows that are triangularised at a time.
_BLOCK = 4096


def persistent_excitation_order(signal: Record | ArrayLike, max_order: int = 50, tolerance: float = 1e-10) -> int:
    """Largest n up to ``max_order`` for which the rows [u(t), u(t−1), …, u(t−n+1)] have full column rank n·nu.

    Orthogonal transformations reduce the rows to one triangular R; its rank is the number of singular values
    σ > tolerance·σ_max. Working on the rows instead of their covariance keeps all digits. For a coarse tolerance the
    covariance suffices and is much faster. The order is defined for infinite signals; three steps make a finite record
    give the same order:

    - *Transients are left out.* A step excites only at one instant; apart from it, it is a constant, of order 1. So the
      record is cut into eight equal parts, no row crosses a part or a segment, and the two parts of highest rank are
      left out.
    - *The rows are as long as the record allows.* Longer rows do not raise the rank of a sum of sines, but they
      separate slow sines much better than rows of n samples. This holds for one channel.
    - *Every 2nd, 4th, … sample is tried as well.* This does not raise the rank of a sum of sines either, and slow sines
      become faster. It is done for one channel only: with several, it would separate inputs that follow each other.

    If the result equals `largest_order`, the true order may be higher. A mean adds one.

    Args:
        signal: (N,) samples, (N, nu) channels, or a record, whose inputs count. Each channel is scaled to peak 1.
        max_order: the largest order to look for; it is returned for a signal that excites every order.
        tolerance: smallest singular value, as a fraction of the largest, that counts. 1e-10 suits a computed
            signal. For a measured one, use its noise-to-signal ratio, since noise excites every order: 1e-3 is above
            the rounding of a 12-bit converter.

    Raises:
        DataError: for a signal without channels or samples, or a bad order or tolerance.

    Source: Ljung, section 13.2.

    >>> t = np.arange(200)
    >>> persistent_excitation_order(np.sin(0.3 * t) + 0.1 * np.cos(t))
    4
    >>> persistent_excitation_order(t > 50)
    1
    """
    record = as_record(signal)
    if not 0 < tolerance < 1:
        raise DataError(f"a tolerance of {tolerance}; give a number between 0 and 1")
    peak = np.max(np.abs(record.input), axis=0, initial=0.0)
    if not peak.size:
        raise DataError(f"{record.name}: no input channel; name the one that excites the system")
    largest = whole(max_order, "largest order")
    if not np.all(peak > 0):
        return 0
    parts = _parts([segment.input / peak for segment in segments(record)])
    n = _largest_order(parts, largest)
    if not n:
        return 0
    factors = [_factor(part, n, tolerance) for part in parts]
    steady = sorted(range(_PARTS), key=lambda k: _rank(factors[k], tolerance))[:-_TRANSIENTS]
    factor = _triangularised(np.concatenate([factors[k] for k in steady]))
    if len(peak) > 1:
        full = (k for k in range(n, 0, -1) if _rank(factor[:, : k * len(peak)], tolerance) == k * len(peak))
        return next(full, 0)
    order = _rank(factor, tolerance)
    parts = [parts[k] for k in steady]
    while max(order, 1) < n:
        parts = [[piece[::2] for piece in part] for part in parts]
        n = _largest_order(parts, n)
        if n > order:
            order = max(order, _rank(_factor([piece for part in parts for piece in part], n, tolerance), tolerance))
    return order


def largest_order(signal: Record | ArrayLike, max_order: int = 50) -> int:
    """The highest order of persistent excitation up to ``max_order`` that a record of this length can show.

    At this order n every eighth of the record holds n rows: about N/16 for up to three channels.

    Args:
        signal: (N,) samples, (N, nu) channels, or a record, whose inputs count.
        max_order: the largest order to look for.
    """
    pieces = [segment.input for segment in segments(as_record(signal))]
    return _largest_order(_parts(pieces), whole(max_order, "largest order"))


def _parts(pieces: Sequence[Array]) -> list[list[Array]]:
    """Pieces without a gap (N, nu), cut into equal parts of the record."""
    ends = np.cumsum([len(piece) for piece in pieces])
    cuts = [k * int(ends[-1]) // _PARTS for k in range(_PARTS + 1)]
    return [
        [
            piece[max(begin - (end - len(piece)), 0) : stop - (end - len(piece))]
            for piece, end in zip(pieces, ends.tolist(), strict=True)
            if end - len(piece) < stop and begin < end
        ]
        for begin, stop in pairwise(cuts)
    ]


def _largest_order(parts: Sequence[Sequence[Array]], largest: int) -> int:
    """The largest n for which every part has n rows of n samples; above three channels, n·nu/3 rows."""
    width = max((piece.shape[1] for part in parts for piece in part), default=0)

    def suffices(n: int) -> bool:
        return all(sum(max(0, len(piece) - n + 1) for piece in part) >= n * max(1.0, width / 3) for part in parts)

    order, beyond = 0, largest + 1  # the condition is monotonic in n, so bisection works
    while beyond - order > 1:
        middle = (order + beyond) // 2
        order, beyond = (middle, beyond) if suffices(middle) else (order, middle)
    return order


def _rank(factor: Array, tolerance: float) -> int:
    sigma = np.linalg.svd(factor, compute_uv=False)
    return int(np.count_nonzero(sigma > tolerance * sigma[0])) if sigma.size else 0


def _factor(pieces: Sequence[Array], n: int, tolerance: float) -> Array:
    """A matrix F with the FᵀF, and so the singular values, of the rows of n samples each of all pieces (N, nu)."""
    if tolerance < _COARSE:
        return _triangular_factor(pieces, n)
    power, directions = np.linalg.eigh(sum(_covariance(piece, n) for piece in pieces if len(piece) >= n))
    return np.asarray(np.sqrt(np.maximum(power, 0.0))[:, None] * directions.T)


def _covariance(piece: Array, n: int) -> Array:
    """The sum of rowᵀ·row over the rows of n samples each of a piece (N, nu).

    Its blocks are C(i, j) = Σₜ u(t+i)ᵀ u(t+j) over all rows t, so that C(i+1, j+1) is C(i, j) without its
    first term and with one more at the end.
    """
    rows, width = len(piece) - n + 1, piece.shape[1]
    c = np.empty((n, width, n, width))
    for j in range(n):
        c[0, :, j] = piece[:rows].T @ piece[j : j + rows]
    for i in range(1, n):
        gone, come = np.outer(piece[i - 1], piece[: n - 1]), np.outer(piece[i - 1 + rows], piece[rows : rows + n - 1])
        c[i, :, 1:] = c[i - 1, :, :-1] + (come - gone).reshape(width, n - 1, width)
        c[i, :, 0] = c[0, :, i].T
    return c.reshape(n * width, n * width)


def _triangular_factor(pieces: Sequence[Array], n: int) -> Array:
    """R of the rows of n samples each of all pieces (N, nu), computed block by block."""
    width = n * pieces[0].shape[1]
    r: Array = np.zeros((0, width))
    for piece in pieces:
        if len(piece) < n:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(piece, n, axis=0).transpose(0, 2, 1)
        for begin in range(0, len(windows), _BLOCK):
            rows = windows[begin : begin + _BLOCK].reshape(-1, width)
            r = _triangularised(np.concatenate([r, rows]))
    return r


def _triangularised(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)
