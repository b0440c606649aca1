"""Serves a board on a TCP port and on a pseudo-terminal, in the line protocol.

Commands are lines: ``u 1.5`` sets the voltage until the next command, ``u 1,2,3`` one voltage for each of the next
samples, ``stop`` sets zero volts, ``?`` asks for the header. Every connected client receives every sample; the one that
sent the last voltage drives the motor. It stands at zero volts when its driver disconnects, or sends no command for
`WATCHDOG` seconds of real time.
"""

from __future__ import annotations

import os
import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from emsid.errors import DataError
from emsid.live.board import Board

HEADER = b"n,t[s],voltage[V],speed[rad/s]\n"
WATCHDOG = 0.5
"""Seconds without a command after which the board sets zero volts."""
TICK = 2e-3
"""Seconds between two moments at which samples that are due are computed."""
MOST_QUEUED = 1 << 26
"""Bytes that wait for a client that does not read; more, and it is disconnected."""
MOST_VALUES = 10_000
"""Voltages in one command."""


@dataclass(eq=False)
class _Client:
    """A connected client."""

    number: int
    close: Callable[[], None]
    receive: Callable[[], bytes]
    transmit: Callable[[bytes], int]
    lossy: bool = False  # a terminal drops what nobody reads, as a serial line does
    incoming: bytes = b""
    outgoing: bytearray = field(default_factory=bytearray)


class Server:
    """A board that serves its samples.

    Attributes:
        address: host and port of the TCP port.
        terminal: path of the pseudo-terminal; empty where there is none.
        voltages: the voltages of the next samples; the last one is held.

    Args:
        board: the board.
        host: where it listens; only this machine by default.
        port: TCP port; 0 for any free one.
        terminal: whether to open a pseudo-terminal.
        pace: samples in real time times this factor; 0 for a sample for every commanded voltage, as fast as asked.

    Raises:
        DataError: where the port is taken or cannot be used.
    """

    def __init__(
        self, board: Board, host: str = "127.0.0.1", port: int = 0, terminal: bool = False, pace: float = 1.0
    ) -> None:
        if not (isfinite(pace) and pace >= 0):
            raise DataError(f"a pace of {pace:g}; give a factor of real time, or 0", arguments=("pace",))
        self.board, self.state, self.pace = board, board.start(), pace
        self.voltages: list[float] = []
        self.terminal = ""
        self._clients: dict[int, _Client] = {}
        self._driver: int | None = None
        self._commanded = time.monotonic()
        self._selector = selectors.DefaultSelector()
        try:
            self._listener = socket.create_server((host, port))
        except (OSError, OverflowError) as problem:
            reason = getattr(problem, "strerror", None) or str(problem)
            raise DataError(
                f"port {port} of {host} cannot be served ({reason.lower()}); choose another", arguments=("port",)
            ) from None
        self._listener.setblocking(False)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        self._selector.register(self._listener, selectors.EVENT_READ)
        if terminal:
            self._open_terminal()

    @property
    def voltage(self) -> float:
        """The present voltage in V."""
        return self.voltages[0] if self.voltages else 0.0

    def run(self, stop: Callable[[], bool], duration: float | None = None) -> None:
        """Serve until ``stop()`` is true, or for this many seconds of samples; then close everything."""
        begun, first = time.monotonic(), self.state.samples
        last = None if duration is None else round(duration / self.board.dt)
        try:
            while not stop():
                waiting = bool(self.pace) or any(client.outgoing for client in self._clients.values())
                self._exchange(TICK if waiting else 0.05)
                if self.pace:
                    due = first + int((time.monotonic() - begun) * self.pace / self.board.dt)
                    due = due if last is None else min(due, last)
                    if self._driver is not None and self.voltage and time.monotonic() - self._commanded > WATCHDOG:
                        self._driver, self.voltages = None, []
                    if due > self.state.samples:
                        self._sample(min(due - self.state.samples, MOST_VALUES))
                if last is not None and self.state.samples >= last:
                    self._flush()
                    return
        finally:
            self.close()

    def close(self) -> None:
        """Set zero volts and close everything."""
        self.voltages = []
        for client in list(self._clients.values()):
            self._drop(client)
        with suppress(KeyError, ValueError):
            self._selector.unregister(self._listener)
        self._listener.close()
        self._selector.close()

    def _exchange(self, timeout: float) -> None:
        """Accept, receive and send what can be."""
        for key, _ in self._selector.select(timeout):
            if key.fileobj is self._listener:
                self._accept()
            else:
                client = self._clients.get(key.fd)
                if client is not None:
                    self._receive(client)
        for client in list(self._clients.values()):
            self._send(client)

    def _accept(self) -> None:
        with suppress(OSError):
            connection, _ = self._listener.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._add(_Client(connection.fileno(), connection.close, lambda: connection.recv(1 << 16), connection.send))

    def _open_terminal(self) -> None:
        import tty

        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.terminal = os.ttyname(slave)

        def close() -> None:
            os.close(master)
            os.close(slave)

        self._add(
            _Client(master, close, lambda: os.read(master, 1 << 12), lambda data: os.write(master, data), lossy=True)
        )

    def _add(self, client: _Client) -> None:
        self._clients[client.number] = client
        self._selector.register(client.number, selectors.EVENT_READ)
        client.outgoing += HEADER

    def _drop(self, client: _Client) -> None:
        if self._driver == client.number:
            self._driver, self.voltages = None, []
        self._clients.pop(client.number, None)
        with suppress(KeyError, ValueError):
            self._selector.unregister(client.number)
        with suppress(OSError):
            client.close()

    def _receive(self, client: _Client) -> None:
        try:
            data = client.receive()
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        *lines, client.incoming = (client.incoming + data).split(b"\n")
        client.incoming = client.incoming[-MOST_VALUES:]
        for line in lines:
            self._command(client, line.decode("ascii", "replace").strip())

    def _command(self, client: _Client, line: str) -> None:
        word, _, rest = line.partition(" ")
        if word == "?":
            client.outgoing += HEADER
        elif word == "stop":
            self._set(client, [0.0])
        elif word == "u":
            try:
                values = [float(value) for value in rest.split(",")]
            except ValueError:
                values = []
            if not values or len(values) > MOST_VALUES or not all(map(isfinite, values)):
                client.outgoing += b"# not understood: write u VOLTS\n"
            else:
                self._set(client, values)
        elif line:
            client.outgoing += b"# not understood; commands are u VOLTS, stop and ?\n"

    def _set(self, client: _Client, values: list[float]) -> None:
        self._driver, self._commanded, self.voltages = client.number, time.monotonic(), values
        if not self.pace:
            self._sample(len(values))

    def _sample(self, count: int) -> None:
        """Compute samples and put them into the queue of every client."""
        now = self.voltages[:count]
        volts = np.array(now + [now[-1] if now else 0.0] * (count - len(now)))
        self.voltages = self.voltages[count:] or self.voltages[-1:]
        first = self.state.samples
        rows, self.state = self.board.advance(self.state, volts)
        lines = [b"%d,%.7g,%.6g,%.7g\n" % (first + k, *row) for k, row in enumerate(rows.tolist())]
        data = b"".join(lines)
        for client in list(self._clients.values()):
            client.outgoing += data
            if len(client.outgoing) > MOST_QUEUED:
                self._drop(client)

    def _send(self, client: _Client) -> None:
        try:
            while client.outgoing:
                done = client.transmit(bytes(client.outgoing[: 1 << 16]))
                del client.outgoing[:done]
        except BlockingIOError:
            if client.lossy:
                line = client.outgoing.find(b"\n")  # nobody reads: the rest of a line, and whole lines, are lost
                del client.outgoing[line + 1 :]
        except OSError:
            self._drop(client)

    def _flush(self) -> None:
        """Give the clients a moment to receive what is left."""
        end = time.monotonic() + 1.0
        while time.monotonic() < end and any(client.outgoing and not client.lossy for client in self._clients.values()):
            self._exchange(0.01)
