"""The verdict on every model: residual tests, agreement, plausibility, and the recommendation that follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
import emsid.identification.verdict as compared_module
import emsid.identification.verdict as verdict_module
from emsid.blocks import CubicSpline, DeadZone, PiecewiseLinear, Polynomial, Rational
from emsid.estimation.fit import Ending, Fit
from emsid.findings import Finding
from emsid.identification.evidence import IMPLAUSIBLE, PREDICTABLE, Plausibility, predictable_shares
from emsid.identification.ranking import ranked
from emsid.identification.verdict import (
    EXPERIMENTS,
    excluded_models,
    experiment,
    implausible_models,
    model_verdicts,
    recommendation,
    recommended,
)
from emsid.models.extrapolation import Extremes, runs_away
from emsid.options import Options
from emsid.validation.agreement import difference_of_pieces
from emsid.validation.comparison import as_fit, compare
from emsid.validation.correlation import input_test

DT, POLE = 0.01, 0.9


def held(seed, samples=1200, each=8, low=-1.0, high=1.0):
    return np.repeat(np.random.default_rng(seed).uniform(low, high, samples // each), each)


def record(seed=0, samples=1200, noise=0.02, of=lambda u: u, name="bench", **how):
    """A first-order drive behind a static map, with white noise in the measurement."""
    u = held(seed, samples, **how)
    y = lfilter([0.0, 1 - POLE], [1.0, -POLE], of(u))
    noisy = y + noise * np.random.default_rng([1, seed]).standard_normal(len(y))
    return emsid.Record(u, noisy, DT, input_units=("V",), output_units=("rad/s",), name=name)


def linear(gain=1.0, pole=POLE, delay=1, name="filter"):
    """A model of that drive without a map."""
    return as_fit(emsid.Cascade((Rational([gain * (1 - pole)], [-pole], delay),), name=name))


def mapped(static, name="hammerstein"):
    return as_fit(emsid.Cascade((static, Rational([1 - POLE], [-POLE], 1)), name=name))


def verdicts(*fits, known=None, unseen=None, findings=()):
    known, unseen = known or record(0), unseen or record(1, name="other")
    return model_verdicts(compare(fits, known, data="identification"), compare(fits, unseen), findings)


def reasons(verdict):
    return [each["code"] for each in verdict.data["reasons"]]


# --- residual tests --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("colour", "of_input"), [(0.0, 0.0), (0.9, 0.9)])
def test_of_independent_residuals_one_in_a_hundred_fails_each_test(colour, of_input):
    rng = np.random.default_rng(3)
    failed = np.zeros(2)
    for _ in range(150):
        e, u = (lfilter([1.0], [1.0, -a], rng.standard_normal(900))[100:] for a in (colour, of_input))
        test = input_test(e, u, (), 30)
        failed += abs(test.largest) > test.limit, test.p_value < 0.01
    assert np.all(failed <= 6)  # of 150; more in one of 250 such tests


def test_a_weak_influence_at_many_lags_is_seen_by_the_portmanteau_test():
    rng = np.random.default_rng(4)
    u, noise = rng.standard_normal((2, 2000))
    spread = lfilter(np.full(30, 0.027), [1.0], u)
    test = input_test(noise + spread, u, (), 30)
    assert abs(test.largest) < test.limit
    assert test.p_value < 1e-3
    assert test.depends


def test_a_residual_is_found_to_depend_at_its_lag():
    u = np.random.default_rng(5).standard_normal(1500)
    test = input_test(0.3 * np.roll(u, 7) + np.random.default_rng(6).standard_normal(1500), u, (), 30)
    assert (test.at_lag, test.depends) == (7, True)
    assert input_test(np.ones(100), u[:100], (), 30) is None


def test_shares_of_several_residuals_are_those_of_each_alone():
    known = record(2)
    errors = np.random.default_rng(7).standard_normal((1200, 2)) + np.abs(known.input) * [0.0, 3.0]
    both = predictable_shares(errors, known)
    assert both == pytest.approx([predictable_shares(errors[:, [k]], known)[0] for k in (0, 1)])
    assert both[0] < 0.02
    assert both[1] > 0.3


def test_a_slow_input_predicts_a_residual_in_a_short_record():
    """What a linear model leaves of a drive behind a dead zone; without a penalty, 29 % would be predicted."""
    t = 0.005 * np.arange(680)
    parts = ((3.0, 0.25, 0.0), (1.5, 0.9, 2.0), (0.8, 2.1, 4.0), (0.5, 4.0, 6.0))
    u = sum(size * np.sin(2 * np.pi * frequency * t + phase) for size, frequency, phase in parts)
    moved, straight = (lfilter([0, 0.1], [1, -0.9], x) for x in (np.sign(u) * np.maximum(np.abs(u) - 0.8, 0), u))
    known = emsid.Record(u, moved, 0.005)
    left = moved - (straight @ moved) / (straight @ straight) * straight
    assert predictable_shares(left[:, None], known)[0] > 0.8
    noise = lfilter([1], [1, -0.9], np.random.default_rng(8).standard_normal((680, 40)), axis=0)
    assert np.mean(predictable_shares(noise, known) > PREDICTABLE) <= 0.05


def test_a_model_without_a_fault_is_supported():
    (verdict,) = verdicts(linear())
    assert verdict.code == "model-supported"
    assert verdict.data["reasons"] == []
    tests = verdict.data["tests"]
    assert {test["test"] for test in tests} == {"past-inputs", "nonlinear-term"}
    assert all(test["passed"] and test["limit"] > 2.5 for test in tests)


@pytest.mark.parametrize(
    ("fit", "code"),
    [
        (linear(pole=0.8), "depends-on-past-inputs"),
        (mapped(Polynomial(np.array([0.0, 1.0]))), "depends-on-nonlinear-term"),
    ],
)
def test_a_model_that_misses_dynamics_or_a_map_is_limited(fit, code):
    bent = (lambda u: u**2 + u) if code == "depends-on-nonlinear-term" else (lambda u: u)
    (verdict,) = verdicts(fit, known=record(0, of=bent), unseen=record(1, of=bent, name="other"))
    assert verdict.code == "model-limited"
    assert code in reasons(verdict)
    assert any(not each["passed"] for each in verdict.data["tests"])


def test_a_model_that_leaves_what_another_explains_is_limited():
    exact, alike, wrong = linear(), linear(1.001, name="alike"), linear(0.8, name="wrong")
    best, same, other = verdicts(exact, alike, wrong)
    assert [finding.code for finding in (best, same, other)] == ["model-supported", "model-supported", "model-limited"]
    (found,) = [each for each in other.data["reasons"] if each["code"] == "another-is-better"]
    errors = [
        assessment.row.simulation_mse for assessment in compare([exact, wrong], record(1, name="other")).assessments
    ]
    assert found["other"] in ("filter", "alike")
    assert found["left"] == pytest.approx(errors[0] / errors[1], rel=0.05)
    on_fitted = compare([exact, alike, wrong], record(0), data="identification")
    said = model_verdicts(on_fitted, on_fitted, ())  # no unseen data
    assert not any("another-is-better" in reasons(each) for each in said)


def test_one_step_errors_of_a_model_of_noise_are_tested():
    known, unseen = record(0, noise=0.1), record(1, noise=0.1, name="other")
    (coloured,) = verdicts(emsid.least_squares(emsid.arx(1, 1), known), known=known, unseen=unseen)
    assert "one-step-errors-coloured" in reasons(coloured)
    (verdict,) = verdicts(linear(), known=known, unseen=unseen)
    assert "one-step-errors-coloured" not in reasons(verdict)


@pytest.mark.parametrize(
    ("fit", "code"),
    [(linear(gain=-1.0), "no-better-than-mean"), (linear(gain=1e6), "diverges")],
)
def test_a_model_without_use_is_unusable_and_not_recommended(fit, code):
    unseen = record(1, name="other")
    (verdict,) = verdicts(fit)
    assert verdict.code == "model-unusable"
    assert reasons(verdict) == [code]
    choice = compare([fit], unseen)
    found = recommendation(choice, ranked(choice, None, Options()), verdict, (), seen=False)
    assert found.code == "no-model-recommended"
    assert found.code != "model-recommended"


def step(samples=250, noise=0.02):
    """A first-order drive after one step of its input."""
    u = np.r_[np.zeros(10), np.ones(samples - 10)]
    y = lfilter([0.0, 1 - POLE], [1.0, -POLE], u) + noise * np.random.default_rng(4).standard_normal(samples)
    return emsid.Record(u, y, DT, input_units=("V",), output_units=("rad/s",), name="step")


@pytest.mark.parametrize(("gain", "code"), [(1.02, "model-limited"), (0.3, "model-unusable")])
def test_a_model_is_not_unusable_because_the_unseen_output_is_settled(gain, code):
    """After a step nothing is better than the mean of the output; only an error as large as the step counts."""
    known, unseen = step()[:100], step()[100:]
    (verdict,) = verdicts(linear(gain), known=known, unseen=unseen)
    assert compare([linear(gain)], unseen).best.row.fit_percent <= 0
    assert verdict.code == code
    assert ("output-moves-little" in reasons(verdict)) == (code == "model-limited")
    assert "larger-on-unseen" not in reasons(verdict)


def test_a_model_of_a_step_is_the_best_and_its_limits_are_said():
    result = emsid.identify(step(), models="arx,output-error")
    assert result.on_unseen.best.row.fit_percent <= 0
    assert result.recommendation[0].code == "best-not-recommended"
    assert "few-levels" in {each["code"] for each in result.recommendation[0].data["reasons"]}
    codes = {finding.code for finding in result.findings}
    assert "input-constant" in codes
    assert "no-better-than-mean" not in codes


@pytest.mark.parametrize(("wiggle", "gains"), [(0.0, False), (0.5, True)])
def test_a_model_that_is_no_better_than_a_straight_line_is_not_supported(wiggle, gains):
    """A ramp moves the output as a line in time does; only what the input adds to it shows the response."""
    t = np.linspace(0, 4, 1200)
    u = t + wiggle * held(3)
    y = lfilter([0.0, 1 - POLE], [1.0, -POLE], u) + 0.02 * np.random.default_rng(6).standard_normal(len(u))
    whole = emsid.Record(u, y, DT, name="ramp")
    (verdict,) = verdicts(linear(), known=whole[:800], unseen=whole[800:])
    assert ("no-gain-over-trend" in reasons(verdict)) != gains
    assert verdict.code == "model-limited"  # its error is larger at the end of the ramp, beyond what was fitted


def test_an_implausible_model_stands_behind_plausible_ones(monkeypatch):
    def names():
        return [each.model.name for each in emsid.identify(record(), models="arx,output-error,armax").on_unseen.fits]

    first, second, third = names()
    monkeypatch.setattr(compared_module, "implausible_models", lambda findings: frozenset({second}))
    assert names() == [first, third, second]


def test_a_search_without_an_end_is_a_limit():
    (verdict,) = verdicts(replace(linear(), ending=Ending.STALLED))
    assert reasons(verdict) == ["search-not-finished"]


# --- agreement -------------------------------------------------------------------------------------------------------


def test_pieces_that_differ_are_found_by_kind_and_size():
    fit, known = linear(), record(0)
    unseen = record(1, name="other")
    lifted = replace(unseen, output=unseen.output + 0.3)
    run = [(each, fit.model.simulate(each)) for each in (known, lifted)]
    found = difference_of_pieces(run, "filter")
    assert found.difference.name == "level"
    assert max(found.values) - min(found.values) == pytest.approx(0.3, abs=0.02)
    assert difference_of_pieces([(each, fit.model.simulate(each)) for each in (known, unseen)], "filter") is None
    (verdict,) = verdicts(fit, unseen=lifted)
    assert {"pieces-differ", "larger-on-unseen"} <= set(reasons(verdict))


def test_an_error_in_one_stretch_is_named():
    unseen = record(1, name="other")
    y = unseen.output.copy()
    y[600:640] += 1.0
    (verdict,) = verdicts(linear(), unseen=replace(unseen, output=y))
    stretch = next(each for each in verdict.data["reasons"] if each["code"] == "error-in-one-stretch")
    assert stretch["first"] <= 640
    assert stretch["last"] >= 600
    assert (stretch["from"], stretch["to"]) == (unseen.time[stretch["first"]], unseen.time[stretch["last"]])
    assert stretch["share"] > 0.5


def test_an_error_that_hardly_explains_anything_is_a_limit():
    (verdict,) = verdicts(linear(gain=0.4))
    assert "explains-little" in reasons(verdict)


# --- plausibility ----------------------------------------------------------------------------------------------------


def implausible(fit, known=None):
    return {finding.code: finding.data for finding in Plausibility(known or record(0)).findings(fit)}


def sparse(seed=0):
    """A record whose inputs above 1 are rare."""
    u = held(seed)
    u[600:602] = 1.571
    y = lfilter([0.0, 1 - POLE], [1.0, -POLE], u)
    return emsid.Record(u, y, DT)


KNOTS = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.571])


def test_a_spline_that_leaves_the_range_of_the_output_is_implausible():
    found = implausible(mapped(CubicSpline(KNOTS, np.array([-1.0, -0.5, 0.0, 0.5, 1.0, -90.0]))), sparse())
    assert found["map-leaves-range"]["value"] == pytest.approx(-90.0)
    assert found["map-leaves-range"]["at"] == pytest.approx(1.571)
    assert implausible(mapped(CubicSpline(KNOTS, KNOTS)), sparse()) == {}


def test_a_map_that_turns_where_there_are_no_data_is_implausible_and_one_that_turns_among_data_is_not():
    turning = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.2])
    knots = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.3])
    found = implausible(mapped(PiecewiseLinear(np.append(knots, 1.571), np.append(turning, 0.8))), sparse())
    assert found["map-turns-without-data"]["at"] == pytest.approx(1.3)
    assert "map-turns-without-data" not in implausible(mapped(PiecewiseLinear(KNOTS, np.abs(KNOTS))), sparse())


def test_a_delay_longer_than_the_response_is_implausible():
    assert implausible(linear(delay=90))["delay-longer-than-rise"]["samples"] == 90
    assert "delay-longer-than-rise" not in implausible(linear(delay=3))
    late = emsid.Record(np.roll(record(0).input, -90, axis=0)[:1100], record(0).output[:1100], DT)
    assert "delay-longer-than-rise" not in implausible(linear(delay=90), late)
    lag = emsid.Structure.parse("y(t-1)", "u(t-90)").model(np.array([0.9, 0.1]), record())
    assert "delay-longer-than-rise" in implausible(as_fit(lag))


def test_a_pole_faster_than_the_sampling_is_implausible():
    fast = emsid.Cascade((Rational([0.09], [-1.0, 0.09], 1),), name="filter")  # poles 0.9 and 0.1
    assert implausible(as_fit(fast))["faster-than-sampling"]["pole"] == pytest.approx(0.1)
    assert implausible(linear()) == {}


@pytest.mark.parametrize("to", ["speed", "position"])
def test_a_gain_of_the_other_sign_than_that_of_the_response_is_implausible(to):
    """The sign at rest, or of the drift of a position; a map that turns, as a magnitude, has none."""
    u = held(0)
    y = lfilter([0.0, 0.1], np.polymul([1.0, -0.9], [1.0, -1.0] if to == "position" else [1.0]), u)
    known = emsid.Record(u, y + 0.01 * np.random.default_rng(0).standard_normal(len(u)), DT)
    lag = [-1.9, 0.9] if to == "position" else [-0.9]
    for gain, found in ((0.1, set()), (-0.1, {"gain-of-other-sign"})):
        model = emsid.Cascade((Rational([0.0, gain], lag),), name="filter")
        assert set(implausible(as_fit(model), known)) & {"gain-of-other-sign"} == found
    magnitude = emsid.Cascade((Polynomial([0.0, 0.0, -1.0]), Rational([0.0, 0.1], lag)), name="filter")
    assert "gain-of-other-sign" not in implausible(as_fit(magnitude), known)


def test_half_a_period_of_delay_gives_a_gain_of_the_other_sign():
    """A sine with a little noise: with a delay of half a period a model of the wrong sign fits as well."""
    rng = np.random.default_rng(5)
    u = np.sin(0.1 * np.arange(1200)) + 0.1 * rng.standard_normal(1200)
    known = emsid.Record(u, lfilter([0.0, 0.1], [1.0, -0.9], u) + 0.01 * rng.standard_normal(1200), DT)
    for nk, wrong in ((1, False), (32, True)):
        result = emsid.identify(known, models="output-error", options=Options(na=1, nb=1, nk=nk))
        assert ("gain-of-other-sign" in {finding.code for finding in result.findings}) == wrong
        assert (result.model_verdicts[0].code == "model-implausible") == wrong


def test_a_pole_that_a_zero_cancels_is_a_remark_in_a_regression_too():
    structure = emsid.arx(2, 2)  # (1 - 0.5q⁻¹)(1 - 0.9q⁻¹) over q⁻¹(1 - 0.5q⁻¹)
    cancelled = structure.model(np.array([-1.4, 0.45, 0.1, -0.05]), record())
    assert implausible(as_fit(cancelled))["zero-cancels-pole"]["pole"] == pytest.approx([0.5, 0.0])
    assert implausible(as_fit(structure.model(np.array([-1.4, 0.45, 0.1, 0.05]), record()))) == {}
    filters = emsid.Cascade((DeadZone(-0.5, 0.5), Rational([1.0, -0.899], [-0.9])), name="blocks")
    remark = implausible(as_fit(filters))["zero-cancels-pole"]
    assert (remark["block"], remark["pole"]) == (2, pytest.approx([0.9, 0.0]))


def test_linear_models_with_a_noise_model_are_judged_alike():
    none = np.zeros(0)
    polynomial = emsid.PolynomialModel(
        none, np.array([[0.1, -0.05]]), none, none, np.array([[-1.4, 0.45]]), 0.0, 1, DT, "box-jenkins"
    )
    good = replace(polynomial, b=np.array([[0.1, 0.05]]))
    fast, late = replace(good, f=np.array([[-1.0, 0.09]])), replace(good, delay=90)
    assert implausible(as_fit(polynomial))["zero-cancels-pole"]["pole"] == pytest.approx([0.5, 0.0])
    assert implausible(as_fit(polynomial.form))["zero-cancels-pole"]["pole"] == pytest.approx([0.5, 0.0])
    assert implausible(as_fit(fast))["faster-than-sampling"]["pole"] == pytest.approx(0.1)
    assert implausible(as_fit(fast.form))["faster-than-sampling"]["pole"] == pytest.approx(0.1)
    assert implausible(as_fit(late))["delay-longer-than-rise"]["samples"] == 90
    assert implausible(as_fit(good)) == implausible(as_fit(good.form)) == {}


@pytest.mark.parametrize("code", sorted(IMPLAUSIBLE))
def test_any_of_these_findings_makes_a_model_implausible(code):
    (verdict,) = verdicts(linear(), findings=[Finding(code, "filter", {"model": "filter"})])
    assert (verdict.code, reasons(verdict)) == ("model-implausible", [code])
    (other,) = verdicts(linear(), findings=[Finding(code, "other", {"model": "other"})])
    assert other.code == "model-supported"


def driven(u, below, of=lambda u: u):
    """A drive of unit gain with these poles behind a map, with little noise."""
    y = lfilter([0.0, sum(below)], below, of(u))
    return emsid.Record(u, y + 0.002 * np.random.default_rng(0).standard_normal(len(u)), DT)


def rarely(high, count):
    """Inputs within 1, but for a few samples."""
    u = held(0, 600)
    u[300 : 300 + count] = high
    return u


SLOW, TWO = [1.0, -POLE], [1.0, -1.0, 0.09]
SPLINE = {"models": "hammerstein", "orders": (1,), "static": "spline", "knots": 5, "nk": 1}
POLYNOMIAL = SPLINE | {"static": "polynomial", "knots": 7}
ARX, OUTPUT_ERROR = ({"models": name, "na": 1, "nb": 1, "nk": 1} for name in ("arx", "output-error"))
SAME = held(0, 600)


@pytest.mark.parametrize(
    ("codes", "data", "options", "ordinary", "other"),
    [
        ({"delay-longer-than-rise"}, driven(SAME, SLOW), ARX | {"nk": 90}, driven(SAME, SLOW), ARX),
        ({"faster-than-sampling"}, driven(SAME, TWO), OUTPUT_ERROR | {"na": 2}, driven(SAME, SLOW), OUTPUT_ERROR),
        ({"knots-without-data"}, driven(rarely(1.571, 2), SLOW), SPLINE, driven(SAME, SLOW), SPLINE),
        (
            {"diverges-beyond-range", "map-turns-without-data", "map-leaves-range"},
            driven(rarely(3.0, 6), SLOW, lambda u: np.tanh(3 * u)),
            POLYNOMIAL,
            driven(SAME, SLOW),
            POLYNOMIAL | {"knots": 3},
        ),
    ],
    ids=lambda each: ", ".join(sorted(each)) if isinstance(each, set) else "",
)
def test_an_identification_calls_its_implausible_model_so(codes, data, options, ordinary, other):
    for known, given, expected in ((data, options, codes), (ordinary, other, set())):
        result = emsid.identify(
            known, models=given["models"], options=Options(**{k: v for k, v in given.items() if k != "models"})
        )
        assert {finding.code for finding in result.findings if finding.code in codes} == expected
        assert (result.model_verdicts[0].code in ("model-implausible", "model-unusable")) == bool(expected)


def test_a_pole_that_a_zero_cancels_makes_no_model_implausible():
    result = emsid.identify(record(0), models="output-error", na=2, nb=2, nk=1)
    assert "zero-cancels-pole" in {finding.code for finding in result.findings}
    assert "zero-cancels-pole" not in IMPLAUSIBLE
    assert result.model_verdicts[0].code in ("model-supported", "model-limited")


def test_a_model_that_diverges_on_steps_within_the_range_of_the_input_is_implausible():
    """The cube of how far the output is behind the input, which is little in a smooth record."""
    u = np.sin(0.02 * np.arange(2000.0))
    smooth = emsid.Record(u, lfilter([0.0, 1 - POLE], [1.0, -POLE], u), DT, name="smooth")
    cube = ("u(t-1)^3", "y(t-1)*u(t-1)^2", "y(t-1)^2*u(t-1)", "y(t-1)^3")
    steep = emsid.Structure.parse("y(t-1)", "u(t-1)", *cube, name="steep")
    fit = as_fit(emsid.RegressionModel(steep, np.array([POLE, 1 - POLE, *(3.0 * np.array([1, -3, 3, -1]))]), DT))
    findings = implausible(fit, smooth)
    assert findings["diverges-on-steps"] == {"model": "steep"}
    assert "diverges-beyond-range" not in findings
    assert "diverges-on-steps" not in implausible(linear(), smooth)


def test_a_model_that_diverges_while_an_extreme_input_is_held_is_not_recommended():
    """A slow output stays small in a record of short pulses; a cube of it wins at the steady state of the largest."""
    u, slow = np.repeat(np.random.default_rng(3).uniform(-1, 1, 500), 4), 0.99
    known = emsid.Record(u, lfilter([0.0, 1 - slow], [1.0, -slow], u), DT, name="pulses")
    cubic = emsid.Structure.parse("y(t-1)", "u(t-1)", "y(t-1)^3", name="cubic")
    fit = as_fit(emsid.RegressionModel(cubic, np.array([slow, 1 - slow, 0.4 * (1 - slow)]), DT))
    findings = implausible(fit, known)
    assert findings["diverges-on-constant-input"] == {"model": "cubic"}
    assert "diverges-beyond-range" not in findings
    assert excluded_models(Finding(code, "cubic", data) for code, data in findings.items()) == {"cubic"}
    known_errors = {"cubic": 1.0, "arx": 3.9}
    about = [Finding(code, "cubic", data) for code, data in findings.items()]
    assert excluded_models(about, known_errors) == {"cubic"}
    assert excluded_models(about, {**known_errors, "arx": 4.1}) == set()  # the system may do so, too
    beyond = Finding("diverges-beyond-range", "cubic", {"model": "cubic"})
    assert excluded_models([*about, beyond], {**known_errors, "arx": 4.1}) == {"cubic"}
    stable = as_fit(emsid.RegressionModel(cubic, np.array([slow, 1 - slow, -0.4 * (1 - slow)]), DT))
    assert "diverges-on-constant-input" not in implausible(stable, known)
    assert [runs_away(each.model, Extremes(known)) for each in (fit, stable)] == [True, False]


def test_a_model_that_diverges_on_a_larger_input_is_not_recommended():
    known, unseen = record(0), record(1, name="other")
    cubic = emsid.Structure.parse("y(t-1)", "u(t-1)", "y(t-1)^3", name="cubic")
    turns = (1 - POLE) / (0.8 * float(np.abs(known.output).max())) ** 2  # the cube wins near the end of the range
    fit = as_fit(emsid.RegressionModel(cubic, np.array([POLE, 1 - POLE, turns]), DT))
    assert implausible(fit, known)["diverges-beyond-range"] == {"model": "cubic", "factor": 1.2}
    assert "diverges-beyond-range" not in implausible(linear(), known)
    fits = [linear(gain=0.3, name="poor"), linear(name="good")]
    assert recommended(ranked(compare(fits, unseen), None, Options()), (), {"good"}).name == "poor"


# --- the recommendation ----------------------------------------------------------------------------------------------


def chosen_of(better_by, implausible="a", ending=Ending.CONVERGED):
    """The recommended of two models, of which one is implausible."""
    unseen = record(1, name="other")
    fits = [replace(linear(name="a"), ending=ending), linear(gain=1 - better_by, name="b")]
    findings = [Finding("map-leaves-range", implausible, {"model": implausible})]
    choice = compare(fits, unseen)
    ranking = ranked(choice, None, Options())
    chosen = recommended(ranking, implausible_models(findings))
    found = {verdict.model: verdict for verdict in verdicts(*fits, unseen=unseen, findings=findings)}
    choice = choice.in_order_of([chosen.fit, *(each.fit for each in ranking if each is not chosen)])
    return chosen.name, recommendation(choice, ranking, found[chosen.name], findings, seen=False)


def test_an_implausible_model_is_not_recommended_over_a_plausible_one_within_noise():
    name, why = chosen_of(0.005)
    assert (name, why.code, why.subject) == ("b", "model-recommended", "b")
    assert why.data["instead_of"] == "a"
    assert why.data["because"]["code"] == "map-leaves-range"
    assert why.data["same_in"] in ("noise", "practice")
    assert not why.data["unfinished"]
    assert chosen_of(0.005, ending=Ending.OUT_OF_BUDGET)[1].data["unfinished"]
    name, why = chosen_of(0.5)
    assert (name, why.data["verdict"]) == ("a", "model-implausible")
    assert "instead_of" not in why.data
    name, why = chosen_of(0.005, implausible="b")
    assert (name, why.data["verdict"]) == ("a", "model-supported")


def test_only_models_that_were_followed_over_the_folds_are_counted():
    unseen = record(1, name="other")
    fits = [linear(name="a"), linear(gain=0.9, name="b"), linear(gain=0.1, name="c")]
    choice = compare(fits, unseen)
    ranking = ranked(choice, None, Options())
    followed = [*(replace(each, folds=each.folds * 4) for each in ranking[:2]), ranking[2]]
    (verdict, *_) = verdicts(*fits, unseen=unseen)
    for among, count in ((ranking, 3), (followed, 2)):
        assert recommendation(choice, among, verdict, (), seen=False).data["models"] == count


def next_of(known, reason=None, unseen=None, seen=False):
    unseen = unseen or record(1, name="other")
    (verdict,) = verdicts(linear())
    if reason is not None:
        verdict = replace(verdict, data=verdict.data | {"reasons": [reason]})
    found = experiment(verdict, known, unseen, seen=seen)
    assert found.code == "next-experiment"
    return found.data["kind"]


def test_the_next_experiment_is_about_what_the_data_leave_open():
    known = record(0)
    two_levels = replace(known, input=np.sign(known.input))
    assert next_of(two_levels) == "more-levels"
    assert next_of(known[:40]) == "longer"
    assert next_of(record(0, low=0.2, high=1.0)) == "both-directions"
    assert next_of(known, {"code": "map-leaves-range", "at": 1.571}) == "fill-range"
    assert next_of(known, {"code": "knots-without-data", "knots": [1.0]}) == "fill-range"
    assert next_of(known, {"code": "pieces-differ"}) == "repeat-input"
    assert next_of(known, seen=True) == "other-input"
    assert next_of(known, unseen=record(1, name="bench, unseen part")) == "other-input"
    assert next_of(known) == "in-use"


def test_every_finding_of_the_first_look_that_asks_for_an_experiment_has_words():
    from emsid.wording import CATALOGUE
    from emsid.wording.verdict import _EXPERIMENTS

    assert set(EXPERIMENTS) <= set(CATALOGUE)
    assert set(EXPERIMENTS.values()) <= set(_EXPERIMENTS)


def test_an_identification_has_a_verdict_for_every_model_and_recommends_one():
    result = emsid.identify(record(0), record(1, name="other"), models="arx", options=emsid.Options(na=1, nb=1, nk=1))
    assert [verdict.model for verdict in result.model_verdicts] == [fit.model.name for fit in result.fits]
    why, then = result.recommendation
    assert why.subject == result.chosen.model.name == "arx"
    assert then.data["kind"] == "in-use"
    assert isinstance(result.chosen, Fit)


# --- findings against a verdict --------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", ["no-response", "end-shows-little", "effect-missing", "value-contradicted"])
@pytest.mark.parametrize("about", ["filter", ""])
def test_a_finding_that_contradicts_a_model_allows_no_support(code, about):
    """One about no model concerns every one, and one about another model none but that."""
    assert verdicts(linear())[0].code == "model-supported"
    found = Finding(code, "y", {"model": about} if about else {})
    (own,) = verdicts(linear(), findings=[found])
    assert own.code == "model-limited"
    assert reasons(own) == [code]
    assert own.data["reasons"][0]["subject"] == "y"
    (other,) = verdicts(linear(name="another"), findings=[found])
    assert other.code == ("model-supported" if about else "model-limited")


def test_the_worst_reason_is_the_verdict_and_comes_first():
    against = [Finding(code, "y", {"model": "filter"}) for code in ("effect-missing", "map-leaves-range")]
    (found,) = verdicts(linear(), findings=against)
    assert found.code == "model-implausible"
    assert reasons(found) == ["map-leaves-range", "effect-missing"]


@pytest.mark.parametrize(("noise", "limited"), [(0.02, True), (0.0005, False)])
def test_a_residual_that_the_input_predicts_limits_a_model_whose_tests_pass(monkeypatch, noise, limited):
    """Unless it is small beside the output."""
    monkeypatch.setattr(verdict_module, "predictable_shares", lambda errors, record: np.full(errors.shape[1], 0.3))
    found = verdicts(linear(), known=record(0, noise=noise), unseen=record(1, noise=noise))[0]
    assert all(each["passed"] for each in found.data["tests"] if each["test"] != "whiteness")
    assert ("residual-depends-on-input" in reasons(found)) == limited


def test_a_record_without_a_response_supports_no_model():
    rng = np.random.default_rng(5)
    u = held(5, 1600)
    slow = lfilter([1.0], [1.0, -0.999], 0.05 * rng.standard_normal(1600))
    y = 0.1 * lfilter([0.0, 1 - POLE], [1.0, -POLE], u) + slow
    found = emsid.identify(emsid.Record(u, y, DT, name="walks"), models="arx,output-error")
    assert "no-response" in {each.code for each in found.findings}
    assert "model-supported" not in {each.code for each in found.model_verdicts}
