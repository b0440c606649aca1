"""Words for linear estimation, and for the end of a search for parameters."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.errors import listed
from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import LISTED, shortened

sentences(
    __name__,
    """
dictionary-rank-deficient warning: too few input levels for this degree: only {rank} of {terms} terms are independent;
    lower the degree, or record more levels # Data: rank, terms.
forgetting-limited warning: in {samples:,} samples the input did not excite all parameters{parameters:?, at the end
    {parameters:some}}; excite them all the time, or use a larger forgetting factor
    # Data: samples, parameters (those at the limit in the end).
regression-biased warning: its one-step errors are correlated ({correlated}), so its coefficients are biased and have no
    intervals; fit the free run instead # Data: lags, p_value, largest, lag.
intervals-allow-for-colour info: the residual of the fit is correlated ({correlated}), and the intervals allow for that
    # Data: lags, p_value, largest, lag.
intervals-by-bootstrap info: {model}: intervals and bands are those of {count} fits to {pieces} pieces drawn from the
    data ({samples:,} samples or more each)
no-bootstrap warning: {model}: its intervals are those of its fit and not by bootstrap: {reason}
few-samples warning: {parameters} parameters were estimated from only {samples:g} samples; record longer, or choose a
    smaller structure

search-stalled problem: the search stalled before a minimum ({so_far}){starts:?, where {agreeing} of {starts} searches
    end}; the estimates are not reliable
steps-used-up warning: the search ended at its limit of steps, before a minimum ({so_far}); the estimates may still
    change
time-used-up warning: the search ended at its time limit, before a minimum ({so_far}); allow more time
search-cancelled warning: the search was interrupted before a minimum ({so_far}); the best estimate so far is kept
cost-hardly-falls info: the last {last_steps} steps lowered the cost by less than {least_saving:g %}; the search ended
    there ({so_far})
minimum-not-smooth info: the error is not smooth at the minimum; {agreeing} of {starts} searches from around it end
    there, and the intervals cover their estimates
""",
    correlated="{largest:.2f} at lag {lag}, Ljung–Box p {p_value:chance}",
    so_far="{offset:None=>{counted}|{steps:?{counted}, }{offset:.2g} standard errors above it}",
    counted="{steps} {steps:step/steps}",
)


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


SHOW_ZONE = "let it coast at zero command"
"""What to record where the two are inseparable."""


@words("searches-agreeing")
def searches_agreeing(f: Finding, argument: Spelling) -> str:
    searches, compared = f.data["searches"], f.data["compared"]
    if searches > 1:
        if f.data["agreeing"] > searches / 2:
            return f"the optimum is reliable: {f.data['agreeing']} of {searches} starts lead to it"
        return f"the optimum may be a local one: {f.data['agreeing']} of {searches} starts lead to it"
    best = f", from the best of {compared} starts," if compared > 1 else ""
    return (
        f"only one search{best} ran to its end; give what is known ({argument('fixed')}, {argument('datasheet')}) to "
        "be sure"
    )


@words("parameter-at-bound", Severity.WARNING)
def parameter_at_bound(f: Finding, argument: Spelling) -> str:
    side = f.data["side"]
    if f.data.get("because") == "inseparable":
        both_ways = "drive it in both directions, " if f.data["one_way"] else ""
        zone = f"{SHOW_ZONE}, " if f.data.get("zone_unseen") else ""
        return (
            f"{f.subject} is at its {side} limit {f.data['bound']:.4g}, not separable from {listed(f.data['others'])}; "
            f"{zone}{both_ways}or fix one of them ({argument('fixed')})"
        )
    because = _BECAUSE.get(f.data.get("because", ""), "")
    beyond = "smaller" if side == "lower" else "larger"
    why = because.format(beyond=beyond, sheet=argument("datasheet"), profile=argument("profile"))
    return f"{f.subject} is at its {side} limit {f.data['bound']:.4g}{why}"


_BECAUSE = {
    "datasheet": ": the datasheet allows no {beyond} value; widen its tolerance, or check units and what is fixed",
    "sample-time": ": this sample time cannot resolve a {beyond} value; give it from the datasheet ({sheet})",
    "physical": ": a {beyond} value is not physical; check units, signs and what is fixed; its profile ({profile}) "
    "gives an interval",
    "bounds": ": its bounds allow no {beyond} value; widen them, or check units and what is fixed",
}


@words("parameters-undetermined", Severity.PROBLEM)
def parameters_undetermined(f: Finding, argument: Spelling) -> str:
    silent, groups = f.data["without_effect"], f.data["inseparable"]
    said = []
    if silent:
        said.append(f"{listed(silent)} {'have' if len(silent) > 1 else 'has'} no effect on the output in these data")
    said += [f"these data do not determine {_some(group)} separately" for group in _joined(groups)]
    return "; ".join(said)


def _some(names: Sequence[str]) -> str:
    """Names in a sentence; of many, the first."""
    return listed(names) if len(names) <= LISTED + 1 else shortened(names)


def _joined(groups: Sequence[Sequence[str]]) -> list[list[str]]:
    """Groups of names, those that share a name as one.

    >>> _joined([["a", "b"], ["c", "d"], ["e", "b"]])
    [['a', 'b', 'e'], ['c', 'd']]
    """
    joined: list[list[str]] = []
    for group in groups:
        sharing = [each for each in joined if set(each) & set(group)]
        names = dict.fromkeys(name for each in (*sharing, group) for name in each)
        at = joined.index(sharing[0]) if sharing else len(joined)
        joined = [each for each in joined if each not in sharing]
        joined.insert(at, list(names))
    return joined
