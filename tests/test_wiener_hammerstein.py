"""Cascades from records alone: starts, choices, advice, interruption, bad input, and two real recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

import emsid
from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import Activity, Control, Stopped
from emsid.estimation.nonlinear.frequency_response import fit_rational, frequency_response
from emsid.excitation import SIGNALS
from emsid.io import read
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational, fir
from emsid.models.blocks.gain import unit_gain
from emsid.models.blocks.search import choice as cascade_choice
from emsid.models.blocks.search.cross_validation import CHOICE_SAMPLES, held_back, shortened
from emsid.models.blocks.search.diagnostics import advice
from emsid.models.blocks.search.estimation import CascadeStructure, estimate
from emsid.models.blocks.search.map_families import Family, families, given
from emsid.models.blocks.search.orders import map_sizes, order_shares, total_orders
from emsid.models.blocks.search.starts import (
    _splits,
    at_higher_rate,
    grown,
    regression_candidate,
    sign_recovery_candidates,
)
from emsid.models.blocks.search.topologies import (
    DEFAULTS,
    HAMMERSTEIN,
    HAMMERSTEIN_WIENER,
    WIENER,
    WIENER_HAMMERSTEIN,
    CascadeSearch,
    Topology,
)
from emsid.models.blocks.search.trials import scanned
from emsid.models.blocks.static_maps import (
    Abs,
    CubicSpline,
    DeadZone,
    EvenSpline,
    MonotoneSpline,
    OddSpline,
    Polynomial,
    Saturation,
    UserMap,
)
from emsid.models.free_run import free_run_error
from emsid.plant import Bench, Motor, simulate
from emsid.plant.dead_zone import DeadZoneLaw
from emsid.plant.friction import Friction
from emsid.record import Record, concatenate
from emsid.validation.metrics import fit_percent
from independent.diode_circuit import diode_circuit
from independent.nonlinear_systems import coupled_drives

Array = NDArray[np.float64]

FAST = Rational([0.5, 0.2], [-0.4])
SLOW = Rational([0.1, 0.05], [-1.3, 0.45])
FAMILIES = families()
ABS, COULOMB, DEAD_ZONE = FAMILIES["abs"], FAMILIES["coulomb"], FAMILIES["dead-zone"]
POLYNOMIAL, SPLINE = FAMILIES["polynomial"], FAMILIES["spline"]


def wiener_hammerstein(records: Any, orders: Any = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    pair = (None, None) if orders is None else orders
    return CascadeStructure(WIENER_HAMMERSTEIN, pair, settings).fit(records)


def hammerstein(records: Any, order: int | None = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    return CascadeStructure(HAMMERSTEIN, (None, order), settings).fit(records)


def wiener(records: Any, order: int | None = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    return CascadeStructure(WIENER, (order, None), settings).fit(records)


def hammerstein_wiener(records: Any, order: int | None = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    return CascadeStructure(HAMMERSTEIN_WIENER, (None, order), settings).fit(records)


KNOTS = np.linspace(-4, 4, 9)
BEND = CubicSpline(KNOTS, KNOTS - 0.04 * KNOTS**3 / 3 + 0.05 * KNOTS**2)
AT_RATE = CascadeSearch(oversampling=1)
FRICTIONLESS: dict[str, Any] = {"rotor_friction": Friction(0.0), "load_friction": Friction(0.0)}


def record_of(model: Cascade, samples: int = 4000, noise: float = 0.01, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    u = 1.5 * lfilter([0.6], [1, -0.4], rng.standard_normal(samples)) / 0.65
    y = model.output(u, model.resting(float(u[0])))
    return Record(u, y + noise * np.std(y) * rng.standard_normal(samples), 1e-3)


def held_levels(model: Cascade, samples: int, seed: int, noise: float = 0.01) -> Record:
    """A drive's command: levels held for ten samples."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1.4, samples // 10), 10)
    y = model.output(u, model.resting(float(u[0])))
    return Record(u, y + noise * np.std(y) * rng.standard_normal(samples), 1e-3)


def unexplained(fit: Fit[Cascade], record: Record) -> float:
    """Free-run error on a record over the spread of its output."""
    run = fit.model.simulate(record)
    return float(np.sqrt(np.mean((run.output - record.output)[run.counted] ** 2)) / np.std(record.output))


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
    fit = estimator(record_of(truth, 4500), None, replace(AT_RATE, static=None))
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


def test_a_map_that_loses_the_sign_is_tried_where_the_output_shows_magnitudes() -> None:
    """Splines, which have to find the kink, leave 46 times the noise."""
    drives = coupled_drives(300, seed=22, spread=0.2)
    fit = wiener(drives.fitted, None, CascadeSearch(static=None))
    (other,) = drives.unseen.values()
    assert unexplained(fit, other) * np.std(other.output) < 1.5 * drives.noise
    assert isinstance(fit.model.blocks[-1], Abs)


def test_the_number_of_knots_is_limited_by_the_samples() -> None:
    few, many = (record_of(Cascade((BEND, SLOW)), samples) for samples in (120, 4000))
    lines = FAMILIES["piecewise-linear"]
    for family, small in ((SPLINE, SPLINE.sizes[:1]), (lines, (6, 10, 16))):
        sizes = [map_sizes(family, HAMMERSTEIN, [each], (None, 2), CascadeSearch()) for each in (few, many)]
        assert sizes == [small, family.sizes]
    assert map_sizes(SPLINE, HAMMERSTEIN, [few], (None, 2), CascadeSearch(size=20)) == (20,)


def test_a_pair_of_filters_that_fails_does_not_fail_the_others() -> None:
    """A motor of first order has no two filters to share out; one of the trials passes nothing on."""
    record = record_of(Cascade((FAST, BEND, SLOW)), 800)
    segments = [(record.input[:, 0], record.output[:, 0])]
    runaway, template = Rational([1.0], [-3.0]), Cascade((SLOW,))
    with np.errstate(over="ignore", invalid="ignore"):
        found = scanned([(runaway, SLOW), (FAST, SLOW)], segments, SPLINE.trial, template, 2)
        assert len(found) == 1
        with pytest.raises(ModelError, match="filter before it diverges"):
            scanned([(runaway, SLOW)], segments, SPLINE.trial, template, 2)


@pytest.mark.parametrize("orders", [(4, 4), (20, 20)])
def test_poles_are_divided_without_trying_every_subset(orders: tuple[int, int]) -> None:
    first, second = orders
    groups = [[complex(0.01 * k)] for k in range(first + second - 2)] + [[0.5 + 0.1j, 0.5 - 0.1j]]
    shares = list(islice(_splits(groups, first), 500))
    assert all((len(left), len(right)) == orders for left, right in shares)
    whole = sorted(map(str, (root for group in groups for root in group)))
    assert all(sorted(map(str, left + right)) == whole for left, right in shares)
    assert len({str(left) for left, _ in shares}) == len(shares)
    if first == 4:  # every way there is
        assert len(list(_splits(groups, first))) == comb(6, 4) + comb(6, 2)


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
    u = np.repeat(rng.uniform(-6, 6, 1500), 4)
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
    fit = hammerstein(record_of(truth, 6000), 2, replace(AT_RATE, static=DEAD_ZONE))
    interval = fit.interval(0.99)
    for name, value in (("f.b_l", -0.6), ("f.b_r", 0.45)):
        at = fit.names.index(name)
        assert fit.estimate[at] == pytest.approx(value, rel=0.02)
        assert interval[at, 0] <= value <= interval[at, 1]
    assert advice(fit, record_of(truth, 6000)) == ()


def test_a_lost_sign_is_recovered() -> None:
    truth = Cascade((Rational([0.0, 0.1], [-0.9]), Abs(), Rational([0.6], [-0.4])))
    fit = wiener_hammerstein(record_of(truth, 1500), (1, 1), replace(AT_RATE, static=ABS))
    assert unexplained(fit, record_of(truth, 1500, noise=0.0, seed=1)) < 0.03


def test_a_sensor_with_offsets_loses_the_sign_of_a_resonance() -> None:
    """The kink is not at u = 0: a start that leaves u₀ there ends in another minimum."""
    drive = Rational([0.0, 0.03, 0.02], np.real(np.poly([0.93 + 0.2j, 0.93 - 0.2j]))[1:])
    truth = Cascade((drive, Abs(), Rational([0.5], [-0.5])), input_offset=0.3, output_offset=0.05)
    record, other = (held_levels(truth, 600, seed) for seed in (0, 1))
    fit = wiener_hammerstein(record, (2, 1), replace(AT_RATE, static=ABS))
    assert isinstance(fit.model.blocks[1], Abs)
    assert fit.model.input_offset == pytest.approx(0.3, abs=0.02)
    assert unexplained(fit, other) < 0.02


@pytest.mark.parametrize("static", [ABS, None])
def test_only_a_sensor_with_a_curve_gets_knots(static: Family | None) -> None:
    curve = np.linspace(-4, 4, 41)
    bent = CubicSpline(curve, np.sqrt(curve**2 + 0.1) + 0.1 * curve**2)
    drive = Rational([0.0, 0.1], [-0.9])
    for sensor, kind in ((bent, EvenSpline), (Abs(), Abs)):
        truth = Cascade((drive, sensor), input_offset=0.3)  # type: ignore[arg-type]
        fit = wiener(held_levels(truth, 800, 0), 1, replace(AT_RATE, static=static, magnitudes=True))
        assert isinstance(fit.model.blocks[1], kind)
        assert unexplained(fit, held_levels(truth, 800, 1)) < 0.03


@pytest.mark.parametrize("static", ["odd-spline", "monotone-spline"])
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


def test_every_sample_of_a_short_record_is_selection_data_once() -> None:
    short, long = (record_of(Cascade((SLOW,)), samples) for samples in (403, 6000))
    _, rounds = held_back([short], CascadeSearch())
    judged = np.concatenate([each.unseen[0].output[each.ahead[0] :, 0] for each in rounds])
    np.testing.assert_array_equal(judged, short.output[:, 0])
    for rest, (run,), (ahead,) in rounds:
        unseen = run[ahead:]
        np.testing.assert_array_equal(run.output, short.output[: len(run)])  # what is ahead settles the run
        assert sum(len(piece) for record in rest for piece in record.segments) == 403 - len(unseen)
        assert not np.isin(unseen.output, np.concatenate([p.output for r in rest for p in r.segments])).any()
    shown, [(rest, (unseen,), (ahead,))] = held_back([long], CascadeSearch())
    assert ahead == 0
    assert rest is shown
    assert len(shown[0]) == 4500
    np.testing.assert_array_equal(unseen.output, long[4500:].output)


def test_orders_below_that_of_the_response_are_tried() -> None:
    def totals(layout: Topology, orders: tuple[int | None, int | None]) -> list[int]:
        record = record_of(Cascade((FAST, BEND, SLOW)), 8000, noise=0.001)
        return total_orders(layout, [(record.input[:, 0], record.output[:, 0])], orders)

    most = totals(WIENER_HAMMERSTEIN, (None, None))[-1]
    assert most >= 3
    assert totals(WIENER_HAMMERSTEIN, (None, None)) == list(range(max(most - 2, 2), most + 1))
    assert totals(WIENER, (None, None)) == list(range(1, most + 1))
    assert totals(WIENER_HAMMERSTEIN, (1, 2)) == [3]
    assert totals(WIENER_HAMMERSTEIN, (None, 2)) == list(range(max(most - 2, 3), most + 1))


def test_a_filter_that_grows_keeps_the_output() -> None:
    model = Cascade((FAST, BEND, SLOW))
    larger = grown(model, (3, 4))
    assert [len(block.denominator) for block in larger.blocks if isinstance(block, Rational)] == [3, 4]
    u = record_of(model, 300).input[:, 0]
    np.testing.assert_allclose(larger.output(u, np.zeros(7)), model.output(u, np.zeros(3)), atol=1e-12)
    assert grown(model, (None, 4)) is model


def test_a_larger_model_fits_no_worse_than_the_smaller_one() -> None:
    record = record_of(Cascade((Saturation(1.0, -1.0, 1.2), SLOW)), 600, seed=3)
    settings = replace(AT_RATE, delay=0, static="saturation")
    small, large = (hammerstein(record, order, settings) for order in (2, 3))
    assert free_run_error(large.model, [record]) <= 1.001 * free_run_error(small.model, [record])


def test_an_order_that_is_given_is_kept_where_the_other_is_open() -> None:
    assert order_shares(WIENER_HAMMERSTEIN, (None, None), 3) == [(1, 2), (2, 1)]
    assert order_shares(WIENER_HAMMERSTEIN, (None, 2), 3) == [(1, 2)]
    assert order_shares(WIENER_HAMMERSTEIN, (0, None), 3) == [(0, 3)]
    assert order_shares(WIENER_HAMMERSTEIN, (2, 0), 2) == [(2, 0)]
    record = record_of(Cascade((FAST, BEND, SLOW)))
    for orders in ((None, 2), (1, None)):
        fit = wiener_hammerstein(record, orders, replace(AT_RATE, size=9, delay=0))  # type: ignore[arg-type]
        first, second = (len(block.denominator) for block in fit.model.blocks if isinstance(block, Rational))
        assert orders[0] in (None, first)
        assert orders[1] in (None, second)
        assert unexplained(fit, record_of(Cascade((FAST, BEND, SLOW)), 2000, noise=0.0, seed=1)) < 0.02


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


def test_the_papers_regression_is_factorised_into_blocks() -> None:
    curve = Polynomial.from_powers([0.0, 2.0, 0.5], -6, 6)
    truth = Cascade((curve, Rational([0.1, 0.05, 0.02], [-1.3, 0.45])), delay=1)
    found, behind = regression_candidate([record_of(truth, 3000, noise=0.0)], 2, 2, 1)
    np.testing.assert_allclose(behind.denominator, [-1.3, 0.45], rtol=1e-8)
    np.testing.assert_allclose(behind.numerator / behind.numerator[0], [1, 0.5, 0.2], rtol=1e-7)
    np.testing.assert_allclose(found.powers * behind.numerator[0], [0, 0.2, 0.05], atol=1e-9)


def test_frequency_response_and_the_rational_function_fitted_to_it() -> None:
    record = record_of(Cascade((SLOW,)), 20_000, noise=0.001)
    response = frequency_response([(record.input[:, 0], record.output[:, 0])])
    b, a, cost = fit_rational(response, 2, 2)
    np.testing.assert_allclose(a, SLOW.denominator, atol=0.01)
    np.testing.assert_allclose(b, SLOW.numerator, atol=0.002)
    assert cost < 4 * len(response.frequency)
    with pytest.raises(ModelError, match="needs a segment of 32 samples"):
        frequency_response([(np.ones(20), np.ones(20))])
    with pytest.raises(ModelError, match="excites nothing"):
        frequency_response([(np.zeros(200), np.ones(200))])


def test_every_activity_is_reported() -> None:
    heard: list[Activity] = []
    truth = Cascade((BEND, SLOW))
    settings = replace(AT_RATE, size=6)
    estimate(HAMMERSTEIN, record_of(truth, 800), (None, 2), settings, Control(report=heard.append))
    assert any("start values" in each.doing for each in heard)
    fitting = [each for each in heard if each.doing == "fitting hammerstein"]
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


def test_more_steps_per_sample_are_not_taken_where_they_do_not_help(monkeypatch: pytest.MonkeyPatch) -> None:
    record = record_of(Cascade((BEND, SLOW)), 800)
    options = replace(AT_RATE, size=6, oversampling=None)
    fit = hammerstein(record, 2, options)
    assert fit.model.oversampling == 1
    assert np.sqrt(fit.noise_variance) == pytest.approx(0.01 * np.std(record.output), rel=0.1)
    monkeypatch.setattr(cascade_choice, "ordered_starts", lambda *arguments: [[]])
    with pytest.raises(ModelError, match="no start value leads to a model"):
        hammerstein(record, 2, options)


def test_other_sources_of_starts_are_left_out_where_a_refined_start_explains_the_output(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record = record_of(Cascade((BEND, SLOW)), 800)
    sources = cascade_choice.ordered_starts

    def batches(*arguments: Any) -> Iterator[list[Cascade]]:
        yield next(sources(*arguments))
        pytest.fail("other sources are searched")

    monkeypatch.setattr(cascade_choice, "ordered_starts", batches)
    fit = hammerstein(record, 2, replace(AT_RATE, size=6))
    assert np.sqrt(fit.noise_variance) == pytest.approx(0.01 * np.std(record.output), rel=0.1)


def test_a_map_with_harmonics_above_half_the_sampling_rate_gets_more_steps_per_sample() -> None:
    """At one step per sample the same structure has 3.7 times the noise."""
    record, judge, noise = diode_circuit(seed=4, samples=4_000, noise=8e-4)
    model = emsid.fit(emsid.wiener_hammerstein(), record).model
    assert model.oversampling == 2
    run = model.simulate(judge)
    assert np.sqrt(np.mean((run.output - judge.output)[run.counted] ** 2)) < 0.6 * noise


def test_few_knots_move_to_where_the_map_bends() -> None:
    """Spread over the data, ten knots leave 3.8 times the noise."""
    record, judge, noise = diode_circuit(seed=4, samples=4_000, noise=8e-4)
    structure = emsid.wiener_hammerstein((3, 3), static="spline", size=10, oversampling=2, delay=0)
    run = emsid.fit(structure, record).model.simulate(judge)
    assert np.sqrt(np.mean((run.output - judge.output)[run.counted] ** 2)) < 0.8 * noise


@pytest.mark.parametrize("kink", [True, False])
def test_a_number_of_knots_that_is_too_small_is_said_where_the_map_bends_more_sharply(kink: bool) -> None:
    """Eight knots round the edges of a saturation and suffice for a flat arctangent."""
    rng = np.random.default_rng(3)
    u = np.asarray(lfilter([1.0], [1.0, -0.8], rng.standard_normal(2000)))
    y = lfilter([0.3], [1.0, -0.7], np.clip(u, -1, 1) if kink else np.arctan(0.3 * u))
    record = Record(u, y + 0.01 * np.std(y) * rng.standard_normal(2000), 0.01)
    fit = emsid.fit(emsid.hammerstein(1, static="spline", size=8, oversampling=1, delay=0), record)
    few = [finding for finding in fit.findings if finding.code == "too-few-knots"]
    assert len(few) == kink
    if kink:  # the noise remains, and so do edges between the new knots
        error, noise = np.sqrt(fit.noise_variance), 0.01 * np.std(y)
        assert 0.3 < few[0].data["saved"] < 1 - noise / error
        assert few[0].data["block"] == 1


@pytest.mark.parametrize(
    "poles", [[0.9], [0.995], [0.8 + 0.3j, 0.8 - 0.3j], [0.7 + 0.4j, 0.7 - 0.4j, 0.5], [-0.2]], ids=str
)
def test_a_filter_at_a_higher_rate_responds_alike_at_low_frequencies(poles: list[complex]) -> None:
    block = Rational(np.real(np.poly([0.5] * len(poles))), np.real(np.poly(poles))[1:], 1)
    (faster,) = at_higher_rate(Cascade((block,)), 2).blocks
    assert isinstance(faster, Rational)
    frequency = np.geomspace(1e-5, 0.2, 50)
    responses = block.response(frequency, 1.0), faster.response(frequency, 0.5)
    assert np.abs(responses[0] - responses[1]).max() < 0.03 * np.abs(responses[0]).max()


def test_recovering_signs_can_be_cancelled() -> None:
    u = np.repeat(np.random.default_rng(0).uniform(-1, 1, 60), 10)
    y = np.abs(Rational([0.0, 0.1], [-0.9]).output(u, np.zeros(1)))
    with pytest.raises(Stopped):
        list(sign_recovery_candidates([(u, y)], (1, None), np.random.default_rng(0), Control(cancelled=lambda: True)))


def test_what_the_records_do_not_determine_is_found() -> None:
    record = record_of(Cascade((BEND, SLOW)), 1000)

    def about(*blocks: object) -> list[tuple[str, Any]]:
        model = Cascade(blocks)  # type: ignore[arg-type]
        fit = Fit(model, (), np.zeros(0), np.zeros((0, 0)), 1.0, 1000, 1.0, 0)
        return [(finding.code, dict(finding.data)) for finding in advice(fit, record)]

    assert about(DeadZone(-0.5, 50.0), SLOW) == [
        ("dead-zone-side-unseen", {"block": 1, "side": "right", "parameters": ["b_r", "m_r"], "share": 0.0})
    ]
    assert about(DeadZone(-1e-6, 1e-6), SLOW) == [("dead-zone-unseen", {"block": 1, "share": 0.0})]
    assert about(CubicSpline([-1.0, 0.0, 1.0, 30.0], np.ones(4)), SLOW) == [  # type: ignore[arg-type]
        ("knots-without-data", {"block": 1, "knots": [30.0]})
    ]
    straight = CubicSpline([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0])  # type: ignore[arg-type]
    assert about(straight, SLOW) == [("map-is-straight", {"block": 1})]
    assert about(CubicSpline([-1.0, 0.0, 1.0], [-1.0, 0.5, 1.0]), SLOW) == []  # type: ignore[arg-type]
    ((code, data),) = about(DeadZone(-0.5, 0.5), Rational([1.0, -0.899], [-0.9]))
    assert (code, data["block"]) == ("zero-cancels-pole", 2)
    assert data["pole"] == pytest.approx([0.9, 0.0])
    assert about(Saturation(1.0, -1.0, 90.0), SLOW) == [("limit-unseen", {"block": 1, "side": "high", "share": 0.0})]
    assert about(DeadZone(-0.5, 0.5), SLOW) == []
    model = Cascade((DeadZone(-0.5, 0.5), SLOW))
    lost = Fit(model, ("f.b_l", "f.b_r"), np.zeros(2), np.diag([np.inf, 1.0]), 1.0, 1000, 1.0, 2)
    assert [(f.code, f.data) for f in advice(lost, record)] == [
        ("parameters-without-interval", {"parameters": ["f.b_l"]})
    ]


def test_every_value_of_static_is_accepted_or_refused_in_one_line() -> None:
    for static in ("dead-zone", DeadZone, DeadZone(), DEAD_ZONE, DeadZone(-0.3, 0.4, 2.0, 2.0)):
        assert emsid.wiener_hammerstein((1, 2), static=static).search.families == (DEAD_ZONE,)
    knots = np.linspace(-1, 1, 5)
    (spline,) = emsid.hammerstein(2, static=CubicSpline(knots, knots)).search.families
    assert (spline.name, spline.sizes) == ("spline", (5,))
    own = UserMap(lambda x, p: x, lambda x, p: np.ones_like(x))
    (mine,) = emsid.wiener(2, static=own).search.families
    assert mine.start(knots, knots, 0) is own
    for static, said in (
        ("dead zone", "no static map 'dead zone'; there are spline"),
        (3, "a int is no static map; give a name"),
        (Rational, "Rational is no static map; give a name"),
    ):
        with pytest.raises(ModelError, match=said):
            emsid.wiener_hammerstein((1, 2), static=static)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda r: emsid.wiener_hammerstein(r, (1, 2), emsid.Options()), "wiener_hammerstein takes no record; give it"),
        (lambda r: emsid.wiener_hammerstein([r, r]), "wiener_hammerstein takes no record; give it to fit: emsid.fit"),
        (lambda r: emsid.hammerstein(r), "hammerstein takes no record"),
        (lambda r: emsid.hammerstein(2, r), "hammerstein takes no record"),
        (lambda r: emsid.wiener_hammerstein((1, 2), emsid.Options()), "takes no Options; give its options by name"),
        (lambda r: emsid.wiener_hammerstein((1, 2), static=emsid.Options()), "takes no Options"),
        (lambda r: emsid.wiener_hammerstein((1, 2), CascadeSearch()), "takes no CascadeSearch"),
        (lambda r: emsid.wiener_hammerstein((1, 2), "dead-zone"), "takes one argument by position"),
        (lambda r: emsid.wiener_hammerstein(3), "orders 3; give one for each filter"),
        (lambda r: emsid.wiener_hammerstein("12"), "orders '12'; give one for each filter"),
        (lambda r: emsid.wiener_hammerstein((1, 2, 3)), "give one for each filter"),
        (lambda r: emsid.hammerstein((1, 2)), "hammerstein: order"),
        (lambda r: emsid.wiener_hammerstein((1, 2), statics="spline"), "no option 'statics'; .* did you mean static"),
        (lambda r: CascadeStructure(HAMMERSTEIN, (1, 2)), "hammerstein has one filter; give one order"),
    ],
)
def test_misplaced_arguments_are_refused_in_one_line(call: Any, said: str) -> None:
    record = record_of(Cascade((BEND, SLOW)), 50)
    with pytest.raises(ModelError, match=said) as refused:
        call(record)
    assert "\n" not in str(refused.value)


def test_fit_fits_a_cascade_that_is_only_described() -> None:
    truth = unit_gain(Cascade((DeadZone(-0.5, 0.4, 0.8, 1.2), SLOW)))
    structure = emsid.hammerstein(2, static=emsid.blocks.DeadZone(), delay=0, oversampling=1)
    fit = emsid.fit(structure, record_of(truth, 2000))
    assert fit.ending is Ending.CONVERGED
    assert structure.name == fit.model.name == "hammerstein"
    zone = fit.model.blocks[0]
    assert isinstance(zone, DeadZone)
    np.testing.assert_allclose([zone.b_l, zone.b_r], [-0.5, 0.4], atol=0.03)


@pytest.mark.parametrize(
    ("record", "orders", "options", "message"),
    [
        (record_of(Cascade((BEND, SLOW)), 100), (9, 9), {}, "parameters for 100 samples"),
        (record_of(Cascade((BEND, SLOW)), 500), (-1, 2), {}, "order -1"),
        (record_of(Cascade((BEND, SLOW)), 500), (1.5, 2), {}, r"order 1\.5.* whole number"),
        (record_of(Cascade((BEND, SLOW)), 500), (1, 2, 3), {}, r"orders \(1, 2, 3\); give one for each filter"),
        (record_of(Cascade((BEND, SLOW)), 500), 2, {}, "orders 2; give one for each filter"),
        (
            record_of(Cascade((BEND, SLOW)), 500),
            None,
            {"static": "dead zone"},
            "no static map 'dead zone'",
        ),
        (record_of(Cascade((BEND, SLOW)), 900), (30, 30), {"size": 6}, r"takes 480 samples to start, .* have 225"),
        (record_of(Cascade((BEND, SLOW)), 500), (1, 1), {"delay": 500}, "a delay of 500 in a stretch of"),
        (record_of(Cascade((BEND, SLOW)), 45), None, {}, "10 parameters for 45 samples"),
        (record_of(Cascade((BEND, SLOW)), 70), (1, 2), {}, r"takes 24 samples to start, .* have 17"),
        (Record(np.zeros(500), np.random.default_rng(0).standard_normal(500), 1.0), (1, 1), {}, "is constant at 0"),
        (Record(np.ones((500, 2)), np.ones(500), 1.0), (1, 1), {}, "choose one of u1, u2"),
        (
            record_of(Cascade((BEND, SLOW)), 500),
            (1, 1),
            {"static": given(UserMap(lambda x, p: np.ones(3), lambda x, p: x))},
            r"returned shape \(3,\)",
        ),
        (
            record_of(Cascade((BEND, SLOW)), 500),
            (1, 1),
            {"static": given(UserMap(lambda x, p: np.where(x > 0, x, np.nan), lambda x, p: np.ones_like(x)))},
            "user map, or its derivative, is not finite at inputs such as -",
        ),
    ],
)
def test_bad_input(record: Record, orders: tuple[int, int], options: dict[str, object], message: str) -> None:
    with pytest.raises(EmsidError, match=message):
        wiener_hammerstein(record, orders, replace(AT_RATE, **options))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"delay": -1}, "delay -1"),
        ({"oversampling": 0}, "oversampling 0"),
        ({"size": 2.5}, r"size 2\.5"),
        ({"threads": 0}, "threads 0"),
        ({"transient": -3}, "transient -3"),
    ],
)
def test_invalid_numbers_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        CascadeSearch(**options)  # type: ignore[arg-type]


def test_no_record_and_unseen_data_that_are_too_short_are_refused() -> None:
    with pytest.raises(ModelError, match="no record"):
        hammerstein([])
    record = record_of(Cascade((BEND, SLOW)), 800)
    with pytest.raises(ModelError, match=r"takes 16 samples to start, .* have 5; give"):
        hammerstein(record, 2, replace(AT_RATE, size=6, unseen=record[:5]))


def test_a_single_step_does_not_separate_a_map_from_a_filter() -> None:
    u = np.repeat([0.0, 1.0], [20, 480])
    step = Record(u, SLOW.output(u, np.zeros(2)), 1.0)
    with pytest.raises(ModelError, match="wiener: the input changes 1 time between two values, too seldom"):
        wiener(step, 2, AT_RATE)


def test_a_map_of_two_levels_is_equivalent_to_a_gain() -> None:
    u = np.where(np.random.default_rng(0).random(500) > 0.5, 1.0, -1.0)
    with pytest.raises(ModelError, match="two values only, -1 and 1"):
        hammerstein(Record(u, SLOW.output(u, np.zeros(2)), 1.0), 2, AT_RATE)


@pytest.mark.long
@pytest.mark.recordings
@pytest.mark.parametrize(("estimator", "most"), [(hammerstein, 0.12), (wiener, 0.06), (hammerstein_wiener, 0.08)])
def test_a_drive_with_friction_gets_no_slow_pole_for_its_drift(
    recordings: Path, estimator: Callable[..., Fit[Cascade]], most: float
) -> None:
    """A slow pole runs through what it was fitted to and past what it was not; one quarter alone does not tell.

    The best linear model leaves 0.18.
    """
    record = read(
        recordings / "dc_motor_bidirectional" / "testBench_testAll_10ms.dat",
        input="PWM",
        output="mVel",
        dt=0.010048,
        mask="abs(PWM) > 255",
    )
    first, second = record.split(0.5)
    fit = estimator(first)
    assert fit.ending is Ending.CONVERGED, fit.findings
    assert unexplained(fit, second) < most


@pytest.mark.long
@pytest.mark.recordings
@pytest.mark.parametrize(("channel", "most"), [(0, 0.4), (1, 0.35)])
def test_drives_whose_sensor_loses_the_sign(recordings: Path, channel: int, most: float) -> None:
    values = np.loadtxt(recordings / "coupled_drives" / "uniform_first400.csv", delimiter=",", skiprows=1)
    first, second = Record(values[:, channel], values[:, channel + 2], 0.02).split(0.7)
    fit = wiener_hammerstein(first, None, CascadeSearch(static=ABS))
    assert unexplained(fit, second) < most


@pytest.mark.long
@pytest.mark.recordings
def test_orders_of_the_benchmark_circuit_are_found(recordings: Path) -> None:
    """Two filters of third order; the response alone asks for eight poles."""
    values = np.loadtxt(recordings / "wiener_hammerstein_2009" / "estimation.csv", delimiter=",", skiprows=1)
    record = Record(values[:, 0], values[:, 1], 1 / 51_200)
    fit = wiener_hammerstein(record[5200:35_000], None, CascadeSearch(size=25))
    assert [len(block.denominator) for block in fit.model.blocks if isinstance(block, Rational)] == [3, 3]
    assert unexplained(fit, record[85_000:]) < 0.0015


@pytest.mark.long
@pytest.mark.recordings
def test_benchmark_circuit(recordings: Path) -> None:
    """The circuit of 2009 from orders and a number of knots, on a part of the data short enough for a test."""
    values = np.loadtxt(recordings / "wiener_hammerstein_2009" / "estimation.csv", delimiter=",", skiprows=1)
    record = Record(values[:, 0], values[:, 1], 1 / 51_200)
    fit = wiener_hammerstein(record[5200:25_000], (3, 3), CascadeSearch(size=25, static=SPLINE))
    held = record[85_000:]
    run = fit.model.simulate(held)
    error = float(np.sqrt(np.mean((run.output - held.output)[run.counted] ** 2)))
    assert fit.model.oversampling == 2
    assert error < 0.26e-3


@pytest.mark.parametrize(("excitation", "order"), [pytest.param("multisine", 6, marks=pytest.mark.long), ("sines", 5)])
def test_a_pole_on_the_unit_circle_does_not_end_the_search(excitation: str, order: int) -> None:
    rng = np.random.default_rng(1)
    record = Bench.typical().run(Motor(), SIGNALS[excitation](1400, 0.005, 6.0, rng), 0.005, rng)
    _, a, _ = fit_rational(frequency_response([(record.input[:, 0], record.output[:, 0])]), order + 1, order)
    assert np.max(np.abs(np.roots(np.append(1.0, a)))) < 1 - 1e-4
    fit = wiener_hammerstein(record, (1, 1), CascadeSearch(threads=1, static=SPLINE, size=7))
    run = fit.model.simulate(record)
    assert fit_percent(record.output[run.counted], run.output[run.counted]) > 90


def test_every_choice_uses_all_heights_of_a_series_of_steps() -> None:
    steps = [Record(np.repeat([0.0, height], [100, 900]), np.ones(1000), 0.01) for height in np.linspace(-6, 6, 26)]
    series = concatenate(steps)
    _, [(known, unseen, _)] = held_back([series], CascadeSearch())
    for records in (shortened([series]), known, unseen):
        heights = np.concatenate([record.input[:, 0] for record in records])
        assert heights.min() < -4
        assert heights.max() > 4
    assert sum(map(len, shortened([series]))) <= CHOICE_SAMPLES
    assert not set(known[0].input[:, 0]) & set(unseen[0].input[:, 0]) - {0.0}
    single = Record(series.input, series.output, 0.01)
    assert len(shortened([single])[0]) == CHOICE_SAMPLES
    assert np.array_equal(shortened([single])[0].input, series.input[:CHOICE_SAMPLES])


def test_a_standstill_among_moving_segments_is_no_divergence() -> None:
    moving = record_of(Cascade((BEND, SLOW)), 500)
    still = replace(moving, input=np.zeros(500), output=np.full(500, 1e-9))
    run = Cascade((BEND, SLOW), output_offset=0.1).simulate(concatenate([moving, still]))
    assert run.diverged_at is None


def test_filters_of_order_zero_leave_the_map_alone() -> None:
    truth = Cascade((DeadZone(-0.5, 0.7, 1.2, 0.8),))
    fit = wiener_hammerstein(record_of(truth, 1500, noise=0.001), (0, 0), CascadeSearch(static=DEAD_ZONE))
    np.testing.assert_allclose(fit.model.blocks[1].parameters, [-0.5, 0.7, 1.2, 0.8], atol=0.01)
    assert fit.model.delay == 0


@pytest.mark.long
def test_a_map_that_loses_the_sign_is_found_in_a_short_record_although_nobody_names_it() -> None:
    rng = np.random.default_rng(2)
    truth = Cascade((Rational([0.0, 0.2, 0.1], [-1.4, 0.7]), Abs(), Rational([0.0, 0.5], [-0.5])))
    u = np.repeat(rng.uniform(-1, 1, 80), 5) + 0.2
    y = emsid.simulate(truth, u, dt=0.02).output[:, 0]
    noise = 0.02 * float(np.std(y))
    record = Record(u, y + noise * rng.standard_normal(len(y)), 0.02)
    fit = wiener_hammerstein(record[:300])
    assert np.sqrt(free_run_error(fit.model, [record[300:]])) < 2 * noise
