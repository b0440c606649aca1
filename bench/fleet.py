"""Fleets and large least-squares problems: time, memory, and what is named.

python bench/fleet.py motors [N] [SEED]   # N simulated motors of 5,000 samples, faults by the kind; a pool, then Dask
python bench/fleet.py rows [MILLIONS]     # least squares with 10 regressors over Parquet, beside Polars alone
"""

from __future__ import annotations

import resource
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import polars as pl

import emsid
from emsid.fleets.simulated import simulated_fleet

PART = 20_000_000
"""Rows of a file."""


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begun


class Memory:
    """The largest resident memory of any process that this one has started, in GB."""

    def __enter__(self) -> Memory:
        self.largest, self._go = 0.0, True
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._go = False
        self._thread.join()

    def _watch(self) -> None:
        import psutil

        while self._go:
            for process in psutil.Process().children(recursive=True):
                try:
                    self.largest = max(self.largest, process.memory_info().rss / 1e9)
                except psutil.Error:
                    continue
            time.sleep(0.2)


def motors(count: int, seed: int) -> None:
    reading = {"input": "voltage", "output": "speed", "time": "t", "units": {"voltage": "V", "speed": "rad/s"}}
    options = emsid.Options(fixed={"resistance": 2.0})
    with TemporaryDirectory() as folder, Memory() as memory:
        made = simulated_fleet(folder, count, worn=8, loaded=1, poisoned=3, seed=seed)
        result, seconds = timed(lambda: emsid.fleet(folder, "rigid-motor", options=options, **reading))
        named = {outlier.motor for outlier in result.outliers}
        faults = set(made.worn + made.loaded)
        processor = sum(row.seconds for row in result.rows)
        print(f"{count} motors by a pool: {seconds:.0f} s, {processor / count:.2f} s of processor each")
        print(f"named {sorted(named & faults)} of {sorted(faults)}; falsely {sorted(named - faults)}")
        print(f"without a model {[row.motor for row in result.failed]}, poisoned {list(made.poisoned)}")
        print(f"largest worker {memory.largest:.2f} GB")
        from distributed import LocalCluster

        from emsid.fleets.engine import connected

        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
            with connected(cluster.scheduler_address) as executor:
                again, dask = timed(lambda: emsid.fleet(folder, "rigid-motor", executor, options=options, **reading))
            same = [row.data for row in again.rows] == [row.data for row in result.rows]
            print(f"by Dask with two workers: {dask:.0f} s, {dask / seconds:.2f} times as long; same rows: {same}")


def rows(millions: int) -> None:
    structure = emsid.arx(na=5, nb=5)
    with TemporaryDirectory() as folder:
        left, number = millions * 1_000_000, 0
        while left > 0:
            _write(Path(folder) / f"{number:03d}.parquet", min(PART, left), number)
            left, number = left - PART, number + 1
        with Memory() as memory:
            fit, seconds = timed(
                lambda: emsid.fleets.least_squares_over(folder, structure, input="u", output="y", dt=1e-3)
            )
        scan = pl.scan_parquet(f"{folder}/*.parquet")
        _, alone = timed(lambda: scan.select(pl.col("u").sum(), pl.col("y").sum()).collect(engine="streaming"))
        rate = fit.samples / seconds / 1e6
        print(f"{fit.samples:,.0f} rows, 10 regressors: {seconds:.1f} s, {rate:.1f} million rows a second")
        print(
            f"Polars alone, two sums of the same files: {alone:.1f} s, {fit.samples / alone / 1e6:.1f} million a second"
        )
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        print(f"largest worker {memory.largest:.2f} GB, main process {own:.2f} GB")
        print("a1, b1:", fit.estimate[[0, 5]], "true: -0.9, 1.0; standard errors", fit.standard_error[[0, 5]])


def _write(path: Path, count: int, seed: int) -> None:
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    u = rng.standard_normal(count)
    y = lfilter([0.0, 1.0], [1.0, -0.9], u) + lfilter([1.0], [1.0, -0.9], 0.1 * rng.standard_normal(count))
    pl.DataFrame({"u": u, "y": y}).write_parquet(path, compression="uncompressed", row_group_size=1_000_000)


if __name__ == "__main__":
    what, *numbers = sys.argv[1:] or ["rows"]
    given = [int(number) for number in numbers]
    if what == "motors":
        motors(*(given + [400, 1][len(given) :]))
    else:
        rows(*(given or [100]))
