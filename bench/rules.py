"""Rules of choice among refinements of a plant: ``python bench/accuracy.py rules``.

Every rule chooses for the simulated motors and axes of ``tests/independent``; the table has the RMSE of the free run on
a record of another kind over that of the true parameters. Name the cases whose names begin like that to run only
these: ``python bench/accuracy.py "rules=axis with drift"``, or others by their seeds: ``"rules=motor 100-109"``.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from math import log

import numpy as np
from rich.console import Console

import emsid
from emsid.models.plants.free_run_error import all_alike
from emsid.models.plants.search.trials import Trial, gain
from emsid.plants import Recent, choose, linear_axis, rigid_motor
from emsid.selection.improvement import better, schwarz_gain
from independent.cases import KINDS, Case, named

FORGOTTEN = 60
"""Errors are forgotten after this part of the record, by the rules that say so."""
SEEDS = "500-507"
"""Of every kind of plant, unless others are named."""


def of_all_samples(simple: Trial, rich: Trial) -> float:
    """Schwarz's criterion as if all samples were independent."""
    samples = sum(len(residual) for residual in rich.residuals)
    return schwarz_gain(rich.mean_square, simple.mean_square, samples, len(rich.names) - len(simple.names))


def of_paired_blocks(simple: Trial, rich: Trial) -> float:
    """The logarithm of what is saved where a paired t test over blocks finds it, else that of a part not worth it."""
    saved = log(simple.mean_square / rich.mean_square)
    return saved if better(rich.errors, simple.errors) else min(saved, 0.0) - 1e-9


def of_the_end(simple: Trial, rich: Trial) -> float:
    """The logarithm of what is saved on the last 30 % of the samples."""
    ends = [np.concatenate([r[int(0.7 * len(r)) :] for r in trial.residuals]) for trial in (simple, rich)]
    return log(float(np.mean(ends[0] ** 2)) / float(np.mean(ends[1] ** 2))) - 1e-3


RULES = {
    "present": {"rule": gain},
    "present, all errors alike": {"rule": gain, "weighting": "alike"},
    "present, errors forgotten": {"rule": gain, "weighting": "recent"},
    "Schwarz over all samples": {"rule": of_all_samples},
    "paired t over blocks": {"rule": of_paired_blocks},
    "end of the record": {"rule": of_the_end},
}


def ratio(case: Case, how: Mapping[str, object]) -> float:
    """RMSE on the unseen record over that of the truth, of the plant that a rule chooses."""
    unit = "m" if case.shows_position else "rad/s"
    record = emsid.Record(case.fitted.input, case.fitted.output, case.fitted.dt, output_units=unit)
    options = dict(how)
    if "weighting" in options:
        recent = Recent(len(record) * record.dt / FORGOTTEN, 2 if case.shows_position else 1)
        options["weighting"] = recent if options["weighting"] == "recent" else all_alike
    fit = choose(linear_axis() if case.shows_position else rigid_motor(), record, **options)
    run = fit.model.plant.simulate(case.unseen.input, case.unseen.dt, np.zeros(3), fit.model.signals)
    return float(np.sqrt(np.mean((case.unseen.output - run) ** 2))) / case.error_of_truth(case.unseen)


def main(begins: str, console: Console) -> None:
    """Print geometric mean, how many are above 1.1 and 2, and the worst, by kind of plant and rule, line after line."""
    console.print("Rules of choice: RMSE on an unseen record over that of the truth")
    console.print(f"{'':24}{'rule':28}  mean  > 1.1  > 2  worst  CPU s")
    cases = (
        named(begins) if begins else {name: make for kind in KINDS for name, make in named(f"{kind} {SEEDS}").items()}
    )
    for group in KINDS:
        some = [make for name, make in cases.items() if name.rpartition(" ")[0] == group]
        for rule, how in RULES.items() if some else ():
            start = time.process_time()
            found = np.array([ratio(make(), how) for make in some])
            seconds = time.process_time() - start
            mean = np.exp(np.mean(np.log(found)))
            console.print(
                f"{len(some):3} x {group:18}{rule:28}{mean:6.2f}{np.sum(found > 1.1):7}{np.sum(found > 2):5}"
                f"{found.max():7.2f}{seconds:7.1f}"
            )
