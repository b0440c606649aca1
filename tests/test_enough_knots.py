"""A spline whose number of knots is not given gets more of them where low noise shows that they are too few."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

import emsid
from emsid.models.blocks.static_maps import CubicSpline
from emsid.record import Record

Array = NDArray[np.float64]
Map = Callable[[Array], Array]

MAPS: dict[str, Map] = {
    "hyperbolic tangent": lambda x: np.tanh(1.5 * x),
    "dead zone": lambda x: x - np.clip(x, -0.4, 0.4),
    "saturation": lambda x: np.clip(x, -0.8, 0.8),
}


def records(curve: Map, seed: int, noise: float) -> tuple[Record, Record, float]:
    """A record to fit, one of nine tenths of its amplitude without noise, and the standard deviation of the noise."""
    rng = np.random.default_rng(seed)

    def run(level: float) -> tuple[Array, Array]:
        spectrum = np.zeros(1251, complex)
        spectrum[1:501] = np.exp(2j * np.pi * rng.uniform(size=500))
        u = np.fft.irfft(spectrum, 2500)
        u *= level / u.std()
        return u, lfilter(*butter(1, 0.35), curve(lfilter(*butter(2, 0.25), u)))

    (u, y), other = run(1.0), run(0.9)
    size = noise * float(np.std(y))
    return Record(u, y + size * rng.standard_normal(len(u)), 0.01), Record(*other, 0.01), size


def ratio(model: emsid.Cascade, judge: Record, noise: float) -> float:
    """The free-run error on a record with noise over that noise."""
    run = model.simulate(judge)
    error = (run.output - judge.output)[run.counted]
    return float(np.sqrt(1 + np.mean(error**2) / noise**2))


@pytest.mark.parametrize(
    ("name", "seed"),
    [("dead zone", 1), *(pytest.param("saturation", seed, marks=pytest.mark.long) for seed in (1, 3))],
)
def test_a_kink_gets_knots_until_noise_hides_it(name: str, seed: int) -> None:
    """With 40 knots the errors are 1.6 to 2.5 times the noise."""
    record, judge, noise = records(MAPS[name], seed, 0.001)
    fit = emsid.fit(emsid.wiener_hammerstein((2, 1), static="spline", delay=0), record)
    (spline,) = (block for block in fit.model.blocks if isinstance(block, CubicSpline))
    assert spline.size > 100
    assert spline.findings(fit.model.signals(record.input[:, 0], fit.model.resting(0.0))[1]) == ()
    assert np.sqrt(fit.noise_variance) < 1.06 * noise
    assert ratio(fit.model, judge, noise) < 1.08


@pytest.mark.parametrize(("name", "noise"), [("hyperbolic tangent", 0.001), ("dead zone", 0.05)])
def test_no_knots_are_added_where_noise_hides_what_they_show(name: str, noise: float) -> None:
    record, _, _ = records(MAPS[name], 1, noise)
    fit = emsid.fit(emsid.wiener_hammerstein((2, 1), static="spline", delay=0), record)
    assert [block.size for block in fit.model.blocks if isinstance(block, CubicSpline)] == [40]


@pytest.mark.parametrize(
    "name", ["dead zone", *(pytest.param(x, marks=pytest.mark.long) for x in ("hyperbolic tangent", "saturation"))]
)
def test_without_options_the_error_is_the_noise_of_a_thousandth(name: str) -> None:
    record, judge, noise = records(MAPS[name], 1, 0.001)
    fit = emsid.fit(emsid.wiener_hammerstein(), record)
    assert ratio(fit.model, judge, noise) < 1.03
