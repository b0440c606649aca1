"""The first look at a file: its form, the roles of its columns, its clock, and several files at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal

import emsid
from emsid.errors import DataError
from emsid.first_look import describe, describe_files
from emsid.first_look.together import statistic
from first_look_records import N, Run, T, U, Write, Y, codes, data, proposals, table

# --- form and roles --------------------------------------------------------------------------------------------------


def german() -> str:
    rows = (f"{t:.2f};{u:.3f};{y:.5f}".replace(".", ",") for t, u, y in zip(T, U, Y, strict=True))
    return "Zeit;Spannung;Drehzahl\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("text", "encoding", "name", "reading"),
    [
        (german(), "utf-8-sig", "log.csv", {"input": "Spannung", "output": "Drehzahl", "time": "Zeit"}),
        (table("\t", T, "t\tu\ty\n"), "utf-16", "log.csv", {"input": "u", "output": "y", "time": "t"}),
        (table(" ", T), "utf-8", "log.txt", {"input": "c2", "output": "c3", "time": "c1"}),
        (
            table(",", 1718e9 + 1e3 * T, "timestamp,cmd,vel\n"),
            "utf-8",
            "log.csv",
            {"input": "cmd", "output": "vel", "time": "timestamp", "time_unit": "ms"},
        ),
        (
            table(",", 1e3 * T, "time,voltage,speed\n(ms),(V),(rpm)\n"),
            "utf-8",
            "log.csv",
            {"input": "voltage", "output": "speed", "units": {"voltage": "V", "speed": "rpm"}, "time": "time"},
        ),
        (table(",", T % 2, "t,u,y\n"), "utf-8", "log.csv", {"input": "u", "output": "y", "time": "t"}),
        (
            table(",", T + (T > 3), "t,u,y\n"),
            "utf-8",
            "a.csv",
            {"input": "u", "output": "y", "time": "t", "resample": True},
        ),
    ],
    ids=["German", "UTF-16", "no header", "milliseconds", "row of units", "resets", "gap"],
)
def test_a_file_of_any_form_is_read_by_guesses(
    write: Write, text: str, encoding: str, name: str, reading: dict[str, object]
) -> None:
    path = write(text, name, encoding)
    look = describe(path)
    assert look.reading == reading
    assert look.record is not None
    assert look.record.dt == pytest.approx(0.01)
    assert look.response.sign == 1
    assert look.response.delay == 1
    np.testing.assert_array_equal(emsid.read(path, **look.reading).output, look.record.output)
    assert ("time-unit-assumed" in codes(look)) is ("time_unit" in reading)
    assert ("clock-irregular" in codes(look)) is ("resample" in reading)


def test_what_is_given_is_not_guessed(write: Write) -> None:
    path = write({"t": T, "u": U, "y": Y})
    look = describe(path, dt=0.02, output="t")
    assert look.reading == {"input": look.roles.input, "output": "t", "dt": 0.02}
    assert describe(path, rows=slice(0, 100)).record is not None
    with pytest.raises(DataError, match="there is no column 'speed'"):
        describe(path, input="u", output="speed")


def test_columns_may_be_given_without_their_units(write: Write) -> None:
    path = write({"t [s]": T, "a [V]": U, "b (rpm)": Y, "b2": -Y})
    look = describe(path, input="a", output="b", time="t", scale={"b": -1.0}, mask="abs(b) > 1e6")
    assert (look.roles.input, look.roles.output) == ("a [V]", "b (rpm)")
    assert {name: look.reading[name] for name in ("input", "output", "time", "scale", "units")} == {
        "input": "a [V]",
        "output": "b (rpm)",
        "time": "t [s]",
        "scale": {"b (rpm)": -1.0},
        "units": {"a [V]": "V", "b (rpm)": "rpm"},
    }
    assert look.record is not None
    assert look.record.output_units == ("rad/s",)
    two = write({"t": T, "u": U, "y (rpm)": Y, "y [rad/s]": Y}, "two.csv")
    with pytest.raises(DataError, match=r"two\.csv: several columns are called 'y'"):
        describe(two, input="u", output="y")


def test_names_and_influence_find_the_pair(write: Write) -> None:
    reference = np.roll(Y, -3)
    look = describe(write({"t": T, "ref": reference, "i [A]": U - 0.1 * Y, "Vm": U, "w [deg/s]": Y, "temp": 20 + T}))
    assert (look.roles.input, look.roles.output) == ("Vm", "w [deg/s]")
    assert min(look.roles.input_confidence, look.roles.output_confidence) > 0.8
    assert "role-uncertain" not in codes(look)
    unnamed = describe(write({"a1": T, "b1": Y, "k1": U}))
    assert (unnamed.roles.input, unnamed.roles.output) == ("k1", "b1")  # by influence alone


def test_an_uncertain_role_is_said(write: Write) -> None:
    rng = np.random.default_rng(2)
    walks = {name: np.cumsum(rng.standard_normal(N)) for name in ("a", "b", "c")}
    assert "role-uncertain" in codes(describe(write({"t": T, **walks})))


def test_no_role_is_said(write: Write) -> None:
    look = describe(write({"t": T, "y": Y}))
    assert data(look, "no-role-found") == {"roles": ["input"]}
    assert (look.record, proposals([look])) == (None, [])


def test_several_experiments_side_by_side(write: Write) -> None:
    look = describe(write({"z1": Y, "u1": U, "z2": -Y, "u2": -U}))
    assert data(look, "several-experiments") == {"chosen": ["u1", "z1"], "pairs": [["u2", "z2"]]}
    assert "several-experiments" not in codes(describe(write({"u1": U, "z1": Y})))


@pytest.mark.parametrize("sides", [("left", "right"), ("front", "rear")])
def test_every_system_of_a_file_has_a_command(write: Write, run: Run, sides: tuple[str, str]) -> None:
    """Wheels of a robot are told apart by the first word of their columns; a gyroscope beside them is of neither."""
    other = np.random.default_rng(4).permutation(U.reshape(-1, 10)).ravel()
    columns = {"time": T, "gyro_z": 0.01 * Y}
    for side, u in zip(sides, (U, other), strict=True):
        columns |= {f"{side}_pwm": np.round(10 * u), f"{side}_speed": signal.lfilter([0.0, 0.5], [1.0, -0.9], u)}
    path = write(columns)
    look = describe(path)
    assert (look.roles.input, look.roles.output) == (f"{sides[0]}_pwm", f"{sides[0]}_speed")
    assert data(look, "several-experiments")["pairs"] == [[f"{sides[1]}_pwm", f"{sides[1]}_speed"]]
    status, shown, _ = run("describe", str(path))
    assert status == 0
    last = shown.splitlines()[-2:]
    for line, side in zip(last, sides, strict=True):
        assert f"--input {side}_pwm --output {side}_speed" in line


def test_columns_of_one_sheet_belong_together(write: Write) -> None:
    rng = np.random.default_rng(2)
    other = {"Run 2.t": T, "Run 2.voltage": U, "Run 2.speed": Y}  # with less noise than the first
    look = describe(write({"t": T, "voltage": U, "speed": Y + 0.5 * rng.standard_normal(N), **other}))
    assert (look.reading["input"], look.reading["output"]) == ("voltage", "speed")
    pairs = [["Run 2.voltage", "Run 2.speed"]]
    assert data(look, "several-experiments") == {"chosen": ["voltage", "speed"], "pairs": pairs}
    groups = describe(write({"t": T, "drive.voltage": U, "motor.speed": Y}))  # of one experiment
    assert (groups.reading["input"], groups.reading["output"]) == ("drive.voltage", "motor.speed")
    assert "several-experiments" not in codes(groups)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"input": "nix"}, "there is no column 'nix'"),
        ({"rows": slice(9, 3)}, "rows 9:3 select nothing"),
        ({"filter": 400.0}, "between 0 and 50 Hz"),
        ({"units": {"w": "rpm"}}, "'w', which is neither input nor output"),
    ],
)
def test_an_argument_that_cannot_be_used_is_refused(write: Write, given: dict[str, Any], reason: str) -> None:
    with pytest.raises(DataError, match=reason):
        describe(write({"t": T, "u": U, "y": Y}), **given)


def test_a_record_that_cannot_be_read_is_said(write: Write) -> None:
    rows = table(",", T, "t,u,y\n").splitlines()
    rows[1::25] = ["[message]"] * len(rows[1::25])
    look = describe(write("\n".join(rows)))
    assert "at most 2 % are skipped" in str(data(look, "not-readable")["reason"])
    assert look.record is None


def test_bad_rows_are_skipped_and_said(write: Write) -> None:
    rows = table(",", T, "t,u,y\n").splitlines()
    rows.insert(500, "[RxCallback]Communication Status #: 6")
    look = describe(write("\n".join(rows)))
    assert look.reading == {"input": "u", "output": "y", "time": "t", "skip_bad_rows": True}
    assert data(look, "rows-skipped")["line"] == 501


# --- clock -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "above", "dt", "code"),
    [
        ("log.csv", "Rig 3\nSample rate 200 Hz\n", 0.005, "sample-time-from-text"),
        ("log.csv", "(dt=10)\n", 0.01, "time-unit-assumed"),
        ("log.csv", "Sample Interval,5.0e-03,s\n", 0.005, "sample-time-from-text"),
        ("log.csv", "Increment 2.000000e-03\n", 0.002, "sample-time-from-text"),
        ("log.csv", "Abtastrate 2 kSa/s\n", 0.0005, "sample-time-from-text"),
        ("log.csv", "dt,OCR2A\n10,156\n", 0.01, "time-unit-assumed"),
        ("test_20ms.csv", "", 0.02, "sample-time-from-text"),
        ("test_dt2.csv", "", 0.002, "time-unit-assumed"),
        ("log.csv", "", 1.0, "sample-time-unknown"),
    ],
)
def test_a_sample_time_without_time_column(write: Write, name: str, above: str, dt: float, code: str) -> None:
    rows = "".join(f"{u:g},{y:.5f}\n" for u, y in zip(U, Y, strict=True))
    look = describe(write(f"{above}Voltage,Speed\n{rows}", name))
    assert look.reading == {"input": "Voltage", "output": "Speed", "dt": dt}
    assert code in codes(look)


@pytest.mark.parametrize(
    ("entry", "number", "dt"),
    [
        ("fs", 500.0, 0.002),
        ("run.Fs_kHz", 2.0, 0.0005),
        ("Ts", 0.01, 0.01),
        ("sampleTime", 0.02, 0.02),
        ("dt_ms", 5, 0.005),
    ],
)
def test_a_single_number_of_a_file_is_its_sample_time(tmp_path: Path, entry: str, number: float, dt: float) -> None:
    path = tmp_path / "runs.npz"
    np.savez(path, period=1024, u=U, y=Y, **{entry: number})
    look = describe(path)
    assert look.reading["dt"] == pytest.approx(dt)
    assert data(look, "sample-time-from-text")["source"] == entry
    assert data(describe(path, dt=1.0), "sample-time-contradicted")["said"] == pytest.approx(dt)
    with pytest.raises(DataError, match=f"no sample time; .*the entry '{entry}' of the file gives"):
        emsid.read(path, input="u", output="y")


def test_a_single_number_of_another_name_is_no_sample_time(tmp_path: Path) -> None:
    path = tmp_path / "runs.npz"
    np.savez(path, period=1024, offset=0.1, fs=0.0, u=U, y=Y)
    assert "sample-time-unknown" in codes(describe(path))


def test_another_sample_time_than_the_file_says(write: Write) -> None:
    path = write({"u": U, "y": Y}, "log_dt2.csv")
    assert data(describe(path, dt=0.01), "sample-time-contradicted") == {
        "dt": 0.01,
        "said": 0.002,
        "source": "file name",
    }
    assert "sample-time-contradicted" not in codes(describe(path, dt=0.00201)) | codes(describe(path))


def test_times_that_are_not_understood_are_named(write: Write) -> None:
    rows = "".join(f"noon plus {k},{U[k]},{Y[k]}\n" for k in range(N))
    look = describe(write("time,voltage,speed\n" + rows))
    assert data(look, "sample-time-unknown")["texts"] == ["time"]
    assert data(describe(write({"voltage": U, "speed": Y})), "sample-time-unknown")["texts"] == []


@pytest.mark.parametrize("cell", ["", "nan", "N/A", "ERR"])
def test_a_gap_is_masked_and_said(write: Write, cell: str) -> None:
    rows = table(",", T, "t,u,y\n").splitlines()
    rows[301:341] = [f"{row.rpartition(',')[0]},{cell}" for row in rows[301:341]]
    look = describe(write("\n".join(rows)))
    assert look.reading == {"input": "u", "output": "y", "time": "t", "mask": "isnan(y)"}
    assert data(look, "values-missing") == {"count": 40, "rows": 800}
    assert look.record is not None
    assert (len(look.record), look.record.breaks) == (760, (300,))
    assert "values-missing" not in codes(describe(write(table(",", T, "t,u,y\n"))))


def test_a_row_for_every_message_is_brought_to_the_times_of_the_output(tmp_path: Path) -> None:
    path = tmp_path / "can.csv"
    rows = [f"{t:.3f},{u},,\n{t + 0.002:.3f},,{y:.4f},\n" for t, u, y in zip(T, U, Y, strict=True)]
    slow = [f"{t + 0.005:.3f},,,{20 + t:.1f}\n" for t in T[::100]]
    lines = sorted("".join(rows + slow).splitlines(), key=lambda line: float(line.split(",")[0]))
    path.write_text("time,voltage,speed,temperature\n" + "\n".join(lines) + "\n")
    look = describe(path)
    assert look.reading == {"input": "voltage", "output": "speed", "time": "time"}
    assert data(look, "rows-of-messages") == {"rows": len(lines), "columns": ["voltage", "speed"]}
    assert look.record is not None
    assert look.record.dt == pytest.approx(0.01)
    np.testing.assert_array_equal(look.record.input[:, 0], U[: len(look.record)])
    np.testing.assert_allclose(look.record.output[:, 0], Y[: len(look.record)], atol=1e-4)


def test_two_signals_of_one_message_are_read_without_the_rows_of_others(tmp_path: Path) -> None:
    path = tmp_path / "can.csv"
    rows = [f"{t:.3f},{u},{y:.4f},\n{t + 0.002:.3f},,,{k}" for k, (t, u, y) in enumerate(zip(T, U, Y, strict=True))]
    path.write_text("time,u,y,temperature\n" + "\n".join(rows) + "\n")
    look = describe(path)
    assert look.record is not None
    np.testing.assert_array_equal(look.record.input[:, 0], U)


def test_values_that_are_missing_now_and_then_are_not_messages(write: Write) -> None:
    rng = np.random.default_rng(2)
    holes = np.where(rng.random(N) < 0.2, np.nan, Y)
    silent = np.where(np.arange(N) < 300, np.nan, rng.standard_normal(N))
    look = describe(write({"t": T, "u": U, "y": holes, "z": silent}))
    assert "rows-of-messages" not in codes(look)
    assert look.reading["mask"] == "isnan(y)"


# --- several files ---------------------------------------------------------------------------------------------------


def test_two_files_of_one_signal_each(write: Write) -> None:
    paths = [write("".join(f"{x}\n" for x in values), name) for name, values in (("b.csv", Y), ("a.csv", U))]
    (look,), findings = describe_files(paths, dt=0.01)
    assert look.reading == {"dt": 0.01, "input": f"{paths[1]}:1", "output": f"{paths[0]}:1"}
    assert (look.response.delay, findings) == (1, [])
    u, y, late = (
        write({"t": T + shift, name: values}, f"{k}.csv")
        for k, (name, values, shift) in enumerate([("voltage", U, 0), ("speed", Y, 0), ("speed", Y, 0.5)])
    )
    for paths in ([u, y], [y, u]):
        (look,), _ = describe_files(paths)
        assert look.reading == {"input": f"{u}:voltage", "output": f"{y}:speed", "time": "t"}
        assert (look.response.delay, "role-uncertain" in codes(look)) == (1, False)
    headed = [write({name: values}, f"{name[0]}.csv") for name, values in (("voltage (V)", U), ("Speed (RPM)", Y))]
    (look,), _ = describe_files(headed, dt=0.01)
    assert look.reading["units"] == {"voltage (V)": "V", "Speed (RPM)": "rpm"}
    assert {look.roles.input, look.roles.output} == set(look.reading["units"])
    common = emsid.read(
        late, input=f"{u}:voltage", output="speed", time="t"
    )  # those 0.5 s in which only one has samples
    np.testing.assert_allclose((common.input[:, 0], common.output[:, 0]), (U[50:], Y[:-50]), rtol=1e-9)


def test_two_files_of_one_signal_each_with_other_times(write: Write) -> None:
    u = write({"t": T, "voltage": U}, "u.csv")
    seldom, late, never = (
        write({"t": T[::step] + shift, "speed": Y[::step]}, f"{name}.csv")
        for name, step, shift in (("seldom", 2, 0.0), ("late", 1, 0.5), ("never", 1, T[-1] + 1))
    )
    for y, delay, share in ((seldom, 1, (T[-2] - T[0]) / (T[-1] - T[0])), (late, 51, (N - 51) / (N + 49))):
        for paths in ([u, y], [y, u]):
            (look,), _ = describe_files(paths)
            assert look.reading == {"input": f"{u}:voltage", "output": f"{y}:speed", "time": "t"}
            (found,) = (each for each in look.findings if each.code == "clocks-of-files")
            assert found.data == {"columns": ["voltage", "speed"], "share": pytest.approx(share, rel=1e-6)}
            assert look.response.delay == delay
    apart = ([u, never], [seldom, late], [u, write({"time": T[::2], "speed": Y[::2]}, "other.csv")])
    assert [len(describe_files(paths)[0]) for paths in apart] == [2, 2, 2]
    one = [write({"t": T, name: values}, f"{name}.csv") for name, values in (("voltage", U), ("speed", Y))]
    assert "clocks-of-files" not in codes(describe_files(one)[0][0])


def test_white_noise_has_no_command(run: Run, write: Write) -> None:
    for seed in range(20):
        path = write({"t": T, "u": U, "y": 1e-3 * np.random.default_rng(seed).standard_normal(N)})
        assert "output-noise-only" in codes(describe(path))
    assert run("describe", path)[1].endswith("nothing to identify here: see above\n")


def test_a_record_of_opposite_sign_among_others(write: Write) -> None:
    paths = [write({"t": T, "u": U, "y": sign * Y + 0.01 * k}, f"{k}.csv") for k, sign in enumerate((1, -1, 1))]
    (finding,) = describe_files(paths)[1]
    assert (finding.code, finding.data) == ("records-of-opposite-sign", {"records": ["1.csv"], "of": 3})
    assert describe_files(paths[::2])[1] == []


def drive(pole: float, seed: int) -> np.ndarray:
    """The output of a drive with this pole, with noise."""
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = pole * y[k - 1] + 5 * (1 - pole) * np.roll(U, 8 * seed)[k - 1]
    return y + 0.05 * np.random.default_rng(seed).standard_normal(N)


def test_files_with_another_header_and_another_response_are_of_another_system(write: Write) -> None:
    def file(name: str, header: str, pole: float, seed: int) -> Path:
        u, y = np.roll(U, 8 * seed), drive(pole, seed)
        rows = (f"{x:g}\t{speed:.5f}\n" for x, speed in zip(u, y, strict=True))
        return write(f"{header} (dt=10)\nPWM\tspeed\n{''.join(rows)}", name)

    old, same = file("old.dat", "Motor", 0.9, 0), file("same.dat", "Motor Prescaler 5", 0.9, 1)
    other, unmarked = file("other.dat", "Motor Prescaler 5", 0.8, 2), file("unmarked.dat", "Motor", 0.8, 3)
    looks, findings = describe_files([old, other])
    assert [finding.code for finding in findings] == ["files-of-another-system"]
    said = findings[0].data
    assert (said["files"], said["others"], said["words"]) == (["other.dat"], ["old.dat"], ["Prescaler"])
    assert said["ratio"] > 3
    assert [[Path(word).name for word in words if word.endswith(".dat")] for words in proposals(looks)] == [
        ["old.dat"],
        ["other.dat"],
    ]
    for pair in ([old, same], [old, unmarked]):
        looks, findings = describe_files(pair)
        assert findings == []
        assert len(proposals(looks)) == 1


def test_the_statistic_of_two_halves_of_a_system_is_about_one() -> None:
    whole = emsid.Record(U, drive(0.9, 0), 0.01)
    assert statistic(whole[:400], whole[400:]) < 3
    assert statistic(whole[:400], emsid.Record(U, drive(0.8, 0), 0.01)[400:]) > 30
    assert statistic(whole[:40], whole[400:]) == np.inf


def test_a_frame_is_looked_at_as_a_file_is() -> None:
    """The frame of a notebook, with its times as index and a column of texts."""
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame({"Voltage (V)": U, "Speed (rpm)": Y, "mode": ["auto"] * N})
    frame.index = pd.Index(pd.to_datetime(T, unit="s"), name="when")
    look = describe(frame)
    assert look.reading == {
        "input": "Voltage (V)",
        "output": "Speed (rpm)",
        "time": "when",
        "units": {"Voltage (V)": "V", "Speed (rpm)": "rpm"},
    }
    assert look["mode"].kind == "text"
    record = emsid.read(frame, **look.reading)
    np.testing.assert_allclose(record.output[:, 0], Y * np.pi / 30)
    assert describe({"t": T, "u": U, "y": Y}).reading == {"input": "u", "output": "y", "time": "t"}
    with pytest.raises(emsid.DataError, match="a list has no columns"):
        describe([1, 2])
