"""The server of the studio as a process: what it bounds, how a fit is cancelled, and what is left after kill -9."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
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

from emsid.errors import DataError
from emsid.studio import uplot
from emsid.studio.server import serve
from emsid.studio.session import Session, held

PROC, NO_PROC = Path("/proc/self/cmdline").exists(), "finds the processes that fit in /proc"
START = """
import signal
import sys
from contextlib import suppress
from pathlib import Path
from emsid.studio import server, studio
from emsid.cli.commands.studio import command_of, track_of
server.HEAD = 1.0
studio.Studio.warm = lambda self: None
signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends by an exception, as in a command
with suppress(KeyboardInterrupt):
    server.serve(Path(sys.argv[1]), [], browser=False, command=command_of, track=track_of,
                 say=lambda address: print(address, flush=True))
"""
"""The server without what it loads for the first fit: these tests draw nothing, and fit in other processes."""


class Server:
    """A server in a process of its own, and requests to it."""

    def __init__(self, process: subprocess.Popen[str], folder: Path) -> None:
        assert process.stdout is not None
        self.process, self.folder = process, folder
        self.address = urlsplit(process.stdout.readline().strip())

    def ask(self, path: str, content: Any = None, body: Any = None, on: int | None = None) -> tuple[int, bytes]:
        """Status and content of an answer; a table or a body is posted, made on a version."""
        connection = http.client.HTTPConnection(str(self.address.hostname), self.address.port, timeout=60)
        try:
            sent = msgspec.json.encode(content) if content is not None else body
            headers = {} if on is None else {"If-Match": str(on)}
            connection.request("GET" if sent is None else "POST", self.address.path + path, sent, headers)
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
def serving(folder: Path, **options: Any) -> Iterator[Server]:
    words = [sys.executable, "-c", START, str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, **options) as process:
        try:
            yield Server(process, folder)
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
        server.ask("api/files?name=log.csv", body=table(300))
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


def test_corrections_at_once_lose_none(tmp_path: Path) -> None:
    with serving(tmp_path / "session") as server:
        server.ask("api/files?name=log.csv", body=table(60))

        def correct(given: dict[str, Any]) -> int:
            """Do it again after a refusal, as a user of a page that was drawn anew; the number of refusals."""
            refused = 0
            while (answer := server.ask("api/edit", {"given": given}, on=server.state()["version"]))[0] == 409:
                refused += 1
            assert answer[0] == 200
            return refused

        with ThreadPoolExecutor(2) as pool:
            for k in range(6):
                corrections = {"mask": f"row < {k + 1}"}, {"units": {"speed": ["rpm", "rad/s"][k % 2]}}
                list(pool.map(correct, corrections))
                assert server.state()["step"]["given"] == {"log.csv": corrections[0] | corrections[1]}
        version = server.state()["version"]
        assert version == 1 + 12
        with ThreadPoolExecutor(8) as pool:  # of those made on one version, one is taken
            asked = pool.map(lambda k: server.ask("api/edit", {"unseen": 0.2 + k / 100}, on=version)[0], range(8))
            assert sorted(asked) == [200] + 7 * [409]


def test_a_session_is_open_in_one_studio_at_a_time(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    second = [sys.executable, "-m", "emsid", "studio", "--no-browser", "--session", str(folder)]
    with serving(folder) as server:
        server.ask("api/files?name=log.csv", body=table(60))
        before = (folder / "session.json").read_bytes()
        said = f"{folder}: another process (number {server.process.pid}) has this session open; use its page, or name"
        with pytest.raises(DataError, match=re.escape(said)):
            serve(folder, [], browser=False, command=lambda *_: "", track=lambda *_: [], say=print)
        if uplot.is_there():
            refused = subprocess.run(second, capture_output=True, text=True, timeout=60, check=False)
            assert (refused.returncode, len(refused.stderr.splitlines())) == (2, 1)
        assert (folder / "session.json").read_bytes() == before
        server.process.kill()
        server.process.wait()
    assert (folder / ".lock").exists()  # of a process that is no more
    with held(folder):
        assert Session.at_folder(folder).step["files"] == ["log.csv"]
    assert not (folder / ".lock").exists()


@pytest.mark.skipif(not PROC, reason=NO_PROC)
def test_interrupting_a_studio_in_a_run_leaves_a_readable_session(tmp_path: Path) -> None:
    folder, number = tmp_path / "session", ""
    for how in (signal.SIGINT, signal.SIGKILL, None):
        with serving(folder) as server:
            found = server.state()
            if number:
                assert (found["step"]["files"], found["problem"]) == (["log.csv"], "")
                run = server.run(number)
                assert run["state"] in ("ended", "done", "failed")
                for name in run["models"]:
                    assert server.ask(f"api/about?model={number}/{name}")[0] == 200
                assert not list(folder.rglob("*.tmp"))
            else:
                server.ask("api/files?name=log.csv", body=table(300))
            if how is not None:
                number = server.begin()
                until(lambda: workers(folder))
                server.process.send_signal(how)
                server.process.wait(30)
                until(lambda: not workers(folder))


def test_half_a_request_is_closed_after_seconds_unless_it_has_the_token(server: Server) -> None:
    host, port = str(server.address.hostname), int(server.address.port or 0)
    starts = [
        b"",
        b"GET / HTTP/1.1\r\nHost: x",
        b"POST /none/api/files HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n",
    ]
    begun = time.monotonic()
    idle = [socket.create_connection((host, port)) for _ in starts]
    for connection, start in zip(idle, starts, strict=True):
        connection.sendall(start)
    slow = socket.create_connection((host, port))
    slow.sendall(
        f"POST {server.address.path}api/edit HTTP/1.1\r\nHost: {host}:{port}\r\nContent-Length: 2\r\n\r\n{{".encode()
    )
    for connection in idle:
        connection.settimeout(20)
        with suppress(ConnectionResetError):
            while connection.recv(1000):  # until the server closes it
                pass
        connection.close()
    assert time.monotonic() - begun < 10
    time.sleep(max(0.0, begun + 2 - time.monotonic()))
    slow.sendall(b"}")
    slow.settimeout(20)
    assert slow.recv(1000).startswith(b"HTTP/1.1 200")
    slow.close()


def test_an_upload_that_breaks_off_leaves_no_file(server: Server) -> None:
    connection = http.client.HTTPConnection(str(server.address.hostname), server.address.port, timeout=60)
    connection.putrequest("POST", server.address.path + "api/files?name=more.csv")
    connection.putheader("content-length", "1000")
    connection.endheaders(b"t,voltage")
    until(lambda: list((server.folder / "incoming").iterdir()))
    connection.close()
    until(lambda: not list((server.folder / "incoming").iterdir()))
    assert [path.name for path in (server.folder / "data").iterdir()] == ["log.csv"]
    assert server.state()["step"]["files"] == ["log.csv"]


@pytest.mark.skipif(sys.platform == "win32", reason="limits the size of files as POSIX does")
def test_a_full_disk_is_answered_in_one_line_and_changes_nothing(tmp_path: Path) -> None:
    import resource

    folder, most = tmp_path / "session", 4000

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))  # writing more than this fails, as on a full disk

    session, steps = Session.at_folder(folder), 0
    (tmp_path / "log.csv").write_bytes(table(60))
    session.change(0, files=[session.add(tmp_path / "log.csv")])
    for k in range(12):
        session.change(k + 1, unseen=0.2 + k / 100)
    with serving(folder, preexec_fn=limit) as server:
        for path, content, body in (
            ("api/files?name=more.csv", None, table(600)),
            ("api/example", {"name": "motor"}, None),
        ):
            status, answer = server.ask(path, content, body)
            assert status in (400, 507), answer
            assert b"\n" not in answer
        while (answers := server.ask("api/edit", {"unseen": 0.5 + steps / 1000}))[0] == 200:
            steps += 1
            assert steps < 100
        assert answers[0] in (400, 507)
        assert b"\n" not in answers[1]
        assert server.state()["step"]["unseen"] == pytest.approx(0.5 + (steps - 1) / 1000)
        server.ask("api/undo", {})
    assert [path.name for path in (folder / "data").iterdir()] == ["log.csv"]
    assert list((folder / "incoming").iterdir()) == []
    assert Session.at_folder(folder).step["files"] == ["log.csv"]


@pytest.mark.skipif(not PROC, reason="looks for a command line in /proc")
def test_the_token_is_in_no_command_line(tmp_path: Path) -> None:
    seen, browser = tmp_path / "seen", tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$@" > {seen}.part; mv {seen}.part {seen}\n')
    browser.chmod(0o700)
    start = START.replace("browser=False", "browser=True")
    environment = {**os.environ, "BROWSER": f"{browser} %s"}
    words = [sys.executable, "-c", start, str(tmp_path / "session")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            server = Server(process, tmp_path / "session")
            until(seen.exists)
            address = seen.read_text().strip()
            door = Path(address.removeprefix("file://"))
            assert door == tmp_path / "session" / "open.html"
            assert door.stat().st_mode & 0o777 == 0o600
            assert f"url={server.address.geturl()}" in door.read_text()
            assert len(server.address.path) > 20
            token = server.address.path.strip("/").encode()
            assert token not in Path(f"/proc/{process.pid}/cmdline").read_bytes()
        finally:
            process.terminate()
    assert not door.exists()
