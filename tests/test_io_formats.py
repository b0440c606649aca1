"""MAT, Parquet and NPZ files: their columns, and messages about the other entries."""

from __future__ import annotations

import gzip
import io
import os
import pickle
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import polars as pl
import pytest
import scipy.io

from emsid.errors import FormatError
from emsid.io import files, mat
from emsid.io.columns import Columns, nearest
from emsid.io.mat import read_mat
from emsid.io.npz import read_npz
from emsid.io.parquet import read_parquet
from emsid.io.reading import read_columns

N = 7


def mat_5(variables: dict[str, object], **options: object) -> bytes:
    content = io.BytesIO()
    scipy.io.savemat(content, variables, **options)  # type: ignore[arg-type]
    return content.getvalue()


def mat_73(variables: dict[str, Any]) -> bytes:
    """As MATLAB writes it: transposed, with the class of each variable, behind a header of 512 bytes."""
    content = io.BytesIO()
    with h5py.File(content, "w", userblock_size=512) as file:

        def put(parent: h5py.Group, name: str, value: Any) -> None:
            if isinstance(value, dict):
                group = parent.create_group(name)
                for field, inner in value.items():
                    put(group, field, inner)
            else:
                parent.create_dataset(name, data=np.atleast_2d(value).T).attrs["MATLAB_class"] = np.bytes_("double")

        for name, value in variables.items():
            put(file, name, value)
        text = file.create_dataset("note", data=np.array([[104], [105]], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("nothing", data=np.zeros(2, dtype=np.uint64)).attrs["MATLAB_empty"] = 1
        file.create_group("#refs#")
    data = bytearray(content.getvalue())
    data[:19] = b"MATLAB 7.3 MAT-file"
    return bytes(data)


def npz(**arrays: object) -> bytes:
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    return content.getvalue()


def parquet(frame: pl.DataFrame) -> bytes:
    content = io.BytesIO()
    frame.write_parquet(content)
    return content.getvalue()


VARIABLES = {
    "column": np.arange(N)[:, None] * 0.1,
    "row": np.arange(N)[None, :] * 0.2,
    "both": np.arange(2.0 * N).reshape(N, 2),
    "wide": np.zeros((3, N)),
    "gain": np.array([[35.0]]),
    "other": np.arange(3.0)[:, None],
    "cube": np.zeros((2, 3, 4)),
}


def check_arrays(columns: Columns) -> None:
    lengths = {name: len(series) for name, series in columns.series.items()}
    assert lengths | {"column": N, "row": N, "both_1": N, "both_2": N, "other": 3} == lengths
    np.testing.assert_array_equal(columns.series["column"].to_numpy(), np.arange(N) * 0.1)
    np.testing.assert_array_equal(columns.series["row"].to_numpy(), np.arange(N) * 0.2)
    np.testing.assert_array_equal(columns.series["both_2"].to_numpy(), 1 + 2 * np.arange(N))
    assert columns.others["gain"] == "a single number"
    assert "3 rows by 7 columns" in columns.others["wide"]
    assert columns.others["cube"] == "a 3-dimensional array"


@pytest.mark.parametrize("compressed", [False, True])
def test_mat_5(compressed: bool) -> None:
    columns = read_mat(
        mat_5(
            {
                **VARIABLES,
                "run": {"u": np.arange(N), "label": "drive"},
                "label": "hello",
                "phasor": np.zeros(N, dtype=complex),
                "cells": np.array([1, "a"], dtype=object),
                "flags": np.array([True, False, True]),
                "counts": np.arange(N, dtype=np.int16),
            },
            do_compression=compressed,
        )
    )
    check_arrays(columns)
    np.testing.assert_array_equal(columns.series["run.u"].to_numpy(), np.arange(N))
    assert len(columns.series["flags"]) == 3
    assert columns.series["counts"].to_list() == list(range(N))
    assert columns.others["label"] == columns.others["run.label"] == "text"
    assert columns.others["phasor"] == "complex numbers"
    assert (columns.others["cells{1}"], columns.others["cells{2}"]) == ("a single number", "text")


def test_cells_and_structs_in_cells_are_read() -> None:
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = {"u": np.arange(N)}, np.arange(2.0 * N).reshape(N, 2)
    columns = read_mat(mat_5({"runs": cells}))
    np.testing.assert_array_equal(columns.series["runs{1}.u"].to_numpy(), np.arange(N))
    np.testing.assert_array_equal(columns.series["runs{2}_2"].to_numpy(), 1 + 2 * np.arange(N))


def mat_object(name: str, kind: str) -> bytes:
    """An element with an object of a class, as MATLAB writes it: flags, three names, and an array of its own."""

    def element(type: int, data: bytes) -> bytes:
        return np.array([type, len(data)], "<u4").tobytes() + data.ljust(-(-len(data) // 8) * 8, b"\0")

    numbers = element(6, np.array([13, 0], "<u4").tobytes()) + element(5, np.array([1, 1], "<i4").tobytes())
    numbers += element(1, b"") + element(6, np.array([7], "<u4").tobytes())
    flags = element(6, np.array([17, 0], "<u4").tobytes())
    return element(
        14, flags + b"".join(element(1, text.encode()) for text in (name, "MCOS", kind)) + element(14, numbers)
    )


def test_objects_of_matlab_are_named_with_what_to_do() -> None:
    """Bytes that MATLAB hides behind the last variable, where objects are, are no column."""
    hidden = mat_5({"x": np.arange(8, dtype=np.uint8)})[128:].replace(b"\x01\0\1\0x", b"\x01\0\0\0\0")
    content = mat_5({"u": np.arange(N)}) + mat_object("z", "iddata") + mat_object("m", "idnlarx") + hidden
    columns = read_mat(content)
    assert list(columns.series) == ["u"]
    assert columns.others["z"].endswith("u = z.u; y = z.y; Ts = z.Ts; save z_arrays.mat u y Ts -v7")
    assert columns.others["m"].endswith("holds a model and no signals")


def test_cells_and_objects_of_mat_73() -> None:
    content = io.BytesIO()
    with h5py.File(content, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")
        parts = [refs.create_dataset(str(k), data=np.arange(1.0 * N)[None, :] + k) for k in range(2)]
        cell = file.create_dataset("runs", data=np.array([[p.ref for p in parts]], dtype=h5py.ref_dtype))
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        table = file.create_dataset("log", data=np.zeros((1, 6), dtype=np.uint32))
        table.attrs["MATLAB_class"], table.attrs["MATLAB_object_decode"] = np.bytes_("timetable"), 3
        file.create_group("#subsystem#").create_dataset("MCOS", data=np.zeros(400, dtype=np.uint8))
    columns = read_mat(content.getvalue())
    assert list(columns.series) == ["runs{1}", "runs{2}"]
    np.testing.assert_array_equal(columns.series["runs{2}"].to_numpy(), 1 + np.arange(N))
    assert columns.others["log"].endswith("writetimetable(log, 'log.csv')")


def test_a_log_of_simulink_is_read() -> None:
    """Structures with time: a struct of signals, or an array of such structs, and signals of (1, 1, N)."""
    u, y = np.arange(N) * 1.0, np.cos(np.arange(N))
    one = {"time": np.arange(N) / 100, "signals": {"values": np.c_[u, y], "label": "scope"}}
    two = np.array([(u, 1.0), (y, 1.0)], dtype=[("values", object), ("dimensions", object)])
    columns = read_mat(mat_5({"one": one, "two": {"signals": two}, "three": y[None, None, :]}))
    np.testing.assert_array_equal(columns.series["one.signals.values_1"].to_numpy(), u)
    np.testing.assert_array_equal(columns.series["two.signals(2).values"].to_numpy(), y)
    np.testing.assert_array_equal(columns.series["three"].to_numpy(), y)
    assert columns.others["two.signals(1).dimensions"] == "a single number"
    deep: dict[str, Any] = {"y": y}
    for _ in range(mat.DEEPEST + 1):
        deep = {"x": deep}
    assert "structs inside many others" in read_mat(mat_5({"y": y, "deep": deep})).others.values()
    many = np.array([(u,)] * 101, dtype=[("u", object)])
    assert read_mat(mat_5({"y": y, "many": many})).others == {"many": "an array of 101 structs"}


def test_mat_5_of_the_other_byte_order() -> None:
    words = lambda *values: np.array(values, ">u4").tobytes()  # noqa: E731
    values = np.arange(3.0).astype(">f8").tobytes()
    variable = words(6, 8, 6, 0) + words(5, 8, 3, 1) + words((1 << 16) | 1) + b"u\0\0\0" + words(9, 24) + values
    content = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + words(14, len(variable)) + variable
    np.testing.assert_array_equal(read_mat(content).series["u"].to_numpy(), [0, 1, 2])


def test_mat_73() -> None:
    columns = read_mat(mat_73({**VARIABLES, "run": {"u": np.arange(N) * 1.0, "inner": {"y": np.arange(N) * 2.0}}}))
    check_arrays(columns)
    np.testing.assert_array_equal(columns.series["run.u"].to_numpy(), np.arange(N))
    np.testing.assert_array_equal(columns.series["run.inner.y"].to_numpy(), 2.0 * np.arange(N))
    assert columns.others["note"] == "text"
    assert columns.others["nothing"] == "empty"
    assert not any(name.startswith("#") for name in [*columns.series, *columns.others])


def test_npz() -> None:
    columns = read_npz(npz(**VARIABLES, objects=np.array([{}, []], dtype=object), words=np.array(["a", "b"])))
    check_arrays(columns)
    assert columns.others["objects"] == "Python objects or damaged"
    assert columns.others["words"] == "text"


def test_pickled_objects_are_never_loaded() -> None:
    class Trap:
        def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
            return (pytest.fail, ("a pickle was loaded",))

    assert "objects" in read_npz(npz(objects=np.array([Trap(), 1], dtype=object), u=np.arange(3))).others
    with pytest.raises(FormatError, match="not an NPZ file"):
        read_npz(pickle.dumps(Trap()))


def test_parquet() -> None:
    start = datetime(2024, 1, 1)
    frame = pl.DataFrame(
        {
            "when": [start + timedelta(milliseconds=20 * k) for k in range(4)],
            "u": pl.Series([1, 2, None, 4], dtype=pl.Int32),
            "state": ["a", "b", "c", "d"],
            "pairs": [[1, 2]] * 4,
        }
    )
    columns = read_parquet(parquet(frame))
    assert list(columns.series) == ["when", "u", "state", "pairs_1", "pairs_2"]
    assert columns.others == {}
    assert columns.place(0) == "row 1"


def test_a_parquet_file_that_takes_its_parser_down_leaves_us_standing(monkeypatch: pytest.MonkeyPatch) -> None:
    content = parquet(pl.DataFrame({"u": range(100)}))
    monkeypatch.setattr("emsid.io.parquet.parsed", os.abort)
    with pytest.raises(FormatError, match="this Parquet file is damaged or cut off"):
        read_parquet(content)


@pytest.mark.parametrize("reader", [read_mat, read_npz, read_parquet])
@pytest.mark.parametrize(
    ("content", "what"),
    [(b"t,u\n1,2\n", "text"), (b"\x89PNG\r\n\x1a\n" + bytes(200), "a PNG image"), (bytes(300), "binary")],
)
def test_another_kind_of_file_is_recognised(reader: Callable[[bytes], Columns], content: bytes, what: str) -> None:
    with pytest.raises(FormatError, match="give it its right suffix") as caught:
        reader(content)
    assert f"it looks like {what}" in str(caught.value)


@pytest.mark.parametrize(
    ("reader", "content"),
    [
        (read_mat, mat_5(VARIABLES)),
        (read_mat, mat_5(VARIABLES, do_compression=True)),
        (read_mat, mat_73({"u": np.arange(100.0)})),
        (read_npz, npz(u=np.arange(100.0))),
        (read_parquet, parquet(pl.DataFrame({"u": range(100)}))),
    ],
    ids=["mat 5", "mat 5 compressed", "mat 7.3", "npz", "parquet"],
)
def test_a_file_that_is_cut_off_is_recognised(reader: Callable[[bytes], Columns], content: bytes) -> None:
    with pytest.raises(FormatError, match=r"damaged|cut off") as caught:
        reader(content[: int(0.7 * len(content))])
    assert "\n" not in str(caught.value)


def test_a_packed_file_is_read_as_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = gzip.compress(b"t,u,y\n0,1,2\n1,3,4\n")
    path = tmp_path / "log.CSV.gz"
    path.write_bytes(packed)
    assert read_columns(path).series["y"].to_list() == [2, 4]
    for content in (packed[:-9], b"t,u\n0,1\n"):
        path.write_bytes(content)
        with pytest.raises(FormatError, match="this is no gzip file, or a damaged one"):
            read_columns(path)
    path.write_bytes(packed)
    monkeypatch.setattr(files, "LARGEST", 10)
    with pytest.raises(FormatError, match="unpacked, this file has more than"):
        read_columns(path)
    path.rename(tmp_path / "log.gz")
    with pytest.raises(FormatError, match="no reader for the suffix ''"):
        read_columns(tmp_path / "log.gz")


def test_the_nearest_name() -> None:
    assert nearest("sped", ["speed", "u"]) == "; did you mean 'speed'?"
    assert nearest("PWM", ["pwm"]) == "; did you mean 'pwm'?"
    assert nearest("torque", ["u", "y"]) == ""
