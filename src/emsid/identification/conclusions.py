"""Conclusions of an identification as findings: a verdict on the residual, and what to do next."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.findings import Finding, finite
from emsid.models.plants.registry import PLANTS
from emsid.models.plants.search.result import has_physical_parameters
from emsid.record import Record
from emsid.validation.comparison import Assessment
from emsid.validation.correlation import autocorrelation

Array = NDArray[np.float64]

# A residual of which the input predicts more than this share of the variance depends on the input.
PREDICTABLE = 0.05
# Of fewer independent values, chance explains half as large a share, and such a share does not stand out from it.
FEWEST_INDEPENDENT = 2 / PREDICTABLE
# Penalties of the regressions that predict a residual.
RIDGES = (0.0, 0.01, 0.1, 1.0)
# A fit in percent below which a model is called poor, and above which it is called good.
POOR, GOOD = 70.0, 95.0
# A fit in percent below which channels may not belong together, which leaves a residual independent of the input too.
RELATED = 20.0


def verdicts(best: Assessment) -> tuple[Finding, ...]:
    """Whether the residual of a free run still depends on the input, for every output."""
    return tuple(_verdict(best, channel) for channel in range(best.record.output.shape[1]))


def _verdict(best: Assessment, channel: int) -> Finding:
    record = best.record
    error = best.errors[:, channel]
    data: dict[str, Any] = {"model": best.row.model, "output": record.output_names[channel]}
    share = float(predictable_shares(error[:, None], record)[0])
    if np.isnan(share):
        return Finding("residual-not-tested", best.row.model, data)
    independent = max(independent_values(error, u, record.breaks) for u in record.input.T)
    if share <= PREDICTABLE and independent < FEWEST_INDEPENDENT:
        return Finding("residual-not-tested", best.row.model, data | {"independent": independent})
    code = "residual-depends-on-input" if share > PREDICTABLE else "residual-independent-of-input"
    return Finding(code, best.row.model, data | {"share": share})


def independent_values(error: Array, u: Array, breaks: Sequence[int]) -> float:
    r"""How many independent values a correlation of two signals (N,) comes from, ``N/(1 + 2·Σ w(k)·r_e(k)·r_u(k))``.

    Two slow signals are alike by chance (Bartlett, 1946). r are their autocorrelations up to a quarter of the samples,
    w falls from 1 to 0 there.

    Args:
        error: NaN where it does not count.
        u: an input.
        breaks: the first sample of every segment but the first.
    """
    count = int(np.count_nonzero(np.isfinite(error)))
    known = np.where(np.isfinite(error), u, np.nan)
    alike = [np.asarray(autocorrelation(each, breaks, count // 4))[1:] for each in (error, known)]
    lags = min(map(len, alike))
    weights = 1 - np.arange(1, lags + 1) / (lags + 1)
    return count / max(1 + 2 * float(np.sum(weights * alike[0][:lags] * alike[1][:lags])), 1.0)


def predictable_shares(errors: Array, record: Record) -> Array:
    """(m,) the shares of the variances of residuals that the inputs predict, at lags of 0, 1, 2, 4, 8, … samples.

    Of every input it takes u, |u|, u·|u| and its sign, so that it sees a dead zone and friction that a linear model
    misses. Each quarter of the samples is predicted by coefficients from the other quarters, so that chance predicts
    nothing; below zero counts as zero. In a short record a slow input has few independent values, and all these
    functions together predict nothing there. Coefficients with a penalty count too, where they make every quarter
    better: slow noise in a short record follows some function of the input in one quarter or two.

    Args:
        errors: (N, m) residuals on the same samples, NaN where they do not count.
        record: of the inputs.

    Returns:
        NaN where the residual or the inputs are constant, or there are too few samples.
    """
    known = np.asarray(np.isfinite(errors).all(axis=1))
    found = _past_inputs(record, known) if known.any() and errors.size else None
    if found is None:
        return np.full(errors.shape[1], np.nan)
    return np.where(np.ptp(errors[known], axis=0) > 0, _shares(errors, *found), np.nan)


def _shares(errors: Array, phi: Array, usable: NDArray[np.bool_]) -> Array:
    """`predictable_shares` for functions of past inputs (n, p) and the samples (N,) that have them."""
    e = errors[usable]
    quarters = np.array_split(np.arange(len(e)), 4)
    factors = [np.linalg.qr(np.hstack([np.ones((len(k), 1)), phi[k], e[k]]), mode="r") for k in quarters]
    left = np.empty((len(RIDGES), *e.shape))
    for number, part in enumerate(quarters):
        others = np.vstack([each for k, each in enumerate(factors) if k != number])
        centres = others[:, 0] @ others / float(others[:, 0] @ others[:, 0])  # the means of all columns
        others = others - others[:, :1] * centres
        count = 1 + phi.shape[1]
        coefficients = [_ridge_regression(others[:, 1:count], others[:, count:], ridge) for ridge in RIDGES]
        predicted = (phi[part] - centres[1:count]) @ np.hstack(coefficients)
        left[:, part] = e[part] - centres[count:] - np.stack(np.hsplit(predicted, len(RIDGES)))
    variance = np.var(e, axis=0)
    squares, usual = left**2, (e - e.mean(axis=0)) ** 2
    helped = np.all([np.mean(squares[:, k], axis=1) < np.mean(usual[k], axis=0) for k in quarters], axis=0)
    shares = 1 - np.mean(squares, axis=1) / np.where(variance > 0, variance, np.inf)
    sure = helped | (np.array(RIDGES)[:, None] == 0)
    return np.asarray(np.max(np.where((variance > 0) & sure, shares, 0.0), axis=0, initial=0.0))


def _ridge_regression(phi: Array, target: Array, ridge: float) -> Array:
    """The coefficients for the columns of phi, with a penalty in units of the sum of squares of each column."""
    penalty = np.diag(np.sqrt(ridge) * np.linalg.norm(phi, axis=0))
    padded = np.vstack([target, np.zeros((len(penalty), target.shape[1]))])
    return np.asarray(np.linalg.lstsq(np.vstack([phi, penalty]), padded, rcond=1e-6)[0])


def _past_inputs(record: Record, known: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]] | None:
    """Functions of past inputs as columns, on the samples where they and the residuals are known (N,)."""
    lags = [0, *(2**k for k in range(12) if 2**k <= min(len(segment) for segment in record.segments) // 8)]
    usable = known.copy()
    columns = []
    for u in record.input.T:
        for signal in (u, np.abs(u), u * np.abs(u), np.sign(u)):
            if np.ptp(signal) > 0:
                columns += [np.roll(signal, lag)[:, None] / np.max(np.abs(signal)) for lag in lags]
    for start in (0, *record.breaks):
        usable[start : start + lags[-1]] = False
    if not columns or np.count_nonzero(usable) < 4 * (1 + len(columns)):
        return None
    return np.hstack(columns)[usable], usable


def measurements(fit: Fit[Any]) -> tuple[Finding, ...]:
    """What to measure because estimates of a model depend on values that nobody gave; nothing without such values."""
    if not fit.assumed:
        return ()
    current = any(each.data.get("current_missing") for each in fit.findings)
    return (
        Finding("next-measure", fit.model.name, {"parameters": [row.name for row in fit.assumed], "current": current}),
    )


def next_steps(
    chosen: Assessment,
    found: Sequence[Finding],
    fits: Iterable[Fit[Any]],
    record: Record,
    over_folds: float = -np.inf,
    *,
    is_best: bool = True,
) -> Iterable[Finding]:
    """What to do next besides another experiment, the most useful first.

    Args:
        chosen: the recommended model on the unseen data.
        found: its `verdicts`, and what was found in fitting the models.
        fits: of all models.
        record: what they were fitted to.
        over_folds: the fit of the recommended model over all folds in %, where there are several.
        is_best: whether no other model has a smaller error.
    """
    fit = np.fmax(chosen.row.fit_percent, over_folds)
    depends = any(each.code == "residual-depends-on-input" for each in found)
    looped = any(each.code == "feedback-likely" for each in found)
    failed = {each.subject for each in found if each.code == "model-failed"}
    physical = any(has_physical_parameters(each) for each in fits) or not failed.isdisjoint(PLANTS)
    unstable = any(each.code == "unstable-in-loop" for each in found)
    if chosen.input_moves and not fit >= POOR and not unstable:
        tested = not any(each.code == "residual-not-tested" for each in found)
        noisy = fit >= RELATED and tested and not depends and is_best and not looped
        yield Finding("next-reduce-noise" if noisy else "next-check-data", record.name, {"fit_percent": finite(fit)})
    if (depends or not fit >= GOOD) and not physical and not unstable:
        yield Finding("next-physical-model", chosen.row.model)
