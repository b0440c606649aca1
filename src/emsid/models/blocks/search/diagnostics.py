"""Findings on what the records do not determine in a fitted cascade."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from emsid.estimation.fit import Ending, Fit
from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.search.cross_validation import as_arrays
from emsid.models.blocks.static_maps import StaticMap
from emsid.record import Record


def advice(fit: Fit[Cascade], records: Record | Sequence[Record]) -> tuple[Finding, ...]:
    """Findings on what the records do not determine in a fitted cascade.

    Args:
        fit: the fitted cascade.
        records: the records that it was fitted to.
    """
    several = [records] if isinstance(records, Record) else list(records)
    model = fit.model
    pairs = as_arrays(several)
    findings: list[Finding] = []
    for k, block in enumerate(model.blocks):
        if isinstance(block, StaticMap):
            found = block.findings(np.concatenate([model.signals_from_rest(u)[k] for u, _ in pairs]))
            findings += [replace(each, subject=model.name, data={"block": k + 1, **each.data}) for each in found]
    lost = [n for n, variance in zip(fit.names, np.diag(fit.covariance), strict=True) if not np.isfinite(variance)]
    if lost and fit.ending is not Ending.RANK_DEFICIENT:  # which has a finding of its own
        findings.append(Finding("parameters-without-interval", model.name, {"parameters": lost}))
    return tuple(findings)
