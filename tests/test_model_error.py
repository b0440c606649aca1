"""The covariance under model error: without model error, and for a known model error."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.uncertainty.coloured_residuals import coloured_covariance
from emsid.estimation.uncertainty.model_error import model_error_covariance, upper_bound

Array = NDArray[np.float64]
BOTH, NONE = np.arange(2), np.arange(0)


class Line:
    """r = a + b·x − y, linear in both."""

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y

    def residuals(self, theta: Array) -> list[Array]:
        return [theta[0] + theta[1] * self.x - self.y]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        return [(self.residuals(theta)[0], np.column_stack([np.ones_like(self.x), self.x]))]


class Power:
    """r = xᵃ − y: its second derivative meets a residual that does not average out."""

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y

    def residuals(self, theta: Array) -> list[Array]:
        return [self.x ** theta[0] - self.y]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        return [(self.residuals(theta)[0], (self.x ** theta[0] * np.log(self.x))[:, None])]


def test_upper_bound_is_above_both_and_no_more_than_their_sum() -> None:
    rng = np.random.default_rng(0)
    one, other = (m @ m.T for m in rng.standard_normal((2, 4, 4)))
    bound = upper_bound(one, other)
    for below in (one, other):
        assert np.linalg.eigvalsh(bound - below)[0] > -1e-12
    assert np.linalg.eigvalsh(one + other - bound)[0] > -1e-12
    np.testing.assert_allclose(upper_bound(one, 2 * one), 2 * one)
    np.testing.assert_allclose(upper_bound(one, 0.5 * one), one)
    np.testing.assert_array_equal(upper_bound(0 * one, other), other)


def test_with_white_noise_it_is_the_usual_covariance() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal(20_000)
    problem = Line(x, 1 + 2 * x + 0.3 * rng.standard_normal(len(x)))
    minimum = gauss_newton(problem, np.zeros(2))
    covariance = model_error_covariance(problem, minimum.estimate, BOTH, NONE, problem)
    np.testing.assert_allclose(np.diag(covariance), np.diag(minimum.white_covariance), rtol=0.05)
    (residual, jacobian), *_ = problem.linearised(minimum.estimate)
    plain = coloured_covariance([(residual, jacobian)])
    assert np.linalg.eigvalsh(covariance - plain)[0] > -1e-12
    own = model_error_covariance(problem, minimum.estimate, BOTH[1:], BOTH[:1], problem)
    assert own[0, 0] == pytest.approx(covariance[1, 1], rel=0.02)


def test_a_curved_truth_gives_the_computed_covariance() -> None:
    """No noise at all: 200 data sets of a square root with a step, fitted by a power."""
    rng = np.random.default_rng(2)
    estimates, errors, first_order = [], [], []
    for _ in range(200):
        x = rng.uniform(0.1, 2.0, 1000)
        problem = Power(x, np.sqrt(x) + 1.5 * (x > 1.8))
        minimum = gauss_newton(problem, np.array([0.5]), tolerance=1e-8)
        estimates.append(minimum.estimate[0])
        errors.append(model_error_covariance(problem, minimum.estimate, BOTH[:1], NONE, problem)[0, 0])
        first_order.append(minimum.white_covariance[0, 0])
    spread = np.var(estimates)
    assert np.mean(errors) == pytest.approx(spread, rel=0.15)
    assert abs(np.mean(first_order) / spread - 1) > 0.3


class TwoDecays:
    """r = exp(−a·x) + exp(−b·x) − y: for a near b what tells them apart is hardly more than its own curvature."""

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y

    def residuals(self, theta: Array) -> list[Array]:
        return [np.exp(-np.outer(theta, self.x)).sum(axis=0) - self.y]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        return [(self.residuals(theta)[0], (-self.x * np.exp(-np.outer(theta, self.x))).T)]


@pytest.mark.long
def test_noise_is_not_model_error_where_parameters_are_hardly_identifiable() -> None:
    """The residual is noise; what it makes of the second derivatives must not narrow the intervals (0.84 hold then)."""
    rng, truth = np.random.default_rng(4), np.array([1.0, 1.3])
    held = []
    for _ in range(300):
        x = rng.uniform(0, 3, 1000)
        problem = TwoDecays(x, np.exp(-np.outer(truth, x)).sum(axis=0) + 0.04 * rng.standard_normal(len(x)))
        estimate = gauss_newton(problem, truth, tolerance=1e-6).estimate
        spread = np.sqrt(np.diag(model_error_covariance(problem, estimate, BOTH, NONE, problem)))
        held.append(np.abs(estimate - truth) < 1.96 * spread)
    assert np.all(np.abs(np.mean(held, axis=0) - 0.95) < 0.035)


def test_a_step_to_a_derivative_that_overflows_shows_no_curvature() -> None:
    """A model close to the fitted one nearly diverges, as an unstable filter does."""
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 1.0, 100)
    y = 1.0 + 2.0 * x + 0.1 * rng.standard_normal(100)

    class Steep(Line):
        def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
            (residual, rows), *_ = super().linearised(theta)
            return [(residual, rows * (1 + 1e160 * (theta[1] - slope)))]

    line = Line(x, y)
    minimum = gauss_newton(line, [0.0, 0.0])
    slope = minimum.estimate[1]
    steep = Steep(x, y)
    both = [model_error_covariance(each, minimum.estimate, BOTH, NONE, each) for each in (line, steep)]
    np.testing.assert_allclose(both[1], both[0])
