r"""The physical parameters of a plant from records, by the error of its free run.

The steps have modules of their own: the task (`task`), start values (`starts`), the search (`continuation`, which
minimises `emsid.models.plants.free_run_error`), and the table and findings of the result (`result`).

Not every parameter can be identified from every record: from voltage and speed of a rigid motor, R_a, K_m and J can be
anything that keeps K_m/(R_a·J) and K_m²/(R_a·J). Some are then kept at their start, those first that a datasheet most
likely has right. The fit lists them with their values, and the combinations that do not depend on them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear import restarts
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.restarts import RESTARTS, SLOW, TURNS, confirmed
from emsid.estimation.threads import one_blas_thread
from emsid.findings import Finding
from emsid.models.plants.drive import Hold
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError, Weighting, all_alike
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.initial_state import InitialState, as_seen, starts_from_samples
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal, parts
from emsid.models.plants.plant import BEGINNING, Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.between_samples import as_hold, is_open, straight_if_better
from emsid.models.plants.search.by_record import (
    asked_together,
    experiments,
    known_by_record,
    own_names,
    separated,
    typical_values,
)
from emsid.models.plants.search.conclusion import concluded
from emsid.models.plants.search.continuation import LOOK, Reached, identified_by, keep_identifiable
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.plants.search.second_starts import second_starts
from emsid.models.plants.search.starts import starts_of, usual_rates
from emsid.models.plants.search.task import Task, prepare
from emsid.models.plants.search.trials import Trial, Trials
from emsid.plant import Motor
from emsid.record import Record

Array = NDArray[np.float64]


@one_blas_thread()
def simulation_error(
    plant: Plant | Motor,
    records: Record | Iterable[Record],
    *,
    free: str | Sequence[str] | None = None,
    fixed: Mapping[str, float | str] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    datasheet: Mapping[str, Any] | None = None,
    signals: str | Signal | Sequence[str | Signal] | None = None,
    weighting: Weighting = all_alike,
    hold: Hold | str | None = None,
    per_record: str | Sequence[str] = (),
    find_start: bool = True,
    max_iterations: int = 60,
    threads: int | None = None,
    control: Control = FREE,
) -> GreyBoxFit:
    """The physical parameters that minimise the error of the free run over one or several records.

    Args:
        plant: what to fit, with its parameters as the start; a bare `Motor` gets a drive and a sensor without effect.
        records: a record, or several experiments, all with one set of parameters.
        free: the parameters to estimate, by name or symbol; by default those that are usually unknown for this kind.
        fixed: values that are known, by name or symbol, in SI units or as texts with a unit; they are not estimated.
            Intervals include the tolerance of ``"2 ohm ± 5 %"``; without one they hold only if the value is right, and
            say so where it matters. ``NAME[RECORD]`` is the value in one record, by its name, and needs one in all.
        bounds: (lower, upper) by name, in addition to what is physical.
        datasheet: what is known beforehand, by name or symbol: a value is the start, and a tolerance bounds it. Each is
            a number in SI units, a text with a unit (``"2 ohm"``), ``{"value": "2 ohm", "tolerance": "10 %"}``,
            ``"unknown"``, or a `Given`.
        signals: the quantities of the outputs, `Signal` or its name; by default from their units.
        weighting: how errors count by their age: `all_alike`, `Recent`, or any other linear filter (error, dt) → error.
        hold: the course of the command between its samples: ``"zero"`` (held), ``"first"`` (straight to the next) or
            ``"record"`` (straight in records where it changes smoothly at every sample and never jumps). By default the
            one that simulates the records better.
        per_record: parameters with a value of their own in every record, by name or symbol, such as the load; all
            others are shared. For another record the model uses their medians.
        find_start: whether to begin at the datasheet, or at the result of a regression on the records if that simulates
            better; otherwise the search begins with the plant as given.
        max_iterations: of the search, all its rounds together; a parameter that is kept only in the end adds a few.
        threads: how many, by default as many as there are cores.
        control: when to stop, and where to report every step.

    Raises:
        ModelError: for names that the plant does not have, bounds that exclude a start, a datasheet that contradicts
            itself.
        DataError: for records without motion, with other channels, in other units, or with an output of the wrong sign.
    """
    plant = DrivenMotor(plant) if isinstance(plant, Motor) else plant
    how: dict[str, Any] = {
        "free": free, "fixed": fixed, "bounds": bounds, "datasheet": datasheet, "signals": signals,
        "weighting": weighting, "hold": hold, "find_start": find_start, "max_iterations": max_iterations,
        "threads": threads, "control": control,
    }  # fmt: skip
    if per_record or any("[" in name for name in fixed or ()):
        return _by_record(plant, records, per_record, **how)
    return concluded(*searched(plant, records, **how))


def searched(
    plant: Plant,
    records: Record | Iterable[Record],
    *,
    hold: Hold | str | None = None,
    find_start: bool = True,
    max_iterations: int = 60,
    **asked: Any,
) -> tuple[Task, Plant, Reached]:
    """The search of `simulation_error`, with the same arguments: the task, the start of the search and its end.

    As a start for other searches it takes less time than a fit, as it computes no intervals.
    """
    task = prepare(
        plant if hold is None else plant.with_hold(as_hold(hold)), records, from_datasheet=find_start, **asked
    )
    drifts = isinstance(task.weighting, tuple)  # then what a model leaves is noise, which bends no initial state
    begins = InitialState.FREE if drifts else InitialState.SAMPLES
    task = replace(task, hold_given=hold is not None, begins=begins)
    starts = starts_of(task) if find_start else [task.plant]
    start = _promising(task, starts)
    reached = continuation.search(task, start, max_iterations)._replace(compared=len(starts))
    if find_start and reached.unended:
        reached = beside_kinks(task, reached, max_iterations)
    if max_iterations and reached.unended:
        reached = held_as_seen(task, reached, max_iterations)
    first = reached = begun_again(task, reached, max_iterations)
    if starts_from_samples(task.plant, task.signals) and reached.unended:
        with suppress(Stopped):
            begin = reached.problem.plant if find_start else start
            task, reached = _begun_as_seen(task, reached, begin, max_iterations)
            if find_start and reached is not first:  # a start that was off took other parameters to zero
                reached = beside_kinks(task, reached, max_iterations)
    if not task.hold_given and reached.unended and is_open(task.plant, task.segments):
        reached = straight_if_better(task, reached, max_iterations)
    if reached is not first and reached.unended:
        reached = begun_again(task, reached, max_iterations)
    return task, start, reached


def _by_record(
    plant: Plant,
    records: Record | Iterable[Record],
    per_record: str | Sequence[str],
    free: str | Sequence[str] | None,
    **options: Any,
) -> GreyBoxFit:
    """The fit with some parameters for every record, begun at the one with the same for all; of one record the same."""
    segments = experiments(records)
    fixed, known = known_by_record(plant, options["fixed"])
    options["fixed"] = {**fixed, **typical_values(plant, known, segments)}
    own = own_names(plant, per_record, fixed, known)
    free = asked_together(plant, free, own, options["fixed"])
    own = tuple(side for name in own for side in (name in (free or own) and [name]) or parts(plant, name))
    hold = options.pop("hold")  # decided where the records have their own values
    together = simulation_error(plant, segments, free=free, hold=plant.hold if hold is None else hold, **options)
    if len({segment.experiments[0] for segment in segments}) == 1:
        alone = Finding("single-record", segments[0].name, {"parameters": list(own)})
        return replace(together, findings=(alone, *together.findings))
    options["fixed"] = fixed
    kept = ("fixed", "bounds", "datasheet", "max_iterations", "threads", "control")
    given = {"hold_given": hold is not None, **{name: options[name] for name in kept}}
    return separated(together, segments, (*own, *known), known, **given)


def _begun_as_seen(task: Task, reached: Reached, begin: Plant, max_iterations: int) -> tuple[Task, Reached]:
    """A search with initial states from the first samples, or estimated ones, or at rest, as the records allow."""

    def search(start: InitialState, before: Reached | None) -> Reached:
        if start is task.begins:
            return reached
        plant = begin if before is None else before.problem.plant
        return continuation.search(replace(task, begins=start), plant, max_iterations)

    found = as_seen(task.segments, reached.cost, search)
    return (task, reached) if found is None else (replace(task, begins=found[0]), found[1])


def _trials(task: Task) -> Trials:
    return Trials(task.segments, task.signals, task.limits, task.weighting, task.control, begins=task.begins)


def _promising(task: Task, starts: Sequence[Plant]) -> Plant:
    """The start with the lowest cost after a few steps; the first one if steps are slow, as with an elastic shaft."""
    first = starts[0]
    if len(starts) == 1 or first.secondary or not isinstance(first, DrivenPlant):
        return first
    identified = identified_by(task.problem(first, task.asked), task.asked, None)
    names = keep_identifiable(identified, task.asked, task.preference)
    try:
        return _trials(task).promising([each for each in starts if isinstance(each, DrivenPlant)], names)
    except Stopped:
        return first


def beside_kinks(task: Task, reached: Reached, max_iterations: int) -> Reached:
    """A search, or a better one from the other side of a kink of its cost; see `second_starts`.

    Coulomb friction, a dead zone and a Stribeck excess with a low rate have nearly the same effect. If a search takes
    one of them to zero, the others compensate for it, and it stays zero. So the search begins again where it ended,
    with that parameter above zero, and usual rates. The effect of a delay has a kink at every whole number of samples,
    where a held command changes, and that of a knee at every level of a command in steps. So a search begins again with
    a delay that is half a sample shorter or longer, with other knees, and with parameters of nearly the same effect
    exchanged.
    """
    plant = reached.problem.plant
    if not isinstance(plant, DrivenPlant) or plant.secondary:
        return reached
    names = [name for name in task.asked if name in reached.names or plant.value(name) == 0]
    with suppress(EmsidError, Stopped):
        for values in second_starts(task, plant, names):
            free = [name for name in task.asked if name in names or any(name in each for each in values)]
            trial = _trials(task).fitted([plant.with_values(each) for each in values], free) if values else None
            if trial is not None and trial.cost < (1 - SLOW) * reached.cost:
                reached = reached.or_better(continuation.search(task, trial.plant, max_iterations))
            elif trial is not None:
                reached = reached._replace(ends=(*reached.ends, trial.cost))
    return reached


def held_as_seen(task: Task, reached: Reached, max_iterations: int) -> Reached:
    """A search of a speed, or a better one with other initial states; see `GreyBox.initial_state`.

    A noisy first speed does not show whether the first command acts before the record. If it does not, the search has
    biased the initial speed and the delay. So further samples decide, with the plant that was found.
    """
    plant = reached.problem.plant
    if not isinstance(plant, DrivenPlant) or plant.secondary or starts_from_samples(plant, task.signals):
        return reached
    model, states = GreyBox(plant, task.signals), reached.states
    with suppress(EmsidError, Stopped):
        others = [model.initial_state(segment, BEGINNING) for segment in task.segments]
        here, there = (_squares(task.problem(plant, (), each)) for each in (states, others))
        if np.sum(np.maximum(here - there, 0.0)) > 2 * SLOW * reached.cost:
            begin = [other if less else state for state, other, less in zip(states, others, there < here, strict=True)]
            return reached.or_better(continuation.search(task, plant, max_iterations, begin))
    return reached


def _squares(problem: FreeRunError) -> Array:
    """(segments,) the sum of squares of the weighted error of every segment."""
    return np.array([float(error @ error) for error in problem.residuals(problem.start)])


def begun_again(task: Task, reached: Reached, max_iterations: int) -> Reached:
    """The best of a search that did not converge and of some that begin around its end, until none of them is better.

    Costs of free runs have narrow, bent valleys. A search that used up its steps may also have followed a rate of
    Stribeck friction without limit, so it begins again with usual rates too. Searches that are limited to a few steps
    do not begin again.
    """
    plant, rng = reached.problem.plant, np.random.default_rng(0)
    if not isinstance(plant, DrivenPlant):
        stalled = reached.minimum.ending is Ending.STALLED
        return _own_begun_again(task, reached, max_iterations) if stalled else reached
    may_end = max_iterations < LOOK or bool(plant.secondary)
    with suppress(Stopped):
        for _ in range(TURNS):
            used_up = reached.minimum.ending is Ending.OUT_OF_BUDGET
            if not (reached.minimum.ending is Ending.STALLED or (used_up and not may_end)):
                break
            here = _trial(reached)
            there = _trials(task).around(here, rng, RESTARTS, RESTARTS)
            others = [_usual(task, here)] if used_up else []
            best = min([there, *(each for each in others if each is not None)], key=lambda each: each.cost)
            if best.cost < here.cost or used_up:
                reached = reached.or_better(continuation.search(task, best.plant, max_iterations))
            if reached.minimum.ending is Ending.STALLED and tuple(reached.names) == there.names:
                reached = reached._replace(minimum=confirmed(reached.minimum, there.ends))
            if reached.cost > (1 - SLOW) * here.cost:
                break
    return reached


def _trial(reached: Reached) -> Trial:
    plant = reached.problem.plant
    assert isinstance(plant, DrivenPlant)
    return Trial(plant, tuple(reached.names), reached.states, reached.cost, reached.residuals)


def _usual(task: Task, trial: Trial) -> Trial | None:
    """A trial begun again with usual rates of Stribeck friction; None where it has none."""
    rates = usual_rates(task, trial.names)
    return _trials(task).fitted([trial.plant.with_values(rates)], trial.names, trial.states) if rates else None


def _own_begun_again(task: Task, reached: Reached, max_iterations: int) -> Reached:
    """The same for a plant without a drive, such as a user's own."""
    problem = reached.problem
    lower, upper = problem.within({name: task.limits[name] for name in reached.names})

    def search(theta: Array, **options: Any) -> Minimum:
        with problem.under(task.control):
            return gauss_newton(
                problem, np.clip(theta, lower, upper), lower=lower, upper=upper, noise=problem.precision,
                names=problem.names, control=task.control, **options,
            )  # fmt: skip

    with suppress(Stopped):
        minimum = restarts.begun_again(reached.minimum, search, len(reached.names), task.control)
        if minimum.cost >= reached.cost:
            return reached._replace(minimum=minimum)
        again = continuation.search(task, problem.plant_at(minimum.estimate), max_iterations)
        return again if again.cost < reached.cost else reached
    return reached
