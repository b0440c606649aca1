"""Free-run errors by operating region and by record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import emsid
from emsid.blocks import Rational
from emsid.models.free_run import free_run_error
from emsid.report.views.front import record_table, region_tables
from emsid.validation.comparison import (
    REGIONS,
    as_fit,
    by_record,
    by_region,
    compare,
    errors_by_region,
    region_of,
    worst_region,
)

DT = 0.01


def speed(samples=400):
    """Forward, a quick reversal, backward, a rest, backward again."""
    parts = [np.full(100, 1.0), np.linspace(1, -1, 21)[1:-1], np.full(100, -1.0), np.zeros(101), np.full(80, -0.2)]
    return np.concatenate(parts)[:samples]


def model(gain=1.0, name="gain"):
    """A model without dynamics."""
    return as_fit(emsid.Cascade((Rational([gain], [], 0),), name=name))


def record(u, extra=0.0, name="record"):
    return emsid.Record(u, u + extra, DT, output_units=("rad/s",), name=name)


def test_the_regions_of_a_reversal_a_rest_and_two_speeds():
    names = np.array(REGIONS)[region_of(speed())]
    assert set(names[:100]) == {"high speed"}
    inside = names[100:119]
    assert set(inside[np.abs(speed()[100:119]) <= 0.3]) == {"reversal"}
    assert set(names[119:219]) == {"high speed"}
    assert set(names[219:320]) == {"standstill"}
    assert set(names[320:]) == {"low speed"}


def test_a_rest_between_two_directions_is_no_reversal_and_no_reversal_crosses_a_gap():
    y = np.concatenate([np.ones(50), np.linspace(1, 0, 5), np.zeros(60), np.linspace(0, -1, 5), -np.ones(50)])
    assert 2 not in region_of(y)
    assert 2 in region_of(speed())
    assert 2 not in region_of(speed(), breaks=(110,))


@settings(max_examples=30, deadline=None)
@given(arrays(float, 40, elements=st.floats(-5, 5)), st.floats(0.01, 100), st.booleans())
def test_regions_depend_on_the_range_of_the_output_and_not_on_its_unit_or_sign(y, scale, turned):
    assert np.array_equal(region_of(y), region_of(y * scale * (-1 if turned else 1)))
    assert set(region_of(y)) <= set(range(len(REGIONS)))


def test_the_regions_share_all_samples_and_the_whole_error():
    rng = np.random.default_rng(0)
    u = speed()
    (assessment,) = compare(model(0.9), record(u, 0.1 * rng.standard_normal(len(u)))).assessments
    errors = errors_by_region(assessment)
    assert sum(error.samples for error in errors) == assessment.row.samples
    assert sum(error.share for error in errors) == pytest.approx(1.0)
    squares = sum(error.samples * error.rmse**2 for error in errors)
    assert squares / assessment.row.samples == pytest.approx(assessment.row.simulation_mse)


def test_a_region_that_is_much_worse_is_named_and_equal_ones_are_not():
    u, noise = speed(), 0.05 * np.random.default_rng(0).standard_normal(400)
    (even,) = compare(model(), record(u, noise)).assessments
    assert worst_region(even) is None
    (uneven,) = compare(model(0.5), record(u, noise)).assessments
    found = worst_region(uneven)
    assert (found.code, found.subject, found.data["region"]) == ("error-in-region", "y1", "high speed")
    assert found.data["rmse"] > 4 * found.data["others"]
    (short,) = compare(model(0.5), record(u[:130], noise[:130])).assessments
    assert np.count_nonzero(region_of(u[:130]) != 3) < 50
    assert worst_region(short) is None
    (exact,) = compare(model(1 + 1e-12), record(u)).assessments
    assert worst_region(exact) is None


@pytest.mark.parametrize("unit", ["m", "deg"])
def test_a_position_has_no_regions(unit):
    u = np.r_[np.zeros(200), np.ones(200)]
    moved = replace(record(u, 0.3 * (u > 0)), output_units=(unit,))
    (run,) = compare([model()], moved).assessments
    assert errors_by_region(run) == ()
    assert worst_region(run) is None
    assert worst_region(compare([model()], replace(moved, output_units=("",))).best) is not None


def test_errors_by_record_are_those_of_each_record_alone():
    several = [record(speed(), extra, f"run {k}") for k, extra in enumerate((0.1, 0.3))]
    fits = [model(1.0, "a"), model(0.5, "b")]
    errors = by_record(fits, [*several, record(speed(1), name="short")])
    assert [(error.model, error.record) for error in errors] == [
        (name, run) for name in "ab" for run in ("run 0", "run 1", "short")
    ]
    for error in errors[:2]:
        alone = free_run_error(fits[0].model, [several[int(error.record[-1])]])
        assert error.rmse**2 == pytest.approx(alone)
    many = [record(speed(), k, f"run {k}") for k in range(7)]
    wide, long = record_table(errors), record_table(by_record(fits[:1], many))
    assert (wide.header, len(wide.rows)) == (("Model", "run 0", "run 1", "short"), 2)
    assert (long.header, len(long.rows)) == (("Record", "a"), 7)


def test_the_table_of_regions_has_a_row_for_every_model_and_the_samples():
    comparison = compare([model(1.0, "a"), model(0.5, "b")], record(speed(), 0.01))
    (table,) = region_tables(by_region(comparison), "on unseen data")
    assert table.header == ("Model", "Standstill", "Low speed", "Reversal", "High speed")
    assert [row[0] for row in table.rows] == ["a", "b", "samples"]


def test_the_table_of_regions_names_one_unit():
    turning = replace(record(speed(), 0.01), output_names=("Drehzahl [U/min]",))
    (table,) = region_tables(by_region(compare([model(1.0, "a")], turning)), "on unseen data")
    assert "of Drehzahl [rad/s], on" in table.caption


def test_an_identification_of_several_records_has_errors_by_region_and_record(tmp_path):
    rng = np.random.default_rng(1)
    several = []
    for k in range(2):
        u = np.repeat(rng.uniform(-1, 1, 40), 10)
        several.append(record(u, 0.05 * rng.standard_normal(400), f"run {k}"))
    result = emsid.identify(several, models="arx,friction-narx", options=emsid.Options(na=1, nb=1, nk=0))
    assert {(each.model, each.record) for each in result.by_record} == {
        (name, f"run {k}") for name in ("arx", "friction-narx") for k in range(2)
    }
    data = result.to_data()
    assert {each["region"] for each in data["regions"]} <= set(REGIONS)
    assert len(data["records"]) == 4
    assert {each["model"] for each in data["front"] if each["recommended"]} == {result.chosen.model.name}
    sizes = [each["parameters"] for each in data["front"]]
    assert sizes == sorted(sizes)
    only = emsid.identify(several[0], models="arx", options=emsid.Options(na=1, nb=1, nk=0))
    assert (only.by_record, only.to_data()["records"]) == ((), [])
