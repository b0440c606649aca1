"""Feedback models: their runs and derivatives, the models that are cases of them, and their coordinates."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import emsid
from emsid import ModelError, Record
from emsid.identification.evidence import about_the_maps
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.static_maps import CubicSpline, DeadZone, Polynomial, Saturation
from emsid.models.feedback.coordinates import (
    Visited,
    check_size,
    coordinates,
    coordinates_in_form,
    directions,
    in_coordinates,
    whitened,
)
from emsid.models.feedback.curves import feedback_at_rest, rounded_equation, visited_in_free_run
from emsid.models.feedback.curves import visited as visited_in
from emsid.models.feedback.fitting import fit_feedback
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.normal_form import normal_form
from emsid.models.feedback.search.rectified_output import as_feedback
from emsid.models.kinds import capabilities_of
from feedback_models import Array, U, X, loop, multiplied
from model_examples import DT, LOOP, MAPS, TWO_LOOPS


@pytest.mark.parametrize("name", [name for name in MAPS if name != "user"])
def test_the_compiled_run_equals_the_plain_one(name: str) -> None:
    for make in (loop, multiplied):
        model, plain = make(name), make(name)
        vars(plain)["_tables"] = None
        for one, other in zip(model.stepped(U, X)[0], plain.stepped(U, X)[0], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("model", [loop(), loop("spline", 2), loop("dead-zone"), FeedbackModel(
    TWO_LOOPS, (MAPS["saturation"], MAPS["coulomb-linear"]), dt=DT
), multiplied("spline", 2)], ids=["polynomial", "spline, oversampled", "dead zone", "two maps", "product"])  # fmt: skip
def test_the_derivative_is_that_of_differences(model: FeedbackModel) -> None:
    u, step = U[:120], 1e-6
    theta, count = model.parameters, len(model.parameters)
    found = model.gradient(u, model.trajectory(u, X))
    expected = np.empty_like(found)
    for k in range(count):
        move = step * np.eye(1, count, k)[0]
        ahead, behind = model.with_parameters(theta + move), model.with_parameters(theta - move)
        expected[:, k] = (ahead.output(u, X) - behind.output(u, X)) / (2 * step)
    for k in range(2):
        move = step * np.eye(1, 2, k)[0]
        expected[:, count + k] = (model.output(u, X + move) - model.output(u, X - move)) / (2 * step)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def sticking() -> FeedbackModel:
    """Friction as a steep saturation of the speed: at small inputs the speed changes its sign with every step."""
    return FeedbackModel([[0.9, 0.1, -0.3], [20, 0, 0], [1, 0, 0]], (Saturation(),), dt=DT)


@pytest.mark.parametrize("level", [-5.0, -1.0, 0.0, 0.5, 2.5, 5.0])
def test_it_rests_where_a_run_ends(level: float) -> None:
    """Newton steps from one side of the saturation lead to the other, and from there back."""
    model = sticking()
    (x,) = model.resting(level)
    if abs(level) > 3:
        assert x == pytest.approx(level - 3 * np.sign(level))
    else:
        assert abs(x) <= 0.4
    moved = feedback_at_rest(model, np.array([level]))(model)
    assert moved == pytest.approx(level - np.clip(level, -3, 3), abs=0.1)


def saturated_loop(begin: float = 0.0) -> FeedbackModel:
    """A PI controller with a limit, whose integrator begins at this value, and a lag: states y and the integral."""
    kp, ki, lag = 8.0, 0.05, 0.03
    matrix = [[1 - lag, 0, 0, lag], [-ki, 1, ki, 0], [-kp, 1, kp, 0], [1, 0, 0, 0]]
    return FeedbackModel(np.array(matrix), (Saturation(1.0, -3.0, 3.0),), np.array([begin]), dt=DT)


def test_a_rest_is_looked_for_from_the_centre() -> None:
    """In coordinates in which the zero state is far from the data, the controller takes longer than the run to it."""
    u = np.repeat(np.random.default_rng(2).uniform(-2, 2, 200), 15)
    model = saturated_loop(begin=400.0)
    assert abs(model.resting(1.0)[0] - 1.0) > 1
    inside = replace(model, centre=np.array([0.0, -400.0]))
    np.testing.assert_allclose(inside.resting(1.0), [1.0, -399.0])
    y = inside.output(u, inside.resting(0.0))
    record = Record(u, y + 0.01 * np.std(y) * np.random.default_rng(3).normal(size=len(u)), DT)
    fitted = fit_feedback(inside, record).model
    seen = fitted.trajectory(u, fitted.resting(0.0)).x
    np.testing.assert_allclose(fitted.centre, seen.mean(axis=0), atol=0.01 * seen.std())
    assert fitted.output(u, fitted.resting(0.0)) == pytest.approx(y, abs=0.01 * np.std(y))
    again = FeedbackModel.from_data(fitted.to_data())
    np.testing.assert_array_equal(again.centre, fitted.centre)


# --- cases -----------------------------------------------------------------------------------------------------------


def wiener_hammerstein() -> tuple[Cascade, FeedbackModel]:
    bend = MAPS["polynomial"]
    cascade = Cascade((Rational([0.3, 0.1], [-0.7]), bend, Rational([0.2, 0.5], [-0.4])), 0.0, 0.3, dt=DT)
    matrix = [[0.7, 0, 1, 0], [0, 0.4, 0, 1], [0.3 * 0.7 + 0.1, 0, 0.3, 0], [0, 0.2 * 0.4 + 0.5, 0, 0.2]]
    return cascade, FeedbackModel(np.array(matrix), (bend,), np.zeros(1), 0.3, dt=DT)


def hammerstein() -> tuple[Cascade, FeedbackModel]:
    bend = MAPS["saturation"]
    cascade = Cascade((bend, Rational([0.0, 0.5], [-0.4])), dt=DT)
    return cascade, FeedbackModel(np.array([[0.4, 0, 0.5], [0, 1, 0], [1, 0, 0]]), (bend,), dt=DT)


def wiener() -> tuple[Cascade, FeedbackModel]:
    bend = MAPS["spline"]
    cascade = Cascade((Rational([0.0, 0.5], [-0.4]), bend), dt=DT)
    return cascade, FeedbackModel(np.array([[0.4, 0.5, 0], [1, 0, 0], [0, 0, 1]]), (bend,), dt=DT)


@pytest.mark.parametrize("case", [wiener_hammerstein, hammerstein, wiener])
def test_a_cascade_is_a_case_of_it(case) -> None:
    cascade, model = case()
    zero = Record(U, np.empty((len(U), 0)), DT)
    first = cascade.run(cascade.at_rest(0.0)._replace(blocks=np.zeros(cascade.states)), U[:, None])[0]
    second = model.output(U, np.zeros(model.states))
    np.testing.assert_allclose(second, first[:, 0], rtol=1e-12, atol=1e-12)
    assert model.simulate(zero).counted.all()


def test_a_cascade_of_two_filters_becomes_a_feedback_model() -> None:
    """Also with an offset of its input."""
    cascade = replace(wiener_hammerstein()[0], input_offset=0.4)
    model, moved = as_feedback(cascade)
    run = cascade.output(U, np.array([0.3, -0.2]))
    np.testing.assert_allclose(model.output(U, np.array([0.3, -0.2]) + moved), run, rtol=1e-9, atol=1e-9)


def test_a_motor_with_friction_is_a_case_of_it() -> None:
    """Coulomb friction over an implicit step: the speed is a dead zone of what it would be without friction."""
    a, b, c = 0.95, 0.5, 0.2
    model = FeedbackModel(np.array([[0, 0, 1], [a, b, 0], [1, 0, 0]]), (DeadZone(-c, c),), dt=DT)
    u, speed, expected = np.round(U, 1), 0.0, []
    for level in u:
        expected.append(speed)
        free = a * speed + b * level
        held = abs(free) <= c
        speed = 0.0 if held else free - c * np.sign(free)
    assert expected.count(0.0) > 10  # the motor sticks
    np.testing.assert_allclose(model.output(u, np.zeros(1)), expected, rtol=1e-12, atol=1e-12)


def test_signals_of_a_slow_model_are_those_of_its_free_run() -> None:
    """Its rest at the first input is more than ten times as far away as the states of the record."""
    matrix = np.array([[0.9999, 0.02, -0.02], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    model = FeedbackModel(matrix, (Polynomial(np.array([0.0, 0.01, 0.0, 0.0001])),), np.array([0.01]), dt=DT)
    u = np.random.default_rng(3).normal(size=400)
    run = model.trajectory(u, np.array([0.5]))
    record = Record(u, run.y, DT)
    assert np.abs(model.resting(u[0])).max() > 10 * np.abs(run.z).max()
    np.testing.assert_allclose(visited_in_free_run(model, record).z, run.z, atol=1e-3)
    used = capabilities_of(model).maps_in_use(model, record)
    np.testing.assert_array_equal(np.column_stack([each.input for each in used]), visited_in_free_run(model, record).z)
    assert about_the_maps(model, record[:300], record[300:], False) == []


# --- coordinates -----------------------------------------------------------------------------------------------------


def visited(model: FeedbackModel, u: Array = U, x: Array = X) -> Visited:
    return Visited.of(model, [u], [x])


@pytest.mark.parametrize("make", [loop, multiplied])
@pytest.mark.parametrize("name", ["polynomial", "dead-zone", "saturation", "abs"])
def test_redundant_directions_leave_the_output_as_it_is(name: str, make: Callable[[str], FeedbackModel]) -> None:
    model = make(name)
    rows = model.gradient(U, model.trajectory(U, X))
    own, states = np.split(rows, [len(model.parameters)], axis=1)
    change = own @ directions(model, visited(model))
    change -= states @ np.linalg.lstsq(states, change, rcond=None)[0]
    assert change.shape[1] >= 4
    assert np.abs(change).max() < 1e-9 * np.abs(own).max()
    free = own @ coordinates(model, visited(model))
    sizes = np.linalg.svd(np.column_stack([free, states]), compute_uv=False)
    assert sizes[-1] > 1e-5 * sizes[0]


@pytest.mark.parametrize("make", [loop, multiplied])
@pytest.mark.parametrize(
    "name", ["polynomial", "dead-zone", "spline", "monotone-spline", "tanh", "coulomb-linear", "abs"]
)
def test_other_forms_of_a_model_have_the_same_output(name: str, make: Callable[[str], FeedbackModel]) -> None:
    model = replace(make(name), centre=X)
    expected = model.output(U, X)
    normal = normal_form(model, visited(model))
    for same in (whitened(model, visited(model)), normal):
        np.testing.assert_allclose(same.model.output(U, same.state(X)), expected, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(same.model.centre, same.state(model.centre), rtol=1e-9, atol=1e-10)
    seen = visited(normal.model, U, normal.state(X))
    spread = coordinates_in_form(normal.model, seen, normal.fixed, normal.conditions)
    assert not spread[normal.fixed].any()
    np.testing.assert_allclose(normal.conditions @ spread, 0.0, atol=1e-6 * np.abs(normal.conditions).max())
    assert spread.shape[1] == coordinates(model, visited(model)).shape[1]


@pytest.mark.parametrize("name", ["polynomial", "dead-zone", "spline"])
def test_a_change_is_expressed_in_coordinates_whatever_its_units(name: str) -> None:
    """A change with another state and other units of the signals of the maps, which the coordinates do not have."""
    model = multiplied(name)
    seen = visited(model)
    spread, redundant, rng = coordinates(model, seen), directions(model, seen), np.random.default_rng(6)
    phi = rng.normal(size=spread.shape[1])
    change = spread @ phi + redundant @ rng.normal(size=redundant.shape[1])
    np.testing.assert_allclose(in_coordinates(model, seen, spread, change), phi, rtol=1e-6, atol=1e-6)


def test_a_line_is_taken_from_a_map_at_seldom_reached_knots_too() -> None:
    """One input in four thousand reaches the last knot; a line that ends before it would change the model."""
    u = 0.3 * np.random.default_rng(4).normal(size=4000)
    u[2001] = 6.0
    knots = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 6.0, 9.0])
    matrix = np.array([[0.8, 0.5, -0.3], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    model = FeedbackModel(matrix, (CubicSpline(knots, knots + 0.2 * np.sin(knots)),))
    same = normal_form(model, visited(model, u, np.zeros(1)))
    for amplitude in (1.0, 1.5):
        expected = model.output(amplitude * u, np.zeros(1))
        np.testing.assert_allclose(same.model.output(amplitude * u, same.state(np.zeros(1))), expected, atol=1e-9)


def test_a_map_without_effect_on_the_data_gets_no_huge_unit() -> None:
    """A dead zone beyond the data has no derivative: a step in huge units would turn rounding into parameters."""
    matrix = np.array([[0.8, 0.5, -0.3], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    model = FeedbackModel(matrix, (DeadZone(-1e3, 1e3),))
    assert np.abs(coordinates(model, visited(model, U, np.zeros(1)))).max() < 1e4


# --- refusals and figures --------------------------------------------------------------------------------------------


def test_signals_without_a_size_are_refused() -> None:
    """What a map gives may be so large that its square is no number, although the output is small."""
    model = loop()
    seen = visited(model)
    with pytest.raises(ModelError, match="diverges"):
        check_size(model, replace(seen, w=1e200 * np.random.default_rng(0).standard_normal(seen.w.shape)))


def test_what_is_no_feedback_model_is_refused() -> None:
    with pytest.raises(ModelError, match="w must not reach z"):
        FeedbackModel(np.ones((4, 4)), (Saturation(),))
    with pytest.raises(ModelError, match="a matrix of shape"):
        FeedbackModel(np.ones((3, 4)), (Saturation(),))
    with pytest.raises(ModelError, match="no static map"):
        FeedbackModel(LOOP, (Rational([1.0]),))  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="finite"):
        FeedbackModel(np.full((1, 1), np.nan))
    with pytest.raises(ModelError, match="a centre of 3 states; give 2"):
        replace(loop(), centre=np.ones(3))
    with pytest.raises(ModelError, match="one input"):
        fit_feedback(loop(), Record(np.zeros((50, 2)), np.arange(50.0), DT))
    steep = FeedbackModel(LOOP, (Polynomial(np.array([0.0, 0.0, 0.0, 500.0])),))
    with pytest.raises(ModelError, match="diverges"):
        fit_feedback(steep, Record(U, U, DT))


def test_an_unknown_option_or_record_is_refused() -> None:
    with pytest.raises(ModelError, match="did you mean"):
        emsid.feedback(static="dead-zon")
    with pytest.raises(ModelError, match="orders count states"):
        emsid.feedback(order=-1)
    with pytest.raises(ModelError, match="fewer than"):
        emsid.fit(emsid.feedback(), Record(U[:30], U[:30], DT))


def test_maps_and_poles_are_drawn() -> None:
    from emsid.report.views.sections import model_section

    truth, rng = FeedbackModel(TWO_LOOPS, (MAPS["saturation"], MAPS["polynomial"]), dt=DT), np.random.default_rng(1)
    u = rng.normal(size=400)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    fit = fit_feedback(truth, record)
    maps, poles = model_section(fit, record).figures[:2]
    assert len(maps.plots) == 2
    band = next(mark for mark in maps.plots[0].marks if hasattr(mark, "lower"))
    assert np.all(band.lower <= band.upper)
    assert np.any(band.upper - band.lower > 0)
    # Changes of the model that leave its output as it is add nothing to a band.
    model, redundant = fit.model, 0.01 * directions(fit.model, visited_in(fit.model, record))
    covariance, at = redundant @ redundant.T, [model.names.index(name) for name in fit.names]
    covariance[np.ix_(at, at)] += fit.covariance
    looser = replace(fit, names=model.names, estimate=model.parameters, covariance=covariance)
    other = model_section(looser, record).figures[0]
    for k in range(2):
        bands = [next(mark for mark in each.plots[k].marks if hasattr(mark, "lower")) for each in (maps, other)]
        np.testing.assert_allclose(bands[1].upper, bands[0].upper, rtol=1e-3, atol=1e-4)
    # In samples in which a saturated map has no slope, the poles are those of the model without it.
    assert [plot.title for plot in poles.plots] == ["Poles, by map 1", "Poles, by map 2"]
    _, small, middle, large = poles.plots[0].marks
    assert [len(each.x) for each in (small, middle, large)] == [18, 2, 18]
    seen, n = visited_in(model, record), model.states
    t = np.argsort(seen.z[:, 0])[round(0.99 * (len(seen.u) - 1))]
    assert large.label.endswith(f"to {seen.z[t, 0]:.3g}")
    saturated, bent = (each.slope(seen.z[t : t + 1, k])[0] for k, each in enumerate(model.maps))
    assert saturated == 0
    expected = np.linalg.eigvals(model.matrix[:n, :n] + bent * np.outer(model.matrix[:n, -1], model.matrix[n + 1, :n]))
    np.testing.assert_allclose(np.sort(large.x[-2:] + 1j * large.y[-2:]), np.sort(expected), atol=1e-9)


def test_an_equation_has_the_digits_that_its_free_run_needs() -> None:
    truth, rng = FeedbackModel(LOOP, (MAPS["saturation"],), dt=DT), np.random.default_rng(1)
    u = rng.normal(size=600)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    fit = fit_feedback(truth, record)
    text = rounded_equation(fit, record)
    longest = max(len(digits.replace(".", "").lstrip("0")) for digits in re.findall(r"\d*\.\d+", text))
    assert 3 <= longest <= 7
    assert len(text) < len(fit.model.equation())
    assert (
        rounded_equation(replace(fit, covariance=np.full_like(fit.covariance, np.inf)), record) == fit.model.equation()
    )
