"""NIST's certified linear regressions, and what double precision lets any solver say about them.

A regression that reaches a solver has been rounded to doubles; the exact least-squares solution of the rounded matrix,
found here in rational arithmetic, is the best answer there is. `emsid.solve_rows` gives it to 15 digits, also where the
rounding alone (Filip) or plain double arithmetic (Wampler 5) leaves far fewer. Where `emsid.least_squares` makes the
regressors itself it knows what rounding took from them, and comes to the certified digits of Filip as well.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from emsid import Information, Record, Structure, least_squares, solve_rows

Array = NDArray[np.float64]
PROBLEMS = tomllib.loads((Path(__file__).parent / "nist" / "linear.toml").read_text("utf-8"), parse_float=Fraction)
MOST_DIGITS = 15.0  # NIST certifies no more


def exact_solution(regression: list[list[Fraction]], target: list[Fraction]) -> list[Fraction]:
    """θ of the normal equations, by Gauss–Jordan elimination without rounding."""
    columns = [*zip(*regression, strict=True), target]
    n = len(columns) - 1
    rows = [[sum(a * b for a, b in zip(columns[i], columns[j], strict=True)) for j in range(n + 1)] for i in range(n)]
    for k in range(n):
        for i in range(n):
            if i != k:
                ratio = rows[i][k] / rows[k][k]
                rows[i] = [a - ratio * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [rows[k][n] / rows[k][k] for k in range(n)]


def digits(found: Array | list[Fraction], wanted: list[Fraction]) -> float:
    """Correct significant digits of the worst coefficient (log relative error), at most `MOST_DIGITS`."""
    errors = [abs((Fraction(f) - w) / w) for f, w in zip(found, wanted, strict=True)]
    return min(MOST_DIGITS, -float(np.log10(max(1e-99, float(max(errors))))))


@dataclass(frozen=True)
class Problem:
    """A certified problem, as printed and as doubles.

    Attributes:
        decimal: Φ and y as NIST prints them, powers formed exactly.
        regression, target: Φ and y in doubles, powers formed in doubles.
        certified: estimate with 15 digits.
        standard_error, residual_deviation: certified, zero where the fit is perfect.
    """

    decimal: tuple[list[list[Fraction]], list[Fraction]]
    regression: Array
    target: Array
    certified: list[Fraction]
    standard_error: Array
    residual_deviation: float

    @property
    def of_doubles(self) -> list[Fraction]:
        """The exact solution of the problem after rounding."""
        rows = [[Fraction(value) for value in row] for row in self.regression.tolist()]
        return exact_solution(rows, [Fraction(value) for value in self.target.tolist()])


@cache
def problem(name: str) -> Problem:
    stored = PROBLEMS[name]
    columns = [[Fraction(value) for value in column] for column in stored["x"]]
    if len(columns) == 1:
        decimal = [[x**power for power in stored["powers"]] for x in columns[0]]
        regression = np.column_stack([np.array(columns[0], dtype=float) ** power for power in stored["powers"]])
    else:
        decimal = [[Fraction(1), *row] for row in zip(*columns, strict=True)]
        regression = np.array(decimal, dtype=float)
    return Problem(
        (decimal, [Fraction(value) for value in stored["y"]]),
        regression,
        np.array(stored["y"], dtype=float),
        [Fraction(value) for value in stored["estimate"]],
        np.array(stored["standard_error"], dtype=float),
        float(stored["residual_deviation"]),
    )


def by_lapack(phi: Array, y: Array) -> Array:
    q, r = qr(phi, mode="economic")
    solution: Array = solve_triangular(r, q.T @ y)
    return solution


every_problem = pytest.mark.parametrize("name", list(PROBLEMS))


def test_there_are_eleven_problems() -> None:
    wampler = {f"Wampler{k}" for k in range(1, 6)}
    assert set(PROBLEMS) == {"Norris", "Pontius", "NoInt1", "NoInt2", "Filip", "Longley"} | wampler


@every_problem
def test_the_stored_data_give_the_certified_values(name: str) -> None:
    case = problem(name)
    rows, target = case.decimal
    theta = exact_solution(rows, target)
    assert digits(theta, case.certified) > 14.0
    residuals = [y - sum(a * b for a, b in zip(row, theta, strict=True)) for row, y in zip(rows, target, strict=True)]
    squares = sum(r * r for r in residuals) / (len(target) - len(theta))
    assert float(squares) ** 0.5 == pytest.approx(case.residual_deviation, rel=5e-14)


@every_problem
def test_refined_solution_is_exact_for_the_given_matrix(name: str) -> None:
    case = problem(name)
    assert digits(solve_rows(case.regression, case.target).estimate, case.of_doubles) >= 14.9


@every_problem
def test_certified_digits_as_far_as_double_precision_allows(name: str) -> None:
    case = problem(name)
    reached = digits(solve_rows(case.regression, case.target).estimate, case.certified)
    allowed = digits(case.of_doubles, case.certified)
    assert reached >= min(12.0, allowed - 0.01)
    assert allowed >= 12.0 or name == "Filip"  # its rounded powers of x are another problem, from the 8th digit on


@pytest.mark.parametrize("name", [name for name, stored in PROBLEMS.items() if len(stored["x"]) == 1])
def test_certified_digits_with_powers_by_the_structure(name: str) -> None:
    """Then what their rounding loses is known, and Filip, too, has its digits."""
    stored, case = PROBLEMS[name], problem(name)
    x = np.array([float(Fraction(value)) for value in stored["x"][0]])
    structure = Structure.parse(*(f"u(t)^{power}" if power else "1" for power in stored["powers"]))
    fit = least_squares(structure, Record(x, case.target, 1.0), refinements=4)
    assert digits(fit.estimate, case.certified) >= 12.0


@every_problem
def test_at_least_as_many_digits_as_lapack(name: str) -> None:
    case = problem(name)
    wanted = case.of_doubles
    ours = digits(solve_rows(case.regression, case.target).estimate, wanted)
    assert ours >= min(digits(by_lapack(case.regression, case.target), wanted), 14.0)


@every_problem
def test_unrefined_solution_is_as_good_as_a_backward_stable_one_can_be(name: str) -> None:
    """Householder's error bound: about ε(κ + κ²ρ), κ the condition number, ρ the residual against the fit."""
    case = problem(name)
    plain = Information.from_rows(case.regression, case.target).solve()
    theta = np.array([float(value) for value in case.of_doubles])
    length = np.linalg.norm(case.regression, axis=0)
    misfit = np.sqrt(plain.residual_sum_of_squares) / np.linalg.norm(length * theta)
    bound = 8 * np.finfo(float).eps * (plain.condition + plain.condition**2 * misfit)
    assert np.linalg.norm(length * (plain.estimate - theta)) <= bound * np.linalg.norm(length * theta)


@every_problem
def test_certified_standard_errors_and_residual_deviation(name: str) -> None:
    case = problem(name)
    solution = solve_rows(case.regression, case.target)
    assert solution.rank == len(case.certified)
    assert solution.aliases == ()
    floor = 1e-13 * np.linalg.norm(case.target)  # where the certified residual is zero, rounding remains
    assert np.sqrt(solution.noise_variance) == pytest.approx(case.residual_deviation, rel=1e-7, abs=floor)
    if case.residual_deviation:
        np.testing.assert_allclose(np.sqrt(np.diag(solution.covariance)), case.standard_error, rtol=1e-6)
