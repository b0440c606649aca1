r"""What a fitted plant lacks, by one score test for every move that was not taken (`emsid.models.search.score`).

Three kinds of parameters are scored at a minimum, each with the derivative of one free run:

- the known additions (`additions`), at their neutral values;
- every value that was given, kept or built in: whether the data contradict it; one without effect where it is, such
  as a limit that is never reached, by differences to a few smaller values;
- every parameter as a linear function of the time of the record. Where a plant forgets fast compared with the record,
  the derivative of its run by a slope over the record is that by the parameter times the time, from −1 to 1.

A move is named only if noise does not explain its promise, its promise matters, and a refit with it keeps the promise.
The best one is named first. The others are scored again beside it, since what is missing shows in many of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.findings import Finding
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.conditions import held_names
from emsid.models.plants.search.moves import Addition, Situation, additions
from emsid.models.plants.search.result import Combination
from emsid.models.plants.search.scored import bounds_of, by_channel, effect_of, score_at
from emsid.models.plants.search.starts import started
from emsid.models.plants.search.task import Task, cost_of
from emsid.models.search.score import INSEPARABLE, Promise, Score
from emsid.models.visited import Needs
from emsid.selection.improvement import NEGLIGIBLE

Array = NDArray[np.float64]

ALIKE = 0.9
"""Additions that promise this part of the best one are as likely: these data hardly tell them apart."""
CHANCE = 0.01
"""The probability that noise alone makes any of the moves of one fit seem to matter."""
TRIED = 3
"""The most promising moves that are fitted; a refit seldom refutes one of them."""
NAMED = 2
"""The most moves that are named: the search that follows the advice begins with one."""
EXACT = 1e3
"""Noise below this many times the rounding errors of a free run is rounding: the data are exact."""
SMALLER = (0.5, 0.25, 0.125, 0.0625)
"""Parts of a value without effect, such as a limit that is never reached, at which it may have one."""
POOR, FAR = 0.01, (4.0, 2.0, 0.5, 0.25, 0.125)
"""Of a fit that leaves a larger share, given values are tried at these multiples, from new starts."""
MANY = 12_000
"""A plant that is not one mass is scored on no more samples: its free run takes twenty times as long."""


@dataclass(frozen=True, eq=False)
class Move:
    """One move and its derivative.

    Attributes:
        code: of the finding that names it.
        names: its parameters.
        columns: (Nᵢ, k) of every segment and channel.
        lower, upper: (k,) bounds of the change.
        start: the plant where its parameters have these columns.
        addition: of a known addition; None for others.
    """

    code: str
    names: tuple[str, ...]
    columns: list[Array]
    lower: Array
    upper: Array
    start: Plant
    addition: Addition | None = None


def missing(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> list[Finding]:
    """Findings about what would lower the error of a fit, the best first; none where the search was stopped.

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        minimum: where the search ended.
    """
    found: list[Finding] = []
    if not minimum.cost > 0 or np.sqrt(minimum.noise_variance) <= EXACT * problem.precision:
        return found
    with suppress(EmsidError, Stopped):
        moves, beside = list(_moves(task, problem, names)), list[Move]()
        for _ in range(NAMED):
            kept = _kept_promise(task, problem, names, minimum, _score(task, problem, minimum, beside), moves)
            if kept is None:
                break
            beside.append(kept[0])
            found.append(kept[1])
            moves = [each for each in moves if set(each.names).isdisjoint(kept[0].names)]
        if all(each.code != "value-contradicted" for each in found) and _left(task, minimum) > POOR:
            found = [*_given_wrong(task, problem, names, minimum), *found]
    return found


def _left(task: Task, minimum: Minimum) -> float:
    """The share of the outputs' variation that a fit leaves."""
    total = sum(float(np.sum((each.output - each.output.mean(axis=0)) ** 2)) for each in task.segments)
    return 2.0 * minimum.cost / total if total > 0 and task.weighting is all_alike else 0.0


def _given_wrong(task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum) -> list[Finding]:
    """The finding about a given value with another one of which new starts lead to far less: the best, or none.

    Beside a value that is far off, the others are so wrong that no derivative shows it.
    """
    plant, best = problem.plant, minimum.cost
    found: list[Finding] = []
    if not isinstance(plant, DrivenPlant):
        return found
    for name, given in task.fixed.items():
        handle, free = plant.handles[name], (*names, name)
        within = replace(task, limits={**task.limits, name: (handle.lower, handle.upper)})
        for part in FAR:
            with suppress(EmsidError):
                task.control.check()
                other = plant.with_values({name: part * given})
                starts = started(other, task.segments, task.signals, names)
                begun = min((task.problem(each, free) for each in starts), key=cost_of)
                refit = continuation.search_once(begun, within)
                better = begun.plant_at(refit.estimate).value(name)
                if refit.cost < (1.0 - NEGLIGIBLE) * best and not np.isclose(better, given):
                    best = refit.cost
                    data = {"value": given, "better": better, "unit": handle.parameter.unit, "or": []}
                    found = [Finding("value-contradicted", name, {**data, "share": 1.0 - best / minimum.cost})]
    return found


def _kept_promise(
    task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum, score: Score, moves: Sequence[Move]
) -> tuple[Move, Finding] | None:
    """The most promising move whose refit lowers the error, with its finding."""
    chance = CHANCE / max(len(moves), 1)
    promises = [(score.promise(each.columns, each.lower, each.upper, NEGLIGIBLE, chance), each) for each in moves]
    likely = [pair for pair in promises if pair[0].share > NEGLIGIBLE and pair[0].chance < chance]
    for promise, move in sorted(likely, key=lambda pair: -pair[0].share)[:TRIED]:
        with suppress(EmsidError):
            finding = _tried(task, problem, names, minimum, promise, move)
            if finding is not None:
                others = {
                    each.addition.effect
                    for other, each in likely
                    if each.addition is not None and other.share > ALIKE * promise.share
                }
                same = {move.addition.effect} if move.addition is not None else set()
                return move, replace(finding, data={**finding.data, "or": sorted(others - same)})
    return None


def _score(task: Task, problem: FreeRunError, minimum: Minimum, beside: Sequence[Move]) -> Score:
    """The score at a minimum; moves beside it count as present."""
    return score_at(problem, minimum.free, [(move.columns, move.lower, move.upper) for move in beside])


def acting_alike(
    task: Task, problem: FreeRunError, names: Sequence[str], together: Sequence[Combination]
) -> list[Finding]:
    """Findings about effects that these records do not tell from a parameter that was estimated.

    At two levels of the voltage, a dead zone changes the free run exactly as a Coulomb level does. What stays the same
    where one of them takes the place of the other is determined.

    Args:
        task: what was asked.
        problem: begun at the minimum.
        names: (p,) the parameters that were estimated.
        together: what the records identify.
    """
    plant = problem.plant
    if not isinstance(plant, DrivenPlant) or not plant.is_one_mass or not names:
        return []
    at = Situation(plant, tuple(names), task.segments, task.signals, scored=True)
    known = {*task.fixed, *task.asked} - {*names}
    alike: dict[str, list[tuple[Addition, float]]] = {}
    with suppress(EmsidError, Stopped):
        slopes = np.concatenate([jacobian for _, jacobian in problem.exactly(problem.start)])[:, : len(names)]
        for row in additions(at, known, fixed=task.fixed):
            if len(row.names) > 1 or row.beside or row.probe or row.instead or row.kept:
                continue
            effect = np.concatenate(effect_of(problem, row.start, row.names))[:, 0]
            for name, slope in zip(names, slopes.T, strict=True):
                share = float(effect @ slope) / (float(slope @ slope) or inf)
                if share and np.linalg.norm(effect - share * slope) <= INSEPARABLE * np.linalg.norm(effect):
                    alike.setdefault(name, []).append((row, share))
    found = []
    for name, rows in alike.items():
        same = [each for each in together if all(_is_kept(plant, name, row, share, each) for row, share in rows)]
        data = {
            "effects": sorted({row.effect for row, _ in rows}),
            "combinations": [
                [each.quantity.formula, each.quantity.value, HALF_WIDTH * each.standard_error, each.quantity.unit]
                for each in same
            ],
        }
        found.append(Finding("effects-alike", name, data))
    return found


def _is_kept(plant: DrivenPlant, name: str, row: Addition, share: float, combination: Combination) -> bool:
    """Whether a quantity depends on an effect, but not where the effect takes the place of a parameter."""
    value, (added,) = plant.value(name), row.names
    if combination.quantity.rests_on.needs is not Needs.ANY or not value:
        return False
    begun = row.start.value(added)
    plants = [
        row.start.with_values({added: begun + 0.01 * abs(value / share), name: left})
        for left in (value, value - 0.01 * abs(value / share) * share)
    ]
    alone, instead = (
        next(each.value for each in moved.quantities() if each.name == combination.quantity.name) for moved in plants
    )
    before = combination.quantity.value
    return not np.isclose(alone, before, rtol=1e-6, atol=0) and bool(np.isclose(instead, before, rtol=1e-6, atol=0))


# --- the moves ------------------------------------------------------------------------------------------------------


def _moves(task: Task, problem: FreeRunError, names: Sequence[str]) -> Iterator[Move]:
    plant = problem.plant
    driven = plant.of_record(0)
    slow = isinstance(driven, DrivenPlant) and not driven.is_one_mass
    if slow and (driven.secondary or sum(map(len, task.segments)) > MANY):
        return
    held = held_names(task, plant, names)
    if isinstance(plant, DrivenPlant):
        at = Situation(plant, tuple(names), task.segments, task.signals, scored=True)
        for row in additions(at, (*task.fixed, *(name for name in task.asked if name not in names)), fixed=task.fixed):
            yield from _of(task, problem, "effect-missing", row.names, row)
    for name in held:
        yield from _of_value(task, problem, name)
    if Signal.POSITION not in task.signals and not isinstance(task.weighting, tuple):
        yield from _over_time(task, problem, names, held)


def _of_value(task: Task, problem: FreeRunError, name: str) -> Iterator[Move]:
    """The move of a value that was held; of one without effect where it is, several to smaller ones."""
    for move in _of(task, problem, "value-contradicted", (name,)):
        if any(map(np.any, move.columns)):
            yield move
            continue
        for part in SMALLER:
            probe = part * problem.plant.value(name)
            yield from _of(task, problem, "value-contradicted", (name,), probe={name: probe}) if probe else ()


def _of(
    task: Task,
    problem: FreeRunError,
    code: str,
    names: tuple[str, ...],
    row: Addition | None = None,
    probe: Mapping[str, float] | None = None,
) -> Iterator[Move]:
    """The move of some parameters; none if the plant cannot be simulated with them."""
    task.control.check()
    with suppress(EmsidError):
        start = problem.plant if row is None else row.start
        columns = effect_of(problem, start, names, probe if row is None else row.probe)
        lower, upper = bounds_of(start, names)
        yield Move(code, names, columns, lower, upper, start, row)


def _over_time(task: Task, problem: FreeRunError, names: Sequence[str], held: Sequence[str]) -> Iterator[Move]:
    """Every parameter as a linear function of time, from −1 at the first sample to 1 at the last."""
    samples = [len(segment) for segment in task.segments]
    times = np.split(np.linspace(-1.0, 1.0, sum(samples)), np.cumsum(samples)[:-1])
    whole = task.problem(problem.plant, (*names, *held), problem.states(problem.start))
    blocks = [jacobian for _, jacobian in whole.exactly(whole.start)]
    unbounded = np.full(1, np.inf)
    for k, name in enumerate(whole.free):
        if problem.plant.own_parameter(name) is None:
            columns = [
                part * time[:, None]
                for jacobian, time in zip(blocks, times, strict=True)
                for part in by_channel(problem, jacobian[:, k : k + 1])
            ]
            yield Move("parameter-changes", (name,), columns, -unbounded, unbounded, problem.plant)


# --- the refit ------------------------------------------------------------------------------------------------------


def _tried(
    task: Task, problem: FreeRunError, names: Sequence[str], minimum: Minimum, promise: Promise, move: Move
) -> Finding | None:
    """The finding about a move whose refit keeps its promise; None for others."""
    if move.code == "parameter-changes":
        return _halves(task, problem, minimum, move.names[0])
    row = move.addition
    values = {name: float(move.start.value(name) + step) for name, step in zip(move.names, promise.step, strict=True)}
    free = (*names, *move.names) if row is None else row.free(tuple(names))
    start = move.start.with_values(values)
    handles = start.handles
    limits = {**{name: (handles[name].lower, handles[name].upper) for name in free}, **task.limits}
    begun = task.problem(start, free, problem.states(problem.start))
    refit = continuation.search_once(begun, replace(task, limits=limits))
    share = 1.0 - refit.cost / minimum.cost
    if not share > NEGLIGIBLE:
        return None
    reached = begun.plant_at(refit.estimate)
    if row is not None:
        return Finding(
            "effect-missing", problem.plant.name, {"effect": row.effect, "parameters": list(move.names), "share": share}
        )
    (name,) = move.names
    data = {"value": problem.plant.value(name), "better": reached.value(name), "unit": handles[name].parameter.unit}
    return Finding("value-contradicted", name, {**data, "share": share})


def _halves(task: Task, problem: FreeRunError, minimum: Minimum, name: str) -> Finding | None:
    """The finding that a parameter differs between the halves of the records, if that lowers the error."""
    states = problem.states(problem.start)
    fixed: list[tuple[int, ...]] = [() for _ in states]
    samples = [len(segment) for segment in task.segments]
    whole = np.arange(sum(samples)) < sum(samples) // 2
    handle, values, cost = problem.plant.handles[name], [], 0.0
    for half in (whole, ~whole):
        counted = [each.astype(float) for each in np.split(half, np.cumsum(samples)[:-1])]
        begun = FreeRunError(
            problem.plant, task.signals, task.segments, (name,), states, fixed, task.weighting, task.threads, counted
        )
        found = continuation.search_once(begun, replace(task, limits={name: (handle.lower, handle.upper)}))
        values.append(float(found.estimate[0]))
        cost += found.cost
    share = 1.0 - cost / minimum.cost
    if not share > NEGLIGIBLE:
        return None
    return Finding("parameter-changes", name, {"halves": values, "unit": handle.parameter.unit, "share": share})
