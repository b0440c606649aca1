r"""The physical parameters of a plant from records, by the error of its free run.

In steps that stand in modules of their own: what is asked (`task`), where the search starts (`starts`), the search
(`continuation`, on the problem of `problem`), and what is to be said of the result (`result`).

Not every parameter can be identified from every record: from voltage and speed of a rigid motor, R_a, K_m and J can be
anything that keeps K_m/(R_a·J) and K_m²/(R_a·J). Some are then kept at their start, in the order in which a datasheet
is likeliest to have them right, and the fit says which, at what, and which combinations do not depend on that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.restarts import RESTARTS, confirmed
from emsid.estimation.threads import one_blas_thread
from emsid.findings import Finding
from emsid.models.plants.beginning import agrees, starts_from_samples
from emsid.models.plants.drive import Hold
from emsid.models.plants.free_run_error import FreeRunError, Weighting, all_alike
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.alternatives import alternatives, nothing
from emsid.models.plants.search.between_samples import as_hold, is_open, promising
from emsid.models.plants.search.conditions import conditions, unconditional
from emsid.models.plants.search.continuation import LOOK, Reached, colour_of, identified_by, keep_identifiable
from emsid.models.plants.search.diagnostics import likelihood_profile
from emsid.models.plants.search.result import GreyBoxFit, combinations, findings_of, table
from emsid.models.plants.search.slow_drift import slow_drift
from emsid.models.plants.search.starts import starts_of
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
    find_start: bool = True,
    max_iterations: int = 60,
    threads: int | None = None,
    control: Control = FREE,
) -> GreyBoxFit:
    """The physical parameters that minimise the error of the free run over one or several records.

    Args:
        plant: what to fit, with its parameters as the start; a bare `Motor` gets a drive and a sensor without effect.
        records: a record, or several experiments, all with one set of parameters.
        free: the parameters to estimate, by name or symbol; by default what plants of this kind usually have unknown.
        fixed: values that are known, by name or symbol, in SI units or as texts with a unit; they are not estimated.
            Intervals include the tolerance of ``"2 ohm ± 5 %"``; without one they hold only if the value is right, and
            say so where it matters.
        bounds: (lower, upper) by name, in addition to what is physical.
        datasheet: what is known beforehand, by name or symbol: a value is the start, and a tolerance bounds it. Each is
            a number in SI units, a text with a unit (``"2 ohm"``), ``{"value": "2 ohm", "tolerance": "10 %"}``,
            ``"unknown"``, or a `Given`.
        signals: what the outputs of the records are, `Signal` or its name, by default judged by their units.
        weighting: how errors count by their age: `all_alike`, `Recent`, or any other linear filter (error, dt) → error.
        hold: how the command goes on between its samples: ``"zero"`` (held), ``"first"`` (straight to the next) or
            ``"record"`` (straight in records where it changes smoothly at every sample and never jumps). By default
            whichever simulates the records better.
        find_start: whether to begin at the datasheet, or where a regression on the records says if that simulates
            better; otherwise the search begins with the plant as it is given.
        max_iterations: of the search, all its rounds together; a parameter that is kept only in the end adds a few.
        threads: how many, by default as many as there are cores.
        control: when to stop, and whom to tell of every step.

    Raises:
        ModelError: for names that the plant does not have, bounds that exclude a start, a datasheet that contradicts
            itself.
        DataError: for records without motion, with other channels, in other units, or with an output of the wrong sign.
    """
    plant = DrivenMotor(plant) if isinstance(plant, Motor) else plant
    task = prepare(
        plant if hold is None else plant.with_hold(as_hold(hold)),
        records,
        free=free,
        fixed=fixed,
        bounds=bounds,
        datasheet=datasheet,
        signals=signals,
        weighting=weighting,
        from_datasheet=find_start,
        threads=threads,
        control=control,
    )
    task = replace(task, hold_given=hold is not None, free_starts=not starts_from_samples(task.plant, task.signals))
    start = _promising(task, starts_of(task)) if find_start else task.plant
    first = reached = _begun_again(task, continuation.search(task, start, max_iterations), max_iterations)
    if not task.free_starts and reached.unended:
        freed = replace(task, free_starts=True)
        with suppress(Stopped):
            again = continuation.search(freed, reached.problem.plant, max_iterations)
            if _starts_agree(freed, again.problem):
                task, reached = freed, again
    if not task.hold_given and reached.unended and is_open(task.plant, task.segments):
        reached = _straight_if_better(task, reached, max_iterations)
    if reached is not first and reached.unended:
        reached = _begun_again(task, reached, max_iterations)
    return _concluded(task, start, reached)


def _straight_if_better(task: Task, reached: Reached, max_iterations: int) -> Reached:
    """Where the search ends with a command that goes straight from sample to sample, if that simulates better."""
    with suppress(Stopped):
        for straight in promising(task, reached.problem, reached.minimum.cost):
            again = continuation.search(task, straight, max_iterations)
            if again.minimum.cost < reached.minimum.cost:
                reached = again
    return reached


def _starts_agree(task: Task, problem: FreeRunError) -> bool:
    """Whether the estimated starts are such as the first samples of every segment show."""
    states = problem.states(problem.start)
    starts = [(segment, float(state[0]), float(state[1])) for segment, state in zip(task.segments, states, strict=True)]
    return all(agrees(segment, speed, position) for segment, speed, position in starts)


def _trials(task: Task) -> Trials:
    return Trials(task.segments, task.signals, task.limits, task.weighting, task.control)


def _promising(task: Task, starts: Sequence[Plant]) -> Plant:
    """The start that leads furthest down in a few steps; the first where steps are slow, as with an elastic shaft."""
    first = starts[0]
    if len(starts) == 1 or first.secondary or first.driven is None:
        return first
    identified = identified_by(task.problem(first, task.asked), task.asked, None)
    names = keep_identifiable(identified, task.asked, task.preference)
    try:
        return _trials(task).promising([plant for each in starts if (plant := each.driven) is not None], names)
    except Stopped:
        return first


def _begun_again(task: Task, reached: Reached, max_iterations: int) -> Reached:
    """The best of a search that stalled and of some that begin around its end: free runs have narrow, bent valleys."""
    driven = reached.problem.plant.driven
    if reached.minimum.ending is not Ending.STALLED or driven is None or driven.secondary:
        return reached
    states = reached.problem.states(reached.problem.start)
    residuals = reached.problem.residuals(reached.problem.start)
    here = Trial(driven, tuple(reached.names), states, reached.minimum.cost, residuals)
    with suppress(Stopped):
        there = _trials(task).around(here, np.random.default_rng(0), RESTARTS)
        if there.cost < here.cost:
            again = continuation.search(task, there.plant, max_iterations)
            reached = again if again.minimum.cost < reached.minimum.cost else reached
        if reached.minimum.ending is Ending.STALLED and tuple(reached.names) == there.names:
            return reached._replace(minimum=confirmed(reached.minimum, there.ends))
    return reached


def _concluded(task: Task, start: Plant, reached: Reached) -> GreyBoxFit:
    """The fit with its table, its combinations and what is to be said of it."""
    problem, names, steps = reached.problem, reached.names, reached.steps
    minimum = reached.minimum.judged()
    found, states = problem.plant, problem.states(problem.start)
    whole = problem if len(names) == len(task.asked) else task.problem(found, task.asked, states)
    identifiability = identified_by(whole, task.asked, minimum)
    held, others = unconditional(len(names)), [nothing(len(names))]
    if reached.unended:
        others = [model_error(task, problem, names, minimum) for model_error in (alternatives, slow_drift)]
        inseparable = [name for group in identifiability.groups for name in group]
        held = conditions(task, found, names, minimum.free, states, inseparable)
    own = slice(len(names))
    minimum.covariance[own, own] += held.covariance + sum(each.covariance for each in others)
    rows = table(task, found, start, names, minimum, held)
    together = combinations(found, names, identifiability, minimum, held)
    findings = findings_of(task, found, names, minimum, identifiability, rows, together)
    findings = (*(finding for each in others for finding in each.findings), *findings)
    if reached.unended and _shaft_unseen(task, reached):
        findings = (Finding("no-shaft-seen", found.name, {"simpler": "rigid-motor"}), *findings)
    fit = minimum.fit(GreyBox(found, task.signals), tuple(names), "gn")
    return _with_bounds_profiled(
        GreyBoxFit(
            **{f: getattr(fit, f) for f in Fit.__dataclass_fields__ if f not in ("findings", "iterations")},
            iterations=steps,
            findings=findings,
            table=rows,
            combinations=together,
            identifiability=identifiability,
            segments=task.segments,
            states=tuple(states),
            weighting=task.weighting,
            limits=task.limits,
            cost=minimum.cost,
            colour=colour_of(reached.minimum, len(names)),
        ),
        task.control,
    )


def _with_bounds_profiled(fit: GreyBoxFit, control: Control) -> GreyBoxFit:
    """The fit with intervals of parameters at a physical bound, where a profile takes no time.

    A bound that is not physical says what a parameter may be, not what the data say of it.
    """
    physical = {
        finding.subject
        for finding in fit.findings
        if finding.code == "parameter-at-bound" and finding.data.get("because") == "physical"
    }
    plant = fit.model.plant
    if not physical or fit.ending is not Ending.CONVERGED or plant.driven is None or plant.secondary:
        return fit
    rows = []
    for row in fit.table:
        interval = row.interval
        if row.name in physical:
            with suppress(EmsidError, Stopped):
                interval = likelihood_profile(fit, row.name, control=control).interval
        rows.append(replace(row, interval=interval))
    return replace(fit, table=tuple(rows))


def _shaft_unseen(task: Task, reached: Reached) -> bool:
    """Whether a simpler plant is as good: what the others gain is what noise gives them (χ², at 95 %)."""
    from scipy.special import chdtri

    problem, names, minimum, _ = reached
    simpler = problem.plant.simpler(names)
    if simpler is None:
        return False
    plant, left = simpler
    states = problem.states(problem.start)
    try:
        rigid = continuation.search_once(task.problem(plant, left, states), task, LOOK)
    except (EmsidError, Stopped):  # one mass is not even simulated, or there is no time for it
        return False
    noise = minimum.noise_variance * float(max(colour_of(minimum, len(names))))
    return rigid.cost - minimum.cost <= 0.5 * noise * float(chdtri(len(names) - len(left), 0.05))
