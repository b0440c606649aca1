"""ARMAX and Box–Jenkins models, fitted to the prediction error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

import emsid
from emsid import Ending, ModelError, PolynomialModel, Record, armax, box_jenkins, concatenate
from emsid.models.linear.polynomials import observer_form
from emsid.models.linear.prediction_error import (
    PolynomialStructure,
    PredictionError,
    armax_orders,
    noise_orders,
    segments_of,
)

Array = NDArray[np.float64]

# The ARMAX system of the examples in Ljung, System Identification, 2nd ed.
A, B, C, OFFSET = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], [1.0, -1.0, 0.2], 0.6
TRUE_ARMAX = np.array([-1.5, 0.7, 1.0, 0.5, -1.0, 0.2, OFFSET])
F, D, NOISE = [1.0, -1.2, 0.5], [1.0, -0.9], [1.0, 0.5]
TRUE_BJ = np.array([1.0, 0.5, -1.2, 0.5, 0.5, -0.9, OFFSET])


def of_armax(samples: int, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    u, e = rng.choice([-1.0, 1.0], samples), rng.standard_normal(samples)
    return Record(u, lfilter(B, A, u) + lfilter(C, A, e) + lfilter([1.0], A, np.full(samples, OFFSET)), dt=0.01)


def of_box_jenkins(samples: int, seed: int = 0, size: float = 1.0) -> Record:
    rng = np.random.default_rng(seed)
    u, e = rng.choice([-1.0, 1.0], samples), size * rng.standard_normal(samples)
    return Record(u, lfilter(B, F, u) + lfilter(NOISE, D, e) + OFFSET, dt=0.01)


def test_the_gas_furnace_of_box_and_jenkins() -> None:
    """Box, Jenkins, Time Series Analysis (1970), ch. 11: series J and the model they fitted to it.

    Y(t) = −(0.53 + 0.37B + 0.51B²)/(1 − 0.57B) X(t − 3) + 1/(1 − 1.53B + 0.63B²) a(t), variance of a: 0.0561.
    """
    u, y = np.loadtxt(Path(__file__).parent / "published" / "gas_furnace.csv", delimiter=",", skiprows=2).T
    fit = emsid.fit(box_jenkins(nb=3, nc=0, nd=2, nf=1, nk=3), Record(u, y, dt=9.0))
    published = np.array([-0.53, -0.37, -0.51, -0.57, -1.53, 0.63])
    assert fit.ending is Ending.CONVERGED
    np.testing.assert_allclose(fit.estimate[:6], published, atol=0.025)
    assert fit.noise_variance == pytest.approx(0.0561, rel=0.06)


def test_the_armax_system_of_the_textbook() -> None:
    fit = emsid.fit(armax(2, 2, 2), of_armax(3000))
    assert fit.names == ("a1", "a2", "b1", "b2", "c1", "c2", "offset")
    assert (np.abs(fit.estimate - TRUE_ARMAX) < 3.5 * fit.standard_error).all()
    assert fit.standard_error.max() < 0.05
    assert fit.noise_variance == pytest.approx(1.0, rel=0.1)
    state_space = emsid.fit(emsid.state_space(2), of_armax(3000))  # the same set of models
    np.testing.assert_allclose(state_space.estimate[:6], fit.estimate[:6], atol=0.01)


def test_a_regression_with_arma_errors_is_that_of_statsmodels() -> None:
    """SARIMAX(1, 0, 1) of statsmodels 0.15 by exact likelihood; ``python bench/linear.py`` prints these numbers."""
    rng = np.random.default_rng(0)
    u = rng.choice([-1.0, 1.0], 2000)
    noise = lfilter([1.0, 0.4], [1.0, -0.8], rng.standard_normal(2000))
    fit = emsid.fit(box_jenkins(2, 1, 1, 0), Record(u, lfilter([0.0, 1.0, 0.5], [1.0], u) + 3.0 + noise, 0.01))
    theirs, errors = np.array([0.9996, 0.5027, 0.3971, -0.7981]), np.array([0.0192, 0.0190, 0.0230, 0.0149])
    assert (np.abs(fit.estimate[:4] - theirs) < 0.15 * fit.standard_error[:4]).all()
    np.testing.assert_allclose(fit.standard_error[:4], errors, rtol=0.1)


def test_the_covariance_of_an_arma_model_is_that_of_the_textbook() -> None:
    """Box and Jenkins (1970), sec. 7.2.6: ARMA(1, 1), of which an input that does nothing is independent."""
    a, c, samples = -0.8, 0.5, 4000
    rng = np.random.default_rng(2)
    u, e = rng.choice([-1.0, 1.0], samples), rng.standard_normal(samples)
    fit = emsid.fit(armax(1, 1, 1, constant=False), Record(u, lfilter([1.0, c], [1.0, a], e), 0.01))
    both = 1 - a * c
    stated = (
        both
        / (c - a) ** 2
        * np.array([[(1 - a**2) * both, (1 - a**2) * (1 - c**2)], [(1 - a**2) * (1 - c**2), (1 - c**2) * both]])
    )
    found = samples * fit.covariance[np.ix_([0, 2], [0, 2])]
    np.testing.assert_allclose(found, stated, rtol=0.15, atol=0.05)


def test_the_covariance_of_an_output_error_model_is_that_of_the_textbook() -> None:
    """Ljung (1999), sec. 9.4: λ²[E ψψᵀ]⁻¹ for b/(1 + f q⁻¹), with the sums over both impulse responses of ψ."""
    b, f, size, samples = 1.0, -0.8, 0.5, 4000
    rng = np.random.default_rng(3)
    u = rng.choice([-1.0, 1.0], samples)
    record = Record(u, lfilter([0.0, b], [1.0, f], u) + size * rng.standard_normal(samples), 0.01)
    by_b, by_f = 1 / (1 - f**2), b**2 * (1 + f**2) / (1 - f**2) ** 3
    information = np.array([[by_b, b * f / (1 - f**2) ** 2], [b * f / (1 - f**2) ** 2, by_f]])
    stated = size**2 * np.linalg.inv(information)
    for structure, options in ((box_jenkins(1, 0, 0, 1, constant=False), {}), (emsid.arx(1, 1), {"free_run": True})):
        fit = emsid.fit(structure, record, **options)
        order = [fit.names.index("b1"), next(k for k, name in enumerate(fit.names) if name in ("f1", "a1"))]
        np.testing.assert_allclose(samples * fit.covariance[np.ix_(order, order)], stated, rtol=0.15)


@pytest.mark.parametrize(
    ("structure", "make", "truth"),
    [(armax(2, 2, 2), of_armax, TRUE_ARMAX), (box_jenkins(2, 1, 1, 2), of_box_jenkins, TRUE_BJ)],
    ids=["armax", "box-jenkins"],
)
def test_intervals_contain_the_truth(structure: PolynomialStructure, make: object, truth: Array) -> None:
    inside = []
    for seed in range(20):
        fit = emsid.fit(structure, make(600, seed))  # type: ignore[operator]
        low, high = fit.interval().T
        inside.append((low <= truth) & (truth <= high))
    assert np.mean(inside) > 0.88  # 140 dependent numbers
    assert np.mean(inside, axis=0).min() >= 0.75  # 20 each


@pytest.mark.parametrize(
    "structure", [armax(2, 2, 2, nk=0), box_jenkins(2, 1, 2, 2), PolynomialStructure(1, 2, 1, 1, 1)]
)
def test_the_derivative_is_exact(structure: PolynomialStructure) -> None:
    pieces = [of_box_jenkins(60, 1), of_box_jenkins(80, 2)]
    problem = PredictionError(structure, segments_of(structure, [concatenate(pieces)]))
    rng = np.random.default_rng(0)
    theta = 0.2 * rng.standard_normal(len(structure.names) + problem.states)
    step = 1e-5 * rng.standard_normal(len(theta))
    blocks, up, down = problem.linearised(theta), problem.residuals(theta + step), problem.residuals(theta - step)
    for (residual, derivative), above, below in zip(blocks, up, down, strict=True):
        np.testing.assert_allclose(derivative @ step, (above - below) / 2, rtol=1e-6, atol=1e-11)
        np.testing.assert_allclose(residual, (above + below) / 2, atol=1e-8)


def test_two_inputs_have_polynomials_each() -> None:
    rng = np.random.default_rng(0)
    u = rng.choice([-1.0, 1.0], (2000, 2))
    y = (
        lfilter([0, 1.0], [1.0, -0.8], u[:, 0])
        + lfilter([0, 0.5], [1.0, 0.3], u[:, 1])
        + 0.2 * rng.standard_normal(2000)
    )
    fit = emsid.fit(box_jenkins(1, 0, 0, 1, inputs=2), Record(u, y, dt=0.01))
    assert fit.names == ("b1_1", "b2_1", "f1_1", "f2_1", "offset")
    np.testing.assert_allclose(fit.estimate, [1.0, 0.5, -0.8, 0.3, 0.0], atol=0.05)
    frequency = np.array([0.0, 10.0])
    z = np.exp(2j * np.pi * frequency * 0.01)
    np.testing.assert_allclose(fit.model.response(frequency)[:, 0, 0], 1 / (z - 0.8), rtol=0.1)


def test_orders_come_from_one_factor() -> None:
    found = armax_orders(of_armax(4000), range(3), range(1, 4), range(1, 4), range(3))
    assert found.na >= 2
    assert found.nk <= 1
    assert noise_orders([lfilter([1.0], D, np.random.default_rng(0).standard_normal(3000))], 3) == (0, 1)


def test_a_predictor_leaves_the_innovations() -> None:
    """The error one step ahead of the true model is e, and that of the free run is the noise."""
    record = of_box_jenkins(2000)
    model = PolynomialModel([], [B[1:]], NOISE[1:], D[1:], [F[1:]], OFFSET, 1, 0.01)
    one, free = model.predict(record), model.simulate(record)
    assert np.var((record.output - one.output)[one.counted]) == pytest.approx(1.0, rel=0.1)
    assert np.var((record.output - free.output)[free.counted]) > 3.0


def test_observer_form_has_the_response_of_its_polynomials() -> None:
    a, columns = observer_form(np.array([1.0, -1.5, 0.7]), [np.array([0.3, 1.0, 0.5])])
    z = np.exp(0.7j)
    response = np.linalg.solve(z * np.eye(2) - a, columns)[0, 0] + 0.3
    assert response == pytest.approx((0.3 + 1 / z + 0.5 / z**2) / (1 - 1.5 / z + 0.7 / z**2))


def test_equations_are_printed() -> None:
    arma = PolynomialModel(A[1:], [B[1:]], C[1:], [], np.zeros((1, 0)), OFFSET, 1, 0.01)
    assert arma.equation() == (
        "(1 - 1.5*q^-1 + 0.7*q^-2) y(t) = (1*q^-1 + 0.5*q^-2) u(t) + 0.6 + (1 - 1*q^-1 + 0.2*q^-2) e(t)"
    )
    box = PolynomialModel([], [B[1:]], [], D[1:], [F[1:]], 0.0, 1, 0.01)
    assert box.equation() == ("y(t) = (1*q^-1 + 0.5*q^-2)/(1 - 1.2*q^-1 + 0.5*q^-2) u(t) + (1)/(1 - 0.9*q^-1) e(t)")


@pytest.mark.parametrize("name", ["armax", "box-jenkins", "state-space"])
def test_they_are_candidates_of_identify(name: str) -> None:
    found = emsid.identify(of_box_jenkins(800, size=0.2), models=name)
    assert found.on_unseen.rows[0].model == name
    assert found.on_unseen.rows[0].fit_percent > 60


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(ModelError, match="whole number"):
        armax(2, 0, 1)
    with pytest.raises(ModelError, match="too few samples"):
        emsid.fit(armax(2, 2, 2), of_armax(10))
    with pytest.raises(ModelError, match="one output and 2 inputs"):
        emsid.fit(armax(2, 2, 2, inputs=2), of_armax(100))
    with pytest.raises(ModelError, match="not a model in polynomials"):
        PolynomialModel.from_data({"name": "x"})
    with pytest.raises(ModelError, match="dimensions"):
        PolynomialModel(A, B, C, D, F, 0.0, 1, 0.01)
