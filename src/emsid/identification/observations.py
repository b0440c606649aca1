"""Findings about the fitted models and the data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from emsid.errors import EmsidError
from emsid.estimation.borders import border
from emsid.estimation.fit import Fit
from emsid.findings import Finding, finite
from emsid.identification.map_ranges import BEYOND, about_the_maps
from emsid.identification.plausibility import Plausibility
from emsid.identification.ranking import deviations
from emsid.models.kinds import capabilities_of
from emsid.models.model import Model
from emsid.models.plants.search.diagnostics import Profile
from emsid.record import Record
from emsid.record.overlap import has_common_samples
from emsid.selection.improvement import NEGLIGIBLE
from emsid.validation.comparison import Assessment, Comparison, models_noise
from emsid.validation.metrics import FEWEST
from emsid.validation.regions import worst_region
from emsid.validation.residual_test import residual_tests


def observations(
    comparison: Comparison,
    record: Record,
    unseen: Record,
    profiles: Mapping[str, tuple[Profile, ...]],
    choice: Comparison | None = None,
    *,
    ranked_on: int = 0,
    tests: bool = True,
) -> list[Finding]:
    """All findings about the free runs of the models on unseen data, and about their profiles.

    Args:
        comparison: the models on the unseen data, the chosen one first.
        record: what they were fitted to.
        unseen: what their errors are from.
        profiles: by model.
        choice: the models on further unseen data that chose among them; None where ``unseen`` did.
        ranked_on: the samples that ranked the models, where these are more than those of the comparison.
        tests: whether the residuals of the best model are tested.
    """
    seen = has_common_samples(unseen, record)
    best = comparison.best
    checks: dict[str, Callable[[], Iterable[Finding | None]]] = {
        "error of the free run": lambda: _about_the_best(comparison, unseen, seen, choice),
        "residual test": lambda: about_the_residual(best) if tests else (),
        "test of nonlinear terms": lambda: about_nonlinear_terms(best) if tests else (),
        "errors by region": lambda: [worst_region(best)],
        "number of samples": lambda: _about_few_samples(max(best.row.samples, ranked_on), unseen),
        "unseen input": lambda: about_the_unseen_input(record, unseen, seen),
        "ranges of the maps": lambda: about_the_maps(best.fit.model, record, unseen, seen),
    }
    found: list[Finding] = []
    for name, check in checks.items():
        with border(f"check of {best.row.model}: {name}", best.row.model):
            found += filter(None, check())
    return [
        *([Finding("data-not-unseen", unseen.name)] if seen else []),
        *found,
        *(
            Finding("free-run-diverged", row.model, {"model": row.model, "sample": int(row.diverged_at), "seen": seen})
            for row in comparison.rows
            if row.diverged_at is not None
        ),
        *(about_a_profile(model, each) for model, some in profiles.items() for each in some),
    ]


def _about_the_best(comparison: Comparison, unseen: Record, seen: bool, choice: Comparison | None) -> list[Finding]:
    """The error of the best free run."""
    row = comparison.best.row
    if not np.isfinite(row.simulation_mse):
        return []
    rows: tuple[Any, ...] = row.outputs or (row,)
    outputs = [
        {
            "name": name,
            "unit": unit,
            "rmse": float(each.simulation_rmse),
            "fit_percent": finite(each.fit_percent),
        }
        for each, name, unit in zip(rows, unseen.output_names, unseen.output_units, strict=True)
    ]
    data: dict[str, Any] = {"model": row.model, "seen": seen, "outputs": outputs}
    if len(comparison.rows) > 1 and not seen:
        data |= {"chosen_among": len(comparison.rows)}
        data |= {"chosen_on": choice.best.row.samples} if choice else {"apart": chosen_and_judged_apart(comparison)}
    findings = [Finding("free-run-error", row.model, data)]
    if row.fit_percent <= 0 and comparison.best.input_moves:
        findings += [Finding("no-better-than-mean", " and ".join(unseen.output_names), {"seen": seen})]
    if 0 < 2 * row.one_step_mse < row.simulation_mse:
        ratio = float(row.simulation_mse / row.one_step_mse)
        findings += [Finding("one-step-error-smaller", row.model, {"model": row.model, "ratio": ratio})]
    return findings


def _about_few_samples(samples: int, unseen: Record) -> list[Finding]:
    """Unseen data that are too few to rank models on."""
    if samples >= FEWEST:
        return []
    return [Finding("few-unseen-samples", unseen.name, {"samples": samples, "needed": FEWEST})]


ENOUGH = 200
"""Samples of a half on which a model is chosen, or judged."""


def length_trusted(fit: Fit[Any], model: Model, whole: Record) -> list[Finding]:
    """For how long the free run of a plant over all data is trusted, where its fit does not say so already.

    A fit to a part of a record adapts to the drift there, so that its errors add up in the rest only.

    Args:
        fit: of the recommended model.
        model: the same for later use.
        whole: all data.
    """
    if {"free-run-drifts", "load-drifts"} & {each.code for each in fit.findings}:
        return []
    return capabilities_of(model).trusted_length(model, whole)


def chosen_and_judged_apart(comparison: Comparison) -> list[float] | None:
    """RMSE of every output where a model is chosen on one half of the data and judged on the other, both ways round.

    The error of the best of several models is too small on the data that it was chosen on. Here no sample does both.

    Returns:
        None where a half has fewer than `ENOUGH` samples.
    """
    record = comparison.best.record
    counted = np.flatnonzero(np.all([each.simulation.counted for each in comparison.assessments], axis=0))
    halves = np.array_split(counted, 2)
    if len(halves[1]) < ENOUGH:
        return None
    spread = deviations(record.output[counted])
    squares = [  # of every model (2, ny)
        np.stack([np.mean(each.errors[half] ** 2, axis=0) for half in halves]) for each in comparison.assessments
    ]
    judged = []
    for choice in (0, 1):
        costs = [float(np.mean(each[choice] / spread**2)) for each in squares]
        best = int(np.nanargmin(costs)) if np.isfinite(costs).any() else 0
        judged.append(squares[best][1 - choice])
    errors = np.sqrt(np.mean(judged, axis=0))
    return errors.tolist() if np.isfinite(errors).all() else None


def about_the_residual(best: Assessment) -> list[Finding]:
    """Whether the one-step errors of the best model are white, if it models noise."""
    if not models_noise(best.fit.model):
        return []
    return [
        Finding(
            "residual-white" if test.white else "residual-coloured",
            test.output,
            {
                "model": best.row.model,
                "lags": test.lags,
                "largest": test.largest_autocorrelation,
                "lag": test.at_lag,
                "p_value": test.p_value,
            },
        )
        for test in residual_tests(best.record, best.prediction)
    ]


def about_nonlinear_terms(best: Assessment) -> list[Finding]:
    """The nonlinear function of inputs that the residual of the best free run depends on most, for every output.

    It must explain a part of the residual that matters: in a long record a test also sees the rounding of an encoder. A
    plant says itself what it lacks, by a score of every known effect (`emsid.models.plants.search.missing`).
    """
    if capabilities_of(best.fit.model).says_what_it_lacks:
        return []
    findings = []
    for channel, output in enumerate(best.record.output_names):
        tests = [test for test in best.nonlinear_tests[channel] if test.depends and test.share > NEGLIGIBLE]
        if tests:
            worst = max(tests, key=lambda test: abs(test.largest))
            data = {
                "model": best.row.model,
                "term": worst.term,
                "kind": worst.kind,
                "largest": worst.largest,
                "at_lag": worst.at_lag,
                "limit": worst.limit,
            }
            findings.append(Finding("residual-depends-on-term", output, data))
    return findings


def about_the_unseen_input(record: Record, unseen: Record, seen: bool = False) -> list[Finding]:
    """Inputs that are constant in the unseen data, or outside their range in the fit."""
    u = unseen.input
    if np.all(np.ptp(u, axis=0) == 0):
        levels = [{"name": name, "level": float(x)} for name, x in zip(unseen.input_names, u[0], strict=True)]
        return [Finding("input-constant", " and ".join(unseen.input_names), {"inputs": levels, "seen": seen})]
    findings = []
    for name, new, known in zip(unseen.input_names, u.T, record.input.T, strict=True):
        slack = BEYOND * np.ptp(known)
        if new.min() < known.min() - slack or new.max() > known.max() + slack:
            data = {
                "low": float(new.min()),
                "high": float(new.max()),
                "fitted_low": float(known.min()),
                "fitted_high": float(known.max()),
                "seen": seen,
            }
            findings.append(Finding("input-beyond-range", name, data))
    return findings


def about_the_fits(fits: Iterable[Fit[Any]], record: Record) -> list[Finding]:
    """Findings of the estimators, and on how plausible the models are on the data they were fitted to."""
    found: list[Finding] = []
    plausibility = Plausibility(record)
    for fit in fits:
        name = fit.model.name
        found += [each.about(name) for each in fit.findings]
        with border(f"check of {name}", name):
            found += [each.about(name) for each in capabilities_of(fit.model).advice(fit, record)]
        with border(f"check whether {name} is plausible", name):
            found += plausibility.findings(fit)
    return found


def about_a_profile(model: str, profile: Profile) -> Finding:
    """The interval that a profile gives."""
    low, high = (finite(end) for end in profile.interval)
    data = {"model": model, "level": float(profile.level), "low": low, "high": high, "unit": profile.unit}
    return Finding("profile-interval", profile.name, data)


def failure(name: str, problem: EmsidError, code: str = "model-failed") -> Finding:
    """A model that could not be fitted, or not again for its intervals."""
    reason = str(problem).removeprefix(f"{name}: ")
    return Finding(code, name, {"model": name, "reason": reason, "arguments": list(problem.arguments)})
