"""Filters of a cascade that get the poles which the error shows to be missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import fit_cascade
from emsid.models.blocks.search.choice import larger_cascades
from emsid.models.blocks.search.cross_validation import WIENER_HAMMERSTEIN
from emsid.models.blocks.search.refinement import UNKNOWN, Choice, evident
from emsid.models.blocks.static_maps import Saturation, TwoSlopes
from independent.cascades import cascade

NOISE = 0.01


@pytest.fixture(scope="module")
def record() -> emsid.Record:
    """A limit between filters of orders one and two."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(2000)
    x = np.clip(lfilter([0.6], [1, -0.4], u), -0.5, 0.5)
    y = lfilter([0.1], np.poly([0.8, 0.5]), x)
    return emsid.Record(u, y + NOISE * np.std(y) * rng.standard_normal(2000), 0.01)


def orders(model: Cascade) -> list[int]:
    return [len(block.denominator) for block in model.blocks if isinstance(block, Rational)]


def test_the_error_shows_the_filter_that_misses_a_pole(record: emsid.Record) -> None:
    first = Rational([0.5, 0.0], [-0.5])
    small = fit_cascade(Cascade((first, Saturation(1.0, -0.5, 0.5), Rational([0.2, 0.0], [-0.8]))), record)
    assert small.noise_variance > (3 * NOISE * np.std(record.output)) ** 2
    larger = larger_cascades(small.model, WIENER_HAMMERSTEIN, (None, None), [record])
    assert [1, 2] in [orders(each) for each in larger]
    (second,) = larger_cascades(small.model, WIENER_HAMMERSTEIN, (1, None), [record])
    one, other = (model.simulate(record).output[200:] for model in (small.model, second))
    assert np.allclose(one, other, atol=1e-6)  # a zero cancels the pole; the initial states are estimated
    fit = fit_cascade(second, record)
    assert fit.noise_variance == pytest.approx((NOISE * np.std(record.output)) ** 2, rel=0.15)
    assert larger_cascades(fit.model, WIENER_HAMMERSTEIN, (None, None), [record]) == []


def test_no_filter_of_a_given_order_or_of_few_samples_grows(record: emsid.Record) -> None:
    model = Cascade((Rational([0.5, 0.0], [-0.5]), Saturation(1.0, -0.5, 0.5), Rational([0.2, 0.0], [-0.8])))
    assert larger_cascades(model, WIENER_HAMMERSTEIN, (1, 1), [record]) == []
    assert larger_cascades(model, WIENER_HAMMERSTEIN, (None, None), [record[:50]]) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", [14, 23, 51, 52, 56, 219])
def test_cascades_whose_response_shows_too_few_poles_reach_the_noise(seed: int) -> None:
    """Without higher orders the errors are 2.2 to 5.9 times the noise; 219 needs new starts for them."""
    _, fitted, judge, noise = cascade(seed)
    run = emsid.fit(emsid.wiener_hammerstein(static=None), fitted).model.simulate(judge)
    assert np.sqrt(np.mean((judge.output - run.output)[run.counted] ** 2)) < 1.1 * noise


@pytest.mark.parametrize("seed", [pytest.param(308, marks=pytest.mark.long), 328])
def test_a_short_record_gets_the_poles_that_its_error_shows(seed: int) -> None:
    """With the orders of the response the errors are 5.1 and 8 times the noise."""
    _, fitted, judge, noise = cascade(seed, samples=400)
    run = emsid.fit(emsid.wiener_hammerstein(static=None), fitted).model.simulate(judge)
    assert np.sqrt(np.mean((judge.output - run.output)[run.counted] ** 2)) < 1.1 * noise


def test_correlated_errors_show_less_than_independent_ones() -> None:
    """A wrong model of 300 samples halves its squared error with ten parameters; its errors are worth 15 or 300."""
    model = Cascade((Rational([0.5], [-0.5]),))
    simpler = Choice(model, UNKNOWN, known=1.0, determined=5.0)
    larger = Choice(model, UNKNOWN, known=0.7, determined=15.0)
    assert evident(replace(larger, independent=300.0), simpler)
    assert not evident(replace(larger, independent=15.0), simpler)


@pytest.mark.long
def test_two_slopes_are_found_where_nobody_names_them() -> None:
    """A dead zone ends at the bound of its edges here, and a piecewise linear map has 2.5 times the noise."""
    _, fitted, judge, noise = cascade(31)
    fit = emsid.fit(emsid.wiener_hammerstein(static=None), fitted)
    assert isinstance(fit.model.blocks[1], TwoSlopes)
    run = fit.model.simulate(judge)
    assert np.sqrt(np.mean((judge.output - run.output)[run.counted] ** 2)) < 1.1 * noise
