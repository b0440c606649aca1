"""Feedback models, and records and trials of them, that several test files share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid import Record
from emsid.models.blocks.search.map_families import family_of
from emsid.models.blocks.static_maps import DeadZone
from emsid.models.feedback.fitting import searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.trials import Trial
from emsid.models.one_channel import segments_longer_than
from emsid.selection.improvement import StretchErrors
from model_examples import DT, LOOP, MAPS, TWO_LOOPS

Array = NDArray[np.float64]
U = np.random.default_rng(0).normal(size=400)
X = np.array([0.3, -0.2])


def loop(name: str = "polynomial", rate: int = 1) -> FeedbackModel:
    """A loop of second order through one map of this kind."""
    offset = 0.0 if MAPS[name].absorbs_shift else 0.05
    return FeedbackModel(LOOP, (MAPS[name],), np.array([offset]), 0.2, oversampling=rate, dt=DT)


def multiplied(name: str = "polynomial", rate: int = 1) -> FeedbackModel:
    """A loop with two maps, of which the first is multiplied by a signal."""
    factors = np.array([[0.3, -0.2, 0.1, 0.4], [0.0, 0.0, 0.0, 1.0]])
    maps = MAPS[name], DeadZone(-0.2, 0.3)
    return FeedbackModel(TWO_LOOPS, maps, np.zeros(2), 0.2, oversampling=rate, dt=DT, factors=factors)


def before_sensor(name: str = "even-spline", behind: int = 1) -> FeedbackModel:
    """A loop of second order through a dead zone, before a sensor with a map of this kind and a lag."""
    n = 2 + behind
    matrix = np.zeros((n + 3, n + 3))
    matrix[:2, :2], matrix[:2, n], matrix[:2, n + 2] = LOOP[:2, :2], LOOP[:2, 2], [-0.2, 0.1]
    matrix[n, [0, 1, n]], matrix[n + 1, :2], matrix[-1, n + 1] = [1.0, 0.2, 0.3], [0.4, 1.0], 1.0
    if behind:
        matrix[2, [2, n + 1]], matrix[-1, [2, n + 1]] = [0.4, 0.6], [1.0, 0.1]
    offsets = np.array([0.0 if MAPS[name].absorbs_shift else 0.1, 0.0])
    return FeedbackModel(matrix, (MAPS[name], DeadZone(-0.2, 0.3)), offsets, 0.2, dt=DT, sensor=behind)


def sticking(seed: int, samples: int = 240) -> Record:
    """A motor that sticks, with 2 % noise."""
    truth, rng = FeedbackModel(np.array([[0, 0, 1], [0.9, 0.5, 0], [1, 0, 0]]), (DeadZone(-0.2, 0.2),)), np.random
    u = np.repeat(rng.default_rng(seed).normal(size=samples // 4), 4)
    noise = 0.01 * rng.default_rng(seed + 100).normal(size=samples)
    return Record(u, truth.output(u, np.zeros(1)) + noise, DT)


def begun_trial(samples: int) -> tuple[Record, Trial]:
    """A record of the loop with 1 % noise, and a trial of it that has not taken a step."""
    model = loop()
    u = np.random.default_rng(5).normal(size=samples)
    y = model.output(u, X)
    record = Record(u, y + 0.01 * np.std(y) * np.random.default_rng(6).normal(size=samples), DT)
    segments = segments_longer_than(model.memory, model, [record])
    start = model.with_parameters(1.02 * model.parameters)
    found = searched(start, segments, model.edge, 0)
    return record, Trial(found, StretchErrors.of(np.ones(16)), family_of("polynomial"), 3)
