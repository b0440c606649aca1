"""Feedback models: their runs and derivatives, the models that are cases of them, their coordinates and their fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

import emsid
from emsid import ModelError, Record
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control, Stopped
from emsid.identification.curves import curves
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.map_families import family_of
from emsid.models.blocks.search.sign_recovery import may_be_magnitudes
from emsid.models.blocks.static_maps import (
    STATIC_MAPS,
    Abs,
    CubicSpline,
    DeadZone,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    UserMap,
)
from emsid.models.feedback import fitting
from emsid.models.feedback.coordinates import Visited, coordinates, directions, normal_form, whitened, with_line
from emsid.models.feedback.fitting import fit_feedback, searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search import choice, estimation, trials
from emsid.models.feedback.search.choice import chosen
from emsid.models.feedback.search.directions import Direction
from emsid.models.feedback.search.magnitudes import as_feedback, of_magnitudes
from emsid.models.feedback.search.starts import started_beside_line
from emsid.models.feedback.search.trials import Bench, FeedbackSearch, Steps, Trial
from emsid.models.free_run import squared_errors
from emsid.models.one_channel import segments_longer_than
from emsid.models.start_states import starting
from emsid.record import concatenate
from emsid.selection.improvement import StretchErrors
from test_models_contract import DT, LOOP, MAPS, TWO_LOOPS

Array = NDArray[np.float64]
U = np.random.default_rng(0).normal(size=400)
X = np.array([0.3, -0.2])


def loop(name: str = "polynomial", rate: int = 1) -> FeedbackModel:
    offset = 0.0 if MAPS[name].absorbs_shift else 0.05
    return FeedbackModel(LOOP, (MAPS[name],), np.array([offset]), 0.2, oversampling=rate, dt=DT)


def multiplied(name: str = "polynomial", rate: int = 1) -> FeedbackModel:
    """A loop with two maps, of which the first is multiplied by a signal."""
    factors = np.array([[0.3, -0.2, 0.1, 0.4], [0.0, 0.0, 0.0, 1.0]])
    maps = MAPS[name], DeadZone(-0.2, 0.3)
    return FeedbackModel(TWO_LOOPS, maps, np.zeros(2), 0.2, oversampling=rate, dt=DT, factors=factors)


def visited(model: FeedbackModel, u: Array = U, x: Array = X) -> Visited:
    return Visited.of([model.entering(u)], [model.trajectory(u, x)])


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


def magnitudes(samples: int = 200, seed: int = 3) -> Record:
    """Two masses on a spring, a motor whose friction levels off, and a sensor that shows the size of the speed only."""
    rng = np.random.default_rng(seed)
    u, x, y = np.repeat(rng.uniform(-1.2, 1.8, samples // 10), 10), np.zeros(3), np.empty(samples)
    for t in range(samples):
        y[t] = abs(x[2]) + 0.005 * rng.standard_normal()
        for _ in range(10):
            change = [4.0 * u[t] - 6.0 * x[0] / (0.8 + abs(x[0])), x[0] - x[2], 400.0 * x[1] - 6.0 * x[2]]
            x = x + 0.002 * np.array(change)
    return Record(u, y, 0.02)


def test_a_sensor_that_loses_the_sign_is_a_start() -> None:
    record = magnitudes()
    assert may_be_magnitudes([record])
    assert not may_be_magnitudes([replace(record, input=record.input + 2.0)])
    assert not may_be_magnitudes([replace(record, output=record.output - 1.0)])
    found = of_magnitudes([record], 4, FREE)
    assert [[type(each) for each in model.model.maps] for model, _ in found] == [[Abs], [CubicSpline]]
    assert min(model.error for model, _ in found) < 0.03  # 0.074 is the best of models that start without signs
    fit = emsid.fit(emsid.feedback(order=4), record)
    assert fit.noise_variance < 0.01**2
    assert emsid.compare([fit], magnitudes(300, seed=50)).best.row.simulation_rmse < 0.02


def test_a_sensor_that_loses_the_sign_is_no_spline() -> None:
    """A spline rounds the corner of |z|; the fit begins at the recovered signs, as either fits the start."""
    rng = np.random.default_rng(14)
    matrix = np.array([[1.6, 1.0, 0.1, 0.0], [-0.7, 0.0, 0.1, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    truth, u = FeedbackModel(matrix, (MAPS["abs"],)), np.repeat(rng.normal(size=40), 5)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    (found, knots), _ = of_magnitudes([record], 2, FREE)
    assert knots == 0
    assert found.error < 0.0105


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


def sticking(seed: int, samples: int = 240) -> Record:
    """A motor that sticks, with 2 % noise."""
    truth, rng = FeedbackModel(np.array([[0, 0, 1], [0.9, 0.5, 0], [1, 0, 0]]), (DeadZone(-0.2, 0.2),)), np.random
    u = np.repeat(rng.default_rng(seed).normal(size=samples // 4), 4)
    noise = 0.01 * rng.default_rng(seed + 100).normal(size=samples)
    return Record(u, truth.output(u, np.zeros(1)) + noise, DT)


@pytest.mark.parametrize("name", STATIC_MAPS)
def test_every_map_is_fitted_in_a_loop(name: str) -> None:
    record = sticking(1)
    fit = emsid.fit(emsid.feedback(order=1, static=name, maps=1, delay=0, oversampling=1), record)
    assert fit.model.maps[0].kind == name
    linear = emsid.fit(FeedbackModel(np.array([[0.9, 0.5], [1.0, 0.0]])), record)
    assert fit.noise_variance < linear.noise_variance


def test_friction_that_sticks_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all families, by default; the noise is what is left, on a new record too. No polynomial comes near it."""
    tried, begin = [], choice._with_map
    monkeypatch.setattr(
        choice, "_with_map", lambda *given: (tried.append((given[1].model.states, given[2].name)), begin(*given))[1]
    )
    fit = emsid.fit(emsid.feedback(maps=1, delay=0, oversampling=1), sticking(1))
    assert type(fit.model.maps[0]) in (DeadZone, Saturation)
    assert emsid.compare([fit], sticking(2)).best.row.simulation_rmse < 0.0115
    assert {(1, "polynomial"), (1, "dead-zone"), (2, "dead-zone")} <= {*tried}
    assert (2, "polynomial") not in tried


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
@pytest.mark.parametrize("name", ["polynomial", "dead-zone", "spline", "monotone-spline", "coulomb-linear", "abs"])
def test_other_forms_of_a_model_have_the_same_output(name: str, make: Callable[[str], FeedbackModel]) -> None:
    model = make(name)
    expected = model.output(U, X)
    normal, held = normal_form(model, visited(model))
    for same in (whitened(model, visited(model)), normal):
        np.testing.assert_allclose(same.model.output(U, same.state(X)), expected, rtol=1e-9, atol=1e-10)
    spread = coordinates(normal.model, visited(normal.model, U, normal.state(X)), held)
    assert not spread[held].any()
    assert spread.shape[1] == coordinates(model, visited(model)).shape[1]


def test_a_fit_finds_the_model_of_noisy_data() -> None:
    truth, rng = loop(), np.random.default_rng(1)
    u = rng.normal(size=1500)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    begin = truth.with_parameters(truth.parameters * (1 + 0.05 * rng.normal(size=len(truth.parameters))))
    fit = emsid.fit(begin, record)
    assert fit.ending is emsid.Ending.CONVERGED
    assert fit.noise_variance == pytest.approx(1e-4, rel=0.1)
    v = rng.normal(size=500)
    error = fit.model.simulate(v, dt=DT).output - truth.simulate(v, dt=DT).output
    assert np.sqrt(np.mean(error[50:] ** 2)) < 2e-3
    assert set(fit.names) >= {"x1.x1", "x2.u", "y.1"}
    assert np.all(np.sqrt(np.diag(fit.covariance)) < 0.5)


def test_intervals_hold() -> None:
    """Among 20 records, 95 % intervals of the pole and of the gain contain the truth at least 16 times."""
    truth = FeedbackModel(np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (Saturation(0.3, -0.2, 0.2),))
    inside = {"x1.x1": 0, "x1.u": 0}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = rng.normal(size=1000)
        record = Record(u, truth.output(u, np.zeros(1)) + 0.05 * rng.normal(size=len(u)), DT)
        fit = fit_feedback(truth, record)
        for name, value in (("x1.x1", 0.8), ("x1.u", 0.5)):
            k = fit.names.index(name)
            inside[name] += bool(abs(fit.estimate[k] - value) < 1.96 * np.sqrt(fit.covariance[k, k]))
    assert min(inside.values()) >= 16


def test_a_users_own_map_is_fitted() -> None:
    cubic = UserMap(
        lambda x, p: p[0] * x**3, lambda x, p: 3 * p[0] * x**2, lambda x, p: x[None] ** 3, np.array([0.2]), ("c",)
    )
    truth = FeedbackModel(np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (cubic,))
    u = np.random.default_rng(2).normal(size=300)
    begin = replace(truth, maps=(cubic.with_parameters(np.array([0.1])),))
    fit = fit_feedback(begin, Record(u, truth.output(u, np.zeros(1)), DT), max_iterations=8)
    assert np.sqrt(fit.noise_variance) < 1e-6
    assert ", c=" in fit.model.equation()


def test_what_is_no_feedback_model_is_refused() -> None:
    with pytest.raises(ModelError, match="w must not reach z"):
        FeedbackModel(np.ones((4, 4)), (Saturation(),))
    with pytest.raises(ModelError, match="a matrix of shape"):
        FeedbackModel(np.ones((3, 4)), (Saturation(),))
    with pytest.raises(ModelError, match="no static map"):
        FeedbackModel(LOOP, (Rational([1.0]),))  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="finite"):
        FeedbackModel(np.full((1, 1), np.nan))
    with pytest.raises(ModelError, match="one input"):
        fit_feedback(loop(), Record(np.zeros((50, 2)), np.arange(50.0), DT))
    steep = FeedbackModel(LOOP, (Polynomial(np.array([0.0, 0.0, 0.0, 500.0])),))
    with pytest.raises(ModelError, match="diverges"):
        fit_feedback(steep, Record(U, U, DT))


def oscillator(samples: int, growing: bool = False) -> tuple[Record, float]:
    """A hardening spring that is driven by an input that is held, with 1 % noise, and the noise."""
    rng, dt, x, v, out = np.random.default_rng(samples), 1 / 600.0, 0.0, 0.0, []
    u = np.repeat(rng.normal(size=samples // 4 + 1), 4)[:samples] * 0.1
    u *= np.linspace(0, 1.2, samples) if growing else 1.0
    for level in u:
        out.append(x)
        for _ in range(10):
            v += dt / 10 * (190_000 * (level - x - 12.0 * x**3) - 44 * v)
            x += dt / 10 * v
    y = np.array(out)
    noise = 0.01 * float(np.std(y))
    return Record(u, y + noise * rng.normal(size=samples), dt), noise


def test_a_spring_that_hardens_is_found_to_the_noise() -> None:
    """The search knows nothing of it; a new record of growing amplitude judges it."""
    record, noise = oscillator(800)
    fit = emsid.fit(emsid.feedback(order=2, oversampling=2, held=True), record)
    assert emsid.compare([fit], record).best.row.simulation_rmse < 1.1 * noise
    other, noise = oscillator(900, growing=True)
    assert emsid.compare([fit], other).best.row.simulation_rmse < 1.4 * noise


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
    # The linear part may have any line of a polynomial, so the band is that of its shape.
    line = np.array([fit.names.index(name) for name in truth.names[truth.spans[1]][:2]])
    looser = fit.covariance.copy()
    looser[np.ix_(line, line)] += 100.0
    other = model_section(replace(fit, covariance=looser), record).figures[0]
    bands = [mark for each in (maps, other) for mark in each.plots[1].marks if hasattr(mark, "lower")]
    np.testing.assert_allclose(bands[1].upper, bands[0].upper, rtol=1e-6)
    # A saturated map has no slope: the loop is open there, and its poles are those of A.
    groups = {mark.label: mark for mark in poles.plots[0].marks}
    assert {"small z", "middle", "large z"} <= groups.keys()
    assert len(groups["middle"].x) == 2


def test_a_delay_of_the_input_is_found() -> None:
    truth = FeedbackModel(
        np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (Saturation(0.3, -0.2, 0.2),), delay=3
    )
    rng = np.random.default_rng(5)
    u = rng.normal(size=400)
    record = Record(u, truth.output(u, np.zeros(1)) + 0.01 * rng.normal(size=len(u)), DT)
    found = emsid.feedback(order=1, static="saturation", maps=1, oversampling=1)
    fit = emsid.fit(found, record)
    assert fit.model.delay in (3, 4)  # the state adds a sample, which a direct path can make up for
    assert np.sqrt(fit.noise_variance) < 0.011


def test_an_order_above_three_is_found() -> None:
    """Two resonances and a spring that hardens, which drives both."""
    poles = np.array([0.9 * np.exp(0.4j), 0.95 * np.exp(1.1j)])
    a = np.real(np.poly([*poles, *poles.conj()]))
    matrix = np.zeros((6, 6))
    matrix[:4, :4] = np.eye(4, k=1)
    matrix[:4, 0], matrix[:4, 4], matrix[:4, 5] = -a[1:], (0.3, -0.2, 0.1, 0.05), (0.2, -0.1, 0.0, 0.1)
    matrix[4:, 0] = 1.0
    truth = FeedbackModel(matrix, (Polynomial(np.array([0.0, 0.0, 0.0, -0.1])),))
    rng = np.random.default_rng(6)
    u = 0.3 * rng.normal(size=500)
    record = Record(u, truth.output(u, np.zeros(4)) + 0.01 * rng.normal(size=len(u)), DT)
    fit = emsid.fit(emsid.feedback(static="polynomial", size=3, maps=1, delay=0, oversampling=1), record)
    assert fit.model.states == 4
    assert np.sqrt(fit.noise_variance) < 0.011


def test_a_linear_record_takes_one_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    """No direction of a map explains more than noise, so none is refined; no linear model is fitted again."""
    fitted: list[tuple[object, ...]] = []
    begin = trials.linear_start
    monkeypatch.setattr(trials, "linear_start", lambda *asked: (fitted.append(asked[1:5]), begin(*asked))[1])
    rng = np.random.default_rng(7)
    u = rng.normal(size=500)
    linear = FeedbackModel(np.array([[1.5, 1.0, 0.2], [-0.6, 0.0, 0.1], [1.0, 0.0, 0.0]]))
    record = Record(u, linear.output(u, np.zeros(2)) + 0.1 * rng.normal(size=len(u)), DT)
    tried = list(chosen([record], FeedbackSearch(), FREE))
    assert [(len(each.found.model.maps), each.found.model.states) for each in tried] == [(1, 2)]
    assert len(set(fitted)) == len(fitted) > 6


def test_a_map_may_explain_more_than_its_direction_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no direction seems to explain more than noise, a map that does is refined and others are tried."""
    monkeypatch.setattr(choice, "_bent", lambda *_: [])
    rng = np.random.default_rng(11)
    u = np.repeat(rng.uniform(-1, 1, 60), 5)
    truth = FeedbackModel(np.array([[0.9, 0.3, -0.4], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (DeadZone(-0.3, 0.3),))
    record = Record(u, truth.output(u, np.zeros(1)) + 0.01 * rng.normal(size=len(u)), DT)
    first, *_, last = chosen([record], FeedbackSearch(order=1, delay=0, oversampling=1), FREE)
    assert first.found.error > 0.012
    assert last.found.error < 0.0105


def test_a_third_map_is_found() -> None:
    """A motor whose voltage saturates, with a friction that bends, and a sensor that picks up part of the voltage."""
    rng = np.random.default_rng(9)
    u = np.repeat(rng.uniform(-1, 1, 50), 5)
    matrix = np.array([
        [0.9, 0.0, 0.3, -0.2, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0, 1.0],
    ])  # fmt: skip
    maps = (Saturation(1.0, -0.6, 0.6), Polynomial(np.array([0.0, 0.0, 0.3, 0.1])), DeadZone(-0.4, 0.2, 0.5, 0.5))
    truth = FeedbackModel(matrix, maps)
    record = Record(u, truth.output(u, np.zeros(1)) + 0.01 * rng.normal(size=len(u)), DT)
    without = FeedbackModel(np.delete(np.delete(matrix, 3, axis=0), 4, axis=1), maps[:2])
    bench = Bench.of([record], FeedbackSearch(), FREE)
    begun = bench.judged(searched(without, bench.segments(without), 0, 30), family_of("polynomial"), 3)
    assert begun.found.error > 0.015
    (trial,) = choice._one_map_more(bench, begun, FeedbackSearch(), (("dead-zone", 0),))
    assert len(trial.found.model.maps) == 3
    assert trial.found.error < 0.0105


def coasting(seed: int, samples: int = 1500) -> tuple[Record, float]:
    """A motor whose damping grows with the size of the command, as of a bridge that lets it coast, and its noise."""
    matrix = np.array([[0.98, 0.05, -0.05, -0.03], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    factors = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    truth = FeedbackModel(matrix, (Abs(), Saturation(20.0, -1.0, 1.0)), dt=DT, factors=factors)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-4, 4, samples // 15), 15)
    y, noise = truth.output(u, np.zeros(1)), 0.01
    return Record(u, y + noise * rng.normal(size=len(u)), DT), noise


def test_a_map_that_is_multiplied_by_a_signal_is_found() -> None:
    """Damping by the command, beside friction: with the same maps of one signal each, three times the noise is left."""
    record, noise = coasting(1)
    fit = emsid.fit(emsid.feedback(order=1, delay=0, oversampling=1), record)
    model = fit.model
    assert list(model.multiplied) == [0]
    assert emsid.compare([fit], coasting(2)[0]).best.row.simulation_rmse < 1.1 * noise
    assert {"g1.u", "g1.1"} & {*fit.names}
    assert ")*g1(t)\n" in model.equation()
    (first, *_) = curves(fit, record)[-len(model.maps) :]
    assert first.name == "w1/g1"
    plain = emsid.fit(emsid.feedback(order=1, delay=0, oversampling=1, static="two-slopes", maps=2), record)
    assert np.sqrt(plain.noise_variance) > 3 * noise


def test_a_product_is_found_where_one_map_is_no_better_than_a_linear_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(choice, "_bent", lambda *_: [])
    monkeypatch.setattr(choice, "_beside_linear", lambda bench, straight, *_: straight)
    record, noise = coasting(1)
    *_, last = chosen([record], FeedbackSearch(order=1, delay=0, oversampling=1), FREE)
    assert list(last.found.model.multiplied) == [0]
    assert last.found.error < 1.1 * noise


def test_no_map_is_multiplied_where_another_leaves_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = []
    monkeypatch.setattr(choice, "with_product", lambda *given: begun.append(given))
    emsid.fit(emsid.feedback(order=1, delay=0, oversampling=1), sticking(1))
    assert not begun


def test_a_map_is_added_to_the_best_model_and_to_the_one_that_explains_most() -> None:
    """Of models with as many maps; one that leaves the range of the data is not extended."""
    few, other, most, away = (_scaled(size) for size in (3.0, 2.0, 1.0, 0.5))
    away = replace(away, errors=StretchErrors.of(np.full(16, np.inf)))
    tried = [few, other, most, away]
    assert choice._to_extend(tried, few, 1) == [few, most]
    assert choice._to_extend(tried, most, 1) == [most]
    assert choice._to_extend(tried, few, 2) == []
    assert choice._to_extend(tried, _scaled(1.0, maps=2), 1) == [most]  # the best one has another number of maps


def test_maps_are_added_as_long_as_one_more_explains_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second map is not preferred, as its residual has few independent errors, but the third one beside it is."""

    class Judge:
        leaves_noise = staticmethod(lambda trial: False)
        prefers = staticmethod(lambda trial, best: trial is third)

    first, second, third, idle = _scaled(4.0), _scaled(2.0, maps=2), _scaled(1.0, maps=3), _scaled(4.0, maps=2)
    found = {1: [second], 2: [third]}
    monkeypatch.setattr(choice, "_one_map_more", lambda bench, each, *_: found[len(each.found.model.maps)])
    contest = choice.Contest(Judge(), [first], first)  # type: ignore[arg-type]
    assert list(choice._more_maps(contest, FeedbackSearch(maps=3), ())) == [third]
    found[1] = [idle]
    contest = choice.Contest(Judge(), [first], first)  # type: ignore[arg-type]
    assert list(choice._more_maps(contest, FeedbackSearch(maps=3), ())) == []


def _scaled(size: float, maps: int = 1) -> Trial:
    """A trial with so many maps whose residual is multiplied by a factor."""
    _, begun = _begun(200)
    minimum = begun.found.minimum
    residuals = [size * residual for residual in minimum.residuals]
    scaled = replace(minimum, residuals=residuals, noise_variance=size**2 * minimum.noise_variance)
    model = FeedbackModel(np.zeros((2 + maps, 2 + maps)), maps * (Saturation(),))
    return replace(begun, found=replace(begun.found, model=model, minimum=scaled))


def test_parts_that_are_left_out_decide_between_models_of_many_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """A polynomial in a record of 100 samples of a linear system."""
    rng = np.random.default_rng(12)
    u = rng.normal(size=100)
    linear = FeedbackModel(np.array([[0.8, 0.5], [1.0, 0.0]]))
    record = Record(u, linear.output(u, np.zeros(1)) + 0.1 * rng.normal(size=len(u)), DT)
    bench = Bench.of([record], FeedbackSearch(), FREE)
    straight = bench.judged(bench.linear(1, Steps(1, False), 0), family_of("spline"), 0)
    bent = choice._with_map(bench, straight.found, family_of("polynomial"), 5)
    assert bent.found.error < straight.found.error
    assert bent.parameters * trials.PER_PARAMETER > len(u)
    assert not bench.prefers(bent, straight)
    assert set(bench.folds) == {id(bent), id(straight)}
    better = StretchErrors.of(np.zeros(16))
    monkeypatch.setitem(bench.folds, id(bent), (bent, better))
    assert bench.prefers(bent, straight)
    assert not bench.prefers(straight, bent)
    monkeypatch.setattr(trials, "FEWEST", 1 + len(u) // bent.parameters)
    assert not bench.prefers(bent, straight)  # too few samples for every parameter


@pytest.mark.parametrize("line", [0.0, -1.0, 2.0])
@pytest.mark.parametrize("family", ["dead-zone", "saturation"])
def test_a_map_is_begun_beside_a_line(family: str, line: float) -> None:
    """A line beside a map is a part of the linear system, so a curve shows the map up to that."""
    z = np.random.default_rng(11).uniform(-1, 1, 500)
    w = np.clip(z, -0.4, 0.5) + line * z + 0.3
    map_, slope, level = started_beside_line(family_of(family), z, w, 0)
    np.testing.assert_allclose(map_.value(z) + slope * z + level, w, atol=0.06)
    model = FeedbackModel(np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (map_,), np.array([0.1]))
    moved = with_line(model, 0, slope, level)
    assert moved is not None
    run, other = model.trajectory(U, np.zeros(1)), moved[0].trajectory(U, moved[1])
    # The map's output with the line, on the same signal, does what the other model does without it.
    x, y = 0.0, []
    for u in U:
        w_line = float(map_.value(np.array([x + 0.1]))[0]) + slope * (x + 0.1) + level
        y.append(x)
        x = 0.8 * x + 0.5 * u - w_line
    np.testing.assert_allclose(other.y, y, atol=1e-9 * max(np.abs(y)))
    assert np.abs(run.y - other.y).max() > 0.1


def test_maps_of_free_form_are_tried_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside others only where one such map is the best model, and not at all where a plain one leaves noise."""
    first, second, spline = _scaled(4.0), _scaled(2.0, maps=2), _scaled(1.0)
    better, leaves = [second], list[Trial]()

    class Judge:
        leaves_noise = staticmethod(lambda trial: trial in leaves)
        prefers = staticmethod(lambda trial, best: trial in better)

    asked = []

    def others(bench: object, single: Trial, settings: FeedbackSearch, families: object) -> list[Trial]:
        assert single is first
        asked.append(families)
        return [spline] if families is choice.FREE_FORM.others else []

    def more(contest: choice.Contest, settings: FeedbackSearch, families: object) -> Iterator[Trial]:
        asked.append(families)
        yield from contest.entered([second] if families is choice.PLAIN.more else [])

    monkeypatch.setattr(choice, "_other_families", others)
    monkeypatch.setattr(choice, "_more_maps", more)

    def tried() -> list[Trial]:
        asked.clear()
        return list(choice._other_maps(choice.Contest(Judge(), [first], first), FeedbackSearch()))  # type: ignore[arg-type]

    assert tried() == [second]
    assert asked == [*choice.PLAIN, choice.FREE_FORM.others]
    better.append(spline)
    assert tried() == [second, spline]
    assert asked == [*choice.PLAIN, *choice.FREE_FORM]
    leaves.append(second)
    assert tried() == [second]
    assert asked == [*choice.PLAIN]


def test_a_direction_explains_a_slow_residual() -> None:
    """What a linear model misses is slow, so few of its samples are independent; what is left is not."""
    rng = np.random.default_rng(10)
    slow = lfilter([0.02], [1, -0.98], rng.normal(size=700))
    slow /= np.std(slow)
    some = Direction(np.zeros(3), np.zeros(3), np.zeros(0), np.zeros(0), 0.2 * rng.normal(size=700), 1.0, 9)
    assert some.explains(700)
    assert not replace(some, left=0.9 * slow).explains(700)


def test_no_map_is_added_to_noise() -> None:
    """A direction explains some of the noise of one segment of eight, and nothing of the others."""
    truth, rng = loop(), np.random.default_rng(13)
    u = rng.normal(size=2400)
    noisy = truth.output(u, X) + 0.02 * rng.normal(size=len(u))
    record = concatenate([Record(u, noisy, DT)[k : k + 300] for k in range(0, 2400, 300)])
    bench = Bench.of([record], FeedbackSearch(held_back=0.0), FREE)
    found = searched(truth, bench.segments(truth), 0, 5)
    trial = bench.judged(found, family_of("polynomial"), 3)
    assert bench.leaves_noise(trial)
    assert not list(choice._one_map_more(bench, trial, FeedbackSearch(), choice.PLAIN.more))
    linear = bench.linear(2, Steps(1, False), 0)
    assert bench.more_than_noise(linear)
    assert not bench.leaves_noise(replace(trial, found=linear))
    assert all(len(way.left) == linear.minimum.samples for way in bench.directions(linear))


def test_models_are_tried_on_a_larger_input_and_backward_in_time() -> None:
    """A map that is steep beyond its data; the second input ends before its effect has come, and turns round there."""
    assert not trials.runs_away(loop(), [(U, loop().output(U, X))], [X])
    matrix, still = np.array([[0.5, 0.5, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.zeros(1)
    steep = FeedbackModel(matrix, (DeadZone(-1.05, 1.05, 30.0, 30.0),))
    for held in (50, 3):
        u = np.repeat([0.0, 1.0], [50, held])
        segment = u, steep.output(u, still)
        assert np.abs(segment[1]).max() <= 1.0
        assert trials.runs_away(steep, [segment], [still])
    assert not trials.runs_away(replace(steep, maps=(DeadZone(-1.2, 1.2, 30.0, 30.0),)), [segment], [still])


def test_a_state_of_unknown_sign_is_found() -> None:
    """The first samples of an absolute value fit a wrong sign almost as well, and the state decays slowly."""
    matrix = np.array([[1.0, 0.1, 0.1, 0.0], [-0.05, 0.96, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    model, errors = FeedbackModel(matrix, (MAPS["abs"],)), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u, x = np.repeat(rng.normal(size=30), 10), rng.normal(size=2)
        y = model.output(u, x)
        noisy = y[: model.memory] + 0.02 * rng.normal(size=model.memory)
        errors.append(float(np.abs(model.output(u, starting(model, u, noisy)) - y).max()))
    assert max(errors) < 0.3


def test_a_start_is_found_however_far_the_first_searches_get(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two tanks that overflow; the prior is weighted by the variance of the residual at the estimate."""
    monkeypatch.setattr("emsid.models.start_states.FIRST_LOOK", {"max_iterations": 0, "tolerance": 0.5})
    height = np.linspace(0, 15, 31)
    level = np.minimum(height, 10)
    falls = PiecewiseLinear(height, 0.2 * np.sqrt(level))
    stays, seen = (PiecewiseLinear(height, each) for each in (level - falls.values, level))
    matrix = np.zeros((7, 7))
    matrix[0, [2, 4]] = matrix[1, [3, 5]] = matrix[[2, 3], 0] = matrix[[4, 5], 1] = matrix[6, 6] = 1.0
    model, errors = FeedbackModel(matrix, (falls, stays, stays, seen)), []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u, x = (
            0.2 * np.interp(np.arange(1000), np.arange(0, 1000, 25), rng.uniform(1.2, 3.8, 40)),
            rng.uniform(1, 12, 2),
        )
        y = model.output(u, x)
        noisy = y[: model.memory] + 0.02 * rng.normal(size=model.memory)
        errors.append(float(np.sqrt(np.mean((model.output(u, starting(model, u, noisy)) - y)[:100] ** 2))))
    assert np.mean(np.array(errors) < 0.1) > 0.9


def test_the_last_steps_of_a_fit_never_lose_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A penalty that begins too heavy in the normal form would flatten the map."""
    truth = loop("spline")
    rng = np.random.default_rng(8)
    record = Record(U, truth.output(U, X) + 0.01 * rng.normal(size=len(U)), DT)
    before = fit_feedback(truth, record, max_iterations=8)
    steps = fitting._gauss_newton

    def flattened(problem: fitting.FreeRun, states: list[Array], iterations: int, *rest: object) -> object:
        minimum = steps(problem, states, iterations, *rest)
        heavier = [10 * residual for residual in minimum.residuals]
        return replace(minimum, residuals=heavier, noise_variance=1.0) if iterations and rest[2] else minimum

    monkeypatch.setattr(fitting, "_gauss_newton", flattened)
    after = fit_feedback(truth, record, max_iterations=8)
    assert after.noise_variance == pytest.approx(before.noise_variance, rel=0.05)
    assert np.isfinite(after.covariance).all()


def _begun(samples: int) -> tuple[Record, Trial]:
    model = loop()
    u = np.random.default_rng(5).normal(size=samples)
    y = model.output(u, X)
    record = Record(u, y + 0.01 * np.std(y) * np.random.default_rng(6).normal(size=samples), DT)
    segments = segments_longer_than(model.memory, model, [record])
    start = model.with_parameters(1.02 * model.parameters)
    found = searched(start, segments, model.edge, 0)
    return record, Trial(found, StretchErrors.of(np.ones(16)), family_of("polynomial"), 3)


def test_a_long_record_is_fitted_from_the_minimum_of_a_part(monkeypatch) -> None:
    record, begun = _begun(2000)
    whole = estimation._fitted([begun], [record], FREE)
    monkeypatch.setattr(estimation, "LONG", 800)
    monkeypatch.setattr(estimation, "PART", 800)
    quick = estimation._fitted([begun, estimation._in_part(begun, [record], FREE)], [record], FREE)
    errors = [float(np.nanmean(squared_errors(fit.model, [record]))) for fit in (whole, quick)]
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)
    assert quick.samples == whole.samples  # all of them, in the end


def test_a_fit_to_a_long_record_stops_within_a_step_and_within_its_covariances(monkeypatch) -> None:
    record, begun = _begun(2000)
    monkeypatch.setattr("emsid.models.feedback.model.BLOCK", 500)
    monkeypatch.setattr(fitting, "BLOCK", 500)
    model, asked = begun.found.model, 0
    segments = segments_longer_than(model.memory, model, [record])
    for most in (0, 2, 3, 6):  # asked three times in the derivative and four times in the covariances

        def late(most: int = most) -> bool:
            nonlocal asked
            asked += 1
            return asked > most

        asked = 0
        with pytest.raises(Stopped):
            fitting.conclude(begun.found, segments, model.edge, control=Control(cancelled=late), max_iterations=0)
        assert asked == most + 1
    parts = [rows for _, rows in model.gradients(record.input[:, 0], model.trajectory(record.input[:, 0], X))]
    monkeypatch.setattr("emsid.models.feedback.model.BLOCK", 10_000)
    whole = model.gradient(record.input[:, 0], model.trajectory(record.input[:, 0], X))
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_a_search_of_a_long_record_that_is_stopped_ends_with_a_part_of_it(monkeypatch) -> None:
    record, begun = _begun(2000)

    def stopped(*_: object) -> Iterator[Trial]:
        yield begun
        raise Stopped(Ending.INTERRUPTED)

    monkeypatch.setattr(estimation, "chosen", stopped)
    monkeypatch.setattr(estimation, "LONG", 800)
    monkeypatch.setattr(estimation, "SEARCHED", 800)
    fit = emsid.feedback().fit(record)
    assert (fit.ending, fit.samples < 900) == (Ending.INTERRUPTED, True)
    same = [float(np.nanmean(squared_errors(model, [record]))) for model in (begun.found.model, fit.model)]
    assert same[1] == pytest.approx(same[0], rel=1e-3)
