"""Test signals: equations, spectra, limits, order of excitation, and a contract test of every named signal."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emsid.errors import DataError
from emsid.excitation import (
    SIGNALS,
    amplitude_modulated_prbs,
    chirp,
    crest_factor,
    full_harmonics,
    largest_order,
    limit,
    linear_sweep,
    logarithmic_sweep,
    low_crest_phases,
    multisine,
    odd_harmonics,
    persistent_excitation_order,
    prbs,
    ramp,
    random_phases,
    schroeder_phases,
    sines,
    staircase,
)
from emsid.excitation.named import PRIMITIVE_POLYNOMIALS
from emsid.excitation.persistence import _covariance
from emsid.record import Record, concatenate


def seeded(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def amplitude_spectrum(period: np.ndarray) -> np.ndarray:
    """Amplitude of every harmonic 0 … M/2 of one period."""
    return np.abs(np.fft.rfft(period)) * 2 / len(period)


# --- sums of sines ---------------------------------------------------------------------------------------


def test_sines_are_the_sum_in_the_docstring():
    t = 1e-3 * np.arange(500)
    expected = 3 * np.sin(2 * np.pi * 1.5 * t + 0.2) + 0.5 * np.sin(2 * np.pi * 40 * t - 1.0)
    assert np.allclose(sines(500, 1e-3, [3, 0.5], [1.5, 40], [0.2, -1.0]), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("period", [64, 101, 1000])
@pytest.mark.parametrize("phases", [low_crest_phases, schroeder_phases, random_phases])
def test_multisine_has_power_on_its_harmonics_only(period, phases):
    harmonics = np.array([1, 2, 5, 11, 30])
    weights = np.array([1.0, 2.0, 0.5, 1.0, 3.0])
    u = multisine(3 * period, harmonics, seeded(), 12.0, period=period, weights=weights, phases=phases)
    assert np.array_equal(u[:period], u[period : 2 * period])
    assert np.max(np.abs(u)) == 12.0
    spectrum = amplitude_spectrum(u[:period]) / 12.0
    assert np.delete(spectrum, harmonics).max() < 1e-12
    assert np.allclose(spectrum[harmonics] / spectrum[1], weights, rtol=1e-12)


def test_multisine_weights_belong_to_their_harmonics_in_any_order():
    u = multisine(100, [7, 3], seeded(), weights=[2.0, 1.0])
    spectrum = amplitude_spectrum(u)
    assert spectrum[7] / spectrum[3] == pytest.approx(2.0, rel=1e-12)
    assert np.array_equal(u, multisine(100, [3, 7], seeded(), weights=[1.0, 2.0]))


def test_multisine_on_odd_harmonics_is_half_wave_antisymmetric():
    u = multisine(1000, odd_harmonics(1000, 1e-3, 1, 99), seeded())
    assert np.allclose(u[:500], -u[500:], rtol=0, atol=1e-13)


def test_multisine_follows_its_seed():
    harmonics = np.arange(1, 40)
    first, again, other = (multisine(400, harmonics, seeded(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.9


@pytest.mark.parametrize(
    ("harmonics", "bound"),
    [
        (np.arange(1, 32), 1.5),
        (np.arange(1, 201), 1.46),
        (np.arange(1, 400, 2), 1.46),  # odd
        (np.arange(50, 200), 1.54),  # a band
    ],
)
def test_low_crest_factor_of_a_flat_multisine(harmonics, bound):
    period = 32 * harmonics[-1]  # fine enough to see every peak between the samples of the design
    for seed in range(3):
        low, schroeder, random = (
            crest_factor(multisine(period, harmonics, seeded(seed), phases=phases))
            for phases in (low_crest_phases, schroeder_phases, random_phases)
        )
        assert low < bound
        assert schroeder < 2.0 < 2.4 < random
        assert low < schroeder - 0.15
        assert low < random - 1.0


def test_low_crest_factor_of_a_full_multisine_up_to_nyquist():
    assert crest_factor(multisine(128, np.arange(1, 64), seeded())) < 1.4


def test_more_swaps_give_a_lower_crest_factor():
    harmonics = np.arange(1, 101)
    few, many = (
        crest_factor(multisine(1000, harmonics, seeded(), phases=partial(low_crest_phases, iterations=n)))
        for n in (10, 600)
    )
    assert many < few - 0.05


def test_harmonics_of_a_band():
    assert full_harmonics(2000, 1e-3, 0.0, 2.0).tolist() == [1, 2, 3, 4]
    assert odd_harmonics(2000, 1e-3, 0.0, 2.0).tolist() == [1, 3]
    assert full_harmonics(10, 0.1, 0.1 * 30, 4.0).tolist() == [3, 4]  # an edge meant exactly


# --- binary and multilevel noise -------------------------------------------------------------------------


def times_x_to(power: int, polynomial: int, degree: int) -> int:
    """x^power modulo a polynomial over GF(2), both as bit masks."""

    def product(a: int, b: int) -> int:
        result = 0
        while b:
            if b & 1:
                result ^= a
            a, b = a << 1, b >> 1
            if a >> degree & 1:
                a ^= polynomial
        return result

    result, square = 1, 2
    while power:
        if power & 1:
            result = product(result, square)
        square, power = product(square, square), power >> 1
    return result


def prime_factors(n: int) -> set[int]:
    factors, p = set(), 2
    while p * p <= n:
        while n % p == 0:
            factors.add(p)
            n //= p
        p += 1
    return factors | ({n} if n > 1 else set())


@pytest.mark.parametrize("degree", PRIMITIVE_POLYNOMIALS)
def test_polynomials_are_primitive(degree):
    exponents = PRIMITIVE_POLYNOMIALS[degree]
    assert list(exponents) == sorted(exponents, reverse=True)
    polynomial = sum(1 << e for e in (degree, *exponents, 0))
    period = 2**degree - 1
    assert times_x_to(period, polynomial, degree) == 1
    assert all(times_x_to(period // p, polynomial, degree) != 1 for p in prime_factors(period))


@pytest.mark.parametrize("order", PRIMITIVE_POLYNOMIALS)
def test_prbs_equals_the_bit_by_bit_register(order):
    start, length = 1 + order % 2, 500
    bits = [start >> k & 1 for k in range(order)]
    while len(bits) < length:
        past = len(bits) - order
        bits.append((bits[past] + sum(bits[past + e] for e in PRIMITIVE_POLYNOMIALS[order])) % 2)
    assert np.array_equal(prbs(length, order, start=start), 2.0 * np.array(bits[:length]) - 1)


@pytest.mark.parametrize("order", range(2, 17))
def test_prbs_period_levels_and_autocorrelation(order):
    period, a = 2**order - 1, 6.0
    u = prbs(2 * period, order, a)
    assert np.array_equal(u[:period], u[period:])
    assert set(np.unique(u)) == {-a, a}
    assert u[:period].sum() == a
    autocorrelation = np.fft.irfft(np.abs(np.fft.rfft(u[:period])) ** 2, period) / period
    assert autocorrelation[0] == pytest.approx(a**2, rel=1e-12)
    assert np.allclose(autocorrelation[1:], -(a**2) / period, rtol=0, atol=1e-10)  # so no shorter period


def test_prbs_of_order_20_has_the_full_period():
    u = prbs(2**20 + 20, 20)
    assert u[: 2**20 - 1].sum() == 1.0
    assert np.array_equal(u[:21], u[2**20 - 1 :])


def test_prbs_hold_repeats_every_tick():
    ticks, held = prbs(40, 5), prbs(118, 5, hold=3)
    assert np.array_equal(held, np.repeat(ticks, 3)[:118])


def test_prbs_start_is_a_shift_of_the_same_sequence():
    first, other = prbs(31, 5), prbs(31, 5, start=9)
    assert any(np.array_equal(np.roll(first, shift), other) for shift in range(31))


def test_aprbs_switches_with_the_prbs_and_uses_every_level_once():
    binary = prbs(600, 6, hold=7)
    u = amplitude_modulated_prbs(600, 6, seeded(), 12.0, hold=7)
    assert np.array_equal(np.flatnonzero(np.diff(u)), np.flatnonzero(np.diff(binary)))
    levels = u[np.flatnonzero(np.diff(u, prepend=np.nan))]
    assert np.allclose(np.sort(levels), np.linspace(-12, 12, len(levels)), rtol=0, atol=1e-14)
    assert not np.array_equal(u, amplitude_modulated_prbs(600, 6, seeded(1), 12.0, hold=7))


# --- sweeps, steps and ramps -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sweep", "frequency"),
    [
        (linear_sweep, lambda x: 2 + (50 - 2) * x),
        (logarithmic_sweep, lambda x: 2 * (50 / 2) ** x),
    ],
)
def test_chirp_sweeps_as_its_frequency_law_says(sweep, frequency):
    x, h = np.linspace(0.1, 0.9, 9), 1e-5
    slope = (sweep(x + h, 2.0, 50.0) - sweep(x - h, 2.0, 50.0)) / (2 * h)
    assert np.allclose(slope, frequency(x), rtol=1e-7)
    u = chirp(20_000, 1e-3, 2.0, 50.0, 3.0, sweep)
    assert u[0] == 0.0
    assert 2.9999 < np.max(np.abs(u)) <= 3.0
    assert crest_factor(u) == pytest.approx(np.sqrt(2), abs=0.02)
    crossings = np.count_nonzero(np.diff(np.signbit(u)))
    assert crossings / 2 == pytest.approx(20 * float(sweep(np.array(1.0), 2.0, 50.0)), abs=1)


def test_chirp_of_equal_ends_is_a_sine():
    for sweep in (linear_sweep, logarithmic_sweep):
        assert np.allclose(chirp(300, 0.01, 4.0, 4.0, 1.0, sweep), sines(300, 0.01, [1.0], [4.0]), atol=1e-11)


@pytest.mark.parametrize(("samples", "steps"), [(5, 1), (21, 5), (1000, 5), (137, 4)])
def test_staircase_goes_up_down_negative_and_back(samples, steps):
    u = staircase(samples, steps, 10.0)
    starts = np.flatnonzero(np.diff(u, prepend=np.nan))
    up = np.arange(1, steps + 1)
    down = up[::-1][1:]
    expected = np.concatenate([[0], up, down, [0], -up, -down, [0]]) * 10.0 / steps
    assert np.allclose(u[starts], expected, rtol=0, atol=1e-14)
    lengths = np.diff([*starts, samples])
    assert lengths.max() - lengths.min() <= 1
    assert (u.max(), u.min()) == (10.0, -10.0)


def test_ramp_has_one_slope_and_reaches_its_ends():
    u = ramp(4801, (0.0, 12.0, -12.0, 0.0))
    assert (u[0], u[1200], u[3600], u[-1]) == (0.0, 12.0, -12.0, 0.0)
    assert np.allclose(np.abs(np.diff(u)), 0.01, rtol=1e-9)
    assert np.allclose(ramp(11, (-1.0, 1.0)), np.linspace(-1, 1, 11), atol=1e-15)


# --- limits ----------------------------------------------------------------------------------------------

values = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60)
limits = st.one_of(st.none(), st.floats(1e-6, 1e6))


@settings(deadline=None)
@given(values, st.floats(1e-6, 10.0), limits, limits)
def test_limits_hold_exactly_and_limiting_twice_changes_nothing(signal, dt, amplitude, slew):
    u = np.array(signal)
    y = limit(u, dt, amplitude, slew)
    assert y.shape == u.shape
    if amplitude is not None:
        assert np.max(np.abs(y)) <= amplitude
    if slew is not None:
        assert np.all(np.abs(np.diff(y)) <= slew * dt)
    assert np.array_equal(limit(y, dt, amplitude, slew), y)
    within = np.max(np.abs(u)) <= (amplitude or np.inf)
    if within and np.all(np.abs(np.diff(u)) <= (slew or np.inf) * dt):
        assert np.array_equal(y, u)


def test_limit_follows_at_the_slew_rate():
    y = limit(np.full(100, 7.0), 0.01, slew=10.0)
    assert np.array_equal(y, np.full(100, 7.0))  # the first sample is free
    y = limit(np.concatenate([[0.0], np.full(99, 7.0)]), 0.01, slew=10.0)
    assert np.allclose(y, np.minimum(0.1 * np.arange(100), 7.0), rtol=0, atol=1e-13)


def test_limit_does_not_change_its_argument():
    u = np.array([0.0, 5.0])
    y = limit(u, 1.0)
    y[0] = 9.0
    assert u.tolist() == [0.0, 5.0]


# --- order of excitation, crest factor ------------------------------------------------------------------------------


def test_known_crest_factors():
    assert crest_factor(prbs(100, 5, 7.0)) == pytest.approx(1.0, rel=1e-14)
    assert crest_factor(sines(1000, 1e-3, [3.0], [5.0])) == pytest.approx(np.sqrt(2), rel=1e-12)
    assert crest_factor(ramp(100_001, (-1.0, 1.0))) == pytest.approx(np.sqrt(3), rel=1e-4)


def test_the_crest_factor_of_a_record_is_the_largest_of_its_inputs():
    t = np.arange(1000) * 1e-3
    inputs = np.column_stack([prbs(1000, 6), 1e-3 * np.sin(2 * np.pi * 5 * t)])
    record = Record(inputs, np.zeros(1000), dt=1e-3)
    assert crest_factor(record) == pytest.approx(np.sqrt(2), rel=1e-12)


@pytest.mark.parametrize(
    ("signal", "order"),
    [
        (np.zeros(100), 0),
        (np.full(100, 3.0), 1),
        (np.eye(1, 100)[0], 0),  # a pulse is over
        (np.repeat([0.0, 1.0], [30, 270]), 1),  # a step
        (np.repeat([1.0, 2.0, 1.0], [95, 110, 95]), 1),
        (sines(400, 1e-3, [1.0], [20.0]), 2),
        (4.0 + sines(400, 1e-3, [1.0], [20.0]), 3),
        (sines(2000, 1e-3, [1.0, 2.0, 0.5], [20.0, 45.0, 130.0]), 6),
        (ramp(400, (0.0, 1.0)), 2),
        (prbs(200, 3), 7),
        (prbs(400, 4, 9.0), 15),
        (prbs(800, 5), 31),
        (multisine(400, [3, 10, 20, 44], seeded(), period=200), 8),
    ],
)
def test_order_of_persistent_excitation(signal, order):
    assert persistent_excitation_order(signal, max_order=40) == order
    assert persistent_excitation_order(signal, max_order=40, tolerance=1e-6) == order


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
@pytest.mark.parametrize(("samples", "dt"), [(2000, 5e-3), (12_000, 5e-3), (40_000, 1e-3)])
def test_slow_sines_at_a_fast_sample_time_count_two_each(samples, dt, tolerance):
    u = SIGNALS["sines"](samples, dt, 6.0, seeded())
    assert persistent_excitation_order(u, tolerance=tolerance) == 10


def test_largest_order_of_a_short_record():
    assert largest_order(np.ones(2000)) == 50
    assert largest_order(np.ones(2000), max_order=200) == 125
    assert largest_order(np.ones((2000, 6)), max_order=200) == 83
    assert largest_order(np.ones(7)) == persistent_excitation_order(np.ones(7)) == 0
    u = prbs(200, 5)  # of order 31
    assert largest_order(u) == persistent_excitation_order(u) == 13


def test_noise_excites_every_order():
    noise = seeded().standard_normal(10_000)  # several blocks of rows
    assert persistent_excitation_order(noise, max_order=60) == 60
    assert persistent_excitation_order(noise[:200], max_order=60) == 13  # as many as 200 samples can show


def test_order_above_a_noise_floor():
    u = sines(5000, 1e-3, [1.0], [100.0]) + 1e-5 * seeded().standard_normal(5000)
    assert persistent_excitation_order(u, max_order=30) == 30
    assert persistent_excitation_order(u, max_order=30, tolerance=1e-3) == 2


@pytest.mark.parametrize(("samples", "channels", "n"), [(9, 1, 1), (40, 3, 7), (10, 2, 10), (3000, 2, 20)])
def test_the_covariance_of_rows_is_their_product(samples, channels, n):
    u = seeded().standard_normal((samples, channels))
    rows = np.array([u[t : t + n].ravel() for t in range(samples - n + 1)])
    np.testing.assert_allclose(_covariance(u, n), rows.T @ rows, rtol=0, atol=1e-12 * samples)


@pytest.mark.parametrize("name", SIGNALS)
def test_the_fast_computation_of_the_order_equals_the_exact_one(name, monkeypatch):
    u = SIGNALS[name](1500, 5e-3, 6.0, seeded())
    fast = [persistent_excitation_order(u, tolerance=tolerance) for tolerance in (1e-4, 1e-3, 1e-2)]
    monkeypatch.setattr("emsid.excitation.persistence._COARSE", 1.0)
    assert [persistent_excitation_order(u, tolerance=tolerance) for tolerance in (1e-4, 1e-3, 1e-2)] == fast


def test_order_does_not_depend_on_unit_or_block():
    u = sines(9000, 1e-3, [1.0, 1.0], [5.0, 12.0])
    assert persistent_excitation_order(u) == persistent_excitation_order(1e-9 * u) == 4


def test_order_of_two_inputs_counts_their_joint_excitation():
    u = seeded().standard_normal(500)
    other = seeded(1).standard_normal(500)
    assert persistent_excitation_order(np.column_stack([u, 1e-6 * other]), max_order=20) == 20
    assert persistent_excitation_order(np.column_stack([u, u]), max_order=20) == 0
    assert persistent_excitation_order(np.column_stack([u[1:], u[:-1]]), max_order=20) == 1
    assert persistent_excitation_order(np.column_stack([u, 0 * u]), max_order=20) == 0


def test_order_is_computed_segment_by_segment():
    def constant(level: float) -> Record:
        return Record(np.full(50, level), np.zeros(50), dt=0.1)

    levels = concatenate([constant(level) for level in seeded().uniform(-1, 1, 30)])
    assert persistent_excitation_order(levels) == 1
    assert persistent_excitation_order(levels.input) > 10  # steps inside a segment excite
    short = concatenate([Record(seeded(k).standard_normal(9), np.zeros(9), dt=0.1) for k in range(30)])
    assert persistent_excitation_order(short, max_order=20) == largest_order(short, max_order=20) == 7
    at_rest = Record(np.zeros(500), np.zeros(500), dt=0.1)
    assert persistent_excitation_order(concatenate([at_rest, short, short])) == 9  # rest does not count


def test_inputs_may_be_excited_in_turn():
    noise, rest = seeded().standard_normal(2000), np.zeros(2000)
    u = np.column_stack([np.concatenate([noise, rest]), np.concatenate([rest, noise])])
    assert persistent_excitation_order(u, max_order=20) == 20


# --- errors ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: sines(10, 0.1, [1.0], [5.0]), "Nyquist frequency of 5 Hz"),
        (lambda: sines(10, 0.1, [1.0], [-1.0]), "Nyquist"),
        (lambda: sines(10, 0.1, [1.0, 2.0], [1.0]), "2 amplitudes, 1 frequencies"),
        (lambda: sines(0, 0.1, [1.0], [1.0]), "number of samples 0"),
        (lambda: sines(2.5, 0.1, [1.0], [1.0]), "number of samples 2.5"),
        (lambda: sines(10, 0.0, [1.0], [1.0]), "sample time 0"),
        (lambda: sines(10, 0.1, [[1.0]], [1.0]), "one-dimensional"),
        (lambda: multisine(100, [], seeded()), "one or more"),
        (lambda: multisine(100, [1.5], seeded()), "whole numbers"),
        (lambda: multisine(100, [3, 3], seeded()), "twice"),
        (lambda: multisine(100, [1, 50], seeded()), "1 to 49"),
        (lambda: multisine(100, [0, 1], seeded()), "1 to 49"),
        (lambda: multisine(100, [1], seeded(), 0.0), "amplitude 0"),
        (lambda: multisine(100, [1, 2], seeded(), weights=[1.0]), "1 weights for 2"),
        (lambda: multisine(100, [1, 2], seeded(), weights=[1.0, 0.0]), "positive weight"),
        (lambda: full_harmonics(100, 0.1, 0.11, 0.12), "no harmonic"),
        (lambda: full_harmonics(100, 0.1, 1.0, 5.0), "Nyquist"),
        (lambda: odd_harmonics(100, 0.1, 0.2, 0.2), "even"),
        (lambda: prbs(100, 1), "give 2 … 32"),
        (lambda: prbs(100, 33), "give 2 … 32"),
        (lambda: prbs(100, 3, start=8), "give 1 … 7"),
        (lambda: prbs(100, 3, start=0), "start"),
        (lambda: prbs(100, 3, hold=0), "hold 0"),
        (lambda: prbs(100, 3, -1.0), "amplitude -1"),
        (lambda: amplitude_modulated_prbs(100, 40, seeded()), "give 2 … 32"),
        (lambda: chirp(100, 0.01, 1.0, 50.0), "Nyquist frequency of 50 Hz"),
        (lambda: chirp(100, 0.01, 0.0, 5.0, 1.0, logarithmic_sweep), "positive frequencies"),
        (lambda: staircase(20, 5), "21 levels"),
        (lambda: ramp(10, [1.0]), "2 or more"),
        (lambda: ramp(10, [0.0, 1.0, 1.0]), "no two equal"),
        (lambda: ramp(1, [0.0, 1.0]), "2 or more"),
        (lambda: limit([0.0, np.nan], 0.1), "finite"),
        (lambda: limit([0.0], 0.1, amplitude=-1.0), "amplitude limit"),
        (lambda: limit([0.0], 0.1, slew=0.0), "slew limit"),
        (lambda: crest_factor(np.zeros(5)), "no crest factor"),
        (lambda: crest_factor(np.empty(0)), "no samples"),
        (lambda: persistent_excitation_order(np.empty(0)), "no samples"),
        (
            lambda: persistent_excitation_order(Record(np.empty((5, 0)), np.ones(5), dt=1.0)),
            "no input channel",
        ),
        (lambda: persistent_excitation_order(np.ones(5), max_order=0), "largest order 0"),
        (lambda: persistent_excitation_order(np.ones(5), tolerance=0.0), "tolerance"),
    ],
)
def test_errors_are_one_line_that_says_what_to_do(call, says):
    with pytest.raises(DataError) as caught:
        call()
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


# --- the contract of every named signal ------------------------------------------------------------------


@pytest.mark.parametrize("name", SIGNALS)
class TestEverySignal:
    @pytest.mark.parametrize(("samples", "dt"), [(5, 0.1), (6, 1e-3), (127, 0.05), (10_000, 1e-3), (50_001, 2e-4)])
    @pytest.mark.parametrize("amplitude", [0.1, 12.0])
    def test_fills_its_length_within_its_amplitude(self, name, samples, dt, amplitude):
        u = SIGNALS[name](samples, dt, amplitude, seeded())
        assert u.shape == (samples,)
        assert u.dtype == np.float64
        assert np.isfinite(u).all()
        assert np.max(np.abs(u)) <= amplitude
        if samples >= 127:
            assert np.max(np.abs(u)) > 0.6 * amplitude

    def test_follows_the_seed(self, name):
        first, again = (SIGNALS[name](1000, 1e-3, 5.0, seeded(3)) for _ in range(2))
        assert np.array_equal(first, again)

    def test_goes_both_ways(self, name):
        u = SIGNALS[name](10_000, 1e-3, 12.0, seeded())
        assert u.max() > 6.0
        assert u.min() < -6.0

    def test_scales_with_its_amplitude(self, name):
        small, large = (SIGNALS[name](500, 1e-3, a, seeded(1)) for a in (1.0, 8.0))
        assert np.allclose(8.0 * small, large, rtol=1e-12, atol=1e-14)

    def test_says_what_it_is(self, name):
        assert SIGNALS[name].__doc__
        assert name == name.lower()

    @pytest.mark.parametrize(
        ("samples", "dt", "amplitude"), [(0, 0.1, 1.0), (-3, 0.1, 1.0), (100, 0.1, -1.0), (100, 0.1, np.nan)]
    )
    def test_refuses_bad_sizes(self, name, samples, dt, amplitude):
        with pytest.raises(DataError):
            SIGNALS[name](samples, dt, amplitude, seeded())


@pytest.mark.parametrize("name", ["sines", "multisine", "odd-multisine", "prbs", "aprbs"])
def test_random_signals_differ_between_seeds_and_excite_a_motor_model(name):
    first, other = (SIGNALS[name](10_000, 1e-3, 12.0, seeded(seed)) for seed in (1, 2))
    assert not np.array_equal(first, other)
    assert persistent_excitation_order(first, max_order=8, tolerance=1e-12) == 8


def test_more_samples_than_fit_are_refused() -> None:
    with pytest.raises(DataError, match="from 1 to 100,000,000"):
        prbs(10**13, 3)
