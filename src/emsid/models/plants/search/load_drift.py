r"""A load that drifts during the record, and what that adds to the uncertainty of the estimates.

Where errors of a position are forgotten (`Recent`), a slow disturbance no longer bends most parameters, but a constant
load takes up its mean over the record, which another record does not have. So the load is taken for

    constant load + d(t),      E d(t)·d(s) = v·e^{−|t − s|/τ},

with d constant in each of K pieces of the record. Near the estimates θ̂ the residual is r + A·δ + M·d + noise of
variance σ² for a change δ of θ. With A projected out of M and r (M̃, r̃), G = M̃ᵀM̃/σ² and h = −M̃ᵀr̃/σ², the variance v
and the time τ maximise the marginal likelihood, whose logarithm is

    −½·log det(I + G·P) + ½·hᵀ·P·(I + G·P)⁻¹·h,      P = v·R.

The drift has moved the estimates by A⁺M·d, so their covariance includes A⁺M·P·(A⁺M)ᵀ. The variance of the constant load
includes also that of the mean of d over another record as long as this one, v·1ᵀR1/K²: so its interval says what the
load may be there.

References:
    Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), sec. 2.7 and 5.4.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.plants.beginning import starts_from_samples
from emsid.models.plants.free_run_error import FreeRunError, Recent
from emsid.models.plants.parameters import parts
from emsid.models.plants.plant import DrivenPlant
from emsid.models.plants.search.alternatives import Addition, nothing
from emsid.models.plants.search.refinements.contract import level_name
from emsid.models.plants.search.task import Task

Array = NDArray[np.float64]

PIECES = 20
"""Pieces of the record in which the load is constant."""
TIMES = (0.1, 0.3, 1.0)
"""Times τ that are looked at, as a part of the record."""
DEVIATIONS = np.geomspace(1e-5, 0.3, 30)
"""Standard deviations √v that are looked at, as a part of the largest force of the drive."""
SMALL = 1e-4
"""Change of the load for derivatives, as a part of the largest force."""
ROUNDS = 3
"""How often σ² is found anew from what the drift leaves."""


def load_drift(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Addition:
    """What a drift of the load adds, in a single record of a position of which errors are forgotten.

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    none, plant = nothing(len(names)), problem.plant.driven
    if plant is None or len(task.segments) != 1 or not starts_from_samples(plant, task.signals) or plant.latency:
        return none
    load = _load(plant, names)
    if not isinstance(task.weighting, Recent) or not load.any():
        return none
    force = plant.largest_force(task.segments[0].input)
    columns = np.flatnonzero(minimum.free & np.isfinite(np.diag(minimum.covariance)))
    try:
        ((residual, jacobian),) = problem.exactly(problem.start)
        effects = force * _effects(task, plant, problem.states(problem.start)[0], SMALL * force)
    except (EmsidError, Stopped):
        return none
    sizes = np.linalg.norm(jacobian[:, columns], axis=0)
    sizes[sizes == 0] = 1.0
    basis, triangle = np.linalg.qr(jacobian[:, columns] / sizes)
    prior = _prior(*(each - basis @ (basis.T @ each) for each in (effects, residual)))
    if prior is None:
        return none
    moves = np.zeros((len(minimum.estimate), PIECES))
    moves[columns] = np.linalg.lstsq(triangle, basis.T @ effects, rcond=1e-10)[0] / sizes[:, None]
    moved = moves[: len(names)]
    elsewhere = force**2 * float(prior.mean()) * np.outer(load, load)
    data = {
        "parameters": [name for name, share in zip(names, load, strict=True) if share],
        "deviation": force * float(np.sqrt(prior[0, 0])),
        "mean": force * float(np.sqrt(prior.mean())),
        "unit": plant.handles[plant.load_name].parameter.unit,
    }
    return Addition(moved @ prior @ moved.T + elsewhere, (Finding("load-drifts", plant.name, data),))


def _load(plant: DrivenPlant, names: Sequence[str]) -> Array:
    """(p,) how parameters change with a constant load; zeros where none of them does."""
    along = np.zeros(len(names))
    sides = parts(plant, level_name(plant))
    if plant.load_name in names:
        along[names.index(plant.load_name)] = 1.0
    elif set(sides) <= set(names):
        along[[names.index(side) for side in sides]] = 1.0, -1.0
    return along


def _prior(effects: Array, residual: Array) -> Array | None:
    """(K, K) P, of a drift as a part of the largest force; None where none is seen.

    Args:
        effects: (N, K) M̃.
        residual: (N,) r̃.
    """
    steps = np.abs(np.subtract.outer(np.arange(PIECES), np.arange(PIECES))) / PIECES
    priors = [v * np.exp(-steps / time) for time, v in product(TIMES, DEVIATIONS**2)]
    best, gained, left = priors[0], 0.0, residual
    for _ in range(ROUNDS):
        noise = float(left @ left) / effective_samples([left])
        gram, right = effects.T @ effects / noise, -effects.T @ residual / noise
        likelihoods = [_likelihood(gram, right, prior)[0] for prior in priors]
        best, gained = priors[int(np.argmax(likelihoods))], max(likelihoods)
        left = residual + effects @ _likelihood(gram, right, best)[1]
    return best if gained > 0 else None


def _likelihood(gram: Array, right: Array, prior: Array) -> tuple[float, Array]:
    """The logarithm of the marginal likelihood over that without drift, and the drift (K,)."""
    inflated = np.eye(len(right)) + gram @ prior
    drift = prior @ np.linalg.solve(inflated, right)
    return 0.5 * float(right @ drift) - 0.5 * float(np.linalg.slogdet(inflated)[1]), drift


def _effects(task: Task, plant: DrivenPlant, state: Array, change: float) -> Array:
    """(N, K) the derivative of the weighted free run by the load in every piece of the record."""
    segment, signals = task.segments[0], task.signals
    edges = np.linspace(0, len(segment), PIECES + 1).astype(int)
    heavier = plant.with_values({plant.load_name: plant.value(plant.load_name) + change})
    plain, other = plant.for_segment(segment), heavier.for_segment(segment)
    at = plain.start(state, segment.input[0], segment.dt, signals, len(segment))
    run, effects = plain.run(at, segment.input, signals)[0], np.zeros((len(segment), PIECES))
    for k, (first, last) in enumerate(pairwise(edges.tolist())):
        moved, after = other.run(at, segment.input[first:last], signals)
        if last < len(segment):
            moved = np.concatenate([moved, plain.run(after, segment.input[last:], signals)[0]])
        moved = np.concatenate([np.zeros(first), (moved - run[first:])[:, 0]])
        effects[:, k] = task.weighting(moved, segment.dt) / change
        at = plain.run(at, segment.input[first:last], signals)[1]
    return effects
