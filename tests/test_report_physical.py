"""Figures and tables of physical models: parameters, friction, dead zone, sticking, profiles."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from emsid.models.plants.parameters import Signal
from emsid.models.plants.sensor import Sensor
from emsid.report.document import Band, Line, Points, Spans
from emsid.report.views import grey_box as grey_box_views
from emsid.report.views.grey_box import physical_table
from report_examples import PLANT_FITS, PROFILES


def test_every_physical_parameter_has_its_row_and_status():
    for kind, fit in PLANT_FITS.items():
        parameters, *rest = physical_table(fit)
        assert [row[0] for row in parameters.rows] == [row.name for row in fit.table]
        assert all(cells[4].startswith(row.how) for cells, row in zip(parameters.rows, fit.table, strict=True))
        assert bool(rest) == bool(fit.combinations)
        assert ("Datasheet" in parameters.header) == (kind == "datasheet")
        for cells, row in zip(parameters.rows, fit.table, strict=True):
            assert (" ± " in cells[5]) == (row.estimated and not row.may_be_zero)
            assert cells[5].startswith("less than ") == row.may_be_zero
            if " ± " in cells[5]:
                value, half = (float(part) for part in cells[5].split(" ± "))
                assert value == pytest.approx(row.value, abs=0.1 * half)
                assert half == pytest.approx(1.96 * row.standard_error, rel=0.05)


def test_a_parameter_with_an_interval_that_includes_zero_is_marked():
    fit = PLANT_FITS["axis"]
    table = physical_table(fit)[0]
    for cells, row in zip(table.rows, fit.table, strict=True):
        wide = row.standard_error is not None and 1.96 * row.standard_error > abs(row.value)
        assert ("interval includes zero" in cells[4]) == (wide and row.estimated)
    assert any("interval includes zero" in cells[4] for cells in table.rows)
    assert "interval includes zero: the parameter may be zero" in table.note.lower()
    assert "interval includes zero" not in physical_table(PLANT_FITS["rigid motor"])[0].note


def test_a_band_that_depends_on_kept_values_has_a_note():
    def values(kind):
        caption = grey_box_views.friction(PLANT_FITS[kind]).caption
        return re.findall(r"([a-z_.]+) = (\S+ [^\s,]*[^\s.,])", caption), "kept" in caption

    resistance, viscous = ("resistance", "2 Ω"), ("rotor_viscous", "1e-5 N·m·s/rad")
    assert values("no units") == ([resistance, viscous], True)
    assert values("rigid motor") == ([viscous, resistance], True)  # the kept one, then the fixed one
    for kind in ("rigid motor", "no units"):  # its edges are identifiable whatever was kept
        assert "kept" not in grey_box_views.dead_zone(PLANT_FITS[kind]).caption
    assert "kept" not in grey_box_views.friction(PLANT_FITS["datasheet"]).caption


def test_a_curve_of_which_nothing_was_estimated_has_no_band():
    figure = grey_box_views.friction(PLANT_FITS["datasheet"])
    assert not [mark for mark in figure.plots[0].marks if isinstance(mark, Band)]
    assert "95 %" not in figure.caption
    figure = grey_box_views.friction(PLANT_FITS["rigid motor"])
    assert [mark for mark in figure.plots[0].marks if isinstance(mark, Band)]
    assert "95 %" in figure.caption


def test_points_of_a_curve_are_where_the_data_are():
    fit = PLANT_FITS["rigid motor"]
    (plot,) = grey_box_views.friction(fit).plots
    (points,) = [mark for mark in plot.marks if isinstance(mark, Points) and mark.label == "with data"]
    factor = 1000 if plot.y.unit == "mN*m" else 1
    assert points.y == pytest.approx(factor * fit.model.plant.friction_characteristic().law(points.x))
    speeds = np.concatenate([segment.output[:, 0] for segment in fit.segments])
    width = 2 * np.max(np.abs(points.x)) / grey_box_views.STRETCHES
    assert len(points.x) >= 8
    for x in points.x:
        assert np.count_nonzero(np.abs(speeds - x) < width) >= grey_box_views.ENOUGH


def test_friction_is_the_law_of_the_plant_and_jumps_at_rest():
    fit = PLANT_FITS["rigid motor"]
    (plot,) = grey_box_views.friction(fit).plots
    (line,) = [mark for mark in plot.marks if isinstance(mark, Line) and mark.label == "friction torque"]
    factor = 1000 if plot.y.unit == "mN*m" else 1
    law = factor * fit.model.plant.friction_characteristic().law(line.x)
    shown = np.isfinite(line.y)
    assert shown.sum() > 0.5 * len(shown)
    assert line.y[shown] == pytest.approx(law[shown])
    broken = plot.marks[-1]
    motor = fit.model.plant.motor
    assert broken.y[1] == pytest.approx(factor * (motor.rotor_friction.breakaway[0] + motor.load_friction.breakaway[0]))


def test_the_dead_zone_is_shown_again_where_it_is_small():
    fit = PLANT_FITS["rigid motor"]
    whole, close = grey_box_views.dead_zone(fit).plots
    assert close.x.range[1] == pytest.approx(3 * fit.model.plant.motor.voltage_dead_zone.b_r)
    assert whole.x.range[1] > 10


def test_a_small_dead_zone_without_a_band_is_drawn(monkeypatch):
    """A search that ended before a minimum has no intervals."""
    fit = PLANT_FITS["rigid motor"]
    curve = grey_box_views.dead_zone_curve(fit, grey_box_views.POINTS)
    unknown = np.full_like(curve.y, np.nan)
    monkeypatch.setattr(grey_box_views, "dead_zone_curve", lambda *_: replace(curve, low=unknown, high=unknown))
    _, close = grey_box_views.dead_zone(fit).plots
    assert np.all(np.isfinite(close.y.range))
    assert close.y.range[0] < 0 < close.y.range[1]


@pytest.mark.parametrize("kind", ["rigid motor", "nothing known, with a lag"])
def test_the_motor_sticks_where_it_stands_still_whatever_the_sensor_shows(kind):
    fit = PLANT_FITS[kind]
    figure = grey_box_views.sticking(fit)
    spans, measured, _ = figure.plots[0].marks
    inside = np.zeros(len(measured.x), dtype=bool)
    for a, b in spans.edges:
        inside |= (measured.x >= a - 1e-9) & (measured.x < b - 1e-9)
    plant = fit.model.plant
    ideal = replace(plant, sensor=Sensor())
    speeds = np.concatenate(
        [
            ideal.simulate(segment.input, segment.dt, state, (Signal.SPEED,))[:, 0]
            for segment, state in zip(fit.segments, fit.states, strict=True)
        ]
    )
    at_rest = inside[np.isfinite(measured.y)]
    assert np.count_nonzero(speeds == 0) > 100
    assert np.mean(at_rest == (speeds == 0)) > 0.99
    residual = figure.plots[1].marks[-1].y
    assert residual[np.isfinite(residual)] == pytest.approx(
        np.concatenate([s.output[:, 0] for s in fit.segments]) - np.concatenate(fit.simulated())[:, 0]
    )


def test_a_profile_stands_beside_its_quadratic_approximation():
    fit, profile = PLANT_FITS["rigid motor"], PROFILES["taken"]
    figure = grey_box_views.likelihood(fit, profile)
    assert figure.name == "rigid-motor-profile-rotor-inertia"
    (plot,) = figure.plots
    spans, curve, quadratic, points, threshold = plot.marks
    assert plot.x.title == "Moment of inertia of the rotor, with the load [kg·m²]"
    assert tuple(spans.edges[0]) == profile.interval
    assert threshold.value == pytest.approx(3.841459)
    assert np.interp(spans.edges[0], curve.x, curve.y) == pytest.approx([threshold.value] * 2, rel=1e-3)
    approximate = profile.estimate + 1.96 * profile.standard_error * np.array([-1, 1])  # without weak priors
    assert profile.standard_error < fit["rotor_inertia"].standard_error
    assert np.interp(approximate, quadratic.x, quadratic.y) == pytest.approx([threshold.value] * 2, rel=1e-3)
    assert np.interp(points.x, curve.x, curve.y) == pytest.approx(points.y, abs=0.01)
    assert all(f"{end:.6g}" in figure.caption for end in (*profile.interval, *approximate))


def test_an_open_profile_is_shaded_to_the_edge():
    figure = grey_box_views.likelihood(PLANT_FITS["rigid motor"], PROFILES["open"])
    assert figure.plots[0].marks[0].edges[0] == pytest.approx([0.0, figure.plots[0].x.range[1]])
    assert re.findall(r"\S+ kg·m²", figure.caption)[0] == "0 kg·m²"  # its lower end


def test_a_plant_of_the_users_own_has_no_friction_to_show():
    fit = PLANT_FITS["own plant"]
    assert grey_box_views.friction(fit) is None
    assert grey_box_views.dead_zone(fit) is None
    sticking = grey_box_views.sticking(fit)
    assert not [mark for plot in sticking.plots for mark in plot.marks if isinstance(mark, Spans)]
