"""The seconds of ``emsid identify``: of whole processes, and by part. ``python bench/identify.py [SAMPLES …]``.

The records are of the built-in motor, with dead zone and friction, sampled every 5 ms while it follows random steps.
CPU seconds count all threads; they change less than wall seconds where other programs run.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from arguments import asked_parts
from emsid.estimation.nonlinear.control import Activity, Control
from emsid.io import write_record
from emsid.plant import Motor, simulate

CASES: dict[str, tuple[int, tuple[str, ...], str]] = {
    "280 samples": (280, (), "4 s"),
    "280 samples, one model": (280, ("--models", "arx"), "2 s CPU"),
    "10,000 samples, quick": (10_000, ("--quick",), "5 s"),
    "10,000 samples, budget of 20 s": (10_000, ("--budget", "20s"), "25 s"),
    "10,000 samples": (10_000, (), ""),
    "100,000 samples": (100_000, (), "30 s wall"),
    "500,000 samples": (500_000, (), "60 s wall"),
}
"""By name the number of samples, the options and what is expected."""
BY_PART = 10_000
"""More samples are not measured by part."""


def record_of(samples: int) -> emsid.Record:
    """A motor that follows random steps of its voltage."""
    rng = np.random.default_rng(samples)
    u = np.repeat(rng.uniform(-8, 8, samples // 25 + 1), 25)[:samples]
    y = simulate(Motor(), u, 0.005).load_speed
    noisy = y + 0.01 * float(np.std(y)) * rng.standard_normal(samples)
    return emsid.Record(u, noisy, 0.005, ("voltage",), ("speed",), ("V",), ("rad/s",))


def used() -> float:
    """CPU seconds of the processes that this one started."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def whole_process(record: Path, options: Sequence[str], out: Path) -> tuple[float, float]:
    """CPU and wall seconds of a process that reads, identifies, writes and draws."""
    command = [sys.executable, "-m", "emsid", "identify", str(record), "-u", "voltage", "-y", "speed", "--time", "t"]
    before, start = used(), time.perf_counter()
    subprocess.run([*command, *options, "--out", str(out)], check=True, capture_output=True)
    return used() - before, time.perf_counter() - start


def by_part(path: Path) -> dict[str, float]:
    """CPU seconds of the parts of a default run in this process: reading, the first look, every model, the report."""
    from emsid.report.identification_page import report
    from emsid.report.page import report_files

    spent: dict[str, float] = {}
    last = ["reading", time.process_time()]

    def now(part: str) -> None:
        name, begun = last
        spent[name] = spent.get(name, 0.0) + time.process_time() - begun
        last[:] = part, time.process_time()

    def told(activity: Activity) -> None:
        part = activity.doing.partition(" (")[0].partition(":")[0]
        if part and part != last[0]:
            now(part)

    record = emsid.read(path, input="voltage", output="speed", time="t")
    now("first look")
    result = emsid.identify(record, control=Control(report=told))
    now("page")
    page = report(result)
    now("figures")
    report_files(page)
    now("")
    return spent


def identify(only: Sequence[str] = ()) -> None:
    """Print both tables.

    Args:
        only: numbers of samples; by default all of `CASES`.
    """
    console = Console(width=100)
    table = Table("emsid identify", "CPU s", "wall s", "expected", title="Whole processes", title_justify="left")
    parts = Table("part", title="By part, CPU s", title_justify="left")
    columns: dict[str, dict[str, float]] = {}
    with TemporaryDirectory() as place:
        folder = Path(place)
        for name, (samples, options, expected) in CASES.items():
            if only and str(samples) not in only:
                continue
            path = folder / f"{samples}.csv"
            if not path.exists():
                write_record(record_of(samples), path)
                whole_process(path, ("--models", "arx"), folder / "warm")  # compiles, where nothing is compiled yet
            cpu, wall = whole_process(path, options, folder / "out")
            table.add_row(name, f"{cpu:.1f}", f"{wall:.1f}", expected)
            if not options and samples <= BY_PART:
                columns[name] = by_part(path)
    console.print(table, f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    for name in columns:
        parts.add_column(name, justify="right")
    for part in dict.fromkeys(part for column in columns.values() for part in column):
        parts.add_row(part, *(f"{column.get(part, 0.0):.2f}" for column in columns.values()))
    console.print(parts)


if __name__ == "__main__":
    identify(asked_parts(__doc__, dict.fromkeys(str(samples) for samples, _, _ in CASES.values())))
