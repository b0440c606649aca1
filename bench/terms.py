"""Terms of degree 3 selected one step ahead, beside FROLS of SysIdentPy: ``python bench/run.py terms``.

Each selection runs in a process of its own, so that its peak memory is its own; it includes making the dictionary.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

HOME = Path(__file__).resolve().parents[1]
SAMPLES, CHOSEN = 20_000, 10
# Lagged outputs and inputs of each dictionary; SysIdentPy takes the first two.
LAGS = (2, 5, 18)
REPETITIONS = 5


def terms() -> None:
    """Selection of terms from dictionaries of 35, 286 and 9,139 terms of degree 3."""
    table = Table(
        title=f"{CHOSEN} terms selected from {SAMPLES:,} samples: CPU s, seconds, peak memory", title_justify="left"
    )
    for head in ("terms", "emsid", "SysIdentPy", "faster by (CPU, seconds)", "same terms in the same order"):
        table.add_column(head, justify="right")
    for lags in LAGS:
        own = in_a_process("emsid", lags)
        row = [f"{own['terms']:,}", shown(own), "–", "–", "–"]
        if lags != LAGS[-1]:
            other = in_a_process("sysidentpy", lags)
            ratios = f"{other['cpu'] / own['cpu']:.0f}, {other['seconds'] / own['seconds']:.0f}"
            same = sum(a == b for a, b in zip(own["labels"], other["labels"], strict=True))
            row[2:] = [shown(other), ratios, f"{same} of {CHOSEN}"]
        table.add_row(*row)
    Console(width=120).print(table)


def shown(result: dict[str, Any]) -> str:
    """Times and memory in a cell."""
    return f"{result['cpu']:.4f} s, {result['seconds']:.4f} s, {result['peak']:.0f} MiB"


def in_a_process(who: str, lags: int) -> dict[str, Any]:
    """The result of `measure` in a new process."""
    command = [sys.executable, __file__, who, str(lags)]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    result: dict[str, Any] = json.loads(answer.splitlines()[-1])
    return result


def measure(who: str, lags: int) -> dict[str, Any]:
    """The least CPU time and duration of a selection in s, the memory it adds in MiB, and what it chooses."""
    sys.path.insert(0, str(HOME / "tests"))
    from independent.nonlinear_systems import duffing

    record = duffing(SAMPLES).fitted
    select = {"emsid": by_emsid, "sysidentpy": by_sysidentpy}[who]
    select(record[:500], 1)  # loads and compiles what is needed
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times, answer = [], (0, [""])
    for _ in range(REPETITIONS):
        cpu, clock = time.process_time(), time.perf_counter()
        answer = select(record, lags)
        times.append((time.process_time() - cpu, time.perf_counter() - clock))
    peak = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    cpu, seconds = np.min(times, axis=0).tolist()
    return {"cpu": cpu, "seconds": seconds, "peak": peak, "terms": answer[0], "labels": answer[1]}


def by_emsid(record: Any, lags: int) -> tuple[int, list[str]]:
    """The size of the dictionary and the chosen terms."""
    import emsid

    dictionary = emsid.polynomial_narx(lags, lags, 3)
    return len(dictionary), list(emsid.select_terms(dictionary, record, CHOSEN).structure.labels)


def by_sysidentpy(record: Any, lags: int) -> tuple[int, list[str]]:
    """The same of SysIdentPy, in emsid's notation."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    model = FROLS(
        order_selection=False,
        n_terms=CHOSEN,
        ylag=lags,
        xlag=lags,
        estimator=LeastSquares(),
        basis_function=Polynomial(degree=3),
    )
    model.fit(X=record.input, y=record.output)
    return len(model.regressor_code), [written(row) for row in model.final_model]


def written(row: np.ndarray) -> str:
    """A term of SysIdentPy, codes 1000·channel + lag with channel 1 for y, as emsid writes it."""
    codes = sorted((int(code) for code in row if code), key=lambda code: (code // 1000, code % 1000))
    powers = {code: codes.count(code) for code in dict.fromkeys(codes)}
    factors = [
        f"{'y' if c // 1000 == 1 else 'u'}(t-{c % 1000})" + (f"^{p}" if p > 1 else "") for c, p in powers.items()
    ]
    return "*".join(factors) or "1"


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
