"""One rule for 'better by more than noise', and one policy for holding data back."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

import emsid
from emsid import Cascade, Narx, Record, arx, concatenate
from emsid.models.blocks.filters import Rational
from emsid.models.free_run import free_run_error, mean_squared_error
from emsid.record import hold_back
from emsid.record.holding_back import FOLDS, hold_back_records, validation_splits
from emsid.selection.improvement import Gain, as_good, better

SOURCES = Path(emsid.__file__).parent


@pytest.mark.parametrize("gain", Gain)
def test_only_more_than_the_gain_counts(gain: Gain) -> None:
    edge = 1.0 - gain.value
    assert better(0.999 * edge, 1.0, gain)
    assert not better(1.001 * edge, 1.0, gain)
    assert as_good(1.0, 1.001 * edge, gain)
    assert not as_good(1.0, 0.999 * edge, gain)


def test_a_model_that_diverges_is_worse_than_any_other() -> None:
    assert better(1.0, np.inf, Gain.PLANT)
    assert not better(np.inf, 1.0, Gain.PLANT)
    assert as_good(np.inf, np.inf, Gain.REGRESSION)
    assert not as_good(np.inf, 1.0, Gain.REGRESSION)


def test_the_three_thresholds_have_their_values() -> None:
    assert 1 / (1 - Gain.REGRESSION.value) == pytest.approx(1.01)
    assert np.sqrt(1 - Gain.CASCADE.value) == pytest.approx(0.98)
    assert Gain.PLANT.value == 0.1


def test_every_kind_of_model_is_chosen_by_this_rule() -> None:
    users = {
        path.relative_to(SOURCES).as_posix()
        for path in SOURCES.rglob("*.py")
        if "improvement import" in path.read_text()
    }
    assert {
        "selection/coordinate_search.py",
        "models/blocks/search/choice.py",
        "models/plants/search/choice.py",
    } <= users
    assigned = {
        target.id
        for path in SOURCES.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
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
    model = Narx(arx(1, 1), np.array([-0.5, 1.0]), 0.1)
    records = [Record(rng.standard_normal(n), rng.standard_normal(n), 0.1) for n in (40, 70)]
    runs = [model.simulate(record, 5) for record in records]
    errors = np.concatenate([(record.output - run.output)[5:] for record, run in zip(records, runs, strict=True)])
    assert free_run_error(model, records, 5) == pytest.approx(np.mean(errors**2), rel=1e-14)
    assert free_run_error(model, records[:1], 40) == np.inf
    assert free_run_error(Narx(arx(1, 1), np.array([-3.0, 1.0]), 0.1), records) == np.inf
    still = Cascade((Rational([0.0]),))
    assert free_run_error(still, records[:1]) == mean_squared_error(records[0].output, np.zeros((40, 1)))
