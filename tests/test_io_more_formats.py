"""Formats that other packages read: a file of each kind, and the message where the package is missing."""

from __future__ import annotations

import json
import re
import struct
import tomllib
from collections.abc import Callable
from functools import partial
from importlib import import_module
from io import BytesIO
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import emsid
from emsid.errors import EmsidError, FormatError
from emsid.io import READERS, ParsedFile, read_columns, sandbox
from emsid.io.columns import Columns
from emsid.io.messages import on_one_clock
from emsid.io.parquet import read_arrow
from emsid.io.sandbox import in_sandbox
from emsid.io.spreadsheet import read_spreadsheet

N = 60
T = 0.01 * np.arange(N)
U = np.repeat([0.0, 3.0, -2.0, 5.0, 1.0, 4.0], 10)
Y = np.cumsum(U) / 10


def feather() -> bytes:
    content = BytesIO()
    pl.DataFrame({"t": T, "u": U, "y": Y}).write_ipc(content, compression="zstd")
    return content.getvalue()


def excel() -> bytes:
    content = BytesIO()
    rows = [["Bench 3", None, None], ["t", "u", "y"], ["s", "V", "rad/s"], *zip(T, U, Y, strict=True)]
    import xlsxwriter

    with xlsxwriter.Workbook(content, {"in_memory": True}) as book:
        sheet = book.add_worksheet()
        for k, row in enumerate(rows):
            sheet.write_row(k, 0, row)
    return content.getvalue()


def test_every_sheet_of_a_spreadsheet_is_read() -> None:
    import xlsxwriter

    content = BytesIO()
    sheets = {"Info": [["Operator", "Kim"]], "Run 1": [["t", "u"], *zip(T, U, strict=True)], "Empty": [], "Run 2": []}
    sheets["Run 2"] = [["t", "y"], ["s", "rad/s"], *zip(T[:50], Y[:50], strict=True)]
    with xlsxwriter.Workbook(content, {"in_memory": True}) as book:
        for name, rows in sheets.items():
            sheet = book.add_worksheet(name)
            for k, row in enumerate(rows):
                sheet.write_row(k, 0, row)
    columns = read_spreadsheet(content.getvalue())
    assert {name: len(values) for name, values in columns.series.items()} == {
        "t": len(T),
        "u": len(T),
        "Run 2.t": 50,
        "Run 2.y": 50,
    }
    assert columns.units == {"Run 2.t": "s", "Run 2.y": "rad/s"}
    assert columns.place(60) == "row 61"
    empty = BytesIO()
    with xlsxwriter.Workbook(empty, {"in_memory": True}) as book:
        book.add_worksheet("Info").write_row(0, 0, ["Operator", "Kim"])
    with pytest.raises(FormatError, match="there are no numbers in this file"):
        read_spreadsheet(empty.getvalue())


def tdms(**start: float) -> bytes:
    """A file of LabVIEW, which writes a start of the waveform; other programs may not."""
    from nptdms import ChannelObject, TdmsWriter

    content = BytesIO()
    with TdmsWriter(content) as writer:
        waveform = {"wf_increment": 0.01, "wf_samples": N, **start}
        units = {"u": "V", "y": "rad/s"}
        writer.write_segment(
            [
                ChannelObject("bench", name, values, properties=waveform | {"unit_string": units[name]})
                for name, values in (("u", U), ("y", Y))
            ]
        )
    return content.getvalue()


def mdf() -> bytes:
    from asammdf import MDF, Signal

    content = BytesIO()
    with MDF(version="4.10") as file:
        signals = (("u", U, "V"), ("y", Y, "rad/s"))
        file.append([Signal(values, T, name=name, unit=unit) for name, values, unit in signals])
        file.save(content)
    return content.getvalue()


def wpilog() -> bytes:
    """By its specification: a header, then records of entry, time in µs and payload."""

    def record(entry: int, payload: bytes, time: float = 0.0) -> bytes:
        """The lengths of entry, size and time are 1, 4 and 8 bytes."""
        return struct.pack("<BBIQ", 0b0111_1100, entry, len(payload), round(1e6 * time))

    def text(words: str) -> bytes:
        return struct.pack("<I", len(words)) + words.encode()

    content = b"WPILOG" + struct.pack("<HI", 0x0100, 0)
    for entry, name in ((1, "u"), (2, "y")):
        start = b"\0" + struct.pack("<I", entry) + text(name) + text("double") + text("")
        content += record(0, start) + start
    for t, u, y in zip(T, U, Y, strict=True):
        for entry, value in ((1, u), (2, y)):
            payload = struct.pack("<d", value)
            content += record(entry, payload, t) + payload
    return content


def mcap() -> bytes:
    from mcap.writer import Writer

    content = BytesIO()
    writer = Writer(content)
    writer.start()
    schema = writer.register_schema("sample", "jsonschema", b'{"type": "object"}')
    channel = writer.register_channel("/bench", "json", schema)
    for t, u, y in zip(T, U, Y, strict=True):
        time = round(1e9 * (1000 + t))
        writer.add_message(channel, time, json.dumps({"u": u, "y": y, "note": "x"}).encode(), time)
    writer.finish()
    return content.getvalue()


def mcap_of_ros() -> bytes:
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    vector = types.types["geometry_msgs/msg/Vector3"]
    content = BytesIO()
    writer = Writer(content)
    writer.start("ros2")
    schema = writer.register_schema(vector.__msgtype__, "ros2msg", b"float64 x\nfloat64 y\nfloat64 z\n")
    channel = writer.register_channel("/bench", "cdr", schema)
    for t, u, y in zip(T, U, Y, strict=True):
        data = bytes(types.serialize_cdr(vector(u, y, 0.0), vector.__msgtype__))
        writer.add_message(channel, round(1e9 * t), data, round(1e9 * t))
    writer.finish()
    return content.getvalue()


def bag(tmp_path: Path) -> bytes:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    vector = types.types["geometry_msgs/msg/Vector3"]
    with Writer(tmp_path / "made.bag") as writer:
        connection = writer.add_connection("/bench", vector.__msgtype__, typestore=types)
        for t, u, y in zip(T, U, Y, strict=True):
            data = types.serialize_ros1(vector(u, y, 0.0), vector.__msgtype__)
            writer.write(connection, round(1e9 * (1000 + t)), data)
    return (tmp_path / "made.bag").read_bytes()


def ulog() -> bytes:
    """By its specification: a header, formats, subscriptions, and data with a time in µs; u and y in two topics."""

    def message(kind: str, payload: bytes) -> bytes:
        return struct.pack("<HB", len(payload), ord(kind)) + payload

    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 5)
    content += message("F", b"command:uint64_t timestamp;float[2] u;") + message(
        "F", b"motor:uint64_t timestamp;float y;"
    )
    for number, topic in enumerate((b"\0command", b"\0motor")):
        content += message("A", topic[:1] + struct.pack("<H", number) + topic[1:])
    for t, u, y in zip(T, U, Y, strict=True):
        for number, values in ((0, (u, 7.0)), (1, (y,))):
            content += message("D", struct.pack(f"<HQ{len(values)}f", number, round(1e6 * (t + 3)), *values))
    return content


def dataflash() -> bytes:
    """By its description: FMT defines every kind of message; then units and multipliers, then samples."""

    def text(words: str, size: int) -> bytes:
        return words.encode().ljust(size, b"\0")

    def message(kind: int, layout: str, *values: float | bytes) -> bytes:
        return b"\xa3\x95" + struct.pack(f"<B{layout}", kind, *values)

    content = b""
    for kind, name, types, fields, layout in (
        (128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "BB4s16s64s"),
        (129, "UNIT", "QbZ", "TimeUS,Id,Label", "Qb64s"),
        (130, "MULT", "Qbd", "TimeUS,Id,Mult", "Qbd"),
        (131, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "QB16s16s"),
        (140, "MOT", "QBhc", "TimeUS,Instance,Volt,Rate", "QBhh"),
        (141, "MSG", "QZ", "TimeUS,Message", "Q64s"),
    ):
        size = 3 + struct.calcsize(f"<{layout}")
        content += message(128, "BB4s16s64s", kind, size, text(name, 4), text(types, 16), text(fields, 64))
    for letter, unit in (("v", "V"), ("E", "rad/s")):
        content += message(129, "Qb64s", 0, ord(letter), text(unit, 64))
    for letter, factor in (("F", 1e-6), ("C", 1e-3), ("B", 1e-2)):
        content += message(130, "Qbd", 0, ord(letter), factor)
    content += message(131, "QB16s16s", 0, 140, text("s#vE", 16), text("F-CB", 16))
    content += message(141, "Q64s", 0, text("armed", 64)) + b"\xa3\xa3\x95 noise"
    for t, u, y in zip(T, U, Y, strict=True):
        for motor, sign in ((0, -1), (1, 1)):
            content += message(140, "QBhh", round(1e6 * (t + 3)), motor, round(1e3 * sign * u), round(1e2 * sign * y))
    return content


DBC = """VERSION ""
BU_: Drive
BO_ 256 Command: 8 Drive
 SG_ u : 0|16@1- (0.01,0) [0|0] "V" Drive
 SG_ State : 16|8@1+ (1,0) [0|0] "" Drive
BO_ 512 Motor: 8 Drive
 SG_ y : 7|16@0- (0.1,0) [0|0] "rad/s" Drive
 SG_ State : 16|8@1+ (1,0) [0|0] "" Drive
"""


def candump() -> str:
    """A log whose second message comes half as often as the first and 2 ms later, beside frames of another node."""
    lines = []
    for k, (t, u, y) in enumerate(zip(T, U, Y, strict=True)):
        lines.append(f"({1700000000 + t:.6f}) can0 100#{struct.pack('<hB', round(100 * u), 1).hex().upper()}")
        if k % 2 == 0:
            lines.append(f"({1700000000.002 + t:.6f}) can0 200#{struct.pack('>hB', round(10 * y), 2).hex().upper()}")
            lines.append(f"({1700000000.003 + t:.6f}) can0 701#05")
    return "\n".join([*lines, f"({1700000001:.6f}) can0 200#FF", ""])


def vector(text: str) -> str:
    """The same in Vector's ASC."""
    frames = [re.fullmatch(r"\(17(.*)\) can0 (\w+)#(\w+)", line) for line in text.splitlines()]
    rows = [(float(f[1]), f[2], bytes.fromhex(f[3]).hex(" ")) for f in frames if f]
    body = [f"{t:.6f} 1 {name} Rx d {len(data.split())} {data}" for t, name, data in rows]
    return "\n".join(["date Mon Jan 5 10:00:00.000 am 2026", "base hex timestamps absolute", "", *body, ""])


@pytest.mark.parametrize(("suffix", "text"), [(".log", candump()), (".asc", vector(candump()))], ids=["candump", "ASC"])
def test_a_log_of_a_can_bus_needs_a_database(
    tmp_path: Path, suffix: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, dbc = tmp_path / f"bus{suffix}", str(tmp_path / "drive.dbc")
    log.write_text(text)
    Path(dbc).write_text(DBC)
    with pytest.raises(FormatError, match="give the DBC file of the bus") as refused:
        emsid.read(log, input="u", output="y")
    assert refused.value.arguments == ("dbc",)
    here = (sandbox, "in_sandbox", lambda parser, content, damaged: parser(content))
    if suffix == ".asc":
        monkeypatch.setattr(*here)
    columns = read_columns(log, dbc=dbc)
    monkeypatch.setattr(*here)  # one in a process of its own is enough for a test
    assert set(columns.series) == {"u", "Command.State", "y", "Motor.State", "time", "y.time"}
    np.testing.assert_allclose(columns.series["y"], np.round(Y[::2], 1), atol=1e-9)
    record = emsid.read(log, input="u", output="y", dbc=dbc)  # at the times of the output; the input is held
    assert (record.dt, record.input_units, record.output_units) == (pytest.approx(0.02), ("V",), ("rad/s",))
    np.testing.assert_allclose(record.input[:, 0], U[::2])
    look = emsid.describe(log, dbc=dbc)
    assert look.reading["dbc"] == dbc
    assert emsid.read(log, **look.reading).output_names == ("d(y)",)
    Path(dbc).write_text(DBC.replace("256", "257").replace("512", "513"))
    with pytest.raises(FormatError, match="no frame of this log is a message of"):
        read_columns(log, dbc=dbc)
    monkeypatch.setattr(sandbox, "find_spec", lambda name: None)
    with pytest.raises(FormatError, match=r"install cantools: pip install 'emsid\[can\]'"):
        emsid.read(log, input="u", output="y", dbc=dbc)
    with pytest.raises(FormatError, match="a database describes logs of a CAN bus"):
        read_columns(dbc, dbc=dbc)


def test_a_dataflash_log_that_is_cut_off_or_another_file() -> None:
    columns = READERS[".bin"](dataflash()[:-3])
    assert len(columns.series["MOT.0.Volt"]) == N
    assert len(columns.series["MOT.1.Volt"]) == N - 1
    assert columns.cut == {"": (2 * N - 1, 0)}
    with pytest.raises(FormatError, match="not a DataFlash log, or it is damaged; it looks like text"):
        READERS[".bin"](b"t,u,y")


Made = Callable[[], bytes]


@pytest.mark.parametrize(
    ("suffix", "made", "input", "output", "units"),
    [
        (".feather", feather, "u", "y", ("", "")),
        (".xlsx", excel, "u", "y", ("V", "rad/s")),
        (".tdms", tdms, "u", "y", ("V", "rad/s")),
        (".tdms", partial(tdms, wf_start_offset=0.0), "u", "y", ("V", "rad/s")),
        (".mf4", mdf, "u", "y", ("V", "rad/s")),
        (".wpilog", wpilog, "u", "y", ("", "")),
        (".mcap", mcap, "bench.u", "bench.y", ("", "")),
        (".mcap", mcap_of_ros, "bench.x", "bench.y", ("", "")),
        (".bag", bag, "bench.x", "bench.y", ("", "")),
        (".ulg", ulog, "command.u_1", "motor.y", ("", "")),
        (".bin", dataflash, "MOT.1.Volt", "MOT.1.Rate", ("V", "rad/s")),
    ],
    ids=[
        "Feather",
        "Excel",
        "TDMS without start",
        "TDMS",
        "MDF",
        "WPILOG",
        "MCAP",
        "MCAP of ROS 2",
        "bag",
        "ULog",
        "DataFlash",
    ],
)
def test_a_file_of_each_kind(
    tmp_path: Path,
    suffix: str,
    made: Callable[..., bytes],
    input: str,
    output: str,
    units: tuple[str, str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / f"log{suffix}"
    path.write_bytes(made(tmp_path) if made is bag else made())
    time = "t" if suffix in (".feather", ".xlsx") else None
    if suffix != ".wpilog":  # one in a process of its own is enough for a test
        monkeypatch.setattr(sandbox, "in_sandbox", lambda parser, content, damaged: parser(content))
    record = emsid.read(path, input=input, output=output, time=time)
    np.testing.assert_allclose(record.input[:, 0], U)
    exact = 1e-6 if path.suffix == ".ulg" else 1e-7  # its numbers are of single precision
    np.testing.assert_allclose(record.output[:, 0], Y, rtol=exact)
    assert record.dt == pytest.approx(0.01)
    assert (*record.input_units, *record.output_units) == units
    look = emsid.describe(path)
    assert look.record is not None
    assert look.record.dt == pytest.approx(0.01)


EXTRAS = {
    "excel": (".xlsx", ".xls", ".ods"),
    "tdms": (".tdms",),
    "mdf": (".mf4", ".mdf"),
    "wpilog": (".wpilog",),
    "ros": (".mcap", ".bag"),
}
NEEDS = {suffix: extra for extra, suffixes in EXTRAS.items() for suffix in suffixes}


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_a_package_that_is_missing_is_named(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every reader: it says which extra to install, which the project has, or needs none."""
    monkeypatch.setattr(sandbox, "find_spec", lambda name: None)
    (tmp_path / f"log{suffix}").write_bytes(b"anything")
    with pytest.raises(EmsidError) as refused:
        emsid.read(tmp_path / f"log{suffix}", input="u", output="y")
    asked = re.search(r"install \w+: pip install 'emsid\[(\w+)\]'", str(refused.value))
    assert (asked and asked[1]) == NEEDS.get(suffix)
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
    assert asked is None or asked[1] in project["optional-dependencies"]


def bag_folder(path: Path) -> Path:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    vector = types.types["geometry_msgs/msg/Vector3"]
    with Writer(path, version=8) as writer:
        connection = writer.add_connection("/bench", vector.__msgtype__, typestore=types)
        for t, u, y in zip(T, U, Y, strict=True):
            data = types.serialize_cdr(vector(u, y, 0.0), vector.__msgtype__)
            writer.write(connection, round(1e9 * (1000 + t)), bytes(data))
    return path


def test_a_bag_of_ros_2_is_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag_folder(tmp_path / "run 1")
    look = emsid.describe(path)  # in a process of its own
    assert look.reading["input"] == "bench.x"
    monkeypatch.setattr(sandbox, "in_sandbox", lambda parser, content, damaged: parser(content))
    record = emsid.read(path, input="bench.x", output="bench.y")
    np.testing.assert_allclose(record.output[:, 0], Y)
    assert record.dt == pytest.approx(0.01)
    monkeypatch.setattr(sandbox, "find_spec", lambda name: None)
    with pytest.raises(FormatError, match=r"install rosbags: pip install 'emsid\[ros\]'"):
        emsid.read(path, input="bench.x", output="bench.y")
    (tmp_path / "other").mkdir()
    with pytest.raises(FormatError, match="this is a folder; name a file in it"):
        emsid.read(tmp_path / "other", input="u", output="y")


@pytest.mark.parametrize("suffix", [".mcap", ".wpilog"])
def test_another_kind_of_file_is_said_to_be_one(suffix: str) -> None:
    with pytest.raises(FormatError, match="or it is damaged or cut off; it looks like text"):
        READERS[suffix](b"t,u,y\n0,1,2\n")


def test_damaged_arrow_files() -> None:
    with pytest.raises(FormatError, match="damaged or cut off"):
        read_arrow(feather()[:300])
    with pytest.raises(FormatError, match="not an Arrow file; it looks like text"):
        read_arrow(b"t,u,y\n0,1,2\n")


def test_columns_with_clocks_of_their_own() -> None:
    fast, slow = np.arange(0.0, 2.0, 0.1), np.arange(0.25, 1.8, 0.25)
    series = {"u": np.arange(7.0), "u.time": slow, "y": 2 * fast, "time": fast, "other": np.ones(3)}
    columns = Columns(
        {name: pl.Series(name, values) for name, values in series.items()},
        clocks={"u": "u.time", "u.time": "u.time", "y": "time", "time": "time"},
    )
    held = on_one_clock(columns, "time", ["u"])
    times = held.series["time"].to_numpy()
    assert (times[0], times[-1]) == (pytest.approx(0.3), pytest.approx(1.7))
    np.testing.assert_array_equal(
        held.series["u"].to_numpy(), np.minimum(np.floor((times + 0.05) / 0.25 + 1e-9), 7) - 1
    )
    np.testing.assert_allclose(on_one_clock(columns, "time", []).series["u"].to_numpy(), times / 0.25 - 1)
    np.testing.assert_allclose(held.series["y"].to_numpy(), 2 * times)
    assert on_one_clock(Columns({}), "time", []) == Columns({})


def test_a_topic_that_was_logged_only_at_the_start_does_not_shorten_the_others(tmp_path: Path) -> None:
    """Of a file with many clocks, a first look takes the columns that are there for most of the time."""
    time, short = 0.01 * np.arange(500), np.array([0.0, 0.01])
    u = np.repeat(np.random.default_rng(0).choice([-3.0, 3.0], 50), 10)
    y = np.convolve(u, np.exp(-np.arange(100) / 10))[:500]
    series = {"voltage": u, "time": time, "speed": y, "speed.time": time + 0.002, "fault": short, "fault.time": short}
    clocks = {"voltage": "time", "speed": "speed.time", "fault": "fault.time"}
    columns = Columns(
        {name: pl.Series(name, values) for name, values in series.items()},
        clocks=clocks | {name: name for name in clocks.values()},
    )
    look = emsid.describe(ParsedFile(tmp_path / "log.ulg", columns))
    assert (look.reading["input"], look.reading["output"]) == ("voltage", "speed")
    assert look.record is not None
    assert len(look.record) > 490


def test_what_a_library_prints_is_no_part_of_the_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "chatty.py").write_text("def parser(content):\n    print('what a mess')\n    return content[::-1]\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert in_sandbox(import_module("chatty").parser, b"abc", "damaged") == b"cba"
