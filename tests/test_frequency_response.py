"""Frequency responses of simulated systems: values, levels of noise and distortion, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import freqz, lfilter

import emsid
from emsid import FrequencyResponse, Record, excitation, frequency_response

Array = NDArray[np.float64]
B, A, DT = [0.0, 0.1, 0.05], [1.0, -1.6, 0.8], 1e-3
PERIOD, NOISE = 2000, 0.05


def truth(frequency: Array) -> NDArray[np.complex128]:
    return np.asarray(freqz(B, A, 2 * np.pi * frequency * DT)[1])


def experiments(
    count: int, seed: int, harmonics: NDArray[np.int64], cubic: float = 0.0, square: float = 0.0, periods: int = 6
) -> list[Record]:
    """Multisines of random phases into a static nonlinearity and a filter, in steady state, with white noise."""
    rng, made = np.random.default_rng(seed), []
    for _ in range(count):
        u = excitation.multisine(PERIOD * (periods + 1), harmonics, rng, period=PERIOD, phases=excitation.random_phases)
        u = u / u.std()
        y = lfilter(B, A, u + square * u**2 + cubic * u**3)[PERIOD:]
        made.append(Record(u[PERIOD:], y + NOISE * rng.standard_normal(len(y)), DT))
    return made


def in_db(one: Any, other: Any) -> float:
    return float(10 * np.log10(np.mean(one) / np.mean(other)))


FULL = np.arange(1, 600)


def with_detection_lines(seed: int) -> NDArray[np.int64]:
    """Odd multiples of which one in four is left out at random."""
    return excitation.odd_harmonics(PERIOD, DT, 0.5, 300.0, left_out=4, rng=np.random.default_rng(seed))


def test_the_robust_method_tells_noise_from_cubic_distortion() -> None:
    found = frequency_response(experiments(8, 1, FULL, cubic=0.02))
    power = np.abs(np.fft.rfft(experiments(1, 1, FULL)[0].input[:PERIOD, 0]))[FULL] ** 2
    assert abs(in_db(found.noise, NOISE**2 * PERIOD / power / 6 / 8)) < 0.5
    reference = frequency_response(experiments(60, 2, FULL, cubic=0.02))
    assert abs(in_db(found.distortion, reference.distortion)) < 0.5
    assert (found.realisations, len(found)) == (8, len(FULL))
    missed = np.abs(found.response - reference.response) ** 2
    assert abs(in_db(missed, found.total + reference.total)) < 0.7


def test_the_fast_method_sees_odd_and_even_distortion_at_lines_without_input() -> None:
    lines = with_detection_lines(3)
    several = [frequency_response(experiments(1, seed, lines, cubic=0.02, square=0.01)) for seed in range(4, 8)]
    many = frequency_response(experiments(60, 9, lines, cubic=0.02, square=0.01))
    assert abs(in_db([each.distortion for each in several], many.distortion)) < 1.0
    assert abs(in_db([each.total for each in several], 60 * many.total)) < 1.0
    without = frequency_response(experiments(1, 4, lines, cubic=0.02))
    assert in_db(several[0].even, without.even) > 5
    assert "fast method" in several[0].method


def test_without_distortion_its_level_is_far_below_the_noise() -> None:
    found = frequency_response(experiments(1, 6, with_detection_lines(7)))
    assert in_db(found.distortion, found.noise) < -5


@pytest.mark.parametrize("method", ["polynomial", "welch"])
def test_the_error_of_a_response_from_noise_is_as_large_as_it_says(method: str) -> None:
    rng = np.random.default_rng(8)
    u = rng.standard_normal(12_000)
    y = lfilter(B, A, u) + NOISE * rng.standard_normal(len(u))
    found = frequency_response([Record(u[:8000], y[:8000], DT), Record(u[8000:], y[8000:], DT)], method)
    missed = np.abs(found.response[:, 0, 0] - truth(found.frequency)) ** 2
    assert abs(in_db(missed, found.total)) < 1.0
    assert (found.coherence is not None) == (method == "welch")
    assert found.noise is None
    mean = np.mean((found.response[:, 0, 0] - truth(found.frequency)) / np.sqrt(found.total[:, 0, 0]))
    assert abs(mean) ** 2 < 9 * found.overlap / len(found)


def test_local_polynomials_have_no_leakage() -> None:
    u = np.random.default_rng(9).standard_normal(4000)
    record = Record(u, lfilter(B, A, u), DT)
    errors = {
        method: np.abs(found.response[:, 0, 0] - truth(found.frequency)).max()
        for method in ("polynomial", "welch")
        for found in [frequency_response(record, method)]
    }
    assert errors["polynomial"] < 0.01 * errors["welch"]


@pytest.mark.parametrize("method", ["periodic", "polynomial", "welch"])
def test_several_inputs_and_outputs(method: str) -> None:
    rng = np.random.default_rng(10)
    u = np.concatenate([np.tile(rng.standard_normal((1000, 2)), (5, 1)) for _ in range(4)])
    y = np.column_stack([lfilter(B, A, u[:, 0]) + 0.5 * u[:, 1], lfilter([1.0], [1.0, -0.5], u[:, 1])])
    record = Record(u, y + 0.01 * rng.standard_normal(y.shape), DT)
    given = [record[k + 1000 : k + 5000] for k in range(0, 20_000, 5000)] if method == "periodic" else record
    found = frequency_response(given, method, window=500 if method == "welch" else None)
    assert found.response.shape[1:] == (2, 2)
    true = truth(found.frequency)
    for (i, j), value in {(0, 0): true, (0, 1): 0.5 + 0 * true, (1, 0): 0 * true}.items():
        missed = np.abs(found.path(i, j).response[:, 0, 0] - value) ** 2
        assert np.mean(missed < 12 * found.path(i, j).total[:, 0, 0] + 1e-4) > 0.97


def closed_loop(rng: np.random.Generator, r: Array) -> Record:
    u, y, x, v = np.zeros(len(r)), np.zeros(len(r)), np.zeros(len(r)), 0.3 * rng.standard_normal(len(r))
    for k in range(len(r)):
        x[k] = -A[1] * x[k - 1] - A[2] * x[k - 2] + B[1] * u[k - 1] + B[2] * u[k - 2]
        y[k] = x[k] + v[k]
        u[k] = r[k] - 0.8 * y[k]
    return Record(np.column_stack([r, u]), y, DT, ("r", "u"), ("y",))


@pytest.mark.parametrize("method", ["periodic", "polynomial", "welch"])
def test_in_closed_loop_the_response_goes_through_the_reference(method: str) -> None:
    """The mean error over records is zero within 4 standard errors from their spread; without the reference it is not.

    The direct estimate tends to the inverse of the controller where the reference is weak.
    """
    through, direct = [], []
    for seed in range(41_000, 41_012):
        rng = np.random.default_rng(seed)
        once = rng.standard_normal(12_000)
        if method == "periodic":
            once = 3.0 * excitation.multisine(1500, np.arange(1, 750), rng, phases=excitation.random_phases)
        record = closed_loop(rng, np.resize(once, 12_000))[1500:]
        found = frequency_response(record, method, reference="r")
        assert found.input_names == ("u",)
        alone = frequency_response(Record(record.input[:, 1], record.output, DT), "welch")
        for errors, each in ((through, found.between(highest=150.0)), (direct, alone.between(highest=150.0))):
            errors.append(np.mean(each.response[:, 0, 0] - truth(each.frequency)))

    def bias(errors: list[complex]) -> float:  # in standard errors of the mean
        spread = np.std(errors, ddof=1) / np.sqrt(len(errors))
        return float(np.abs(np.mean(errors)) / spread)

    assert bias(through) < 4
    assert bias(direct) > 4
    assert np.abs(np.mean(direct)) > 4 * np.abs(np.mean(through))


def test_what_cannot_be_estimated_is_refused_with_the_reason() -> None:
    rng = np.random.default_rng(12)
    r, u, y = rng.standard_normal((3, 2000))
    silent = Record(np.column_stack([r, u]), y, DT, ("r", "u"), ("y",))
    with pytest.raises(emsid.DataError, match="does not move every input"):
        frequency_response(silent, reference="r")
    with pytest.raises(emsid.DataError, match="no input 'w' as reference; it has r and u"):
        frequency_response(silent, reference="w")
    with pytest.raises(emsid.DataError, match="2 references for 0 other inputs"):
        frequency_response(silent, reference=["r", "u"])
    with pytest.raises(emsid.DataError, match="do not repeat"):
        frequency_response(silent, "periodic")
    with pytest.raises(emsid.DataError, match="follows another"):
        frequency_response(Record(np.column_stack([u, 2 * u]), y, DT))
    with pytest.raises(emsid.DataError, match="one for every input"):
        frequency_response(Record(np.tile(rng.standard_normal((500, 2)), (4, 1)), y, DT), "periodic")
    with pytest.raises(emsid.DataError, match="needs 30 samples"):
        frequency_response(Record(u[:20], y[:20], DT))


def test_a_response_is_a_value_with_parts_units_and_a_frame() -> None:
    g = np.array([[[1.0 + 1j, 2.0]], [[0.5, 1j]], [[0.1, 0.2]]])
    found = FrequencyResponse(
        np.array([1.0, 2.0, 4.0]), g, np.full(g.shape, 0.01), input_units=("V", "mV"), output_units=("rpm",)
    )
    assert found.path(0, 1).response[:, 0, 0].tolist() == [2.0, 1j, 0.2]
    assert len(found.between(1.5, 4.0)) == 2
    si = found.in_si()
    np.testing.assert_allclose(si.response / found.response, np.pi / 30 * np.array([[[1.0, 1e3]]] * 3))
    np.testing.assert_allclose(si.total / found.total, (np.pi / 30) ** 2 * np.array([[[1.0, 1e6]]] * 3))
    assert found.to_frame().columns[:4] == ["frequency", "magnitude_1_1", "phase_1_1", "deviation_1_1"]
    np.testing.assert_allclose(found.ahead(0.25).response[0, 0, 1], 2j)
    with pytest.raises(emsid.DataError, match="ascend"):
        FrequencyResponse(np.array([2.0, 1.0]), np.ones(2))
    with pytest.raises(ValueError, match="read-only"):
        found.response[0] = 0


def test_a_measured_response_is_drawn_with_its_levels_and_under_models() -> None:
    found = frequency_response(experiments(3, 13, FULL, cubic=0.02))
    curve = emsid.bode(found)
    assert set(curve.levels) == {"noise", "distortion"}
    assert np.median(curve.magnitude.high - curve.magnitude.low) > 0
    fit = emsid.fit(emsid.arx(2, 2), experiments(1, 14, FULL))
    both = emsid.bode([found, fit])
    assert len(both.plot().axes) == 2
    assert len(found.plot().axes[0].lines) >= 3
