"""Commands that ``emsid describe`` proposes for folders of recordings, run with a part of the data left out.

Every folder is a set of recordings. As a new user would, a script asks for the command to run, and runs it, with a part
of the data left out: of four files or more every fourth, otherwise the last fifth of every file.
"""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import emsid
from emsid.cli.commands.describe import proposals
from emsid.first_look import FirstLook, describe_files, groups
from emsid.io.reading import READERS
from emsid.record import concatenate

EVERY, LAST = 4, 0.2
"""Of this many files or more one in so many is left out; otherwise this part of every file, its end."""


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
    """The commands that describe proposes for the files of a folder, with at most this many rows of every file."""
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.suffix.lower() in READERS)
    if not files:
        return
    looks, _ = describe_files(files)
    by_path = {look.path: look for look in looks}
    commands = proposals(groups(looks))
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
    """Run the command with its results in a folder, and stop it after these seconds; the CPU time in s."""
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


def part_left_out(trial: Trial) -> emsid.Record:
    """What the command is not given."""
    reading = trial.look.reading
    parts = [emsid.read(path, **{**reading, "rows": slice(first, last)}) for path, first, last in trial.unseen]
    return parts[0] if len(parts) == 1 else concatenate(parts)


def errors(models: Sequence[emsid.Model], record: emsid.Record) -> list[float]:
    """The RMSE of the free run of every model, all on the same samples; infinite where it diverges."""
    start = max(model.memory for model in models)
    rows = [emsid.compare(model, record, transient=start).rows[0] for model in models]
    found = [float(np.sqrt(row.ranked_by)) for row in rows]
    return [each if np.isfinite(each) else float("inf") for each in found]
