"""The compiled loops of a feedback model: its run, and the derivative of its output.

The run needs the value of every static map, sample by sample: compiled maps are polynomials between break points
(`Pieces`); `run_reference` calls the maps themselves, and runs those that are no polynomials. The derivative needs the
slopes of the maps along the run only, so it is compiled for maps of any kind.

With the matrix M of `FeedbackModel`, split by rows into (x⁺, z, y) and by columns into (x, u, w), the derivative of
the state with respect to a parameter θ follows from the linearised recursion

    δz  = C_z δx + (∂z/∂θ)       δg = F_x δx + (∂g/∂θ)       δw = g f′(z) δz + f(z) δg + g (∂f/∂θ)
    δx⁺ = A δx + B_w δw + (∂x⁺/∂θ)                           δy = C_y δx + D_yw δw + (∂y/∂θ)

where the derivative in brackets of a row of M·(x, u, w) with respect to an element of M is the signal that it
multiplies, and likewise for F.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.models.blocks.static_maps.static_map import StaticMap
from emsid.models.blocks.static_maps.tables import Tables as Tables
from emsid.models.blocks.static_maps.tables import tables_of as tables_of
from emsid.models.blocks.static_maps.tables import value_at

Array = NDArray[np.float64]


class LoopSignals(NamedTuple):
    """The signals of a run over K steps, written by `run`.

    Attributes:
        x: (K, n) the state before each step.
        z, w: (K, m) inputs and outputs of the maps.
        y: (K,) output.
    """

    x: Array
    z: Array
    w: Array
    y: Array

    @classmethod
    def empty(cls, steps: int, states: int, maps: int) -> LoopSignals:
        """Uninitialised arrays for a run."""
        return cls(np.empty((steps, states)), np.empty((steps, maps)), np.empty((steps, maps)), np.empty(steps))


class MapSlopes(NamedTuple):
    """What the maps give along a run over K steps, and its derivatives.

    Attributes:
        slopes: (m, K) ∂w/∂z = g f′(z).
        values: (m, K) ∂w/∂g = f(z) of maps that are multiplied by a signal, zero of others.
        gradient: (q, K) ∂w/∂θ = g ∂f/∂θ of all maps.
        owners: (q,) the map that each row of ``gradient`` belongs to.
    """

    slopes: Array
    values: Array
    gradient: Array
    owners: NDArray[np.int64]


def map_slopes(maps: Sequence[StaticMap], g: Array, multiplied: NDArray[np.int64], z: Array) -> MapSlopes:
    """The maps and their derivatives along a run.

    Args:
        maps: m static maps.
        g: (m, K) or (m, 1) the factor of each.
        multiplied: those whose factor is a signal.
        z: (K, m) their inputs.
    """
    shape, counts = z.T.shape, np.array([len(each.parameters) for each in maps], dtype=np.int64)
    slopes, values, gradient = np.empty(shape), np.zeros(shape), np.empty((counts.sum(), len(z)))
    first = 0
    for i, (each, count) in enumerate(zip(maps, counts, strict=True)):
        own = np.ascontiguousarray(z[:, i])
        np.multiply(g[i], each.slope(own), out=slopes[i])
        np.multiply(g[i], each.parameter_gradient(own), out=gradient[first : first + count])
        if i in multiplied:
            values[i] = each.value(own)
        first += count
    return MapSlopes(slopes, values, gradient, np.repeat(np.arange(len(counts)), counts))


@njit(nogil=True)
def run(matrix: Array, offsets: Array, factors: Array, tables: Tables, u: Array, state: Array, out: LoopSignals) -> int:
    """Run the model over an input.

    Args:
        matrix: (n + m + 1, n + 1 + m) M.
        offsets: (m + 1,) added to every z, and to y.
        factors: (m, n + 2) F.
        tables: of the maps.
        u: (K,) input.
        state: (n,) the state at the start; overwritten by that after the last step.
        out: receives the signals.

    Returns:
        The number of steps before a signal is not finite, K if there is none.
    """
    n, m = len(state), len(offsets) - 1
    all_x, all_z, all_w, y = out.x, out.z, out.w, out.y
    new, w = np.empty(n + 1), np.empty(m)
    for t in range(len(u)):
        for j in range(n):
            all_x[t, j] = state[j]
        for i in range(m):
            z = offsets[i] + matrix[n + i, n] * u[t]
            for j in range(n):
                z += matrix[n + i, j] * state[j]
            value = value_at(tables, i, z)
            factor = factors[i, n + 1] + factors[i, n] * u[t]
            for j in range(n):
                factor += factors[i, j] * state[j]
            value *= factor
            all_z[t, i], all_w[t, i], w[i] = z, value, value
        for i in range(n + 1):
            row = i if i < n else n + m
            total = matrix[row, n] * u[t]
            for j in range(n):
                total += matrix[row, j] * state[j]
            for j in range(m):
                total += matrix[row, n + 1 + j] * w[j]
            new[i] = total
        y[t] = new[n] + offsets[m]
        if not np.isfinite(y[t]):
            return t
        for j in range(n):
            state[j] = new[j]
    for j in range(n):
        if not np.isfinite(state[j]):
            return len(u) - 1
    return len(u)


@njit(nogil=True)
def run_each(
    matrix: Array, offsets: Array, factors: Array, tables: Tables, u: Array, states: Array, every: int, y: Array
) -> None:
    """Write the outputs of runs over the same input from several initial states; NaN from where one diverges.

    Args:
        matrix, offsets, factors, tables: as in `run`.
        u: (K,) input.
        states: (k, n) overwritten by those at the end.
        every: one in ``every`` steps has an output.
        y: (k, ⌈K/every⌉) the outputs.
    """
    steps, n, m = len(u), states.shape[1], len(factors)
    out = LoopSignals(np.empty((steps, n)), np.empty((steps, m)), np.empty((steps, m)), np.empty(steps))
    for k in range(len(states)):
        out.y[run(matrix, offsets, factors, tables, u, states[k], out) :] = np.nan
        y[k] = out.y[::every]


def run_reference(
    matrix: Array,
    offsets: Array,
    factors: Array,
    maps: Sequence[StaticMap],
    u: Array,
    state: Array,
    out: LoopSignals,
) -> int:
    """As `run`, with the maps themselves: slow and simple, and for maps of any kind."""
    n, m = len(state), len(maps)
    for t in range(len(u)):
        signals = np.concatenate([state, u[t : t + 1]])
        z = matrix[n : n + m, : n + 1] @ signals + offsets[:m]
        w = np.array([float(each.value(z[i : i + 1])[0]) for i, each in enumerate(maps)])
        w = w * (factors @ np.append(signals, 1.0))
        signals = np.concatenate([signals, w])
        y = matrix[-1] @ signals + offsets[m]
        out.x[t], out.z[t], out.w[t], out.y[t] = state, z, w, y
        if not np.isfinite(y):
            return t
        state[:] = matrix[:n] @ signals
    return len(u) if np.isfinite(state).all() else len(u) - 1


@njit(nogil=True)
def derivative(
    matrix: Array,
    factors: Array,
    multiplied: NDArray[np.int64],
    maps: MapSlopes,
    u: Array,
    x: Array,
    w: Array,
    every: int,
    now: Array,
    out: Array,
) -> None:
    """The derivative of the output with respect to M, F, the maps, the offsets and the initial state, over a block.

    Its columns are the elements of M row by row without the block D_zw = 0, the rows of F of maps that are multiplied,
    the parameters of the maps, the offsets of z and y, and the initial state.

    Args:
        matrix: (n + m + 1, n + 1 + m) M.
        factors: (m, n + 2) F.
        multiplied: (k,) the maps that are multiplied by a signal.
        maps: along the run.
        u: (K,) input.
        x, w: (K, n), (K, m) of the run.
        every: one in ``every`` steps has an output.
        now: (n, p) the derivative of the state before the first step; overwritten by that after the last one.
        out: (⌈K/every⌉, p) receives the derivative.
    """
    n, m = x.shape[1], w.shape[1]
    slopes, values, gradient, owners = maps
    width, q = n + 1 + m, len(owners)
    to_maps = n * width  # where the rows of z begin
    to_output = to_maps + m * (n + 1)
    of_factors = to_output + width
    of_maps = of_factors + len(multiplied) * (n + 2)
    of_offsets = of_maps + q
    p = of_offsets + m + 1 + n
    from_maps = np.empty((n + 1, q))
    for i in range(n + 1):
        for j in range(q):
            from_maps[i, j] = matrix[i if i < n else n + m, n + 1 + owners[j]]
    before, after = np.zeros((n + 1, p)), np.zeros((n + 1, p))
    before[:n] = now
    back, closed = np.empty((m, n)), np.empty((n + 1, n))
    for t in range(len(u)):
        rows = n + 1 if t % every == 0 else n  # the last one is that of y
        _by_state(matrix, factors, maps, t, back)
        _close(matrix, back, rows, closed)
        multiply(closed, before, rows, after)
        for i in range(rows):
            row, own = (i, i * width) if i < n else (n + m, to_output)
            for j in range(n):
                after[i, own + j] += x[t, j]
            after[i, own + n] += u[t]
            for k in range(m):
                after[i, own + n + 1 + k] += w[t, k]
                through = matrix[row, n + 1 + k] * slopes[k, t]
                of_z = to_maps + k * (n + 1)
                for j in range(n):
                    after[i, of_z + j] += through * x[t, j]
                after[i, of_z + n] += through * u[t]
                after[i, of_offsets + k] += through
            for c, k in enumerate(multiplied):
                through, of_g = matrix[row, n + 1 + k] * values[k, t], of_factors + c * (n + 2)
                for j in range(n):
                    after[i, of_g + j] += through * x[t, j]
                after[i, of_g + n] += through * u[t]
                after[i, of_g + n + 1] += through
            for j in range(q):
                after[i, of_maps + j] += from_maps[i, j] * gradient[j, t]
        if rows > n:
            after[n, of_offsets + m] += 1.0
            out[t // every] = after[n]
        before, after = after, before
    now[:] = before[:n]


@njit(nogil=True, inline="always")
def _by_state(matrix: Array, factors: Array, maps: MapSlopes, t: int, back: Array) -> None:
    """∂w/∂x (m, n) at one step."""
    m, n = back.shape
    for k in range(m):
        for j in range(n):
            back[k, j] = maps.slopes[k, t] * matrix[n + k, j] + maps.values[k, t] * factors[k, j]


@njit(nogil=True, inline="always")
def _close(matrix: Array, back: Array, rows: int, closed: Array) -> None:
    """The first rows of the linear part from x to (x⁺, y) with ∂w/∂x (m, n) in its feedback."""
    m, n = back.shape
    for i in range(rows):
        row = i if i < n else n + m
        for j in range(n):
            closed[i, j] = matrix[row, j]
            for k in range(m):
                closed[i, j] += matrix[row, n + 1 + k] * back[k, j]


@njit(nogil=True)
def multiply(factors: Array, states: Array, rows: int, out: Array) -> None:
    """The first rows of factors·states: six, four or two states at once, then the others by two and one.

    Args:
        factors: (r, n).
        states: (n or more, p).
        rows: of ``factors`` that are wanted.
        out: (r, p) receives them.
    """
    n, width = factors.shape[1], states.shape[1]
    for i in range(rows):
        if n >= 6:
            a, b, c, d, e, f = factors[i, 0], factors[i, 1], factors[i, 2], factors[i, 3], factors[i, 4], factors[i, 5]
            for k in range(width):
                four = a * states[0, k] + b * states[1, k] + c * states[2, k] + d * states[3, k]
                out[i, k] = four + (e * states[4, k] + f * states[5, k])
            j = 6
        elif n >= 4:
            a, b, c, d = factors[i, 0], factors[i, 1], factors[i, 2], factors[i, 3]
            for k in range(width):
                out[i, k] = a * states[0, k] + b * states[1, k] + c * states[2, k] + d * states[3, k]
            j = 4
        elif n >= 2:
            a, b = factors[i, 0], factors[i, 1]
            for k in range(width):
                out[i, k] = a * states[0, k] + b * states[1, k]
            j = 2
        else:
            out[i, :width] = 0.0
            j = 0
        while j + 2 <= n:
            a, b = factors[i, j], factors[i, j + 1]
            for k in range(width):
                out[i, k] += a * states[j, k] + b * states[j + 1, k]
            j += 2
        if j < n:
            a = factors[i, j]
            for k in range(width):
                out[i, k] += a * states[j, k]


@njit(nogil=True, inline="always")
def _combined(row: Array, factors: Array, states: Array) -> None:
    """row = Σⱼ factorsⱼ statesⱼ."""
    row[:] = 0.0
    for j in range(states.shape[0]):
        factor = factors[j]
        for k in range(len(row)):
            row[k] += factor * states[j, k]


@njit(nogil=True, inline="always")
def _through(row: Array, factors: Array, dw: Array, n: int) -> None:
    """row += Σᵢ (factor of wᵢ) δwᵢ."""
    for i in range(dw.shape[0]):
        factor = factors[n + 1 + i]
        if factor != 0.0:
            for k in range(len(row)):
                row[k] += factor * dw[i, k]


@njit(nogil=True)
def pushed(matrix: Array, factors: Array, maps: MapSlopes, forces: Array, every: int, out: Array) -> None:
    """The change of the output when signals are added to each row of the linear part, to first order.

    Args:
        matrix: (n + m + 1, n + 1 + m) M.
        factors: (m, n + 2) F.
        maps: along the run.
        forces: (K, r) the signals.
        every: one in ``every`` steps has an output.
        out: (⌈K/every⌉, (n + 1)·r) receives the change by each signal added to x₁⁺, …, xₙ⁺ and y, row after row.
    """
    m, r = len(factors), forces.shape[1]
    n = matrix.shape[0] - m - 1
    back = np.empty((m, n))
    now, new = np.zeros((n, n * r)), np.zeros((n, n * r))
    dw, dy = np.zeros((m, n * r)), np.zeros(n * r)
    for t in range(len(forces)):
        _by_state(matrix, factors, maps, t, back)
        for i in range(m):
            _combined(dw[i], back[i], now)
        if t % every == 0:
            _combined(dy, matrix[n + m], now)
            _through(dy, matrix[n + m], dw, n)
            out[t // every, : n * r] = dy
            out[t // every, n * r :] = forces[t]
        for i in range(n):
            _combined(new[i], matrix[i], now)
            _through(new[i], matrix[i], dw, n)
            for k in range(r):
                new[i, i * r + k] += forces[t, k]
        now, new = new, now
