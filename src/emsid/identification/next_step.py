"""What to do next, chosen from the findings: the one thing that promises most."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.findings import Finding

UNDETERMINED = ("rank-deficient", "parameters-undetermined", "parameters-inseparable", "no-parameter-determined")
RICHER = ("friction-narx", "wiener-hammerstein", "rigid-motor")
"""What to try where the free-run error depends on the input, from fast to slow."""


def next_step(findings: Sequence[Finding], chosen: str, tried: Sequence[str]) -> Finding:
    """The recommendation.

    Args:
        findings: everything that was noticed.
        chosen: the model with the best free run.
        tried: the models that were asked for.
    """
    codes = {finding.code for finding in findings}
    own = {finding.code for finding in findings if finding.model == chosen}
    if "no-better-than-mean" in codes or "free-run-diverged" in own:
        return Finding("next-step-check-data", data={})
    if "records-differ" in codes:
        return Finding("next-step-separate-records", data={})
    if "data-not-unseen" in codes or "input-constant" in codes:
        return Finding("next-step-unseen-data", data={})
    if own & set(UNDETERMINED):
        return Finding("next-step-determine-parameters", chosen, {})
    if "search-stalled" in own:
        return Finding("next-step-repair-search", chosen, {})
    richer = [name for name in RICHER if name not in tried]
    if "residual-follows-input" in own and richer:
        return Finding("next-step-richer-model", chosen, {"models": richer})
    return Finding("next-step-another-experiment", chosen, {})
