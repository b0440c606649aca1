"""Smooth maps: the weight of a penalty on roughness, and splines whose number of knots does not matter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.signal import lfilter

from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear.gauss_newton import gauss_newton
from emsid.estimation.nonlinear.smoothing import Penalty, Smoothing, chosen_weights
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import fit_cascade, static_band
from emsid.models.blocks.search.starts import started
from emsid.models.blocks.static_maps import CubicSpline
from emsid.record import Record

Array = NDArray[np.float64]

SECOND = Rational([0.1, 0.05], [-1.3, 0.45])
MAPS: dict[str, Callable[[Array], Array]] = {
    "bent": lambda x: np.arctan(1.5 * x),
    "cut off": lambda x: np.clip(x, -1, 1),
}


def record_of(curve: Callable[[Array], Array], samples: int, noise: float, seed: int) -> Record:
    """Filter, map and filter by lfilter."""
    rng = np.random.default_rng(seed)
    u = 1.5 * lfilter([0.6], [1, -0.4], rng.standard_normal(samples)) / 0.65
    y = lfilter([0.1, 0.05], [1, -1.3, 0.45], curve(lfilter([0.6, 0.0], [1, -0.4], u)))
    return Record(u, y + noise * np.std(y) * rng.standard_normal(samples), 1e-3)


def fitted(record: Record, knots: int) -> Cascade:
    segments = [(record.input[:, 0], record.output[:, 0])]
    line = Cascade((Rational([0.6, 0.0], [-0.4]), CubicSpline([-1.0, 1.0], [-1.0, 1.0]), SECOND))
    return fit_cascade(started(line, lambda x, z: CubicSpline.started(x, z, knots), segments), record).model


def unexplained(model: Cascade, record: Record) -> float:
    run = model.simulate(record)
    return float(np.sqrt(np.mean((run.output - record.output)[run.counted] ** 2)) / np.std(record.output))


@pytest.mark.parametrize(("name", "samples", "bound"), [("bent", 1000, 0.011), ("cut off", 400, 0.025)])
def test_the_number_of_knots_hardly_matters(name: str, samples: int, bound: float) -> None:
    """Without a penalty the error of 40 knots is 0.013 for the bent map and 0.053 for the other."""
    curve = MAPS[name]
    record, other = record_of(curve, samples, 0.05, 0), record_of(curve, 2000, 0.0, 1)
    errors = [unexplained(fitted(record, knots), other) for knots in (10, 20, 40)]
    assert max(errors) < bound
    assert errors[2] == pytest.approx(errors[1], rel=0.1)


@dataclass(frozen=True)
class Lines:
    """A linear problem: basis (N, p) and y (N,)."""

    basis: Array
    y: Array

    def residuals(self, theta: Array) -> list[Array]:
        return [self.basis @ theta - self.y]

    def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
        return [(self.basis @ theta - self.y, self.basis)]


def test_the_weight_is_the_most_likely_one() -> None:
    """For y = f + e with f ~ N(0, σ²/μ) in the penalised directions, against the likelihood written out."""
    rng = np.random.default_rng(0)
    jacobian, rows = rng.standard_normal((60, 8)), rng.standard_normal((5, 8))
    theta = rng.standard_normal(8)
    target = jacobian @ (0.3 * rng.standard_normal(8)) + rng.standard_normal(60)
    penalty = Penalty(rows, rng.standard_normal(5))
    information = Information.from_rows(jacobian, target)
    (weight,) = chosen_weights([penalty], information, theta, np.arange(8), np.ones(1), 60)

    def unlikelihood(mu: float) -> float:
        """−2 log of the likelihood with every flat direction integrated out and σ² at its best."""
        both = np.vstack([jacobian, np.sqrt(mu) * rows])
        right = np.concatenate([target, -np.sqrt(mu) * penalty.value(theta)])
        misfit = np.sum((both @ np.linalg.lstsq(both, right)[0] - right) ** 2)
        return float((60 - 8 + 5) * np.log(misfit) + np.linalg.slogdet(both.T @ both)[1] - 5 * np.log(mu))

    grid = weight * 10 ** np.linspace(-3, 3, 61)
    assert unlikelihood(weight) <= min(map(unlikelihood, grid)) + 0.05


@pytest.mark.parametrize("knots", [10, 40])
def test_a_curve_does_not_follow_a_slow_residual(knots: int) -> None:
    """What drifts over several turns of a slow input looks like a curve of it; counted one by one, samples say so."""
    rng, errors, t = np.random.default_rng(5), [], np.arange(2000)
    x = np.sin(t / 60) + 0.3 * np.sin(t / 37)
    at = np.linspace(-1.35, 1.35, knots)
    spline = CubicSpline(at, at)
    basis, penalty = spline.parameter_gradient(x).T, Penalty(spline.roughness(), np.zeros(len(spline.roughness())))
    for _ in range(10):
        y = x + lfilter([0.04], [1, -0.98], rng.standard_normal(2000))
        smoothing = Smoothing([penalty], correlated=True)
        found = gauss_newton(Lines(basis, y), np.linalg.lstsq(basis, y)[0], smoothing=smoothing)
        curve = basis @ found.estimate
        errors.append(np.std(curve - np.polyval(np.polyfit(x, curve, 1), x)))
    assert np.mean(errors) < 0.035  # without correlation in mind 0.045 and 0.051


def test_two_penalties_have_a_weight_each() -> None:
    rng = np.random.default_rng(1)
    basis = np.repeat(np.eye(20), 10, axis=0)
    second = np.diff(np.eye(20), 2, axis=0)
    rough, straight = np.where(np.arange(20) % 2, 3.0, -3.0), np.linspace(-1, 1, 20)
    jacobian = np.block([[basis, np.zeros_like(basis)], [np.zeros_like(basis), basis]])
    target = jacobian @ np.concatenate([rough, straight]) + 0.5 * rng.standard_normal(400)
    penalties = [
        Penalty(np.hstack([second, 0 * second]), np.zeros(18)),
        Penalty(np.hstack([0 * second, second]), np.zeros(18)),
    ]
    weights = np.ones(2)
    for _ in range(3):
        information = Information.from_rows(jacobian, target)
        weights = chosen_weights(penalties, information, np.zeros(40), np.arange(40), weights, 400)
    assert weights[0] < 0.1
    assert weights[1] > 1e3


def test_roughness_is_the_integral_of_the_squared_second_derivative() -> None:
    rng = np.random.default_rng(2)
    knots = np.sort(rng.uniform(-2, 2, 7))
    spline = CubicSpline(knots, rng.standard_normal(7))

    def bend(x: float) -> float:
        return float(np.interp(x, knots, spline.curvatures @ spline.values)) ** 2

    integral = sum(quad(bend, a, b)[0] for a, b in pairwise(knots))
    assert np.sum((spline.roughness() @ spline.values) ** 2) == pytest.approx(integral, rel=1e-9)
    assert np.abs(spline.roughness() @ knots).max() < 1e-9 * np.abs(spline.roughness()).max()


def test_a_knot_without_data_stays_in_the_band_of_its_neighbours() -> None:
    """The input leaves out 0.2 to 1.4, where six knots have nothing to hold on to."""
    rng = np.random.default_rng(3)
    u = np.where(rng.random(600) < 0.5, rng.uniform(-2, 0.2, 600), rng.uniform(1.4, 2, 600))
    curve = MAPS["bent"]
    y = lfilter([0.1, 0.05], [1, -1.3, 0.45], curve(u))
    record = Record(u, y + 0.02 * np.std(y) * rng.standard_normal(600), 1e-3)
    knots = np.linspace(-2.5, 2.5, 22)
    fit = fit_cascade(Cascade((CubicSpline(knots, knots), SECOND)), record)
    spline = fit.model.blocks[0]
    assert isinstance(spline, CubicSpline)
    gain = SECOND.resting(1.0)[1]
    assert np.abs(spline.values / gain - curve(knots)).max() < 0.25
    band = static_band(fit, 0, np.array([-1.0, 0.8]))
    assert band[1, 1] > 3 * band[0, 1]
    assert abs(band[1, 0] - gain * curve(np.array([0.8]))[0]) < 3 * band[1, 1]
    outside = spline.slope(np.array([-9.0, knots[0], knots[-1], 9.0]))
    assert outside[[0, 2]] == pytest.approx(outside[[1, 3]])
