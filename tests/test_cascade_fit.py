"""Fits of cascades: recovery, intervals, endings and input that is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from cascade_examples import CASCADES, FAST, SLOW, Array, record_of
from coverage_cascade import CASES as COVERED
from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.nonlinear.gauss_newton import PATIENCE
from emsid.estimation.nonlinear.losses import Huber
from emsid.estimation.nonlinear.minimum import Minimum
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.fitting import fit_cascade, freedom, search, static_band
from emsid.models.blocks.gain import unit_gain
from emsid.models.blocks.search.cross_validation import Round
from emsid.models.blocks.search.diagnostics import advice
from emsid.models.blocks.search.estimation import wiener_hammerstein
from emsid.models.blocks.search.map_families import TRIAL_KNOTS
from emsid.models.blocks.search.refinement import FINISHED, Plan, promising, refined, unseen_errors
from emsid.models.blocks.search.sources import refined_first
from emsid.models.blocks.static_maps import CubicSpline, DeadZone, Saturation, TwoSlopes, UserMap
from emsid.selection.improvement import StretchErrors


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


# --- intervals -------------------------------------------------------------------------------------------------------


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


# --- endings and input -----------------------------------------------------------------------------------------------


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
    wrong = UserMap(lambda x, p: x[: 101 if len(x) == 101 else 7], lambda x, p: np.ones_like(x))
    with pytest.raises(ModelError, match=r"returned shape \(7,\) instead of \(300,\)"):
        fit_cascade(Cascade((FAST, wrong, SLOW)), record)


# --- which starts are refined ----------------------------------------------------------------------------------------


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


def test_a_model_that_is_much_worse_on_the_first_split_is_not_fitted_to_the_others() -> None:
    true = Cascade((Rational(np.array([0.0, 0.5]), np.array([-0.5])),))
    record = record_of(true, 400)
    splits = [Round([record[200:]], [record[:200]], [0]), Round([record[:200]], [record[200:]], [0])]
    start = true.with_parameters(0.9 * true.parameters)
    assert unseen_errors(start, splits, Control(), None).mean < 1e-9  # fitted again to each
    rival = StretchErrors.of(np.full(400, 1e-30))
    with pytest.raises(ModelError, match="much larger"):
        unseen_errors(start, [splits[0], Round([], [], [])], Control(), rival)
    squares = np.full(400, 1e-30)
    squares[300:] = 1e-29  # the second split is the harder one for the rival, so it comes first
    with pytest.raises(ModelError, match="much larger"):
        unseen_errors(start, [Round([], [], []), splits[1]], Control(), StretchErrors.of(squares))
