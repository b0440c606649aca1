"""Verdicts know the experiment: what its input does not tell, loops, and models that explain little."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.blocks import PiecewiseLinear, Rational
from emsid.identification.evidence import LARGEST, LOWER, SAMPLES, Probes, Undetermined, few_levels
from emsid.identification.ranking import Ranked
from emsid.identification.task import horizon_of, unstable_pole
from emsid.identification.verdict import is_weak, model_verdicts
from emsid.models.extrapolation import BEGUN
from emsid.selection.improvement import StretchErrors
from emsid.validation.comparison import as_fit, compare
from emsid.wording import sentence

DT, POLE, NOISE = 0.01, 0.9, 0.02


def filtered(u):
    return lfilter([0.0, 1 - POLE], [1.0, -POLE], u)


def record(u, seed=0, of=lambda u: u, noise=NOISE):
    rng = np.random.default_rng([1, seed])
    return emsid.Record(u, filtered(of(u)) + noise * rng.standard_normal(len(u)), DT)


def binary(seed=0, samples=800):
    return np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], samples // 8), 8)


def many(seed=0, samples=800):
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, samples // 8), 8)


def straight(name="straight", pole=POLE):
    return emsid.Cascade((Rational([1 - pole], [-pole], 1),), name=name)


def bent(name="bent"):
    """The same for −1 and 1, and half of it between."""
    zone = PiecewiseLinear(np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), np.array([-1.0, -0.25, 0.0, 0.25, 1.0]))
    return emsid.Cascade((zone, Rational([1 - POLE], [-POLE], 1)), name=name)


def ranking(known, *models, parts=()):
    """The models with their errors on a record."""
    scale = float(np.std(known.output))
    errors = [StretchErrors.of((known.output - model.simulate(known).output)[:, 0] ** 2 / scale**2) for model in models]
    return [Ranked(as_fit(model), (error,), parts=parts) for model, error in zip(models, errors, strict=True)]


def codes(found, name):
    return [each["code"] for each in found.reasons.get(name, [])]


def test_probes_stay_within_the_range_of_the_record():
    known = record(many())
    assert len(Probes(known).records) == 3
    for each in Probes(known).records:
        u = each.input[-SAMPLES:]
        middle, half = (0.5 * (known.input.max() + sign * known.input.min()) for sign in (1, -1))
        assert np.abs(u - middle).max() <= LOWER * half * (1 + 1e-9)
        assert np.ptp(u) > 0.5 * LOWER * np.ptp(known.input)
        np.testing.assert_array_equal(each.input[:BEGUN], known.input[:BEGUN])


def test_two_levels_do_not_tell_a_straight_line_from_a_curve():
    known = record(binary())
    assert few_levels(known) == 2
    found = Undetermined.of(ranking(known, straight(), bent()), known)
    assert found.straight == {"straight"}
    assert codes(found, "straight") == ["another-differs", "few-levels"]
    assert codes(found, "bent") == ["another-differs", "few-levels"]
    assert {each["other"] for some in found.reasons.values() for each in some if "other" in each} == {
        "straight",
        "bent",
    }
    assert codes(Undetermined.of(ranking(known, straight()), known), "straight") == ["few-levels"]
    assert codes(Undetermined.of(ranking(known, bent()), known), "bent") == ["few-levels"]
    assert codes(Undetermined.of(ranking(known, straight(), bent()), known, {"bent"}), "straight") == ["few-levels"]


def test_three_levels_tell_a_straight_line_from_a_curve_but_not_which_curve():
    known = record(np.repeat(np.random.default_rng(2).integers(-1, 2, 200).astype(float), 10))
    assert few_levels(known) == 3
    assert codes(Undetermined.of(ranking(known, straight()), known), "straight") == []
    assert codes(Undetermined.of(ranking(known, bent()), known), "bent") == ["few-levels"]


def test_the_best_model_of_a_two_level_record_is_named_and_not_recommended():
    result = emsid.identify(record(binary()), models="arx,output-error")
    first = result.recommendation[0]
    assert first.code == "best-not-recommended"
    assert "the input has 2 levels" in sentence(first)
    assert (result.is_usable, result.is_recommended) == (True, False)
    assert "model-supported" not in {each.code for each in result.model_verdicts}


def test_many_levels_do():
    known = record(many())
    assert few_levels(known) is None
    found = Undetermined.of(ranking(known, straight(), bent()), known)
    assert codes(found, "straight") == []  # the other one is far worse on these data
    assert codes(found, "bent") == ["another-differs"]  # a better one differs
    same = Undetermined.of(ranking(known, straight(), straight("alike", POLE + 1e-3)), known)
    assert same.reasons == {}


def test_frequencies_that_the_input_lacks_are_not_known():
    """On a slow input a filter is like its gain alone; on a faster one it is not."""
    known = record(np.sin(2 * np.pi * np.arange(1800) / 1800), noise=0.1)
    at_once = emsid.Cascade((Rational([1.0], [], 1),), name="at once")
    assert codes(Undetermined.of(ranking(known, straight()), known), "straight") == []
    assert codes(Undetermined.of(ranking(known, straight(), at_once), known), "straight") == ["another-differs"]


def test_fits_to_parts_that_differ_are_a_limit():
    """A part that lacks a quarter: the doubled standard error is 2·√3 times the difference."""
    known = record(many())
    (one,) = ranking(known, straight())
    error = float(np.sqrt(one.errors.mean)) * float(np.std(known.output))
    for change, limited in ((1.0005, False), (1.2, True)):
        part = emsid.Cascade((Rational([change * (1 - POLE)], [-POLE], 1),), name="straight")
        found = Undetermined.of(ranking(known, straight(), parts=((0.25, part),) * 4), known)
        assert codes(found, "straight") == ["parts-differ"] * limited
    ((reason,),) = found.reasons.values()
    runs = [each.simulate(probe).output[-SAMPLES:] for probe in Probes(known).records for each in (straight(), part)]
    most = max(float(np.sqrt(np.mean((a - b) ** 2))) for a, b in zip(runs[::2], runs[1::2], strict=True))
    assert reason["times"] == pytest.approx(2 * np.sqrt(3) * most / error, rel=0.05)
    assert reason["times"] > LARGEST


def test_a_linear_model_is_the_best_for_two_levels_and_none_is_supported():
    result = emsid.identify(record(binary()), models="output-error,friction-narx")
    assert result.chosen.model.name == "output-error"
    assert "model-supported" not in {verdict.code for verdict in result.model_verdicts}


# --- loops -----------------------------------------------------------------------------------------------------------


def levitated(seed=0, samples=1500, noise=0.002):
    """x″ = 1600 x − 30 u with a controller that holds it: without it, an error grows by 1.14 in a sample."""
    rng, dt = np.random.default_rng(seed), 0.00325
    x = v = 0.0
    u, y = np.zeros(samples), np.zeros(samples)
    reference = 0.05 * lfilter([0.05], [1, -0.95], rng.standard_normal(samples)) / 0.16
    before = 0.0
    for t in range(samples):
        y[t] = x + noise * 0.01 * rng.standard_normal()
        error = y[t] - reference[t]
        u[t] = 110.0 * error + 2.6 * (error - before) / dt + 0.3 * rng.standard_normal()
        before = error
        for _ in range(20):
            v += dt / 20 * (1600.0 * x - 30.0 * u[t])
            x += dt / 20 * v
    return emsid.Record(u, y, dt, name="levitation")


def test_a_plant_that_is_unstable_without_its_controller_is_detected():
    known = levitated()
    assert np.abs(known.output).max() < 10
    assert unstable_pole(known) == pytest.approx(np.exp(40 * known.dt), rel=0.02)
    assert horizon_of(1.13) == 9
    assert unstable_pole(record(many())) is None
    walk = np.cumsum(record(many()).output)  # a pole at 1 is no such plant
    assert unstable_pole(emsid.Record(many(), walk + 0.01 * np.random.default_rng(3).standard_normal(800), DT)) is None


def test_models_of_it_are_ranked_by_predictions():
    result = emsid.identify(levitated(), models="arx,output-error")
    (said,) = [finding for finding in result.findings if finding.code == "unstable-in-loop"]
    assert said.data["horizon"] == horizon_of(said.data["pole"])
    assert result.chosen.model.name == "arx"
    below, above = result.chosen.model.linear_part()
    assert np.abs(np.roots(below)).max() > 1.1
    assert np.sum(above) < 0  # more input lowers the output
    verdicts = {verdict.data["model"]: verdict for verdict in result.model_verdicts}
    assert verdicts["arx"].code == "model-limited"
    for assessment in result.on_unseen.assessments:
        if assessment.row.diverged_at is None:
            assert verdicts[assessment.row.model].code == "model-unusable"
    why, then = result.recommendation
    assert why.data["ahead"] == said.data["horizon"]
    assert then.data["kind"] == "test-signal"
    assert not {step.code for step in result.next_steps} & {"next-reduce-noise", "next-check-data"}


def test_the_first_line_says_that_it_is_unstable_and_no_line_gives_a_gain_or_a_time_constant(run, tmp_path):
    known, log = levitated(seed=1), tmp_path / "levitation.csv"
    columns = np.column_stack([known.time, known.input, known.output])
    np.savetxt(log, columns, delimiter=",", header="t,u,y", comments="")
    words = ("--input", "u", "--output", "y", "--time", "t", "--models", "arx,output-error", "--details")
    status, printed, _ = run("identify", log, *words, "--out", tmp_path / "out")
    assert status == 0
    first, second = printed.splitlines()[:2]
    assert first.startswith("the plant is unstable without its controller (a pole of 1.14 per sample)")
    assert second.startswith("Recommended: arx, ")
    data = json.loads((tmp_path / "out" / "result.json").read_text())
    assert data["characteristics"] == []
    assert "unstable-in-loop" in [each["code"] for each in data["findings"]]
    page = (tmp_path / "out" / "report.html").read_text()
    assert not re.search(r"\bgain\b|time constant", printed)
    assert not re.search(r">\s*gain\s*<|time constant", page)  # cells of a table; a caption explains what gains do


# --- models that explain little --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["future", "walk"])
def test_what_the_input_does_not_move_is_described_by_no_model(kind):
    rng = np.random.default_rng(4)
    u = rng.standard_normal(600)
    y = np.r_[u[3:], 0, 0, 0] if kind == "future" else np.cumsum(rng.standard_normal(600))
    result = emsid.identify(emsid.Record(u, y, DT, name=kind), models="arx,friction-narx")
    assert result.recommendation[0].code == "no-model-recommended"
    assert {verdict.code for verdict in result.model_verdicts} == {"model-unusable"}


def test_a_right_model_under_much_noise_is_not_weak():
    known, unseen = (record(many(seed), seed, noise=0.6) for seed in (0, 1))
    on_unseen = compare([straight()], unseen)
    assert 0 < on_unseen.rows[0].fit_percent < 29
    apart = {"straight": [{"code": "parts-differ", "times": 2.0}]}
    assert [is_weak(on_unseen.best, some) for some in ({}, apart)] == [False, True]
    (verdict,) = model_verdicts(compare([straight()], known), on_unseen, (), apart)
    assert verdict.code == "model-unusable"


# --- an input that explains nothing ----------------------------------------------------------------------------------


def verdict_on(numerator, denominator, known, unseen):
    model = emsid.Cascade((Rational(numerator, denominator, 1),), name="model")
    return model_verdicts(compare([model], known, data="identification"), compare([model], unseen), ())[0]


def oscillating(seed, samples=1600):
    """sin(2π·0.7·t) beside an unrelated input."""
    y = np.sin(2 * np.pi * 0.7 * DT * np.arange(samples) + seed)
    return emsid.Record(
        binary(seed, samples), y + NOISE * np.random.default_rng([2, seed]).standard_normal(samples), DT
    )


def test_a_model_that_oscillates_by_itself_is_not_usable():
    """Its small response to the input makes it neither better nor worse."""
    verdict = verdict_on([1e-6], [-2 * np.cos(2 * np.pi * 0.7 * DT), 1.0], oscillating(0), oscillating(1))
    assert verdict.code == "model-unusable"
    (reason,) = verdict.data["reasons"]
    assert reason["code"] == "input-explains-nothing"
    assert reason["shuffled"] == pytest.approx(1.0, abs=0.1)
    assert reason["held"] == pytest.approx(1.0, abs=0.1)


def test_the_first_sentence_says_that_the_input_explains_nothing(run, tmp_path):
    rng, log = np.random.default_rng(1), tmp_path / "drift.csv"
    t = DT * np.arange(1200)
    columns = np.column_stack([t, binary(2, 1200), t / 4 + 0.01 * rng.standard_normal(1200)])
    np.savetxt(log, columns, delimiter=",", header="t,u,y", comments="")
    words = ("--input", "u", "--output", "y", "--time", "t", "--models", "arx")
    status, printed, _ = run("identify", log, *words, "--out", tmp_path / "out")
    assert status == 0
    assert printed.startswith("the input explains nothing of y")
    data = json.loads((tmp_path / "out" / "result.json").read_text())
    assert data["findings"][0]["code"] == "input-explains-nothing"
    assert data["recommendation"][0]["code"] == "no-model-recommended"
    assert data["recommendation"][0]["data"]["reasons"][0]["code"] == "input-explains-nothing"
    assert "the input explains nothing of y" in (tmp_path / "out" / "report.html").read_text()


N = 1600
BY_INPUT = {
    "many levels": (many(5, N), 0.02),
    "much noise": (many(5, N), 0.6),
    "sine": (np.sin(2 * np.pi * np.arange(N) / 200), 0.02),  # a whole number of periods in any eighth
    "square wave": (np.sign(np.sin(2 * np.pi * (np.arange(N) + 0.5) / 200)), 0.02),
    "one step": (np.repeat([0.0, 1.0], N // 2), 0.02),
    "rest after a third": (many(5, N) * (np.arange(N) < N / 3), 0.02),
    "offset": (3 + 0.2 * many(5, N), 0.02),
}


@pytest.mark.parametrize("kind", BY_INPUT)
def test_an_input_that_moves_the_output_is_no_reason_against_a_model(kind):
    u, noise = BY_INPUT[kind]
    known, unseen = (record(u, seed, noise=noise) for seed in (0, 1))
    verdict = verdict_on([1 - POLE], [-POLE], known, unseen)
    assert "input-explains-nothing" not in [each["code"] for each in verdict.data["reasons"]]
    assert verdict.code != "model-unusable"


def test_segments_with_a_constant_input_each_are_explained_by_it():
    levels = [emsid.Record(np.full(100, u), filtered(np.full(100, u)) + NOISE, DT) for u in (0.5, 1.0, -1.0, 2.0)]
    several = emsid.concatenate(levels)
    assert verdict_on([1 - POLE], [-POLE], several, several).code != "model-unusable"


@pytest.mark.parametrize("kind", ["friction", "axis", "slow", "closed loop"])
def test_plants_of_every_kind_pass_with_a_model_that_is_nearly_right(kind):
    """A motor with Coulomb friction, its position, a time constant of half the record, and a controlled speed."""
    rng, u = np.random.default_rng(6), np.repeat(np.random.default_rng(7).uniform(-6, 6, N // 40), 40)
    pole = np.exp(-2 / N) if kind == "slow" else 0.95
    speed, y = np.zeros(N), np.zeros(N)
    for k in range(1, N):
        if kind == "closed loop":
            u[k - 1] = 4 * (np.sign(np.sin(k / 60)) - speed[k - 1]) + 0.2 * rng.standard_normal()
        friction = 0.3 * np.sign(speed[k - 1]) if kind == "friction" else 0.0
        speed[k] = pole * speed[k - 1] + (1 - pole) * (u[k - 1] - friction)
        y[k] = y[k - 1] + DT * speed[k - 1]
    output = y if kind == "axis" else speed
    noisy = emsid.Record(u, output + 0.02 * np.std(output) * rng.standard_normal(N), DT)
    found = emsid.identify(noisy, models="output-error,arx")
    assert found.is_usable
    assert "input-explains-nothing" not in {each.code for each in found.findings}
