"""Feedback models are fitted: estimates, intervals, initial states, and long records."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import emsid
from emsid import Record
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.estimation.nonlinear.restarts import Ends, Search
from emsid.findings import Finding
from emsid.models.blocks.static_maps import STATIC_MAPS, DeadZone, PiecewiseLinear, Saturation, TwoSlopes, UserMap
from emsid.models.feedback import fitting
from emsid.models.feedback.fitting import Found, fit_feedback, searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search import estimation
from emsid.models.feedback.search.trials import Trial
from emsid.models.free_run import squared_errors
from emsid.models.initial_states import initial_state
from emsid.models.one_channel import segments_longer_than
from feedback_models import Array, U, X, begun_trial, loop, sticking
from model_examples import DT, MAPS


def test_a_fit_finds_the_model_of_noisy_data() -> None:
    truth, rng = loop(), np.random.default_rng(1)
    u = rng.normal(size=1500)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    begin = truth.with_parameters(truth.parameters * (1 + 0.05 * rng.normal(size=len(truth.parameters))))
    fit = emsid.fit(begin, record)
    assert fit.ending is emsid.Ending.CONVERGED
    assert fit.noise_variance == pytest.approx(1e-4, rel=0.1)
    v = rng.normal(size=500)
    error = fit.model.simulate(v, dt=DT).output - truth.simulate(v, dt=DT).output
    assert np.sqrt(np.mean(error[50:] ** 2)) < 2e-3
    assert set(fit.names) >= {"x1.x1", "x2.u", "y.1"}
    assert np.all(np.sqrt(np.diag(fit.covariance)) < 0.5)


def test_a_search_keeps_to_models_that_are_not_refused() -> None:
    """Unless it begins at one that is."""
    truth, rng = loop(), np.random.default_rng(1)
    u = rng.normal(size=400)
    segments = [(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)))]
    begin = truth.with_parameters(truth.parameters * (1 + 0.05 * rng.normal(size=len(truth.parameters))))

    def radius(model: FeedbackModel) -> float:
        return float(np.abs(np.linalg.eigvals(model.matrix[: model.states, : model.states])).max())

    def least(limit: float) -> Found:
        """Among models of this spectral radius at least."""
        return searched(begin, segments, 0, 8, 0.1, refused=lambda model, *_: radius(model) < limit)

    free = least(0.0)
    limit = 0.5 * (radius(begin) + radius(free.model))
    assert radius(free.model) < limit < radius(begin)
    limited = least(limit)
    assert radius(limited.model) >= limit
    assert free.error < limited.error < 10 * free.error
    assert least(1.0).error == free.error


def test_a_model_that_depends_on_rounding_has_no_derivative() -> None:
    """The run of a tent map stays within its range, while its derivative by a parameter is 1.9 times as large every
    sample; all columns are soon the same but for rounding."""
    tent = FeedbackModel(np.array([[0.0, 0.95, 1.9], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (TwoSlopes(0.5, 1.0, -1.0),))
    u = np.random.default_rng(2).uniform(0.98, 1.0, 80)
    y, spread = tent.output(u, np.array([0.3])), np.eye(len(tent.parameters))
    assert np.all(np.abs(y - 0.5) < 0.5)

    def columns(samples: int) -> Array:
        problem = fitting.FreeRun(tent, spread, [(u[:samples], y[:samples])], 0)
        return problem.linearised(np.append(np.zeros(len(spread)), 0.3))[0][1]

    assert 1e5 < np.abs(columns(25)).max() < 1e10
    with pytest.raises(Infeasible, match="too large"):
        columns(80)


def test_intervals_hold() -> None:
    """Among 20 records, 95 % intervals of the pole and of the gain contain the truth at least 16 times."""
    truth = FeedbackModel(np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (Saturation(0.3, -0.2, 0.2),))
    inside = {"x1.x1": 0, "x1.u": 0}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = rng.normal(size=1000)
        record = Record(u, truth.output(u, np.zeros(1)) + 0.05 * rng.normal(size=len(u)), DT)
        fit = fit_feedback(truth, record)
        for name, value in (("x1.x1", 0.8), ("x1.u", 0.5)):
            k = fit.names.index(name)
            inside[name] += bool(abs(fit.estimate[k] - value) < 1.96 * np.sqrt(fit.covariance[k, k]))
    assert min(inside.values()) >= 16


def test_a_users_own_map_is_fitted() -> None:
    cubic = UserMap(
        lambda x, p: p[0] * x**3, lambda x, p: 3 * p[0] * x**2, lambda x, p: x[None] ** 3, np.array([0.2]), ("c",)
    )
    truth = FeedbackModel(np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (cubic,))
    u = np.random.default_rng(2).normal(size=100)
    begin = replace(truth, maps=(cubic.with_parameters(np.array([0.1])),))
    fit = fit_feedback(begin, Record(u, truth.output(u, np.zeros(1)), DT), max_iterations=8)
    assert np.sqrt(fit.noise_variance) < 1e-6
    assert ", c=" in fit.model.equation()


@pytest.mark.parametrize("name", STATIC_MAPS)
def test_every_map_is_fitted_in_a_loop(name: str) -> None:
    record = sticking(1)
    fit = emsid.fit(emsid.feedback(order=1, static=name, maps=1, delay=0, oversampling=1), record)
    assert fit.model.maps[0].kind == name
    linear = emsid.fit(FeedbackModel(np.array([[0.9, 0.5], [1.0, 0.0]])), record)
    assert fit.noise_variance < linear.noise_variance


def test_the_last_steps_of_a_fit_never_lose_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A penalty that begins too heavy in other coordinates would flatten the map."""
    truth = loop("spline")
    rng = np.random.default_rng(8)
    record = Record(U, truth.output(U, X) + 0.01 * rng.normal(size=len(U)), DT)
    before = fit_feedback(truth, record, max_iterations=8)
    steps, reached = fitting._last_steps, []

    def flattened(*args: object) -> tuple[Found, list[fitting.Other]]:
        last, others = steps(*args)
        reached.append(last)
        heavier = replace(last.minimum, residuals=tuple(10 * residual for residual in last.minimum.residuals))
        return replace(last, model=last.model.with_parameters(0.5 * last.model.parameters), minimum=heavier), others

    monkeypatch.setattr(fitting, "_last_steps", flattened)
    after = fit_feedback(truth, record, max_iterations=8)
    assert reached
    assert after.noise_variance == pytest.approx(before.noise_variance, rel=0.05)
    assert np.isfinite(after.covariance).all()


# --- initial states --------------------------------------------------------------------------------------------------


def test_a_state_of_unknown_sign_is_found() -> None:
    """The first samples of an absolute value fit a wrong sign almost as well, and the state decays slowly."""
    matrix = np.array([[1.0, 0.1, 0.1, 0.0], [-0.05, 0.96, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    model, errors = FeedbackModel(matrix, (MAPS["abs"],)), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u, x = np.repeat(rng.normal(size=30), 10), rng.normal(size=2)
        y = model.output(u, x)
        noisy = y[: model.memory] + 0.02 * rng.normal(size=model.memory)
        errors.append(float(np.abs(model.output(u, initial_state(model, u, noisy)) - y).max()))
    assert max(errors) < 0.3


def test_a_start_is_found_however_far_the_first_searches_get(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two tanks that overflow; the prior is weighted by the variance of the residual at the estimate."""
    for effort in ("LOOSE", "FIRST_LOOK"):
        monkeypatch.setattr(f"emsid.models.initial_states.{effort}", {"max_iterations": 0, "tolerance": 0.5})
    height = np.linspace(0, 15, 31)
    level = np.minimum(height, 10)
    falls = PiecewiseLinear(height, 0.2 * np.sqrt(level))
    stays, seen = (PiecewiseLinear(height, each) for each in (level - falls.values, level))
    matrix = np.zeros((7, 7))
    matrix[0, [2, 4]] = matrix[1, [3, 5]] = matrix[[2, 3], 0] = matrix[[4, 5], 1] = matrix[6, 6] = 1.0
    model, errors = FeedbackModel(matrix, (falls, stays, stays, seen)), []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u, x = (
            0.2 * np.interp(np.arange(1000), np.arange(0, 1000, 25), rng.uniform(1.2, 3.8, 40)),
            rng.uniform(1, 12, 2),
        )
        y = model.output(u, x)
        noisy = y[: model.memory] + 0.02 * rng.normal(size=model.memory)
        errors.append(float(np.sqrt(np.mean((model.output(u, initial_state(model, u, noisy)) - y)[:100] ** 2))))
    assert np.mean(np.array(errors) < 0.1) > 0.9


@pytest.mark.parametrize("start", [-3.0, -0.5, 0.8])
def test_a_state_that_the_input_never_leads_to_again_is_found(start: float) -> None:
    """A tank that fills up and then overflows: every state that its input leads to is hidden by the limit."""
    model = FeedbackModel(
        np.array([[0.95, 0.05, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), (Saturation(1.0, -9.0, 1.0),)
    )
    rng = np.random.default_rng(3)
    u = rng.uniform(1.5, 3.0, 300)
    y = model.output(u, np.array([start]))
    noisy = y[: model.memory] + 0.02 * rng.normal(size=model.memory)
    assert initial_state(model, u, noisy)[0] == pytest.approx(start, abs=0.03)


def test_a_state_far_from_the_usual_ones_is_not_taken_for_noise() -> None:
    """A slow state that the first samples hardly show remains near those that the input leads to."""
    matrix = np.array([[0.5, 0.0, 1.0], [0.0, 0.999, 1e-3], [1.0, 0.01, 0.0]])
    model, rng = FeedbackModel(matrix), np.random.default_rng(4)
    u = rng.normal(size=20_000)
    for k in (5_000, 9_000, 15_000):
        x = model.trajectory(u, np.zeros(2)).x[k]
        y = model.output(u[k:], x)[: model.memory] + 0.5 * rng.normal(size=model.memory)
        usual = model.reachable(u[k : k + 10_000])[:, 1]
        assert abs(initial_state(model, u[k:], y)[1] - usual.mean()) < 3 * usual.std()


# --- long records ----------------------------------------------------------------------------------------------------


def test_a_long_record_is_fitted_from_the_minimum_of_a_part(monkeypatch) -> None:
    record, begun = begun_trial(2000)
    whole = estimation._fitted([begun], [record], FREE)
    monkeypatch.setattr(estimation, "LONG", 800)
    monkeypatch.setattr(estimation, "PART", 800)
    quick = estimation._fitted([begun, estimation._in_part(begun, [record], FREE)], [record], FREE)
    errors = [float(np.nanmean(squared_errors(fit.model, [record]))) for fit in (whole, quick)]
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)
    assert quick.samples == whole.samples  # all of them, in the end


def test_a_fit_to_a_long_record_stops_within_a_step_and_within_its_covariances(monkeypatch) -> None:
    record, begun = begun_trial(2000)
    monkeypatch.setattr("emsid.models.feedback.model.BLOCK", 500)
    monkeypatch.setattr(fitting, "BLOCK", 500)
    model, asked = begun.found.model, 0
    segments = segments_longer_than(model.memory, model, [record])
    for most in (0, 2, 3, 6):  # asked three times in the derivative and four times in the covariances

        def late(most: int = most) -> bool:
            nonlocal asked
            asked += 1
            return asked > most

        asked = 0
        with pytest.raises(Stopped):
            fitting.conclude(begun.found, segments, model.edge, control=Control(cancelled=late), max_iterations=0)
        assert asked == most + 1
    parts = [rows for _, rows in model.gradients(record.input[:, 0], model.trajectory(record.input[:, 0], X))]
    monkeypatch.setattr("emsid.models.feedback.model.BLOCK", 10_000)
    whole = model.gradient(record.input[:, 0], model.trajectory(record.input[:, 0], X))
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_a_search_of_a_long_record_that_is_stopped_ends_with_a_part_of_it(monkeypatch) -> None:
    record, begun = begun_trial(2000)

    def stopped(*_: object) -> Iterator[Trial]:
        yield begun
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setattr(estimation, "chosen", stopped)
    monkeypatch.setattr(estimation, "LONG", 800)
    monkeypatch.setattr(estimation, "SEARCHED", 800)
    fit = emsid.feedback().fit(record)
    assert (fit.ending, fit.samples < 900) == (Ending.INTERRUPTED, True)
    same = [float(np.nanmean(squared_errors(model, [record]))) for model in (begun.found.model, fit.model)]
    assert same[1] == pytest.approx(same[0], rel=1e-3)


# --- searches that stall ---------------------------------------------------------------------------------------------


def test_a_search_that_stalls_is_confirmed_by_others_with_their_spread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three others end at the same cost, apart by ±1e-5 in one direction of the last search."""
    record, trial = begun_trial(600)
    begun, calls = fitting.begun_around, []
    model = trial.found.model
    usual = fit_feedback(model, record)

    def stalled(minimum: Minimum, search: Search, own: int, control: Control, **_: Any) -> tuple[Minimum, Ends]:
        assert begun(minimum, search, own, control) == (minimum, [])  # as it has converged
        calls.append(own)
        moves = 1e-5 * np.eye(1, own)[0] * np.array([[1.0], [-1.0], [1.0]])
        stall = replace(
            minimum, ending=Ending.STALLED, findings=(Finding("search-stalled", "", {"steps": 1, "offset": 2.0}),)
        )
        return stall, [(minimum.cost, minimum.estimate[:own] + move) for move in moves]

    monkeypatch.setattr(fitting, "begun_around", stalled)
    fit = fit_feedback(model, record)
    assert calls
    assert fit.ending is Ending.CONVERGED
    assert [finding.code for finding in fit.findings] == ["minimum-not-smooth"]
    np.testing.assert_array_equal(fit.estimate, usual.estimate)
    added = fit.covariance - usual.covariance
    sizes = np.linalg.eigvalsh(added)
    assert sizes[-1] > 1e-13
    assert np.abs(sizes[:-1]).max() < 0.05 * sizes[-1]
    monkeypatch.setattr(fitting, "BEGUN_AGAIN", 500)
    calls.clear()
    assert fit_feedback(model, record).ending is Ending.CONVERGED
    assert not calls


# --- sides that are not reached --------------------------------------------------------------------------------------


def test_no_step_leads_to_a_slope_without_bound() -> None:
    """The left side of a dead zone is not reached, so that its slope changes nothing, however large it becomes."""
    matrix = np.array([[0.8, 0.5, -0.3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    model, u = FeedbackModel(matrix, (DeadZone(-3.0, 0.3),), dt=DT), np.abs(U)
    problem = fitting.FreeRun(model, np.eye(len(model.parameters)), [(u, model.output(u, np.zeros(1)))], 0)
    theta = np.zeros(len(model.parameters) + 1)
    left = model.names.index("f.m_l")
    theta[left] = 1e11
    np.testing.assert_array_equal(problem.residuals(theta)[0], 0.0)
    theta[left] = 1e13
    with pytest.raises(Infeasible, match="without bound"):
        problem.residuals(theta)
