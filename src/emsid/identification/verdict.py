"""The verdict on every model: supported by the data, to be used with limits, implausible, or unusable.

It has six sources. The input: whether the free run is better than one with a shuffled or a constant input, and than a
straight line in time. Residual tests with 99 % bands: whether the residual of the free run on unseen data is
independent of the past of the inputs (lag by lag, and by a portmanteau test over all lags) and of their powers, and
whether the one-step errors of a model with a noise model are white. Other models: whether one of them leaves less than
half of the squared error. Agreement: between pieces of the data, and between fitted and unseen data. Other inputs:
whether models that are as good agree there, see `determined`. Plausibility: see `plausibility`.

In a long record, a test rejects every model for deviations that do not matter. A residual that fails a test therefore
limits a model only if the inputs predict more than `PREDICTABLE` of its variance.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from emsid.estimation.threads import cores, short_tasks
from emsid.findings import Finding, finite
from emsid.identification.conclusions import POOR, PREDICTABLE, predictable_shares
from emsid.identification.plausibility import DIVERGES, EXCLUDING, IMPLAUSIBLE
from emsid.identification.ranking import deviations, stretch_errors
from emsid.identification.remainder import LACKS
from emsid.identification.unstable import horizon_of
from emsid.models.extrapolation import MUCH_BETTER
from emsid.models.model import Run
from emsid.selection.improvement import DIFFERENT, STRETCHES, StretchErrors, better_by_ratio
from emsid.validation.agreement import difference_of_pieces
from emsid.validation.comparison import Assessment, Comparison, models_noise
from emsid.validation.correlation import LAGS, input_test
from emsid.validation.metrics import SMALL
from emsid.validation.residual_test import residual_tests

LARGER = 1.5
"""An error, as a share of the output's deviation, is larger on unseen data from this ratio on."""
MOST = sqrt(1 / DIFFERENT)
"""An error above this share of the output's deviation leaves most of its variance."""

Reason = dict[str, Any]
NO_INPUT = "input-explains-nothing"
"""The reason against a model that follows the output without its input, and the finding where it is the best one."""
NO_GAIN = "no-gain-over-trend"
"""The reason against a model that follows the output no better than a straight line does, without any input."""
UNTESTED: Reason = {"code": "residual-untested"}
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
        left_open: by model, what the data leave open about it, see `emsid.identification.determined`.
        tests: whether residuals are tested; if not, the verdicts say so.
        pole: of a plant that is unstable without its controller: a free run then tests nothing.
    """
    if pole is not None:
        return tuple(_in_loop(each, pole) for each in on_unseen.assessments)
    fitted = {each.row.model: each for each in on_record.assessments}
    against: dict[str, list[Reason]] = {}
    for finding in findings:
        if finding.code in ALLOWED:
            reason = {"code": finding.code, "subject": finding.subject, **finding.data}
            against.setdefault(finding.model, []).append(reason)

    other = _other_is_better(on_unseen.assessments)

    def verdict(unseen: Assessment, shares: Sequence[float] | None = None) -> Finding:
        name = unseen.row.model
        others = [*(left_open or {}).get(name, []), *other.get(name, [])]
        if is_weak(unseen, left_open or {}) and not unusable(unseen, fitted[name]):
            reason = {"code": "explains-little", "fit_percent": float(unseen.row.fit_percent)}
            return Finding("model-unusable", name, {"model": name, "reasons": [reason, *others], "tests": []})
        return _verdict(unseen, fitted[name], [*against.get(name, []), *against.get("", [])], shares, others)

    if not tests:
        return tuple(map(verdict, on_unseen.assessments))
    in_turn = short_tasks(cores())  # transforms of long residuals, which leave the interpreter free
    return tuple(in_turn(verdict, on_unseen.assessments, _shares(on_unseen.assessments)))


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


def _verdict(
    unseen: Assessment,
    fitted: Assessment,
    found: list[Reason],
    shares: Sequence[float] | None,
    other: list[Reason],
) -> Finding:
    """The verdict on a model; its residual is not tested where the predictable shares are not given."""
    row = unseen.row
    useless = unusable(unseen, fitted)
    tests = [] if useless or shares is None else residual_table(unseen)
    tested = [] if shares is None else _from_tests(tests, unseen, shares)
    if not any(each["test"] == "past-inputs" for each in tests):
        tested.append(UNTESTED)
    limits = (
        [] if useless else [*_poor(unseen, fitted), *_no_gain(unseen), *tested, *other, *_disagreements(unseen, fitted)]
    )
    if unseen.fit.ending.before_minimum:
        limits.append({"code": "search-not-finished", "ending": unseen.fit.ending.value})
    against = [*useless, *found, *limits]
    reasons = sorted(against, key=lambda each: (_level(each), each["code"] in ALLOWED), reverse=True)
    data = {"model": row.model, "reasons": reasons, "tests": tests}
    return Finding(LEVELS[max(map(_level, reasons), default=0)], row.model, data)


def _level(reason: Reason) -> int:
    """The place in `LEVELS` of the best verdict that a reason allows."""
    return LEVELS.index(ALLOWED.get(reason["code"], "model-limited"))


def _in_loop(unseen: Assessment, pole: float) -> Finding:
    """The verdict on a model of a plant that is unstable without its controller: a stable one is none."""
    name, stable = unseen.row.model, unseen.row.diverged_at is None
    reason = {
        "code": "stable-model-of-unstable" if stable else "only-in-loop",
        "pole": pole,
        "horizon": horizon_of(pole),
    }
    code = "model-unusable" if stable else "model-limited"
    return Finding(code, name, {"model": name, "reasons": [reason], "tests": []})


def is_weak(unseen: Assessment, left_open: Mapping[str, list[Reason]]) -> bool:
    """Whether a model leaves most of the variance, and its fits to parts of the data do not agree.

    Where noise is larger than the response, a right model leaves most of the variance too; its parameters are then
    about the same from every part.
    """
    codes = {each["code"] for each in left_open.get(unseen.row.model, [])}
    agree = codes.isdisjoint({"parts-differ", "response-uncertain"})
    return bool(unseen.row.fit_percent < 100 * (1 - MOST)) and not agree


def unusable(unseen: Assessment, fitted: Assessment) -> list[Reason]:
    """Why a model cannot be used at all, from its free run on unseen data.

    While no input changes, as after a step, the output is at rest but for noise, and a good model is no better than its
    mean. It can be used if its error is small beside the deviation of the output over fitted and unseen data
    (`MOST`).
    """
    row = unseen.row
    if row.diverged_at is not None:
        return [{"code": "diverges", "sample": int(row.diverged_at)}]
    if row.fit_percent <= 0 and (unseen.input_moves or _share_of_deviation(unseen, fitted) > MOST):
        return [{"code": "no-better-than-mean", "fit_percent": finite(row.fit_percent)}]
    return _input_explains_nothing(unseen)


def _input_explains_nothing(unseen: Assessment) -> list[Reason]:
    """That a free run is no better than one with the input shuffled, or held at its mean, where the input changes.

    A model that oscillates or drifts by itself can follow an output that has nothing to do with the input.
    """
    if not _shows_a_response(unseen):
        return []
    shuffled, held = (_compared_with(unseen, run) for run in unseen.on_other_inputs)
    if shuffled.better and held.better:
        return []
    return [{"code": NO_INPUT, "shuffled": shuffled.share, "held": held.share}]


def _no_gain(unseen: Assessment) -> list[Reason]:
    """That a free run is no better than the straight line in time that fits the unseen output best."""
    if not _shows_a_response(unseen):
        return []
    record, counted = unseen.record, unseen.simulation.counted
    t = np.vander(record.time - record.time[0], 2)
    line = t @ np.linalg.lstsq(t[counted], record.output[counted], rcond=None)[0]
    trend = _compared_with(unseen, replace(unseen.simulation, output=line))
    return [] if trend.better else [{"code": NO_GAIN, "share": trend.share}]


def _shows_a_response(unseen: Assessment) -> bool:
    """Whether an input changes in the unseen data, and the output is not at rest."""
    return unseen.input_moves and not np.isnan(unseen.row.fit_percent)


class _Comparison(NamedTuple):
    """Whether a free run is better than another run of the same samples, and the squared error as a share of its."""

    better: bool
    share: float


def _compared_with(unseen: Assessment, other: Run) -> _Comparison:
    """The free run of a model beside another run.

    Less than half of the squared error is better, too, in however few stretches: the input can be at rest in the
    others.
    """
    own, errors = _stretches(unseen), _stretches(unseen, other)
    better = DIFFERENT * own.mean < errors.mean or better_by_ratio(own, errors)
    return _Comparison(better, float(own.mean / errors.mean) if errors.mean > 0 else 1.0)


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
    for channel, (output, error) in enumerate(zip(record.output_names, assessment.errors.T, strict=True)):
        for name, u in zip(record.input_names, record.input.T, strict=True):
            past = input_test(error, u, record.breaks, LAGS)
            if past is not None:
                of = {"output": output, "input": name}
                found.append({"test": "past-inputs", **of, **past._asdict(), "passed": not past.depends})
        found += [
            {
                "test": "nonlinear-term",
                "output": output,
                "term": each.term,
                "kind": each.kind,
                "largest": each.largest,
                "at_lag": each.at_lag,
                "limit": each.limit,
                "passed": not each.depends,
            }
            for each in assessment.nonlinear_tests[channel]
        ]
    if models_noise(assessment.fit.model):
        found += [
            {
                "test": "whiteness",
                "output": each.output,
                "lags": each.lags,
                "largest": each.largest_autocorrelation,
                "at_lag": each.at_lag,
                "p_value": each.p_value,
                "passed": each.white,
            }
            for each in residual_tests(record, assessment.prediction)
        ]
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
    """Differences between pieces of the data, between unseen and fitted data, and between stretches."""
    found: list[Reason] = []
    runs = [(each.record, each.simulation) for each in (fitted, unseen)]
    differs = difference_of_pieces(runs, unseen.row.model)
    if differs is not None:
        spread = max(differs.values) - min(differs.values)
        data = {"kind": differs.difference.name, "output": differs.output, "unit": differs.unit}
        found.append({"code": "pieces-differ", **data, "spread": spread, "share": differs.share})
    if (ratio := larger_on_unseen(unseen, fitted)) is not None:
        found.append({"code": "larger-on-unseen", "ratio": ratio})
    found += _concentrated(unseen)
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


def _concentrated(unseen: Assessment) -> list[Reason]:
    """The stretch that has most of the squared error, if one has."""
    errors, time = _stretches(unseen), unseen.record.time
    sums = errors.means * errors.samples
    worst, total = int(np.argmax(sums)), float(sums.sum())
    if errors.samples.sum() < 10 * STRETCHES or not 0 < total < np.inf or 2 * sums[worst] < total:
        return []
    first, last = np.array_split(np.arange(len(time)), STRETCHES)[worst][[0, -1]].tolist()
    place = {"first": first, "last": last, "from": float(time[first]), "to": float(time[last])}
    return [{"code": "error-in-one-stretch", "share": float(sums[worst]) / total, **place}]


def _shares(assessments: Sequence[Assessment]) -> list[list[float]]:
    """The predictable share of the residual variance of every model and output; NaN where it is not known."""
    record, counted = assessments[0].record, assessments[0].simulation.counted
    usable = [bool(np.isfinite(each.errors[counted]).all()) for each in assessments]
    runs = [each.errors for each, good in zip(assessments, usable, strict=True) if good]
    unknown = [np.nan] * record.output.shape[1]
    found = predictable_shares(np.hstack(runs), record).reshape(len(runs), -1).tolist() if runs else []
    known = iter(found)
    return [next(known) if good else unknown for good in usable]
