"""Correlations of residuals, by hand and by what chance makes of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid.validation.correlation import autocorrelation, cross_correlation

Array = NDArray[np.float64]

# 99 of 100 normal deviates are smaller.
WHITE = 2.5758


def test_cross_correlation_is_that_of_pairs_in_one_segment() -> None:
    rng = np.random.default_rng(0)
    error, u = rng.standard_normal((2, 50))
    error[7] = np.nan
    e, v = np.nan_to_num(error - np.nanmean(error)), u - np.delete(u, 7).mean()
    pairs = [
        [(t, t - lag) for t in range(50) if 0 <= t - lag < 50 and (t < 20) == (t - lag < 20)] for lag in range(-5, 6)
    ]
    sums = np.array([sum(e[a] * v[b] for a, b in some) for some in pairs])

    def own(x, k):
        return sum(x[t] * x[t - k] for t in range(k, 50) if (t < 20) == (t - k < 20))

    spread = sum((1 - abs(k) / 6) * own(e, abs(k)) * own(v, abs(k)) for k in range(-5, 6)) / 49
    assert cross_correlation(error, u, (20,), 5) == pytest.approx(sums / np.sqrt(spread))


def test_cross_correlation_of_coloured_signals_that_are_independent_stays_within_its_limits() -> None:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((2, 60, 2000))
    outside = [
        np.mean(np.abs(cross_correlation(e, u, (), 100)) > WHITE)
        for e, u in zip(lfilter([1], [1, -0.9], noise[0]), lfilter([1], [1, -0.8], noise[1]), strict=True)
    ]
    assert 0.003 < np.mean(outside) < 0.03
    missed = lfilter([0, 0, 1], [1], noise[0, 0])
    shown = cross_correlation(missed, noise[0, 0], (), 20)
    assert np.argmax(shown) == 22  # two samples after the input


@pytest.mark.parametrize("u", [np.ones(100), np.zeros(100)])
def test_an_input_that_does_not_move_has_no_cross_correlation(u: Array) -> None:
    assert not cross_correlation(np.arange(100.0), u, (), 20).any()


def test_autocorrelation_does_not_reach_across_gaps() -> None:
    error = np.array([1.0, -1.0, 1.0, -1.0, np.nan, np.nan, -1.0, 1.0, -1.0, 1.0])
    inside = autocorrelation(error, (5,), 1)
    assert inside[1] == pytest.approx(-6 / 8)
