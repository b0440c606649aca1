"""Words for linear estimation."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.chances import chance
from emsid.wording.lists import shortened


@words("rank-deficient", Severity.WARNING)
def rank_deficient(f: Finding, argument: Spelling) -> str:
    """Data: rank, parameters, zero (regressors), alike (regressor, like)."""
    zero, alike = f.data["zero"], f.data["alike"]
    found = []
    if zero:
        found.append(f"{shortened(zero)} {'are' if len(zero) > 1 else 'is'} zero in all samples")
    if alike:
        found.append(f"{shortened([each['regressor'] for each in alike])} depend on others")
    return (
        f"the data determine only {f.data['rank']} of {f.data['parameters']} parameters ({'; '.join(found)}); record "
        "an input that varies more"
    )


@words("dictionary-rank-deficient", Severity.WARNING)
def dictionary_rank_deficient(f: Finding, argument: Spelling) -> str:
    """Data: rank, terms."""
    rank, terms = f.data["rank"], f.data["terms"]
    return (
        f"too few input levels for this degree: only {rank} of {terms} terms are independent; lower the degree, or "
        "record more levels"
    )


@words("forgetting-limited", Severity.WARNING)
def forgetting_limited(f: Finding, argument: Spelling) -> str:
    """Data: samples, parameters (those at the limit in the end)."""
    at_limit = f.data["parameters"]
    now = f", at the end {shortened(at_limit)}" if at_limit else ""
    return (
        f"in {f.data['samples']:,} samples the input did not excite all parameters{now}; excite them all the time, or "
        "use a larger forgetting factor"
    )


@words("regression-biased", Severity.WARNING)
def regression_biased(f: Finding, argument: Spelling) -> str:
    """Data: lags, p_value, largest, lag."""
    return (
        f"its one-step errors are correlated ({_correlated(f)}), so its coefficients are biased and have no "
        "intervals; fit the free run instead"
    )


@words("intervals-allow-for-colour")
def intervals_allow_for_colour(f: Finding, argument: Spelling) -> str:
    """Data: lags, p_value, largest, lag."""
    return f"the residual of the fit is correlated ({_correlated(f)}), and the intervals allow for that"


def _correlated(f: Finding) -> str:
    return f"{f.data['largest']:.2f} at lag {f.data['lag']}, Ljung–Box p {chance(f.data['p_value'])}"


sentences("""
intervals-by-bootstrap info: {model}: intervals and bands are those of {count} fits to {pieces} pieces drawn from the
    data ({samples:,} samples or more each)
no-bootstrap warning: {model}: its intervals are those of its fit and not by bootstrap: {reason}
few-samples warning: {parameters} parameters were estimated from only {samples:g} samples; record longer, or choose a
    smaller structure
""")
