"""A library of identified actuators."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest

import emsid
from emsid import DataError, FormatError, Record
from emsid.io.motor_library import actuators, add_actuator, model_of


@pytest.fixture
def identified(tmp_path):
    """A model file of an axis, and the record that it was fitted to."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-5, 5, 30), 20)
    plant = emsid.LinearAxis(mass=2.0, viscous_friction=4.0)
    y = plant.simulate(u[:, None], 0.01, np.zeros(2), (emsid.plants.Signal.SPEED,)) + 0.01 * rng.standard_normal(
        (600, 1)
    )
    record = Record(u, y, 0.01, input_units="N", output_units="m/s")
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([u, y]), delimiter=",")
    fit = emsid.fit(emsid.plants.linear_axis(), record, free=["mass", "viscous_friction"])
    emsid.save(fit, tmp_path / "axis.json", record)
    return tmp_path


def test_an_actuator_is_kept_with_what_reproduces_it(identified) -> None:
    home = identified / "library"
    add_actuator(home, "axis-1", identified / "axis.json", [identified / "log.csv"], "emsid identify log.csv")
    entry = actuators(home)["axis-1"]
    assert entry.command == "emsid identify log.csv"
    assert entry.records[0].file == "log.csv"
    assert entry.records[0].sha256 == hashlib.sha256((identified / "log.csv").read_bytes()).hexdigest()
    kept, known = emsid.load(model_of(home, "axis-1")), emsid.load(identified / "axis.json")
    assert kept["mass"].interval == known["mass"].interval


def test_an_altered_model_and_other_mistakes_are_refused(identified) -> None:
    home, log = identified / "library", identified / "log.csv"
    add_actuator(home, "axis", identified / "axis.json", [log], "a command")
    with pytest.raises(DataError, match="has an actuator axis already"):
        add_actuator(home, "axis", identified / "axis.json", [log], "a command")
    with pytest.raises(DataError, match="no name of an actuator"):
        add_actuator(home, "../axis", identified / "axis.json", [log], "a command")
    with pytest.raises(DataError, match="name the records"):
        add_actuator(home, "other", identified / "axis.json", [], "a command")
    with pytest.raises(FormatError, match="not a model file"):
        add_actuator(home, "other", log, [log], "a command")
    with pytest.raises(DataError, match="has no actuator other; it has axis"):
        model_of(home, "other")
    with pytest.raises(FormatError, match="no such folder"):
        actuators(identified / "nowhere")
    path = home / "axis.json"
    path.write_text(path.read_text().replace("2", "3", 1))
    with pytest.raises(FormatError, match="altered since it was added"):
        actuators(home)


def test_the_command_lists_adds_and_compares(identified, run) -> None:
    home, model, log = (str(identified / name) for name in ("library", "axis.json", "log.csv"))
    for name in ("one", "two"):
        status, out, err = run(
            "motors", home, "--add", f"{name}={model}", "--record", log, "--command", "emsid identify"
        )
        assert (status, err) == (0, "")
        assert f"{name}: log.csv" in out
    status, out, _ = run("motors", home, "--compare", "one,two")
    assert status == 0
    assert [line.split()[-1] for line in out.splitlines()] == ["intervals", "overlap", "overlap"]
    data = json.loads(run("motors", home, "--json")[1])
    assert list(data["motors"]) == ["one", "two"]
    assert data["motors"]["one"]["parameters"]["mass"][0] == pytest.approx(2.0, rel=0.05)
    assert run("motors", home, "--add", f"three={model}", "--record", log)[0] == 2


def test_a_published_value_is_found_again_by_its_command(tmp_path, run, monkeypatch) -> None:
    """The command of an entry, run beside its records, gives its values; other records and models are refused."""
    import shlex

    monkeypatch.chdir(tmp_path)
    u = np.repeat(np.random.default_rng(1).uniform(-5, 5, 30), 20)
    plant = emsid.LinearAxis(mass=2.0, viscous_friction=4.0)
    y = plant.simulate(u[:, None], 0.01, np.zeros(2), (emsid.plants.Signal.SPEED,))[:, 0]
    noisy = y + 0.01 * np.random.default_rng(2).standard_normal(600)
    np.savetxt("log.csv", np.column_stack([u, noisy]), delimiter=",", header="u [N],y [m/s]", comments="", fmt="%.9g")
    words = "identify log.csv -u u -y y --dt 0.01 --models linear-axis --free mass,viscous_friction --out a"
    assert run(*words.split())[0] == 0
    assert run("motors", "lib", "--add", "axis=a/linear-axis.json", "--record", "log.csv", "--command", words)[0] == 0
    command = actuators("lib")["axis"].command
    assert run(*shlex.split(command.replace("--out a", "--out again")))[0] == 0
    status, out, err = run("motors", "lib", "--check", "axis=again/linear-axis.json", "--record", "log.csv")
    assert (status, err) == (0, "")
    assert [line.split()[-1] for line in out.splitlines()] == ["axis", "same", "same"]
    log = (tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text(log.replace("1", "2", 1))
    status, _, err = run("motors", "lib", "--check", "axis=again/linear-axis.json", "--record", "log.csv")
    assert (status, "its checksum differs" in err) == (2, True)
    (tmp_path / "log.csv").write_text(log)
    other = emsid.fit(emsid.plants.linear_axis(), Record(u, 2 * y, 0.01, input_units="N", output_units="m/s"))
    emsid.save(other, "other.json")
    status, out, err = run("motors", "lib", "--check", "axis=other.json", "--record", "log.csv")
    assert (status, "has other values than axis: mass" in err) == (2, True)
    assert run("motors", "lib", "--check", "axis=other.json")[0] == 2  # without its record


def test_another_file_of_the_folder_is_not_overwritten(identified) -> None:
    before = (identified / "axis.json").read_bytes()
    with pytest.raises(DataError, match="exists and is not of this library"):
        add_actuator(identified, "axis", identified / "axis.json", [identified / "log.csv"], "a command")
    (identified / "mine.json").write_text("{}")
    with pytest.raises(DataError, match="exists and is not of this library"):
        add_actuator(identified, "mine", identified / "axis.json", [identified / "log.csv"], "a command")
    assert (identified / "mine.json").read_text() == "{}"
    assert (identified / "axis.json").read_bytes() == before


def test_a_check_that_compares_nothing_fails(identified, run) -> None:
    home, log, bare = (str(identified / name) for name in ("library", "log.csv", "bare.json"))
    emsid.save(emsid.load(identified / "axis.json").model, bare)
    assert run("motors", home, "--add", f"bare={bare}", "--record", log, "--command", "emsid identify")[0] == 0
    status, _, err = run("motors", home, "--check", f"bare={identified / 'axis.json'}", "--record", log)
    assert status == 2
    assert "nothing to compare" in err
    assert run("motors", home, "--add", f"axis={identified / 'axis.json'}", "--record", log, "--command", "c")[0] == 0
    status, _, err = run("motors", home, "--check", f"axis={home}/../library/axis.json", "--record", log)
    assert (status, "the model of axis itself, so there is nothing to compare" in err) == (2, True)


def test_records_of_one_name_are_told_apart_by_their_folders_and_can_be_checked(identified, run) -> None:
    home, model, content = identified / "library", identified / "axis.json", (identified / "log.csv").read_bytes()
    paths = [identified / each for each in ("M1/log.csv", "M2/log.csv", "x/M2/log.csv", "M1/other.csv")]
    for k, path in enumerate(paths):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content + b"\n" * k)
    words = [word for path in paths for word in ("--record", path)]
    assert run("motors", home, "--add", f"axis={model}", *words, "--command", "emsid identify")[0] == 0
    names = [each.file for each in actuators(home)["axis"].records]
    assert names == ["M1/log.csv", f"{identified.name}/M2/log.csv", "x/M2/log.csv", "other.csv"]
    assert run("motors", home, "--check", f"axis={model}", *words)[0] == 0
    assert run("motors", home, "--check", f"axis={model}", *words[2:], *words[:2])[0] == 0
    status, _, err = run("motors", home, "--check", f"axis={model}", *words[2:])
    assert (status, "identified from M1/log.csv too" in err) == (2, True)
    paths[2].write_bytes(b"changed")
    status, _, err = run("motors", home, "--check", f"axis={model}", *words)
    assert (status, f"{paths[2]} is not the file" in err) == (2, True)
    status, _, err = run("motors", home, "--add", f"b={model}", *words[:2], *words[:2], "--command", "emsid identify")
    assert (status, "given twice" in err) == (2, True)


def test_an_actuator_is_replaced_only_with_force(identified, run) -> None:
    home, log = identified / "library", identified / "log.csv"
    words = ("motors", home, "--add", f"axis={identified / 'axis.json'}", "--record", log, "--command")
    assert run(*words, "the first")[0] == 0
    status, _, err = run(*words, "the second")
    assert (status, err.count("\n"), "--force" in err) == (2, 1, True)
    assert actuators(home)["axis"].command == "the first"
    assert run(*words, "the second", "--force")[0] == 0
    assert actuators(home)["axis"].command == "the second"
