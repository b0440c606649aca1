"""Nothing is destroyed: sources of a command, results on a full disk, closed streams, the log of a second tracker."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from command_line import FIRST_ORDER, IDENTIFY, table
from emsid import DataError
from emsid.errors import FormatError
from emsid.io import atomic_write
from emsid.io.files import read_bytes
from emsid.live.log import Log
from emsid.live.sources import open_source
from emsid.replacing import is_source, sources_kept
from live_sessions import lines

ARX = (*IDENTIFY, "--models", "arx", *FIRST_ORDER)
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory, command: Callable[..., int]) -> Path:
    folder = tmp_path_factory.mktemp("model")
    assert command("identify", table(folder / "log.csv"), *ARX, "--out", folder) == 0
    return folder / "arx.json"


@pytest.mark.parametrize("name", ["same.csv", "link.csv", "../{}/same.csv"])
def test_a_simulation_does_not_replace_its_input(run: Run, model: Path, tmp_path: Path, name: str) -> None:
    source = table(tmp_path / "same.csv")
    (tmp_path / "link.csv").hardlink_to(source)
    before = source.read_bytes()
    target = tmp_path / name.format(tmp_path.name)
    status, _, err = run("simulate", model, source, "-u", "u", "--dt", ".01", "--out", target, "--force")
    assert (status, err.count("\n")) == (2, 1)
    assert "reads this file" in err
    assert source.read_bytes() == before
    assert run("simulate", model, source, "-u", "u", "--dt", ".01", "--out", tmp_path / "new.csv")[0] == 0


def test_no_command_replaces_a_file_of_others(run: Run, model: Path, tmp_path: Path) -> None:
    """A single file only with --force; in a folder of results those of an earlier run, and nothing else."""
    log, mine = table(tmp_path / "log.csv"), b"my own words\n"
    data, fleet_of = ("-u", "u", "-y", "y", "--dt", ".01"), ("--models", str(model))
    folders = {
        ("describe", log, *data[:4]): ("report.html",),
        ("identify", log, *ARX): ("result.json", "report.html", "best.json", "arx.json"),
        ("validate", model, log): ("validation.json", "report.html"),
        ("track", log, *data): ("track.json", "report.html", "state.json", "record.csv"),
        ("fleet", log, *data, *fleet_of): ("rows.jsonl", "fleet.parquet", "fleet.json", "report.html"),
        ("study", "--duration", "1"): ("study.json", "report.html"),
        ("demo",): ("commands.md", "motor.csv"),
    }
    for k, (words, names) in enumerate(folders.items()):
        for name in names:
            folder = tmp_path / f"{k}-{name}"
            folder.mkdir()
            (folder / name).write_bytes(mine)
            where = (folder,) if words == ("demo",) else ("--out", folder)
            status, _, err = run(*words, *where)
            assert (status, err.count("\n")) == (2, 1), (words, err)
            assert f"{name} in it is not a result of emsid" in err
            assert {path.name: path.read_bytes() for path in folder.iterdir()} == {name: mine}
    for words in (
        ("simulate",),
        ("simulate", model, log, "-u", "u", "--dt", ".01"),
        ("design", model, "--limit", "2", "--duration", "1"),
        ("bench", "run", "--source", "socket://localhost:1", "--limit", "6V"),
    ):
        (tmp_path / "mine.csv").write_bytes(mine)
        status, _, err = run(*words, "--out", tmp_path / "mine.csv")
        assert (status, err.count("\n"), "--force" in err) == (2, 1, True), (words, err)
        assert (tmp_path / "mine.csv").read_bytes() == mine
    assert run("simulate", "--duration", "1", "--out", tmp_path / "mine.csv", "--force")[0] == 0
    assert (tmp_path / "mine.csv").read_bytes() != mine


def test_a_later_run_replaces_the_results_of_an_earlier_one(run: Run, model: Path, tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv")
    data = ("-u", "u", "-y", "y", "--dt", ".01")
    for k, words in enumerate(
        (
            ("describe", log, *data[:4]),
            ("validate", model, log),
            ("track", log, *data),
            ("fleet", log, *data, "--models", model),
        )
    ):
        for _ in range(2):
            assert run(*words, "--out", tmp_path / str(k))[0] == 0


def test_what_an_earlier_run_has_left_is_said(run: Run, model: Path, tmp_path: Path) -> None:
    log, out = table(tmp_path / "log.csv"), tmp_path / "out"
    words = ("validate", model, log, "--out", out)
    assert "from an earlier run" not in run(*words)[1] + run(*words)[1]
    for name in ("free-run-of-a-motor.svg", "0.pdf"):
        (out / "figures" / name).write_bytes(b"")
    status, said, _ = run(*words)
    assert (status, said.splitlines()[-1]) == (
        0,
        "from an earlier run, not from this one: 2 in figures/",
    )


def test_a_tracking_does_not_replace_its_source(run: Run, tmp_path: Path) -> None:
    (tmp_path / "record.csv").write_bytes(lines(600))
    (tmp_path / "track.json").write_text('{\n  "schema": 1}')  # a folder of results
    status, _, err = run("track", tmp_path / "record.csv", "--out", tmp_path)
    assert (status, err.count("\n")) == (2, 1)
    assert "would replace its source" in err
    assert (tmp_path / "record.csv").read_bytes() == lines(600)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_program_may_replace_what_it_reads_and_a_command_may_not(tmp_path: Path) -> None:
    path = tmp_path / "file"
    atomic_write(path, "old")
    with sources_kept():
        assert read_bytes(path, replaceable=True) == b"old"
        read_bytes(path)
        assert is_source(path)
        with pytest.raises(FormatError, match="would replace it"):
            atomic_write(path, "lost")
        atomic_write(tmp_path / "own", "1")
        read_bytes(tmp_path / "own")
        atomic_write(tmp_path / "own", "2")
    assert read_bytes(path) == b"old"
    atomic_write(path, "newer")


def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("emsid.io.files.os.replace", refuse)


@pytest.mark.parametrize("words", [(), ("--json",)])
def test_a_full_disk_does_not_swallow_a_result(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    log = table(tmp_path / "log.csv")
    full_disk(monkeypatch)
    status, out, err = run("identify", log, *ARX, "--out", tmp_path / "out", *words)
    assert (status, err.count("\n")) == (2, 1)
    assert "no space left" in err
    assert str(tmp_path / "out") in err
    assert "arx" in out
    assert len(out.splitlines()) > 5


@pytest.mark.parametrize(
    ("closed", "status", "complaint"),
    [(">&-", 2, "standard output is closed"), ("2>&-", 0, ""), (">&- 2>&-", 2, ""), ("<&-", 0, "")],
)
def test_closed_streams_are_no_error_of_python(tmp_path: Path, closed: str, status: int, complaint: str) -> None:
    log = table(tmp_path / "log.csv")
    program = f"{sys.executable} -m emsid describe {log} --dt 0.01 {closed}"
    done = subprocess.run(["sh", "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (status, int(bool(complaint))), done.stderr
    assert complaint in done.stderr
    assert bool(done.stdout) is (">&-" not in closed.split())


def test_two_logs_are_not_mixed_and_a_killed_tracker_is_no_obstacle(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    holder = "import sys, time; from emsid.live.log import Log; log = Log(sys.argv[1]); print('held', flush=True)"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{holder}; time.sleep(60)", str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    before = path.read_bytes()
    with pytest.raises(FormatError, match=rf"another process \(number {process.pid}\) writes into this log"):
        Log(path)
    assert path.read_bytes() == before
    process.kill()
    process.communicate()
    assert (tmp_path / ".log.txt.lock").exists()  # nobody holds it
    log = Log(path)
    with pytest.raises(FormatError, match=f"number {os.getpid()}"):
        Log(path)
    log.close()
    assert [file.name for file in tmp_path.iterdir()] == ["log.txt"]


@pytest.mark.parametrize("url", ["spy:///dev/null?file={}", "serial://spy:///dev/null?file={}", "SPY://x?file={}"])
def test_no_url_writes_a_file(tmp_path: Path, url: str) -> None:
    precious = tmp_path / "v"
    precious.write_text("precious")
    with pytest.raises(DataError, match="no such kind of source; there are serial://"):
        open_source(url.format(precious))
    assert precious.read_text() == "precious"


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("socket://", "the host is missing"),
        ("socket://:7000", "the host is missing"),
        ("socket://[::1", "the host is missing"),
        ("socket://127.0.0.1", "nothing is no port"),
        ("socket://127.0.0.1:99999", "'99999' is no port; write a number from 1 to 65535"),
        ("socket://127.0.0.1:0", "'0' is no port"),
        ("socket://127.0.0.1:-5", "'-5' is no port"),
        ("rfc2217://127.0.0.1:x", "'x' is no port"),
        ("serial://", "no such kind of source"),
    ],
)
def test_addresses_are_refused_in_words_of_the_program(run: Run, tmp_path: Path, url: str, said: str) -> None:
    status, _, err = run("track", url, "--out", tmp_path / "out")
    assert (status, err.count("\n")) == (2, 1)
    assert said in err
    assert not any(word in err for word in ("Errno", "Python", "pyserial", "Error", "getaddrinfo"))


def test_a_named_pipe_without_a_writer_does_not_block(run: Run, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    status, _, err = run("track", tmp_path / "pipe", "--patience", "0.3", "--out", tmp_path / "out")
    assert (status, err.count("\n")) == (2, 1)
    assert "it has sent nothing yet" in err
    assert "(waited 0.3 s)" in err


def test_a_named_pipe_is_tracked_and_logged(run: Run, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "log.csv").write_bytes(lines(600))
    with subprocess.Popen(["sh", "-c", f"cat {tmp_path / 'log.csv'} > {tmp_path / 'pipe'}"]):
        status, _, err = run("track", tmp_path / "pipe", "--out", tmp_path / "out")
    assert status == 0, err
    assert lines(600) in (tmp_path / "out" / "log.txt").read_bytes()


def test_kernels_are_compiled_in_memory_where_nothing_can_be_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Without a folder to write to, with a full disk, and with damaged files of an earlier process."""
    from numba.core import caching

    from emsid.compiled import NOT_KEPT, NOTICE, njit

    said: list[str] = []
    monkeypatch.setattr(NOTICE, "say", said.append)

    def twice(x: float) -> float:
        return 2 * x

    monkeypatch.setattr(NOTICE, "given", False)
    with monkeypatch.context() as patch:
        patch.setattr(caching.CacheImpl, "_locator_classes", [])
        assert njit()(twice)(1.5) == njit(nogil=True)(twice)(1.5) == 3.0
    assert said == [NOT_KEPT]  # once
    monkeypatch.setattr(NOTICE, "given", False)
    monkeypatch.setattr("numba.core.caching.config.CACHE_DIR", str(tmp_path))
    with monkeypatch.context() as patch:
        full_disk(patch)
        assert njit()(twice)(2.5) == 5.0
    assert said == [NOT_KEPT] * 2
    assert njit()(twice)(2.5) == 5.0
    kept = [path for path in tmp_path.rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert len(kept) == 2
    for path in kept:
        path.write_bytes(path.read_bytes()[:40])
    assert njit()(twice)(2.5) == 5.0
    assert len(said) == 2
