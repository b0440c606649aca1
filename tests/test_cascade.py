"""Cascades as models: derivatives, normalisation, runs, files, equations and linear parts."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import firwin, resample_poly

from cascade_examples import CASCADES, FAST, SLOW, excitation, record_of
from emsid.errors import ModelError
from emsid.estimation.linear.filtering import is_stable
from emsid.estimation.nonlinear.problem import SQUARES, Infeasible, linearised
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.fitting import FreeRun, freedom
from emsid.models.blocks.gain import fixed_gains, unit_gain
from emsid.models.blocks.static_maps import Abs, DeadZone
from emsid.models.input_path import INTERPOLATION_REACH, between
from emsid.models.model import Model
from emsid.record import Record

# --- derivatives and coordinates -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASCADES)
def test_derivatives_agree_with_finite_differences(name: str) -> None:
    model, u = CASCADES[name], excitation(150)
    states = np.random.default_rng(1).standard_normal(model.states)
    theta = model.parameters
    exact = model.gradient(model.signals(u, states))
    step = 1e-6
    for k in range(len(theta)):
        move = step * (np.arange(len(theta)) == k)
        difference = (
            model.with_parameters(theta + move).output(u, states)
            - model.with_parameters(theta - move).output(u, states)
        ) / (2 * step)
        np.testing.assert_allclose(exact[k], difference, rtol=1e-6, atol=1e-6, err_msg=model.names[k])
    for k in range(model.states):
        move = step * (np.arange(model.states) == k)
        difference = (model.output(u, states + move) - model.output(u, states - move)) / (2 * step)
        np.testing.assert_allclose(exact[len(theta) + k], difference, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", CASCADES)
def test_the_free_coordinates_are_differentiated_exactly(name: str) -> None:
    cascade = unit_gain(CASCADES[name])
    u = excitation(120)
    inputs = (u, u[::-1].copy())
    segments = tuple((each, cascade.output(each, cascade.resting(float(each[0])))) for each in inputs)
    problem = FreeRun(cascade, freedom(cascade), segments, 5)
    theta = problem.start
    blocks = problem.linearised(theta)
    assert [len(r) for r, _ in blocks] == [115, 115]
    for k in range(len(theta)):
        move = 1e-6 * (np.arange(len(theta)) == k)
        above, below = problem.residuals(theta + move), problem.residuals(theta - move)
        for (_, jacobian), a, b in zip(blocks, above, below, strict=True):
            np.testing.assert_allclose(jacobian[:, k], (a - b) / 2e-6, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", CASCADES)
def test_given_states_leave_their_columns_out(name: str) -> None:
    cascade, u = unit_gain(CASCADES[name]), excitation(120)
    segments = ((u, u), (u[::-1].copy(), u))
    problem = FreeRun(cascade, freedom(cascade), segments, 5)
    held = replace(problem, given=problem.starting_states())
    count = len(problem.freedom.free)
    assert len(problem.start) == count + 2 * cascade.states
    assert np.array_equal(held.start, problem.start[:count])
    for (r, jacobian), (same, part) in zip(problem.linearised(problem.start), held.linearised(held.start), strict=True):
        assert np.array_equal(r, same)
        assert np.array_equal(jacobian[:, :count], part)


def test_threads_that_share_segments_change_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emsid.models.blocks.fitting.SHARED_SAMPLES", 0)
    cascade, u = unit_gain(CASCADES["wiener-hammerstein"]), excitation(150)
    one = FreeRun(cascade, freedom(cascade), tuple((np.roll(u, k), u) for k in range(7)), 5)
    two, every = replace(one, threads=2), np.arange(len(one.start))
    for r, same in zip(one.residuals(one.start), two.residuals(one.start), strict=True):
        assert np.array_equal(r, same)
    here, there = (linearised(each, one.start, every, SQUARES) for each in (one, two))
    assert np.array_equal(here.information.factor, there.information.factor)
    assert here.cost == there.cost


def test_columns_that_are_zero_are_left_out_of_no_information() -> None:
    cascade, u = unit_gain(CASCADES["wiener-hammerstein"]), excitation(150)
    problem = FreeRun(cascade, freedom(cascade), ((u, u), (-u, u)), 5)
    found = linearised(problem, problem.start, np.arange(1, len(problem.start)), SQUARES)
    blocks = found.blocks()
    rows = np.concatenate([np.column_stack([jacobian[:, 1:], -r]) for r, jacobian in blocks])
    size = np.abs(rows.T @ rows).max()
    np.testing.assert_allclose(found.information.factor.T @ found.information.factor, rows.T @ rows, atol=1e-12 * size)


def test_a_derivative_uses_the_run_of_the_residual_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    cascade, u, runs = unit_gain(CASCADES["wiener-hammerstein"]), excitation(100), []
    problem = FreeRun(cascade, freedom(cascade), ((u, u), (-u, u)), 5)
    start, run = problem.start, Cascade.signals
    monkeypatch.setattr(Cascade, "signals", lambda *some: runs.append(1) or run(*some))
    for theta, count in ((start, 2), (start, 2), (start + 1e-3, 4), (start, 6)):
        residuals = problem.residuals(theta)
        assert all(np.array_equal(r, found) for r, (found, _) in zip(residuals, problem.linearised(theta), strict=True))
        assert len(runs) == count


@pytest.mark.parametrize("name", CASCADES)
def test_the_free_parameters_are_identifiable(name: str) -> None:
    cascade = unit_gain(CASCADES[name])
    u = excitation(600)
    rows = cascade.gradient(cascade.signals(u, cascade.resting(u[0])))
    coordinates = freedom(cascade)
    coordinates.tie(rows)
    left = rows[coordinates.free]
    left = left / np.linalg.norm(left, axis=1)[:, None]
    singular = np.linalg.svd(left, compute_uv=False)
    assert singular[-1] > 1e-5 * singular[0]


@pytest.mark.parametrize("name", CASCADES)
def test_normalisation_changes_nothing_outside(name: str) -> None:
    model, u = CASCADES[name], excitation(100)
    moved = unit_gain(model)
    rest, moved_rest = model.resting(float(u[0])), moved.resting(float(u[0]))
    np.testing.assert_allclose(moved.output(u, moved_rest), model.output(u, rest), rtol=1e-9, atol=1e-11)


def test_normalised_filters_have_unit_gain() -> None:
    model = CASCADES["wiener-hammerstein"]
    gained = unit_gain(model)
    assert fixed_gains(model) == (0, 2)
    assert [gained.blocks[k].gain for k in (0, 2)] == pytest.approx([1, 1])  # type: ignore[attr-defined]
    assert fixed_gains(CASCADES["with a sign lost"]) == (0,)
    assert fixed_gains(CASCADES["user's"]) == ()
    assert fixed_gains(CASCADES["linear"]) == ()


# --- the model -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [2 * INTERPOLATION_REACH + 1, 200])
@pytest.mark.parametrize("factor", [2, 3, 7])
def test_interpolation_is_that_of_a_polyphase_filter(samples: int, factor: int) -> None:
    u = np.random.default_rng(factor).standard_normal(samples)
    ends = INTERPOLATION_REACH * factor
    window = firwin(2 * ends + 1, 1 / factor, window=("kaiser", 9.0))
    assert between(u, factor) == pytest.approx(resample_poly(u, factor, 1, window=window)[ends:-ends], abs=1e-13)


def test_a_cascade_is_a_model() -> None:
    model = CASCADES["wiener-hammerstein"]
    assert isinstance(model, Model)
    record = record_of(model, 500)
    run = model.simulate(record[100:])
    assert run.diverged_at is None
    assert run.counted.sum() == 400 - model.memory
    error = (run.output - record[100:].output)[run.counted]
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.std(record.output)
    assert model.simulate(record, 200).counted.sum() == 300
    np.testing.assert_array_equal(model.predict(record).output, model.simulate(record).output)


@pytest.mark.parametrize("name", [n for n in CASCADES if n != "user's"])
def test_a_cascade_is_saved_and_loaded(name: str) -> None:
    model, u = CASCADES[name], excitation(50)
    back = Cascade.from_data(model.to_data())
    np.testing.assert_array_equal(back.output(u, np.zeros(back.states)), model.output(u, np.zeros(model.states)))
    assert back.equation() == model.equation()
    assert back.names == model.names


def test_equation_of_a_cascade() -> None:
    model = Cascade((fir([2.0]), DeadZone(-0.5, 0.5), Rational([0.1], [-0.9])), output_offset=0.25, delay=1)
    assert model.equation().splitlines() == [
        "v(t) = u(t-1)",
        "x1(t) = 2*v(t)",
        "x2(t) = 1*max(x1(t)-0.5, 0) + 1*min(x1(t)+0.5, 0)",
        "y(t) = (0.1)/(1 - 0.9*q^-1) x2(t) + 0.25 + e(t)",
    ]


@pytest.mark.parametrize(
    ("input_offset", "output_offset", "first", "last"),
    [
        (0.0, 0.0, "x1(t) = 2*u(t)", "y(t) = abs(x1(t)) + e(t)"),
        (1e-16, -7.5e-16, "x1(t) = 2*u(t)", "y(t) = abs(x1(t)) + e(t)"),
        (-0.5, -2.0, "v(t) = u(t) + 0.5", "y(t) = abs(x1(t)) - 2 + e(t)"),
        (0.5, 1e-9, "v(t) = u(t) - 0.5", "y(t) = abs(x1(t)) + 1e-09 + e(t)"),
    ],
)
def test_offsets_that_are_rounding_are_not_printed(
    input_offset: float, output_offset: float, first: str, last: str
) -> None:
    lines = Cascade((fir([2.0]), Abs()), input_offset, output_offset).equation().splitlines()
    assert lines[0] == first
    assert lines[-1] == last


@pytest.mark.parametrize("oversampling", [1, 3])
def test_linear_parts_as_python_control_systems(oversampling: int) -> None:
    control = pytest.importorskip("control")
    dt = 1e-3
    model = replace(CASCADES["wiener-hammerstein"], delay=2, oversampling=oversampling)
    systems = model.to_control(dt)
    u = excitation(60)
    frequency = np.geomspace(1.0, 0.4 / dt, 20)
    for system, block, late in zip(systems, (FAST, SLOW), (2 * oversampling, 0), strict=True):
        assert isinstance(system, control.TransferFunction)
        assert system.dt == pytest.approx(dt / oversampling)
        assert system.dcgain() == pytest.approx(block.gain)
        np.testing.assert_allclose(np.sort(np.abs(system.poles()))[-2:], np.sort(np.abs(block.poles)))
        wait = np.exp(-2j * np.pi * frequency * late * system.dt)
        np.testing.assert_allclose(
            system(np.exp(2j * np.pi * frequency * system.dt)), wait * block.response(frequency, system.dt), rtol=1e-9
        )
        delayed = np.concatenate([np.zeros(late), u])[: len(u)]
        there = control.forced_response(system, inputs=u).outputs
        np.testing.assert_allclose(there, block.output(delayed, np.zeros(block.states)), atol=1e-9)


def test_without_python_control_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ModelError, match=r"pip install emsid\[control\]"):
        CASCADES["linear"].to_control(1e-3)


@pytest.mark.parametrize("poles", [[0.5], [0.999], [1.0], [0.3, -0.8], [0.6 + 0.5j, 0.6 - 0.5j], [0.1, 1.2], [1j, -1j]])
def test_a_filter_is_stable_where_its_largest_pole_is_inside_the_circle(poles: list[complex]) -> None:
    block = Rational([1.0], np.real(np.poly(poles))[1:])
    if np.max(np.abs(poles)) < 1:
        block.check()
    else:
        with pytest.raises(Infeasible):
            block.check()


@pytest.mark.parametrize("order", range(7))
@pytest.mark.parametrize("radius", [1.0, 0.9])
def test_stability_without_the_roots_agrees_with_the_roots(order: int, radius: float) -> None:
    rng = np.random.default_rng(order)
    seen = set()
    for _ in range(200):
        pairs = rng.uniform(0.2, 1.15, order // 2) * np.exp(1j * rng.uniform(0, np.pi, order // 2))
        poles = np.concatenate([pairs, pairs.conj(), rng.uniform(-1.1, 1.1, order % 2)])
        denominator = np.real(np.atleast_1d(np.poly(poles)))[1:]
        stable = bool(np.abs(poles).max(initial=0.0) < radius)
        assert is_stable(denominator.tolist(), radius) == stable
        seen.add(stable)
    assert seen == ({True, False} if order else {True})


# --- initial states --------------------------------------------------------------------------------------------------


def test_a_free_run_does_not_drift_with_a_pole_that_its_start_does_not_determine() -> None:
    slow = Rational([1.0, 0.0, 0.0], np.poly([0.999, 0.9, 0.85])[1:])
    model = Cascade((slow.amplified(1 / slow.gain),))
    rng = np.random.default_rng(0)
    u = rng.standard_normal(6000).cumsum() / 20
    clean = model.output(u, model.resting(float(u[0])))
    record = Record(u, clean + 0.1 * np.std(clean) * rng.standard_normal(6000), 1.0)[2000:]
    error = (model.simulate(record).output[:, 0] - clean[2000:])[model.memory :]
    assert np.sqrt(np.mean(error**2)) < 0.15 * np.std(clean)


def test_the_initial_state_behind_a_lost_sign_has_the_right_sign() -> None:
    """From rest alone, ten of these eighty starts end on the wrong side of zero."""
    model = Cascade((Rational([0.1], [-0.9]), Abs()))
    u = np.repeat(np.random.default_rng(2).uniform(-1, 1, 40), 25)
    y = model.output(u, model.resting(float(u[0])))
    wrong = 0
    for first in range(5, 800, 10):
        states = model.initial_state(u[first:], y[first : first + model.memory])
        wrong += np.max(np.abs(model.output(u[first:], states) - y[first:])) > 1e-3
    assert wrong <= 2


def test_the_initial_state_behind_a_lost_sign_survives_noise() -> None:
    """The state that fits the first samples best, without what this input makes likely, is wrong for long."""
    poles = [0.93, 0.9 * np.exp(0.25j), 0.9 * np.exp(-0.25j)]
    denominator = np.real(np.poly(poles))
    model, rng, noise = Cascade((Rational([denominator.sum()], denominator[1:]), Abs())), np.random.default_rng(3), 0.02
    u = np.repeat(rng.uniform(-1, 1.5, 80), 5)
    clean = model.output(u, np.zeros(3))
    y = clean + noise * rng.standard_normal(len(u))
    for first in range(10, 330, 8):
        states = model.initial_state(u[first:], y[first : first + model.memory])
        error = (model.output(u[first:], states) - clean[first:])[model.memory :][:30]
        assert np.sqrt(np.mean(error**2)) < noise / 4


@pytest.mark.parametrize("name", CASCADES)
def test_several_starts_at_once_are_those_one_by_one(name: str) -> None:
    cascade, u = CASCADES[name], excitation(50)
    states = np.random.default_rng(3).standard_normal((3, cascade.states))
    np.testing.assert_array_equal(cascade.outputs(u, states), [cascade.output(u, state) for state in states])
