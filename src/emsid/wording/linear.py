"""Words for linear estimation, and for the end of a search for parameters."""

from __future__ import annotations

from collections.abc import Sequence

from emsid.errors import listed
from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.lists import LISTED, chance, shortened


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


SHOW_ZONE = "let it coast at zero command"
"""What to record where the two are inseparable."""


@words("search-stalled", Severity.PROBLEM)
def search_stalled(f: Finding, argument: Spelling) -> str:
    others = f", where {f.data['agreeing']} of {f.data['starts']} searches end" if "starts" in f.data else ""
    return f"the search stalled before a minimum ({_so_far(f)}){others}; the estimates are not reliable"


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


@words("steps-used-up", Severity.WARNING)
def steps_used_up(f: Finding, argument: Spelling) -> str:
    return f"the search ended at its limit of steps, before a minimum ({_so_far(f)}); the estimates may still change"


@words("time-used-up", Severity.WARNING)
def time_used_up(f: Finding, argument: Spelling) -> str:
    return f"the search ended at its time limit, before a minimum ({_so_far(f)}); allow more time"


@words("search-cancelled", Severity.WARNING)
def search_cancelled(f: Finding, argument: Spelling) -> str:
    return f"the search was interrupted before a minimum ({_so_far(f)}); the best estimate so far is kept"


@words("cost-hardly-falls", Severity.INFO)
def cost_hardly_falls(f: Finding, argument: Spelling) -> str:
    data = f.data
    return (
        f"the last {data['last_steps']} steps lowered the cost by less than {100 * data['least_saving']:g} %; the "
        f"search ended there ({_so_far(f)})"
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


def _so_far(f: Finding) -> str:
    steps, offset = f.data["steps"], f.data["offset"]
    counted = [f"{steps} step{'s' * (steps != 1)}"] if steps or offset is None else []
    short = [] if offset is None else [f"{offset:.2g} standard errors above it"]
    return ", ".join(counted + short)


sentences("""
minimum-not-smooth info: the error is not smooth at the minimum; {agreeing} of {starts} searches from around it end
    there, and the intervals cover their estimates
""")
