"""Words for the study of Kara and Abokoos."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.identification import of_program
from emsid.wording.lists import listed


def times(value: float) -> str:
    """A number with three digits and commas.

    >>> times(2034.5), times(0.9905)
    ('2,030', '0.991')
    """
    return f"{float(f'{value:.3g}'):,.10g}"


def ratio(value: float) -> str:
    """A ratio to the linear model, with three digits."""
    return f"×{times(value)}"


def span(group: Mapping[str, Any]) -> str:
    """The lowest and the highest ratio of a group."""
    return f"{ratio(group['lowest'])} to {ratio(group['highest'])}"


@words("study-load-friction")
def load_friction(f: Finding, argument: Spelling) -> str:
    """Data: mse, share, paper, at_most, unfair_from (or None), visible_from (or None), errors (two), difference."""
    d = f.data
    suits = (
        f"a linear–static–linear structure suits the motor up to {100 * d['at_most']:.3g} % of the rotor's friction"
        if d["unfair_from"] is None
        else f"a linear–static–linear structure is worse from {100 * d['unfair_from']:.2g} % of the rotor's friction on"
    )
    return f"Friction on the load makes up {percent(d['share'])} of the variance of the speed; {suits}"


@words("study-paper-ratios")
def paper_ratios(f: Finding, argument: Spelling) -> str:
    """Data: rows (study, data, paper, free_run, one_step), with those on unseen data."""
    rows = [row for row in f.data["rows"] if row["data"] == "unseen"]
    shares = [f"{1 / row['free_run']:.3g} in {row['study']} (paper: {1 / row['paper']:.2g})" for row in rows]
    return f"On unseen data, the paper's nonlinear free-run MSE relative to its linear one is {listed(shares)}"


@words("study-best-model")
def best_model(f: Finding, argument: Spelling) -> str:
    """Data: study, parameters, fit_percent, ratio (1 for the linear model)."""
    d = f.data
    smaller = f", with an MSE {times(d['ratio'])} times smaller than the linear model's" if d["ratio"] != 1 else ""
    return (
        f"{f.subject} ({d['parameters']} parameters) is the best model of the {d['study']}: its free run fits to "
        f"{d['fit_percent']:.1f} %{smaller}"
    )


@words("study-many-inputs")
def many_inputs(f: Finding, argument: Spelling) -> str:
    """Data: rows (model, parameters, inputs, median, lowest, highest)."""
    rows = f.data["rows"]
    medians = listed([f"{ratio(row['median'])} for {row['model']}" for row in rows])
    return f"Over {rows[0]['inputs']} pairs of inputs on the noisy bench, the median ratio to linear is {medians}"


@words("study-what-decides")
def what_decides(f: Finding, argument: Spelling) -> str:
    """Data: even and odd (motors, lowest, highest; or None), always (by model, the smallest ratio)."""
    even, odd = f.data["even"], f.data["odd"]
    where = "where the linear model's error is"
    parts = [f"{span(even)} on {even['motors']} motors {where} partly even in u"] if even else []
    if odd:
        parts.append(f"{span(odd)} on {odd['motors']} {'others' if even else f'motors {where} not even in u'}")
    return f"{f.subject} reaches ratios of {', '.join(parts)}"


@words("study-largest-ratio")
def largest_ratio(f: Finding, argument: Spelling) -> str:
    """Data: motors, readings, usual and largest (rows), one_step, published (two ratios), reached (readings)."""
    d = f.data
    return (
        f"The largest ratio of {f.subject} over {d['motors']} motors is {ratio(d['usual']['unseen'])} with the inputs "
        f"of the study and {ratio(d['largest']['unseen'])} over {d['readings']} kinds of experiment"
    )


@words("study-two-masses", Severity.WARNING)
def two_masses(f: Finding, argument: Spelling) -> str:
    """Data: rows (record, parameters, covered, worst, error, interval), fixed (names)."""
    best, worst = (end(f.data["rows"], key=lambda row: row["covered"]) for end in (max, min))
    of = [f"{row['covered']} of {row['parameters']} true values on {row['record']}" for row in (best, worst)]
    contain = of[0] if best is worst else f"{of[0]}, but {of[1]}"
    return f"The 95 % intervals of {f.subject}, without the uncertainty of fixed values, contain {contain}"


def percent(share: float) -> str:
    """A share in percent, with two digits.

    >>> percent(-0.0934), percent(1.5e-9)
    ('-9.3 %', '1.5e-07 %')
    """
    return f"{100 * share:.2g} %"


@words("study-excitation")
def excitation(f: Finding, argument: Spelling) -> str:
    """Data: study, order, parameters, condition, crest_factor, richer (or None)."""
    d = f.data
    order, enough = (
        (f"{d['order']}", "too few for") if d["order"] < d["parameters"] else (f"{d['order']} or more", "enough for")
    )
    return (
        f"The input of the {d['study']} study is persistently exciting of order {order}, {enough} the "
        f"{d['parameters']} parameters of the linear model"
    )


@words("study-own-simulator", Severity.WARNING)
def own_simulator(f: Finding, argument: Spelling) -> str:
    return (
        f"{f.subject} ({f.data['study']}): noise-free, by the program's own simulator: a check of the estimator, not a "
        f"result. {', '.join(f.data['fixed'])} are fixed at their true values"
    )


@words("study-recursive-and-batch")
def recursive_and_batch(f: Finding, argument: Spelling) -> str:
    """Data: study, difference, forgetting; where known condition, covariance, ridge, vanishes_at (or None)."""
    d = f.data
    share = format(100 * d["difference"], ".2g" if d["difference"] < 1 else ",.0f")
    return (
        f"Recursive and batch least squares (forgetting factor {d['forgetting']:g}) differ by at most {share} % of the "
        f"free-run MSE in the {d['study']} study, in {f.subject}"
    )


@words("study-model-failed", Severity.PROBLEM)
def model_failed(f: Finding, argument: Spelling) -> str:
    more = of_program(argument) if f.data["internal"] else ""
    return f"{f.subject} could not be fitted in the {f.data['study']} study: {f.data['problem']}{more}"


sentences("""
study-survey-recorded info: The tables of other motors, inputs and records were recorded with the default settings
study-even-terms info: The quadratic terms of {subject} are the same for u and −u, so they cannot describe a dead zone
    and friction that are alike in both directions
study-noise-free warning: The simulation study has no noise, and its physical models are the equations that made the
    data; compare the models by the experiment study
study-virtual-bench info: The experiment study used a virtual bench with noise, quantisation, delay and ripple that no
    model contains; give {argument[record]} and {argument[unseen]} for records of a real drive
study-one-step info: One-step errors are small for almost any model: in the {study} study, the free-run MSE of
    {subject} ({method}) is {ratio:,.0f} times its one-step MSE
study-rank-deficient warning: {subject} ({study}, {method}): the data determine {rank} combinations of the
    {parameters} parameters, so not all of its estimates are meaningful
""")
