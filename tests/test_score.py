"""The score of further parameters: what they promise, and whether chance explains it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import kstest

from emsid.models.search.score import Score

SAMPLES = 1000


def problem(rng, pole=0.0, columns=3):
    """Noise and the residual of a linear fit to it, its derivatives, and one of a further parameter."""
    jacobian, added = rng.standard_normal((SAMPLES, columns)), np.cumsum(rng.standard_normal((SAMPLES, 1)), axis=0)
    noise = lfilter([1.0], [1.0, -pole], rng.standard_normal(SAMPLES + 200))[200:]
    left = noise - jacobian @ np.linalg.lstsq(jacobian, noise)[0]
    return jacobian, added, left


def test_of_a_linear_model_the_promise_is_what_the_refit_gains():
    jacobian, added, left = problem(np.random.default_rng(0))
    left = left + 0.05 * (added - jacobian @ np.linalg.lstsq(jacobian, added)[0])[:, 0]
    promise = Score([left[:150], left[150:]], [jacobian[:150], jacobian[150:]], [0, 0]).promise(
        [added[:150], added[150:]]
    )
    whole = np.column_stack([jacobian, added])
    refit = np.linalg.lstsq(whole, -left)[0]
    gained = 1 - np.sum((left + whole @ refit) ** 2) / np.sum(left**2)
    assert promise.share == pytest.approx(gained, rel=1e-9)
    assert promise.step[0] == pytest.approx(refit[-1], rel=1e-6)
    assert promise.chance < 1e-6


def test_a_parameter_with_the_effect_of_others_promises_nothing():
    jacobian, _, left = problem(np.random.default_rng(1))
    for same in (jacobian @ np.ones((3, 1)), np.zeros((SAMPLES, 1))):
        promise = Score([left], [jacobian], [0]).promise([same])
        assert (promise.share, promise.chance) == (0.0, 1.0)


def test_a_step_beyond_a_bound_promises_what_the_bound_allows():
    jacobian, added, left = problem(np.random.default_rng(2))
    left = left + 0.05 * added[:, 0]
    score = Score([left], [jacobian], [0])
    free, half, none = (score.promise([added], low, high) for low, high in ((-1.0, 1.0), (-0.02, 1.0), (0.0, np.inf)))
    assert free.step[0] < -0.04
    assert half.step[0] == pytest.approx(-0.02)
    assert 0 < half.share < free.share
    assert none.share == 0.0


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_the_chance_is_uniform_under_noise_of_any_colour(pole):
    rng = np.random.default_rng(3)
    chances = []
    for _ in range(200):
        jacobian, added, left = problem(rng, pole)
        chances.append(Score([left], [jacobian], [0]).promise([added], least=-1.0).chance)
    assert np.mean(np.array(chances) < 0.01) < 0.04  # of the two covariances the larger one counts
    assert kstest(chances, "uniform").statistic < 0.25
