"""What several files show together in the first look, and the commands for them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from emsid.first_look import describe, describe_files, groups
from first_look_records import N, Run, T, U, Write, Y, codes, proposals


def steps_from_rest(write: Write) -> list[Path]:
    """One step in each file; a command of 2 does not move the output."""
    paths = []
    for level in (-8, -5, -3, -2, 2, 3, 5, 8):
        u = np.where(T > 1, float(level), 0.0)
        moves = np.sign(u) * np.maximum(np.abs(u) - 2.5, 0.0)
        noise = 0.01 * np.random.default_rng(level + 8).standard_normal(N)
        y = signal.lfilter([0, 1.0], [1, -0.9], moves) + (abs(level) > 2) * noise
        paths.append(write({"t": T, "u": u, "y": y}, f"{level}.csv"))
    return paths


def test_files_show_together_what_none_shows_alone(run: Run, write: Write, tmp_path: Path) -> None:
    paths = steps_from_rest(write)
    looks, _ = describe_files(paths)
    alone = set.union(*map(codes, looks))
    assert "few-input-levels" in alone
    assert not {"excitation-sufficient", "nonlinear-likely"} & alone
    (group,) = groups(looks)
    assert len(group.looks) == 6  # the output of the others does not move
    found = {finding.code: finding.data for finding in group.findings}
    assert {"excitation-sufficient", "dead-zone-likely", "nonlinear-likely"} <= set(found)
    assert "few-input-levels" not in found
    assert found["dead-zone-likely"]["dead_zone"] == pytest.approx(2.5)  # between 2 and 3
    assert found["much-standstill" if "much-standstill" in found else "motion"]["reversals"] == 0  # within a file
    out = run("describe", *paths, "--out", tmp_path / "page")[1]
    assert "has only 2 levels" not in out
    assert "6 files, such as -8.csv, together:" in out
    page = re.sub("<[^>]+>", "", (tmp_path / "page" / "report.html").read_text())
    assert "6 files, such as -8.csv, together" in page
    document = json.loads(run("describe", *paths, "--json")[1])
    (joint,) = document["together"]
    assert (len(joint["files"]), "dead-zone-likely" in {each["code"] for each in joint["findings"]}) == (6, True)


def test_a_single_file_keeps_its_findings(write: Write) -> None:
    (look,), _ = describe_files([write({"t": T, "u": U, "y": Y})])
    assert [group.findings for group in groups([look])] == [()]


def test_files_of_other_sample_times_are_not_joined(write: Write) -> None:
    looks, _ = describe_files([write({"t": k * T, "u": U, "y": Y}, f"{k}.csv") for k in (1, 2)])
    assert [group.findings for group in groups(looks)] == [()]


def test_a_file_of_opposite_sign_has_a_command_of_its_own(write: Write) -> None:
    paths = [write({"t": T, "u": U, "y": sign * Y + 0.01 * k}, f"{k}.csv") for k, sign in enumerate((1, -1, 1))]
    words = proposals(describe_files(paths)[0])
    assert [[Path(each).name for each in command if each.endswith(".csv")] for command in words] == [
        ["0.csv", "2.csv"],
        ["1.csv"],
    ]
    assert [command[-2:] == ["--scale", "u=-1"] for command in words] == [False, True]


def test_a_copy_of_a_file_is_said_and_proposed_once(run: Run, write: Write) -> None:
    first, again = (write({"t": T, "u": U, "y": Y}, f"{name}.csv") for name in "ab")
    other = write({"t": T, "u": U, "y": Y + 0.1}, "other.csv")
    looks, found = describe_files([first, again, other, first])
    assert [(each.code, each.subject, each.data["copies"]) for each in found if each.code == "files-equal"] == [
        ("files-equal", str(first), [str(again), str(first)])
    ]
    assert [word for word in proposals(looks)[0] if word.endswith(".csv")] == [str(first), str(other)]
    out = run("describe", first, first)[1]
    assert "have the same samples" in out
    assert out.count(str(first)) == 3  # twice in the sentence, once in the command
    assert "files-equal" not in {each.code for each in describe_files([first, other])[1]}


def test_the_command_mends_what_the_files_need(write: Write) -> None:
    stuck, again = Y.copy(), Y + 0.1
    stuck[400:520] = stuck[400]
    again[100:220] = again[100]
    paths = [write({"t": T, "u": U, "y": y}, f"{k}.csv") for k, y in enumerate((Y, stuck, again))]
    (command,) = proposals(describe_files(paths)[0])
    values = [describe(path)["y"].stuck[0].value for path in paths[1:]]
    assert command[-2:] == ["--mask", f"y = {values[0]!r} OR y = {values[1]!r}"]
    given = describe(paths[1], mask="y > 19")
    assert (given.mends, given.reading["mask"]) == ({}, "y > 19")
    assert describe(paths[0]).mends == {}


def test_a_drift_is_subtracted_beside_a_mask_of_the_user(write: Write) -> None:
    u = np.repeat(np.random.default_rng(3).integers(-10, 11, 400).astype(float), 10)
    y = signal.lfilter([0.0, 0.5], [1.0, -0.9], u) + np.linspace(0, 100, len(u))
    path = write({"t": 0.01 * np.arange(len(u)), "u": u, "y": y})
    assert describe(path).mends == describe(path, mask="u > 100").mends == {"detrend": 1}
