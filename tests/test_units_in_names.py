"""Units in brackets in the names of columns: which are taken, what decides, and how such columns are named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emsid.errors import DataError
from emsid.io import read
from emsid.record import Record
from emsid.units import SI, name_and_unit

Log = Callable[..., Path]


@pytest.fixture
def log(tmp_path: Path) -> Log:
    """Writes twenty rows: every column counts from 0, the later ones times 2, 3, …."""

    def write(header: str, name: str = "log.csv") -> Path:
        *above, last = header.split("\n")
        width = last.count(",") + 1
        rows = (",".join(str(k * (j + 1)) for j in range(width)) for k in range(20))
        path = tmp_path / name
        path.write_text("\n".join([*above, last, *rows]) + "\n")
        return path

    return write


def units(record: Record) -> tuple[str, ...]:
    return (*record.input_units, *record.output_units)


@pytest.mark.parametrize(
    ("column", "name", "unit", "size"),
    [
        ("speed [rad/s]", "speed", "rad/s", 1),
        ("speed(rad/s)", "speed", "rad/s", 1),
        ("speed {RAD/S}", "speed", "rad/s", 1),
        ("speed / (rad/s)", "speed", "rad/s", 1),
        ("torque (Nm)", "torque", "N*m", 1),
        ("voltage [Volt]", "voltage", "V", 1),
        ("voltage [mV]", "voltage", "V", 1e-3),
        ("a [m/s²]", "a", "m/s^2", 1),
        ("speed [rpm]", "speed", "rad/s", np.pi / 30),
        ("angle (°)", "angle", "rad", np.pi / 180),
        ("duty [%]", "duty", "1", 0.01),
        ("encoder [counts]", "encoder", "count", 1),  # of unknown size: the numbers remain, and so does the unit
        ("duty [pwm]", "duty", "pwm", 1),
    ],
)
def test_a_channel_is_converted_from_the_unit_in_the_name_of_its_column_to_si(
    log: Log, column: str, name: str, unit: str, size: float
) -> None:
    path = log(f"u,{column}")
    for asked in (name, column):
        record = read(path, input="u", output=asked, dt=0.1)
        assert (record.output_names, units(record)) == ((column,), ("", unit))
        np.testing.assert_allclose(record.output[:, 0], size * 2 * np.arange(20), rtol=1e-14)


@pytest.mark.parametrize(
    "column", ["speed [2]", "x (raw)", "y(n)", "y(t)", "v (v)", "flow [furlong]", "x [1]", "[V]", "x ()", "Encoder_A"]
)
def test_what_is_no_unit_is_part_of_the_name(log: Log, column: str) -> None:
    path = log(f"u,{column}")
    record = read(path, input="u", output=column, dt=0.1)
    assert (record.output_names, units(record)) == ((column,), ("", ""))
    bare = column.partition("[")[0].partition("(")[0].partition("_")[0].strip()
    with pytest.raises(DataError, match="there is no column"):
        read(path, input="u", output=bare, dt=0.1)


def test_a_name_with_another_unit_is_another_column(log: Log) -> None:
    path = log("u,speed [rad/s]")
    assert read(path, input="u", output="speed (rad/s)", dt=0.1).output_names == ("speed [rad/s]",)
    with pytest.raises(DataError, match=r"no column 'speed \[rpm\]'; did you mean 'speed \[rad/s\]'"):
        read(path, input="u", output="speed [rpm]", dt=0.1)


def test_columns_that_differ_by_their_units_are_named_with_them(log: Log) -> None:
    path = log("u,speed [rpm],speed [rad/s],speed2 [V],speed2")
    for options in ({"output": "speed"}, {"output": "d(speed)"}, {"output": "u", "time": "speed"}):
        with pytest.raises(DataError) as caught:
            read(path, **{"input": "u", "dt": 0.1, **options})  # type: ignore[arg-type]
        assert str(caught.value) == (
            f"{path}: several columns are called 'speed': 'speed [rpm]' and 'speed [rad/s]'; give the name with its "
            "unit"
        )
    with pytest.raises(DataError, match="the mask 'speed > 1' uses 'speed', which is the name of several columns"):
        read(path, input="u", output="speed2", dt=0.1, mask="speed > 1")
    assert read(path, input="u", output="speed (rpm)", dt=0.1).output[1, 0] == pytest.approx(2 * np.pi / 30)
    assert read(path, input="u", output="speed2", dt=0.1).output[1, 0] == 5  # one column has that very name


@pytest.mark.parametrize("name", ["speed", "speed [rad/s]", "speed (rad/s)"])
def test_every_argument_takes_a_column_with_or_without_its_unit(log: Log, name: str) -> None:
    path = log("t [ms],u [V],speed [rad/s],dir (raw)")
    record = read(
        path,
        input="u",
        output=name,
        time="t",
        scale={name: -2.0},
        offset={name: 1.0},
        wrap={name: 1000.0},
        shift={"u": -1},
        units={name: "deg/s"},
        mask="u > 20 and t < 13",
    )
    assert (record.input_names, record.output_names) == (("u [V]",), ("speed [rad/s]",))
    assert (record.dt, units(record)) == (0.001, ("V", "rad/s"))
    assert (len(record.breaks), len(record)) == (1, 17)
    np.testing.assert_allclose(record.output[:3, 0], np.deg2rad([1, -5, -11]))
    np.testing.assert_allclose(record.input[:3, 0], [2, 4, 6])
    assert record.converted("speed", 3.0) == pytest.approx(np.deg2rad(-5))


def test_a_unit_that_is_given_decides_then_a_row_of_units_then_the_name(log: Log) -> None:
    in_name, in_row = log("u [V],y [rad/s]"), log("u [V],y [rad/s]\n[mV],[Nm]", "row.csv")
    given: dict[str, Any] = {"input": "u", "output": "y", "dt": 0.1}
    assert units(read(in_name, **given)) == ("V", "rad/s")
    record = read(in_row, **given)
    assert (units(record), record.input[1, 0]) == (("V", "N*m"), pytest.approx(1e-3))
    record = read(in_row, **given, units={"u": "mV", "y [rad/s]": "rpm"})
    assert units(record) == ("V", "rad/s")
    np.testing.assert_allclose((record.input[1, 0], record.output[1, 0]), (1e-3, 2 * np.pi / 30))
    assert units(read(in_name, **given, units={"u": "1"})) == ("1", "rad/s")


def test_a_scale_may_change_the_unit(log: Log) -> None:
    path = log("tacho [V],y [rad/s]")
    given: dict[str, Any] = {"input": "tacho", "output": "y", "dt": 0.1}
    assert units(read(path, **given, scale={"tacho": 50.0, "y": -1.0}, offset={"y": 3.0})) == ("", "rad/s")
    assert units(read(path, **given, scale={"tacho": 50.0}, units={"tacho": "rad/s"})) == ("rad/s", "rad/s")


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("u,q [rad]", "rad/s"),
        ("u,q [m]", "m/s"),
        ("u,q\nV,rad/s", "rad/s^2"),
        ("u,q [V]", "V/s"),
        ("u,q [deg]", "rad/s"),
    ],
)
def test_a_derivative_has_the_unit_of_its_column_per_second(log: Log, header: str, unit: str) -> None:
    record = read(log(header), input="u", output="d(q)", dt=0.1)
    column = header.split("\n")[0].removeprefix("u,")
    assert (record.output_names, record.output_units) == ((f"d({column})",), (unit,))
    np.testing.assert_allclose(record.output, np.deg2rad(20) if "deg" in header else 20, rtol=1e-9)
    assert repr(record).endswith("d(q) [rad/s])") is (unit == "rad/s")
    assert read(log(header), input="u", output="d(q)", dt=0.1, units={"d(q)": "rpm"}).output_units == ("rad/s",)


def test_a_channel_of_another_file_has_the_unit_there(log: Log) -> None:
    a, b = log("t,value [V]", "a.csv"), log("t,value [rad/s]", "b.csv")
    record = read(b, input="a.csv:value", output="value", time="t")
    assert (record.input_names, record.output_names) == (("value [V]",), ("value [rad/s]",))
    assert units(record) == ("V", "rad/s")
    log("t,value [V],value [rpm]", "a.csv")
    with pytest.raises(DataError, match=rf"{a}: several columns are called 'value'"):
        read(b, input="a.csv:value", output="value", time="t")


def test_a_frame_is_read_likewise() -> None:
    frame = {"u [V]": np.arange(20.0), "speed (rad/s)": np.arange(20.0)}
    record = read(frame, input="u", output="speed", dt=0.1)
    assert (record.input_names, units(record)) == (("u [V]",), ("V", "rad/s"))


def test_a_deeply_nested_derivative_is_a_name() -> None:
    name = "d(" * 5000 + "x" + ")" * 5000
    assert name_and_unit(name) == (name, "")


def test_every_si_unit_that_logs_give_is_converted_to_itself(log: Log) -> None:
    for unit in SI:
        if name_and_unit(f"x [{unit}]")[1]:
            assert units(read(log(f"u,x [{unit}]"), input="u", output=["x", "d(x)"], dt=0.1))[1] == unit
