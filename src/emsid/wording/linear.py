"""Words for linear estimation."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words
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
        pairs = [f"{each['regressor']} is a combination of {shortened(each['like'])}" for each in alike]
        found.append(shortened(pairs, "; ", "; and "))
    return (
        f"the data determine only {f.data['rank']} of {f.data['parameters']} parameters: {'; '.join(found)}; remove "
        "these regressors, or record with an input that varies more"
    )


@words("dictionary-rank-deficient", Severity.WARNING)
def dictionary_rank_deficient(f: Finding, argument: Spelling) -> str:
    """Data: rank, terms."""
    rank, terms = f.data["rank"], f.data["terms"]
    return (
        f"too few input levels for this degree: only {rank} of {terms} terms are independent; lower the degree, or "
        "record more levels"
    )


@words("intervals-by-bootstrap", Severity.INFO)
def intervals_by_bootstrap(f: Finding, argument: Spelling) -> str:
    """Data: model, count, pieces, samples (of the shortest piece)."""
    d = f.data
    return (
        f"{d['model']}: intervals and bands are those of {d['count']} fits to {d['pieces']} pieces drawn from the data "
        f"({d['samples']:,} samples or more each)"
    )


@words("no-bootstrap", Severity.WARNING)
def no_bootstrap(f: Finding, argument: Spelling) -> str:
    """Data: model, problem (why)."""
    problem = f.data["problem"].removeprefix(f"{f.data['model']}: ")
    return f"{f.data['model']}: its intervals are those of its fit and not by bootstrap: {problem}"


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


@words("regression-biased", Severity.WARNING)
def regression_biased(f: Finding, argument: Spelling) -> str:
    """Data: lags, p_value, largest, lag."""
    return (
        f"the one-step errors in the fit are correlated ({_correlated(f)}), as noise on the output makes them. The "
        "coefficients then suit the prediction of the next sample and differ from those of the system, so they have no "
        "intervals; for parameters of the system fit the free run: output-error, a cascade or a physical model"
    )


@words("intervals-allow-for-colour")
def intervals_allow_for_colour(f: Finding, argument: Spelling) -> str:
    """Data: lags, p_value, largest, lag."""
    return f"the residual of the fit is correlated ({_correlated(f)}), and the intervals allow for that"


def _correlated(f: Finding) -> str:
    return f"{f.data['largest']:.2f} at lag {f.data['lag']}, Ljung–Box p {chance(f.data['p_value'])}"
