"""A session of tracking: log, gaps, findings, states that go on, and what goes wrong."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from emsid import DataError, FormatError, Record, RecursiveLeastSquares, Structure, arx, friction_narx
from emsid.estimation import Control, Directional, Forgetting
from emsid.findings import Finding
from emsid.live.board import Board
from emsid.live.log import Log, read_from
from emsid.live.protocol import LineParser
from emsid.live.receiver import Piece, Receiver
from emsid.live.server import Server
from emsid.live.session import Session, Settings, messages
from emsid.live.sources import open_source, read_log
from emsid.live.tracking import Tracker
from emsid.plant import Bench
from emsid.wording import sentence
from emsid.wording.terms import meanings
from live_sessions import DT, PLAIN, Bytes, findings, lines, tracked, url


def test_the_estimate_over_time_has_many_points_also_where_a_file_comes_at_once(tmp_path: Path) -> None:
    session, _ = tracked(lines(600), folder=tmp_path)
    assert len(session.history.time) == 30
    assert np.all(np.diff(session.history.time) > 0)
    assert session.counts["samples"] == sum(len(record) for record, _ in session.recent) == 600


def test_a_source_without_faults_gives_no_finding(tmp_path: Path) -> None:
    absent = {"change-detected", "source-gap", "samples-not-tracked", "source-disconnected", "source-silent"}
    absent |= {"lines-not-used", "log-not-written", "tracking-errors-coloured", "nothing-excites"}
    session, found = tracked(lines(3000), folder=tmp_path, settings=Settings(0.1, patience=1, false_alarm=3600))
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
    assert (session.counts["samples"], session.counts["lost"], session.reason) == (3000, 0, "ended")
    record = read_log(tmp_path / "log.txt")
    assert (len(record), record.breaks, record.input_units, record.dt) == (3000, (), ("V",), pytest.approx(DT))


def test_errors_that_follow_each_other_are_said(tmp_path: Path) -> None:
    """A slow disturbance that the model does not have stays in its prediction errors."""
    rows = lines(3000).decode().splitlines()
    for k, row in enumerate(rows[1:], 1):
        before, _, y = row.rpartition(",")
        rows[k] = f"{before},{float(y) + np.sin(k / 10):.6f}"
    _, found = tracked("\n".join([*rows, ""]).encode(), folder=tmp_path)
    assert "tracking-errors-coloured" in findings(found)


@pytest.mark.parametrize("samples", [100, 1000])
def test_a_source_at_zero_volts_excites_nothing_and_that_is_said_once(tmp_path: Path, samples: int) -> None:
    noise = np.random.default_rng(0).standard_normal(samples)
    rows = [lines(2).decode().splitlines()[0], *(f"{k},{k * DT:.4f},0,{y:.6f}" for k, y in enumerate(noise))]
    session, found = tracked("\n".join([*rows, ""]).encode(), folder=tmp_path)
    assert findings(found).count("nothing-excites") == 1
    assert session.counts["samples"] == samples
    _, driven = tracked(lines(samples), folder=tmp_path / "driven")
    assert "nothing-excites" not in findings(driven)


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
    assert [change.kind for change in whole.changes] == [change.kind for change in pieces.changes]
    moments = [np.array([(change.time, change.since) for change in session.changes]) for session in (whole, pieces)]
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
    assert {"source-gap", "lines-not-used"} <= {finding.code for finding in session.findings}
    assert data in read_from(tmp_path / "log.txt")
    record = read_log(tmp_path / "log.txt")
    assert [len(segment) for segment in record.segments] == [299, 100, 49, 145]


def test_time_that_goes_backwards_is_a_gap(tmp_path: Path) -> None:
    session, found = tracked(lines(300), lines(300), folder=tmp_path)
    (gap,) = [each["data"] for each in found if each.get("code") == "source-gap"]
    assert (gap["cause"], gap["samples"]) == ("backwards", None)
    assert session.counts["samples"] == 600


def test_a_source_that_sends_nothing_is_reported_and_its_log_closed(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"has sent nothing yet; .*waited 0.3 s"):
        tracked(folder=tmp_path, end=TimeoutError())
    assert read_from(tmp_path / "log.txt").startswith(b"# emsid: begins")


def test_a_source_that_speaks_late_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a limit, however long it takes; it is said once that it waits, and what has come."""
    monkeypatch.setattr("emsid.live.session.SILENT", 0.1)
    begun = time.monotonic()

    class Late(Bytes):
        def read(self, timeout: float) -> bytes:
            if time.monotonic() - begun < 0.6:
                time.sleep(0.01)
                return b""
            return super().read(timeout)

    for sent, said in ((b"", "it has sent nothing yet"), (b"ready\n", "1 lines have come and none is a sample")):
        begun = time.monotonic()
        log, parser = Log(tmp_path / f"{len(sent)}.txt"), LineParser()
        session = Session(Tracker(RecursiveLeastSquares(arx(1, 1))), "board")
        receiver = Receiver(Late(lines(300)), log)
        if sent:
            parser.feed(sent)
        found = list(messages(session, receiver, parser, Settings(0.01), log))
        receiver.close()
        log.close()
        first, second = found[:2]
        assert (first["code"], second["kind"]) == ("source-awaited", "start")
        assert said in sentence(Finding(*(first[name] for name in ("code", "subject", "data"))))
        assert [each.get("code") for each in found].count("source-awaited") == 1
        assert session.counts["samples"] == 300


def test_terms_are_named_by_what_they_mean() -> None:
    record = Record(np.zeros(3), np.zeros(3), DT, ("voltage [V]",), ("speed",), ("V",), ("rad/s",))
    structure = friction_narx(1, 1, knots=(-0.5, 0.16), speeds=(4.48,))
    assert dict(zip(structure.parameter_names, meanings(structure, record), strict=True)) == {
        "a1": "speed, 1 sample before",
        "b1": "voltage, 1 sample before",
        "h1_1": "voltage below -0.5 V, 1 sample before",
        "h2_1": "voltage above 0.16 V, 1 sample before",
        "c0": "Coulomb friction, direction of speed",
        "c1": "Stribeck friction, fades over 4.48 rad/s",
        "offset": "offset",
    }
    product = Structure.parse("y(t-1)*u(t-2)^2", "sign(u(t))")
    assert meanings(product, record) == ("speed(t-1)*voltage(t-2)^2", "sign(voltage(t))")


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
    assert [len(segment) for segment in record.segments] == [99, 50]
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


def test_a_page_goes_on_while_many_pieces_wait() -> None:
    """Where the tracker is behind, one call to the receiver brings all of them."""
    rows = lines(8000).splitlines(keepends=True)

    class Behind:
        away, heard, pieces = (
            0.0,
            time.monotonic(),
            [Piece("data", b"".join(rows[k : k + 200])) for k in range(0, 8000, 200)],
        )

        def wait(self, timeout: float) -> list[Piece]:
            pieces, self.pieces = self.pieces, [Piece("ended")]
            return pieces

    session = Session(Tracker(RecursiveLeastSquares(arx(5, 5))), "board")
    found = list(messages(session, Behind(), LineParser(), Settings(every=1e-3)))  # type: ignore[arg-type]
    assert session.counts["samples"] == 8000 - 1
    assert sum(each["kind"] == "estimate" for each in found) > 10


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
