"""Transfer functions from records, frequency responses and both: as accurate as any unbiased estimate can be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.stats import chi2

import emsid
from emsid import FrequencyResponse, Record, TransferFunction, excitation, frequency_response, transfer_function

Array = NDArray[np.float64]
DT, NOISE, PERIOD, PERIODS = 0.002, 0.05, 1000, 10
TRUE = np.array([30.0, 900.0, 4.0, 900.0])
LINES = np.arange(1, 200)


def system(theta: Array, level: float = 0.0, delay: float = 0.0) -> TransferFunction:
    return TransferFunction(theta[:2], np.array([1.0, *theta[2:4]]), delay, level, DT)


def driven(model: TransferFunction, u: Array) -> Array:
    return np.asarray(model.run(model.at_rest(0.0), u[:, None])[0][:, 0])


def record_of(seed: int, model: TransferFunction, samples: int = 4000) -> Record:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.standard_normal(samples // 4), 4)
    return Record(u, driven(model, u) + NOISE * rng.standard_normal(samples), DT)


def response_of(seed: int, model: TransferFunction) -> tuple[FrequencyResponse, Array]:
    """A response, and one period of the input."""
    rng = np.random.default_rng(seed)
    u = excitation.multisine(PERIOD * (PERIODS + 2), LINES, rng, 2.0, period=PERIOD)
    y = driven(model, u) + NOISE * rng.standard_normal(len(u))
    return frequency_response(Record(u[2 * PERIOD :], y[2 * PERIOD :], DT)), u[:PERIOD]


def slopes(curve: object, theta: Array) -> Array:
    """Derivatives of curve(θ) by differences, one column each."""
    moves = [1e-5 * value * unit for value, unit in zip(theta, np.eye(len(theta)), strict=True)]
    return np.column_stack(
        [(curve(theta + move) - curve(theta - move)) / (2 * np.sum(move)) for move in moves]  # type: ignore[operator]
    )


def of_response(seed: int) -> tuple[Array, Array, Array]:
    """Of a fit to a response: its error, the information about the parameters, its standard errors."""
    measured, u = response_of(seed, system(TRUE))
    fit = emsid.fit(transfer_function(2), measured)
    power = np.abs(np.fft.rfft(u)[LINES]) ** 2 * PERIODS / (NOISE**2 * PERIOD)
    j = slopes(lambda theta: system(theta).response(measured.frequency)[:, 0, 0], TRUE)
    return fit.estimate - TRUE, 2 * np.real((j.conj().T * power) @ j), fit.standard_error


def of_record(seed: int) -> tuple[Array, Array, Array]:
    """The same of a fit to a record."""
    true = np.append(TRUE, 0.3)
    record = record_of(seed, system(TRUE, 0.3))
    fit = emsid.fit(transfer_function(2), record)
    j = slopes(lambda theta: driven(system(theta, theta[4]), record.input[:, 0]), true)
    return fit.estimate - true, j.T @ j / NOISE**2, fit.standard_error


def rms_over_bound(fits: Sequence[tuple[Array, Array, Array]]) -> float:
    """The root mean square of errors in units of the Cramér–Rao bound, all parameters together: 1 for the best."""
    return float(np.sqrt(np.mean([error @ bound @ error / len(error) for error, bound, _ in fits])))


@pytest.mark.parametrize(("of", "first"), [(of_response, 31_000), (of_record, 32_000)])
def test_a_fit_reaches_the_cramer_rao_bound(of: Callable[[int], tuple[Array, Array, Array]], first: int) -> None:
    """Squared errors in units of the bound add up to χ², of which the 99.9 % quantile is the limit.

    ``bench/frequency.py`` measures 100 fits.
    """
    fits = [of(first + k) for k in range(20)]
    freedom = sum(len(error) for error, _, _ in fits)
    low, high = np.sqrt(chi2.ppf([0.001, 0.999], freedom) / freedom)
    assert low < rms_over_bound(fits) < high
    shares = [errors / np.sqrt(np.diag(np.linalg.inv(bound))) for _, bound, errors in fits]
    assert np.mean(shares) == pytest.approx(1.0, abs=0.05)


def test_both_together_are_better_than_either() -> None:
    record, (measured, _) = record_of(1, system(TRUE)), response_of(2, system(TRUE))
    alone = [emsid.fit(transfer_function(2), each) for each in (record, measured)]
    both = emsid.fit(transfer_function(2), [record, measured])
    np.testing.assert_allclose(both.estimate[:4], TRUE, rtol=5e-3)
    assert np.all(both.standard_error[:4] < 1.05 * np.minimum(*[fit.standard_error[:4] for fit in alone]))


@pytest.mark.parametrize("of", ["record", "response"])
def test_a_dead_time_of_parts_of_a_sample_is_found(of: str) -> None:
    late = TransferFunction(np.array([900.0]), np.array([1.0, 4.0, 900.0]), 0.0131, 0.0, DT)
    data = record_of(3, late) if of == "record" else response_of(3, late)[0]
    fit = emsid.fit(transfer_function(2, 0, delay=True), data)
    low, high = fit["delay"].interval
    assert low - (high - low) < 0.0131 < high + (high - low)
    assert high - low < 3e-4


def test_a_function_of_z_is_that_of_the_samples() -> None:
    true = system(TRUE)
    for data in (record_of(4, true), response_of(4, true)[0]):
        fit = emsid.fit(transfer_function(2, discrete=True), data)
        np.testing.assert_allclose(np.sort_complex(emsid.poles(fit)), np.sort_complex(true.sampled.poles), atol=2e-4)


def test_a_response_in_continuous_time_is_fitted_exactly() -> None:
    f = np.geomspace(0.5, 50, 80)
    measured = FrequencyResponse(f, system(TRUE).part.response(f))
    fit = emsid.fit(transfer_function(2, 1), measured)
    np.testing.assert_allclose(fit.estimate, TRUE, rtol=1e-6)
    other = emsid.simulate(fit.model.at(0.001), np.ones(6000)).output[-1, 0]
    assert other == pytest.approx(1.0, abs=1e-3)


def test_intervals_of_overlapping_estimates_contain_the_truth() -> None:
    """Local polynomials share lines: intervals that take them as independent would be 2.4 times too narrow."""
    scores = []
    for seed in range(12):
        record = record_of(40 + seed, system(TRUE))
        fit = emsid.fit(transfer_function(2), frequency_response(record, "polynomial"))
        scores.append((fit.estimate - TRUE) / fit.standard_error)
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_a_model_file_and_what_is_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    fit = emsid.fit(transfer_function(2), record_of(5, system(TRUE)))
    emsid.save(fit, tmp_path / "model.json")
    np.testing.assert_array_equal(emsid.load(tmp_path / "model.json").model.denominator, fit.model.denominator)
    with pytest.raises(emsid.ModelError, match="3 zeros and 2 poles"):
        transfer_function(2, 3)
    measured = response_of(6, system(TRUE))[0]
    with pytest.raises(emsid.DataError, match=r"emsid\.transfer_function, emsid\.state_space and plants"):
        emsid.fit(emsid.arx(2, 2), measured)
    wide = replace(
        measured, response=np.repeat(measured.response, 2, axis=2), total=None, noise=None, input_names=(),
        input_units=(),
    )  # fmt: skip
    with pytest.raises(emsid.ModelError, match="one input and one output"):
        emsid.fit(transfer_function(2), wide)


def test_a_state_space_is_fitted_to_a_response_of_several_inputs_and_outputs() -> None:
    rng = np.random.default_rng(8)
    at, ratio = 2 * np.pi * 30.0, 0.02
    a = np.array([[-ratio * at, at], [-at, -ratio * at]])
    true = emsid.LinearSystem(a, rng.standard_normal((2, 2)), rng.standard_normal((3, 2)), np.zeros((3, 2)), None)
    f = np.arange(1.0, 200.0)
    g = true.to_discrete(DT).response(f)
    error = 0.01 * np.abs(g).max()
    noise = error * (rng.standard_normal(g.shape) + 1j * rng.standard_normal(g.shape)) / np.sqrt(2)
    measured = FrequencyResponse(f, g + noise, np.full(g.shape, error**2), dt=DT)
    start = emsid.fit(emsid.state_space(2), measured, refine=False)
    assert start.model.order == 2
    fit = emsid.fit(emsid.state_space(2), measured)
    assert fit.ending is emsid.Ending.CONVERGED
    np.testing.assert_allclose(emsid.modes(fit).frequency, 30.0, rtol=2e-3)
    missed = np.sqrt(np.mean(np.abs(fit.model.response(f) - g) ** 2)) / error
    assert missed < 1.6 * np.sqrt((2 + 2 * 6 + 6) / (2 * g.size))  # as parameters add noise, and little more
    with pytest.raises(emsid.DataError, match="has no sample time"):
        emsid.fit(emsid.state_space(2), replace(measured, dt=None))


def test_a_state_space_is_fitted_to_a_response_and_a_record_together() -> None:
    """Its modes are as certain as the sum of what both say, its offset is that of the record, its order that asked."""
    rng = np.random.default_rng(71_000)
    blocks = [w * np.array([[-0.02, 1.0], [-1.0, -0.02]]) for w in 2 * np.pi * np.array([18.0, 30.0])]
    b, c, none = rng.standard_normal((4, 1)), rng.standard_normal((2, 4)), np.zeros((2, 1))
    part = emsid.LinearSystem(block_diag(*blocks), b, c, none, None).to_discrete(DT)
    true = emsid.StateSpaceModel(part.a, part.b, part.c, part.d, np.zeros((4, 2)), np.array([0.5, -1.0]), DT)
    f = np.arange(1.0, 60.0)
    g = true.response(f)
    error = 0.02 * np.abs(g).max()
    noise = error * (rng.standard_normal(g.shape) + 1j * rng.standard_normal(g.shape)) / np.sqrt(2)
    measured = FrequencyResponse(f, g + noise, np.full(g.shape, error**2), dt=DT)
    u = np.repeat(rng.standard_normal(400), 2)
    y = true.run(np.zeros(4), u[:, None])[0]
    record = Record(u, y + 0.1 * y.std(axis=0) * rng.standard_normal(y.shape), DT)
    structure = emsid.state_space(4, direct=True)
    alone = [emsid.fit(structure, measured), emsid.fit(structure, record, free_run=True)]
    both = emsid.fit(structure, [record, measured])
    assert both.model.order == 4
    found = emsid.modes(both)
    together = np.sum([emsid.modes(each).frequency_error ** -2.0 for each in alone], axis=0) ** -0.5
    np.testing.assert_allclose(found.frequency_error, together, rtol=0.1)
    assert np.all(np.abs(found.frequency - [18.0, 30.0]) < 4 * found.frequency_error)
    np.testing.assert_allclose(both.model.level, [0.5, -1.0], atol=0.05)
    with pytest.raises(emsid.DataError, match="other channels"):
        emsid.fit(structure, [measured, Record(u, y[:, 0], DT)])
    with pytest.raises(emsid.DataError, match="different sample times"):
        emsid.fit(structure, [measured, Record(u, y, 2 * DT)])
    with pytest.raises(emsid.DataError, match="one frequency response, with or without records"):
        emsid.fit(structure, [measured, measured])
