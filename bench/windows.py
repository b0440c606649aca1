"""Axes under a load that drifts: the drift in the model against windows, ``python bench/accuracy.py windows``.

The structure is the true one. It is fitted to the whole record, to windows of equal length that have their own initial
states, and with the drift of the load in the model. The table has the RMSE of the free run on another record over that
of the true parameters, which do not know the drift there either. Name other plants by their seeds:
``"windows=axis with drift 100-109"``.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from rich.console import Console

import emsid
from emsid.models.plants.free_run_error import all_alike
from emsid.models.plants.initial_state import InitialState
from emsid.models.plants.search import continuation
from emsid.models.plants.search.estimation import prepare, searched
from emsid.plants import DrivenPlant, choose
from independent.cases import Case, named
from starts import Problem, of_case

PARTS = (3, 6, 12, 24)
"""Numbers of windows."""
ITERATIONS = 60


def main(which: str, console: Console) -> None:
    """Print a row for every plant, and their means."""
    heads = ("whole", *(f"1/{n}" for n in PARTS), "trusted", "drift", "trusted, s")
    console.print("Axes under a drift: RMSE on another record over the truth's, by the length of windows")
    console.print(f"{'':20}" + "".join(f"{head:>11}" for head in heads))
    rows = []
    for name, make in named(which or "axis with drift").items():
        case = make()
        ratios, trusted = compared(case, of_case(case))
        rows.append(ratios)
        console.print(f"{name:20}" + "".join(f"{each:11.2f}" for each in (*ratios, trusted)))
    found = np.array(rows)
    console.print(
        f"{'geometric mean':20}" + "".join(f"{each:11.2f}" for each in np.exp(np.mean(np.log(found), axis=0)))
    )
    console.print(f"{'largest':20}" + "".join(f"{each:11.2f}" for each in found.max(axis=0)))
    console.print(f"{'at most 1.3':20}" + "".join(f"{each:11}" for each in (found <= 1.3).sum(axis=0)) + "\n")


def compared(case: Case, problem: Problem) -> tuple[list[float], float]:
    """The ratios of one plant, and for how long its free run is trusted, in s."""
    record, seconds = problem.record, len(problem.record) * problem.record.dt
    asked = {"free": tuple(problem.known), "fixed": problem.fixed}
    weighting = choose(problem.start, record).weighting
    trusted = weighting[0].trusted(seconds) if isinstance(weighting, tuple) else seconds
    whole, drifting = (
        searched(problem.start, record, **asked, hold=problem.start.hold, weighting=each)[2].problem.plant
        for each in (all_alike, weighting)
    )
    numbers = (*PARTS, int(np.ceil(seconds / trusted)))
    plants = [whole, *(in_windows(whole, record, number, asked) for number in numbers), drifting]
    return [ratio(plant, case) for plant in plants], trusted


def in_windows(plant: DrivenPlant, record: emsid.Record, number: int, asked: dict[str, object]) -> DrivenPlant:
    """The plant fitted to windows of a record, each from an initial state of its own that is estimated."""
    edges = np.linspace(0, len(record), number + 1).astype(int)
    windows = emsid.concatenate([record[a:b] for a, b in pairwise(edges)])
    task = replace(prepare(plant, windows, **asked), hold_given=True, begins=InitialState.FREE)
    return continuation.search(task, plant, ITERATIONS).problem.plant


def ratio(plant: DrivenPlant, case: Case) -> float:
    """RMSE on the unseen record over that of the truth."""
    run = plant.simulate(case.unseen.input, case.unseen.dt, np.zeros(plant.states), (emsid.plants.Signal.POSITION,))
    return float(np.sqrt(np.mean((case.unseen.output - run) ** 2))) / case.error_of_truth(case.unseen)
