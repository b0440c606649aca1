"""The example records of `emsid demo`: every command on their page works, and finds what was simulated."""

import json
import os
import shlex
import subprocess
import sys

import numpy as np
import pytest

import emsid
from conftest import try_few_refinements
from emsid.cli.commands.demo import COMMANDS, commands_page
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.registry import PLANTS
from emsid.study.demonstration import EXAMPLES
from emsid.units import plain_unit


@pytest.fixture(scope="module", params=["few refinements", pytest.param("all refinements", marks=pytest.mark.long)])
def folder(request, tmp_path_factory, command):
    """The folder after every command on the page, in its order, with empty figures."""
    place = tmp_path_factory.mktemp("demo") / "new"
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "few refinements":
            try_few_refinements(patch)
        patch.setattr("emsid.report.figures.draw", lambda _, formats: dict.fromkeys(formats, b""))
        assert command("demo", place) == 0
        patch.chdir(place)
        page = (place / "commands.md").read_text("utf-8")
        commands = [line.split(maxsplit=1) for line in page.splitlines() if line.startswith("    emsid")]
        assert len(commands) == sum(map(len, COMMANDS.values()))
        for _, words in commands:
            assert command(*shlex.split(words)) == 0, words
    return place


def result(folder, name):
    return json.loads((folder / f"{name}-result" / "result.json").read_text("utf-8"))


def parameters(found, model):
    (fit,) = (each for each in found["fits"] if each["model"] == model)
    return fit["parameters"]


def test_files_are_as_the_page_says(folder):
    assert (folder / "commands.md").read_text("utf-8") == commands_page()
    assert {path.stem for path in folder.glob("*.csv")} == {"simulated", *(example.name for example in EXAMPLES)}
    assert all((folder / f"{name}-result" / "result.json").exists() for name in ("motor", "axis", "circuit"))


@pytest.mark.parametrize(("folder_name", "enter"), [("two words", "cd 'two words' && "), (".", "")])
def test_the_first_command_works_from_where_one_is(folder_name, enter, tmp_path, monkeypatch, command, capsys):
    monkeypatch.chdir(tmp_path)
    assert command("demo", folder_name) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"  {enter}emsid {COMMANDS['motor'][0][0]}"


@pytest.mark.parametrize(
    ("name", "best", "fit"),
    [("motor", "rigid-motor", 99), ("axis", "linear-axis", 99.5), ("circuit", "wiener-hammerstein", 98.5)],
)
def test_what_was_simulated_is_chosen(folder, name, best, fit):
    found = result(folder, name)
    assert found["chosen"] == best
    (row,) = (each for each in found["rows"] if (each["model"], each["data"]) == (best, "unseen"))
    assert row["fit_percent"] > fit


@pytest.mark.parametrize(("name", "model", "within"), [("motor", "rigid-motor", 0.15), ("axis", "linear-axis", 0.03)])
def test_the_true_values_on_the_page_are_estimated(folder, name, model, within):
    """Every value that the page states has the name and the unit of its estimate."""
    page = (folder / "commands.md").read_text("utf-8")
    (example,) = (each for each in EXAMPLES if each.name == name)
    found = {row["name"]: row for row in parameters(result(folder, name), model)}
    for true in example.true:
        assert f"| {true.name} | {true.value:.6g} | {true.unit} |" in page
        if true.name in found and found[true.name]["standard_error"] is not None:
            assert plain_unit(found[true.name]["unit"]) == true.unit
            assert found[true.name]["value"] == pytest.approx(true.value, rel=within)
    assert {"motor": "voltage_dead_zone.half_width", "axis": "mass"}[name] in found


def test_no_value_of_the_motor_is_one_that_a_search_begins_with():
    """So that a value which is only kept or built in is seen to be wrong."""
    built_in = emsid.plants.rigid_motor()
    for kept in (built_in, DrivenMotor(), PLANTS["rigid-motor"].start):
        for true in EXAMPLES[0].true:
            assert not 0.7 < kept.value(true.name) / true.value < 1.4, true.name


def test_records_are_the_same_every_time():
    for example in EXAMPLES:
        first, again = example.record(), example.record()
        np.testing.assert_array_equal(first.output, again.output)
        assert len(first) <= 6000


def test_shells_complete_commands():
    asked = {"_EMSID_COMPLETE": "complete_bash", "COMP_WORDS": "emsid ide", "COMP_CWORD": "1"}
    done = subprocess.run([sys.executable, "-m", "emsid"], env=os.environ | asked, capture_output=True)
    assert done.stdout.split() == [b"identify"]
