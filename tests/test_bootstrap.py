"""Intervals by bootstrap over segments: equal to the robust ones where both hold, and refused where they cannot be."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid import ModelError, Record
from emsid.blocks import Rational
from emsid.estimation.nonlinear.control import Activity, Control, Stopped
from emsid.models.bootstrap import pieces_of
from emsid.validation import frequency_response_band


def record(samples: int = 1500, seed: int = 0, pole: float = 0.0) -> Record:
    """A second-order system with noise on the output, white or of first order."""
    rng = np.random.default_rng(seed)
    u = rng.choice([-1.0, 1.0], samples)
    noise = lfilter([1.0], [1.0, -pole], 0.3 * rng.standard_normal(samples))
    return Record(u, lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + noise, 0.01)


@pytest.fixture(scope="module")
def known() -> emsid.Fit:
    return emsid.fit(emsid.arx(2, 2), record(pole=0.7), free_run=True)


@pytest.fixture(scope="module")
def drawn(known: emsid.Fit) -> emsid.Fit:
    return emsid.bootstrap(known, record(pole=0.7), 80, rng=np.random.default_rng(3))


def test_the_intervals_are_those_of_the_robust_covariance(known: emsid.Fit, drawn: emsid.Fit) -> None:
    """Coloured noise in a linear system: both allow for it. 80 draws of 23 pieces are exact to about 20 %."""
    assert drawn.estimate is known.estimate
    ratio = drawn.standard_error / known.standard_error
    assert np.all((ratio > 0.6) & (ratio < 1.6)), ratio
    assert np.exp(np.mean(np.log(ratio))) == pytest.approx(1.0, abs=0.25)
    (finding,) = (each for each in drawn.findings if each.code == "intervals-by-bootstrap")
    assert finding.data == {"model": "arx", "count": 80, "pieces": 30, "samples": 50}
    assert all(each.code != "intervals-by-bootstrap" for each in known.findings)


def test_the_bands_are_those_of_the_drawn_fits(known: emsid.Fit, drawn: emsid.Fit) -> None:
    robust, by_draws = (frequency_response_band(fit, 0.01).magnitude for fit in (known, drawn))
    assert np.all(by_draws.value == robust.value)
    ratio = by_draws.standard_error / robust.standard_error
    assert np.median(ratio) == pytest.approx(1.0, abs=0.3)


def test_the_seed_decides(known: emsid.Fit) -> None:
    one, same, other = (
        emsid.bootstrap(known, record(600, pole=0.7), 10, rng=np.random.default_rng(seed)).covariance
        for seed in (1, 1, 2)
    )
    assert np.all(one == same)
    assert not np.allclose(one, other)


@pytest.mark.parametrize(
    "structure", [emsid.arx(2, 2), emsid.armax(2, 2, 2), emsid.state_space(2, horizon=6)], ids=lambda s: s.name
)
def test_other_linear_models_have_them_too(structure: object) -> None:
    data = record(500, 1)
    fit = emsid.fit(structure, data)
    again = emsid.bootstrap(fit, data, 10, rng=np.random.default_rng(0), pieces=10)
    ratio = again.standard_error / fit.standard_error
    assert 0.4 < np.median(ratio) < 2.0


def test_a_cascade_has_them_too() -> None:
    data = record(300, 2)
    y = lfilter([0.0, 0.4], [1.0, -0.6], np.maximum(data.input[:, 0] - 0.3, 0.0))
    noisy = replace(data, output=(y + 0.05 * np.random.default_rng(0).standard_normal(len(y)))[:, None])
    fit = emsid.fit(emsid.Cascade((Rational([0.4], [-0.6], 1),), name="linear", dt=0.01), noisy)
    again = emsid.bootstrap(fit, noisy, 10, rng=np.random.default_rng(0), pieces=10)
    assert 0.3 < np.median(again.standard_error / fit.standard_error) < 2.5


def test_segments_are_drawn_where_there_are_many(known: emsid.Fit) -> None:
    whole = record(1500)
    apart = [whole[k * 50 : k * 50 + 48 + k % 3] for k in range(30)]
    assert [len(piece) for piece in pieces_of(known, apart, None)] == [48 + k % 3 for k in range(30)]
    assert [len(piece) for piece in pieces_of(known, [whole], 15)] == [100] * 15


def test_what_cannot_be_drawn_is_refused(known: emsid.Fit) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ModelError, match="needs 10; record longer"):
        emsid.bootstrap(known, record(200), rng=rng)
    with pytest.raises(ModelError, match="at least 10"):
        emsid.bootstrap(known, record(), 3, rng=rng)
    recursive = emsid.fit(emsid.arx(2, 2), record(), forgetting=0.99)
    with pytest.raises(ModelError, match="cannot be repeated"):
        emsid.bootstrap(recursive, record(), rng=rng)
    ridge = emsid.fit(emsid.arx(2, 2), record(), ridge=10.0)
    with pytest.raises(ModelError, match="cannot be repeated"):
        emsid.bootstrap(ridge, record(), rng=rng)


def test_it_can_be_watched_and_stopped(known: emsid.Fit) -> None:
    seen: list[Activity] = []
    emsid.bootstrap(known, record(), 10, rng=np.random.default_rng(0), control=Control(report=seen.append))
    assert [(activity.done, activity.total) for activity in seen] == [(k, 10) for k in range(10)]
    end = threading.Event()
    end.set()
    with pytest.raises(Stopped):
        emsid.bootstrap(known, record(), 10, rng=np.random.default_rng(0), control=Control(cancelled=end.is_set))


def test_an_identification_has_them_if_asked() -> None:
    options = emsid.identification.Options(na=2, nb=2, nk=1)
    asked = {"models": "arx", "options": options}
    plain = emsid.identify(record(900), **asked)
    drawn = emsid.identify(record(900), bootstrap=10, seed=4, **asked)
    codes = {finding.code for finding in drawn.fits[0].findings}
    assert "intervals-by-bootstrap" in codes
    assert not np.allclose(drawn.fits[0].standard_error, plain.fits[0].standard_error, rtol=1e-3)
    assert all(finding.code != "no-bootstrap" for finding in (*drawn.findings, *plain.findings))
    short = emsid.identify(record(150), bootstrap=10, **asked)
    assert "no-bootstrap" in {finding.code for finding in short.findings}
