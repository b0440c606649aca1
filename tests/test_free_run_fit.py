"""Regressions fitted to the free run: exact derivatives, no bias by noise, intervals that hold, selected terms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

import emsid
from emsid import ModelError, Record, RegressionModel, Structure, arx
from emsid.estimation.fit import Ending
from emsid.estimation.linear.information import Information
from emsid.identification.candidates import usual_for
from emsid.identification.regressions import REGRESSIONS
from emsid.models.extrapolation import MUCH_BETTER, Extremes, diverges, diverges_held
from emsid.models.regression import free_run_fit
from emsid.models.regression.free_run_fit import FreeRunError, Widened, fit_free_run
from emsid.models.regression.search import cross_validation
from emsid.models.regression.search.cross_validation import CrossValidation, fit_to_compare
from emsid.models.regression.search.terms import Trial, as_good, of_the_rest, prune, select_by_free_run
from emsid.models.regression.structures import friction_narx, input_knots, polynomial_narx
from emsid.models.regression.term_selection import forward_selection
from emsid.models.regression.transforms import Transform, slope, transformed
from emsid.selection.improvement import StretchErrors
from independent.cases import motor
from independent.regressions import derivative_of

Array = NDArray[np.float64]

BILINEAR = Structure.parse(
    "y(t-1)", "-y(t-2)", "y(t-1)^3", "y(t-1)^2*y(t-2)", "y(t-1)*u(t-1)", "u(t)", "-u(t-1)*u(t-2)^2", "1"
)
TRUTH = np.array([1.2, 0.5, -0.1, 0.05, 0.1, 0.3, 0.2, 0.05])


def measured(structure: Structure, theta: Array, samples: int, noise: float, seed: int = 0) -> Record:
    """The free run of a structure for a random input, with white noise on the output."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, structure.inputs or 1))
    run = RegressionModel(structure, theta, 0.1).simulate(u).output
    return Record(u, run + noise * rng.standard_normal(run.shape), 0.1)


# --- derivative ------------------------------------------------------------------------------------------------------


def test_the_derivative_of_a_free_run_is_its_definition() -> None:
    record = measured(BILINEAR, TRUTH, 120, 0.1)
    residual, derivative = FreeRunError(BILINEAR, [record], 3).linearised(TRUTH)[0]
    run = record.output[:, 0].copy()
    run[3:] += residual
    expected = derivative_of(BILINEAR.regressors, TRUTH, run, record.input.T, 3)
    np.testing.assert_allclose(derivative.T, expected[:, 3:], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run, RegressionModel(BILINEAR, TRUTH, 0.1).simulate(record, 3).output[:, 0], rtol=1e-12)


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_the_derivative_of_transforms_and_shares_is_that_of_differences(share: float) -> None:
    structure = Structure.parse(
        "y(t-1)", "tanh(y(t-1)/0.4)*u(t)", "max(y(t-2)-0.1, 0)^2", "-abs(y(t-2))", "exp(-abs(y(t-1))/0.7)", "u2(t-1)"
    )
    theta = np.array([0.5, 0.2, 0.1, 0.1, 0.3, 1.0])
    problem = FreeRunError(structure, [measured(structure, theta, 100, 0.2, 3)], 2, share)
    derivative = problem.linearised(theta)[0][1]
    for k in range(len(theta)):
        step = np.zeros(len(theta))
        step[k] = 1e-6
        ends = [problem.residuals(theta + sign * step)[0] for sign in (1, -1)]
        np.testing.assert_allclose(derivative[:, k], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("transform", Transform)
def test_the_slope_of_every_transform_is_that_of_its_definition(transform: Transform) -> None:
    for x in (-0.9, -0.2, 0.15, 1.1):
        difference = (transform.definition(x + 1e-6, 0.3) - transform.definition(x - 1e-6, 0.3)) / 2e-6
        assert slope.py_func(int(transform), x, 0.3) == pytest.approx(difference, abs=1e-6)
        assert transformed.py_func(int(transform), x, 0.3) == pytest.approx(transform.definition(x, 0.3))


def test_a_share_of_zero_is_the_one_step_prediction() -> None:
    record = measured(BILINEAR, TRUTH, 60, 0.1)
    residual = FreeRunError(BILINEAR, [record], 2, share=0.0).residuals(TRUTH)[0]
    ahead = RegressionModel(BILINEAR, TRUTH, 0.1).predict(record).output[2:, 0]
    np.testing.assert_allclose(residual, ahead - record.output[2:, 0], atol=1e-12)


# --- friction by a sign, whose free run jumps -------------------------------------------------------------------------

DRY = Structure.parse("y(t-1)", "u(t-1)", "-sign(y(t-1))", name="dry friction")
DRY_TRUTH = np.array([0.9, 0.5, 0.1])


def dry_friction(seed: int) -> Record:
    """A drive with dry friction that is a fifth of the largest drive, with white noise on the output."""
    rng = np.random.default_rng([13, seed])
    u, y = np.repeat(rng.uniform(-1, 1, 80), 10), np.zeros(800)
    for t in range(1, len(u)):
        y[t] = DRY_TRUTH @ [y[t - 1], u[t - 1], -np.sign(y[t - 1])]
    return Record(u, y + 0.1 * rng.standard_normal(len(u)), 0.01)


def test_wide_differences_contain_the_moves_of_signs_and_are_exact_without_any() -> None:
    record = measured(BILINEAR, TRUTH, 120, 0.0)
    smooth = FreeRunError(BILINEAR, [record], 3)
    theta = TRUTH * (1 + 1e-5)
    for (residual, wide), (same, exact) in zip(
        Widened(smooth, 1.0).linearised(theta), smooth.linearised(theta), strict=True
    ):
        np.testing.assert_array_equal(residual, same)
        np.testing.assert_allclose(wide, exact, rtol=1e-3, atol=1e-3 * np.abs(exact).max())
    jumps = FreeRunError(DRY, [dry_friction(0)], 1)
    (residual, exact), (_, wide) = jumps.linearised(DRY_TRUTH)[0], Widened(jumps, 2.0).linearised(DRY_TRUTH)[0]
    _, sizes, axes = np.linalg.svd(exact, full_matrices=False)
    reach = 2.0 * np.sqrt(np.mean(residual**2))
    for size, axis in zip(sizes, axes, strict=True):
        ahead, behind = (jumps.residuals(DRY_TRUTH + side * reach / size * axis)[0] for side in (1, -1))
        np.testing.assert_allclose(wide @ axis, (ahead - behind) * size / (2 * reach), rtol=1e-9, atol=1e-9)
    assert np.abs(wide - exact).max() > 0.1 * np.abs(exact).max()


def test_a_search_over_signs_passes_the_minima_between_their_changes() -> None:
    """By the exact derivative alone, most searches end at a larger cost than that of the true parameters."""
    reached = {True: 0, False: 0}
    for seed in range(8):
        record = dry_friction(seed)
        problem = FreeRunError(DRY, [record], 1, states=True)
        of_truth = np.sum(problem.residuals(problem.with_states(DRY_TRUTH))[0] ** 2)
        for wide in reached:
            found = fit_free_run(DRY, record, restarts=wide)
            reached[wide] += found.noise_variance * (found.samples - len(DRY) - 1) <= of_truth
    assert reached[True] >= 6
    assert reached[False] <= 4


@pytest.mark.long
def test_the_intervals_of_dry_friction_contain_the_truth() -> None:
    """0.85 of 100 without wide differences; 150 records, at 2.6 standard deviations below 95 %."""
    fits = [fit_free_run(DRY, dry_friction(1000 + k), restarts=True) for k in range(150)]
    inside = [np.abs(fit.estimate - DRY_TRUTH) < 1.96 * fit.standard_error for fit in fits]
    assert np.mean(inside, axis=0).min() > 0.904


FRICTION = friction_narx(1, 1, knots=(-0.5, 0.5))
FRICTION_TRUTH = np.array([-0.9, 0.0, 0.5, 0.5, 0.1, 0.05])


def dead_zone_and_friction(seed: int) -> Record:
    """A drive with a dead zone and dry friction, a coloured input, and white noise of 5 % on the output."""
    rng = np.random.default_rng([23, seed])
    u, y = 3 * lfilter([0.3], [1, -0.7], rng.standard_normal(600)), np.zeros(600)
    for t in range(1, len(u)):
        drive = 0.5 * (max(u[t - 1] - 0.5, 0.0) + min(u[t - 1] + 0.5, 0.0))
        y[t] = 0.9 * y[t - 1] + drive + 0.05 - 0.1 * np.sign(y[t - 1])
    return Record(u, y + 0.05 * np.std(y) * rng.standard_normal(600), 0.01)


def test_searches_over_signs_of_a_friction_model_end_at_minima() -> None:
    """With the exact derivative around its end, two in three searches stall."""
    fits = [fit_free_run(FRICTION, dead_zone_and_friction(seed), restarts=True) for seed in range(6)]
    assert {fit.ending for fit in fits} == {Ending.CONVERGED}
    assert np.isfinite([fit.standard_error for fit in fits]).all()


@pytest.mark.long
def test_the_intervals_of_a_friction_model_contain_the_truth() -> None:
    """0.96 to 1.0 of 150 records; the least is 2.6 standard deviations below 95 %."""
    fits = [fit_free_run(FRICTION, dead_zone_and_friction(1000 + k), restarts=True) for k in range(150)]
    inside = [np.abs(fit.estimate - FRICTION_TRUTH) < 1.96 * fit.standard_error for fit in fits]
    assert np.mean([fit.ending is Ending.CONVERGED for fit in fits]) > 0.95
    assert np.mean(inside, axis=0).min() > 0.904


@pytest.mark.parametrize(("motors", "most"), [(2, 0), pytest.param(10, 1, marks=pytest.mark.long)])
def test_friction_models_of_simulated_motors_have_intervals(motors: int, most: int) -> None:
    """Also where the model lacks something and the residual is coloured; by exact derivatives 4 of 10 stall."""
    free_run = REGRESSIONS["friction-narx-free-run"]
    fits = [free_run(motor(seed, 1000).fitted, emsid.Options()) for seed in range(motors)]
    assert sum(fit.ending is Ending.STALLED for fit in fits) <= most


def test_a_search_that_stalls_far_from_its_minimum_has_no_intervals() -> None:
    """As for cascades and plants: the covariance of the place where it stalled says nothing of the distance."""
    fit = fit_free_run(friction_narx(1, 1, knots=(), nk=1), motor(6, 1500).fitted)
    (stalled,) = (finding for finding in fit.findings if finding.code == "search-stalled")
    assert stalled.data["offset"] > 0.3
    assert not fit.has_intervals


def test_wide_differences_leave_out_runs_that_diverge() -> None:
    """Beside a model at the limit of stability, a run overflows on one side, and its difference is no derivative."""
    u = np.r_[np.ones(8), np.zeros(292)]
    structure, theta = Structure.parse("y(t-1)", "u(t-1)", "-sign(y(t-1))"), np.array([1.0, 1.0, 0.01])
    record = Record(u, 5 * np.random.default_rng(0).standard_normal(300), 0.1)
    problem = FreeRunError(structure, [record], 1)
    (_, exact), (_, wide) = problem.linearised(theta)[0], Widened(problem, 500.0).linearised(theta)[0]
    assert np.abs(wide).max() < 10 * np.abs(exact).max()


# --- fit -------------------------------------------------------------------------------------------------------------


def second_order(noise: float, samples: int = 3000, seed: int = 0) -> Record:
    """y = 0.05q⁻¹/(1 − 1.9q⁻¹ + 0.93q⁻²) u with white noise on the output: a slow, lightly damped system."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(samples)
    y = lfilter([0.0, 0.05], [1.0, -1.9, 0.93], u)
    return Record(u, y + noise * rng.standard_normal(samples), 0.1)


def test_output_noise_biases_least_squares_and_not_the_free_run() -> None:
    record, truth = second_order(0.1), np.array([-1.9, 0.93, 0.05])
    least, free = emsid.fit(arx(2, 1), record), emsid.fit(arx(2, 1), record, free_run=True)
    assert abs(least.estimate - truth)[0] > 0.1
    assert free.ending is Ending.CONVERGED
    assert (abs(free.estimate - truth) < 4 * free.standard_error).all()
    assert free.noise_variance == pytest.approx(0.01, rel=0.1)


def test_intervals_of_a_free_run_hold() -> None:
    truth = np.array([-1.9, 0.93, 0.05])
    inside = [
        (np.abs(fit.estimate - truth) < 1.96 * fit.standard_error).all(axis=0).mean()
        for fit in (emsid.fit(arx(2, 1), second_order(0.1, 1000, seed), free_run=True) for seed in range(40))
    ]
    assert np.mean(inside) > 0.8  # all three at once, at a nominal level of 0.95 for each


def test_a_fit_to_the_free_run_recovers_a_nonlinear_structure() -> None:
    record = measured(BILINEAR, TRUTH, 1500, 0.05)
    fit = emsid.fit(BILINEAR, record, free_run=True)
    assert (abs(fit.estimate - TRUTH) < 4 * fit.standard_error).all()
    exact = emsid.fit(BILINEAR, replace(record, output=measured(BILINEAR, TRUTH, 1500, 0.0).output), free_run=True)
    np.testing.assert_allclose(exact.estimate, TRUTH, atol=1e-8)


def test_records_and_segments_are_run_on_their_own() -> None:
    one, two = measured(BILINEAR, TRUTH, 300, 0.02, 1), measured(BILINEAR, TRUTH, 400, 0.02, 2)
    apart = emsid.fit(BILINEAR, [one, two], free_run=True)
    joined = emsid.fit(BILINEAR, emsid.concatenate([one, two]), free_run=True)
    np.testing.assert_allclose(apart.estimate, joined.estimate, rtol=1e-10)
    assert apart.samples == 300 + 400
    later = emsid.fit(BILINEAR, one, free_run=True, transient=50)
    assert later.samples == 252  # with the two outputs that it starts from


def test_a_least_squares_estimate_that_diverges_is_still_a_start() -> None:
    record = second_order(0.02, 800)
    fit = emsid.fit(arx(2, 1), record, free_run=True, start=[-2.02, 1.03, 0.04])  # unstable
    np.testing.assert_allclose(fit.estimate, [-1.9, 0.93, 0.05], atol=0.02)


@pytest.mark.parametrize("how", [{"free_run": True}, {"instruments": True}])
@pytest.mark.parametrize(
    ("start", "message"),
    [([1.0], "1 start values for 3 parameters"), ([[1.0] * 3], "give one dimension"), ([np.nan] * 3, "finite numbers")],
)
def test_start_values_are_as_many_as_parameters(how: dict[str, bool], start: list[float], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        emsid.fit(arx(2, 1), second_order(0.02, 100), start=start, **how)


def test_the_start_of_a_run_is_estimated_from_several_outputs() -> None:
    truth = np.array([-1.96, 0.9604, 0.002])  # slow: the difference of two noisy outputs is no slope
    measured_start, estimated = RegressionModel(arx(2, 1), truth, 0.1), RegressionModel(arx(2, 1), truth, 0.1, start=30)
    errors = np.zeros(2)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal(200)
        y = lfilter([0.0, 0.002], [1.0, -1.96, 0.9604], u)
        record = Record(u, y + 0.02 * rng.standard_normal(200), 0.1)
        for k, model in enumerate((measured_start, estimated)):
            errors[k] += np.mean((model.simulate(record, 30).output[30:, 0] - y[30:]) ** 2)
    assert errors[1] < errors[0] / 4
    assert (measured_start.memory, estimated.memory) == (2, 30)
    assert RegressionModel.from_data(estimated.to_data()).start == 30
    assert emsid.fit(arx(2, 1), record, free_run=True).model.start == 16


def test_options_that_contradict_each_other_are_refused() -> None:
    record = second_order(0.1, 200)
    with pytest.raises(ModelError, match="exclude each other"):
        emsid.fit(arx(2, 1), record, free_run=True, ridge=1.0)
    with pytest.raises(ModelError, match="free_run=True"):
        emsid.fit(arx(2, 1), record, transient=10)
    with pytest.raises(ModelError, match="no segment is longer"):
        emsid.fit(arx(2, 1), record, free_run=True, transient=200)


# --- selection of terms ----------------------------------------------------------------------------------------------


def test_forward_selection_on_the_factor_is_that_on_the_rows() -> None:
    rng = np.random.default_rng(0)
    phi = rng.standard_normal((200, 8)) @ rng.standard_normal((8, 8))
    y = phi[:, 5] - 0.5 * phi[:, 2] + 0.1 * rng.standard_normal(200)
    found = forward_selection(Information.from_rows(phi, y), 4)
    chosen: list[int] = []
    for k in range(4):  # by definition: the column that leaves the smallest sum of squares
        left = [np.linalg.lstsq(phi[:, [*chosen, j]], y, rcond=None)[1][0] if j not in chosen else np.inf
                for j in range(8)]  # fmt: skip
        chosen.append(int(np.argmin(left)))
        assert 1 - found.error_reduction[: k + 1].sum() == pytest.approx(min(left) / (y @ y))
    assert list(found.order) == chosen
    assert forward_selection(Information.from_rows(phi, y), 3, first=(7,)).order[0] == 7


def test_columns_that_depend_on_others_are_never_chosen() -> None:
    rng = np.random.default_rng(0)
    phi = rng.standard_normal((50, 3))
    both = np.column_stack([phi, phi[:, 0] + phi[:, 1], np.zeros(50)])
    assert len(forward_selection(Information.from_rows(both, rng.standard_normal(50)), 5).order) == 3


def test_a_dictionary_has_every_product_once() -> None:
    dictionary = polynomial_narx(2, 2, 3)
    assert len(dictionary) == 35
    assert dictionary.labels[:5] == ("y(t-1)", "y(t-2)", "u(t-1)", "u(t-2)", "1")
    assert "y(t-1)*y(t-2)*u(t-2)" in dictionary.labels
    assert len(polynomial_narx(2, 2, 2, inputs=2, constant=False)) == 27


def test_terms_are_selected_by_the_free_run() -> None:
    structure = Structure.parse("y(t-1)", "y(t-2)", "u(t-1)", "y(t-1)^3", "y(t-1)*u(t-1)^2")
    record = measured(structure, np.array([1.5, -0.7, 0.3, -0.05, 0.04]), 1200, 0.05)
    validation = CrossValidation.of(record, 0.25, 2)
    start = emsid.fit(Structure.parse("y(t-1)", "y(t-2)", "u(t-1)", "1"), record, free_run=True)
    found = select_by_free_run(start, polynomial_narx(2, 1, 3), validation)
    assert set(found.fit.model.structure.labels) == set(structure.labels)
    assert found.fit.names == found.fit.model.structure.labels
    assert found.errors.mean == pytest.approx(0.0025, rel=0.15)


def test_a_model_that_diverges_beyond_the_range_is_not_chosen() -> None:
    structure = Structure.parse("y(t-1)", "u(t-1)", "y(t-1)^3")
    model = RegressionModel(structure, np.array([0.5, 0.5, 0.1]), 0.1)  # no steady state for u above 0.86
    u = np.full(60, 0.8)
    record = Record(np.concatenate([-u, u]), model.simulate(np.concatenate([-u, u])).output, 0.1)
    assert not diverges(model, record)
    assert diverges(model, Extremes(record).larger)
    validation = CrossValidation.of(record, 0.25, 1)
    assert validation.errors(structure, lambda *_: model).mean == np.inf


def test_a_model_that_diverges_while_an_extreme_input_is_held_is_not_chosen() -> None:
    structure = Structure.parse("y(t-1)", "u(t-1)", "y(t-1)^3")
    model = RegressionModel(structure, np.array([0.5, 0.5, 0.1]), 0.1)
    u = np.tile([0.9, -0.9], 100)  # with no steady state for u = 0.9
    record = Record(u, model.simulate(u).output, 0.1)
    assert not diverges(model, Extremes(record).larger)
    validation = CrossValidation.of(record, 0.25, 1)
    assert validation.errors(structure, lambda *_: model).mean == np.inf
    stable = RegressionModel(structure, np.array([0.5, 0.5, 0.05]), 0.1)
    assert np.isfinite(validation.errors(structure, lambda *_: stable).mean)


def softening(u: Array) -> Array:
    """y(t) of an oscillator whose spring softens: it has no steady state for constant u above 0.66."""
    return RegressionModel(SOFTENING, SOFTENING_TRUTH, 0.01).simulate(u).output[:, 0]


SOFTENING = Structure.parse("y(t-1)", "y(t-2)", "u(t-1)", "y(t-1)^3")
SOFTENING_TRUTH = np.array([1.4, -0.55, 0.15, 0.12])


def softened(seed: int, size: float, samples: int = 800) -> tuple[Record, float]:
    """Its record for coloured noise of a largest value ``size``, with 1 % noise, and the noise."""
    rng = np.random.default_rng([31, seed])
    u = lfilter([1], [1, -0.7], rng.standard_normal(samples))
    u *= size / np.abs(u).max()
    assert np.abs(softening(1.2 * u)).max() < 1  # stable
    y = softening(u)
    return Record(u, y + 0.01 * np.std(y) * rng.standard_normal(samples), 0.01), 0.01 * float(np.std(y))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
def test_a_system_that_diverges_only_on_a_constant_extreme_is_found(seed: int) -> None:
    record, noise = softened(seed, 0.66)
    assert diverges_held(RegressionModel(SOFTENING, SOFTENING_TRUTH, 0.01), Extremes(record))
    fit = REGRESSIONS["polynomial-narx"](record, emsid.Options())
    other, _ = softened(seed + 10, 0.66)
    error = fit.model.simulate(other.input).output[:, 0] - softening(other.input)
    assert np.sqrt(np.mean(error[50:] ** 2)) < 0.2 * noise  # 2 to 4 times the noise if it is refused


def test_what_diverges_on_a_constant_extreme_must_be_much_better_and_stable_backwards(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record, _ = softened(0, 0.66)
    wary = replace(CrossValidation.of(record, 0.25, 2), wary=True)
    bounded = RegressionModel(SOFTENING, np.array([1.4, -0.55, 0.15, 0.0]), 0.01)
    held = RegressionModel(SOFTENING, SOFTENING_TRUTH, 0.01)
    plain = replace(wary, wary=False)
    assert plain.errors(SOFTENING, lambda *_: held).mean == np.inf
    assert wary.errors(SOFTENING, lambda *_: bounded).mean == plain.errors(SOFTENING, lambda *_: bounded).mean
    own = wary.errors(SOFTENING, lambda *_: held).mean
    with monkeypatch.context() as patched:
        patched.setattr(cross_validation, "diverges_held", lambda *_: False)
        assert own == pytest.approx(MUCH_BETTER**2 * wary.errors(SOFTENING, lambda *_: held).mean)
    far = cross_validation.diverges
    backwards = {id(extremes.backwards) for extremes in wary.extremes}
    monkeypatch.setattr(cross_validation, "diverges", lambda model, on: id(on) in backwards or far(model, on))
    assert wary.errors(SOFTENING, lambda *_: held).mean == np.inf


# --- candidates ------------------------------------------------------------------------------------------------------


def test_a_record_with_offsets_gets_a_constant() -> None:
    plain = second_order(0.02, 600)
    moved = Record(plain.input + 5.0, plain.output + 40.0, plain.dt)
    for name in ("arx", "output-error"):
        fit = REGRESSIONS[name](moved, emsid.Options(na=2, nb=1, nk=1))
        assert "1" in fit.model.structure.labels, name
        assert "1" not in REGRESSIONS[name](plain, emsid.Options(na=2, nb=1, nk=1)).model.structure.labels


def test_an_output_of_one_sign_has_no_friction_terms() -> None:
    record = second_order(0.02, 600)
    moved = replace(record, output=record.output + 40.0)
    given = emsid.Options(na=2, nb=1, nk=1, knots=0)
    assert "-sign(y(t-1))" in REGRESSIONS["friction-narx"](record, given).model.structure.labels
    assert REGRESSIONS["friction-narx"](moved, given).model.structure.labels == ("-y(t-1)", "-y(t-2)", "u(t-1)", "1")


def test_terms_that_the_fit_needs_are_not_removed_by_a_few_unseen_stretches() -> None:
    errors = StretchErrors.of(np.linspace(1.0, 1.2, 160))
    spread = StretchErrors.of(np.concatenate([np.full(150, 0.1), np.full(10, 18.0)]))
    fits = [replace(emsid.fit(arx(2, 1), second_order(0.1, 200)), noise_variance=v) for v in (1.0, 1.5, 1.1)]
    best, worse, close = Trial(fits[0], errors), Trial(fits[1], spread), Trial(fits[2], spread)
    assert not as_good(worse, best)
    assert as_good(close, best)


def test_the_rest_of_the_parameters_is_at_the_minimum_without_the_removed_ones() -> None:
    rng = np.random.default_rng(4)
    regressors = rng.standard_normal((50, 5)) @ rng.standard_normal((5, 5))  # correlated
    y, kept = rng.standard_normal(50), np.array([0, 2, 3])
    whole, alone = (np.linalg.lstsq(a, y, rcond=None)[0] for a in (regressors, regressors[:, kept]))
    covariance = np.linalg.inv(regressors.T @ regressors)
    np.testing.assert_allclose(of_the_rest(whole, covariance, kept), alone, rtol=1e-8)
    unknown = np.full((5, 5), np.inf)
    np.testing.assert_array_equal(of_the_rest(whole, unknown, kept), whole[kept])


def test_a_fit_without_some_terms_goes_on_from_the_one_with_them(monkeypatch: pytest.MonkeyPatch) -> None:
    record = second_order(0.1, 600)
    validation = CrossValidation.of(record, 0.25, 6)
    fit = fit_to_compare(arx(5, 4), validation.fitted, None, validation.control)
    begun = []
    monkeypatch.setattr(free_run_fit, "_towards_free_run", lambda *given: begun.append(given) or given[3])
    trials = prune(Trial(fit, validation.refitted(fit)), validation)
    assert trials[-1].terms < 6
    assert not begun


def test_an_output_that_may_be_an_absolute_value_gets_a_wiener_model() -> None:
    record = second_order(0.02, 300)
    folded = replace(record, output=np.abs(record.output) - 0.01)
    assert {"wiener", "feedback"} <= set(usual_for(folded))
    assert not {"wiener", "feedback"} & set(usual_for(record))
    assert "feedback" not in usual_for(folded[:199])
    assert "wiener" not in usual_for(replace(record, output=record.output + 40.0))


def test_knots_lie_in_the_range_of_the_input() -> None:
    y = np.arange(100.0)
    for low, high in ((-3.0, 3.0), (0.0, 10.0), (2.0, 3.0), (-9.0, -1.0), (-0.5, 8.0)):
        knots = input_knots(Record(np.linspace(low, high, 100), y, 1.0), 4)
        assert all(low < knot < high for knot in knots), (low, high)
        assert len(knots) == 8
    assert input_knots(Record(np.linspace(-3.0, 2.9, 100), y, 1.0), 1) == (-0.75, 0.75)  # one reach on both sides


@pytest.mark.parametrize(("seed", "lower"), [(6, 0.1), (9, 1.0)])
def test_a_search_that_stalls_is_begun_again(seed: int, lower: float) -> None:
    """The free run of a motor with friction is not smooth; the same rule as for cascades and plants helps it."""
    record, structure = motor(seed, 1500).fitted, friction_narx(1, 1, knots=(), nk=1)
    once, again = (fit_free_run(structure, record, restarts=each) for each in (False, True))
    assert once.ending is Ending.STALLED
    assert again.noise_variance < lower * once.noise_variance
    assert again.ending is Ending.CONVERGED
