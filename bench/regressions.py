"""Accuracy of the default models on simulated nonlinear systems: ``python bench/regressions.py [PART…]``.

The systems come from a simulator that is not the program's own (``tests/independent/nonlinear_systems.py``); each model
is fitted to one record and judged on others of another kind. The noise is what no model can do better than.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from emsid.identification.candidates import CANDIDATES, USUAL
from emsid.identification.options import Options

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.nonlinear_systems import SYSTEMS, System  # noqa: E402

console = Console(width=150)


def run_error(fit: emsid.Fit, record: emsid.Record) -> float:
    """RMSE of the free run, in the unit of the output."""
    run = fit.model.simulate(record)
    return float(np.sqrt(np.mean((record.output - run.output)[run.counted] ** 2)))


def models_of(name: str, system: System, models: Sequence[str] = USUAL) -> None:
    """The default models of `emsid identify`, each fitted to the whole record of a system."""
    board = Table(title=f"{name}: RMSE of the free run; noise {system.noise:.4g}", title_justify="left")
    for head in ("", "fitted", *system.unseen, "parameters", "s CPU", "ended"):
        board.add_column(head, justify="right" if head else "left")
    for model in models:
        start = time.process_time()
        try:
            fit = CANDIDATES[model](system.fitted, Options())
        except emsid.ModelError as problem:
            board.add_row(model, str(problem))
            continue
        seconds = time.process_time() - start
        errors = [run_error(fit, record) for record in (system.fitted, *system.unseen.values())]
        board.add_row(model, *(f"{e:.4g}" for e in errors), str(len(fit.estimate)), f"{seconds:.1f}", fit.ending.value)
    console.print(board)


def main(arguments: Sequence[str]) -> None:
    """Print the parts that are asked for, by default all."""
    for name in arguments or SYSTEMS:
        models_of(name, SYSTEMS[name]())


if __name__ == "__main__":
    main(sys.argv[1:])
