"""Whether the recommended model is the best one on data left out: ``python bench/recommendation.py FOLDER``.

Every folder below FOLDER, and FOLDER itself, is a set of recordings. As a new user would, the script asks ``emsid
describe`` for the command to run, and runs it, with a part of the data left out: of four files or more every fourth,
otherwise the last fifth of every file. ``emsid identify`` chooses on a part of what is left. Then all its models run
freely over the part that was left out. The recommended one should have the smallest error there, or one that is at most
5 % larger. The ratio of the error of the model in ``recommended.json``, which is fitted again to all data that the
command was given where these are few, to the smallest one is shown too.

Of long files the first rows only are used (``--rows``), and a command that does not end in time is stopped
(``--seconds``); then the models that it had found by then are compared.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from emsid.cli.commands.describe import proposals
from emsid.errors import EmsidError
from emsid.first_look import FirstLook, describe_files
from emsid.io.reading import READERS
from emsid.record import concatenate

EVERY, LAST = 4, 0.2
"""Of this many files or more one in so many is left out; otherwise this part of every file, its end."""
WITHIN = 1.05
"""The largest ratio of the error of the recommended model to the smallest error that counts as reached."""
console = Console(width=150)


@dataclass(frozen=True)
class Trial:
    """A proposed command on a part of its data.

    Attributes:
        title: the set, and its files if there are several commands for it.
        words: the command to run.
        unseen: the file, the first and the last row of every part that is left out.
        look: at one of the files, for how to read them.
    """

    title: str
    words: list[str]
    unseen: list[tuple[Path, int, int]]
    look: FirstLook


def trials(folder: Path, rows: int) -> Iterator[Trial]:
    """The commands that describe proposes for the files of a folder."""
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix.lower() in READERS)
    if not files:
        return
    looks, _ = describe_files(files)
    by_path = {look.path: look for look in looks}
    commands = proposals(looks)
    for words in commands:
        own = [word for word in words[2:] if word in by_path]
        options = [word for word in words[2:] if word not in by_path]
        title = folder.name if len(commands) == 1 else f"{folder.name}: {shortened(Path(own[0]).stem)}"
        look = by_path[own[0]]
        if len(own) >= EVERY:
            left = own[EVERY - 1 :: EVERY]
            kept = [each for each in own if each not in left]
            unseen = [(Path(each), 0, min(by_path[each].rows, rows)) for each in left]
            yield Trial(title, [*words[:2], *kept, *options, "--rows", f"0:{rows}"], unseen, look)
        else:
            most = min(rows, *(by_path[each].rows for each in own))
            first = int((1 - LAST) * most)
            unseen = [(Path(each), first, most) for each in own]
            yield Trial(title, [*words[:2], *own, *options, "--rows", f"0:{first}"], unseen, look)


def shortened(name: str) -> str:
    """The beginning and the end of a long name."""
    return name if len(name) <= 24 else f"{name[:11]}…{name[-12:]}"


def cpu_seconds() -> float:
    """The CPU time of finished processes that this one started."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(trial: Trial, out: Path, seconds: float) -> float:
    """Run the command with its results in a folder; the CPU time in s."""
    before = cpu_seconds()
    words = [sys.executable, "-m", "emsid", *trial.words[1:], "--out", str(out)]
    with (out.parent / "log.txt").open("w") as log:
        process = subprocess.Popen(words, stdout=log, stderr=log)
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)  # as Ctrl-C does: results first
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
    return cpu_seconds() - before


AGAIN = "fitted again"
"""The model in ``recommended.json``, where the data are few fitted again to all of them."""


def errors(trial: Trial, out: Path) -> dict[str, float]:
    """The RMSE of the free run of every saved model on the part that was left out, and of that which is `AGAIN`."""
    result = json.loads((out / "result.json").read_text("utf-8"))
    reading = trial.look.reading
    parts = [emsid.read(path, **{**reading, "rows": slice(first, last)}) for path, first, last in trial.unseen]
    record = parts[0] if len(parts) == 1 else concatenate(parts)
    fits = [emsid.load(out / f"{each['model']}.json") for each in result["fits"]]
    start = max(model.memory for model in fits)
    found = {row.model: float(np.sqrt(row.ranked_by)) for row in emsid.compare(fits, record, transient=start).rows}
    (row,) = emsid.compare(emsid.load(out / "recommended.json"), record, transient=start).rows
    return {**found, AGAIN: float(np.sqrt(row.ranked_by))}


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="sets whose title contains this text")
    parser.add_argument("--rows", type=int, default=100_000, help="at most this many rows of a file")
    parser.add_argument("--seconds", type=float, default=240.0, help="after which a command is stopped")
    parser.add_argument("--show", action="store_true", help="print the commands and the errors of all models")
    options = parser.parse_args(arguments)
    board = Table(title="Error of the free run on data left out", title_justify="left")
    for head in ("set", "recommended", "RMSE", "smallest", "by", "ratio", AGAIN, "models", "CPU s"):
        board.add_column(head, justify="left" if head in ("set", "recommended", "by") else "right")
    ratios = []
    folders = [options.folder, *sorted(path for path in options.folder.rglob("*") if path.is_dir())]
    for trial in (each for folder in folders for each in trials(folder, options.rows)):
        if options.only not in trial.title:
            continue
        with TemporaryDirectory() as place:
            out = Path(place, "result")
            try:
                seconds = run(trial, out, options.seconds)
                found = errors(trial, out)
            except (EmsidError, OSError) as problem:
                log = Path(place, "log.txt").read_text("utf-8").strip().splitlines()
                board.add_row(trial.title, f"failed: {(log or [str(problem)])[-1][:80]}")
                continue
            chosen = json.loads((out / "result.json").read_text("utf-8"))["chosen"]
        again = found.pop(AGAIN)
        best = min(found, key=found.__getitem__)
        ratio = found[chosen] / found[best]
        ratios.append(ratio)
        numbers = (f"{found[chosen]:.4g}", f"{found[best]:.4g}", best, f"{ratio:.3f}", f"{again / found[best]:.3f}")
        board.add_row(trial.title, chosen, *numbers, str(len(found)), f"{seconds:.0f}")
        if options.show:
            console.print(shlex.join(trial.words), {name: float(f"{x:.4g}") for name, x in found.items()})
    console.print(board)
    reached = sum(ratio <= WITHIN for ratio in ratios)
    console.print(f"at most {WITHIN:g} times the smallest error on {reached} of {len(ratios)} sets")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main(sys.argv[1:])
