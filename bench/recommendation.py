"""Whether the recommended model is the best one on data left out: ``python bench/recommendation.py FOLDER``.

Every folder below FOLDER, and FOLDER itself, is a set of recordings. As a new user would, the script asks ``emsid
describe`` for the command to run, and runs it, with a part of the data left out: of four files or more every fourth,
otherwise the last fifth of every file. Models run freely over this part, and the recommended one should have the
smallest error there, or one that is at most 5 % larger. The table compares

- the models that ``emsid identify`` chose among, as they are fitted to a part of what it was given;
- the models that it hands over in ``recommended.json``, which are fitted again to all that it was given where this is
  little. So that all are treated alike, the command is run again for every model with at most `NEAR` times the smallest
  error, with ``--models`` and this name.

Of long files the first rows only are used (``--rows``), and a command that does not end in time is stopped
(``--seconds``); then the models that it had found by then are compared.
"""

from __future__ import annotations

import json
import os
import resource
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.table import Table

import emsid
from arguments import parser_of
from emsid.cli.commands.describe import proposals
from emsid.errors import EmsidError
from emsid.first_look import FirstLook, describe_files, groups
from emsid.io.reading import READERS
from emsid.record import concatenate

EVERY, LAST = 4, 0.2
"""Of this many files or more one in so many is left out; otherwise this part of every file, its end."""
WITHIN = 1.05
"""The largest ratio of the error of the recommended model to the smallest error that counts as reached."""
NEAR = 2.0
"""Models with at most this many times the smallest error are fitted as the recommended one is."""
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


def part_left_out(trial: Trial) -> emsid.Record:
    """What the command is not given."""
    reading = trial.look.reading
    parts = [emsid.read(path, **{**reading, "rows": slice(first, last)}) for path, first, last in trial.unseen]
    return parts[0] if len(parts) == 1 else concatenate(parts)


def rmse(models: Sequence[emsid.Model], record: emsid.Record, start: int) -> list[float]:
    """Of the free run of every model, all on the same samples."""
    return [float(np.sqrt(emsid.compare(each, record, transient=start).rows[0].ranked_by)) for each in models]


@dataclass(frozen=True)
class Errors:
    """The errors of models on the part that was left out.

    Attributes:
        chosen: the name of the recommended model.
        fitted: of all models, fitted to a part of the data.
        handed: of the models that the command hands over, by the name that it recommends or is given.
    """

    chosen: str
    fitted: dict[str, float]
    handed: dict[str, float]

    def row(self, of: dict[str, float]) -> tuple[float, str, str, str, str]:
        """The ratio of the error of the recommended model to the smallest; both errors, whose it is, and the ratio."""
        best = min(of, key=of.__getitem__)
        ratio = of[self.chosen] / of[best]
        return ratio, f"{of[self.chosen]:.4g}", f"{of[best]:.4g}", best, f"{ratio:.3f}"


def errors(trial: Trial, out: Path, seconds: float) -> Errors:
    """The errors of a result, and of those of its best models alone."""
    result = json.loads((out / "result.json").read_text("utf-8"))
    names, chosen, record = [each["model"] for each in result["fits"]], result["chosen"], part_left_out(trial)
    fits = [emsid.load(out / f"{name}.json") for name in names]
    start = max(model.memory for model in fits)
    fitted = dict(zip(names, rmse(fits, record, start), strict=True))
    handed = {chosen: emsid.load(out / "recommended.json")}
    for name in names:
        if name != chosen and fitted[name] <= NEAR * min(fitted.values()):
            alone = out.parent / name
            run(replace(trial, words=[*trial.words, "--models", name]), alone, seconds)
            if (alone / "recommended.json").exists():
                handed[name] = emsid.load(alone / "recommended.json")
    return Errors(chosen, fitted, dict(zip(handed, rmse(list(handed.values()), record, start), strict=True)))


def main(arguments: Sequence[str]) -> None:
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="sets whose title contains this text")
    parser.add_argument("--rows", type=int, default=100_000, help="at most this many rows of a file")
    parser.add_argument("--seconds", type=float, default=240.0, help="after which a command is stopped")
    parser.add_argument("--show", action="store_true", help="print the commands and the errors of all models")
    options = parser.parse_args(arguments)
    if not options.folder.is_dir():
        parser.error(f"{options.folder} is no folder")
    board = Table(title="Error of the free run on data left out", title_justify="left")
    of_each = ("RMSE", "smallest", "by", "ratio")
    for head in ("set", "recommended", *of_each, *(f"handed over: {of_each[0]}", *of_each[1:]), "CPU s"):
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
                if (out / "result.json").exists() and not (out / "recommended.json").exists():
                    board.add_row(trial.title, "nothing: no model can be used")
                    continue
                found = errors(trial, out, options.seconds)
            except (EmsidError, OSError) as problem:
                log = Path(place, "log.txt").read_text("utf-8").strip().splitlines()
                board.add_row(trial.title, f"failed: {(log or [str(problem)])[-1][:80]}")
                continue
        fitted, handed = found.row(found.fitted), found.row(found.handed)
        ratios.append((fitted[0], handed[0]))
        board.add_row(trial.title, found.chosen, *fitted[1:], *handed[1:], f"{seconds:.0f}")
        if options.show:
            for kind in (found.fitted, found.handed):
                console.print(shlex.join(trial.words), {name: float(f"{x:.4g}") for name, x in kind.items()})
    console.print(board)
    for which, some in zip(("as fitted to a part", "as handed over"), zip(*ratios, strict=True), strict=False):
        reached = sum(ratio <= WITHIN for ratio in some)
        console.print(f"{which}: at most {WITHIN:g} times the smallest error on {reached} of {len(some)} sets")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main(sys.argv[1:])
