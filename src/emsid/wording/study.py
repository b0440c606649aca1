"""Words for the study of Kara and Abokoos."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, sentences, words
from emsid.wording.identification import of_program
from emsid.wording.lists import listed

sentences(
    __name__,
    """
study-survey-recorded info: The tables of other motors, inputs and records were recorded with the default settings
study-even-terms info: The quadratic terms of {subject} are the same for u and −u, so they cannot describe a dead zone
    and friction that are alike in both directions
study-noise-free warning: The simulation study has no noise, and its physical models are the equations that made the
    data; compare the models by the other study
study-virtual-bench info: No drive was measured: the records are of a virtual bench, with noise, delay and ripple that
    no model contains; give your own ({argument[record]}, {argument[unseen]})
study-one-step info: One-step errors are small for almost any model: in the study of the {study}, the free-run MSE of
    {subject} ({method}) is {ratio:,.0f} times its one-step MSE
study-rank-deficient warning: {subject} ({study}, {method}): the data determine {rank} combinations of the {parameters}
    parameters, so not all of its estimates are meaningful
""",
)


def times(value: float) -> str:
    """A number with three digits and commas.

    >>> times(2034.5), times(0.9905)
    ('2,030', '0.991')
    """
    return f"{float(f'{value:.3g}'):,.10g}"


def ratio(value: float) -> str:
    """A ratio to the linear model, with three digits."""
    return f"×{times(value)}"


def smaller(value: float) -> str:
    """How a quantity compares with another one that is so many times it.

    >>> smaller(2034.5), smaller(0.8), smaller(1.0)
    ('2,030 times smaller', '1.25 times larger', 'the same')
    """
    if times(value) == "1":
        return "the same"
    return f"{times(value)} times smaller" if value > 1 else f"{times(1 / value)} times larger"


def where(study: str) -> str:
    """In which of the studies."""
    return "in simulation" if study == "simulation" else f"{'on' if 'bench' in study else 'in'} the {study}"


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
    worse = [times(row["free_run"]) != "1" and row["free_run"] < 1 for row in rows]
    how = "worse" if all(worse) else "partly worse" if any(worse) else "not worse"
    parts = [f"{ratio(row['free_run'])} {where(row['study'])} (paper: {ratio(row['paper'])})" for row in rows]
    return f"The paper's nonlinear model is {how} than its linear one: MSE ratio {listed(parts)}"


@words("study-best-model")
def best_model(f: Finding, argument: Spelling) -> str:
    """Data: study, parameters, fit_percent, ratio (1 for the linear model)."""
    d = f.data
    beside = f", with an MSE {smaller(d['ratio'])} than the linear model's" if times(d["ratio"]) != "1" else ""
    return (
        f"{f.subject} ({d['parameters']} parameters) is the best model {where(d['study'])}: its free run fits to "
        f"{d['fit_percent']:.1f} %{beside}"
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
        (f"{d['order']}", "not rich enough")
        if d["order"] < d["parameters"]
        else (f"{d['order']} or more", "rich enough")
    )
    return (
        f"The input {where(d['study'])} is {enough} for the {d['parameters']} parameters of the linear model (order of "
        f"excitation {order})"
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
        f"free-run MSE {where(d['study'])}, in {f.subject}"
    )


@words("study-model-failed", Severity.PROBLEM)
def model_failed(f: Finding, argument: Spelling) -> str:
    more = of_program(argument) if f.data["internal"] else ""
    return f"{f.subject} could not be fitted {where(f.data['study'])}: {f.data['problem']}{more}"
