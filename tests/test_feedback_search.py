"""The search for a feedback model: its order, delay, maps and products."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from emsid import Record
from emsid.estimation.nonlinear.control import FREE
from emsid.identification.result import curves
from emsid.models.blocks.search.map_families import family_of
from emsid.models.blocks.static_maps import Abs, DeadZone, Polynomial, Saturation, UserMap
from emsid.models.feedback.coordinates import with_line
from emsid.models.feedback.fitting import searched
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.search import choice, estimation, moves, trials
from emsid.models.feedback.search.choice import chosen
from emsid.models.feedback.search.directions import Direction
from emsid.models.feedback.search.moves import MORE, maps_more, with_map_more
from emsid.models.feedback.search.starts import started_beside_line
from emsid.models.feedback.search.trials import FeedbackSearch, SearchData, Steps, Trial, error_of_use
from emsid.record import concatenate
from emsid.selection.improvement import StretchErrors
from feedback_models import Array, U, X, begun_trial, loop, sticking
from model_examples import DT


def scaled_trial(size: float, maps: int = 1) -> Trial:
    """A trial with so many maps whose residual is multiplied by a factor."""
    _, begun = begun_trial(200)
    minimum = begun.found.minimum
    residuals = [size * residual for residual in minimum.residuals]
    scaled = replace(minimum, residuals=residuals, noise_variance=size**2 * minimum.noise_variance)
    model = FeedbackModel(np.zeros((2 + maps, 2 + maps)), maps * (Saturation(),))
    return replace(begun, found=replace(begun.found, model=model, minimum=scaled))


# --- options ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 13}, "order 13: .* from 0 to 12"),
        ({"order": -1}, "order -1: .* from 0 to 12"),
        ({"maps": 7}, "maps 7: .* from 1 to 6"),
        ({"maps": 0}, "maps 0: .* from 1 to 6"),
        ({"oversampling": 65}, "oversampling 65: .* from 1 to 64"),
        ({"held": "yes"}, "held 'yes'; give True, False, or None"),
        ({"size": 9}, "size 9 without a static map"),
        ({"static": "dead-zone", "size": 9}, "size 9 of a dead-zone map, which has one size"),
        ({"static": "spline", "size": 1}, "spline: 1 knots"),
        ({"static": "spline", "size": 101}, "size 101: .* from 0 to 100"),
        ({"static": UserMap}, "a user map has no start from data; give one with start values"),
    ],
)
def test_options_that_make_no_sense_are_refused_when_they_are_given(options: dict[str, Any], message: str) -> None:
    with pytest.raises(emsid.ModelError, match=message):
        emsid.feedback(**options)


def test_a_delay_that_leaves_little_of_a_record_is_refused() -> None:
    with pytest.raises(emsid.ModelError, match="a delay of 25 in a stretch of 240 samples; give at most 24"):
        emsid.fit(emsid.feedback(delay=25), sticking(1))


def root(x: Array, p: Array) -> Array:
    return np.sqrt(x)


def late() -> UserMap:
    """A map that fails some time after it was made."""
    calls = []

    def cubic(x: Array, p: Array) -> Array:
        calls.append(1)
        if len(calls) > 10:
            raise RuntimeError("late")
        return x**3

    return UserMap(cubic, lambda x, p: 3 * x**2)


@pytest.mark.parametrize(
    ("own", "message"),
    [
        (UserMap(root, lambda x, p: 0.5 / np.sqrt(x)), "the user map is not finite at an input of -.*, which the sig"),
        (late(), "the function of a user's map failed: RuntimeError: late"),
    ],
)
def test_why_no_model_is_begun_with_a_users_own_map_is_said(
    own: UserMap, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(emsid.ModelError, match=message):
        emsid.fit(emsid.feedback(order=1, maps=1, oversampling=1, static=own), sticking(1))
    assert "DLASCL" not in "".join(capfd.readouterr())


# --- order, delay and signs ------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("delay", [0, 8])
def test_a_longer_delay_is_tried_where_it_is_shown(delay: int) -> None:
    """A delay of 8 samples comes from linear models, and the record has it or not."""
    truth = FeedbackModel(
        np.array([[0.8, 0.5, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), (Saturation(0.3, -0.2, 0.2),), delay=delay
    )
    rng = np.random.default_rng(5)
    u = rng.normal(size=400)
    record = Record(u, truth.output(u, np.zeros(1)) + 0.01 * rng.normal(size=len(u)), DT)
    search = FeedbackSearch(1, 1, family_of("saturation"), oversampling=1, linear_delay=8)
    fit = estimation.FeedbackStructure(search).fit(record)
    assert fit.model.delay == delay
    assert np.sqrt(fit.noise_variance) < 0.011


@pytest.mark.parametrize(("best", "tried"), [(0, (0,)), (3, (0, 3)), (7, (7, 0)), (8, (0,))])
def test_the_delays_that_linear_models_gain_by_are_tried(best: int, tried: tuple[int, ...]) -> None:
    """One of 7 samples comes from linear models, and others of more than 5 are not tried."""

    class Judge:
        def linear(self, order: int, steps: Steps, delay: int) -> SimpleNamespace:
            return SimpleNamespace(error=0.9 if delay == best else 1.0 + 0.01 * delay)

    assert choice._delays(Judge(), FeedbackSearch(linear_delay=7), Steps(1, False)) == tried  # type: ignore[arg-type]


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
    """No map is better than none, so none is added to it; no linear model is fitted again."""
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


# --- maps ------------------------------------------------------------------------------------------------------------


def test_friction_that_sticks_is_found() -> None:
    """Of all families, by default; the noise is what is left, on a new record too."""
    fit = emsid.fit(emsid.feedback(maps=1, delay=0, oversampling=1), sticking(1))
    assert type(fit.model.maps[0]) in (DeadZone, Saturation)
    assert emsid.compare([fit], sticking(2)).best.row.simulation_rmse < 0.0115


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


def test_a_map_may_explain_more_than_its_direction_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no direction seems to explain more than noise, every order is tried with a map none the less."""
    monkeypatch.setattr(SearchData, "more_than_noise", lambda *_: False)
    rng = np.random.default_rng(11)
    u = np.repeat(rng.uniform(-1, 1, 60), 5)
    matrix = np.array([[1.5, 1.0, 0.3, -0.4], [-0.6, 0.0, 0.2, 0.1], [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    truth = FeedbackModel(matrix, (DeadZone(-0.3, 0.3),))
    record = Record(u, truth.output(u, np.zeros(2)) + 0.01 * rng.normal(size=len(u)), DT)
    *_, last = chosen([record], FeedbackSearch(delay=0, oversampling=1), FREE)
    assert last.found.model.states == 2
    assert last.found.error < 0.0105


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
    data = SearchData.of([record], FeedbackSearch(), FREE)
    begun = data.judged(searched(without, data.segments(without), 0, 30), family_of("polynomial"), 3)
    assert begun.found.error > 0.015
    (trial,) = maps_more(data, [begun], FeedbackSearch(), (("dead-zone", 0),))
    assert len(trial.found.model.maps) == 3
    assert trial.found.error < 0.0105


def with_residual(residual: Array, used: int) -> Trial:
    """A trial with this residual and so many parameters."""
    trial = scaled_trial(1.0)
    variance = float(residual @ residual) / (len(residual) - used)
    minimum = replace(trial.found.minimum, samples=len(residual), residuals=[residual], noise_variance=variance)
    squares = np.full(16, float(np.mean(residual**2)))
    return replace(trial, found=replace(trial.found, minimum=minimum), errors=StretchErrors.of(squares))


def test_few_independent_errors_may_justify_a_map() -> None:
    """Of 400 samples about 40 are independent, and 14 parameters leave 0.9, 0.6 or 0.1 of the error.

    A faster residual has more independent errors.
    """
    fast = np.random.default_rng(1).normal(size=400)
    slow, records = lfilter([1.0], [1.0, -0.9], fast), list[Record]()
    data = SearchData(records, records, 0)
    plain, *others = (with_residual(k * slow, used) for k, used in ((1, 2), (0.9, 16), (0.6, 16), (0.1, 16)))
    _, some, most = others
    followed = with_residual(0.6 * np.std(slow) / np.std(fast) * fast, 16)
    assert [data.prefers(each, plain) for each in (some, followed, most)] == [False, True, True]


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
    data = SearchData.of([record], FeedbackSearch(held_back=0.0), FREE)
    found = searched(truth, data.segments(truth), 0, 5)
    trial = data.judged(found, family_of("polynomial"), 3)
    assert data.leaves_noise(trial)
    assert not list(maps_more(data, [trial], FeedbackSearch(), MORE))
    linear = data.linear(2, Steps(1, False), 0)
    assert data.more_than_noise(linear)
    assert not data.leaves_noise(replace(trial, found=linear))
    assert all(len(way.left) == linear.minimum.samples for way in data.directions(linear))


# --- products --------------------------------------------------------------------------------------------------------


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
    """Damping by the command, beside friction."""
    record, noise = coasting(1, 600)
    fit = emsid.fit(emsid.feedback(order=1, delay=0, oversampling=1), record)
    model = fit.model
    assert list(model.multiplied) == [0]
    assert emsid.compare([fit], coasting(2)[0]).best.row.simulation_rmse < 1.1 * noise
    assert {"g1.u", "g1.1"} & {*fit.names}
    assert ")*g1(t)\n" in model.equation()
    (first, *_) = curves(fit, record)[-len(model.maps) :]
    assert first.name == "w1/g1"


@pytest.mark.long
def test_maps_of_one_signal_each_leave_three_times_the_noise_of_a_product() -> None:
    record, noise = coasting(1)
    plain = emsid.fit(emsid.feedback(order=1, delay=0, oversampling=1, static="two-slopes", maps=2), record)
    assert np.sqrt(plain.noise_variance) > 3 * noise


def test_no_map_is_multiplied_where_another_leaves_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = []
    monkeypatch.setattr(moves, "with_product", lambda *given: begun.append(given))
    emsid.fit(emsid.feedback(order=1, delay=0, oversampling=1), sticking(1))
    assert not begun


# --- trials ----------------------------------------------------------------------------------------------------------


def test_parts_that_are_left_out_decide_between_models_of_many_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    """A polynomial in a record of 100 samples of a linear system."""
    rng = np.random.default_rng(13)  # another seed may end at a polynomial that diverges on a constant input
    u = rng.normal(size=100)
    linear = FeedbackModel(np.array([[0.8, 0.5], [1.0, 0.0]]))
    record = Record(u, linear.output(u, np.zeros(1)) + 0.1 * rng.normal(size=len(u)), DT)
    data = SearchData.of([record], FeedbackSearch(), FREE)
    straight = data.judged(data.linear(1, Steps(1, False), 0), family_of("spline"), 0)
    bent = with_map_more(data, straight.found, family_of("polynomial"), 5)
    assert bent.found.error < straight.found.error
    assert bent.parameters * trials.PER_PARAMETER > len(u)
    assert not data.prefers(bent, straight)
    assert set(data.folds) == {id(bent), id(straight)}
    better = StretchErrors.of(np.zeros(16))
    monkeypatch.setitem(data.folds, id(bent), (bent, better))
    assert data.prefers(bent, straight)
    assert not data.prefers(straight, bent)
    monkeypatch.setattr(trials, "FEWEST", 1 + len(u) // bent.parameters)
    assert not data.prefers(bent, straight)  # too few samples for every parameter


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


def test_models_are_tried_while_an_extreme_input_is_held() -> None:
    """An input that changes fast keeps the signal of a map small; a model that integrates goes on for long."""
    u, still = np.tile([1.5, -1.5], 50), np.zeros(1)
    matrix = np.array([[0.5, 0.5, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    for edge, away in ((1.05, True), (1.6, False)):
        model = FeedbackModel(matrix, (DeadZone(-edge, edge, 30.0, 30.0),))
        assert trials.runs_away(model, [(u, model.output(u, still))], [still]) == away
    integrating = FeedbackModel(np.array([[1.0, 0.5], [1.0, 0.0]]))
    assert not trials.runs_away(integrating, [(u, integrating.output(u, still))], [still])


def test_the_error_of_use_begins_at_states_that_the_first_samples_show() -> None:
    matrix = np.diag([0.9, 0.99999, 0.0])
    matrix[0, 2], matrix[2, :2] = 1.0, [0.05, 1e-4]
    model, u = FeedbackModel(matrix, dt=DT), np.random.default_rng(5).normal(size=2000)
    y = model.output(u, np.array([0.0, 1.0]))
    noisy = y + 0.1 * np.random.default_rng(6).normal(size=len(u))
    assert error_of_use(model, [(u, noisy)]) < 0.15
    steep = FeedbackModel(np.array([[1.2, 0.5], [1.0, 0.0]]), dt=DT)
    assert error_of_use(steep, [(u, noisy)]) == np.inf
    away = replace(model, matrix=matrix * np.array([[1], [1], [1e3]]))
    assert error_of_use(away, [(u, noisy)]) > 10


def test_a_given_number_of_maps_is_kept_though_one_is_enough() -> None:
    truth, rng = loop(), np.random.default_rng(2)
    u = rng.normal(size=400)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    search = emsid.feedback(2, maps=2, static="polynomial", delay=0, oversampling=1)
    assert len(emsid.fit(search, record).model.maps) == 2


def test_a_model_with_another_number_of_maps_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, rng = loop(), np.random.default_rng(2)
    u = rng.normal(size=400)
    record = Record(u, truth.output(u, X) + 0.01 * rng.normal(size=len(u)), DT)
    search = emsid.feedback(2, maps=1, delay=0, oversampling=1)
    assert "other-number-of-maps" not in codes(emsid.fit(search, record))
    monkeypatch.setattr(choice, "MOVES", ())  # as if no second map could be added
    fit = emsid.fit(emsid.feedback(2, maps=2, delay=0, oversampling=1), record)
    assert len(fit.model.maps) == 1
    assert "other-number-of-maps" in codes(fit)


def codes(fit: emsid.Fit[emsid.FeedbackModel]) -> list[str]:
    return [finding.code for finding in fit.findings]
