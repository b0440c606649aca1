"""Words for the study of Kara and Abokoos."""

from __future__ import annotations

from emsid.findings import Finding
from emsid.wording.catalogue import Severity, Spelling, words


@words("study-load-friction")
def load_friction(f: Finding, argument: Spelling) -> str:
    d = f.data
    fair = "can be neglected, and a linear–static–linear structure suits this motor as far as the load is concerned"
    return (
        f"Friction on the load side changes the speed by a mean square of {d['mse']:.3g} (rad/s)², "
        f"{100 * d['share']:.2g} % of its variance (the paper's motor: {d['paper']:.3g}). "
        f"It {fair if d['negligible'] else 'cannot be neglected: a linear–static–linear structure does not suit it'}"
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
        "result"
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
    return (
        f"Recursive and batch least squares (forgetting factor {d['forgetting']:g}) differ by at most {share} % of the "
        f"free-run MSE in the {d['study']} study, in {f.subject}"
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
