"""A TCP server that sends lines from the first moment of every connection, to see whether a tracker loses any.

As a program, it has trackers killed and started again while it sends, and counts the lines that were sent at least a
second before a kill and are not in the log. Usage: sending_server.py KILLS FOLDER
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread

AT_ONCE, EVERY = 20, 0.01
HEADER = b"n,t,u,y\n"


class SendingServer:
    """Sends a header and 20 lines on accept, and then 20 lines every 10 ms.

    Attributes:
        url: of its port.
        sent: for every connection, the lines with the time at which each was sent.
    """

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.1)
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self.sent: list[list[tuple[bytes, float]]] = []
        self._ended, self._number = Event(), 0
        self._thread = Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ended.is_set():
            with suppress(TimeoutError):
                connection, _ = self._listener.accept()
                with connection, suppress(OSError):
                    self._send(connection)

    def _send(self, connection: socket.socket) -> None:
        sent: list[tuple[bytes, float]] = []
        self.sent.append(sent)
        head = HEADER
        while not self._ended.is_set():
            lines = []
            for _ in range(AT_ONCE):
                n = self._number = self._number + 1
                lines.append(b"%d,%.4f,%d,%.4f" % (n, 5e-4 * n, n // 40 % 2, (n * 37 % 101) / 101))
            connection.sendall(head + b"\n".join(lines) + b"\n")
            now = time.monotonic()
            sent += [(line, now) for line in lines]
            head = b""
            self._ended.wait(EVERY)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._listener.close()


def missing(server: SendingServer, log: bytes, kills: list[float], age: float) -> tuple[int, int]:
    """How many lines were sent this long before the kill that ended their connection, and how many are not logged."""
    lines = set(log.split(b"\n"))
    old = [line for sent, kill in zip(server.sent, kills, strict=False) for line, at in sent if at < kill - age]
    return len(old), sum(line not in lines for line in old)


def killed(count: int, folder: Path, age: float = 1.0) -> tuple[int, int]:
    """Kill trackers while the server sends; the lines that should be in the log, and those of them that are not."""
    server, kills = SendingServer(), []
    words = [sys.executable, "-m", "emsid", "track", server.url, "--json", "--out", str(folder)]
    try:
        for k in range(count):
            with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
                while len(server.sent) <= k and process.poll() is None:
                    time.sleep(0.01)
                time.sleep(1.2 * age + 0.037 * (k % 11))
                kills.append(time.monotonic())
                process.send_signal(signal.SIGKILL)
        return missing(server, (folder / "log.txt").read_bytes(), kills, age)
    finally:
        server.close()


if __name__ == "__main__":
    lines, lost = killed(int(sys.argv[1]), Path(sys.argv[2]))
    print(
        f"{sys.argv[1]} kills: {lines} lines were sent over a second before a kill, {lost} of them are not in the log"
    )
    sys.exit(lost > 0)
