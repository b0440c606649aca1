"""Orders of linear models from one factor, and linear models estimated with instruments."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import coherence as scipy_coherence
from scipy.signal import csd, lfilter

import emsid
from emsid import Ending, ModelError, Record
from emsid.estimation.linear.filtering import coherence, filtered, filtered_from, mirrored, past_state, spectrum
from emsid.models.regression.search.orders import order_grid, output_error_orders
from emsid.record import concatenate
from emsid.validation.comparison import fit_percent
from independent.structures import known

A, B, OFFSET = [1.0, -1.5, 0.7], [0.0, 1.0, 0.5], 0.6
TRUTH = np.array([-1.5, 0.7, 1.0, 0.5, OFFSET])
GRID = [
    {"nk": nk, "na": na, "nb": nb, "constant": constant}
    for nk in (0, 1, 2, 3)
    for na in (1, 2, 3, 4)
    for nb in (1, 2, 3, 4)
    for constant in (0, 1)
]


def noisy(samples: int, noise: str, size: float = 1.0, seed: int = 0) -> Record:
    """y = (B u + offset)/A + v, where v is white, autoregressive, or e/A, which makes it ARX."""
    rng = np.random.default_rng(seed)
    u, e = rng.choice([-1.0, 1.0], samples), size * rng.standard_normal(samples)
    v = {"white": e, "coloured": lfilter([1.0], [1.0, -0.9], e), "arx": lfilter([1.0], A, e)}[noise]
    return Record(u, lfilter(B, A, u) + lfilter([1.0], A, np.full(samples, OFFSET)) + v, dt=0.01)


def test_filtered_rows_are_those_of_scipy() -> None:
    x = np.random.default_rng(0).standard_normal((3, 50))
    for above, below in (([1.0], A), (B, A), ([1.0, 0.2, 0.3], [2.0]), (B, [2.0, 0.5])):
        np.testing.assert_allclose(filtered(above, below, x), lfilter(above, below, x, axis=1), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(filtered(above, below, x[0]), lfilter(above, below, x[0]), rtol=1e-12, atol=1e-12)


def test_a_filter_goes_on_from_its_state() -> None:
    x = np.random.default_rng(0).standard_normal(50)
    whole = filtered(B, A, x)
    first, state = filtered_from(B, A, x[:20], np.zeros(2))
    np.testing.assert_allclose(state, past_state(B, A, first, x[:20]), atol=1e-12)
    np.testing.assert_allclose(np.r_[first, filtered_from(B, A, x[20:], state)[0]], whole, rtol=1e-12)


@pytest.mark.parametrize("size", [64, 33, 1])
def test_spectra_are_those_of_scipy(size: int) -> None:
    x, y = np.random.default_rng(0).standard_normal((2, 300))
    expected = csd(x, y, nperseg=size)[1]
    found = spectrum(x, y, size)
    scale = np.vdot(found, expected) / max(np.vdot(found, found).real, 1e-300)
    np.testing.assert_allclose(found * scale.real, expected, atol=1e-12)
    if size > 1:
        np.testing.assert_allclose(coherence(x, y, size), scipy_coherence(x, y, nperseg=size)[1], atol=1e-12)


def test_roots_are_mirrored_into_the_circle() -> None:
    np.testing.assert_allclose(mirrored(np.poly([2.0, 0.5])), np.poly([0.5, 0.5]))
    assert np.abs(np.roots(mirrored([1.0, -1.0]))).max() < 1
    np.testing.assert_array_equal(mirrored([1.0]), [1.0])


def test_a_grid_has_the_criteria_of_separate_fits() -> None:
    record = noisy(2000, "arx")
    table = order_grid(record, na=(1, 2, 3), nb=(1, 2), nk=(1, 2))
    assert len(table.rows) == 3 * 2 * 2 * 2
    row = next(r for r in table.rows if (r.na, r.nb, r.nk, r.constant) == (2, 2, 1, True))
    short = Record(record.input[1:], record.output[1:], record.dt)  # the grid begins at its largest lag
    fit = emsid.fit(emsid.arx(2, 2, constant=True), short)
    samples, residual = 2000 - 3, fit.noise_variance * (fit.samples - 5)
    assert fit.samples == samples
    assert row.variance == pytest.approx(residual / samples)
    assert row.aic == pytest.approx(samples * np.log(residual / samples) + 2 * 5)
    assert row.bic == pytest.approx(samples * np.log(residual / samples) + 5 * np.log(samples))
    assert row.fpe == pytest.approx(residual / samples * (samples + 5) / (samples - 5))


def test_the_criteria_find_the_true_orders() -> None:
    table = order_grid(noisy(3000, "arx", 0.5))
    for row in (table.best("bic"), table.simplest):
        assert (row.na, row.nb, row.nk, row.constant) == (2, 2, 1, True)
    assert table.best("free_run").free_run <= table.simplest.free_run
    assert str(table).splitlines()[0].split()[:3] == ["na", "nb", "nk"]
    with pytest.raises(ModelError, match="no criterion"):
        table.best("r2")
    with pytest.raises(ModelError, match="no value of nb"):
        order_grid(noisy(300, "arx"), nb=())


@pytest.mark.parametrize("noise", ["white", "coloured"])
def test_orders_of_an_output_error_model_are_found_in_noise_of_any_colour(noise: str) -> None:
    fit = output_error_orders(noisy(2000, noise, 1.5 if noise == "white" else 0.8), GRID, 0.25)
    assert len(fit.estimate) == 5
    u = np.zeros(40)
    u[0] = 1.0
    step = lfilter(B, A, np.cumsum(u)) + OFFSET / sum(A)
    state = fit.model.at_rest(0.0)
    np.testing.assert_allclose(fit.model.run(state, np.cumsum(u)[:, None])[0][:, 0], step, atol=0.8)  # of 7.5


def test_segments_shorter_than_the_memory_do_not_stop_an_output_error_model() -> None:
    record = noisy(2000, "white", 0.5)
    ends = np.cumsum(np.tile([60, 9, 5, 1, 3], 20))
    pieces = [record[a + 1 : b] for a, b in pairwise((0, *ends)) if b > a + 1]  # a sample is lost between two
    fit = output_error_orders(concatenate(pieces), GRID, 0.25)
    np.testing.assert_allclose(fit.estimate, TRUTH, atol=0.15)
    with pytest.raises(ModelError, match="no segment has more than"):
        output_error_orders(concatenate(pieces[1::4]), GRID, 0.25)


def test_orders_that_no_linear_model_suits_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def unstable(*_: object) -> None:
        raise ModelError("the free run diverges")

    monkeypatch.setattr("emsid.models.regression.search.orders.fit_to_compare", unstable)
    with pytest.raises(ModelError, match=r"no linear model of na = \d+, nb = \d+ or more can be fitted") as problem:
        output_error_orders(noisy(600, "white", 0.0), GRID, 0.25)
    assert problem.value.arguments == ("na", "nb")


@pytest.mark.parametrize("noise", ["white", "coloured"])
def test_instruments_have_no_bias_and_robust_intervals(noise: str) -> None:
    inside, errors = [], []
    for seed in range(25):
        fit = emsid.fit(emsid.arx(2, 2, constant=True), noisy(1000, noise, 1.5, seed), instruments=True)
        assert fit.ending is Ending.CONVERGED
        low, high = fit.interval().T
        inside.append((low <= TRUTH) & (high >= TRUTH))
        errors.append((fit.estimate - TRUTH) / fit.standard_error)
    assert np.mean(inside) > 0.87  # 125 dependent numbers
    assert np.abs(np.mean(errors, axis=0)).max() < 0.8  # 0.2 is the standard error of a mean
    biased = emsid.fit(emsid.arx(2, 2, constant=True), noisy(1000, noise, 1.5))
    assert np.abs(biased.estimate[0] + 1.5) > 0.2


def test_white_noise_of_the_output_gives_the_estimate_of_the_free_run() -> None:
    record = noisy(3000, "white")
    one = emsid.fit(emsid.arx(2, 2, constant=True), record, instruments=True)
    other = emsid.fit(emsid.arx(2, 2, constant=True), record, free_run=True)
    np.testing.assert_allclose(one.estimate, other.estimate, atol=0.02)
    np.testing.assert_allclose(one.standard_error, other.standard_error, rtol=0.25)


def test_instruments_refuse_what_they_cannot_estimate() -> None:
    record = noisy(300, "white")
    with pytest.raises(ModelError, match="linear structures"):
        emsid.fit(emsid.Structure.parse("y(t-1)", "u(t-1)^2"), record, instruments=True)
    with pytest.raises(ModelError, match="exclude each other"):
        emsid.fit(emsid.arx(1, 1), record, instruments=True, free_run=True)


@pytest.mark.parametrize("seed", [0, 6])
def test_the_orders_of_motors_of_known_structure_are_found(seed: int) -> None:
    """The short form of ``bench/structures.py``: one pole and two."""
    motor = known(seed)
    fit = output_error_orders(motor.record[:2800], GRID, 0.25)
    assert max(f.lag for r in fit.model.structure.regressors for f in r.factors if not f.channel) == motor.order
    run = fit.model.simulate(motor.other)
    assert fit_percent(motor.other.output[run.counted], run.output[run.counted]) > 98
