"""The choice of a plant: refinements are added while a criterion prefers them, and removed if it does not.

The search begins with the effects that every motor has. `refinements` lists further effects of real drives. The search
is greedy. In every round each refinement is fitted, from several starts, to the whole record, and the one that
Schwarz's criterion prefers most is added (`trials.gain`), until it prefers none. Then superfluous refinements are
removed in the same way. A delay, a lag and a mean over the sample have similar effects; they are exchanged if that is
better (`look_alikes`).

All of this is done in units of the record's own size (`scaling`), so the outcome does not depend on the units of its
channels. Only the last fit, with its intervals, is done in SI units.

**Drift.** The effect of a slow disturbance on the free run of a position never decays. The drift of the load is
estimated before and after these rounds (`load_drift`); if it changes, refinements are added and removed under the new
one. An initial state that agrees with the first samples (`beginning`) is estimated, as an inexact one looks like drift.

**Another system.** If the error of a plant with one refinement is several times that of a linear model or of a
nonlinear regression, the record is of another kind of system, and the plant is refined no further (`reference`).

**Intervals.** Of the refinements whose intervals include the value without effect (`support`), the one that costs least
is removed and the rest is fitted again, until there is none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf, log

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.restarts import AGREEING
from emsid.estimation.threads import in_threads, one_blas_thread
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.plants.beginning import InitialState
from emsid.models.plants.datasheet import Given, applicable
from emsid.models.plants.drifting_load import DriftingLoad
from emsid.models.plants.drive import Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import Weighting, all_alike, threads_for
from emsid.models.plants.grey_box import check_channels, signals_of
from emsid.models.plants.neutral import with_usual_sizes
from emsid.models.plants.parameters import Signal, bounds_of_parts, without_overlap
from emsid.models.plants.plant import Plant
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search import kinds
from emsid.models.plants.search.between_samples import as_hold, holds_in, is_open
from emsid.models.plants.search.conclusion import SEARCHES, searches_agreeing
from emsid.models.plants.search.estimation import searched, simulation_error
from emsid.models.plants.search.load_drift import WHITE, alike, chosen
from emsid.models.plants.search.look_alikes import in_place
from emsid.models.plants.search.reference import Reference
from emsid.models.plants.search.refinements.catalogue import (
    ADDED,
    BREAKS,
    BY_DIRECTION,
    DELAYS,
    EXTRAPOLATES,
    INSTEAD,
    REFINEMENTS,
    simplified,
    without_effect,
)  # fmt: skip
from emsid.models.plants.search.refinements.contract import Refined, Refinement
from emsid.models.plants.search.refinements.stribeck_shape import usual_shape
from emsid.models.plants.search.refinements.switching_loss import switching_loss
from emsid.models.plants.search.refinements.usual import by_direction, stribeck
from emsid.models.plants.search.result import GreyBoxFit, with_choices
from emsid.models.plants.search.scaling import Scaling
from emsid.models.plants.search.starts import started
from emsid.models.plants.search.support import unsupported
from emsid.models.plants.search.task import all_known, known_values
from emsid.models.plants.search.thinning import thinned
from emsid.models.plants.search.trials import KEPT, Trial, Trials, begun_with, gain, has_load, joined, not_needed, rank
from emsid.record import Record
from emsid.record.excerpt import excerpt
from emsid.selection.improvement import better

Array = NDArray[np.float64]
Rule = Callable[[Trial, Trial], float]
"""A rule of choice between a simpler and a richer trial; see `choose`."""
STARTS: Mapping[str, Plant] = {name: kind.start for name, kind in PLANTS.items()}
"""The plant of every kind that a search without other knowledge begins with."""

MOST = 8
"""How many refinements may be added, and how many removed."""
OTHERS = 2
"""First starts from which a refinement is tried too, besides the best plant so far."""
RESTARTS = 8
"""The most fits of a chosen plant from points around its minimum; they end when `AGREEING` of them agree."""
SCREENED, PIECES, CONFIRMED = 10_000, 4, 5
"""Where trials see more than twice `SCREENED` samples, refinements are fitted to an excerpt of that many samples in
`PIECES` pieces first, and only the best `CONFIRMED` of them to all."""
POSITIVE = 2.0
"""By how much Schwarz's criterion prefers an unusual friction, at least: positive evidence (Kass, Raftery 1995)."""
PASSES = 3
"""The most passes of adding and removing refinements, as another structure may need another weighting."""
AKAIKE = 2.0
"""The increase of Akaike's criterion for a parameter."""
STRONG = 10.0
"""Schwarz's criterion is strong evidence above this (Kass, Raftery, *Bayes factors*, JASA 90 (1995))."""


@one_blas_thread()
def choose(
    plant: DrivenPlant,
    record: Record,
    *,
    fixed: Mapping[str, float | str] | None = None,
    datasheet: Mapping[str, Given] | None = None,
    weighting: Weighting | None = None,
    hold: Hold | str | None = None,
    per_record: str | Sequence[str] = (),
    refinements: Sequence[Refinement] = REFINEMENTS,
    rule: Rule = gain,
    linear: float = inf,
    regression: Callable[[], float] | None = None,
    control: Control = FREE,
) -> GreyBoxFit:
    """The plant with the refinements that the record supports, fitted to all of it.

    Args:
        plant: to begin with.
        record: what to identify from.
        fixed: as in `simulation_error`; they hold for every trial.
        datasheet: likewise, as far as it is `applicable` to the plant.
        weighting: how errors count by their age; chosen where it is None.
        hold: as in `simulation_error`.
        per_record: likewise; the refinements are chosen with the same values in all records.
        refinements: what is tried.
        rule: by how much the richer of two trials (simple, rich) is preferred; negative for the simpler.
        linear: the share of the output's variance that a linear model leaves in free run; a plant with one refinement
            that leaves much more is refined no further.
        regression: gives the same share for a nonlinear regression.
        control: when to stop; the best plant so far is then the answer.
    """
    plant = plant.for_command(record)
    values, sheet = known_values(plant, fixed, applicable(datasheet or {}, plant))
    unknown = (name for name, given in sheet.items() if given.value is None)
    free = without_overlap(plant, (*plant.default_free, *unknown), values)
    plant = with_usual_sizes(plant.measured_by(all_known(values, sheet), free), free, values)
    if not refinements:
        return simulation_error(
            plant, record, free=free, fixed=values, datasheet=sheet, weighting=weighting or all_alike, hold=hold,
            per_record=per_record, control=control,
        )  # fmt: skip
    search = _Choice(plant, record, free, values, sheet, hold, control)
    how = weighting or (all_alike if plant.turn else None)  # gravity pulls a joint back: its errors do not add up
    stopped = search.run(how, refinements, rule, Reference(linear, regression))
    last = {"max_iterations": 0, "control": Control(cancelled=control.cancelled)} if stopped else {"control": control}

    def concluded() -> GreyBoxFit:
        return simulation_error(
            search.found, record, free=search.asked, fixed=values, datasheet=sheet,
            weighting=search.weighting_of(record), hold=hold if search.between_samples_open else search.found.hold,
            per_record=per_record, find_start=False, **last,
        )  # fmt: skip

    fit = concluded()
    while (
        not stopped and fit.ending is not Ending.INTERRUPTED and search.take_out(unsupported(fit, search.asked, free))
    ):
        fit = concluded()
    if search.trial.ends:
        said = searches_agreeing(plant.name, search.trial.cost, [cost for cost, _ in search.trial.ends])
        fit = replace(fit, findings=tuple(said if each.code == SEARCHES else each for each in fit.findings))
    findings = [Finding("choice-interrupted", plant.name)] if stopped else []
    if search.another_system:
        data = {"left": search.left, "linear": linear, "regression": search.reference.by_regression}
        findings.append(Finding("probably-another-system", plant.name, data))
    table = with_choices(fit, plant)
    return replace(fit, ending=stopped or fit.ending, findings=(*findings, *fit.findings), table=table)


class _Choice:
    """A search for refinements in units of the record's own size.

    Attributes:
        trial: the best plant so far.
        asked: its free parameters, whether the record identifies them or not.
        another_system: whether the search ended because another model leaves much less of the output.
        reference: such models.
        thinned: whether trials see fewer samples than there are.
    """

    def __init__(
        self,
        plant: DrivenPlant,
        record: Record,
        free: tuple[str, ...],
        fixed: Mapping[str, float],
        sheet: Mapping[str, Given],
        hold: Hold | str | None,
        control: Control,
    ) -> None:
        signals = signals_of(plant, record)
        check_channels(plant, signals, record)
        self._original, self._scaling = plant, Scaling.of(plant, record)
        whole, physical = self._scaling.record(record, signals, plant.drive.loaded), self._scaling.limits(plant)
        scaled = self._fewer(whole, signals, hold)
        self.thinned = scaled is not whole
        hold = Hold.ZERO if self.thinned else hold
        task, _, reached = searched(
            self._scaling.to(plant, record.input.shape[1]),
            replace(scaled, input_units=(), output_units=()),
            free=free,
            fixed=self._scaling.values(plant, fixed),
            datasheet=self._scaling.datasheet(plant, sheet),
            bounds={name: physical[name] for name in free if physical[name][0] > plant.handles[name].lower},
            signals=signals,
            hold=hold,
            control=control,
        )
        self._may_be_straight = hold is None and is_open(plant, record.segments)
        start = reached.problem.plant
        assert isinstance(start, DrivenPlant)
        self.asked, self._fixed = free, tuple(fixed)
        self.another_system, self.reference = False, Reference(inf, None)
        self._record = scaled
        limits = {**physical, **bounds_of_parts(plant, task.limits), **task.limits}
        complete = whole if self.thinned and signals == (Signal.POSITION,) else None
        self._trials = Trials(task.segments, signals, limits, all_alike, control, complete, begins=task.begins)
        self._rng = np.random.default_rng(0)
        self._starts = [start]
        if not start.secondary:  # the search has looked at the others already, and every step is slow
            self._starts += started(start, task.segments, signals, self._fixed)
        self.trial = Trial(start, tuple(reached.names), reached.states, reached.cost, [])

    def _fewer(self, record: Record, signals: Sequence[Signal], hold: Hold | str | None) -> Record:
        """The record for trials, with a held command if it has fewer samples; of a position, one segment at most."""
        speed = signals == (Signal.SPEED,)
        if self._original.drive.codes or not (speed or (signals == (Signal.POSITION,) and len(record.segments) == 1)):
            return record
        straight = is_open(self._original, record.segments) if hold is None else as_hold(hold) is not Hold.ZERO
        return thinned(record, straight, speed)

    @property
    def found(self) -> DrivenPlant:
        """The best plant so far, in SI units."""
        return self._scaling.back(self.trial.plant, self._original)

    @property
    def weighting(self) -> Weighting:
        """The weighting of errors by their age, or the drift of the load."""
        return self._trials.weighting

    def weighting_of(self, record: Record) -> Weighting:
        """The weighting for the last fit, in SI units and for all samples."""
        if not isinstance(self.weighting, tuple):
            return self.weighting
        found, signals, weightings = self.found, self._trials.signals, []
        states = [self._scaling.output * state for state in self.trial.states]
        drifting = zip(record.segments, self._record.segments, states, self.weighting, strict=True)
        for segment, fewer, state, each in drifting:
            drifted = each.loads / self.trial.plant.largest_force(fewer.input)
            drift = each.drift._replace(noise=self._scaling.output * each.drift.noise)
            weightings.append(DriftingLoad.around(found, segment, state, signals, drift, drifted))
        return tuple(weightings)

    @property
    def left(self) -> float:
        """The share of the output's variance that the best plant so far leaves in free run."""
        return self.trial.mean_square / float(np.var(self._record.output))

    @property
    def between_samples_open(self) -> bool:
        """Whether the last fit decides on the hold of the command."""
        return not self.another_system and (self.thinned or self.found.hold is not Hold.ZERO)

    def run(
        self, weighting: Weighting | None, refinements: Sequence[Refinement], rule: Rule, reference: Reference
    ) -> Ending | None:
        """Choose the weighting where it is None, add and remove refinements; how it was ended early, if it was."""
        self._rule, self.reference = rule, reference
        try:
            self._begin(all_alike if weighting is None else weighting)
            if not self.trial.residuals:
                return None
            if weighting is None:
                self._weigh(*self._rich())
            for _ in range(PASSES):
                self._add([each for each in refinements if each not in INSTEAD])
                if self.another_system:
                    break
                if self._exchange(refinements):  # beside it another short time may be seen that it hid
                    effects = {ADDED[each]: each for each in DELAYS if each in refinements}
                    self._add(self._trials.most_promising(self.trial, self._fixed, effects), most=1)
                self._remove()
                if weighting is not None or not self._weigh([self.trial.plant], self.trial.names):
                    break
        except Stopped as stop:
            return stop.ending
        return None

    def _begin(self, weighting: Weighting) -> None:
        self._trials = replace(self._trials, weighting=weighting)
        self._starts = self._trials.by_cost(self._starts, self.trial.names)
        self._fit_again(self._starts[:KEPT])  # no others would be searched from

    def _fit_again(self, starts: Sequence[DrivenPlant], states: Sequence[Array] | None = None) -> None:
        found = self._trials.fitted(starts, self.trial.names, states)
        if found is not None:
            self._take(found)

    def _rich(self) -> tuple[list[DrivenPlant], tuple[str, ...]]:
        """Starts of a plant with what friction has most often, unless something of it is fixed, and what is free."""
        plant, names = self.trial.plant, self.trial.names
        if any(name in self._fixed for name in plant.default_free):
            return [plant], names
        starts = [(plant, names)]
        for refine in (by_direction, stribeck):
            starts = [new for each in starts for new in refine(*each, self._record)] or starts
        return [each for each, _ in starts], starts[0][1]

    def _weigh(self, starts: Sequence[DrivenPlant], names: Sequence[str]) -> bool:
        """Estimate the drift of the load with a structure, linearised there; whether it has changed."""
        before, found = self.weighting, chosen(self._trials, starts, names, self.trial.states)
        if found is None and before is all_alike:
            return False
        self._trials = found or replace(self._trials, weighting=all_alike, begins=InitialState.SAMPLES)
        self._fit_again([self.trial.plant], self.trial.states)
        return not alike(self.weighting, before)

    def _gain(self, simple: Trial, rich: Trial) -> float:
        """By how much the richer of two trials is preferred: by the rule, or Akaike's for a constant load that drifts.

        Many samples do not make the drift smaller, so Schwarz's penalty is too large for this parameter.
        """
        more = has_load(rich) - has_load(simple)
        drifts = isinstance(self.weighting, tuple) and self._rule is gain
        return self._rule(simple, rich) + (more * (log(effective_samples(rich.residuals)) - AKAIKE) if drifts else 0.0)

    def _add(self, refinements: Sequence[Refinement], most: int = MOST) -> None:
        tried: list[Trial | None] = [None] * len(refinements)
        added: Refinement | None = None
        for done in range(most):
            self._doing(f"trying {len(refinements)} refinements", done)
            groups = [begun_with(each, self.trial, self._starts[:OTHERS], self._record) for each in refinements]
            for group, before in zip(groups, tried, strict=True):
                if group and before is not None and added is not None:
                    group += joined(before, added, self.trial, self._record)
            tried = self._tried_from_neutral(self._screened(groups))
            self._doing("adding refinements", done)
            richer = [
                (trial, refine)
                for trial, refine in zip(tried, refinements, strict=True)
                if trial is not None and self._gain(self.trial, trial) > 0
            ]
            gains = {id(trial): self._gain(self.trial, trial) for trial, _ in richer}
            others = [trial for trial, _ in richer]
            richer.sort(key=lambda pair: rank(pair[0], others, gains), reverse=True)
            best, added = next((pair for pair in richer if self._is_safe(*pair)), (None, None))
            if best is not None:
                self._trials, best = self._trials.settled(best)
                self._take(best)
            self.another_system = done == 0 and self.reference.is_much_less(self.left)
            if best is None or self.another_system:
                break

    def _tried_from_neutral(self, groups: Sequence[Sequence[Refined]]) -> list[Trial | None]:
        """Trials of refined plants; one that ends above the best plant begins there again, without effect.

        A refinement without effect is the plant without it, so no minimum with it is higher.
        """
        tried, above = self._tried(groups), []
        for group, trial in zip(groups, tried, strict=True):
            search = group and (trial is None or trial.cost > self.trial.cost)
            above.append(without_effect(group[0], self.trial.plant, self.trial.names) if search else [])
        return [
            min((each for each in both if each is not None), key=lambda each: each.cost, default=None)
            for both in zip(tried, self._tried(above), strict=True)
        ]

    def _is_safe(self, trial: Trial, refine: Refinement) -> bool:
        """Whether the record has both cases that a refinement distinguishes, and a break improves both.

        With one that extrapolates it is better by more than noise, also on what it was not fitted to.
        """
        if refine in BREAKS:
            return kinds.better_on_both_sides(self._trials, trial, self.trial, BREAKS[refine])
        if refine is switching_loss:
            return kinds.better_at_full_duty_and_below(self._trials, trial, self.trial)
        if refine in BY_DIRECTION:
            return kinds.both_directions_seen(self._trials)
        if refine in DELAYS:
            return kinds.better_in_both_changes(self._trials, trial, self.trial)
        if refine in EXTRAPOLATES:
            return better(trial.errors, self.trial.errors) and kinds.better_on_kinds(self._trials, trial, self.trial)
        return True

    def _exchange(self, refinements: Sequence[Refinement]) -> bool:
        """Take look-alikes in the place of each other, and another hold; whether a look-alike was taken."""
        groups = in_place(self.trial.plant, self.trial.names, self._original, refinements, self._record)
        exchanged = [(self._gain(self.trial, each), each) for each in self._tried(list(groups)) if each is not None]
        gained, best = max(exchanged, key=lambda pair: pair[0], default=(0.0, self.trial))
        if gained > 0:
            self._take(best)
        shaped = self._tried([usual_shape(self.trial.plant, self.trial.names)])[0]
        if shaped is not None and gain(shaped, self.trial) < POSITIVE:
            self._take(shaped)
        if self._may_be_straight:
            self._exchange_hold()
        return gained > 0

    def _exchange_hold(self) -> None:
        """Take another hold if it changes the simulation of some segment and improves that of all."""
        segments = self._record.segments
        seen = [holds_in(self.trial.plant, segments)]
        for hold in (Hold.ZERO, Hold.RECORD, Hold.FIRST):
            other = self.trial.plant.with_hold(hold)
            if (held := holds_in(other, segments)) not in seen:
                seen.append(held)
                exchanged = self._tried([[(other, self.trial.names)]])[0]
                if exchanged is not None and exchanged.cost < self.trial.cost:
                    self._take(exchanged)

    def _remove(self) -> None:
        for done in range(MOST):
            self._doing("removing refinements", done)
            tried = self._tried([[each] for each in simplified(self.trial.plant, self.trial.names)])
            enough = [trial for trial in tried if trial is not None and self._gain(trial, self.trial) < 0]
            if not enough:
                break
            self._take(min(enough, key=lambda trial: self._gain(trial, self.trial)))

    def take_out(self, changes: Sequence[frozenset[str]]) -> bool:
        """Remove the refinement that costs least among those that change these free names; whether there is one.

        None is removed without which the error is larger by more than noise.
        """
        names = frozenset(self.trial.names)
        groups = [[each] for each in simplified(self.trial.plant, self.trial.names) if names ^ set(each[1]) in changes]
        try:
            enough = not_needed([trial for trial in self._tried(groups) if trial is not None], self._needed)
            if enough:
                self._take(min(enough, key=lambda each: each.cost))
        except Stopped:
            return False
        return bool(enough)

    def _needed(self, without: Trial) -> bool:
        """Whether a trial without a refinement has an error that is larger by more than noise.

        If the residual is white, strong evidence by Schwarz's criterion is accepted too: for a rate, or for parameters
        that compensate for each other, an interval from the derivatives is less reliable.
        """
        samples = sum(len(residual) for residual in self.trial.residuals)
        white = effective_samples(self.trial.residuals) >= WHITE * samples
        return better(self.trial.errors, without.errors) or (white and self._gain(without, self.trial) > STRONG)

    def _doing(self, what: str, done: int) -> None:
        self._trials.control.doing(f"{self._original.name}: {what}", done)

    def _screened(self, groups: Sequence[Sequence[Refined]]) -> Sequence[Sequence[Refined]]:
        """Starts for `_tried`: for a long record only the groups that are best on an excerpt; the others become empty.

        A position is not cut into pieces, of which each would need an initial state of its own.
        """
        if len(self._record) <= 2 * SCREENED or self._trials.signals == (Signal.POSITION,):
            return groups
        few = replace(self._trials, segments=excerpt(self._record, SCREENED, PIECES).segments)
        plain = few.fitted([self.trial.plant], self.trial.names)
        if plain is None:
            return groups
        found = self._tried(groups, few)
        gains = [-np.inf if trial is None else self._rule(plain, trial) for trial in found]
        best = set(np.argsort(gains)[-CONFIRMED:].tolist())
        kept = enumerate(found)
        return [[(trial.plant, trial.names)] if k in best and trial is not None else [] for k, trial in kept]

    def _tried(self, groups: Sequence[Sequence[Refined]], few: Trials | None = None) -> list[Trial | None]:
        """A trial for each group of starts with the same free names; None if none can be simulated.

        Args:
            groups: of starts, each a plant and its free names.
            few: trials over other samples than those of the search.
        """
        known = {name: self.trial.plant.value(name) for name in self._fixed}

        def tried(starts: Sequence[Refined]) -> Trial | None:
            starts = [each for each in starts if all(each[0].value(name) == known[name] for name in known)]
            names = without_overlap(starts[0][0], starts[0][1], self._fixed) if starts else ()
            if not names:
                return None
            plants = [plant for plant, _ in starts]
            return self._trials.fitted(plants, names, self.trial.states) if few is None else few.fitted(plants, names)

        with in_threads(threads_for(self._trials.segments)) as in_turn:
            return list(in_turn(tried, groups))

    def _take(self, trial: Trial) -> None:
        """Continue with a trial, or a better one near it."""
        trial = self._trials.around(trial, self._rng, RESTARTS, AGREEING)
        before, after = self.trial.names, trial.names
        kept = [name for name in self.asked if name not in before or name in after]
        self.asked = (*kept, *(name for name in after if name not in kept))
        self.trial = trial
