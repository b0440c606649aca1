"""The first screen of an identification: characteristics, the verdict on the residual, and what to do next."""

from __future__ import annotations

import json
from math import exp

import numpy as np
import pytest

from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.identification import identify
from emsid.identification.evidence import next_steps, verdicts
from emsid.identification.result import Characteristic
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import DeadZone
from emsid.models.kinds import capabilities_of
from emsid.models.regression.structures import arx
from emsid.options import Options
from emsid.record import Record
from emsid.report.identification_page import report
from emsid.validation.comparison import assess, compare
from emsid.wording import sentence

DT, TIME_CONSTANT, GAIN, EDGE = 0.01, 0.2, 3.0, 0.5


def characteristics_of(fit, record):
    return capabilities_of(fit.model).characteristics(fit, record)


def drive(edge=0.0, noise=0.01, seed=0, samples=2000, name="bench"):
    """A first-order drive behind a dead zone, with white noise in the measurement."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3, 3, samples // 20), 20)
    v = np.sign(u) * np.maximum(np.abs(u) - edge, 0)
    a = exp(-DT / TIME_CONSTANT)
    y = np.zeros(samples)
    for k in range(1, samples):
        y[k] = a * y[k - 1] + (1 - a) * GAIN * v[k - 1]
    noisy = y + noise * rng.standard_normal(samples)
    return Record(u, noisy, DT, input_units=("V",), output_units=("rad/s",), name=name)


def test_gain_and_time_constant_of_a_linear_model_are_in_the_units_of_the_record():
    record = drive(noise=1e-4)
    gain, time_constant = characteristics_of(least_squares(arx(1, 1), record), record)
    assert (gain.name, gain.unit) == ("gain", "rad/(s*V)")
    assert (time_constant.name, time_constant.unit) == ("time constant", "s")
    for found, truth in ((gain, GAIN), (time_constant, TIME_CONSTANT)):
        assert abs(found.value - truth) < 2 * found.half_width < 0.01 * truth


def test_intervals_of_characteristics_follow_the_covariance_to_first_order():
    record = drive()
    a, b = -0.9, 0.3
    covariance = np.array([[4e-6, 1e-6], [1e-6, 9e-6]])
    theta = np.array([a, b])
    fit = Fit(arx(1, 1).model(theta, record), ("a1", "b1"), theta, covariance, 1.0, 100, 1.0, 2)
    gain, _ = characteristics_of(fit, record)
    slope = np.array([-b / (1 + a) ** 2, 1 / (1 + a)])
    assert gain.value == pytest.approx(b / (1 + a))
    assert gain.half_width == pytest.approx(1.959964 * np.sqrt(slope @ covariance @ slope), rel=1e-4)


def test_the_break_points_of_a_dead_zone_are_in_the_unit_of_the_input():
    record = drive(edge=EDGE)
    a = exp(-DT / TIME_CONSTANT)
    model = Cascade(
        (DeadZone(-EDGE, EDGE, 1.0, 1.0), Rational(np.array([1 - a]), np.array([-a]), delay=1)), name="blocks"
    )
    free = tuple(name for name in model.names if "b_" in name and "f" in name)
    estimate = np.array([model.parameters[model.names.index(name)] for name in free])
    fit = Fit(model, free, estimate, np.diag([1e-4] * len(free)), 1.0, 100, 1.0, len(free))
    found = {each.name: each for each in characteristics_of(fit, record)}
    assert found["dead zone backward"].value == -EDGE
    assert found["dead zone forward"].half_width == pytest.approx(0.01959964)
    assert found["dead zone forward"].unit == "V"
    assert found["time constant"].value == pytest.approx(TIME_CONSTANT)


@pytest.mark.parametrize("gain", [2.0, -2.0])
def test_the_break_points_of_a_dead_zone_behind_a_filter_are_levels_of_the_input(gain):
    record, offset = drive(edge=EDGE), 0.3
    before = Rational([gain * 0.3], [-0.7], delay=1)
    model = Cascade(
        (before, DeadZone(-0.4, 0.8, 1.0, 1.0), Rational([0.1], [-0.9])), input_offset=offset, name="blocks"
    )
    free = ("f.b_l", "f.b_r", "u0")
    estimate = np.array([-0.4, 0.8, offset])
    fit = Fit(model, free, estimate, np.diag([1e-4, 4e-4, 9e-4]), 1.0, 100, 1.0, 3)
    found = {each.name: each for each in characteristics_of(fit, record)}
    ends = sorted((edge / gain + offset, variance) for edge, variance in ((-0.4, 1e-4), (0.8, 4e-4)))
    for name, (edge, variance) in zip(("dead zone backward", "dead zone forward"), ends, strict=True):
        assert found[name].value == pytest.approx(edge)
        assert found[name].half_width == pytest.approx(1.959964 * np.sqrt(variance / gain**2 + 9e-4), rel=1e-6)


@pytest.mark.parametrize("before", [Rational([1.0, -1.0]), DeadZone(-1.0, 1.0, 1.0, 1.0)])
def test_a_dead_zone_without_a_level_of_the_input_of_its_own_is_left_out(before):
    record = drive(edge=EDGE)
    zone = DeadZone(-0.4, 0.8, 1.0, 1.0)
    model = Cascade((before, Rational([0.1], [-0.9]), zone), name="blocks")
    fit = Fit(model, ("u0",), np.zeros(1), np.eye(1), 1.0, 100, 1.0, 1)
    found = {each.name: each.value for each in characteristics_of(fit, record) if "dead zone" in each.name}
    ends = {} if isinstance(before, Rational) else {"dead zone backward": -1.0, "dead zone forward": 1.0}
    assert found == ends


@pytest.mark.parametrize(("edge", "code"), [(0.0, "residual-independent-of-input"), (1.0, "residual-depends-on-input")])
def test_a_residual_depends_on_the_input_where_the_model_misses_something(edge, code):
    record = drive(edge=edge, noise=0.05)
    fit = least_squares(arx(1, 1), drive(edge=edge, noise=0.0))
    (verdict,) = verdicts(assess(fit, record))
    assert verdict.code == code
    assert verdict.data["share"] > 0.5 if edge else verdict.data["share"] < 0.02


def test_a_residual_of_zero_is_not_tested():
    record = drive(noise=0.0)
    theta = least_squares(arx(1, 1), record).estimate
    exact = Record(record.input, least_squares(arx(1, 1), record).model.simulate(record).output, DT)
    fit = Fit(arx(1, 1).model(theta, exact), ("a1", "b1"), theta, np.eye(2), 0.0, 100, 1.0, 2)
    (verdict,) = verdicts(assess(fit, exact))
    assert verdict.code in ("residual-not-tested", "residual-independent-of-input")


@pytest.mark.parametrize("constant", [True, False])
def test_a_residual_with_a_constant_input_is_not_tested(constant):
    """Nothing can depend on an input that does not change."""
    fit, record = least_squares(arx(1, 1), drive(noise=0.05)), drive(noise=0.05, seed=2)
    if constant:
        record = Record(np.ones_like(record.input), record.output, DT)
    (verdict,) = verdicts(assess(fit, record))
    assert (verdict.code == "residual-not-tested") == constant


@pytest.mark.parametrize(("pace", "code"), [(2.0, "residual-not-tested"), (0.2, "residual-independent-of-input")])
def test_a_residual_that_is_as_slow_as_the_input_is_not_independent_of_it(pace, code):
    """In a short record nothing can be said about a slow load that the model misses."""
    t = np.arange(2000) * DT
    slow = np.sin(t / pace) + np.sin(1.7 * t / pace + 1)
    load = np.cos(1.3 * t / pace) + np.cos(2.3 * t / pace)
    fit = least_squares(arx(1, 1), drive(noise=0.0))
    record = Record(slow, fit.model.simulate(Record(slow, np.zeros(2000), DT)).output[:, 0] + load, DT)
    (verdict,) = verdicts(assess(fit, record))
    assert verdict.code == code


def steps(record, unseen):
    comparison = compare([least_squares(arx(1, 1), record)], unseen)
    return [finding.code for finding in next_steps(comparison.best, verdicts(comparison.best), comparison.fits, record)]


def test_what_to_do_next_follows_from_what_was_found():
    record, other = drive(noise=1e-4), drive(noise=1e-4, seed=1, name="another")
    assert steps(record, other) == []
    assert "next-physical-model" in steps(drive(edge=1.0), drive(edge=1.0, seed=1, name="another"))
    noise = drive(noise=30.0, seed=3, name="noise")
    assert steps(record, noise)[0] == "next-check-data"
    assert "next-reduce-noise" not in steps(drive(edge=1.5), drive(edge=1.5, seed=1))


def test_noise_is_named_where_it_limits_a_fit():
    record = drive(noise=3.0)
    comparison = compare([least_squares(arx(1, 1), drive(noise=1e-4))], drive(noise=3.0, seed=1))
    assert 20 < comparison.best.row.fit_percent < 40
    found = [step.code for step in next_steps(comparison.best, verdicts(comparison.best), comparison.fits, record)]
    assert found[0] == "next-reduce-noise"
    assert "next-check-data" not in found


def test_no_physical_model_is_proposed_where_one_was_tried_and_failed():
    record = drive(edge=1.0)
    reversed_leads = Record(record.input, -record.output, DT, input_units="V", output_units="rad/s", name="reversed")
    both = identify(reversed_leads, models="arx, rigid-motor", options=Options(na=1, nb=1, nk=1))
    assert {finding.subject for finding in both.findings if finding.code == "model-failed"} == {"rigid-motor"}
    assert "next-physical-model" not in {step.code for step in both.next_steps}


@pytest.fixture(scope="module")
def result():
    return identify(drive(edge=EDGE), models=("arx", "friction-narx"), options=Options(na=1, nb=1, nk=1))


def test_the_first_screen_says_which_model_and_how_good_and_shows_its_free_run(result):
    page = report(result)
    best = result.on_unseen.best.row
    verdict, tested = page.summary
    assert verdict == sentence(result.recommendation[0])
    assert best.model in verdict
    assert f"{best.fit_percent:.1f} %" in tested
    assert f"run on {best.samples:,} that no fit and no choice has used" in tested
    shown = [fact.meaning for fact in page.facts[:3]]
    assert shown == [
        "Static gain over the range of the input",
        "Time constant",
        "Coulomb friction in units of the input",
    ]
    (figure,) = page.opening.figures
    assert [mark.label for mark in figure.plots[0].marks][-2] == "measured"
    steps = (*result.recommendation[1:], *result.next_steps)
    assert page.advice == tuple(sentence(finding) for finding in steps)
    tests = next(section for section in page.sections if section.title == "Verdicts")
    assert [row[0] for row in tests.tables[0].rows] == [verdict.model for verdict in result.model_verdicts]
    assert tests.remarks == tuple(sentence(verdict) for verdict in result.model_verdicts)
    assert all(notice.severity in ("warning", "problem") for notice in page.notices)
    about_others = {sentence(finding) for finding in result.findings if finding.model not in ("", best.model)}
    assert about_others
    assert not about_others & {notice.text for notice in page.notices}


def test_results_hold_what_the_first_screen_shows(result):
    data = json.loads(json.dumps(result.to_data(), allow_nan=False))
    assert [each["code"] for each in data["next"]] == [step.code for step in result.next_steps]
    assert [each["code"] for each in data["recommendation"]] == ["model-recommended", "next-experiment"]
    assert [each["code"] for each in data["verdicts"]] == [verdict.code for verdict in result.model_verdicts]
    assert [each["code"] for each in data["residual"]] == [verdict.code for verdict in result.verdicts]
    assert data["characteristics"] == [each.to_data() for each in result.characteristics]


@pytest.mark.parametrize(("half_width", "significant"), [(None, True), (2.0, True), (2.1, False)])
def test_a_characteristic_is_significant_that_is_not_within_its_interval_of_zero(half_width, significant):
    assert Characteristic("dead zone", -2.0, half_width, "V", "arx").significant == significant
