"""The normal form of feedback models: its units, its exactness, and the intervals of its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import emsid
from coverage_feedback import CASES, Signal, fitted, noisy, white
from emsid import FeedbackModel
from emsid.blocks import Polynomial
from emsid.models.blocks.static_maps import Scaling
from emsid.models.feedback.coordinates import always_fixed, free_lines
from emsid.models.feedback.curves import map_band
from emsid.models.feedback.curves import visited as visited_in
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.normal_form import CORRELATED, normal_form, power_of, squared_gains
from emsid.models.feedback.search.rectified_output import as_feedback
from feedback_models import Array, U, X, loop, multiplied
from independent.nonlinear_systems import duffing
from model_examples import DT, MAPS
from test_feedback import visited, wiener_hammerstein
from test_map_bands import MOTOR, SPRING, held, smooth

LONG = ("polynomial", "product", "sensor")


# --- the form --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [loop, multiplied])
@pytest.mark.parametrize("name", MAPS)
def test_the_form_changes_no_output(name: str, make: Callable[[str], FeedbackModel]) -> None:
    """On the record whose signals define it, and on another one of twice the size."""
    model = make(name)
    same = normal_form(model, visited(model))
    for size in (1.0, 2.0):
        expected = model.output(size * U, X)
        np.testing.assert_allclose(same.model.output(size * U, same.state(X)), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("make", [loop, multiplied])
def test_its_units_are_those_of_signals(make: Callable[[], FeedbackModel]) -> None:
    model = make()
    form = normal_form(model, visited(model))
    same, n = form.model, form.model.states
    seen = visited(same, U, form.state(X))
    sizes = [*np.std(seen.x, axis=0), np.std(seen.u)]
    g = same.factor(seen.x, seen.u)
    for i, each in enumerate(same.maps):
        assert min(abs(np.std(seen.z[:, i]) / sizes - 1)) < 1e-9
        column = np.append(same.matrix[:n, n + 1 + i], same.matrix[-1, n + 1 + i])
        assert column @ squared_gains(same, seen, i, power_of(seen.w[:, i])) @ column == pytest.approx(1.0)
        if free_lines(same, i, seen.z[:, i]).size:
            line = [] if i in same.multiplied else [seen.z[:, i]]
            for against in (np.ones(len(U)), *line):
                assert abs(np.mean(each.value(seen.z[:, i]) * g[:, i] ** 2 * against)) < 1e-9 * np.std(seen.w[:, i])
    for i in same.multiplied:
        levels = [*np.sqrt(np.mean(np.square(np.column_stack([seen.x, seen.u])), axis=0)), 1.0]
        assert min(abs(np.sqrt(np.mean(g[:, i] ** 2)) / levels - 1)) < 1e-9


def fast(poles: Array) -> FeedbackModel:
    """A linear system of these poles, with a cubic spring of its output; y is x₁ in observer form."""
    coefficients = -np.poly(poles)[1:].real
    n = len(poles)
    matrix = np.zeros((n + 2, n + 2))
    matrix[:n, 0], matrix[np.arange(n - 1), np.arange(1, n)] = coefficients, 1.0
    matrix[n - 1, n], matrix[n - 1, n + 1], matrix[n, 0], matrix[n + 1, 0] = 1e-5, -1e-5, 1.0, 1.0
    return FeedbackModel(matrix, (Polynomial(np.array([0.0, 0.6, 0.0, 0.4])),), dt=DT)


@pytest.mark.parametrize(
    "poles", [np.array([0.99, 0.98]), np.array([0.99, 0.95 + 0.1j, 0.95 - 0.1j])], ids=["two states", "three"]
)
def test_its_states_are_uncorrelated_however_fast_the_sampling(poles: Array) -> None:
    model = fast(poles)
    u = np.cumsum(np.random.default_rng(3).normal(size=4000)) * 0.02
    rest = model.resting(float(u[0]))
    form = normal_form(model, visited(model, u, rest))
    same, n = form.model, model.states
    table = np.corrcoef(form.state(model.trajectory(u, rest).x).T)
    assert np.abs(table - np.eye(n)).max() < CORRELATED
    assert np.abs(np.corrcoef(model.trajectory(u, rest).x.T) - np.eye(n)).max() > 0.99
    assert all(float(f"{value:.7f}") == value for value in same.matrix[:n, 1:n].ravel())
    np.testing.assert_array_equal(same.matrix[-1, :n], np.eye(1, n)[0])
    np.testing.assert_allclose(same.output(u, form.state(rest)), model.output(u, rest), atol=1e-9)


@pytest.mark.parametrize("make", [loop, multiplied])
@pytest.mark.parametrize("name", ["polynomial", "dead-zone", "coulomb-linear", "abs"])
def test_parameters_that_follow_from_others_are_not_counted(name: str, make: Callable[[str], FeedbackModel]) -> None:
    """A unit of a sum leaves all of its terms in the table; a unit of one term leaves one out."""
    model = make(name)
    fit = fit_feedback(model, noisy(model, white, 1, 1500))
    units = 2 * sum(each.scaling is Scaling.FREE for each in model.maps) + len(model.multiplied)
    assert fit.size == len(fit.model.parameters) - model.states**2 - units - np.count_nonzero(always_fixed(fit.model))
    assert fit.size + fit.dependent == len(fit.estimate) == len(fit.names)
    assert f"{fit.size} parameters" in repr(fit)


# --- intervals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["dead zone", *(pytest.param(x, marks=pytest.mark.long) for x in ("spring", "saturation", *LONG))]
)
def test_every_interval_contains_the_true_value_as_often_as_it_says(name: str) -> None:
    """The short form of ``tests/coverage_feedback.py``: 60 records."""
    shares = np.array([share for share, _ in CASES[name].coverage(60).values()])
    assert shares.min() >= binom.ppf(1e-4, 60, 0.95) / 60
    assert shares.mean() >= 0.9


@pytest.mark.parametrize(("truth", "signal"), [(SPRING, smooth), (MOTOR, held)], ids=["spring", "motor"])
def test_intervals_are_as_narrow_as_the_band_of_the_map(truth: FeedbackModel, signal: Signal) -> None:
    """The parameters of the map alone draw the same band as the units of signals do."""
    fit, _, record = fitted(truth, noisy(truth, signal, 7, 2000))
    z = visited_in(fit.model, record).z[:, 0]
    x, map_ = np.linspace(z.min(), z.max(), 15), fit.model.maps[0]
    band = map_band(fit, record, 0, x)
    at = [fit.names.index(f"f.{name}") for name in map_.names]
    rows = map_.parameter_gradient(x)
    alone = np.sqrt(np.einsum("ik,ij,jk->k", rows, fit.covariance[np.ix_(at, at)], rows))
    assert alone.max() < 2 * band.standard_error.max()
    assert alone.max() < 0.01 * np.ptp(map_.value(x))
    share = dict(zip(fit.names, fit.standard_error / np.abs(fit.estimate), strict=True))
    assert share["x1.x1"] < 5e-4
    assert share["x1.w"] < 0.05
    assert share["z.x1"] < 0.02


@pytest.mark.long
def test_the_cubic_spring_of_an_oscillator_is_known_to_one_percent() -> None:
    """It was 30 % in the unit of a single element."""
    fit = emsid.fit(emsid.feedback(2, delay=0), duffing(samples=2048).fitted)
    at = fit.names.index("f.c3")
    assert 1.96 * fit.standard_error[at] < 0.01 * abs(fit.estimate[at])


@pytest.mark.parametrize("name", MAPS)
def test_a_wiener_hammerstein_model_has_the_form_too(name: str) -> None:
    """Of its two states one is behind the map. The linear part shows it only if that contains a line of the map."""
    model, moved = as_feedback(wiener_hammerstein()[0])
    model, x = replace(model, maps=(MAPS[name],)), np.array([0.3, -0.2]) + moved
    same = normal_form(model, visited(model, U, x))
    np.testing.assert_allclose(same.model.output(U, same.state(x)), model.output(U, x), rtol=1e-9, atol=1e-9)
    assert np.abs(same.model.matrix).max() < 10


@pytest.mark.parametrize("name", ["abs", "polynomial", "dead-zone"])
def test_a_map_without_a_linear_system_has_the_form_too(name: str) -> None:
    """Nothing is redundant for an absolute value of u; the unit of z is that of a single term, which is fixed."""
    model = FeedbackModel(np.array([[1.3, 0.0], [0.4, 0.7]]), (MAPS[name],), dt=DT)
    fit = fit_feedback(model, noisy(model, white, 3, 400))
    assert name == "abs" or "z.u" not in fit.names
    assert np.isfinite(fit.covariance).all()
    assert np.sqrt(np.mean((fit.model.output(U, np.zeros(0)) - model.output(U, np.zeros(0))) ** 2)) < 0.01
