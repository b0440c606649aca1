"""The Gauss–Newton search against SciPy, at bounds, with outliers, and where it cannot converge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares, lsq_linear

from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.linear.information import Information
from emsid.estimation.nonlinear import gauss_newton as module
from emsid.estimation.nonlinear.control import FREE, Activity, Control, Stopped
from emsid.estimation.nonlinear.few_unknowns import few_unknowns
from emsid.estimation.nonlinear.gauss_newton import PATIENCE, each_step, gauss_newton
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import SQUARES, Cauchy, Huber, Infeasible, Loss, without
from emsid.estimation.nonlinear.smoothing import Penalty, Smoothing
from emsid.estimation.nonlinear.steps import bounded_step
from emsid.estimation.uncertainty.robust_covariance import automatic_window, long_run_variance, weighted_variance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Curves:
    """Residuals of one or more experiments with one derivative function each."""

    residual: Callable[[Array], list[Array]]
    jacobian: Callable[[Array], list[Array]]

    def residuals(self, theta: Array) -> Sequence[Array]:
        return self.residual(theta)

    def linearised(self, theta: Array) -> Sequence[tuple[Array, Array]]:
        return list(zip(self.residual(theta), self.jacobian(theta), strict=True))


def decay(noise: float = 0.05, outliers: float = 0.0, experiments: int = 1) -> Curves:
    """y = a·exp(−bx) + c, split over experiments."""
    x = np.linspace(0, 5, 240)
    y = 2 * np.exp(-1.3 * x) + 0.5 + noise * np.random.default_rng(0).standard_normal(len(x))
    y[::12] += outliers
    parts = np.array_split(np.arange(len(x)), experiments)

    def residual(theta: Array) -> list[Array]:
        return [theta[0] * np.exp(-theta[1] * x[i]) + theta[2] - y[i] for i in parts]

    def jacobian(theta: Array) -> list[Array]:
        e = [np.exp(-theta[1] * x[i]) for i in parts]
        return [np.column_stack([ei, -theta[0] * x[i] * ei, np.ones_like(ei)]) for ei, i in zip(e, parts, strict=True)]

    return Curves(residual, jacobian)


def codes(found: Minimum) -> list[str]:
    return [finding.code for finding in found.findings]


def by_scipy(problem: Curves, start: list[float], lower: object, upper: object, loss: str = "linear") -> Array:
    found = least_squares(
        lambda t: np.concatenate(problem.residual(t)),
        start,
        lambda t: np.concatenate(problem.jacobian(t)),
        bounds=(lower, upper),
        method="dogbox",
        loss=loss,
        f_scale=0.1,
        ftol=1e-15,
        xtol=1e-15,
        gtol=1e-15,
    )
    return np.asarray(found.x)


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        (-np.inf, np.inf),
        ([0, 0, 0], [9, 9, 9]),
        ([0, 0, 0.6], [3, 9, 2]),  # one bound is touched
        ([0, 0, 0.6], [3, 1.2, 2]),  # two are
        ([0, 0, 0.6], [1.5, 1.2, 2]),  # all are
    ],
)
def test_finds_the_minimum_that_scipy_finds(lower: object, upper: object) -> None:
    problem, start = decay(), [1.0, 1.0, 0.7]
    found = gauss_newton(problem, start, lower=lower, upper=upper, tolerance=1e-9)
    assert found.ending is Ending.CONVERGED
    np.testing.assert_allclose(found.estimate, by_scipy(problem, start, lower, upper), rtol=1e-8)


@pytest.mark.parametrize(("loss", "name"), [(SQUARES, "linear"), (Huber(0.1), "huber"), (Cauchy(0.1), "cauchy")])
def test_robust_losses_agree_with_scipy_and_ignore_outliers(loss: Loss, name: str) -> None:
    problem, start = decay(outliers=3.0), [1.0, 1.0, 0.7]
    found = gauss_newton(problem, start, loss=loss, tolerance=1e-9)
    np.testing.assert_allclose(found.estimate, by_scipy(problem, start, -np.inf, np.inf, name), rtol=1e-7)
    if loss is not SQUARES:
        assert np.abs(found.estimate - [2, 1.3, 0.5]).max() < 0.1


@pytest.mark.parametrize("loss", [SQUARES, Huber(0.4), Cauchy(0.4)])
def test_loss_derivatives(loss: Loss) -> None:
    r = np.linspace(-2, 2, 41) + 0.003
    step = 1e-5
    slope = (loss.cost(r + step) - loss.cost(r - step)) / (2 * step)
    bend = (loss.cost(r + step) - 2 * loss.cost(r) + loss.cost(r - step)) / step**2
    np.testing.assert_allclose(loss.weight(r) * r, slope, atol=1e-8)
    np.testing.assert_allclose(loss.curvature(r), bend, atol=1e-4)


def test_several_experiments_equal_one() -> None:
    whole = gauss_newton(decay(), [1, 1, 0.7], tolerance=1e-9)
    parts = gauss_newton(decay(experiments=5), [1, 1, 0.7], tolerance=1e-9)
    np.testing.assert_allclose(parts.estimate, whole.estimate, rtol=1e-10)
    np.testing.assert_allclose(parts.white_covariance, whole.white_covariance, rtol=1e-8)


def test_equal_bounds_fix_a_parameter_and_the_rest_is_the_smaller_problem() -> None:
    found = gauss_newton(decay(), [1, 1.3, 0.7], lower=[-9, 1.3, -9], upper=[9, 1.3, 9], tolerance=1e-9)
    assert found.estimate[1] == 1.3
    assert found.free.tolist() == [True, False, True]
    assert found.covariance[1].tolist() == [0, 0, 0]
    x = np.linspace(0, 5, 240)
    y = -decay().residual(np.zeros(3))[0]
    linear = np.linalg.lstsq(np.column_stack([np.exp(-1.3 * x), np.ones_like(x)]), y)[0]
    np.testing.assert_allclose(found.estimate[[0, 2]], linear, rtol=1e-10)


@pytest.mark.parametrize("together", [0.0, 0.5, 30.0])
def test_a_step_within_bounds_is_that_of_scipy(together: float) -> None:
    """``together`` makes the columns similar, so that several bounds take turns."""
    rng = np.random.default_rng(8)
    reached = 0
    for n in rng.integers(1, 10, 40):
        phi = (rng.standard_normal((30, n)) + together * rng.standard_normal((30, 1))) * 10.0 ** rng.uniform(-4, 4, n)
        y = rng.standard_normal(30)
        size = np.abs(np.linalg.lstsq(phi, y)[0])
        lower, upper = -size * rng.uniform(0, 2, n), size * rng.choice([0.1, 0.5, 2.0, np.inf], n)
        lower[rng.random(n) < 0.2] = 0.0
        step = bounded_step(Information.from_rows(phi, y), lower, upper)
        expected = lsq_linear(phi * size, y, (lower / size, upper / size), "bvls", tol=1e-15).x
        np.testing.assert_allclose(step / size, expected, rtol=1e-6, atol=1e-7)
        reached += int(np.sum((step == lower) | (step == upper)))
    assert reached > 40


def test_a_linear_problem_is_solved_as_least_squares_with_its_covariance() -> None:
    rng = np.random.default_rng(1)
    phi, y = rng.standard_normal((300, 4)) * [1, 1e-3, 1e3, 1], rng.standard_normal(300)
    problem = Curves(lambda t: [phi @ t - y], lambda t: [phi])
    found = gauss_newton(problem, np.zeros(4), tolerance=1e-9)
    expected = np.linalg.lstsq(phi, y)[0]
    np.testing.assert_allclose(found.estimate, expected, rtol=1e-8)
    variance = np.sum((phi @ expected - y) ** 2) / 296
    scale = np.sqrt(np.diag(variance * np.linalg.inv(phi.T @ phi)))
    np.testing.assert_allclose(np.sqrt(np.diag(found.white_covariance)), scale, rtol=1e-8)


def test_rosenbrock_without_residual_ends_converged() -> None:
    problem = Curves(
        lambda t: [np.array([10 * (t[1] - t[0] ** 2), 1 - t[0]])],
        lambda t: [np.array([[-20 * t[0], 10], [-1, 0.0]])],
    )
    found = gauss_newton(problem, [-1.2, 1.0])
    assert found.ending is Ending.CONVERGED
    np.testing.assert_allclose(found.estimate, 1, rtol=1e-10)


@pytest.mark.parametrize("loss", [SQUARES, Huber(5.0)], ids=["squares", "huber"])
def test_steps_follow_a_curved_valley(loss: Loss) -> None:
    """A valley a thousand times narrower than long; the two residuals that are constant set the accuracy asked for."""
    problem = Curves(
        lambda t: [np.array([1000 * (t[1] - t[0] ** 2), 1 - t[0], 0.5, 0.5])],
        lambda t: [np.array([[-2000 * t[0], 1000], [-1, 0.0], [0, 0], [0, 0]])],
    )
    bent, straight = (
        gauss_newton(problem, [-1.5, 2.0], loss=loss, max_iterations=400, accelerated=each) for each in (True, False)
    )
    assert straight.ending is bent.ending is Ending.CONVERGED
    np.testing.assert_allclose(bent.estimate, 1, rtol=2e-3)
    assert bent.iterations < straight.iterations / 4


def test_a_search_ends_where_further_steps_are_rounding() -> None:
    exact = gauss_newton(decay(noise=0.0), [1.0, 1.0, 0.0])
    rounded = gauss_newton(decay(noise=0.0), [1.0, 1.0, 0.0], noise=1e-3)
    assert rounded.ending is exact.ending is Ending.CONVERGED
    assert rounded.iterations < exact.iterations
    assert rounded.costs == exact.costs[: len(rounded.costs)]
    jacobian = decay().jacobian(exact.estimate)[0]
    away = float(np.linalg.norm(jacobian @ (rounded.estimate - exact.estimate))) / np.sqrt(3)
    assert 0 < away < 1e-3 * 1e-3  # standard errors that such a noise makes, by the default tolerance


def test_infeasible_steps_are_shortened() -> None:
    """log(θ) exists only for θ > 0, and the full step from 40 to its zero at 1 goes far below."""

    def residual(theta: Array) -> list[Array]:
        if theta[0] <= 0:
            raise Infeasible("logarithm of a negative number")
        return [np.array([np.log(theta[0])])]

    found = gauss_newton(Curves(residual, lambda t: [np.array([[1 / t[0]]])]), [40.0])
    np.testing.assert_allclose(found.estimate, 1, rtol=1e-9)
    with pytest.raises(ModelError, match="logarithm"):
        gauss_newton(Curves(residual, lambda t: [np.array([[1 / t[0]]])]), [-1.0])


def test_a_step_to_parameters_without_a_derivative_is_shortened() -> None:
    """The cost is lower there, so the last parameters that have a derivative are the result."""

    class Steep:
        def residuals(self, theta: Array) -> list[Array]:
            return [np.full(3, theta[0] - 1.0)]

        def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
            return [(np.full(3, theta[0] - 1.0), np.full((3, 1), 1.0 if theta[0] < 0.9 else 1e200))]

    found = gauss_newton(Steep(), [0.0])
    assert 0.5 < found.estimate[0] < 0.9
    assert found.ending is Ending.STALLED


def test_a_penalty_that_is_too_heavy_does_not_flatten_the_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begun at the minimum of the data, a search with a far too heavy penalty stays near it."""
    rng = np.random.default_rng(0)
    wave = np.sin(np.arange(400) / 20)
    y = 2.0 * wave + 0.1 * rng.normal(size=400)

    class Wave:
        def residuals(self, theta: Array) -> list[Array]:
            return [theta[0] * wave - y]

        def linearised(self, theta: Array) -> list[tuple[Array, Array]]:
            return [(theta[0] * wave - y, wave[:, None])]

    monkeypatch.setattr(module, "chosen_weights", lambda *_: np.array([1e3]))
    found = gauss_newton(Wave(), [2.0], smoothing=Smoothing([Penalty(np.ones((1, 1)), np.zeros(1))]))
    assert np.std(found.residuals[0]) < 0.11
    assert found.estimate[0] > 1.95


def test_endings_other_than_convergence() -> None:
    problem = decay()
    short = gauss_newton(problem, [1, 9, 0.7], max_iterations=1)
    assert short.ending is Ending.OUT_OF_BUDGET
    assert codes(short) == ["steps-used-up"]
    assert short.findings[0].data["steps"] == short.iterations == 1
    assert short.findings[0].data["offset"] > 1e-3
    late = gauss_newton(problem, [1, 9, 0.7], control=FREE.within(0))
    assert (late.ending, codes(late), late.iterations) == (Ending.OUT_OF_BUDGET, ["time-used-up"], 0)
    assert gauss_newton(problem, [1, 1, 0.7], control=FREE.within(600)).findings == ()
    backwards = Curves(problem.residual, lambda t: [-j for j in problem.jacobian(t)])
    stalled = gauss_newton(backwards, [1, 1, 0.7])
    assert stalled.ending is Ending.STALLED
    assert codes(stalled) == ["search-stalled"]
    assert stalled.findings[0].data["offset"] > 1e-3
    alias = Curves(
        lambda t: problem.residual(np.array([t[0] + t[3], *t[1:3]])),
        lambda t: [np.column_stack([j, j[:, 0]]) for j in problem.jacobian(np.array([t[0] + t[3], *t[1:3]]))],
    )
    deficient = gauss_newton(alias, [1, 1, 0.7, 0.1], names=("a", "b", "c", "d"))
    assert deficient.ending is Ending.RANK_DEFICIENT
    assert codes(deficient) == ["parameters-undetermined"]
    assert deficient.findings[0].data == {"without_effect": [], "inseparable": [["d", "a"]]}
    assert np.isinf(np.diag(deficient.covariance)).sum() == 1


def test_a_search_ends_in_a_valley_where_the_cost_hardly_falls() -> None:
    """Rosenbrock's, beside a residual of 100 that no parameter changes: all there is to gain is 0.24 % of the cost."""
    problem = Curves(
        lambda t: [np.array([10 * (t[1] - t[0] ** 2), 1 - t[0], 100.0])],
        lambda t: [np.array([[-20 * t[0], 10], [-1, 0.0], [0.0, 0.0]])],
    )
    whole = gauss_newton(problem, [-1.2, 1.0], tolerance=1e-8)
    assert whole.ending is Ending.CONVERGED
    np.testing.assert_allclose(whole.estimate, 1, rtol=1e-4)
    short = gauss_newton(problem, [-1.2, 1.0], tolerance=1e-8, least_saving=0.01)
    assert short.ending is Ending.OUT_OF_BUDGET
    assert codes(short) == ["cost-hardly-falls"]
    assert short.findings[0].data["last_steps"] == PATIENCE
    assert short.costs == whole.costs[: PATIENCE + 1]
    assert gauss_newton(problem, [-1.2, 1.0], tolerance=1e-8, least_saving=1e-9).costs == whole.costs


def test_an_active_bound_is_named() -> None:
    found = gauss_newton(decay(), [1, 1, 0.7], lower=[0, 0, 0.6], upper=9, names=("gain", "rate", "rest"))
    assert [(f.code, f.subject, f.data) for f in found.findings] == [
        ("parameter-at-bound", "rest", {"side": "lower", "bound": 0.6})
    ]
    fixed = gauss_newton(decay(), [1, 1, 0.6], lower=[0, 0, 0.6], upper=[9, 9, 0.6])
    np.testing.assert_allclose(found.estimate, fixed.estimate, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, fixed.covariance, rtol=1e-4)
    assert found.covariance[2, 2] == 0


def test_a_cancelled_search_keeps_the_best_so_far() -> None:
    seen: list[Activity] = []
    control = Control(cancelled=lambda: len(seen) == 2, report=seen.append).during("decay")
    found = gauss_newton(decay(), [1, 9, 0.7], control=control, tolerance=1e-9)
    assert (found.ending, codes(found), found.iterations) == (Ending.INTERRUPTED, ["search-cancelled"], 2)
    assert [(activity.doing, activity.done, activity.total) for activity in seen] == [
        ("decay", 1, None),
        ("decay", 2, None),
    ]
    assert found.cost == seen[-1].cost < found.costs[0]
    assert found.findings[0].data == {"steps": 2, "offset": seen[-1].offset}
    there = gauss_newton(decay(), found.estimate, max_iterations=0)
    np.testing.assert_array_equal(found.covariance, there.covariance)


def test_a_problem_that_is_stopped_within_a_step_ends_the_search_before_that_step() -> None:
    """A slow simulation looks at its `Control` itself."""
    calls = iter(range(1000))

    def residual(theta: Array) -> list[Array]:
        if next(calls) >= 12:
            raise Stopped(Ending.INTERRUPTED)
        return decay().residual(theta)

    found = gauss_newton(Curves(residual, decay().jacobian), [1, 9, 0.7], tolerance=1e-9)
    whole = gauss_newton(decay(), [1, 9, 0.7], tolerance=1e-9)
    assert (found.ending, codes(found)) == (Ending.INTERRUPTED, ["search-cancelled"])
    assert 0 < found.iterations < whole.iterations
    assert found.costs == whole.costs[: len(found.costs)]


def test_a_search_without_covariances_finds_the_same_minimum() -> None:
    found, whole = (gauss_newton(decay(), [1, 9, 0.7], covariances=wanted) for wanted in (False, True))
    np.testing.assert_array_equal(found.estimate, whole.estimate)
    assert np.isinf(np.diag(found.covariance)).all()
    assert np.isfinite(whole.covariance).all()


def test_a_control_ends_a_search() -> None:
    assert FREE.ending is None
    FREE.check()
    assert Control(cancelled=lambda: True).within(0).ending is Ending.INTERRUPTED
    with pytest.raises(Stopped) as stopped:
        FREE.within(-1).doing("waiting")
    assert stopped.value.ending is Ending.OUT_OF_BUDGET
    heard: list[Activity] = []
    outer = Control(report=heard.append)
    outer.during("motor").doing("refining", 1, 4)
    outer.during("motor").quietly().doing("nothing")
    assert heard == [Activity("motor: refining", 1, 4)]


@pytest.mark.parametrize(
    ("start", "options", "message"),
    [
        ([[1.0]], {}, "shape"),
        ([1, np.nan, 1], {}, "θ2 is nan"),
        ([1, 1, 1], {"lower": 2}, "outside its bounds"),
        ([1, 1, 1], {"lower": [0, 3, 0], "upper": 2}, "must not exceed"),
        ([1, 1, 1], {"names": ("a",)}, "1 names for 3"),
        ([1, -1e9, 1], {}, "not finite"),
    ],
)
def test_bad_input(start: object, options: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        gauss_newton(decay(), start, **options)  # type: ignore[arg-type]


def test_bad_problems() -> None:
    with pytest.raises(ModelError, match=r"give \(N,\) and \(N, 3\)"):
        gauss_newton(Curves(decay().residual, lambda t: [np.ones((240, 2))]), [1, 1, 1])
    with pytest.raises(ModelError, match=r"parameters \[1\] is not finite"):
        gauss_newton(Curves(decay().residual, lambda t: [np.full((240, 3), [1, np.nan, 1])]), [1, 1, 1])
    with pytest.raises(ModelError, match=r"parameters \[1, 2\] is not finite"):
        gauss_newton(Curves(decay().residual, lambda t: [np.full((240, 3), [1, np.inf, -np.inf])]), [1, 1, 1])
    with pytest.raises(ModelError, match="1 samples for 2"):
        gauss_newton(Curves(lambda t: [np.ones(1)], lambda t: [np.ones((1, 2))]), [1, 1])
    with pytest.raises(ModelError, match="positive number"):
        Huber(0.0)


def test_batch_sums_are_the_newey_west_estimate() -> None:
    scores = np.random.default_rng(2).standard_normal((60, 3)).cumsum(axis=0)
    window = 7
    expected = scores.T @ scores
    for k in range(1, window):
        gamma = scores[k:].T @ scores[:-k]
        expected += (1 - k / window) * (gamma + gamma.T)
    np.testing.assert_allclose(weighted_variance([scores], window), expected, rtol=1e-10)


def test_window_is_short_for_white_scores_and_long_for_coloured_ones() -> None:
    rng = np.random.default_rng(3)
    white = rng.standard_normal((20_000, 2))
    pole, coloured = 0.9, white.copy()
    for t in range(1, len(coloured)):
        coloured[t] += pole * coloured[t - 1]
    assert automatic_window([white]) <= 5
    assert automatic_window([np.zeros((10, 2))]) == 1
    truth = 1 / (1 - pole) ** 2 * len(white)
    assert np.diag(long_run_variance([coloured])) == pytest.approx(truth, rel=0.25)


@pytest.mark.parametrize("experiments", [1, 3])
def test_a_search_with_few_unknowns_finds_the_same_minimum(experiments: int) -> None:
    problem = decay(experiments=experiments)
    expected = gauss_newton(problem, [5.0, 0.2, -3.0], tolerance=1e-9)
    found, residuals = few_unknowns(problem, np.array([5.0, 0.2, -3.0]), max_iterations=100, tolerance=1e-9)
    assert found == pytest.approx(expected.estimate, rel=1e-7)
    assert np.concatenate(residuals) == pytest.approx(np.concatenate(expected.residuals), abs=1e-7)


def test_a_search_with_few_unknowns_solves_a_linear_problem_in_one_step() -> None:
    rng = np.random.default_rng(3)
    matrix, target = rng.standard_normal((30, 4)) * [1, 1e3, 1e-3, 1], rng.standard_normal(30)
    problem = Curves(lambda theta: [matrix @ theta - target], lambda theta: [matrix])
    found, _ = few_unknowns(problem, np.zeros(4), max_iterations=1, tolerance=0.0)
    assert found == pytest.approx(np.linalg.lstsq(matrix, target, rcond=None)[0], rel=1e-9)


def test_a_search_with_few_unknowns_refuses_a_derivative_whose_square_with_a_damping_is_no_number() -> None:
    problem = Curves(lambda theta: [1e145 * theta - 1.0], lambda theta: [np.full((1, 1), 1e145)])
    with pytest.raises(ModelError, match="not finite"):
        few_unknowns(problem, np.ones(1), max_iterations=5, tolerance=0.0)


def test_a_search_with_few_unknowns_shortens_infeasible_steps_and_refuses_a_start_without_residual() -> None:
    def residual(theta: Array) -> list[Array]:
        if theta[0] <= 0:
            raise Infeasible("a logarithm of nothing")
        return [np.array([np.log(theta[0]), 0.1])]

    problem = Curves(residual, lambda theta: [np.array([[1 / theta[0]], [0.0]])])
    found, _ = few_unknowns(problem, np.array([20.0]), max_iterations=50, tolerance=1e-8)
    assert found == pytest.approx([1.0], abs=1e-6)
    with pytest.raises(ModelError, match="logarithm"):
        few_unknowns(problem, np.array([-1.0]), max_iterations=5, tolerance=1e-8)
    with pytest.raises(ModelError, match="not finite"):
        few_unknowns(Curves(lambda theta: [theta * np.nan], lambda theta: [np.eye(1)]), np.ones(1),
                     max_iterations=5, tolerance=0.1)  # fmt: skip


def test_a_derivative_whose_square_overflows_is_refused() -> None:
    """Its least-squares problem has no solution; a search takes a shorter step."""

    def steep(theta: Array) -> Array:
        return np.full((3, 1), 1e200 if theta[0] > 1.5 else 1.0)

    curves = Curves(lambda theta: [np.full(3, theta[0] - 2.0) + np.arange(3) * 0.1], lambda theta: [steep(theta)])
    with pytest.raises(Infeasible, match="too large"):
        gauss_newton(curves, [1.7])
    with pytest.raises(ModelError, match="not finite"):
        few_unknowns(curves, np.array([1.7]), max_iterations=5, tolerance=0.1)
    found = gauss_newton(curves, [0.0])
    assert 0 < found.estimate[0] <= 1.5


def test_a_negative_number_of_steps_is_refused() -> None:
    with pytest.raises(ModelError, match=r"max_iterations -1: .* at least 0"):
        gauss_newton(decay(), [0.5, 3.0, 0.0], max_iterations=-1)


@pytest.mark.parametrize("steps", [1, 3, 100])
def test_a_few_steps_end_where_the_search_does_without_the_last_derivative(steps):
    whole, derivatives = decay(), []

    def jacobian(theta: Array) -> list[Array]:
        derivatives.append(theta)
        return whole.jacobian(theta)

    problem, start, box = Curves(whole.residual, jacobian), [0.5, 3.0, 0.0], {"lower": 0.0, "upper": 10.0}
    searched = gauss_newton(problem, start, max_iterations=steps, covariances=False, **box)
    at_every_step = len(derivatives)
    derivatives.clear()
    *_, last = islice(each_step(problem, start, **box), steps)
    assert np.array_equal(last, searched.estimate)
    assert len(derivatives) == at_every_step - (searched.ending is Ending.OUT_OF_BUDGET)


def test_a_problem_without_samples_is_that_of_the_others() -> None:
    """The masks also cover samples before the first residual."""
    rng = np.random.default_rng(4)
    rows = [rng.standard_normal((n, 3)) for n in (40, 25)]
    values = [rng.standard_normal(n) for n in (40, 25)]
    out = [rng.random(n) < 0.3 for n in (47, 25)]

    def residual(theta: Array) -> list[Array]:
        return [a @ theta - b for a, b in zip(rows, values, strict=True)]

    whole = Curves(residual, lambda _: rows)
    kept = [~out[0][7:], ~out[1]]
    expected = np.linalg.lstsq(
        np.vstack([a[k] for a, k in zip(rows, kept, strict=True)]),
        np.concatenate([b[k] for b, k in zip(values, kept, strict=True)]),
    )[0]
    found = gauss_newton(without(whole, out), np.zeros(3), tolerance=1e-9)
    np.testing.assert_allclose(found.estimate, expected, rtol=1e-9)
    assert found.samples == sum(np.count_nonzero(each) for each in kept)
    assert without(whole, None) is whole
