"""Bands of the static maps of feedback models: how often they contain the true map, and how they shrink."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from emsid import Ending, FeedbackModel, Record
from emsid.blocks import CoulombLinear, Polynomial
from emsid.models.feedback.coordinates import Visited
from emsid.models.feedback.curves import map_band, map_shape, visited, visited_in_free_run
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.normal_form import normal_form
from emsid.validation import free_run_band
from feedback_models import Array

DT = 0.01
# x₂ is nearly the output one step earlier, so a lag of z can hardly be told from one of w.
SPRING = FeedbackModel(
    np.array([[1.83, 1.0, 0.13, 1.0], [-0.96, 0.0, 0.0, 0.3], [1.0, 0.2, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]),
    (Polynomial(np.array([0.0, 0.0, 0.0, -0.35])),),
    dt=DT,
)
MOTOR = FeedbackModel(
    np.array([[0.95, 0.5, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (CoulombLinear(-0.16, -0.04, width=0.3),), dt=DT
)


def smooth(rng: np.random.Generator, samples: int) -> Array:
    return np.convolve(0.02 * rng.normal(size=samples), np.ones(3), "same")


def held(rng: np.random.Generator, samples: int) -> Array:
    return np.repeat(rng.normal(size=samples // 4), 4)


def fitted(truth: FeedbackModel, signal: Callable[[np.random.Generator, int], Array], seed: int, samples: int):
    rng = np.random.default_rng(seed)
    u = signal(rng, samples)
    y = truth.output(u, truth.resting(float(u[0])))
    record = Record(u, y + 0.01 * np.std(y) * rng.normal(size=samples), DT)
    return fit_feedback(truth, record), record


@pytest.mark.parametrize(
    ("truth", "signal"),
    [pytest.param(SPRING, smooth, id="spring", marks=pytest.mark.long), pytest.param(MOTOR, held, id="motor")],
)
def test_a_band_contains_the_true_map_as_often_as_it_says(truth, signal) -> None:
    """Of 20 records at least 16 at every point; four times the samples halve the band."""
    inside, width = [], {1000: [], 4000: []}
    for seed in range(20):
        for samples in (1000, 4000)[: 2 if seed < 5 else 1]:
            fit, record = fitted(truth, signal, 100 + seed, samples)
            z = visited(fit.model, record).z[:, 0]
            x = np.linspace(z.min(), z.max(), 15)
            band, shape = map_band(fit, record, 0, x), map_shape(fit.model, record, 0, x)
            width[samples].append(band.standard_error[-1] / np.ptp(band.value))
            if samples == 1000:
                alike = normal_form(truth, visited(truth, record)).model  # in the coordinates of the fit
                inside.append(np.abs(shape(fit.model) - shape(alike)) <= band.half)
    assert np.sum(inside, axis=0).min() >= 16
    assert np.median(width[1000]) < 0.01
    assert 1.5 < np.median(width[1000]) / np.median(width[4000]) < 2.7


def test_a_band_of_a_slow_model_belongs_to_the_signals_of_its_free_run() -> None:
    """From rest, which is far from all data, several of these bands were wider than the map is high."""
    slow = FeedbackModel(
        np.array([[0.9995, 0.02, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (CoulombLinear(-0.008, 0.0, 0.3),), dt=DT
    )
    inside, width, begin = [], [], np.array([-1.0])
    for seed in range(10):
        rng = np.random.default_rng(seed)
        u = held(rng, 400) + 1.0
        y = slow.output(u, begin)
        record = Record(u, y + 0.01 * np.std(y) * rng.normal(size=len(u)), DT)
        fit = fit_feedback(slow, record)
        z = visited_in_free_run(fit.model, record).z[:, 0]
        x = np.linspace(z.min(), z.max(), 7)
        band = map_band(fit, record, 0, x)
        if band.known:
            shape = map_shape(fit.model, record, 0, x)
            alike = normal_form(slow, Visited.of(slow, [u], [begin])).model
            inside.append(np.abs(shape(fit.model) - shape(alike)) <= band.half)
            width.append(np.max(band.half) / np.ptp(band.value))
    assert len(inside) >= 8
    assert np.sum(inside, axis=0).min() >= 0.75 * len(inside)
    assert np.max(width) < 0.3


def test_a_search_that_ended_before_a_minimum_has_no_bands() -> None:
    fit, record = fitted(MOTOR, held, 3, 400)
    x = np.linspace(-1.0, 1.0, 5)
    assert fit.has_bands
    assert map_band(fit, record, 0, x).known
    assert free_run_band(fit, record).known
    for ending in (Ending.OUT_OF_BUDGET, Ending.STALLED, Ending.INTERRUPTED):
        early = replace(fit, ending=ending)
        assert early.has_intervals
        assert not early.has_bands
        assert not map_band(early, record, 0, x).known
        assert not free_run_band(early, record).known
