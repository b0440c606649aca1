"""Bad rows, channels in several files, clocks that begin again, filters, implausible sample times, and codes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.errors import DataError
from emsid.findings import Finding
from emsid.identification.candidates import Options
from emsid.identification.task import codes_of_channel, unused_requests
from emsid.models.plants.drive import Bridge
from emsid.record import Record, concatenate

Rows = Callable[[dict[int, str]], Path]
COLUMNS = {"input": "u", "output": "y"}
MESSAGE = "[RxCallback]Communication Status #: 6"


@pytest.fixture
def log(tmp_path: Path) -> Rows:
    """A file of 200 rows t, u, y with other texts before (a message) or in place of (anything else) some rows."""

    def write(strange: dict[int, str]) -> Path:
        lines = ["t,u,y"]
        for k in range(200):
            row = f"{0.01 * k:.2f},{k % 7},{k}"
            lines += [strange[k], row] if strange.get(k) == MESSAGE else [strange.get(k, row)]
        path = tmp_path / "log.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def codes(record: Record) -> list[str]:
    return [finding.code for finding in record.findings]


class TestBadRows:
    def test_a_message_is_shown_with_its_row_and_what_helps(self, log: Rows) -> None:
        with pytest.raises(DataError, match="row 152 of the file has 1 value where the others have 3") as caught:
            emsid.read(log({150: MESSAGE}), **COLUMNS, time="t")
        assert MESSAGE in str(caught.value)
        assert caught.value.arguments == ("skip_bad_rows",)

    def test_rows_before_it_are_read(self, log: Rows) -> None:
        path = log({150: MESSAGE})
        assert len(emsid.read(path, **COLUMNS, time="t", rows=slice(0, 150))) == 150
        assert len(emsid.read(path, **COLUMNS, time="t", rows=slice(151, None))) == 49
        with pytest.raises(DataError, match="row 152"):
            emsid.read(path, **COLUMNS, time="t", rows=slice(100, 160))

    def test_a_message_takes_the_place_of_no_sample(self, log: Rows) -> None:
        record = emsid.read(log({150: MESSAGE}), **COLUMNS, time="t", skip_bad_rows=True)
        assert (len(record), record.breaks) == (200, ())
        data = {"count": 1, "rows": 201, "line": 152, "text": MESSAGE, "messages": 1}
        assert record.findings == (Finding("rows-skipped", "log.csv", data),)

    @pytest.mark.parametrize("damaged", ["1.50,3", "1.50,3,?", "1.50,3,ERR", "1.50,3,4,5"])
    def test_another_one_is_a_sample_that_is_missing(self, log: Rows, damaged: str) -> None:
        record = emsid.read(log({150: damaged}), **COLUMNS, dt=0.01, skip_bad_rows=True)
        assert (len(record), record.breaks, record.times) == (199, (150,), (0.0, 1.51))
        assert record.findings[0].data["line"] == 152

    def test_a_message_after_the_last_row(self, log: Rows) -> None:
        path = log({})
        path.write_text(path.read_text() + MESSAGE + "\n")
        with pytest.raises(DataError, match="row 202"):
            emsid.read(path, **COLUMNS, time="t")
        assert len(emsid.read(path, **COLUMNS, time="t", rows=slice(0, 199))) == 199

    def test_a_good_file_has_no_finding(self, log: Rows) -> None:
        assert emsid.read(log({}), **COLUMNS, time="t", skip_bad_rows=True).findings == ()

    def test_too_many_are_not_skipped(self, log: Rows) -> None:
        with pytest.raises(
            DataError, match=r"6 of 200 rows have no number in a column in use \(3 %\); at most 2 % are skipped"
        ):
            emsid.read(log({10 * k: "1,x,2" for k in range(1, 7)}), **COLUMNS, time="t", skip_bad_rows=True)


def test_channels_in_files_without_header(tmp_path: Path) -> None:
    for name, factor in (("x.csv", 1), ("y.csv", 2)):
        (tmp_path / name).write_text("".join(f"{factor * k},7\n" for k in range(20)))
    record = emsid.read(tmp_path / "y.csv", input="x.csv:1", output="y.csv:1", dt=0.1, units={"x": "mV"})
    assert (record.input_names, record.output_names, record.input_units) == (("x",), ("y",), ("V",))
    np.testing.assert_allclose(record.input[:, 0] * 2000, record.output[:, 0])
    with pytest.raises(DataError, match=r"the time is a column of every file .* give its name alone, '2'"):
        emsid.read(tmp_path / "y.csv", input="x.csv:1", output="y.csv:1", time="x.csv:2")
    with pytest.raises(DataError, match=r"x.csv: there is no column '3'; there are c1, c2"):
        emsid.read(tmp_path / "y.csv", input="x.csv:3", output="y.csv:1", dt=0.1)


def test_channels_in_files_with_header(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,value\n" + "".join(f"{k},{k}\n" for k in range(20)))
    (tmp_path / "b.csv").write_text("t,value\n" + "".join(f"{k},{-k}\n" for k in range(20)))
    record = emsid.read(tmp_path / "b.csv", input="a.csv:value", output="value", time="t")
    assert (record.input_names, record.output_names, record.dt) == (("a.csv:value",), ("value",), 1.0)
    np.testing.assert_array_equal(record.input, -record.output)
    (tmp_path / "a.csv").write_text("value\n1\n2\n3\n")
    with pytest.raises(DataError, match="has 3 samples and 'value' 20; they must agree"):
        emsid.read(tmp_path / "b.csv", input="a.csv:value", output="value", time="t")


def test_a_channel_has_the_unit_of_its_own_file(tmp_path: Path) -> None:
    """Both files have units in a row under the header; the column has the same name in both."""
    for name, units in (("a.csv", "s,V"), ("b.csv", "s,rad/s")):
        (tmp_path / name).write_text(f"t,value\n{units}\n" + "".join(f"{k},{k}\n" for k in range(20)))
    record = emsid.read(tmp_path / "b.csv", input="a.csv:value", output="value", time="t")
    assert (record.input_units, record.output_units) == (("V",), ("rad/s",))


def test_files_with_other_times_are_brought_to_those_of_the_output(tmp_path: Path) -> None:
    """The input is held and the output keeps its samples, whichever file is named first."""
    fast, slow = tmp_path / "u.csv", tmp_path / "y.csv"
    fast.write_text("t,u\n" + "".join(f"{0.25 * k},{k}\n" for k in range(40)))
    slow.write_text("t,y\n" + "".join(f"{0.6 * k + 0.1:.1f},{-k}\n" for k in range(20)))
    for path, names in (
        (slow, {"input": "u.csv:u", "output": "y"}),
        (fast, {"input": "u", "output": "y.csv:y"}),
        (fast, {"input": "u.csv:u", "output": "y.csv:y"}),
    ):
        record = emsid.read(path, **names, time="t")
        assert (record.dt, record.times) == (0.6, (0.1,))
        np.testing.assert_array_equal(record.output[:, 0], -np.arange(17.0))  # up to the last input
        middle = 0.6 * np.arange(17) + 0.1 + 0.3  # of each row, in which a command holds that is sent before it
        np.testing.assert_array_equal(record.input[:, 0], np.minimum(np.floor(middle / 0.25 + 1e-9), 39))
    slow.write_text("t,y\n" + "".join(f"{k + 100},{k}\n" for k in range(20)))
    with pytest.raises(DataError, match="have no time in common"):
        emsid.read(slow, input="u.csv:u", output="y", time="t")
    for path, name in ((fast, "u"), (slow, "y")):
        path.write_text(f"t,{name}\n" + "".join(f"2024-05-01 12:00:{k + (name == 'y'):02d},{k}\n" for k in range(20)))
    with pytest.raises(DataError, match=r"the times in 't' of u\.csv and y\.csv differ"):
        emsid.read(slow, input="u.csv:u", output="y", time="t")


def test_a_clock_that_begins_again_divides_the_record(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,u,y\n" + "".join(f"{0.1 * (k % 30):.1f},{k},{k}\n" for k in range(90)))
    record = emsid.read(path, **COLUMNS, time="t")
    assert (record.breaks, record.times, record.dt) == ((30, 60), (0.0, 0.0, 0.0), 0.1)
    assert record.findings == (Finding("clock-reset", "log.csv", {"count": 2, "column": "t", "line": 32}),)
    resampled = emsid.read(path, **COLUMNS, time="t", resample=True)
    assert (resampled.breaks, codes(resampled)) == ((30, 60), ["clock-reset", "data-resampled"])
    path.write_text("t,u,y\n" + "".join(f"{0.1 * k - (k == 40):.1f},{k},{k}\n" for k in range(90)))  # one wrong time
    with pytest.raises(DataError, match="1 gap"):
        emsid.read(path, **COLUMNS, time="t")


def test_a_board_that_is_reset_twice_divides_the_record(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    times = [0.1 * k for k in (*range(50), *range(3), *range(40))]
    path.write_text("t,u,y\n" + "".join(f"{t:.1f},{k},{k}\n" for k, t in enumerate(times)))
    record = emsid.read(path, **COLUMNS, time="t")
    assert (record.breaks, codes(record)) == ((50, 53), ["clock-reset"])
    times[50:53] = [2.0, 2.1, 2.2]  # a time in the middle is no beginning
    path.write_text("t,u,y\n" + "".join(f"{t:.1f},{k},{k}\n" for k, t in enumerate(times)))
    with pytest.raises(DataError, match="not regular"):
        emsid.read(path, **COLUMNS, time="t")


@pytest.mark.parametrize(("dt", "questioned"), [(10.048, True), (1e-8, True), (10.048e-3, False), (1.0, False)])
def test_an_implausible_sample_time_is_questioned(log: Rows, dt: float, questioned: bool) -> None:
    record = emsid.read(log({}), **COLUMNS, dt=dt)
    assert record.findings == ((Finding("sample-time-implausible", "log.csv", {"dt": dt}),) if questioned else ())


def test_findings_of_joined_records_are_joined(log: Rows) -> None:
    slow = emsid.read(log({}), **COLUMNS, dt=10)
    other = emsid.read(log({5: MESSAGE}), **COLUMNS, dt=10, skip_bad_rows=True)
    assert codes(concatenate([slow, other])) == ["sample-time-implausible", "rows-skipped"]
    assert codes(slow[:20]) == ["sample-time-implausible"]


def test_filter_then_decimate_then_detrend(tmp_path: Path) -> None:
    t = 0.001 * np.arange(4000)
    slow, fast = np.sin(2 * np.pi * 2 * t), np.sin(2 * np.pi * 150 * t)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([slow + fast, slow + 5 + fast]), delimiter=",", header="u,y", comments="")
    record = emsid.read(path, **COLUMNS, dt=0.001, filter=30.0, decimate=4, detrend=0)
    assert (len(record), record.dt) == (1000, 0.004)
    filtered, subtracted = {"cutoff": 30.0, "factor": 4}, {"order": 0}
    assert [(finding.code, finding.data) for finding in record.findings] == [
        ("data-filtered", filtered),
        ("data-detrended", subtracted),
    ]
    assert emsid.read(path, **COLUMNS, dt=0.001, decimate=1).findings == ()
    np.testing.assert_allclose(record.input[50:-50, 0], slow[::4][50:-50], atol=2e-3)
    np.testing.assert_allclose(record.output, record.input, atol=1e-3)
    with pytest.raises(DataError, match="a cutoff of 600 Hz; give one between 0 and 500 Hz"):
        emsid.read(path, **COLUMNS, dt=0.001, filter=600)
    with pytest.raises(DataError, match="a segment of 10 samples is too short to filter"):
        emsid.read(path, **COLUMNS, dt=0.001, filter=60, rows=slice(0, 10))


def test_a_low_pass_filter_halves_the_amplitude_at_its_cutoff() -> None:
    u = np.sin(2 * np.pi * 0.05 * np.arange(4000))
    filtered = Record(u, dt=1.0).lowpass(0.05).input[500:-500, 0]
    np.testing.assert_allclose(filtered, u[500:-500] / 2, atol=1e-6)


class TestCodes:
    """Codes are compared with the numbers of the file, as a mask is."""

    @pytest.fixture
    def record(self, tmp_path: Path) -> Record:
        path = tmp_path / "log.csv"
        pwm = [[100, 255, 1000, -40][k // 10 % 4] for k in range(200)]
        path.write_text("PWM,y\n" + "".join(f"{u},{k % 13}\n" for k, u in enumerate(pwm)))
        return emsid.read(path, input="PWM", output="y", dt=0.01, units={"PWM": "pwm"}, supply_voltage=12)

    def test_they_become_values_of_the_channel(self, record: Record) -> None:
        options = codes_of_channel(Options(codes=((1000.0, Bridge.BRAKE), (999.0, Bridge.COAST))), record)
        (brake, _), (coast, _) = options.codes
        assert np.count_nonzero(record.input[:, 0] == brake) == 50
        assert brake == pytest.approx(1000 * 12 / 255)
        assert coast == pytest.approx(999 * 12 / 255)

    def test_only_one_that_is_not_in_the_file_never_occurs(self, record: Record) -> None:
        options = Options(codes=((1000.0, Bridge.BRAKE), (999.0, Bridge.COAST)))
        findings = unused_requests({"rigid-motor": emsid.plants.rigid_motor()}, ["rigid-motor"], options, record)
        absent = [finding for finding in findings if finding.code == "code-never-occurs"]
        assert absent == [Finding("code-never-occurs", "PWM", {"value": 999.0})]

    def test_a_record_made_by_hand_has_the_numbers_of_its_channel(self) -> None:
        record = Record([1.0, 47.0], [0.0, 0.0], dt=0.1)
        assert record.converted("u1", 47.0) == 47.0

    def test_scaling_a_record_of_a_file_keeps_the_relation(self, record: Record) -> None:
        assert record.scale("PWM", 2.0, 1.0).converted("PWM", 1000.0) == pytest.approx(2 * 1000 * 12 / 255 + 1)


def test_the_derivative_of_a_column_of_another_file(tmp_path: Path) -> None:
    t = 0.01 * np.arange(40)
    (tmp_path / "u.csv").write_text("\n".join(map(str, t)))
    (tmp_path / "y.csv").write_text("\n".join(map(str, t**2)))
    record = emsid.read(tmp_path / "u.csv", input="u.csv:1", output=("d(y.csv:1)", "y.csv:1"), dt=0.01)
    assert record.output_names == ("d(y)", "y")
    np.testing.assert_allclose(record.output[:, 0], 2 * t, atol=1e-6)
