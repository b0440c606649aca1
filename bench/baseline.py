"""What ``emsid identify`` recommends for about fifty systems, to compare two states of the program.

    python bench/baseline.py --out before.json                     # 45 minutes of CPU time
    python bench/baseline.py --out after.json --against before.json
    python bench/baseline.py --only motors --models rigid-motor --seeds 3-5 --jobs 2
    python bench/baseline.py --recordings DIR --only recordings

Every simulated system (``tests/independent/systems.py``) gives a record, from which a model is recommended with the
default options, or from ``--models``. The model then runs freely over a record of another kind of input, of 0.8 of its
amplitude. The table has its error there over that of the true simulator, the smallest such ratio of all models, and the
verdict. A model that is more than `WITHIN` times worse than the truth is not supported by the data; the verdict is
wrong where it says so. Single systems change by chance; the distribution over several seeds is what two states are
judged by. With ``--recordings`` every folder below the given one is a set of recordings, for which the command is run
that ``emsid describe`` proposes, with a part of the data left out (``bench/recordings.py``); their errors are over the
smallest of all models.

``--out`` writes a line of JSON for every system as soon as it is done. A file that has some already is continued, so
an interrupted run can be called again. ``--against`` compares the errors with those of another such file.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from arguments import numbers, parser_of
from emsid.errors import EmsidError
from recordings import Trial, errors, part_left_out, run, trials

HOME = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HOME / "tests"))
from independent.systems import SYSTEMS  # noqa: E402

WITHIN = 1.3
"""The ratio of a model's error to that of the truth above which it may not be called supported."""
SUPPORTED = "model-supported"
RECORDINGS = "recordings"
"""The family of what is not simulated."""
ROWS, SECONDS = 100_000, 600.0
"""Rows of a recording that are used at most, and the time in s after which its command is stopped."""
console = Console(width=170)


@dataclass(frozen=True)
class Line:
    """A line of the table.

    Attributes:
        family, system, seed: what was identified.
        model: the recommended one, or the best that cannot be used.
        parameters: how many were estimated.
        error: root mean square error of its free run on the other record; None where it diverges.
        ratio: this over the error of the truth, or of the best model for a recording; None where it diverges.
        best, best_ratio: the model with the smallest error there.
        verdict: on the recommended model.
        reasons: against it.
        seconds: CPU time.
    """

    family: str
    system: str
    seed: int
    model: str
    parameters: int
    error: float | None
    ratio: float | None
    best: str
    best_ratio: float | None
    verdict: str
    reasons: tuple[str, ...]
    seconds: float

    @property
    def key(self) -> tuple[str, str, int]:
        """What was identified."""
        return self.family, self.system, self.seed

    @property
    def wrong(self) -> bool:
        """Whether the verdict promises too much."""
        far = self.ratio is None or self.ratio > WITHIN
        return self.family != RECORDINGS and self.verdict == SUPPORTED and far


def simulated(system: str, seed: int, models: str = "") -> Line:
    """Identify a simulated system, with some models only if they are named, separated by commas."""
    family, case = SYSTEMS[system][0], SYSTEMS[system][1].pair(seed)
    before = time.process_time()
    result = emsid.identify(case.fitted, models=models.split(",") if models else None)
    seconds = time.process_time() - before
    verdict, fit = result.model_verdicts[0], result.chosen
    models = [result.recommended or fit.model, *(each.model for each in result.fits)]
    found = [rmse(model, case.unseen) for model in models]
    best = int(np.argmin(found))
    return Line(
        family, system, seed, fit.model.name, fit.size, finite(found[0]), finite(found[0] / case.noise),
        models[best].name, finite(found[best] / case.noise), verdict.code, _codes(verdict.data["reasons"]), seconds,
    )  # fmt: skip


def rmse(model: emsid.Model, unseen: emsid.Record) -> float:
    """Root mean square error of the free run; infinite where it diverges."""
    found = float(emsid.compare(model, unseen).rows[0].simulation_rmse)
    return found if np.isfinite(found) else float("inf")


def recorded(trial: Trial) -> Line:
    """Run the command for a set of recordings."""
    with TemporaryDirectory() as place:
        out = Path(place, "result")
        seconds = run(trial, out, SECONDS)
        if not (out / "result.json").exists():
            log = Path(place, "log.txt").read_text("utf-8").strip().splitlines()
            raise EmsidError((log or ["no result"])[-1])
        result = json.loads((out / "result.json").read_text("utf-8"))
        names, chosen = [each["model"] for each in result["fits"]], result["chosen"]
        handed = out / "best.json"
        own = emsid.load(handed if handed.exists() else out / f"{chosen}.json")
        models = [own, *(emsid.load(out / f"{name}.json") for name in names)]
        found = errors(models, part_left_out(trial))
    verdict = next(each for each in result["verdicts"] if each["data"]["model"] == chosen)
    size = next(each for each in result["fits"] if each["model"] == chosen)["parameters"]
    best = int(np.argmin(found))
    return Line(
        RECORDINGS, trial.title, 0, chosen, len(size), finite(found[0]), finite(found[0] / found[best]),
        models[best].name, 1.0, verdict["code"], _codes(verdict["data"]["reasons"]), seconds,
    )  # fmt: skip


def finite(value: float) -> float | None:
    """A number for JSON."""
    return value if np.isfinite(value) else None


def _codes(reasons: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    return tuple(each["code"] for each in reasons)


def read(path: Path) -> list[Line]:
    """The lines of a file; the last one may be cut off."""
    lines = []
    for text in path.read_text("utf-8").splitlines() if path.exists() else ():
        try:
            values = json.loads(text)
        except json.JSONDecodeError:
            continue
        lines.append(Line(**{**values, "reasons": tuple(values["reasons"])}))
    return lines


def write(line: Line, path: Path) -> None:
    """Add a line to a file, whose last one may be cut off."""
    with path.open("a+b") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - 1, 0))
        begun = file.read() not in (b"", b"\n")
        file.write(b"\n" * begun + json.dumps(asdict(line)).encode() + b"\n")


def measured(tasks: Sequence[Callable[[], Line]], jobs: int, out: Path | None) -> Iterator[Line]:
    """The lines of all tasks as they are done, each written at once."""
    started, spawn = time.monotonic(), multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_leave_interruption_to_parent) as pool:
        futures = {pool.submit(task): task for task in tasks}
        try:
            for k, future in enumerate(as_completed(futures), 1):
                try:
                    line = future.result()
                except (EmsidError, OSError) as problem:
                    console.print(f"failed: {futures[future].args[0]}: {str(problem)[:120]}", highlight=False)  # type: ignore[attr-defined]
                    continue
                if out:
                    write(line, out)
                left = (time.monotonic() - started) / k * (len(tasks) - k) / 60
                progress = f"{k} of {len(tasks)}, about {left:.0f} min left"
                console.print(f"{progress}: {' '.join(cells(line)[1:])}", highlight=False)
                yield line
        except KeyboardInterrupt:
            console.print("interrupted; what was found until now follows")
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()


def _leave_interruption_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def cells(line: Line) -> list[str]:
    """A row of the table."""
    own, best = ("∞" if each is None else f"{each:.2f}" for each in (line.ratio, line.best_ratio))
    verdict = line.verdict.removeprefix("model-")
    wrong = "wrong" if line.wrong else ""
    shown = line.model, str(line.parameters), own, line.best, best, verdict, wrong, f"{line.seconds:.0f}"
    return [line.family, line.system, str(line.seed), *shown]


def show(lines: Sequence[Line]) -> None:
    """Print the table and what it comes to."""
    board = Table(title="Error on another kind of input over that of the truth", title_justify="left")
    heads = "family", "system", "seed", "recommended", "parameters", "ratio", "best of all", "its ratio", "verdict"
    for head in (*heads, "wrong", "CPU s"):
        numeric = head in ("seed", "parameters", "ratio", "its ratio", "CPU s")
        board.add_column(head, justify="right" if numeric else "left")
    for line in lines:
        board.add_row(*cells(line))
    console.print(board)
    own = [line for line in lines if line.family != RECORDINGS]
    if own:
        console.print(distribution(own))


def distribution(lines: Sequence[Line]) -> str:
    """What simulated systems come to; one that diverges has an infinite ratio."""
    ratios = np.array([np.inf if line.ratio is None else line.ratio for line in lines])
    supported, wrong = sum(line.verdict == SUPPORTED for line in lines), sum(line.wrong for line in lines)
    return (
        f"median {np.median(ratios):.3f}, 90 % quantile {np.quantile(ratios, 0.9, method='lower'):.3f}, "
        f"{np.sum(ratios <= WITHIN)} of {len(lines)} within {WITHIN:g} times the truth; "
        f"{supported} called supported, {wrong} of them wrong; {sum(line.seconds for line in lines):.0f} s of CPU"
    )


def compared(lines: Sequence[Line], before: Sequence[Line]) -> None:
    """Print the errors over those of another run."""
    known = {each.key: each for each in before}
    both = [(line, known[line.key]) for line in lines if line.key in known]
    if not both:
        console.print("the other file has none of these systems")
        return
    board = Table(title="Error over that of the other file", title_justify="left")
    for head in ("system", "seed", "model", "before", "error ratio", "CPU ratio", "verdict", "before"):
        board.add_column(head, justify="right" if "ratio" in head or head == "seed" else "left")
    ratios = []
    for line, old in both:
        size = [np.inf if each.error is None else each.error for each in (line, old)]
        ratios.append(1.0 if size[0] == size[1] else size[0] / size[1])
        verdicts = (each.verdict.removeprefix("model-") for each in (line, old))
        board.add_row(
            line.system, str(line.seed), line.model, old.model, f"{ratios[-1]:.3f}",
            f"{line.seconds / old.seconds:.2f}", *verdicts,
        )  # fmt: skip
    console.print(board)
    new = [line.system for line, old in both if line.verdict == SUPPORTED != old.verdict]
    wrong = [line.system for line, old in both if line.wrong and not old.wrong]
    seconds = sum(line.seconds for line, _ in both) / sum(old.seconds for _, old in both)
    console.print(
        f"error over the other's in {len(both)} systems: median {np.median(ratios):.3f}, "
        f"90 % quantile {np.quantile(ratios, 0.9):.3f}; CPU {seconds:.2f}\n"
        f"supported that were not: {', '.join(new) or 'none'}; newly wrong: {', '.join(wrong) or 'none'}"
    )


def main() -> None:
    """Measure what is asked for and print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--only", default="", help="systems whose family or name contains this text, or several with |")
    parser.add_argument("--models", default="", help="fit only these, such as rigid-motor,arx")
    parser.add_argument("--seeds", type=numbers, default="0", help="such as 0-2 or 0-2,61 (default: 0)")
    parser.add_argument("--recordings", type=Path, metavar="DIR", help="a folder with folders of recordings")
    parser.add_argument("--out", type=Path, metavar="FILE", help="lines of JSON; a file that exists is continued")
    parser.add_argument("--against", type=Path, metavar="FILE", help="an earlier file to compare with")
    parser.add_argument("--jobs", type=int, default=1, help="systems at the same time (default: 1)")
    options = parser.parse_args()
    for name, path in (("--recordings", options.recordings), ("--against", options.against)):
        if path and not path.exists():
            parser.error(f"{name}: {path} does not exist")
    if options.jobs < 1:
        parser.error("--jobs: at least 1")
    done = {line.key: line for line in read(options.out)} if options.out else {}
    wanted: dict[tuple[str, str, int], Callable[[], Line]] = {
        (family, name, seed): partial(simulated, name, seed, options.models)
        for seed in options.seeds
        for name, (family, _) in SYSTEMS.items()
    }
    if options.recordings:
        folders = [options.recordings, *sorted(path for path in options.recordings.rglob("*") if path.is_dir())]
        for trial in (each for folder in folders for each in trials(folder, ROWS)):
            wanted[RECORDINGS, trial.title, 0] = partial(recorded, trial)
    parts = options.only.split("|")
    asked = {key: task for key, task in wanted.items() if any(part in f"{key[0]}: {key[1]}" for part in parts)}
    if not asked:
        parser.error(f"no system is called {options.only}; there are {', '.join(SYSTEMS)}")
    lines = [done[key] for key in asked if key in done]
    lines += measured([task for key, task in asked.items() if key not in done], options.jobs, options.out)
    place = {key: k for k, key in enumerate(asked)}
    lines.sort(key=lambda line: place[line.key])
    if lines:
        show(lines)
        if options.against:
            compared(lines, read(options.against))


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the processes; CPU time would count threads that wait
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
