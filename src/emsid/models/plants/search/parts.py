r"""The search for parts of a plant of which there may be many, such as the harmonics of a torque over the angle.

A plant names the parts that records of this kind can show, each with its probability before the data are seen
(`Plant.possible_parts`). A part without effect is contained in the plant, so that one linearised run gives the score of
them all (`emsid.models.search.score`). The driver of all searches (`emsid.models.search.driver`) refits what the score
promises and takes what the criterion prefers: Schwarz's, and −2·log of the prior probability for each part, which is
the price of having chosen it among many.

Parts hardly depend on each other, so that a move adds all that the score promises together: the best, the best beside
it, and so on, as many as the criterion prefers and are not much smaller. It counts the independent samples of what all
of them leave, because the error without one of them is no noise.

References:
    Chen, Chen, *Extended Bayesian information criteria for model selection with large model spaces*, Biometrika 95
    (2008), on the price of many candidates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Stopped
from emsid.estimation.threads import one_blas_thread
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.models.plants.free_run_error import FreeRunError, all_alike
from emsid.models.plants.parameters import find_handle
from emsid.models.plants.plant import Part, Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.conclusion import concluded
from emsid.models.plants.search.continuation import Reached
from emsid.models.plants.search.estimation import begun_again, searched
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.plants.search.scored import score_at
from emsid.models.plants.search.task import Task
from emsid.models.plants.search.without_moves import MOST, with_filter, with_rise
from emsid.models.search.driver import climb
from emsid.models.search.score import Score
from emsid.record import Record
from emsid.selection.improvement import StretchErrors, schwarz_gain, steady

Array = NDArray[np.float64]

AS_LARGE = 0.1
"""A move adds no part that promises less than this part of what its best one does: the effect of a large one is not
linear, and beside it the score promises small ones that are not there. Half and double of it left the same harmonics of
a record with three; without it, the search of a record with seven took more than four times as long."""
STEPS = 4
"""The steps of the search of a trial. With two, nothing was found in a record with three harmonics; with eight, the
same as with four, in a fifth more time."""
CHUNK = 32
"""Parts whose derivatives are computed together, and of which the best are compared: 150 MB for 100,000 samples of
three outputs."""
CLEARLY = 10.0
"""A part that the linearised plant needs by more than this is not taken out to look: refits without one differed from
it by less than one. Looking at all of seven harmonics took three times as long and left the same; looking at none
left one that was not there."""


@dataclass(frozen=True, eq=False)
class Extended:
    """A plant with some of its possible parts, where a search of its parameters ended.

    Attributes:
        reached: the end of that search.
        parts: that were added.
        without: what was just taken out, in whose place another part may come.
    """

    reached: Reached
    parts: tuple[Part, ...]
    without: Part | None = None

    @property
    def errors(self) -> StretchErrors:
        """The weighted free-run error of all outputs, stretch by stretch."""
        channels = len(self.reached.problem.signals)
        residuals = self.reached.residuals
        return StretchErrors.of(np.concatenate([np.sum(np.split(each**2, channels), axis=0) for each in residuals]))


@one_blas_thread()
def with_parts(plant: Plant, records: Record | Iterable[Record], **options: Any) -> GreyBoxFit:
    """The fit of `simulation_error`, same arguments, with all that the records support.

    That is a filter of the speed, parts, and a resistance that changes.
    """
    return concluded(*with_rise(*extended(*with_filter(*searched(plant, records, **options)))))


def extended(task: Task, start: Plant, reached: Reached) -> tuple[Task, Plant, Reached]:
    """What a search began and ended with, with the parts that the records support in addition."""
    family = _Parts(task, start, reached)
    best = Extended(reached, ())

    def taken(state: Extended, how: str) -> bool:
        nonlocal best
        best = state
        return True

    if family.possible and reached.unended:
        with suppress(Stopped):
            climb(best, family, taken)
    task, start = family.with_parts(best.parts)
    reached = best.reached
    if best.parts and reached.minimum.ending is Ending.OUT_OF_BUDGET:
        reached = continuation.search(task, reached.problem.plant, MOST, reached.states)
    return task, start, begun_again(task, reached, MOST) if best.parts else reached


class _Parts:
    """The search for parts; a `Family` of the driver.

    Attributes:
        possible: what may be added.
    """

    def __init__(self, task: Task, start: Plant, reached: Reached) -> None:
        self._task, self._start = task, start
        self._own = _parts_of(task, task.given)
        has = {each.names for each in self._own}
        known = {*task.asked, *task.fixed}
        found = reached.problem.plant.possible_parts(task.segments, task.signals)
        self.possible = [each for each in found if each.names not in has and known.isdisjoint(each.names)]

    def with_parts(self, parts: Sequence[Part]) -> tuple[Task, Plant]:
        """The task of a plant with these parts, and its start."""
        if not parts:
            return self._task, self._start
        whole, names = [*self._own, *parts], [name for each in parts for name in each.names]
        task, start = self._task, self._start.with_parts(whole)
        limits = {name: (find_handle(start, name).lower, find_handle(start, name).upper) for name in names}
        return replace(
            task, given=task.given.with_parts(whole), plant=task.plant.with_parts(whole), asked=(*task.asked, *names),
            limits={**task.limits, **limits},
        ), start  # fmt: skip

    def likely(self, state: Extended) -> list[tuple[Part, ...]]:
        """All parts that the score promises together, and the best of them alone."""
        self._task.control.check()
        self._task.control.doing(f"{self._start.name}: scoring {len(self.possible)} parts", len(state.parts))
        problem = state.reached.problem
        free, found = state.reached.minimum.free, list[Part]()
        score = score_at(problem, free)
        left, effects = self._best(problem, score, [each for each in self.possible if each not in state.parts])
        gains, begun, first = list[float](), score, 0.0
        while len(found) < len(left):
            shares = score.shares(effects)
            both = [self._gain(score, share, part) for share, part in zip(shares.tolist(), left, strict=True)]
            best = int(np.argmax(both))
            saved = float(shares[best]) * score.power
            if left[best] in found or both[best] <= 0 or saved < AS_LARGE * first:
                break
            first = max(first, saved)
            found.append(left[best])
            columns = effects[:, [left.index(each) for each in found]].reshape(len(effects), -1)
            score = begun.with_columns(columns)
            gains.append(_preferred(found, score.power, begun.power, effective_samples(score.residuals)))
        most = int(np.argmax(gains)) + 1 if max(gains, default=0.0) > 0 else 0
        if state.without is not None:  # only another one that explains as much may take its place
            return [(found[0],)] if most and found[0] != state.without else []
        return [tuple(found[:k]) for k in dict.fromkeys((most, 1)) if most]

    def _gain(self, score: Score, share: float, part: Part) -> float:
        """By how much the criterion prefers a part with this share of the squared error, all samples independent."""
        return _preferred([part], 1.0 - min(share, 1.0), 1.0, sum(map(len, score.residuals)))

    def _best(self, problem: FreeRunError, score: Score, parts: list[Part]) -> tuple[list[Part], Array]:
        """The parts that promise most, at most `CHUNK`, and the derivatives (N, parts, k) of the error by them."""
        kept, effects, gains = list[Part](), np.zeros((sum(map(len, score.residuals)), 0, 1)), np.zeros(0)
        groups = [parts[k : k + CHUNK] for k in range(0, len(parts), CHUNK)]
        for group, found in zip(groups, _effects(problem, groups), strict=True):
            shares = score.shares(found).tolist()
            both = np.append(gains, [self._gain(score, *each) for each in zip(shares, group, strict=True)])
            first = np.sort(np.argsort(-both, kind="stable")[:CHUNK])
            effects = np.concatenate([effects.reshape(len(found), -1, found.shape[2]), found], axis=1)[:, first]
            kept, gains = [[*kept, *group][k] for k in first.tolist()], both[first]
        return kept, effects

    def refitted(self, state: Extended, moves: Sequence[tuple[Part, ...]]) -> list[Extended | None]:
        """The plants with further parts, refitted."""
        return [self._refitted(state, (*state.parts, *move)) for move in moves]

    def smaller(self, state: Extended) -> list[Extended]:
        """The plants without each of the parts in turn that the linearised plant does not clearly need."""
        found = []
        for part in state.parts:
            if self._needed(state.reached, part) > CLEARLY:
                continue
            less = self._refitted(state, tuple(each for each in state.parts if each is not part))
            found.append(replace(less, without=part))
        return found

    def _needed(self, reached: Reached, part: Part) -> float:
        """By how much the criterion prefers the plant with a part, its output linearised: ‖r‖² grows by θᵀ·C⁻¹·θ."""
        problem, minimum = reached.problem, reached.minimum
        free = [
            k
            for k in np.flatnonzero(minimum.free).tolist()
            if k >= len(reached.names) or reached.names[k] not in part.names
        ]
        blocks = problem.linearised(problem.start)
        slopes, left = (np.concatenate([block[k] for block in blocks]) for k in (1, 0))
        values = {name: problem.plant.value(name) for name in part.names if name in reached.names}
        moved = -slopes[:, [reached.names.index(name) for name in values]] @ np.array([*values.values()])
        rest = slopes[:, free] / np.maximum(np.linalg.norm(slopes[:, free], axis=0), 1e-300)
        moved = moved - rest @ np.linalg.lstsq(rest, moved, rcond=None)[0]
        share = float(moved @ moved) / (float(left @ left) + float(moved @ moved))
        samples = effective_samples(reached.residuals)
        return _preferred([part], 1.0 - share, 1.0, samples)

    def gain(self, simple: Extended, rich: Extended) -> float:
        """By Schwarz's criterion and the prior, where the richer one saves something steadily."""
        (a, before), (b, after) = ((each.reached, each.parts) for each in (simple, rich))
        samples = effective_samples(b.residuals)
        found = _preferred(after, b.cost, a.cost, samples) - _preferred(before, 1.0, 1.0, samples)
        return min(found, 0.0) if len(after) > len(before) and not steady(rich.errors, simple.errors) else found

    def _refitted(self, state: Extended, parts: tuple[Part, ...]) -> Extended:
        task, start = self.with_parts(parts)
        task.control.doing(f"{start.name}: fitting {len(parts)} parts", len(state.parts))
        begun = state.reached.problem.plant.with_parts([*self._own, *parts])
        reached = continuation.search(task, begun, STEPS, state.reached.states)
        return Extended(reached, parts)


def _preferred(parts: Sequence[Part], error: float, than: float, samples: float) -> float:
    """By how much the criterion prefers a plant with parts to one without any; see `schwarz_gain`."""
    more = sum(len(each.names) for each in parts)
    return schwarz_gain(error, than, samples, more) + 2.0 * sum(log(each.prior) for each in parts)


def _parts_of(task: Task, plant: Plant) -> Sequence[Part]:
    """The possible parts that a plant has already."""
    handles: Mapping[str, Any] = plant.handles
    found = plant.possible_parts(task.segments, task.signals)
    return [each for each in found if all(name in handles for name in each.names)]


def _effects(problem: FreeRunError, groups: Sequence[Sequence[Part]]) -> Iterator[Array]:
    """Of every group (N, parts, k) the derivatives of the weighted error, every segment and channel."""
    plant, signals, weigh = problem.plant, problem.signals, problem.weighting
    assert not isinstance(weigh, tuple)  # the load of such a plant does not drift
    runs = [
        plant.effects_of_parts(groups, segment, state, signals)
        for segment, state in zip(problem.segments, problem.states(problem.start), strict=True)
    ]
    for of_segments in zip(*runs, strict=True):
        rows = []
        for segment, found in zip(problem.segments, of_segments, strict=True):
            for channel, scale in enumerate(problem.output_scale.tolist()):
                columns = found[:, channel].reshape(len(segment), -1) / scale
                if weigh is not all_alike:
                    columns = np.column_stack([weigh(column, segment.dt) for column in columns.T])
                rows.append(columns.reshape(found.shape[0], *found.shape[2:]))
        yield np.concatenate(rows)
