"""Stamps that jitter beside rows that are really irregular: what a time column says about the rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.cli.reading import Reader
from emsid.first_look import describe
from emsid.record.time_axis import equidistant, on_timer, time_axis, timer_of

DT, N = 0.01, 2000
K = np.arange(N)
LEVELS = np.repeat(np.random.default_rng(3).uniform(-9, 9, N // 40), 40)
ANSWER = lfilter([0, 0.5], [1, -0.9], LEVELS)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


STAMPS = {
    "both sides": DT * K + rng().normal(0, 0.03 * DT, N),
    "late": DT * K + np.minimum(rng().exponential(0.1 * DT, N), 0.9 * DT),
    "in ms": np.round(0.0105 * K, 3),
    "in ms, at 400 Hz": np.floor(2.5 * K) * 1e-3,
}
RATES = {"in ms": 0.0105, "in ms, at 400 Hz": 0.0025}


@pytest.mark.parametrize("kind", STAMPS)
def test_rows_with_jittering_stamps_are_equidistant_with_the_rate_of_the_timer(kind: str) -> None:
    axis = time_axis(STAMPS[kind])
    assert axis.regular
    assert axis.dt == RATES.get(kind, DT)
    assert axis.stamp_error is not None
    assert axis.stamp_error < axis.dt / 2


def test_some_stamps_that_are_later_than_half_a_sample_do_not_move_the_rate() -> None:
    t = DT * K
    t[rng().choice(N, N // 5, replace=False)] += 0.8 * DT
    assert (time_axis(t).dt, time_axis(t).regular) == (DT, True)


@pytest.mark.parametrize("jitter", [0.0, 0.4])
def test_lost_rows_remain_a_gap_and_the_others_go_where_the_timer_sampled_them(jitter: float) -> None:
    true = np.delete(K, [700, 701, 1500])
    t = DT * (true + jitter * rng().uniform(-1, 1, len(true)))
    axis = time_axis(t)
    assert (axis.regular, axis.gaps, axis.duplicates, axis.dt) == (False, (700, 1498), (), DT)
    np.testing.assert_allclose(on_timer(t) - t[0], DT * true, atol=1e-4 * DT * N * jitter + 1e-9)
    frame = {"t": t, "u": LEVELS[true], "y": ANSWER[true]}
    record = emsid.Record.from_frame(frame, input="u", output="y", time="t", resample=True)
    np.testing.assert_array_equal(record.input[:, 0], LEVELS)
    assert np.max(np.abs(record.output[true, 0] - ANSWER[true])) < 1e-2  # not by the slope times the jitter, 1.6


def test_a_clock_that_drifts_and_rows_that_are_irregular_are_no_jitter() -> None:
    steps = DT * (1 + 0.3 * rng().uniform(-1, 1, N))
    drifting = np.cumsum(DT * (1 + 0.2 * K / N))
    for t in (np.cumsum(steps), drifting):
        assert timer_of(t) is None
        assert not time_axis(t).regular
        assert time_axis(t).dt == pytest.approx(t[-1] / N, rel=2e-3)  # the mean rate


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A motor whose rows a timer takes, stamped up to 6 % of a sample late or early."""
    path = tmp_path / "log.csv"
    stamps = 1e3 * (DT * K + rng().uniform(-6e-4, 6e-4, N))
    lines = (f"{t:.4f},{u:.4f},{y:.5f}\n" for t, u, y in zip(stamps, LEVELS, ANSWER, strict=True))
    path.write_text("time_ms,voltage,speed\n" + "".join(lines))
    return path


def test_a_file_with_jitter_is_read_as_with_its_sample_time(log: Path) -> None:
    by_time = emsid.read(log, input="voltage", output="speed", time="time_ms")
    by_dt = emsid.read(log, input="voltage", output="speed", dt=DT)
    assert by_time.dt == by_dt.dt
    np.testing.assert_array_equal(by_time.input, by_dt.input)
    np.testing.assert_array_equal(by_time.output, by_dt.output)
    (found,) = by_time.findings
    assert (found.code, found.data["dt"]) == ("clock-jitters", DT)
    assert found.data["deviation"] == pytest.approx(6e-4, rel=0.1)


def test_describe_proposes_neither_to_resample_nor_to_shift_for_jitter(log: Path) -> None:
    look = describe(log)
    assert {"time", "resample", "shift"} & set(look.reading) == {"time"}
    assert [finding.code for finding in look.findings].count("clock-jitters") == 1
    resampled = describe(log, resample=True)
    found = {finding.code for finding in resampled.findings}
    assert "data-resampled" in found
    assert not {"command-before-its-row", "feedback-likely"} & found
    assert "shift" not in resampled.reading


def test_resampling_keeps_levels_and_puts_each_step_into_the_nearest_row() -> None:
    t = np.cumsum(DT * (1 + 0.4 * rng().uniform(-1, 1, N)))
    u, y = equidistant(t, LEVELS[:, None], np.interp(t, DT * K, ANSWER)[:, None], DT)
    assert set(u[:, 0]) <= set(LEVELS)
    steps = t[1:][np.diff(LEVELS) != 0]
    found = t[0] + DT * (1 + np.flatnonzero(np.diff(u[:, 0])))
    late = found[: len(steps)] - steps[: len(found)]
    assert np.max(np.abs(late)) <= DT / 2 * (1 + 1e-9)
    assert abs(late.mean()) < 0.15 * DT  # holding the last value would be late by half a sample on average
    assert len(y) == len(u) == pytest.approx((t[-1] - t[0]) / DT, abs=1)


@pytest.mark.parametrize(
    ("time", "units"), [("time_ms", None), ("time_ms", {"time_ms": "ms"}), ("clock", {"clock": "ms"}), ("millis", None)]
)
def test_the_time_of_a_frame_has_a_unit_as_in_files(time: str, units: dict[str, str] | None) -> None:
    frame = {time: 1e3 * DT * K, "u": LEVELS, "y": ANSWER}
    for read in (emsid.Record.from_frame, emsid.read):
        record = read(frame, input="u", output="y", time=time, units=units)
        assert record.dt == DT
    with pytest.raises(emsid.DataError, match="time unit 'V' is not understood"):
        emsid.Record.from_frame(frame, input="u", output="y", time=time, units={time: "V"})


def test_a_file_with_a_clock_of_another_rate_is_not_read_with_the_sample_time_of_the_model(log: Path) -> None:
    remembered = {"input": ["voltage"], "output": ["speed"], "dt": 0.02}
    record = Reader({}, {}).after(remembered)(log)
    assert record.dt == DT
    found = {finding.code: finding.data for finding in record.findings}
    assert found["sample-time-of-file"] == {"column": "time_ms", "dt": DT, "before": 0.02}
    same = Reader({}, {}).after({**remembered, "dt": 0.01})(log)
    given = Reader({"dt": 0.02}, {}).after(remembered)(log)
    assert (same.dt, given.dt) == (0.01, 0.02)
    assert not {"sample-time-of-file"} & {finding.code for finding in (*same.findings, *given.findings)}
