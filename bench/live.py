"""Live work measured: ``make bench``, or ``python bench/live.py [update] [long] [rate] [any] [kills]``.

=========  ============================================================================================================
update     one update of ten parameters, called from Python for each sample, and compiled over a block
long       10⁹ updates with directional forgetting, nine in ten without excitation
rate       60 s at 10 kHz from a socket, served by another process
any        5 s at 10 kHz for regressions of every kind, with the stream of JSON that a page follows
kills      50 random kills of tracker, server and connection: every log must read, and miss no more than a second
=========  ============================================================================================================
"""

from __future__ import annotations

import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from threading import Thread

import msgspec
import numpy as np

import emsid
from arguments import asked_parts
from emsid.cli.commands.track import structure_of
from emsid.estimation import Directional, Drift, Forgetting, Frozen, Gradient, RecursiveLeastSquares, Window
from emsid.estimation.linear.recursive_kernels import update
from emsid.live.log import Log
from emsid.live.protocol import LineParser
from emsid.live.receiver import Receiver
from emsid.live.rehearsal import rehearse
from emsid.live.session import Session, Settings, messages
from emsid.live.sources import open_source, read_log
from emsid.live.tracking import Tracker

N = 10


def updates() -> None:
    """One update of ten parameters."""
    rng = np.random.default_rng(0)
    structure, samples = emsid.arx(na=5, nb=5), 50_000
    u = rng.standard_normal(samples)
    y = np.convolve(u, [0.0, 0.5, 0.2, 0.1])[:samples] + 0.01 * rng.standard_normal(samples)
    record, values = emsid.Record(u, y, 1e-3), list(zip(u.tolist(), y.tolist(), strict=True))
    print("one update of ten parameters        from Python (median)   compiled over a block")
    for rule in (Forgetting(0.99), Directional(0.99), Drift(), Window(500), Gradient(), Frozen()):
        recursion = RecursiveLeastSquares(structure, rule=rule)
        online, times = emsid.SampleBySample(recursion, 1e-3), []
        for one, other in values:
            began = time.perf_counter_ns()
            online.add(one, other)
            times.append(time.perf_counter_ns() - began)
        residuals: list[np.ndarray] = []
        best = float("inf")
        for _ in range(5):
            began = time.process_time()
            recursion.update(recursion.start(), record, [] if not residuals else None, residuals)
            best = min(best, time.process_time() - began)
        print(f"  {type(rule).__name__:<34}{np.median(times[100:]) / 1e3:6.2f} µs{1e9 * best / samples:22.0f} ns")
    print("expected: at most 5 µs and, for forgetting, 150 ns; residuals included\n")


def long_run(count: int = 10**9) -> None:
    """Directional forgetting with little excitation, for a long time."""
    rng, size = np.random.default_rng(1), 100_000
    theta = rng.standard_normal(N)
    quiet = [np.zeros((N, size)), np.ones((N, size)), 1e-3 * rng.standard_normal((N, size))]
    estimate, factor, diagonal = np.zeros(N), np.eye(N), np.full(N, 1e8)
    totals, none, unwatched = np.zeros(7 + N), np.empty((0, N)), np.empty((0, 3))
    rule, limits = Directional(0.98).numbers(N), np.stack([np.full(N, 1e12), np.full(N, 1e12)])
    least, largest, moved, began = np.inf, 0.0, 0.0, time.process_time()
    for k in range(count // size):
        phi = rng.standard_normal((N, size)) if k % 10 == 0 else quiet[k % 3]
        block = np.vstack([phi, theta @ phi + 1e-3 * rng.standard_normal(size)])
        update(estimate, factor, diagonal, totals, none, block, rule, limits, none, unwatched)
        covariance = factor.T @ (diagonal[:, None] * factor)
        eigenvalues = np.linalg.eigvalsh(covariance)
        least, largest = min(least, eigenvalues[0]), max(largest, eigenvalues[-1])
        moved = max(moved, float(np.abs(estimate - theta).max()))
    seconds = time.process_time() - began
    print(
        f"{count:.0e} updates in {seconds:.0f} s of CPU, data included: eigenvalues of P from {least:.2g} to "
        f"{largest:.2g}, largest error of an estimate {moved:.2g} (noise 0.001)\n"
        "expected: positive, bounded, and errors of the size of the noise\n"
    )


def serve(port: int, *words: str) -> subprocess.Popen[bytes]:
    """A server in a process of its own; it listens when this returns."""
    command = [sys.executable, "-m", "emsid", "bench", "serve", "--port", str(port), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    return process


FOLLOWED = {
    "arx, 10 parameters": ("arx", {"na": 5, "nb": 5}, None),
    "friction, dead zone": ("friction-narx", {"na": 2, "nb": 2}, "-0.5,0.5"),
    "polynomial of degree 3": ("polynomial-narx", {"na": 2, "nb": 2, "degree": 3}, None),
    "wiener-hammerstein": ("wiener-hammerstein-regression", {"na": 2, "nb": 2, "degree": 3}, None),
    "regressors as text": ("y(t-1); u(t-1); sign(y(t-1)); exp(-abs(y(t-1))/2)*u(t-1); u(t-1)^3", {}, None),
}
"""A regression of every kind, as the command line makes them."""


def any_structure(seconds: float = 5.0) -> None:
    """10 kHz from a socket, tracked by regressions of every kind; every message becomes a line of JSON for a page."""
    for name, (text, orders, knots) in FOLLOWED.items():
        structure = structure_of(text, orders, knots, 1)
        tracker = Tracker(RecursiveLeastSquares(structure, rule=Directional(0.999)))
        rehearse(tracker, 1, detects=True)
        session, logged, shown, used = followed(tracker, seconds)
        counts, each = session.counts, 1e6 * used / max(session.counts["samples"], 1)
        print(
            f"{name:<24}{len(structure.parameter_names):3} parameters, {counts['samples']:,} of {logged:,} samples "
            f"tracked, {counts['lost']} lost, {counts['skipped']} skipped, {shown / seconds:.1f} messages a second; "
            f"{each:.1f} µs of CPU for a sample: up to {1e3 / each:.0f} kHz"
        )
    print("expected: nothing lost or skipped, five messages a second, more than 10 kHz\n")


def followed(tracker: Tracker, seconds: float) -> tuple[Session, int, int, float]:
    """Track a board that sends 10,000 samples a second.

    Returns:
        The session, the samples in its log, the messages with an estimate, and seconds of processor time.
    """
    port = free_port()
    server = serve(port, "--dt", "0.0001", "--duration", str(seconds))
    with tempfile.TemporaryDirectory() as folder:
        log = Log(Path(folder) / "log.txt")
        session = Session(tracker, f"socket://127.0.0.1:{port}")
        receiver = Receiver(open_source(session.name), log)
        began, shown = time.process_time(), 0
        for message in messages(session, receiver, LineParser(), Settings(false_alarm=3600.0), log):
            shown += message["kind"] == "estimate" and message["prediction"] is not None
            msgspec.json.encode(message)
        used = time.process_time() - began
        receiver.close()
        log.close()
        server.wait(timeout=20)
        return session, len(read_log(log.path)), shown, used


def rate(seconds: float = 60.0) -> None:
    """10 kHz from a socket."""
    tracker = Tracker(RecursiveLeastSquares(emsid.arx(na=5, nb=5), rule=Directional(0.999)))
    session, logged, shown, used = followed(tracker, seconds)
    counts = session.counts
    print(
        f"10 kHz for {seconds:g} s: {counts['samples']:,} samples tracked, {logged:,} in the log, "
        f"{counts['lost']} lost, {counts['skipped']} skipped, {shown} predictions shown, "
        f"{used:.0f} s of CPU\nexpected: nothing lost\n"
    )


class Proxy:
    """Passes a connection on, remembers when every line was passed, and can break it."""

    def __init__(self, target: int) -> None:
        self.target, self.lines, self.connection = target, [], None
        self.rest, self.killed = b"", float("inf")
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        Thread(target=self.work, daemon=True).start()

    def work(self) -> None:
        while True:
            self.connection, _ = self.listener.accept()
            # What was passed to a tracker that was killed meanwhile has reached nobody.
            self.lines[:] = [line for line in self.lines if line[0] <= self.killed]
            self.killed = float("inf")
            try:
                with self.connection, socket.create_connection(("127.0.0.1", self.target)) as server:
                    while data := server.recv(1 << 16):
                        with suppress(BlockingIOError):
                            server.sendall(self.connection.recv(1 << 16, socket.MSG_DONTWAIT))
                        self.connection.sendall(data)
                        *lines, self.rest = (self.rest + data).split(b"\n")
                        now = time.monotonic()
                        self.lines += [(now, line) for line in lines]
            except OSError:
                pass
            self.rest = b""

    def cut(self) -> None:
        if self.connection is not None:
            with suppress(OSError):
                self.connection.shutdown(socket.SHUT_RDWR)


def kills(rounds: int = 50) -> None:
    """Random kills of tracker, server and connection."""
    rng, port = random.Random(1), free_port()
    server, proxy, killed = serve(port), Proxy(port), {"tracker": 0, "server": 0, "connection": 0}
    worst, unreadable, missing = 0.0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        words = [f"socket://127.0.0.1:{proxy.port}", "--json", "--patience", "120", "--out", folder]
        command = [sys.executable, "-m", "emsid", "track", *words]
        tracker = None
        try:
            for _ in range(rounds):
                if tracker is None:
                    tracker = subprocess.Popen(command, stdout=subprocess.PIPE)
                    assert tracker.stdout is not None
                    assert tracker.stdout.readline(), "the tracker has ended"
                    Thread(target=tracker.stdout.read, daemon=True).start()
                time.sleep(rng.uniform(0.3, 1.5))
                victim = rng.choice(list(killed))
                killed[victim] += 1
                if victim == "tracker":
                    now = proxy.killed = time.monotonic()
                    tracker = _kill(tracker)
                    late, lost, bad = _missing(Path(folder) / "log.txt", proxy.lines, now)
                    worst, missing, unreadable = max(worst, late), missing + lost, unreadable + bad
                elif victim == "server":
                    _kill(server)
                    server = serve(port)
                else:
                    proxy.cut()
            time.sleep(1.0)
            now = time.monotonic()
        finally:
            if tracker is not None:
                _kill(tracker)
            _kill(server)
        late, lost, bad = _missing(Path(folder) / "log.txt", proxy.lines, now)
        record = read_log(Path(folder) / "log.txt")
    worst, missing, unreadable = max(worst, late), missing + lost, unreadable + bad
    print(
        f"{rounds} kills ({', '.join(f'{count} of {name}' for name, count in killed.items())}): {unreadable} logs "
        f"unreadable, {missing} lines older than a second missing, the oldest missing line {worst:.3f} s old, "
        f"{len(record):,} samples in {len(record.segments)} segments\nexpected: none, none, at most 1 s\n"
    )


def _kill(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGKILL)
    process.wait()


def _missing(path: Path, passed: list[tuple[float, bytes]], now: float) -> tuple[float, int, bool]:
    """The age of the oldest line that is not in the log, how many are older than a second, whether it is unreadable."""
    logged = set(path.read_bytes().split(b"\n"))
    ages = [now - at for at, line in passed if line not in logged]
    passed[:] = [each for each in passed if each[1] in logged]  # what is missing is counted once
    try:
        read_log(path)
    except emsid.EmsidError as problem:
        print(problem)
        return max(ages, default=0.0), sum(age > 1 for age in ages), True
    return max(ages, default=0.0), sum(age > 1 for age in ages), False


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


if __name__ == "__main__":
    parts = {"update": updates, "long": long_run, "rate": rate, "any": any_structure, "kills": kills}
    for name in asked_parts(__doc__, parts):
        parts[name]()
