"""Speed compared with other packages, in one run on one machine: ``make bench``, or ``python bench/run.py PART…``.

Every figure is the best of several repetitions with the libraries' default thread settings, after a warm-up that
compiles what is compiled. Slow peers are measured on fewer samples and reported per sample. Nothing here decides a
test.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import tracemalloc
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.signal import lfilter

import emsid
from arguments import asked_parts
from emsid.plant import Motor, simulate
from emsid.plant.reference import simulate_reference
from emsid.plant.simulation import Taylor
from terms import terms

warnings.filterwarnings("ignore")  # the peers'
Array = NDArray[np.float64]
N, FEW = 1_000_000, 5_000
console = Console(width=120)


def best(run: Callable[[], object], repetitions: int = 5) -> float:
    """Seconds of the fastest of several runs, after one that does not count."""
    run()
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


class Board:
    """A table of what was measured against what is expected."""

    def __init__(self, title: str, unit: str) -> None:
        self.table = Table(title=title, title_justify="left")
        for head in ("", unit, "emsid is faster by", "expected"):
            self.table.add_column(head, justify="left" if not head else "right")
        self.own = 0.0

    def emsid(self, what: str, value: float, expected: str = "") -> None:
        self.own = value
        self.table.add_row(f"[bold]emsid[/] {what}", f"{value:,.3g}", "", expected)

    def peer(self, what: str, value: float, expected: str = "") -> None:
        self.table.add_row(what, f"{value:,.4g}", f"{value / self.own:,.3g}", expected)

    def show(self) -> None:
        console.print(self.table)


def record_of(samples: int) -> emsid.Record:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(samples)
    y = lfilter([0.0, 0.1, 0.2, 0.1], [1, -1.2, 0.5, -0.1], u) + 0.01 * rng.standard_normal(samples)
    return emsid.Record(u, y, 0.001)


def batch() -> None:
    """Batch least squares, 10 parameters."""
    record, structure = record_of(N), emsid.arx(na=5, nb=5)
    u, y = record.input[:, 0], record.output[:, 0]

    def build() -> tuple[Array, Array]:
        columns = [-y[5 - k : N - k] for k in range(1, 6)] + [u[5 - k : N - k] for k in range(1, 6)]
        return np.column_stack(columns), y[5:]

    matrix, target = build()
    board = Board(f"Batch least squares, ARX with 10 parameters, {N:,} samples", "ns/sample")
    board.emsid("least_squares, regression included", best(lambda: emsid.least_squares(structure, record)) / N * 1e9)
    built = best(build) / N * 1e9
    solved = best(lambda: np.linalg.lstsq(matrix, target, rcond=None)) / N * 1e9
    board.peer("numpy: build the matrix, then lstsq", built + solved, "≥ 10")
    board.peer("numpy: lstsq on a ready-made matrix", solved)
    board.peer("SysIdentPy FROLS(order_selection=False), per sample", _sysidentpy_batch(record) * 1e9)
    board.show()
    tracemalloc.start()
    emsid.least_squares(structure, record)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    size = matrix.nbytes / 2**20
    console.print(f"peak memory beyond the data: {peak / 2**20:.1f} MiB (the matrix: {size:.0f} MiB)\n")


def _sysidentpy(estimator: object, degree: int = 1, terms: int = 10) -> object:
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS

    return FROLS(
        order_selection=False,
        n_terms=terms,
        ylag=5,
        xlag=5,
        estimator=estimator,
        basis_function=Polynomial(degree=degree),
    )


def _sysidentpy_batch(record: emsid.Record) -> float:
    from sysidentpy.parameter_estimation import LeastSquares

    few = record[:20_000]
    return best(lambda: _sysidentpy(LeastSquares()).fit(X=few.input, y=few.output), 2) / len(few)


def recursive() -> None:
    """Recursive least squares, 10 parameters."""
    record, structure = record_of(N), emsid.arx(na=5, nb=5)
    few = record[:FEW]
    matrix, target = structure.regression(few)

    board = Board("Recursive least squares, 10 parameters", "ns/sample")
    for what, history in (("last estimate only", False), ("every estimate kept, as by the others", True)):
        run = partial(emsid.recursive_least_squares, structure, record, forgetting=0.999, history=history)
        board.emsid(f"recursive_least_squares, {what}", best(run, 3) / N * 1e9, "≤ 150 ns")
    import padasip
    from statsmodels.regression.recursive_ls import RecursiveLS
    from sysidentpy.parameter_estimation import RecursiveLeastSquares

    board.peer(
        "padasip FilterRLS", best(lambda: padasip.filters.FilterRLS(10, mu=0.999).run(target, matrix), 2) / FEW * 1e9
    )
    board.peer(
        "statsmodels RecursiveLS, without forgetting", best(lambda: RecursiveLS(target, matrix).fit(), 1) / FEW * 1e9
    )
    board.peer(
        "SysIdentPy RecursiveLeastSquares",
        best(lambda: RecursiveLeastSquares(lam=0.999).optimize(matrix, target[:, None]), 2) / FEW * 1e9,
        "≥ 500",
    )
    board.show()


def free_run() -> None:
    """Free run of a linear and a nonlinear structure."""
    from sysidentpy.parameter_estimation import LeastSquares

    record = record_of(N)
    few = record[:FEW]
    for title, structure, degree, chosen in (
        ("Free run, ARX with 10 parameters", emsid.arx(na=5, nb=5), 1, 10),
        (
            "Free run, NARX with 10 parameters of degree 2",
            emsid.arx(na=3, nb=3)
            + emsid.Structure.parse("y(t-1)*u(t-1)", "u(t-1)^2", "y(t-2)*u(t-2)", "u(t-1)*u(t-2)"),
            2,
            10,
        ),
    ):
        model = emsid.least_squares(structure, record).model
        board = Board(title, "ns/sample")
        board.emsid("simulate", best(lambda model=model: model.simulate(record)) / N * 1e9)
        if degree == 1:
            a, b = np.r_[1, model.parameters[:5]], np.r_[0, model.parameters[5:]]
            board.peer("scipy.signal.lfilter", best(lambda a=a, b=b: lfilter(b, a, record.input[:, 0])) / N * 1e9)
        peer = _sysidentpy(LeastSquares(), degree, chosen)
        peer.fit(X=few.input, y=few.output)
        board.peer(
            "SysIdentPy predict",
            best(lambda peer=peer: peer.predict(X=few.input, y=few.output[:5]), 2) / FEW * 1e9,
            "≥ 500",
        )
        board.show()


def plant() -> None:
    """The motor with friction and dead zone, against SciPy restarted at every event."""
    motor, dt = Motor(), 0.005
    u = 3.0 * np.sin(2 * np.pi * 0.5 * dt * np.arange(400))
    exact = simulate(motor, u, dt, method=Taylor(tolerance=1e-15)).load_speed
    scale = float(np.max(np.abs(exact)))

    def error(speed: Array) -> str:
        return f"error {np.max(np.abs(speed - exact)) / scale:.0e}"

    board = Board("The plant: 2 s of the default motor, 400 samples, sticking and breaking away", "ms")
    board.emsid(f"simulate, {error(simulate(motor, u, dt).load_speed)}", best(lambda: simulate(motor, u, dt)) * 1e3)
    for tolerance in (1e-6, 1e-9, 1e-12):
        began = time.perf_counter()
        states, _ = simulate_reference(motor, u, dt, tolerance=tolerance)
        seconds = time.perf_counter() - began
        board.peer(
            f"scipy solve_ivp restarted at events, rtol {tolerance:g}, {error(states[:-1, 2])}",
            seconds * 1e3,
            "≥ 200 at equal error",
        )
    board.show()


def wiener_hammerstein() -> None:
    """Three blocks: a simulated circuit, and the benchmark of SYSID 2009 where its file is."""
    from emsid.io import read

    def held_back(record: emsid.Record, at: int, orders: tuple[int, int], knots: int, what: str, scale: float) -> None:
        began = time.process_time()
        fit = emsid.fit(emsid.wiener_hammerstein(orders, size=knots), record[:at])
        seconds = time.process_time() - began
        row = emsid.validate(fit, record[at:], 50).row
        console.print(f"{what}: {seconds:.1f} s of CPU, free-run RMSE on unseen data {scale * row.simulation_rmse:.4g}")

    rng = np.random.default_rng(0)
    u = np.cumsum(rng.standard_normal(20_000)) * 0.1
    u -= lfilter([0.01], [1, -0.99], u)
    x = lfilter([0.0, 0.3], [1, -0.7], u)
    y = lfilter([0.0, 0.2, 0.1], [1, -1.1, 0.4], np.where(x > 0.5, x - 0.5, np.where(x < -0.5, x + 0.5, 0.0)))
    record = emsid.Record(u, y + 0.001 * rng.standard_normal(len(y)), 0.001)
    held_back(record, 15_000, (1, 2), 12, "Wiener-Hammerstein, simulated, noise 0.001", 1.0)
    path = Path(os.environ.get("EMSID_RECORDINGS", "../shared/data")) / "wiener_hammerstein_2009" / "estimation.csv"
    if path.exists():
        record = read(path, input="u", output="y", dt=1 / 51200, rows=slice(5200, None))
        held_back(
            record, 79_800, (3, 3), 25, "Wiener-Hammerstein 2009 (expected within 15 s, at most 0.28 mV), in mV", 1e3
        )


def start() -> None:
    """The time of ``emsid --help``."""
    command = [sys.executable, "-c", "import sys; sys.argv = ['emsid', '--help']; from emsid.cli import main; main()"]
    seconds = best(lambda: subprocess.run(command, capture_output=True, check=True))
    console.print(f"emsid --help: {seconds:.2f} s (expected under 0.3 s)")


def identify() -> None:
    """The seconds of ``emsid identify``, whole and by part; ``python bench/identify.py 280`` prints some of them."""
    from identify import identify as measured

    measured()


PARTS = {
    part.__name__.replace("_", "-"): part
    for part in (batch, recursive, free_run, terms, plant, wiener_hammerstein, start, identify)
}


if __name__ == "__main__":
    for name in asked_parts(__doc__, PARTS):
        PARTS[name]()
