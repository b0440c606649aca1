"""Live work against real sockets and pseudo-terminals: sources, log, tracking, driving, and what goes wrong."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from emsid import DataError, EmsidError, FormatError, Motor, Record, RecursiveLeastSquares, arx, friction_narx
from emsid import save as save_model
from emsid.cli.structures import structure_of
from emsid.estimation import Control, Directional, Forgetting
from emsid.estimation.linear.change_detection import ChangeDetector
from emsid.excitation import SIGNALS
from emsid.findings import Finding
from emsid.live.board import Board, MotorChange, read_change
from emsid.live.driving import Limits, drive
from emsid.live.log import Log, read_from
from emsid.live.protocol import LineParser
from emsid.live.receiver import Receiver
from emsid.live.recorded import read_log
from emsid.live.server import Server
from emsid.live.session import Session, Settings, messages
from emsid.live.sources import Disconnected, connect, open_source
from emsid.live.tracking import Tracker
from emsid.plant import Bench
from emsid.wording import sentence

DT = 1e-3
PLAIN = Motor().rigid()


@contextmanager
def served(pace: float = 10.0, terminal: bool = False, changes: tuple[MotorChange, ...] = ()) -> Iterator[Server]:
    """A server in a thread, ended in every case."""
    server = Server(Board(PLAIN, DT, Bench.typical(), changes), terminal=terminal, pace=pace)
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


# --- a session -------------------------------------------------------------------------------------------------------


def test_the_estimate_over_time_has_many_points_also_where_a_file_comes_at_once(tmp_path: Path) -> None:
    session, _ = tracked(lines(600), folder=tmp_path)
    assert len(session.history.time) == 30
    assert np.all(np.diff(session.history.time) > 0)
    assert session.counts["samples"] == sum(len(record) for record, _ in session.recent) == 600


def test_a_source_without_faults_gives_no_finding(tmp_path: Path) -> None:
    absent = {"change-detected", "source-gap", "samples-not-tracked", "source-disconnected", "source-silent"}
    absent |= {"lines-not-used", "log-not-written", "tracking-errors-coloured"}
    session, found = tracked(lines(6000), folder=tmp_path, settings=Settings(0.01, patience=1, false_alarm=3600))
    assert not absent & set(findings(found))
    assert [each["kind"] for each in found if each["kind"] != "estimate"] == ["start", "end"]
    assert all(json.loads(json.dumps(each)) == each for each in found)
    last = [each for each in found if each["kind"] == "estimate"][-1]
    assert {each["name"]: each["value"] for each in last["parameters"]} == pytest.approx(
        {"a1": -0.9, "b1": 0.2}, abs=0.01
    )
    physical = {each["name"]: each for each in last["physical"]}
    constant = physical["time constant"]
    assert constant["value"] == pytest.approx(-DT / np.log(0.9), abs=3 * constant["half_width"])
    assert (session.counts["samples"], session.counts["lost"], session.reason) == (6000, 0, "ended")
    record = read_log(tmp_path / "log.txt")
    assert (len(record), record.breaks, record.input_units, record.dt) == (6000, (), ("V",), pytest.approx(DT))


def test_errors_that_follow_each_other_are_said(tmp_path: Path) -> None:
    """A slow disturbance that the model does not have stays in its prediction errors."""
    rows = lines(3000).decode().splitlines()
    for k, row in enumerate(rows[1:], 1):
        before, _, y = row.rpartition(",")
        rows[k] = f"{before},{float(y) + np.sin(k / 10):.6f}"
    _, found = tracked("\n".join([*rows, ""]).encode(), folder=tmp_path)
    assert "tracking-errors-coloured" in findings(found)


def test_a_change_of_the_motor_is_announced_with_its_delay(tmp_path: Path) -> None:
    settings = Settings(0.01, patience=1, false_alarm=3600)
    session, found = tracked(lines(4000, step=3500, dt=0.01), folder=tmp_path, settings=settings)
    (change,) = [each["data"] for each in found if each["kind"] == "finding" and each["code"] == "change-detected"]
    assert change["since"] == pytest.approx(35.0, abs=0.1)
    assert 35.0 <= change["time"] < 35.2
    assert change["delay"] == pytest.approx(change["time"] - change["since"])
    assert change["false_alarm"] == pytest.approx(3600)
    assert session.fit is not None
    np.testing.assert_allclose(session.fit.estimate, [-0.9, 0.1], atol=0.02)


def test_pieces_of_any_size_give_the_same_session(tmp_path: Path) -> None:
    data = lines(4000, step=3500, dt=0.01)
    settings = Settings(10.0, patience=1, false_alarm=3600)
    whole, _ = tracked(data, folder=tmp_path / "a", settings=settings)
    parts = [data[k : k + 997] for k in range(0, len(data), 997)]
    pieces, _ = tracked(*parts, folder=tmp_path / "b", settings=settings)
    assert whole.tracking is not None
    assert pieces.tracking is not None
    np.testing.assert_array_equal(whole.tracking.state.estimate, pieces.tracking.state.estimate)
    np.testing.assert_array_equal(whole.tracking.detection, pieces.tracking.detection)
    assert [each.kind for each in whole.changes] == [each.kind for each in pieces.changes]
    moments = [np.array([(each.time, each.since) for each in session.changes]) for session in (whole, pieces)]
    np.testing.assert_allclose(*moments, rtol=1e-12)  # times of a piece are sums with another rounding


def test_a_structure_with_friction_and_a_fixed_model_are_tracked_beside(tmp_path: Path) -> None:
    known = RecursiveLeastSquares(arx(1, 1))
    model = known.fit(known.start(), Record(np.zeros(2), np.zeros(2), DT)).model
    model = replace(model, parameters=np.array([-0.9, 0.2]))
    recursion = RecursiveLeastSquares(friction_narx(1, 1, knots=(-0.5, 0.5)), rule=Forgetting(0.999))
    _, found = tracked(lines(noise=0.0), folder=tmp_path, tracker=Tracker(recursion, model=model))
    last = [each for each in found if each["kind"] == "estimate"][-1]
    assert [each["name"] for each in last["parameters"]] == ["a1", "b1", "h1_1", "h2_1", "c0", "offset"]
    assert last["model"]["output"] == pytest.approx(last["output"], abs=1e-4)


def test_lost_malformed_and_overflowed_samples_are_counted_and_stay_in_the_log(tmp_path: Path) -> None:
    rows = lines().split(b"\n")
    rows[300:305] = []
    rows[400], rows[450] = b"#\x01garbage"[1:], rows[450].rsplit(b",", 1)[0] + b",nan"
    data = b"\n".join(rows)
    session, _ = tracked(data, folder=tmp_path)
    assert {name: session.counts[name] for name in ("samples", "lost", "malformed", "not_finite", "gaps")} == {
        "samples": 593,
        "lost": 7,
        "malformed": 1,
        "not_finite": 1,
        "gaps": 3,
    }
    assert {"source-gap", "lines-not-used"} <= {each.code for each in session.findings}
    assert data in read_from(tmp_path / "log.txt")
    record = read_log(tmp_path / "log.txt")
    assert [len(each) for each in record.segments] == [299, 100, 49, 145]


def test_time_that_goes_backwards_is_a_gap(tmp_path: Path) -> None:
    session, found = tracked(lines(300), lines(300), folder=tmp_path)
    (gap,) = [each["data"] for each in found if each.get("code") == "source-gap"]
    assert (gap["cause"], gap["samples"]) == ("backwards", None)
    assert session.counts["samples"] == 600


def test_a_source_that_sends_nothing_is_reported_and_its_log_closed(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="has sent nothing for"):
        tracked(folder=tmp_path, end=TimeoutError())
    assert read_from(tmp_path / "log.txt").startswith(b"# emsid: begins")


def test_garbage_lines_are_reported_and_logged(tmp_path: Path) -> None:
    garbage = np.random.default_rng(0).integers(128, 255, 5000).astype(np.uint8).tobytes() + b"\n"
    with pytest.raises(DataError, match="check the baud rate"):
        tracked(*[garbage[k : k + 60] + b"\n" for k in range(0, 5000, 60)], folder=tmp_path, end=TimeoutError())
    assert garbage[:60] in read_from(tmp_path / "log.txt")


def test_a_header_that_comes_late_is_waited_for(tmp_path: Path) -> None:
    header, *rows = lines(600).splitlines(keepends=True)
    log, parser = Log(tmp_path / "log.txt"), LineParser()
    parser.implies = False  # as for every connection
    session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), "board")
    receiver = Receiver(Bytes(b"".join(rows[:300]), header, b"".join(rows[300:])), log)
    list(messages(session, receiver, parser, Settings(0.01), log))
    receiver.close()
    log.close()
    assert session.counts["samples"] == 300
    assert session.counts["malformed"] == 0


def test_silence_is_announced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emsid.live.session.SILENT", 0.1)
    end = time.monotonic() + 0.6
    session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), "board")
    receiver = Receiver(Bytes(lines(), end=TimeoutError()), None)
    control = Control(cancelled=lambda: time.monotonic() > end)
    found = list(messages(session, receiver, LineParser(), Settings(0.05), control=control))
    receiver.close()
    assert findings(found).count("source-silent") == 1
    assert session.reason == "stopped"


def test_a_session_goes_on_from_a_saved_state(tmp_path: Path, command: object) -> None:
    from emsid.io.state_file import load_state, save_state

    structure = arx(1, 1)
    session, _ = tracked(lines(), folder=tmp_path)
    assert session.tracking is not None
    save_state(session.tracking.state, structure, tmp_path / "state.json")
    restored = load_state(tmp_path / "state.json", structure)
    for name in ("estimate", "factor", "diagonal", "totals"):
        np.testing.assert_array_equal(getattr(restored, name), getattr(session.tracking.state, name))
    with pytest.raises(FormatError, match="other regressors"):
        load_state(tmp_path / "state.json", arx(2, 1))
    (tmp_path / "state.json").write_text("{}")
    with pytest.raises(FormatError, match="no state file"):
        load_state(tmp_path / "state.json", structure)


# --- log -------------------------------------------------------------------------------------------------------------


def test_a_log_is_appended_to_and_read_after_a_cut(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    log = Log(path)
    log.write(lines(100)[:-7])
    log.close()
    again = Log(path)
    assert again.begin > 0
    again.write(b"n,t[s],u[V],y[rad/s]\n" + b"".join(b"%d,%.3f,0,0\n" % (k, 1 + DT * k) for k in range(50)))
    again.mark("disconnected")
    again.close()
    record = read_log(path)
    assert [len(each) for each in record.segments] == [99, 50]
    assert len(read_log(path, again.begin)) == 50
    assert path.read_bytes().count(b"# emsid: ") == 3


def test_what_is_received_is_on_disk_within_a_second(tmp_path: Path) -> None:
    log = Log(tmp_path / "log.txt")
    log.write(b"0,1,2\n")
    assert (tmp_path / "log.txt").read_bytes().endswith(b"0,1,2\n")  # with the operating system at once
    log.close()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_full_disk_is_announced_and_nothing_is_dropped_silently(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    log = Log("/dev/full")
    assert log.problem
    session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), "board")
    receiver = Receiver(Bytes(lines()), log)
    found = list(messages(session, receiver, LineParser(), Settings(0.01), log))
    receiver.close()
    assert findings(found).count("log-not-written") == 1
    assert session.counts["samples"] == 600
    with pytest.raises(FormatError, match=r"the last \d+ lines could not be written \(no space left") as problem:
        log.close()
    assert lines() in (tmp_path / str(problem.value).split("they are in ")[1].split(":")[0]).read_bytes()


def test_a_disk_that_takes_bytes_again_gets_all_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = Log(tmp_path / "log.txt")
    real, full = os.write, [True]

    def write(file: int, data: bytes) -> int:
        if full[0] and len(data) > 2:
            return real(file, bytes(data[:2]))
        if full[0]:
            raise OSError(28, "No space left on device")
        return real(file, data)

    monkeypatch.setattr("emsid.live.log.os.write", write)
    log.write(b"0,1,2\n1,1,2\n")
    assert log.problem == "no space left on device"
    full[0] = False
    log.write(b"2,1,2\n")
    log.close()
    assert (tmp_path / "log.txt").read_bytes().endswith(b"0,1,2\n1,1,2\n2,1,2\n")


def test_a_log_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="the log cannot be written"):
        Log(tmp_path / "file" / "log.txt")
    with pytest.raises(FormatError, match="cannot be read"):
        read_from(tmp_path / "none.txt")
    (tmp_path / "log.txt").write_text("# nothing\n")
    with pytest.raises(DataError, match="no samples"):
        read_log(tmp_path / "log.txt")


# --- sources ---------------------------------------------------------------------------------------------------------


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
    assert [len(each) for each in read_log(log.path).segments] == [300, 300]


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
    assert [len(each) for each in read_log(log.path).segments] == [300, 300]
    assert b"# emsid: connected again at" in log.path.read_bytes()


def test_a_tracker_that_is_too_slow_skips_samples_that_the_log_has(tmp_path: Path) -> None:
    rows = lines(600).splitlines(keepends=True)
    parts = [b"".join(rows[k : k + 50]) for k in range(0, 601, 50)]
    log = Log(tmp_path / "log.txt")
    receiver = Receiver(Bytes(*parts[:10]), log, most_waiting=2000)
    receiver._thread.join()  # everything has come before the tracker begins
    session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), "board")
    found = list(messages(session, receiver, LineParser(), Settings(0.01), log))
    receiver.close()
    log.close()
    assert 50 <= session.counts["samples"] < 499
    assert session.counts["samples"] + session.counts["skipped"] == 499  # also where nothing comes after them
    assert "samples-not-tracked" in findings(found)
    assert len(read_log(log.path)) == 499


# --- board, server, driving ------------------------------------------------------------------------------------------


def test_a_board_in_pieces_gives_the_same_samples() -> None:
    board = Board(PLAIN, DT, Bench(), (MotorChange(0.05, "load_inertia", 1e-4), MotorChange(0.08, "disturbance", 0.01)))
    volts = np.sin(0.05 * np.arange(150)) * 5
    whole, _ = board.advance(board.start(), volts)
    state, parts = board.start(), []
    for part in (volts[:1], volts[1:60], volts[60:]):
        rows, state = board.advance(state, part)
        parts.append(rows)
    np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-9)
    plain, _ = replace(board, changes=()).advance(replace(board, changes=()).start(), volts)
    np.testing.assert_array_equal(plain[:51], whole[:51])
    assert np.abs(plain[60:] - whole[60:]).max() > 0.5


def test_changes_are_read_with_their_units() -> None:
    assert read_change("load_inertia=30 g*cm^2@2 s") == MotorChange(2.0, "load_inertia", pytest.approx(3e-6))
    assert read_change("disturbance=0.05@30") == MotorChange(30.0, "disturbance", 0.05)
    for wrong in ("load=1@2", "load_inertia=1", "load_inertia=x@2", "load_inertia=1@x"):
        with pytest.raises(EmsidError):
            read_change(wrong)


def driven(server: Server, folder: Path, limits: Limits, seconds: float, control: Control = Control()) -> object:  # noqa: B008
    log = Log(folder / "log.txt")
    receiver = Receiver(open_source(url(server)), log, lambda: open_source(url(server)))
    try:
        return drive(
            receiver,
            LineParser(),
            lambda dt: 4.0 * np.sign(np.sin(20 * dt * np.arange(round(seconds / dt)))),
            limits,
            control,
        )
    finally:
        receiver.close()
        log.close()


def test_a_run_over_a_socket_ends_at_zero_volts(tmp_path: Path) -> None:
    absent = "motor-not-at-zero"
    with served() as server:
        result = driven(server, tmp_path, Limits(6.0), 10.0)  # a second, of which a busy machine may miss a part
        assert (result.reason, result.at_zero) == ("done", True), absent
        assert server.voltage == 0.0
    record = read_log(tmp_path / "log.txt")
    assert record.dt == pytest.approx(DT)
    assert record.input[-1, 0] == 0.0
    assert np.abs(record.input).max() == pytest.approx(4.0, abs=0.01)
    assert np.abs(record.output).max() > 10


@pytest.mark.parametrize(
    ("limits", "control", "reason"),
    [
        (Limits(6.0, speed=5.0), Control(), "speed"),
        (Limits(6.0, time=0.2), Control(), "time"),
        (Limits(6.0), Control().within(0.3), "interrupted"),
    ],
    ids=["speed", "time", "Ctrl-C"],
)
def test_limits_and_ctrl_c_end_a_run_at_zero_volts(
    tmp_path: Path, limits: Limits, control: Control, reason: str
) -> None:
    with served() as server:
        if reason == "interrupted":
            control = Control().within(0.3)
        result = driven(server, tmp_path, limits, 100.0, control)
        assert (result.reason, result.at_zero, server.voltage) == (reason, True, 0.0)


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


def test_a_run_goes_on_where_the_clock_begins_again_and_ends_where_the_board_does() -> None:
    ticks = 2**32 - 1_000_000 + 10_000 * np.arange(1000)
    rows = [b"%d,0,%d\n" % (tick % 2**32, k) for k, tick in enumerate(ticks)]
    turned = SentBoard(b"t[us],u,y\n", *rows)
    again = SentBoard(b"t[us],u,y\n", *(b"%d,0,0\n" % (10_000 * k) for k in (*range(500, 700), *range(50))))
    for board, reason in ((turned, "done"), (again, "restarted")):
        receiver = Receiver(board, None)
        result = drive(receiver, LineParser(), lambda dt: 1.0 + np.arange(300) / 300, Limits(6.0))
        receiver.close()
        assert result.reason == reason
        assert board.commands[-1] == b"u 0\n"
        sent = [float(each[2:]) for each in board.commands if each.startswith(b"u ")]
        first, last = sent.index(1.0), len(sent) - 1 - sent[::-1].index(max(sent))
        assert np.all(np.diff(sent[first : last + 1]) >= 0)


def test_a_signal_above_the_limit_never_reaches_the_motor(tmp_path: Path) -> None:
    with served() as server:
        with pytest.raises(DataError, match=r"reaches 3\.99\d+ V|reaches 4 V"):
            driven(server, tmp_path, Limits(3.0), 1.0)
        assert server.voltage == 0.0
    assert np.abs(read_log(tmp_path / "log.txt").input).max() == 0.0


def test_the_board_stops_when_its_driver_is_gone_or_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emsid.live.server.WATCHDOG", 0.2)
    with served() as server:

        def wait_for(voltage: float) -> bool:
            end = time.monotonic() + 3
            while time.monotonic() < end and server.voltage != voltage:
                time.sleep(0.005)
            return server.voltage == voltage

        first = socket.create_connection(server.address)
        first.sendall(b"u 3\n")
        assert wait_for(3.0)
        first.close()
        assert wait_for(0.0)
        second = socket.create_connection(server.address)
        second.sendall(b"u 2\n")
        assert wait_for(2.0)
        assert wait_for(0.0)  # no further command
        second.sendall(b"u x\nnonsense\nu nan\n")
        time.sleep(0.05)
        assert server.voltage == 0.0
        second.close()


def test_a_server_that_is_asked_gives_a_sample_for_every_voltage() -> None:
    with served(pace=0.0) as server:
        source = open_source(url(server))
        source.write(b"u 1,2,3\nstop\n")
        data, end = b"", time.monotonic() + 5
        while data.count(b"\n") < 5 and time.monotonic() < end:
            data += source.read(0.1)
        source.close()
    rows = LineParser().feed(data)
    assert rows is not None
    np.testing.assert_allclose(rows.input[:, 0], [1, 2, 3, 0], atol=0.01)
    np.testing.assert_array_equal(rows.number, range(4))


def test_a_pseudo_terminal_is_served_too(tmp_path: Path) -> None:
    with served(terminal=True) as server:
        receiver = Receiver(open_source(server.terminal), None)
        result = drive(receiver, LineParser(), lambda dt: np.ones(200), Limits(6.0))
        receiver.close()
        assert (result.reason, result.at_zero, server.voltage) == ("done", True, 0.0)


def test_a_terminal_that_nobody_reads_loses_samples_and_the_server_goes_on() -> None:
    with served(terminal=True, pace=50.0) as server:
        end = time.monotonic() + 10
        while server.state.samples < 3000 and time.monotonic() < end:
            time.sleep(0.01)
        source = open_source(server.terminal)
        source.read(1.0)
        time.sleep(0.1)
        rows = LineParser("n,t,u,y").feed(source.read(1.0) + source.read(1.0))
        source.close()
    assert rows is not None
    assert rows.number[-1] >= 3000


def test_a_port_that_cannot_be_served_is_refused() -> None:
    with served() as server, pytest.raises(DataError, match="cannot be served"):
        Server(Board(PLAIN), port=server.address[1])
    with pytest.raises(DataError, match="a pace of"):
        Server(Board(PLAIN), pace=-1.0)


def test_ten_thousand_samples_a_second_from_a_socket_without_loss(tmp_path: Path) -> None:
    """The short form of 60 s in ``bench/live.py``."""
    server = Server(Board(PLAIN, 1e-4, Bench.typical()), pace=1.0)
    thread = Thread(target=server.run, args=(lambda: False, 1.0), daemon=True)
    log = Log(tmp_path / "log.txt")
    session = Session(Tracker(RecursiveLeastSquares(arx(5, 5), rule=Directional(0.99))), url(server))
    receiver = Receiver(open_source(url(server)), log)
    thread.start()
    found = list(messages(session, receiver, LineParser(), Settings(0.1), log))
    thread.join()
    receiver.close()
    log.close()
    assert session.counts["samples"] == 10_000
    assert session.counts["lost"] == session.counts["skipped"] == 0
    assert len(read_log(log.path)) == 10_000
    assert [each for each in found if each["kind"] == "estimate"][-1]["prediction"] is not None


# --- the command line ------------------------------------------------------------------------------------------------


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], command: object) -> object:
    def call(*words: object) -> tuple[int, str, str]:
        status = command(*words)  # type: ignore[operator]
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call


def test_track_a_file_writes_record_report_model_and_state(tmp_path: Path, run: object) -> None:
    (tmp_path / "log.csv").write_bytes(lines(4000, step=3500, dt=0.01))
    status, out, _ = run("track", tmp_path / "log.csv", "--forgetting", "0.995", "--out", tmp_path / "out")
    assert status == 0
    assert "4000 samples" in out
    assert out.count("has changed") == 1
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"record.csv", "report.html", "track.json", "state.json", "arx.json", "figures"}
    data = json.loads((tmp_path / "out" / "track.json").read_text())
    assert (data["samples"], data["reason"], len(data["changes"])) == (4000, "ended", 1)
    named = (tmp_path / "log.csv").read_bytes().replace(b"t[s]", b"Zeit[s]", 1)
    (tmp_path / "named.csv").write_bytes(named)
    assert run("track", tmp_path / "named.csv", "--time", "Zeit", "--out", tmp_path / "same")[0] == 0
    assert json.loads((tmp_path / "same" / "track.json").read_text())["dt"] == data["dt"]
    status, out, _ = run(
        "track", tmp_path / "log.csv", "--structure", tmp_path / "out" / "arx.json", "--state",
        tmp_path / "out" / "state.json", "--rule", "frozen", "--json", "--out", tmp_path / "again",
    )  # fmt: skip
    assert status == 0
    found = [json.loads(line) for line in out.splitlines()]
    assert [each["kind"] for each in found if each["kind"] not in ("estimate", "finding")] == ["start", "end"]
    before = {each["name"]: each["value"] for each in data["fit"]["parameters"]}
    assert {each["name"]: each["value"] for each in found[-1]["fit"]["parameters"]} == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--structure", "nothing"), "name arx"),
        (("--structure", "arx", "--knots", "1"), "does not use knots"),
        (("--structure", "friction-narx", "--input", "n,u"), "has one input and 2 are named"),
        (("--rule", "nothing"), "no rule"),
        (("--rule", "window"), "needs its length"),
        (("--rule", "frozen", "--forgetting", "0.9"), "no forgetting factor"),
        (("--forgetting", "2"), "forgetting factor 2.0"),
        (("--output", "z"), "no column 'z'"),
        (("--false-alarm", "-1"), "false_alarm of -1 s"),
    ],
)
def test_track_refuses_in_one_line(tmp_path: Path, run: object, words: tuple[str, ...], message: str) -> None:
    (tmp_path / "log.csv").write_bytes(lines(100))
    status, _, err = run("track", tmp_path / "log.csv", *words, "--out", tmp_path / "out")
    assert (status, err.count("\n")) == (2, 1)
    assert message in err


@pytest.mark.parametrize(
    ("text", "orders", "knots", "inputs", "terms"),
    [
        ("arx", {"na": 2, "nb": 2}, None, 1, 4),
        ("arx", {}, None, 2, 3),
        ("friction-narx", {}, "-0.5,0.5", 1, 6),
        ("wiener-hammerstein-regression", {"degree": 3}, None, 1, 4),
        ("polynomial-narx", {"degree": 2}, None, 2, 10),
        ("y(t-1); u(t-1); sign(y(t-1))", {}, None, 1, 3),
    ],
)
def test_every_structure_is_tracked_by_name(
    text: str, orders: dict[str, int | None], knots: str | None, inputs: int, terms: int
) -> None:
    rng, structure = np.random.default_rng(4), structure_of(text, orders, knots, inputs)
    assert len(structure.parameter_names) == terms
    record = Record(rng.uniform(-2, 2, (300, inputs)), rng.standard_normal(300), DT)
    tracker = Tracker(RecursiveLeastSquares(structure, rule=Directional(0.99)))
    tracking, _, predictions = tracker.advance(tracker.start(), record)
    assert np.isfinite(tracker.half_widths(tracking)).all()
    assert np.isfinite(predictions[2:]).all()


def test_bench_run_drives_a_server_and_writes_a_record(tmp_path: Path, run: object) -> None:
    with served(pace=20.0) as server:
        words = ("--excitation", "prbs", "--limit", "4V", "--duration", "2", "--out", tmp_path / "record.csv")
        status, out, err = run("bench", "run", "--source", url(server), *words)
        assert status == 0, err
        assert server.voltage == 0.0
    assert "the motor is at 0 V" in out
    assert (tmp_path / "record.csv").exists()
    assert (tmp_path / "record.log.txt").exists()
    for wrong, message in (
        (("--source", "log.csv", "--limit", "4V"), "takes no commands"),
        (("--source", "socket://127.0.0.1:1", "--limit", "4V", "--amplitude", "5"), "above the limit"),
        (("--source", "socket://127.0.0.1:1", "--limit", "0"), "voltage limit"),
        (("--source", "socket://127.0.0.1:1", "--limit", "4V", "--excitation", "none"), "no test signal"),
        (("--source", "socket://127.0.0.1:1", "--limit", "4V"), "nothing listens"),
    ):
        status, _, err = run("bench", "run", *wrong, "--out", tmp_path / "none.csv")
        assert (status, err.count("\n")) == (2, 1)
        assert message in err


def test_bench_run_says_that_zero_volts_are_not_confirmed(
    tmp_path: Path, run: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = SentBoard(b"t,u,y\n", *(b"%.2f,1,0\n" % (0.01 * k) for k in range(40)))
    monkeypatch.setattr("emsid.live.sources.open_source", lambda *_: stuck)
    monkeypatch.setattr("emsid.live.driving.PATIENCE", 0.2)
    monkeypatch.setattr("emsid.live.driving.CONFIRM", 0.1)
    words = ("--limit", "4V", "--out", tmp_path / "record.csv")
    status, out, _ = run("bench", "run", "--source", "socket://127.0.0.1:1", *words)
    assert (status, out.count(sentence(Finding("motor-not-at-zero", "socket://127.0.0.1:1")))) == (1, 1)


def test_a_killed_tracker_leaves_a_log_that_reads(tmp_path: Path) -> None:
    """The short form of 50 kills in ``bench/live.py``; then Ctrl-C, after which everything is written."""
    with served(pace=1.0) as server:
        words = [sys.executable, "-m", "emsid", "track", url(server), "--json", "--out", str(tmp_path)]
        for end in (signal.SIGKILL, signal.SIGINT):
            process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            assert process.stdout is not None
            try:
                for line in process.stdout:
                    if json.loads(line)["kind"] == "estimate":
                        break
                last = json.loads(process.stdout.readline())
                process.send_signal(end)
                _, complaint = process.communicate(timeout=60)
            finally:
                process.kill()
            record = read_log(tmp_path / "log.txt")
            assert record.time[-1] >= last["time"]
            assert (process.returncode == 0) is (end == signal.SIGINT), complaint
    assert (tmp_path / "report.html").exists()
    assert (tmp_path / "record.csv").exists()
    assert len(record.segments) >= 2  # both sessions, with a gap between


def test_models_that_are_not_regressions_are_not_tracked(tmp_path: Path, run: object) -> None:
    from emsid import GreyBox, plants
    from emsid.models.plants.grey_box import signals_of

    plant = plants.rigid_motor()
    model = GreyBox(plant, signals_of(plant, Record(np.zeros(9), np.zeros(9), 0.01)))
    save_model(model, tmp_path / "motor.json")
    (tmp_path / "log.csv").write_bytes(lines(100))
    status, _, err = run("track", tmp_path / "log.csv", "--structure", tmp_path / "motor.json", "--out", tmp_path / "o")
    assert (status, "not linear in its parameters" in err) == (2, True)


COLOURS = {"white": [1.0], "slow": [1.0, -0.95], "resonant": [1.0, -1.8, 0.9]}


@pytest.mark.parametrize("colour", COLOURS)
def test_false_alarms_come_as_often_as_stated(colour: str) -> None:
    """The mean time to the first false alarm of Gaussian errors, white or not; 80 runs have a deviation of 11 %."""
    rng, settling, detector = np.random.default_rng(5), 600, ChangeDetector(run=2000.0, settling=600)
    time = alarms = 0
    for _ in range(80):
        errors = lfilter([1.0], COLOURS[colour], rng.standard_normal(7000))[100:]
        _, alarm = detector.update(detector.start(), errors, np.ones(len(errors)))
        time += (len(errors) if alarm is None else alarm.index) - settling
        alarms += alarm is not None
    assert 1400 <= time / alarms <= 3400


@pytest.mark.parametrize(("colour", "size", "most"), [("white", 1.0, 50), ("resonant", 2.0, 50)])
def test_a_level_is_announced_soon(colour: str, size: float, most: int) -> None:
    """The delay of 18 of 20 alarms, with a false alarm in a million samples."""
    rng, settling, detector = np.random.default_rng(6), 1000, ChangeDetector(run=1e6, settling=1000)
    delays = []
    for _ in range(20):
        errors = lfilter([1.0], COLOURS[colour], rng.standard_normal(3000))[100:]
        errors[2 * settling :] += size * errors.std()
        _, alarm = detector.update(detector.start(), errors, np.ones(len(errors)))
        delays.append(len(errors) if alarm is None else alarm.index - 2 * settling)
    assert min(delays) >= 0
    assert sorted(delays)[17] <= most


def test_bursts_that_come_again_are_announced_no_more() -> None:
    """As the errors of a linear structure at every reversal: three alarms in the first minutes, then none."""
    rng, detector, alarms = np.random.default_rng(7), ChangeDetector(1e6, 1000, 3.0), []
    state = detector.start()
    errors = rng.standard_normal(60_000)
    for k in range(1500, len(errors), 1000):
        errors[k : k + 50] += 4.0 * rng.choice([-1.0, 1.0])
    at = 0
    while at < len(errors):
        state, alarm = detector.update(state, errors[at:], np.ones(len(errors) - at))
        if alarm is None:
            break
        at += alarm.index + 1
        alarms.append(at)
    assert len(alarms) <= 3
    assert max(alarms, default=0) < 10_000


def test_a_load_is_announced_although_the_structure_is_too_small() -> None:
    """A linear structure of a motor with a dead zone and friction, driven for 40 s; the load comes at 30 s."""
    dt, load = 5e-3, (MotorChange(30.0, "disturbance", 0.02),)
    board = Board(Motor(), dt, Bench.typical(), load)
    volts = SIGNALS["multisine"](2000, dt, 6.0, np.random.default_rng(1))
    rows, _ = board.advance(board.start(), np.tile(volts, 4))
    detector = ChangeDetector(3600 / dt, 2000, 3.0)
    tracker = Tracker(RecursiveLeastSquares(arx(1, 1), rule=Directional(0.995)), detector)
    _, changes, _ = tracker.advance(tracker.start(), Record(rows[:, 1], rows[:, 2], dt))
    assert 30.0 <= changes[0].time <= 30.5


def test_an_inertia_that_grows_is_tracked_faster_than_by_plain_forgetting() -> None:
    """Inertia +50 %: within 5 % for good in fewer samples than plain forgetting, at equal noise before the step."""
    rng = np.random.default_rng(2)
    n, step, gain, tau = 8_000, 5_000, 20.0, 0.05
    u, y = np.repeat(rng.uniform(-6, 6, n // 25 + 1), 25)[:n], np.zeros(n)
    for t in range(1, n):
        a = np.exp(-DT / (tau if t <= step else 1.5 * tau))
        y[t] = a * y[t - 1] + (1 - a) * gain * u[t - 1] + 0.02 * rng.standard_normal()
    record = Record(u, y, DT)
    recursion = RecursiveLeastSquares(arx(1, 1), 0.999)

    def settled(detector: ChangeDetector | None) -> int:
        tracker = Tracker(recursion, detector)
        tracking, late = tracker.start(), 0
        for first in (0, *range(step, n, 10)):
            piece = record[first : first + 10] if first else record[:step]
            tracking, _, _ = tracker.advance(tracking, piece)
            inertia = -DT / np.log(min(max(-tracking.state.estimate[0], 1e-9), 1 - 1e-9)) / tau
            if first >= step and abs(inertia / 1.5 - 1) > 0.05:
                late = first + 10 - step
        return late

    watched, plain = settled(ChangeDetector(1e6, 1000)), settled(None)
    assert watched < 300
    assert plain > 3 * watched


def test_a_source_that_ends_without_samples_says_so(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="ended without enough samples; 3 lines"):
        tracked(b"t,u,y\n0,1,2\n1,1,2\n", folder=tmp_path)


def test_a_session_that_is_stopped_before_the_first_sample_ends_quietly(tmp_path: Path) -> None:
    session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), "board")
    receiver = Receiver(Bytes(end=TimeoutError()), None)
    found = list(messages(session, receiver, LineParser(), Settings(), control=Control(cancelled=lambda: True)))
    receiver.close()
    assert [each["kind"] for each in found] == ["end"]
    assert session.fit is None
