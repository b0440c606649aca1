r"""Intervals of a regression whose residual is not white.

The covariance σ²(ΦᵀΦ)⁻¹ of least squares holds for white residuals. For others it is (ΦᵀΦ)⁻¹ Ω (ΦᵀΦ)⁻¹, Ω the long-run
variance of the scores φₜeₜ (`robust_covariance`), or ΦᵀΓΦ with Γ the covariance of the residual (`coloured_residuals`)
where the regressors are inputs only; there no other correction is needed.

Past outputs as regressors contain past noise. If the residual is correlated, the noise in it is correlated with them,
and the estimate tends to another value than the truth (Ljung 1999, sec. 7.3): white noise on the output, for instance,
makes the residual A(q)v and the poles too fast. The interval is then one of the best one-step predictor of this form,
whatever the truth is.

References:
    Ljung, *System Identification*, 2nd ed. (1999). Söderström, Stoica, *System Identification* (1989), ch. 7.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Ending, Fit
from emsid.estimation.uncertainty.coloured_residuals import coloured_covariance
from emsid.estimation.uncertainty.robust_covariance import long_run_variance
from emsid.estimation.uncertainty.whiteness import LAGS, absorbed, whiteness
from emsid.findings import Finding
from emsid.models.regression.narx import Narx
from emsid.record import Record

Array = NDArray[np.float64]

LARGEST = 20_000_000
"""The numbers of a regression that are held in memory; of a longer one only the white covariance is given."""
EXACT = 1e-10
"""A residual below this part of the output is rounding."""


def with_robust_intervals(fit: Fit[Narx], records: Record | Iterable[Record]) -> Fit[Narx]:
    """The fit with intervals for a coloured residual, and a finding where they differ from those of white noise.

    Args:
        fit: by least squares, all parameters determined.
        records: what it was fitted to, or excerpts of that: they show the colour of the residual.
    """
    structure = fit.model.structure
    several = (records,) if isinstance(records, Record) else tuple(records)
    held = min(fit.samples, sum(map(len, several)))
    if fit.ending is not Ending.SOLVED or held * len(structure) > LARGEST:
        return fit
    parts = [
        np.hstack(list(structure.blocks(*chunk)))
        for record in several
        for chunk in structure.chunks(record, max(len(record), 1))
    ]
    residuals = [part[-1] - fit.estimate @ part[:-1] for part in parts]
    largest = max(float(np.max(np.abs(part[-1]))) for part in parts)
    if np.sqrt(np.mean(np.concatenate(residuals) ** 2)) < EXACT * largest:
        return fit
    past = sum(any(factor.channel == 0 for factor in regressor.factors) for regressor in structure.regressors)
    lags = max(LAGS, 2 * past)
    taken = absorbed([(e, part[:-1].T) for part, e in zip(parts, residuals, strict=True)], lags) if past else 0.0
    test = whiteness(residuals, taken, lags)
    if test is None or test.white:
        return fit
    data = {"lags": test.lags, "p_value": test.p_value, "largest": test.largest, "lag": test.at_lag}
    code = "regression-biased" if past else "intervals-allow-for-colour"
    if past:
        covariance = _by_scores(parts, residuals)
    else:
        covariance = coloured_covariance([(e, part[:-1].T) for part, e in zip(parts, residuals, strict=True)])
    covariance *= min(sum(map(len, residuals)) / fit.samples, 1.0)
    return replace(fit, covariance=covariance, findings=(*fit.findings, Finding(code, "", data)))


def _by_scores(parts: list[Array], residuals: list[Array]) -> Array:
    """(p, p) for a residual that depends on the regressors, from the columns [Φ y] of every segment."""
    inverse = np.linalg.inv(np.linalg.qr(np.hstack(parts)[:-1].T, mode="r"))
    scores = [residual[:, None] * (part[:-1].T @ inverse) for part, residual in zip(parts, residuals, strict=True)]
    samples, parameters = sum(map(len, residuals)), len(inverse)
    correction = samples / max(samples - parameters, 1)
    covariance: Array = correction * inverse @ long_run_variance(scores) @ inverse.T
    return covariance
