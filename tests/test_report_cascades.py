"""Figures and tables of cascades: static maps, frequency responses, equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import static_band
from emsid.models.blocks.static_maps import CoulombLinear, Polynomial, Saturation
from emsid.models.blocks.static_maps import DeadZone as DeadZoneMap
from emsid.report.document import Band, Line
from emsid.report.views import cascade as cascade_views
from report_examples import CASCADE_FITS, CASCADES, FIRST, SECOND, TABLES, of_cascade


@pytest.mark.parametrize("kind", [kind for kind in CASCADES if kind not in ("no map",)])
def test_a_static_map_is_drawn_where_its_signal_was_and_little_further(kind):
    fit, record = CASCADE_FITS[kind]
    model = fit.model
    figure = cascade_views.static_maps(fit, record)
    maps = [k for k, block in enumerate(model.blocks) if not isinstance(block, Rational)]
    assert len(figure.plots) == len(maps)
    for k, plot in zip(maps, figure.plots, strict=True):
        u, start = record.input[:, 0], slice(model.memory)
        signal = model.signals(u, model.initial_state(u[start], record.output[start, 0]))[k]
        signal = signal[model.memory * model.oversampling :]
        backdrop, band, line = plot.marks[:3]
        assert backdrop.backdrop
        assert backdrop.heights.sum() == len(signal)
        low, high = plot.x.range
        assert low < signal.min() <= signal.max() < high
        assert high - low == pytest.approx(np.ptp(signal), rel=0.1)
        assert (line.x[0], line.x[-1]) == pytest.approx((low, high))
        value, error = static_band(fit, k, line.x).T
        assert line.y == pytest.approx(value)
        assert band.upper - band.lower == pytest.approx(2 * 1.959964 * error, rel=1e-6, abs=1e-12)
        for marked in plot.marks[3:]:  # where the map has one, and inside
            assert marked.y == pytest.approx(model.blocks[k].value(marked.x))
            assert np.all((marked.x >= low) & (marked.x <= high))


def test_break_points_and_limits_are_marked():
    def marked(kind):
        return cascade_views.static_maps(*CASCADE_FITS[kind]).plots[0].marks[3]

    zone, limits = CASCADE_FITS["dead zone"][0].model.blocks[0], CASCADE_FITS["saturation"][0].model.blocks[1]
    assert marked("dead zone").x == pytest.approx([zone.b_l, zone.b_r])
    assert marked("saturation").y == pytest.approx([limits.low, limits.high])


def test_maps_are_in_the_units_of_the_record_as_far_as_gains_allow():
    def units(kind):
        return [(plot.x.unit, plot.y.unit) for plot in cascade_views.static_maps(*CASCADE_FITS[kind]).plots]

    assert units("spline") == [("V", "rad/s")]
    assert units("sign lost")[0][0] == units("sign lost")[0][1]
    assert units("piecewise") == [("V", cascade_views.CONVENTIONAL), (cascade_views.CONVENTIONAL, "rad/s")]


@pytest.mark.parametrize("kind", [kind for kind in CASCADES if kind != "no filter"])
def test_responses_of_filters_reach_half_the_sampling_rate_of_the_record(kind):
    fit, record = CASCADE_FITS[kind]
    figure = cascade_views.frequency_responses(fit, record.dt)
    filters = [block for block in fit.model.blocks if isinstance(block, Rational)]
    magnitude, phase = ([mark for mark in plot.marks if isinstance(mark, Line)] for plot in figure.plots)
    assert len(magnitude) == len(phase) == len(filters)
    for block, gain, turn in zip(filters, magnitude, phase, strict=True):
        assert gain.x[-1] == pytest.approx(0.5 / record.dt)
        response = block.response(gain.x, record.dt / fit.model.oversampling)
        assert 10 ** (gain.y / 20) * np.exp(1j * np.radians(turn.y)) == pytest.approx(response, abs=1e-9)


@pytest.mark.parametrize("part", [0, 1])
def test_the_band_of_a_response_is_that_of_the_parameters_to_first_order(part):
    """Against finite differences of magnitude (dB) and phase (deg)."""
    fit, record = CASCADE_FITS["spline"]
    band, line = cascade_views.frequency_responses(fit, record.dt).plots[part].marks[:2]
    block = fit.model.blocks[0]
    at = [fit.names.index(name) for name in fit.model.names[fit.model.spans[0]]]

    def shown(theta):
        response = block.with_parameters(theta).response(line.x, record.dt)
        return np.degrees(np.angle(response)) if part else 20 * np.log10(np.abs(response))

    theta = block.parameters
    slopes = np.array([(shown(theta + d) - shown(theta - d)) / 2e-6 for d in 1e-6 * np.eye(len(theta))])
    half = 1.959964 * np.sqrt(np.einsum("im,ij,jm->m", slopes, fit.covariance[np.ix_(at, at)], slopes))
    assert (band.upper - band.lower) / 2 == pytest.approx(half, rel=1e-4, abs=1e-6)


def test_an_undetermined_response_has_no_band_and_a_note():
    fit, record = CASCADE_FITS["spline"]
    names = [name for name in fit.names if name.startswith("G1")]
    at = [fit.names.index(name) for name in names]
    covariance = fit.covariance.copy()
    covariance[np.ix_(at, at)] += 1e20 * np.outer(*[fit.estimate[at] * (np.array(names) != "G1.a1")] * 2)  # its gain
    figure = cascade_views.frequency_responses(replace(fit, covariance=covariance), record.dt)
    for plot in figure.plots:
        assert len([mark for mark in plot.marks if isinstance(mark, Band)]) == 1
        lines = [mark for mark in plot.marks if isinstance(mark, Line)]
        assert len(lines) == 2
        for line in lines:
            assert plot.y.range[0] < np.nanmin(line.y)
            assert np.nanmax(line.y) < plot.y.range[1]
    assert "G1" in figure.caption
    assert "G1" not in cascade_views.frequency_responses(fit, record.dt).caption


def test_responses_do_not_reach_far_below_what_the_record_lasts():
    fit, record = CASCADE_FITS["spline"]
    slow = replace(fit.model, blocks=(Rational([0.1], [-1 + 1e-9]), *fit.model.blocks[1:]))
    figure = cascade_views.frequency_responses(replace(fit, model=slow), record.dt)
    assert figure.plots[0].marks[-1].x[0] == pytest.approx(0.1 / (fit.samples * record.dt), rel=1e-6)


def test_what_a_cascade_has_not_is_left_out():
    assert cascade_views.static_maps(*CASCADE_FITS["no map"]) is None
    assert cascade_views.frequency_responses(CASCADE_FITS["no filter"][0], 0.01) is None


def test_long_maps_are_counted_in_the_equation_and_listed_in_the_table():
    model = CASCADES["spline"]
    lines = cascade_views.cascade_equations(model).split("\n")
    assert lines[1] == "x2(t) = spline(x1(t); 9 knots from -5 to 5, see the table)"
    assert lines[::2] == model.equation().split("\n")[::2]
    last = replace(model, blocks=model.blocks[:2], output_offset=2.0)
    assert cascade_views.cascade_equations(last).endswith("see the table) + 2 + e(t)")
    short = CASCADES["piecewise"]
    assert cascade_views.cascade_equations(short) == short.equation()
    assert "value at -2.5 (block 2)" in [row[1] for row in TABLES["blocks"].rows]


def test_every_parameter_of_a_map_has_a_meaning():
    def meanings(*blocks):
        return cascade_views.block_column(of_cascade(Cascade(blocks))[0])["Meaning"]

    assert meanings(DeadZoneMap(-1.5, 1.0, 0.5, 1.0), SECOND)[:4] == (
        "dead-zone: left end of the zone (block 1)",
        "dead-zone: right end of the zone (block 1)",
        "dead-zone: slope on the left (block 1)",
        "dead-zone: slope on the right (block 1)",
    )
    assert meanings(FIRST, Saturation(0.8, -2.0, 1.5))[3:6] == (
        "saturation: slope (block 2)",
        "saturation: lower limit (block 2)",
        "saturation: upper limit (block 2)",
    )
    assert meanings(FIRST, CoulombLinear(0.5, 1.0, 0.1))[3:5] == (
        "coulomb: height of the sign (block 2)",
        "coulomb: slope (block 2)",
    )
    assert meanings(Polynomial(np.array([0.1, 1.0, 0.5]), -6, 5), SECOND)[2] == (
        "× Legendre polynomial 2, of -6 … 5 (block 1)"
    )
