"""`emsid identify` on the command line: what it prints and writes, for the models and options that were asked for."""

import json
import os
import signal
import sys

import numpy as np
import pytest

import emsid
from command_line import FIRST_ORDER, IDENTIFY, MOTOR, table
from emsid.cli.options import option
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Stopped
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES
from emsid.models.plants.drive import Bridge, Drive
from emsid.models.plants.parameters import Signal
from emsid.wording import sentence

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")


def test_identify_with_validation_file_and_chosen_models(run, log, tmp_path):
    other = table(tmp_path / "other.csv", seed=1)
    words = ("identify", log, *IDENTIFY, "--validate", other, "--models", "arx", "--na", "1", "--nb", "1", "--nk", "1")
    status, out, _ = run(*words, "--details", "--out", tmp_path / "out")
    assert status == 0
    assert "y(t) = 0.9*y(t-1) + 0.3*u(t-1) + e(t)" in out
    assert not (tmp_path / "out" / "friction-narx.json").exists()


SHEETS = {"motor": "[motor]\nresistance = '2 ohm'\n", "axis": "[linear-axis]\nmass = '1 kg'\n"}


def test_a_profile_is_printed_drawn_and_written(run, motor_log, tmp_path, no_refinements):
    wanted = "motor_constant,drive.delay"
    words = ("identify", motor_log, *MOTOR, "--models", "rigid-motor", "--fix", "resistance=2", "--profile", wanted)
    status, out, _ = run(*words, "--details", "--out", tmp_path / "out")
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


def test_a_datasheet_of_another_plant_is_reported_as_unused(run, motor_log, tmp_path, no_refinements):
    sheet = tmp_path / "sheet.toml"
    sheet.write_text(SHEETS["motor"])
    words = ("identify", motor_log, *MOTOR, "--models", "arx,linear-axis,rigid-motor", "--datasheet", sheet)
    status, out, _ = run(*words, "--details", "--out", tmp_path / "out")
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


def test_the_first_screen_answers_five_questions_in_order_in_25_lines(run, motor_log, tmp_path, no_refinements):
    known = ("--fix", "resistance=2", "--models", "arx,polynomial-narx,friction-narx,output-error,rigid-motor")
    status, printed, _ = run("identify", motor_log, *MOTOR, *known, "--out", tmp_path / "out")
    lines = printed.splitlines()
    assert status == 0
    assert len(lines) <= 25
    starts = (
        "Not recommended: rigid-motor, ",
        "rigid-motor: on unseen data, the free run has a fit of ",
        "on unseen data (",
        "known, with 95 % intervals",
        "not known",
        "Next experiment: ",
        "--details prints ",
        "written to ",
    )
    places = [[line.startswith(start) for line in lines].index(True) for start in starts]
    assert places == sorted(places)
    assert places[:2] == [0, 1]
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    (fit,) = [each for each in result["fits"] if each["model"] == "rigid-motor"]
    values = {row["name"]: row for row in fit["parameters"]}
    rows = {line.split()[0]: line.split() for line in lines[places[3] + 1 : places[4]] if line}
    for name in ("motor_constant", "rotor_inertia"):
        assert float(rows[name][1]) == pytest.approx(values[name]["value"], rel=1e-3)
        assert float(rows[name][2]) == pytest.approx(1.96 * values[name]["standard_error"], rel=0.05)
        assert ("given" in rows[name]) == bool(values[name]["given"])


def test_the_details_lose_no_finding_about_the_recommended_model(run, motor_log, tmp_path):
    out = tmp_path / "out"
    words = ("identify", motor_log, *MOTOR, "--models", "arx,polynomial-narx", "--details", "--out", out)
    status, printed, _ = run(*words)
    first, second, *rest = printed.splitlines()
    assert status == 0
    best = first.removeprefix("Recommended: ").partition(",")[0]
    assert second.startswith(f"{best}: on unseen data, the free run has a fit of ")
    assert len([line for line in rest if "recommended; " in line and line.split()[0] == best]) == 2
    (other,) = {"arx", "polynomial-narx"} - {best}
    assert not any(line.startswith(f"- {other}: ") for line in rest)  # findings about it are in the report
    assert other in printed
    found = [Finding(**each) for each in json.loads((out / "result.json").read_text())["findings"]]
    for finding in found:
        if finding.model in (None, "", best):
            assert sentence(finding, option) in printed


def test_where_no_model_can_be_used_none_is_called_recommended(run, tmp_path):
    rng = np.random.default_rng(8)
    noise = table(tmp_path / "noise.csv", 400, u=rng.standard_normal(400), y=rng.standard_normal(400).cumsum())
    out = tmp_path / "out"
    status, printed, _ = run("identify", noise, *IDENTIFY, "--models", "arx", "--out", out)
    page = (out / "report.html").read_text()
    assert status == 0
    assert printed.startswith("No model describes these data: ")
    assert "recommended; " not in printed
    assert '<p class="lead">No model describes these data: ' in page
    assert "arx is recommended" not in page
    assert not (out / "best.json").exists()
    assert (out / "arx.json").exists()


def test_a_candidate_that_cannot_be_fitted_is_named_and_the_others_go_on(run, tmp_path):
    two_inputs = table(tmp_path / "two.csv", v=np.random.default_rng(3).standard_normal(600))
    words = ("identify", two_inputs, *IDENTIFY, "--input", "v", "--models", "arx,friction-narx", "--rows", "0:40")
    status, out, _ = run(*words, "--out", tmp_path / "out")
    assert status == 0
    assert "friction-narx: could not be fitted" in out


def test_a_candidate_that_the_numbers_defeat_is_left_out(run, log, tmp_path, monkeypatch):
    def defeated(*_):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setitem(CANDIDATES, "friction-narx", defeated)
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--models", "arx,friction-narx", "--out", tmp_path / "out")
    status, printed, _ = run("identify", log, *words)
    assert status == 0
    first = printed.splitlines()[printed.splitlines().index("not known") + 1]
    assert first.startswith("- friction-narx: could not be fitted: the numbers are out of range (SVD did not converge)")


def test_errors_on_identification_data_are_reported_as_such(run, log, tmp_path):
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--models", "arx, arx", *FIRST_ORDER, "--out", tmp_path / "out")
    status, printed, _ = run("identify", log, "--validate", log, *words)
    assert status == 0
    assert "contains data of the fit, so errors on it say nothing about unseen data" in printed
    assert "say nothing about unseen data" not in run("identify", log, *words)[1]


def test_names_may_be_given_together_or_one_by_one(run, log, tmp_path, monkeypatch):
    asked = []

    def kept(*_, models=None, **__):
        asked.append(models)
        raise emsid.ModelError("enough")

    monkeypatch.setattr("emsid.identification.workflow.identify", kept)
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--out", tmp_path / "out")
    for models in (("arx,output-error,arx",), ("arx", "output-error"), ()):
        run("identify", log, *words, *(word for name in models for word in ("--models", name)))
    assert asked == [("arx", "output-error"), ("arx", "output-error"), None]


def test_data_of_the_fit_are_named_before_a_search(run, log, tmp_path, monkeypatch):
    def searched(*_, **__):
        raise emsid.ModelError("enough")

    monkeypatch.setattr("emsid.identification.workflow.identify", searched)
    words = ("-u", "u", "-y", "y", "--dt", 0.01, "--out", tmp_path / "out")
    other = table(tmp_path / "other.csv", seed=9)
    for unseen, count in ((log, 1), (other, 0)):
        assert run("identify", log, *words, "--validate", unseen)[2].count("contains data of the fit") == count


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


def test_a_budget_that_ends_before_a_model_is_found_is_said(run, log, tmp_path, monkeypatch):
    def searched(*_, **__):
        raise Stopped(Ending.OUT_OF_BUDGET)

    monkeypatch.setattr("emsid.identification.workflow.identify", searched)
    status, _, err = run("identify", log, *IDENTIFY, "--budget", "1s", "--out", tmp_path)
    assert (status, err.count("\n")) == (2, 1)
    assert err.startswith("emsid: the time was up before a model was found")
    assert "--budget" in err


def test_codes_for_the_bridge_are_options(run, tmp_path, no_refinements):
    rng = np.random.default_rng(6)
    command = np.repeat(rng.uniform(-10, 10, 60), 10)
    command[np.repeat(rng.uniform(size=60) < 0.2, 10)] = 1000.0
    command[np.repeat(rng.uniform(size=60) < 0.2, 10)] = 999.0
    codes = ((1000.0, Bridge.BRAKE), (999.0, Bridge.COAST))
    plant = emsid.MotorPlant(emsid.Motor(inductance=0.0, voltage_dead_zone=None).rigid(), Drive(codes=codes))
    speed = plant.simulate(command[:, None], 0.01, np.zeros(2), (Signal.SPEED,))[:, 0]
    path = table(tmp_path / "log.csv", len(command), u=command, y=speed + rng.normal(0, 0.1, len(command)))
    words = ("identify", path, *IDENTIFY, "--models", "rigid-motor,arx", "--unit", "y=rad/s", "--out", tmp_path / "out")
    status, out, err = run(*words, "--brake", "1000", "--coast", "999", "--fix", "resistance=2", "--details")
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


def test_named_physical_parameters_are_estimated_and_no_others(run, log, tmp_path, no_refinements):
    path, out = tmp_path / "axis.csv", tmp_path / "out"
    rng = np.random.default_rng(4)
    force = np.repeat(rng.uniform(-60, 60, 20), 25)
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
    out = tmp_path / "out"
    words = ("identify", log, *IDENTIFY, "--out", out, *FIRST_ORDER, "--models")
    assert "earlier run" not in run(*words, "arx,friction-narx")[1]
    figures = set((out / "figures").iterdir())
    for path in figures:
        os.utime(path, (0, 0))
    printed = run(*words, "arx")[1]
    old = {path.stem for path in figures if path.stat().st_mtime == 0}
    assert old == {"friction-narx-friction", "friction-narx-static-map", "front"}
    left = len(old)
    assert printed.endswith(f"from an earlier run, not from this one: friction-narx.json, {left} in figures/\n")
    monkeypatch.setattr("emsid.report.page.page", lambda *_: os.kill(os.getpid(), signal.SIGINT))
    status, printed, _ = run(*words, "arx")
    assert status == 130
    said = f"report.html, friction-narx.json, {len(figures)} in figures/\n"
    assert printed.endswith(f"from an earlier run, not from this one: {said}")
