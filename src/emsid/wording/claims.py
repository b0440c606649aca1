"""The claims of Kara and Abokoos beside what the study finds about each, and where it holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from emsid.findings import Finding
from emsid.wording.catalogue import Spelling, as_python, sentence
from emsid.wording.lists import listed
from emsid.wording.study import percent, ratio, smaller, span, where


@dataclass(frozen=True)
class Claim:
    """A row of the table of claims.

    Attributes:
        paper: what the paper says.
        found: what the study finds.
        where: the motors, inputs and records for which it is found.
    """

    paper: str
    found: str
    where: str


Parts = tuple[str, str, str]
"""What the paper says, the numbers behind the sentence of the finding, and where they hold."""
_CLAIMS: dict[str, Callable[[Finding], Parts]] = {}


def claim(finding: Finding, argument: Spelling = as_python) -> Claim | None:
    """The row of a finding; None for one that is not about a claim of the paper."""
    parts = _CLAIMS.get(finding.code)
    if parts is None:
        return None
    paper, numbers, where = parts(finding)
    return Claim(f"{paper}.", f"{sentence(finding, argument)} {numbers}.".removesuffix(" ."), where)


def _about(code: str) -> Callable[[Callable[[Finding], Parts]], Callable[[Finding], Parts]]:
    """Register the parts of the row of a code."""

    def register(parts: Callable[[Finding], Parts]) -> Callable[[Finding], Parts]:
        _CLAIMS[code] = parts
        return parts

    return register


@_about("study-paper-ratios")
def paper_ratios(f: Finding) -> Parts:
    rows = f.data["rows"]
    published = listed([f"{ratio(row['paper'])} (beside our {row['study']}, {row['data']} data)" for row in rows])
    ahead = listed([ratio(row["one_step"]) for row in rows])
    return (
        f"The nonlinear model (5.10) has a smaller MSE than the linear model (5.12), by {published}",
        f"One step ahead it is {ahead}, in this order",
        "one pair of inputs, for identification and for verification",
    )


@_about("study-even-terms")
def even_terms(f: Finding) -> Parts:
    studies = f.data["studies"]
    here = listed([f"{smaller(study['better'])} {where(study['study'])}" for study in studies])
    paper = listed([smaller(study["paper"]) for study in studies])
    return (
        "An expansion of second degree describes dead zone and Coulomb friction",
        f"Its free-run MSE, beside the linear model's, is {here}; in the paper {paper}",
        "dead zone and friction alike in both directions",
    )


@_about("study-what-decides")
def what_decides(f: Finding) -> Parts:
    motors = sum(group["motors"] for group in (f.data["even"], f.data["odd"]) if group)
    always = listed([f"{model} {ratio(least)}" for model, least in f.data["always"].items()])
    return (
        "Nonlinear identification is necessary for systems with nonlinear characteristics",
        "Even in u: the same for u and −u, as the quadratic terms are. On every motor the other models reach at least: "
        f"{always}",
        f"{motors} motors on the noisy bench",
    )


@_about("study-many-inputs")
def many_inputs(f: Finding) -> Parts:
    ranges = listed([f"{row['model']} {span(row)}" for row in f.data["rows"]])
    return (
        "The comparison is made with one pair of inputs",
        f"From lowest to highest: {ranges}",
        "the built-in motor; free run on unseen data",
    )


@_about("study-largest-ratio")
def largest_ratio(f: Finding) -> Parts:
    d = f.data
    first, second = (ratio(each) for each in d["published"])
    reached = (
        f"A motor reaches both ratios of the paper only with these inputs: {', '.join(d['reached'])}"
        if d["reached"]
        else "No motor reaches both ratios of the paper"
    )
    return (
        f"In simulation the linear MSE is {first} (identification data) and {second} (verification) the nonlinear MSE",
        f"The largest one step ahead is {ratio(d['one_step'])}. {reached}",
        f"{d['motors']} motors that combine dead zone, slope and friction",
    )


@_about("study-one-step")
def one_step(f: Finding) -> Parts:
    return (
        "ŷ in the MSE (5.14) is the predicted output; free run or one step ahead is not stated",
        "",
        f"{f.data['study']}, unseen data",
    )


@_about("study-excitation")
def excitation(f: Finding) -> Parts:
    d, richer = f.data, f.data["richer"]
    numbers = f"Condition number {_condition(d['condition'])}, crest factor {d['crest_factor']:.3g}"
    if richer is not None:
        changes = listed([f"{name} {_mse(two)} to {_mse(many)}" for name, (two, many) in richer["errors"].items()])
        numbers += (
            f". A multisine of the same peak has order {richer['order']} or more, condition number "
            f"{_condition(richer['condition'])} and crest factor {richer['crest_factor']:.3g}; "
            f"fitted to it, the models change their free-run MSE on unseen data: {changes}"
        )
    return "Two sines added are persistently exciting", numbers, f"{d['study']}, identification data"


def _mse(value: float | None) -> str:
    """A mean square error, or that there is none."""
    return "(diverges)" if value is None else f"{value:.3g}"


def _condition(value: float) -> str:
    """A condition number with two digits.

    >>> _condition(370.3), _condition(10986.6), _condition(3.69e9)
    ('370', '11,000', '3.7e+09')
    """
    return f"{value:.2g}" if value >= 1e5 else f"{float(f'{value:.2g}'):,.10g}"


@_about("study-recursive-and-batch")
def recursive_and_batch(f: Finding) -> Parts:
    d = f.data
    numbers = ""
    if d.get("covariance") is not None:
        vanishes = "at none of those tried" if d["vanishes_at"] is None else f"from P(0) = {d['vanishes_at']:.0e} on"
        numbers = (
            f"P(0) = {d['covariance']:.0e} acts as a ridge of {1 / d['covariance']:.0e}, at a condition number of "
            f"{_condition(d['condition'])}; batch least squares with this ridge differs by "
            f"{100 * abs(d['ridge']):.2g} %. The difference is below 1 % {vanishes}"
        )
    return "Least squares and recursive least squares both identify the models", numbers, f"{d['study']}, unseen data"


@_about("study-load-friction")
def load_friction(f: Finding) -> Parts:
    d, (without, at_most) = f.data, f.data["errors"]
    seen = (
        f". Without fitting it again, the friction costs as much as that error from {percent(d['visible_from'])} on"
        if d["visible_from"] is not None
        else ""
    )
    return (
        f"Friction on the side of the load can be ignored: it changes the output by about {d['paper']:.3g}",
        f"Here it is a mean square of {d['mse']:.3g} (rad/s)². Fitted again, the structure has a free-run MSE of "
        f"{without:.3g} without load friction and {at_most:.3g} with {percent(d['at_most'])} of the rotor's{seen}",
        "the simulated motor, without noise",
    )


@_about("study-two-masses")
def two_masses(f: Finding) -> Parts:
    rows = "; ".join(
        f"{row['record']}: {row['covered']} of {row['parameters']}, largest error {percent(row['error'])} in "
        f"{row['worst']} (± {percent(row['interval'])})"
        for row in f.data["rows"]
    )
    return (
        "The motor is simulated with rotor, shaft and load",
        f"Record by record – {rows}. Fixed: {', '.join(f.data['fixed'])}",
        "records of the built-in motor",
    )
