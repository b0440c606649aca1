"""The command line as a user meets it: what it prints, what it writes, and how it refuses."""

import importlib
import io
import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import emsid
from conftest import try_few_refinements
from emsid.cli import main
from emsid.cli.interruption import ERASED, Interruption, tell
from emsid.cli.live_view import Screen
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Stopped
from emsid.identification.candidates import CANDIDATES
from emsid.models.plants.drive import Bridge, Drive
from emsid.models.plants.parameters import Signal

IDENTIFY = ("--input", "u", "--output", "y", "--dt", "0.01")
FIRST_ORDER = ("--na", 1, "--nb", 1, "--nk", 1)  # so that none is chosen


@pytest.fixture(autouse=True)
def heard():
    """Ctrl-C is heard, also where the tests run in the background of a shell that has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler), signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGINT, before[0])
    signal.signal(signal.SIGTERM, before[1])


@pytest.fixture(autouse=True)
def undrawn(monkeypatch):
    """Figures are empty files. The README and the tests of the report draw them."""
    monkeypatch.setattr("emsid.report.figures.draw", lambda _, formats: dict.fromkeys(formats, b""))


@pytest.fixture
def run(monkeypatch, capsys):
    """Call the command line in this process: (status, standard output, standard error)."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["emsid", *map(str, words)])
        status = 0
        try:
            main()
        except SystemExit as end:
            status = end.code or 0
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call


def table(path: Path, samples: int = 600, seed: int = 0, **columns: object) -> Path:
    """A CSV with input u and the output y of a first-order system."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, samples // 10), 10)
    y = np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.9 * y[t - 1] + 0.3 * u[t - 1]
    data = {"u": u, "y": y, **columns}
    rows = [",".join(data), *(",".join(str(values[t]) for values in data.values()) for t in range(samples))]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture
def log(tmp_path):
    return table(tmp_path / "log.csv")


@pytest.fixture(scope="module")
def result(tmp_path_factory, command):
    """A folder in which a record has been identified with the default models, their orders and map given.

    Figures are empty files here; `test_report` draws them.
    """
    folder = tmp_path_factory.mktemp("identified")
    log = table(folder / "log.csv", samples=300)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("emsid.report.figures.draw", lambda _, formats: dict.fromkeys(formats, b""))
        try_few_refinements(patch)
        blocks = ("--orders", "1", "--static", "dead-zone")
        assert command("identify", log, *IDENTIFY, *blocks, "--out", folder / "result") == 0
    return folder / "result"


def test_identify_writes_everything_it_promises(result):
    data = json.loads((result / "result.json").read_text())
    assert {row["model"] for row in data["rows"]} >= {"arx", "wiener-hammerstein-regression", "friction-narx"}
    assert {row["experiment"] for row in data["rows"]} == {"record"}
    assert {row["data"] for row in data["rows"]} == {"identification", "unseen"}
    unseen = [row for row in data["rows"] if row["data"] == "unseen"]
    errors = {row["model"]: row["simulation_mse"] for row in unseen}
    assert errors["arx"] < 1e-20
    assert errors[data["chosen"]] == pytest.approx(min(errors.values()), abs=1e-20)
    assert "<html" in (result / "report.html").read_text()
    for row in unseen:
        assert (result / f"{row['model']}.json").exists()
    assert len(list((result / "figures").glob("*.svg"))) > 3


def test_validate_reproduces_the_errors_of_identify(result, run, tmp_path):
    rows = json.loads((result / "result.json").read_text())["rows"]
    unseen = ("validate", "MODEL", result.parent / "log.csv", *IDENTIFY, "--rows", "210:300", "--json")
    for name in ("arx", "friction-narx", "wiener-hammerstein-regression"):
        (before,) = (row for row in rows if (row["model"], row["data"]) == (name, "unseen"))
        words = (result / f"{name}.json" if word == "MODEL" else word for word in unseen)
        status, out, _ = run(*words, "--horizon", "5")
        assert status == 0
        (after,) = json.loads(out)["records"]
        for error in ("simulation_mse", "one_step_mse", "fit_percent"):
            assert after[error] == pytest.approx(before[error], rel=1e-9, abs=1e-25)
        assert after["horizon"] == 5
        model, record = emsid.load(result / f"{name}.json"), emsid.read(unseen[2], input="u", output="y", dt=0.01)[210:]
        ahead = model.predict(record, 5)
        expected = np.mean((ahead.output - record.output)[ahead.counted] ** 2)
        assert after["horizon_mse"] == pytest.approx(expected, rel=1e-9, abs=1e-25)


def test_validate_says_that_the_model_was_fitted_to_these_data(result, run, tmp_path):
    """The model was fitted to the first 210 samples; a part of them, or a copy of the file, is no unseen record."""
    log, other = result.parent / "log.csv", table(tmp_path / "other.csv", seed=1)
    copy = tmp_path / "copy.csv"
    copy.write_text(log.read_text())

    def seen(*words: object) -> tuple[str, bool]:
        (document,) = json.loads(run("validate", result / "arx.json", *words, "--json")[1])["records"]
        return document["data"], "data-not-unseen" in {finding["code"] for finding in document["findings"]}

    assert seen(copy) == seen(log, "--rows", "20:150") == ("identification", True)
    assert seen(log, "--rows", "210:300") == seen(other) == ("unseen", False)


def test_validate_says_what_makes_an_error_large(result, run, tmp_path):
    """A file with another sample time, and an output that is not that of the model."""
    log, out = (result.parent / "log.csv").read_text(), tmp_path / "out"
    other = tmp_path / "log_dt2.csv"
    header, *rows = log.splitlines()
    at = header.split(",").index("y")
    cells = [row.split(",") for row in rows]
    turned = [",".join(str(-float(cell)) if k == at else cell for k, cell in enumerate(row)) for row in cells]
    other.write_text("\n".join([header, *turned]))
    status, said, _ = run("validate", result / "arx.json", other, "--out", out)
    assert status == 0
    for code in ("name of the file gives a sample time of 2 ms", "does not describe this record"):
        assert code in said
        assert code in (out / "report.html").read_text()
    (found,) = json.loads((out / "validation.json").read_text())["records"]
    codes = {"worse-than-mean", "sample-time-contradicted"}
    assert codes <= {each["code"] for each in found["findings"]}
    (found,) = json.loads(run("validate", result / "arx.json", result.parent / "log.csv", "--json")[1])["records"]
    assert not codes & {each["code"] for each in found["findings"]}


def test_validate_says_that_a_record_is_late(result, run, tmp_path):
    header, *rows = (result.parent / "log.csv").read_text().splitlines()
    cells, at = [row.split(",") for row in rows], header.split(",").index("y")
    for row, before in zip(reversed(cells[1:]), reversed(cells[:-1]), strict=True):
        row[at] = before[at]
    late = tmp_path / "late.csv"
    late.write_text("\n".join([header, *(",".join(row) for row in cells)]))
    (found,) = json.loads(run("validate", result / "arx.json", late, "--json")[1])["records"]
    (shifted,) = [each["data"] for each in found["findings"] if each["code"] == "record-shifted"]
    assert shifted["samples"] == pytest.approx(1, abs=0.2)
    (found,) = json.loads(run("validate", result / "arx.json", result.parent / "log.csv", "--json")[1])["records"]
    assert "record-shifted" not in {each["code"] for each in found["findings"]}


def test_identify_with_validation_file_and_chosen_models(run, log, tmp_path):
    other = table(tmp_path / "other.csv", seed=1)
    words = ("identify", log, *IDENTIFY, "--validate", other, "--models", "arx", "--na", "1", "--nb", "1", "--nk", "1")
    status, out, _ = run(*words, "--out", tmp_path / "out")
    assert status == 0
    assert "y(t) = 0.9*y(t-1) + 0.3*u(t-1) + e(t)" in out
    assert not (tmp_path / "out" / "friction-narx.json").exists()


def test_simulate_then_describe(run, tmp_path):
    path = tmp_path / "made.csv"
    status, out, _ = run("simulate", "--excitation", "prbs", "--duration", "2", "--out", path)
    assert status == 0
    assert "400 samples, crest factor 1.00" in out
    status, out, _ = run("describe", path, "--input", "voltage", "--output", "speed", "--time", "t")
    assert status == 0
    assert "time column t: 400 samples, dt 5 ms, jitter 0 %, no gaps, no duplicates\n" in out
    assert "- voltage is persistently exciting of order at least 25: enough for linear models and for friction" in out


def test_quantisation_is_no_excitation_unless_it_is_asked_for(run, tmp_path):
    path = tmp_path / "made.csv"
    assert run("simulate", "--duration", "20", "--out", path)[0] == 0  # five sines, in steps of a converter
    words = ("describe", path, "--input", "voltage", "--output", "speed", "--time", "t")
    assert "persistently exciting of order 10: " in run(*words)[1]
    assert "persistently exciting of order at least 50: " in run(*words, "--tolerance", "1e-6")[1]
    for wrong in ("0", "2", "nan"):
        status, out, err = run(*words, "--tolerance", wrong)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert "give a number between 0 and 1" in err


def test_a_low_order_of_excitation_is_called_too_low(run, tmp_path):
    path = tmp_path / "step.csv"
    path.write_text("u,y\n" + "".join(f"{int(t > 100)},{t}\n" for t in range(400)))
    out = run("describe", path, "--input", "u", "--output", "y", "--dt", "1ms")[1]
    assert "persistently exciting of order 1; a linear model of second order needs 4" in out


def test_list_names_every_model_and_signal(run):
    from emsid.excitation import SIGNALS

    status, out, _ = run("list")
    assert status == 0
    rows = [line.split(maxsplit=1) for line in out.splitlines() if line.startswith("  ")]
    names = json.loads(run("list", "--json")[1])
    assert dict(rows) == names["models"] | names["excitation"]
    assert (list(names["models"]), list(names["excitation"])) == (list(CANDIDATES), list(SIGNALS))


BAD = {
    "missing column": (("identify", "LOG", "--input", "volts", "--output", "y", "--dt", "1"), ("volts", "u, y")),
    "misspelt column": (("identify", "LOG", "--input", "u", "--output", "yy", "--dt", "1"), ("yy", "y")),
    "no sample time": (("identify", "LOG", "--input", "u", "--output", "y"), ("--dt", "--time")),
    "missing file": (("identify", "nowhere.csv", *IDENTIFY), ("nowhere.csv", "no such file")),
    "unknown model": (("identify", "LOG", *IDENTIFY, "--models", "arxx"), ("arxx", "friction-narx")),
    "bad rows": (("identify", "LOG", *IDENTIFY, "--rows", "5"), ("--rows", "A:B")),
    "empty rows": (("identify", "LOG", *IDENTIFY, "--rows", "900:950"), ("600",)),
    "bad scale": (("identify", "LOG", *IDENTIFY, "--scale", "u"), ("--scale", "COLUMN=VALUE")),
    "no model named": (("identify", "LOG", *IDENTIFY, "--models", ""), ("--models '': write it as names with commas",)),
    "a model left out": (("identify", "LOG", *IDENTIFY, "--models", "arx,,wiener"), ("--models 'arx,,wiener'",)),
    "nothing free": (("identify", "LOG", *IDENTIFY, "--models", "motor", "--free", ""), ("--free ''",)),
    "no order": (("identify", "LOG", *IDENTIFY, "--orders", ""), ("--orders '': write it as whole numbers",)),
    "scale twice": (
        ("identify", "LOG", *IDENTIFY, "--scale", "u=2", "--scale", "u=3"),
        ("--scale gives u twice, as 2 and as 3; leave one of them out",),
    ),
    "unit twice": (("describe", "LOG", *IDENTIFY, "--unit", "u=V", "--unit", "u=mV"), ("u twice, as V and as mV",)),
    "parameter fixed twice": (
        ("identify", "LOG", *IDENTIFY, "--models", "motor", "--fix", "resistance=1", "--fix", "resistance=2"),
        ("--fix gives resistance twice",),
    ),
    "scale that is no number": (("identify", "LOG", *IDENTIFY, "--scale", "u=x"), ("--scale", "not a number")),
    "mask that leaves nothing": (("identify", "LOG", *IDENTIFY, "--mask", "u > -99"), ("mask",)),
    "mask that is no condition": (("identify", "LOG", *IDENTIFY, "--mask", "u >"), ("mask",)),
    "unit without meaning": (("identify", "LOG", *IDENTIFY, "--unit", "y=count/sample"), ("--counts-per-revolution",)),
    "unknown unit": (("identify", "LOG", *IDENTIFY, "--unit", "y=furlong/moon"), ("furlong/moon",)),
    "too few samples": (("identify", "LOG", *IDENTIFY, "--rows", "8:14"), ("6 samples", "--rows")),
    "model file that is none": (("validate", "LOG", "LOG", *IDENTIFY), ("log.csv",)),
    "unknown signal": (("simulate", "--excitation", "noise", "--out", "x.csv"), ("noise", "prbs")),
    "unknown suffix to write": (("simulate", "--out", "x.doc"), (".doc", ".csv")),
    "negative duration": (("simulate", "--duration", "-1", "--out", "x.csv"), ("-1",)),
    "study of one record": (("study", "--record", "LOG"), ("--validate",)),
    "study without duration": (("study", "--duration", "0"), ("duration",)),
    "more coefficients than anybody means": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--na", "99999999999999"),
        ("na", "1000"),
    ),
    "orders in words": (("identify", "LOG", *IDENTIFY, "--orders", "two"), ("--orders",)),
    "orders for another structure": (
        ("identify", "LOG", *IDENTIFY, "--models", "wiener", "--orders", "2,2"),
        ("wiener has 1 filter; 2 orders given", "give one for each (--orders)"),
    ),
    "unknown static map": (("identify", "LOG", *IDENTIFY, "--static", "cubic"), ("cubic", "dead-zone")),
    "unknown physical parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "rigid-motor", "--fix", "resistanse=1"),
        ("resistanse", "resistance"),
    ),
    "profile of an unknown parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx,rigid-motor", "--profile", "resistance,inertia"),
        ("rigid-motor has no parameter 'inertia'", "rotor_inertia"),
    ),
    "profile of a fixed parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "rigid-motor", "--fix", "resistance=1", "--profile", "resistance"),
        ("resistance is fixed, so it has no profile", "rotor_inertia"),
    ),
    "profile of a parameter that is not free": (
        (
            *("identify", "LOG", *IDENTIFY, "--models", "rigid-motor"),
            *("--free", "rotor_inertia", "--profile", "motor_constant"),
        ),
        ("motor_constant is not estimated, so it has no profile; add it to the free parameters", "rotor_inertia"),
    ),
    "profile without a physical model": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--profile", "resistance"),
        ("resistance cannot be profiled", "rigid-motor, motor, linear-axis"),
    ),
    "fixed without a physical model": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--fix", "resistance=1"),
        ("resistance cannot be fixed", "rigid-motor, motor, linear-axis"),
    ),
    "transient of a whole record": (
        ("identify", "LOG", *IDENTIFY, "--models", "arx", "--transient", "100000"),
        ("a transient of 100000 samples leaves no sample", "--transient"),
    ),
    "misspelt parameter": (
        ("identify", "LOG", *IDENTIFY, "--models", "rigid-motor", "--fix", "resistanc=2"),
        ("rigid-motor has no parameter 'resistanc'; did you mean resistance",),
    ),
    "missing datasheet": (("identify", "LOG", *IDENTIFY, "--datasheet", "sheet.toml"), ("sheet.toml",)),
    "missing motor": (("study", "--motor", "motor.toml"), ("motor.toml",)),
    "forgetting of zero": (("study", "--forgetting", "0", "--duration", "2"), ("forgetting",)),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(case, run, log, tmp_path, monkeypatch):
    words, said = BAD[case]
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*(str(log) if word == "LOG" else word for word in words))
    assert status == 2
    assert err.count("\n") == 1
    assert err.startswith("emsid: ")
    assert all(part in err for part in said), err
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [("constant input", {"u": np.ones(600)}, "nothing can be identified"), ("text", {"y": ["x"] * 600}, "row")],
)
def test_columns_that_cannot_be_identified_from(name, values, said, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bad = table(tmp_path / "bad.csv", **values)
    status, _, err = run("identify", bad, *IDENTIFY)
    assert status == 2
    assert said in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["bad.csv"]


@pytest.fixture(scope="module")
def motor_log(tmp_path_factory, command):
    """A CSV of a simulated motor."""
    path = tmp_path_factory.mktemp("motor") / "motor.csv"
    assert command("simulate", "--duration", 4, "--out", path) == 0
    return path


MOTOR = ("--input", "voltage", "--output", "speed", "--time", "t")
SHEETS = {"motor": "[motor]\nresistance = '2 ohm'\n", "axis": "[linear-axis]\nmass = '1 kg'\n"}


@pytest.fixture
def bare(monkeypatch):
    """Physical candidates without the search for refinements, which takes its time."""
    from emsid.identification import fitting as identification

    for name in ("rigid-motor", "linear-axis"):
        plain = replace(identification.CANDIDATES[name], refinements=())
        monkeypatch.setitem(identification.CANDIDATES, name, plain)


def test_a_profile_is_printed_drawn_and_written(run, motor_log, tmp_path, bare):
    wanted = "motor_constant,drive.delay"
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", "--fix", "resistance=2", "--profile", wanted)
    status, out, _ = run(*words, "--out", tmp_path / "out")
    assert status == 0
    data = json.loads((tmp_path / "out" / "result.json").read_text())
    (profile,) = data["profiles"]
    assert (profile["model"], profile["name"], profile["unit"]) == ("rigid-motor", "motor_constant", "N*m/A")
    low, high = profile["interval"]
    assert low < profile["estimate"] < high
    assert high - low == pytest.approx(2 * 1.96 * profile["standard_error"], rel=0.2)
    assert len(profile["values"]) == len(profile["deviance"]) >= 9
    said = f"by its profile, the 95 % interval of motor_constant goes from {low:.6g} to {high:.6g} N·m/A."
    missing = "rigid-motor: no profile of drive.delay: drive.delay was not estimated; profiles can be had of "
    assert said in out
    assert missing in out
    assert [each["subject"] for each in data["findings"] if each["code"] == "profile-failed"] == ["drive.delay"]
    assert (tmp_path / "out" / "figures" / "rigid-motor-profile-motor-constant.svg").exists()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Likelihood profile of motor_constant" in page
    assert said.replace(" %", "\N{NO-BREAK SPACE}%") in page


def test_a_datasheet_of_another_plant_is_reported_as_unused(run, motor_log, tmp_path, bare):
    sheet = tmp_path / "sheet.toml"
    sheet.write_text(SHEETS["motor"])
    words = ("identify", motor_log, *MOTOR, "--models", "arx,linear-axis,rigid-motor", "--datasheet", sheet)
    status, out, _ = run(*words, "--out", tmp_path / "out")
    assert status == 0
    said = "linear-axis: the datasheet has no parameter of this model, so it is not used."
    assert out.count(said) == 1
    assert "datasheet has" not in out.replace(said, "")
    assert said in (tmp_path / "out" / "report.html").read_text()
    findings = json.loads((tmp_path / "out" / "result.json").read_text())["findings"]
    assert {"code": "datasheet-not-used", "subject": "linear-axis", "data": {"model": "linear-axis"}} in findings


@pytest.mark.parametrize(
    ("kind", "models", "usable"),
    [
        ("axis", "rigid-motor,motor", "linear-axis"),
        ("motor", "linear-axis", "rigid-motor, motor"),
        ("motor", "arx", "rigid-motor, motor"),
    ],
)
def test_a_datasheet_that_no_model_can_use_is_refused_before_anything_is_fitted(
    kind, models, usable, run, motor_log, tmp_path, monkeypatch
):
    monkeypatch.setattr("emsid.identification.candidates.choose", None)
    sheet = tmp_path / "sheet.toml"
    sheet.write_text(SHEETS[kind])
    out = tmp_path / "out"
    status, _, err = run("identify", motor_log, *MOTOR, "--models", models, "--datasheet", sheet, "--out", out)
    assert status == 2
    assert err.count("\n") == 1
    assert f"choose a model that has some of them: {usable}" in err
    assert not out.exists()


def test_interrupting_a_profile_keeps_the_fit(run, motor_log, tmp_path, bare, monkeypatch):
    def interrupted(*_, **__):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setattr("emsid.identification.profiles.likelihood_profile", interrupted)
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", "--profile", "motor_constant")
    status, out, err = run(*words, "--out", tmp_path / "out")
    assert status == 130
    assert "interrupted" in err
    assert "Recommended: rigid-motor" in out
    assert json.loads((tmp_path / "out" / "result.json").read_text())["profiles"] == []


def test_interrupting_keeps_what_was_found(run, log, tmp_path, monkeypatch):
    from emsid.identification import fitting as identification

    def interrupted(*_):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setitem(identification.CANDIDATES, "friction-narx", interrupted)
    status, out, err = run("identify", log, *IDENTIFY, "--models", "arx,friction-narx", "--out", tmp_path / "out")
    assert status == 130
    assert "interrupted" in err
    assert "Recommended: arx" in out
    rows = json.loads((tmp_path / "out" / "result.json").read_text())["rows"]
    assert {row["model"] for row in rows} == {"arx"}
    assert (tmp_path / "out" / "report.html").exists()


def test_every_finished_model_is_saved_at_once(run, log, tmp_path, monkeypatch):
    from emsid.identification import fitting as identification

    def killed(*_):
        assert emsid.load(tmp_path / "out" / "arx.json").name == "arx"
        assert not (tmp_path / "out" / "result.json").exists()
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setitem(identification.CANDIDATES, "friction-narx", killed)
    status, _, _ = run("identify", log, *IDENTIFY, "--models", "arx,friction-narx", "--out", tmp_path / "out")
    assert status == 130


def test_interrupting_before_anything_is_found_writes_nothing(run, log, tmp_path, monkeypatch):
    from emsid.identification import fitting as identification

    def interrupted(*_):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setitem(identification.CANDIDATES, "arx", interrupted)
    status, _, _ = run("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "out")
    assert status != 0
    assert not (tmp_path / "out").exists()


def test_the_first_lines_are_the_recommendation_its_error_and_the_next_experiment(run, motor_log, tmp_path):
    out = tmp_path / "out"
    status, printed, _ = run("identify", motor_log, *MOTOR, "--models", "arx,polynomial-narx", "--out", out)
    first, second, third, *rest = printed.splitlines()
    assert status == 0
    assert first.startswith("Recommended: ")
    best = first.removeprefix("Recommended: ").partition(".")[0]
    assert second.startswith(f"{best}: on unseen data, the free run has a fit of ")
    assert third.startswith("Next experiment: ")
    (line,) = [line for line in rest if "recommended; " in line]
    assert line.split()[0] == best
    (other,) = {"arx", "polynomial-narx"} - {best}
    assert not any(line.startswith(f"- {other}: ") for line in rest)  # findings about it are in the report
    assert other in printed


def test_where_no_model_can_be_used_none_is_called_recommended(run, tmp_path):
    rng = np.random.default_rng(8)
    noise = table(tmp_path / "noise.csv", 400, u=rng.standard_normal(400), y=rng.standard_normal(400).cumsum())
    out = tmp_path / "out"
    status, printed, _ = run("identify", noise, *IDENTIFY, "--models", "arx", "--out", out)
    page = (out / "report.html").read_text()
    assert status == 0
    assert printed.startswith("No model is recommended: ")
    assert "recommended; " not in printed
    assert "none is recommended" in page
    assert "arx is recommended" not in page
    assert not (out / "recommended.json").exists()
    assert (out / "arx.json").exists()


def test_an_answer_on_a_terminal_takes_the_place_of_the_progress_bar(monkeypatch, answers):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    tell("stopping")
    assert answers == [f"{ERASED}emsid: stopping\n"]


def test_a_live_view_shows_the_answer_to_ctrl_c_itself(capsys, answers):
    pressed = Interruption()
    with Screen(str) as view, pressed.asked("ending; writing record and report", view.told):
        pressed()
    assert "ending; writing record and report" in capsys.readouterr().out
    assert answers == []
    with pressed.asked("stopping"):
        pressed.pressed = False
        pressed._when = -math.inf
        pressed()
    assert len(answers) == 1


def test_no_command_is_cut_in_the_list_of_commands(run):
    _, out, _ = run("--help")
    listed = out.partition("Commands:\n")[2].partition("\n\n")[0].splitlines()
    assert len(listed) == 11
    assert all(line.endswith(".") and not line.endswith("...") for line in listed)


def test_a_candidate_that_cannot_be_fitted_is_named_and_the_others_go_on(run, tmp_path):
    two_inputs = table(tmp_path / "two.csv", v=np.random.default_rng(3).standard_normal(600))
    words = ("identify", two_inputs, *IDENTIFY, "--input", "v", "--models", "arx,friction-narx", "--rows", "0:40")
    status, out, _ = run(*words, "--out", tmp_path / "out")
    assert status == 0
    assert "friction-narx: could not be fitted" in out


def test_interrupting_the_drawing_keeps_all_numbers(run, log, tmp_path, monkeypatch):
    def interrupted(*_):
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setattr("emsid.report.figures.draw", interrupted)
    out = tmp_path / "out"
    status, printed, err = run("identify", log, "-u", "u", "-y", "y", "--dt", 0.01, "--models", "arx", "--out", out)
    assert status == 130
    assert "interrupted" in err
    assert "Recommended: arx" in printed
    assert "report.html" not in printed
    assert sorted(path.name for path in out.iterdir()) == ["arx.json", "recommended.json", "result.json"]


def test_what_follows_from_an_interrupt_is_one(run, log, tmp_path, monkeypatch):
    """An import that was cut short fails later, as anything at all."""

    def half_imported(*_, **__):
        os.kill(os.getpid(), signal.SIGINT)

    def broken(*_, **__):
        try:
            half_imported()
        except KeyboardInterrupt:
            raise NameError("name '_half' is not defined") from None

    monkeypatch.setattr("emsid.identification.workflow.identify", broken)
    status, _, err = run("identify", log, "-u", "u", "-y", "y", "--dt", 0.01, "--out", tmp_path / "out")
    assert status == 130
    assert err == "emsid: interrupted; there is no result\n"
    assert not (tmp_path / "out").exists()


def test_a_candidate_that_the_numbers_defeat_is_left_out(run, log, tmp_path, monkeypatch):
    def defeated(*_):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setitem(CANDIDATES, "friction-narx", defeated)
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--models", "arx,friction-narx", "--out", tmp_path / "out")
    status, printed, _ = run("identify", log, *words)
    assert status == 0
    assert "friction-narx: could not be fitted: the numbers are out of range (SVD did not converge)" in printed


def test_errors_on_identification_data_are_reported_as_such(run, log, tmp_path):
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--models", "arx, arx", *FIRST_ORDER, "--out", tmp_path / "out")
    status, printed, _ = run("identify", log, "--validate", log, *words)
    assert status == 0
    assert "contains data of the fit, so these errors say nothing about unseen data" in printed
    assert "say nothing about unseen data" not in run("identify", log, *words)[1]


@pytest.mark.parametrize(("spent", "left"), [(3.0, 14.0), (8.0, 10.0)])
def test_a_budget_is_of_the_whole_command(run, log, tmp_path, monkeypatch, spent, left):
    asked, clock = [], iter([0.0, spent])

    def searched(*_, budget, **__):
        asked.append(budget)
        raise emsid.ModelError("enough")

    monkeypatch.setattr("emsid.identification.workflow.identify", searched)
    monkeypatch.setattr(sys.modules["emsid.cli.commands.identify"], "monotonic", lambda: next(clock))
    status, _, err = run("identify", log, *IDENTIFY, "--budget", "20s", "--out", tmp_path)
    assert (status, err) == (2, "emsid: enough\n")
    assert asked == [left]


@pytest.mark.parametrize("fraction", [0, 1, 2, -0.5, "nan"])
def test_fractions_kept_unseen_lie_between_none_and_all(run, log, tmp_path, fraction):
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--out", tmp_path / "out", "--unseen", fraction)
    status, _, err = run("identify", log, *words)
    assert (status, err.count("\n")) == (2, 1)
    assert "give a fraction between 0 and 1" in err


@pytest.mark.parametrize("command", ["study", "identify"])
def test_a_folder_that_cannot_be_written_to_is_noticed_before_anything_is_done(run, log, command):
    words = ("identify", log, "-u", "u", "-y", "y", "--dt", 0.01) if command == "identify" else ("study",)
    status, _, err = run(*words, "--out", log / "below")
    assert status == 2
    assert "is not a folder that can be written to" in err


STOPPING = "emsid: stopping after this step; the results so far follow (Ctrl-C again: end without them)\n"
LEFT_OUT = "emsid: the report is left out\n"
FOUND = "emsid: identification was interrupted; the results so far are printed above and written\n"
REGRESSIONS = ("--models", "arx, wiener-hammerstein-regression", *FIRST_ORDER, "--degree", 2, "--taps", 1)


def press():
    """Ctrl-C, heard at once."""
    os.kill(os.getpid(), signal.SIGINT)


class Lost:
    """Ctrl-C in a callback, where exceptions are lost."""

    def __del__(self):
        press()


@pytest.fixture
def pressed_at(monkeypatch):
    """Ctrl-C the next time each of these functions is called, so that no test depends on speed."""

    def arrange(*places, press=press):
        for place in places:
            module, name = place.rsplit(".", 1)
            home = importlib.import_module(module)
            real = getattr(home, name)

            def called(*given, home=home, name=name, real=real, **named):
                monkeypatch.setattr(home, name, real)
                press()
                return real(*given, **named)

            monkeypatch.setattr(home, name, called)

    return arrange


def test_ctrl_c_in_demo_says_which_files_are_complete(run, tmp_path, pressed_at):
    pressed_at("emsid.io.write_record")
    status, out, err = run("demo", tmp_path / "new")
    assert (status, out, err) == (130, "", "emsid: interrupted; only the files named above are complete\n")


@pytest.mark.parametrize("place", ["emsid.io.read", "emsid.identification.options.least_squares"])
def test_ctrl_c_before_anything_is_found(place, run, log, tmp_path, pressed_at):
    pressed_at(place)
    words = ("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "out")
    assert run(*words) == (130, "", "emsid: interrupted; there is no result\n")
    assert not (tmp_path / "out").exists()


def assert_whole(folder, drawn):
    """A model file for every model of the result, and the page with its figures, or neither."""
    rows = json.loads((folder / "result.json").read_text())["rows"]
    models = {f"{row['model']}.json" for row in rows}
    assert {path.name for path in folder.glob("*.json")} == models | {"recommended.json", "result.json"}
    assert {path.name for path in folder.iterdir() if path.suffix != ".json"} == (
        {"report.html", "figures"} if drawn else set()
    )


@pytest.mark.parametrize(
    ("place", "press", "drawn"),
    [
        ("emsid.identification.regressions.wiener_hammerstein_regression", press, True),
        ("emsid.identification.regressions.wiener_hammerstein_regression", Lost, True),
        ("emsid.identification.compared.compare", press, True),
        ("emsid.io.save", press, True),  # a model is saved as soon as it is fitted
        ("emsid.report.page.page", press, False),
        ("emsid.report.figures.draw", Lost, False),
    ],
)
def test_ctrl_c_keeps_the_results_so_far(place, press, drawn, run, log, tmp_path, pressed_at, monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)
    pressed_at(place, press=press)
    status, out, err = run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert "Recommended: " in out
    assert out.splitlines()[-1].startswith(f"written to {tmp_path / 'out'}/: ")
    assert ("report.html" in out.splitlines()[-1]) == drawn
    assert_whole(tmp_path / "out", drawn)


VALUES, COMPARE = "emsid.identification.workflow.built_in_values", "emsid.identification.compared.compare"


@pytest.mark.parametrize("then", [(VALUES,), (COMPARE,), (VALUES, COMPARE)])
def test_ctrl_c_twice_within_a_moment_is_ctrl_c_once(then, run, log, tmp_path, pressed_at):
    pressed_at("emsid.identification.regressions.wiener_hammerstein_regression", *then)
    status, out, err = run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert "Recommended: arx" in out
    assert json.loads((tmp_path / "out" / "result.json").read_text())["chosen"] == "arx"
    assert_whole(tmp_path / "out", drawn=True)


def test_a_grey_box_interrupted_twice_keeps_its_search(run, motor_log, tmp_path, pressed_at):
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", "--free", "motor_constant,rotor_inertia")
    pressed_at(*(f"emsid.models.plants.search.continuation.{name}" for name in ("gauss_newton", "with_colour")))
    status, _, err = run(*words, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert json.loads((tmp_path / "out" / "result.json").read_text())["chosen"] == "rigid-motor"


# A fresh process that is sent Ctrl-C where a module is imported, and again when it ends. It has one core, so that it
# draws the figures itself.
SIGNALLED = """
import atexit, os, signal, sys

class Finder:
    def find_spec(self, name, *_):
        if name == wanted:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
wanted, *sys.argv = sys.argv[1:]
sys.meta_path.insert(0, Finder())
atexit.register(lambda: (os.kill(os.getpid(), signal.SIGINT), str(signal)))
from emsid.__main__ import main
main()
"""


def signalled(folder, module, *words):
    """Run the program with Ctrl-C at an import and at its end: (status, standard output, standard error)."""
    command = [sys.executable, "-c", SIGNALLED, module, "emsid", *map(str, words)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def answers(monkeypatch):
    """What Ctrl-C is answered at once, on the standard error of the process."""
    lines = []
    monkeypatch.setattr("emsid.cli.interruption.os.write", lambda _, words: lines.append(words.decode()))
    return lines


def test_ctrl_c_is_answered_the_results_written_and_then_the_report_drawn(run, log, tmp_path, pressed_at, answers):
    out, seen = tmp_path / "out", []
    pressed_at("emsid.identification.regressions.wiener_hammerstein_regression")
    pressed_at("emsid.report.page.page", press=lambda: seen.extend([*answers, *out.iterdir()]))
    assert run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", out)[0] == 130
    count = len(list((out / "figures").iterdir()))
    assert seen[:2] == answers == [STOPPING, f"emsid: drawing the report with {count} figures (Ctrl-C: leave it out)\n"]
    assert {path.name for path in seen[2:]} >= {"result.json", "arx.json"}


def test_a_second_ctrl_c_leaves_the_report_out(run, log, tmp_path, pressed_at, answers, monkeypatch):
    clock = iter(range(0, 100, 10))
    monkeypatch.setattr("emsid.cli.interruption.monotonic", lambda: next(clock))
    pressed_at("emsid.identification.regressions.wiener_hammerstein_regression", "emsid.report.page.page")
    status, out, err = run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")
    assert (status, err) == (130, FOUND)
    assert "Recommended: arx" in out
    assert answers[0] == STOPPING
    assert answers[-1] == LEFT_OUT
    assert_whole(tmp_path / "out", drawn=False)


@pytest.mark.parametrize("at", range(2))
def test_a_report_is_written_as_a_whole(at, run, log, tmp_path, pressed_at, monkeypatch):
    """Ctrl-C while its files are written waits until they are."""
    clock = iter(range(0, 1000, 10))
    monkeypatch.setattr("emsid.cli.interruption.monotonic", lambda: next(clock))
    pressed_at("emsid.report.page.write_files" if at else "emsid.report.page.atomic_write")
    assert run("identify", log, *IDENTIFY, *REGRESSIONS, "--out", tmp_path / "out")[0] == 130
    assert_whole(tmp_path / "out", drawn=True)


def test_ctrl_c_at_exit_prints_no_second_message(tmp_path):
    status, out, err = signalled(tmp_path, "", "list")
    assert (status, err) == (130, "")
    assert out.splitlines()[-1].startswith("files written: ")


def test_ctrl_c_while_the_drawing_library_is_imported(log, tmp_path):
    status, out, err = signalled(
        tmp_path, "matplotlib.figure", "identify", log, *IDENTIFY, *REGRESSIONS, "--pdf", "--out", "out"
    )
    assert (status, err) == (130, LEFT_OUT + FOUND)
    assert "Recommended: " in out
    assert_whole(tmp_path / "out", drawn=False)


def test_ctrl_c_after_a_moment_is_another_one(monkeypatch):
    clock = iter([0.0, 0.4, 1.3, 2.5, 3.0])
    monkeypatch.setattr("emsid.cli.interruption.monotonic", lambda: next(clock))
    pressed = Interruption()
    for counts in (True, False, False, True):  # the third comes 0.9 s after the second
        with pytest.raises(KeyboardInterrupt) if counts else nullcontext():
            pressed()
    pressed.begin()
    with pytest.raises(KeyboardInterrupt):
        pressed()


@pytest.mark.parametrize(
    "module", ["emsid.cli", "typer", "polars", "numpy.linalg", "emsid.models.blocks.search.estimation"]
)
def test_ctrl_c_amid_the_first_imports_is_one_line(module, log, tmp_path):
    words = ("describe", log) if "models" not in module else ("identify", log, "--models", "arx", "--out", "out")
    status, out, err = signalled(tmp_path, module, *words, *IDENTIFY)
    assert (status, out, err) == (130, "", "emsid: interrupted; there is no result\n")
    assert not (tmp_path / "out").exists()


def test_ctrl_c_in_a_callback_is_not_spoken_of_twice():
    program = """
import sys
from emsid import __main__, cli
class Lost:
    def __init__(self, problem): self.problem = problem
    def __del__(self): raise self.problem
def work():
    Lost(KeyboardInterrupt())
    Lost(ValueError("a slip of the program"))
cli.main = work
__main__.main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "KeyboardInterrupt" not in done.stderr
    assert "a slip of the program" in done.stderr


def test_the_unseen_record_of_a_study_has_two_names(run, tmp_path):
    for name in ("--validate", "--verify"):
        status, _, err = run("study", name, tmp_path / "b.csv")
        assert status == 2
        assert "--record and --validate belong together" in err


def test_a_study_interrupted_while_it_is_drawn_is_printed_and_written(run, tmp_path, monkeypatch):
    from emsid.report.page import write_report  # noqa: F401  (loads the module)

    monkeypatch.setattr(sys.modules["emsid.report.page"], "page", lambda *_: os.kill(os.getpid(), signal.SIGINT))
    monkeypatch.setattr("emsid.study.workflow.searches", lambda *_, **__: {})  # regressions are enough to be drawn
    status, out, err = run("study", "--duration", "2", "--out", tmp_path / "out")
    assert status == 130
    assert err == FOUND.replace("identification", "the study")
    assert "simulation study" in out
    assert "more findings" in out
    assert "study-paper-ratios" in (tmp_path / "out" / "study.json").read_text()
    assert "The paper does not say" not in out  # that is in the report
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["study.json"]


def test_being_terminated_is_quiet(run, log, tmp_path, pressed_at):
    pressed_at("emsid.report.page.page", press=partial(os.kill, os.getpid(), signal.SIGTERM))
    status, _, err = run("identify", log, *IDENTIFY, "--models", "arx", "--out", tmp_path / "out")
    assert (status, err) == (143, "")


COMPILED = """
import hashlib, signal, sys
from emsid.cli.interruption import INTERRUPTION
signal.signal(signal.SIGINT, INTERRUPTION)
INTERRUPTION.watch()
with INTERRUPTION.asked(sys.argv[1]):
    print("begun", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 100_000_000)
"""


@pytest.mark.parametrize(("answer", "presses"), [("stopping", 2), ("", 1)], ids=["of a search", "of other work"])
def test_ctrl_c_ends_a_step_that_python_does_not_leave(answer, presses):
    process = subprocess.Popen(
        [sys.executable, "-c", COMPILED, answer], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.1)
    for _ in range(presses):
        process.send_signal(signal.SIGINT)
        time.sleep(0.3)
    _, err = process.communicate(timeout=5)
    assert (process.returncode, err) == (130, "emsid: ended within a step that cannot be interrupted\n")


def test_a_terminated_program_ends_soon_but_not_while_it_writes(monkeypatch):
    left = []
    monkeypatch.setattr("emsid.cli.interruption.CLEANING", 0.01)
    monkeypatch.setattr("emsid.cli.interruption.os._exit", left.append)
    interruption = Interruption()
    interruption.own_process = True
    with interruption.put_off():
        with pytest.raises(SystemExit, match="143"):
            interruption.terminate()
        assert interruption.pressed  # threads of a search end as well
        time.sleep(0.05)
        assert left == []
    end = time.monotonic() + 5
    while not left and time.monotonic() < end:
        time.sleep(0.01)
    assert left == [143]


EMSID = [sys.executable, "-c", "from emsid.cli import main; main()"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("identif",), "no such command 'identif'. Did you mean 'identify'?; see emsid --help"),
        (("identify",), "missing argument 'FILE...'; give a file, or columns of files"),
        (("identify", "a.csv", "--na", "x"), "invalid value for '--na': "),
        (("study", "--bogus"), "no such option: --bogus"),
        (("study", "--step", "nan"), "sample time of nan s; give a finite number"),
    ],
)
def test_a_slip_of_the_keyboard_is_one_line(words, said, run):
    status, out, err = run(*words)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"emsid: {said}")


def test_without_a_word_six_lines_say_what_to_do_first(run):
    status, out, err = run()
    assert (status, err, out.count("\n")) == (0, "", 6)
    for line in out.splitlines()[1:]:
        assert run(line.split()[1], "--help")[0] == 0


def test_the_version_is_printed(run):
    assert run("--version") == (0, f"emsid {emsid.__version__}\n", "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full")
def test_an_output_that_cannot_be_written_is_one_line():
    with open("/dev/full", "w") as full:
        done = subprocess.run([*EMSID, "list"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "emsid: the output cannot be written (no space left on device)\n"


def test_a_terminal_with_few_characters_gets_what_one_types():
    done = subprocess.run([*EMSID, "list"], capture_output=True, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"ohms, kg*m^2 and N*m with intervals" in done.stdout


def test_units_are_shown_as_they_are_printed_and_without_the_signs_for_it_as_they_are_typed(
    motor_log, tmp_path, command, monkeypatch, bare
):
    known = ("--fix", "resistance=2", "--free", "motor_constant,rotor_inertia,rotor_friction.coulomb")
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", *known, "--out", "out")
    units = {"resistance": ("ohm", "Ω"), "rotor_inertia": ("kg*m^2", "kg·m²"), "rotor_friction.coulomb": ("N*m", "N·m")}
    for k, coding in enumerate(("ascii", "utf-8")):
        printed = io.TextIOWrapper(io.BytesIO(), encoding=coding)
        with monkeypatch.context() as patch:
            patch.chdir(tmp_path)
            patch.setattr(sys, "stdout", printed)
            assert command(*words) == 0
        printed.flush()
        lines = printed.buffer.getvalue().decode(coding).splitlines()
        rows = {name: next(line for line in lines if line.startswith(f"{name} ")) for name in units}
        places = {row.index(f" {units[name][k]} ") for name, row in rows.items()}
        assert len(places) == 1  # the columns stand


def test_parameters_are_printed_as_files_that_can_be_edited_and_read_back(run, tmp_path):
    from emsid.io import read_datasheet, read_motor

    path = tmp_path / "printed.toml"
    status, motor, err = run("parameters")
    assert (status, err) == (0, "")
    path.write_text(motor)
    assert asdict(read_motor(path)) == asdict(emsid.Motor())
    status, axis, err = run("parameters", "linear-axis")
    assert (status, err) == (0, "")
    path.write_text(axis.replace('# mass = "unknown"', 'mass = "2 t"'))
    assert {name: given.value for name, given in read_datasheet(path).items()} == {"mass": pytest.approx(2000.0)}
    assert run("parameters", "rigid-motor") == run("parameters", "motor")
    status, out, err = run("parameters", "car")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert all(name in err for name in ("car", "motor", "linear-axis"))


def test_codes_for_the_bridge_are_options(run, tmp_path, bare):
    rng = np.random.default_rng(6)
    command = np.repeat(rng.uniform(-10, 10, 60), 20)
    command[np.repeat(rng.uniform(size=60) < 0.2, 20)] = 1000.0
    command[np.repeat(rng.uniform(size=60) < 0.2, 20)] = 999.0
    codes = ((1000.0, Bridge.BRAKE), (999.0, Bridge.COAST))
    plant = emsid.DrivenMotor(emsid.Motor(inductance=0.0, voltage_dead_zone=None).rigid(), Drive(codes=codes))
    speed = plant.simulate(command[:, None], 0.01, np.zeros(2), (Signal.SPEED,))[:, 0]
    path = table(tmp_path / "log.csv", len(command), u=command, y=speed + rng.normal(0, 0.1, len(command)))
    words = ("identify", path, *IDENTIFY, "--models", "rigid-motor,arx", "--unit", "y=rad/s", "--out", tmp_path / "out")
    status, out, err = run(*words, "--brake", "1000", "--coast", "999", "--fix", "resistance=2")
    assert (status, err) == (0, "")
    assert "rigid-motor: u has no unit and is read as volts" in out
    found = json.loads((tmp_path / "out" / "result.json").read_text())["findings"]
    assert [each["data"]["model"] for each in found if each["code"] == "codes-taken-as-commands"] == ["arx"]
    rows = {line.split()[0]: line.split() for line in out.splitlines() if line}
    assert (rows["resistance"][2], rows["resistance"][-1]) == ("2", "fixed")
    assert rows["rotor_inertia"][-2:] == ["given", "resistance"]
    assert "rigid-motor: resistance =" not in out
    found = emsid.load(tmp_path / "out" / "rigid-motor.json").plant
    assert found.drive.codes == codes
    assert found.motor.motor_constant == pytest.approx(0.05, rel=0.02)


def test_a_model_run_on_other_channels_is_reported(result, run):
    rows = ("--rows", "210:300")  # without those that it was fitted to
    words = ("validate", result / "arx.json", result.parent / "log.csv", *rows, "--dt", "0.01", "--input")
    (same,) = json.loads(run(*words, "u", "--output", "y", "--json")[1])["records"]
    assert same["findings"] == []
    status, out, _ = run(*words, "y", "--output", "u", "--json")
    assert status == 0
    (other,) = json.loads(out)["records"]
    assert [(each["code"], each["data"].get("what")) for each in other["findings"]] == [
        ("channels-differ", "inputs"),
        ("channels-differ", "outputs"),
        ("worse-than-mean", None),
    ]
    named = [
        [channel["name"] for channel in other["findings"][0]["data"][side]] for side in ("identified_with", "channels")
    ]
    assert named == [["u"], ["y"]]
    assert "the model was identified with the inputs u; log.csv has y.\n" in run(*words, "y", "--output", "u")[1]


def test_named_physical_parameters_are_estimated_and_no_others(run, log, tmp_path, bare):
    path, out = tmp_path / "axis.csv", tmp_path / "out"
    rng = np.random.default_rng(4)
    force = np.repeat(rng.uniform(-60, 60, 40), 50)
    axis = emsid.LinearAxis().with_values(
        {"mass": 20.0, "viscous_friction": 30.0, "friction.coulomb": 8.0, "offset": 2.0}
    )
    position = axis.simulate(force[:, None], 0.01, np.zeros(2), (Signal.POSITION,))[:, 0]
    table(path, len(force), u=force, y=position + rng.normal(0, 1e-5, len(force)))
    words = ("identify", path, *IDENTIFY, "--models", "linear-axis", "--unit", "y=m", "--out", out)
    free = ("--free", "mass,viscous_friction,friction.coulomb", "--fix", "offset=2")
    for recent in ((), ("--recent", "0.05")):
        status, _, err = run(*words, *free, *recent)
        assert (status, err) == (0, "")
        found = emsid.load(out / "linear-axis.json").plant
        assert found.value("mass") == pytest.approx(20, rel=1e-2)
        assert found.value("friction.coulomb") == pytest.approx(8, rel=2e-2)
        assert (found.value("offset"), found.value("friction.stribeck")) == (2, 0)
    assert "a positive time" in run(*words, *free, "--recent", "-1")[2]
    assert "has no parameter 'masse'" in run(*words, "--free", "masse")[2]
    assert "both free and fixed" in run(*words, "--free", "mass", "--fix", "mass=3")[2]
    words = ("identify", path, *IDENTIFY, "--models", "arx", "--out", out)
    assert "mass cannot be free, because arx has no physical parameters" in run(*words, "--free", "mass")[2]


def test_options_that_no_model_uses_are_named(run, log, tmp_path):
    words = ("identify", log, *IDENTIFY, "--models", "arx", "--degree", "3", "--static", "dead-zone", "--nk", "1")
    status, out, _ = run(*words, "--out", tmp_path / "out")
    assert status == 0
    assert "degree was given and is not used by arx." in out
    assert "static was given and is not used by arx." in out
    assert "nk was given" not in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("study", "-u", "zzz", "--unit", "y=rpm"), "--input, --unit: only for --record and --validate"),
        (("identify", "LOG", *IDENTIFY, "--ridge", "1", "--forgetting", "0.9"), "choose one of them"),
        (("identify", "LOG", *IDENTIFY, "--fix", "resistance"), "write it as NAME=VALUE"),
    ],
)
def test_options_that_contradict_each_other_are_refused(words, said, run, log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(*(log if word == "LOG" else word for word in words))
    assert (status, err.count("\n")) == (2, 1)
    assert said in err


def test_a_constant_unseen_output_has_no_fit(run, log, tmp_path):
    still = table(tmp_path / "still.csv", y=np.full(600, 3.0))
    words = ("identify", log, *IDENTIFY, "--validate", still, "--models", "arx", "--out", tmp_path / "out")
    words += FIRST_ORDER
    status, out, _ = run(*words)
    assert status == 0
    assert "arx: on unseen data, the free run has no fit, as the measured output is constant; its RMSE is" in out
    assert "inf" not in out
    assert "nan" not in out
    page = (tmp_path / "out" / "report.html").read_text()
    assert "none (constant output)" in page
    assert not any(f"{wrong}</" in page for wrong in ("inf", "nan", "inf %", "nan %"))


def test_every_unseen_record_is_named(run, log, tmp_path):
    others = [table(tmp_path / f"{name}.csv", seed=k) for k, name in enumerate("abcdef", 1)]
    unseen = [word for other in others[:2] for word in ("--validate", other)]
    words = ("identify", log, *IDENTIFY, "--models", "arx", *FIRST_ORDER, "--out", tmp_path / "out")
    assert "on unseen data (a.csv, b.csv)" in run(*words, *unseen)[1]
    assert "a.csv, b.csv" in (tmp_path / "out" / "report.html").read_text()
    unseen = [word for other in others for word in ("--validate", other)]
    assert "on unseen data (6 records)" in run(*words, *unseen)[1]


def test_files_of_an_earlier_run_are_listed_separately(run, log, tmp_path, monkeypatch):
    from emsid.report.page import write_report  # noqa: F401  (loads the module)

    out = tmp_path / "out"
    words = ("identify", log, *IDENTIFY, "--out", out, *FIRST_ORDER, "--models")
    assert "earlier run" not in run(*words, "arx,friction-narx")[1]
    assert run(*words, "arx")[1].endswith("from an earlier run, not from this one: friction-narx.json\n")
    page = sys.modules["emsid.report.page"]
    monkeypatch.setattr(page, "page", lambda *_: os.kill(os.getpid(), signal.SIGINT))
    status, printed, _ = run(*words, "arx")
    assert status == 130
    assert printed.endswith("from an earlier run, not from this one: report.html, friction-narx.json\n")


def test_values_may_have_a_unit(run, log, tmp_path):
    plain = run("describe", log, "--input", "u", "--output", "y", "--dt", "0.01")
    for text in ("10ms", "10 ms", "1e4us", "0.01 s"):
        assert run("describe", log, "--input", "u", "--output", "y", "--dt", text) == plain
    status, out, err = run("describe", log, "--input", "u", "--output", "y", "--dt", "10 volts")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "invalid value for '--dt'" in err


def test_validate_remembers_how_the_record_was_read(run, tmp_path):
    path = table(tmp_path / "log.csv")
    words = ("identify", path, "-u", "u", "-y", "y", "--dt", "10ms", "--mask", "u > 1.9", "--models", "arx")
    assert run(*words, "--out", tmp_path / "out")[0] == 0
    status, out, err = run("validate", tmp_path / "out" / "arx.json", path, "--json")
    assert (status, err) == (0, "")
    (row,) = json.loads(out)["records"]
    assert (row["model"], [finding["code"] for finding in row["findings"]]) == ("arx", ["data-not-unseen"])
    status, out, _ = run("validate", tmp_path / "out" / "arx.json", path, "--mask", "", "--json")
    (whole,) = json.loads(out)["records"]
    assert whole["samples"] > row["samples"]
    status, out, err = run("validate", tmp_path / "out" / "arx.json", path, "--out", tmp_path / "check")
    assert (status, err) == (0, "")
    assert {"report.html", "validation.json"} <= {each.name for each in (tmp_path / "check").iterdir()}


def test_what_a_file_is_called_is_never_obeyed_by_the_terminal(run, tmp_path):
    from emsid.cli.terminal import harmless

    path = table(tmp_path / "log.csv", **{"[/red]": np.ones(600), "\u202eu": np.ones(600)})
    status, _, err = run("describe", path, "-u", "volts", "-y", "y", "--dt", "1")
    assert status == 2
    assert "[/red]" in err
    assert harmless(err) == err
    words = ("identify", path, "-u", "u", "-y", "y", "--dt", "1", "--models", "arx", "--out", tmp_path / "out")
    assert run(*words)[0] == 0
    from dataclasses import replace

    from emsid.io import load, save

    model = load(tmp_path / "out" / "arx.json")
    save(replace(model, structure=replace(model.structure, name="[/red]")), tmp_path / "red.json")
    status, out, _ = run("validate", tmp_path / "red.json", path, "-u", "u", "-y", "y", "--dt", "1")
    assert status == 0
    assert "[/red]" in out


def test_a_simulated_log_says_its_units(run, tmp_path):
    assert run("simulate", "--duration", "2", "--out", tmp_path / "log.csv")[0] == 0
    record = emsid.read(tmp_path / "log.csv", input="voltage", output="speed", time="t")
    assert (record.input_units, record.output_units) == (("V",), ("rad/s",))


def test_json_is_alone_on_standard_output(run, log):
    names = json.loads(run("list", "--json")[1])
    assert set(names["models"]) == set(CANDIDATES)
    (record,) = json.loads(run("describe", log, *IDENTIFY, "--json")[1])["records"]
    assert (record["samples"], record["dt"], [each["name"] for each in record["channels"]]) == (600, 0.01, ["u", "y"])
    table = json.loads(run("parameters", "linear-axis", "--json")[1])
    assert table["plant"] == "linear-axis"
    assert [each["unit"] for each in table["parameters"] if each["name"] == "mass"] == ["kg"]
    assert json.loads(run("parameters", "--json")[1])["parameters"][0]["name"] == "resistance"


def test_a_saved_model_is_simulated_on_the_inputs_of_a_file(result, run, tmp_path):
    inputs, out = table(tmp_path / "inputs.csv", seed=3), tmp_path / "simulated.csv"
    words = ("simulate", result / "arx.json", inputs, "--out", out, "--json")
    status, printed, _ = run(*words)
    assert status == 0
    assert json.loads(printed)["columns"] == ["t", "u", "y"]
    simulated = emsid.read(out, input="u", output="y", time="t")
    voltage = emsid.read(inputs, input="u", output=(), dt=0.01).input
    expected = emsid.simulate(emsid.load(result / "arx.json"), voltage)
    np.testing.assert_array_equal(simulated.input, voltage)
    np.testing.assert_array_equal(simulated.output, expected.output)
    assert "name the file with the inputs" in run("simulate", result / "arx.json", "--out", out)[2]
    assert "identified at 0.01 s" in run(*words[:3], "--out", out, "--dt", "20ms")[2]
    emsid.save(emsid.load(result / "arx.json"), tmp_path / "bare.json")
    assert "does not say how its record was read" in run("simulate", tmp_path / "bare.json", inputs, "--out", out)[2]


def test_a_saved_model_is_simulated_on_columns_of_other_names(result, run, tmp_path):
    out, times = tmp_path / "simulated.csv", 0.01 * np.arange(600)
    inputs = table(tmp_path / "inputs.csv", seed=3, seconds=times)
    other = tmp_path / "other.csv"
    other.write_text(inputs.read_text().replace("u,y,seconds", "volts,y,seconds"))
    assert "no column 'u'" in run("simulate", result / "arx.json", other, "--out", out)[2]
    words = ("simulate", result / "arx.json", other, "--input", "volts", "--time", "seconds", "--out", out)
    assert run(*words)[0] == 0
    voltage = emsid.read(inputs, input="u", output=(), dt=0.01).input
    simulated = emsid.read(out, input="volts", output="y", time="t")
    np.testing.assert_array_equal(simulated.output, emsid.simulate(emsid.load(result / "arx.json"), voltage).output)
    status, _, err = run("simulate", "--time", "t", "--out", out)
    assert (status, "--time: only for the file with the inputs" in err) == (2, True)


def test_orders_prints_the_grid_of_the_library(run, tmp_path):
    path = table(tmp_path / "log.csv")
    words = ("orders", path, "-u", "u", "-y", "y", "--dt", "10ms", "--na", "1-2", "--nb", "1,2", "--nk", "1")
    status, out, err = run(*words, "--json")
    assert (status, err) == (0, "")
    found = json.loads(out)
    record = emsid.read(path, input="u", output="y", dt=0.01)
    known = emsid.regression.order_grid(record, na=(1, 2), nb=(1, 2), nk=(1,))
    assert [(row["na"], row["nb"], row["constant"]) for row in found["rows"]] == [
        (row.na, row.nb, row.constant) for row in known.rows
    ]
    assert [row["bic"] for row in found["rows"]] == pytest.approx([row.bic for row in known.rows])
    assert set(found["best"]) == {"simplest", "free_run", "bic", "aic", "fpe"}
    assert found["best"]["simplest"]["parameters"] == known.simplest.parameters
    assert run(*words)[1].startswith("8 structures of ARX")
    for text in ("2-1", "x", "1-", ""):
        status, _, err = run(*words, "--na", text)
        assert status != 0
        assert "write whole numbers" in err
