"""Layouts of files as loggers, spreadsheets and laboratories write them: every one gives the same columns."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

import emsid
from emsid.first_look.names import ColumnQuantity, meaning
from emsid.io import read_columns
from emsid.units import conversion

N = 40
T = 0.01 * np.arange(N)
U = np.repeat([1.5, -2.0, 0.5, 3.0], 10)
Y = np.sin(3 * T) + 0.25


def rows(separator: str = ",", end: str = "") -> str:
    return "".join(f"{separator.join(f'{x:.6f}' for x in row)}{end}\n" for row in zip(T, U, Y, strict=True))


def check(path: Path, names: list[str]) -> None:
    columns = read_columns(path)
    assert list(columns.series) == names
    for series, expected in zip(columns.series.values(), (T, U, Y), strict=True):
        np.testing.assert_allclose(series.to_numpy(), expected, atol=1e-6)
    assert not columns.damaged


@pytest.mark.parametrize("end", [";", ",", "\t"])
@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize("header", ["plain", "ended", "none"])
def test_a_separator_at_the_end_of_every_row_is_no_column(tmp_path, separator, end, header) -> None:
    above = "" if header == "none" else separator.join(["t", "u", "y"]) + (end if header == "ended" else "") + "\n"
    path = tmp_path / "log.csv"
    path.write_text(above + rows(separator, end))
    check(path, ["c1", "c2", "c3"] if header == "none" else ["t", "u", "y"])


def test_an_empty_named_last_column_is_kept(tmp_path) -> None:
    (tmp_path / "log.csv").write_text("t,u,y,note\n" + rows(end=","))
    assert list(read_columns(tmp_path / "log.csv").series) == ["t", "u", "y", "note"]


@pytest.mark.parametrize("name", ["run_3.t", "excite", "log.asc", "run.01"])
def test_a_text_of_an_unknown_suffix_is_a_table(tmp_path, name) -> None:
    (tmp_path / name).write_text("t,u,y\n" + rows())
    check(tmp_path / name, ["t", "u", "y"])


def test_other_content_of_an_unknown_suffix_is_refused(tmp_path) -> None:
    (tmp_path / "log.xyz").write_bytes(bytes(range(256)))
    with pytest.raises(emsid.FormatError, match="no reader for the suffix"):
        read_columns(tmp_path / "log.xyz")


@pytest.mark.parametrize("end", ["", ";"])
def test_names_and_units_in_two_comment_lines(tmp_path, end) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"%Motor data\n\n%t,voltage,speed{end}\n%[ms],[mV],[turns/s]{end}\n" + rows(end=end))
    check(path, ["t", "voltage", "speed"])
    assert dict(read_columns(path).units) == {"t": "ms", "voltage": "mV", "speed": "turns/s"}
    assert read_columns(path).unit("speed") == "rev/s"


def test_names_over_two_lines_are_joined_where_the_lower_one_repeats(tmp_path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(",Motor,Motor,Load\ntime,voltage,speed,speed\ns,V,rpm,rpm\n")
    with path.open("a") as file:
        file.writelines(f"{t:.3f},{u},{y},{2 * y}\n" for t, u, y in zip(T, U, Y, strict=True))
    columns = read_columns(path)
    assert list(columns.series) == ["time", "Motor voltage", "Motor speed", "Load speed"]
    assert columns.unit("Load speed") == "rpm"


@pytest.mark.parametrize(("separator", "line"), [*product([",", ";", "\t"], ["\n", "\r\n"])])
def test_a_line_break_in_a_name_is_a_blank(tmp_path, separator, line) -> None:
    path = tmp_path / "log.csv"
    names = ["Time\n[ms]", "Motor\nvoltage [mV]", "Motor\nspeed [rpm]"]
    header = separator.join(f'"{name}"' for name in names) + "\n"
    path.write_bytes((header + rows(separator)).replace("\n", line).encode())
    check(path, ["Time [ms]", "Motor voltage [mV]", "Motor speed [rpm]"])
    columns = read_columns(path)
    assert columns.number(0) == 5  # the header takes four lines of the file
    record = emsid.read(path, input="Motor voltage", output="Motor speed", time="Time")
    assert (record.input_units, record.output_units) == (("V",), ("rad/s",))
    np.testing.assert_allclose(record.dt, 1e-5)
    np.testing.assert_allclose(record.output[:, 0], Y * np.pi / 30, atol=1e-6)


def test_a_capture_of_dspace_has_its_signals_by_name(tmp_path) -> None:
    def path(name: str) -> str:
        return f'"Model Root"/"{name}"/"Out1"'

    signals = np.array([(path("Duty"), U), (path("Speed"), Y)], dtype=[("Name", object), ("Data", object)])
    savemat(tmp_path / "a.mat", {"capture": {"X": {"Name": "", "Data": T}, "Y": signals}}, oned_as="row")
    check(tmp_path / "a.mat", ["time", "Duty", "Speed"])


@pytest.mark.parametrize(
    ("name", "unit", "quantity"),
    [
        ("commanded_deg_s", "deg/s", None),
        ("velocity_rad_s", "rad/s", ColumnQuantity.SPEED),
        ("speed_m_s", "m/s", ColumnQuantity.SPEED),
        ("omega_rad_per_s", "rad/s", ColumnQuantity.SPEED),
        ("motor_speed_rpm", "rpm", ColumnQuantity.SPEED),
        ("acc_rad_s2", "rad/s^2", ColumnQuantity.ACCELERATION),
        ("flow_l_s", "", None),
        ("time_s", "s", ColumnQuantity.TIME),
        ("gain_s", "s", None),
    ],
)
def test_the_longest_unit_at_the_end_of_a_name_is_read(name, unit, quantity) -> None:
    said = meaning(name)
    assert said.unit == unit
    assert quantity is None or said.quantity is quantity
    assert name in ("time_s", "gain_s") or said.quantity is not ColumnQuantity.TIME


def test_a_time_and_one_angle_alone_have_no_input(tmp_path) -> None:
    path = tmp_path / "angle.csv"
    angle = 20 * np.clip(T - 0.1, 0, None) + 0.2 * T
    path.write_text("Timestamp,Angle in deg\n" + "".join(f"{t:.3f},{x:.3f}\n" for t, x in zip(T, angle, strict=True)))
    assert "no-role-found" in [finding.code for finding in emsid.describe(path).findings]


@pytest.mark.parametrize("header", ["{n} [{u}]", "{n} ({u})", "{n}{{{u}}}", "{n}"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize(("unit_u", "unit_y"), [("mV", "rpm"), ("V", "deg/s"), ("mV", "rev/s"), ("V", "rad/s")])
def test_a_unit_is_converted_in_every_style_of_header(tmp_path, header, separator, unit_u, unit_y) -> None:
    names = [header.format(n=n, u=u) for n, u in (("t", "s"), ("voltage", unit_u), ("speed", unit_y))]
    units = "" if "u}" in header else separator.join(["s", unit_u, unit_y]) + "\n"
    path = tmp_path / "log.csv"
    path.write_text(separator.join(names) + "\n" + units + rows(separator))
    record = emsid.read(path, input="voltage", output="speed", time="t")
    assert (record.input_units, record.output_units) == (("V",), ("rad/s",))
    np.testing.assert_allclose(record.input[:, 0], conversion(unit_u, "V").gain * U, atol=1e-6)
    np.testing.assert_allclose(record.output[:, 0], conversion(unit_y, "rad/s").gain * Y, atol=1e-5)


@pytest.mark.parametrize(
    "units", [("V", "rad/s"), ("A", "rad"), ("1", "m/s"), ("N*m", "kg*m^2"), ("", "ohm"), ("", "")]
)
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".npz"])
def test_a_written_record_is_read_back_with_its_units(tmp_path, units, suffix) -> None:
    record = emsid.Record(U, Y, 0.01, "command", "answer", units[0], units[1])
    path = tmp_path / f"log{suffix}"
    emsid.write_record(record, path)
    again = emsid.read(path, input="command", output="answer", time="t")
    assert (again.input_units, again.output_units) == ((units[0],), (units[1],))
    np.testing.assert_array_equal(again.output, record.output)
    if suffix == ".csv":
        np.testing.assert_array_equal(np.loadtxt(path, skiprows=1, delimiter=",")[:, 1:], np.column_stack([U, Y]))
        assert pl.read_csv(path).dtypes == [pl.Float64] * 3


def test_captures_of_dspace_in_cells(tmp_path) -> None:
    signals = np.empty(2, dtype=object)
    signals[:] = [{"Name": '"Root"/"Duty"/"Out1"', "Data": U}, {"Name": '"Root"/"Speed"/"Out1"', "Data": Y}]
    savemat(tmp_path / "a.mat", {"bench": {"X": {"Name": np.empty((0, 0)), "Data": T}, "Y": signals}})
    check(tmp_path / "a.mat", ["time", "Duty", "Speed"])


@pytest.mark.parametrize("stale", [1, 2, 3])
def test_stale_first_rows_are_left_out(tmp_path, stale) -> None:
    rng = np.random.default_rng(4)
    u = rng.choice([-3.0, 3.0], 15).repeat(20)
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = 0.9 * y[k - 1] + 2 * u[k - 1]
    t = np.concatenate([7 + 0.01 * np.arange(stale), 0.008 + 0.01 * np.arange(len(u) - stale)])
    path = tmp_path / "log.csv"
    path.write_text("t,duty,omega\n" + "".join(f"{a:.3f},{b},{c:.3f}\n" for a, b, c in zip(t, u, y, strict=True)))
    look = emsid.describe(path)
    assert look.reading["rows"] == slice(stale, None)
    assert look.record is not None
    assert len(look.record) == len(u) - stale
    assert look.record.dt == pytest.approx(0.01)


@pytest.mark.parametrize("restarts", [1, 3])
def test_an_uneven_time_without_a_name_is_the_clock(tmp_path, restarts) -> None:
    rng = np.random.default_rng(6)
    text = ""
    for run in range(restarts):
        t = 0.004 + np.cumsum(rng.choice([0.005, 0.0065, 0.008, 0.03], 90, p=[0.5, 0.3, 0.15, 0.05]))
        duty = 20.0 + 15 * run
        speed = 6 * duty * (1 - np.exp(-t / 0.1))
        text += "".join(
            f"{duty:g}; {a:.7f};{b:.0f};{c:.0f}\n" for a, b, c in zip(t, speed, np.cumsum(speed) / 50, strict=True)
        )
    path = tmp_path / "run.csv"
    path.write_text(text)
    clock = emsid.describe(path).clock
    assert clock.column == "c2"
    assert 0.004 < clock.dt < 0.009


def test_a_position_whose_steps_go_with_its_speed_is_no_clock(tmp_path) -> None:
    rng = np.random.default_rng(7)
    speed = 2 + np.sin(np.arange(200) / 15) + 0.1 * rng.standard_normal(200)
    position = 0.02 * np.cumsum(speed)
    path = tmp_path / "joint.csv"
    path.write_text("".join(f"{u:.4f},{q:.5f},{w:.4f}\n" for u, q, w in zip(0.5 * speed, position, speed, strict=True)))
    assert emsid.describe(path).clock.column == ""


@pytest.mark.parametrize("blank", ["", " "])
def test_a_header_with_the_first_row_behind_it_is_said_and_the_rest_is_read(tmp_path, blank) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,voltage,speed" + blank + rows())
    columns = read_columns(path)
    assert list(columns.series) == ["t", "voltage", "speed"]
    assert [len(series) for series in columns.series.values()] == [N - 1] * 3
    with pytest.raises(emsid.DataError, match="row 1 of the file has 5 values where the others have 3"):
        emsid.read(path, input="voltage", output="speed", time="t")
    record = emsid.read(path, input="voltage", output="speed", time="t", skip_bad_rows=True)
    np.testing.assert_allclose(record.output[:, 0], Y[1:], atol=1e-6)
    assert "rows-skipped" in [finding.code for finding in record.findings]


def test_a_time_of_day_in_a_sheet_of_opendocument(tmp_path) -> None:
    def cell(value: float | str, kind: str = "float") -> str:
        if isinstance(value, str):
            return f'<table:table-cell office:value-type="string"><text:p>{value}</text:p></table:table-cell>'
        if kind == "time":
            value = f"PT10H00M{value:09.6f}S"  # type: ignore[assignment]
        attribute = "time-value" if kind == "time" else "value"
        return f'<table:table-cell office:value-type="{kind}" office:{attribute}="{value}"/>'

    lines = [cell("time") + cell("voltage [V]") + cell("speed")]
    lines += [
        cell(0.5 * k, "time") + cell(float(u)) + cell(float(y)) for k, (u, y) in enumerate(zip(U, Y, strict=True))
    ]
    names = ("office", "table", "text")
    spaces = " ".join(f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"' for name in names)
    body = "".join(f"<table:table-row>{line}</table:table-row>" for line in lines)
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    with ZipFile(tmp_path / "log.ods", "w") as archive:
        archive.writestr("mimetype", kind)
        archive.writestr(
            "content.xml",
            f'<office:document-content {spaces} office:version="1.2"><office:body><office:spreadsheet>'
            f'<table:table table:name="S">{body}</table:table></office:spreadsheet></office:body>'
            "</office:document-content>",
        )
        archive.writestr(
            "META-INF/manifest.xml",
            '<manifest:manifest xmlns:manifest="urn:oasis:names:tc:opendocument:xmlns:manifest:1.0">'
            f'<manifest:file-entry manifest:full-path="/" manifest:media-type="{kind}"/></manifest:manifest>',
        )
    record = emsid.read(tmp_path / "log.ods", input="voltage", output="speed", time="time")
    assert record.dt == pytest.approx(0.5)
    assert record.time[0] == pytest.approx(36000)
    np.testing.assert_allclose(record.output[:, 0], Y)
