"""The one model that is recommended, with reasons, and the experiment to run next.

The simplest model is recommended that is as good as the best within noise (`emsid.selection.improvement`), by the free
runs over data that were left out of the fit (`ranking`). In a long record noise is small. There a plausible model with
far fewer parameters is the best one where the errors are the same in practice. An implausible model is the best one
only if its error is smaller than that of every plausible one by more than noise and by more than matters in practice.
Among equals one that is supported by the data comes before one with limits, and only then the number of parameters
counts; where the input has few levels, which show no nonlinearity, a linear one comes before both. The best one is
recommended unless it cannot be used, or one of the reasons of `emsid.identification.verdict.ALLOWED` is against it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from emsid.findings import Finding, finite
from emsid.first_look.data_advice import advice_by_code
from emsid.identification.plausibility import IMPLAUSIBLE
from emsid.identification.ranking import Ranked, close, compared, within_noise
from emsid.identification.verdict import ALLOWED
from emsid.record import Record
from emsid.selection.improvement import equivalent, simplest
from emsid.validation.comparison import Comparison

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
IN_LOOP = frozenset({"stable-model-of-unstable", "only-in-loop"})
"""The reasons against models of a plant that is unstable without its controller."""
FAR_FEWER = 3
"""A model has far fewer parameters than another if the other has so many times as many."""
TWO_SIDED = 0.05
"""An input goes both ways if it reaches this share of its largest value on either side."""


def recommended(
    ranking: Sequence[Ranked],
    implausible: Collection[str],
    unusable: Collection[str] = (),
    *,
    straight: Collection[str] = (),
    supported: Callable[[], Collection[str]] | None = None,
) -> Ranked:
    """The model to recommend: the best plausible one, or a simpler one that is as good within noise or in practice.

    An implausible model is recommended only where no plausible one is as good.

    Args:
        ranking: the models with their errors.
        implausible: the names of the models that are implausible.
        unusable: the names of models that are not recommended over any other, however small their error is.
        straight: the names of the linear models, which come first where they are as good; empty for no such preference.
        supported: gives the names of the models that the data support; it is asked for equals only.
    """
    usable = [each for each in compared(ranking) if each.name not in unusable] or compared(ranking)
    best = min(usable, key=lambda each: each.errors.mean)
    plausible = [each for each in usable if each.name not in implausible]
    if best.name in implausible:
        plausible = [each for each in plausible if _stands_in(each, best)]
    if not plausible:
        return simplest(usable, lambda each: each.size, as_good=close)
    top = min(plausible, key=lambda each: each.errors.mean)
    linear = [each for each in plausible if each.name in straight and _stands_in(each, top)]
    plausible = linear or plausible
    equals = [each for each in plausible if within_noise(each, min(plausible, key=lambda each: each.errors.mean))]
    if supported is not None and len(equals) > 1:
        names = supported()
        plausible = [each for each in equals if each.name in names] or plausible
    chosen = simplest(plausible, lambda each: each.size, as_good=close)
    small = [e for e in plausible if FAR_FEWER * e.size <= chosen.size and equivalent(e.errors, best.errors)]
    return min(small, key=lambda each: each.errors.mean, default=chosen)


def _stands_in(plausible: Ranked, best: Ranked) -> bool:
    """Whether a plausible model is as good as the best one, which is not, within noise or in practice."""
    return within_noise(plausible, best) or equivalent(plausible.errors, best.errors)


def recommendation(
    on_unseen: Comparison, ranking: Sequence[Ranked], verdict: Finding, findings: Iterable[Finding], *, seen: bool
) -> Finding:
    """The recommended model with the reasons for it, or the best one with the reasons against it.

    Args:
        on_unseen: the models on unseen data, the recommended one first.
        ranking: the models with their errors over all folds.
        verdict: on the recommended model.
        findings: about the models.
        seen: whether the models were fitted to some of these data.
    """
    ahead = [each["horizon"] for each in verdict.data["reasons"] if each["code"] in IN_LOOP]
    row, among = on_unseen.best.row, {each.name: each for each in compared(ranking)}
    data: dict[str, Any] = {
        "fit_percent": finite(row.fit_percent),
        "models": len(among),
        "others": len(ranking) - len(among),
        "folds": max(len(each.folds) for each in ranking),
        "seen": seen,
        "verdict": verdict.code,
        "reasons": verdict.data["reasons"],
        "ahead": ahead[0] if ahead else None,
        "tests_failed": sum(not each["passed"] for each in verdict.data["tests"]),
    }
    if verdict.code == "model-unusable":
        return Finding("no-model-recommended", row.model, data)
    vetoed = any(each["code"] in ALLOWED for each in verdict.data["reasons"])
    smallest, own = min(among.values(), key=lambda each: each.errors.mean), among[row.model]
    if data["folds"] > 1:
        data |= {"fit_percent": finite(own.fit_percent)}
    if smallest.errors.mean < own.errors.mean:
        data |= _instead_of(own, smallest, findings)
    return Finding("best-not-recommended" if vetoed else "model-recommended", row.model, data)


def _instead_of(own: Ranked, smallest: Ranked, findings: Iterable[Finding]) -> dict[str, Any]:
    """The model with the smallest error, how it compares with the recommended one, and what makes it implausible."""
    against = [each for each in findings if each.model == smallest.name and each.code in IMPLAUSIBLE]
    return {
        "instead_of": smallest.name,
        "because": {"code": against[0].code, **against[0].data} if against else None,
        "unfinished": smallest.fit.ending.before_minimum,
        "ratio": float(np.sqrt(own.errors.mean / smallest.errors.mean)),
        "same_in": _same_in(own, smallest),
        "parameters": [own.size, smallest.size],
    }


def _same_in(own: Ranked, smallest: Ranked) -> str | None:
    """In what respect a model is as good as that with the smallest error; None for none."""
    if within_noise(own, smallest):
        return "noise"
    return "practice" if equivalent(own.errors, smallest.errors) else None


def experiment(verdict: Finding, record: Record, unseen: Record, *, seen: bool, one_load: bool = False) -> Finding:
    """The experiment to run next: what these data leave open first.

    Args:
        verdict: on the recommended model.
        record, unseen: what the models were fitted to, and ranked on.
        seen: whether the models were fitted to some of the unseen data.
        one_load: whether a second load would separate parameters of the recommended model.
    """
    if any(each["code"] in IN_LOOP for each in verdict.data["reasons"]):
        return Finding("next-experiment", record.name, {"kind": "test-signal"})
    looked = advice_by_code(record)
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
    if one_load:
        return Finding("next-experiment", record.name, {"kind": "second-load"})
    if seen or unseen.name.startswith(f"{record.name},"):
        return Finding("next-experiment", record.name, {"kind": "other-input"})
    return Finding("next-experiment", record.name, {"kind": "in-use"})


def _place(reason: Mapping[str, Any]) -> dict[str, Any]:
    """Where a map has hardly any data."""
    places = reason.get("knots", [reason["at"]] if "at" in reason else [])
    return {"at": list(places)} if places else {}
