"""Receives a source in a thread of its own: every byte goes into the log first, and then waits for the tracker.

A connection that breaks is opened again until it comes back, or until a stated time is over. Where the tracker is
slower than the source, bytes that wait too long are skipped, and counted; they are in the log.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from threading import Event, Lock, Thread

from emsid.errors import EmsidError
from emsid.live.log import Log
from emsid.live.sources import Disconnected, Ended, Source

RETRY = 0.5
"""Seconds between two attempts to open a source that was disconnected."""
AWAY = 30.0
"""Seconds in which a connection that broke may come back: a board that starts again, or is plugged in again, needs a
few."""
MOST_WAITING = 1 << 25
"""Bytes that wait for the tracker."""


@dataclass(frozen=True)
class Piece:
    """What has arrived from a source.

    Attributes:
        kind: ``data``, ``disconnected``, ``connected``, ``skipped``, ``ended`` or ``failed``.
        data: the bytes.
        text: why it was disconnected or failed.
        lines: how many lines were skipped.
    """

    kind: str
    data: bytes = b""
    text: str = ""
    lines: int = 0


class Receiver:
    """A thread that reads a source.

    Attributes:
        source: the open source.
        log: where every byte goes first; None for a file, which is its own log.
        heard: when bytes came last, on the clock of `time.monotonic`.
        away: seconds after which a source that was disconnected is given up.

    Args:
        source: the open source.
        log: see above.
        again: opens the source again after it was disconnected; None to give up then.
        most_waiting: bytes that wait for the tracker.
        away: see above.
    """

    def __init__(
        self,
        source: Source,
        log: Log | None,
        again: Callable[[], Source] | None = None,
        most_waiting: int = MOST_WAITING,
        away: float = AWAY,
    ) -> None:
        self.source, self.log, self._again, self._most = source, log, again, most_waiting
        self.away = away
        self.heard = time.monotonic()
        self._pieces: deque[Piece] = deque()
        self._waiting, self._arrived, self._ended, self._room = 0, Event(), Event(), Event()
        self._skipping, self._lock = 0, Lock()
        self._thread = Thread(target=self._work, name="receiver", daemon=True)
        self._thread.start()

    def wait(self, timeout: float) -> list[Piece]:
        """What has arrived since the last call, after at most this many seconds."""
        self._arrived.wait(timeout)
        self._arrived.clear()
        pieces = []
        while self._pieces:
            piece = self._pieces.popleft()
            pieces.append(piece)
        with self._lock:
            self._waiting -= sum(len(piece.data) for piece in pieces)
        self._room.set()
        return pieces

    def send(self, data: bytes) -> None:
        """Send bytes to the board.

        Raises:
            Disconnected: where the connection is broken.
            DataError: for a source that takes no commands.
        """
        self.source.write(data)

    def close(self) -> None:
        """End the thread and close the source; the log stays open."""
        self._ended.set()
        self._room.set()
        self._thread.join(timeout=5)
        self.source.close()

    def _work(self) -> None:
        try:
            while not self._ended.is_set():
                try:
                    data = self.source.read(0.05)
                except Disconnected as problem:
                    if not self._reconnected(str(problem)):
                        return
                    continue
                if data:
                    self.heard = time.monotonic()
                    if self.log is not None:
                        self.log.write(data)
                    self._pass_on(data)
        except Ended:
            self._put(Piece("ended"))
        except EmsidError as problem:
            self._put(Piece("failed", text=str(problem)))
        except OSError as problem:
            self._put(Piece("failed", text=f"{self.source.name}: {(problem.strerror or str(problem)).lower()}"))

    def _pass_on(self, data: bytes) -> None:
        while self._waiting > self._most and self.log is None and not self._ended.is_set():
            self._room.clear()
            self._room.wait(0.1)
        if self._waiting > self._most:
            self._skipping += data.count(b"\n")
            return
        with self._lock:
            self._waiting += len(data)
        self._put(Piece("data", data))

    def _put(self, piece: Piece) -> None:
        """Pass a piece on, after what was skipped before it."""
        if self._skipping:
            self._pieces.append(Piece("skipped", lines=self._skipping))
            self._skipping = 0
        self._pieces.append(piece)
        self._arrived.set()

    def _reconnected(self, reason: str) -> bool:
        """Open the source again, as often as it takes; false where that is not wanted, or takes too long."""
        until = time.monotonic() + self.away
        self.source.close()
        if self.log is not None:
            self.log.mark("disconnected")
        self._put(Piece("disconnected", text=reason))
        while self._again is not None and not self._ended.is_set() and time.monotonic() < until:
            try:
                self.source = self._again()
            except EmsidError:
                self._ended.wait(RETRY)
                continue
            if self.log is not None:
                self.log.mark("connected again")
            self._put(Piece("connected"))
            return True
        self._put(Piece("ended", text=f"{reason}; it did not come back within {self.away:g} s"))
        return False
