"""Cascades are found from a record alone: their topology, their map and their delay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import emsid
from cascade_searches import (
    AT_RATE,
    BEND,
    COULOMB,
    DEAD_ZONE,
    FAMILIES,
    FAST,
    KNOTS,
    POLYNOMIAL,
    SLOW,
    Array,
    hammerstein,
    hammerstein_wiener,
    record_of,
    unexplained,
    wiener,
    wiener_hammerstein,
)
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import Activity, Control, Stopped
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.gain import unit_gain
from emsid.models.blocks.search.cross_validation import HAMMERSTEIN, CascadeSearch
from emsid.models.blocks.search.estimation import advice, estimate
from emsid.models.blocks.search.map_families import Family, given
from emsid.models.blocks.search.starts import regression_candidate
from emsid.models.blocks.static_maps import (
    CubicSpline,
    DeadZone,
    MonotoneSpline,
    OddSpline,
    Polynomial,
    Saturation,
    UserMap,
)
from emsid.plant import Motor, simulate
from emsid.plant.dead_zone import DeadZoneLaw
from emsid.plant.friction import Friction
from emsid.record import Record


@pytest.mark.parametrize(
    ("estimator", "orders", "truth"),
    [
        (wiener_hammerstein, (1, 2), Cascade((FAST, BEND, SLOW))),
        (wiener_hammerstein, None, Cascade((FAST, BEND, SLOW))),
        (hammerstein, 2, Cascade((BEND, SLOW))),
        (wiener, 2, Cascade((SLOW, BEND))),
        (wiener, None, Cascade((SLOW, BEND))),
        (hammerstein_wiener, 2, Cascade((DeadZone(-0.4, 0.5), SLOW, BEND))),
    ],
)
def test_structures_are_found_from_a_record_alone(
    estimator: Callable[..., Fit[Cascade]], orders: object, truth: Cascade
) -> None:
    fit = estimator(record_of(truth), orders, replace(AT_RATE, size=9))
    assert fit.ending is Ending.CONVERGED, fit.findings
    assert unexplained(fit, record_of(truth, 2000, noise=0.0, seed=1)) < (
        0.03 if estimator is hammerstein_wiener else 0.01
    )


def test_fit_fits_a_cascade_that_is_only_described() -> None:
    truth = unit_gain(Cascade((DeadZone(-0.5, 0.4, 0.8, 1.2), SLOW)))
    structure = emsid.hammerstein(2, static=emsid.blocks.DeadZone(), delay=0, oversampling=1)
    fit = emsid.fit(structure, record_of(truth, 2000))
    assert fit.ending is Ending.CONVERGED
    assert structure.name == fit.model.name == "hammerstein"
    zone = fit.model.blocks[0]
    assert isinstance(zone, DeadZone)
    np.testing.assert_allclose([zone.b_l, zone.b_r], [-0.5, 0.4], atol=0.03)


def test_a_delay_is_found() -> None:
    truth = Cascade((FAST, BEND, SLOW), delay=6)
    fit = wiener_hammerstein(record_of(truth), (1, 2), replace(AT_RATE, size=9))
    impulse = np.where(np.arange(60) == 20, 0.5, 0.0)

    def response(model: Cascade) -> Array:
        state = model.resting(0.0)
        return (model.output(impulse, state) - model.output(np.zeros(60), state))[20:]

    # A leading coefficient of either filter that is nearly zero is a delay too, so the response says it, not the field.
    expected, found = response(truth), response(fit.model)
    assert np.argmax(expected != 0.0) == 6
    assert np.max(np.abs(found[:6])) < 0.02 * np.max(expected)
    np.testing.assert_allclose(found[6:], expected[6:], atol=0.03 * np.max(expected))
    assert unexplained(fit, record_of(truth, 2000, noise=0.0, seed=1)) < 0.01


def test_filters_of_order_zero_leave_the_map_alone() -> None:
    truth = Cascade((DeadZone(-0.5, 0.7, 1.2, 0.8),))
    fit = wiener_hammerstein(record_of(truth, 1500, noise=0.001), (0, 0), CascadeSearch(static=DEAD_ZONE))
    np.testing.assert_allclose(fit.model.blocks[1].parameters, [-0.5, 0.7, 1.2, 0.8], atol=0.01)
    assert fit.model.delay == 0


def test_the_papers_regression_is_factorised_into_blocks() -> None:
    curve = Polynomial.from_powers([0.0, 2.0, 0.5], -6, 6)
    truth = Cascade((curve, Rational([0.1, 0.05, 0.02], [-1.3, 0.45])), delay=1)
    found, behind = regression_candidate([record_of(truth, 3000, noise=0.0)], 2, 2, 1)
    np.testing.assert_allclose(behind.denominator, [-1.3, 0.45], rtol=1e-8)
    np.testing.assert_allclose(behind.numerator / behind.numerator[0], [1, 0.5, 0.2], rtol=1e-7)
    np.testing.assert_allclose(found.powers * behind.numerator[0], [0, 0.2, 0.05], atol=1e-9)


# --- maps ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("family", "truth"),
    [
        (DEAD_ZONE, DeadZone(-0.5, 0.4, 0.8, 1.2)),
        (POLYNOMIAL, Polynomial.from_powers([0.0, 1.0, 0.2, -0.03], -4, 4)),
        (FAMILIES["saturation"], FAMILIES["saturation"].start(KNOTS, np.clip(KNOTS, -1.0, 1.2), 0)),
        (FAMILIES["piecewise-linear"], BEND),
        (COULOMB, COULOMB.start(KNOTS, KNOTS + np.sign(KNOTS), 0)),
        (
            given(UserMap(lambda x, p: np.tanh(x), lambda x, p: 1 / np.cosh(x) ** 2)),
            UserMap(lambda x, p: np.tanh(x), lambda x, p: 1 / np.cosh(x) ** 2),
        ),
    ],
)
def test_every_family_is_found(family: Family, truth: object) -> None:
    model = Cascade((FAST.amplified(1 / FAST.gain), truth, SLOW))  # type: ignore[arg-type]
    fit = wiener_hammerstein(record_of(model), (1, 2), replace(AT_RATE, static=family))
    assert unexplained(fit, record_of(model, 2000, noise=0.0, seed=1)) < 0.03


@pytest.mark.parametrize(
    ("estimator", "curve"),
    [
        (hammerstein, DeadZone(-0.5, 0.4, 0.8, 1.2)),
        (hammerstein, FAMILIES["saturation"].start(KNOTS, np.clip(KNOTS, -1.0, 1.2), 0)),
        (hammerstein, Polynomial.from_powers([0.0, 1.0, 0.2, -0.03], -4, 4)),
        (hammerstein, CubicSpline(KNOTS, np.sin(2 * KNOTS) + KNOTS + np.cos(2 * KNOTS))),
        (hammerstein, OddSpline(KNOTS[5:], np.sin(2 * KNOTS[5:]) + KNOTS[5:])),
        (wiener_hammerstein, DeadZone(-0.5, 0.4, 0.8, 1.2)),
    ],
)
def test_the_family_of_the_map_is_chosen_where_none_is_given(
    estimator: Callable[..., Fit[Cascade]], curve: object
) -> None:
    blocks = (curve, SLOW) if estimator is hammerstein else (FAST, curve, SLOW)
    truth = Cascade(blocks)  # type: ignore[arg-type]
    fit = estimator(record_of(truth, 3000), None, replace(AT_RATE, static=None))
    assert {type(block) for block in fit.model.blocks} == {type(curve), Rational}
    assert [len(block.denominator) for block in fit.model.blocks if isinstance(block, Rational)] == [
        len(block.denominator) for block in blocks if isinstance(block, Rational)
    ]
    assert unexplained(fit, record_of(truth, 2000, noise=0.0, seed=1)) < 0.01


def test_the_map_is_chosen_where_only_the_order_is_given() -> None:
    fit = emsid.fit(emsid.hammerstein(2), record_of(Cascade((Saturation(0.8, -1.0, 1.2), SLOW)), 1500))
    assert isinstance(fit.model.blocks[0], Saturation)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_monotone_map_is_tried(seed: int) -> None:
    """It is neither odd nor a polynomial, and data are rare where it is steep."""
    rng = np.random.default_rng(seed)
    u = lfilter([1.0], [1.0, -0.7], rng.standard_normal(900))
    x = u / np.std(u)
    z = np.where(x > 0, np.log1p(3 * x.clip(0)) / 3, x * (1 + 0.4 * x**2))
    y = lfilter([0.2, 0.1], [1.0, -0.7], z)
    noise = 0.02 * float(np.std(y))
    record = Record(u, y + noise * rng.standard_normal(900), 0.01)
    fit = emsid.fit(emsid.hammerstein(1), record[:500])
    assert isinstance(fit.model.blocks[0], MonotoneSpline)
    assert np.std((y[500:] - fit.model.simulate(record[500:]).output[:, 0])[50:]) < 0.5 * noise


@pytest.mark.parametrize("static", ["odd-spline", "monotone-spline", "tanh"])
def test_a_map_of_a_shape_is_fitted_like_any_other(static: str) -> None:
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-3, 3, 150), 10)
    truth = Cascade((CubicSpline(np.linspace(-3, 3, 13), np.tanh(np.linspace(-3, 3, 13))), SLOW))
    y = truth.output(u, np.zeros(truth.states)) + 1e-3 * rng.standard_normal(1500)
    fit = emsid.fit(emsid.hammerstein(2, static=static, delay=0, oversampling=1), Record(u, y, 0.01))
    assert fit.ending is Ending.CONVERGED
    assert fit.noise_variance < 2e-6
    x = np.linspace(-2.5, 2.5, 11)
    assert np.max(np.abs(fit.model.blocks[0].value(x) - np.tanh(x))) < 0.01


def test_a_users_map_with_parameters_starts_with_those_it_has() -> None:
    def saturating(rate: float) -> UserMap:
        return UserMap(
            lambda x, p: np.tanh(p[0] * x),
            lambda x, p: p[0] / np.cosh(p[0] * x) ** 2,
            lambda x, p: (x / np.cosh(p[0] * x) ** 2)[None],
            np.array([rate]),
            ("rate",),
        )

    truth = Cascade((saturating(0.8), SLOW))
    fit = hammerstein(record_of(truth), 2, replace(AT_RATE, static=given(saturating(1.5))))
    assert fit.estimate[fit.names.index("f.rate")] == pytest.approx(0.8, rel=0.02)
    assert unexplained(fit, record_of(truth, 2000, noise=0.0, seed=1)) < 0.01


FRICTIONLESS: dict[str, Any] = {"rotor_friction": Friction(0.0), "load_friction": Friction(0.0)}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    "motor",
    [
        Motor(shaft_stiffness=np.inf, voltage_dead_zone=DeadZoneLaw(-0.8, 0.5), **FRICTIONLESS),
        Motor(
            inductance=0.0, shaft_stiffness=np.inf, voltage_dead_zone=DeadZoneLaw(-0.4, 0.7, 0.9, 1.2), **FRICTIONLESS
        ),
        Motor(voltage_dead_zone=DeadZoneLaw(-0.6, 0.45), **FRICTIONLESS),
    ],
    ids=["rigid", "of first order", "elastic"],
)
def test_dead_zone_of_a_simulated_motor(motor: Motor, seed: int) -> None:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-6, 6, 750), 4)
    speed = np.asarray(simulate(motor, u, 0.005).load_speed)[: len(u)]
    record = Record(u, speed + 0.01 * np.std(speed) * rng.standard_normal(len(u)), 0.005)
    zone = motor.voltage_dead_zone
    assert zone is not None
    fit = hammerstein(record, None, CascadeSearch(static=DEAD_ZONE))
    interval = fit.interval(0.99)
    for name, value in (("f.b_l", zone.b_l), ("f.b_r", zone.b_r)):
        at = fit.names.index(name)
        assert fit.estimate[at] == pytest.approx(value, rel=0.02)
        assert interval[at, 0] <= value <= interval[at, 1]


def test_dead_zone_of_a_motor_within_two_percent_and_inside_its_interval() -> None:
    truth = unit_gain(Cascade((fir([1.0]), DeadZone(-0.6, 0.45, 1.0, 1.0), SLOW)))
    fit = hammerstein(record_of(truth, 3000), 2, replace(AT_RATE, static=DEAD_ZONE))
    interval = fit.interval(0.99)
    for name, value in (("f.b_l", -0.6), ("f.b_r", 0.45)):
        at = fit.names.index(name)
        assert fit.estimate[at] == pytest.approx(value, rel=0.02)
        assert interval[at, 0] <= value <= interval[at, 1]
    assert advice(fit, record_of(truth, 6000)) == ()


# --- progress --------------------------------------------------------------------------------------------------------


def test_every_activity_is_reported() -> None:
    heard: list[Activity] = []
    truth = Cascade((BEND, SLOW))
    settings = replace(AT_RATE, size=6)
    estimate(HAMMERSTEIN, record_of(truth, 800), (None, 2), settings, Control(report=heard.append))
    assert any("start values" in activity.doing for activity in heard)
    fitting = [activity for activity in heard if activity.doing == "fitting hammerstein"]
    assert [each.done for each in fitting] == list(range(1, len(fitting) + 1))
    assert all(each.cost and each.offset for each in fitting)


def test_a_cancelled_search_keeps_the_best_so_far() -> None:
    record = record_of(Cascade((BEND, SLOW)), 800)
    doing: list[str] = []
    control = Control(
        cancelled=lambda: "fitting hammerstein to all data" in doing, report=lambda each: doing.append(each.doing)
    )
    fit = estimate(HAMMERSTEIN, record, (None, 2), replace(AT_RATE, size=6), control)
    assert fit.ending is Ending.INTERRUPTED
    assert [(f.code, f.subject, f.data) for f in fit.findings] == [
        ("choices-cut-short", "hammerstein", {"cancelled": True})
    ]
    with pytest.raises(Stopped):
        estimate(HAMMERSTEIN, record, (None, 2), AT_RATE, Control(cancelled=lambda: True))
