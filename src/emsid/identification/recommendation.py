"""The one model that is recommended, with reasons, and the experiment to run next.

The model with the smallest free-run error on unseen data is recommended, unless it is implausible and a plausible model
is as good within noise (`emsid.selection.improvement`). A model that cannot be used is not recommended at all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np

from emsid.findings import Finding, finite
from emsid.first_look.advice import advice
from emsid.first_look.dynamics import response
from emsid.identification.plausibility import IMPLAUSIBLE
from emsid.record import Record
from emsid.selection.improvement import StretchErrors, better
from emsid.validation.comparison import Assessment, Comparison

EXPERIMENTS = {
    "record-too-short": "longer",
    "feedback-likely": "without-feedback",
    "few-input-levels": "more-levels",
    "excitation-too-low": "more-levels",
    "amplitude-near-dead-zone": "larger-input",
    "sampling-too-slow": "faster-sampling",
    "coarse-values": "finer-sensor",
    "much-standstill": "larger-input",
}
"""The experiment that mends what the first look finds, the most important first."""
OF_REASONS = {
    "map-leaves-range": "fill-range",
    "map-turns-without-data": "fill-range",
    "knots-without-data": "fill-range",
    "pieces-differ": "repeat-input",
    "error-in-one-stretch": "repeat-input",
}
"""The experiment that shows what is behind a reason against a model."""
TWO_SIDED = 0.05
"""An input goes both ways if it reaches this share of its largest value on either side."""


def recommended_first(
    comparison: Comparison, implausible: Collection[str], excluded: Collection[str] = ()
) -> Comparison:
    """The models with the recommended one first: the best, or a plausible one that is as good within noise.

    Args:
        comparison: the models on the data that choose, the best free run first.
        implausible: the names of the models that are implausible.
        excluded: the names of models that are not recommended over any usable one, however small their error is.
    """
    if comparison.best.row.model in excluded:
        others = (each for each in comparison.assessments if each.row.model not in excluded and _usable(each))
        comparison = comparison.led_by(next(others, comparison.best))
    best = comparison.best
    if best.row.model not in implausible:
        return comparison
    other = next((each for each in comparison.assessments if each.row.model not in implausible), best)
    if other is best or not _usable(other) or better(_stretches(best), than=_stretches(other)):
        return comparison
    return comparison.led_by(other)


def _usable(assessment: Assessment) -> bool:
    """Whether a free run is better than the mean of the output."""
    return assessment.row.diverged_at is None and not assessment.row.fit_percent <= 0


def _stretches(assessment: Assessment) -> StretchErrors:
    """The squared free-run errors, each output in its own deviation."""
    record, counted = assessment.record, assessment.simulation.counted
    spread = record.output[counted].std(axis=0)
    errors = (record.output - assessment.simulation.output) / np.where(spread > 0, spread, 1.0)
    squares = np.mean(errors**2, axis=1)
    squares[~np.isfinite(squares)] = np.inf
    return StretchErrors.of(np.where(counted, squares, np.nan))


def recommendation(choice: Comparison, verdict: Finding, findings: Iterable[Finding], *, seen: bool) -> Finding:
    """The recommended model with the reasons for it.

    Args:
        choice: the models on the data that chose, the recommended one first.
        verdict: on the recommended model.
        findings: about the models.
        seen: whether the models were fitted to some of these data.
    """
    row = choice.best.row
    data: dict[str, Any] = {
        "fit_percent": finite(row.fit_percent),
        "models": len(choice.rows),
        "seen": seen,
        "verdict": verdict.code,
        "reasons": verdict.data["reasons"],
    }
    if verdict.code == "model-unusable":
        return Finding("no-model-recommended", row.model, data)
    smallest = min(choice.rows, key=lambda each: each.ranked_by)
    if smallest.ranked_by < row.ranked_by:
        against = [each for each in findings if each.model == smallest.model and each.code in IMPLAUSIBLE]
        because = {"code": against[0].code, **against[0].data} if against else None
        ratio = float(np.sqrt(row.ranked_by / smallest.ranked_by))
        data |= {"instead_of": smallest.model, "because": because, "ratio": ratio}
    return Finding("model-recommended", row.model, data)


def experiment(verdict: Finding, record: Record, unseen: Record, *, seen: bool) -> Finding:
    """The experiment to run next: what these data leave open first.

    Args:
        verdict: on the recommended model.
        record, unseen: what the models were fitted to, and ranked on.
        seen: whether the models were fitted to some of the unseen data.
    """
    looked = _first_look(record)
    for code, kind in EXPERIMENTS.items():
        if code in looked:
            return Finding("next-experiment", record.name, {"kind": kind, **looked[code].data})
    u = record.input[:, 0]
    reach = TWO_SIDED * float(np.max(np.abs(u)))
    if record.input.shape[1] == 1 and (u.min() > -reach or u.max() < reach):
        return Finding("next-experiment", record.name, {"kind": "both-directions", "input": record.input_names[0]})
    reasons: list[Mapping[str, Any]] = verdict.data["reasons"]
    for reason in reasons:
        if reason["code"] in OF_REASONS:
            return Finding("next-experiment", record.name, {"kind": OF_REASONS[reason["code"]], **_place(reason)})
    if seen or unseen.name.startswith(f"{record.name},"):
        return Finding("next-experiment", record.name, {"kind": "other-input"})
    return Finding("next-experiment", record.name, {"kind": "in-use"})


def _place(reason: Mapping[str, Any]) -> dict[str, Any]:
    """Where a map has hardly any data."""
    places = reason.get("knots", [reason["at"]] if "at" in reason else [])
    return {"at": list(places)} if places else {}


def _first_look(record: Record) -> dict[str, Finding]:
    """What the first look finds in the record, by code."""
    u, y = record.input[:, 0], record.output[:, 0]
    found = advice(record, response(u, y, record.breaks))
    return {each.code: each for each in reversed(found)}
