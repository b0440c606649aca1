"""Sources, boards and whole sessions that several tests of live work share."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import numpy as np

from emsid import DataError, Motor, RecursiveLeastSquares, arx
from emsid.estimation import Directional
from emsid.live.board import Board, MotorChange
from emsid.live.log import Log
from emsid.live.protocol import LineParser
from emsid.live.receiver import Receiver
from emsid.live.server import Server
from emsid.live.session import Session, Settings, messages
from emsid.live.tracking import Tracker
from emsid.plant import Bench

DT = 1e-3
PLAIN = Motor().rigid()


@contextmanager
def served(
    pace: float = 10.0, terminal: bool = False, changes: tuple[MotorChange, ...] = (), dt: float = DT
) -> Iterator[Server]:
    """A server in a thread, ended in every case."""
    server = Server(Board(PLAIN, dt, Bench.typical(), changes), terminal=terminal, pace=pace)
    ended: list[bool] = []
    thread = Thread(target=server.run, args=(lambda: bool(ended),), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        ended.append(True)
        thread.join(timeout=10)
        assert not thread.is_alive()


def url(server: Server) -> str:
    return f"socket://{server.address[0]}:{server.address[1]}"


def lines(samples: int = 600, step: int | None = None, noise: float = 0.01, dt: float = DT) -> bytes:
    """A first-order motor in the protocol; its gain halves at a step."""
    rng = np.random.default_rng(3)
    u, y, text = np.repeat(rng.uniform(-1, 1, samples // 10 + 1), 10), 0.0, [b"n,t[s],u[V],y[rad/s]"]
    for k in range(samples):
        text.append(b"%d,%.4f,%.5f,%.6f" % (k, dt * k, u[k], y))
        gain = 0.2 if step is None or k < step else 0.1
        y = 0.9 * y + gain * u[k] + noise * rng.standard_normal()
    return b"\n".join(text) + b"\n"


class Bytes:
    """A source that sends these bytes, and then what `end` says."""

    def __init__(self, *parts: bytes, end: Exception | None = None, lasting: bool = False) -> None:
        from emsid.live.sources import Ended

        self.parts, self.end, self.lasting, self.name = list(parts), end or Ended(), lasting, "board"

    def read(self, timeout: float) -> bytes:
        if self.parts:
            return self.parts.pop(0)
        if isinstance(self.end, TimeoutError):
            time.sleep(timeout)
            return b""
        raise self.end

    def write(self, data: bytes) -> None:
        raise DataError("board takes no commands")

    def close(self) -> None:
        pass


def tracked(
    *parts: bytes,
    folder: Path,
    settings: Settings = Settings(every=0.01, patience=0.3),  # noqa: B008
    end: Exception | None = None,
    log: Log | None = None,
    tracker: Tracker | None = None,
) -> tuple[Session, list[dict[str, object]]]:
    """A whole session over these bytes, and its messages."""
    log = log or Log(folder / "log.txt")
    session = Session(tracker or Tracker(RecursiveLeastSquares(arx(1, 1), rule=Directional(0.99))), "board")
    receiver = Receiver(Bytes(*parts, end=end), log)
    try:
        found = list(messages(session, receiver, LineParser(), settings, log))
    finally:
        receiver.close()
        log.close()
    return session, found


def findings(found: list[dict[str, object]]) -> list[object]:
    return [each["code"] for each in found if each["kind"] == "finding"]


class SentBoard(Bytes):
    """A board that sends these parts once it is driven."""

    def __init__(self, *parts: bytes) -> None:
        super().__init__(*parts, end=TimeoutError())
        self.commands: list[bytes] = []

    def read(self, timeout: float) -> bytes:
        time.sleep(0.002)
        return super().read(timeout) if len(self.commands) > 1 else b""

    def write(self, data: bytes) -> None:
        self.commands.append(data)
