"""The server of the studio as a process: what it bounds, how a fit is cancelled, and what is left after kill -9."""

from __future__ import annotations

import http.client
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

PROC, NO_PROC = Path("/proc/self/cmdline").exists(), "finds the processes that fit in /proc"
START = """
import sys
from pathlib import Path
from emsid.studio import server
from emsid.cli.commands.studio import command_of, track_of
server.serve(Path(sys.argv[1]), [], browser=False, spelling=str, command=command_of, track=track_of,
             say=lambda address: print(address, flush=True))
"""
"""The server without the check for uPlot, which these tests do not draw with."""


class Server:
    """A server in a process of its own, and requests to it."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        self.process = process
        self.address = urlsplit(process.stdout.readline().strip())

    def ask(self, path: str, content: Any = None, body: Any = None) -> tuple[int, bytes]:
        """Status and content of an answer; a table or a body is posted."""
        connection = http.client.HTTPConnection(str(self.address.hostname), self.address.port, timeout=60)
        try:
            sent = msgspec.json.encode(content) if content is not None else body
            connection.request("GET" if sent is None else "POST", self.address.path + path, sent)
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def state(self) -> dict[str, Any]:
        """What a page would show."""
        status, content = self.ask("api/state")
        assert status == 200
        found: dict[str, Any] = msgspec.json.decode(content)
        return found

    def begin(self) -> str:
        """Fit; the number of the run."""
        status, content = self.ask("api/run", {})
        assert status == 200
        return str(msgspec.json.decode(content)["run"])

    def run(self, number: str) -> dict[str, Any]:
        """The state of a run."""
        return next(each for each in self.state()["runs"] if each["number"] == number)

    def until(self, number: str, *states: str, limit: float = 120) -> dict[str, Any]:
        """The run once it is in one of some states."""
        end = time.monotonic() + limit
        while (run := self.run(number))["state"] not in states:
            assert time.monotonic() < end, run
            time.sleep(0.05)
        return run


@contextmanager
def serving(folder: Path) -> Iterator[Server]:
    words = [sys.executable, "-c", START, str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield Server(process)
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(tmp_path_factory.mktemp("studio") / "session") as found:
        assert found.ask("api/files?name=log.csv", body=table(300))[0] == 200
        yield found


def table(rows: int) -> bytes:
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-5, 5, rows // 10), 10)
    y = np.zeros(rows)
    for t in range(1, rows):
        y[t] = 0.9 * y[t - 1] + 0.5 * u[t - 1]
    y += 0.02 * rng.standard_normal(rows)
    return "\n".join(["t,voltage,speed", *(f"{k / 100:.2f},{u[k]:.4f},{y[k]:.4f}" for k in range(rows))]).encode()


def test_two_hundred_requests_at_once_are_answered_or_refused_and_the_server_stays_up(server: Server) -> None:
    def ask(k: int) -> int:
        with suppress(OSError, http.client.HTTPException):
            return server.ask("api/state")[0]
        return 0

    with ThreadPoolExecutor(200) as pool:
        statuses = list(pool.map(ask, range(200)))
    assert set(statuses) <= {200, 503}
    assert statuses.count(200) >= 50
    assert server.state()["step"]["files"] == ["log.csv"]


def test_a_request_of_a_hundred_megabytes_is_refused(server: Server) -> None:
    connection = http.client.HTTPConnection(str(server.address.hostname), server.address.port, timeout=60)
    connection.putrequest("POST", server.address.path + "api/edit")
    connection.putheader("content-length", str(100_000_000))
    connection.endheaders()
    assert connection.getresponse().status == 413  # before any of it has arrived
    connection.close()
    blocks = (b" " * 1_000_000 for _ in range(100))
    with suppress(OSError):  # the server may close the connection while the rest is sent
        assert server.ask("api/edit", body=blocks)[0] == 413
    assert server.state()["step"]["files"] == ["log.csv"]


@pytest.mark.skipif(not PROC, reason=NO_PROC)
def test_a_cancelled_fit_ends_with_what_it_has_and_the_next_one_is_fitted(tmp_path: Path) -> None:
    with serving(tmp_path / "s") as server:
        server.ask("api/files?name=log.csv", body=table(600))
        number = server.begin()
        server.ask("api/cancel", {"run": number})  # also where its process is not there yet
        assert server.until(number, "done", "failed", "ended")["state"] in ("done", "failed")
        second, third, fourth = server.begin(), server.begin(), server.begin()
        assert server.run(fourth)["state"] == "waiting"
        server.ask("api/cancel", {"run": fourth})  # has not begun
        assert server.run(fourth)["state"] == "ended"
        until(lambda: len(workers(tmp_path)) == 2)
        for each in (second, third):
            server.ask("api/cancel", {"run": each})
            server.ask("api/cancel", {"run": each})  # at once
            assert server.until(each, "ended")["models"] == []
        server.ask("api/edit", {"models": ["arx"], "options": {"na": "1", "nb": "1", "nk": "1"}})
        assert server.until(server.begin(), "done", "failed", "ended")["models"] == ["arx"]


def until(found: Any, limit: float = 60) -> None:
    end = time.monotonic() + limit
    while not found():
        assert time.monotonic() < end
        time.sleep(0.02)


def workers(folder: Path) -> list[int]:
    """The processes that fit into a session."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            words = path.read_bytes().split(b"\0")
            if b"emsid.studio.worker" in words and any(str(folder).encode() in word for word in words):
                found.append(int(path.parent.name))
    return found


@pytest.mark.long
@pytest.mark.skipif(not PROC, reason=NO_PROC)
def test_killing_server_and_worker_at_any_moment_loses_nothing_that_was_finished(tmp_path: Path) -> None:
    """At 20 random moments; what was finished before has the same bytes after."""
    rng, folder = np.random.default_rng(1), tmp_path / "session"
    finished: dict[Path, bytes] = {}
    steps = 0
    for k in range(10):
        with serving(folder) as server:
            found = server.state()
            assert all(path.read_bytes() == content for path, content in finished.items())
            done = {path.parent.name for path in finished}
            assert done <= {run["number"] for run in found["runs"] if run["state"] == "done"}
            if k == 0:
                server.ask("api/files?name=log.csv", body=table(300))
                server.ask("api/edit", {"models": ["arx"], "options": {"na": "1", "nb": "1", "nk": "1"}})
                server.until(server.begin(), "done")
            else:
                assert found["step"]["unseen"] == pytest.approx(0.3 + steps / 100)
            number = server.begin()
            time.sleep(rng.uniform(0, 2))
            for process in workers(folder):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            assert server.until(number, "done", "ended", "waiting", "failed")["state"] in ("done", "ended")
            server.begin()
            steps += 1
            assert server.ask("api/edit", {"unseen": 0.3 + steps / 100})[0] == 200
            time.sleep(rng.uniform(0, 2))
            for run in server.state()["runs"]:
                if run["state"] == "done":
                    for path in (folder / "runs" / run["number"]).iterdir():
                        finished[path] = path.read_bytes() if path.is_file() else b""
            finished = {path: content for path, content in finished.items() if path.is_file()}
            server.process.kill()
    assert finished
    until(lambda: not workers(folder))  # those without a server end by themselves


def test_two_hundred_files_that_are_added_at_once_are_all_kept(tmp_path: Path) -> None:
    content = table(60)
    with serving(tmp_path / "session") as server:
        assert server.ask("api/files?name=log.csv", body=content)[0] == 200

        def add(k: int) -> int:
            while (status := server.ask(f"api/files?name=log.csv&unseen={k % 2}", body=content)[0]) == 503:
                time.sleep(0.05)  # refused, as too many ask
            return status

        with ThreadPoolExecutor(40) as pool:
            assert set(pool.map(add, range(200))) == {200}
        step = server.state()["step"]
        assert len({*step["files"], *step["unseen_files"]}) == 201
        assert len(list((tmp_path / "session" / "data").iterdir())) == 201
