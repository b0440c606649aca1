"""Words for the residual of the chosen model, and for what to do next."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words
from emsid.wording.lists import listed


@words("residual-white")
def residual_white(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: lags, largest."""
    return f"the one-step errors of {f.subject} are white: no correlation is left over {f.data['lags']} samples"


@words("residual-coloured", Severity.WARNING)
def residual_coloured(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: largest, lag."""
    return (
        f"the one-step errors of {f.subject} are correlated with each other (up to {f.data['largest']:.2f} at lag "
        f"{f.data['lag']}): dynamics or noise are not modelled, and intervals from least squares are too narrow"
    )


@words("residual-free-of-input")
def residual_free_of_input(f: Finding, argument: Spelling) -> str:
    """Subject: the output."""
    return f"the free-run error of {f.subject} does not depend on the input, as far as correlation shows"


@words("residual-follows-input", Severity.WARNING)
def residual_follows_input(f: Finding, argument: Spelling) -> str:
    """Subject: the output. Data: input, lag, deviations."""
    return (
        f"the free-run error of {f.subject} depends on {f.data['input']} {f.data['lag']} samples earlier "
        f"({f.data['deviations']:.0f} standard deviations): a better model would explain more"
    )


@words("next-step-check-data")
def next_step_check_data(f: Finding, argument: Spelling) -> str:
    """No data."""
    return (
        f"next: check that the columns, units and sample time are right ({argument('input')}, {argument('output')}, "
        f"{argument('unit')}, {argument('dt')}), and that the input moves the output at all"
    )


@words("next-step-separate-records")
def next_step_separate_records(f: Finding, argument: Spelling) -> str:
    """No data."""
    return "next: identify the records one by one, and compare their gains and delays"


@words("next-step-unseen-data")
def next_step_unseen_data(f: Finding, argument: Spelling) -> str:
    """No data."""
    return f"next: give a record that the models were not fitted to and whose input varies ({argument('unseen')})"


@words("next-step-determine-parameters")
def next_step_determine_parameters(f: Finding, argument: Spelling) -> str:
    """Subject: the model."""
    return (
        f"next: these data do not determine all parameters of {f.subject}; fix those that are known "
        f"({argument('fixed')}), choose a smaller structure, or record with an input that varies more"
    )


@words("next-step-repair-search")
def next_step_repair_search(f: Finding, argument: Spelling) -> str:
    """Subject: the model."""
    return f"next: fit {f.subject} with fewer parameters or lower orders, so that its search reaches a minimum"


@words("next-step-richer-model")
def next_step_richer_model(f: Finding, argument: Spelling) -> str:
    """Subject: the chosen model. Data: models."""
    return (
        f"next: {f.subject} does not explain all that the input does; try {listed(f.data['models'])} "
        f"({argument('models')})"
    )


@words("next-step-another-experiment")
def next_step_another_experiment(f: Finding, argument: Spelling) -> str:
    """Subject: the chosen model."""
    return f"next: test {f.subject} on another experiment, with another kind of input ({argument('unseen')})"
