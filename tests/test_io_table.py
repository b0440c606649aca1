"""Text tables: every dialect that gives the same numbers, and every damage that is named with its row."""

from __future__ import annotations

import csv
import io

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emsid.errors import FormatError
from emsid.io.columns import Columns, as_numbers
from emsid.io.table import read_table

ROWS = [[0.0, 1.5, -2.25], [0.5, 0.0, 1e-3], [1.0, -7.0, 3.125]]


def columns_of(text: str, encoding: str = "utf-8") -> Columns:
    return read_table(text.encode(encoding))


def numbers(columns: Columns) -> list[list[float]]:
    return [list(row) for row in zip(*(s.to_list() for s in columns.series.values()), strict=True)]


DIALECTS = {
    "comma": "t,u,y\n0,1.5,-2.25\n0.5,0,1e-3\n1,-7,3.125\n",
    "semicolon": "t;u;y\n0;1.5;-2.25\n0.5;0;1e-3\n1;-7;3.125",
    "tab": "t\tu\ty\n0\t1.5\t-2.25\n0.5\t0\t1E-3\n1\t-7\t3.125\n",
    "blanks": "  t   u      y\n  0   1.5   -2.25\n  0.5 0  .001\n  1. -7 +3.125  \n",
    "comma and blanks": "t, u, y\n0 , 1.5, -2.25\n0.5,  0, 1e-3\n1, -7, 3.125\n",
    "decimal commas, semicolon": "t;u;y\n0;1,5;-2,25\n0,5;0;1e-3\n1;-7;3,125\n",
    "decimal commas, tab": "t\tu\ty\n0\t1,5\t-2,25\n0,5\t0\t1,0e-3\n1\t-7\t3,125\n",
    "decimal commas, blanks": "t u y\n0 1,5 -2,25\n0,5 0 0,001\n1 -7 3,125\n",
    "quoted numbers with decimal commas": 't,u,y\n"0","1,5","-2,25"\n"0,5","0","0,001"\n"1","-7","3,125"\n',
    "CRLF": "t,u,y\r\n0,1.5,-2.25\r\n0.5,0,1e-3\r\n1,-7,3.125\r\n",
    "CR": "t,u,y\r0,1.5,-2.25\r0.5,0,1e-3\r1,-7,3.125",
    "byte order mark": "\ufefft,u,y\n0,1.5,-2.25\n0.5,0,1e-3\n1,-7,3.125\n",
    "quoted names": '"t";"u";"y"\n0;1.5;-2.25\n0.5;0;1e-3\n1;-7;3.125\n',
    "comments": "# logged by me\n% on a Monday\n\nt,u,y\n0,1.5,-2.25\n# pause\n0.5,0,1e-3\n\n1,-7,3.125\n# end\n",
    "names in a comment": "# a logger\n# t,u,y\n0,1.5,-2.25\n0.5,0,1e-3\n1,-7,3.125\n",
    "names in a comment, blanks": "% t u y\n0 1.5 -2.25\n0.5 0 1e-3\n1 -7 3.125\n",
    "preamble": "Pendulum, try 7\nroom 12\nt\tu\ty\n0\t1.5\t-2.25\n0.5\t0\t1e-3\n1\t-7\t3.125\n",
    "preamble table": "Pendulum\ndt\tOCR2A\tdiv\n10\t156\t1024\nt\tu\ty\n0\t1.5\t-2.25\n0.5\t0\t1e-3\n1\t-7\t3.125\n",
    "long preamble": "note\n" * 300 + "t,u,y\n0,1.5,-2.25\n0.5,0,1e-3\n1,-7,3.125\n",
    "row of units": "t,u,y\n(s),[V],rad/s\n0,1.5,-2.25\n0.5,0,1e-3\n1,-7,3.125\n",
    "separator at the end of the data": "t,u,y\n0,1.5,-2.25,\n0.5,0,1e-3,\n1,-7,3.125,\n",
    "separator at the end of the header": "t,u,y,\n0,1.5,-2.25\n0.5,0,1e-3\n1,-7,3.125\n",
    "labels": "boot mode:(3,6)\nReady.\nt:0,u:1.5,y:-2.25\nt:0.5,u:0,y:1e-3\nt:1,u:-7,y:3.125,\n",
    "labels, blanks": "t=0 u=1.5 y=-2.25\nt=.5 u=0 y=1e-3\nt=1. u=-7 y=+3.125 \n",
    "labels, tab": "t: 0\tu: 1.5\ty: -2.25\nt: 0.5\tu: 0\ty: 1e-3\nt: 1\tu: -7\ty: 3.125\n",
    "labels and units": "t: 0 s, u: 1.5 V, y: -2.25\nt: 0.5 s, u: 0V, y: 1e-3\nt: 1 s, u: -7 V, y: 3.125\n",
    "preamble as wide as the table": "Model,MSO24\nInterval,1.5e-2,s\nLength,20,points\nt,u,y\n"
    "0,1.5,-2.25\n0.5,0,1e-3\n1,-7,3.125\n",
    "JSON lines": '{"t": 0, "u": 1.5, "y": -2.25}\n{"t":0.5,"u":0,"y":1e-3}\n{"t": 1, "u": -7, "y": 3.125}\n',
}


@pytest.mark.parametrize("text", DIALECTS.values(), ids=DIALECTS)
def test_every_dialect_gives_the_same_columns(text: str) -> None:
    columns = columns_of(text)
    assert list(columns.series)[:3] == ["t", "u", "y"]
    assert [row[:3] for row in numbers(columns)] == ROWS


def test_lines_of_a_serial_monitor_have_labels_units_and_times() -> None:
    columns = columns_of(
        "12:00:00.010 -> Ready.\n12:00:00.020 -> PWM:120 motor speed:3.5 rad/s\n"
        "12:00:00.030 -> PWM:-4 motor speed:nan\n12:00:00.040 -> PWM:7 mot\n12:00:00.050 -> PWM:6 motor speed:1 rad/s\n"
    )
    assert list(columns.series) == ["time", "PWM", "motor speed"]
    assert columns.units == {"motor speed": "rad/s"}
    assert [str(row) for row in columns.damaged] == [
        "row 4 of the file has 2 values where the others have 3 ('12:00:00.040 PWM:7 mot')"
    ]
    np.testing.assert_allclose(as_numbers(columns.series["time"]), [0, 0.01, 0.03])
    np.testing.assert_array_equal(as_numbers(columns.series["PWM"]), [120, -4, 6])
    np.testing.assert_array_equal(as_numbers(columns.series["motor speed"]), [3.5, np.nan, 1])


@pytest.mark.parametrize(
    "before",
    [
        "[INFO] [1700000000.{}]: ",
        "[INFO] 1700000000.{} motor: ",
        "2024-03-05 10:00:00,{} - INFO - ",
        "I 10:00:00.{} (main): ",
    ],
)
def test_a_log_with_a_time_a_level_and_labels(before: str) -> None:
    columns = columns_of("".join(f"{before.format(100 + 50 * k)}cmd={k} vel={k / 2}A\n" for k in range(4)) + "done\n")
    assert list(columns.series) == ["time", "cmd", "vel"]
    assert columns.units == {"vel": "A"}
    times = columns.series["time"]
    if times.dtype == pl.Datetime:
        times = times.dt.epoch("us") / 1e6
    np.testing.assert_allclose(np.diff(as_numbers(times)), 0.05, atol=1e-6)
    np.testing.assert_array_equal(as_numbers(columns.series["cmd"]), range(4))


@pytest.mark.parametrize(
    "text",
    [
        "(0, 1.5, -2.25)\n(0.5, 0, 1e-3)\n(1, -7, 3.125)\n",
        "[[ 0.   1.5   -2.25 ]\n [ 0.5  0.  1.e-3]\n [ 1. -7.   3.125]]\n",
        "data = [\n0 1.5 -2.25;\n0.5 0 1e-3;\n1 -7 3.125;\n];\n",
        "x = np.array([\n [0, 1.5, -2.25],\n [0.5, 0, 1e-3],\n [1, -7, 3.125],\n])\n",
    ],
)
def test_rows_of_a_list_or_a_matrix_lose_their_brackets(text: str) -> None:
    columns = columns_of(text)
    assert list(columns.series) == ["c1", "c2", "c3"]
    assert numbers(columns) == ROWS
    assert columns.damaged == ()


def test_both_headers_of_labview_are_no_data() -> None:
    first = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n\n"
    second = "Channels\t2\nSamples\t3\t3\nX0\t0\t0\nDelta_X\t1\t1\n***End_of_Header***\n"
    rows = "0\t1.5\t-2.25\n0.5\t0\t1e-3\n1\t-7\t3.125\n"
    columns = columns_of(f"{first}{second}X_Value\tu\ty\tComment\n{rows}")
    assert list(columns.series) == ["X_Value", "u", "y"]
    assert numbers(columns) == ROWS
    assert "LabVIEW Measurement" in columns.preamble


@pytest.mark.parametrize("arrow", ["->", ">"])
@pytest.mark.parametrize("separator", ["\t", ",", " "])
def test_times_before_an_arrow_are_a_column(separator: str, arrow: str) -> None:
    rows = [["pwm", "speed"], ["1", "2.5"], ["3", "4.5"]]
    lines = [f"23:59:5{k}.5 {arrow} {separator.join(row)}" for k, row in enumerate(rows, 7)]
    columns = columns_of("\n".join(lines))
    assert list(columns.series) == ["time", "pwm", "speed"]
    np.testing.assert_allclose(as_numbers(columns.series["time"]), [0, 1])
    np.testing.assert_array_equal(as_numbers(columns.series["speed"]), [2.5, 4.5])


def test_other_encodings() -> None:
    assert list(columns_of("t;µ·°\n1;2\n", "latin-1").series) == ["t", "µ·°"]
    assert numbers(columns_of("t\tu\n1\t2\n3\t4\n", "utf-16")) == [[1, 2], [3, 4]]


def test_names() -> None:
    assert list(columns_of("1;2\n3;4\n").series) == ["c1", "c2"]
    assert list(columns_of('"Speed (rpm), left",u\n1,2\n').series) == ["Speed (rpm), left", "u"]
    assert list(columns_of('"Speed left" u\n1 2\n3 4\n').series) == ["Speed left", "u"]
    assert list(columns_of("u,u,,u_2\n1,2,3,4\n").series) == ["u", "u_2", "c3", "u_2_2"]
    assert list(columns_of("u\n1\n2\n").series) == ["u"]
    assert list(columns_of("Timestamp(ms),Motor_Speed(RPM)\n1,2\n").series) == ["Timestamp(ms)", "Motor_Speed(RPM)"]


def test_units_below_the_names_are_kept() -> None:
    assert columns_of("Time,A,B\n(ms),(V),\n0,1,2\n1,2,3\n").units == {"Time": "ms", "A": "V"}


def test_the_preamble_is_kept_for_hints() -> None:
    assert columns_of("# by me\nPendulum\n(dt=10)\nu\ty\n1\t2\n3\t4\n").preamble == ("by me", "Pendulum", "(dt=10)")


def test_rows_are_counted_as_an_editor_counts_them() -> None:
    columns = columns_of("# by me\n\nu,y\n1,2\n# pause\n3,4\n")
    assert [columns.place(k) for k in range(2)] == ["row 4 of the file", "row 6 of the file"]


def test_a_column_with_text_or_gaps_does_not_disturb_the_others() -> None:
    columns = columns_of("t,state,u\n0,IDLE,1\n1,,NaN\n2,RUN 1,\n3,RUN,inf\n")
    assert columns.series["state"].to_list() == ["IDLE", None, "RUN 1", "RUN"]
    assert columns.series["t"].dtype == columns.series["u"].dtype == pl.Float64
    np.testing.assert_array_equal(columns.series["u"].fill_null(-1).to_numpy(), [1, np.nan, -1, np.inf])


def test_text_in_a_column_of_decimal_commas_stays_and_the_numbers_are_read() -> None:
    assert columns_of("t;u\n0;0,5\n1;ERR\n2;1,5\n").series["u"].to_list() == ["0.5", "ERR", "1.5"]
    assert columns_of("t;u\n0;1,234\n1;2,5\n").series["u"].to_list() == [1.234, 2.5]  # thousands are not guessed


@pytest.mark.parametrize(
    ("content", "where"),
    [
        (b"t,u,y\n0,1,2\n1,2,3\n2,3\n", ["row 4 of the file has 2 values where the others have 3 ('2 3')"]),
        (b"t,u\n0,1\n1,2,3\n2,3\n3,4\n", ["row 3 of the file has 3 values where the others have 2 ('1 2 3')"]),
        (b"t u\n0 1\n# x\n1\n2 3\n3 4\n", ["row 4 of the file has 1 value where the others have 2 ('1')"]),
        (b"t u\n0 1\n# x\n2 3\n3 4\n", []),
    ],
)
def test_lines_of_another_width_are_kept_apart(content: bytes, where: list[str]) -> None:
    columns = read_table(content)
    assert [str(row) for row in columns.damaged] == where
    for row in columns.damaged:
        assert row.is_sample
        assert all(series[row.row] is None for series in columns.series.values())


def test_data_that_begin_with_missing_values() -> None:
    columns = columns_of("t,u\nNA,NA\nNA,NA\n1,2\n3,4\n")
    assert list(columns.series) == ["t", "u"]
    assert columns.series["t"].to_list() == ["NA", "NA", "1", "3"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"# only\n# comments\n\n", "no table in this file, only comments or blank lines"),
        (b"Dear reader,\nhow are you?\n", "no numbers in this file"),
        (b"t,u\n0,1\n2\n3\n4\n5,6\n7,8\n9,1,2\n9,1,3\n", "row 3 of the file has 1 value where the others have 2"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "not a text table; it looks like a PNG image"),
        (b"PK\x03\x04 spreadsheet", "it looks like a ZIP archive"),
        (b"MATLAB 5.0 MAT-file, Platform: X", "it looks like a MAT file"),
        (b"PAR1 text", "it looks like a Parquet file"),
        (b"t,u\n0,1\n\0\0\0\0\n2,3\n", "not a text table; it looks like binary data"),
        (b"t,u\n" + b"0,1\n" * 2000 + b"\0\0\n2,3\n", "text with binary data in row 2002"),
        (b"\xff\xfet\0,\0u", "no numbers in this file"),
    ],
)
def test_what_is_no_table(content: bytes, message: str) -> None:
    with pytest.raises(FormatError, match=message) as caught:
        read_table(content)
    assert "\n" not in str(caught.value)


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.integers(1, 4).flatmap(lambda k: st.lists(st.lists(finite, min_size=k, max_size=k), min_size=1, max_size=20)),
    st.sampled_from([",", ";", "\t", " "]),
    st.booleans(),
    st.booleans(),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["", "# a comment\n", "Logger, the third\n\n"]),
)
def test_numbers_come_back_bit_by_bit(
    rows: list[list[float]], separator: str, decimal_comma: bool, header: bool, end: str, above: str
) -> None:
    decimal_comma = decimal_comma and separator != "," and len(rows[0]) > 1
    lines = [separator.join(map(repr, row)) for row in rows]
    if decimal_comma:
        lines = [line.replace(".", ",") for line in lines]
    names = [f"name{k}" for k in range(len(rows[0]))]
    text = above + end.join(([separator.join(names)] if header else []) + lines) + end
    columns = columns_of(text)
    if header:
        assert list(columns.series) == names
    np.testing.assert_array_equal(numbers(columns), rows)


@given(
    st.lists(st.text(st.characters(exclude_categories=("Cc", "Cs")), min_size=1), min_size=2, max_size=4, unique=True)
)
def test_quoted_names_come_back(names: list[str]) -> None:
    names = [f"x{name.strip()}x" for name in names]
    text = io.StringIO()
    csv.writer(text, quoting=csv.QUOTE_ALL).writerows([names, *([[1.5] * len(names)] * 3)])
    assert list(columns_of(text.getvalue()).series) == names or len(set(names)) < len(names)


def test_every_row_of_a_long_table_is_read() -> None:
    rows = 200_000
    columns = read_table(b"t,u\n" + b"".join(b"%d.125,-%d\n" % (k, k % 977) for k in range(rows)))
    np.testing.assert_array_equal(columns.series["t"].to_numpy(), np.arange(rows) + 0.125)
    np.testing.assert_array_equal(columns.series["u"].to_numpy(), -(np.arange(rows) % 977))


@pytest.mark.parametrize(
    "line",
    [
        "(1700000000.0008) can0 181#FFFF",
        "(1700000000.0008)  vcan0  0000201#F4D40000 R",
        "  can0  201   [4]  F4 D4 00 00",
        " (001.25)  can0  181   [2]  41 42   'AB'",
    ],
)
def test_frames_of_a_can_bus_are_named_with_what_helps(line: str) -> None:
    with pytest.raises(FormatError, match=r"log of CAN frames.*give the DBC file"):
        columns_of(f"{line}\n" * 20)


def test_times_of_day_with_am_and_pm() -> None:
    columns = columns_of("Time,u\n11:59:59.500 AM,1\n12:00:00.000 PM,2\n12:00:00.500 PM,3\n")
    assert as_numbers(columns.series["Time"]).tolist() == [0.0, 0.5, 1.0]
    columns = columns_of("Time,u\n03/04/2026 11:59:59.5 PM,1\n03/05/2026 12:00:00 AM,2\n")
    assert as_numbers(columns.series["Time"]).tolist() == [0.0, 0.5]


@pytest.mark.parametrize(
    "cells",
    [
        ("-1.4", "1,234.5", "12,345"),
        ("-1,4", "1.234,5", "12.345"),
        ("-1.4", "1,234.5", ""),
        ("1,234,567", "2", "3"),
    ],
)
def test_separators_of_thousands(cells: tuple[str, ...]) -> None:
    columns = columns_of("t;y\n" + "".join(f"{k};{cell}\n" for k, cell in enumerate(cells)))
    group = "." if "-1,4" in cells else ","
    expected = [float(cell.replace(group, "").replace(",", ".")) if cell else None for cell in cells]
    assert columns.series["y"].to_list() == expected


def test_texts_that_only_resemble_grouped_numbers_stay_texts() -> None:
    assert columns_of("t;y\n0;1,23,4\n1;2.5\n").series["y"].dtype == pl.String
    assert columns_of("t;y\n0;1.2.3\n1;2\n").series["y"].dtype == pl.String


def test_minutes_and_seconds_are_times() -> None:
    columns = columns_of("elapsed,u\n00:59.500,1\n01:00.000,2\n01:00.250,3\n")
    assert as_numbers(columns.series["elapsed"]).tolist() == [0.0, 0.5, 0.75]


def test_a_pair_of_words_is_one_and_zero_and_stays_text_for_masks() -> None:
    columns = columns_of("t,dir,state\n0,CW,RUN\n1,ccw,STOP\n2,CW,ON\n")
    assert columns.series["dir"].dtype == pl.String
    assert as_numbers(columns.series["dir"]).tolist() == [1.0, 0.0, 1.0]
    assert np.isnan(as_numbers(columns.series["state"])).all()


def test_a_first_row_with_a_damaged_value_is_no_preamble() -> None:
    columns = columns_of("t,u,y\n0,ERR,-2.25\n0.5,0,1e-3\n1,-7,3.125\n")
    assert list(columns.series) == ["t", "u", "y"]
    assert len(columns.series["t"]) == 3


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("between", ["", " "])
def test_units_behind_the_numbers_are_units_of_the_columns(separator: str, between: str) -> None:
    units = ("ms", "V", "rad/s")
    lines = [separator.join(f"{x:g}{between}{unit}" for x, unit in zip(row, units, strict=True)) for row in ROWS]
    columns = columns_of("\n".join((separator.join("tuy"), *lines)))
    assert numbers(columns) == ROWS
    assert columns.units == dict(zip("tuy", units, strict=True))


def test_units_behind_numbers_allow_decimal_commas_and_times_before_an_arrow() -> None:
    assert columns_of("t;u\n0 s;1,5 V\n1 s;-0,25 V\n").series["u"].to_list() == [1.5, -0.25]
    columns = columns_of("".join(f"12:00:0{k} -> {k} V,{k}.5 rpm\n" for k in range(3)))
    assert list(columns.units.values()) == ["V", "rpm"]


def test_numbers_with_different_or_unknown_units_stay_texts() -> None:
    assert columns_of("t,u\n0,1 V\n1,20 mV\n").series["u"].dtype == pl.String
    assert columns_of("t,u\n0,1 furlong\n1,2 furlong\n").series["u"].dtype == pl.String


def test_hexadecimal_numbers_have_a_mark_in_front() -> None:
    columns = columns_of("t,pwm,code\n0,0x0A,0A\n1,0xff,FF\n2,,1B\n")
    assert columns.series["pwm"].to_list() == [10.0, 255.0, None]
    assert columns.series["code"].dtype == pl.String


def test_values_that_an_oscilloscope_writes_once_under_their_names() -> None:
    text = "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-2.0e+00,1.0e-03\n0,1.5,2.5,,\n1,1.25,2.0,,\n2,1.0,1.5,,\n"
    columns = columns_of(text)
    assert numbers(columns) == [[0.0, 1.5, 2.5], [1.0, 1.25, 2.0], [2.0, 1.0, 1.5]]
    assert columns.units == {"CH1": "Volt", "CH2": "Volt"}
    assert columns.preamble == ("Start -2.0e+00", "Increment 1.0e-03")
    assert columns.number(0) == 3


def test_a_first_row_with_a_text_and_a_value_that_others_lack_is_data() -> None:
    columns = columns_of("t,u,note,gain\n0,1.5,start,5\n1,1.25,,\n2,1.0,,\n")
    assert columns.series["u"].to_list() == [1.5, 1.25, 1.0]
    assert columns.preamble == ()
    columns = columns_of("t,u,y\n0.0\n0.0,,1_0\n,0.0,0.0\n")  # without names above it
    assert columns.series["c1"].to_list() == [0.0, None]
