"""The triangular factor against NumPy, its algebra, and its solution of ill-conditioned and rank-deficient problems."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emsid import Information, ModelError
from emsid.estimation.linear.information import TILE, add_rows, add_rows_reference

Array = NDArray[np.float64]


def problem(rows: int, parameters: int, seed: int = 0, noise: float = 0.1) -> tuple[Array, Array, Array]:
    """Φ, y and the θ behind them."""
    rng = np.random.default_rng(seed)
    phi = rng.standard_normal((rows, parameters))
    theta = rng.standard_normal(parameters)
    return phi, phi @ theta + noise * rng.standard_normal(rows), theta


def canonical(factor: Array) -> Array:
    """The factor with a diagonal that is not negative, which makes it unique."""
    return np.where(np.diag(factor) < 0, -1.0, 1.0)[:, None] * factor


def assert_same(one: Information, other: Information, rtol: float = 1e-12) -> None:
    a, b = canonical(one.factor), canonical(other.factor)
    np.testing.assert_allclose(a, b, rtol=0, atol=rtol * np.abs(b).max())
    assert one.samples == pytest.approx(other.samples, rel=1e-12)


# --- the factor ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [1, 2, TILE - 1, TILE, TILE + 1, 2 * TILE, 3 * TILE + 7])
@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 6, 7, 13])
def test_added_rows_give_the_triangular_factor_of_numpy(rows: int, width: int) -> None:
    rng = np.random.default_rng(rows * 100 + width)
    start = np.triu(rng.standard_normal((width, width)))
    columns = rng.standard_normal((width, rows))
    untouched = columns.copy()
    found = start.copy()
    add_rows(found, columns)
    np.testing.assert_allclose(canonical(found), canonical(add_rows_reference(start, columns)), atol=1e-12 * rows**0.5)
    np.testing.assert_array_equal(np.tril(found, -1), 0.0)
    np.testing.assert_array_equal(columns, untouched)


def test_from_rows_keeps_all_inner_products_and_counts_samples() -> None:
    phi, y, _ = problem(1000, 6)
    stacked = np.column_stack([phi, y])
    information = Information.from_rows(phi, y)
    np.testing.assert_allclose(information.factor.T @ information.factor, stacked.T @ stacked, rtol=1e-12, atol=1e-10)
    assert information.samples == 1000
    assert information.parameters == 6


@settings(max_examples=40, derandomize=True, deadline=None)
@given(st.lists(st.integers(0, 3 * TILE), min_size=1, max_size=6), st.integers(1, 7))
def test_blocks_of_any_size_give_the_same_factor(sizes: list[int], parameters: int) -> None:
    phi, y, _ = problem(sum(sizes) + 10, parameters, seed=sum(sizes))
    information = Information.empty(parameters)
    for first, size in zip(np.cumsum([0, *sizes]), [*sizes, 10], strict=True):
        information = information.add(phi[first : first + size], y[first : first + size])
    assert_same(information, Information.from_rows(phi, y))


def test_merged_parts_are_the_whole_in_any_order() -> None:
    phi, y, _ = problem(900, 5)
    parts = [Information.from_rows(phi[a:b], y[a:b]) for a, b in ((0, 1), (1, 200), (200, 900))]
    whole = Information.from_rows(phi, y)
    for order in permutations(parts):
        merged = Information.empty(5)
        for part in order:
            merged = merged.merge(part)
        assert_same(merged, whole)


def test_adding_rows_does_not_change_the_original() -> None:
    phi, y, _ = problem(50, 3)
    information = Information.from_rows(phi, y)
    before = information.factor.copy()
    information.add(phi, y)
    information.merge(information)
    information.forget(0.5)
    information.with_prior(3.0)
    information.solve()
    np.testing.assert_array_equal(information.factor, before)


@pytest.mark.parametrize("forgetting", [1.0, 0.99, 0.5])
def test_forgetting_weights_row_k_steps_back_by_its_kth_power(forgetting: float) -> None:
    phi, y, _ = problem(60, 4)
    information = Information.empty(4)
    for row, value in zip(phi, y, strict=True):
        information = information.forget(forgetting).add(row[None], np.array([value]))
    weight = forgetting ** np.arange(59, -1, -1)
    weighted = Information.from_rows(np.sqrt(weight)[:, None] * phi, np.sqrt(weight) * y)
    np.testing.assert_allclose(canonical(information.factor), canonical(weighted.factor), atol=1e-12)
    assert information.samples == pytest.approx(weight.sum(), rel=1e-12)


@pytest.mark.parametrize("columns", [[0], [4, 1], [3, 2, 1, 0], list(range(5)), []])
def test_selected_columns_are_the_smaller_problem(columns: list[int]) -> None:
    phi, y, _ = problem(300, 5)
    chosen = Information.from_rows(phi, y).select(columns)
    assert_same(chosen, Information.from_rows(phi[:, columns], y))
    estimate = np.linalg.lstsq(phi[:, columns], y, rcond=None)[0] if columns else np.empty(0)
    solution = chosen.solve()
    np.testing.assert_allclose(solution.estimate, estimate, rtol=1e-11)
    assert solution.residual_sum_of_squares == pytest.approx(np.sum((y - phi[:, columns] @ estimate) ** 2), rel=1e-11)


@pytest.mark.parametrize("weight", [0.0, 0.3, 1e4])
def test_prior_is_ridge_regression(weight: float) -> None:
    phi, y, _ = problem(80, 4)
    solution = Information.from_rows(phi, y).with_prior(weight).solve()
    closed = np.linalg.solve(phi.T @ phi + weight * np.eye(4), phi.T @ y)
    np.testing.assert_allclose(solution.estimate, closed, rtol=1e-11)


def test_prior_with_a_mean_and_a_weight_for_every_parameter() -> None:
    phi, y, _ = problem(80, 3)
    weight, mean = np.array([0.0, 5.0, 1e9]), np.array([7.0, -1.0, 2.5])
    information = Information.from_rows(phi, y).with_prior(weight, mean)
    closed = np.linalg.solve(phi.T @ phi + np.diag(weight), phi.T @ y + weight * mean)
    np.testing.assert_allclose(information.solve().estimate, closed, rtol=1e-9)
    assert information.solve().estimate[2] == pytest.approx(2.5, abs=1e-6)  # 1e9 means: it is 2.5
    assert information.samples == 80  # a prior is no measurement


# --- the solution ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rows", "parameters"), [(5, 1), (40, 3), (1000, 12)])
def test_solution_against_numpy(rows: int, parameters: int) -> None:
    phi, y, _ = problem(rows, parameters)
    solution = Information.from_rows(phi, y).solve()
    estimate = np.linalg.lstsq(phi, y, rcond=None)[0]
    squares = float(np.sum((y - phi @ estimate) ** 2))
    np.testing.assert_allclose(solution.estimate, estimate, rtol=1e-11, atol=1e-13)
    assert solution.residual_sum_of_squares == pytest.approx(squares, rel=1e-11)
    assert solution.noise_variance == pytest.approx(squares / (rows - parameters), rel=1e-11)
    covariance = solution.noise_variance * np.linalg.inv(phi.T @ phi)
    np.testing.assert_allclose(solution.covariance, covariance, rtol=1e-9, atol=1e-12 * np.abs(covariance).max())
    unit = phi / np.linalg.norm(phi, axis=0)
    assert solution.condition == pytest.approx(np.linalg.cond(unit), rel=1e-10)
    assert (solution.rank, solution.aliases) == (parameters, ())


def test_the_solution_scales_with_columns_and_target() -> None:
    phi, y, _ = problem(200, 5)
    scale = np.array([1e-8, 1.0, 1e8, 1e-4, 3e7])
    plain, scaled = Information.from_rows(phi, y).solve(), Information.from_rows(phi * scale, 1e6 * y).solve()
    np.testing.assert_allclose(scaled.estimate, 1e6 * plain.estimate / scale, rtol=1e-11)
    np.testing.assert_allclose(scaled.covariance, 1e12 * plain.covariance / np.outer(scale, scale), rtol=1e-9)
    assert scaled.condition == pytest.approx(plain.condition, rel=1e-9)
    assert scaled.rank == 5


def test_accuracy_is_that_of_orthogonal_triangularisation_not_of_normal_equations() -> None:
    phi = np.vander(np.linspace(0, 1, 300), 10)  # condition 1e7, squared 1e14
    theta = np.arange(1.0, 11.0)
    solution = Information.from_rows(phi, phi @ theta).solve()
    assert np.max(np.abs(solution.estimate / theta - 1)) < 1e-8


# --- what the data cannot tell ---------------------------------------------------------------------------------------


def test_a_dependent_column_is_named_with_those_it_depends_on() -> None:
    phi, y, _ = problem(100, 4)
    phi = np.column_stack([phi, 2 * phi[:, 1] - phi[:, 3]])
    solution = Information.from_rows(phi, y).solve()
    assert solution.rank == 4
    assert len(solution.aliases) == 1
    (alias,) = solution.aliases
    assert set(alias) == {1, 3, 4}
    left_out = alias[0]
    assert solution.estimate[left_out] == 0.0
    assert np.isinf(solution.covariance[left_out, left_out])
    kept = [k for k in range(5) if k != left_out]
    np.testing.assert_allclose(phi @ solution.estimate, phi @ np.linalg.lstsq(phi, y, rcond=None)[0], rtol=1e-10)
    assert np.isfinite(np.diag(solution.covariance)[kept]).all()


def test_dependence_is_found_in_spite_of_scaling_and_not_claimed_without_need() -> None:
    phi, y, _ = problem(100, 2)
    assert Information.from_rows(np.column_stack([phi, 1e-8 * phi[:, 0]]), y).solve().rank == 2
    nearly = np.column_stack([phi, phi[:, 0] + 1e-10 * np.cos(np.arange(100))])
    solution = Information.from_rows(nearly, y).solve()
    assert solution.rank == 3
    assert 1e10 < solution.condition < 1e11
    assert Information.from_rows(nearly, y).solve(rank_tolerance=1e-8).rank == 2


@pytest.mark.parametrize("seed", range(20))
def test_a_column_of_zeros_has_no_estimate_and_an_infinite_condition(seed: int) -> None:
    """Its singular value is not always computed as exactly zero, so the condition does not rest on it."""
    phi, y, _ = problem(60, 3, seed)
    phi[:, 1] = 0.0
    solution = Information.from_rows(phi, y).solve()
    assert (solution.rank, solution.aliases) == (2, ((1,),))
    assert solution.estimate[1] == 0.0
    assert np.isinf(solution.covariance[1, 1])
    assert np.isinf(solution.condition)
    expected = np.linalg.lstsq(phi[:, [0, 2]], y, rcond=None)[0]
    np.testing.assert_allclose(solution.estimate[[0, 2]], expected, rtol=1e-11)


def test_a_column_of_hardly_any_length_has_an_infinite_variance() -> None:
    rows = np.random.default_rng(1).standard_normal((20, 3)) * [1.0, 1e-158, 1.0]
    solution = Information.from_rows(rows[:, :2], rows[:, 2]).solve()
    assert solution.rank == 2
    assert np.isinf(solution.covariance[1, 1])
    assert np.isfinite(solution.covariance[0, 0])


def test_a_regression_of_zeros_explains_nothing() -> None:
    y = np.arange(10.0)
    solution = Information.from_rows(np.zeros((10, 3)), y).solve()
    assert solution.rank == 0
    assert {alias[0] for alias in solution.aliases} == {0, 1, 2}
    np.testing.assert_array_equal(solution.estimate, 0.0)
    assert solution.residual_sum_of_squares == pytest.approx(np.sum(y**2), rel=1e-14)
    assert np.isinf(np.diag(solution.covariance)).all()


def test_no_rows() -> None:
    solution = Information.empty(2).solve()
    assert solution.rank == 0
    assert solution.residual_sum_of_squares == 0.0
    assert np.isnan(solution.noise_variance)


def test_fewer_rows_than_parameters_are_fitted_exactly() -> None:
    phi, y, _ = problem(4, 7)
    solution = Information.from_rows(phi, y).solve()
    assert solution.rank == 4
    assert len(solution.aliases) == 3
    assert np.count_nonzero(solution.estimate) == 4
    np.testing.assert_allclose(phi @ solution.estimate, y, rtol=1e-11)
    assert np.isnan(solution.noise_variance)  # nothing is left to tell the noise by


@pytest.mark.parametrize(
    ("regression", "target"),
    [(np.ones(4), np.ones(4)), (np.ones((4, 2)), np.ones(3)), (np.ones((4, 2)), np.ones((4, 1)))],
)
def test_rows_of_other_shapes_are_refused(regression: Array, target: Array) -> None:
    with pytest.raises(ModelError, match="shape"):
        Information.from_rows(regression, target)


def test_rows_for_another_number_of_parameters_are_refused() -> None:
    with pytest.raises(ModelError, match="3 parameters"):
        Information.empty(3).add(np.ones((4, 2)), np.ones(4))
