"""Words for the study of Kara and Abokoos."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words


def ratio(value: float) -> str:
    """A ratio to the linear model, with three digits."""
    return f"×{float(f'{value:.3g}'):,.10g}"


@words("study-load-friction")
def load_friction(f: Finding, argument: Spelling) -> str:
    d = f.data
    most, (without, at_most) = 100 * d["at_most"], d["errors"]
    cost = (
        f"a linear–static–linear structure suits the motor as well with load friction up to {most:.3g} % of the "
        f"rotor's: fitted again, its free-run MSE on unseen data is {without:.3g} without that friction and "
        f"{at_most:.3g} with it"
        if d["unfair_from"] is None
        else f"from a load friction of {100 * d['unfair_from']:.2g} % of the rotor's on, a linear–static–linear "
        "structure "
        "fitted to the motor has a larger free-run error by more than noise"
    )
    seen = (
        f"; without fitting it again, the friction costs as much as that error from {100 * d['visible_from']:.2g} % on"
        if d["visible_from"] is not None
        else ""
    )
    return (
        f"Friction on the load side changes the speed by a mean square of {d['mse']:.3g} (rad/s)², "
        f"{100 * d['share']:.2g} % of its variance (the paper's motor: {d['paper']:.3g}). That is small by the choice "
        f"of the motor and says nothing about the structure. By its cost in free run, {cost}{seen}"
    )


@words("study-paper-ratios")
def paper_ratios(f: Finding, argument: Spelling) -> str:
    """Data: study, rows (data, paper, free_run, one_step)."""
    rows = [
        f"on {row['data']} data {row['paper']:.3g} in the paper, "
        f"{row['free_run']:.3g} here in free run and {row['one_step']:.3g} one step ahead"
        for row in f.data["rows"]
    ]
    return (
        f"Linear MSE divided by the MSE of {f.subject} ({f.data['study']}): {'; '.join(rows)}. The paper does not say "
        "which of the two errors it means"
    )


@words("study-survey-recorded")
def survey_recorded(f: Finding, argument: Spelling) -> str:
    return (
        "The tables of other motors, inputs and records were recorded with the default settings; give "
        f"{argument('survey')} to repeat them with yours, which takes about two minutes"
    )


@words("study-many-inputs")
def many_inputs(f: Finding, argument: Spelling) -> str:
    """Data: rows (model, parameters, inputs, median, lowest, highest)."""
    rows = f.data["rows"]
    listed = "; ".join(
        f"{row['model']} ({row['parameters']} parameters) {ratio(row['median'])}, "
        f"{ratio(row['lowest'])} to {ratio(row['highest'])}"
        for row in rows
    )
    return (
        f"On the noisy bench, over {rows[0]['inputs']} pairs of inputs, the free-run MSE of the linear model divided "
        f"by that of another is in the median, and from lowest to highest: {listed}"
    )


@words("study-what-decides")
def what_decides(f: Finding, argument: Spelling) -> str:
    """Data: even and odd (motors, lowest, highest; or None), always (by model, the smallest ratio)."""
    even, odd = f.data["even"], f.data["odd"]
    parts = [
        f"on {group['motors']} motors {where} its ratio to linear is {ratio(group['lowest'])} to "
        f"{ratio(group['highest'])}"
        for group, where in (
            (odd, "that are the same in both directions"),
            (even, "where a part of the linear model's error is the same for u and −u"),
        )
        if group
    ]
    always = ", ".join(f"{model} {ratio(least)}" for model, least in f.data["always"].items())
    return (
        f"Whether {f.subject} helps is decided by the error that is the same for u and −u, the only one that its "
        f"quadratic terms can describe: {'; '.join(parts)}. On every motor the others reach at least: {always}"
    )


@words("study-largest-ratio")
def largest_ratio(f: Finding, argument: Spelling) -> str:
    """Data: motors, usual and largest (rows), one_step, published (two ratios), reached (readings)."""
    d = f.data
    usual, best = d["usual"], d["largest"]
    first, second = (ratio(each) for each in d["published"])
    reached = (
        f"Both ratios of the paper's simulation, {first} and {second}, are reached by a motor of the family only with "
        f"these inputs: {', '.join(d['reached'])}"
        if d["reached"]
        else f"Under no reading does a motor of the family reach both ratios of the paper's simulation, {first} and "
        f"{second}"
    )
    return (
        f"The largest ratio of {f.subject} over {d['motors']} motors is {ratio(usual['unseen'])} in free run on unseen "
        f"data ({ratio(usual['identification'])} on identification data) and {ratio(d['one_step'])} one step ahead, "
        f"with the inputs of the study; over all readings it is {ratio(best['unseen'])} in free run "
        f"({best['reading']}). {reached}"
    )


@words("study-two-masses", Severity.WARNING)
def two_masses(f: Finding, argument: Spelling) -> str:
    """Data: rows (record, parameters, covered, worst, error, interval), fixed (names)."""
    rows = "; ".join(
        f"{row['record']}: {row['covered']} of {row['parameters']}, largest error {percent(row['error'])} in "
        f"{row['worst']} with an interval of ± {percent(row['interval'])}"
        for row in f.data["rows"]
    )
    return (
        f"{f.subject} on several records, and how many of its 95 % intervals contain the true value – {rows}. The "
        f"intervals do not include the uncertainty of what is fixed: {', '.join(f.data['fixed'])}"
    )


def percent(share: float) -> str:
    """A share in percent, with two digits.

    >>> percent(-0.0934), percent(1.5e-9)
    ('-9.3 %', '1.5e-07 %')
    """
    return f"{100 * share:.2g} %"


def mse(value: float | None) -> str:
    """A mean square error, or that there is none."""
    return "(diverges)" if value is None else f"{value:.3g}"


@words("study-excitation")
def excitation(f: Finding, argument: Spelling) -> str:
    """Data: study, order, parameters, condition, crest_factor, richer (or None)."""
    d, richer = f.data, f.data["richer"]
    enough = "enough for" if d["order"] >= d["parameters"] else "too few for"
    text = (
        f"The input of the {d['study']} study is persistently exciting of order {d['order']}, {enough} the "
        f"{d['parameters']} parameters of the linear model; only nonlinearity and noise determine the rest"
        if d["order"] < d["parameters"]
        else f"The input of the {d['study']} study is persistently exciting of order {d['order']} or more, {enough} "
        "the "
        f"{d['parameters']} parameters of the linear model"
    )
    text += f" (condition number {d['condition']:.2g}, crest factor {d['crest_factor']:.3g})"
    if richer is None:
        return text
    changes = ", ".join(f"{name} {mse(two)} to {mse(many)}" for name, (two, many) in richer["errors"].items())
    return (
        f"{text}. A multisine of the same peak has order {richer['order']} or more, condition number "
        f"{richer['condition']:.2g} and crest factor {richer['crest_factor']:.3g}; models fitted to it change their "
        f"free-run MSE on the unseen record of two sines: {changes}"
    )


@words("study-even-terms")
def even_terms(f: Finding, argument: Spelling) -> str:
    d = f.data
    return (
        f"{f.subject} ({d['study']}): its free-run MSE is {1 / d['better']:.2f} times the linear model's, and "
        f"{1 / d['paper']:.2g} times in the paper; quadratic terms are even functions and cannot describe the "
        "dead zone and friction of this motor, which are the same in both directions"
    )


@words("study-own-simulator", Severity.WARNING)
def own_simulator(f: Finding, argument: Spelling) -> str:
    return (
        f"{f.subject} ({f.data['study']}): noise-free, by the program's own simulator: a check of the estimator, not a "
        f"result. {', '.join(f.data['fixed'])} are fixed at their true values"
    )


@words("study-noise-free", Severity.WARNING)
def noise_free(f: Finding, argument: Spelling) -> str:
    return (
        "The simulation study has no noise, and its physical models are the equations that made the data; compare the "
        "models by the experiment study"
    )


@words("study-virtual-bench")
def virtual_bench(f: Finding, argument: Spelling) -> str:
    return (
        "The experiment study used a virtual bench with noise, quantisation, delay and ripple that no model contains; "
        f"give {argument('record')} and {argument('unseen')} for records of a real drive"
    )


@words("study-one-step")
def one_step(f: Finding, argument: Spelling) -> str:
    d = f.data
    return (
        f"One-step errors are small for almost any model: in the {d['study']} study, the free-run MSE of "
        f"{f.subject} ({d['method']}) is {d['ratio']:,.0f} times its one-step MSE"
    )


@words("study-recursive-and-batch")
def recursive_and_batch(f: Finding, argument: Spelling) -> str:
    d = f.data
    share = format(100 * d["difference"], ".2g" if d["difference"] < 1 else ",.0f")
    text = (
        f"Recursive and batch least squares (forgetting factor {d['forgetting']:g}) differ by at most {share} % of the "
        f"free-run MSE in the {d['study']} study, in {f.subject}"
    )
    if d.get("covariance") is None:
        return text
    from_there = "at none of those tried" if d["vanishes_at"] is None else f"from P(0) = {d['vanishes_at']:.0e} on"
    return (
        f"{text}. P(0) = {d['covariance']:.0e} acts as a ridge of {1 / d['covariance']:.0e}, at a condition number of "
        f"{d['condition']:.2g}: batch least squares with this ridge differs by {100 * abs(d['ridge']):.2g} %. The "
        f"difference is below 1 % {from_there}"
    )


@words("study-rank-deficient", Severity.WARNING)
def rank_deficient(f: Finding, argument: Spelling) -> str:
    d = f.data
    return (
        f"{f.subject} ({d['study']}, {d['method']}): the data determine {d['rank']} combinations of the "
        f"{d['parameters']} parameters, so not all of its estimates are meaningful"
    )


@words("study-model-failed", Severity.PROBLEM)
def model_failed(f: Finding, argument: Spelling) -> str:
    return f"{f.subject} could not be fitted in the {f.data['study']} study: {f.data['problem']}"
