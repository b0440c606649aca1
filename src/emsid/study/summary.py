"""What the numbers of the study show: a row for every model, and findings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from emsid.estimation.fit import Ending
from emsid.findings import Finding
from emsid.plant import Motor
from emsid.study.models import LINEAR, MEANINGS, PAPER, TWO_MASSES
from emsid.study.setup import (
    EXPERIMENT,
    IDENTIFICATION,
    PAPER_LOAD_FRICTION_MSE,
    SIMULATION,
    VERIFICATION,
    paper_ratio,
)
from emsid.study.workflow import Part, Study
from emsid.validation.comparison import Row

# A ratio of free-run errors below which the paper's second-degree model is called no better than the linear one.
NO_BETTER = 1.5
# A share of the output's variance below which friction on the load is neglected.
NEGLIGIBLE = 1e-3


@dataclass(frozen=True)
class SummaryRow:
    """One model in one of the studies.

    Attributes:
        study: ``experiment`` or ``simulation``.
        model: its name.
        meaning: what it is, in a few words.
        parameters: how many were estimated.
        fit_percent: fit of the free run on the verification record.
        simulation_mse: MSE of that free run.
        better_identification, better_verification: how many times smaller the MSE of its free run is than that of the
            linear model, on either record; None where one of them diverged.
        paper_identification, paper_verification: the same of the paper's models, None where the paper has none.
        check: whether the plant and the model are the same equations and the data have no noise, so that the row checks
            the estimator and says nothing of a real motor.
    """

    study: str
    model: str
    meaning: str
    parameters: int
    fit_percent: float
    simulation_mse: float
    better_identification: float | None
    better_verification: float | None
    paper_identification: float | None
    paper_verification: float | None
    check: bool

    def to_data(self) -> dict[str, Any]:
        """By name, in built-in types."""
        return asdict(self)


def summary(part: Part) -> list[SummaryRow]:
    """A row for every model of a study, by the first method it was fitted with."""
    linear = (part.identified(LINEAR).row, part.verified(LINEAR).row)
    rows = []
    for model in part.models:
        seen, unseen = part.identified(model).row, part.verified(model).row
        published = {data: paper_ratio(part.name, data) for data in (IDENTIFICATION, VERIFICATION) if model == PAPER}
        rows.append(
            SummaryRow(
                part.name,
                model,
                MEANINGS[model],
                unseen.parameters,
                unseen.fit_percent,
                unseen.simulation_mse,
                _better(linear[0], seen),
                _better(linear[1], unseen),
                published.get(IDENTIFICATION),
                published.get(VERIFICATION),
                model == TWO_MASSES,
            )
        )
    return rows


def _better(linear: Row, other: Row) -> float | None:
    """How many times smaller the one error is than that of the linear model."""
    known = np.isfinite([linear.simulation_mse, other.simulation_mse]).all() and other.simulation_mse > 0
    return linear.simulation_mse / other.simulation_mse if known else None


def study_data(result: Study) -> dict[str, Any]:
    """What ``study.json`` holds."""
    return {
        "schema": 2,
        "rows": [row.to_data() for row in result.rows],
        "summary": [row.to_data() for part in result.parts for row in summary(part)],
        "load_friction_mse": result.load_friction_mse,
        "findings": [finding.to_data() for finding in findings(result)],
    }


def findings(result: Study) -> list[Finding]:
    """What a reader should know of the numbers; study by study, then what concerns both."""
    return [*(finding for part in result.parts for finding in _of_part(result, part)), _load_friction(result)]


def _of_part(result: Study, part: Part) -> Iterable[Finding]:
    known_motor = part.name == SIMULATION or not result.own_records
    if PAPER in part.models and known_motor:
        better = _better(part.verified(LINEAR).row, part.verified(PAPER).row)
        if is_odd(result.settings.motor) and better is not None and better < NO_BETTER:
            data = {"study": part.name, "better": better, "paper": paper_ratio(part.name, VERIFICATION)}
            yield Finding("study-even-terms", PAPER, data)
    if part.name == EXPERIMENT and not result.own_records:
        yield Finding("study-virtual-bench", part.name)
    if part.name == SIMULATION:
        yield Finding("study-noise-free", part.name)
    if TWO_MASSES in part.models:
        yield Finding("study-own-simulator", TWO_MASSES, {"study": part.name})
    yield from _prediction(part)
    yield from _recursion(part, result.settings.forgetting)
    for fit in part.fits:
        if fit.ending is Ending.RANK_DEFICIENT:
            data = {"study": part.name, "method": fit.method, "rank": int(fit.rank), "parameters": len(fit.names)}
            yield Finding("study-rank-deficient", fit.model.name, data)
    for model, why in part.failed.items():
        yield Finding("study-model-failed", model, {"study": part.name, "problem": why})


def _prediction(part: Part) -> Iterable[Finding]:
    """How much larger than the one-step error the free-run error is, at most."""
    rows = [row for row in part.rows if row.data == VERIFICATION and np.isfinite(row.simulation_mse)]
    rows = [row for row in rows if row.one_step_mse > 0]
    if rows:
        row = max(rows, key=lambda row: row.simulation_mse / row.one_step_mse)
        data = {"study": part.name, "method": row.method, "ratio": row.simulation_mse / row.one_step_mse}
        yield Finding("study-one-step", row.model, data)


def _recursion(part: Part, forgetting: float) -> Iterable[Finding]:
    """By how much recursive and batch estimates differ, at most."""
    recursive = [fit.model.name for fit in part.fits if fit.method == "rls"]
    pairs = [(part.verified(model, "ls").row, part.verified(model, "rls").row) for model in recursive]
    apart = [
        (abs(later.simulation_mse / batch.simulation_mse - 1), later.model)
        for batch, later in pairs
        if np.isfinite([batch.simulation_mse, later.simulation_mse]).all() and batch.simulation_mse > 0
    ]
    if apart:
        difference, model = max(apart)
        data = {"study": part.name, "difference": difference, "forgetting": forgetting}
        yield Finding("study-recursive-and-batch", model, data)


def _load_friction(result: Study) -> Finding:
    share = result.load_friction_mse / result.output_variance
    data = {
        "mse": result.load_friction_mse,
        "paper": PAPER_LOAD_FRICTION_MSE,
        "share": share,
        "negligible": share < NEGLIGIBLE,
    }
    return Finding("study-load-friction", "load friction", data)


def is_odd(motor: Motor) -> bool:
    """Whether dead zone and friction are the same in both directions, which an even polynomial cannot describe."""
    zone, friction = motor.voltage_dead_zone or motor.torque_dead_zone, motor.rotor_friction
    return friction.symmetric and (zone is None or zone.b_l == -zone.b_r)
