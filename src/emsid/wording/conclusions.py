"""Words for what follows from an identification: the verdict on the residual, and what to do next."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words


@words("residual-depends-on-input", Severity.WARNING)
def residual_depends(f: Finding, argument: Spelling) -> str:
    """Data: output, input, largest (in standard deviations), lag (s), limit."""
    d = f.data
    return (
        f"the residual of {d['output']} still depends on {d['input']} (correlation of {d['largest']:.1f} standard "
        f"deviations {d['lag']:.3g} s later, where chance reaches {d['limit']:.1f}), so the model misses part of the "
        "dynamics or a nonlinearity"
    )


@words("residual-independent-of-input")
def residual_independent(f: Finding, argument: Spelling) -> str:
    """Data: output, input, largest, lag, limit."""
    d = f.data
    return (
        f"the residual of {d['output']} does not depend on the input, as far as these data show: what is left is noise "
        "or a disturbance"
    )


@words("residual-not-tested")
def residual_not_tested(f: Finding, argument: Spelling) -> str:
    """Data: output."""
    return f"the residual of {f.data['output']} could not be tested against the input: one of them is constant"


@words("next-check-data", Severity.WARNING)
def next_check_data(f: Finding, argument: Spelling) -> str:
    """Subject: the record. Data: fit_percent."""
    return (
        "No model describes these data well. Check units, sample time and what each column is, leave out what is not "
        f"ordinary operation with {argument('mask')}, and look where in the plot the model goes wrong"
    )


@words("next-physical-model")
def next_physical_model(f: Finding, argument: Spelling) -> str:
    """Subject: the best model."""
    return (
        "Fit a physical model too, which has friction, a dead zone and delays by their names: "
        f"{argument('models')} rigid-motor, or motor for a flexible shaft"
    )


@words("next-other-experiment")
def next_other_experiment(f: Finding, argument: Spelling) -> str:
    """Subject: the unseen data."""
    return (
        "The models were ranked on a part of the same experiment. Record a second one with another input, of the kind "
        f"the model will meet, and rank on it with {argument('unseen')}"
    )


@words("next-use-model")
def next_use_model(f: Finding, argument: Spelling) -> str:
    """Subject: the model."""
    return f"Use {f.subject}: it is saved as {f.subject}.json, which emsid validate and emsid.load read"
