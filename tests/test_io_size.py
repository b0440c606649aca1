"""Memory and time in proportion to the content: large regular tables, bombs, empty space, absurd shapes."""

from __future__ import annotations

import gzip
import subprocess
import sys
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from emsid.errors import FormatError
from emsid.io import files, read, read_columns, regular_table, table
from emsid.io.npz import read_npz
from emsid.io.table import read_table
from test_io_formats import mat_5
from test_io_more_formats import N, tdms

ROWS = 4000
K = np.arange(ROWS)
NUMBERS = [(k / 10, (k * 37 % 101) / 7, -1e-3 * k) for k in range(ROWS)]


def text(row: str = "{:.1f},{:.6g},{:.3e}", head: str = "t,u,y\n", end: str = "\n") -> bytes:
    return (head + end.join(row.format(*number) for number in NUMBERS) + end).encode()


TABLES = {
    "plain": text(),
    "without header": text(head=""),
    "preamble and units": text(head="Stand 3\n# remark\nt;u;y\n[s];[V];[rpm]\n", row="{:.1f};{:.6g};{:.3e}"),
    "tabs, Windows": text("{:.1f}\t{:.6g}\t{:.3e}", "t\tu\ty\r\n", "\r\n"),
    "blanks": text("{:.1f} {:.6g} {:.3e}", "% t u y\n"),
    "decimal commas": text("{:.1f};{:.6g};{:.3e}", "t;u;y\n").replace(b".", b","),
    "missing cells": text().replace(b",3.28571,", b",,"),
    "not finite": text().replace(b",3.28571,", b",nan,").replace(b",4.14286,", b",-inf,"),
    "dates": text("2024-01-01 00:00:{:06.3f},{:.6g},{:.3e}").replace(b":60", b":59"),
    "texts": text("{:.1f},{:.6g},{:.3e},ON", "t,u,y,state\n"),
    "blank lines at its end": text() + b"\n\r\n\n",
    "no line break at its end": text()[:-1],
}
OTHERS = {
    "blanks around": text("{:.1f}, {:.6g} ,{:.3e}"),
    "a comment": text().replace(b"\n200.0,", b"\n# restart\n200.0,"),
    "a blank line": text().replace(b"\n200.0,", b"\n\n200.0,"),
    "a cut line": text().replace(b"\n200.0,", b"\n200.\n200.0,"),
    "a line too long": text().replace(b"\n200.0,", b"\n200.0,1,2,3,4\n200.0,"),
    "a short and a long one": text().replace(b"\n200.0,", b"\n1,2\n1,2,3,4\n200.0,"),
    "a text": text().replace(b"\n200.0,", b"\novf,"),
    "a word for nothing": text().replace(b"\n200.0,", b"\nn/a,"),
    "quotes": text().replace(b"\n200.0,", b'\n"200.0",'),
    "units behind": text("{:.1f} s,{:.6g} V,{:.3e} V"),
    "a serial monitor": text("t:{:.1f} u:{:.6g} y:{:.3e}", ""),
    "groups of thousands": text("{:.1f};{:.6g};{:.3e}", "t;u;y\n").replace(b"\n200.0;", b"\n1,200.0;"),
    "hexadecimal": text().replace(b"\n200.0,", b"\n0xC8,"),
}


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Tables of some kilobytes are large; whether each was parsed at once."""
    used: list[bool] = []
    plain = regular_table.read_regular

    def noted(content: bytes, by_lines: object) -> object:
        found = plain(content, by_lines)  # type: ignore[arg-type]
        used.append(found is not None)
        return found

    monkeypatch.setattr(regular_table, "LARGE", 0)
    monkeypatch.setattr(regular_table, "SAMPLE", 8000)
    monkeypatch.setattr(table, "read_regular", noted)
    return used


@pytest.mark.parametrize("name", [*TABLES, *OTHERS])
def test_a_table_that_is_parsed_at_once_is_the_one_read_line_by_line(name: str, small: list[bool]) -> None:
    content = (TABLES | OTHERS)[name]
    found, wanted = read_table(content), table._read_by_lines(content)
    assert small == [name in TABLES]
    assert list(found.series) == list(wanted.series)
    for each, series in wanted.series.items():
        assert found.series[each].dtype == series.dtype
        assert found.series[each].equals(series, null_equal=True)
    assert list(found.lines or ()) == list(wanted.lines or ())
    assert (found.units, found.preamble, found.damaged) == (wanted.units, wanted.preamble, wanted.damaged)


def test_a_large_table_takes_memory_in_proportion_to_its_numbers(tmp_path: Path) -> None:
    """Two million short rows: 32 MB of numbers; line by line, they take 300 MB more."""
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(b"1,2\n" * 2_000_000, 1))
    program = (
        "import resource, sys; from emsid.io import read_columns; import polars\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "columns = read_columns(sys.argv[1]); assert len(columns.series['c2']) == 2_000_000\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    words = [sys.executable, "-c", program, str(tmp_path / "log.csv.gz")]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert int(done.stdout) / 1024 < 3 * 32 + 16  # MB; 16 for the parser itself


def test_a_long_table_of_unlike_lines_is_refused(small: list[bool], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(regular_table, "MOST_LINES", 1000)
    assert read_table(TABLES["plain"]).series["u"].len() == ROWS
    with pytest.raises(FormatError, match="4,002 lines, some of them unlike the others"):
        read_table(OTHERS["a comment"])


@pytest.mark.parametrize("head", ["", ",".join(f"c{k}" for k in range(200_000)) + "\n"])
def test_a_table_of_too_many_columns_is_refused(tmp_path: Path, head: str) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(head + 3 * (",".join("1" for _ in range(200_000)) + "\n"))
    with pytest.raises(FormatError, match=r"wide\.csv: this table has 200,000 columns and at most 20,000"):
        read_columns(path)


def test_empty_space_is_refused_before_it_is_read(tmp_path: Path) -> None:
    for name, content in (("a.csv", b"t,u,y\n0,1,2\n"), ("b.parquet", b"PAR1"), ("c.npz", b"")):
        with open(tmp_path / name, "wb") as file:
            file.write(content)
            file.truncate(2**31)
        with pytest.raises(FormatError, match="2,048 MiB holds"):
            read_columns(tmp_path / name)
    (tmp_path / "d.csv").write_bytes(bytes(5000))
    with pytest.raises(FormatError, match="begins with zeros only"):
        read_columns(tmp_path / "d.csv")


@pytest.mark.parametrize("kind", ["npz", "gz", "mat", "xlsx"])
def test_what_unpacks_to_an_absurd_size_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    zeros = np.zeros(2_000_000)
    packed = BytesIO()
    if kind == "npz":
        np.savez_compressed(packed, u=zeros)
        path = tmp_path / "bomb.npz"
    elif kind == "gz":
        packed = BytesIO(gzip.compress(b"1,2\n" * 4_000_000))
        path = tmp_path / "bomb.csv.gz"
    elif kind == "mat":
        packed = BytesIO(mat_5({"u": zeros}, do_compression=True))
        path = tmp_path / "bomb.mat"
    else:
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("xl/worksheets/sheet1.xml", bytes(16_000_000))
        path = tmp_path / "bomb.xlsx"
    path.write_bytes(packed.getvalue())
    for module in (files, *([sys.modules["emsid.io.mat"]] if kind == "mat" else [])):
        monkeypatch.setattr(module, "SMALL", 2**20)
    with pytest.raises(FormatError, match=rf"{path.name}: unpacked, this file has more than"):
        read_columns(path)


def test_an_array_that_is_larger_than_its_data_is_refused() -> None:
    content = BytesIO()
    with zipfile.ZipFile(content, "w") as archive, archive.open("u.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)})
        member.write(bytes(80))
    with pytest.raises(FormatError, match="'u' is said to have 8,000,000,000,000 bytes and has"):
        read_npz(content.getvalue())


def test_a_tdms_file_that_is_cut_off_says_how_much_is_missing(tmp_path: Path) -> None:
    whole = tdms()
    reading = {"input": "u", "output": "y", "time": "time"}
    (tmp_path / "log.tdms").write_bytes(whole)
    assert "file-cut-off" not in [finding.code for finding in read(tmp_path / "log.tdms", **reading).findings]
    (tmp_path / "log.tdms").write_bytes(whole[: -8 * 20])
    record = read(tmp_path / "log.tdms", **reading)
    (found,) = [finding for finding in record.findings if finding.code == "file-cut-off"]
    assert found.data == {"columns": {"y": [N - 20, N]}}


def test_a_packed_record_of_usual_size_is_read(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "log.npz", t=K / 10, u=np.zeros(ROWS))
    assert read_columns(tmp_path / "log.npz").series["u"].equals(pl.Series("u", np.zeros(ROWS)))
