"""Words for linear estimation."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words
from emsid.wording.lists import shortened


@words("rank-deficient", Severity.WARNING)
def rank_deficient(f: Finding, argument: Spelling) -> str:
    """Data: rank, parameters, zero (regressors), alike (regressor, like)."""
    zero, alike = f.data["zero"], f.data["alike"]
    found = []
    if zero:
        found.append(f"{shortened(zero)} {'are' if len(zero) > 1 else 'is'} zero in all samples")
    if alike:
        pairs = [f"{each['regressor']} is a combination of {shortened(each['like'])}" for each in alike]
        found.append(shortened(pairs, "; ", "; and "))
    return (
        f"the data determine only {f.data['rank']} of {f.data['parameters']} parameters: {'; '.join(found)}; remove "
        "these regressors, or record with an input that varies more"
    )


@words("few-samples", Severity.WARNING)
def few_samples(f: Finding, argument: Spelling) -> str:
    """Data: samples, parameters."""
    return (
        f"{f.data['parameters']} parameters were estimated from only {f.data['samples']:g} samples; record longer, or "
        "choose a smaller structure"
    )


@words("forgetting-limited", Severity.WARNING)
def forgetting_limited(f: Finding, argument: Spelling) -> str:
    """Data: samples, parameters (those at the limit in the end)."""
    at_limit = f.data["parameters"]
    return (
        f"in {f.data['samples']:,} samples the input did not excite all parameters, so the recursion forgot nothing in "
        "the directions without excitation"
        + (f"; at the end of the record these are directions of {shortened(at_limit)}" if at_limit else "")
        + ". Excite the system all the time, or use a larger forgetting factor"
    )
