r"""Rational filters over rows of signals, compiled.

    A(q) y(t) = B(q) x(t)        A = 1 + a₁q⁻¹ + …,  B = b₀ + b₁q⁻¹ + …

in the transposed direct form, from a state of zero. `scipy.signal` does the same, but takes most of a second to import.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit

Array = NDArray[np.float64]


def filtered(above: ArrayLike, below: ArrayLike, signals: ArrayLike) -> Array:
    """The signals (N,) or (k, N) through B/A, before which they were zero.

    Args:
        above: (≥ 1,) b₀, b₁, …
        below: (≥ 1,) the leading coefficient of A, which is not zero, and a₁, a₂, …
        signals: each row is filtered on its own.
    """
    b, a = _equally_long(above, below)
    values = np.array(signals, dtype=float, order="C")
    rows = values.reshape(-1, values.shape[-1])
    filter_rows(b, a, rows, rows, np.zeros((len(rows), len(a) - 1)))
    return values


def filtered_from(above: ArrayLike, below: ArrayLike, signals: ArrayLike, states: ArrayLike) -> tuple[Array, Array]:
    """The signals (N,) or (k, N) through B/A from a state, and the state after them.

    Args:
        above, below: as in `filtered`; n is the larger of their orders.
        signals: each row is filtered on its own.
        states: (n,) or (k, n) of the transposed direct form; see `past_state`.
    """
    b, a = _equally_long(above, below)
    values, after = np.array(signals, dtype=float, order="C"), np.array(states, dtype=float, order="C")
    rows = values.reshape(-1, values.shape[-1])
    filter_rows(b, a, rows, rows, after.reshape(len(rows), -1))
    return values, after


def filtered_both_ways(above: ArrayLike, below: ArrayLike, signals: ArrayLike, padding: int) -> Array:
    """The signals (N,) or (k, N) through B/A forwards and then backwards, so that nothing is delayed.

    Beyond its ends a signal is continued point-symmetrically, from the steady state of the filter there.

    Args:
        above, below: as in `filtered`, with a finite gain at rest.
        signals: each row is filtered on its own.
        padding: samples beyond each end, fewer than N.

    References:
        Gustafsson, *Determining the initial states in forward-backward filtering*, IEEE Trans. Signal Processing 44
        (1996).
    """
    b, a = _equally_long(above, below)
    x = np.asarray(signals, dtype=float)
    before, after = 2 * x[..., :1] - x[..., padding:0:-1], 2 * x[..., -1:] - x[..., -2 : -padding - 2 : -1]
    whole = np.concatenate([before, x, after], axis=-1)
    at_rest = np.cumsum((b[1:] - a[1:] * (b.sum() / a.sum()))[::-1])[::-1]
    for _ in range(2):
        whole = filtered_from(b, a, whole, at_rest * whole[..., :1])[0][..., ::-1]
    return np.asarray(whole[..., padding : padding + x.shape[-1]])


def past_state(above: ArrayLike, below: ArrayLike, outputs: ArrayLike, inputs: ArrayLike) -> Array:
    """(n,) the state of a filter after these outputs and inputs (≥ n,), the newest last."""
    b, a = _equally_long(above, below)
    y, u, n = np.asarray(outputs, dtype=float)[::-1], np.asarray(inputs, dtype=float)[::-1], len(a) - 1
    return np.array([b[k + 1 :] @ u[: n - k] - a[k + 1 :] @ y[: n - k] for k in range(n)])


def _equally_long(above: ArrayLike, below: ArrayLike) -> tuple[Array, Array]:
    a, b = np.atleast_1d(np.asarray(below, dtype=float)), np.atleast_1d(np.asarray(above, dtype=float))
    both = np.zeros((2, max(len(a), len(b))))
    both[0, : len(b)], both[1, : len(a)] = b / a[0], a / a[0]
    return both[0], both[1]


LARGEST = 0.999
"""A root that is mirrored ends at most this far out, relative to the circle."""


@njit(nogil=True, fastmath={"contract"})
def filter_rows(b: Array, a: Array, rows: Array, out: Array, states: Array) -> None:
    """Filter every row (k, N) by B/A into ``out``, which may be ``rows``; a faster `lfilter`.

    Each step of a recursion waits for the previous one, so four rows are computed in parallel.

    Args:
        b, a: (s + 1,) in q⁻¹; ``a[0]`` is one.
        rows: (k, N) the signals.
        out: (k, N) the results.
        states: (k, s) the initial states of the transposed direct form; overwritten by the final ones.
    """
    count, samples = rows.shape
    order = len(a) - 1
    state = np.zeros((order + 1, 4))
    x, y = np.zeros(4), np.zeros(4)
    for first in range(0, count, 4):
        width = min(4, count - first)
        for j in range(width):
            for i in range(order):
                state[i, j] = states[first + j, i]
        for t in range(samples):
            for j in range(width):
                x[j] = rows[first + j, t]
            for j in range(4):
                y[j] = b[0] * x[j] + state[0, j]
            for i in range(order):
                for j in range(4):
                    state[i, j] = b[i + 1] * x[j] - a[i + 1] * y[j] + state[i + 1, j]
            for j in range(width):
                out[first + j, t] = y[j]
        for j in range(width):
            for i in range(order):
                states[first + j, i] = state[i, j]


def is_stable(denominator: Sequence[float], radius: float = 1.0) -> bool:
    """Whether the roots of 1 + a₁q⁻¹ + … + aₙq⁻ⁿ lie within a circle, by the recursion of Schur and Cohn.

    It takes a tenth of the time of the roots themselves.

    Args:
        denominator: (n,) a₁, a₂, …
        radius: of the circle.
    """
    a = [coefficient / radius**k for k, coefficient in enumerate(denominator, start=1)]
    while a:
        *before, reflection = a
        if not abs(reflection) < 1.0:
            return False
        rest = 1.0 - reflection * reflection
        a = [(one - reflection * other) / rest for one, other in zip(before, reversed(before), strict=True)]
    return True


def mirrored(polynomial: Sequence[float] | Array) -> Array:
    """A polynomial 1 + a₁q⁻¹ + … with its roots mirrored into the unit circle, and those on it moved inside."""
    roots = np.roots(np.asarray(polynomial, dtype=float))
    if not len(roots):
        return np.ones(1)
    size = np.maximum(np.abs(roots), 1e-300)
    inside = roots * np.where(size >= 1.0, np.minimum(1 / size, LARGEST) / size, 1.0)
    return np.real(np.poly(inside))


def spectrum(x: Array, y: Array, size: int) -> NDArray[np.complex128]:
    """(size//2 + 1,) the one-sided cross spectrum of y after x, without a scale, by Welch's method.

    Pieces of ``size`` samples overlap by half; each has its mean removed and a Hann window. The frequencies are those
    of `numpy.fft.rfftfreq`.

    Args:
        x, y: (N,) with at least ``size`` samples; x twice gives the power spectrum.
        size: samples of a piece.
    """
    window = np.sin(np.pi * np.arange(size) / size) ** 2 if size > 1 else np.ones(1)
    step = max(size - size // 2, 1)

    def pieces(signal: Array) -> NDArray[np.complex128]:
        cut = np.lib.stride_tricks.sliding_window_view(signal, size)[::step]
        return np.asarray(np.fft.rfft(window * (cut - cut.mean(axis=1, keepdims=True)), axis=1))

    of_x = pieces(x)
    cross = np.mean(of_x.conj() * (of_x if y is x else pieces(y)), axis=0)
    cross[1 : len(cross) - (size % 2 == 0)] *= 2
    return np.asarray(cross)


def coherence(x: Array, y: Array, size: int) -> Array:
    """(size//2 + 1,) the part of the power of y that a linear relation to x explains; NaN where one has no power."""
    with np.errstate(divide="ignore", invalid="ignore"):
        powers = spectrum(x, x, size).real * spectrum(y, y, size).real
        return np.asarray(np.abs(spectrum(x, y, size)) ** 2 / powers)
