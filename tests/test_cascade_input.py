"""What a search for a cascade is given: arguments and records that are refused, and records that do not suffice."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import emsid
from cascade_searches import AT_RATE, BEND, DEAD_ZONE, SLOW, hammerstein, record_of, wiener, wiener_hammerstein
from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.cross_validation import HAMMERSTEIN, CascadeSearch
from emsid.models.blocks.search.estimation import CascadeStructure, advice
from emsid.models.blocks.search.map_families import given
from emsid.models.blocks.static_maps import CubicSpline, DeadZone, Saturation, UserMap
from emsid.record import Record, concatenate


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
            {"static": given(UserMap(lambda x, p: x[: 101 if len(x) == 101 else 3], lambda x, p: np.ones_like(x)))},
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


# --- records that do not suffice -------------------------------------------------------------------------------------


def test_a_single_step_does_not_separate_a_map_from_a_filter() -> None:
    u = np.repeat([0.0, 1.0], [20, 480])
    step = Record(u, SLOW.output(u, np.zeros(2)), 1.0)
    with pytest.raises(ModelError, match="wiener: the input changes 1 time between two values, too seldom"):
        wiener(step, 2, AT_RATE)


def test_a_map_of_two_levels_is_equivalent_to_a_gain() -> None:
    u = np.where(np.random.default_rng(0).random(500) > 0.5, 1.0, -1.0)
    with pytest.raises(ModelError, match="two values only, -1 and 1"):
        hammerstein(Record(u, SLOW.output(u, np.zeros(2)), 1.0), 2, AT_RATE)


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
    assert about(Saturation(1.0, -1.0, 90.0), SLOW) == [("limit-unseen", {"block": 1, "side": "high", "share": 0.0})]
    assert about(DeadZone(-0.5, 0.5), SLOW) == []
    model = Cascade((DeadZone(-0.5, 0.5), SLOW))
    lost = Fit(model, ("f.b_l", "f.b_r"), np.zeros(2), np.diag([np.inf, 1.0]), 1.0, 1000, 1.0, 2)
    assert [(f.code, f.data) for f in advice(lost, record)] == [
        ("parameters-without-interval", {"parameters": ["f.b_l"]})
    ]


def test_a_standstill_among_moving_segments_is_no_divergence() -> None:
    moving = record_of(Cascade((BEND, SLOW)), 500)
    still = replace(moving, input=np.zeros(500), output=np.full(500, 1e-9))
    run = Cascade((BEND, SLOW), output_offset=0.1).simulate(concatenate([moving, still]))
    assert run.diverged_at is None
