"""Files that are cut off: what is there is read, and the finding says how much that is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from emsid.io import read, read_columns
from emsid.io.cut_off import without_cut_line
from emsid.wording import sentence
from test_io_more_formats import T, wpilog

N = 60
ROWS = [(k / 10, k % 7, 0.5 * k) for k in range(N)]
TEXTS = {
    "comma.csv": b"t,u,y\n" + b"".join(b"%.1f,%d,%.3f\n" % row for row in ROWS),
    "semicolon.csv": b"t;u;y\r\n" + b"".join(b"%.1f;%d;%.3f\r\n" % row for row in ROWS).replace(b".", b","),
    "monitor.log": b"".join(b"12:00:%06.3f -> u:%d, y:%.3f\n" % row for row in ROWS),
    "labels.txt": b"".join(b"t:%.1f, u:%d, y:%.3f\n" % row for row in ROWS),
    "flat.jsonl": b"".join(json.dumps({"t": t, "u": u, "y": y}).encode() + b"\n" for t, u, y in ROWS),
    "nested.jsonl": b"".join(json.dumps({"t": t, "at": {"u": u, "y": y}}).encode() + b"\n" for t, u, y in ROWS),
    "nested.json": b"".join(json.dumps({"t": t, "at": {"u": u, "y": y}}).encode() + b"\n" for t, u, y in ROWS),
}


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("of_line", [0.3, 0.6, 0.95])
def test_a_text_that_ends_within_a_line_is_read_up_to_it(tmp_path: Path, name: str, of_line: float) -> None:
    content = TEXTS[name]
    lines = content.splitlines(keepends=True)
    kept = len(lines) - 20
    whole = b"".join(lines[:kept])
    path = tmp_path / name
    path.write_bytes(whole + lines[kept][: int(of_line * len(lines[kept].rstrip()))])
    u, y = ("at.u", "at.y") if "nested" in name else ("u", "y")
    record = read(path, input=u, output=y, dt=0.1)
    np.testing.assert_array_equal(record.output[:, 0], [row[2] for row in ROWS[: N - 20]])
    (found,) = [finding for finding in record.findings if finding.code == "file-cut-off"]
    assert found.data == {"columns": {"": [N - 20, 0]}}
    assert "it ends after 40 samples, within another one" in sentence(found)


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_without_the_end_of_its_last_line_is_whole(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(TEXTS[name].rstrip())
    columns = read_columns(path)
    assert {len(series) for series in columns.series.values()} == {N}
    assert columns.cut == {}


@pytest.mark.parametrize(
    "content",
    [
        b"0.5,1\n1.25,2\n2.125,3\n3,4",  # decimals as they come
        b"u,y\n0,1\n1,2\nend of the log",
        b"0,1e-3\n1,1e-4\n2,1e-5",
        b"-1,2\n1,-2\n1,2",
        b"1\n22\n3",
        b"12:00:00 5\n12:00:01 6\n12:00:02 7",
        b"one line",
        b"",
    ],
)
def test_what_may_be_whole_is_kept(content: bytes) -> None:
    assert without_cut_line(content) == (content, False)


@pytest.mark.parametrize(
    "content", [b"0,1.50\n1,2.50\n2,3.5", b"0,1e-3\n1,1e-4\n2,1e-", b"0,5\n1,6\n2", b"0,5\r1,6\r2,"]
)
def test_what_cannot_be_whole_is_left_out(content: bytes) -> None:
    assert without_cut_line(content) == (content[: max(map(content.rfind, (b"\n", b"\r"))) + 1], True)


@pytest.mark.parametrize("missing", [1, 7, 12])
def test_a_wpilog_that_ends_within_a_record_is_read_up_to_it(tmp_path: Path, missing: int) -> None:
    """The library gives the record before a second time."""
    path = tmp_path / "log.wpilog"
    path.write_bytes(wpilog()[:-missing])
    columns = read_columns(path)
    assert {name: len(columns.series[name]) for name in "uy"} == {"u": len(T), "y": len(T) - 1}
    assert columns.cut == {"y": (len(T) - 1, 0)}


def test_a_whole_wpilog_is_not_cut_off(tmp_path: Path) -> None:
    (tmp_path / "log.wpilog").write_bytes(wpilog())
    assert read_columns(tmp_path / "log.wpilog").cut == {}
