"""Feedback models before a sensor: what the structure excludes, its coordinates, its form, and its file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from emsid import FeedbackModel, Record
from emsid.blocks import CubicSpline, Saturation
from emsid.errors import ModelError
from emsid.models.feedback.coordinates import coordinates, coordinates_in_form, directions, whitened
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.normal_form import normal_form, power_of, squared_gains
from emsid.models.feedback.search.starts import with_map, with_steps_doubled
from feedback_models import Array, U, before_sensor
from model_examples import DT
from test_feedback import visited

CURVES = ["even-spline", "abs", "polynomial", "spline", "saturation"]


def at(model: FeedbackModel) -> Array:
    """A state away from rest."""
    return np.linspace(0.3, -0.2, model.states)


def test_the_loop_does_not_depend_on_the_sensor() -> None:
    model = before_sensor()
    other = replace(model, maps=(Saturation(2.0, -0.1, 0.1), model.maps[1]))
    one, two = (each.trajectory(U, at(each)) for each in (model, other))
    np.testing.assert_array_equal(one.z, two.z)
    assert np.abs(one.y - two.y).max() > 0.1


def test_what_a_sensor_excludes_is_made_zero() -> None:
    rng = np.random.default_rng(0)
    matrix = 0.1 * rng.normal(size=(6, 6))
    matrix[3:5, 4:] = 0.0
    model = FeedbackModel(matrix, before_sensor().maps, sensor=1)
    kept = model.matrix != 0
    expected = np.zeros((6, 6), dtype=bool)
    expected[[0, 1, 3, 4], :2] = expected[[0, 1, 3, 4], 3] = expected[:2, 5] = True  # x₁, x₂, z₁, z₂ by x, u, w₂
    expected[2, [2, 4]] = expected[5, [2, 4]] = True  # x₃ and y by x₃ and w₁
    np.testing.assert_array_equal(kept, expected)
    np.testing.assert_array_equal(model.matrix[kept], matrix[kept])


def test_a_sensor_that_a_model_cannot_have_is_refused() -> None:
    with pytest.raises(ModelError, match="a sensor without a map"):
        FeedbackModel(np.eye(2), sensor=0)
    with pytest.raises(ModelError, match="the number of states behind the sensor"):
        replace(before_sensor(), sensor=4)
    for given in ({"shared": (("z2", "z1"),)}, {"factors": np.ones((2, 5))}):
        with pytest.raises(ModelError, match="multiplied or signals that are shared"):
            replace(before_sensor(), **given)


@pytest.mark.parametrize("behind", [0, 1])
@pytest.mark.parametrize("name", ["abs", "polynomial", "saturation"])
def test_redundant_directions_leave_the_output_as_it_is(name: str, behind: int) -> None:
    model = before_sensor(name, behind)
    rows = model.gradient(U, model.trajectory(U, at(model)))
    own, states = np.split(rows, [len(model.parameters)], axis=1)
    seen = visited(model, U, at(model))
    change = own @ directions(model, seen)
    change -= states @ np.linalg.lstsq(states, change, rcond=None)[0]
    assert np.abs(change).max() < 1e-9 * np.abs(own).max()
    free = own @ coordinates(model, seen)
    sizes = np.linalg.svd(np.column_stack([free, states]), compute_uv=False)
    assert sizes[-1] > 1e-6 * sizes[0]


@pytest.mark.parametrize("behind", [0, 1])
def test_the_structure_has_few_parameters(behind: int) -> None:
    """Those that count in a plant, each once, but for the choice of the state and of units."""
    model = before_sensor("abs", behind)
    count = coordinates(model, visited(model, U, at(model))).shape[1]
    loop = 4 + 2 + 2 + 2 * 3 - 4  # A, B of u and w₂, C and D of z₁ and z₂, less the state
    dead_zone = 4 - 2  # less the units of z₂ and w₂
    sensor = 1 + 2 * behind - 1  # gain, and then a pole and a direct path; less the unit of z₁
    assert count == loop + dead_zone + sensor + 2  # offsets of z₁ and y
    whole = replace(model, sensor=None)
    assert coordinates(whole, visited(whole, U, at(whole))).shape[1] > count + 5


@pytest.mark.parametrize("behind", [0, 1])
@pytest.mark.parametrize("name", CURVES)
def test_other_forms_of_a_model_have_the_same_output(name: str, behind: int) -> None:
    model = before_sensor(name, behind)
    x = at(model)
    seen, expected = visited(model, U, x), model.output(U, x)
    normal = normal_form(model, seen)
    for same in (whitened(model, seen), normal):
        np.testing.assert_allclose(same.model.output(U, same.state(x)), expected, rtol=1e-9, atol=1e-10)
    again = visited(normal.model, U, normal.state(x))
    spread = coordinates_in_form(normal.model, again, normal.fixed, normal.conditions)
    assert spread.shape[1] == coordinates(model, seen).shape[1]
    np.testing.assert_allclose(normal.conditions @ spread, 0.0, atol=1e-6 * np.abs(normal.conditions).max())


@pytest.mark.parametrize("name", ["even-spline", "abs", "spline"])
def test_the_input_of_the_sensor_is_in_the_unit_of_the_output(name: str) -> None:
    model = before_sensor(name)
    form = normal_form(model, visited(model, U, at(model)))
    same, n = form.model, model.states
    seen = visited(same, U, form.state(at(model)))
    np.testing.assert_array_equal(same.matrix[n, :n], [1.0, 0.0, 0.0])  # z₁ shows x₁
    np.testing.assert_array_equal(same.matrix[-1, :n], [0.0, 0.0, 1.0])  # y shows x₃
    column = np.append(same.matrix[:n, n + 1], same.matrix[-1, n + 1])
    assert column @ squared_gains(same, seen, 0, power_of(seen.w[:, 0])) @ column == pytest.approx(1.0)
    reached = np.abs(seen.z[:, 0]) if same.maps[0].loses_sign else seen.z[:, 0]
    ends = np.quantile(reached, [0.25, 0.75])
    assert np.diff(same.maps[0].value(ends))[0] == pytest.approx(np.diff(ends)[0])


def test_more_steps_and_maps_keep_the_structure() -> None:
    model = before_sensor()
    finer = with_steps_doubled(model, True)
    np.testing.assert_allclose(finer.output(U, at(model))[:2], model.output(U, at(model))[:2], atol=0.05)
    knots = np.linspace(-1.0, 1.0, 5)
    more = with_map(model, CubicSpline(knots, 0.1 * knots**3), np.ones(4), np.ones(4))
    for each in (finer, more):
        assert each.sensor == 1
        assert not each.matrix[each.absent].any()


def test_a_file_keeps_the_sensor() -> None:
    model = before_sensor()
    again = FeedbackModel.from_data(model.to_data())
    assert again.sensor == 1
    np.testing.assert_array_equal(again.output(U, at(model)), model.output(U, at(model)))
    assert "sensor" not in replace(model, sensor=None).to_data()


def test_its_equations_show_loop_and_sensor_apart() -> None:
    lines = dict(line.split(" = ") for line in before_sensor().equation().splitlines())
    assert "w1" not in lines["x1(t+1)"] + lines["x2(t+1)"] + lines["z2(t)"]
    assert "x1" not in lines["y(t)"] + lines["x3(t+1)"]


def test_the_true_model_is_found_from_another_one() -> None:
    """Without noise, from parameters 2 % away."""
    truth, rng = before_sensor("polynomial"), np.random.default_rng(1)
    u = rng.normal(size=600)
    record = Record(u, truth.output(u, truth.resting(float(u[0]))), DT)
    start = truth.with_parameters(truth.parameters * rng.uniform(0.98, 1.02, len(truth.parameters)))
    fit = fit_feedback(start, record, tolerance=1e-6)
    assert fit.model.sensor == 1
    assert fit.noise_variance < 1e-12 * record.output.var()
