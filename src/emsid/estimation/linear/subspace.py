r"""Subspace identification: the order, A and C of a state-space model from one triangular factor.

    x(t + 1) = A x(t) + B u(t) + K e(t)        y(t) = C x(t) + D u(t) + y₀ + e(t)

Every segment gives rows of past data z = (u, y)(t − 1) … (u, y)(t − h), future inputs u(t) … u(t + h − 1) and future
outputs. The outputs are linear in the state, and the state in the past (nearly so where h is long enough)::

    Y = Γ X + (response to future inputs) + constant + noise        Γ = (C; CA; CA²; …)        X = L Z

`Information` reduces the rows [1, U, Z, Y] to a triangular factor R, in constant memory and over any number of
segments. The part of Y that Z explains beyond U stands in one block of R. Its singular values show the order, and its
left singular vectors span Γ, for all orders at once. A follows from the shift between the rows of Γ, C is its first
row. The three classical methods are weightings of that block (Van Overschee & De Moor 1995).

With A and C known, the free run is linear in B, D, y₀ and the initial states (`response_rows`). Deviations of the
states X = L Z from A and B, against those of the output from C and D, give K.

The past contains outputs, so data from a feedback loop bias the estimate where the noise is large.

References:
    Verhaegen, Verdult, *Filtering and System Identification* (2007), ch. 9. Van Overschee, De Moor, *A unifying theorem
    for three subspace system identification algorithms*, Automatica 31 (1995). Larimore, *Canonical variate analysis in
    identification, filtering, and adaptive control*, CDC (1990). Bauer, *Order estimation for subspace methods*,
    Automatica 37 (2001).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.linear.information import Information, add_rows

Array = NDArray[np.float64]
Signals = tuple[Array, Array]
"""Outputs (N, ny) and inputs (N, nu) of a segment."""

# Rows that are added to the factor at a time.
BLOCK = 4096
# Eigenvalues of a covariance below this part of the largest are taken as this part.
LEAST = 1e-12
# Poles outside the circle of this radius are mirrored into it.
CIRCLE = 1.0


def cva(block: Array, rest: Array) -> Array:
    """The weight of canonical variates: the inverse square root of the covariance of Y without the future inputs.

    Args:
        block: (f, z) the part of the factor's rows of Y that the past explains.
        rest: (f, f) the part that it does not explain.
    """
    values, vectors = np.linalg.eigh(block @ block.T + rest @ rest.T)
    values = np.maximum(values, LEAST * values[-1])
    return np.asarray((vectors / np.sqrt(values)) @ vectors.T)


def moesp(block: Array, rest: Array) -> Array:
    """No weight: the past is an instrument (PO-MOESP).

    Args:
        block: (f, z) the part of the factor's rows of Y that the past explains.
        rest: (f, f) the part that it does not explain.
    """
    return np.eye(len(block))


Weighting = Callable[[Array, Array], Array]
"""The weight (f, f) of the rows of Y from the part that Z explains (f, z) and the rest (f, f)."""


@dataclass(frozen=True, eq=False)
class Subspace:
    """The factor of past and future data, and the models of all orders in it.

    Attributes:
        information: of the rows [1, U, Z, Y].
        inputs, outputs: the numbers of channels.
        horizon: h, the samples of past and of future.
        weighting: how the rows of Y are weighted.
    """

    information: Information
    inputs: int
    outputs: int
    horizon: int
    weighting: Weighting = cva

    @classmethod
    def of(cls, segments: Sequence[Signals], horizon: int, weighting: Weighting = cva) -> Subspace:
        """From the segments that are longer than past and future.

        Raises:
            ModelError: for too few samples.
        """
        outputs, inputs = segments[0][0].shape[1], segments[0][1].shape[1]
        width = 1 + 2 * horizon * (inputs + outputs)
        factor, samples = np.zeros((width, width)), 0
        for y, u in segments:
            rows = len(y) - 2 * horizon + 1
            for first in range(0, rows, BLOCK):
                count = min(BLOCK, rows - first)
                here = slice(first, first + count + 2 * horizon - 1)
                add_rows(factor, _columns(y[here], u[here], horizon))
                samples += count
        if samples < width:
            raise ModelError(
                f"{samples} samples for {width} columns of past and future data; record longer, or choose a shorter "
                "horizon"
            )
        return cls(Information(factor, samples), inputs, outputs, horizon, weighting)

    @property
    def most(self) -> int:
        """The largest order that the horizon shows."""
        return (self.horizon - 1) * self.outputs

    @cached_property
    def _parts(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """The weight's inverse, U, S, and the blocks of the factor for Z and for Y."""
        first = 1 + self.horizon * self.inputs
        second = first + self.horizon * (self.inputs + self.outputs)
        lower = self.information.factor.T
        past, block, rest = lower[first:second, first:second], lower[second:, first:second], lower[second:, second:]
        weight = self.weighting(block, rest)
        left, size, _ = np.linalg.svd(weight @ block)
        return np.asarray(np.linalg.inv(weight)), np.asarray(left), np.asarray(size), past, block, rest

    @property
    def sizes(self) -> Array:
        """The singular values of the part of Y that the past explains; for `cva` these are canonical correlations."""
        return self._parts[2]

    def order(self, most: int) -> int:
        """The order that Bauer's criterion σ²ₙ₊₁ + d(n)·log(N)/N chooses, for `cva`; d counts parameters."""
        most = min(most, self.most)
        size, samples = self.sizes, self.information.samples
        each = 2 * self.outputs + self.inputs
        criterion = [size[n] ** 2 + n * each * np.log(samples) / samples for n in range(most + 1)]
        return max(1, int(np.argmin(criterion)))

    def observability(self, order: int) -> tuple[Array, Array, Array]:
        """A (n, n), C (ny, n), and the map L (n, h·(nu + ny)) from the past z to the state.

        z holds (u, y) of the oldest sample first.

        Raises:
            ModelError: for an order that the horizon does not show.
        """
        if not 1 <= order <= self.most:
            raise ModelError(f"order {order}: a horizon of {self.horizon} samples shows orders from 1 to {self.most}")
        back, left, size, past, block, _ = self._parts
        extended = back @ (left[:, :order] * np.sqrt(size[:order]))
        a = np.linalg.lstsq(extended[: -self.outputs], extended[self.outputs :], rcond=None)[0]
        explained = np.linalg.lstsq(past.T, block.T, rcond=LEAST)[0].T
        state = np.linalg.lstsq(extended, explained, rcond=None)[0]
        return stabilised(a), extended[: self.outputs], state


def _columns(y: Array, u: Array, horizon: int) -> Array:
    """The columns [1, U, Z, Y] (width, rows) of consecutive samples."""
    rows = len(y) - 2 * horizon + 1

    def lagged(signals: Array, first: int) -> list[Array]:
        return [signals[first + k : first + k + rows].T for k in range(horizon)]

    both = np.hstack([u, y])
    parts = [np.ones((1, rows)), *lagged(u, horizon), *lagged(both, 0), *lagged(y, horizon)]
    return np.ascontiguousarray(np.vstack(parts))


def stabilised(a: Array) -> Array:
    """A with its eigenvalues outside the unit circle mirrored into it."""
    values, vectors = np.linalg.eig(a)
    size = np.abs(values)
    if not (size > CIRCLE).any():
        return a
    inside = np.where(size > CIRCLE, values / size**2, values)
    return np.asarray(np.real(np.linalg.solve(vectors.T, (vectors * inside).T).T))


def states(past_to_state: Array, y: Array, u: Array, horizon: int) -> Array:
    """(N − h + 1, n) the states L z at the samples from h on, the one after the last included."""
    both = np.hstack([u, y])
    rows, width = len(y) - horizon + 1, both.shape[1]
    found = np.zeros((rows, len(past_to_state)))
    for k in range(horizon):
        found += both[k : k + rows] @ past_to_state[:, k * width : (k + 1) * width].T
    return found


@njit(nogil=True)
def response_rows(rows: Array, a: Array, c: Array, signal: Array, begin: Array) -> None:
    """Write into ``rows`` (n, N) the responses of an output to a signal (N,) that drives each of the n states.

    ``r(t + 1) = r(t) A + s(t) c`` holds at once for all states, since c Aᵏ is a row.

    Args:
        rows: the result, r(t) as its columns.
        a: (n, n).
        c: (n,) the row of C of this output.
        signal: (N,) s.
        begin: (n,) r(0): zero, or c for the response to the initial state.
    """
    n, samples = rows.shape
    now, following = begin.copy(), np.empty(n)
    for t in range(samples):
        for j in range(n):
            rows[j, t] = now[j]
            following[j] = signal[t] * c[j]
        for i in range(n):
            by = now[i]
            for j in range(n):
                following[j] += by * a[i, j]
        now, following = following, now


@dataclass(frozen=True, eq=False)
class InputPart:
    """The input matrices of a model whose A and C are known.

    Attributes:
        b: (n, nu).
        d: (ny, nu).
        level: (ny,) y₀.
        residual: mean square error of the free run, of outputs scaled as they were given.
    """

    b: Array
    d: Array
    level: Array
    residual: float


def input_part(a: Array, c: Array, segments: Sequence[Signals], direct: bool) -> InputPart:
    """B, D and y₀ that minimise the error of the free run, the initial state of every segment estimated with them.

    Args:
        a, c: of the model, without eigenvalues outside the unit circle.
        segments: outputs and inputs; outputs of equal noise count equally, so scale them.
        direct: whether there is a D.
    """
    n, outputs, inputs = len(a), len(c), segments[0][1].shape[1]
    width = n * inputs + outputs * inputs * direct + outputs
    total = Information.empty(width)
    for y, u in segments:
        alone = Information.empty(n + width)  # the initial state first
        for i in range(outputs):
            columns = np.zeros((n + width + 1, len(y)))
            response_rows(columns[:n], *map(read_only, (a, c[i], np.zeros(len(y)), c[i])))
            for k in range(inputs):
                own = slice(n + k * n, n + (k + 1) * n)
                response_rows(columns[own], *map(read_only, (a, c[i], u[:, k], np.zeros(n))))
                if direct:
                    columns[n + n * inputs + i * inputs + k] = u[:, k]
            columns[n + width - outputs + i] = 1.0
            columns[-1] = y[:, i]
            alone = alone.add_columns(columns)
        total = total.merge(Information(np.ascontiguousarray(alone.factor[n:, n:]), alone.samples - n))
    solution = total.solve()
    theta = solution.estimate
    d = theta[n * inputs : width - outputs].reshape(outputs, inputs) if direct else np.zeros((outputs, inputs))
    mean = solution.residual_sum_of_squares / max(total.samples, 1.0)
    return InputPart(theta[: n * inputs].reshape(inputs, n).T, d, theta[width - outputs :], mean)


def noise_gain(a: Array, c: Array, part: InputPart, state: Array, segments: Sequence[Signals], horizon: int) -> Array:
    """K (n, ny) from the states L z; zero where it would make the predictor unstable.

    Args:
        a, c, part: the model.
        state: the map L.
        segments: outputs and inputs.
        horizon: h of L.
    """
    n, outputs = len(a), len(c)
    factor = np.zeros((1 + outputs + n,) * 2)  # of [1, e, w]
    for y, u in segments:
        if len(y) <= horizon + 1:
            continue
        x = states(state, y, u, horizon)
        y, u = y[horizon:], u[horizon:]
        e = y - x[:-1] @ c.T - u @ part.d.T - part.level
        w = x[1:] - x[:-1] @ a.T - u @ part.b.T
        add_rows(factor, np.ascontiguousarray(np.hstack([np.ones((len(e), 1)), e, w]).T))
    own = factor[1 : 1 + outputs, 1 : 1 + outputs]
    gain = np.linalg.lstsq(own, factor[1 : 1 + outputs, 1 + outputs :], rcond=LEAST)[0].T
    stable = np.abs(np.linalg.eigvals(a - gain @ c)).max() < CIRCLE
    return np.asarray(gain) if stable else np.zeros((n, outputs))
