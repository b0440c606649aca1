"""No received line is lost, and every end of a tracking – of the board, by SIGTERM – writes the page."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import pytest

from emsid.cli.interruption import Interruption
from emsid.live.log import Log
from emsid.live.receiver import Receiver
from emsid.live.sources import connect
from live_sessions import Bytes, lines, served, url
from sending_server import SendingServer, killed


def test_what_a_server_sends_at_once_is_received(tmp_path: Path) -> None:
    """Also what has arrived before the receiver reads."""
    server = SendingServer()
    try:
        for k in range(5):
            log = Log(tmp_path / f"{k}.txt")
            source = connect(server.url)
            time.sleep(0.05)
            receiver = Receiver(source, log)
            time.sleep(0.1)
            receiver.close()
            log.close()
            sent = b"\n".join(line for line, _ in server.sent[k][:60]) + b"\n"
            assert sent in log.path.read_bytes()
    finally:
        server.close()


@pytest.mark.long
def test_fifty_killed_trackers_lose_no_line(tmp_path: Path) -> None:
    lines_, lost = killed(50, tmp_path)
    assert lines_ > 10_000
    assert lost == 0


def test_a_connection_that_does_not_come_back_is_given_up_in_time(tmp_path: Path) -> None:
    from emsid.errors import DataError
    from emsid.live.sources import Disconnected

    def refuse() -> Bytes:
        raise DataError("nothing listens there")

    log = Log(tmp_path / "log.txt")
    receiver = Receiver(Bytes(lines(20), end=Disconnected("gone")), log, refuse, away=0.2)
    found, begun = [], time.monotonic()
    while (not found or found[-1].kind != "ended") and time.monotonic() < begun + 10:
        found += receiver.wait(0.1)
    receiver.close()
    log.close()
    assert [each.kind for each in found] == ["data", "disconnected", "ended"]
    assert found[-1].text == "gone; it did not come back within 0.2 s"


def test_a_tracker_ends_with_its_page_when_the_board_ends(run: object, tmp_path: Path) -> None:
    with served(pace=10.0) as server:

        def end() -> None:
            while not server._clients:  # the tracker is not connected yet
                time.sleep(0.05)
            time.sleep(1.0)
            server.close()

        Thread(target=end, daemon=True).start()
        status, out, err = run("track", url(server), "--reconnect", "0.3", "--out", tmp_path)  # type: ignore[operator]
    assert status == 0, err
    assert "the tracking ends if it is not back within 0.3 s" in out
    assert {"log.txt", "report.html", "state.json", "track.json"} <= {path.name for path in tmp_path.iterdir()}
    assert '"reason": "disconnected"' in (tmp_path / "track.json").read_text()


def test_sigterm_writes_the_page_as_ctrl_c_does(tmp_path: Path) -> None:
    with served(pace=1.0) as server:
        words = [sys.executable, "-m", "emsid", "track", url(server), "--json", "--out", str(tmp_path)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if '"estimate"' in line:
                    break
            process.send_signal(signal.SIGTERM)
            out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "emsid: ending; writing record and report\n")
    assert '"kind":"end"' in out.splitlines()[-1].replace(" ", "")
    assert {"log.txt", "record.csv", "report.html", "state.json"} <= {path.name for path in tmp_path.iterdir()}


def test_only_work_that_asks_for_it_is_answered_on_sigterm() -> None:
    interruption, answers = Interruption(), []
    with interruption.asked("ending", answers.append, by_sigterm=True):
        interruption.terminate()
        assert (interruption.pressed, answers) == (True, ["ending"])
        with pytest.raises(SystemExit, match="143"):
            interruption.terminate()  # the second one ends at once
    with interruption.asked("stopping"), pytest.raises(SystemExit, match="143"):
        interruption.terminate()
