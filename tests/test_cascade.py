"""Cascades: derivatives, normalisations, recovery of known blocks, endings, bad input."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import firwin, resample_poly

from coverage_cascade import CASES as COVERED
from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.linear.filtering import is_stable
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.nonlinear.gauss_newton import PATIENCE
from emsid.estimation.nonlinear.losses import Huber
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.fitting import FreeRun, fit_cascade, freedom, search, static_band
from emsid.models.blocks.gain import fixed_gains, unit_gain
from emsid.models.blocks.search.cross_validation import Round
from emsid.models.blocks.search.diagnostics import advice
from emsid.models.blocks.search.estimation import wiener_hammerstein
from emsid.models.blocks.search.map_families import TRIAL_KNOTS
from emsid.models.blocks.search.refinement import FINISHED, Plan, promising, refined, unseen_errors
from emsid.models.blocks.search.sources import refined_first
from emsid.models.blocks.static_maps import (
    Abs,
    CoulombLinear,
    CubicSpline,
    DeadZone,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    TwoSlopes,
    UserMap,
)
from emsid.models.interpolation import INTERPOLATION_REACH, between
from emsid.models.model import Model
from emsid.record import Record
from emsid.selection.improvement import StretchErrors

Array = NDArray[np.float64]

FAST = Rational([0.3, 0.15], [-0.75, 0.2])
SLOW = Rational([0.1, 0.05], [-1.3, 0.45])
KNOTS = np.linspace(-3, 3, 7)
CASCADES = {
    "linear": Cascade((SLOW,), output_offset=0.3),
    "two slopes": Cascade((FAST, TwoSlopes(0.2, 0.3, 1.4), SLOW)),
    "hammerstein": Cascade((DeadZone(-0.5, 0.4, 0.8, 1.2), SLOW), output_offset=0.2, delay=2),
    "wiener": Cascade((SLOW, CubicSpline(KNOTS, np.tanh(KNOTS)))),
    "wiener-hammerstein": Cascade((FAST, Polynomial(np.array([0.1, 1.0, 0.2, -0.1]), -3, 3), SLOW)),
    "wiener-hammerstein-spline": Cascade((FAST, CubicSpline(KNOTS, np.tanh(KNOTS)), SLOW)),
    "with a sign lost": Cascade((FAST, Abs(), SLOW), input_offset=0.1, output_offset=-0.3),
    "hammerstein-wiener": Cascade(
        (PiecewiseLinear(KNOTS, KNOTS + 0.1 * KNOTS**2), SLOW, Saturation(1.0, -0.6, 0.5)), output_offset=0.1
    ),
    "with friction": Cascade((FAST, CoulombLinear(0.3, 1.0, width=0.2), SLOW), input_offset=0.2),
    "of five blocks": Cascade((FAST, DeadZone(-0.3, 0.3), SLOW, Saturation(1.0, -1.0, 1.0), fir([0.5, 0.5], delay=1))),
    "oversampled": Cascade((FAST, CubicSpline(KNOTS, np.tanh(KNOTS)), SLOW), oversampling=3, delay=1),
    "user's": Cascade((FAST, UserMap(lambda x, p: x**3, lambda x, p: 3 * x**2), SLOW)),
}


def excitation(samples: int, seed: int = 0, size: float = 1.5) -> Array:
    return size * np.random.default_rng(seed).standard_normal(samples)


def record_of(model: Cascade, samples: int, noise: float = 0.0, seed: int = 0, size: float = 1.5) -> Record:
    u = excitation(samples, seed, size)
    y = model.output(u, model.resting(float(u[0])))
    spread = noise * float(np.std(y))
    return Record(u, y + spread * np.random.default_rng(seed + 1000).standard_normal(samples), 1e-3)


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


@pytest.mark.parametrize("name", [n for n in CASCADES if n not in ("user's", "oversampled")])
def test_known_blocks_are_recovered_from_a_start_nearby(name: str) -> None:
    truth = unit_gain(CASCADES[name])
    record = record_of(truth, 1500)
    coordinates = freedom(truth)
    off = truth.parameters[coordinates.free] * (
        1 + 0.03 * np.random.default_rng(3).uniform(-1, 1, len(coordinates.free))
    )
    fit = fit_cascade(truth.with_parameters(coordinates.parameters(off)), record, tolerance=1e-6, max_iterations=100)
    assert fit.ending is Ending.CONVERGED, fit.findings
    np.testing.assert_allclose(fit.model.parameters, truth.parameters, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("samples", [2 * INTERPOLATION_REACH + 1, 200])
@pytest.mark.parametrize("factor", [2, 3, 7])
def test_interpolation_is_that_of_a_polyphase_filter(samples: int, factor: int) -> None:
    u = np.random.default_rng(factor).standard_normal(samples)
    ends = INTERPOLATION_REACH * factor
    window = firwin(2 * ends + 1, 1 / factor, window=("kaiser", 9.0))
    assert between(u, factor) == pytest.approx(resample_poly(u, factor, 1, window=window)[ends:-ends], abs=1e-13)


def test_an_oversampled_cascade_is_recovered_where_the_input_excites_it() -> None:
    truth = unit_gain(CASCADES["oversampled"])
    record = record_of(truth, 1500)
    coordinates = freedom(truth)
    off = truth.parameters[coordinates.free] * 1.02
    fit = fit_cascade(truth.with_parameters(coordinates.parameters(off)), record, max_iterations=100)
    assert np.sqrt(fit.noise_variance) < 1e-6 * np.std(record.output)


def test_several_segments_with_unknown_starts() -> None:
    truth = unit_gain(CASCADES["wiener-hammerstein"])
    whole = record_of(truth, 3000)
    gone = np.zeros(3000, dtype=bool)
    gone[700:760] = gone[1500:1510] = True
    fit = fit_cascade(truth, [whole.mask(gone)], tolerance=1e-6)
    np.testing.assert_allclose(fit.model.parameters, truth.parameters, rtol=1e-6, atol=1e-8)
    assert fit.samples == 2930
    skipping = fit_cascade(truth, whole.mask(gone), transient=120, tolerance=1e-6)
    assert skipping.samples == 2930 - 3 * 120
    np.testing.assert_allclose(skipping.model.parameters, truth.parameters, rtol=1e-4, atol=1e-6)


def test_a_fixed_parameter_stays_and_a_robust_loss_ignores_outliers() -> None:
    truth = unit_gain(CASCADES["hammerstein"])
    clean = record_of(truth, 2000, noise=0.01)
    fit = fit_cascade(truth, clean, fixed=["f.b_r"])
    assert "f.b_r" not in fit.names
    assert fit.model.blocks[0].b_r == truth.blocks[0].b_r  # type: ignore[attr-defined]
    spoiled = clean.output.copy()
    spoiled[::50] += 20.0
    robust = fit_cascade(truth, replace(clean, output=spoiled), loss=Huber(0.01))
    np.testing.assert_allclose(robust.model.parameters, truth.parameters, rtol=0.05, atol=0.01)
    with pytest.raises(ModelError, match=r"no parameter 'f\.x'"):
        fit_cascade(truth, clean, fixed=["f.x"])


def test_dead_zone_edges_are_within_their_intervals() -> None:
    truth = unit_gain(Cascade((fir([1.0]), DeadZone(-0.5, 0.4, 1.0, 1.0), SLOW)))
    record = record_of(truth, 4000, noise=0.01)
    start = replace(truth, blocks=(truth.blocks[0], DeadZone(-0.3, 0.2, 1.3, 0.9), truth.blocks[2]))
    fit = fit_cascade(start, record)
    interval = dict(zip(fit.names, fit.interval(0.999), strict=True))
    for name, value in (("f.b_l", -0.5), ("f.b_r", 0.4)):
        assert fit.estimate[fit.names.index(name)] == pytest.approx(value, rel=0.02)
        assert interval[name][0] < value < interval[name][1]


def test_a_corner_between_two_slopes_is_within_its_intervals() -> None:
    truth, inside = unit_gain(Cascade((FAST, TwoSlopes(0.1, 0.2, 1.0), SLOW))), []
    for seed in range(20):
        start = replace(truth, blocks=(FAST, TwoSlopes(-0.2, 0.5, 0.9), SLOW))
        fit = fit_cascade(start, record_of(truth, 1000, noise=0.01, seed=seed))
        assert fit.ending is Ending.CONVERGED
        values = dict(zip(truth.names, truth.parameters, strict=True))
        ends = zip(fit.names, fit.interval(0.95), strict=True)
        inside += [low < values[name] < high for name, (low, high) in ends if name.startswith("f.")]
    assert np.mean(inside) > 0.88  # 60 intervals of 95 %, two standard errors below


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name.startswith("smooth map") else name for name in COVERED]
)
def test_intervals_cover_the_truth(name: str) -> None:
    """The short form of ``tests/coverage_cascade.py``: 20 data sets, and half as many where it takes more samples."""
    case = COVERED[name]
    shares = case.coverage(20 if case.system is case.model else 10)
    assert 0.89 <= np.mean(list(shares.values())) <= 0.995
    assert min(shares.values()) >= 0.7


@pytest.mark.parametrize(
    "name", ["wiener-hammerstein-spline", "hammerstein-wiener", "with a sign lost", "with friction"]
)
def test_scipy_finds_the_same_minimum(name: str) -> None:
    truth = unit_gain(CASCADES[name])
    records = [record_of(truth, samples, noise=0.02, seed=samples) for samples in (600, 400)]
    minimum, problem = search(truth, records, tolerance=1e-8, max_iterations=100)
    penalty = minimum.penalty  # on the roughness of splines, with the weight that was chosen

    def residuals(theta: Array) -> Array:
        try:
            return np.concatenate([*problem.residuals(theta), penalty.value(theta)])
        except Infeasible:
            return np.full(minimum.samples + len(penalty.rows), 1e3)

    def derivative(theta: Array) -> Array:
        return np.concatenate([*(jacobian for _, jacobian in problem.linearised(theta)), penalty.rows])

    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    found = least_squares(residuals, problem.start, jac=derivative, x_scale="jac", **tight)
    assert minimum.cost + penalty.cost(minimum.estimate) == pytest.approx(found.cost, rel=1e-12)
    own = len(problem.freedom.free)
    np.testing.assert_allclose(minimum.estimate[:own], found.x[:own], rtol=1e-6, atol=1e-7)


def test_band_of_the_static_map() -> None:
    truth = unit_gain(CASCADES["wiener-hammerstein-spline"])
    fit = fit_cascade(truth, record_of(truth, 3000, noise=0.02))
    x = np.linspace(-1.5, 1.5, 30)
    band = static_band(fit, 1, x)
    assert np.all(band[:, 1] > 0)
    assert np.mean(np.abs(band[:, 0] - truth.blocks[1].value(x)) < 3 * band[:, 1]) > 0.9  # type: ignore[attr-defined]
    with pytest.raises(ModelError, match="is a filter"):
        static_band(fit, 0, x)
    with pytest.raises(ModelError, match="no block 3"):
        static_band(fit, 3, x)


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


def test_interruption_keeps_the_best_so_far() -> None:
    truth = unit_gain(CASCADES["wiener-hammerstein"])

    start = truth.with_parameters(freedom(truth).parameters(truth.parameters[freedom(truth).free] * 1.05))
    fit = fit_cascade(start, record_of(truth, 600, noise=0.05), control=Control(cancelled=lambda: True))
    assert fit.ending is Ending.INTERRUPTED
    assert [(f.code, f.data["steps"]) for f in fit.findings] == [("search-cancelled", 0)]


def test_what_the_records_do_not_determine_is_reported_once() -> None:
    truth = Cascade((FAST, DeadZone(-0.2, 0.2), SLOW))
    record = record_of(truth, 600, noise=0.01)
    fit = fit_cascade(replace(truth, blocks=(FAST, DeadZone(-0.2, 50.0), SLOW)), record, max_iterations=100)
    assert fit.ending is Ending.RANK_DEFICIENT
    (finding,) = fit.findings
    assert finding.code == "parameters-undetermined"
    assert finding.data["without_effect"] == ["f.b_r", "f.m_r"]
    assert {name for group in finding.data["inseparable"] for name in group} <= {*fit.names, "starting states"}
    lost = {name for name, error in zip(fit.names, fit.standard_error, strict=True) if not np.isfinite(error)}
    assert lost >= {"f.b_r", "f.m_r"}
    assert [(f.code, f.data["block"], f.data["side"]) for f in advice(fit, record)] == [
        ("dead-zone-side-unseen", 2, "right")
    ]


def test_bad_input() -> None:
    model = CASCADES["wiener-hammerstein"]
    record = record_of(model, 300)
    with pytest.raises(ModelError, match="no segment is longer"):
        fit_cascade(model, record[:10])
    with pytest.raises(ModelError, match="no segment is longer"):
        model.simulate(record[:10])
    with pytest.raises(ModelError, match="one input and record 2; choose one of u1, u2"):
        fit_cascade(model, replace(record, input=np.ones((300, 2)), input_names=(), input_units=()))
    with pytest.raises(Infeasible, match=r"block 1: unstable filter: a pole of size 1\.2"):
        fit_cascade(Cascade((Rational([1.0], [-1.2]), DeadZone(-1, 1), SLOW)), record)
    with pytest.raises(ModelError, match="at least one block"):
        Cascade(())
    with pytest.raises(ModelError, match="oversampling 0"):
        Cascade((SLOW,), oversampling=0)
    with pytest.raises(ModelError, match="look ahead"):
        Cascade((SLOW,), delay=-1)
    with pytest.raises(ModelError, match="finite"):
        Cascade((SLOW,), output_offset=np.nan)
    with pytest.raises(ModelError, match=r"delay 1\.5.* whole number"):
        Cascade((SLOW,), delay=1.5)  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="block 2: 3 is no filter and no static map"):
        Cascade((SLOW, 3))  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="block 1: all its numerator coefficients are zero"):
        fit_cascade(Cascade((fir([0.0, 0.0]), DeadZone(-1, 1), SLOW)), record)
    with pytest.raises(Infeasible, match="block 2: saturation from 1 to -1"):
        fit_cascade(Cascade((FAST, Saturation(1.0, 1.0, -1.0), SLOW)), record)
    with pytest.raises(ModelError, match="transient -1"):
        fit_cascade(model, record, transient=-1)
    nowhere = UserMap(lambda x, p: np.where(x < 1, x, np.nan), lambda x, p: np.ones_like(x))
    with pytest.raises(ModelError, match=r"block 2: at an input of 1.* its output is nan"):
        fit_cascade(Cascade((FAST, nowhere, SLOW)), record)
    with pytest.raises(ModelError, match="not a cascade"):
        Cascade.from_data({"blocks": []})
    wrong = UserMap(lambda x, p: np.ones(7), lambda x, p: x)
    with pytest.raises(ModelError, match=r"returned shape \(7,\) instead of \(300,\)"):
        fit_cascade(Cascade((FAST, wrong, SLOW)), record)


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
        states = model.starting(u[first:], y[first : first + model.memory])
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
        states = model.starting(u[first:], y[first : first + model.memory])
        error = (model.output(u[first:], states) - clean[first:])[model.memory :][:30]
        assert np.sqrt(np.mean(error**2)) < noise / 4


@pytest.mark.parametrize("name", CASCADES)
def test_several_starts_at_once_are_those_one_by_one(name: str) -> None:
    cascade, u = CASCADES[name], excitation(50)
    states = np.random.default_rng(3).standard_normal((3, cascade.states))
    np.testing.assert_array_equal(cascade.outputs(u, states), [cascade.output(u, each) for each in states])


def test_of_every_pair_of_orders_one_start_is_refined_and_none_twice() -> None:
    def start(first: int, second: int, pole: float) -> Cascade:
        filters = [Rational(np.eye(order + 1)[0], pole * np.eye(order)[0]) for order in (first, second)]
        return Cascade((filters[0], Saturation(1.0, -1.0, 1.0), filters[1]))

    starts = [start(4, 2, 0.1 * (k // 2)) for k in range(8)] + [start(3, 4, 0.1), start(3, 3, 0.1), start(3, 3, 0.2)]
    assert refined_first(starts) == [starts[0], starts[8], starts[9], *starts[2:8:2]]


def test_of_many_starts_those_that_are_far_after_a_few_steps_are_given_up() -> None:
    true = Cascade((Rational(np.array([0.0, 0.5]), np.array([-0.5])),))
    record = record_of(true, 100)
    stuck = Cascade((Rational(np.array([1.0]), np.zeros(0)),))  # without the pole no search comes near
    starts = [stuck, *[true.with_parameters((0.9 + 0.01 * k) * true.parameters) for k in range(FINISHED)]]
    left = promising([Plan(each) for each in starts], [record], {}, 1, Control())
    assert len(left) == FINISHED
    assert all(len(plan.model.parameters) == len(true.parameters) for plan in left)
    (alone,) = promising([Plan(stuck)], [record[:1]], {}, 1, Control())  # too short for any search
    assert alone.model is stuck


def test_without_splits_the_best_choice_of_every_kind_is_left_and_none_is_run_on_unseen_data() -> None:
    true = Cascade((Rational(np.array([0.0, 0.5]), np.array([-0.5])),))
    record, gain = record_of(true, 100), Cascade((Rational(np.array([1.0]), np.zeros(0)),))
    starts = [gain, *[true.with_parameters(part * true.parameters) for part in (0.9, 1.1)]]
    first, second = refined([Plan(each) for each in starts], [record], (), 1, Control())
    assert [len(each.model.parameters) for each in (first, second)] == [len(true.parameters), len(gain.parameters)]
    assert first.known < second.known
    assert first.error == second.error == np.inf


def test_the_trial_splines_of_a_short_record_are_not_cross_validated(monkeypatch: pytest.MonkeyPatch) -> None:
    compared = []

    def unseen(model: Cascade, *others: Any) -> Any:
        compared.append(next(len(block.knots) for block in model.blocks if isinstance(block, CubicSpline)))
        return unseen_errors(model, *others)

    monkeypatch.setattr("emsid.models.blocks.search.refinement.unseen_errors", unseen)
    record = record_of(CASCADES["wiener-hammerstein"], 300, noise=0.01)
    wiener_hammerstein((1, 1), static="spline", oversampling=1).fit(record)
    assert compared
    assert TRIAL_KNOTS not in compared


def test_a_search_that_ends_where_it_saves_little_is_not_begun_again(monkeypatch: pytest.MonkeyPatch) -> None:
    true = CASCADES["wiener-hammerstein"]
    record, start = record_of(true, 400, noise=0.1), true.with_parameters(0.6 * true.parameters)
    again: list[Minimum] = []

    def begun_again(minimum: Minimum, *_: object) -> Minimum:
        again.append(minimum)
        return minimum

    monkeypatch.setattr("emsid.models.blocks.fitting.begun_again", begun_again)
    few, _ = search(start, record, least_saving=1.0, restarts=True)
    assert (few.ending, few.iterations, again) == (Ending.OUT_OF_BUDGET, PATIENCE, [])
    same, _ = search(start, record, max_iterations=PATIENCE, restarts=True)
    assert again == [same]


def test_a_model_that_is_hopeless_on_the_first_split_is_not_fitted_to_the_others() -> None:
    true = Cascade((Rational(np.array([0.0, 0.5]), np.array([-0.5])),))
    record = record_of(true, 400)
    splits = [Round([record[200:]], [record[:200]], [0]), Round([record[:200]], [record[200:]], [0])]
    start = true.with_parameters(0.9 * true.parameters)
    assert unseen_errors(start, splits, Control(), None).mean < 1e-9  # fitted again to each
    rival = StretchErrors.of(np.full(400, 1e-30))
    with pytest.raises(ModelError, match="much larger"):
        unseen_errors(start, [splits[0], Round([], [], [])], Control(), rival)


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
