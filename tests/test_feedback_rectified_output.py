"""Feedback models before a sensor that loses the sign, and the parts of a short record that choose between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid import Record
from emsid.estimation.nonlinear.control import FREE
from emsid.models.blocks.search.map_families import family_of
from emsid.models.blocks.search.sign_recovery import may_be_rectified
from emsid.models.blocks.static_maps import Abs, CubicSpline, EvenSpline, HyperbolicTangent
from emsid.models.feedback.fitting import searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search.rectified_output import rectified_models
from emsid.models.feedback.search.trials import FeedbackSearch, SearchData
from emsid.models.one_channel import segments_longer_than
from feedback_models import Array, X
from model_examples import DT, MAPS

NOISE = 0.005


def slowly(speed: float) -> float:
    """Friction that levels off: at nine times the speed of the bend a tenth of it is still missing."""
    return 6.0 * speed / (0.8 + abs(speed))


def soon(speed: float) -> float:
    """Friction that levels off: at nine times the speed of the bend less than a hundredth of it is missing."""
    return 6.0 * speed / float(np.hypot(0.8, speed))


def rectified(
    samples: int = 200,
    seed: int = 3,
    bend: float = 0.0,
    lag: float = 0.0,
    friction: Callable[[float], float] = slowly,
) -> Record:
    """Two masses on a spring, a motor whose friction levels off, and a sensor that shows the size of the speed only.

    Args:
        samples: how many.
        seed: of input and noise.
        bend: how much more than in proportion the sensor shows, per unit of speed.
        lag: time constant of the sensor, in seconds; 0 for none.
        friction: of the motor, by its speed.
    """
    rng = np.random.default_rng(seed)
    u, x, y = np.repeat(rng.uniform(-1.2, 1.8, samples // 10), 10), np.zeros(4), np.empty(samples)
    for t in range(samples):
        y[t] = (x[3] if lag else shown(x[2], bend)) + NOISE * rng.standard_normal()
        for _ in range(10):
            change = [4.0 * u[t] - friction(x[0]), x[0] - x[2], 400.0 * x[1] - 6.0 * x[2], 0.0]
            change[3] = (shown(x[2], bend) - x[3]) / lag if lag else 0.0
            x = x + 0.002 * np.array(change)
    return Record(u, y, 0.02)


def shown(speed: float, bend: float) -> float:
    """What the sensor shows of a speed that lasts."""
    return abs(speed) * (1 + bend * abs(speed))


def test_a_sensor_that_loses_the_sign_is_a_start() -> None:
    record = rectified()
    assert may_be_rectified([record])
    assert not may_be_rectified([replace(record, input=record.input + 2.0)])
    assert not may_be_rectified([replace(record, output=record.output - 1.0)])
    found = rectified_models([record], 4, FREE)
    assert [[type(each) for each in model.model.maps] for model, _ in found] == [[Abs], [EvenSpline], [EvenSpline]]
    assert [model.model.sensor for model, _ in found] == [0, 0, 1]
    assert min(model.error for model, _ in found) < 0.5 * 0.074  # the best of models that start without signs
    fit = emsid.fit(emsid.feedback(order=3), record)
    assert fit.noise_variance < 0.006**2  # 0.0077² with a limit in place of the friction
    assert fit.model.sensor == 0
    assert emsid.compare([fit], rectified(300, seed=50)).best.row.simulation_rmse < 0.01


def test_a_sensor_that_loses_the_sign_is_no_spline() -> None:
    """A spline rounds the corner of |z|; the fit begins at the recovered signs, as either fits the start."""
    rng = np.random.default_rng(14)
    matrix = np.array([[1.6, 1.0, 0.1, 0.0], [-0.7, 0.0, 0.1, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    truth, u = FeedbackModel(matrix, (MAPS["abs"],)), np.repeat(rng.normal(size=40), 5)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    (found, knots), *_ = rectified_models([record], 2, FREE)
    assert knots == 0
    assert found.error < 0.0105


@pytest.mark.long
def test_a_sensor_may_be_curved_and_slow() -> None:
    """Little more than the noise is left, also elsewhere; with a free curve and a limit it was 4 and 12 times it."""
    fit = emsid.fit(emsid.feedback(order=4), rectified(300, 32, bend=0.8, lag=0.03))
    assert [type(each) for each in fit.model.maps] == [EvenSpline, CubicSpline]
    assert fit.noise_variance < (1.2 * NOISE) ** 2
    other = rectified(300, 150, bend=0.8, lag=0.03)
    assert emsid.compare([fit], other).best.row.simulation_rmse < 2.0 * NOISE


@pytest.mark.long
def test_friction_that_levels_off_soon_has_two_numbers() -> None:
    """With a spline in their place, the error on the other record is 1.26 times the noise."""
    fit = emsid.fit(emsid.feedback(order=3), rectified(300, 32, friction=soon))
    assert [type(each) for each in fit.model.maps] == [Abs, HyperbolicTangent]
    assert emsid.compare([fit], rectified(300, 150, friction=soon)).best.row.simulation_rmse < 1.1 * NOISE


@pytest.mark.long
def test_maps_of_a_given_family_that_loses_the_sign_are_all_of_it() -> None:
    search = emsid.feedback(order=3, static="even-spline", maps=2, delay=0, oversampling=1)
    fit = emsid.fit(search, rectified(300))
    assert [type(each) for each in fit.model.maps] == [EvenSpline, EvenSpline]


@pytest.mark.parametrize("maps", [1, pytest.param(3, marks=pytest.mark.long)])
def test_a_given_number_of_maps_counts_the_sensor(maps: int) -> None:
    fit = emsid.fit(emsid.feedback(order=3, maps=maps, oversampling=1), rectified())
    assert fit.model.maps[0].loses_sign
    assert len(fit.model.maps) == maps
    assert {type(each) for each in fit.model.maps[1:]} <= {CubicSpline, HyperbolicTangent}


# --- samples that are left out ---------------------------------------------------------------------------------------


def begun(record: Record) -> tuple[FeedbackModel, list[tuple[Array, Array]]]:
    """A feedback model of a rectified record, and its segments."""
    model = rectified_models([record], 3, FREE)[1][0].model
    return model, segments_longer_than(model.memory, model, [record])


def test_samples_that_are_left_out_have_no_influence() -> None:
    model, [(u, y)] = begun(rectified())
    out = np.zeros(len(y), dtype=bool)
    out[90:110] = True
    wrong = np.where(out, 100.0, y)
    first, second, of_all = (
        searched(model, [(u, each)], 5, 10, 0.1, left_out=None if mask is None else [mask])
        for each, mask in ((y, out), (wrong, out), (y, None))
    )
    np.testing.assert_array_equal(first.model.parameters, second.model.parameters)
    assert first.minimum.samples == of_all.minimum.samples - 20 == len(y) - 25
    assert not np.allclose(first.model.parameters, of_all.model.parameters, rtol=1e-6)


def test_the_run_goes_on_through_samples_that_are_left_out() -> None:
    """A model that is right has the same error there as elsewhere, without a start of its own."""
    rng, u = np.random.default_rng(3), np.repeat(np.random.default_rng(2).normal(size=60), 5)
    matrix = np.array([[1.6, 1.0, 0.1, 0.0], [-0.7, 0.0, 0.1, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    truth = FeedbackModel(matrix, (MAPS["abs"],))
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    data = SearchData.of([record], FeedbackSearch(order=2), FREE)
    trial = data.refined(truth, None, family_of("abs"), 0)
    errors = data.left_out(trial)
    assert errors.mean == pytest.approx(0.01**2, rel=0.35)
    assert np.all(errors.means < 3 * 0.01**2)
