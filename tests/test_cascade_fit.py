"""Fits of cascades: recovery, intervals, endings and input that is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from cascade_examples import CASCADES, FAST, SLOW, Array, record_of
from coverage_cascade import CASES as COVERED
from emsid.errors import ModelError
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import Control
from emsid.estimation.nonlinear.problem import Huber, Infeasible
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.fitting import fit_cascade, freedom, search, static_band
from emsid.models.blocks.gain import unit_gain
from emsid.models.blocks.search.estimation import advice
from emsid.models.blocks.static_maps import DeadZone, Saturation, TwoSlopes, UserMap


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
    assert {name for group in finding.data["inseparable"] for name in group} <= {*fit.names, "initial states"}
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
    with pytest.raises(Infeasible, match="block 2: saturation from low = 1 to high = -1"):
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
