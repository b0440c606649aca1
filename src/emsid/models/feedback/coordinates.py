r"""The redundant directions of a feedback model, and coordinates without them.

**Directions.** A change of the state, x′ = (I + E)x, changes the linear part by dA = EA − AE, dB = EB, dC = −CE and the
output not at all. A map can be changed by df = c + k·z + d·f′ − s·z·f′ + o·f without a change of the output if the rest
of the model makes up for it:

    c, k: a level and a line, subtracted from the linear part          o: the unit of w, divided out of B_w and D_yw
    d:    a shift of z, subtracted from z₀                             s: the unit of z, multiplied into C_z and D_zu

Those (c, k, d, s, o) whose df the family of the map contains are redundant. They are found numerically along the run,
for maps of any family; maps that declare that they absorb a shift or take factors do so to the accuracy of their knots.
Of a map that is multiplied by a signal g, c·g is subtracted from the linear part, which cannot make up for a line z·g;
the unit of g is divided out of B_w and D_yw. A constant added to x⁺ moves the state by (I − A)⁻¹ of it.

**Coordinates.** θ = θ₀ + Cφ, with C orthogonal to these directions (data-driven local coordinates, McKelvey,
Helmersson, Ribarits, Automatica 40, 2004), in units in which a change of each element has the same effect on its row.
Where signals are shared, changes of their elements are multiples of one another, and C and the redundant directions are
those within this subspace.
In a form of the model, with elements that are fixed and conditions Gθ = const, the same changes are expressed by others
within the form: C − R(GR)⁺GC, with the redundant directions R (S-transformation, Baarda, *S-Transformations and
Criterion Matrices*, 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.nonlinear.problem import LARGEST
from emsid.models.blocks.static_maps import Scaling, StaticMap
from emsid.models.feedback.equations import Pair, multiple
from emsid.models.feedback.model import FeedbackModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Steps along the run in which directions are compared.
COMPARED = 400
# A change of a map is contained in its family if its remainder is smaller than this fraction; directions whose singular
# value is smaller depend on others.
CONTAINED, DEPENDENT = 1e-7, 1e-9
# A transformation of the state that is worse conditioned than this is not made.
WORST_CONDITION = 1e10


@dataclass(frozen=True, eq=False)
class Visited:
    """The signals of a model over its records, of which only distributions are used.

    Attributes:
        x, z, w: (K, n), (K, m), (K, m).
        u, y: (K,).
    """

    x: Array
    z: Array
    w: Array
    u: Array
    y: Array

    @classmethod
    def of(cls, model: FeedbackModel, inputs: Sequence[Array], states: Sequence[Array]) -> Visited:
        """Of the runs of a model for several inputs (N,), each from states (n,)."""
        runs = [model.trajectory(u, x) for u, x in zip(inputs, states, strict=True)]
        x, z, w, y = (np.concatenate([getattr(each, name) for each in runs]) for name in "xzwy")
        return cls(x, z, w, np.concatenate([model.entering(u) for u in inputs]), y)

    def thinned(self, most: int) -> Visited:
        """At most this many steps of it."""
        every = max(1, -(-len(self.u) // most))
        return Visited(*(each[::every] for each in (self.x, self.z, self.w, self.u, self.y)))


@dataclass(frozen=True, eq=False)
class Change:
    """A change of a model to first order.

    Attributes:
        matrix: of M.
        maps: of the parameters of every map.
        map_offsets: (m,) of z₀.
        factors: of F.
        output_offset: of y₀.
    """

    matrix: Array
    maps: list[Array]
    map_offsets: Array
    factors: Array
    output_offset: float = 0.0

    @classmethod
    def none(cls, model: FeedbackModel) -> Change:
        """No change."""
        parts = [np.zeros(len(each.parameters)) for each in model.maps]
        return cls(np.zeros(model.matrix.shape), parts, np.zeros(len(model.maps)), np.zeros(model.factors.shape))

    def moved_by_constant(self, model: FeedbackModel, constant: Array, behind: float) -> Change:
        """With a constant added to x⁺ (n,) and to y moved into the offsets."""
        n, m = model.states, len(model.maps)
        shift = resting_shift(model.matrix[:n, :n], constant)
        offsets = self.map_offsets + model.matrix[n : n + m, :n] @ shift
        factors = self.factors.copy()
        factors[:, -1] += model.factors[:, :n] @ shift
        behind += float(model.matrix[-1, :n] @ shift)
        return replace(self, map_offsets=offsets, factors=factors, output_offset=behind)

    def vector(self, model: FeedbackModel) -> Array:
        """(p,) in the order of the parameters."""
        own = [self.factors[model.multiplied].ravel(), *self.maps]
        return np.concatenate([self.matrix[model.free_entries], *own, self.map_offsets, [self.output_offset]])


def directions(model: FeedbackModel, visited: Visited) -> Array:
    """(p, k) the redundant directions."""
    n = model.states
    found = []
    for part, _ in model.parts:
        for i, j in product(range(n)[part], repeat=2):
            change = Change.none(model)
            change.matrix[i] += model.matrix[j]
            change.matrix[:, j] -= model.matrix[:, i]
            change.factors[:, j] -= model.factors[:, i]
            found.append(change.vector(model))
    for i in model.multiplied:
        change = Change.none(model)
        change.factors[i] += model.factors[i]
        change.matrix[:, n + 1 + i] -= model.matrix[:, n + 1 + i]
        found.append(change.vector(model))
    seen = visited.thinned(COMPARED)
    shifts = [within(each, seen.z[:, i], each.slope(seen.z[:, i])) for i, each in enumerate(model.maps)]
    for i, each in enumerate(model.maps):
        own = _contained(each, seen.z[:, i], model.takes_line(i))
        found += [_of_a_map(model, i, mix, change, shifts).vector(model) for mix, change in own]
    return np.array(found).reshape(-1, len(model.parameters)).T


def within(map_: StaticMap, z: Array, values: Array) -> Array:
    """(p,) the change of a map's parameters that is closest to a change of its values."""
    rows = map_.parameter_gradient(z)
    return np.asarray(np.linalg.lstsq(rows.T, values, rcond=None)[0], dtype=float)


def _contained(map_: StaticMap, z: Array, line: bool) -> list[tuple[Array, Array]]:
    """The redundant mixtures (c, k, d, s, o) of a map, each with the change (p,) of its parameters.

    Args:
        map_: the map.
        z: (K,) its input.
        line: whether the linear part can make up for a line.
    """
    slope, value = map_.slope(z), map_.value(z)
    generators = np.stack([np.ones_like(z), z, slope, -z * slope, value])
    length = np.linalg.norm(generators, axis=1)
    length[length == 0] = 1.0
    units = generators / length[:, None]
    parts = np.stack([within(map_, z, unit) for unit in units])
    rest = units - parts @ map_.parameter_gradient(z)
    if map_.scaling is Scaling.FREE:
        rest[3] = 0.0
    # Where z₀ is fixed, a shift changes nothing.
    used = [k for k in range(5) if not (k == 1 and not line) and not (k == 2 and map_.absorbs_shift)]
    _, sizes, axes = np.linalg.svd(rest[used].T, full_matrices=True)
    sizes = np.pad(sizes, (0, len(used) - len(sizes)))
    mixtures = np.zeros((len(used), 5))
    mixtures[:, used] = axes
    return [(mix / length, mix @ parts) for mix, size in zip(mixtures, sizes, strict=True) if size < CONTAINED]


def _of_a_map(model: FeedbackModel, i: int, mix: Array, own: Array, shifts: list[Array]) -> Change:
    """The change of the model that makes up for that of one map.

    Args:
        model: with its maps.
        i: the map.
        mix: (5,) c, k, d, s, o.
        own: (p,) the change of its parameters.
        shifts: for every map, the change of its parameters that shifts its input.
    """
    n, m = model.states, len(model.maps)
    level, line, shift, unit_in, unit_out = mix
    change = Change.none(model)
    change.maps[i][:] = own
    into, out = model.matrix[n + i, : n + 1], model.matrix[:, n + 1 + i]
    constants = -(level * model.factors[i, -1] + line * model.map_offsets[i]) * out
    change.matrix[:, : n + 1] -= np.outer(out, line * into + level * model.factors[i, :-1])
    change.matrix[n : n + m, : n + 1][i] += unit_in * into
    change.matrix[:, n + 1 + i] -= unit_out * out
    change = change.moved_by_constant(model, constants[:n], float(constants[-1]))
    change.map_offsets[i] += unit_in * model.map_offsets[i] - shift
    for j, each in enumerate(model.maps):
        if each.absorbs_shift:  # z₀ is fixed; a shift of z goes into the map
            change.maps[j][:] += change.map_offsets[j] * shifts[j]
            change.map_offsets[j] = 0.0
    return change


def weights(model: FeedbackModel, visited: Visited) -> Array:
    """(p,) the effect of a change of every parameter on its row, relative to the row's own size."""
    seen = visited.thinned(COMPARED)
    out = np.column_stack([seen.x, seen.z, seen.y[:, None]])
    entering = np.column_stack([seen.x, seen.u[:, None], seen.w])
    rows, columns = size_of(out), np.sqrt(np.mean(entering**2, axis=0))
    columns[columns == 0] = 1.0
    table = columns[None, :] / rows[:, None]
    n = model.states
    of_w, g = size_of(seen.w), model.factor(seen.x, seen.u)
    parts = [
        np.sqrt(np.mean((g[:, i] * each.parameter_gradient(seen.z[:, i])) ** 2, axis=1)) / of_w[i]
        for i, each in enumerate(model.maps)
    ]
    of_factors = np.append(columns[: n + 1], 1.0) / _level(g)[model.multiplied, None]
    # A map without effect on the data, such as a dead zone beyond them, gets no unit from them.
    of_maps = [np.maximum(part, 1e-6 * part.max() if part.any() else 1.0) for part in parts]
    free = table[model.free_entries]
    return np.concatenate([free, of_factors.ravel(), *of_maps, 1 / rows[n:-1], [1 / rows[-1]]])


def check_size(model: FeedbackModel, visited: Visited) -> None:
    """Refuse signals of which the squares are no numbers, though the output may be small.

    Raises:
        ModelError: if there is one.
    """
    if not all(np.abs(each).max(initial=0.0) < LARGEST for each in (visited.x, visited.z, visited.w)):
        raise ModelError(f"{model.name}: the free run diverges; scale the channels or choose a smaller order")


def size_of(signals: Array) -> Array:
    """The standard deviation of every column, one where it is constant."""
    size = np.std(signals, axis=0)
    return np.where(size > 0, size, 1.0)


def _level(signals: Array) -> Array:
    """The root mean square of every column, one where it is zero."""
    level = np.sqrt(np.mean(signals**2, axis=0))
    return np.where(level > 0, level, 1.0)


def free_lines(model: FeedbackModel, k: int, z: Array) -> Array:
    """(c, q) the lines that the family of a map contains and the linear part can take: factors of 1 and z in each.

    Args:
        model: with the map.
        k: the map, from 0; of one that is multiplied by a signal or of a sensor, a level only (c = 1).
        z: (K,) inputs of the map.
    """
    rows = model.maps[k].parameter_gradient(z).T
    generators = np.vander(z, 1 + model.takes_line(k), increasing=True)
    length = np.linalg.norm(generators, axis=0)
    units = generators / np.where(length > 0, length, 1.0)
    rest = units - rows @ np.linalg.lstsq(rows, units, rcond=None)[0]
    _, sizes, axes = np.linalg.svd(rest, full_matrices=False)
    return np.asarray((axes / np.where(length > 0, length, 1.0))[sizes < CONTAINED].T)


def coordinates(model: FeedbackModel, visited: Visited, held: Mask | None = None) -> Array:
    """(p, f) C: the directions in which the parameters are free.

    Args:
        model: θ₀.
        visited: its signals.
        held: (p,) parameters that keep their values; they remove as many redundant directions as they determine.
    """
    scale = weights(model, visited)
    fixed = always_fixed(model) if held is None else held | always_fixed(model)
    redundant = directions(model, visited) * scale[:, None]
    length = np.linalg.norm(redundant, axis=0)
    redundant = redundant[:, length > 0] / length[length > 0]
    if fixed.any() and redundant.size:
        _, sizes, axes = np.linalg.svd(redundant[fixed], full_matrices=True)
        rank = int(np.sum(sizes > DEPENDENT))
        redundant = redundant @ axes[rank:].T
    redundant, alike = redundant[~fixed], _of_unit_length(shared_rows(model)[:, ~fixed] / scale[~fixed])
    basis = _null_space(alike)
    if redundant.size:
        kept = redundant @ _null_space(alike @ redundant)
        left, sizes, _ = np.linalg.svd(basis.T @ kept, full_matrices=True)
        basis = basis @ left[:, _rank(sizes) :]
    spread = np.zeros((len(scale), basis.shape[1]))
    spread[~fixed] = basis / scale[~fixed][:, None]
    return spread


def shared_rows(model: FeedbackModel, in_any_unit: bool = False) -> Array:
    """(k, p) changes whose product with these is zero keep the signals that are shared multiples of one another.

    Args:
        model: with the signals.
        in_any_unit: whether the factor between them may change.
    """
    rows = [rows_of(model, pair, in_any_unit) for pair in model.shared]
    return np.concatenate(rows) if rows else np.zeros((0, len(model.parameters)))


def rows_of(model: FeedbackModel, pair: Pair, in_any_unit: bool) -> Array:
    """(k, p) parameters whose product with these is zero have a first signal that is a multiple of the second."""
    of, like = map(model.entries, pair)
    factor, own = multiple(model.matrix[of], model.matrix[like]), model.matrix[like][None]
    found = []
    for mixture in _null_space(own).T if in_any_unit else np.eye(len(of[0])):
        change = Change.none(model)
        change.matrix[of] += mixture
        change.matrix[like] -= factor * mixture
        found.append(change.vector(model))
    return np.array(found)


def _of_unit_length(rows: Array) -> Array:
    """(k, q) rows divided by their lengths, also where their squares are too large; those of zeros remain."""
    largest = np.abs(rows).max(axis=1, keepdims=True, initial=0.0)
    rows = rows / np.where(largest > 0, largest, 1.0)
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(length > 0, length, 1.0), dtype=float)


def _null_space(rows: Array) -> Array:
    """(q, f) orthonormal directions whose products with the rows (k, q) are zero."""
    if not rows.size:
        return np.eye(rows.shape[1])
    _, sizes, axes = np.linalg.svd(rows, full_matrices=True)
    return np.asarray(axes[_rank(sizes) :].T, dtype=float)


def _rank(sizes: Array) -> int:
    """The number of singular values whose directions do not depend on others."""
    return int(np.sum(sizes > DEPENDENT * max(sizes.max(initial=0.0), 1e-300)))


def coordinates_in_form(model: FeedbackModel, visited: Visited, fixed: Mask, conditions: Array) -> Array:
    """(p, f) C: the directions in which the parameters are free in a form of the model.

    Args:
        model: θ₀.
        visited: its signals.
        fixed: (p,) parameters that the form fixes.
        conditions: (k, p) G: changes of the parameters whose product with it is zero remain in the form.
    """
    scale, fixed = weights(model, visited), fixed | always_fixed(model)
    free = coordinates(model, visited) * scale[:, None]
    rows = _of_unit_length(np.vstack([np.eye(len(scale))[fixed], conditions, shared_rows(model, True)]) / scale)
    redundant = directions(model, visited) * scale[:, None]
    length = np.linalg.norm(redundant, axis=0)
    if not length.any():
        return coordinates(model, visited, fixed)
    redundant, sizes, _ = np.linalg.svd(redundant[:, length > 0] / length[length > 0], full_matrices=False)
    redundant = redundant[:, : _rank(sizes)]
    moved = free - redundant @ np.linalg.pinv(rows @ redundant, rcond=DEPENDENT) @ (rows @ free)
    if np.abs(rows @ moved).max(initial=0.0) > CONTAINED * np.abs(moved).max(initial=0.0):
        return coordinates(model, visited, fixed)  # conditions that depend on one another
    spread = np.linalg.qr(moved)[0] / scale[:, None]
    spread[fixed] = 0.0
    return np.asarray(spread, dtype=float)


def in_coordinates(model: FeedbackModel, visited: Visited, spread: Array, change: Array) -> Array:
    """(f,) φ: a change (p,) of the parameters is Cφ and redundant directions, such as another unit of a signal.

    Args:
        model: θ₀.
        visited: its signals.
        spread: (p, f) C.
        change: to another model that differs little.
    """
    scale = weights(model, visited)
    columns = np.column_stack([spread, directions(model, visited)]) * scale[:, None]
    length = np.linalg.norm(columns, axis=0)
    length[length == 0] = 1.0
    found = np.linalg.lstsq(columns / length, scale * change, rcond=DEPENDENT)[0] / length
    return np.asarray(found[: spread.shape[1]], dtype=float)


def always_fixed(model: FeedbackModel) -> Mask:
    """(p,) the offsets z₀ of maps that absorb a shift, and the elements that are zero as the model has a sensor."""
    fixed = np.zeros(len(model.parameters), dtype=bool)
    absent = model.absent[model.free_entries]
    fixed[: len(absent)] = absent
    first = len(fixed) - 1 - len(model.maps)
    fixed[first:-1] = [each.absorbs_shift for each in model.maps]
    return fixed


def with_state(model: FeedbackModel, transform: Array) -> FeedbackModel:
    """The same model with the state x′ = Tx."""
    n = model.states
    matrix = model.matrix.copy()
    matrix[:n] = transform @ matrix[:n]
    factors = model.factors.copy()
    for rows in (matrix, factors):
        rows[:, :n] = np.linalg.solve(transform.T, rows[:, :n].T).T
    return replace(model, matrix=matrix, factors=factors, centre=transform @ model.centre)


def with_units(model: FeedbackModel, i: int, unit_in: float, unit_out: float) -> FeedbackModel:
    """The same model with the input of one map divided by ``unit_in`` and its output by ``unit_out``."""
    n = model.states
    matrix, offsets, maps = model.matrix.copy(), model.map_offsets.copy(), list(model.maps)
    maps[i] = maps[i].scaled(1 / unit_in, 1 / unit_out)
    matrix[n + i] /= unit_in
    offsets[i] /= unit_in
    matrix[:, n + 1 + i] *= unit_out
    return replace(model, matrix=matrix, maps=tuple(maps), map_offsets=offsets)


def with_factor_unit(model: FeedbackModel, i: int, unit: float) -> FeedbackModel:
    """The same model with the signal that multiplies one map divided by ``unit``."""
    matrix, factors = model.matrix.copy(), model.factors.copy()
    factors[i] /= unit
    matrix[:, model.states + 1 + i] *= unit
    return replace(model, matrix=matrix, factors=factors)


@dataclass(frozen=True, eq=False)
class Same:
    """A model with the same output, and its state x′ = Tx + s.

    Attributes:
        model: the other model.
        transform: (n, n) T.
        shift: (n,) s.
    """

    model: FeedbackModel
    transform: Array
    shift: Array

    def state(self, x: Array) -> Array:
        """(n,) or (K, n) x′."""
        return x @ self.transform.T + self.shift


def whitened(model: FeedbackModel, visited: Visited) -> Same:
    """The same model with states, z and w of unit size over its records, and uncorrelated states.

    Those of a loop and those behind a sensor may be correlated.
    """
    n = model.states
    transform = np.eye(n, order="F")
    covariance = np.atleast_2d(np.cov(visited.x.T)) if n else np.zeros((0, 0))
    units_in, units_out = size_of(visited.z), size_of(visited.w)
    for part, _ in model.parts:
        size, axes = np.linalg.eigh(covariance[part, part])
        if size.max(initial=0.0) > 0:
            transform[part, part] = (axes / np.sqrt(np.maximum(size, 1e-12 * size[-1]))).T
    model = with_state(model, transform)
    g = _level(model.factor(visited.x @ transform.T, visited.u))
    for i in model.multiplied:
        model = with_factor_unit(model, i, float(g[i]))
    for i, each in enumerate(model.maps):
        if each.scaling is Scaling.FREE:
            unit = float(units_out[i]) / (float(g[i]) if i in model.multiplied else 1.0)
            model = with_units(model, i, float(units_in[i]), unit)
    return Same(model, transform, np.zeros(n))


def with_line(model: FeedbackModel, i: int, slope: float, level: float) -> tuple[FeedbackModel, Array] | None:
    """The model with slope·z + level·g added to what one map gives, as a part of the linear part and the offsets.

    Args:
        model: with its maps.
        i: the map; where g is a signal, the slope is zero.
        slope, level: of the line.

    Returns:
        The model, and (n,) the change of its state; None where an integrator would have to hold the level, or where
        signals that are shared would no longer be multiples of one another.
    """
    n = model.states
    out, into = model.matrix[:, n + 1 + i], model.matrix[n + i, : n + 1]
    matrix = model.matrix.copy()
    matrix[:, : n + 1] += np.outer(out, slope * into + level * model.factors[i, :-1])
    constants = (level * model.factors[i, -1] + slope * model.map_offsets[i]) * out
    shift = resting_shift(matrix[:n, :n], constants[:n])
    if np.abs(shift - matrix[:n, :n] @ shift - constants[:n]).max(initial=0.0) > CONTAINED * np.abs(constants).max():
        return None
    offsets, factors = model.map_offsets + matrix[n:-1, :n] @ shift, model.factors.copy()
    factors[:, -1] += factors[:, :n] @ shift
    behind = model.output_offset + float(constants[-1] + matrix[-1, :n] @ shift)
    moved = replace(
        model,
        matrix=matrix,
        map_offsets=offsets,
        factors=factors,
        output_offset=behind,
        centre=model.centre - shift,
    )
    if np.abs(moved.matrix - matrix).max(initial=0.0) > CONTAINED * np.abs(matrix).max():
        return None
    return moved, -shift


def resting_shift(a: Array, constant: Array) -> Array:
    """(n,) the steady state under a constant (n,) added to x⁺: (I − A)⁻¹ times the constant."""
    return np.asarray(np.linalg.lstsq(np.eye(len(a)) - a, constant, rcond=None)[0], dtype=float)
