"""Figures and tables of results: responses, residuals, rankings, convergence, errors and parameters."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import emsid
from emsid.errors import DataError
from emsid.estimation.fit import Fit
from emsid.record import Record
from emsid.report import tracking_page, views
from emsid.report.document import Dash, Ink
from emsid.report.figures import draw
from emsid.validation.comparison import Row, assess, compare, labels
from emsid.validation.correlation import autocorrelation, cross_correlation, input_test, limit_over
from emsid.wording import sentence
from report_examples import (
    COMPARISONS,
    FIGURES,
    MOTORS,
    RECURSIVE,
    RUNAWAY,
    STRUCTURES,
    TABLES,
    VIEWS,
    drive,
    error_of,
    two_outputs,
    with_gaps,
)

each_table = pytest.mark.parametrize("table", VIEWS["tables"], indirect=True)


@pytest.fixture
def table(request):
    return TABLES[request.param]


# --- one record ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("record", [drive(), with_gaps(), drive(30)], ids=["whole", "with gaps", "short"])
@pytest.mark.parametrize("width", [0.02, 0.5, 2.0, 100.0])
@pytest.mark.parametrize("judged", [False, True], ids=["by rest", "by error"])
def test_critical_intervals_lie_apart_inside_one_segment(record, width, judged):
    error = np.abs(record.output) if judged else None
    intervals = views.critical_intervals(record, width, error)
    assert 1 <= len(intervals) <= 2
    edges = (0, *record.breaks, len(record))
    for rows in intervals:
        first = max(edge for edge in edges if edge <= rows.start)
        following = min(edge for edge in edges if edge > rows.start)
        assert rows.stop <= following
        assert rows.stop - rows.start == min(max(2, round(width / record.dt)), following - first)
    assert all(a.stop <= b.start for a, b in pairwise(intervals))


def test_critical_intervals_are_where_the_error_is_and_the_output_turns():
    record = drive()
    error = np.zeros(len(record))
    turn = 1 + np.flatnonzero(np.diff(np.sign(record.output[:, 0])))[10]
    error[turn - 5 : turn + 5] = 1.0
    assert any(rows.start <= turn < rows.stop for rows in views.critical_intervals(record, 0.4, error))


def test_an_output_that_never_turns_has_intervals_too():
    record = Record(np.ones(100), 5 + np.arange(100.0), 0.1)
    assert views.critical_intervals(record, 1.0, np.arange(100.0))[-1] == slice(90, 100)


def test_models_look_as_in_the_paper():
    figure = FIGURES["responses, whole"]
    measured, first, second = (mark.stroke for mark in figure.plots[0].marks[:3])
    assert (measured.ink, measured.dash) == (Ink.BLUE, Dash.SOLID)
    assert (first.ink, first.dash) == (Ink.RED, Dash.SOLID)
    assert second.dash is Dash.DOTTED


def test_the_responses_are_the_runs():
    result = COMPARISONS["whole"]
    rows = views.critical_intervals(result.best.record, 1.0)
    figure = views.responses(result.assessments, rows)
    for plot, part in zip(figure.plots, rows, strict=True):
        for line, assessment in zip(plot.marks[1:], result.assessments, strict=True):
            assert np.array_equal(line.y, assessment.simulation.output[part, 0], equal_nan=True)


def test_labels_name_the_method_where_a_model_stands_there_twice():
    structure, record = STRUCTURES[0], drive()
    both = [emsid.least_squares(structure, record), emsid.recursive_least_squares(structure, record)]
    assert labels([assess(fit, record) for fit in both]) == ("arx, one step", "arx, recursive")
    assert labels([assess(both[0], record)]) == ("arx",)
    assert labels([assess(both[0], record)] * 2) == ("arx, one step, no. 1", "arx, one step, no. 2")


def test_nonlinear_correlations_are_drawn_with_the_band_of_their_test():
    result = COMPARISONS["whole"]
    tests = result.best.nonlinear_tests[0]
    plots = views.nonlinear_correlations(result.assessments).plots
    assert [plot.title for plot in plots] == [f"Residual against {test.term}" for test in tests]
    for plot, test in zip(plots, tests, strict=True):
        np.testing.assert_array_equal(plot.marks[0].y, test.curve)
        assert [mark.value for mark in plot.marks[-2:]] == [test.limit, -test.limit]
    constant = assess(RECURSIVE[0], replace(drive(), input=np.ones((len(drive()), 1))))
    assert views.nonlinear_correlations([constant]) is None


def test_residuals_show_shares_and_autocorrelation():
    result = COMPARISONS["whole"]
    _, distribution, correlation, _ = views.residuals(result.assessments[:1]).plots
    (histogram,) = distribution.marks
    assert histogram.heights.sum() == pytest.approx(100)
    line = correlation.marks[0]
    best = result.best
    error = (best.record.output - best.simulation.output)[best.simulation.counted, 0]
    error = error - error.mean()
    expected = [error[: len(error) - k] @ error[k:] / (error @ error) for k in range(len(line.y))]
    assert np.allclose(line.y, expected, atol=1e-12)
    # At the level of the table of tests: 99 of 100 white residuals are within it at all lags.
    assert correlation.marks[1].value == pytest.approx(limit_over(len(line.y) - 1) / np.sqrt(len(error)))


# --- several outputs ------------------------------------------------------------------------------------------------


def by_hand(assessment, channel):
    """RMSE and fit of one output's free run."""
    counted = assessment.simulation.counted
    y, run = assessment.record.output[counted, channel], assessment.simulation.output[counted, channel]
    rmse = np.sqrt(np.mean((y - run) ** 2))
    return rmse, 100 * (1 - rmse / np.std(y))


def test_every_output_has_its_own_errors_in_its_own_unit():
    _, runs = two_outputs()
    for assessment in runs:
        table = views.results_table([assessment.row])
        assert [row[2:4] for row in table.rows] == [("speed", "rad/s"), ("current", "A")]
        for k, cells in enumerate(table.rows):
            rmse, fit = by_hand(assessment, k)
            assert float(cells[4]) == pytest.approx(fit, abs=0.005)
            assert float(cells[5]) == pytest.approx(rmse, rel=1e-3)
            assert float(cells[6]) == pytest.approx(rmse**2, rel=1e-3)
    table = views.results_table([run.row for run in runs])
    assert table.emphasised == {0, 1}
    assert "rad/s" not in table.caption


def test_every_output_has_its_own_panels():
    two, runs = two_outputs()
    near = runs[0]
    figure = views.measured_and_simulated(near)
    assert [plot.y.title for plot in figure.plots] == [
        "Speed [rad/s]", "Residual [rad/s]", "Current [A]", "Residual [A]",
    ]  # fmt: skip
    for k in (0, 1):
        run, left = figure.plots[2 * k : 2 * k + 2]
        between = np.isfinite(run.marks[0].y)
        free = np.where(near.simulation.counted, near.simulation.output[:, k], np.nan)
        assert run.marks[0].y[between] == pytest.approx(two.output[:, k])
        assert run.marks[1].y[between] == pytest.approx(free, nan_ok=True)
        assert left.marks[0].y[between] == pytest.approx(two.output[:, k] - free, nan_ok=True)
        rmse, fit = by_hand(near, k)
        assert f"fit {fit:.1f} %, RMSE {rmse:.4g} {two.output_units[k]}" in figure.caption


def test_critical_intervals_count_every_output_by_how_much_it_varies():
    two, _ = two_outputs()
    record = replace(two, output=np.column_stack([drive().output, 1e-3 * drive(seed=9).output])[: len(two)])
    error = np.zeros_like(record.output)
    turn = 1 + np.flatnonzero(np.diff(np.sign(record.output[:500, 1])))[3]
    error[turn - 3 : turn + 3, 1] = 1e-3  # small, as that output is
    error[:, 0] = 1e-3
    assert any(rows.start <= turn < rows.stop for rows in views.critical_intervals(record, 0.3, error, count=1))


def test_responses_show_every_output_on_every_interval():
    two, runs = two_outputs()
    rows = views.critical_intervals(two, 0.5, error_of(runs[1]))
    figure = views.responses(runs, rows)
    shown = [(part, k) for part in rows for k in (0, 1)]
    for plot, (part, k) in zip(figure.plots, shown, strict=True):
        assert plot.title.endswith(two.output_names[k])
        for line, run in zip(plot.marks[1:], runs, strict=True):
            assert np.array_equal(line.y, run.simulation.output[part, k], equal_nan=True)
    assert f"{by_hand(runs[0], 1)[1]:.1f} % of current" in figure.caption


def test_residuals_of_every_output_are_tested():
    two, runs = two_outputs()
    plots = views.residuals(runs).plots
    assert [plot.title for plot in plots[:4]] == [
        "Residual: speed",
        "Distribution: speed", "Autocorrelation: speed", "Cross-correlation with voltage: speed",
    ]  # fmt: skip
    assert len(plots) == 8
    for k in (0, 1):
        error = np.where(runs[0].simulation.counted, error_of(runs[0])[:, k], np.nan)
        over_time, _, own, crossed = plots[4 * k : 4 * k + 4]
        assert over_time.y.unit == two.output_units[k]
        assert own.marks[0].y == pytest.approx(autocorrelation(error, two.breaks, len(own.marks[0].y) - 1))
        lags = len(crossed.marks[0].y) // 2
        assert crossed.marks[0].y == pytest.approx(cross_correlation(error, two.input[:, 0], two.breaks, lags))
        assert crossed.marks[0].x[[0, -1]] == pytest.approx([-lags * two.dt, lags * two.dt])
        test = input_test(error, two.input[:, 0], two.breaks, lags)
        assert [mark.value for mark in crossed.marks[-2:]] == [test.limit, -test.limit]


def test_every_output_is_ranked_in_its_own_unit():
    two, runs = two_outputs()
    result = compare([run.fit for run in runs], two)
    figure = views.ranking(result)
    assert [plot.x.title for plot in figure.plots] == ["RMSE of speed [rad/s]", "RMSE of current [A]"]
    for k, plot in enumerate(figure.plots):
        assert plot.marks[0].values == pytest.approx([by_hand(assessment, k)[0] for assessment in result.assessments])


def test_every_input_has_its_plots():
    assert [plot.y.title for plot in FIGURES["two inputs"].plots] == ["u1 [V]", "u2 [A]"]
    titles = [plot.title for plot in FIGURES["two inputs, residuals"].plots]
    assert titles[-2:] == ["Cross-correlation with u1", "Cross-correlation with u2"]


def test_residuals_of_a_perfect_model_can_be_drawn():
    u = np.random.default_rng(0).standard_normal(300)
    y = np.zeros(300)
    for k in range(1, 300):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    record = Record(u, y, 0.1, output_units=("V",))
    exact = assess(Fit(emsid.arx(1, 1).model(np.array([-0.5, 1.0]), record), ("a1", "b1"), np.array([-0.5, 1.0]),
                       np.eye(2), 0.0, 299, 1.0, 2), record)  # fmt: skip
    assert exact.row.simulation_mse == 0
    for figure in (views.residuals([exact]), views.ranking(compare([exact.fit], record))):
        assert draw(figure)["svg"]


def test_convergence_ends_where_the_estimate_is():
    fit = RECURSIVE[0]
    lines = [mark for plot in views.convergence(fit).plots for mark in plot.marks]
    assert [line.y[-1] for line in lines] == pytest.approx(fit.estimate)
    assert all(line.x[-1] == len(fit.history) for line in lines)


def test_convergence_without_history_says_what_to_do():
    with pytest.raises(DataError, match="history=True"):
        views.convergence(emsid.least_squares(STRUCTURES[0], drive()))


def test_ranking_has_the_best_at_the_top_and_says_who_diverged():
    (plot,) = views.ranking(COMPARISONS["whole"]).plots
    bars = plot.marks[0]
    assert list(bars.values) == sorted(bars.values)
    assert plot.y.names[0] == COMPARISONS["whole"].best.row.model
    assert bars.remarks[-1].startswith("diverged at sample")
    assert plot.x.log


def test_friction_jumps_from_break_away_to_break_away():
    figure = views.nonlinearities(MOTORS["uneven"])
    line, points = figure.plots[-1].marks
    at_rest = np.abs(line.x) < 1e-6
    assert line.y[at_rest] == pytest.approx([-200, 150])  # mN·m
    assert figure.plots[-1].y.title == "Friction torque [mN·m]"
    assert points.y == pytest.approx([-200, 150])


# --- tables ---------------------------------------------------------------------------------------------------------


@each_table
def test_tables_are_rectangular_and_say_what_they_show(table):
    assert all(len(row) == len(table.header) for row in table.rows)
    assert table.caption
    for cell in (cell for row in table.rows for k, cell in enumerate(row) if not table.is_text(k)):
        assert not re.search(r"nan|inf|None", cell)


def test_the_best_free_run_on_unseen_data_stands_out():
    def row(experiment, model, data, mse):
        return Row(experiment, model, "ls", data, 1.0, mse, mse**0.5, 90.0, 3, 100)

    rows = [
        row("simulation", "a", "identification", 0.1),
        row("simulation", "a", "unseen", 3.0),
        row("simulation", "b", "unseen", 2.0),
        row("experiment", "a", "unseen", 1.0),
        row("experiment", "b", "unseen", np.inf),
    ]
    table = views.results_table(rows)
    assert table.emphasised == {2, 3}
    assert table.header[0] == "Experiment"
    assert "MSE in m², RMSE in m." in views.results_table(rows, unit="m").caption
    assert "MSE in (rad/s)², RMSE in rad/s." in views.results_table(rows, unit="rad/s").caption


def test_a_run_that_diverged_is_named_below_the_table():
    assert "diverged at sample" in TABLES["results"].note


def test_intervals_are_those_of_the_fit():
    fit = RECURSIVE[0]
    for row, value, (low, high) in zip(views.parameter_table(fit).rows, fit.estimate, fit.interval(), strict=True):
        printed_low, printed_high = (float(text) for text in row[2].split(" … "))
        assert float(row[1]) == pytest.approx(value, abs=0.05 * (high - low))
        assert (printed_low, printed_high) == pytest.approx((low, high), abs=0.05 * (high - low))


def test_parameters_that_the_data_do_not_determine_are_named():
    assert TABLES["undetermined parameters"].rows[1][2] == "not determined by these data"
    (finding,) = RUNAWAY.findings
    (remark,) = views.model_section(RUNAWAY, drive()).remarks
    assert remark.lower() == sentence(finding).lower()


def test_an_axis_has_the_unit_that_only_the_name_of_its_column_gives():
    record = replace(drive(), output_names=("Motor_Speed(RPM)",), output_units=("",))
    assessment = assess(emsid.least_squares(emsid.arx(1, 1), record), record)
    for figure in (views.measured_and_simulated(assessment), views.residuals([assessment])):
        units = {axis.unit for plot in figure.plots for axis in (plot.x, plot.y)}
        assert "RPM" in units
        assert "" not in units
    assert views.measured_and_simulated(assessment).plots[0].y.title == "Motor_Speed [RPM]"


def test_an_estimate_outside_the_range_is_not_drawn_at_its_edge() -> None:
    estimate = np.concatenate([np.zeros(3), np.linspace(1.8, 1.9, 97)])[:, None]
    history = SimpleNamespace(time=0.1 * np.arange(100), estimate=estimate, half_width=np.full((100, 1), 0.05))
    fit = SimpleNamespace(names=("b1",), model=SimpleNamespace(name="arx", structure=emsid.arx(0, 1)))
    session = SimpleNamespace(history=history, fit=fit, changes=[], recent=[(drive(),)])
    figure = tracking_page.convergence(session)
    _, line = figure.plots[0].marks
    np.testing.assert_array_equal(line.y, estimate[:, 0])
    assert figure.plots[0].y.range[0] > 1
    assert "changes" not in figure.caption
