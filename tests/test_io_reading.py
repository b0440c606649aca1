"""From a file to a record: every option does what it says, and every mistake is named with its place."""

from __future__ import annotations

import os
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import polars as pl
import pytest

from emsid.errors import DataError, EmsidError, FormatError
from emsid.io import READERS, read
from emsid.io.options_by_column import derivative
from emsid.record import Record

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str | bytes, name: str = "log.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return write


@pytest.fixture
def log(write: Write) -> Path:
    """Ten samples: t in s, u = 0 … 9, y = u²."""
    return write("t,u,y\n" + "".join(f"{0.1 * k:.1f},{k},{k * k}\n" for k in range(10)))


def failure(*arguments: Any, **options: Any) -> str:
    """The message of the error that reading ends in: one line, beginning with the file."""
    with pytest.raises(EmsidError) as caught:
        read(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{arguments[0]}: ")
    return message.removeprefix(f"{arguments[0]}: ")


def test_a_record_has_the_columns_asked_for(log: Path) -> None:
    record = read(log, input="u", output=["y", "t"], dt=0.1)
    assert record.times == (0.0,)
    assert (record.name, record.dt, record.input_names, record.output_names) == ("log.csv", 0.1, ("u",), ("y", "t"))
    np.testing.assert_array_equal(record.input[:, 0], np.arange(10))
    np.testing.assert_array_equal(record.output[:, 0], np.arange(10) ** 2)
    assert read(log, input="u", output=(), dt=0.1).output.shape == (10, 0)


@pytest.mark.parametrize(
    ("form", "separator"),
    [
        ("%Y-%m-%dT%H:%M:%S.%f", ","),
        ("%Y-%m-%d %H:%M:%S,%f", ";"),
        ("%Y-%m-%dT%H:%M:%S.%fZ", ","),
        ("%Y-%m-%dT%H:%M:%S.%f+02:00", "\t"),
        ("%d.%m.%Y %H:%M:%S.%f", ";"),
        ("%m/%d/%Y %H:%M:%S.%f", ","),
        ("%H:%M:%S.%f", ","),
    ],
)
def test_a_time_column_may_hold_moments(write: Write, form: str, separator: str) -> None:
    first = datetime(2026, 12, 31, 23, 59, 59)  # midnight, and the end of a year, are passed
    moments = [(first + timedelta(milliseconds=5 * k)).strftime(form) for k in range(400)]
    rows = [separator.join([moment, str(k), str(2 * k)]) for k, moment in enumerate(moments)]
    header = separator.join(["when", "u", "y"])
    record = read(write("\n".join([header, *rows])), input="u", output="y", time="when")
    assert record.dt == pytest.approx(5e-3, rel=1e-12)
    assert len(record) == 400
    rows[300] = rows[300].replace(":", ".")
    message = failure(write("\n".join([header, *rows])), input="u", output="y", time="when")
    assert message.startswith("column 'when' has no value in row 302 of the file, not a number")


def test_rows_are_data_rows(log: Path) -> None:
    record = read(log, input="u", output="y", time="t", rows=slice(3, 6))
    np.testing.assert_array_equal(record.input[:, 0], [3, 4, 5])
    assert record.times == (pytest.approx(0.3),)
    np.testing.assert_array_equal(read(log, input="u", output="y", dt=1, rows=slice(-2, None)).input[:, 0], [8, 9])


def test_scale_and_offset_then_unit(log: Path) -> None:
    record = read(
        log, input="u", output="y", dt=0.1, scale={"y": 2.0}, offset={"y": 1.0, "u": -1.0}, units={"y": "mV", "u": "V"}
    )
    np.testing.assert_allclose(record.channel("y"), (2 * np.arange(10.0) ** 2 + 1) * 1e-3)
    np.testing.assert_allclose(record.channel("u"), np.arange(10) - 1)
    assert (record.input_units, record.output_units) == (("V",), ("V",))


@pytest.mark.parametrize(
    ("direction", "signs"), [("0 0 1 1", [-1, -1, 1, 1]), ("-1 1 1 0", [-1, 1, 1, 0]), ("2 2 2 2", [1, 1, 1, 1])]
)
def test_a_column_takes_the_sign_of_its_direction_before_gain_and_offset(
    write: Write, direction: str, signs: list[int]
) -> None:
    rows = "".join(f"{k + 1},{k},{sign}\n" for k, sign in enumerate(direction.split()))
    record = read(
        write("u,y,dir\n" + rows), input="u", output="y", dt=1, direction={"u": "dir"}, scale={"u": 2}, offset={"u": 3}
    )
    np.testing.assert_array_equal(record.input[:, 0], 2 * np.multiply(signs, [1, 2, 3, 4]) + 3)


def test_a_counter_that_starts_again_is_made_continuous_before_gain_and_offset(write: Write) -> None:
    path = write("u,enc\n0,250\n1,254\n2,2\n3,\n4,10\n5,254\n")
    record = read(path, input="u", output="enc", dt=1, mask="enc IS NULL", wrap={"enc": 256}, scale={"enc": 2.0})
    np.testing.assert_array_equal(record.output[:, 0], [500, 508, 516, 532, 508])
    assert "there is no column 'x'" in failure(path, input="x", output="enc", dt=1, wrap={"x": 256})
    assert "wrap is given for 't', which is neither" in failure(path, input="u", output="enc", dt=1, wrap={"t": 256})
    assert "wrap of 'enc' is -1; give a positive" in failure(path, input="u", output="enc", dt=1, wrap={"enc": -1})


def test_a_column_is_moved_by_rows_together_with_its_direction(write: Write) -> None:
    path = write("u,y,dir\n1,1,0\n2,2,1\n3,3,1\n4,4,0\n")
    given: dict[str, Any] = {"input": "u", "output": "y", "dt": 1, "direction": {"u": "dir"}}
    for rows, u in ((-1, [2, 3, -4, -4]), (0, [-1, 2, 3, -4]), (2, [-1, -1, -1, 2])):
        record = read(path, **given, shift={"u": rows})
        np.testing.assert_array_equal(record.input[:, 0], u)
        np.testing.assert_array_equal(record.output[:, 0], [1, 2, 3, 4])
    assert "shift is given for 't', which is neither" in failure(path, **given, shift={"t": 1})
    for wrong in (0.5, 4, -4):
        assert f"shift of 'u' is {wrong:g}; give a whole number" in failure(path, **given, shift={"u": wrong})


def test_a_direction_is_a_column_of_few_values(log: Path) -> None:
    kwargs = {"input": "u", "output": "y", "dt": 1}
    assert "column 't' has" in failure(log, **kwargs, direction={"u": "t"})
    assert "which is no direction" in failure(log, **kwargs, direction={"u": "t"})
    assert "there is no column 'dir'" in failure(log, **kwargs, direction={"u": "dir"})
    assert "direction is given for 't', which is neither" in failure(log, **kwargs, direction={"t": "u"})


def test_counts_and_pwm_have_their_meaning(log: Path) -> None:
    record = read(
        log,
        input="u",
        output="y",
        dt=0.01,
        units={"u": "pwm", "y": "count/sample"},
        counts_per_revolution=621,
        supply_voltage=12,
        pwm_full_scale=9,
    )
    np.testing.assert_allclose(record.channel("u"), np.arange(10) * 12 / 9)
    np.testing.assert_allclose(record.channel("y"), np.arange(10.0) ** 2 * 2 * np.pi / 621 / 0.01)


def test_a_mask_cuts_the_record_into_segments(log: Path) -> None:
    record = read(log, input="u", output="y", time="t", mask="u = 3 OR y BETWEEN 49 AND 64")
    np.testing.assert_array_equal(record.input[:, 0], [0, 1, 2, 4, 5, 6, 9])
    assert record.breaks == (3, 6)
    np.testing.assert_allclose(record.times, [0.0, 0.4, 0.9])


def test_the_mask_sees_the_rows_taken_as_the_file_has_them(log: Path) -> None:
    record = read(log, input="u", output="y", dt=1, rows=slice(2, None), mask="u = min(u)", scale={"u": 100.0})
    np.testing.assert_array_equal(record.input[:, 0], np.arange(3, 10) * 100)


def test_what_is_left_out_may_be_anything(write: Write) -> None:
    path = write("state,u,y\nRUN,0,1\nERR,ERR,1\nRUN,2,\nRUN,3,4\nRUN,nan,4\nRUN,5,6\n")
    record = read(path, input="u", output="y", dt=1, mask="state = 'ERR' OR y IS NULL", rows=slice(None, 4))
    np.testing.assert_array_equal(record.input[:, 0], [0, 3])
    # a sample for which the mask cannot be evaluated is left out
    record = read(path, input="u", output="y", dt=1, mask="u > 4 OR y > 100", rows=slice(None, 4))
    np.testing.assert_array_equal(record.input[:, 0], [0, 3])


@pytest.mark.parametrize(
    ("row", "column", "message"),
    [
        ("3,ERR,9", "u", "column 'u' has 'ERR' in row 5 of the file, not a number"),
        ("3,,9", "u", "column 'u' has no value in row 5 of the file"),
        ("3,NaN,9", "u", "column 'u' has nan in row 5 of the file"),
        ("3,-inf,9", "u", "column 'u' has -inf in row 5 of the file"),
    ],
)
def test_what_is_no_number_is_named_with_its_row(write: Write, row: str, column: str, message: str) -> None:
    path = write(f"t,u,y\n1,2,3\n2,2,3\n# remark\n{row}\n4,2,3\n")
    assert message in failure(path, input=column, output="y", dt=1)
    assert len(read(path, input="t", output="y", dt=1)) == 4  # in a column not used
    assert len(read(path, input=column, output="y", dt=1, rows=slice(0, 2))) == 2  # in a row not used


def test_what_its_scale_makes_too_large_is_named_with_its_row(log: Path) -> None:
    message = failure(log, input="u", output="y", dt=1, rows=slice(2, None), scale={"y": 1e307})
    assert message == "column 'y' becomes inf in row 7 of the file by its scale 1e+307 and offset 0; give others"


class TestTime:
    def test_a_regular_column_gives_the_sample_time(self, log: Path) -> None:
        record = read(log, input="u", output="y", time="t")
        assert (record.dt, record.times) == (0.1, (0.0,))
        assert str(record.time_axis) == "10 samples, dt 100 ms, jitter 0 %, no gaps, no duplicates"
        assert read(log, input="u", output="y", dt=0.1).time_axis is None

    @pytest.mark.parametrize(
        ("header", "options", "dt"),
        [
            ("t", {}, 2.0),
            ("Timestamp(ms)", {}, 0.002),
            ("Timestamp [us]", {}, 2e-6),
            ("time_ms", {}, 0.002),
            ("t_s", {}, 2.0),
            ("millis", {}, 0.002),
            ("Micros", {}, 2e-6),
            ("Time (ms)", {"time_unit": "s"}, 2.0),
            ("t", {"time_unit": "min"}, 120.0),
        ],
    )
    def test_its_unit(self, write: Write, header: str, options: dict[str, Any], dt: float) -> None:
        path = write(f"{header},u,y\n0,1,1\n2,2,2\n4,3,3\n")
        assert read(path, input="u", output="y", time=header, **options).dt == pytest.approx(dt, rel=1e-12)

    def test_its_unit_in_a_row_of_units(self, write: Write) -> None:
        path = write("Time,u,y\n(ms),(V),(V)\n0,1,1\n2,2,2\n4,3,3\n")
        assert read(path, input="u", output="y", time="Time").dt == 0.002

    def test_dates_and_durations(self, tmp_path: Path) -> None:
        path = tmp_path / "log.parquet"
        k = pl.Series([0, 20, 40, 60])
        for unit in ("ms", "us", "ns"):
            when = (1_700_000_000_000 + k).cast(pl.Datetime("ms")).dt.cast_time_unit(unit)  # type: ignore[arg-type]
            pl.DataFrame({"when": when, "u": [1, 2, 3, 4], "y": [1, 2, 3, 4]}).write_parquet(path)
            assert read(path, input="u", output="y", time="when").dt == pytest.approx(0.02)
        pl.DataFrame({"when": k.cast(pl.Date), "u": [1, 2, 3, 4], "y": [1, 2, 3, 4]}).write_parquet(path)
        assert read(path, input="u", output="y", time="when").dt == 20 * 86400

    def test_none_at_all(self, log: Path, write: Write) -> None:
        message = failure(log, input="u", output="y")
        assert (
            message
            == "no sample time; give dt in seconds, or time, the column that holds it; 't' looks like the time column"
        )
        path = write("Pendulum\n(dt=10)\nu\ty\n1\t2\n3\t4\n", "a.dat")
        assert failure(path, input="u", output="y").endswith("the file says '(dt=10)' above its header (mind the unit)")
        path = write("dt\tdiv\tx\n10\t8\t1\nu\ty\n1\t2\n3\t4\n", "b.dat")
        assert "the file says 'dt div x / 10 8 1' above" in failure(path, input="u", output="y")
        path = write("Timestamp(ms),u,y\n1,2,3\n2,3,4\n", "c.csv")
        assert "'Timestamp(ms)' looks like the time column" in failure(path, input="u", output="y")

    def test_gaps_and_duplicates(self, write: Write) -> None:
        path = write("t,u,y\n" + "".join(f"{t},{t},0\n" for t in [0, 1, 2, 2, 3, 6, 7]))
        message = failure(path, input="u", output="y", time="t")
        assert "time column 't' is not regular: 7 samples, dt 1 s" in message
        assert "1 gap (at row 7 of the file, 3 s), 1 duplicate (at row 5 of the file)" in message
        assert "give resample" in message
        assert "or dt in its place" in message
        assert read(path, input="u", output="y", dt=1).dt == 1
        assert "1 gap (at row 7 of the file" in failure(path, input="u", output="y", time="t", rows=slice(3, None))
        resampled = read(path, input="u", output="y", time="t", resample=True)
        assert f": {resampled.time_axis}; give" in message

    def test_steps_that_differ_and_add_up(self, write: Write) -> None:
        times = np.cumsum(1 + 0.4 * np.random.default_rng(0).uniform(-1, 1, 200))
        path = write("t,u,y\n" + "".join(f"{t:.4f},0,{t:.4f}\n" for t in times))
        assert "is not regular: 200 samples, dt 1.0" in failure(path, input="u", output="y", time="t")

    def test_irregularities_in_what_is_left_out_do_not_count(self, write: Write) -> None:
        path = write("t,u,y\n" + "".join(f"{t},{k},0\n" for k, t in enumerate([0, 1, 2, 2, 3, 50, 51, 52])))
        record = read(path, input="u", output="y", time="t", mask="u IN (3, 4)")
        assert (record.dt, record.breaks, record.times) == (1.0, (3,), (0.0, 50.0))

    @pytest.mark.parametrize("turn", [2**16, 2**32])
    def test_a_counter_that_begins_at_zero_again_goes_on(self, write: Write, turn: int) -> None:
        steps = [turn - 40, turn - 20, 0, 20, 60, 80, 100, 120, 140, 160, 180]
        path = write("millis,u,y\n" + "".join(f"{t % turn},{k},0\n" for k, t in enumerate(steps)))
        record = read(path, input="u", output="y", time="millis", resample=True)
        assert (record.dt, record.breaks, len(record)) == (0.02, (), 12)
        assert "1 gap" in failure(path, input="u", output="y", time="millis")

    def test_a_clock_that_begins_again_elsewhere_does_not(self, write: Write) -> None:
        path = write("millis,u,y\n" + "".join(f"{20 * (k % 15)},{k},0\n" for k in range(30)))
        record = read(path, input="u", output="y", time="millis")
        assert (record.breaks, [found.code for found in record.findings]) == ((15,), ["clock-reset"])

    def test_text_in_it(self, write: Write) -> None:
        path = write("t,u,y\n0,1,1\nlater,2,2\n2,3,3\n")
        assert "column 't' has 'later' in row 3 of the file" in failure(path, input="u", output="y", time="t")

    def test_agreement_with_a_given_sample_time(self, log: Path) -> None:
        assert read(log, input="u", output="y", time="t", dt=0.1004).dt == 0.1004
        message = failure(log, input="u", output="y", time="t", dt=0.2)
        assert "time column 't' says a sample time of 0.1 s and dt is 0.2 s" in message

    def test_impossible_ones(self, log: Path) -> None:
        assert "sample time -1 s" in failure(log, input="u", output="y", dt=-1)
        assert "there is no column 'T'; did you mean 't'?" in failure(log, input="u", output="y", time="T")
        assert "time unit 'fortnight' is not understood; give one of" in failure(
            log, input="u", output="y", time="t", time_unit="fortnight"
        )
        assert "has 1 sample, and a sample time needs two" in failure(
            log, input="u", output="y", time="t", rows=slice(0, 1)
        )


class TestResampling:
    def test_jitter_goes(self, write: Write) -> None:
        t = np.arange(50) + 0.2 * np.sin(np.arange(50))
        path = write("t,u,y\n" + "".join(f"{a!r},{k},{2 * a!r}\n" for k, a in enumerate(t.tolist())))
        record = read(path, input="u", output="y", time="t", resample=True, dt=1.0)
        np.testing.assert_allclose(record.output[:, 0], 2 * record.time, atol=1e-9)
        assert record.dt == 1.0

    def test_a_long_gap_ends_a_segment_and_a_short_one_is_bridged(self, write: Write) -> None:
        t = [0, 1, 2, 3, 8, 9, 10, 11, 31, 32, 33]
        path = write("t,u,y\n" + "".join(f"{a},{a},{a}\n" for a in t))
        record = read(path, input="u", output="y", time="t", resample=True)
        assert (record.dt, record.breaks, record.times) == (1.0, (12,), (0.0, 31.0))
        np.testing.assert_allclose(record.output[:, 0], record.time)
        np.testing.assert_array_equal(record.input[:9, 0], [0, 1, 2, 3, 3, 3, 3, 3, 8])

    def test_segments_of_a_mask_stay_apart(self, write: Write) -> None:
        path = write("t,u,y\n" + "".join(f"{k + 0.1 * (k % 2)},{k},{k}\n" for k in range(12)))
        record = read(path, input="u", output="y", time="t", resample=True, dt=1, mask="u = 5")
        assert (record.breaks, record.times) == ((5,), (0.0, 6.0))

    def test_it_needs_a_time_column(self, log: Path) -> None:
        assert "resampling needs a time column" in failure(log, input="u", output="y", dt=1, resample=True)


class TestDerivative:
    def test_polynomials_to_the_third_degree_are_exact_to_the_edges(self) -> None:
        t = np.arange(40)[:, None] * 0.1
        np.testing.assert_allclose(derivative(t**3 - 2 * t, 0.1, 9), 3 * t**2 - 2, atol=1e-10)

    def test_its_bandwidth_is_the_one_stated(self) -> None:
        k = np.arange(4000)
        for frequency, loss in ((1 / 20, 0.01), (1 / 7, 1 - 10 ** (-3 / 20))):
            omega = 2 * np.pi * frequency
            slope = derivative(np.sin(omega * k)[:, None], 1.0, 9)[100:-100, 0]
            gain = np.sqrt(2 * np.mean(slope**2)) / omega
            assert gain == pytest.approx(1, abs=1.01 * loss)
            np.testing.assert_allclose(slope, gain * omega * np.cos(omega * k[100:-100]), atol=1e-3)  # no delay

    def test_a_position_becomes_a_speed(self, write: Write) -> None:
        t = np.arange(100) * 0.01
        path = write("q (mm),u\n" + "".join(f"{1e3 * np.sin(x)},0\n" for x in t.tolist()))
        record = read(path, input="u", output="d(q (mm))", dt=0.01, units={"q (mm)": "mm"})
        assert (record.output_names, record.output_units) == (("d(q (mm))",), ("m/s",))
        np.testing.assert_allclose(record.output[:, 0], np.cos(t), atol=1e-5)

    def test_position_and_speed_together(self, log: Path) -> None:
        record = read(log, input="u", output=["y", "d(y)"], dt=1, offset={"y": 5.0}, units={"d(y)": "rpm"})
        np.testing.assert_allclose(record.channel("d(y)"), 2 * np.arange(10) * np.pi / 30, atol=1e-12)
        np.testing.assert_allclose(record.channel("y"), np.arange(10) ** 2 + 5)

    def test_a_column_of_that_name_wins(self, write: Write) -> None:
        path = write("u,q,d(q)\n1,2,3\n4,5,6\n")
        np.testing.assert_array_equal(read(path, input="u", output="d(q)", dt=1).output[:, 0], [3, 6])

    def test_it_does_not_reach_across_what_is_left_out(self, write: Write) -> None:
        q = np.concatenate([np.arange(12), [1e9] * 3, 5 * np.arange(12), [1e9], np.arange(4)])
        path = write("u,q\n" + "".join(f"0,{x}\n" for x in q))
        record = read(path, input="u", output="d(q)", dt=1, mask="q > 1e6")
        # the last segment is shorter than the window
        assert (record.breaks, record.times) == ((12,), (0.0, 15.0))
        np.testing.assert_allclose(record.output[:, 0], [1] * 12 + [5] * 12)

    def test_a_noisy_one_is_smoothed_by_a_longer_window(self, write: Write) -> None:
        noise = np.random.default_rng(0).standard_normal(500)
        path = write("u,q\n" + "".join(f"0,{x}\n" for x in noise))
        short, long = (
            read(path, input="u", output="d(q)", dt=1, derivative_window=window).output.std() for window in (9, 31)
        )
        assert long < short / 4

    def test_impossible_ones(self, log: Path) -> None:
        assert "the longest segment has 5 samples, too few for a derivative over 9" in failure(
            log, input="u", output="d(y)", dt=1, rows=slice(0, 5)
        )
        assert "a derivative over 4 samples; give an odd number of at least 5" in failure(
            log, input="u", output="d(y)", dt=1, derivative_window=4
        )
        assert "there is no column 'z'" in failure(log, input="u", output="d(z)", dt=1)


class TestColumns:
    def test_misspelt(self, log: Path) -> None:
        assert (
            failure(log, input="U", output="y", dt=1) == "there is no column 'U'; did you mean 'u'?; there are t, u, y"
        )
        assert failure(log, input="torque", output="y", dt=1) == "there is no column 'torque'; there are t, u, y"

    def test_twice(self, log: Path) -> None:
        assert "column 'u' is named twice" in failure(log, input="u", output="u", dt=1)
        assert "column 'y' is named twice" in failure(log, input="u", output=["y", "y"], dt=1)

    def test_a_name_that_two_columns_have(self, write: Write) -> None:
        path = write("t,v,v\n0,1,2\n1,2,4\n2,0,1\n")
        assert failure(path, input="v", output="v", dt=1).endswith("every channel is one column; there is also v_2")
        assert read(path, input="v", output="v_2", dt=1).output[:, 0].tolist() == [2, 4, 1]

    def test_no_input(self, log: Path) -> None:
        assert "no input column" in failure(log, input=(), output="y", dt=1)

    @pytest.mark.parametrize("option", ["scale", "offset", "units"])
    def test_options_for_others(self, log: Path, option: str) -> None:
        value = "V" if option == "units" else 2.0
        message = failure(log, input="u", output="y", dt=1, **{option: {"Y": value}})
        assert (
            message
            == f"{option} is given for 'Y', which is neither input nor output; did you mean 'y'?; these are u, y"
        )

    def test_of_other_length(self, tmp_path: Path) -> None:
        path = tmp_path / "two.npz"
        np.savez(path, u1=np.zeros(5), y1=np.arange(5), u2=np.zeros(7), y2=np.ones(7), gain=3.0)
        assert len(read(path, input="u2", output="y2", dt=1, mask="y2 > 5")) == 7
        assert failure(path, input="u1", output="y2", dt=1) == "column 'u1' has 5 samples and 'y2' 7; they must agree"
        assert failure(path, input="u1", output="gain", dt=1).startswith("'gain' is no column: it is a single number")
        assert "(and, no columns: gain, a single number)" in failure(path, input="u1", output="y3", dt=1)
        # a mask sees the columns of the same length
        assert "uses 'y2', which is no column" in failure(path, input="u1", output="y1", dt=1, mask="y2 > 0")

    def test_rows(self, log: Path) -> None:
        assert failure(log, input="u", output="y", dt=1, rows=slice(20, 30)) == (
            "rows 20:30 select nothing of 10 rows; give A:B with 0 ≤ A < B ≤ 10"
        )
        assert "without a step" in failure(log, input="u", output="y", dt=1, rows=slice(0, 9, 2))

    def test_units(self, log: Path) -> None:
        assert "unit 'Volt-ish' is not understood" in failure(log, input="u", output="y", dt=1, units={"u": "Volt-ish"})
        assert "give counts_per_revolution" in failure(log, input="u", output="y", dt=1, units={"y": "count/sample"})

    def test_overflow(self, log: Path) -> None:
        assert "column 'y' becomes inf in row 4 of the file by" in failure(
            log, input="u", output="y", dt=1, scale={"y": 1e308}
        )


class TestMask:
    @pytest.mark.parametrize(
        ("mask", "kept"),
        [
            ("abs(u - 5) > 2", [3, 4, 5, 6, 7]),
            ("NOT (u >= 2 AND u <= 3)", [2, 3]),
            ('"u" <> 4', [4]),
            ("u % 2 = 1", [0, 2, 4, 6, 8]),
            ("u / 2 > 1.0", [0, 1, 2]),
            ("u IN (0, 1, 2, 3) OR y >= 36", [4, 5]),
            ("u != -1e0 AND u>3", [0, 1, 2, 3]),
            ("y > avg(y) + 0.5*stddev(y)", [0, 1, 2, 3, 4, 5, 6]),
            ("u = -1", list(range(10))),
            ("u = 1 OR u = 2 AND y = 0 OR NOT u < 8", [0, 2, 3, 4, 5, 6, 7]),
            ("(u = 1 OR u = 2) AND (y = 4)", [0, 1, 3, 4, 5, 6, 7, 8, 9]),
            ("u BETWEEN 1 AND 3 AND y BETWEEN 2 AND 5 OR u NOT BETWEEN 1 AND 7", [1, 3, 4, 5, 6, 7]),
            ("NOT NOT u = 1 AND NOT(u = 2)", [0, 2, 3, 4, 5, 6, 7, 8, 9]),
            ("(u = 3) <> (y IN (9, 16))", [0, 1, 2, 3, 5, 6, 7, 8, 9]),
        ],
    )
    def test_conditions(self, log: Path, mask: str, kept: list[int]) -> None:
        np.testing.assert_array_equal(read(log, input="u", output="y", dt=1, mask=mask).input[:, 0], kept)

    @pytest.mark.parametrize(
        ("mask", "message"),
        [
            ("u > -1", "leaves none of 10 samples; relax it"),
            ("true", "leaves none of 10 samples"),
            ("v > 1", "uses 'v', which is no column; there are t, u, y"),
            ("Motor_Speed(RPM) > 1", "uses a function 'Motor_Speed', which is none of abs"),
            ("u >", "is not understood"),
            ("", "is not understood"),
            ("u", "is not true or false; write a condition"),
            ("u > 'a'", "is not understood"),
            ("abs(u > 3", "is not understood"),
            ("u > 1; y > 2", "is not understood from '; y > 2' on"),
            ("u > 1 -- y", "is not understood from '-- y' on"),
            ("u > 1 /* */", "is not understood"),
            ("u > (SELECT max(u) FROM y)", "uses 'SELECT', which is no column"),
            ("u IN (select c from read_csv('{log}'))", "which is no column"),
            ("u IN (table (read_csv('{log}')))", "uses a function 'table'"),
            ("u IN (E'a\\'b')", "is not understood"),
            ("u > least()", "uses 'least', which is no column"),
            ("u > $$1$$", "is not understood"),
            ("u > 1) OR (u > 2", "closes a bracket that none has opened"),
            ("u > 1 t OR u > 3", "is not understood"),
            ("u = 1 OR", "is not understood"),
            ("AND u = 1", "is not understood"),
            ("u = 1 OR y", "is not understood"),
            ("u = 1 AND NOT", "is not understood"),
            ("u BETWEEN 1 OR u = 2 AND 3", "is not understood"),
            ("(" * 31 + "u = 1" + ")" * 31, "30 brackets in brackets; mark these samples in a column of their own"),
            ("u = 1" + "+ 1" * 200, "has more than 100 operators between two ANDs or ORs; divide it"),
            (" OR ".join(["u = 1"] * 10_000), "is too long: more than 20,000 names, numbers and operators"),
        ],
    )
    def test_what_is_none(self, log: Path, mask: str, message: str) -> None:
        told = failure(log, input="u", output="y", dt=1, mask=mask.replace("{log}", str(log)))
        assert told.startswith(("the mask '", 'the mask "'))
        assert message in told

    @pytest.mark.parametrize(
        ("mask", "kept"),
        [
            ("isnan(u)", [0, 3, 4, 5]),
            ("NOT isfinite(u)", [0, 5]),
            ("isnan(u) OR isnan(y)", [0, 4, 5]),
            ("isfinite(u + y) AND u < 5", [1, 2, 3, 4, 5]),
        ],
    )
    def test_values_that_are_missing_or_no_number(self, write: Write, mask: str, kept: list[int]) -> None:
        path = write("u,y,k\n0,0,0\n,1,1\nnan,2,2\ninf,nan,3\n-inf,4,4\n5,5,5\n")
        record = read(path, input="k", output=(), dt=1, mask=mask)
        np.testing.assert_array_equal(record.input[:, 0], kept)

    def test_long_ones_take_a_time_in_proportion(self, log: Path) -> None:
        begin = perf_counter()
        mask = " OR ".join(f"(u = {k} AND NOT y < {k})" for k in range(1, 1500))
        np.testing.assert_array_equal(read(log, input="u", output="y", dt=1, mask=mask).input[:, 0], [0])
        assert perf_counter() - begin < 5  # it took minutes when the expression was as deep as long

    def test_files_stay_closed(self, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(*_: object, **__: object) -> None:
            pytest.fail("the mask came through to polars")

        monkeypatch.setattr(pl, "sql_expr", refuse)
        for mask in (
            f"u IN (SELECT t FROM read_csv('{log}'))",
            f"u IN (-- '\nSELECT t FROM read_csv('{log}') -- ')",
            f"u IN (/* \" */ SELECT t FROM read_csv('{log}') /* \" */)",
            f"u = 1 OR EXISTS(FROM read_parquet('{log}'))",
        ):
            failure(log, input="u", output="y", dt=1, mask=mask)

    def test_a_name_with_brackets_goes_into_quotes(self, write: Write) -> None:
        path = write("Speed (rpm),u\n1,2\n3,4\n5,6\n")
        record = read(path, input="u", output="Speed (rpm)", dt=1, mask='"Speed (rpm)" > 4')
        assert len(record) == 2


class TestFiles:
    def test_missing(self, log: Path) -> None:
        path = log.with_name("lag.csv")
        assert failure(path, input="u", output="y", dt=1) == "there is no such file; did you mean log.csv?"
        nowhere = log.parent / "nowhere" / "x.csv"
        assert "there is no such file; nor a folder" in failure(nowhere, input="u", output="y", dt=1)

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name here")
    def test_a_pipe_that_may_never_end(self, tmp_path: Path) -> None:
        path = tmp_path / "pipe.csv"
        os.mkfifo(path)
        assert "a pipe or a device, which may never end; name a file" in failure(path, input="u", output="y", dt=1)
        assert "a pipe or a device" in failure(Path(os.devnull), input="u", output="y", dt=1)

    @pytest.mark.skipif(not Path("/dev/fd").exists(), reason="open files have no names here")
    def test_a_pipe_that_is_open_already(self, tmp_path: Path) -> None:
        reading, writing = os.pipe()
        os.write(writing, b"u,y\n1,2\n2,3\n")
        os.close(writing)
        path = tmp_path / "pipe.csv"
        path.symlink_to(f"/dev/fd/{reading}")
        assert len(read(path, input="u", output="y", dt=1)) == 2
        os.close(reading)

    def test_folder(self, log: Path) -> None:
        assert failure(log.parent, input="u", output="y", dt=1) == "this is a folder; name a file in it"

    def test_empty(self, write: Write) -> None:
        assert "the file is empty" in failure(write(""), input="u", output="y", dt=1)

    def test_suffix(self, write: Write) -> None:
        message = failure(write("u,y\n1,2\n\x00", "log.doc"), input="u", output="y", dt=1)
        assert message == f"no reader for the suffix '.doc'; there are {', '.join(READERS)}, also packed (.csv.gz)"
        assert len(read(write("u,y\n1,2\n", "LOG.CSV"), input="u", output="y", dt=1)) == 1

    @pytest.mark.parametrize("suffix", [".mat", ".parquet", ".npz"])
    def test_another_kind_under_this_name(self, write: Write, suffix: str) -> None:
        message = failure(write("u,y\n1,2\n", f"log{suffix}"), input="u", output="y", dt=1)
        assert "it looks like text: give it its right suffix" in message

    def test_unreadable(self, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def denied(_: Path) -> bytes:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(Path, "read_bytes", denied)
        assert "cannot be read (permission denied)" in failure(log, input="u", output="y", dt=1)

    def test_no_columns(self, tmp_path: Path) -> None:
        path = tmp_path / "empty.npz"
        np.savez(path, gain=1.0)
        assert failure(path, input="u", output="y", dt=1) == (
            "there is no column in this file (and, no columns: gain, a single number); name another"
        )

    def test_errors_are_of_the_right_kind(self, log: Path) -> None:
        with pytest.raises(FormatError):
            read(log.with_suffix(".npz"), input="u", output="y", dt=1)
        with pytest.raises(DataError):
            read(log, input="u", output="z", dt=1)


def test_reading_twice_gives_the_same(log: Path) -> None:
    first, second = (read(log, input="u", output="y", time="t") for _ in range(2))
    assert isinstance(first, Record)
    np.testing.assert_array_equal(first.output, second.output)
