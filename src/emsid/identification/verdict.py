"""The verdict on every model: supported by the data, to be used with limits, implausible, or unusable.

It has six sources. The input: whether the free run is better than one with a shuffled or a constant input, and than a
straight line in time. Residual tests with 99 % bands: whether the residual of the free run on unseen data is
independent of the past of the inputs (lag by lag, and by a portmanteau test over all lags) and of their powers, and
whether the one-step errors of a model with a noise model are white. Other models: whether one of them leaves less than
half of the squared error. Agreement: between pieces of the data, and between fitted and unseen data. Other inputs:
whether models that are as good agree there, see `determined`. Plausibility: see `plausibility`.

In a long record, a test rejects every model for deviations that do not matter. A residual that fails a test therefore
limits a model only if the inputs predict more than `PREDICTABLE` of its variance.

The one model that is recommended, with reasons, and the experiment to run next.

The simplest model is recommended that is as good as the best within noise (`emsid.selection.improvement`), by the free
runs over data that were left out of the fit (`ranking`). In a long record noise is small. There a plausible model with
far fewer parameters is the best one where the errors are the same in practice. An implausible model is the best one
only if its error is smaller than that of every plausible one by more than noise and by more than matters in practice.
Among equals one that is supported by the data comes before one with limits, and only then the number of parameters
counts; where the input has few levels, which show no nonlinearity, a linear one comes before both. The best one is
recommended unless it cannot be used, or one of the reasons of `emsid.identification.verdict.ALLOWED` is against it.

Fitted models in the order of recommendation, with their errors on every part of the data.

The recommended model from more data, by one refit of three budgets (`emsid.models.refitting`).

A long record is compared on an excerpt; the recommended model then continues from its estimates to all samples, with
intervals (`Budget.LAST`). Where few data were held back, its parameters are estimated again from all data, from the
known estimate (`Budget.FEW`). Its structure was chosen on the fitted part alone. Where the error of a feedback model
or of a plant is much larger on the held-back part, that part shows something that its structure lacks, such as a tank
that overflows only there, or tells apart what the fitted part does not, such as friction and a load that drifts. Order
and maps, or refinements, are then chosen again from all data, by the same search (`Budget.SEARCH`). So they are for
every short record of a sensor that loses the sign, from which a part shows too little. Cascades, whose structure
differs less, gain nothing by that. Of the two structures the one stands whose errors are smaller on stretches of all
data that are left out in turn (`ranking.in_turn`). The errors that are reported stay those of the fit that has not seen
the held-back part.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np

from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.threads import cores, short_tasks
from emsid.findings import Finding, finite
from emsid.first_look.data_advice import advice_by_code
from emsid.identification.candidates import CANDIDATES, refit_data
from emsid.identification.evidence import (
    DIVERGES,
    EXCLUDING,
    IMPLAUSIBLE,
    POOR,
    PREDICTABLE,
    Plausibility,
    Undetermined,
    about_the_fits,
    predictable_shares,
)
from emsid.identification.fitting import LACKS
from emsid.identification.ranking import (
    MANY,
    Ranked,
    close,
    compared,
    deviations,
    in_turn,
    ranked,
    ranked_ahead,
    stretch_errors,
    within_noise,
)
from emsid.identification.task import horizon_of
from emsid.models.extrapolation import MUCH_BETTER
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model, Run
from emsid.models.refit_data import Budget
from emsid.models.refitting import usable_refit
from emsid.options import Options
from emsid.record import Record
from emsid.record.holding_back import SHORT, choice_and_headline
from emsid.selection.improvement import (
    DIFFERENT,
    STRETCHES,
    StretchErrors,
    better,
    better_by_ratio,
    equivalent,
    simplest,
)
from emsid.validation.agreement import difference_of_pieces
from emsid.validation.comparison import SMALL, Assessment, Comparison, compare, models_noise
from emsid.validation.correlation import LAGS, input_test, residual_tests

LARGER = 1.5
"""An error, as a share of the output's deviation, is larger on unseen data from this ratio on."""
MOST = sqrt(1 / DIFFERENT)
"""An error above this share of the output's deviation leaves most of its variance."""

Reason = dict[str, Any]
NO_INPUT = "input-explains-nothing"
"""The reason against a model that follows the output without its input, and the finding where it is the best one."""
NO_GAIN = "no-gain-over-trend"
"""The reason against a model that follows the output no better than a straight line does, without any input."""
OF_SENSORS = frozenset({"output-clipped", "few-output-levels", "input-logged-slower", "samples-repeated"})
"""Findings about how the channels were measured, after which no estimate is known, however narrow its interval."""
LEVELS = ("model-supported", "model-limited", "model-implausible", "model-unusable")
"""The verdicts, the best first. A reason allows none better than the second one."""
ALLOWED: Mapping[str, str] = {
    **dict.fromkeys(("diverges", "no-better-than-mean", NO_INPUT, "output-is-input"), "model-unusable"),
    **dict.fromkeys(IMPLAUSIBLE, "model-implausible"),
    **dict.fromkeys((*LACKS, *OF_SENSORS, "no-response", "end-shows-little", "few-levels", NO_GAIN), "model-limited"),
}
"""The best verdict on a model that a reason or a finding allows: a finding about no model concerns all of them. A model
with one of them is not recommended, even where it is the best one."""


def model_verdicts(
    on_record: Comparison,
    on_unseen: Comparison,
    findings: Iterable[Finding],
    left_open: Mapping[str, list[Reason]] | None = None,
    *,
    tests: bool = True,
    pole: float | None = None,
) -> tuple[Finding, ...]:
    """A verdict on every model, in the order of their ranks.

    Args:
        on_record: the models on the data they were fitted to.
        on_unseen: the models on unseen data.
        findings: about the models and the data; those in `ALLOWED` are reasons against a model.
        left_open: by model, what the data leave open about it, see `emsid.identification.evidence`.
        tests: whether residuals are tested; if not, the verdicts say so.
        pole: of a plant that is unstable without its controller: a free run then tests nothing, and a model that is
            stable is none of it.
    """
    several, found = on_unseen.assessments, []
    if pole is not None:
        for each in several:
            stable = each.row.diverged_at is None
            reason = {"code": "stable-model-of-unstable" if stable else "only-in-loop", "pole": pole}
            data = {"model": each.row.model, "reasons": [reason | {"horizon": horizon_of(pole)}], "tests": []}
            found.append(Finding("model-unusable" if stable else "model-limited", each.row.model, data))
        return tuple(found)
    fitted = {each.row.model: each for each in on_record.assessments}
    left_open, against = left_open or {}, dict[str, list[Reason]]()
    for finding in findings:
        if finding.code in ALLOWED:
            reason = {"code": finding.code, "subject": finding.subject, **finding.data}
            against.setdefault(finding.model, []).append(reason)
    other = _other_is_better(several)

    def verdict(unseen: Assessment, shares: Sequence[float] | None = None) -> Finding:
        row, before = unseen.row, fitted[unseen.row.model]
        useless = unusable(unseen, before)
        others = [*left_open.get(row.model, []), *other.get(row.model, [])]
        if is_weak(unseen, left_open) and not useless:
            reason = {"code": "explains-little", "fit_percent": float(row.fit_percent)}
            return Finding("model-unusable", row.model, {"model": row.model, "reasons": [reason, *others], "tests": []})
        tested = [] if useless or shares is None else residual_table(unseen)
        failed = [] if shares is None else _from_tests(tested, unseen, shares)
        if not any(each["test"] == "past-inputs" for each in tested):
            failed.append({"code": "residual-untested"})
        of_model = [*against.get(row.model, []), *against.get("", [])]
        reasons = [*useless, *of_model]
        if not useless:
            reasons += [*_poor(unseen, before), *_no_gain(unseen), *failed, *others, *_disagreements(unseen, before)]
        if unseen.fit.ending.before_minimum:
            reasons.append({"code": "search-not-finished", "ending": unseen.fit.ending.value})
        reasons.sort(key=lambda each: (_level(each), each["code"] in ALLOWED), reverse=True)
        data = {"model": row.model, "reasons": reasons, "tests": tested}
        return Finding(LEVELS[max(map(_level, reasons), default=0)], row.model, data)

    if not tests:
        return tuple(map(verdict, several))
    in_turn = short_tasks(cores())  # transforms of long residuals, which leave the interpreter free
    return tuple(in_turn(verdict, several, _shares(several)))


def implausible_models(findings: Iterable[Finding]) -> frozenset[str]:
    """The names of the models that some of the findings make implausible."""
    return frozenset(finding.model for finding in findings if finding.code in IMPLAUSIBLE)


def excluded_models(findings: Iterable[Finding], errors: Mapping[str, float] | None = None) -> frozenset[str]:
    """The names of the models that diverge on a slightly larger or a constant input.

    One that diverges on a constant input only is none of them where its error is smaller by `MUCH_BETTER` than those of
    all models that do not: the system may do so, too.

    Args:
        findings: on how plausible the models are.
        errors: mean square errors of the free runs of all models on unseen data, by name, if known.
    """
    several, known = list(findings), errors or {}
    excluded = {finding.model for finding in several if finding.code in EXCLUDING}
    never = {finding.model for finding in several if finding.code == DIVERGES}
    others = min((error for name, error in known.items() if name not in excluded), default=np.inf)
    much_better = {name for name, error in known.items() if np.isfinite(error) and MUCH_BETTER**2 * error <= others}
    return frozenset(excluded - (much_better - never))


def _level(reason: Reason) -> int:
    """The place in `LEVELS` of the best verdict that a reason allows."""
    return LEVELS.index(ALLOWED.get(reason["code"], "model-limited"))


def is_weak(unseen: Assessment, left_open: Mapping[str, list[Reason]]) -> bool:
    """Whether a model leaves most of the variance, and its fits to parts of the data do not agree.

    Where noise is larger than the response, a right model leaves most of the variance too; its parameters are then
    about the same from every part.
    """
    codes = {each["code"] for each in left_open.get(unseen.row.model, [])}
    agree = codes.isdisjoint({"parts-differ", "response-uncertain"})
    return bool(unseen.row.fit_percent < 100 * (1 - MOST)) and not agree


def shows_the_input(unseen: Assessment, fitted: Assessment) -> bool:
    """Whether a model leaves less than half of the variance by its input, on unseen data."""
    return bool(unseen.row.fit_percent >= 100 * (1 - MOST)) and not unusable(unseen, fitted)


def unusable(unseen: Assessment, fitted: Assessment) -> list[Reason]:
    """Why a model cannot be used at all, from its free run on unseen data.

    While no input changes, as after a step, the output is at rest but for noise, and a good model is no better than its
    mean. It can be used if its error is small beside the deviation of the output over fitted and unseen data
    (`MOST`). Where the input changes, the free run is better than one with the input shuffled, or held at its mean: a
    model that oscillates or drifts by itself can follow an output that has nothing to do with the input.
    """
    row = unseen.row
    if row.diverged_at is not None:
        return [{"code": "diverges", "sample": int(row.diverged_at)}]
    if row.fit_percent <= 0 and (unseen.input_moves or _share_of_deviation(unseen, fitted) > MOST):
        return [{"code": "no-better-than-mean", "fit_percent": finite(row.fit_percent)}]
    if not _shows_a_response(unseen):
        return []
    (better, shuffled), (best, held) = (_beside(unseen, run) for run in unseen.on_other_inputs)
    return [] if better and best else [{"code": NO_INPUT, "shuffled": shuffled, "held": held}]


def _no_gain(unseen: Assessment) -> list[Reason]:
    """That a free run is no better than the straight line in time that fits the unseen output best."""
    if not _shows_a_response(unseen):
        return []
    record, counted = unseen.record, unseen.simulation.counted
    t = np.vander(record.time - record.time[0], 2)
    line = t @ np.linalg.lstsq(t[counted], record.output[counted], rcond=None)[0]
    better, share = _beside(unseen, replace(unseen.simulation, output=line))
    return [] if better else [{"code": NO_GAIN, "share": share}]


def _shows_a_response(unseen: Assessment) -> bool:
    """Whether an input changes in the unseen data, and the output is not at rest."""
    return unseen.input_moves and not np.isnan(unseen.row.fit_percent)


def _beside(unseen: Assessment, other: Run) -> tuple[bool, float]:
    """Whether the free run of a model is better than another run, and its squared error as a share of the other's.

    Less than half of the squared error is better, too, in however few stretches: the input can be at rest in the
    others.
    """
    own, errors = _stretches(unseen), _stretches(unseen, other)
    better = DIFFERENT * own.mean < errors.mean or better_by_ratio(own, errors)
    return better, float(own.mean / errors.mean) if errors.mean > 0 else 1.0


def _share_of_deviation(unseen: Assessment, fitted: Assessment) -> float:
    """The RMSE on unseen data over the deviation of the output in fitted and unseen data; the mean over the outputs."""
    spread = np.concatenate([fitted.record.output, unseen.record.output]).std(axis=0)
    moves, errors = spread > 0, np.sqrt(np.nanmean(unseen.errors**2, axis=0))
    return float(np.mean(errors[moves] / spread[moves])) if moves.any() else np.inf


def _poor(unseen: Assessment, fitted: Assessment) -> list[Reason]:
    """A poor fit on unseen data; or none, because no input changes or the output does not move."""
    row = unseen.row
    if np.isnan(row.fit_percent):
        return [{"code": "output-at-rest"}]
    if row.fit_percent <= 0:
        return [{"code": "output-moves-little", "share": _share_of_deviation(unseen, fitted)}]
    return [{"code": "explains-little", "fit_percent": float(row.fit_percent)}] if row.fit_percent < POOR else []


def residual_table(assessment: Assessment) -> list[Reason]:
    """All residual tests of one model with their 99 % limits; ``passed`` where a residual stays within its limit."""
    record, found = assessment.record, list[Reason]()
    of: Reason
    for channel, (output, error) in enumerate(zip(record.output_names, assessment.errors.T, strict=True)):
        for name, u in zip(record.input_names, record.input.T, strict=True):
            past = input_test(error, u, record.breaks, LAGS)
            if past is not None:
                of = {"output": output, "input": name}
                found.append({"test": "past-inputs", **of, **past._asdict(), "passed": not past.depends})
        for each in assessment.nonlinear_tests[channel]:
            of = {"output": output, "term": each.term, "kind": each.kind, "largest": each.largest}
            of |= {"at_lag": each.at_lag, "limit": each.limit, "passed": not each.depends}
            found.append({"test": "nonlinear-term", **of})
    for test in residual_tests(record, assessment.prediction) if models_noise(assessment.fit.model) else ():
        of = {"output": test.output, "lags": test.lags, "largest": test.largest_autocorrelation}
        of |= {"at_lag": test.at_lag, "p_value": test.p_value, "passed": test.white}
        found.append({"test": "whiteness", **of})
    return found


def _from_tests(tests: Sequence[Reason], unseen: Assessment, shares: Sequence[float]) -> list[Reason]:
    """The failed tests that limit a model: one for the inputs, and one for the one-step errors, of every output.

    A residual that is not small, and that the inputs predict, limits it where no test fails, too.
    """
    found = []
    for output, share in zip(unseen.record.output_names, shares, strict=True):
        failed = [each for each in tests if each["output"] == output and not each["passed"]]
        of_inputs = [each for each in failed if each["test"] != "whiteness"]
        if share > PREDICTABLE and not of_inputs and unseen.row.fit_percent < 100 * (1 - SMALL):
            found.append({"code": "residual-depends-on-input", "output": output, "share": share})
        elif share > PREDICTABLE and of_inputs:
            worst = max(of_inputs, key=lambda each: abs(each["largest"]) / each["limit"])
            found.append({"code": f"depends-on-{worst['test']}", "share": share, **worst})
        found += [{"code": "one-step-errors-coloured", **each} for each in failed if each["test"] == "whiteness"]
    return found


def _other_is_better(assessments: Sequence[Assessment]) -> dict[str, list[Reason]]:
    """For each model that lacks something: that the best model leaves less than half of its squared error.

    A free run is computed from the input alone, so what the best one explains can be predicted, whatever tests of the
    residual against a few functions of the input see.
    """
    if any(each.row.data == "identification" for each in assessments):  # there a larger model has a smaller error
        return {}
    errors = {each.row.model: _stretches(each) for each in assessments}
    best = min(errors, key=lambda name: errors[name].mean)
    least = errors[best]
    return {
        name: [{"code": "another-is-better", "other": best, "left": least.mean / own.mean}]
        for name, own in errors.items()
        if DIFFERENT * least.mean < own.mean < np.inf and better_by_ratio(least, own)
    }


def _stretches(assessment: Assessment, run: Run | None = None) -> StretchErrors:
    """The squared errors of all outputs, each over its variance, by stretch; infinite where the run diverged.

    Args:
        assessment: a model on a record.
        run: another free run of it; by default that on the record.
    """
    record, run = assessment.record, run or assessment.simulation
    return stretch_errors(run, record, deviations(record.output[run.counted]), STRETCHES)


def _disagreements(unseen: Assessment, fitted: Assessment) -> list[Reason]:
    """Differences between pieces of the data, and unseen and fitted ones, and a stretch with most of the error."""
    found: list[Reason] = []
    runs = [(each.record, each.simulation) for each in (fitted, unseen)]
    differs = difference_of_pieces(runs, unseen.row.model)
    if differs is not None:
        spread = max(differs.values) - min(differs.values)
        data = {"kind": differs.difference.name, "output": differs.output, "unit": differs.unit}
        found.append({"code": "pieces-differ", **data, "spread": spread, "share": differs.share})
    if (ratio := larger_on_unseen(unseen, fitted)) is not None:
        found.append({"code": "larger-on-unseen", "ratio": ratio})
    errors, time = _stretches(unseen), unseen.record.time
    sums = errors.means * errors.samples
    worst, total = int(np.argmax(sums)), float(sums.sum())
    if errors.samples.sum() >= 10 * STRETCHES and 0 < total < np.inf and 2 * sums[worst] >= total:
        first, last = np.array_split(np.arange(len(time)), STRETCHES)[worst][[0, -1]].tolist()
        place = {"first": first, "last": last, "from": float(time[first]), "to": float(time[last])}
        found.append({"code": "error-in-one-stretch", "share": float(sums[worst]) / total, **place})
    return found


def fails_on_unseen(unseen: Assessment, on_record: Comparison) -> bool:
    """Whether the error of a model is much larger on unseen data than on the record, where it is among others."""
    fitted = next(each for each in on_record.assessments if each.row.model == unseen.row.model)
    return larger_on_unseen(unseen, fitted) is not None


def larger_on_unseen(unseen: Assessment, fitted: Assessment) -> float | None:
    """How many times larger the error of a model is on unseen data, each as a share of the output's deviation.

    None where it is not much larger than on the fitted data, small on both, or where no input changes in unseen data.
    """
    if not unseen.input_moves:
        return None
    sizes = [1 - each.row.fit_percent / 100 for each in (fitted, unseen)]
    larger = np.isfinite(sizes).all() and sizes[1] > max(LARGER * sizes[0], SMALL) and sizes[0] > 0
    return sizes[1] / sizes[0] if larger else None


def _shares(assessments: Sequence[Assessment]) -> list[list[float]]:
    """The predictable share of the residual variance of every model and output; NaN where it is not known."""
    record, counted = assessments[0].record, assessments[0].simulation.counted
    usable = [bool(np.isfinite(each.errors[counted]).all()) for each in assessments]
    runs = [each.errors for each, good in zip(assessments, usable, strict=True) if good]
    unknown = [np.nan] * record.output.shape[1]
    found = predictable_shares(np.hstack(runs), record).reshape(len(runs), -1).tolist() if runs else []
    known = iter(found)
    return [next(known) if good else unknown for good in usable]


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
        against = [each for each in findings if each.model == smallest.name and each.code in IMPLAUSIBLE]
        in_practice = "practice" if equivalent(own.errors, smallest.errors) else None
        data |= {
            "instead_of": smallest.name,
            "because": {"code": against[0].code, **against[0].data} if against else None,
            "unfinished": smallest.fit.ending.before_minimum,
            "ratio": float(np.sqrt(own.errors.mean / smallest.errors.mean)),
            "same_in": "noise" if within_noise(own, smallest) else in_practice,
            "parameters": [own.size, smallest.size],
        }
    return Finding("best-not-recommended" if vetoed else "model-recommended", row.model, data)


def experiment(verdict: Finding, record: Record, unseen: Record, *, seen: bool, one_load: bool = False) -> Finding:
    """The experiment to run next: what these data leave open first.

    Args:
        verdict: on the recommended model.
        record, unseen: what the models were fitted to, and ranked on.
        seen: whether the models were fitted to some of the unseen data.
        one_load: whether a second load would separate parameters of the recommended model.
    """
    reasons: list[Mapping[str, Any]] = verdict.data["reasons"]

    def kinds() -> Iterator[dict[str, Any]]:
        if any(each["code"] in IN_LOOP for each in reasons):
            yield {"kind": "test-signal"}
        looked, u = advice_by_code(record), record.input[:, 0]
        yield from ({"kind": kind, **looked[code].data} for code, kind in EXPERIMENTS.items() if code in looked)
        reach = TWO_SIDED * float(np.max(np.abs(u)))
        if record.input.shape[1] == 1 and (u.min() > -reach or u.max() < reach):
            yield {"kind": "both-directions", "input": record.input_names[0]}
        for each in reasons:
            if each["code"] in OF_REASONS:  # with the places where a map has hardly any data
                places = list(each.get("knots", [each["at"]] if "at" in each else []))
                yield {"kind": OF_REASONS[each["code"]], **({"at": places} if places else {})}
        if one_load:
            yield {"kind": "second-load"}
        yield {"kind": "other-input" if seen or unseen.name.startswith(f"{record.name},") else "in-use"}

    return Finding("next-experiment", record.name, next(kinds()))


@dataclass(frozen=True, eq=False)
class Compared:
    """The models of an identification, compared.

    Attributes:
        record: the data they were fitted to.
        on_record: their errors on these.
        on_choice: on the unseen data that choose among them; None where `on_unseen` does.
        on_unseen: on unseen data, the recommended model first, implausible and useless ones last.
        ranking: their errors over the folds that ranked them.
        findings: of the estimators, and on how plausible the models are.
        undetermined: what the data leave open about the models.
        pole: of a plant that is unstable without its controller; else None.
        whole: what the recommended model was fitted to in the end, where that is more than `record`; else None.
    """

    plausibility: Plausibility
    on_record: Comparison
    on_choice: Comparison | None
    on_unseen: Comparison
    ranking: tuple[Ranked, ...]
    findings: tuple[Finding, ...]
    undetermined: Undetermined
    pole: float | None
    whole: Record | None = None

    @classmethod
    def of(
        cls,
        fits: Sequence[Fit[Any]],
        train: Record,
        test: Record,
        options: Options,
        control: Control,
        outside: Record | None = None,
        *,
        transient: int | None,
        whole: Record | None,
        pole: float | None = None,
    ) -> Compared:
        """Compare models.

        Args:
            fits: the models.
            train: what they were fitted to.
            test: unseen data.
            options: how they were fitted.
            control: when to stop; the unseen data then decide alone.
            outside: the data outside an excerpt that the models were fitted to.
            transient: samples that start the models where a segment begins in motion; they enter no error.
            whole: all data, where the unseen data are a part of them; these are then divided, and the models followed
                over folds of all data. None where the unseen data are others.
            pole: of a plant that is unstable without its controller: models are ranked by their predictions.
        """
        on_record = compare(fits, train, transient=transient, data="identification")
        plausibility = Plausibility(train, whole)
        findings = about_the_fits(fits, plausibility)
        parts = choice_and_headline(test) if whole is not None and len(fits) > 1 else None
        on_choice = parts and compare(fits, parts[0], transient=transient, data="choice")
        on_unseen = compare(fits, parts[1] if parts else test, transient=transient, data="unseen")
        chosen_on, seen = on_choice or on_unseen, whole if on_choice is None else None
        errors = {each.row.model: each.row.ranked_by for each in chosen_on.assessments}
        fitted, excluded = None if whole is None else train, excluded_models(findings, errors)
        if pole is not None:
            ranking = ranked_ahead(chosen_on, horizon_of(pole))
            useless = frozenset(each.row.model for each in chosen_on.assessments if each.row.diverged_at is None)
            left_open = Undetermined({}, frozenset(), None)
        else:
            ranking = ranked(chosen_on, fitted, options, excluded, control, outside, seen)
            before = {each.row.model: each for each in on_record.assessments}
            useless = excluded | {e.row.model for e in chosen_on.assessments if unusable(e, before[e.row.model])}
            left_open = Undetermined.of(ranking, train, useless | implausible_models(findings))
            useless |= {each.row.model for each in chosen_on.assessments if is_weak(each, left_open.reasons)}
        implausible = implausible_models(findings)

        def supported() -> list[str]:
            verdicts = model_verdicts(on_record, chosen_on, findings, left_open.reasons)
            return [each.data["model"] for each in verdicts if each.code == "model-supported"]

        straight = () if left_open.levels is None else left_open.straight
        first = recommended(ranking, implausible, useless, straight=straight, supported=supported)
        # the recommended one, plausible ones, implausible ones, and useless ones; each group by its errors
        by = sorted(ranking, key=lambda each: (each is not first, each.name in useless, each.name in implausible))
        order = [each.fit for each in by]
        on_choice = on_choice and on_choice.in_order_of(order)
        on_unseen = on_unseen.in_order_of(order)
        return cls(plausibility, on_record, on_choice, on_unseen, ranking, tuple(findings), left_open, pole)

    @property
    def record(self) -> Record:
        """What the models were fitted to."""
        return self.plausibility.record

    @property
    def fits(self) -> tuple[Fit[Any], ...]:
        """The models, the recommended one first."""
        return self.on_unseen.fits

    @property
    def best(self) -> Fit[Any]:
        """The recommended model."""
        return self.fits[0]

    @property
    def chosen_on(self) -> Record:
        """The unseen data that choose among the models."""
        return (self.on_choice or self.on_unseen).best.record

    def with_finished(self, fit: Fit[Any], whole: Record) -> Compared:
        """The same with a fit of the recommended model to more data; the errors that chose it stay as they were."""

        def in_place(each: Ranked) -> Ranked:
            return replace(each, fit=fit) if each.name == fit.model.name else each

        on_record, on_unseen = (each.with_fit(fit) for each in (self.on_record, self.on_unseen))
        findings = tuple(about_the_fits(on_unseen.fits, self.plausibility))
        ranking = tuple(map(in_place, self.ranking))
        return replace(self, on_record=on_record, on_unseen=on_unseen, ranking=ranking, findings=findings, whole=whole)


SEARCHED_AGAIN = 50_000
"""A structure is not chosen twice from as many samples: every search takes seconds for them."""


def refit(fit: Fit[Any], data: Record, budget: Budget, options: Options, control: Control = FREE) -> Fit[Any] | None:
    """The model of a fit from other data.

    Args:
        fit: the model.
        data: to which it is fitted.
        budget: how far.
        options: how it was fitted.
        control: when to stop.

    Returns:
        None where there is no time, where the data do not suit it, or where the result cannot be used; see
        `usable_refit`.
    """
    doing = f"fitting {fit.model.name} to all data"
    kind = CANDIDATES.get(fit.model.name)
    search = None if kind is None else lambda record, control: kind(record, options, control)
    try:
        control.doing(doing)
        within = control if budget is Budget.FEW else control.during(doing)
        found = usable_refit(fit, refit_data(options, data, within, search=search), budget)
        if budget is not Budget.FEW:
            control.check()
    except Stopped:
        return None
    return found


def on_all_samples(judged: Compared, train: Record, options: Options, control: Control = FREE) -> Compared:
    """The comparison with the recommended model fitted to the whole record, from its estimates of the excerpt.

    The model of the excerpt is kept where there is no other, and where it is better by more than noise on the unseen
    data that chose.

    Args:
        judged: the models, fitted to an excerpt.
        train: all data to fit.
        options: how they were fitted.
        control: when to stop.
    """
    fit, found = judged.best, refit(judged.best, train, Budget.LAST, options, control)
    if found is None:
        return judged
    errors = {id(each.fit): each.errors for each in ranked(compare([fit, found], judged.chosen_on), None, options)}
    return judged if better(errors[id(fit)], than=errors[id(found)]) else judged.with_finished(found, train)


def from_all_data(
    judged: Compared, held_back: Record, whole: Record, options: Options, control: Control = FREE
) -> tuple[Model, Finding] | None:
    """The recommended model from all data, and a finding about that.

    Args:
        judged: the models, fitted to all data but those that were held back.
        held_back: these data.
        whole: all data.
        options: how the models were fitted.
        control: when to stop.

    Returns:
        None where the data are so many that it would change little, or where no fit simulates them better.
    """
    few, best = len(held_back) < MANY, judged.best.model
    rectified = capabilities_of(best).hides_the_sign(best) and len(whole) < SHORT
    larger = len(whole) < SEARCHED_AGAIN and _structure_is_doubtful(judged)
    anew = refit(judged.best, whole, Budget.SEARCH, options, control) if larger or rectified else None
    # The search chose that of a rectified output by errors on data left out.
    searched = anew is not None and (rectified or _better(anew, judged, whole, options, control))
    model = anew.model if searched and anew else _with_steps(judged, whole, options, control) if few else None
    if model is None:
        return None
    data = {"model": model.name, "samples": len(whole), "of": len(judged.record)}
    return model, Finding("fitted-to-all-data", whole.name, data | {"searched": searched, "larger": larger})


def _better(anew: Fit[Any], judged: Compared, whole: Record, options: Options, control: Control) -> bool:
    """Whether a structure has the smaller errors on stretches of all data that are left out in turn."""
    try:
        one, other = in_turn((anew, judged.best), whole, judged.on_unseen.best.transient, options, control)
    except Stopped:
        return False
    return one.errors.mean <= other.errors.mean


def _with_steps(judged: Compared, whole: Record, options: Options, control: Control) -> Model | None:
    """The recommended model with its parameters from all data, which the ranking knows where it has seen these."""
    known = next(each for each in judged.ranking if each.fit is judged.best)
    if known.included and judged.on_choice is None:
        return known.refit
    found = refit(judged.best, whole, Budget.FEW, options, control)
    return None if found is None else found.model


def _structure_is_doubtful(judged: Compared) -> bool:
    """Whether the error of the recommended model is much larger on unseen data; its kind is then searched anew."""
    anew = getattr(CANDIDATES.get(judged.best.model.name), "searched_anew", False)
    return anew and fails_on_unseen(judged.on_unseen.best, judged.on_record)


def about_excerpt(judged: Compared, train: Record) -> list[Finding]:
    """The findings about the data that models were compared on.

    Args:
        judged: the models.
        train: all data to fit.
    """
    if judged.record is train:
        return []
    model = "" if judged.whole is None else judged.best.model.name
    data = {"samples": len(judged.record), "of": len(train), "finished": model}
    return [Finding("fitted-to-excerpt", train.name, data)]
