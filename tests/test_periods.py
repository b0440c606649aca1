"""Periodic inputs: their period, the mean over it, and cascades fitted in steady state."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import freqz, lfilter

import emsid
from emsid.errors import ModelError
from emsid.estimation.nonlinear.rational import measured
from emsid.excitation.periods import averaged, period_of
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.estimation import SHORTEST, steady_state
from emsid.models.blocks.static_maps import Saturation
from independent.process_noise import FIRST, SECOND, circuit, multisine

Array = NDArray[np.float64]


NOISE = 0.02


def drive(u: Array, seed: int) -> emsid.Record:
    """Two periods and more of a saturation before a first-order filter, from rest, with noise of the size `NOISE`."""
    y = lfilter([0.2], [1, -0.8], np.clip(u, -1, 1)) + NOISE * np.random.default_rng(seed).standard_normal(len(u))
    return emsid.Record(u, y, 0.01)


@pytest.fixture(scope="module")
def periodic() -> list[emsid.Record]:
    """Two realisations of five periods; the first of each begins at rest."""
    return [drive(np.tile(multisine(np.random.default_rng(k), 2048), 5), k) for k in range(2)]


def test_the_period_of_an_input_is_found() -> None:
    once = np.random.default_rng(0).standard_normal(1500)
    assert period_of(np.tile(once, 3)) == 1500
    assert period_of(np.concatenate([once[700:], np.tile(once, 2)])) == 1500
    assert period_of(np.tile(np.repeat(np.sign(once[:150]), 10), 2)) == 1500


def test_an_input_that_does_not_repeat_has_no_period() -> None:
    once = np.random.default_rng(0).standard_normal(1500)
    changed = np.tile(once, 3)
    changed[2000] += 1e-3
    assert period_of(changed) is None
    assert period_of(np.zeros(5000)) is None
    assert period_of(np.tile(once[:100], 12), SHORTEST) is None  # the mean would be a very short record
    assert period_of(np.tile(once[:3], 4)) is None


def test_several_short_periods_count_as_one() -> None:
    repeated = np.tile(np.random.default_rng(0).standard_normal(300), 10)
    assert period_of(repeated, SHORTEST) == 1200
    assert period_of(repeated) == 300


def test_periods_are_averaged_without_a_first_one_that_is_not_settled() -> None:
    rng = np.random.default_rng(1)
    u, y = np.tile(rng.standard_normal(2000), 5), np.tile(rng.standard_normal(2000), 5)
    noisy = y + 0.1 * rng.standard_normal(10_000)
    settled = averaged(u, noisy, 2000)
    assert settled.averages == 5
    assert settled.variance == pytest.approx(0.01, rel=0.1)
    assert np.std(settled.output - y[:2000]) == pytest.approx(0.1 / np.sqrt(5), rel=0.1)
    noisy[:400] += 1.0
    assert averaged(u, noisy, 2000).averages == 4


def test_the_response_at_the_lines_of_a_period_has_no_leakage() -> None:
    """A resonance that a window would smear, to three standard deviations of its noise at almost all lines."""
    made = circuit(3, 2048, process=0.0, level=0.2)
    found = measured([(r.input[:, 0], r.output[:, 0]) for r in made.fitted], period=2048)
    at = 2 * np.pi * found.frequency
    missed = np.abs(found.response[:, 0, 0] - freqz(*FIRST, at)[1] * freqz(*SECOND, at)[1])
    assert np.mean(missed < 4 * np.sqrt(found.total[:, 0, 0]) + 2e-3 * np.abs(found.response[:, 0, 0])) > 0.95


def test_a_fit_to_averaged_periods_is_that_to_all_samples(periodic: list[emsid.Record]) -> None:
    def fit(**options: int) -> emsid.Fit:
        structure = emsid.hammerstein(1, static="saturation", oversampling=1, delay=0, **options)
        return emsid.fit(structure, periodic)

    mean, every = fit(), fit(period=0)
    (finding,) = (each for each in mean.findings if each.code == "periods-averaged")
    assert finding.data["noise"] == pytest.approx(NOISE, rel=0.05)
    assert (finding.data["period"], finding.data["records"]) == (2048, 2)
    assert "periods-averaged" not in {each.code for each in every.findings}
    apart = np.abs(mean.model.parameters - every.model.parameters)[: len(mean.estimate)]
    assert np.all(apart[:3] < 2 * every.standard_error[:3])
    assert mean.noise_variance == pytest.approx(NOISE**2 * 2 / finding.data["periods"], rel=0.1)


def test_a_period_may_be_given(periodic: list[emsid.Record]) -> None:
    once = [record[-2048:] for record in periodic]
    steady = steady_state(once, 2048)
    assert steady is not None
    assert (steady.averages, steady.noise) == (2, None)
    assert steady_state(once, None) is None
    with pytest.raises(ModelError):
        steady_state(once, 2049)


def test_the_free_run_is_in_steady_state_after_the_samples_put_ahead(periodic: list[emsid.Record]) -> None:
    steady = steady_state(periodic, None)
    assert steady is not None
    model = Cascade((Saturation(1.0, -1.0, 1.0), Rational([0.05], [-0.95])))
    records, ahead = steady.with_end_ahead(model)
    u = records[0].input[:, 0]
    run = model.output(u, model.resting(float(u[0])))
    again = model.output(np.tile(steady.records[0].input[:, 0], 2), model.resting(0.0))[2048:]
    assert 0 < ahead < 2048
    np.testing.assert_allclose(run[ahead:], again, atol=1e-3 * np.std(again))


def test_a_period_with_which_the_input_does_not_repeat_is_refused() -> None:
    rng = np.random.default_rng(3)
    white, once = rng.standard_normal(2000), rng.standard_normal(400)
    with pytest.raises(ModelError, match=r"does not repeat with a period of 400 samples; give its period, or 0"):
        emsid.fit(emsid.hammerstein(1, static="saturation", period=400), drive(white, 0))
    with pytest.raises(ModelError, match=r"does not repeat with a period of 300 samples; it does with 400"):
        emsid.fit(emsid.hammerstein(1, static="saturation", period=300), drive(np.tile(once, 5), 0))
    for period, enough in ((7, 56), (1, 50)):
        with pytest.raises(ModelError, match=f"a period of {period} samples is too short .* such as {enough}, or 0"):
            emsid.fit(emsid.hammerstein(1, static="saturation", period=period), drive(white, 0))


def test_a_period_may_be_given_for_an_input_that_is_measured_with_noise() -> None:
    rng = np.random.default_rng(3)
    u = np.tile(rng.standard_normal(400), 5)
    assert averaged(u + 0.1 * rng.standard_normal(len(u)), u, 400).averages == 5
