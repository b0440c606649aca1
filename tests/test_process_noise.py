"""Noise before the static map of a cascade: its test, its size, and the fit that allows for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import binom

from emsid.findings import Finding
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import search
from emsid.models.blocks.process_noise import ErrorPiece, ProcessNoise, dependence, error_pieces, estimated_noise
from emsid.models.blocks.search.cross_validation import Orders
from emsid.models.blocks.search.process_noise import (
    Corrected,
    ExpectedMap,
    in_turn,
    with_spread_of_mean,
    without_process_noise,
)
from emsid.models.blocks.static_maps import CubicSpline, DeadZone, Polynomial, Saturation
from emsid.models.free_run import free_run_error
from independent.process_noise import DT, FIRST, SECOND, Circuit, circuit

Array = NDArray[np.float64]

BEHIND = Rational(SECOND[0], SECOND[1][1:])
TRUTH = Cascade((Rational(FIRST[0], FIRST[1][1:]), Saturation(1.0, -1.0, 1.0), BEHIND), dt=DT)
KNOTS = np.linspace(-2.2, 2.2, 20)
SPLINE = replace(TRUTH, blocks=(TRUTH.blocks[0], CubicSpline(KNOTS, np.clip(KNOTS, -1, 1)), BEHIND))


@pytest.fixture(scope="module")
def noisy() -> Circuit:
    return circuit(3, 4096)


def pieces_of(made: Circuit) -> list[ErrorPiece]:
    segments = [(r.input[:, 0], r.output[:, 0]) for r in made.fitted]
    mean = replace(TRUTH, blocks=(TRUTH.blocks[0], ExpectedMap(Saturation(1.0, -1.0, 1.0), made.process), BEHIND))
    return error_pieces(mean, segments, [mean.initial_state(u, y[: mean.memory]) for u, y in segments], 200)


def test_the_test_holds_its_level_in_coloured_and_heavy_tailed_noise() -> None:
    """Normal errors exceed 1.645 standard errors one time in twenty."""
    rng, runs, exceeded = np.random.default_rng(0), 200, 0
    for _ in range(runs):
        x = lfilter([0.1], [1, -0.9], 3 * rng.standard_normal(2000))
        noise = lfilter([1.0], [1, -0.9], rng.standard_t(3, 2000))
        piece = ErrorPiece(noise, (np.abs(x) < 1).astype(float), np.asarray(lfilter(*SECOND, np.clip(x, -1, 1))))
        exceeded += dependence([piece], BEHIND, 1) > 1.645
    assert exceeded <= binom.ppf(0.999, runs, 0.05)


def test_noise_before_the_map_is_seen_and_its_size_estimated(noisy: Circuit) -> None:
    pieces = pieces_of(noisy)
    assert dependence(pieces, BEHIND, 1) > 4
    found = estimated_noise(pieces, BEHIND, 1)
    assert found.spread == pytest.approx(noisy.process, rel=0.15)
    assert found.output == pytest.approx(noisy.noise, rel=0.1)


@pytest.mark.parametrize("rate", [1, 2])
def test_the_weighting_is_that_of_the_covariance_of_the_noise(rate: int) -> None:
    """Whitened signals have the squares of xᵀC⁻¹x, with the covariance C written out."""
    rng, steps = np.random.default_rng(2), 24 * rate
    slope, behind = rng.uniform(0, 1, steps), Rational([0.3, 0.2, 0.1], [-0.5, 0.2])
    noise = ProcessNoise(0.7, (0.6, -0.3), 0.2, 0.4)
    first, second = noise.reflections
    correlation = [1.0, first]
    for _ in range(steps - 2):
        correlation.append(first * (1 - second) * correlation[-1] + second * correlation[-2])
    lags = np.abs(np.subtract.outer(np.arange(steps), np.arange(steps)))
    impulse = lfilter(behind.numerator, np.r_[1.0, behind.denominator], np.eye(steps)[0])
    through = np.tril(impulse[lags]) * slope
    start = noise.spread**2 * np.max(slope**2) * np.sum(behind.numerator**2) + noise.output**2
    begun = np.array([lfilter([1.0], np.r_[1.0, behind.denominator], np.eye(steps)[k]) for k in range(2)])
    covariance = noise.spread**2 * through @ np.array(correlation)[lags] @ through.T + start * begun.T @ begun
    covariance = (covariance + noise.output**2 * noise.pole**lags)[::rate, ::rate]
    rows = rng.standard_normal((2, 24))
    white = noise.weighting(slope, behind, rate).whitened(rows)
    np.testing.assert_allclose(white @ white.T, rows @ np.linalg.solve(covariance, rows.T), rtol=1e-9)


def test_the_mean_of_a_parabola_is_higher_by_the_variance() -> None:
    x = np.linspace(-1, 1, 5)
    parabola = Polynomial.from_powers(np.array([0.0, 1.0, 2.0]), -1.0, 1.0)
    np.testing.assert_allclose(ExpectedMap(parabola, 0.3).value(x), parabola.value(x) + 2 * 0.09, atol=1e-12)


@pytest.mark.parametrize("map_", [DeadZone(-0.2, 0.3, 1.0, 2.0), CubicSpline([-1.0, 0.0, 1.0], [-1.0, 0.2, 0.7])])
def test_the_expectation_of_a_map_is_that_of_its_values(map_: DeadZone | CubicSpline) -> None:
    x, w = np.array([-0.5, 0.1, 0.4]), np.random.default_rng(0).standard_normal(500_000)
    drawn = [float(np.mean(map_.value(at + 0.2 * w))) for at in x]
    np.testing.assert_allclose(ExpectedMap(map_, 0.2).value(x), drawn, atol=5e-3)
    step = 1e-5
    moved = (ExpectedMap(map_, 0.2).value(x + step) - ExpectedMap(map_, 0.2).value(x - step)) / (2 * step)
    np.testing.assert_allclose(ExpectedMap(map_, 0.2).slope(x), moved, atol=1e-4)


def corrected(
    made: Circuit,
    start: Cascade,
    orders: Orders = (3, 3),
    transient: int | None = None,
    free_map: bool = False,
) -> tuple[Cascade, Corrected]:
    minimum, problem = search(start, made.fitted, transient=transient)
    found = without_process_noise(minimum, problem, made.fitted, orders, {}, free_map=free_map)
    return problem.model(minimum.estimate), found


def finding(found: Corrected) -> Finding:
    (only,) = found.findings
    assert only.code == "process-noise"
    return only


def test_a_fit_is_corrected_for_noise_before_its_map(noisy: Circuit) -> None:
    plain, found = corrected(noisy, SPLINE)
    assert found.fit is not None
    assert finding(found).data["corrected"] is True
    assert finding(found).data["share"] == pytest.approx(0.15, abs=0.03)
    judges = list(noisy.unseen.values())
    before, after = (np.sqrt(free_run_error(each, judges)) for each in (plain, found.fit.model))
    assert np.sqrt(after**2 - noisy.noise**2) < 0.9 * np.sqrt(before**2 - noisy.noise**2)


def test_noise_that_is_taken_for_far_larger_is_estimated_again_with_the_model() -> None:
    made = circuit(2, 4096, seed=3)
    far = ProcessNoise(2.5 * made.process, (-0.2, 0.2), made.noise, 0.0)
    _, found = in_turn(TRUTH, far, pieces_of(made), made.fitted, 1.0, {"transient": 200})
    assert found.spread == pytest.approx(made.process, rel=0.2)
    assert found.output == pytest.approx(made.noise, rel=0.1)


def test_the_gradient_of_an_expectation_contains_that_for_the_spread() -> None:
    mean, x, step = ExpectedMap(DeadZone(-0.2, 0.3, 1.0, 2.0), 0.2), np.array([-0.5, 0.1, 0.4]), 1e-6
    values = [replace(mean, spread=mean.spread + sign * step).value(x) for sign in (1, -1)]
    np.testing.assert_allclose(mean.parameter_gradient(x)[-1], (values[0] - values[1]) / (2 * step), atol=1e-7)
    assert mean.names[-1] == "spread"
    assert mean.with_parameters(mean.parameters).spread == mean.spread


def test_the_mean_of_a_map_shows_noise_that_the_second_filter_stops() -> None:
    """The error alone shows 1.6 times the spread, as if the noise were white."""
    made = circuit(6, 8192, seed=2)
    error_shows = ProcessNoise(1.6 * made.process, (0.0, 0.0), made.noise, 0.0)
    start = replace(TRUTH, blocks=(TRUTH.blocks[0], ExpectedMap(TRUTH.blocks[1], error_shows.spread), BEHIND))  # type: ignore[arg-type]
    found = with_spread_of_mean(start, error_shows, made.fitted, {})
    assert found.blocks[1].spread == pytest.approx(made.process, rel=0.15)  # type: ignore[attr-defined]
    smooth = replace(start, blocks=(start.blocks[0], ExpectedMap(SPLINE.blocks[1], 0.1), BEHIND))  # type: ignore[arg-type]
    assert with_spread_of_mean(smooth, error_shows, made.fitted, {}) is smooth


def test_a_fit_with_states_from_its_transient_is_corrected_on_the_same_samples(noisy: Circuit) -> None:
    """The search fixes the states where estimated ones would describe a drift."""
    _, found = corrected(noisy, SPLINE, transient=200)
    assert found.fit is not None
    assert finding(found).data["corrected"] is True


def test_an_order_that_is_too_low_is_raised_in_noise_before_the_map() -> None:
    smaller = Rational(np.array([0.0, 0.15, 0.1]), np.array([-1.2, 0.45]))
    _, found = corrected(circuit(1, 4096), replace(TRUTH, blocks=(*TRUTH.blocks[:2], smaller)), (3, None))
    assert found.fit is not None
    assert len(found.fit.model.blocks[2].parameters) == 7


@pytest.mark.long
def test_a_spline_takes_the_place_of_another_map_in_noise_before_it(noisy: Circuit) -> None:
    """A cubic polynomial leaves an error that is small beside this noise, and three times that of the true map."""
    cubic = Polynomial(np.array([0.0, 0.9, 0.0, -0.1]), -3, 3)
    start, judges = replace(TRUTH, blocks=(TRUTH.blocks[0], cubic, BEHIND)), list(noisy.unseen.values())
    for free_map, kind, least, most in ((False, Polynomial, 2.5, 4.0), (True, CubicSpline, 1.0, 1.7)):
        _, found = corrected(noisy, start, free_map=free_map)
        assert found.fit is not None
        assert isinstance(found.fit.model.blocks[1], kind)
        assert least < np.sqrt(free_run_error(found.fit.model, judges)) / noisy.noise < most


def test_without_noise_before_the_map_a_fit_stays_as_it_is() -> None:
    _, found = corrected(circuit(1, 4096, process=0.0, noise=0.05), TRUTH)
    assert found == Corrected()


def test_an_error_like_a_random_walk_has_an_estimate() -> None:
    """Its correlations are estimated at the edge of what is stationary, where the variance of the noise is zero."""
    error = np.cumsum(np.random.default_rng(0).standard_normal(2000))
    slope = (np.abs(np.sin(np.arange(2000) / 30)) > 0.5).astype(float)
    found = estimated_noise([ErrorPiece(error, slope, error)], Rational([1.0]), 1)
    assert np.isfinite([found.spread, *found.reflections, found.output, found.pole]).all()
