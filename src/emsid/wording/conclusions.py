"""Words for the conclusions of an identification: the verdict on the residual, and what to do next."""

from __future__ import annotations

from emsid.errors import listed
from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words


@words("residual-depends-on-input", Severity.WARNING)
def residual_depends(f: Finding, argument: Spelling) -> str:
    """Data: output, share (of the variance of the residual)."""
    return (
        f"the input predicts {100 * f.data['share']:.0f} % of the variance of the residual of {f.data['output']}, so "
        "the model lacks part of the dynamics or a nonlinearity"
    )


@words("residual-independent-of-input")
def residual_independent(f: Finding, argument: Spelling) -> str:
    """Data: output, share (of the variance of the residual)."""
    return (
        f"the input predicts at most {max(1.0, 100 * f.data['share']):.0f} % of the residual of {f.data['output']}: "
        "the rest is noise or a disturbance"
    )


@words("residual-not-tested")
def residual_not_tested(f: Finding, argument: Spelling) -> str:
    """Data: output, independent (values of the residual, where these are too few)."""
    if "independent" in f.data:
        return (
            f"the residual of {f.data['output']} could not be tested: only {f.data['independent']:.0f} independent "
            "values; record longer"
        )
    return f"the residual of {f.data['output']} could not be tested: a constant signal, or too few samples"


@words("residual-depends-on-term", Severity.WARNING)
def residual_depends_on_term(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: term, kind (even, odd, product), largest, at_lag, limit."""
    kind = f.data["kind"]
    lacks = "a product of these signals" if kind == "product" else f"an {kind} nonlinearity"
    return (
        f"the residual of {f.subject} is correlated with {f.data['term']} ({f.data['largest']:.1f} standard deviations "
        f"at lag {f.data['at_lag']}, limit {f.data['limit']:.1f}): the model lacks {lacks}"
    )


@words("next-measure", Severity.WARNING)
def next_measure(f: Finding, argument: Spelling) -> str:
    """Subject: the model. Data: parameters (assumed), current (whether that would determine them)."""
    names = f.data["parameters"]
    current = ", or record the current" if f.data["current"] else ""
    given = " ".join(f"{argument('fixed')} {name}=…" for name in names)
    return f"Next: measure the {listed([name.replace('_', ' ') for name in names])}{current}: {given}"


sentences("""
residual-white info: the one-step errors of {subject} are white: the first {lags} lags show no correlation
residual-coloured warning: the one-step errors of {subject} are correlated with each other (up to {largest:.2f} at lag
    {lag}): dynamics or noise are not modelled
next-check-data warning: No model describes these data well; check units, sample time and columns, and leave out
    samples that are not normal operation ({argument[mask]})
next-reduce-noise warning: Noise or a disturbance probably limits the fit to {fit_percent:.0f} %; use a larger input,
    a better sensor, or record the disturbance as another input
next-physical-model info: Fit a physical model too, to estimate friction, dead zone and delay as parameters:
    {argument[models]} rigid-motor, or motor for a flexible shaft
""")
