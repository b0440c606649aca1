r"""A load that drifts during the record: a test for it, and its effect on the uncertainty of the estimates.

With a drift d of the load in pieces, as in `drifting_load`, the residual near the estimates is r + A·δ + M·d + noise of
variance σ² for a change δ of the parameters. With A projected out of M and r (M̃, r̃), G = M̃ᵀM̃/σ² and h = −M̃ᵀr̃/σ², the
rate q and the time τ of the drift maximise the marginal likelihood, whose logarithm is

    −½·log det(I + G·P) + ½·hᵀ·P·(I + G·P)⁻¹·h,

and the drift is P·(I + G·P)⁻¹·h. With P = q·L·Lᵀ, the eigenvalues of LᵀGL give both for every q at once. A choice of
refinements takes a drift into account where Schwarz's criterion prefers its two numbers, and where the remaining
residual is white, since a drift does not stand for other errors of a model. The parameters and the drift are estimated
in turn.

If the user lets errors of a position be forgotten (`Recent`) instead, a constant load includes the mean of its drift
over the record, which another record does not have. The drift has moved the estimates by A⁺M·d, so their covariance
includes A⁺M·P·(A⁺M)ᵀ. The variance of the constant load also includes that of the mean of d over another record of this
length, 1ᵀP1/K², so that its interval holds there.

References:
    Rasmussen, Williams, *Gaussian Processes for Machine Learning* (2006), sec. 2.7 and 5.4.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite, log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.plants.drifting_load import PIECES, DriftingLoad, LoadDrift, load_effects
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, Recent, Weighting, all_alike
from emsid.models.plants.initial_state import InitialState, agree, begun, may_rest, starts_from_samples
from emsid.models.plants.parameters import Signal, parts
from emsid.models.plants.search.alternatives import Addition, nothing
from emsid.models.plants.search.moves import level_name
from emsid.models.plants.search.task import Task
from emsid.models.plants.search.trials import Trial, Trials
from emsid.selection.improvement import steady

Array = NDArray[np.float64]

PARTS = (0.1, 0.03)
"""Times τ of a drift that returns, as a part of the longest segment."""
SHORT = log(5.0)
"""A drift returns where the logarithm of its marginal likelihood is larger than that of a walk by this. Longer times
cannot be distinguished from a walk. Those from 0.02 to 50 lengths are taken to be as likely in every decade, so that
the longer ones are five times as likely as the half decade that one of `PARTS` stands for."""
DEVIATIONS = np.geomspace(1e-5, 0.3, 30)
"""Standard deviations of a walk at the end of the longest segment that are tried, in parts of the largest force."""
ROUNDS = 3
"""How often σ² is estimated anew from the residual without the drift."""
TURNS = 4
"""The most turns of estimating drift and parameters."""
LONG = 800
"""Samples of a segment that can show a drift."""
WHITE = 0.5
"""A residual is white if its effective samples are at least this part of its samples."""


# --- the choice -----------------------------------------------------------------------------------------------------


def chosen(
    trials: Trials, starts: Sequence[DrivenPlant], names: Sequence[str], states: Sequence[Array] | None = None
) -> Trials | None:
    """Trials weighted by the drift of the load; None if the records do not show one.

    The initial states are estimated under the drift, or at rest where the records allow it. States from the first
    samples are too inexact to linearise a free run at.

    Args:
        trials: what all fits share.
        starts: plants with the structure, to begin with.
        names: the parameters to estimate.
        states: initial states to begin with, by default what the first samples show.
    """
    if len(trials.signals) != 1 or max(len(segment) for segment in trials.segments) < LONG:
        return None
    if trials.signals == (Signal.SPEED,):
        found = _under_a_drift(trials, starts, names, states)
        plain = found and replace(trials, weighting=all_alike).fitted([found[1].plant], names, states)
        return found[0] if found and plain and steady(found[1].errors, plain.errors) else None
    if trials.signals != (Signal.POSITION,):
        return None
    if agree(trials.seen, [np.zeros(2) for _ in trials.segments]):
        found = _under_a_drift(replace(trials, begins=InitialState.REST), starts, names, states)
        if found is None or _rests(*found):
            return found and found[0]
    found = _under_a_drift(replace(trials, begins=InitialState.FREE), starts, names, states)
    return found and found[0]


def _rests(trials: Trials, trial: Trial) -> bool:
    """Whether estimated initial states are better than rest by no more than noise explains."""
    free = replace(trials, begins=InitialState.FREE).fitted([trial.plant], trial.names, trial.states)
    return free is None or may_rest(trial.cost, free.cost, free.residuals)


def _under_a_drift(
    trials: Trials, starts: Sequence[DrivenPlant], names: Sequence[str], states: Sequence[Array] | None
) -> tuple[Trials, Trial] | None:
    """Trials weighted by the drift of the load, and the structure fitted by them; None if there is no drift."""
    longest = max(len(segment) * segment.dt for segment in trials.segments)
    trial, found = trials.fitted(starts, names, states), trials.weighting
    known = found if isinstance(found, tuple) and not isfinite(found[0].drift.time) else ()
    trial, known = _in_turn(trials, trial, known, starts, (inf,))
    if trial is not None and known:
        returning = _estimated(trials, trial, known, (inf, *(part * longest for part in PARTS)))
        if returning and isfinite(returning[0].drift.time):
            trial, known = _in_turn(trials, trial, returning, starts, (returning[0].drift.time,))
    samples = sum(len(segment) for segment in trials.segments)
    if trial is None or not known or effective_samples(trial.residuals) < WHITE * samples:
        return None
    return replace(trials, weighting=known), trial


def _in_turn(
    trials: Trials,
    trial: Trial | None,
    known: tuple[DriftingLoad, ...],
    starts: Sequence[DrivenPlant],
    times: Sequence[float],
) -> tuple[Trial | None, tuple[DriftingLoad, ...]]:
    """Estimate drift and parameters in turn, from a trial and a drift; no drift if there is none."""
    for _ in range(TURNS):
        before, known = known, () if trial is None else _estimated(trials, trial, known, times)
        if trial is None or not known:
            return trial, ()
        trial = replace(trials, weighting=known).fitted([trial.plant, *starts], trial.names, trial.states)
        if before and alike(before, known):
            break
    return trial, known


def alike(one: Weighting, other: Weighting) -> bool:
    """Whether two weightings are drifts with the same rate and time."""
    if not (isinstance(one, tuple) and isinstance(other, tuple)):
        return False
    return [each.drift[:2] for each in one] == [each.drift[:2] for each in other]


def _estimated(
    trials: Trials, trial: Trial, known: tuple[DriftingLoad, ...], times: Sequence[float]
) -> tuple[DriftingLoad, ...]:
    """The drift that a trial shows, linearised at a known one; none where Schwarz's criterion prefers none."""
    plant, signals, segments = trial.plant, trials.signals, trials.segments
    drifted = [each.drifted for each in known] or [np.zeros(PIECES) for _ in segments]
    around = list(zip(segments, trial.states, strict=True))
    try:
        plain = tuple(
            DriftingLoad.around(plant, segment, state, signals, LoadDrift(0.0, inf, 1.0), at)
            for (segment, state), at in zip(around, drifted, strict=True)
        )
        first, free = begun(plant, signals, segments, trials.begins, trial.states)
        problem = FreeRunError(plant, signals, segments, trial.names, first, free, plain, 1)
        blocks = problem.exactly(problem.start)
        durations = [len(segment) * segment.dt for segment in segments]
        found = _found([each.effects for each in plain], durations, times, *zip(*blocks, strict=True))
        if found is None:
            return ()
        drift, loads = found
        if signals != (Signal.POSITION,):  # a speed forgets a load, and its free run stays near that without a drift
            loads = drifted
        return tuple(
            DriftingLoad.around(plant, segment, state, signals, drift, at)
            for (segment, state), at in zip(around, loads, strict=True)
        )
    except EmsidError:
        return ()


def _found(
    effects: Sequence[Array],
    durations: Sequence[float],
    times: Sequence[float],
    residuals: Sequence[Array],
    jacobians: Sequence[Array],
) -> tuple[LoadDrift, list[Array]] | None:
    """The drift and its values (K,) in every segment, as a part of the largest force."""
    lengths = np.cumsum([0, *map(len, residuals)])
    moved, residual = np.zeros((lengths[-1], PIECES * len(effects))), np.concatenate(residuals)
    for k, each in enumerate(effects):
        moved[lengths[k] : lengths[k + 1], PIECES * k : PIECES * (k + 1)] = each
    basis = _basis(np.vstack(jacobians))
    moved, residual = (each - basis @ (basis.T @ each) for each in (moved, residual))
    left = residual - moved @ np.linalg.lstsq(moved, residual, rcond=1e-10)[0]
    best = _likeliest(moved, residual, left, durations, times)
    if best.gained <= log(len(residual)):
        return None
    return best.drift, np.split(best.loads, len(effects))


def _basis(jacobian: Array) -> Array:
    sizes = np.linalg.norm(jacobian, axis=0)
    return np.asarray(np.linalg.qr(jacobian[:, sizes > 0] / sizes[sizes > 0])[0])


# --- the uncertainty ------------------------------------------------------------------------------------------------


def load_drift(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> Addition:
    """The uncertainty that a drift of the load adds, in records of a position.

    Only a finding if the fit has taken the drift into account.

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    none, plant = nothing(len(names)), problem.plant
    if not isinstance(plant, DrivenPlant):
        return none
    load = _load_direction(plant, names)
    force = plant.largest_force(task.segments[0].input)
    longest = max(len(segment) * segment.dt for segment in task.segments)
    if isinstance(task.weighting, tuple):
        drift = task.weighting[0].drift
        prior, walks = force**2 * drift.prior(longest), not isfinite(drift.time)
        trusted = min(
            each.trusted(len(segment) * segment.dt) for each, segment in zip(task.weighting, task.segments, strict=True)
        )
        finding = _finding(plant, names, load, prior, mean=None, walks=walks, trusted=trusted)
        return Addition(none.covariance, (finding,))
    if len(task.segments) != 1 or not starts_from_samples(plant, task.signals):
        return none
    if not isinstance(task.weighting, Recent) or not load.any():
        return none
    columns = np.flatnonzero(minimum.free & np.isfinite(np.diag(minimum.covariance)))
    (segment,), (state,) = task.segments, problem.states(problem.start)
    try:
        ((residual, jacobian),) = problem.exactly(problem.start)
        raw = load_effects(plant, segment, state, task.signals, np.zeros(PIECES))
        effects = np.column_stack([task.weighting(column, segment.dt) for column in raw.T])
    except (EmsidError, Stopped):
        return none
    sizes = np.linalg.norm(jacobian[:, columns], axis=0)
    sizes[sizes == 0] = 1.0
    basis, triangle = np.linalg.qr(jacobian[:, columns] / sizes)
    across = residual - basis @ (basis.T @ residual)
    best = _likeliest(
        effects - basis @ (basis.T @ effects),
        across,
        across,
        [longest],
        [part * longest for part in (inf, *PARTS)],
    )
    if best.gained <= 0:
        return none
    prior = best.drift.prior(longest)
    moves = np.zeros((len(minimum.estimate), PIECES))
    moves[columns] = np.linalg.lstsq(triangle, basis.T @ effects, rcond=1e-10)[0] / sizes[:, None]
    moved = moves[: len(names)]
    mean = force**2 * float(prior.mean())
    finding = _finding(plant, names, load, force**2 * prior, mean=float(np.sqrt(mean)))
    return Addition(moved @ prior @ moved.T + mean * np.outer(load, load), (finding,))


def _finding(plant: DrivenPlant, names: Sequence[str], load: Array, prior: Array, **what: object) -> Finding:
    parameters = [name for name, share in zip(names, load, strict=True) if share]
    unit = plant.handles[plant.load_name].parameter.unit
    data = {"parameters": parameters, "deviation": float(np.sqrt(prior[-1, -1])), "unit": unit, **what}
    return Finding("load-drifts", plant.name, data)


def _load_direction(plant: DrivenPlant, names: Sequence[str]) -> Array:
    """(p,) the change of the parameters for a larger constant load; zeros if none of them is a load."""
    along = np.zeros(len(names))
    sides = parts(plant, level_name(plant))
    if plant.load_name in names:
        along[names.index(plant.load_name)] = 1.0
    elif set(sides) <= set(names):
        along[[names.index(side) for side in sides]] = 1.0, -1.0
    return along


# --- the likelihood -------------------------------------------------------------------------------------------------


class _Likeliest(NamedTuple):
    """The drift that maximises the marginal likelihood, its values, and the increase of the log-likelihood."""

    drift: LoadDrift
    loads: Array
    gained: float


def _likeliest(
    effects: Array, residual: Array, left: Array, durations: Sequence[float], times: Sequence[float]
) -> _Likeliest:
    """Maximise the marginal likelihood.

    Args:
        effects: (N, K·segments) M̃, by a drift as a part of the largest force.
        residual: (N,) r̃.
        left: (N,) the residual without a drift, to begin with.
        durations: of the segments, in s.
        times: τ that are tried; the first one unless another is better by `SHORT`.
    """
    longest = max(durations)
    units = [LoadDrift(1.0 / float(np.sqrt(longest)), time, 1.0) for time in times]
    priors = [_along_diagonal([unit.prior(each) for each in durations]) for unit in units]
    roots = [np.asarray(np.linalg.cholesky(prior), dtype=float) for prior in priors]
    for _ in range(ROUNDS):
        noise = float(left @ left) / effective_samples([left])
        gram, right = effects.T @ effects / noise, -effects.T @ residual / noise
        found = [
            _likelihood(gram, right, root, unit, float(np.sqrt(noise))) for root, unit in zip(roots, units, strict=True)
        ]
        best = max(found, key=lambda each: each.gained)
        best = best if best.gained > found[0].gained + SHORT else found[0]
        left = residual + effects @ best.loads
    return best


def _along_diagonal(blocks: Sequence[Array]) -> Array:
    whole = np.zeros((PIECES * len(blocks), PIECES * len(blocks)))
    for k, block in enumerate(blocks):
        whole[PIECES * k : PIECES * (k + 1), PIECES * k : PIECES * (k + 1)] = block
    return whole


def _likelihood(gram: Array, right: Array, root: Array, unit: LoadDrift, noise: float) -> _Likeliest:
    """The likeliest multiple of a drift, from G and h, and a root of its prior."""
    sizes, vectors = np.linalg.eigh(root.T @ gram @ root)
    along = vectors.T @ (root.T @ right)
    inflated = 1.0 + np.multiply.outer(DEVIATIONS**2, np.maximum(sizes, 0.0))
    gained = 0.5 * (DEVIATIONS[:, None] ** 2 * along**2 / inflated - np.log(inflated)).sum(axis=1)
    k = int(np.argmax(gained))
    drift = root @ (vectors @ (DEVIATIONS[k] ** 2 * along / inflated[k]))
    return _Likeliest(LoadDrift(DEVIATIONS[k] * unit.rate, unit.time, noise), drift, float(gained[k]))
