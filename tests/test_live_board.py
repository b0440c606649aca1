"""A simulated board, the program that drives it, and the server between them: always ended at 0 V."""

from __future__ import annotations

import socket
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emsid import DataError, EmsidError
from emsid.estimation import Control
from emsid.live.board import Board, MotorChange, read_change
from emsid.live.driving import Limits, drive
from emsid.live.log import Log
from emsid.live.protocol import LineParser
from emsid.live.receiver import Receiver
from emsid.live.server import Server
from emsid.live.sources import open_source, read_log
from emsid.plant import Bench
from live_sessions import DT, PLAIN, SentBoard, served, url


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
        sent = [float(command[2:]) for command in board.commands if command.startswith(b"u ")]
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
