"""Summary of the study: a row for every model, and findings, also those beyond its two parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from emsid.estimation.borders import InternalError, collected, joined, tried
from emsid.estimation.fit import Ending
from emsid.findings import Finding, finite, plain
from emsid.plant import Motor
from emsid.study.models import (
    CHOSEN,
    EXPERIMENT,
    FIXED,
    FRICTION,
    IDENTIFICATION,
    LINEAR,
    MEANINGS,
    ONE_MASS,
    PAPER,
    PAPER_LOAD_FRICTION_MSE,
    SIMULATION,
    TWO_MASSES,
    UNSEEN,
    Settings,
    paper_ratio,
)
from emsid.study.survey import (
    FREE_RUN,
    MODELS,
    ONE_STEP,
    USUAL,
    Largest,
    LoadFriction,
    MotorRow,
    Richer,
    Survey,
    TwoMassRow,
)
from emsid.study.workflow import Part, Study
from emsid.validation.comparison import Row

# The paper's second-degree model is better than the linear one only if this ratio of free-run errors is exceeded.
NO_BETTER = 1.5


@dataclass(frozen=True)
class SummaryRow:
    """One model in one of the studies.

    Attributes:
        study: ``experiment`` or ``simulation``.
        model: its name.
        meaning: short description.
        parameters: how many were estimated.
        fit_percent: fit of the free run on unseen data.
        simulation_mse: MSE of that free run.
        better_identification, better_unseen: free-run MSE of the linear model divided by that of this model, on
            identification data and on unseen data; None where one of them diverged.
        paper_identification, paper_unseen: the same ratio of the paper's models; None where the paper has none.
        check: whether plant and model have the same equations and the data no noise, so that the row only checks the
            estimator.
    """

    study: str
    model: str
    meaning: str
    parameters: int
    fit_percent: float
    simulation_mse: float
    better_identification: float | None
    better_unseen: float | None
    paper_identification: float | None
    paper_unseen: float | None
    check: bool


def summary(part: Part, *, own_records: bool = False) -> list[SummaryRow]:
    """A row for every model of a study, by the first method it was fitted with."""
    meanings = MEANINGS | CHOSEN if own_records and part.name == EXPERIMENT else MEANINGS
    pair = (part.on_identification(LINEAR).row, part.on_unseen(LINEAR).row) if LINEAR in part.models else (None, None)
    linear_seen, linear_unseen = pair
    rows = []
    for model in part.models:
        seen, unseen = part.on_identification(model).row, part.on_unseen(model).row
        published = {data: paper_ratio(part.name, data) for data in (IDENTIFICATION, UNSEEN) if model == PAPER}
        rows.append(
            SummaryRow(
                part.name,
                model,
                meanings[model],
                unseen.parameters,
                unseen.fit_percent,
                unseen.simulation_mse,
                _better(linear_seen, seen),
                _better(linear_unseen, unseen),
                published.get(IDENTIFICATION),
                published.get(UNSEEN),
                model == TWO_MASSES,
            )
        )
    return rows


def _better(linear: Row | None, other: Row) -> float | None:
    """The free-run MSE of the linear model, if there is one, divided by that of another model."""
    if linear is None:
        return None
    known = np.isfinite([linear.simulation_mse, other.simulation_mse]).all() and other.simulation_mse > 0
    return linear.simulation_mse / other.simulation_mse if known else None


def study_data(result: Study) -> dict[str, Any]:
    """The content of ``study.json``."""
    curve, richer, survey, parts = result.load_friction, result.richer, result.survey, result.parts
    works: dict[str, Callable[[], Any]] = {
        "rows": lambda: [row.to_data() for row in result.rows],
        "summary": lambda: [asdict(row) for part in parts for row in summary(part, own_records=result.own_records)],
        "paper_ratios": lambda: [asdict(row) for part in parts for row in paper_ratios(part)],
        "load_friction_mse": lambda: result.load_friction_mse,
        "load_friction": lambda: asdict(curve) if curve else None,
        "excitation": lambda: {part.name: [asdict(excitation) for excitation in part.excitations] for part in parts},
        "richer_input": lambda: asdict(richer) if richer else None,
        "priors": lambda: {part.name: [asdict(prior) for prior in part.priors] for part in parts},
        "survey": lambda: survey.to_data() if survey else None,
    }
    with collected() as noted:
        data = {"schema": 4} | {name: tried(f"{name} in the file", work, None) for name, work in works.items()}
    data["findings"] = [finding.to_data() for finding in (*findings(result), *noted)]
    content: dict[str, Any] = plain(data)  # a free run that diverges has no finite error
    return content


HEADLINE = ("study-best-model", "study-paper-ratios", "study-even-terms", "study-what-decides")
"""The findings that sum up the study, in this order; the reason is one of the last two."""


def headline(found: Sequence[Finding]) -> list[Finding]:
    """What was found, in three findings at most: the best model, the paper's comparison, and the reason."""
    by_code = {finding.code: finding for finding in found}
    if "study-even-terms" in by_code:
        by_code.pop("study-what-decides", None)
    return [by_code[code] for code in HEADLINE if code in by_code]


def findings(result: Study) -> list[Finding]:
    """Findings about both studies, then about each, and about what failed."""
    works: dict[str, Callable[[], Iterable[Finding]]] = {
        "comparison with the paper": lambda: _compared(result),
        "best model": lambda: _best(result),
        "survey": lambda: about_the_survey(result.survey, result.settings),
    }
    for part in result.parts:
        richer = result.richer if part.name == EXPERIMENT and not result.own_records else None
        works |= {
            f"conditions of the {part.name}": partial(_of_part, result, part),
            f"excitation of the {part.name}": partial(about_excitation, part, richer),
            f"one-step errors of the {part.name}": partial(_prediction, part),
            f"recursive estimates of the {part.name}": partial(_recursion, part, result.settings.forgetting),
            f"models of the {part.name}": partial(_of_models, part),
        }
    works["friction on the load side"] = lambda: about_load_friction(
        result.load_friction, result.load_friction_mse, result.load_friction_mse / result.output_variance
    )
    with collected() as noted:
        found = joined(works)
    return [*found, *result.noted, *(each for each in noted if each not in result.noted)]


def _compared(result: Study) -> Iterable[Finding]:
    """The paper's comparison on its motor, and the reason of its result."""
    parts = [part for part in result.parts if part.name == SIMULATION or not result.own_records]
    ratios = [asdict(row) | {"study": part.called} for part in parts for row in paper_ratios(part)]
    if any(row["data"] == UNSEEN for row in ratios):
        yield Finding("study-paper-ratios", PAPER, {"rows": ratios})
    compared = [
        (part, _better(part.on_unseen(LINEAR).row, part.on_unseen(PAPER).row)) for part in parts if PAPER in part.models
    ]
    studies = [
        {"study": part.called, "better": better, "paper": paper_ratio(part.name, UNSEEN)}
        for part, better in compared
        if better is not None and better < NO_BETTER
    ]
    if studies and is_odd(result.settings.motor):
        yield Finding("study-even-terms", PAPER, {"studies": studies})


def _best(result: Study) -> Iterable[Finding]:
    """The best model of the first study."""
    rows = [row for row in summary(result.parts[0], own_records=result.own_records) if not row.check]
    best = max(rows, key=lambda row: row.better_unseen or 0.0)
    if best.better_unseen is not None:
        data = {"study": result.parts[0].called, "parameters": best.parameters}
        data |= {"fit_percent": best.fit_percent, "ratio": best.better_unseen}
        yield Finding("study-best-model", best.model, data)


def _of_part(result: Study, part: Part) -> Iterable[Finding]:
    if part.name == EXPERIMENT and not result.own_records:
        yield Finding("study-virtual-bench", part.name)
    if part.name == SIMULATION:
        yield Finding("study-noise-free", part.name)
    if TWO_MASSES in part.models:
        yield Finding("study-own-simulator", TWO_MASSES, {"study": part.called, "fixed": list(FIXED)})


def _of_models(part: Part) -> Iterable[Finding]:
    """Estimates that the data do not determine, and models that are not there."""
    yield from (finding for fit in part.fits for finding in fit.findings if finding.code == "forgetting-limited")
    for fit in part.fits:
        if fit.ending is Ending.RANK_DEFICIENT:
            data = {"study": part.called, "method": fit.method, "rank": int(fit.rank), "parameters": len(fit.names)}
            yield Finding("study-rank-deficient", fit.model.name, data)
    for model, why in part.failed.items():
        reason, internal = str(why).removeprefix(f"{model}: "), isinstance(why, InternalError)
        yield Finding("study-model-failed", model, {"study": part.called, "problem": reason, "internal": internal})


def _prediction(part: Part) -> Iterable[Finding]:
    """The largest ratio of free-run error to one-step error."""
    rows = [row for row in part.rows if row.data == UNSEEN and np.isfinite(row.simulation_mse)]
    rows = [row for row in rows if row.one_step_mse > 0]
    if rows:
        row = max(rows, key=lambda row: row.simulation_mse / row.one_step_mse)
        data = {"study": part.called, "method": row.method, "ratio": row.simulation_mse / row.one_step_mse}
        yield Finding("study-one-step", row.model, data)


def _recursion(part: Part, forgetting: float) -> Iterable[Finding]:
    """The largest difference between recursive and batch estimates."""
    recursive = [fit.model.name for fit in part.fits if fit.method == "rls"]
    pairs = [(part.on_unseen(model, "ls").row, part.on_unseen(model, "rls").row) for model in recursive]
    apart = [
        (abs(later.simulation_mse / batch.simulation_mse - 1), later.model)
        for batch, later in pairs
        if np.isfinite([batch.simulation_mse, later.simulation_mse]).all() and batch.simulation_mse > 0
    ]
    if apart:
        difference, model = max(apart)
        data = {"study": part.called, "difference": difference, "forgetting": forgetting}
        prior = next((row for row in part.priors if row.model == model), None)
        if prior is not None and forgetting == 1.0:
            data |= {"condition": prior.condition, "covariance": USUAL, "ridge": prior.ridge_usual}
            data |= {"vanishes_at": prior.vanishes_at}
        yield Finding("study-recursive-and-batch", model, data)


def is_odd(motor: Motor) -> bool:
    """Whether dead zone and friction are the same in both directions, which an even polynomial cannot describe."""
    zone, friction = motor.voltage_dead_zone or motor.torque_dead_zone, motor.rotor_friction
    return friction.symmetric and (zone is None or zone.b_l == -zone.b_r)


EVEN = 0.01
"""From this share on, the error of a linear model that is the same for u and −u matters."""


@dataclass(frozen=True)
class PaperRatios:
    """Linear divided by nonlinear MSE of the paper's two models, on one record.

    Attributes:
        study: ``experiment`` or ``simulation``.
        data: ``identification`` or ``unseen``.
        paper: as published; the paper does not say which of the two errors it is.
        free_run, one_step: of this study.
    """

    study: str
    data: str
    paper: float
    free_run: float
    one_step: float


def paper_ratios(part: Part) -> list[PaperRatios]:
    """The comparison that the paper makes, for one study; without models or records on which a free run diverges."""
    if not {LINEAR, PAPER} <= set(part.models):
        return []
    found = []
    for data, on in ((IDENTIFICATION, part.on_identification), (UNSEEN, part.on_unseen)):
        linear, paper = on(LINEAR).row, on(PAPER).row
        free_run = linear.simulation_mse / paper.simulation_mse
        one_step = linear.one_step_mse / paper.one_step_mse
        if np.isfinite([free_run, one_step]).all():
            found.append(PaperRatios(part.name, data, paper_ratio(part.name, data), free_run, one_step))
    return found


def about_the_survey(survey: Survey | None, settings: Settings) -> Iterator[Finding]:
    """Findings about other motors, inputs and records."""
    if survey is None or not survey.motors:
        return
    yield Finding("study-survey-recorded", "survey")
    if speaks_of(settings):
        rows = [asdict(row) for row in survey.inputs if row.model in (PAPER, FRICTION, ONE_MASS)]
        yield Finding("study-many-inputs", PAPER, {"rows": rows})
    yield _what_decides(survey.motors)
    yield _largest(survey.largest)
    if survey.two_masses and speaks_of(settings):
        yield _two_masses(survey.two_masses)


def speaks_of(settings: Settings) -> bool:
    """Whether the survey's inputs and two masses are of the settings' motor."""
    return settings.motor == Motor()


def _what_decides(rows: tuple[MotorRow, ...]) -> Finding:
    """The ratio of the paper's model where the error of the linear one is even, and where it is not."""
    even, odd = ([row.unseen[PAPER] for row in rows if (row.even_share >= EVEN) is which] for which in (True, False))
    always = {model: min(row.unseen[model] for row in rows if model in row.unseen) for model in MODELS[2:]}
    data = {
        "even": {"motors": len(even), "lowest": min(even), "highest": max(even)} if even else None,
        "odd": {"motors": len(odd), "lowest": min(odd), "highest": max(odd)} if odd else None,
        "always": always,
    }
    return Finding("study-what-decides", PAPER, data)


def _largest(rows: tuple[Largest, ...]) -> Finding:
    """The largest ratio of the paper's models, and which readings reach those of the paper."""
    free = [row for row in rows if row.error == FREE_RUN]
    ahead = [row for row in rows if row.error == ONE_STEP]
    usual, best = free[0], max(free, key=lambda row: row.unseen)
    published = {data: paper_ratio(SIMULATION, data) for data in (IDENTIFICATION, UNSEEN)}
    reached = [
        row.reading
        for row in (*free, *ahead)
        if row.identification >= published[IDENTIFICATION] and row.unseen >= published[UNSEEN]
    ]
    data = {
        "motors": usual.motors,
        "readings": len(free),
        "usual": asdict(usual),
        "largest": asdict(best),
        "one_step": max(row.unseen for row in ahead if row.reading == usual.reading),
        "published": [published[IDENTIFICATION], published[UNSEEN]],
        "reached": reached,
    }
    return Finding("study-largest-ratio", PAPER, data)


def _two_masses(rows: tuple[TwoMassRow, ...]) -> Finding:
    """How many intervals contain the truth on each record, and the largest error."""
    listed = []
    for row in rows:
        worst = max(row.errors, key=lambda name: abs(row.errors[name]))
        count = {"record": row.record, "parameters": len(row.errors), "covered": row.covered}
        listed.append({**count, "worst": worst, "error": row.errors[worst], "interval": row.intervals[worst]})
    return Finding("study-two-masses", TWO_MASSES, {"rows": listed, "fixed": sorted(rows[0].fixed)})


def about_load_friction(found: LoadFriction | None, mse: float, share: float) -> Iterator[Finding]:
    """What friction on the load costs; nothing without the curve."""
    if found is None:
        return
    data = {
        "mse": mse,
        "share": share,
        "paper": PAPER_LOAD_FRICTION_MSE,
        "at_most": found.shares[-1],
        "unfair_from": found.unfair_from,
        "visible_from": found.visible_from,
        "errors": [found.errors[0], found.errors[-1]],
        "difference": found.differences[-1],
    }
    yield Finding("study-load-friction", "load friction", data)


def about_excitation(part: Part, richer: Richer | None) -> Iterator[Finding]:
    """Order of excitation against the number of parameters, and what a richer input changes."""
    if not part.excitations or LINEAR not in part.models:
        return
    own = part.excitations[0]
    data: dict[str, Any] = {
        "study": part.called,
        "order": own.order,
        "parameters": len(part.on_unseen(LINEAR).fit.names),
    }
    data |= {"condition": own.conditions[PAPER], "crest_factor": own.crest_factor, "richer": None}
    if richer is not None:
        data["richer"] = {
            "order": richer.excitation.order,
            "condition": richer.excitation.conditions[PAPER],
            "crest_factor": richer.excitation.crest_factor,
            "errors": {name: [finite(each) for each in pair] for name, pair in richer.errors.items()},
        }
    yield Finding("study-excitation", part.name, data)
