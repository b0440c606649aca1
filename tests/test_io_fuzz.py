"""Whatever is in a file, reading it gives a record or one of our errors in one line, never anything else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emsid.errors import EmsidError
from emsid.io import READERS, read, read_columns
from emsid.record import Record
from fuzz_formats import KINDS, fuzz
from test_io_formats import mat_5, mat_73, npz, parquet

K = np.arange(30.0)
TABLE = b"Pendulum\n# remark\nt,u,y,state\n" + b"".join(b"%.1f,%d,%.3f,ON\n" % (k / 10, k, k * k) for k in range(30))
VALID = {
    ".csv": [
        TABLE,
        TABLE.replace(b",", b"\t"),
        TABLE.replace(b",", b";").replace(b".", b","),
        TABLE.decode().encode("utf-16"),
        b"".join(b"12:00:%04.1f -> t:%.1f u=%d, y: %.3f V\n" % (k / 10, k / 10, k, k * k) for k in range(30)),
    ],
    ".mat": [
        mat_5({"t": K / 10, "u": K, "y": K**2, "gain": 3.0, "run": {"u": K}}),
        mat_5({"t": K / 10, "u": K, "y": K**2}, do_compression=True),
        mat_73({"t": K / 10, "u": K, "y": K**2, "run": {"u": K}}),
    ],
    ".json": [
        json.dumps({"t": [*K / 10], "u": [*K], "y": [*K**2], "gain": 3.0}).encode(),
        json.dumps([{"t": k / 10, "u": k, "y": k**2, "state": [1, 2]} for k in K]).encode(),
        b"\n".join(json.dumps({"t": k / 10, "u": k, "y": k**2, "state": {"z": 2}}).encode() for k in K),
    ],
    ".npz": [npz(t=K / 10, u=K, y=K**2, gain=3.0)],
    ".parquet": [parquet(pl.DataFrame({"t": K / 10, "u": K, "y": K**2}))],
}
CASES = [(suffix, content) for suffix, contents in VALID.items() for content in contents]

IN_PROCESS = [case for case in CASES if case[0] not in (".parquet", ".mat")]

fuzzing = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


def check(path: Path, content: bytes) -> None:
    """Read ``content`` in the ways that reach most of the code."""
    path.write_bytes(content)
    for options in ({"time": "t"}, {"dt": 0.1, "mask": "u > 20"}, {"time": "t", "resample": True}):
        try:
            record = read(path, input="u", output="y", scale={"y": 2.0}, **options)  # type: ignore[arg-type]
        except EmsidError as problem:
            message = str(problem)
            assert message.startswith(f"{path}: "), message
            assert message.splitlines() == [message]
        else:
            assert isinstance(record, Record)
            assert len(record) > 0
            assert np.isfinite(record.dt)
            assert np.isfinite(record.input).all()
            assert np.isfinite(record.output).all()


@pytest.mark.parametrize(("suffix", "content"), CASES)
def test_the_valid_ones_are_read(folder: Path, suffix: str, content: bytes) -> None:
    path = folder / f"file{suffix}"
    path.write_bytes(content)
    record = read(path, input="u", output="y", time="t")
    np.testing.assert_array_equal(record.input[:, 0], K)
    assert record.dt == 0.1


@pytest.mark.parametrize("suffix", sorted({suffix for suffix, _ in IN_PROCESS}))
@fuzzing
@given(st.binary(max_size=400))
def test_random_bytes(folder: Path, suffix: str, content: bytes) -> None:
    check(folder / f"file{suffix}", content)


@pytest.mark.parametrize("suffix", sorted(set(READERS) - {suffix for suffix, _ in IN_PROCESS}))
def test_random_bytes_for_a_process_of_their_own(folder: Path, suffix: str) -> None:
    """Once only: most of these formats have a library that takes a second to load, in a process for every file."""
    path = folder / f"file{suffix}"
    path.write_bytes(np.random.default_rng(0).bytes(400))
    with pytest.raises(EmsidError) as problem:
        read_columns(path)
    assert str(problem.value).startswith(f"{path}: ")
    assert len(str(problem.value).splitlines()) == 1


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """A file with some bytes changed, or cut off, or with a piece missing, or twice."""
    places = st.integers(0, len(content))
    changed = bytearray(content)
    for at, byte in draw(st.lists(st.tuples(places, st.integers(0, 255)), max_size=6)):
        changed[at : at + 1] = bytes([byte])
    first, second = sorted((draw(places), draw(places)))
    rest = draw(st.sampled_from([bytes(changed[first:]), b"", bytes(changed[second:]), content]))
    return bytes(changed[:first]) + rest


@pytest.mark.parametrize(("suffix", "content"), IN_PROCESS)
@fuzzing
@given(st.data())
def test_damaged_files(folder: Path, suffix: str, content: bytes, data: st.DataObject) -> None:
    check(folder / f"file{suffix}", data.draw(damaged(content)))


@pytest.mark.parametrize(("suffix", "content"), [case for case in CASES if case not in IN_PROCESS])
@settings(fuzzing, max_examples=6)
@given(st.data())
def test_damaged_files_with_a_process_of_their_own(
    folder: Path, suffix: str, content: bytes, data: st.DataObject
) -> None:
    """A few only: each is parsed in a process of its own."""
    path = folder / f"file{suffix}"
    path.write_bytes(data.draw(damaged(content)))
    with suppress(EmsidError):
        assert read_columns(path).series


@pytest.mark.parametrize("kind", ["excel", "tdms", "wpilog", "mcap", "dataflash"])
def test_damaged_files_of_measuring_systems(folder: Path, kind: str) -> None:
    """A few, with parsers whose libraries do not crash; ``fuzz_formats.py`` tries all kinds."""
    read, refused, wrong = fuzz(kind, 40, 1, folder)
    assert wrong == []
    assert (read > 0, refused > 0) == (True, True)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_two_thousand_mutations_and_ten_cuts_of_every_format_of_a_library(kind: str) -> None:
    """In a process of its own: columns or one line; within 2 s of a processor, 10 s and 1 GiB each."""
    program = [sys.executable, str(Path(__file__).with_name("fuzz_formats.py")), kind, "2000", "7"]
    done = subprocess.run(program, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0
    assert done.stdout.rstrip().endswith(", 0 wrong"), done.stdout


@pytest.mark.skipif(os.name != "posix", reason="no limits of memory")
def test_the_memory_of_a_parser_is_limited(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "file.parquet").write_bytes(VALID[".parquet"][0])
    monkeypatch.setattr("emsid.io.sandbox.MEMORY", 1 << 26)
    monkeypatch.setattr("emsid.io.sandbox.EXPANSION", 1)
    with pytest.raises(EmsidError, match="damaged"):
        read_columns(folder / "file.parquet")


cells = st.one_of(
    st.floats().map(repr),
    st.sampled_from(["", "NA", "ERR", '"', "1,5", "1e999", "-", "0x1f", "1_0", "٣", " ", "'", "é"]),
)


@fuzzing
@given(
    st.lists(st.lists(cells, min_size=1, max_size=5), max_size=8),
    st.sampled_from([",", ";", "\t", " ", ", "]),
    st.sampled_from(["t,u,y\n", "", "# t u y\n", "u;y\n", '"u","y"\n']),
)
def test_strange_tables(folder: Path, rows: list[list[str]], separator: str, header: str) -> None:
    check(folder / "file.csv", (header + "\n".join(separator.join(row) for row in rows)).encode())


pieces = st.sampled_from([*"uy 1.,()<>=+-*/%'\"\n;$\\e", "abs(", " and ", " in (", "null", "select ", "not "])


@fuzzing
@given(st.lists(pieces, max_size=12).map("".join))
def test_strange_masks(folder: Path, mask: str) -> None:
    path = folder / "file.csv"
    path.write_bytes(TABLE)
    with suppress(EmsidError):
        assert 0 < len(read(path, input="u", output="y", dt=0.1, mask=mask)) <= 30
