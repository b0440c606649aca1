"""One rule for 'better by more than noise', and one policy for holding data back."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid import Cascade, Record, RegressionModel, arx, concatenate
from emsid.models.blocks.filters import Rational
from emsid.models.free_run import free_run_error, mean_squared_error
from emsid.record import hold_back
from emsid.record.holding_back import FOLDS, LEAST_PART, choice_and_headline, hold_back_records, validation_splits
from emsid.selection.improvement import CHANCE, NEGLIGIBLE, StretchErrors, better, better_by_ratio, equivalent, simplest
from source_tree import nodes_of

SOURCES = Path(emsid.__file__).parent


def coloured(rng: np.random.Generator, samples: int, pole: float) -> np.ndarray:
    """Noise of variance 1 with this pole."""
    return lfilter([np.sqrt(1 - pole**2)], [1, -pole], rng.standard_normal(samples))


@pytest.mark.parametrize("pole", [0.0, 0.9, 0.99])
def test_models_of_equal_merit_are_called_better_as_rarely_as_stated(pole: float) -> None:
    """Two models whose errors share the noise of the output and differ by their own deviations of equal size."""
    rng, trials, passed = np.random.default_rng(1), 2000, np.zeros(2)
    for _ in range(trials):
        noise, *own = (coloured(rng, 3200, pole) for _ in range(3))
        one, other = (StretchErrors.of((noise + each) ** 2) for each in own)
        passed += better(one, other), better_by_ratio(one, other)
    assert np.all(passed / trials <= CHANCE + 2.5 * np.sqrt(CHANCE * (1 - CHANCE) / trials))


def test_a_small_gain_that_lasts_is_found_and_a_large_one_of_a_moment_is_not() -> None:
    rng = np.random.default_rng(2)
    noise, extra = rng.standard_normal((2, 16_000))
    simple = StretchErrors.of((noise + 0.25 * extra) ** 2)
    assert better(StretchErrors.of(noise**2), simple)  # 6 % of the mean square, everywhere
    shock = np.zeros(16_000)
    shock[7000:7100] = 5.0
    assert StretchErrors.of((noise + shock) ** 2).mean > 1.1 * StretchErrors.of(noise**2).mean
    assert not better(StretchErrors.of(noise**2), StretchErrors.of((noise + shock) ** 2))


def test_a_negligible_gain_does_not_count_however_sure_it_is() -> None:
    flat = np.ones(1600)
    assert better(StretchErrors.of((1 - 1.01 * NEGLIGIBLE) * flat), StretchErrors.of(flat))
    assert not better(StretchErrors.of((1 - 0.99 * NEGLIGIBLE) * flat), StretchErrors.of(flat))


def test_the_unit_of_the_output_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    one, other = rng.standard_normal((2, 400)) ** 2
    for scale in (1.0, 0.8, 0.6):
        answers = {better(StretchErrors.of(k * scale * one), StretchErrors.of(k * other)) for k in (1e-12, 1.0, 1e12)}
        assert len(answers) == 1


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_a_model_exact_at_standstill_is_not_better_by_rounding(unit: float) -> None:
    """Over twelve stretches of motion and four of standstill, where one model is exact and the other rounds."""
    samples, standstill = np.full(16, 100.0), np.arange(16) >= 12
    rounds, exact = (StretchErrors(unit * np.where(standstill, rest, 1.0), samples) for rest in (1e-30, 0.0))
    assert equivalent(rounds, exact)
    assert equivalent(exact, rounds)
    worse = StretchErrors(2.0 * exact.means, samples)
    assert better_by_ratio(rounds, worse)
    assert not better_by_ratio(worse, rounds)
    creeps = StretchErrors(unit * np.where(standstill, 0.01, 1.0), samples)  # a tenth of its error in motion
    assert not equivalent(creeps, exact)
    perfect = StretchErrors(np.zeros(16), samples)
    assert better_by_ratio(perfect, exact)
    assert equivalent(perfect, perfect)


def test_samples_of_a_transient_do_not_count() -> None:
    squares = np.array([np.nan] * 300 + [4.0] * 100 + [1.0] * 400)
    errors = StretchErrors.of(squares)
    assert errors.mean == pytest.approx(1.6)
    assert errors.samples.sum() == 500
    longer = StretchErrors.of(np.where(np.arange(800) < 400, np.nan, 0.5 * squares))
    assert longer.mean == 0.5
    assert better(longer, errors)  # of the stretches that both have
    joined = StretchErrors.joined([errors, longer])
    assert joined.mean == pytest.approx((500 * 1.6 + 400 * 0.5) / 900)


def test_a_model_that_diverges_is_worse_than_any_other() -> None:
    fine, lost = StretchErrors.of(np.ones(100)), StretchErrors.of(np.where(np.arange(100) > 90, np.inf, 1.0))
    assert better(fine, lost)
    assert not better(lost, fine)
    assert not better(lost, lost)


def test_every_kind_of_model_is_chosen_by_this_rule() -> None:
    users = {
        path.relative_to(SOURCES).as_posix()
        for path in SOURCES.rglob("*.py")
        if "improvement import" in path.read_text()
    }
    assert {
        "identification/regressions.py",
        "models/blocks/search/choice.py",
        "models/plants/search/choice.py",
    } <= users
    assigned = {
        target.id
        for path in SOURCES.rglob("*.py")
        for node in nodes_of(path)
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    assert {"WORTH", "LEAST_GAIN"} & assigned == set()


def ramp(samples: int) -> Record:
    return Record(np.arange(samples), np.arange(samples), 0.1)


def test_the_end_of_one_record_is_unseen_and_every_third_of_many() -> None:
    train, test = hold_back_records([ramp(100)], 0.3)
    assert (len(train), len(test), test.name) == (70, 30, "record, unseen part")
    train, test = hold_back_records([ramp(10 + k) for k in range(6)], 0.3)
    assert [len(segment) for segment in train.segments] == [10, 11, 13, 14]
    assert [len(segment) for segment in test.segments] == [12, 15]
    assert test.name == "one in 3 of 6 records"


def test_long_unseen_data_are_divided_into_a_part_that_chooses_and_one_that_does_not() -> None:
    choice, headline = choice_and_headline(ramp(2 * LEAST_PART))
    assert choice.input[-1, 0] < headline.input[0, 0]
    assert len(choice) == len(headline) == LEAST_PART
    assert choice_and_headline(ramp(2 * LEAST_PART - 1)) is None
    series = concatenate([ramp(500) for _ in range(5)])
    assert choice_and_headline(series)[1].breaks == (500,)
    assert choice_and_headline(concatenate([ramp(1500), ramp(500)])) is None


def test_every_part_of_a_short_record_is_unseen_once() -> None:
    record = ramp(103)
    shown, judged = validation_splits([record], 0.25)
    assert shown == [record]
    assert len(judged) == FOLDS
    seen = np.concatenate([part.input[:, 0] for _, (part,) in judged])
    np.testing.assert_array_equal(seen, record.input[:, 0])
    for (rest,), (part,) in judged:
        assert not set(rest.input[:, 0]) & set(part.input[:, 0])
        assert len(rest) + len(part) == len(record)


def test_a_long_record_is_split_as_for_regressions_and_plants() -> None:
    series = concatenate([ramp(1000) for _ in range(8)])
    for record in (ramp(5000), series):
        _, [((known,), (unseen,))] = validation_splits([record], 0.25)
        first, last = hold_back(record, 0.25)
        np.testing.assert_array_equal(known.output, first.output)
        np.testing.assert_array_equal(unseen.output, last.output)


def test_a_free_run_error_covers_all_records_after_their_transients() -> None:
    rng = np.random.default_rng(0)
    model = RegressionModel(arx(1, 1), np.array([-0.5, 1.0]), 0.1)
    records = [Record(rng.standard_normal(n), rng.standard_normal(n), 0.1) for n in (40, 70)]
    runs = [model.simulate(record, 5) for record in records]
    errors = np.concatenate([(record.output - run.output)[5:] for record, run in zip(records, runs, strict=True)])
    assert free_run_error(model, records, 5) == pytest.approx(np.mean(errors**2), rel=1e-14)
    assert free_run_error(model, records[:1], 40) == np.inf
    assert free_run_error(RegressionModel(arx(1, 1), np.array([-3.0, 1.0]), 0.1), records) == np.inf
    still = Cascade((Rational([0.0]),))
    assert free_run_error(still, records[:1]) == mean_squared_error(records[0].output, np.zeros((40, 1)))


def test_the_simplest_model_has_no_smaller_one_with_a_smaller_error():
    class Of(NamedTuple):
        size: int
        errors: StretchErrors

    rng = np.random.default_rng(4)
    samples = np.full(16, 100.0)
    means = rng.uniform(0.9, 1.1, 16)
    best = Of(8, StretchErrors(means, samples))
    certain = Of(4, StretchErrors(1.05 * means, samples))  # worse by little, in every stretch
    uncertain = Of(6, StretchErrors(1.1 * means + np.tile([0.6, -0.6], 8), samples))  # worse by more, in half of them
    assert better(best.errors, certain.errors)
    assert not better(best.errors, uncertain.errors)
    assert simplest([best, uncertain], size=lambda each: each.size) is uncertain
    assert simplest([best, certain, uncertain], size=lambda each: each.size) is certain
