r"""What estimates depend on: the values that were held while the others were estimated.

A minimum moves with a value h that is held by

    dθ̂/dh = −(JᵀJ)⁻¹Jᵀ ∂r/∂h,      J = ∂r/∂θ,

and a function q(θ, h) by ∂q/∂h + ∂q/∂θ·dθ̂/dh. An estimate is *given* h if a change of h moves it by more than
`TOLERABLE` standard errors. A value that the user gave changes by `PART`. One that nobody gave is doubled; of zero, it
changes by its plausible size. Where h has a tolerance, from a datasheet or with its fixed value, the covariance
includes it instead: the limits of the tolerance are those of a uniform distribution.

Viscous friction that nobody gave has a weak prior of s = x/√3, where x is its plausible size: at the largest speed it
takes a tenth of the force of the largest command. The no-load current of direct-current motors, which is all of their
friction, is seldom more than a tenth of their stall current. With the data its variance is

    1/(1/s² + ‖P ∂r/∂h‖²/σ²),      P = I − J(JᵀJ)⁻¹Jᵀ,

which enters the covariance of the estimates as a tolerance does. Where the data determine it, this is small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.findings import Finding
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.grey_box import with_effect
from emsid.models.plants.plant import Plant
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.task import Task
from emsid.plant import Measure

Array = NDArray[np.float64]

PART = 0.1
"""The assumed relative error of values that the user gave; for a value of zero, relative to its plausible size."""
TOLERABLE = 0.5
"""With an error of half a standard error, 95 % intervals hold the truth in 92 % of cases."""
ROUNDING = 1e-4
"""Estimates that move by a smaller part of their size do not depend on a held value."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """The values that were held, and how the estimates move with them.

    Attributes:
        names: (h,) of the values held.
        shifts: (p, h) dθ̂/dh of every estimated parameter.
        sizes: (h,) the size of every value held, or what is plausible of one that is zero.
        changes: (h,) by how much the values may be wrong.
        tolerated: (h,) standard deviation that a datasheet or a weak prior gives them; zero where there is none.
        priors: the largest plausible value of every parameter with a weak prior, by name.
    """

    names: tuple[str, ...]
    shifts: Array
    sizes: Array
    changes: Array
    tolerated: Array
    priors: Mapping[str, float] = field(default_factory=dict)

    @property
    def covariance(self) -> Array:
        """(p, p) what the tolerances of held values add to the covariance of the estimates."""
        moved = self.shifts * self.tolerated
        return np.asarray(moved @ moved.T)

    def given(self, shift: Array, error: float, size: float) -> tuple[str, ...]:
        """The held values that a number depends on.

        Args:
            shift: (h,) its derivative with respect to every held value.
            error: its standard error.
            size: its value.
        """
        moved = np.abs(shift) * self.changes > max(TOLERABLE * error, ROUNDING * abs(size))
        return tuple(name for name, yes in zip(self.names, moved & (self.tolerated == 0), strict=True) if yes)

    def widening(self, names: Sequence[str], covariance: Array, plant: Plant) -> list[Finding]:
        """A finding for every weak prior that makes intervals wider by more than `TOLERABLE` standard errors.

        Args:
            names: (p,) the parameters that were estimated.
            covariance: (p, p) of them without the priors.
            plant: that has them.
        """
        errors = np.sqrt(np.diag(covariance))
        found = []
        for name, most in self.priors.items():
            k = self.names.index(name)
            moved = np.abs(self.shifts[:, k]) * self.tolerated[k] > TOLERABLE * errors
            data = {"parameters": [each for each, yes in zip(names, moved, strict=True) if yes], "most": most}
            if moved.any():
                found.append(Finding("damping-open", name, data | {"unit": plant.handles[name].parameter.unit}))
        return found


def held_names(task: Task, plant: Plant, names: Sequence[str]) -> tuple[str, ...]:
    """The parameters that were held: those fixed, those kept, and those of the plant that were not asked for.

    A share of 0 or 1 is a choice of what is there, such as an encoder, and no value that may be a little wrong.
    """
    without_effect = plant.without_effect(task.signals)
    known = (*task.fixed, *(name for name in task.asked if name not in names), *unasked(task, plant))
    return tuple(
        name
        for name in known
        if name not in without_effect and np.isfinite(plant.value(name)) and not _is_choice(plant, name)
    )


def _is_damping(plant: Plant, name: str) -> bool:
    """Whether a parameter is viscous friction, zero or more."""
    handle = plant.handles[name]
    return handle.measure is Measure.DAMPING and handle.lower == 0


def _absent_dampings(task: Task, plant: Plant, others: Sequence[str]) -> tuple[str, ...]:
    """Viscous friction that is zero and neither given nor estimated."""
    taken = {path for name in others for path, _ in plant.handles[name].paths}
    without = {*task.fixed, *plant.absent, *plant.without_effect(task.signals)}
    single = [name for name in plant.handles if name not in without and len(plant.handles[name].paths) == 1]
    return tuple(n for n in single if _is_damping(plant, n) and plant.handles[n].paths[0][0] not in taken)


def unasked(task: Task, plant: Plant) -> list[str]:
    """The parameters of a plant that have an effect, are not estimated, and were not fixed by the user."""
    paths = {path for name in (*task.asked, *task.fixed) for path, _ in plant.handles[name].paths}
    found = with_effect(plant, task.signals)
    return [name for name in found if paths.isdisjoint(path for path, _ in plant.handles[name].paths)]


def is_built_in(plant: Plant, name: str) -> bool:
    """Whether a parameter has the value that a search without other knowledge begins with."""
    kind = PLANTS.get(plant.name)
    return kind is not None and name in kind.start.handles and kind.start.value(name) == plant.value(name)


def _is_physical_bound(plant: Plant, name: str) -> bool:
    """Whether the value of a parameter is the smallest or largest one that is physical."""
    handle = plant.handles[name]
    return plant.value(name) in (handle.lower, handle.upper)


def _is_choice(plant: Plant, name: str) -> bool:
    handle = plant.handles[name]
    return (handle.lower, handle.upper) == (0.0, 1.0) and plant.value(name) in (0.0, 1.0)


def conditions(
    task: Task,
    plant: Plant,
    names: Sequence[str],
    free: NDArray[np.bool_],
    states: Sequence[Array],
    noise: float,
    inseparable: Sequence[str] = (),
) -> Conditions:
    """What the estimates of some parameters of a plant depend on.

    Args:
        task: what was asked.
        plant: with the estimates.
        names: (p,) the parameters that were estimated.
        free: (p + m,) whether each of them, and of the initial states, is not held by a bound.
        states: initial states of every segment.
        noise: standard deviation of the residual.
        inseparable: parameters that the data do not determine separately; one at a bound holds the others. So does one
            at a bound that is not physical, as of a sample time or of a datasheet.
    """
    p, outside = len(names), held_names(task, plant, names)
    absent = _absent_dampings(task, plant, (*names, *outside))
    at_bound = [
        name
        for name, inside in zip(names, free, strict=False)
        if not inside and (name in inseparable or _is_damping(plant, name) or not _is_physical_bound(plant, name))
    ]
    held = (*outside, *at_bound, *absent)
    if not held:
        return unconditional(p)
    problem: FreeRunError = task.problem(plant, (*names, *outside, *absent), states)
    try:
        slopes = np.concatenate([jacobian for _, jacobian in problem.exactly(problem.start)])
    except EmsidError:  # a held value that cannot be moved
        return unconditional(p)
    moving = slopes[:, [problem.free.index(name) for name in held]]
    damping = slopes[:, [problem.free.index(name) for name in names if _is_damping(plant, name)]]
    units = np.hstack([damping, moving])
    units = units / np.maximum(np.linalg.norm(units, axis=0), np.finfo(float).tiny)
    alike = np.any(np.triu(units.T @ units > 1 - ROUNDING, 1), axis=0)  # as the friction of a load is that of the rotor
    units, alike = units[:, damping.shape[1] :], alike[damping.shape[1] :]
    kept = [k for k, name in enumerate(held) if not (name in absent and (alike[k] or not units[:, k].any()))]
    held, moving = tuple(held[k] for k in kept), moving[:, kept]
    columns = np.flatnonzero(free)
    own = slopes[:, np.where(columns < p, columns, columns + len(outside) + len(absent))]
    lengths = np.linalg.norm(own, axis=0)
    lengths[lengths == 0] = 1.0
    moved = -np.linalg.lstsq(own / lengths, moving, rcond=1e-10)[0] / lengths[:, None]
    shifts = np.zeros((p, len(held)))
    shifts[columns[columns < p]] = moved[columns < p]
    values = np.array([abs(plant.value(name)) for name in held])
    scales = problem.scales[[problem.free.index(name) for name in held]]
    sizes = np.where(values > 0, values, scales)
    given = {*task.fixed, *task.known, *(name for name in unasked(task, plant) if not is_built_in(plant, name))}
    changes = np.array([PART if name in given else 1.0 for name in held]) * sizes
    tolerances = [task.sheet[name].tolerance if name in task.sheet else None for name in held]
    tolerated = values * np.array([each or 0.0 for each in tolerances]) / sqrt(3)
    priors = {name: problem.plausible_size(name) for name in held if name not in given and _is_damping(plant, name)}
    prior = np.array([priors.get(name, 0.0) for name in held]) / sqrt(3)
    seen = prior * np.linalg.norm(moving + own @ moved, axis=0) / max(noise, problem.precision)
    return Conditions(held, shifts, sizes, changes, np.hypot(tolerated, prior / np.hypot(1.0, seen)), priors)


def unconditional(parameters: int) -> Conditions:
    """Nothing was held, or it is not known what depends on it."""
    return Conditions((), np.zeros((parameters, 0)), np.zeros(0), np.zeros(0), np.zeros(0))
