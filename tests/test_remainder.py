"""What the inputs still explain of the error of a free run, and which models are fitted by need."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid.findings import Finding
from emsid.identification.candidates import usual_for
from emsid.identification.fitting import explained_share, leaves_nothing
from emsid.models.model import Run

DT, LAST = 0.01, ("state-space", "wiener-hammerstein", "feedback")


def lagging(seed: int = 0, samples: int = 1200, bend: float = 0.0, noise: float = 0.02) -> emsid.Record:
    """A lag of first order with white noise behind it; its gain falls with the output."""
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-1, 1, samples // 20), 20), np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.92 * y[t - 1] + 0.16 * u[t - 1] - bend * y[t - 1] ** 3
    return emsid.Record(u, y + noise * rng.standard_normal(samples), DT, ("u",), ("y",), ("V",), ("V",))


def left(record: emsid.Record, error: Any) -> float:
    """The share of an error of a run over a record without noise."""
    measured = replace(record, output=record.output + np.asarray(error)[:, None])
    share = explained_share(measured, Run(record.output, np.ones(len(record), dtype=bool)))
    assert share is not None
    return share


def test_white_noise_is_not_explained_and_costs_less_than_a_column_in_ten_samples() -> None:
    shares = [
        left(lagging(seed, noise=0.0), np.random.default_rng(100 + seed).standard_normal(1200)) for seed in range(8)
    ]
    assert min(shares) > -0.1
    assert max(shares) < 0.02


@pytest.mark.parametrize(
    "shape",
    [
        lambda u, y: u,
        lambda u, y: np.roll(u, 3),
        lambda u, y: np.sign(y),
        lambda u, y: u * y,
        lambda u, y: np.abs(u),
        lambda u, y: lfilter([0.05], [1.0, -0.95], u),
        lambda u, y: lfilter([1.0, -0.9], [1.0, -1.6, 0.8], u**2),
    ],
    ids=["input", "late", "sign", "product", "magnitude", "slow", "swinging square"],
)
def test_what_depends_on_the_input_is_explained(shape: Any) -> None:
    """A tenth of the squared error."""
    record = lagging(samples=4000, noise=0.0)
    part = shape(record.input[:, 0], record.output[:, 0])
    noise = np.random.default_rng(1).standard_normal(len(record))
    assert left(record, 3.0 * noise + (part - part.mean()) / np.std(part)) > 0.03


def test_records_of_different_size_have_one_function() -> None:
    small, large = (lagging(seed, samples=2000, noise=0.0) for seed in (1, 2))
    small = replace(small, input=0.3 * small.input, output=0.3 * small.output)
    both = emsid.concatenate([small, large])
    assert left(both, both.input[:, 0] ** 2) > 0.9


def test_a_short_record_and_a_run_that_diverges_show_nothing() -> None:
    record = lagging(samples=300)
    counted = np.ones(len(record), dtype=bool)
    assert explained_share(record, Run(0.9 * record.output, counted)) is None
    assert explained_share(lagging(), Run(lagging().output, np.ones(1200, dtype=bool), diverged_at=7)) is None


def test_models_with_blocks_are_fitted_only_where_something_is_left() -> None:
    linear = emsid.identify(lagging())
    (found,) = (finding for finding in linear.findings if finding.code == "models-not-needed")
    assert tuple(found.data["models"]) == LAST
    assert not {fit.model.name for fit in linear.fits} & set(LAST)
    assert not linear.interrupted


def test_a_fit_that_says_what_it_lacks_is_not_enough() -> None:
    record = lagging()
    fit = emsid.fit(emsid.arx(1, 1), record, free_run=True)
    assert leaves_nothing([fit], record) is fit
    lacking = replace(fit, findings=(Finding("effect-missing", "motor", {}),))
    assert leaves_nothing([lacking], record) is None
    assert leaves_nothing([], record) is None
    bent = lagging(bend=0.05)
    assert leaves_nothing([emsid.fit(emsid.arx(1, 1), bent, free_run=True)], bent) is None


def test_models_that_are_named_are_fitted() -> None:
    record = lagging(samples=500)
    assert set(LAST) <= set(usual_for(record))
    result = emsid.identify(record, models=["arx", "wiener-hammerstein"], orders=(1, 1), static="saturation")
    assert len(result.fits) == 2
    assert "models-not-needed" not in {finding.code for finding in result.findings}
