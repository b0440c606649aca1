r"""The normal form of a feedback model, in units that the data determine.

Of the many numbers that give the same output (see `coordinates`) a fit reports those of one form, so that every
parameter has an interval. A form is useful only if the data determine its units: an element of a matrix that is set to
one passes its own uncertainty on to everything that is measured in it. So the form fixes what the signals of the record
show:

**Lines.** Of a map f whose family contains a level or a line, the line closest to it over the record is a part of the
linear system: Σ f(z)·g = Σ f(z)·g·z = 0 over the samples. Line and curve are then uncorrelated over the data, and A is
the linear system that is closest to the loop there, not the one at small signals. Of a map that is multiplied by a
signal g only the level is taken. Where the family does not contain lines, or an integrator would have to hold the
level, the map remains as it is.

The parameters of a map are those that its data determine best (`StaticMap.on_range`).

**State.** x₁ is the output without what passes directly. The others are built up from it,

    x_k(t+1) = a_k x₁(t) + κ_k2 x₂(t) + … + κ_kk x_k(t) + x_k+1(t)                                                  (1)

with constants κ, so every state has its own a_k and all other columns of A are fixed. With κ = 0 the states are shifts
of the output (observer form). Those are nearly equal to one another where the record is sampled fast, and so are badly
determined; κ is chosen so that the states are uncorrelated over the record, with as few decimals as that needs. Of an
oscillator x₁ is then about a position, and x₂ about a speed.

**Units.** z has the standard deviation of the largest signal in its sum, g the root mean square of it. The gain from w
to the output is one: its root mean square over the spectrum of w, with the lines closest to the maps in place of the
maps. A lag in z and a lag in w often have about the same effect, so that single elements of a row of C_z or a column of
B_w are known badly; these sums of their squares are known well.

**Sensor.** Where the model has a sensor, x₁ is its input z₁ without what passes directly, and the first state behind it
is the output. Its gain is that of w₁, which is one. z₁ is in the unit of the output too: the curve rises as much as z₁
does between its quartiles, or those of its magnitude where the sensor loses the sign. The other w have a gain of one to
z₁.

**Intervals.** The units are conditions that are linear in small changes of the parameters, with the signals of the
fitted model: Σₜ z(t)·dz(t) = 0 for the unit of z, the same for g, and bᵀQ·db = 0 for a column b of B_w and D_yw with
the squared gain bᵀQb. Of models that differ in the split into lines and linear system only, the one is meant that is
closest to the fitted one, every parameter measured by its effect on the record. The covariance is that of the changes
within these conditions and the fixed columns of A (`coordinates_in_form`). So the intervals are those of the parameters
in the form that the fitted model defines, with κ and the signals taken as given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import (
    COMPARED,
    CONTAINED,
    WORST_CONDITION,
    Mask,
    Same,
    Visited,
    free_lines,
    size_of,
    with_factor_unit,
    with_line,
    with_state,
    with_units,
    within,
)
from emsid.models.feedback.model import FeedbackModel

Array = NDArray[np.float64]
Indices = int | NDArray[np.int64]

# At most this many samples of a run define lines and units.
DEFINING = 4_000
# Parts of the values of the input of a sensor between which its curve has a slope of one.
QUARTILES = (0.25, 0.75)
# Steps of w from which its spectrum is taken.
SPECTRUM = 1_024
# Decimals of κ are added until no two states are correlated more than this.
MOST_DECIMALS, CORRELATED = 8, 0.1
# A difference of two values that is smaller than this fraction of them is rounding.
ROUNDING = 1e-13
# A term of a condition that is smaller than this fraction of the largest does not count.
NEGLIGIBLE = 1e-12


@dataclass(frozen=True, eq=False)
class NormalForm(Same):
    """A model in the normal form, and what the form fixes.

    Attributes:
        fixed: (p,) the parameters that the form fixes.
        conditions: (k, p) what the form fixes of the others: changes of parameters whose product with it is zero.
        dependent: the number of parameters that follow from others by these units, or by signals that maps share.
    """

    fixed: Mask
    conditions: Array
    dependent: int


def normal_form(model: FeedbackModel, visited: Visited) -> NormalForm:
    """The same model in the normal form of its own signals."""
    ends = zip(visited.z.min(axis=0).tolist(), visited.z.max(axis=0).tolist(), strict=True)
    model = replace(model, maps=tuple(each.on_range(*at) for each, at in zip(model.maps, ends, strict=True)))
    conditions = _Conditions(model)
    model, shift = _without_lines(model, visited)
    x = visited.x + shift
    w = np.empty_like(visited.w)
    for i, each in enumerate(model.maps):
        w[:, i] = each.value(visited.z[:, i])
    run, transform = replace(visited, x=x, w=w * model.factor(x, visited.u)), np.eye(model.states)
    if model.sensor is not None:
        model, run = _in_units_of_sensor(model, run, conditions)
    for part, row in model.parts:
        state = _state(model.matrix[part, part], model.matrix[row, part], run.x[:, part])
        if state is not None:
            transform[part, part], constants = state
            model = _in_state(model, part, row, transform[part, part], constants)
            conditions.fixed_matrix[part, part.start + 1 : part.stop] = True
            conditions.fixed_matrix[row, part] = True
    model = _in_units(model, replace(run, x=run.x @ transform.T), conditions)
    dependent = conditions.dependent + model.states * len(model.shared)
    return NormalForm(model, transform, transform @ shift, conditions.fixed, conditions.rows, dependent)


class _Conditions:
    """What a form fixes, collected while it is made.

    Attributes:
        fixed_matrix: elements of M that it fixes.
        fixed_factors: elements of F that it fixes.
        dependent: the number of parameters that follow from others by the units.
    """

    def __init__(self, model: FeedbackModel) -> None:
        self.model, self.dependent = model, 0
        self.fixed_matrix = np.zeros(model.matrix.shape, dtype=bool)
        self.fixed_factors = np.zeros(model.factors.shape, dtype=bool)
        self._found: list[Array] = []

    def of_matrix(self, where: tuple[Indices, Indices], row: Array, counted: bool = True) -> None:
        """A row (q,) of elements of M, and whether parameters follow from it; of one element alone, it is fixed."""
        alone = _alone(row)
        if alone is not None and counted:
            rows, columns = np.broadcast_arrays(*where)
            self.fixed_matrix[rows[alone], columns[alone]] = True
            return
        table = np.zeros(self.model.matrix.shape)
        table[where] = row
        self._append(np.concatenate([table[self.model.free_entries], np.zeros(self._after)]), counted)

    def of_factors(self, i: int, row: Array) -> None:
        """A row (n + 2,) of elements of one row of F; of one element alone, it is fixed."""
        alone = _alone(row)
        if alone is not None:
            self.fixed_factors[i, alone] = True
            return
        table = np.zeros(self.model.factors.shape)
        table[i] = row
        own = table[self.model.multiplied].ravel()
        before = np.zeros(int(self.model.free_entries.sum()))
        self._append(np.concatenate([before, own, np.zeros(self._after - len(own))]), True)

    @property
    def _after(self) -> int:
        """The number of parameters after those of M."""
        return len(self.model.parameters) - int(self.model.free_entries.sum())

    def of_map(self, i: int, row: Array) -> None:
        """A row (q,) of parameters of one map."""
        condition, span = np.zeros(len(self.model.parameters)), self.model.spans[i]
        condition[span] = row
        self._append(condition, True)

    def _append(self, condition: Array, counted: bool) -> None:
        self._found.append(condition)
        self.dependent += counted

    @property
    def fixed(self) -> Mask:
        """(p,) the parameters that it fixes."""
        first = np.append(self.fixed_matrix[self.model.free_entries], self.fixed_factors[self.model.multiplied])
        return np.pad(first, (0, len(self.model.parameters) - len(first)))

    @property
    def rows(self) -> Array:
        """(k, p) the conditions."""
        return np.array(self._found).reshape(-1, len(self.model.parameters))


def _alone(row: Array) -> int | None:
    """The only element of a row that counts; None if there are several."""
    counts = np.flatnonzero(np.abs(row) > NEGLIGIBLE * np.abs(row).max())
    return int(counts[0]) if len(counts) == 1 else None


# --- lines -----------------------------------------------------------------------------------------------------------


def _without_lines(model: FeedbackModel, visited: Visited) -> tuple[FeedbackModel, Array]:
    """The same model without the lines of its maps, and (n,) the change of its state."""
    seen = visited.thinned(DEFINING)
    shift = np.zeros(model.states)
    for i in range(len(model.maps)):
        model, moved = _without_line(model, i, seen.z[:, i], model.factor(seen.x + shift, seen.u)[:, i])
        shift = shift + moved
    return model, shift


def _without_line(model: FeedbackModel, i: int, z: Array, g: Array) -> tuple[FeedbackModel, Array]:
    """The same model without the line that is closest to a map over its data, and (n,) the change of its state.

    The model is unchanged where the family of the map contains no line, or an integrator would have to hold the level.
    """
    map_, none = model.maps[i], (model, np.zeros(model.states))
    mix = free_lines(model, i, z)
    if not mix.size:
        return none
    lines = np.vander(z, len(mix), increasing=True) @ mix
    closest = mix @ np.linalg.lstsq(lines * g[:, None], map_.value(z) * g, rcond=None)[0]
    level, slope = np.pad(closest, (0, 2 - len(mix)))
    low, high = float(z.min()), float(z.max())
    at = np.linspace(2 * low - high, 2 * high - low, COMPARED)  # beyond the data, too, so that every knot moves
    line, maps = slope * at + level, list(model.maps)
    maps[i] = map_.with_parameters(map_.parameters - within(map_, at, line))
    try:
        maps[i].check()
    except Infeasible:  # ordered ends would cross, where the data lie on one side of both
        return none
    before, after = map_.value(at), maps[i].value(at)
    if np.abs(before - after - line).max() > CONTAINED * np.abs(line).max() + ROUNDING * np.abs(before).max():
        return none  # also where a family contains lines to first order only
    return with_line(replace(model, maps=tuple(maps)), i, float(slope), float(level)) or none


# --- state -----------------------------------------------------------------------------------------------------------


def _state(a: Array, row: Array, x: Array) -> tuple[Array, Array] | None:
    """(n, n) T to a state of the form (1), and (n, n − 1) the columns of A but the first.

    Args:
        a: (n, n) A.
        row: (n,) the factors of the state in the output.
        x: (K, n) states.

    Returns:
        None if the linear part does not show every state at its output.
    """
    if not len(a):
        return None
    uncorrelated = _uncorrelated(a, row, x)
    if uncorrelated is None:
        return None
    transform, step = uncorrelated
    for decimals in range(MOST_DECIMALS):
        constants = step[:, 1:].copy()
        below = np.tril(np.ones(constants.shape, dtype=bool), -1)
        constants[below] = np.round(constants[below], decimals)
        rounded = _of_constants(step, constants, size_of(x @ transform.T))
        if rounded is not None and _correlation(x @ (rounded @ transform).T) < CORRELATED:
            return rounded @ transform, constants
    return transform, step[:, 1:]


def _uncorrelated(a: Array, row: Array, x: Array) -> tuple[Array, Array] | None:
    """T of uncorrelated states of the form (1), and (n, n) A of them; None if the output does not show every state."""
    n = len(a)
    rows, step, of_x = [row], np.eye(n, k=1), size_of(x)
    centred = x - x.mean(axis=0)
    for k in range(n - 1):
        ahead, so_far = rows[-1] @ a, np.array(rows)
        signals = centred @ so_far.T
        sizes = size_of(signals)
        step[k, : k + 1] = np.linalg.lstsq(signals / sizes, centred @ ahead, rcond=None)[0] / sizes
        rows.append(ahead - step[k, : k + 1] @ so_far)
        if not np.linalg.norm(rows[-1] * of_x) > np.linalg.norm(ahead * of_x) / WORST_CONDITION:
            return None  # what remains is rounding
    transform = np.array(rows)
    scaled = transform * of_x
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    if not np.isfinite(transform).all() or not length.all() or np.linalg.cond(scaled / length) > WORST_CONDITION:
        return None
    step[-1] = np.linalg.solve(transform.T, rows[-1] @ a)
    return transform, step


def _of_constants(step: Array, constants: Array, sizes: Array) -> Array | None:
    """(n, n) T from uncorrelated states to those of the form (1) with these constants.

    Every row of T is linear in a₁ … a_n, so that n equations follow from the last row of (1).

    Args:
        step: (n, n) A of the uncorrelated states.
        constants: (n, n − 1) the columns of A but the first.
        sizes: (n,) of the uncorrelated states.
    """
    n = len(step)
    a = step * sizes / sizes[:, None]
    first = np.eye(1, n)[0] * sizes[0]
    known, by_a = [first], [np.zeros((n, n))]
    for k in range(n):
        one = known[k] @ a - sum(constants[k, j - 1] * known[j] for j in range(1, k + 1))
        many = by_a[k] @ a - sum(constants[k, j - 1] * by_a[j] for j in range(1, k + 1))
        many = many - np.outer(np.eye(n)[k], first)
        known.append(one)
        by_a.append(many)
    try:
        found = -np.linalg.solve(by_a[n].T, known[n])
    except np.linalg.LinAlgError:
        return None
    transform = np.array([one + found @ many for one, many in zip(known[:n], by_a[:n], strict=True)]) / sizes
    return transform if np.isfinite(transform).all() and np.linalg.matrix_rank(transform * sizes) == n else None


def _correlation(x: Array) -> float:
    """The largest correlation between two states."""
    scaled = (x - x.mean(axis=0)) / size_of(x)
    table = scaled.T @ scaled / len(x)
    return float(np.abs(table - np.diag(np.diag(table))).max(initial=0.0))


def _in_state(model: FeedbackModel, part: slice, row: int, transform: Array, constants: Array) -> FeedbackModel:
    """The model with another state, with the fixed elements of the form exactly.

    Args:
        model: with its state.
        part: that is changed, of n states.
        row: the row of M that shows it.
        transform: (n, n) T.
        constants: (n, n − 1) the columns of A but the first.
    """
    whole = np.eye(model.states)
    whole[part, part] = transform
    model = with_state(model, whole)
    matrix = model.matrix.copy()
    matrix[part, part.start + 1 : part.stop], matrix[row, part] = constants, np.eye(1, len(transform))[0]
    return replace(model, matrix=matrix)


# --- units -----------------------------------------------------------------------------------------------------------


def _in_units(model: FeedbackModel, run: Visited, conditions: _Conditions) -> FeedbackModel:
    """The model in the units of the form."""
    n = model.states
    seen = run.thinned(DEFINING)
    entering = np.column_stack([seen.x, seen.u])
    of_factors = _moments(np.column_stack([entering, np.ones(len(entering))]))
    for i in model.multiplied:
        size, largest = _size(model.factors[i], of_factors)
        if _usable(size):
            model = with_factor_unit(model, i, size / float(np.sqrt(of_factors[largest, largest])))
            conditions.of_factors(i, of_factors @ model.factors[i])
    into, ends = _moments(entering - entering.mean(axis=0)), np.append(np.arange(n), len(model.matrix) - 1)
    if model.sensor is not None:
        ends = ends[model.parts[0][0]]
    behind = [_gains_from(model, run, i, ends) for i in range(len(model.maps))]
    for i, each in enumerate(model.maps):
        if each.scaling is Scaling.NONE or (model.sensor is not None and i == 0):
            continue
        row, column = model.matrix[n + i, : n + 1], model.matrix[ends, n + 1 + i]
        (size, largest), (gain, _) = _size(row, into), _size(column, behind[i])
        unit = size / float(np.sqrt(into[largest, largest]))
        if each.scaling is Scaling.JOINT:
            if _usable(unit):
                model = with_units(model, i, unit, abs(unit))
                conditions.of_matrix((n + i, np.arange(n + 1)), into @ row, counted=False)
        elif _usable(unit) and _usable(gain):
            model = with_units(model, i, unit, 1 / gain)
            conditions.of_matrix((n + i, np.arange(n + 1)), into @ row)
            conditions.of_matrix((ends, n + 1 + i), behind[i] @ column)
        else:
            model = _by_largest(model, i, conditions)
    return model


def _in_units_of_sensor(model: FeedbackModel, run: Visited, conditions: _Conditions) -> tuple[FeedbackModel, Visited]:
    """The model and its signals with z₁ in the unit of what the sensor shows."""
    map_, n, z = model.maps[0], model.states, run.z[:, 0]
    if map_.scaling is Scaling.NONE:
        return model, run
    ends = np.append(np.arange(n)[model.parts[1][0]], len(model.matrix) - 1)
    gain, _ = _size(model.matrix[ends, n + 1], _gains_from(model, run, 0, ends))
    low, high = np.quantile(np.abs(z) if map_.loses_sign else z, QUARTILES)
    rise = float(abs(np.diff(map_.value(np.array([low, high])))[0]))
    unit_in = 1 / abs(gain) if map_.scaling is Scaling.JOINT else (high - low) / (abs(gain) * rise)
    if not (_usable(gain) and _usable(unit_in)):
        return model, run
    model = with_units(model, 0, unit_in, 1 / abs(gain))
    run = replace(run, z=run.z / np.append(unit_in, np.ones(len(model.maps) - 1)))
    run = replace(run, w=run.w * np.append(abs(gain), np.ones(len(model.maps) - 1)))
    conditions.of_matrix((ends, n + 1), _gains_from(model, run, 0, ends) @ model.matrix[ends, n + 1])
    if map_.scaling is Scaling.FREE:
        conditions.of_map(0, np.diff(model.maps[0].parameter_gradient(np.array([low, high]) / unit_in))[:, 0])
    return model, run


def _gains_from(model: FeedbackModel, run: Visited, k: int, ends: NDArray[np.int64]) -> Array:
    """(q, q) the squared gains from the w of a map, for the rows of M that it acts on."""
    rows = np.minimum(ends, model.states)
    return np.asarray(squared_gains(model, run, k, power_of(run.w[:, k]))[np.ix_(rows, rows)], dtype=float)


def _by_largest(model: FeedbackModel, i: int, conditions: _Conditions) -> FeedbackModel:
    """The model with one as the largest element of a row of z and a column of w, for signals that do not vary."""
    n, rows = model.states, np.append(np.arange(model.states), len(model.matrix) - 1)
    into = int(np.argmax(np.abs(model.matrix[n + i, : n + 1])))
    behind = rows[int(np.argmax(np.abs(model.matrix[rows, n + 1 + i])))]
    units = float(model.matrix[n + i, into]), float(model.matrix[behind, n + 1 + i])
    if not all(map(_usable, units)):
        return model
    conditions.fixed_matrix[n + i, into] = conditions.fixed_matrix[behind, n + 1 + i] = True
    return with_units(model, i, units[0], 1 / units[1])


def _moments(signals: Array) -> Array:
    """(q, q) the mean products of signals (K, q)."""
    return np.asarray(signals.T @ signals / len(signals), dtype=float)


def _size(row: Array, moments: Array) -> tuple[float, int]:
    """The root mean square of a sum, with the sign of its largest term, and which that is.

    Args:
        row: (q,) the factors of the terms.
        moments: (q, q) the mean products of the terms.
    """
    largest = int(np.argmax(np.abs(row) * np.sqrt(np.diag(moments))))
    size = float(np.sqrt(max(float(row @ moments @ row), 0.0)))
    return float(np.copysign(size, row[largest])), largest


def _usable(unit: float) -> bool:
    return bool(np.isfinite(unit) and unit and np.isfinite(1 / unit))


def power_of(w: Array) -> Array:
    """(q,) the power of what a map gives (K,) at the frequencies of its first steps, without its mean."""
    return np.asarray(np.abs(np.fft.rfft(w[:SPECTRUM])[1:]) ** 2)


def squared_gains(model: FeedbackModel, run: Visited, k: int, power: Array) -> Array:
    """(n + 1, n + 1) Q: bᵀQb is the mean squared gain from w to y, with lines in place of the maps.

    Before a sensor it is that to z₁, the input of the sensor, where w is that of another map.


    Args:
        model: with its maps; their lines are those closest to them over the run (equivalent gains).
        run: its signals.
        k: the map.
        power: (q,) of its w, over which the mean is taken.

    Returns:
        For b (n + 1,), the factors of w in x⁺ and y.
    """
    n, m = model.states, len(model.maps)
    z, g = run.z - run.z.mean(axis=0), model.factor(run.x, run.u).mean(axis=0)
    given = np.stack([each.value(run.z[:, i]) for i, each in enumerate(model.maps)], axis=1)
    values, slopes = given.mean(axis=0), g * np.sum(given * z, axis=0) / np.maximum(np.sum(z**2, axis=0), 1e-300)
    back = slopes[:, None] * model.matrix[n : n + m, :n] + values[:, None] * model.factors[:, :n]
    closed = model.matrix[:, :n] + model.matrix[:, n + 1 :] @ back
    turns = np.exp(1j * np.pi * np.arange(1, len(power) + 1) / len(power))
    responses = np.ones((len(turns), n + 1), dtype=complex)
    turned = turns[:, None, None] * np.eye(n) - closed[:n].T
    row = closed[-1 if k == 0 else model.parts[0][1]]
    responses[:, :n] = np.linalg.solve(turned, np.tile(row[:, None], (len(turns), 1, 1)))[..., 0]
    gains = np.real(responses.T @ (power[:, None] * responses.conj()))
    return np.asarray(gains / max(float(power.sum()), 1e-300), dtype=float)
