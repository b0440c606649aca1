"""Accuracy of the default models on simulated nonlinear systems: ``python bench/regressions.py [PART…]``.

The systems come from a simulator that is not the program's own (``tests/independent/nonlinear_systems.py``); each model
is fitted to one record and judged on others of another kind. The noise is what no model can do better than.

The part ``terms`` compares `emsid.select_terms` with FROLS of SysIdentPy (extra ``bench``): terms, and CPU time.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from emsid.identification.candidates import CANDIDATES, USUAL
from emsid.identification.options import Options

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.nonlinear_systems import SYSTEMS, System, duffing  # noqa: E402

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


def terms(samples: int = 20_000, most: int = 10) -> None:
    """Terms of degree 3 selected one step ahead from small and large dictionaries, beside SysIdentPy."""
    record = duffing(samples).fitted
    board = Table(title=f"{most} terms selected from {samples} samples, CPU s", title_justify="left")
    for head in ("terms in the dictionary", "emsid", "SysIdentPy", "ratio", "same terms"):
        board.add_column(head, justify="right")
    for lags in (2, 5, 18):
        dictionary = emsid.polynomial_narx(lags, lags, 3)
        select = partial(emsid.select_terms, dictionary, record, most)
        own = min(cpu_seconds(select) for _ in range(2))
        labels = select().structure.labels
        if lags < 18:
            other, theirs = sysidentpy_frols(record, lags, most)
            row = (f"{other:.3f}", f"{other / own:.0f}", f"{sum(a == b for a, b in zip(labels, theirs, strict=True))}")
        else:
            row = ("–", "–", "–")
        board.add_row(str(len(dictionary)), f"{own:.4f}", *row)
    console.print(board)


def sysidentpy_frols(record: emsid.Record, lags: int, most: int) -> tuple[float, list[str]]:
    """CPU seconds and chosen terms of SysIdentPy's FROLS, in emsid's notation."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    model = FROLS(
        order_selection=False,
        n_terms=most,
        ylag=lags,
        xlag=lags,
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=3),
    )
    seconds = cpu_seconds(lambda: model.fit(X=record.input, y=record.output))
    return seconds, [written(row) for row in model.final_model]


def written(row: np.ndarray) -> str:
    """A term of SysIdentPy, codes 1000·channel + lag with channel 1 for y, as emsid writes it."""
    codes = sorted((int(code) for code in row if code), key=lambda code: (code // 1000, code % 1000))
    powers = {code: codes.count(code) for code in dict.fromkeys(codes)}
    factors = [
        f"{'y' if c // 1000 == 1 else 'u'}(t-{c % 1000})" + (f"^{p}" if p > 1 else "") for c, p in powers.items()
    ]
    return "*".join(factors) or "1"


def cpu_seconds(call: Callable[[], object]) -> float:
    """CPU time of a call, of all threads."""
    start = time.process_time()
    call()
    return time.process_time() - start


def main(arguments: Sequence[str]) -> None:
    """Print the parts that are asked for, by default all."""
    for name in arguments or (*SYSTEMS, "terms"):
        if name == "terms":
            terms()
        else:
            models_of(name, SYSTEMS[name]())


if __name__ == "__main__":
    main(sys.argv[1:])
