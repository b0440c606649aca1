"""Friction that sticks, as a start of feedback models."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import emsid
from emsid import ModelError, Record
from emsid.estimation.fit import Ending
from emsid.models.blocks.static_maps import DeadZone
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.moves import sticking_map, with_speed_that_sticks, with_sticking_steps_doubled
from emsid.models.feedback.search.starts import in_observer_form

Array = NDArray[np.float64]
LINEAR = {
    1: FeedbackModel(in_observer_form(np.array([0.01, 0.05]), np.poly([0.95])), dt=0.01),
    2: FeedbackModel(in_observer_form(np.array([0.0, 0.05, 0.02]), np.poly([0.95, 0.4])), dt=0.01),
    3: FeedbackModel(in_observer_form(np.array([0.0, 0.0, 0.05, 0.02]), np.poly([0.9, 0.5 + 0.2j, 0.5 - 0.2j]).real)),
}


def held(seed: int, samples: int = 400, every: int = 20, size: float = 3.0) -> Array:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-size, size, samples // every), every)


def motor(seed: int, samples: int = 2000) -> tuple[Record, float]:
    """A motor that stands still two thirds of the time: dead zone of the drive, Coulomb friction, 1 % noise."""
    rng, u, dt, finer = np.random.default_rng(seed), held(seed, samples), 0.01, 50
    speed, y = 0.0, np.empty(samples)
    for t in range(samples):
        y[t] = speed
        drive = max(u[t] - 1.0, 0.0) + min(u[t] + 1.6, 0.0)
        for _ in range(finer):
            free = speed + dt / finer * (10.0 * drive - 2.0 * speed)
            speed = np.sign(free) * max(abs(free) - dt / finer * 10.0, 0.0)
    noise = 0.01 * float(np.std(y))
    return Record(u, y + noise * rng.normal(size=samples), dt), noise


def begun(linear: FeedbackModel, x: Array) -> tuple[FeedbackModel, Array]:
    """The start from a linear model in a state (n,), and its state."""
    found: Any = SimpleNamespace(model=linear, states=[x])
    model, (state,) = with_speed_that_sticks(found, [linear.output(held(1), x)])
    return model, state


@pytest.mark.parametrize("order", LINEAR)
def test_without_width_a_start_is_the_linear_model(order: int) -> None:
    linear, u, x = LINEAR[order], held(1), np.arange(1.0, order + 1)
    model, state = begun(linear, x)
    (zone,) = model.maps
    assert zone.b_r == -zone.b_l > 0
    np.testing.assert_array_equal(model.matrix[:order, 0], 0.0)
    exact = replace(model, maps=(DeadZone(0.0, 0.0),))
    np.testing.assert_allclose(exact.output(u, state), linear.output(u, x), atol=1e-12)
    stopped = model.output(np.zeros(400), 0.1 * zone.b_r * np.eye(order)[0])
    np.testing.assert_array_equal(stopped, 0.0)


def test_a_linear_model_that_only_oscillates_is_no_start() -> None:
    linear = FeedbackModel(in_observer_form(np.array([0.0, 0.1, 0.1]), np.poly([0.8 + 0.3j, 0.8 - 0.3j]).real))
    with pytest.raises(ModelError, match="only oscillates"):
        begun(linear, np.zeros(2))


@pytest.mark.parametrize("order", [1, 2])
def test_twice_the_steps_are_the_same_motion(order: int) -> None:
    """Without friction exactly; with it, the motion differs by what friction does within a step."""
    (model, x), u = begun(LINEAR[order], np.ones(order)), held(2)
    free = replace(model, maps=(DeadZone(0.0, 0.0),))
    twice = with_sticking_steps_doubled(free, 0, True)
    np.testing.assert_allclose(twice.output(u, x), free.output(u, x), atol=1e-9)
    assert twice.oversampling == 2
    sticks = replace(model, maps=(DeadZone(0.47, 0.53),), map_offsets=np.array([0.5]))
    y = sticks.output(u, x)
    np.testing.assert_allclose(y, replace(model, maps=(DeadZone(-0.03, 0.03),)).output(u, x), atol=1e-12)
    faster = with_sticking_steps_doubled(sticks, 0, True)
    assert np.std(faster.output(u, x) - y) < 0.02 * np.std(y)
    assert sticking_map(sticks) == sticking_map(faster) == 0


def test_a_dead_zone_elsewhere_is_no_friction_that_sticks() -> None:
    matrix = np.array([[0.9, 0.0, 0.1], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert sticking_map(FeedbackModel(matrix, (DeadZone(-0.1, 0.1),))) is None
    assert sticking_map(LINEAR[1]) is None


@pytest.mark.long
def test_a_motor_that_sticks_is_found_with_its_dead_zone() -> None:
    """Within noise on another record, with two dead zones and intervals; a saturation of the speed would creep."""
    record, noise = motor(1)
    fit = emsid.fit(emsid.feedback(), record)
    assert [type(each) for each in fit.model.maps] == [DeadZone, DeadZone]
    assert fit.ending is Ending.CONVERGED
    assert fit.has_intervals
    assert emsid.compare([fit], motor(2)[0]).best.row.simulation_rmse < 1.1 * noise
