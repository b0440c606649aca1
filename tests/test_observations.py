"""Every finding of an identification: data that show it, and data that do not."""

import numpy as np
import pytest

import emsid
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.findings import Finding
from emsid.identification import task as tasks
from emsid.identification import verdict as verdicts
from emsid.identification.candidates import CANDIDATES, QUICK, refit_data
from emsid.identification.task import plants_of, unused_requests
from emsid.identification.verdict import Compared
from emsid.models.free_run import free_run_error
from emsid.models.model import Run
from emsid.models.plants.datasheet import Given
from emsid.models.plants.drive import Bridge
from emsid.models.refit_data import Budget
from emsid.models.refitting import refitted
from emsid.models.regression.capabilities import OfRegressions
from emsid.options import Options
from emsid.report.identification_page import report, summary
from emsid.validation.comparison import assess
from emsid.validation.correlation import NOTABLE, SIGNIFICANCE, ResidualTest, residual_tests

DT = 0.01


def driven(seed, samples=600, pole=0.9, noise=0.01, square=0.0):
    """y(t) = p·y(t−1) + u(t−1) + s·u(t−1)² and white equation noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, samples // 4), 4)
    y = np.zeros(samples)
    for t in range(1, samples):
        y[t] = pole * y[t - 1] + u[t - 1] + square * u[t - 1] ** 2 + noise * rng.standard_normal()
    return emsid.Record(u, y, DT)


@pytest.fixture(scope="module")
def plain():
    """An identification in which all is well."""
    options = Options(na=1, nb=1, nk=1)
    return emsid.identify(driven(0, 2000), driven(1, 2000), models="arx", options=options)


def codes(result):
    return [finding.code for finding in result.findings]


def test_a_good_model_has_a_white_residual(plain):
    assert codes(plain) == ["free-run-error", "one-step-error-smaller", "residual-white"]
    assert {finding.model for finding in plain.findings} == {"arx"}


def test_the_ratio_of_one_step_and_free_run_errors_is_found(plain):
    (found,) = [finding for finding in plain.findings if finding.code == "one-step-error-smaller"]
    row = plain.on_unseen.best.row
    assert found.data["ratio"] == row.simulation_mse / row.one_step_mse > 2
    # An output error, white and small, is the same one step ahead and in the free run.
    record = driven(3, 2000, noise=0.0)
    noisy = emsid.Record(record.input, record.output + 0.5 * np.random.default_rng(3).standard_normal((2000, 1)), DT)
    fit = emsid.least_squares(emsid.arx(0, 30), noisy)
    row = emsid.compare([fit], noisy).best.row
    assert row.simulation_mse == pytest.approx(row.one_step_mse)


def test_a_model_that_lacks_a_nonlinearity_leaves_coloured_errors():
    options = Options(na=1, nb=1, nk=1)
    result = emsid.identify(driven(0, 2000, square=1.0), driven(1, 2000, square=1.0), models="arx", options=options)
    found = {finding.code: finding for finding in result.findings}
    assert "residual-white" not in found
    assert found["residual-coloured"].data["largest"] > 0.1
    assert found["residual-coloured"].data["p_value"] < 1e-3


@pytest.mark.parametrize(
    ("p_value", "largest", "white"),
    [
        (2 * SIGNIFICANCE, 2 * NOTABLE, True),  # by chance
        (0.5 * SIGNIFICANCE, 0.5 * NOTABLE, True),  # significant in a long record, and too small to matter
        (0.5 * SIGNIFICANCE, 2 * NOTABLE, False),
    ],
)
def test_errors_are_coloured_where_that_is_significant_and_matters(p_value, largest, white):
    assert ResidualTest("speed", 25, p_value, largest, 1).white == white


def test_white_errors_are_rejected_as_seldom_as_they_should_be():
    """1 % nominal: of 200 tests, eight or more rejections would happen by chance once in 1 000 such tests."""
    rng = np.random.default_rng(5)
    record = driven(5, 400)
    rejected = 0
    for _ in range(200):
        run = Run(record.output - rng.standard_normal(record.output.shape), np.ones(len(record), dtype=bool))
        (test,) = residual_tests(record, run)
        rejected += test.p_value < 0.01
    assert rejected < 8


def test_errors_of_a_short_record_are_not_tested():
    record = driven(6, 80)
    run = Run(record.output * 0.5, np.ones(80, dtype=bool))
    assert residual_tests(record, run) == []


def test_data_that_the_models_were_fitted_to_are_not_unseen(plain):
    record = driven(0)
    result = emsid.identify(record, record, models="arx", options=Options(na=1, nb=1, nk=1))
    assert Finding("data-not-unseen", record.name) in result.findings
    assert result.seen
    assert "data-not-unseen" not in codes(plain)


def test_a_free_run_that_diverges_is_found(plain):
    unstable = driven(0, 200, pole=1.02, noise=0.0)
    result = emsid.identify(unstable, driven(1, 3000), models="arx", options=Options(na=1, nb=1, nk=1))
    (found,) = [finding for finding in result.findings if finding.code == "free-run-diverged"]
    assert found.data["sample"] == result.on_unseen.best.row.diverged_at
    assert "free-run-diverged" not in codes(plain)


def test_an_option_that_no_model_uses_is_found(plain):
    result = emsid.identify(driven(0), models="arx", options=Options(na=1, nb=1, nk=1, degree=3))
    assert Finding("option-not-used", "degree", {"models": ["arx"]}) in result.findings
    assert "option-not-used" not in codes(plain)


def test_requests_that_some_models_cannot_meet_are_found():
    record = driven(0)
    options = Options(codes=((999.0, Bridge.COAST),), datasheet={"mass": Given(80.0)})
    names = ("arx", "rigid-motor", "linear-axis")
    found = unused_requests(plants_of(names, options), names, options, record)
    assert [(finding.code, finding.subject) for finding in found] == [
        ("datasheet-not-used", "rigid-motor"),
        ("code-never-occurs", "u1"),
    ]
    assert unused_requests(plants_of(names, Options()), names, Options(), record) == []


def test_codes_are_named_once_and_only_those_that_occur():
    rest = driven(0)
    record = emsid.Record(np.where(np.arange(len(rest)) % 50 < 5, 999.0, rest.input[:, 0]), rest.output, rest.dt)
    options = Options(codes=((999.0, Bridge.COAST), (998.0, Bridge.BRAKE)))
    found = unused_requests({}, ["arx"], options, record)
    assert [(finding.code, finding.data.get("value", finding.data.get("values"))) for finding in found] == [
        ("code-never-occurs", 998.0),
        ("codes-taken-as-commands", [999.0]),
    ]


def test_a_model_that_fails_does_not_stop_the_others(plain):
    options = Options(na=1, nb=1, nk=1, orders=(1, 1))
    result = emsid.identify(driven(0), models="wiener, arx", options=options)
    (found,) = [finding for finding in result.findings if finding.code == "model-failed"]
    assert (found.subject, found.model, found.data["arguments"]) == ("wiener", "wiener", ["orders"])
    assert found.data["reason"].startswith("wiener has 1 filter")
    assert [fit.model.name for fit in result.fits] == ["arx"]
    with pytest.raises(emsid.ModelError, match="wiener has 1 filter"):
        emsid.identify(driven(0), models="wiener", options=options)
    assert "model-failed" not in codes(plain)


class Clock:
    """A clock that stands still unless a test moves it."""

    now = 0.0

    def monotonic(self):
        return self.now


class Endless:
    """A candidate whose search never ends by itself; every step of it takes a tenth of a second of the clock."""

    summary, uses = "endless", ()

    def __init__(self, clock):
        self.clock = clock

    def __call__(self, record, options, control):
        while True:
            self.clock.now += 0.1
            control.check()


def test_a_model_without_a_result_in_its_share_of_the_time_is_named(plain, monkeypatch):
    clock = Clock()
    monkeypatch.setattr("emsid.estimation.nonlinear.control.time", clock)
    monkeypatch.setitem(CANDIDATES, "endless", Endless(clock))
    options = Options(na=1, nb=1, nk=1)
    result = emsid.identify(driven(0), models="endless, arx", options=options, budget=10.0)
    assert 5.0 < clock.now < 5.2  # half of the time
    assert [fit.model.name for fit in result.fits] == ["arx"]
    assert Finding("models-out-of-time", data={"models": ["endless"]}) in result.findings
    assert not result.interrupted
    assert "models-out-of-time" not in codes(plain)
    shortest = emsid.identify(driven(0), models="endless, arx", options=options, budget=0.01)  # no time for either
    assert [fit.model.name for fit in shortest.fits] == ["arx"]
    assert [f.data["models"] for f in shortest.findings if f.code == "models-out-of-time"] == [["endless"]]
    with pytest.raises(Stopped):
        emsid.identify(driven(0), models="endless", budget=1.0)
    with pytest.raises(emsid.ModelError, match="positive time"):
        emsid.identify(driven(0), budget=0.0)


def test_every_experiment_has_a_piece_in_the_excerpt_of_several(monkeypatch):
    monkeypatch.setattr(tasks, "COMPARED", 300)
    u = np.random.default_rng(0).standard_normal(1_000)
    one = emsid.Record(u, u, 0.01)
    inside, outside = tasks.to_compare(emsid.concatenate([one] * 5), ("arx", "wiener"))
    assert [len(part) for part in inside.segments] == [100] * 5
    assert len(outside) == 4_500
    assert [len(part) for part in tasks.to_compare(one, ("arx", "wiener"))] == [300, 700]
    assert tasks.to_compare(one, ("arx",)) == (one, None)


def test_models_of_a_long_record_are_compared_on_an_excerpt_and_the_recommended_one_fitted_to_all(monkeypatch):
    monkeypatch.setattr(tasks, "COMPARED", 1_000)
    options, record = Options(na=1, nb=1, nk=1, knots=2), driven(0, 2000)
    one, several = (emsid.identify(record, models=names, options=options) for names in ("arx", "friction-narx,arx"))
    assert "fitted-to-excerpt" not in codes(one)
    (finding,) = (each for each in several.findings if each.code == "fitted-to-excerpt")
    first, second = several.fits
    assert finding.data == {"samples": 999, "of": 1_400, "finished": first.model.name}
    assert len(several.unseen) == len(one.unseen)
    assert [len(each.folds) for each in several.ranking] == [4, 4]
    assert first.samples > 1_390 > 999 > second.samples
    assert (first.estimate == emsid.least_squares(first.model.structure, record[:1_400]).estimate).all()
    assert "fitted to 1,400 samples after a comparison of fits to 999" in summary(several)
    assert "fitted to 1,400 samples," in summary(one)
    assert several.chosen is first
    np.testing.assert_array_equal(several.data_of(first).output, record[:1_400].output)
    np.testing.assert_array_equal(several.fitted_by_recommended.output, record.output)  # then to the unseen ones too
    assert several.data_of(second) is several.record
    assert all(any(first is each.fit for each in on) for on in (several.on_record.assessments, several.ranking))
    assert several.on_unseen.best.row.simulation_mse == assess(first, several.unseen, 1).row.simulation_mse


def test_only_fits_to_an_excerpt_that_are_continued_merely_compare(monkeypatch):
    asked = []

    class Asked:
        summary, uses = "an arx model", ()

        def __call__(self, record, options, control):
            asked.append((len(record), options.comparing))
            return emsid.fit(emsid.arx(1, 1), record)

    monkeypatch.setattr(tasks, "COMPARED", 1_000)
    monkeypatch.setitem(CANDIDATES, "arx", Asked())
    for models, how in (("friction-narx,arx", {}), ("friction-narx,arx", {"bootstrap": 2}), ("arx", {})):
        asked.clear()
        emsid.identify(driven(0, 2000), models=models, options=Options(knots=2), **how)
        assert asked[0] == ((999, not how) if "," in models else (1_400, False))
        assert (1_400, True) not in asked


@pytest.mark.parametrize(
    "name", ["output-error", "armax", "hammerstein", pytest.param("feedback", marks=pytest.mark.long)]
)
def test_a_fit_to_a_part_continues_to_that_of_the_whole(name):
    record, kind = driven(0, 1200, square=0.3), CANDIDATES[name]
    options = Options(na=1, nb=1, nk=1, orders=(1,), static="polynomial", knots=2, hold="zero")
    part, whole = (kind(each, options) for each in (record[:500], record))
    found = refitted(part, refit_data(options, record), Budget.LAST)
    before, error, least = (free_run_error(fit.model, [record]) for fit in (part, found, whole))
    assert found.ending is Ending.CONVERGED
    assert found.names == part.names
    assert found.samples > 1_190
    assert error < before
    assert error < 1.001 * least


def test_a_model_is_not_continued_where_that_is_worse_or_there_is_no_time(monkeypatch):
    record, options = driven(0, 2000), Options()
    fit = emsid.fit(emsid.arx(1, 1), record[:1000])
    judged = Compared.of([fit], record[:1000], driven(1), options, Control(), transient=None, whole=record)
    for structure, better in ((emsid.arx(1, 1, 5), False), (emsid.arx(1, 1), True)):
        last = emsid.fit(structure, record)
        monkeypatch.setattr(OfRegressions, "refitted", lambda *_, last=last: last)
        found = verdicts.on_all_samples(judged, record, options)
        assert (found.whole is record, found.best is fit) == (better, not better)
    stopped = Control(cancelled=lambda: True)
    assert verdicts.on_all_samples(judged, record, options, stopped) is judged


def test_a_quick_look_has_linear_models_and_regressions_only(plain):
    result = emsid.identify(driven(0)[:600], quick=True)
    (finding,) = (each for each in result.findings if each.code == "quick-look")
    assert "wiener-hammerstein" in finding.data["without"]
    assert not {fit.model.name for fit in result.fits} & set(finding.data["without"])
    assert "quick-look" not in codes(plain)
    assert {fit.model.name for fit in result.fits} == set(QUICK)
    with pytest.raises(emsid.ModelError, match="leave one out"):
        emsid.identify(driven(0), models="arx", quick=True)


def test_a_search_that_is_cancelled_keeps_the_models_found_so_far(plain):
    reached = []
    control = Control(
        cancelled=lambda: any("friction-narx" in each for each in reached), report=lambda a: reached.append(a.doing)
    )
    result = emsid.identify(driven(0), models="arx, friction-narx, wiener", options=Options(), control=control)
    assert [fit.model.name for fit in result.fits] == ["arx"]
    assert result.interrupted
    assert Finding("interrupted", data={"missing": ["friction-narx", "wiener"]}) in result.findings
    assert all((plain.verdicts, plain.curves, plain.recommendation[1:]))
    assert (result.verdicts, result.curves, len(result.recommendation)) == ((), (), 1)
    assert {"code": "residual-untested"} in result.model_verdicts[0].data["reasons"]
    assert not any("residual" in code for code in codes(result))
    assert len(list(report(result).figures)) < len(list(report(plain).figures))
    with pytest.raises(Stopped):
        emsid.identify(driven(0), models="arx", control=Control(cancelled=lambda: True))
    assert "interrupted" not in codes(plain)
