"""The fit that a search ends in, with its intervals and its findings."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.restarts import SAME
from emsid.findings import Finding
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.free_run_error import FreeRunError
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.initial_state import InitialState
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.alternatives import alternatives, as_good, nothing
from emsid.models.plants.search.between_samples import taken_as_constant
from emsid.models.plants.search.conditions import conditions, unconditional
from emsid.models.plants.search.continuation import Reached, colour_of, identified_by
from emsid.models.plants.search.diagnostics import likelihood_profile
from emsid.models.plants.search.load_drift import load_drift
from emsid.models.plants.search.missing import acting_alike, missing
from emsid.models.plants.search.result import GreyBoxFit, combinations, findings_of, table
from emsid.models.plants.search.rising import rising
from emsid.models.plants.search.rounding import Rounded, within_rounding
from emsid.models.plants.search.slow_drift import slow_drift
from emsid.models.plants.search.slow_noise import slow_noise
from emsid.models.plants.search.task import Task
from emsid.models.plants.search.trusted_length import trusted_length
from emsid.models.plants.search.unlogged_input import Unlogged, unlogged_input

Array = NDArray[np.float64]

SEARCHES = "searches-agreeing"
"""The code of the finding that says how many searches ended at a minimum."""


def concluded(task: Task, start: Plant, reached: Reached) -> GreyBoxFit:
    """The fit with its table, its combinations and its findings."""
    problem, names, steps = reached.problem, reached.names, reached.steps
    minimum = reached.minimum.judged()
    found, states = problem.plant, problem.states(problem.start)
    whole = problem if len(names) == len(task.asked) else task.problem(found, task.asked, states)
    identifiability = identified_by(whole, task.asked, minimum)
    held, others = unconditional(len(names)), [nothing(len(names))]
    rounded = Rounded(problem, minimum, ())
    unlogged = Unlogged(frozenset(), nothing(len(names)))
    if reached.unended:
        unlogged = unlogged_input(task, problem, names, minimum)
        others = [
            model_error(task, problem, names, minimum)
            for model_error in (alternatives, slow_noise, slow_drift, load_drift)
        ]
        others.append(unlogged.addition)
        inseparable = [name for group in identifiability.groups for name in group]
        held = conditions(task, found, names, minimum.free, states, float(minimum.noise_variance) ** 0.5, inseparable)
        rounded = within_rounding(task, problem, names, minimum)
    own, estimated = slice(len(names)), rounded.minimum
    moved = estimated is not minimum
    if moved:
        found, states = rounded.problem.plant, rounded.problem.states(rounded.problem.start)
    estimated.covariance[own, own] += sum(each.covariance for each in others)
    widened = held.widening(names, estimated.covariance[own, own], found)
    # what was held says nothing about the residual
    estimated = replace(estimated, covariance=estimated.covariance.copy())
    estimated.covariance[own, own] += held.covariance
    rows = table(task, found, start, names, estimated, held, unlogged.names)
    together = combinations(found, names, identifiability, estimated, held)
    together = tuple(each for each in together if unlogged.names.isdisjoint(each.parameters))
    findings = findings_of(task, found, names, estimated, identifiability, rows, together)
    more: list[Finding] = []
    if reached.unended:
        more += [*taken_as_constant(task, problem, minimum), *trusted_length(task, problem)]
        more += [*missing(task, problem, names, minimum), *acting_alike(task, problem, names, together)]
        more += rounded.findings
        findings = tuple(_tried_without(task, problem, minimum, each) for each in findings)
    more += rising(rounded.problem if moved else problem, names, estimated.covariance[own, own])
    findings = (*widened, *(finding for each in others for finding in each.findings), *more, *findings)
    if minimum.ending is Ending.CONVERGED and names and "minimum-not-smooth" not in {each.code for each in findings}:
        findings = (*findings, searches_agreeing(found.name, reached.cost, reached.ends, reached.compared))
    if reached.unended and _shaft_unseen(task, reached):
        findings = (Finding("no-shaft-seen", found.name, {"simpler": "rigid-motor"}), *findings)
    for k in [k for k, name in enumerate(names) if name in unlogged.names]:
        estimated.covariance[k], estimated.covariance[:, k], estimated.covariance[k, k] = 0.0, 0.0, np.inf
    at_bound = {("parameter-at-bound", name) for name in unlogged.names}
    findings = tuple(each for each in findings if (each.code, each.subject) not in at_bound)
    fit = estimated.fit(GreyBox(found, task.signals), tuple(names), "gn")
    return _with_bounds_profiled(
        GreyBoxFit(
            **{f: getattr(fit, f) for f in Fit.__dataclass_fields__ if f not in OWN},
            iterations=steps,
            findings=findings,
            table=rows,
            output_noise=np.std(problem.errors(), axis=1),
            combinations=together,
            identifiability=identifiability,
            segments=task.segments,
            states=tuple(states),
            begins=InitialState.FREE if moved else task.begins,
            weighting=task.weighting,
            limits=task.limits,
            cost=minimum.cost,
            colour=colour_of(reached.minimum, len(names)),
            of_held=np.diag(held.covariance),
        ),
        task.control,
    )


OWN = ("findings", "iterations", "table", "output_noise")
"""What a fit of a plant has of its own."""


def searches_agreeing(model: str, cost: float, ends: Sequence[float], compared: int = 1) -> Finding:
    """How many searches ended at a minimum.

    Args:
        model: its name.
        cost: of the minimum.
        ends: costs at which other searches ended.
        compared: of how many starts the best was searched from.
    """
    agreeing = 1 + sum(end <= (1 + SAME) * cost for end in ends)
    return Finding(SEARCHES, model, {"searches": 1 + len(ends), "agreeing": agreeing, "compared": compared})


def _tried_without(task: Task, problem: FreeRunError, minimum: Minimum, finding: Finding) -> Finding:
    """A finding about intervals that include zero, with those parameters without which a refit is as good."""
    driven = problem.plant.of_record(0)
    slow = isinstance(driven, DrivenPlant) and not driven.is_one_mass
    if finding.code != "intervals-include-zero" or slow:
        return finding
    without = []
    for name in finding.data["parameters"]:
        with suppress(EmsidError, Stopped):
            left = [each for each in problem.free if each != name]
            begun = task.problem(problem.plant.with_values({name: 0.0}), left, problem.states(problem.start))
            refit = continuation.search_once(begun, task)
            if as_good(refit.cost, minimum.cost, problem):
                without.append(name)
    return replace(finding, data={**finding.data, "without": without})


def _with_bounds_profiled(fit: GreyBoxFit, control: Control) -> GreyBoxFit:
    """The fit with intervals of parameters at a physical bound, where a profile takes no time.

    Other bounds come from the user or a datasheet and do not show what the data say about the parameter.
    """
    physical = {
        finding.subject
        for finding in fit.findings
        if finding.code == "parameter-at-bound" and finding.data.get("because") == "physical"
    }
    plant = fit.model.plant
    if not physical or fit.ending is not Ending.CONVERGED or not isinstance(plant, DrivenPlant) or plant.secondary:
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
    """Whether a simpler plant is as good: the cost is higher by no more than noise explains (χ², at 95 %)."""
    from scipy.special import chdtri

    problem, names, minimum = reached.problem, reached.names, reached.minimum
    simpler = problem.plant.simpler(names)
    if simpler is None:
        return False
    plant, left = simpler
    states = problem.states(problem.start)
    try:
        rigid = continuation.search_once(task.problem(plant, left, states), task)
    except (EmsidError, Stopped):  # one mass is not even simulated, or there is no time for it
        return False
    noise = minimum.noise_variance * float(max(colour_of(minimum, len(names))))
    return rigid.cost - minimum.cost <= 0.5 * noise * float(chdtri(len(names) - len(left), 0.05))
