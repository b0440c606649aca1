"""What follows from an identification: a verdict on the residual, and what to do next, as findings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.special import ndtri

from emsid.findings import Finding, finite
from emsid.models.plants.search.result import GreyBoxFit
from emsid.record import Record
from emsid.validation.comparison import Assessment, Comparison
from emsid.validation.correlation import cross_correlation

# A verdict is given at this probability of a wrong alarm over all lags together.
FALSE_ALARM = 0.01
# A fit in percent below which a model is called poor, and above which it is called good.
POOR, GOOD = 70.0, 95.0


def verdicts(best: Assessment) -> tuple[Finding, ...]:
    """Whether the residual of a free run still depends on the input, for every output."""
    return tuple(_verdict(best, channel) for channel in range(best.record.output.shape[1]))


def _verdict(best: Assessment, channel: int) -> Finding:
    """The largest correlation with a past input, against the largest that independent signals would have.

    Besides the input u itself it is |u| and u·|u|: the residual of a linear model is uncorrelated with u where the drive
    has a dead zone or friction that is the same in both directions.
    """
    record = best.record
    error = np.where(best.simulation.counted, (record.output - best.simulation.output)[:, channel], np.nan)
    lags = lag_count(record)
    data: dict[str, Any] = {"model": best.row.model, "output": record.output_names[channel]}
    largest, where, name = 0.0, 0.0, ""
    tested = 0
    for u, input_name in zip(record.input.T, record.input_names, strict=True):
        for signal in (u, np.abs(u), u * np.abs(u)):
            correlation = np.abs(cross_correlation(error, signal, record.breaks, lags))
            past = correlation[len(correlation) // 2 :]  # inputs before the residual; later ones show feedback
            tested += len(past)
            if len(past) and past.max() > largest:
                largest, where, name = float(past.max()), float(record.dt * np.argmax(past)), input_name
    if not largest:
        return Finding("residual-not-tested", best.row.model, data)
    limit = float(ndtri(1 - FALSE_ALARM / (2 * tested)))
    data |= {"input": name, "largest": largest, "lag": where, "limit": limit}
    code = "residual-depends-on-input" if largest > limit else "residual-independent-of-input"
    return Finding(code, best.row.model, data)


def lag_count(record: Record) -> int:
    """The largest lag of the correlations in samples: a second, but 20 to 400 samples."""
    return int(np.clip(round(1 / record.dt), 20, 400))


def next_steps(comparison: Comparison, record: Record, unseen: Record, *, seen: bool) -> Iterable[Finding]:
    """What to do next, the most useful first.

    Args:
        comparison: the models on the unseen data.
        record: what they were fitted to.
        unseen: what they were ranked on.
        seen: whether that is not unseen at all.
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
    yield Finding("next-use-model", best.row.model)
