"""Sources of live work: serial ports, sockets, RFC 2217, and why one cannot be opened."""

from __future__ import annotations

import os
import socket
import tty
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace

import pytest

from emsid import DataError, RecursiveLeastSquares, arx
from emsid.estimation import Control
from emsid.live.log import Log
from emsid.live.protocol import LineParser
from emsid.live.receiver import Receiver
from emsid.live.session import Session, Settings, messages
from emsid.live.sources import Disconnected, connect, open_source, read_log
from emsid.live.tracking import Tracker
from live_sessions import Bytes, findings, lines


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: the end of the board, and the path of the port."""
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_a_serial_port_is_read_and_written(terminal: tuple[int, str]) -> None:
    board, path = terminal
    source = open_source(f"serial://{path}")
    os.write(board, b"0,1,2\n")
    assert source.read(1.0) == b"0,1,2\n"
    assert source.read(0.0) == b""
    source.write(b"u 1\n")
    assert os.read(board, 100) == b"u 1\n"
    source.close()


def test_a_port_that_is_taken_is_refused(terminal: tuple[int, str]) -> None:
    first = open_source(terminal[1])
    with pytest.raises(DataError, match="used by another program"):
        open_source(terminal[1])
    first.close()


class Rfc2217Server:
    """A serial port over a network, as ``ser2net`` offers it: one part for every connection, which then breaks."""

    def __init__(self, *parts: bytes) -> None:
        self.commands, self.read = b"", [Event() for _ in parts]
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = Thread(target=self._work, args=(parts,), daemon=True)
        self._thread.start()

    def _work(self, parts: tuple[bytes, ...]) -> None:
        import serial
        import serial.rfc2217

        for part, read in zip(parts, self.read, strict=True):
            connection, _ = self._listener.accept()
            with connection:
                connection.settimeout(5)
                network = SimpleNamespace(write=connection.sendall)
                manager = serial.rfc2217.PortManager(serial.serial_for_url("loop://"), network)
                received = b""
                while not received.endswith(b"\n"):  # the settings of the port, and then a command
                    received += b"".join(manager.filter(connection.recv(1024)))
                self.commands += received
                connection.sendall(b"".join(manager.escape(part)))
                read.wait(10)  # pyserial drops what nobody has read when a connection breaks

    def close(self) -> None:
        self._thread.join(timeout=10)
        self._listener.close()
        assert not self._thread.is_alive()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # threads of pyserial
def test_a_port_behind_rfc_2217_is_tracked_through_a_break(tmp_path: Path) -> None:
    server = Rfc2217Server(lines(300), lines(300))
    log = Log(tmp_path / "log.txt")
    session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), server.url)

    def read() -> bool:
        for event in server.read[: session.counts["samples"] // 300]:
            event.set()
        return server.read[-1].is_set()

    again = partial(connect, server.url, 57600)
    receiver = Receiver(again(), log, again)
    found = list(messages(session, receiver, LineParser(), Settings(0.01), log, Control(cancelled=read)))
    receiver.close()
    server.close()
    log.close()
    assert server.commands == b"?\n?\n"
    assert findings(found)[:2] == ["source-disconnected", "source-gap"]
    assert [len(segment) for segment in read_log(log.path).segments] == [300, 300]


def test_pyserials_own_urls_work() -> None:
    source = open_source("loop://")
    source.write(b"0,1,2\n")
    assert source.read(0.1)[:1] == b"0"
    source.close()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("/no/such/log.csv", "no such file"),
        (".", "a folder"),
        ("serial:///dev/ttyNONE", "no such port"),
        ("socket://127.0.0.1:1", "nothing listens"),
        ("carrier-pigeon://loft", "no such kind of source"),
    ],
)
def test_sources_that_cannot_be_opened_say_why(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        open_source(text)


@pytest.mark.parametrize(
    ("number", "message"), [(13, "no permission"), (16, "used by another"), (5, "cannot be opened")]
)
def test_a_port_without_permission_says_so(monkeypatch: pytest.MonkeyPatch, number: int, message: str) -> None:
    import serial

    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(number, f"could not open port: {os.strerror(number)}")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(DataError, match=message):
        open_source("serial:///dev/ttyACM0")


def test_a_connection_that_comes_back_is_a_gap_in_one_log(tmp_path: Path) -> None:
    parts = iter([Bytes(lines(300), end=Disconnected("gone")), Bytes(lines(300))])
    log = Log(tmp_path / "log.txt")
    session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), "board")
    receiver = Receiver(next(parts), log, lambda: next(parts))
    found = list(messages(session, receiver, LineParser(), Settings(0.01), log))
    receiver.close()
    log.close()
    assert findings(found) == ["source-disconnected", "source-gap"]
    (gap,) = [each["data"] for each in found if each.get("code") == "source-gap"]
    assert gap["cause"] == "disconnected"
    assert [len(segment) for segment in read_log(log.path).segments] == [300, 300]
    assert b"# emsid: connected again at" in log.path.read_bytes()
