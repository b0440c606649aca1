"""The form of a feedback model in which a search takes its last steps.

x₁ is the output without what passes directly, and the columns of A but the first are shifts (observer form). The
largest element of every row of z and column of w is one. A map that contains a line has no level and no slope in the
middle of its data, one that is multiplied by a signal no level.

These units are those of single elements, which the data may hardly determine, so a fit is not reported in them (see
`normal_form`). But where the minimum is flat, a search in other coordinates ends at another point of it: the models of
recordings depend on these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import (
    COMPARED,
    CONTAINED,
    WORST_CONDITION,
    Mask,
    Same,
    Visited,
    size_of,
    with_factor_unit,
    with_line,
    with_state,
    with_units,
    within,
)
from emsid.models.feedback.model import FeedbackModel

Array = NDArray[np.float64]


def observer_form(model: FeedbackModel, visited: Visited) -> tuple[Same, Mask]:
    """The same model in this form, and (p,) the parameters that it fixes."""
    n, m = model.states, len(model.maps)
    shift = np.zeros(n)
    for i in range(m):
        model, moved = _without_line(model, i, visited.z[:, i])
        shift = shift + moved
    held, own = np.zeros(model.matrix.shape, dtype=bool), np.zeros(model.factors.shape, dtype=bool)
    transform, x = _observer(model), visited.x
    if transform is not None:
        model, x, shift = with_state(model, transform), x @ transform.T, transform @ shift
        matrix = model.matrix.copy()
        matrix[:n, 1:n] = np.eye(n)[:, : n - 1]
        matrix[-1, :n] = np.eye(1, n)[0]
        model = replace(model, matrix=matrix)
        held[:n, 1:n] = held[-1, :n] = True
    entering = np.append(size_of(x), size_of(visited.u))
    for i in model.multiplied:
        largest = int(np.argmax(np.abs(model.factors[i, :-1]) * entering))
        model, own[i, largest] = with_factor_unit(model, i, float(model.factors[i, largest])), True
    for i, each in enumerate(model.maps):
        if each.scaling is not Scaling.FREE:
            continue
        into = int(np.argmax(np.abs(model.matrix[n + i, : n + 1]) * entering))
        rows = [*range(n), n + m]
        behind = rows[int(np.argmax(np.abs(model.matrix[rows, n + 1 + i])))]
        factors = model.matrix[n + i, into], 1 / model.matrix[behind, n + 1 + i]
        if np.isfinite(factors).all() and all(factors):
            model = with_units(model, i, *map(float, factors))
            held[n + i, into] = held[behind, n + 1 + i] = True
    first = np.append(held[model.free_entries], own[model.multiplied])
    fixed = np.pad(first, (0, len(model.parameters) - len(first)))
    return Same(model, np.eye(n) if transform is None else transform, shift), fixed


def _observer(model: FeedbackModel) -> Array | None:
    """(n, n) T to the observer form; None if the linear part does not show every state at its output."""
    n = model.states
    if not n:
        return None
    a, c = model.matrix[:n, :n], model.matrix[-1, :n]
    polynomial = np.poly(a).real
    rows = [c]
    for k in range(1, n):
        rows.append(rows[-1] @ a + polynomial[k] * c)
    transform = np.array(rows)
    scaled = transform / np.maximum(np.linalg.norm(transform, axis=1, keepdims=True), 1e-300)
    return transform if np.isfinite(transform).all() and np.linalg.cond(scaled) < WORST_CONDITION else None


def _without_line(model: FeedbackModel, i: int, z: Array) -> tuple[FeedbackModel, Array]:
    """The same model without level and slope of a map in the middle of its data, and (n,) the change of its state.

    Of a map that is multiplied by a signal only the level is taken. The model is unchanged where the family of the map
    does not contain lines, or an integrator would have to hold the level.
    """
    map_, n = model.maps[i], model.states
    if not map_.owns_level:
        return model, np.zeros(n)
    middle = np.array([float(np.median(z))])
    slope = 0.0 if i in model.multiplied else float(map_.slope(middle)[0])
    level = float(map_.value(middle)[0]) - slope * float(middle[0])
    low, high = float(z.min()), float(z.max())
    at = np.linspace(2 * low - high, 2 * high - low, COMPARED)  # beyond the data, too, so that every knot moves
    line = slope * at + level
    maps = list(model.maps)
    maps[i] = map_.with_parameters(map_.parameters - within(map_, at, line))
    if np.abs(map_.value(at) - maps[i].value(at) - line).max() > CONTAINED * max(np.abs(line).max(), 1e-300):
        return model, np.zeros(n)  # also where a family contains lines to first order only
    return with_line(replace(model, maps=tuple(maps)), i, slope, level) or (model, np.zeros(n))
