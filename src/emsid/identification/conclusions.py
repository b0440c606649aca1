"""Conclusions of an identification as findings: a verdict on the residual, and what to do next."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.findings import Finding, finite
from emsid.models.plants.search.result import GreyBoxFit
from emsid.record import Record
from emsid.validation.comparison import Assessment, Comparison

Array = NDArray[np.float64]

# A residual of which the input predicts more than this share of the variance depends on the input.
PREDICTABLE = 0.05
# A fit in percent below which a model is called poor, and above which it is called good.
POOR, GOOD = 70.0, 95.0


def verdicts(best: Assessment) -> tuple[Finding, ...]:
    """Whether the residual of a free run still depends on the input, for every output."""
    return tuple(_verdict(best, channel) for channel in range(best.record.output.shape[1]))


def _verdict(best: Assessment, channel: int) -> Finding:
    record = best.record
    error = np.where(best.simulation.counted, (record.output - best.simulation.output)[:, channel], np.nan)
    data: dict[str, Any] = {"model": best.row.model, "output": record.output_names[channel]}
    share = predictable_share(error, record)
    if share is None:
        return Finding("residual-not-tested", best.row.model, data)
    code = "residual-depends-on-input" if share > PREDICTABLE else "residual-independent-of-input"
    return Finding(code, best.row.model, data | {"share": share})


def predictable_share(error: Array, record: Record) -> float | None:
    """The share of the variance of a residual that its inputs predict, at lags of 0, 1, 2, 4, 8, … samples.

    Of every input it takes u, |u|, u·|u| and its sign, so that it sees a dead zone and friction that a linear model
    misses. Each quarter of the samples is predicted by coefficients from the other quarters, so that chance predicts
    nothing; below zero counts as zero.

    Args:
        error: (N,) the residual, NaN where it does not count.
        record: of the inputs.

    Returns:
        None where the residual or the input is constant, or there are too few samples.
    """
    lags = [0, *(2**k for k in range(12) if 2**k <= min(len(segment) for segment in record.segments) // 8)]
    columns = [np.ones((len(error), 1))]
    usable = np.isfinite(error)
    for u in record.input.T:
        for signal in (u, np.abs(u), u * np.abs(u), np.sign(u)):
            if np.ptp(signal) > 0:
                columns += [np.roll(signal, lag)[:, None] / np.max(np.abs(signal)) for lag in lags]
    for start in (0, *record.breaks):
        usable[start : start + lags[-1]] = False
    phi, e = np.hstack(columns)[usable], error[usable]
    if len(e) < 4 * phi.shape[1] or phi.shape[1] == 1 or not np.ptp(e) > 0:
        return None
    left = np.empty(len(e))
    for part in np.array_split(np.arange(len(e)), 4):
        others = np.setdiff1d(np.arange(len(e)), part)
        centre = e[others].mean()
        coefficients = np.linalg.lstsq(phi[others], e[others] - centre, rcond=1e-6)[0]
        left[part] = e[part] - centre - phi[part] @ coefficients
    return max(0.0, float(1 - np.mean(left**2) / np.var(e)))


def next_steps(comparison: Comparison, record: Record, unseen: Record, *, seen: bool) -> Iterable[Finding]:
    """What to do next, the most useful first.

    Args:
        comparison: the models on the unseen data.
        record: what they were fitted to.
        unseen: what they were ranked on.
        seen: whether the models were fitted to some of it.
    """
    best = comparison.best
    fit = best.row.fit_percent
    depends = any(each.code == "residual-depends-on-input" for each in verdicts(best))
    physical = any(isinstance(each, GreyBoxFit) for each in comparison.fits)
    if not np.isfinite(fit) or fit < POOR:
        yield Finding("next-check-data", record.name, {"fit_percent": finite(fit)})
    if (depends or not fit >= GOOD) and not physical:
        yield Finding("next-physical-model", best.row.model)
    if seen or unseen.name.startswith(f"{record.name},"):
        yield Finding("next-other-experiment", unseen.name)
    if fit >= POOR:
        yield Finding("next-use-model", best.row.model)
