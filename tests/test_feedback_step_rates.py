"""Feedback models with more steps per sample: their start, and when the search takes them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import emsid
from emsid import FeedbackModel, ModelError, Record
from emsid.estimation.nonlinear.control import FREE
from emsid.models.blocks.search.map_families import family_of
from emsid.models.blocks.static_maps import Polynomial
from emsid.models.feedback.search.moves import _doubled, more_steps, with_map_more
from emsid.models.feedback.search.starts import with_steps_doubled
from emsid.models.feedback.search.trials import FeedbackSearch, SearchData, Steps
from feedback_models import Array
from independent.nonlinear_systems import duffing

SPRING = Polynomial(np.array([0.0, 0.6, 0.0, 0.4]))  # z³


def spring(rate: int, stiffness: float = 0.1) -> FeedbackModel:
    """A mass on a spring with a cubic part, 12 samples per period, with exact steps for held inputs."""
    a = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, -0.3, 1.0, -stiffness], [0.0] * 4, [0.0] * 4])
    step = expm(a * 2 * np.pi / 12 / rate)[:2]
    matrix = np.vstack([step, [1, 0, 0, 0], [1, 0, 0, 0]])
    return FeedbackModel(matrix, (SPRING,), oversampling=rate, held=True, dt=0.1)


def signal(seed: int, samples: int = 1200) -> Array:
    return 0.5 * np.repeat(np.random.default_rng(seed).normal(size=samples // 4), 4)


def test_twice_the_steps_are_the_exact_steps_for_held_inputs() -> None:
    for rate in (1, 2):
        np.testing.assert_allclose(with_steps_doubled(spring(rate), True).matrix, spring(2 * rate).matrix, atol=1e-12)


def test_twice_the_steps_change_a_linear_model_with_held_input_by_nothing() -> None:
    model, u = spring(1, 0.0), signal(1)
    again = with_steps_doubled(model, True)
    np.testing.assert_allclose(again.output(u, np.zeros(2)), model.output(u, np.zeros(2)), atol=1e-10)


def test_a_negative_pole_has_no_model_with_twice_the_steps() -> None:
    model = FeedbackModel(np.array([[-0.5, 1.0], [1.0, 0.0]]))
    with pytest.raises(ModelError, match="a pole that no faster model has"):
        with_steps_doubled(model, True)


def measured(rate: int, noise: float) -> list[Record]:
    """Two records of the spring, with noise as a part of the output's standard deviation."""
    truth, records = spring(rate), []
    for seed in (1, 2):
        u = signal(seed, 4800)
        y = truth.output(u, np.zeros(2))
        records.append(Record(u, y + noise * np.std(y) * np.random.default_rng(seed + 9).normal(size=len(y)), 0.1))
    return records


@pytest.mark.parametrize(("rate", "least"), [(4, 4), (1, 1)])
def test_steps_are_doubled_as_long_as_that_lowers_the_errors(rate: int, least: int) -> None:
    records = measured(rate, 0.0003)
    data = SearchData.of(records, FeedbackSearch(), FREE)
    begun = data.refined(spring(1), None, family_of("polynomial"), 3)
    found = [begun, *_doubled(data, begun, FeedbackSearch(held=True))]
    assert [each.found.model.oversampling for each in found[:2]] == ([1, 2] if rate > 1 else [1])
    assert found[-1].found.model.oversampling >= least
    assert list(more_steps(data, begun, FeedbackSearch(oversampling=1))) == []
    if rate == 1:
        assert len(found) == 1


def test_more_steps_are_tried_with_a_lower_order() -> None:
    """A higher order makes up for missing steps; with two steps the lower order is not yet better."""
    data = SearchData.of(measured(8, 0.0001)[:1], FeedbackSearch(), FREE)
    high = data.refined(with_map(data, 3), None, family_of("polynomial"), 3)
    tried = [step for step in more_steps(data, high, FeedbackSearch(held=True)) if step.found.model.states == 2]
    assert [each.found.model.oversampling for each in tried[:2]] == [2, 4]
    assert tried[-1].found.error < 0.9 * tried[0].found.error
    assert data.prefers(tried[-1], high)


def with_map(data: SearchData, order: int) -> FeedbackModel:
    """A model of this order with a cubic map and one step per sample."""
    return with_map_more(data, data.linear(order, Steps(1, True), 0), family_of("polynomial"), 3).found.model


def test_a_strong_spring_is_right_on_a_sweep_that_no_fit_has_seen() -> None:
    """With two steps per sample and free directions it has 1.5 times the noise there, with noise only on others."""
    system = duffing(2048, seed=1, noise=0.01)
    fit = emsid.fit(emsid.feedback(order=2, delay=0), system.fitted)
    sweep = system.unseen["growing sweep"]
    assert emsid.compare([fit], sweep).best.row.simulation_rmse < 1.2 * system.noise
