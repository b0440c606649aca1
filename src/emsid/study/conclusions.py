"""What the study says beyond its two parts: findings about motors, inputs, the paper's ratios, friction on the load."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from emsid.findings import Finding, finite
from emsid.plant import Motor
from emsid.study.inputs import Richer
from emsid.study.load_friction import LoadFriction
from emsid.study.models import FRICTION, LINEAR, ONE_MASS, PAPER, TWO_MASSES
from emsid.study.motors import MODELS
from emsid.study.setup import IDENTIFICATION, PAPER_LOAD_FRICTION_MSE, SIMULATION, UNSEEN, Settings, paper_ratio
from emsid.study.survey import FREE_RUN, ONE_STEP, Largest, MotorRow, Survey, TwoMassRow
from emsid.study.workflow import Part

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
    data: dict[str, Any] = {"study": part.name, "order": own.order, "parameters": len(part.on_unseen(LINEAR).fit.names)}
    data |= {"condition": own.conditions[PAPER], "crest_factor": own.crest_factor, "richer": None}
    if richer is not None:
        data["richer"] = {
            "order": richer.excitation.order,
            "condition": richer.excitation.conditions[PAPER],
            "crest_factor": richer.excitation.crest_factor,
            "errors": {name: [finite(each) for each in pair] for name, pair in richer.errors.items()},
        }
    yield Finding("study-excitation", part.name, data)
