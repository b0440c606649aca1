"""Words for the verdict on a model, its residual, the recommendation and the next experiment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from emsid.findings import Finding
from emsid.wording.catalogue import CATALOGUE, Severity, Spelling, as_python, filled, rows, sentences, words
from emsid.wording.lists import listed
from emsid.wording.plants import tests_in_words

sentences(
    __name__,
    """
residual-depends-on-input warning: the input predicts {share:.0f %} of the variance of the residual of {output}, so the
    model lacks part of the dynamics or a nonlinearity # Data: output, share (of the variance of the residual).
residual-not-tested info: the residual of {output} could not be tested: {independent:None=>a constant signal, or too few
    samples|only {independent:.0f} independent values; record longer}
    # Data: output, independent (values of the residual, where these are too few).
residual-depends-on-term warning: the residual of {subject} is correlated with {term} ({largest:.1f} standard deviations
    at lag {at_lag}, limit {limit:.1f}): the model lacks {kind:product=>a product of these signals|an {kind}
    nonlinearity} # Subject: the output. Data: term, kind (even, odd, product), largest, at_lag, limit.
residual-white info: the one-step errors of {subject} are white: the first {lags} lags show no correlation
residual-coloured warning: the one-step errors of {subject} are correlated with each other (up to {largest:.2f} at lag
    {lag}): dynamics or noise are not modelled
next-check-data warning: No model describes these data well; check units, sample time and columns, and leave out samples
    that are not normal operation ({argument[mask]})
next-reduce-noise warning: Noise or a disturbance probably limits the fit to {fit_percent:.0f} %; use a larger input, a
    better sensor, or record the disturbance as another input
next-physical-model info: Fit a physical model too, to estimate friction, dead zone and delay as parameters:
    {argument[models]} rigid-motor, or motor for a flexible shaft
""",
)


Reason = Mapping[str, Any]

IN_SHORT = {
    "model-supported": "supported by these data",
    "model-limited": "usable with limits",
    "model-implausible": "implausible",
    "model-unusable": "not usable",
}
"""The verdict on a model in a table of models."""


_SHORT = rows("""
diverges: its free run diverges at sample {sample}
explains-little: it explains little of the output (a fit of {fit_percent:.0f} %)
output-at-rest: the output does not change in the unseen data, which test only the steady state
output-moves-little: it is no better than the mean of the output in the unseen data, where the output moves little (its
    error is {share:.2g %} of its deviation in all data)
input-explains-nothing: its free run is no better than with the input shuffled, or with its mean instead
no-gain-over-trend: a straight line in time follows the output as well, without any input
no-better-than-mean: it is no better than the mean of the output
depends-on-past-inputs: the input predicts {share:.0f %} of the residual of {output} ({largest:.1f} standard deviations
    at lag {at_lag}, 99 % limit {limit:.1f})
depends-on-nonlinear-term: the input predicts {share:.0f %} of the residual of {output}, which depends on {term}
    ({largest:.1f} standard deviations at lag {at_lag}, 99 % limit {limit:.1f})
one-step-errors-coloured: its one-step errors are correlated (up to {largest:.2f} at lag {at_lag}), so its prediction is
    not the best one
another-is-better: {other} has {left:.2g %} of its squared error on the same data
another-differs: {other} fits these data as well and differs from it by {times:.2g} times its error on other inputs
parts-differ: its fits to parts of the data {times:None=>diverge on other inputs|leave it uncertain by {times:.2g} times
    its error on other inputs}
stable-model-of-unstable: it is stable, and the plant is not without its controller (a pole of {pole:.3g} per sample)
only-in-loop: only its predictions some samples ahead are tested, of a plant with a pole of {pole:.3g} per sample
response-uncertain: its response to the input may be zero
few-levels: the input has {levels} levels, which cannot show a nonlinearity
residual-untested: its residual was not tested
pieces-differ: the {kind} of {output} differs by up to {kind:gain=>{spread:.2g
    %}|delay=>{spread:duration}|{spread:.3g[unit]}} between pieces of the data, which makes {share:.0f %} of the squared
    error
larger-on-unseen: its error is {ratio:.2g} times larger on unseen data than on fitted data
error-in-one-stretch: {share:.0f %} of its squared error is between {from:.4g} and {to:.4g} s
search-not-finished: its search did not reach a minimum ({ending:stalled=>it stalled|out of budget=>it ended at its
    limit of steps or time|interrupted=>it was interrupted})
""")
"""Reasons of a verdict that are no findings of their own."""


def reason_in_words(reason: Reason) -> str:
    """A reason of a verdict as a clause."""
    code = reason["code"]
    if code in _SHORT:
        return filled(_SHORT[code], reason)
    text = CATALOGUE[code].wording(
        Finding(code, reason.get("subject", ""), {k: v for k, v in reason.items() if k != "model"}), as_python
    )
    return text.partition("; ")[0].partition(". ")[0]


def _because(f: Finding) -> str:
    return "; ".join(reason_in_words(each) for each in f.data["reasons"])


@words("model-supported")
def model_supported(f: Finding, argument: Spelling) -> str:
    """Data: reasons (none), tests."""
    return f"supported by these data: {_supported(sum(not each['passed'] for each in f.data['tests']))}"


def _supported(failed: int) -> str:
    """What the residual tests of a supported model say, of which some fail in a long record."""
    if failed:
        return "the input predicts at most 5 % of what is left"
    return "no test contradicts it"


@words("model-limited")
def model_limited(f: Finding, argument: Spelling) -> str:
    """Data: reasons, tests."""
    return f"usable with limits: {_because(f)}"


@words("model-implausible", Severity.WARNING)
def model_implausible(f: Finding, argument: Spelling) -> str:
    """Data: reasons, tests."""
    return f"implausible: {_because(f)}"


@words("model-unusable", Severity.WARNING)
def model_unusable(f: Finding, argument: Spelling) -> str:
    """Data: reasons, tests."""
    return f"not usable: {_because(f)}"


@words("model-recommended")
def model_recommended(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: fit_percent (over all folds), models, others (that were not compared with these), folds
    (parts of the data that were left out of a fit in turn), seen, verdict, reasons, tests_failed (how many);
    instead_of, because (None for no finding), unfinished (whether the search for it is), ratio, parameters (of it and
    of the other), ahead (the samples of the predictions that ranked models, None for free runs) and same_in (noise or
    practice, None where the errors differ) where another model has a smaller error."""
    why, d = _best_of(f.data), f.data
    if "instead_of" in d and d["verdict"] not in _LEVELS:  # the comparison is what there is to say
        return f"Recommended: {f.subject}, {why}"
    verdict = _LEVELS[d["verdict"]] if d["verdict"] in _LEVELS else _supported(d["tests_failed"])
    return f"Recommended: {f.subject}, {why}; {verdict}{_first_reasons(d['reasons'])}"


@words("best-not-recommended", Severity.WARNING)
def best_not_recommended(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: as of model-recommended."""
    return f"Not recommended: {f.subject}, {_best_of(f.data)}, since {_first_reasons(f.data['reasons'])}"


def _best_of(d: Mapping[str, Any]) -> str:
    """Among which models, and on which data, a model is the best, or to which one it is preferred."""
    where = "the data they were fitted to" if d["seen"] else "unseen data"
    fit = "cross-validated fit" if d["folds"] > 1 and "instead_of" in d else "a fit of"
    about = "" if d["fit_percent"] is None else f" ({fit} {d['fit_percent']:.1f} %)"
    if "instead_of" in d:
        own, other = d["parameters"]
        against = [f"{other} parameters instead of {own}"] if other > own else []
        against += ["an implausible shape"] if d["because"] is not None else []
        against += ["an unfinished search"] if d["unfinished"] else []
        percent = f"{100 * (1 - 1 / d['ratio']):.2g} % smaller{_SAME_IN[d['same_in']]}"
        by = f", with {listed(against)}" if against else ""
        return f"preferred{about} to {d['instead_of']}, whose error is {percent}{by}"
    if d["models"] > 1:
        by = "" if d["ahead"] is None else f", by prediction {d['ahead']} samples ahead"
        on = f"in {d['folds']}-fold cross-validation" if d["folds"] > 1 else f"on {where}"
        return f"best of {d['models']} {on}{by}{about}"
    return f"the only model{about}"


_SAME_IN = {
    "noise": " (within noise)",
    "practice": " (hardly matters)",
    None: "",
}
_LEVELS = {
    "model-limited": "limit: ",
}


def _first_reasons(reasons: list[Reason]) -> str:
    """The first reason against a model, and the number of the others."""
    first = "".join(reason_in_words(reason) for reason in reasons[:1])
    more = len(reasons) - 1
    return f"{first}, and {more} more" if more > 0 else first


@words("no-model-recommended", Severity.PROBLEM)
def no_model_recommended(f: Finding, argument: Spelling) -> str:
    """Subject: the model with the smallest error. Data: as of model-recommended."""
    folds = f.data["folds"]
    where = f" in {folds}-fold cross-validation" if folds > 1 else ""
    return f"No model describes these data: the best{where} is {f.subject}, and {_first_reasons(f.data['reasons'])}"


_EXPERIMENTS = rows("""
longer: record longer: {samples} samples are too few, at least {needed} are needed
without-feedback: record without a controller, or with a test signal added to its command, since the input follows the
    output
more-levels: record an input of many levels over the whole range, such as an amplitude-modulated PRBS
test-signal: add a test signal to the reference of the controller and record it too, for a closed-loop method:
    two-stage, instrumental variables or Box–Jenkins
larger-input: record with larger inputs: much of this record is inside the dead zone, or at rest
faster-sampling: sample at least five times faster than every {dt:duration}
finer-sensor: measure the output with a finer sensor, or record larger movements: its steps are coarse
both-directions: record {input} in both directions: friction and dead zone of the other one are not in these data
fill-range: record larger or more varied movements: the static map has hardly any data{at:? around {at:list .3g}}
repeat-input: repeat the same input two or three times in one record, to tell noise from what the model lacks
second-load: record a second load of known weight at a known distance, which separates inertia, friction and gravity
    from the strength of the motor
other-input: record a second experiment, with an input like those in later use, and rank the models on it
in-use: record the drive in its later use, and run the recommended model on that record
""")


@words("next-experiment")
def next_experiment(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: kind, and what it needs: at, dt, input, needed."""
    sentence = filled(_EXPERIMENTS[f.data["kind"]], f.data)
    then = {"other-input": f" ({argument('unseen')})", "in-use": " (emsid validate)"}.get(f.data["kind"], "")
    return f"Next experiment: {sentence}{then}"


@words("next-test")
def next_test(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: tests (what each shows of the parameters that the data do not determine)."""
    return f"Next experiment: {tests_in_words(f.data['tests'], every=False)}; emsid design makes its signal"


@words("residual-independent-of-input")
def residual_independent(f: Finding, argument: Spelling) -> str:
    """Data: output, share (of the variance of the residual)."""
    return (
        f"the input predicts at most {max(1.0, 100 * f.data['share']):.0f} % of the residual of {f.data['output']}: "
        "the rest is noise or a disturbance"
    )


@words("next-measure", Severity.WARNING)
def next_measure(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: parameters (assumed), current (whether that would determine them)."""
    names = f.data["parameters"]
    current = ", or record the current" if f.data["current"] else ""
    given = " ".join(f"{argument('fixed')} {name}=…" for name in names)
    return f"Next: measure the {listed([name.replace('_', ' ') for name in names])}{current}: {given}"
