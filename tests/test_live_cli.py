"""`emsid track` and `emsid bench` on the command line."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest

from emsid import Record, RecursiveLeastSquares
from emsid import save as save_model
from emsid.cli.commands.track import structure_of
from emsid.estimation import Directional
from emsid.findings import Finding
from emsid.io import read
from emsid.live.board import Board
from emsid.live.server import Server
from emsid.live.session import pieces
from emsid.live.sources import read_log
from emsid.live.tracking import Tracker
from emsid.wording import sentence
from live_sessions import DT, PLAIN, SentBoard, lines, served, url

pytestmark = pytest.mark.usefixtures("ctrl_c_heard")


def test_track_a_file_writes_record_report_model_and_state(tmp_path: Path, run: object) -> None:
    (tmp_path / "log.csv").write_bytes(lines(4000, step=3500, dt=0.01))
    status, out, _ = run("track", tmp_path / "log.csv", "--forgetting", "0.995", "--out", tmp_path / "out")
    assert status == 0
    assert "4000 samples" in out
    assert out.count("has changed") == 1
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"record.csv", "report.html", "track.json", "state.json", "arx.json", "figures"}
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "<pre><span>y(t)</span>" in page
    assert ">Meaning</th>" in page
    assert ">u, 1 sample before</td>" in page
    assert page.index('id="last-samples"') < page.index('id="arx-tracking"')
    assert "b1: u, 1 sample before" in out
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
        (("--source", "socket://127.0.0.1:1", "--limit", "4V", "--patience", "0"), "patience of 0 s"),
    ):
        status, _, err = run("bench", "run", *wrong, "--out", tmp_path / "none.csv")
        assert (status, err.count("\n")) == (2, 1)
        assert message in err


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_bench_run_writes_what_it_recorded_and_says_so(tmp_path: Path, sent: signal.Signals) -> None:
    with served(pace=1.0) as server:
        words = ("bench", "run", "--source", url(server), "--limit", "4V", "--duration", "60", "--json")
        command = [sys.executable, "-m", "emsid", *words, "--out", str(tmp_path / "record.csv")]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            log, end = tmp_path / "record.log.txt", time.monotonic() + 60
            while time.monotonic() < end and not (log.exists() and log.stat().st_size > 2000):
                time.sleep(0.05)
            process.send_signal(sent)
            out, err = process.communicate(timeout=60)
        assert server.voltage == 0.0
    said = "emsid: stopping the motor\nemsid: the run was interrupted; what was recorded until then is written\n"
    assert (process.returncode, err) == (130, said)
    assert (json.loads(out)["reason"], json.loads(out)["at_zero"]) == ("interrupted", True)
    assert len(read(tmp_path / "record.csv", input="voltage", output="speed", time="t")) > 50
    assert not list(tmp_path.glob("*.tmp"))


def test_an_interrupted_bench_run_without_a_sample_says_that_nothing_is_confirmed(
    tmp_path: Path, run: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Silent(SentBoard):
        def write(self, data: bytes) -> None:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("emsid.live.sources.open_source", lambda *_: Silent(b""))
    monkeypatch.setattr("emsid.live.driving.CONFIRM", 0.1)
    words = ("--limit", "4V", "--patience", "30", "--out", tmp_path / "record.csv")
    status, out, err = run("bench", "run", "--source", "socket://127.0.0.1:1", *words)
    said = "emsid: interrupted; the board has sent no sample, so 0 V is not confirmed\n"
    assert (status, out, err) == (130, "", said)
    assert not (tmp_path / "record.csv").exists()


def test_tracking_a_file_that_is_interrupted_is_not_done(
    tmp_path: Path, run: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "log.csv").write_bytes(lines(4000, step=3500, dt=0.01))

    def pressed(record: Record) -> object:
        monkeypatch.setattr("emsid.live.session.pieces", pieces)
        os.kill(os.getpid(), signal.SIGINT)
        return pieces(record)

    monkeypatch.setattr("emsid.live.session.pieces", pressed)
    status, _, err = run("track", tmp_path / "log.csv", "--out", tmp_path / "out")
    assert (status, err.splitlines()[-1]) == (130, "emsid: tracking was interrupted; the results so far are written")
    assert json.loads((tmp_path / "out" / "track.json").read_text())["reason"] == "stopped"
    assert (tmp_path / "out" / "report.html").exists()


def test_bench_run_waits_for_a_server_that_starts_later(tmp_path: Path, run: object) -> None:
    """It says so in one line, and for how long; without a server it ends after this time."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    words = ("bench", "run", "--source", f"socket://127.0.0.1:{port}", "--limit", "4V", "--duration", "0.5")
    status, _, err = run(*words, "--patience", "0.2", "--out", tmp_path / "none.csv")
    assert (status, err.count("nothing listens there"), err.count("waiting 0.2 s for it")) == (2, 2, 1)

    server, ended = [], Event()

    def serve() -> None:
        time.sleep(0.4)
        server.append(Server(Board(PLAIN, DT), port=port, pace=20.0))
        server[0].run(ended.is_set)

    thread = Thread(target=serve)
    thread.start()
    try:
        status, out, err = run(*words, "--patience", "10", "--out", tmp_path / "record.csv")
    finally:
        ended.set()
        thread.join()
    assert (status, err.count("nothing listens there")) == (0, 1), err
    assert "the motor is at 0 V" in out


def test_bench_run_says_that_zero_volts_are_not_confirmed(
    tmp_path: Path, run: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = SentBoard(b"t,u,y\n", *(b"%.2f,1,0\n" % (0.01 * k) for k in range(40)))
    monkeypatch.setattr("emsid.live.sources.open_source", lambda *_: stuck)
    monkeypatch.setattr("emsid.live.driving.CONFIRM", 0.1)
    words = ("--limit", "4V", "--patience", "0.2", "--out", tmp_path / "record.csv")
    status, out, _ = run("bench", "run", "--source", "socket://127.0.0.1:1", *words)
    assert (status, out.count(sentence(Finding("motor-not-at-zero", "socket://127.0.0.1:1")))) == (1, 1)


def test_a_killed_tracker_leaves_a_log_that_reads(tmp_path: Path) -> None:
    """The short form of 50 kills in ``bench/live.py``; then Ctrl-C, after which everything is written."""
    with served(pace=1.0, dt=0.01) as server:
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
            assert record.time[-1] >= last["time"] - 1e-9
            assert (process.returncode == 0) is (end == signal.SIGINT), complaint
    assert (tmp_path / "report.html").exists()
    assert (tmp_path / "record.csv").exists()
    assert len(record.segments) >= 2  # both sessions, with a gap between


def test_models_that_are_not_regressions_are_not_tracked(tmp_path: Path, run: object) -> None:
    from emsid import PlantModel, plants
    from emsid.models.plants.grey_box import signals_of

    plant = plants.rigid_motor()
    model = PlantModel(plant, signals_of(plant, Record(np.zeros(9), np.zeros(9), 0.01)))
    save_model(model, tmp_path / "motor.json")
    (tmp_path / "log.csv").write_bytes(lines(100))
    status, _, err = run("track", tmp_path / "log.csv", "--structure", tmp_path / "motor.json", "--out", tmp_path / "o")
    assert (status, "not linear in its parameters" in err) == (2, True)
