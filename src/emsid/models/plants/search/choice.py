"""The choice of a plant: what its score promises is added while a criterion prefers it, and taken out if it does not.

The search begins with the effects that every motor has. `moves` lists further effects of real drives. They are scored,
refitted and taken by the driver of all searches (`emsid.models.search.driver`). Schwarz's criterion decides, where the
larger plant saves something all along the record (`steady`): an effect that only one stretch shows may be chance, or a
break of which the record has one side.

All of this is done in units of the record's own size (`scaling`), so the outcome does not depend on the units of its
channels. Only the last fit, with its intervals, is done in SI units.

**Drift.** The effect of a slow disturbance on the free run of a position never decays. The drift of the load is
estimated before and after the search (`load_drift`); if it changes, the search goes on under the new one. An initial
state that agrees with the first samples (`initial_state`) is estimated, as an inexact one looks like drift.

**Another system.** If the error of a plant with one addition is several times that of a linear model or of a
nonlinear regression, the record is of another kind of system, and nothing is added any more (`reference`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, log

import numpy as np
from numpy.typing import NDArray

from emsid.arguments import did_you_mean
from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.restarts import AGREEING
from emsid.estimation.threads import in_threads, one_blas_thread
from emsid.estimation.uncertainty.coloured_residuals import effective_samples
from emsid.findings import Finding
from emsid.models.plants.datasheet import Given, applicable
from emsid.models.plants.drifting_load import DriftingLoad
from emsid.models.plants.drive import Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, Weighting, all_alike, threads_for
from emsid.models.plants.grey_box import check_channels, signals_of
from emsid.models.plants.initial_state import InitialState
from emsid.models.plants.parameters import Signal, bounds_of_parts, without_overlap
from emsid.models.plants.plant import Plant
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.between_samples import as_hold, holds_in, is_open
from emsid.models.plants.search.conclusion import SEARCHES, searches_agreeing
from emsid.models.plants.search.estimation import searched, simulation_error
from emsid.models.plants.search.load_drift import WHITE, alike, chosen
from emsid.models.plants.search.missing import ALIKE
from emsid.models.plants.search.moves import MOVES, Addition, Situation, additions, moves_of
from emsid.models.plants.search.reference import Reference
from emsid.models.plants.search.result import GreyBoxFit, with_choices
from emsid.models.plants.search.scaling import Scaling
from emsid.models.plants.search.scored import bounds_of, effect_of, score_at
from emsid.models.plants.search.starts import started
from emsid.models.plants.search.task import all_known, known_values
from emsid.models.plants.search.thinning import thinned
from emsid.models.plants.search.trials import KEPT, Trial, Trials, gain, has_load
from emsid.models.plants.state import HELD
from emsid.models.search.driver import climb
from emsid.models.search.score import Promise, Score
from emsid.record import Record
from emsid.selection.improvement import steady

Array = NDArray[np.float64]
Start = tuple[DrivenPlant, tuple[str, ...]]
"""A plant to begin with and what is estimated of it."""
Group = tuple[Sequence[DrivenPlant], tuple[str, ...], tuple[Addition, ...]]
"""Plants to begin one trial with, what is estimated, and what they have in addition."""
STARTS: Mapping[str, Plant] = {name: kind.start for name, kind in PLANTS.items()}
"""The plant of every kind that a search without other knowledge begins with."""

RESTARTS = 8
"""The most fits of a chosen plant from points around its minimum; they end when `AGREEING` of them agree."""
PASSES = 3
"""The most searches, as another structure may need another weighting."""
AKAIKE = 2.0
"""The increase of Akaike's criterion for a parameter."""


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
    effects: str | Sequence[str] | None = None,
    linear: float = inf,
    regression: Callable[[], float] | None = None,
    control: Control = FREE,
) -> GreyBoxFit:
    """The plant with the additions that the record supports, fitted to all of it.

    Args:
        plant: to begin with.
        record: what to identify from.
        fixed: as in `simulation_error`; they hold for every trial.
        datasheet: likewise, as far as it is `applicable` to the plant.
        weighting: how errors count by their age; chosen where it is None.
        hold: as in `simulation_error`.
        per_record: likewise; additions are chosen with the same values in all records.
        effects: names of what is tried, such as ``("delay", "stribeck")``; by default what suits this kind of plant.
        linear: the share of the output's variance that a linear model leaves in free run; nothing more is added to a
            plant with one addition that leaves much more.
        regression: gives the same share for a nonlinear regression.
        control: when to stop; the best plant so far is then the answer.

    Raises:
        ModelError: for an effect that is not known.
    """
    plant = plant.for_command(record)
    values, sheet = known_values(plant, fixed, applicable(datasheet or {}, plant))
    unknown = (name for name, given in sheet.items() if given.value is None)
    free = without_overlap(plant, (*plant.default_free, *unknown), values)
    plant = plant.measured_by(all_known(values, sheet), free)
    effects = moves_of(plant) if effects is None else (effects,) if isinstance(effects, str) else tuple(effects)
    for name in effects:
        if name not in MOVES:
            raise ModelError(f"no effect {name!r}; there are {', '.join(MOVES)}{did_you_mean(name, MOVES)}")
    if not effects:
        return simulation_error(
            plant, record, free=free, fixed=values, datasheet=sheet, weighting=weighting or all_alike, hold=hold,
            per_record=per_record, control=control,
        )  # fmt: skip
    search = _Choice(plant, record, free, values, sheet, hold, control)
    how = weighting or (all_alike if plant.turn else None)  # gravity pulls a joint back: its errors do not add up
    stopped = search.run(how, effects, Reference(linear, regression))
    last = {"max_iterations": 0, "control": Control(cancelled=control.cancelled)} if stopped else {"control": control}

    fit = simulation_error(
        search.found, record, free=search.asked, fixed=values, datasheet=sheet,
        weighting=search.weighting_of(record), hold=hold if search.between_samples_open else search.found.hold,
        per_record=per_record, find_start=False, **last,
    )  # fmt: skip
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
    """The search for additions in units of the record's own size; a `Family` of the driver.

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
            self._starts += started(start, task.segments, signals, reached.names)
        load = start.load_name
        without = (Addition("load", start.with_values({load: 0.0}), (load,)),) if load in free else ()
        self._begun_with = len(without)
        self.trial = Trial(start, tuple(reached.names), reached.states, reached.cost, [], added=without)

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
        states = [np.append(self._scaling.output * state[:HELD], state[HELD:]) for state in self.trial.states]
        for segment, state, each in zip(record.segments, states, self.weighting, strict=True):
            drift = each.drift._replace(noise=self._scaling.output * each.drift.noise)
            weightings.append(DriftingLoad.around(found, segment, state, signals, drift, each.drifted))
        return tuple(weightings)

    @property
    def left(self) -> float:
        """The share of the output's variance that the best plant so far leaves in free run."""
        return self.trial.mean_square / float(np.var(self._record.output))

    @property
    def between_samples_open(self) -> bool:
        """Whether the last fit decides on the hold of the command."""
        return not self.another_system and (self.thinned or self.found.hold is not Hold.ZERO)

    def run(self, weighting: Weighting | None, effects: Sequence[str], reference: Reference) -> Ending | None:
        """Choose the weighting where it is None, and search for additions; how it was ended early, if it was."""
        self._effects, self.reference = effects, reference
        try:
            self._begin(all_alike if weighting is None else weighting)
            if not self.trial.residuals:
                return None
            if weighting is None:
                self._weigh(*self._rich())
            for _ in range(PASSES):
                climb(self.trial, self, self._taken)
                if self.another_system or (len(self.trial.added) == self._begun_with and self._is_another_system()):
                    return None
                if self._may_be_straight:
                    self._exchange_hold()
                if weighting is not None or not self._weigh([self.trial.plant], self.trial.names):
                    break
            self._take(self._trials.around(self.trial, self._rng, RESTARTS, AGREEING))
        except Stopped as stop:
            return stop.ending
        return None

    # --- the family -------------------------------------------------------------------------------------------------

    def likely(self, state: Trial) -> list[tuple[Addition, Promise]]:
        """The additions whose promise may be worth a parameter, the best of each effect, the most promising first.

        All of them where the present error is no noise: so far from the truth a derivative says little. In the place of
        what was taken out, only what promises about as much, not what no score can say: the same derivatives say what
        that one promises.
        """
        if state.without is not None and not state.without.scored:
            return []
        self._doing("scoring additions")
        problem = self._trials.problem_of(state)
        if problem is None:
            return []
        at = Situation(
            state.plant, state.names, self._trials.segments, self._trials.signals, scored=state.without is not None
        )
        known = {name: self.trial.plant.value(name) for name in self._fixed}
        rows = list(additions(at, self._fixed, self._effects, known))
        score = score_at(problem)
        with in_threads(threads_for(self._trials.segments)) as in_turn:
            promises = list(in_turn(lambda row: self._promised(problem, score, row), rows))
        best: dict[object, tuple[Addition, Promise]] = {}
        for row, promise in zip(rows, promises, strict=True):
            key = row.effect, row.names, row.law
            if promise is not None and (key not in best or promise.gain > best[key][1].gain):
                best[key] = row, promise
        samples = sum(map(len, state.residuals))
        poor = effective_samples(state.residuals) < WHITE * samples  # far from the truth, where no derivative is right
        likely = [pair for pair in best.values() if poor or pair[1].gain > 0]
        if state.without is not None:
            own = [pair for pair in likely if pair[0].effect == state.without.effect]
            least = ALIKE * max((promise.gain for _, promise in own), default=0.0)
            likely = [pair for pair in likely if pair not in own and pair[1].gain >= least]
        return sorted(likely, key=lambda pair: -round(pair[1].gain, 3))  # equal promises in the order of the table

    def _promised(self, problem: FreeRunError, score: Score, row: Addition) -> Promise | None:
        """What an addition promises; None where it cannot be simulated."""
        if not row.scored:
            return Promise(1.0, np.zeros(len(row.names)), 1.0, inf)
        with suppress(EmsidError):
            columns = effect_of(problem, row.start, row.names, row.probe)
            return score.promise(columns, *bounds_of(row.start, row.names), least=1.0)
        return None

    def refitted(self, state: Trial, moves: Sequence[tuple[Addition, Promise]]) -> list[Trial | None]:
        """The trials with additions, each from the step that its score promises and from usual values."""
        self._doing(f"trying {len(moves)} additions")
        return self._fitted([
            (row.begun(promise.step, self._bounds(row)), row.free(state.names), (*state.added, row))
            for row, promise in moves
        ], state)  # fmt: skip

    def smaller(self, state: Trial) -> list[Trial]:
        """The trials without each of the additions in turn."""
        self._doing("taking additions out")
        found = [(row, row.taken_out(state.plant, state.names)) for row in state.added]
        rest = [(row, each) for row, each in found if each is not None]
        tried = self._fitted([
            ([plain], names, tuple(other for other in state.added if other is not row)) for row, (plain, names) in rest
        ], state)  # fmt: skip
        both = zip(rest, tried, strict=True)
        return [replace(each, without=row) for (row, _), each in both if each is not None]

    def gain(self, simple: Trial, rich: Trial) -> float:
        """By how much the richer of two trials is preferred: by Schwarz's criterion, where it saves something steadily.

        Akaike's decides for a constant load that drifts: many samples do not make the drift smaller, so Schwarz's
        penalty is too large for this parameter.
        """
        more = has_load(rich) - has_load(simple)
        found = gain(simple, rich)
        if isinstance(self.weighting, tuple):
            found += more * (log(effective_samples(rich.residuals)) - AKAIKE)
        richer = len(rich.names) > len(simple.names)
        return min(found, 0.0) if richer and not steady(rich.errors, simple.errors) else found

    def _bounds(self, row: Addition) -> dict[str, tuple[float, float]]:
        handles, limits = row.start.handles, self._trials.limits
        names = {*row.names, *(name for each in row.begins for name in each)}
        return {name: limits.get(name, (handles[name].lower, handles[name].upper)) for name in names}

    def _fitted(self, groups: Sequence[Group], state: Trial) -> list[Trial | None]:
        """A trial for each group; None if none of its starts can be simulated."""

        def tried(group: Group) -> Trial | None:
            plants, free, added = group
            names = without_overlap(plants[0], free, self._fixed)
            found = self._trials.fitted(plants, names, state.states) if names else None
            return None if found is None else replace(found, added=added)

        with in_threads(threads_for(self._trials.segments)) as in_turn:
            return list(in_turn(tried, groups))

    def _taken(self, trial: Trial, how: str) -> bool:
        """Go on with a trial, unless another model leaves much less than it with its first addition."""
        first = how == "added" and len(trial.added) == 1 + self._begun_with
        self._take(trial)
        return not (first and self._is_another_system())

    def _is_another_system(self) -> bool:
        self.another_system = self.reference.is_much_less(self.left)
        return self.another_system

    # --- the weighting and the hold -----------------------------------------------------------------------------------

    def _begin(self, weighting: Weighting) -> None:
        self._trials = replace(self._trials, weighting=weighting)
        starts = self._trials.by_cost(self._starts, self.trial.names)
        self._fit_again(starts[:KEPT])  # no others would be searched from

    def _fit_again(self, starts: Sequence[DrivenPlant], states: Sequence[Array] | None = None) -> None:
        found = self._trials.fitted(starts, self.trial.names, states)
        if found is not None:
            self._take(replace(found, added=self.trial.added))

    def _rich(self) -> tuple[list[DrivenPlant], tuple[str, ...]]:
        """Starts of a plant with what friction has most often, unless something of it is fixed, and what is free."""
        plant, names = self.trial.plant, self.trial.names
        if any(name in self._fixed for name in plant.default_free):
            return [plant], names
        starts = [(plant, names)]
        for effect in ("coulomb-by-direction", "stribeck"):
            starts = [new for start in starts for new in self._with(effect, *start)] or starts
        return [each for each, _ in starts], starts[0][1]

    def _with(self, effect: str, plant: DrivenPlant, names: tuple[str, ...]) -> list[Start]:
        """Starts of a plant with an effect of friction; what is not split by direction begins at 0.3 of its level."""
        at = Situation(plant, names, self._trials.segments, self._trials.signals)
        level, rows = 0.3 * plant.value(at.level), additions(at, self._fixed, (effect,))
        return [
            (row.start.with_values({} if row.instead else dict.fromkeys(row.names, level)), row.free(names))
            for row in rows
        ]

    def _weigh(self, starts: Sequence[DrivenPlant], names: Sequence[str]) -> bool:
        """Estimate the drift of the load with a structure, linearised there; whether it has changed."""
        before, found = self.weighting, chosen(self._trials, starts, names, self.trial.states)
        if found is None and before is all_alike:
            return False
        self._trials = found or replace(self._trials, weighting=all_alike, begins=InitialState.SAMPLES)
        self._fit_again([self.trial.plant], self.trial.states)
        return not alike(self.weighting, before)

    def _exchange_hold(self) -> None:
        """Take another hold if it changes the simulation of some segment and improves that of all."""
        segments = self._record.segments
        seen = [holds_in(self.trial.plant, segments)]
        for hold in (Hold.ZERO, Hold.RECORD, Hold.FIRST):
            other = self.trial.plant.with_hold(hold)
            if (held := holds_in(other, segments)) not in seen:
                seen.append(held)
                exchanged = self._fitted([([other], self.trial.names, self.trial.added)], self.trial)[0]
                if exchanged is not None and exchanged.cost < self.trial.cost:
                    self._take(exchanged)

    def _doing(self, what: str) -> None:
        self._trials.control.doing(f"{self._original.name}: {what}", len(self.trial.added))

    def _take(self, trial: Trial) -> None:
        """Continue with a trial."""
        before, after = self.trial.names, trial.names
        kept = [name for name in self.asked if name not in before or name in after]
        self.asked = (*kept, *(name for name in after if name not in kept))
        self.trial = replace(trial, without=None)
