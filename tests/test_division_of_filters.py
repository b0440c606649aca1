"""Poles and zeros of cascades, divided between their two filters."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, cheby1, firwin, lfilter

import emsid
from emsid.estimation.nonlinear.rational import measured
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.starts import delay_exchanged, divided_anew, linear_candidates
from emsid.models.blocks.static_maps import Saturation
from emsid.record import Record


def test_pairs_of_zeros_are_divided_between_two_odd_orders() -> None:
    """All zeros of a response are pairs, each order is three: no division keeps both filters proper."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(8000)
    zeros = [0.8 + 0.5j, 0.8 - 0.5j, 0.1 + 0.6j, 0.1 - 0.6j, -0.5 + 0.6j, -0.5 - 0.6j]
    poles = [0.84 + 0.3j, 0.84 - 0.3j, 0.8, 0.9 + 0.15j, 0.9 - 0.15j, 0.7]
    y = lfilter(np.real(np.poly(zeros)), np.real(np.poly(poles)), u) + 0.01 * rng.standard_normal(8000)
    pairs = list(linear_candidates(measured([(u, y)]), (3, 3), 6, 1))
    assert pairs
    assert {(len(first.denominator), len(second.denominator)) for first, second in pairs if first and second} == {
        (3, 3)
    }


def test_every_division_keeps_the_product_of_the_filters() -> None:
    (b1, a1), (b2, a2) = cheby1(3, 1, 0.2), cheby1(3, 1, 0.25)
    model = Cascade((Rational(b1 + 0.01, a1[1:]), Saturation(0.3, -0.5, 1.0), Rational(b2, a2[1:])))
    frequency = np.linspace(0.0, 0.4, 20)

    def product(cascade: Cascade) -> NDArray[np.complex128]:
        return np.prod([b.response(frequency, 1.0) for b in cascade.blocks if isinstance(b, Rational)], axis=0)

    divided = list(divided_anew(model))
    assert len(divided) > 4
    for each in divided:
        np.testing.assert_allclose(product(each), product(model), rtol=1e-4, atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, pytest.param(4, marks=pytest.mark.long)])
def test_zeros_beyond_the_band_of_the_input_end_in_the_right_filter(seed: int) -> None:
    """All zeros are at half the sampling rate, where the input has no power; there is a minimum at 1.5 × the noise."""
    rng = np.random.default_rng(seed)
    (b1, a1), (b2, a2) = cheby1(3, 1, 0.2), cheby1(3, 1, 0.25)
    u = lfilter(firwin(101, 0.4), 1.0, 2.0 * rng.standard_normal(4000))
    y = lfilter(b2, a2, np.clip(lfilter(b1, a1, u), -0.5, 0.3))
    noise = 0.005 * float(np.std(y))
    record = Record(u, y + noise * rng.standard_normal(4000), 1e-3)
    fit = emsid.fit(emsid.wiener_hammerstein(orders=(3, 3), static="saturation"), record[:2000])
    error = (y[2000:] - fit.model.simulate(record[2000:]).output[:, 0])[400:]
    assert np.std(error) < 0.2 * noise


def test_a_delay_of_the_second_filter_is_moved_to_the_first() -> None:
    model = Cascade(
        (Rational([0.5, 0.2, 0.0], [-0.9, 0.3]), Saturation(0.3, -0.5, 1.0), Rational([0.0, 0.4, 0.1], [-0.7, 0.2]))
    )
    late, _ = delay_exchanged(model)
    first, _, second = late.blocks
    np.testing.assert_allclose(first.parameters, [0.0, 0.5, 0.2, -0.9, 0.3], atol=1e-6)
    np.testing.assert_allclose(second.parameters, [0.4, 0.1, 0.0, -0.7, 0.2], atol=1e-6)
    _, early = delay_exchanged(late)
    np.testing.assert_allclose(early.parameters, model.parameters, atol=1e-6)


def test_a_sample_of_delay_in_the_wrong_filter_is_moved() -> None:
    """The zeros of the first filter are beyond the band of the input; there is a minimum at 2.6 × the noise."""
    rng = np.random.default_rng(1)
    (b1, a1), a2 = butter(2, 0.375), np.array([1.0, -1.6659, 1.8171, -1.0633, 0.3148])
    u = lfilter(firwin(81, 0.35), 1.0, rng.standard_normal(8000))
    x = lfilter(b1, a1, u) / np.std(lfilter(b1, a1, u))
    y = lfilter([0.36], a2, np.sign(x) * np.maximum(np.abs(x) - 0.3, 0.0))
    noise = 0.005 * float(np.std(y))
    record = Record(u, y + noise * rng.standard_normal(8000), 1e-3)
    fit = emsid.fit(emsid.wiener_hammerstein(orders=(2, 4), static="dead-zone"), record[:4000])
    error = (y[4000:] - fit.model.simulate(record[4000:]).output[:, 0])[400:]
    assert np.std(error) < 0.2 * noise
