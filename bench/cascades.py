"""How fits of random cascades end, and their errors: ``python bench/accuracy.py cascades``, ``"cascades=60-79"``.

The filters, the kind of map and the records are drawn anew for every seed, by a simulator that is not the program's own
(``tests/independent``). Orders and map are chosen by the fit. Errors are of the free run on another record, in
multiples of the noise. Sixty take about five CPU minutes.
"""

from __future__ import annotations

from collections import Counter
from time import process_time

import numpy as np
from rich.console import Console

import emsid
from independent.cascades import cascade

SEEDS = "0-59"


def main(seeds: str, console: Console) -> None:
    """One row for every fit that did not converge or has more than twice the noise, and a line for all.

    Args:
        seeds: the first and the last, such as ``60-79``; sixty if it is empty.
        console: to print to.
    """
    first, last = map(int, (seeds or SEEDS).split("-"))
    counts: Counter[str] = Counter()
    errors, start = [], process_time()
    for seed in range(first, last + 1):
        kind, fitted, judge, noise = cascade(seed)
        fit = emsid.fit(emsid.wiener_hammerstein(static=None), fitted)
        run = fit.model.simulate(judge)
        errors.append(float(np.sqrt(np.mean((judge.output - run.output)[run.counted] ** 2))) / noise)
        counts[fit.ending.value] += 1
        if fit.ending.value != "converged" or errors[-1] > 2:
            console.print(f"cascade {seed} ({kind}): {fit.ending.value}, {errors[-1]:.2f} times the noise")
    ended = ", ".join(f"{count} {ending}" for ending, count in counts.most_common())
    found = np.array(errors)
    console.print(
        f"Random cascades: {ended}; RMSE over the noise: median {np.median(found):.2f}, at most 1.2 in "
        f"{np.sum(found <= 1.2)} of {len(found)}, worst {found.max():.2f}; {process_time() - start:.0f} s CPU\n"
    )
