r"""Starts of feedback models: the best linear approximation, and the map that explains most of what a model misses.

**Linear.** An output-error model is realised in observer form; with oversampling its matrix is taken to the power 1/L.

**One map more.** A map is added at a signal z, a direction in the space of (x, u) along the run of the model so far (or
the measured output). Let φₖ be functions of z without line and level. If Σₖ βⱼₖ φₖ(z) is added to row j of (x⁺, y), the
output changes by Σ βⱼₖ Sⱼₖ, with the derivative Sⱼₖ of `pushed`. One linear least-squares problem for β, together with
the changes of the model so far, says how much of the residual this direction can explain; alternating least squares
reduces β to one column, β = b·cᵀ: b is the column of w, and Σ cₖφₖ the map. The directions that explain most are
refined.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.static_maps import CubicSpline, StaticMap
from emsid.models.blocks.static_maps.through_points import spread_knots
from emsid.models.feedback.coordinates import Visited, coordinates, whitened, with_line
from emsid.models.feedback.fitting import Found, FreeRun, searched
from emsid.models.feedback.kernels import LoopSignals, pushed
from emsid.models.feedback.model import FeedbackModel
from emsid.models.interpolation import interpolated
from emsid.models.one_channel import Segments
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.structures import arx
from emsid.record import Record, concatenate
from emsid.selection.improvement import schwarz_gain

Array = NDArray[np.float64]

# Knots of the spline whose cardinal functions test a direction.
TRIAL_KNOTS = 8
# Samples in which directions are compared.
COMPARED = 3_000
# Samples that maps in the best directions are refined on before one is chosen.
REFINED_ON = 2_500
# Random directions beside those of the signals.
RANDOM = 24
# Singular values below this fraction count as zero when directions are compared.
RIDGE = 1e-6
# Factors by which the column of w is reduced, until the run does not diverge.
SHARES = (1.0, 0.5, 0.2, 0.05, 0.01)
# Steps of the alternating least squares.
ALTERNATIONS = 10
# Points of a curve that a map is begun at, and stretches of it whose slopes are tried as that of a line beside the map.
POINTS, STRETCHES = 400, 5
# Squared distances that differ by a smaller share count as equal.
ALIKE = 1e-6


def linear_start(
    records: Sequence[Record],
    order: int,
    oversampling: int = 1,
    delay: int = 0,
    held: bool = False,
    control: Control = FREE,
) -> FeedbackModel:
    """A feedback model without maps: the output-error model of this order, realised in observer form.

    Raises:
        ModelError: where no linear model can be fitted, or the root of its matrix is not real.
    """
    record = concatenate(records) if len(records) > 1 else records[0]
    structure = arx(order, order + 1, delay, 1, True)
    fit = fit_free_run(structure, record, max_iterations=20, tolerance=0.1, control=control, covariances=False)
    a, b, level = fit.estimate[:order], fit.estimate[order:-1], float(fit.estimate[-1])
    matrix = in_observer_form(b, np.concatenate([[1.0], a]))
    if oversampling > 1:
        matrix = _faster(matrix, oversampling)
    steady = 1 + float(a.sum())
    offset = level / steady if abs(steady) > 1e-9 else 0.0
    return FeedbackModel(matrix, (), np.zeros(0), offset, delay, oversampling, held, dt=record.dt)


def in_observer_form(b: Array, a: Array) -> Array:
    """(n + 1, n + 1) a filter, b (n + 1,) over a (n + 1,) with a[0] = 1: rows x(t+1) and y by the columns x and u."""
    n = len(a) - 1
    matrix = np.zeros((n + 1, n + 1))
    matrix[:n, :n] = np.eye(n, k=1)
    matrix[:n, 0] = -a[1:]
    matrix[:n, n] = b[1:] - a[1:] * b[0]
    matrix[n, :1], matrix[n, n] = 1.0, b[0]
    return matrix


def _faster(matrix: Array, rate: int) -> Array:
    """The linear part with a step that is shorter by a factor, for an input held over the longer one.

    Raises:
        ModelError: if a pole is negative or zero.
    """
    from scipy.linalg import fractional_matrix_power

    n = len(matrix) - 1
    poles = np.linalg.eigvals(matrix[:n, :n])
    if np.any((np.abs(poles.imag) < 1e-9) & (poles.real <= 1e-9)):
        raise ModelError("the linear part has a pole that no faster model has; choose a smaller order")
    whole = np.vstack([matrix[:n], np.eye(1, n + 1, n)])
    root = fractional_matrix_power(whole, 1 / rate)
    if not np.isfinite(root).all() or np.abs(np.imag(root)).max(initial=0.0) > 1e-6 * np.abs(root).max():
        raise ModelError("the linear part has no real model with shorter steps; choose a smaller order")
    faster = matrix.copy()
    faster[:n] = np.real(root)[:n]
    return faster


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
    """

    row: Array
    column: Array
    z: Array
    w: Array
    left: Array
    before: float
    numbers: int

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


def with_one_map_more(
    found: Found,
    segments: Segments,
    transient: int,
    family: Family,
    size: int,
    directions: Sequence[Direction],
    tried: int = 3,
    steps: int = 10,
    control: Control = FREE,
) -> Found | None:
    """The best model with one more map, refined from the directions that explain most; None if all diverge.

    Directions are compared on some of the segments where there are many; then the result has the states of these only.

    Args:
        found: a model with its states, fitted to the segments.
        segments: (u, y) of each.
        transient: samples without error at the start of each.
        family, size: of the map.
        directions: of the map, the best first; see `directions_for`.
        tried: how many directions are refined.
        steps: of the refinement of each; the best is refined to the end by the caller.
        control: when to stop.
    """
    best: Found | None = None
    every = max(1, round(sum(len(y) for _, y in segments) / REFINED_ON))
    for direction in _apart(directions, tried):
        start = _joined(found, segments, direction, family, size)
        if start is None:
            continue
        try:
            new = searched(start[0], segments[::every], transient, steps, 0.1, control, 1e-3, start[1][::every])
        except EmsidError:
            continue
        if best is None or new.error < best.error:
            best = new
        control.check()
    return best


def directions_for(found: Found, segments: Segments, transient: int, rng: np.random.Generator) -> list[Direction]:
    """Directions in which a map explains part of the residual, the best first."""
    model, runs = found.model, []
    for (u, _), x in zip(segments, found.states, strict=True):
        runs.append(model.trajectory(u, x))
    inputs = [model.entering(u) for u, _ in segments]
    same = whitened(model, Visited.of(inputs, runs))
    states = [same.state(x) for x in found.states]
    runs = [same.model.trajectory(u, x) for (u, _), x in zip(segments, states, strict=True)]
    visited = Visited.of(inputs, runs)
    k, shown = _chosen_part(segments, transient, same.model.oversampling)
    problem = FreeRun(same.model, coordinates(same.model, visited), (segments[k],), transient)
    known = _known(problem, states[k], shown)
    step = slice(0, shown.stop * model.oversampling)
    part = LoopSignals(*(each[step] for each in runs[k]))
    n, size = model.states, np.append(np.ones(model.states), np.std(visited.u) or 1.0)
    found_directions = []
    for row, z in _signals(same.model, part, inputs[k][step], segments[k][1][: shown.stop], size, rng):
        direction = _explained(same.model, part, row, z, known, shown)
        if direction is not None:
            column = direction.column.copy()
            column[:n] = np.linalg.solve(same.transform, column[:n])
            turned = np.append(row[:n] @ same.transform, row[n])
            found_directions.append(replace(direction, row=turned, column=column))
    return sorted(found_directions, key=lambda each: each.error)


def _chosen_part(segments: Segments, transient: int, rate: int) -> tuple[int, slice]:
    """The longest segment, and its samples in which directions are compared."""
    k = int(np.argmax([len(y) for _, y in segments]))
    return k, slice(transient, min(len(segments[k][1]), transient + COMPARED))


def _known(problem: FreeRun, state: Array, shown: slice) -> tuple[Array, Array]:
    """Columns that the model so far can change its output by, orthonormal, and the residual without them."""
    (u, y), model = problem.segments[0], problem.model
    u, y = u[: shown.stop], y[: shown.stop]
    passed = model.trajectory(u, state)
    rows = model.gradient(u, passed)[shown]
    count = len(model.parameters)
    changes = np.column_stack([rows[:, :count] @ problem.spread, rows[:, count:]])
    basis, sizes, _ = np.linalg.svd(changes / np.maximum(np.linalg.norm(changes, axis=0), 1e-300), full_matrices=False)
    basis = basis[:, sizes > RIDGE * sizes.max(initial=0.0)]
    residual = (y - passed.y[:: model.oversampling])[shown]
    return basis, residual - basis @ (basis.T @ residual)


def _signals(
    model: FeedbackModel, run: LoopSignals, u: Array, y: Array, size: Array, rng: np.random.Generator
) -> Iterator[tuple[Array, Array]]:
    """Rows (n + 1,) of C_z and D_zu with their signal (K,)."""
    n = model.states
    signals = np.column_stack([run.x, u])
    of_output = model.matrix[-1, : n + 1]
    between = interpolated(y, model.oversampling)[: len(u)]
    yield of_output, between - model.output_offset
    rows = [of_output, *(np.eye(n + 1) / size)]
    if n > 1:
        rows += [model.matrix[-1, :n] @ model.matrix[:n, : n + 1]]  # the output one step later
    rows += [rng.standard_normal(n + 1) / size for _ in range(RANDOM)]
    for row in rows:
        yield row, signals @ row


def _explained(
    model: FeedbackModel, run: LoopSignals, row: Array, z: Array, known: tuple[Array, Array], shown: slice
) -> Direction | None:
    """What a map at z can explain; None for a signal without a spread."""
    try:
        knots = spread_knots(z, TRIAL_KNOTS)
    except ModelError:
        return None
    trial = CubicSpline(knots, np.zeros(TRIAL_KNOTS)).parameter_gradient(z)
    straight = np.linalg.qr(np.column_stack([np.ones_like(z), z]))[0]
    bent = trial.T - straight @ (straight.T @ trial.T)
    sides, sizes, _ = np.linalg.svd(bent, full_matrices=False)
    functions = np.ascontiguousarray(sides[:, sizes > 1e-4 * sizes[0]]) * np.sqrt(len(z))
    slopes = np.column_stack([np.empty((len(z), 0)), *(each.slope(run.z[:, i]) for i, each in enumerate(model.maps))])
    count, n = functions.shape[1], model.states
    out = np.empty((-(-len(z) // model.oversampling), (n + 1) * count))
    pushed(model.matrix, np.ascontiguousarray(slopes), functions, model.oversampling, out)
    basis, residual = known
    columns = out[shown]
    if not np.isfinite(columns).all():
        return None
    columns = columns - basis @ (basis.T @ columns)
    shape = columns.reshape(len(columns), n + 1, count)
    length = np.linalg.norm(shape, axis=(0, 2))
    shape = shape / np.where(length > 0, length, 1.0)[:, None]
    b, c, left = _one_column(shape, residual)
    before, numbers = float(np.mean(residual**2)), n + count  # n + 1 and count, less one for the unit of w
    return Direction(row, b / np.where(length > 0, length, 1.0), z, functions @ c, left, before, numbers)


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


def _apart(directions: Sequence[Direction], count: int) -> list[Direction]:
    """The first directions whose signals are not nearly the same."""
    chosen: list[Direction] = []
    for each in directions:
        z = each.z - each.z.mean()
        alike = any(
            abs(z @ (other.z - other.z.mean())) > 0.98 * np.linalg.norm(z) * np.linalg.norm(other.z - other.z.mean())
            for other in chosen
        )
        if not alike:
            chosen.append(each)
        if len(chosen) == count:
            break
    return chosen


def _joined(
    found: Found, segments: Segments, direction: Direction, family: Family, size: int
) -> tuple[FeedbackModel, list[Array]] | None:
    """The model with a map of the family in this direction, and its states; None if it diverges however small it is."""
    model = found.model
    try:
        map_, slope, level = started_beside_line(family, direction.z, direction.w, size)
    except EmsidError:
        return None
    for share in SHARES:
        new = with_map(model, map_, direction.row, share * direction.column)
        new, moved = with_line(new, len(model.maps), slope, level) or (new, np.zeros(model.states))
        states = [x + moved for x in found.states]
        try:
            runs = [new.output(u, x) for (u, _), x in zip(segments, states, strict=True)]
        except Infeasible:
            continue
        worst = max(float(np.abs(run).max()) for run in runs)
        if worst < 100 * max(float(np.abs(y).max()) for _, y in segments):
            return new, states
    return None


def started_beside_line(family: Family, z: Array, w: Array, size: int) -> tuple[StaticMap, float, float]:
    """The map of a family that is closest to a curve if a line is added, and slope and level of that line.

    A line beside a map is a part of the linear system, so a curve shows a map up to a line: that of a limit is a dead
    zone of the opposite sign. Lines with the slope of every stretch of the curve are tried.

    Args:
        family: of the map.
        z, w: (K,) points of the curve.
        size: of the map.

    Raises:
        ModelError: where the family has no start from points.
    """
    order = np.argsort(z)
    order = order[:: max(1, len(order) // POINTS)]
    z, w = z[order], w[order]
    stretches = zip(np.array_split(z, STRETCHES), np.array_split(w, STRETCHES), strict=True)
    best, least = None, np.inf
    for tried in (0.0, *(_line(*each)[0] for each in stretches)):
        map_ = family.start(z, w - tried * z, size)
        rest = w - map_.value(z)
        slope, level = _line(z, rest)
        error = float(np.sum((rest - slope * z - level) ** 2))
        if best is None or error < (1 - ALIKE) * least:  # families that contain a line need none beside them
            best, least = (map_, slope, level), error
    assert best is not None
    return best


def _line(z: Array, w: Array) -> tuple[float, float]:
    """Slope and level of the straight line closest to points."""
    middle = float(z.mean())
    power = float(np.sum((z - middle) ** 2))
    slope = float((z - middle) @ w) / power if power > 0 else 0.0
    return slope, float(w.mean()) - slope * middle


def with_map(model: FeedbackModel, map_: object, row: Array, column: Array) -> FeedbackModel:
    """The model with one map more.

    Args:
        model: with n states and m maps.
        map_: the new map, the last one.
        row: (n + 1,) of C_z and D_zu.
        column: (n + 1,) of B_w and D_yw.
    """
    n, m = model.states, len(model.maps)
    matrix = np.zeros((n + m + 2, n + m + 2))
    old = [*range(n + m), n + m + 1]
    matrix[np.ix_(old, range(n + 1 + m))] = model.matrix
    matrix[n + m, : n + 1] = row
    matrix[[*range(n), n + m + 1], n + 1 + m] = column
    return replace(model, matrix=matrix, maps=(*model.maps, map_), map_offsets=np.append(model.map_offsets, 0.0))  # type: ignore[arg-type]
