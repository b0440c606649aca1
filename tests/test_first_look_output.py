"""How the first look is shown: tables, pages, JSON, and the command that it proposes."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid.first_look import describe
from emsid.report.views.first_look import braille, distortion_figure
from first_look_records import N, Run, T, U, Write, Y, proposals


def test_it_prints_as_a_table(write: Write) -> None:
    look = emsid.describe(write({"t_ms": 1e3 * T, "u": U, "y": Y}))
    lines = str(look).splitlines()
    assert lines[1].split() == ["Column", "Role", "Quantity", "Unit", "Notes", "From", "To", "Step"]
    assert lines[2].startswith("t_ms    time (almost certainly)")
    assert lines[-1].endswith("input='u', output='y', time='t_ms')")
    assert "<table>" in look._repr_html_()
    assert len(look.plot().axes) == 2


def test_of_many_columns_those_with_a_role_are_printed(run: Run, write: Write) -> None:
    rng = np.random.default_rng(2)
    others = {f"ch{k}": rng.standard_normal(N) for k in range(40)}
    log = write({"t": T, "voltage": U} | others | {"speed": Y})
    _, out, _ = run("describe", log)
    assert "43 columns, of which 30 are shown" in out
    assert "ch26" in out
    assert "ch27" not in out
    assert "speed    output" in out
    assert len(describe(log).columns) == 43


def test_braille_shows_a_line() -> None:
    rng = np.random.default_rng(2)
    assert braille(np.arange(8.0), 4, 2) == ["⠀⠀⡠⠊", "⡠⠊⠀⠀"]
    assert braille([1.0, 1.0], 1, 1) == ["⣀"]
    assert braille([0.0, np.nan, np.nan, 3.0], 2, 1) == ["⡀⠈"]
    assert len(braille(rng.standard_normal(100_000), 60, 4)[0]) == 60


def test_a_separator_at_the_end_of_every_row_is_no_column(write: Write) -> None:
    rows = "".join(f"{t:g},{u:g},{y:g},\n" for t, u, y in zip(T, U, Y, strict=True))
    text = str(describe(write("t,u,y,\n" + rows)))
    assert "empty" not in text
    assert "constant" not in text


def test_distortion_is_drawn_over_frequency(write: Write) -> None:
    """Of a square and a dead zone under odd multiples of 0.5 Hz: even ones by the square, odd ones by the dead zone."""
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 10)
    odd = np.outer(np.arange(200), 2 * np.arange(10) + 1)
    u = np.tile(np.cos(2 * np.pi * odd / 200 + phases).sum(axis=1), 5)
    moved = np.sign(u) * np.maximum(np.abs(u) - 1, 0)
    y = moved + 0.05 * moved**2 + 0.01 * np.random.default_rng(2).standard_normal(len(u))
    look = describe(write({"t": 0.01 * np.arange(len(u)), "u": u, "y": y}))
    drawn = distortion_figure(look)
    assert drawn is not None
    noise, *points = drawn.plots[0].marks
    frequencies = {mark.label: set(np.rint(2 * mark.x).astype(int)) for mark in points}
    assert frequencies["at frequencies of the input"] == set(range(1, 20, 2))
    assert {k % 2 for k in frequencies["even distortion"]} == {0}
    assert frequencies["odd distortion"] == set(range(21, 58, 2))  # up to three times the highest one
    assert all(np.median(mark.y) > 3 * np.median(noise.y) for mark in points)
    assert np.median(noise.y) == pytest.approx(0.01 * 2 / np.sqrt(200) / 2, rel=0.3)  # of the mean of four periods
    assert distortion_figure(describe(write({"t": T, "u": U, "y": Y}))) is None


def test_many_files_are_described_in_a_line_each(run: Run, write: Write) -> None:
    paths = [write({"t": T, "u": U, "y": Y + 0.01 * k}, f"{k}.csv") for k in range(4)]
    out = run("describe", *paths)[1]
    assert "- in 4 of 4 files, such as 0.csv: y almost certainly responds to u after 1 sample" in out
    assert "4 files, such as 0.csv, together:\n- u is rich enough" in out
    assert shlex.split(out.splitlines()[-1])[2:6] == list(map(str, paths))


def test_what_several_files_show_names_the_file_and_the_column(run: Run, write: Write, tmp_path: Path) -> None:
    one = write({"t": T, "u": U, "y": Y}, "one.csv")
    others = [write({"t": T, "v": U, "w": Y + 0.01 * k}, f"{k}.csv") for k in range(3)]
    short = write({"t": T[:1], "u": U[:1], "y": Y[:1]}, "short.csv")
    status, out, _ = run("describe", one, short, *others, "--out", tmp_path / "page")
    assert status == 0
    assert "- in 1 of 5 files, one.csv: y almost certainly responds to u" in out
    assert "- in 3 of 5 files, such as 0.csv: w almost certainly responds to v" in out
    page = (tmp_path / "page" / "report.html").read_text("utf-8")
    assert '<li class="problem">short.csv: u is constant' in page
    assert "Run these, with corrections" in page
    run("describe", short, "--out", tmp_path / "short")
    page = (tmp_path / "short" / "report.html").read_text("utf-8")
    assert "There is nothing to identify here" in page
    assert "<figure" not in page


def test_columns_of_files_are_described_without_a_file(run: Run, write: Write) -> None:
    u, y = write({"u": U}, "u.csv"), write({"y": Y}, "y.csv")
    status, out, _ = run("describe", "--input", f"{u}:1", "--output", f"{y}:1", "--dt", "10ms")
    assert status == 0
    assert out.splitlines()[-1].split() == f"emsid identify {y} --input {u}:1 --output {y}:1 --dt 0.01".split()
    assert "missing argument 'FILE'" in run("describe")[2]


def test_json_and_a_page(run: Run, write: Write, tmp_path: Path) -> None:
    path = write({"t": T, "u": U, "y": -Y})
    status, out, _ = run("describe", path, "--json", "--out", tmp_path / "page")
    assert status == 0
    document = json.loads(out)
    (record,) = document["records"]
    assert record["guesses"]["input"]["column"] == "u"
    assert record["response"] == {"delay": 1, "sign": -1}
    assert record["guesses"]["time"]["evidence"]["its name"] == 4.0
    assert record["guesses"]["kind"]["file"] == "a dynamic record"
    assert {"response-negative", "excitation-sufficient"} <= {finding["code"] for finding in record["findings"]}
    assert document["commands"] == [f"emsid identify {path} --input u --output y --time t --scale u=-1"]
    page = (tmp_path / "page" / "report.html").read_text()
    assert "<svg" in page
    assert document["commands"][0] in re.sub("<[^>]+>", "", page)


def test_a_file_is_parsed_once(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    from emsid.io import READERS

    parsed = []
    reader = READERS[".csv"]
    monkeypatch.setitem(READERS, ".csv", lambda content: parsed.append(1) or reader(content))
    assert emsid.describe(write({"t": T, "u": U, "y": Y})).record is not None
    assert len(parsed) == 1


# --- proposed command ------------------------------------------------------------------------------------------------


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


def test_without_options_there_is_no_missing_option(run: Run, write: Write, tmp_path: Path) -> None:
    status, out, err = run("describe", write({"y": Y}))
    assert (status, err) == (0, "")
    assert "no column looks like the input; name it with --input" in out
    assert out.splitlines()[-1] == "nothing to identify here: see above"
    status, _, err = run("identify", write({"y": Y}))
    assert status == 2
    assert "name the input column; `emsid describe" in err
    for command in ("identify", "orders"):
        status, _, err = run(command, tmp_path / "nowhere.csv")
        assert status == 2
        assert "nowhere.csv: there is no such file" in err
