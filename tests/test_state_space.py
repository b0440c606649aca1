"""State-space models: subspace estimates, their refinement, and intervals of what does not depend on the basis."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import emsid
from emsid import Ending, ModelError, Record, StateSpaceModel, concatenate
from emsid.estimation.linear.subspace import Weighting, cva, moesp, response_rows, stabilised
from emsid.models.linear.state_space import run_linear, run_reference
from emsid.models.linear.subspace_fit import StateSpaceError, state_space, subspace_models

Array = NDArray[np.float64]
DT = 0.01

# Ljung, System Identification, 2nd ed.: the system of the examples, (1 − 1.5q⁻¹ + 0.7q⁻²) y = (q⁻¹ + 0.5q⁻²) u +
# (1 − q⁻¹ + 0.2q⁻²) e, in observer form.
TRUTH = StateSpaceModel(
    np.array([[1.5, 1.0], [-0.7, 0.0]]),
    np.array([[1.0], [0.5]]),
    np.array([[1.0, 0.0]]),
    np.zeros((1, 1)),
    np.array([[0.5], [-0.5]]),
    np.array([3.0]),
    DT,
)
COEFFICIENTS = {"a1": -1.5, "a2": 0.7, "b1": 1.0, "b2": 0.5, "c1": -1.0, "c2": 0.2, "y0": 3.0}
MIMO = StateSpaceModel(
    np.array([[0.9, 0.2, 0.0], [-0.2, 0.9, 0.1], [0.0, 0.0, 0.5]]),
    np.array([[1.0, 0.0], [0.2, 0.5], [0.3, 1.0]]),
    np.array([[1.0, 0.0, 0.5], [0.0, 20.0, 1.0]]),
    np.zeros((2, 2)),
    np.array([[0.3, 0.0], [0.1, 0.01], [0.1, 0.0]]),
    np.array([1.0, -40.0]),
    DT,
)


def record_of(model: StateSpaceModel, samples: int, noise: Array | float = 0.0, seed: int = 0) -> Record:
    """A record of a model with white noise e of a standard deviation for every output, from rest."""
    rng = np.random.default_rng(seed)
    u = rng.choice([-1.0, 1.0], (samples, model.b.shape[1])) + 0.5
    e = np.broadcast_to(noise, len(model.level)) * rng.standard_normal((samples, len(model.level)))
    b, d = np.hstack([model.b, model.k]), np.hstack([model.d, np.eye(len(model.level))])
    y, _ = run_linear(model.a, b, model.c, d, np.zeros(model.order), np.hstack([u, e]))
    return Record(u, y + model.level, model.dt)


def test_a_run_equals_its_definition() -> None:
    u = np.random.default_rng(0).standard_normal((30, 2))
    matrices = MIMO.a, MIMO.b, MIMO.c, MIMO.d + 0.1
    for one, other in zip(run_linear(*matrices, np.ones(3), u), run_reference(*matrices, np.ones(3), u), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_response_rows_are_the_responses_of_every_state() -> None:
    signal, c = np.random.default_rng(0).standard_normal(20), MIMO.c[1].copy()
    rows = np.empty((3, 20))
    response_rows(rows, MIMO.a, c, signal, np.zeros(3))
    for k in range(3):
        b = np.eye(3)[:, k : k + 1]
        expected = run_reference(MIMO.a, b, c[None], np.zeros((1, 1)), np.zeros(3), signal[:, None])[0][:, 0]
        np.testing.assert_allclose(rows[k], expected, atol=1e-12)


@pytest.mark.parametrize("weighting", [cva, moesp])
@pytest.mark.parametrize("model", [TRUTH, MIMO], ids=["one output", "two outputs"])
def test_without_noise_the_subspace_estimate_is_exact(model: StateSpaceModel, weighting: Weighting) -> None:
    record = record_of(model, 600)
    structure = state_space(model.order, horizon=8, weighting=weighting)
    fit = emsid.fit(structure, record, refine=False)
    frequency = np.array([0.0, 1.0, 5.0, 20.0, 50.0])
    np.testing.assert_allclose(fit.model.response(frequency), model.response(frequency), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(fit.model.level, model.level, rtol=1e-6)
    assert fit.method == "subspace"
    assert np.isinf(fit.standard_error).all()


def test_the_order_is_chosen_from_the_singular_values() -> None:
    assert emsid.fit(state_space(), record_of(TRUTH, 1500, 1.0), refine=False).model.order == 2
    assert emsid.fit(state_space(), record_of(MIMO, 1500, [0.3, 6.0]), refine=False).model.order == 3


def test_a_fit_recovers_the_system_of_the_textbook_with_its_noise_model() -> None:
    fit = emsid.fit(state_space(2), record_of(TRUTH, 4000, 1.0))
    assert fit.names == tuple(COEFFICIENTS)
    assert fit.ending is Ending.CONVERGED
    error = (fit.estimate - list(COEFFICIENTS.values())) / fit.standard_error
    assert np.abs(error).max() < 3.5
    assert fit.standard_error[:4].max() < 0.05
    assert fit.noise_variance == pytest.approx(1.0, rel=0.1)


def test_the_intervals_contain_the_truth() -> None:
    inside = []
    for seed in range(40):
        fit = emsid.fit(state_space(2, horizon=10), record_of(TRUTH, 500, 1.0, seed))
        low, high = fit.interval().T
        inside.append((low <= list(COEFFICIENTS.values())) & (list(COEFFICIENTS.values()) <= high))
    assert np.mean(inside) > 0.9  # 280 dependent numbers: 0.95 less four deviations
    assert np.mean(inside, axis=0).min() >= 0.8  # 40 each


def test_fitted_to_the_free_run_it_is_an_output_error_model() -> None:
    """White noise of the output: K = 0, and the same minimum as that of the regression."""
    quiet = StateSpaceModel(TRUTH.a, TRUTH.b, TRUTH.c, TRUTH.d, 0 * TRUTH.k, TRUTH.level, DT)
    record = record_of(quiet, 1000, 0.5)
    fit = emsid.fit(state_space(2), record, free_run=True)
    other = emsid.fit(emsid.arx(2, 2, constant=True), record, free_run=True)
    assert not fit.model.k.any()
    np.testing.assert_allclose(fit.estimate[:4], other.estimate[:4], atol=0.02)
    np.testing.assert_allclose(fit.standard_error[:4], other.standard_error[:4], rtol=0.15)


def test_several_segments_and_outputs_share_one_model() -> None:
    pieces = [record_of(MIMO, n, [0.3, 6.0], seed) for seed, n in enumerate((400, 300, 500))]
    fit = emsid.fit(state_space(3, horizon=8), concatenate(pieces))
    frequency = np.array([0.0, 5.0, 20.0])
    np.testing.assert_allclose(fit.model.response(frequency), MIMO.response(frequency), rtol=0.1, atol=0.3)
    truth = dict(zip(*MIMO.coefficients(direct=False, noise=False), strict=True))
    assert fit.names[:3] == ("mode1.a1", "mode1.a2", "mode2.a1")
    error = fit.estimate - [truth[name] for name in fit.names]
    assert (np.abs(error) < 4.5 * fit.standard_error).all()


@pytest.mark.parametrize("free_run", [False, True])
def test_the_derivative_is_exact(free_run: bool) -> None:
    structure = state_space(3, direct=True, horizon=6)
    data = subspace_models(structure, record_of(MIMO, 200, [0.3, 6.0]))
    problem = StateSpaceError(data.model(3, direct=True), data, direct=True, free_run=free_run)
    rng = np.random.default_rng(0)
    at, along = 1e-3 * rng.standard_normal(problem.size), 1e-4 * rng.standard_normal(problem.size)
    for (_, derivative), up, down in zip(
        problem.linearised(at), problem.residuals(at + along), problem.residuals(at - along), strict=True
    ):
        np.testing.assert_allclose(derivative @ along, (up - down) / 2, rtol=1e-4, atol=1e-6)


def test_the_direct_term_is_found() -> None:
    direct = StateSpaceModel(TRUTH.a, TRUTH.b, TRUTH.c, np.array([[0.8]]), TRUTH.k, TRUTH.level, DT)
    fit = emsid.fit(state_space(2, direct=True), record_of(direct, 1000, 0.3))
    assert fit.estimate[fit.names.index("b0")] == pytest.approx(0.8, abs=0.05)


def test_a_model_prints_its_equations() -> None:
    assert TRUTH.equation().splitlines() == [
        "x1(t+1) = 1.5*x1(t) + 1*x2(t) + 1*u(t) + 0.5*e(t)",
        "x2(t+1) = -0.7*x1(t) + 0.5*u(t) - 0.5*e(t)",
        "y(t) = 1*x1(t) + 3 + e(t)",
    ]


def test_unstable_estimates_are_mirrored() -> None:
    mirrored = stabilised(np.array([[1.25, 1.0], [0.0, 0.5]]))
    np.testing.assert_allclose(sorted(np.linalg.eigvals(mirrored)), [0.5, 0.8])


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(ModelError, match="whole number"):
        state_space(0)
    with pytest.raises(ModelError, match="more samples than states"):
        state_space(5, horizon=5)
    with pytest.raises(ModelError, match="no segment has"):
        emsid.fit(state_space(2, horizon=50), record_of(TRUTH, 60))
    with pytest.raises(ModelError, match="fits the others"):
        StateSpaceModel(TRUTH.a, np.zeros((3, 1)), TRUTH.c, TRUTH.d, TRUTH.k, TRUTH.level, DT)
    with pytest.raises(ModelError, match="not a state-space model"):
        StateSpaceModel.from_data({"name": "x"})
