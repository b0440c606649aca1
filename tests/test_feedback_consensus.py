"""Feedback models that a short record does not tell apart: the choice of the one that agrees with the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import emsid
from emsid import Record
from emsid.models.blocks.static_maps import Polynomial
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search import choice
from emsid.models.feedback.search.consensus import agreeing
from emsid.models.feedback.search.trials import Trial, error_of_use
from emsid.models.one_channel import segments_longer_than
from emsid.record import concatenate
from feedback_models import X, begun_trial, loop
from model_examples import DT

RECORD, BEGUN = begun_trial(400)


def bench(*records: Record, useless: Sequence[Trial] = ()) -> Any:
    """The data of these records, and models that are of no use from the initial states that a user knows."""
    return SimpleNamespace(
        segments=lambda model: segments_longer_than(model.memory, model, records),
        is_of_use=lambda trial: trial not in useless,
    )


def trial(cubic: float, error: float) -> Trial:
    """A trial of the loop with another cubic term, and with residuals that are multiplied by a factor."""
    model, minimum = BEGUN.found.model, BEGUN.found.minimum
    bent = model.maps[0].parameters + np.array([0.0, 0.0, 0.0, cubic])
    scaled = replace(
        minimum,
        residuals=[error * each for each in minimum.residuals],
        noise_variance=error**2 * minimum.noise_variance,
    )
    return replace(BEGUN, found=replace(BEGUN.found, model=replace(model, maps=(Polynomial(bent),)), minimum=scaled))


@pytest.mark.parametrize(("alone", "chosen"), [(0.995, 1), (0.9, 0)])
def test_a_model_that_is_alone_is_chosen_only_where_it_fits_far_better(alone: float, chosen: int) -> None:
    trials = [trial(-0.08, alone), *(trial(each, 1.0) for each in (-0.05, -0.051, -0.049, -0.048))]
    assert agreeing(bench(RECORD), trials, trials[0]) is trials[chosen]


def test_the_order_of_the_models_does_not_matter() -> None:
    trials = [trial(cubic, 1 + abs(cubic + 0.05)) for cubic in (-0.08, -0.05, -0.051, -0.049, -0.048)]
    found = {id(agreeing(bench(RECORD), order, trials[2])) for order in (trials, trials[::-1], trials[2:] + trials[:2])}
    assert len(found) == 1


def test_models_of_no_use_take_no_part_if_there_are_others() -> None:
    trials = [trial(each, 1.0) for each in (-0.05, -0.051, -0.049, -0.048)]
    assert agreeing(bench(RECORD, useless=trials[:3]), trials, trials[0]) is trials[3]
    assert agreeing(bench(RECORD, useless=trials), trials, trials[0]) is agreeing(bench(RECORD), trials, trials[0])


def test_the_error_of_use_begins_at_states_that_the_first_samples_show() -> None:
    matrix = np.diag([0.9, 0.99999, 0.0])
    matrix[0, 2], matrix[2, :2] = 1.0, [0.05, 1e-4]
    model, u = FeedbackModel(matrix, dt=DT), np.random.default_rng(5).normal(size=2000)
    y = model.output(u, np.array([0.0, 1.0]))
    noisy = y + 0.1 * np.random.default_rng(6).normal(size=len(u))
    assert error_of_use(model, [(u, noisy)]) < 0.15
    steep = FeedbackModel(np.array([[1.2, 0.5], [1.0, 0.0]]), dt=DT)
    assert error_of_use(steep, [(u, noisy)]) == np.inf
    away = replace(model, matrix=matrix * np.array([[1], [1], [1e3]]))
    assert error_of_use(away, [(u, noisy)]) > 10


def test_one_model_is_the_choice() -> None:
    assert agreeing(bench(RECORD), [BEGUN], BEGUN) is BEGUN


def test_models_are_compared_on_segments_that_all_of_them_have() -> None:
    """One of first order starts in segments that are too short for one of second order."""
    short, model = RECORD[:12], loop()
    both = concatenate([short, RECORD])
    first = FeedbackModel(np.array([[0.5, 0.4], [1.0, 0.0]]), dt=DT)
    smaller = replace(BEGUN, found=replace(BEGUN.found, model=first, states=[np.zeros(1), np.zeros(1)]))
    assert model.memory > len(short) > first.memory
    assert agreeing(bench(both), [smaller, BEGUN], BEGUN) in (smaller, BEGUN)


def test_a_given_number_of_maps_is_kept_though_one_is_enough() -> None:
    truth, rng = loop(), np.random.default_rng(2)
    u = rng.normal(size=400)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    search = emsid.feedback(2, maps=2, static="polynomial", delay=0, oversampling=1)
    assert len(emsid.fit(search, record).model.maps) == 2


def test_a_model_with_another_number_of_maps_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, rng = loop(), np.random.default_rng(2)
    u = rng.normal(size=400)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    search = emsid.feedback(2, maps=1, delay=0, oversampling=1)
    assert "other-number-of-maps" not in codes(emsid.fit(search, record))
    monkeypatch.setattr(choice.Contest, "continued", property(lambda self: []))  # as if all others ran away
    fit = emsid.fit(emsid.feedback(2, maps=2, delay=0, oversampling=1), record)
    assert len(fit.model.maps) == 1
    assert "other-number-of-maps" in codes(fit)


def codes(fit: emsid.Fit[emsid.FeedbackModel]) -> list[str]:
    return [each.code for each in fit.findings]
