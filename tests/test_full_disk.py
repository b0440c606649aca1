"""A full disk, Ctrl-C and SIGTERM while files are written: one line, nothing half-written, older results stay."""

from __future__ import annotations

import errno
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import main_thread

import pytest

from command_line import FIRST_ORDER, IDENTIFY, table
from emsid.exports import FORMATS
from emsid.fleets.verb import JOURNAL, Journal
from emsid.fleets.work import FleetRow
from emsid.io import save
from emsid.io.files import NotWritten, atomic_write, together
from model_examples import ALL

DATA = ("-u", "u", "-y", "y", "--dt", ".01")
Run = Callable[..., tuple[int, str, str]]


class Disk:
    """Becomes full, or sees a signal, at a file that is forced to disk or renamed; counts them."""

    def __init__(self) -> None:
        self.written, self.full_at, self.renamed, self.stop_at, self.sent = 0, 0, 0, (0, 0), signal.SIGINT

    def fsync(self, number: int) -> None:
        self.written += 1
        if self.written == self.full_at:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self.written == self.stop_at[0]:
            signal.pthread_kill(main_thread().ident, self.sent)  # files may be written by other threads

    def replace(self, source: Path, target: Path) -> None:
        REPLACE(source, target)
        self.renamed += 1
        if self.renamed == self.stop_at[1]:
            os.kill(os.getpid(), self.sent)


REPLACE = os.replace


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    made = Disk()
    monkeypatch.setattr(os, "fsync", made.fsync)
    monkeypatch.setattr(os, "replace", made.replace)
    return made


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory, command: Callable[..., int]) -> Path:
    folder = tmp_path_factory.mktemp("models")
    words = ("identify", table(folder / "log.csv"), *IDENTIFY, *FIRST_ORDER, "--models", "arx", "--out", folder)
    assert command(*words) == 0
    save(ALL["rigid motor"], folder / "motor.json")
    return folder


def tree(folder: Path) -> dict[str, bytes]:
    """The files in a folder, and the folders without any."""
    paths = [path for path in folder.rglob("*") if path.is_file() or not any(path.iterdir())]
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"" for path in paths}


MOTOR, OTHER_MODELS = ("MODELS/motor.json", "--dt", "2ms"), {"fixed-point", "odrive", "vesc", "moteus", "simplefoc"}
ONE_SET: dict[str, tuple[str, ...]] = {
    **{
        each: ("export", *MOTOR, "--to", each, "--out", "OUT", "--force")
        for each in FORMATS
        if each not in OTHER_MODELS
    },
    "fixed-point": (
        *("export", "MODELS/arx.json", "--to", "fixed-point", "--out", "OUT", "--force"),
        *("--option", "largest=10,10"),
    ),
    "compensate": ("compensate", *MOTOR, "--out", "OUT", "--force"),
    "motors": (
        *("motors", "OUT", "--add", "servo=MODELS/arx.json", "--record", "MODELS/log.csv"),
        *("--command", "emsid identify log.csv", "--force"),
    ),
    "demo": ("demo", "OUT"),
    "demo --fleet": ("demo", "OUT", "--fleet", "4"),
    "simulate": (
        "simulate",
        "MODELS/arx.json",
        "MODELS/log.csv",
        *DATA[:2],
        *DATA[4:],
        "--force",
        "--out",
        "OUT/s.csv",
    ),
    "simulate motor": ("simulate", "--duration", "1", "--force", "--out", "OUT/s.npz"),
    "describe": ("describe", "MODELS/log.csv", *DATA[:4], "--out", "OUT"),
}


@pytest.mark.parametrize("verb", ONE_SET)
def test_a_full_disk_leaves_the_older_files_of_a_verb_as_they_were(
    run: Run, models: Path, tmp_path: Path, disk: Disk, verb: str
) -> None:
    out = tmp_path / "out"
    words = [word.replace("MODELS", str(models)).replace("OUT", str(out)) for word in ONE_SET[verb]]

    def refused(full_at: int) -> None:
        disk.written, disk.full_at = 0, full_at
        status, printed, err = run(*words)
        disk.full_at = 0
        assert (status, err.count("\n")) == (2, 1), err
        assert err.startswith(f"emsid: {out}")
        assert "cannot be written (no space left on device)" in err
        assert "written to" not in printed

    refused(1)
    assert not out.exists()
    disk.written = 0
    assert run(*words)[0] == 0
    files, before = disk.written, tree(out)
    assert files == len(before)
    for full_at in sorted({2, files} - {files + 1}):
        refused(full_at)
        assert tree(out) == before


@pytest.mark.usefixtures("ctrl_c_heard")
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("verb", ["c99", "compensate", "motors", "demo", "simulate motor", "describe"])
def test_a_signal_while_a_verb_writes_leaves_all_files_or_none(
    run: Run, models: Path, tmp_path: Path, disk: Disk, verb: str, sent: signal.Signals
) -> None:
    out = tmp_path / "out"
    words = [word.replace("MODELS", str(models)).replace("OUT", str(out)) for word in ONE_SET[verb]]
    disk.sent, expected = sent, 130 if sent == signal.SIGINT else 143
    disk.stop_at = (1, 0)
    status, _, err = run(*words)
    whole = "emsid: interrupted after everything was written\n"  # a page is short
    said = {"demo": "emsid: interrupted; nothing is written\n", "describe": whole}
    line = said.get(verb, "emsid: interrupted; there is no result\n")
    assert (status, err) == (expected, line if sent == signal.SIGINT else "")
    assert out.exists() is (err == whole)
    disk.renamed, disk.stop_at = 0, (0, 1)
    assert run(*words)[0] == expected
    names = set(tree(out))
    disk.stop_at = (0, 0)
    assert run(*words)[0] == 0
    assert set(tree(out)) == names


@pytest.mark.parametrize("verb", ["identify", "validate", "track", "fleet", "study"])
def test_a_full_disk_leaves_whole_files_of_a_verb_that_writes_results_and_then_a_report(
    run: Run, models: Path, tmp_path: Path, disk: Disk, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    monkeypatch.setattr("emsid.study.workflow.searches", lambda *_, **__: {})  # its regressions write the same files
    out, log = tmp_path / "out", models / "log.csv"
    words = {
        "identify": ("identify", log, *IDENTIFY, *FIRST_ORDER, "--models", "arx"),
        "validate": ("validate", models / "arx.json", log),
        "track": ("track", log, *DATA),
        "fleet": ("fleet", log, *DATA, "--models", models / "arx.json"),
        "study": ("study", "--duration", "2"),
    }[verb]
    assert run(*words, "--out", out)[0] == 0
    names, files = set(tree(out)), disk.written - (verb == "fleet")  # whose row is in the journal from now on
    first = 2 if verb == "identify" else 1  # a model that is saved as it is found is saved at the end, too
    for full_at in (first, files):
        before, disk.written, disk.full_at = tree(out), 0, full_at
        status, _, err = run(*words, "--out", out)
        disk.full_at = 0
        assert (status, err.count("\n")) == (2, 1), (full_at, files, err)
        assert err.startswith(f"emsid: {out}")
        after = tree(out)
        assert set(after) == names
        changed = {name for name in names if after[name] != before[name]}
        assert not any(name.startswith("figures") or name == "report.html" for name in changed), changed
        assert full_at == files or changed <= {"arx.json"}, changed


def test_files_that_are_written_together_appear_together_or_not_at_all(tmp_path: Path, disk: Disk) -> None:
    new, other = tmp_path / "new", tmp_path / "other"
    with together():
        for name, content in (("a", "1"), ("b", "1"), ("a", "2")):
            atomic_write(new / name, content)
        assert not (new / "a").exists()
    assert tree(tmp_path) == {"new/a": b"2", "new/b": b"1"}

    def refused() -> None:
        with together():
            atomic_write(new / "a", "3")
            with suppress(NotWritten):
                atomic_write(new / "b", "3")
            atomic_write(other / "c", "3")

    def interrupted() -> None:
        with together():
            atomic_write(other / "c", "3")
            raise KeyboardInterrupt

    disk.full_at = disk.written + 2
    with pytest.raises(NotWritten, match="b: cannot be written"):
        refused()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert tree(tmp_path) == {"new/a": b"2", "new/b": b"1"}


def test_a_journal_on_a_full_disk_keeps_the_rows_before(tmp_path: Path, disk: Disk) -> None:
    path = tmp_path / JOURNAL
    with Journal(path, "job", {}) as journal:
        journal.add(FleetRow("M1", "", job="job"))
        disk.full_at = disk.written + 1
        with pytest.raises(NotWritten, match=r"rows\.jsonl: cannot be written \(no space left on device\)"):
            journal.add(FleetRow("M2", "", job="job"))
        journal.add(FleetRow("M3", "", job="job"))
    assert [line.split('"')[3] for line in path.read_text().splitlines()] == ["M1", "M3"]
