"""How signals are arranged in files: arrays in cells, JSON, labels, blocks, and times of their own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from emsid.errors import FormatError
from emsid.io.json_file import read_json, read_json_lines
from emsid.io.reading import read, read_columns
from emsid.io.table import read_table

N = 40
T = np.arange(N) / 50
U = np.sign(np.sin(np.arange(N)))
Y = np.cumsum(U) / 10


@pytest.mark.parametrize("kind", [pl.List(pl.Float32), pl.Array(pl.Float32, 2)])
@pytest.mark.parametrize("suffix", ["parquet", "feather"])
def test_lists_in_cells_are_columns(tmp_path: Path, kind: pl.DataType, suffix: str) -> None:
    pairs = np.column_stack([U, Y])
    frame = pl.DataFrame(
        {
            "timestamp": T,
            "observation.state": pl.Series(pairs.tolist(), dtype=kind),
            "pose": [{"x": y, "words": ["a", "b"][: k % 3]} for k, y in enumerate(Y)],
        }
    )
    path = tmp_path / f"episodes.{suffix}"
    frame.write_parquet(path) if suffix == "parquet" else frame.write_ipc(path)
    columns = read_columns(path)
    assert list(columns.series) == ["timestamp", "observation.state_1", "observation.state_2", "pose.x"]
    np.testing.assert_allclose(columns.series["observation.state_2"].to_numpy(), Y, rtol=1e-6)
    assert columns.others == {"pose.words": "lists of different lengths"}


def test_arrays_under_keys_of_json() -> None:
    data = {"config": {"fs": 50, "note": "x"}, "motor": {"u": [*U], "state": np.column_stack([U, Y]).tolist()}}
    columns = read_json(json.dumps(data).encode())
    assert list(columns.series) == ["motor.u", "motor.state_1", "motor.state_2"]
    np.testing.assert_array_equal(columns.series["motor.state_2"].to_numpy(), Y)
    assert columns.numbers == {"config.fs": 50}
    assert columns.others["config.note"] == "text"


@pytest.mark.parametrize("lines", [False, True])
def test_records_of_json(lines: bool) -> None:
    records = [{"t": t, "action": [u, 2 * u], "y": None if t == T[3] else y} for t, u, y in zip(T, U, Y, strict=True)]
    if lines:
        columns = read_json_lines("\n".join(map(json.dumps, records)).encode())
    else:
        columns = read_json(json.dumps(records).encode())
    assert list(columns.series) == ["t", "action_1", "action_2", "y"]
    np.testing.assert_array_equal(columns.series["action_2"].to_numpy(), 2 * U)
    assert np.isnan(columns.series["y"].to_numpy()).tolist() == [k == 3 for k in range(N)]


def test_runs_of_json_are_segments_at_the_rate_of_the_file(tmp_path: Path) -> None:
    runs = [{"type": "step", "actions": [*U], "angle": [*Y]}, {"type": "chirp", "actions": [*-U], "angle": [*-Y]}]
    path = tmp_path / "runs.json"
    path.write_text(json.dumps({"config": {"action_hz": 50}, "data": runs}))
    record = read(path, input="data.actions", output="data.angle", time="time")
    assert (record.dt, record.breaks) == (pytest.approx(0.02), (N,))
    np.testing.assert_array_equal(record.output[N:, 0], -Y)


def test_the_tests_of_sysid_are_segments(tmp_path: Path) -> None:
    rows = np.column_stack([T, U, np.cumsum(Y) / 50, Y])
    data = {"sysid": True, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0}
    data |= {name: rows.tolist() for name in ("slow-forward", "fast-forward")}
    path = tmp_path / "sysid.json"
    path.write_text(json.dumps(data))
    record = read(path, input="voltage", output="velocity", time="time", units={"velocity": "rev/s"})
    assert (record.dt, record.breaks, record.input_units) == (pytest.approx(0.02), (N,), ("V",))
    np.testing.assert_allclose(record.output[:N, 0], 2 * np.pi * Y)


@pytest.mark.parametrize("content", [b"{", b"[" * 100_000, b'{"a": {"b": 1}', b"3", b"null", b'{"sysid": true}'])
def test_json_that_holds_no_signals_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(content)
    with pytest.raises(FormatError) as problem:
        read_columns(path)
    assert len(str(problem.value).splitlines()) == 1


def labelled(shift: float = 0.0) -> bytes:
    head = 'Interval,0.02,Interval,0.02\nChannel name,"Force",Channel name,"Speed"\nUnit,"V",Unit,"V"\n'
    rows = (f"{t},{u},{t + shift},{y}" for t, u, y in zip(T, U, Y, strict=True))
    return (head + "\n".join(rows)).encode()


def test_names_and_units_behind_labels_in_the_first_cell() -> None:
    columns = read_table(labelled())
    assert (list(columns.series), dict(columns.units)) == (["time", "Force", "Speed"], {"Force": "V", "Speed": "V"})
    assert not columns.clocks
    one = "Channel;U;n\nUnit;V;rad/s\n" + "".join(f"{t};{u};{y}\n" for t, u, y in zip(T, U, Y, strict=True))
    columns = read_table(one.encode())
    assert (list(columns.series), columns.units["n"]) == (["time", "U", "n"], "rad/s")
    assert list(read_table(one.replace("Unit;V;rad/s\n", "").encode()).series) == ["Channel", "U", "n"]


def test_a_time_column_beside_every_channel(tmp_path: Path) -> None:
    columns = read_table(labelled(0.005))
    assert columns.clocks["Force"] == "time of Force"
    path = tmp_path / "x.csv"
    path.write_bytes(labelled(0.005))
    record = read(path, input="Force", output="Speed")
    assert record.dt == pytest.approx(0.02)
    np.testing.assert_array_equal(record.input[:, 0], U[: len(record)])  # held until the times of the output


def blocks(*names: str) -> str:
    text = "[key]; [value]\nVersion; 0x03050000\n"
    for k, name in enumerate(names):
        text += f"{k}.Variable; {name}\n{k}.Class; 14\n{k}.Data; \n"
        text += "".join(f"; {20 * j + 2}; {(k + 1) * y}\n" for j, y in enumerate(Y))
    return text


@pytest.mark.parametrize("names", [("DB.Setpoint", "Main.Speed", "Main.PID_OUT"), ("Axis1.v", "Axis2.v")])
def test_a_block_for_every_signal(names: tuple[str, ...]) -> None:
    columns = read_table(blocks(*names).encode())
    assert list(columns.series) == ["time", *names]
    np.testing.assert_allclose(columns.series[names[1]].to_numpy(), 2 * Y)
    np.testing.assert_array_equal(columns.series["time"].to_numpy(), 20 * np.arange(N) + 2)


def test_blocks_with_times_of_their_own_have_clocks() -> None:
    text = "Time,Volt\n" + "".join(f"{t},{u}\n" for t, u in zip(T, U, strict=True))
    columns = read_table(
        (text + "Time,Speed\n" + "".join(f"{2 * t},{y}\n" for t, y in zip(T, Y, strict=True))).encode()
    )
    assert columns.clocks["Speed"] == "time of Speed"
    np.testing.assert_array_equal(columns.series["time of Speed"].to_numpy(), 2 * T)


def test_runs_under_one_header_are_no_blocks() -> None:
    run = "time,u,y\n" + "".join(f"{t},{u},{y}\n" for t, u, y in zip(T, U, Y, strict=True))
    columns = read_table((run + run).encode())
    assert list(columns.series) == ["time", "u", "y"]
    assert not columns.clocks
    assert len(columns.series["u"]) == 2 * N + 1  # with the repeated header, a row to skip
