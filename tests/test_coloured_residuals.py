"""Covariances under coloured noise against the spread of estimates in repeated experiments."""

from __future__ import annotations

import numpy as np
import pytest

from emsid.estimation.uncertainty.coloured_residuals import colour, coloured_covariance, whitened_robust_covariance

SAMPLES, EXPERIMENTS = 400, 200
SLOW = np.column_stack([np.sin(np.arange(SAMPLES) / 40 + phase) for phase in (0.0, 1.0)])
"""(N, 2) derivatives of two parameters of a slow model."""


def differences(rng: np.random.Generator) -> np.ndarray:
    """(N,) what rounding of counts does to their differences."""
    return np.diff(rng.uniform(-0.5, 0.5, SAMPLES + 1))


def residual_of(noise: np.ndarray) -> np.ndarray:
    return noise - SLOW @ np.linalg.lstsq(SLOW, noise)[0]


def test_the_noise_of_differences_has_a_zero_near_one():
    rng = np.random.default_rng(0)
    zeros = [colour([(residual_of(differences(rng)), SLOW)]).zero for _ in range(20)]
    assert min(zeros) >= 0.95
    assert [colour([(residual_of(rng.standard_normal(SAMPLES)), SLOW)]).zero for _ in range(20)].count(0.0) >= 18
    assert whitened_robust_covariance([(rng.standard_normal(SAMPLES), SLOW)]) is None


@pytest.mark.parametrize("estimate", [coloured_covariance, whitened_robust_covariance])
def test_the_covariance_under_the_noise_of_differences_is_that_of_repeated_experiments(estimate):
    rng = np.random.default_rng(1)
    noises = [differences(rng) for _ in range(EXPERIMENTS)]
    estimates = np.array([np.linalg.lstsq(SLOW, noise)[0] for noise in noises])
    found = np.mean([np.diag(estimate([(residual_of(noise), SLOW)])) for noise in noises[:40]], axis=0)
    ratio = np.sqrt(found / np.var(estimates, axis=0))
    assert np.all(ratio > 0.9)
    assert np.all(ratio < 1.6)  # a zero of 0.98 where it is one
    white = np.sqrt(np.diag(np.linalg.inv(SLOW.T @ SLOW)) / 6)
    assert np.all(np.sqrt(found) < white / 4)


def test_what_was_before_the_first_sample_counts():
    """A constant under differences is known from the first and the last count alone."""
    noise = np.diff(np.random.default_rng(2).standard_normal(SAMPLES + 1))
    constant = np.ones((SAMPLES, 1))
    assert colour([(noise, constant)]).zero == 1.0
    error = float(np.sqrt(coloured_covariance([(noise, constant)])[0, 0])) * SAMPLES
    assert error == pytest.approx(np.sqrt(2), rel=0.2)


def test_what_a_fit_takes_from_low_frequencies_is_no_zero():
    """Ten slow parameters leave white noise without low frequencies."""
    rng, slow = np.random.default_rng(3), np.polynomial.legendre.legvander(np.linspace(-1, 1, 100), 9)
    noises = [rng.standard_normal(100) for _ in range(40)]
    residuals = [noise - slow @ np.linalg.lstsq(slow, noise)[0] for noise in noises]
    assert [colour([(residual, slow)]).zero for residual in residuals].count(0.0) >= 36
