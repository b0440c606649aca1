r"""Directions in which a map more explains what a feedback model misses.

A map is added at a signal z, a direction in the space of (x, u) along the run of the model so far (or the measured
output). Let φₖ be functions of z without line and level. If Σₖ βⱼₖ φₖ(z) is added to row j of (x⁺, y), the output
changes by Σ βⱼₖ Sⱼₖ, with the derivative Sⱼₖ of `pushed`. One linear least-squares problem for β, together with the
changes of the model so far, says how much of the residual this direction can explain; alternating least squares
reduces β to one column, β = b·cᵀ: b is the column of w, and Σ cₖφₖ the map.

A map may also be multiplied by a signal g, one of the state, the input and the output: then φₖ(z)·g takes the place of
φₖ(z), and only the level of φₖ is left out.

Many directions are compared on some samples, and the best of them again on all. A map of a few numbers explains some of
the noise of any samples, of few samples a large share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.static_maps import CubicSpline
from emsid.models.blocks.static_maps.through_points import spread_knots
from emsid.models.feedback.coordinates import coordinates, whitened
from emsid.models.feedback.fitting import Found, visited
from emsid.models.feedback.kernels import LoopSignals, MapSlopes, pushed
from emsid.models.feedback.model import FeedbackModel, slopes_along
from emsid.models.input_path import interpolated
from emsid.models.one_channel import Segments
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

# Knots of the spline whose cardinal functions test a direction.
TRIAL_KNOTS = 8
# Samples of the longest segment in which all directions are compared, and how many are compared again on all data.
COMPARED, KEPT = 1_500, 3
# Random directions beside those of the signals.
RANDOM = 24
# Directions whose signals are more correlated than this are the same.
SAME = 0.98
# Singular values below this fraction count as zero when directions are compared.
RIDGE = 1e-6
# Steps of the alternating least squares.
ALTERNATIONS = 10


@dataclass(frozen=True, eq=False)
class Direction:
    """A signal z that a map can be added at.

    Attributes:
        row: (n + 1,) of C_z and D_zu.
        column: (n + 1,) of B_w and D_yw.
        z, w: (K,) points of the map.
        left: (N,) the residual that is left, to first order.
        before: mean square of the residual without the map.
        numbers: how many numbers of map and column were fitted for that.
        measured: whether z is the measured output, in place of that of the model.
        factor: (n + 2,) of F, for a map that is multiplied by a signal.
    """

    row: Array
    column: Array
    z: Array
    w: Array
    left: Array
    before: float
    numbers: int
    measured: bool = False
    factor: Array | None = None

    @property
    def error(self) -> float:
        """The mean square of the residual that is left."""
        return float(np.mean(self.left**2))

    def explains(self, samples: int) -> bool:
        """Whether a map in this direction explains more than noise, by Schwarz's criterion.

        What a linear model misses is a slow signal, of which few samples are independent, even if a map explains all
        of it. So those of the residual that is left are counted.

        Args:
            samples: in all data that the map would be fitted to.
        """
        independent = effective_samples([self.left]) * samples / len(self.left)
        return schwarz_gain(self.error, self.before, independent, self.numbers) > 0


def directions_for(
    found: Found,
    segments: Segments,
    transient: int,
    rng: np.random.Generator,
    multiplied: bool = False,
    kept: int = KEPT,
) -> list[Direction]:
    """Directions that differ and in which a map explains most of the residual, the best first.

    Args:
        found: a model with its states, fitted to the segments.
        segments: (u, y) of each.
        transient: samples without error at the start of each.
        rng: for directions.
        multiplied: whether the map is multiplied by a signal.
        kept: how many at most.
    """
    model = found.model
    same = whitened(model, visited(model, segments, found.states))
    states = [same.state(x) for x in found.states]
    seen = visited(same.model, segments, states)
    spread, size = coordinates(same.model, seen), np.append(np.ones(model.states), np.std(seen.u) or 1.0)
    (u, y), x = max(zip(segments, states, strict=True), key=lambda each: len(each[0][1]))
    stop = transient + COMPARED
    part = _Stretches.of(same.model, spread, [(u[:stop], y[:stop])], [x], transient)
    rows, loop = _rows(same.model, size), same.model.parts[0][0]
    if multiplied:  # the measured output times a constant would explain the noise
        tried = [part.explained(row, False, each) for row in rows for each in _factors(same.model, size)]
    else:
        rows += [_within(loop, rng.standard_normal(len(size))) / size for _ in range(RANDOM)]
        first = [] if same.model.sensor is not None else [part.explained(rows[0], True)]
        tried = [*first, *(part.explained(row, False) for row in rows)]
    best = _apart(sorted((each for each in tried if each is not None), key=lambda each: each.error), kept)
    if len(segments) > 1 or len(y) > stop:
        whole = _Stretches.of(same.model, spread, segments, states, transient)
        again = [whole.explained(each.row, each.measured, each.factor) for each in best]
        best = sorted((each for each in again if each is not None), key=lambda each: each.error)
    n, inverse = model.states, np.linalg.inv(same.transform)
    return [
        replace(
            each,
            row=np.append(each.row[:n] @ same.transform, each.row[n]),
            column=np.append(inverse @ each.column[:n], each.column[n]),
            factor=None if each.factor is None else np.append(each.factor[:n] @ same.transform, each.factor[n:]),
        )
        for each in best
    ]


def _rows(model: FeedbackModel, size: Array) -> list[Array]:
    """Rows (n + 1,) of C_z and D_zu that are tried, that of the output first, or of the input of a sensor."""
    n, m, (loop, output) = model.states, len(model.maps), model.parts[0]
    inside = np.flatnonzero(_within(loop, np.ones(n + 1)))
    rows = [model.matrix[output, : n + 1], *(np.eye(n + 1) / size)[inside], *model.matrix[n : n + m, : n + 1]]
    if n > 1:
        rows.append(model.matrix[output, :n] @ model.matrix[:n, : n + 1])  # the output one step later
    return rows


def _within(loop: slice, row: Array) -> Array:
    """(n + 1,) a row with zeros for the states behind a sensor."""
    row[loop.stop : -1] = 0.0
    return row


def _factors(model: FeedbackModel, size: Array) -> list[Array]:
    """Rows (n + 2,) of F that are tried: the output, the states and the input."""
    output = np.append(model.matrix[-1, : model.states + 1], model.output_offset)
    return [output, *np.pad(np.diag(1 / size), ((0, 0), (0, 1)))]


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Stretches of records in which directions are compared, with the run of a model over them.

    Attributes:
        model: so far.
        runs: its signals.
        inputs: (K,) of each stretch, at the steps of the model.
        outputs: (N,) measured.
        maps: their slopes along each.
        basis: (N, k) orthonormal, by which the model so far can change its outputs.
        residual: (N,) measured output minus that of the model, without what is in the basis.
        transient: samples without error at the start of each.
    """

    model: FeedbackModel
    runs: list[LoopSignals]
    inputs: list[Array]
    outputs: list[Array]
    maps: list[MapSlopes]
    basis: Array
    residual: Array
    transient: int

    @classmethod
    def of(
        cls, model: FeedbackModel, spread: Array, segments: Segments, states: Sequence[Array], transient: int
    ) -> _Stretches:
        """Those of segments (u, y), from the states at their starts."""
        runs = [model.trajectory(u, x) for (u, _), x in zip(segments, states, strict=True)]
        blocks, residuals, count = [], [], len(model.parameters)
        for k, ((u, y), run) in enumerate(zip(segments, runs, strict=True)):
            rows = model.gradient(u, run)[transient:]
            own = [np.zeros((len(rows), model.states))] * len(segments)
            own[k] = rows[:, count:]
            blocks.append(np.column_stack([rows[:, :count] @ spread, *own]))
            residuals.append((y - run.y[:: model.oversampling])[transient:])
        changes, residual = np.concatenate(blocks), np.concatenate(residuals)
        changes /= np.maximum(np.linalg.norm(changes, axis=0), 1e-300)
        basis, sizes, _ = np.linalg.svd(changes, full_matrices=False)
        basis = basis[:, sizes > RIDGE * sizes.max(initial=0.0)]
        inputs = [model.entering(u) for u, _ in segments]
        maps = [slopes_along(model, run.x, v, run.z) for run, v in zip(runs, inputs, strict=True)]
        residual = residual - basis @ (basis.T @ residual)
        return cls(model, runs, inputs, [y for _, y in segments], maps, basis, residual, transient)

    def explained(self, row: Array, measured: bool, factor: Array | None = None) -> Direction | None:
        """What a map in a direction can explain; None for a signal without a spread.

        Args:
            row: (n + 1,) of C_z and D_zu.
            measured: whether z is the measured output, in place of this signal.
            factor: (n + 2,) of F, for a map that is multiplied by a signal.
        """
        model, n = self.model, self.model.states
        signals = [
            interpolated(y, model.oversampling) - model.output_offset if measured else run.x @ row[:n] + u * row[n]
            for run, u, y in zip(self.runs, self.inputs, self.outputs, strict=True)
        ]
        z = np.concatenate(signals)
        try:
            knots = spread_knots(z, TRIAL_KNOTS)
        except ModelError:
            return None
        trial = CubicSpline(knots, np.zeros(TRIAL_KNOTS)).parameter_gradient(z)
        lines = [np.ones_like(z), z] if factor is None else [np.ones_like(z)]
        straight = np.linalg.qr(np.column_stack(lines))[0]
        bent = trial.T - straight @ (straight.T @ trial.T)
        sides, sizes, _ = np.linalg.svd(bent, full_matrices=False)
        functions = np.ascontiguousarray(sides[:, sizes > 1e-4 * sizes[0]]) * np.sqrt(len(z))
        columns = self._changes(functions if factor is None else functions * self._factor(factor)[:, None])
        if not np.isfinite(columns).all():
            return None
        columns -= self.basis @ (self.basis.T @ columns)
        count = functions.shape[1]
        shape = columns.reshape(len(columns), n + 1, count)
        if model.sensor is not None:
            shape[:, model.parts[0][0].stop :] = 0.0
        length = np.linalg.norm(shape, axis=(0, 2))
        length[length == 0] = 1.0
        b, c, left = _one_column(shape / length[:, None], self.residual)
        before, numbers = float(np.mean(self.residual**2)), n + count  # n + 1 and count, less one for the unit of w
        return Direction(row, b / length, z, functions @ c, left, before, numbers, measured, factor)

    def _factor(self, row: Array) -> Array:
        """(K,) the signal of a row (n + 2,) of F."""
        n, runs = self.model.states, zip(self.runs, self.inputs, strict=True)
        return np.concatenate([run.x @ row[:n] + u * row[n] + row[n + 1] for run, u in runs])

    def _changes(self, functions: Array) -> Array:
        """(N, (n + 1)·r) the changes of the outputs by signals (K, r) that are added to each row of the linear part."""
        model, found, first = self.model, [], 0
        matrix, factors = read_only(model.matrix), read_only(model.factors)
        for run, maps in zip(self.runs, self.maps, strict=True):
            forces = functions[first : first + len(run.y)]
            first += len(run.y)
            out = np.empty((-(-len(run.y) // model.oversampling), (model.states + 1) * functions.shape[1]))
            pushed(matrix, factors, maps, forces, model.oversampling, out)
            found.append(out[self.transient :])
        return np.concatenate(found)


def _one_column(shape: Array, residual: Array) -> tuple[Array, Array, Array]:
    """b (r,), c (k,) for which Σ bⱼcₖ shapeⱼₖ is closest to the residual (N,), and the rest (N,)."""
    basis, triangle = np.linalg.qr(shape.reshape(len(shape), -1))
    seen = basis.T @ residual
    start = np.linalg.lstsq(triangle, seen, rcond=RIDGE)[0].reshape(shape.shape[1:])
    small = triangle.reshape(-1, *shape.shape[1:])
    left, sizes, right = np.linalg.svd(start)
    b, c = left[:, 0], sizes[0] * right[0]
    for _ in range(ALTERNATIONS):
        c = np.linalg.lstsq(np.tensordot(small, b, (1, 0)), seen, rcond=RIDGE)[0]
        b = np.linalg.lstsq(small @ c, seen, rcond=RIDGE)[0]
        length = float(np.linalg.norm(b)) or 1.0
        b, c = b / length, c * length
    return b, c, residual - np.tensordot(shape, b, (1, 0)) @ c


def _apart(directions: Sequence[Direction], most: int) -> list[Direction]:
    """The first directions whose signals are not nearly the same."""
    chosen: list[Direction] = []
    for each in directions:
        if not any(_alike(each, other) for other in chosen):
            chosen.append(each)
        if len(chosen) == most:
            break
    return chosen


def _alike(one: Direction, other: Direction) -> bool:
    """Whether the signals of two directions are nearly the same, z and that which multiplies the map."""
    pairs = [(one.z - one.z.mean(), other.z - other.z.mean())]
    if one.factor is not None and other.factor is not None:
        pairs.append((one.factor[:-1], other.factor[:-1]))
    return all(abs(a @ b) > SAME * np.linalg.norm(a) * np.linalg.norm(b) for a, b in pairs)
