"""The first look at a file: what its columns hold, the guesses and how sure they are, and the command that follows."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal

import emsid
from emsid.cli.commands.describe import proposals
from emsid.errors import DataError
from emsid.first_look import describe, describe_files
from emsid.first_look.columns import Stretch, column_of_numbers, quantisation
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.first_look.stuck_output import is_stuck
from emsid.first_look.systems import statistic
from emsid.report.braille import braille

N = 800
RNG = np.random.default_rng(1)
U = np.repeat(RNG.integers(-10, 11, N // 10).astype(float), 10)
Y = np.zeros(N)
for k in range(1, N):
    Y[k] = 0.9 * Y[k - 1] + 0.5 * U[k - 1]
Y += 0.01 * RNG.standard_normal(N)
T = 0.01 * np.arange(N)

Write = Callable[..., Path]
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(command: Callable[..., int], capsys: pytest.CaptureFixture[str]) -> Run:
    """Call the command line in this process: (status, standard output, standard error)."""

    def call(*words: object) -> tuple[int, str, str]:
        status = command(*words)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A file of columns by name, or of the given text."""

    def write(
        columns: dict[str, np.ndarray] | str, name: str = "log.csv", encoding: str = "utf-8", **rows: str
    ) -> Path:
        if isinstance(columns, str):
            text = columns
        else:
            lines = [",".join(f"{x:.10g}" for x in row) for row in zip(*columns.values(), strict=True)]
            text = "\n".join([",".join(columns), *rows.values(), *lines]) + "\n"
        path = tmp_path / name
        path.write_text(text, encoding)
        return path

    return write


def codes(look: emsid.FirstLook) -> set[str]:
    return {finding.code for finding in look.findings}


def data(look: emsid.FirstLook, code: str) -> dict[str, object]:
    (found,) = (finding for finding in look.findings if finding.code == code)
    return dict(found.data)


# --- names -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("Motor_Speed(RPM)", ColumnQuantity.SPEED, "rpm"),
        ("t_ms", ColumnQuantity.TIME, "ms"),
        ("Timestamp(ms)", ColumnQuantity.TIME, "ms"),
        ("Commanded_PWM", ColumnQuantity.DUTY, ""),
        ("mVel", ColumnQuantity.SPEED, ""),
        ("w [deg/s]", ColumnQuantity.SPEED, "deg/s"),
        ("i [A]", ColumnQuantity.CURRENT, "A"),
        ("Drehzahl [U/min]", ColumnQuantity.SPEED, "rpm"),
        ("Drehzahl / (1/min)", ColumnQuantity.SPEED, "rpm"),
        ("Motorspannung", ColumnQuantity.VOLTAGE, ""),
        ("Ankerstrom_A", ColumnQuantity.CURRENT, "A"),
        ("Istdrehzahl", ColumnQuantity.SPEED, ""),
        ("Solldrehzahl", ColumnQuantity.REFERENCE, ""),
        ("Wicklungstemperatur", ColumnQuantity.OTHER, ""),
        ("Vitesse (tr/min)", ColumnQuantity.SPEED, "rpm"),
        ("Tensión (V)", ColumnQuantity.VOLTAGE, "V"),
        ("Winkel in Grad", ColumnQuantity.POSITION, "deg"),
        ("U/V", ColumnQuantity.INPUT, "V"),
        ("v m/s", ColumnQuantity.SPEED, "m/s"),
        ("/odom/v", ColumnQuantity.VOLTAGE, ""),
        ("speed_ref", ColumnQuantity.REFERENCE, ""),
        ("u11", ColumnQuantity.INPUT, ""),
        ("ω", ColumnQuantity.SPEED, ""),
        ("c3", ColumnQuantity.UNKNOWN, ""),
        ("x [furlong]", ColumnQuantity.UNKNOWN, ""),
    ],
)
def test_what_a_name_says(name: str, quantity: ColumnQuantity, unit: str) -> None:
    said = meaning(name)
    assert (said.quantity, said.unit) == (quantity, unit)
    assert (said.confidence > 0) is (quantity is not ColumnQuantity.UNKNOWN)


# --- columns ---------------------------------------------------------------------------------------------------------


def test_isolated_whole_numbers_are_codes() -> None:
    pwm = np.concatenate([np.arange(-255, 256), [1000] * 5, [-9999] * 7])
    column = column_of_numbers("PWM", "numbers", meaning("PWM"), pwm.astype(float))
    assert [(code.value, code.count) for code in column.codes] == [(-9999, 7), (1000, 5)]
    assert (column.low, column.high, column.step) == (-255, 255, 1)
    assert np.isnan(column.signal[-12:]).all()


@pytest.mark.parametrize(
    "values",
    [
        np.arange(-255.0, 256.0),
        np.append(np.linspace(0, 1, 100), [1000.5] * 3),  # no whole number
        np.append(np.arange(100.0), [1000.0]),  # an outlier: it occurs once
        np.repeat([0.0, 100.0, 1000.0], 50),  # levels of a command
    ],
)
def test_other_values_are_no_codes(values: np.ndarray) -> None:
    assert column_of_numbers("u", "numbers", meaning("u"), values).codes == ()


def test_quantisation_survives_rounding_in_the_file() -> None:
    step = 0.0024414
    assert quantisation(np.unique(np.round(step * np.arange(300), 6))) == pytest.approx(step, rel=1e-4)
    assert quantisation(np.unique(RNG.standard_normal(300))) is None
    assert quantisation(np.array([3.0])) is None


def test_a_value_that_stays_is_stuck_only_if_that_is_unusual() -> None:
    y = RNG.standard_normal(2000)
    y[700:900] = y[700]
    (stuck,) = column_of_numbers("y", "numbers", meaning("y"), y).stuck
    assert (stuck.start, stuck.length) == (700, 200)
    assert column_of_numbers("y", "numbers", meaning("y"), RNG.standard_normal(2000)).stuck == ()


def test_columns_of_a_file(write: Write) -> None:
    state = "".join(f"{0.01 * k:.2f},RUN,2,{U[k]},{Y[k]}\n" for k in range(N))
    look = describe(write("t,state,gain,u,y\n" + state))
    assert [column.kind for column in look.columns] == ["numbers", "text", "numbers", "numbers", "numbers"]
    assert look["gain"].constant
    assert look.reading == {"input": "u", "output": "y", "time": "t"}


# --- roles and clock -------------------------------------------------------------------------------------------------


def german() -> str:
    rows = (f"{t:.2f};{u:.3f};{y:.5f}".replace(".", ",") for t, u, y in zip(T, U, Y, strict=True))
    return "Zeit;Spannung;Drehzahl\n" + "\n".join(rows) + "\n"


def table(separator: str, times: np.ndarray, header: str = "") -> str:
    rows = (f"{t:.14g}{separator}{u:g}{separator}{y:.5f}" for t, u, y in zip(times, U, Y, strict=True))
    return header + "\n".join(rows) + "\n"


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


@pytest.mark.parametrize(
    ("name", "above", "dt", "code"),
    [
        ("log.csv", "Rig 3\nSample rate 200 Hz\n", 0.005, "sample-time-from-text"),
        ("log.csv", "(dt=10)\n", 0.01, "time-unit-assumed"),
        ("log.csv", "Sample Interval,5.0e-03,s\n", 0.005, "sample-time-from-text"),
        ("log.csv", "Increment 2.000000e-03\n", 0.002, "sample-time-from-text"),
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


def test_what_is_given_is_not_guessed(write: Write) -> None:
    path = write({"t": T, "u": U, "y": Y})
    look = describe(path, dt=0.02, output="t")
    assert look.reading == {"input": look.roles.input, "output": "t", "dt": 0.02}
    assert describe(path, rows=slice(0, 100)).record is not None
    with pytest.raises(DataError, match="there is no column 'speed'"):
        describe(path, input="u", output="speed")


def test_names_and_influence_find_the_pair(write: Write) -> None:
    reference = np.roll(Y, -3)
    look = describe(write({"t": T, "ref": reference, "i [A]": U - 0.1 * Y, "Vm": U, "w [deg/s]": Y, "temp": 20 + T}))
    assert (look.roles.input, look.roles.output) == ("Vm", "w [deg/s]")
    assert min(look.roles.input_confidence, look.roles.output_confidence) > 0.8
    assert "role-uncertain" not in codes(look)
    unnamed = describe(write({"a1": T, "b1": Y, "k1": U}))
    assert (unnamed.roles.input, unnamed.roles.output) == ("k1", "b1")  # by influence alone


def test_an_uncertain_role_is_said(write: Write) -> None:
    walks = {name: np.cumsum(RNG.standard_normal(N)) for name in ("a", "b", "c")}
    assert "role-uncertain" in codes(describe(write({"t": T, **walks})))


def test_no_role_is_said(write: Write) -> None:
    look = describe(write({"t": T, "y": Y}))
    assert data(look, "no-role-found") == {"roles": ["input"]}
    assert (look.record, proposals([look])) == (None, [])


def test_several_experiments_side_by_side(write: Write) -> None:
    look = describe(write({"z1": Y, "u1": U, "z2": -Y, "u2": -U}))
    assert data(look, "several-experiments") == {"chosen": ["u1", "z1"], "pairs": [["u2", "z2"]]}
    assert "several-experiments" not in codes(describe(write({"u1": U, "z1": Y})))


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
    holes = np.where(RNG.random(N) < 0.2, np.nan, Y)
    silent = np.where(np.arange(N) < 300, np.nan, RNG.standard_normal(N))
    look = describe(write({"t": T, "u": U, "y": holes, "z": silent}))
    assert "rows-of-messages" not in codes(look)
    assert look.reading["mask"] == "isnan(y)"


def test_columns_of_one_sheet_belong_together(write: Write) -> None:
    other = {"Run 2.t": T, "Run 2.voltage": U, "Run 2.speed": Y}  # with less noise than the first
    look = describe(write({"t": T, "voltage": U, "speed": Y + 0.5 * RNG.standard_normal(N), **other}))
    assert (look.reading["input"], look.reading["output"]) == ("voltage", "speed")
    pairs = [["Run 2.voltage", "Run 2.speed"]]
    assert data(look, "several-experiments") == {"chosen": ["voltage", "speed"], "pairs": pairs}
    groups = describe(write({"t": T, "drive.voltage": U, "motor.speed": Y}))  # of one experiment
    assert (groups.reading["input"], groups.reading["output"]) == ("drive.voltage", "motor.speed")
    assert "several-experiments" not in codes(groups)


def test_a_position_is_differentiated_and_a_difference_is_recognised(write: Write) -> None:
    counts = np.cumsum(np.rint(Y))
    look = describe(write({"PWM": U, "mStep": counts, "mVel": np.diff(counts, prepend=0)}))
    assert data(look, "difference-of-position") == {"position": "mStep"}
    assert "position-differentiated" not in codes(look)
    look = describe(write({"PWM": U, "enc": counts}))
    assert look.reading["output"] == "d(enc)"
    assert data(look, "position-differentiated") == {"input": ""}
    for output in ("enc", "d(enc)"):  # nothing is proposed where it is given
        assert "position-differentiated" not in codes(describe(write({"PWM": U, "enc": counts}), output=output))


@pytest.mark.parametrize(("name", "period", "low"), [("enc", 65536, -32768), ("angle", 360, 0), ("enc", 4096, 0)])
def test_a_position_that_starts_again_is_made_continuous(write: Write, name: str, period: int, low: int) -> None:
    position = np.rint(0.1 * period * np.cumsum(Y) / np.max(np.abs(Y)))
    look = describe(write({"t": T, "PWM": U, name: (position - low) % period + low}))
    plain = describe(write({"t": T, "PWM": U, name: position}))
    assert data(look, "position-wraps") == {"period": period}
    assert look.reading == plain.reading | {"wrap": {name: period}}
    assert f"--wrap {name}={period}" in " ".join(proposals([look])[0])
    assert "position-wraps" not in codes(plain)
    assert look.record is not None
    assert plain.record is not None
    np.testing.assert_allclose(look.record.output, plain.record.output, atol=1e-6 * period)


def test_a_counter_of_any_period_starts_again(write: Write) -> None:
    position = np.rint(100 * np.cumsum(Y) / np.max(np.abs(Y)))
    look = describe(write({"t": T, "u": U, "ticks": position % 4000}))
    assert look.reading["wrap"] == {"ticks": pytest.approx(4000, rel=0.01)}


def test_an_angle_in_radians_starts_again_between_its_samples(write: Write) -> None:
    angle = np.cumsum(Y) / np.max(np.abs(Y))
    look = describe(write({"t": T, "u": U, "theta [rad]": np.angle(np.exp(1j * angle))}))
    assert look.reading["wrap"] == {"theta [rad]": pytest.approx(2 * np.pi)}


def test_a_position_that_only_jumps_does_not_start_again(write: Write) -> None:
    position = np.cumsum(Y)
    reset = np.where(np.arange(N) < N // 2, position, position - position[N // 2])  # set to zero once
    steps = np.where(U > 0, 300.0, 0.0)
    for values in (reset, steps, RNG.uniform(0, 360, N)):
        assert "position-wraps" not in codes(describe(write({"t": T, "u": U, "angle": values})))


def test_another_sample_time_than_the_file_says(write: Write) -> None:
    path = write({"u": U, "y": Y}, "log_dt2.csv")
    assert data(describe(path, dt=0.01), "sample-time-contradicted") == {
        "dt": 0.01,
        "said": 0.002,
        "source": "file name",
    }
    assert "sample-time-contradicted" not in codes(describe(path, dt=0.00201)) | codes(describe(path))


def test_a_reversed_position_is_seen_by_its_change(write: Write) -> None:
    for sign in (1, -1):
        look = describe(write({"t": T, "u": sign * U, "position": 0.01 * np.cumsum(Y)}), output="position")
        assert (look.response.delay, look.response.sign) == (1, sign)


def test_a_reference_that_the_output_follows_shows_a_controller(write: Write) -> None:
    columns = {"t": T, "u": U, "y": Y}
    look = describe(write(columns | {"setpoint": Y + 0.1 * RNG.standard_normal(N)}))
    assert data(look, "reference-column") == {"input": "u", "follows": "y"}
    assert "reference-column" not in codes(describe(write(columns | {"setpoint": RNG.standard_normal(N)})))


def test_an_output_whose_change_answers_is_a_position(write: Write) -> None:
    look = describe(write({"t": T, "u": U, "y": 0.01 * np.cumsum(Y)}))
    assert data(look, "position-differentiated") == {"input": "u"}
    assert (look.reading["output"], look.response.delay) == ("d(y)", 1)
    named = describe(write({"t": T, "u": U, "y": 0.01 * np.cumsum(Y)}), output="y")
    assert (named.reading["output"], "position-differentiated" in codes(named)) == ("y", False)
    unrelated = describe(write({"t": T, "u": U, "y": RNG.standard_normal(N)}))
    assert {"no-response", "position-differentiated"} & codes(unrelated) == {"no-response"}


def test_an_input_without_sign_takes_that_of_its_direction(write: Write) -> None:
    columns = {"t": T, "pwm": np.abs(U), "dir": np.where(U > 0, 1, 0), "lamp": np.arange(N) // 50 % 2}
    for name, output in (("speed", Y), ("enc", np.cumsum(np.rint(Y)))):
        look = describe(write(columns | {name: output}))
        assert data(look, "direction-column") == {"column": "dir", "output": name}
        assert look.reading["direction"] == {"pwm": "dir"}
        assert look.record is not None
        np.testing.assert_array_equal(look.record.input[:, 0], np.where(U > 0, np.abs(U), -np.abs(U)))
        assert "--direction pwm=dir" in " ".join(proposals([look])[0])
    signed = describe(write(columns | {"pwm": U, "speed": Y}))
    assert "direction-column" not in codes(signed)
    one_way = describe(write({"t": T, "pwm": np.abs(U), "lamp": columns["lamp"], "speed": np.abs(Y)}))
    assert "direction-column" not in codes(one_way)


def test_codes_are_masked_and_what_the_output_does_there_is_said(write: Write) -> None:
    u, y = U.copy(), Y.copy()
    for start in (100, 300, 500):
        u[start : start + 20] = 1000
        y[start : start + 20] = 40 * 0.7 ** np.arange(20)
    look = describe(write({"t": T, "Commanded PWM": u, "speed": y}))
    assert look.reading["mask"] == 'abs("Commanded PWM") > 10'
    (code,) = data(look, "isolated-values")["codes"]
    assert code == {"value": 1000, "count": 60, "share": 0.075, "response": "falls"}
    assert "isolated-values" not in codes(describe(write({"t": T, "Commanded PWM": U, "speed": Y})))


def test_a_stuck_sensor(write: Write) -> None:
    y = Y.copy()
    y[400:520] = y[400]
    assert data(describe(write({"t": T, "u": U, "y": y})), "value-stuck")["row"] == 400
    assert "value-stuck" not in codes(describe(write({"t": T, "u": U, "y": Y})))


def test_a_sensor_that_is_stuck_at_zero_and_a_drive_at_rest(write: Write) -> None:
    rest, frozen = U.copy(), Y.copy()
    rest[300:420] = np.repeat([0.5, -0.5, 0.4], 40)  # inside the dead zone
    y = signal.lfilter([0, 0.5], [1, -0.9], np.where(np.abs(rest) < 0.6, 0.0, rest))
    y[np.abs(y) < 0.05] = 0.0
    frozen[500:620] = 0.0
    assert data(describe(write({"t": T, "u": U, "y": frozen})), "value-stuck")["row"] == 500
    assert np.ptp(y[380:420]) == 0
    assert "value-stuck" not in codes(describe(write({"t": T, "u": rest, "y": y})))


def test_an_output_is_stuck_where_a_single_step_of_the_input_should_move_it() -> None:
    u = np.repeat(RNG.integers(-10, 11, 40).astype(float), 60)
    y = 0.01 * RNG.standard_normal(len(u)) + signal.lfilter([0, 0.5], [1, -0.9], u)
    rows = Stretch(1200, 90, 0.0)
    u[1200:1260], u[1260:1320] = 4.0, 8.0
    held, dead = y.copy(), signal.lfilter([0, 0.5], [1, -0.9], np.sign(u) * np.maximum(np.abs(u) - 8.5, 0.0))
    held[1200:1290] = held[1200]
    assert is_stuck(u, held, rows)
    assert not is_stuck(u, held, Stretch(1200, 55, 0.0))  # the input is steady
    assert np.ptp(dead[1210:1290]) < 0.5
    assert not is_stuck(u, dead, Stretch(1210, 80, 0.0))  # at rest in a wide dead zone
    assert not is_stuck(np.full(len(u), np.nan), held, rows)


def test_the_effect_of_a_code_on_a_position_is_that_on_its_speed(write: Write) -> None:
    pwm, speed = 20 * U, np.zeros(N)
    for k in range(60, N, 120):
        pwm[k : k + 20] = 1000
    for k in range(1, N):
        speed[k] = 0.5 * speed[k - 1] if pwm[k - 1] == 1000 else 0.9 * speed[k - 1] + 0.025 * pwm[k - 1]
    look = describe(write({"t": T, "PWM": pwm, "ticks": np.cumsum(speed)}))
    assert [code["response"] for code in data(look, "isolated-values")["codes"]] in (["falls"], ["rests"])


def test_of_many_columns_those_with_a_role_are_printed(run: Run, write: Write) -> None:
    others = {f"ch{k}": RNG.standard_normal(N) for k in range(40)}
    log = write({"t": T, "voltage": U} | others | {"speed": Y})
    _, out, _ = run("describe", log)
    assert "43 columns, of which 30 are shown" in out
    assert "ch26" in out
    assert "ch27" not in out
    assert "speed    output" in out
    assert len(describe(log).columns) == 43


def test_a_direction_in_words_is_found(write: Write) -> None:
    words = np.where(U > 0, "CW", "CCW")
    log = write("t,dir,duty,speed\n" + "".join(f"{T[k]:.2f},{words[k]},{abs(U[k])},{Y[k]}\n" for k in range(N)))
    assert describe(log).reading["direction"] == {"duty": "dir"}
    record = emsid.read(log, input="duty", output="speed", time="t", direction={"duty": "dir"})
    np.testing.assert_array_equal(record.input[:, 0], U)


def test_times_that_are_not_understood_are_named(write: Write) -> None:
    rows = "".join(f"noon plus {k},{U[k]},{Y[k]}\n" for k in range(N))
    look = describe(write("time,voltage,speed\n" + rows))
    assert data(look, "sample-time-unknown")["texts"] == ["time"]
    assert data(describe(write({"voltage": U, "speed": Y})), "sample-time-unknown")["texts"] == []


def test_bad_rows_are_skipped_and_said(write: Write) -> None:
    rows = table(",", T, "t,u,y\n").splitlines()
    rows.insert(500, "[RxCallback]Communication Status #: 6")
    look = describe(write("\n".join(rows)))
    assert look.reading == {"input": "u", "output": "y", "time": "t", "skip_bad_rows": True}
    assert data(look, "rows-skipped")["line"] == 501


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


def test_a_record_that_cannot_be_read_is_said(write: Write) -> None:
    rows = table(",", T, "t,u,y\n").splitlines()
    rows[1::25] = ["[message]"] * len(rows[1::25])
    look = describe(write("\n".join(rows)))
    assert "at most 2 % are skipped" in str(data(look, "not-readable")["reason"])
    assert look.record is None


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
    assert len(describe_files([u, late])[0]) == 2
    with pytest.raises(DataError, match=r"the times in 't' of 0\.csv and 2\.csv differ"):
        emsid.read(late, input=f"{u}:voltage", output="speed", time="t")


def test_a_record_of_opposite_sign_among_others(write: Write) -> None:
    paths = [write({"t": T, "u": U, "y": sign * Y}, f"{k}.csv") for k, sign in enumerate((1, -1, 1))]
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


# --- how it is shown -------------------------------------------------------------------------------------------------


def test_it_prints_as_a_table(write: Write) -> None:
    look = emsid.describe(write({"t_ms": 1e3 * T, "u": U, "y": Y}))
    lines = str(look).splitlines()
    assert lines[1].split() == ["Column", "Role", "Quantity", "Unit", "Notes", "From", "To", "Step"]
    assert lines[2].startswith("t_ms    time (almost certainly)")
    assert lines[-1].endswith("input='u', output='y', time='t_ms')")
    assert "<table>" in look._repr_html_()
    assert len(look.plot().axes) == 2


def test_braille_shows_a_line() -> None:
    assert braille(np.arange(8.0), 4, 2) == ["⠀⠀⡠⠊", "⡠⠊⠀⠀"]
    assert braille([1.0, 1.0], 1, 1) == ["⣀"]
    assert braille([0.0, np.nan, np.nan, 3.0], 2, 1) == ["⡀⠈"]
    assert len(braille(RNG.standard_normal(100_000), 60, 4)[0]) == 60


ODD = {"t s": T, "u 'in' [V]": U, 'y "1" $HOME; *': Y}


@pytest.mark.parametrize(
    "columns",
    [
        {"t": T, "u": U, "y": Y},
        {"PWM": np.where(np.arange(N) % 50 == 0, 1000, U), "mVel": Y},
        {"Zeit": T, "-u": U, "y=a": Y},
    ],
    ids=["plain", "codes", "strange names"],
)
def test_the_proposed_command_works(run: Run, write: Write, tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    path = write(columns, "it's a log.csv")
    status, out, _ = run("describe", path)
    assert status == 0
    words = shlex.split(out.splitlines()[-1])
    assert words[:3] == ["emsid", "identify", str(path)]
    status, _, err = run(
        *words[1:], "--models", "arx", "--na", "1", "--nb", "1", "--nk", "1", "--out", tmp_path / "out"
    )
    assert status == 0, err


def test_reversed_leads_are_turned_in_the_proposed_command(write: Write) -> None:
    paths = [write({"t": T, "u": U, "y": sign * Y}, f"{sign}.csv") for sign in (1, -1)]
    right, against = map(describe, paths)
    assert [words[-2:] == ["--scale", "u=-1"] for words in proposals([right]) + proposals([against])] == [False, True]
    turned = describe(paths[1], scale={"u": -1})
    assert "response-negative" not in {each.code for each in turned.findings}
    assert proposals([turned]) == proposals([against])
    again = describe(paths[0], scale={"u": -2})
    assert proposals([again])[0][-2:] == ["--scale", "u=2"]


def test_a_file_is_parsed_once(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    from emsid.io import READERS

    parsed = []
    reader = READERS[".csv"]
    monkeypatch.setitem(READERS, ".csv", lambda content: parsed.append(1) or reader(content))
    assert emsid.describe(write({"t": T, "u": U, "y": Y})).record is not None
    assert len(parsed) == 1


def test_without_options_there_is_no_missing_option(run: Run, write: Write, tmp_path: Path) -> None:
    status, out, err = run("describe", write({"y": Y}))
    assert (status, err) == (0, "")
    assert "no column looks like the input; name it with --input" in out
    assert out.splitlines()[-1] == "nothing to identify here: see above"
    status, _, err = run("identify", write({"y": Y}))
    assert status == 2
    assert "name the input column; `emsid describe" in err


def test_json_and_a_page(run: Run, write: Write, tmp_path: Path) -> None:
    path = write({"t": T, "u": U, "y": -Y})
    status, out, _ = run("describe", path, "--json", "--out", tmp_path / "page")
    assert status == 0
    document = json.loads(out)
    (record,) = document["records"]
    assert record["guesses"]["input"]["column"] == "u"
    assert record["response"] == {"delay": 1, "sign": -1}
    assert {"response-negative", "excitation-sufficient"} <= {finding["code"] for finding in record["findings"]}
    assert document["commands"] == [f"emsid identify {path} --input u --output y --time t --scale u=-1"]
    page = (tmp_path / "page" / "report.html").read_text()
    assert "<svg" in page
    assert document["commands"][0] in re.sub("<[^>]+>", "", page)


def test_many_files_are_described_in_a_line_each(run: Run, write: Write) -> None:
    paths = [write({"t": T, "u": U, "y": Y}, f"{k}.csv") for k in range(4)]
    out = run("describe", *paths)[1]
    assert "- in 4 of 4 files, such as 0.csv: u is persistently exciting of order at least 50" in out
    assert shlex.split(out.splitlines()[-1])[2:6] == list(map(str, paths))


def test_columns_of_files_are_described_without_a_file(run: Run, write: Write) -> None:
    u, y = write({"u": U}, "u.csv"), write({"y": Y}, "y.csv")
    status, out, _ = run("describe", "--input", f"{u}:1", "--output", f"{y}:1", "--dt", "10ms")
    assert status == 0
    assert out.splitlines()[-1].split() == f"emsid identify {y} --input {u}:1 --output {y}:1 --dt 0.01".split()
    assert "missing argument 'FILE...'" in run("describe")[2]
