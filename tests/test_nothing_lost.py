"""Whatever one model, check, refit, figure or section of the page raises costs that part only."""

import json
from importlib import import_module

import numpy as np
import pytest

import emsid
from command_line import FIRST_ORDER, IDENTIFY, Page, table
from emsid.estimation.borders import LOG, InternalError, border, collected
from emsid.estimation.nonlinear.control import Stopped
from emsid.identification.candidates import CANDIDATES
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import fit_cascade
from emsid.models.blocks.static_maps import DeadZone, Saturation
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.model import FeedbackModel

pytestmark = pytest.mark.usefixtures("ctrl_c_heard", "figures_undrawn")

DEFECT = "an error inside the program (RuntimeError: of the test)"


def fails(*_, **__):
    raise RuntimeError("of the test")


def patch(monkeypatch, part: str, work: object = fails) -> None:
    where, _, name = part.rpartition(".")
    module, _, kind = where.rpartition(".")
    inside = getattr(import_module(module), kind) if kind.lstrip("_")[0].isupper() else import_module(where)
    monkeypatch.setattr(inside, name, work)


@pytest.fixture
def model_that_fails(monkeypatch) -> str:
    """The name of a model whose search has a defect."""
    monkeypatch.setitem(CANDIDATES, "friction-narx", fails)
    return "friction-narx"


@pytest.fixture(autouse=True)
def quiet_log():
    """The log as it was before, also after ``--debug``."""
    handlers, level = LOG.handlers[:], LOG.level
    yield
    LOG.handlers[:], LOG.level = handlers, level


def test_a_defect_of_one_model_leaves_the_others(run, tmp_path, model_that_fails) -> None:
    log = table(tmp_path / "log.csv", samples=300)
    words = "identify", log, *IDENTIFY, *FIRST_ORDER, "--models", f"arx,{model_that_fails}", "--details", "--out"
    status, out, err = run(*words, tmp_path / "out")
    assert status == 0
    assert f"{model_that_fails}: could not be fitted: {DEFECT}; everything else is complete" in out
    assert "--debug" in out
    assert "Traceback" not in out + err
    written = json.loads((tmp_path / "out" / "result.json").read_text())
    (failed,) = [each for each in written["findings"] if each["code"] == "model-failed"]
    assert failed["subject"] == model_that_fails
    assert DEFECT in (tmp_path / "out" / "report.html").read_text()
    status, _, err = run(*words, tmp_path / "out", "--debug")
    assert status == 0
    assert "Traceback" in err
    assert 'raise RuntimeError("of the test")' in err


def test_without_any_model_one_line_says_why(run, tmp_path, model_that_fails) -> None:
    log = table(tmp_path / "log.csv", samples=300)
    status, out, err = run("identify", log, *IDENTIFY, "--models", model_that_fails, "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert err == f"emsid: {model_that_fails}: {DEFECT} (--debug)\n"


PARTS = {
    "refit to all data": "emsid.identification.workflow.from_all_data",
    "refit for the ranking": "emsid.models.refitting.refitted",
    "runs with other inputs": "emsid.identification.evidence.Probes.difference",
    "errors by record": "emsid.identification.workflow.by_record",
    "plausibility": "emsid.identification.evidence.Plausibility.findings",
    "region": "emsid.identification.evidence.worst_region",
    "nonlinear terms": "emsid.identification.evidence.about_nonlinear_terms",
    "length trusted": "emsid.identification.workflow.length_trusted",
    "characteristics": "emsid.identification.result.characteristics",
    "curves": "emsid.identification.result.step_response_band",
    "residual test": "emsid.identification.result.verdicts",
    "next steps": "emsid.identification.result.next_steps",
    "next experiment": "emsid.identification.result.experiment",
    "band of the free run": "emsid.validation.bands.free_run_band",
    "section of a model": "emsid.report.views.model_section",
    "section of figures": "emsid.report.identification_page.in_detail",
    "values": "emsid.report.identification_page.values",
    "first figure": "emsid.report.identification_page._opening",
    "responses of the models": "emsid.report.identification_page.responses",
    "figure on the page": "emsid.report.page.page_figure",
    "figure as a file": "emsid.report.figures.draw",
    "page": "emsid.report.identification_page.report",
    "template of the page": "emsid.report.page.templates",
    "first screen": "emsid.cli.first_screen.first_screen",
    "result": "emsid.cli.writing.as_json",
}


@pytest.mark.parametrize("part", PARTS)
def test_a_defect_of_one_part_leaves_everything_else(run, tmp_path, monkeypatch, part) -> None:
    patch(monkeypatch, PARTS[part])
    log = table(tmp_path / "log.csv", samples=300)
    words = "--models", "arx,output-error", *FIRST_ORDER, "--details"
    status, out, err = run("identify", log, *IDENTIFY, *words, "--out", tmp_path / "out")
    assert status == (2 if part in ("first screen", "result") else 0), err
    written: dict = {"findings": []}
    if part != "result":
        written = json.loads((tmp_path / "out" / "result.json").read_text())
        assert {row["model"] for row in written["rows"]} == {"arx", "output-error"}
    for name in ("arx.json", "output-error.json", "best.json"):
        assert emsid.load(tmp_path / "out" / name).parameters is not None
    page = (tmp_path / "out" / "report.html").read_text()
    Page(page)
    said = [each for each in written["findings"] if each["code"] == "part-failed"]
    assert said or DEFECT in page or DEFECT in err
    assert all(each["data"]["reason"] == DEFECT and each["data"]["internal"] for each in said)
    assert "Traceback" not in out + err


@pytest.mark.parametrize("raised", [KeyboardInterrupt, MemoryError, Stopped(emsid.estimation.fit.Ending.INTERRUPTED)])
def test_what_ends_a_run_on_purpose_passes_the_border(raised) -> None:
    with pytest.raises(BaseException) as found, collected() as noted, border("part"):  # noqa: PT011
        raise raised
    assert found.type in (KeyboardInterrupt, MemoryError, Stopped)
    assert noted == []


def test_a_border_notes_a_failure_once_and_not_what_is_expected() -> None:
    with collected() as noted:
        for _ in range(2):
            with border("part", "arx"):
                raise ValueError("odd")
        with border("other part", expected=True):
            raise emsid.ModelError("these data do not suit it")
    (finding,) = noted
    assert (finding.code, finding.subject, finding.model) == ("part-failed", "part", "arx")
    reported: list[emsid.EmsidError] = []
    with border("part", report=reported.append):
        raise ValueError
    assert isinstance(reported[0], InternalError)
    assert str(reported[0]) == "part: an error inside the program (ValueError)"


class Overlapping(DeadZone):
    """A dead zone whose ends have crossed: around zero both slopes act."""

    def check(self) -> None:
        """Not refused."""


LOOP = np.array([[0.6, 0.0, 0.3], [0.2, 1.0, 0.0], [1.0, 0.0, 0.0]])
LAG = Rational([0.4], [-0.6])


@pytest.mark.parametrize("kind", ["feedback", "cascade"])
def test_ends_of_a_dead_zone_that_the_data_would_cross_meet(kind) -> None:
    """The error is smallest where the ends have crossed; the search goes on along their meeting, and ends there."""

    def model(zone):
        return FeedbackModel(LOOP, (zone,), dt=0.01) if kind == "feedback" else Cascade((zone, LAG), dt=0.01)

    rng = np.random.default_rng(3)
    u, count = np.repeat(rng.uniform(-2, 2, 60), 5), 300
    truth = model(Overlapping(0.3, -0.3, 1.0, 1.0))
    y = truth.output(u, np.zeros(truth.states)) + 0.002 * rng.standard_normal(count)
    record = emsid.Record(u, y, 0.01)
    fit = (fit_feedback if kind == "feedback" else fit_cascade)(model(DeadZone(-0.2, 0.2)), record)
    zone = fit.model.maps[0] if kind == "feedback" else fit.model.blocks[0]
    zone.check()
    assert 0 <= zone.b_r - zone.b_l < 0.02
    values = fit.model.parameter_values()
    assert fit.estimate == pytest.approx([values[name] for name in fit.names])


STUDY_PARTS = {
    "linear model": "emsid.study.workflow.recursive_least_squares",
    "friction on the load side": "emsid.study.workflow.load_friction_difference",
    "excitation": "emsid.study.workflow.excitation_of",
    "priors": "emsid.study.workflow.priors",
    "survey": "emsid.study.workflow.recorded",
    "example": "emsid.study.workflow.regressions",
    "richer input": "emsid.study.workflow.richer_input",
    "comparison with the paper": "emsid.study.summary._compared",
    "one-step errors": "emsid.study.summary._prediction",
    "ratios in the file": "emsid.study.summary.paper_ratios",
    "screen": "emsid.cli.commands.study._print",
    "first figure": "emsid.report.study_page.overview",
    "claims": "emsid.report.study_page.claims_table",
    "section of a study": "emsid.report.study_page.part_section",
    "section of the motor": "emsid.report.study_page.motor_section",
    "section of a model": "emsid.report.views.model_section",
    "template": "emsid.report.page.templates",
    "figure as a file": "emsid.report.figures.draw",
}


@pytest.mark.parametrize("part", STUDY_PARTS)
def test_a_defect_of_a_part_of_a_study_leaves_everything_else(run, tmp_path, monkeypatch, part) -> None:
    monkeypatch.setattr("emsid.study.workflow.searches", lambda *_, **__: {"rigid-motor": fails})
    patch(monkeypatch, STUDY_PARTS[part])
    status, out, err = run("study", "--duration", "2", "--out", tmp_path / "out")
    written = json.loads((tmp_path / "out" / "study.json").read_text())
    assert {row["model"] for row in written["rows"]} >= {"friction-narx", "arx"}
    page = (tmp_path / "out" / "report.html").read_text()
    Page(page)
    said = [each for each in written["findings"] if each["code"] == "part-failed"]
    failed = [each for each in written["findings"] if each["code"] == "study-model-failed"]
    assert "rigid-motor" in {each["subject"] for each in failed}
    assert said or DEFECT in page.replace("rigid-motor could not be fitted", "") or DEFECT in err
    assert (status == 2) is (part == "screen")
    assert "Traceback" not in out + err
    assert (tmp_path / "out" / "figures").exists() is (part != "figure as a file")


def test_debug_prints_the_traceback_of_a_study(run, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("emsid.study.workflow.searches", lambda *_, **__: {"rigid-motor": fails})
    status, out, err = run("study", "--duration", "2", "--debug", "--out", tmp_path / "out")
    assert status == 0
    assert "rigid-motor could not be fitted in simulation: an error inside the program" in out
    assert 'raise RuntimeError("of the test")' in err


@pytest.fixture(scope="module")
def saved(command, tmp_path_factory):
    """The file of a model, and two other records."""
    folder = tmp_path_factory.mktemp("saved")
    log = table(folder / "log.csv", samples=300)
    assert command("identify", log, *IDENTIFY, *FIRST_ORDER, "--models", "arx", "--out", folder / "model") == 0
    records = [table(folder / f"{seed}.csv", samples=300, seed=seed) for seed in (1, 2)]
    return folder / "model" / "arx.json", records


VALIDATION_PARTS = {
    "errors by region": "emsid.validation.comparison.errors_by_region",
    "worst region": "emsid.validation.comparison.worst_region",
    "late record": "emsid.validation.agreement.lateness",
    "table": "emsid.cli.commands.validate._print",
    "prediction": "emsid.cli.commands.validate._ahead",
    "figure": "emsid.report.views.measured_and_simulated",
    "figure of the inputs": "emsid.report.views.inputs",
    "page": "emsid.cli.commands.validate._report",
    "template": "emsid.report.page.templates",
    "write": "emsid.cli.commands.validate.write",
}


@pytest.mark.parametrize("part", VALIDATION_PARTS)
def test_a_defect_of_a_part_of_a_validation_leaves_everything_else(run, tmp_path, monkeypatch, saved, part) -> None:
    model, records = saved
    patch(monkeypatch, VALIDATION_PARTS[part])
    words = "validate", model, *records, "--horizon", 3, "--out", tmp_path / "out"
    status, out, err = run(*words)
    assert status == (2 if part == "write" else 0)
    assert "Traceback" not in out + err
    page = (tmp_path / "out" / "report.html").read_text()
    Page(page)
    if part != "write":
        written = json.loads((tmp_path / "out" / "validation.json").read_text())
        assert [row["record"] for row in written["records"]] == ["1.csv", "2.csv"]
        assert all(row["fit_percent"] > 99 for row in written["records"])
        assert ("horizon_mse" in out) is False
    assert DEFECT in out + err + page
    assert 'raise RuntimeError("of the test")' in run(*words, "--debug")[2]


def test_a_record_on_which_a_model_fails_leaves_the_others(run, tmp_path, monkeypatch, saved) -> None:
    from emsid.validation import comparison

    model, records = saved
    plain = comparison.assess_model
    failing = {"1.csv"}

    def assess(loaded, record, *rest, **more):
        return fails() if record.name in failing else plain(loaded, record, *rest, **more)

    monkeypatch.setattr(comparison, "assess_model", assess)
    status, out, _ = run("validate", model, *records, "--out", tmp_path / "out")
    assert status == 0
    written = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert [row["record"] for row in written["records"]] == ["2.csv"]
    assert [each["subject"] for each in written["findings"]] == ["validation on 1.csv"]
    assert f"validation on 1.csv failed: {DEFECT}" in out
    failing.add("2.csv")
    status, out, err = run("validate", model, *records)
    assert (status, out) == (2, "")
    assert err == f"emsid: validation on 1.csv: {DEFECT} (--debug)\n"


TRACKING_PARTS = {
    "physical values": "emsid.live.tracking.of_regression",
    "history": "emsid.live.session._Work.remember",
    "detection of changes": "emsid.live.tracking.ChangeDetector.update",
    "view": "emsid.cli.live_view.Lines.show",
    "estimates": "emsid.live.session._Work.periodic",
    "record": "emsid.io.write_record",
    "state": "emsid.io.state_file.save_state",
    "figure": "emsid.report.tracking_page.convergence",
    "counts": "emsid.report.tracking_page._counts",
    "parameters": "emsid.report.tracking_page._parameters",
    "page": "emsid.report.tracking_page.tracking_report",
}


@pytest.mark.parametrize("part", TRACKING_PARTS)
def test_a_defect_of_a_part_of_a_tracking_leaves_everything_else(run, tmp_path, monkeypatch, part) -> None:
    where, once = TRACKING_PARTS[part], []

    def later(*of, **more):  # a defect after samples have come
        once.append(1)
        return fails() if len(once) > 1 else iter(())

    patch(monkeypatch, where, later if part == "estimates" else fails)
    log = table(tmp_path / "log.csv", samples=900)
    words = "track", log, "--dt", "0.01", "--input", "u", "--output", "y", "--false-alarm", "10s"
    status, _, err = run(*words, "--out", tmp_path / "out", "--debug")
    assert status == (2 if part in ("record", "state", "estimates") else 0), err
    assert 'raise RuntimeError("of the test")' in err
    page = (tmp_path / "out" / "report.html").read_text()
    Page(page)
    written = json.loads((tmp_path / "out" / "track.json").read_text())
    said = [each for each in written["findings"] if each["code"] == "part-failed"]
    assert said or DEFECT in err + page
    assert (tmp_path / "out" / "record.csv").exists() is (part != "record")
    assert (tmp_path / "out" / "state.json").exists() is (part != "state")
    assert emsid.load(tmp_path / "out" / "arx.json").parameters["a1"].value == pytest.approx(-0.9, abs=1e-6)


@pytest.mark.parametrize("map", [DeadZone(-0.2, 0.3, 1.0, 2.0), Saturation(1.5, -1.0, 2.0)])
def test_every_pair_of_ends_meets_halfway(map) -> None:
    theta = map.parameters
    at = [map.letters.index(letter) for letter in map.ends]
    theta[at] = 0.7, 0.3
    met = map.with_parameters(theta)
    met.check()
    assert met.parameters[at].tolist() == [0.5, 0.5]
    assert np.isfinite(met.value(np.linspace(-3, 3, 101))).all()
