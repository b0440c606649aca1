r"""Starts of feedback models: the best linear approximation, and the map that explains most of what a model misses.

**Linear.** An output-error model is realised in observer form; with oversampling its matrix is taken to the power 1/L.

**More steps.** A model with maps is started with twice the steps in the same way, with w as another held input.

**One map more.** A map of a family is begun at the curve of a direction (`directions`), and refined in the best ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.search.map_families import Family
from emsid.models.blocks.static_maps import StaticMap
from emsid.models.feedback.coordinates import with_line
from emsid.models.feedback.fitting import Found, Refusal, searched, visited
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.directions import Direction
from emsid.models.one_channel import Segments, segments_longer_than
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.structures import arx
from emsid.record import Record, concatenate

Array = NDArray[np.float64]

# Samples that maps in the best directions are refined on before one is chosen.
REFINED_ON = 2_500
# Steps of a refinement with held signals.
HELD_STEPS = 15
# Factors by which the column of w is reduced, until the run does not diverge.
SHARES = (1.0, 0.5, 0.2, 0.05, 0.01)
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
        matrix = _faster(matrix, oversampling, order)
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


def _faster(matrix: Array, rate: int, states: int) -> Array:
    """M with a step that is shorter by a factor, for inputs and w that are held over the longer one.

    Raises:
        ModelError: if a pole is negative or zero.
    """
    from scipy.linalg import fractional_matrix_power

    n = states
    poles = np.linalg.eigvals(matrix[:n, :n])
    if np.any((np.abs(poles.imag) < 1e-9) & (poles.real <= 1e-9)):
        raise ModelError("the linear part has a pole that no faster model has; choose a smaller order")
    held = matrix.shape[1] - n
    whole = np.vstack([matrix[:n], np.eye(held, n + held, n)])
    root = fractional_matrix_power(whole, 1 / rate)
    if not np.isfinite(root).all() or np.abs(np.imag(root)).max(initial=0.0) > 1e-6 * np.abs(root).max():
        raise ModelError("the linear part has no real model with shorter steps; choose a smaller order")
    faster = matrix.copy()
    faster[:n] = np.real(root)[:n]
    return faster


def with_steps_doubled(model: FeedbackModel, held: bool) -> FeedbackModel:
    """A start with twice as many steps per sample, from a model with fewer.

    Args:
        model: with its maps.
        held: whether its input is held over the steps of a sample.

    Raises:
        ModelError: if a pole is negative or zero.
    """
    matrix = _faster(model.matrix, 2, model.states)
    return replace(model, matrix=matrix, oversampling=2 * model.oversampling, held=held)


def with_one_map_more(
    found: Found,
    segments: Segments,
    transient: int,
    family: Family,
    size: int,
    directions: Sequence[Direction],
    steps: int = 10,
    control: Control = FREE,
    hold_signals: bool = False,
    refused: Refusal | None = None,
) -> Found | None:
    """The best model with one more map, refined from the directions that explain most; None if all diverge.

    Directions are compared on some of the segments where there are many; then the result has the states of these only.

    Args:
        found: a model with its states, fitted to the segments.
        segments: (u, y) of each.
        transient: samples without error at the start of each.
        family, size: of the map.
        directions: of the map, the best first; see `directions_for`.
        steps: of the refinement of each; the best is refined to the end by the caller.
        control: when to stop.
        hold_signals, refused: see `searched`.
    """
    best: Found | None = None
    parts = share_of(segments)
    for direction in directions:
        start = _joined(found, segments, direction, family, size, refused)
        if start is None:
            continue
        try:
            model, states, some = start[0], start[1][parts], segments[parts]
            new = searched(model, some, transient, steps, 0.1, control, 1e-3, states, hold_signals, refused)
        except EmsidError:
            continue
        if best is None or new.error < best.error:
            best = new
        control.check()
    return best


def share_of(segments: Segments) -> slice:
    """The segments that maps in several directions are refined on."""
    return slice(None, None, max(1, round(sum(len(y) for _, y in segments) / REFINED_ON)))


def with_product(
    found: Found,
    segments: Segments,
    transient: int,
    family: Family,
    direction: Direction,
    control: Control = FREE,
) -> Found:
    """The model with one more map, multiplied by a signal; z and g are held at those of the direction.

    Args:
        found: a model with its states, fitted to the segments.
        segments: (u, y) of each.
        transient: samples without error at the start of each.
        family: of the map, which has one size.
        direction: of the map, with its factor.
        control: when to stop.

    Raises:
        ModelError: where it diverges.
    """
    start = _joined(found, segments, direction, family, 0)
    if start is None:
        raise ModelError(f"{found.model.name}: with a map times a signal in its feedback the model diverges")
    model, states = start
    return searched(model, segments, transient, HELD_STEPS, 0.1, control, 1e-3, states, True)


def _joined(
    found: Found,
    segments: Segments,
    direction: Direction,
    family: Family,
    size: int,
    refused: Refusal | None = None,
) -> tuple[FeedbackModel, list[Array]] | None:
    """The model with a map of the family in this direction, and its states.

    Returns:
        None if it diverges, or is refused, however small the map is.
    """
    model = found.model
    try:
        flat = direction.factor is not None
        map_, slope, level = started_beside_line(family, direction.z, direction.w, size, flat)
    except EmsidError:
        return None
    for share in SHARES:
        new = with_map(model, map_, direction.row, share * direction.column, direction.factor)
        new, moved = with_line(new, len(model.maps), slope, level) or (new, np.zeros(model.states))
        states = [x + moved for x in found.states]
        try:
            runs = [new.output(u, x) for (u, _), x in zip(segments, states, strict=True)]
        except Infeasible:
            continue
        worst = max(float(np.abs(run).max()) for run in runs)
        if worst < 100 * max(float(np.abs(y).max()) for _, y in segments) and not (
            refused is not None and refused(new, segments, states)
        ):
            return new, states
    return None


def started_beside_line(
    family: Family, z: Array, w: Array, size: int, flat: bool = False
) -> tuple[StaticMap, float, float]:
    """The map of a family that is closest to a curve if a line is added, and slope and level of that line.

    A line beside a map is a part of the linear system, so a curve shows a map up to a line: that of a limit is a dead
    zone of the opposite sign. Lines with the slope of every stretch of the curve are tried.

    Args:
        family: of the map.
        z, w: (K,) points of the curve.
        size: of the map.
        flat: whether the slope of the line is zero, as beside a map that is multiplied by a signal.

    Raises:
        ModelError: where the family has no start from points.
    """
    order = np.argsort(z)
    order = order[:: max(1, len(order) // POINTS)]
    z, w = z[order], w[order]
    stretches = zip(np.array_split(z, STRETCHES), np.array_split(w, STRETCHES), strict=True)
    best, least = None, np.inf
    for tried in (0.0, *(() if flat else (_line(*each)[0] for each in stretches))):
        map_ = family.start(z, w - tried * z, size)
        rest = w - map_.value(z)
        slope, level = (0.0, float(rest.mean())) if flat else _line(z, rest)
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


def with_map(
    model: FeedbackModel, map_: object, row: Array, column: Array, factor: Array | None = None
) -> FeedbackModel:
    """The model with one map more.

    Args:
        model: with n states and m maps.
        map_: the new map, the last one.
        row: (n + 1,) of C_z and D_zu.
        column: (n + 1,) of B_w and D_yw.
        factor: (n + 2,) of F; none for a map that is not multiplied by a signal.
    """
    n, m = model.states, len(model.maps)
    matrix = np.zeros((n + m + 2, n + m + 2))
    old = [*range(n + m), n + m + 1]
    matrix[np.ix_(old, range(n + 1 + m))] = model.matrix
    matrix[n + m, : n + 1] = row
    matrix[[*range(n), n + m + 1], n + 1 + m] = column
    last = np.eye(1, n + 2, n + 1) if factor is None else factor[None, :]
    offsets, factors = np.append(model.map_offsets, 0.0), np.vstack([model.factors, last])
    return replace(model, matrix=matrix, maps=(*model.maps, map_), map_offsets=offsets, factors=factors)  # type: ignore[arg-type]


def with_family(
    found: Found, records: Sequence[Record], family: Family, size: int
) -> tuple[FeedbackModel, list[Array]]:
    """The model with maps of another family or size, each the closest to the present one, and its states.

    Args:
        found: the model with its states.
        records: that it was fitted to.
        family, size: of the new maps.
    """
    model, states = found.model, found.states
    seen = visited(model, segments_longer_than(model.memory, model, records), states)
    for i in range(len(model.maps)):
        values = model.maps[i].value(seen.z[:, i])
        map_, slope, level = started_beside_line(family, seen.z[:, i], values, size, i in model.multiplied)
        new = replace(model, maps=(*model.maps[:i], map_, *model.maps[i + 1 :]))
        model, moved = with_line(new, i, slope, level) or (new, np.zeros(model.states))
        states = [x + moved for x in states]
    return model, states
