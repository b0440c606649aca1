"""Recursive least squares: the paper's update, the batch solution, and updates in pieces of any size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from emsid import (
    DataError,
    Information,
    ModelError,
    Record,
    RecursiveLeastSquares,
    RegressionModel,
    Structure,
    arx,
    concatenate,
    friction_narx,
    least_squares,
    recursive_least_squares,
    wiener_hammerstein_regression,
)
from emsid.estimation.linear.recursive import RecursiveState, paper_recursion
from emsid.estimation.linear.recursive_kernels import GROWTH, WINDUP, update_by_tiles

Array = NDArray[np.float64]

STRUCTURES = {
    "arx": arx(3, 2),
    "arx, direct and two inputs": arx(1, 2, nk=0, inputs=2),
    "wiener-hammerstein": wiener_hammerstein_regression(2, 2, 2, taps=2),
    "friction": friction_narx(2, 1, knots=(-0.4, 0.4), speeds=(0.3,)),
    "no memory at all": Structure.parse("u(t)", "u(t)^2", "1"),
}


@pytest.fixture(params=list(STRUCTURES))
def structure(request: pytest.FixtureRequest) -> Structure:
    return STRUCTURES[request.param]


def measured(structure: Structure, samples: int = 300, seed: int = 0) -> Record:
    """An input and an output that follows it with noise; no structure fits it exactly."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, (samples, structure.inputs))
    y = np.convolve(u[:, 0], [0.2, 0.6, 0.3, 0.1])[:samples] + 0.1 * rng.standard_normal(samples)
    return Record(u, y, 0.01)


def assert_same(one: RecursiveState, other: RecursiveState) -> None:
    for field in ("estimate", "factor", "diagonal", "samples", "residual_sum_of_squares"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)


# --- the update ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("forgetting", [1.0, 0.99, 0.9])
def test_estimates_and_covariance_are_those_of_the_update_as_printed(structure: Structure, forgetting: float) -> None:
    record = measured(structure, 120)
    phi, y = structure.regression(record)
    n = len(structure)
    fit = recursive_least_squares(structure, record, forgetting=forgetting, initial_covariance=100.0, history=True)
    expected = paper_recursion(phi, y, forgetting, 100.0 * np.eye(n))
    assert fit.history is not None
    np.testing.assert_allclose(fit.history, expected, rtol=1e-9, atol=1e-10)


def test_covariance_is_the_inverse_of_the_weighted_moments_and_the_prior() -> None:
    structure, forgetting = arx(2, 2), 0.97
    record = measured(structure, 200)
    phi, y = structure.regression(record)
    prior = np.array([1.0, 2.0, 3.0, 4.0])
    recursion = RecursiveLeastSquares(structure, forgetting, tuple(prior), (0.1, 0.2, 0.3, 0.4))
    state = recursion.update(recursion.start(), record)
    weight = forgetting ** np.arange(len(y) - 1, -1, -1)
    known = np.diag(forgetting ** len(y) / prior)
    moments = phi.T @ (weight[:, None] * phi) + known
    np.testing.assert_allclose(state.normalised_covariance, np.linalg.inv(moments), rtol=1e-9)
    start = np.array([0.1, 0.2, 0.3, 0.4])
    estimate = np.linalg.solve(moments, phi.T @ (weight * y) + known @ start)
    np.testing.assert_allclose(state.estimate, estimate, rtol=1e-9)
    squares = weight @ (y - phi @ estimate) ** 2 + (estimate - start) @ known @ (estimate - start)
    assert state.residual_sum_of_squares == pytest.approx(squares, rel=1e-10)
    assert state.samples == pytest.approx(weight.sum(), rel=1e-12)


def test_without_forgetting_it_is_batch(structure: Structure) -> None:
    record = measured(structure)
    batch = least_squares(structure, record)
    fit = recursive_least_squares(structure, record, initial_covariance=1e12)
    np.testing.assert_allclose(fit.estimate, batch.estimate, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(fit.covariance, batch.covariance, rtol=1e-6, atol=1e-10)
    assert fit.noise_variance == pytest.approx(batch.noise_variance, rel=1e-8)
    assert fit.samples == batch.samples
    deviation = np.sqrt(np.diag(batch.covariance))
    correlation = batch.covariance / np.outer(deviation, deviation)
    assert fit.condition == pytest.approx(np.sqrt(np.linalg.cond(correlation)), rel=1e-6)
    assert (fit.method, fit.rank, fit.history) == ("rls", len(structure), None)


@pytest.mark.parametrize("forgetting", [0.999, 0.98, 0.9])
def test_with_forgetting_it_is_information_with_forgetting(structure: Structure, forgetting: float) -> None:
    record = measured(structure, 500)
    information = Information.empty(len(structure))
    for row, value in zip(*structure.regression(record), strict=True):
        information = information.forget(forgetting).add(row[None], np.array([value]))
    batch = information.solve()
    fit = recursive_least_squares(structure, record, forgetting=forgetting, initial_covariance=1e10)
    np.testing.assert_allclose(fit.estimate, batch.estimate, rtol=1e-7, atol=1e-8)
    assert fit.samples == pytest.approx(information.samples, rel=1e-12)
    assert fit.noise_variance == pytest.approx(batch.noise_variance, rel=1e-7, nan_ok=True)


# --- state in, state out ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sizes", [[1] * 300, [300], [2, 5, 3, 90, 150, 50], [299, 1]], ids=["one", "all", "mix", "end"]
)
def test_samples_in_pieces_of_any_size_give_the_same_numbers(structure: Structure, sizes: list[int]) -> None:
    record = measured(structure)
    recursion = RecursiveLeastSquares(structure, 0.99, 1e4)
    history: list[Array] = []
    state, first = recursion.start(), 0
    for size in sizes:
        state = recursion.update(state, record[first : first + size], history)
        first += size
    whole_history: list[Array] = []
    whole = recursion.update(recursion.start(), record, whole_history)
    assert_same(state, whole)
    np.testing.assert_array_equal(np.concatenate(history), np.concatenate(whole_history))


@pytest.mark.parametrize("forgetting", [1.0, 0.999, 0.97, 0.5])
@pytest.mark.parametrize("sizes", [[1] * 700, [700], [3, 400, 2, 295]], ids=["one", "all", "mix"])
def test_tiles_give_the_same_as_single_samples(structure: Structure, sizes: list[int], forgetting: float) -> None:
    """Without a history, samples are added by tiles, unless D could reach its ceiling."""
    record = measured(structure, sum(sizes))
    recursion = RecursiveLeastSquares(structure, forgetting, 1e4)
    by_samples = recursion.update(recursion.start(), record, [])
    state, first = recursion.start(), 0
    for size in sizes:
        state = recursion.update(state, record[first : first + size])
        first += size
    np.testing.assert_allclose(state.estimate, by_samples.estimate, rtol=1e-9, atol=1e-11)
    p = by_samples.normalised_covariance
    np.testing.assert_allclose(state.normalised_covariance, p, rtol=1e-9, atol=1e-9 * np.abs(p).max())
    assert state.residual_sum_of_squares == pytest.approx(by_samples.residual_sum_of_squares, rel=1e-9)
    assert state.samples == pytest.approx(by_samples.samples, rel=1e-12)
    if len(sizes) == sum(sizes):
        assert_same(state, by_samples)


def test_an_update_does_not_change_its_argument(structure: Structure) -> None:
    record = measured(structure)
    recursion = RecursiveLeastSquares(structure, 0.98)
    state = recursion.update(recursion.start(), record[:150])
    kept = replace(state, **{name: getattr(state, name).copy() for name in ("estimate", "factor", "diagonal")})
    once = recursion.update(state, record[150:])
    assert_same(state, kept)
    assert_same(recursion.update(state, record[150:]), once)
    assert np.any(once.estimate != state.estimate)


def test_history_holds_every_estimate_and_is_kept_only_if_asked(structure: Structure) -> None:
    record = measured(structure)
    fit = recursive_least_squares(structure, record, history=True)
    assert fit.history is not None
    assert fit.history.shape == (300 - structure.memory, len(structure))
    np.testing.assert_array_equal(fit.history[-1], fit.estimate)
    assert recursive_least_squares(structure, record).history is None


def test_the_tail_has_as_many_samples_as_the_largest_lag(structure: Structure) -> None:
    recursion = RecursiveLeastSquares(structure)
    state = recursion.update(recursion.start(), measured(structure))
    assert (0 if state.tail is None else len(state.tail)) == structure.memory
    assert state.cut().tail is None
    assert_same(state.cut(), state)


def test_no_row_reaches_over_a_gap(structure: Structure) -> None:
    pieces = [measured(structure, seed=samples)[:samples] for samples in (40, 1, 2, 100)]
    rows = [structure.regression(piece) for piece in pieces if len(piece) > structure.memory]
    phi, y = np.vstack([phi for phi, _ in rows]), np.concatenate([y for _, y in rows])
    expected = paper_recursion(phi, y, 0.99, 1e3 * np.eye(len(structure)))[-1]
    recursion = RecursiveLeastSquares(structure, 0.99, 1e3)
    in_segments = recursion.update(recursion.start(), concatenate(pieces))
    cut = recursion.start()
    for piece in pieces:
        cut = recursion.update(cut.cut(), piece)
    assert_same(in_segments, cut)
    np.testing.assert_allclose(in_segments.estimate, expected, rtol=1e-8, atol=1e-9)
    long = [pieces[0], pieces[-1]]
    experiments = recursive_least_squares(structure, long, forgetting=0.99, initial_covariance=1e3)
    segments = recursive_least_squares(structure, concatenate(long), forgetting=0.99, initial_covariance=1e3)
    np.testing.assert_array_equal(experiments.estimate, segments.estimate)


def test_later_samples_must_be_of_the_same_channels() -> None:
    structure = arx(1, 1)
    recursion = RecursiveLeastSquares(structure)
    record = measured(structure)
    state = recursion.update(recursion.start(), record[:100])
    with pytest.raises(DataError, match="sampled every"):
        recursion.update(state, replace(record[100:], dt=0.02))
    with pytest.raises(DataError, match="sampled every"):
        recursive_least_squares(structure, [record, replace(record, dt=0.02, times=())])


# --- what it is for --------------------------------------------------------------------------------------------------


def test_a_step_of_the_parameters_is_tracked() -> None:
    structure, before, after = arx(1, 1), np.array([-0.8, 1.0]), np.array([-0.5, 0.4])
    rng = np.random.default_rng(4)
    u = rng.uniform(-1, 1, 2000)
    first = RegressionModel(structure, before, 0.01).simulate(Record(u, np.zeros(2000), 0.01)).output
    start = np.concatenate([first[999:1000], np.zeros((1000, 1))])
    second = RegressionModel(structure, after, 0.01).simulate(Record(u[999:], start, 0.01)).output
    record = Record(u, np.concatenate([first[:1000], second[1:]]), 0.01)
    fit = recursive_least_squares(structure, record, forgetting=0.95, history=True)
    assert fit.history is not None
    np.testing.assert_allclose(fit.history[998], before, atol=1e-6)
    # What was before the step has weight λᵏ: it is gone at the rate of the forgetting.
    for k in (100, 200, 400):
        assert np.abs(fit.history[998 + k] - after).max() < 20 * 0.95**k + 1e-9
    constant = recursive_least_squares(structure, record).estimate
    assert np.abs(constant - after).min() > 0.05  # without forgetting it rests between the two


def test_forgetting_without_excitation_neither_explodes_nor_loses_positiveness() -> None:
    """A million samples of which nine in ten say nothing, at λ = 0.98: unbounded, P would overflow."""
    rng = np.random.default_rng(5)
    n, block, ceiling = 4, 10_000, np.full(4, 1e8)
    theta = np.array([0.5, -0.3, 1.0, 2.0])
    estimate, factor, diagonal, totals = (
        np.zeros(n),
        np.eye(n),
        ceiling.copy(),
        np.append(np.zeros(7), np.full(n, np.inf)),
    )
    limits = np.stack([ceiling, ceiling])
    lowest, highest, largest = np.inf, 0.0, 0.0
    for k in range(100):
        phi = np.zeros((n, block)) if k % 10 else rng.standard_normal((n, block))
        if k % 20 == 10:
            phi[2:] = phi[:2]  # half of what does excite excites two directions only
        update_by_tiles(estimate, factor, diagonal, totals, np.vstack([phi, theta @ phi]), 0.98, limits)
        lowest, highest = min(lowest, diagonal.min()), max(highest, diagonal.max())
        covariance = factor.T @ (diagonal[:, None] * factor)
        largest = max(largest, float(np.abs(covariance).max()))
        assert np.linalg.eigvalsh(covariance).min() > 0
        assert np.isfinite(estimate).all()
    assert lowest > 0
    assert highest == 1e8  # reached, and not passed
    assert totals[6] > 800_000  # and counted
    assert largest < 1e9
    phi = rng.standard_normal((n, 2000))
    update_by_tiles(estimate, factor, diagonal, totals, np.vstack([phi, theta @ phi]), 0.98, limits)
    np.testing.assert_allclose(estimate, theta, rtol=1e-12)


def test_covariance_and_estimate_stay_bounded_without_input() -> None:
    structure = arx(2, 2)
    record = measured(structure)
    recursion = RecursiveLeastSquares(structure, 0.95, 10.0)
    state = recursion.update(recursion.start(), record)
    silent = recursion.update(state.cut(), Record(np.zeros(5000), np.zeros(5000), 0.01))
    np.testing.assert_array_equal(silent.diagonal, np.maximum(WINDUP / state.peak**2, GROWTH * 10.0))
    np.testing.assert_array_equal(silent.peak, state.peak)
    assert silent.limited > 4000
    np.testing.assert_array_equal(silent.estimate, state.estimate)
    assert silent.samples == pytest.approx(1 / (1 - 0.95), rel=1e-12)


def changing(scale: float) -> Record:
    """A first-order system whose gain and pole change in the middle; both channels in a unit 1/scale times as large."""
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal(2000), np.zeros(2000)
    for t in range(1, 2000):
        y[t] = (0.8 * y[t - 1] + 0.5 * u[t - 1]) if t < 1000 else (0.3 * y[t - 1] + 2.0 * u[t - 1])
    return Record(scale * u, scale * y, 0.01)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e6])
@pytest.mark.parametrize("history", [True, False])
def test_forgetting_works_in_any_unit_of_the_channels(scale: float, history: bool) -> None:
    fit = recursive_least_squares(arx(1, 1), changing(scale), forgetting=0.98, history=history)
    np.testing.assert_allclose(fit.estimate, [-0.3, 2.0], rtol=1e-6)
    assert not fit.findings


def test_where_nothing_is_forgotten_the_fit_says_so() -> None:
    record = changing(1.0)
    silent = replace(record, input=np.where(np.arange(2000) < 500, record.input[:, 0], 0.0))
    (finding,) = recursive_least_squares(arx(1, 2), silent, forgetting=0.9).findings
    assert (finding.code, finding.subject) == ("forgetting-limited", "arx")
    assert 1000 < finding.data["samples"] < 1500
    assert finding.data["parameters"] == ["b1", "b2"]
    assert not recursive_least_squares(arx(1, 2), silent).findings  # without forgetting there is nothing to limit


def test_exact_parameters_come_back_as_a_model(structure: Structure) -> None:
    theta = np.linspace(0.3, -0.2, len(structure))
    record = measured(structure, 600)
    made = replace(record, output=RegressionModel(structure, theta, 0.01).simulate(record).output)
    fit = recursive_least_squares(structure, made, initial_covariance=1e12)
    np.testing.assert_allclose(fit.estimate, theta, rtol=1e-7, atol=1e-7)
    np.testing.assert_array_equal(fit.model.parameters, fit.estimate)
    assert fit.model.dt == 0.01
    assert fit.names == structure.parameter_names


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("forgetting", [0.0, -0.5, 1.0001, np.nan])
def test_forgetting_factors_out_of_range_are_refused(forgetting: float) -> None:
    with pytest.raises(ModelError, match="forgetting factor"):
        RecursiveLeastSquares(arx(1, 1), forgetting)


@pytest.mark.parametrize("covariance", [0.0, -1.0, np.nan, np.inf, (1.0, 0.0)])
def test_initial_covariances_that_are_not_positive_are_refused(covariance: float | tuple[float, ...]) -> None:
    with pytest.raises(ModelError, match="initial covariance"):
        RecursiveLeastSquares(arx(1, 1), 1.0, covariance)


def test_initial_values_of_another_number_are_refused() -> None:
    with pytest.raises(ModelError, match="initial covariance"):
        RecursiveLeastSquares(arx(1, 1), 1.0, (1.0, 2.0, 3.0))
    with pytest.raises(ModelError, match="3 initial values for the 2 parameters"):
        RecursiveLeastSquares(arx(1, 1), initial_estimate=(1.0, 2.0, 3.0)).start()


def test_records_that_do_not_suffice_are_refused() -> None:
    structure = arx(4, 4)
    with pytest.raises(ModelError, match="looks back 4"):
        recursive_least_squares(structure, Record(np.arange(3.0), np.arange(3.0), 0.1))
    with pytest.raises(DataError, match="is constant at 1"):
        recursive_least_squares(structure, Record(np.ones(30), np.arange(30.0), 0.1))
    with pytest.raises(DataError, match="no record"):
        recursive_least_squares(structure, [])


def test_an_overflow_is_reported() -> None:
    record = Record(1e4 * measured(arx(1, 1)).input, measured(arx(1, 1)).output, 0.01)
    with pytest.raises(DataError, match="overflow"):
        recursive_least_squares(Structure.parse("u(t-1)^90", "y(t-1)"), record)
