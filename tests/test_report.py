"""Reports: what every figure and table owes its reader, and a page that needs nothing but itself."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from base64 import b64decode
from dataclasses import fields, replace
from itertools import chain, pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import emsid
from emsid.errors import DataError
from emsid.estimation.fit import Ending, Fit
from emsid.plant import DeadZone, Friction, Motor
from emsid.record import Record, concatenate
from emsid.report import content, views
from emsid.report.content import (
    Axis,
    Band,
    Bars,
    Dash,
    Figure,
    Histogram,
    Ink,
    Level,
    Line,
    Plot,
    Points,
    Report,
    Section,
    Stroke,
    Table,
    thin,
)
from emsid.report.figures import draw, interactive, plotly_source
from emsid.report.page import page, write_report
from emsid.validation.comparison import Row, assess, compare

NASTY = '<script>alert("$x_1$")</script>'


def drive(samples=1200, seed=0, name="bench", dt=0.01):
    """A record of a first-order drive with a dead zone and friction, so that a linear model has trouble."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(samples)
    u = 3 * np.sin(2 * np.pi * 0.4 * t) + 2 * np.sin(2 * np.pi * 1.3 * t + seed)
    y = np.zeros(samples)
    for k in range(1, samples):
        push = np.sign(u[k - 1]) * max(abs(u[k - 1]) - 1.5, 0.0)
        y[k] = 0.9 * y[k - 1] + push
    y += 0.02 * rng.standard_normal(samples)
    return Record(u, y, dt, ("voltage",), ("speed",), ("V",), ("rad/s",), name=name)


def with_gaps():
    """The same in three pieces, the last of them an experiment of its own that begins at zero again."""
    record = drive()
    masked = record.mask((np.arange(len(record)) // 200) % 3 == 1)
    return concatenate([masked, drive(300, seed=3)])


STRUCTURES = (
    emsid.arx(na=2, nb=2),
    emsid.wiener_hammerstein_regression(na=2, nb=2, degree=2),
    emsid.friction_narx(na=1, nb=2, knots=(-1.5, 1.5)),
)
RUNAWAY = Fit(emsid.arx(1, 1).model(np.array([-1.2, 1.0]), drive(10)), ("a1", "b1"), np.array([-1.2, 1.0]),
              np.diag([0.1, np.inf]), 1.0, 100, 1.0, 1, Ending.RANK_DEFICIENT, "b1 cannot be told")  # fmt: skip


def comparison(record):
    return compare([*(emsid.least_squares(structure, drive(seed=1)) for structure in STRUCTURES), RUNAWAY], record)


COMPARISONS = {"whole": comparison(drive()), "with gaps": comparison(with_gaps())}
RECURSIVE = [emsid.recursive_least_squares(structure, drive(), history=True) for structure in STRUCTURES]
MOTORS = {
    "default": Motor(),
    "two dead zones": Motor(torque_dead_zone=DeadZone(-1e-3, 2e-3, 0.5, 2.0)),
    "no dead zone": Motor(voltage_dead_zone=None),
    "uneven": Motor(rotor_friction=Friction((0.1, 0.2), (0.05, 0.0), 0.4), load_friction=Friction()),
    "linear": Motor(voltage_dead_zone=None, rotor_friction=Friction(), load_friction=Friction()),
}


def every_figure():
    """Every view of every kind of result."""
    for kind, motor in MOTORS.items():
        yield f"nonlinearities of a motor, {kind}", views.nonlinearities(motor)
    for kind, result in COMPARISONS.items():
        record, each = result.best.record, result.assessments
        error = record.output - each[1].simulation.output
        yield f"inputs, {kind}", views.inputs([record, drive()])
        yield f"responses, {kind}", views.responses(each, views.critical_intervals(record, 1.0, error))
        yield f"residuals, {kind}", views.residuals(each)
        yield f"ranking, {kind}", views.ranking(result)
        for assessment in each:
            yield f"{assessment.row.model} on a record {kind}", views.measured_and_simulated(assessment)
    for fit in RECURSIVE:
        yield (
            f"convergence of {fit.model.name}",
            views.convergence(fit, emsid.least_squares(fit.model.structure, drive())),
        )
    yield "convergence without batch", views.convergence(RECURSIVE[0])
    yield "every mark", every_mark()


def every_mark():
    x = np.linspace(0.1, 10, 50)
    marks = (
        Histogram(np.linspace(0, 10, 21), np.arange(20.0), "data", backdrop=True),
        Band(x, x - 1, x + 1, "95 % band"),
        Line(x, x, "map", Stroke(Ink.RED, Dash.DASH_DOTTED)),
        Line(x, x**0.5, "held", held=True),
        Points(x[::10], x[::10], "points", Ink.GREEN),
        Level(5.0, "level"),
        Histogram(np.linspace(0, 10, 11), np.ones(10), "outline"),
    )
    gain = Plot((Line(x, -20 * np.log10(x), "first filter"),), Axis("Frequency", "Hz", log=True), Axis("Gain", "dB"))
    bars = Plot((Bars(np.array([2.0, np.inf]), ("2", "none")),), Axis("RMSE", "V"), Axis("Model", names=("a", "b")))
    return Figure("marks", "All marks.", (Plot(marks, Axis("u", "V"), Axis("w", "V"), span=2), gain, bars), columns=2)


FIGURES = dict(every_figure())
TABLES = {
    "results": views.results_table(COMPARISONS["whole"].rows, unit="rad/s"),
    "results and the paper": views.results_table(
        COMPARISONS["whole"].rows, views.Reference("Paper", "another motor", {("arx", "verification"): 0.0023})
    ),
    "parameters": views.parameter_table(RECURSIVE[2], columns=views.regressor_column(RECURSIVE[2])),
    "parameters not told apart": views.parameter_table(RUNAWAY),
    "motor": views.motor_table(MOTORS["uneven"]),
    "rigid motor": views.motor_table(Motor().rigid()),
}

each_figure = pytest.mark.parametrize("figure", FIGURES.values(), ids=FIGURES.keys())
each_table = pytest.mark.parametrize("table", TABLES.values(), ids=TABLES.keys())


# --- what every figure owes -----------------------------------------------------------------------------------------


@each_figure
def test_axes_name_quantity_and_unit(figure):
    for axis in chain.from_iterable((plot.x, plot.y) for plot in figure.plots):
        assert axis.names or re.fullmatch(r".+ \[.+\]", axis.title)
        assert "?" not in axis.title
    assert figure.caption.endswith(".")


@each_figure
def test_arrays_of_a_mark_belong_together(figure):
    for mark in chain.from_iterable(plot.marks for plot in figure.plots):
        match mark:
            case Line(x, y) | Points(x, y):
                assert x.shape == y.shape == (len(x),)
                assert np.isfinite(x).all()
                assert isinstance(mark, Points) or np.all(np.diff(x) > 0)
            case Histogram(edges, heights):
                assert edges.shape == (len(heights) + 1,)
            case Bars(values, remarks):
                assert len(values) == len(remarks)


@each_figure
def test_drawing_is_deterministic_and_whole(figure):
    first, second = draw(figure), draw(figure)
    assert first == second
    root = ElementTree.fromstring(first.svg)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert first.pdf.startswith(b"%PDF")
    assert first.pdf.rstrip().endswith(b"%%EOF")
    assert b"CreationDate" not in first.pdf
    assert b"dc:date" not in first.svg
    links = [value for node in root.iter() for key, value in node.items() if key.endswith("href")]
    assert all(link.startswith("#") for link in links)


@each_figure
def test_no_plot_is_empty_and_nothing_lies_outside(figure):
    """Every plot on the sheet shows a mark, has room for itself, and no two overlap, with their labels."""
    from matplotlib import rc_context

    from emsid.report import figures

    with rc_context(figures._SETTINGS):
        sheet = figures._sheet(figure)
        sheet.draw_without_rendering()
        width, height = sheet.bbox.size
        boxes = [axes.get_tightbbox() for axes in sheet.axes]
    for axes in sheet.axes:
        assert axes.has_data()
    for k, box in enumerate(boxes):
        assert box.x0 >= -1
        assert box.y0 >= -1
        assert box.x1 <= width + 1
        assert box.y1 <= height + 1
        for other in boxes[:k]:
            across = min(box.x1, other.x1) - max(box.x0, other.x0)
            down = min(box.y1, other.y1) - max(box.y0, other.y0)
            assert min(across, down) < 1


@each_figure
def test_plotly_accepts_every_plot(figure):
    import plotly.graph_objects as go

    for plot in figure.plots:
        specification = interactive(plot)
        go.Figure(specification)  # raises for a property that Plotly does not know
        json.loads(json.dumps(specification, allow_nan=False))
        labels = [mark.label for mark in plot.marks if mark.label]
        shown = [each for each in (*specification["data"], *specification["layout"]["shapes"]) if each["showlegend"]]
        assert len(shown) == len(labels)


def test_text_is_never_markup_or_mathematics():
    x = np.arange(3.0)
    figure = Figure(
        "nasty", NASTY, (Plot((Line(x, x, "<b>$\\frac{$</b>"),), Axis("$x", "<i>"), Axis(NASTY), "a $b$ c"),)
    )
    assert draw(figure).svg
    specification = interactive(figure.plots[0])
    assert specification["data"][0]["name"] == "&lt;b&gt;$\\frac{$&lt;/b&gt;"
    assert "<" not in specification["layout"]["yaxis"]["title"]["text"]


def test_legends_show_every_line_in_its_own_look():
    from matplotlib import rc_context

    from emsid.report import figures

    x = np.arange(3.0)
    same = [Line(x, k * x, "same name", Stroke(ink)) for k, ink in enumerate((Ink.RED, Ink.GREEN))]
    marks = (*same, Band(x, x, x + 1, "band"), Line(x, x, "_last", Stroke(Ink.NAVY)))
    with rc_context(figures._SETTINGS):
        (axes,) = figures._sheet(Figure("a", "A.", (Plot(marks, Axis("x", "s"), Axis("y", "V")),))).axes
    legend = axes.get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["same name", "same name", "band", "_last"]
    assert [line.get_color() for line in legend.get_lines()] == [Ink.RED.value, Ink.GREEN.value, Ink.NAVY.value]


def test_drawing_leaves_the_settings_of_matplotlib_alone():
    import matplotlib

    before = dict(matplotlib.rcParams)
    draw(FIGURES["every mark"])
    assert dict(matplotlib.rcParams) == before


def test_drawing_does_without_pyplot_and_its_state():
    code = (
        "import sys\n"
        "from emsid.plant import Motor\n"
        "from emsid.report import figures, views\n"
        "figures.draw(views.nonlinearities(Motor()))\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_content_needs_no_plotting_library():
    code = (
        "import sys, emsid.report\n"
        "heavy = {'matplotlib', 'plotly', 'jinja2', 'numba', 'scipy'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# --- thinning and gaps ----------------------------------------------------------------------------------------------

values = st.floats(-1e6, 1e6) | st.just(np.nan)


@settings(deadline=None)
@given(arrays(float, st.integers(1, 500), elements=values), st.integers(6, 200))
def test_thinning_keeps_ends_extremes_order_and_gaps(y, limit):
    x = np.arange(len(y), dtype=float)
    kept, thinned = thin(x, y, limit)
    assert len(kept) <= max(limit, 6) or len(y) <= limit
    assert (kept[0], kept[-1]) == (0, len(y) - 1)
    assert np.all(np.diff(kept) > 0)
    assert np.array_equal(thinned, y[kept.astype(int)], equal_nan=True)
    if not np.isnan(y).all():
        assert np.nanmin(thinned) == np.nanmin(y)
        assert np.nanmax(thinned) == np.nanmax(y)
    assert np.isnan(thinned).any() == np.isnan(y).any()


def test_thinning_keeps_the_envelope():
    x = np.linspace(0, 60, 300_000)
    y = np.sin(200 * x) * np.sin(x)
    kept, thinned = thin(x, y, 4000)
    assert len(kept) <= 4000
    bucket = 60 / 1999
    for start in np.arange(1, 59, 0.37):
        inside = y[(x >= start) & (x < start + 0.3)]
        near = thinned[(kept >= start - bucket) & (kept < start + 0.3 + bucket)]
        assert near.min() <= inside.min()
        assert near.max() >= inside.max()


def test_no_line_is_drawn_across_a_gap_after_thinning():
    y = np.arange(10_000.0)
    y[3000:3003] = y[7000] = np.nan
    kept, thinned = thin(np.arange(10_000.0), y, 400)
    for gap in (3001, 7000):
        between = (kept >= gap - 1) & (kept <= gap + 1)
        assert np.isnan(thinned[between]).any()


def test_a_record_in_pieces_is_drawn_with_gaps():
    record = with_gaps()
    pieces = len(record.segments)
    for figure in (views.inputs([record]), views.measured_and_simulated(COMPARISONS["with gaps"].best)):
        for plot in figure.plots:
            for line in plot.marks:
                assert np.count_nonzero(np.isnan(line.y)) == pieces - 1
                assert np.all(np.diff(line.x) > 0)
                assert len(line.x) == len(record) + pieces - 1


def test_a_gap_lies_where_the_samples_are_missing():
    record = drive(100).mask((np.arange(100) >= 40) & (np.arange(100) < 60))
    time, samples = views.timeline(record)
    assert 0.39 < time[samples == -1].item() < 0.60
    assert np.allclose(time[samples >= 0], record.time)


# --- views ----------------------------------------------------------------------------------------------------------


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
        for line, each in zip(plot.marks[1:], result.assessments, strict=True):
            assert np.array_equal(line.y, each.simulation.output[part, 0], equal_nan=True)


def test_labels_name_the_method_where_a_model_stands_there_twice():
    structure, record = STRUCTURES[0], drive()
    both = [emsid.least_squares(structure, record), emsid.recursive_least_squares(structure, record)]
    assert views.labels([assess(fit, record) for fit in both]) == ("arx (LS)", "arx (RLS)")
    assert views.labels([assess(both[0], record)]) == ("arx",)
    assert views.labels([assess(both[0], record)] * 2) == ("arx (LS), no. 1", "arx (LS), no. 2")


def test_residuals_show_shares_and_autocorrelation():
    result = COMPARISONS["whole"]
    _, distribution, correlation = views.residuals(result.assessments[:1]).plots
    (histogram,) = distribution.marks
    assert histogram.heights.sum() == pytest.approx(100)
    line = correlation.marks[0]
    best = result.best
    error = (best.record.output - best.simulation.output)[best.simulation.counted, 0]
    error = error - error.mean()
    expected = [error[: len(error) - k] @ error[k:] / (error @ error) for k in range(len(line.y))]
    assert np.allclose(line.y, expected, atol=1e-12)
    assert correlation.marks[1].value == pytest.approx(2.5758 / np.sqrt(len(error)))


def test_autocorrelation_does_not_reach_across_gaps():
    error = np.array([1.0, -1.0, 1.0, -1.0, np.nan, np.nan, -1.0, 1.0, -1.0, 1.0])
    inside = views._autocorrelation(error, (5,), 1)
    assert inside[1] == pytest.approx(-6 / 8)


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
        assert draw(figure).svg


def test_convergence_ends_where_the_estimate_is():
    fit = RECURSIVE[0]
    lines = [mark for plot in views.convergence(fit).plots for mark in plot.marks]
    assert [line.y[-1] for line in lines] == pytest.approx(fit.estimate)
    assert all(line.x[-1] == len(fit.history) for line in lines)


def test_convergence_without_history_says_what_to_do():
    with pytest.raises(DataError, match="ask for the history"):
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
    for cell in chain.from_iterable(row[table.text_columns :] for row in table.rows):
        assert not re.search(r"nan|inf|None", cell)


def test_the_best_free_run_on_unseen_data_stands_out():
    def row(experiment, model, data, mse):
        return Row(experiment, model, "ls", data, 1.0, mse, mse**0.5, 90.0, 3, 100)

    rows = [
        row("simulation", "a", "identification", 0.1),
        row("simulation", "a", "verification", 3.0),
        row("simulation", "b", "verification", 2.0),
        row("experiment", "a", "verification", 1.0),
        row("experiment", "b", "verification", np.inf),
    ]
    table = views.results_table(rows)
    assert table.emphasised == {2, 3}
    assert table.header[0] == "Experiment"


def test_published_figures_stand_beside_the_model_they_belong_to():
    table = TABLES["results and the paper"]
    assert table.header[-1] == "Paper: MSE"
    assert [row[-1] for row in table.rows if row[0] == "arx"] == ["0.0023", "0.0023"]  # two of that name
    assert "another motor" in table.note
    assert "diverged" not in table.note
    assert "left all bounds at sample" in table.note


def test_intervals_are_those_of_the_fit():
    fit = RECURSIVE[0]
    for row, value, (low, high) in zip(views.parameter_table(fit).rows, fit.estimate, fit.interval(), strict=True):
        printed_low, printed_high = (float(text) for text in row[2].split(" … "))
        assert float(row[1]) == pytest.approx(value, abs=0.05 * (high - low))
        assert (printed_low, printed_high) == pytest.approx((low, high), abs=0.05 * (high - low))


def test_what_cannot_be_told_apart_is_said():
    table = TABLES["parameters not told apart"]
    assert "not told apart" in table.rows[1][2]
    assert table.note == "b1 cannot be told"


# --- the page -------------------------------------------------------------------------------------------------------


def nasty_report():
    """Everything a report has, with markup in every text."""
    x = np.arange(3.0)
    plot = Plot((Line(x, x, NASTY),), Axis(NASTY, NASTY), Axis("y", "V"), NASTY)
    table = Table((NASTY, "b"), ((NASTY, "1"),), NASTY, NASTY)
    section = Section(NASTY, (NASTY,), (NASTY,), (table,), (Figure("one", NASTY, (plot,)),))
    facts = (content.Fact(NASTY, NASTY),)
    return Report(NASTY, (NASTY,), (section, Section("Another")), facts, NASTY)


@pytest.fixture(scope="module")
def html():
    figures = (FIGURES["responses, with gaps"], FIGURES["ranking, whole"], FIGURES["every mark"])
    return page(
        Report("A drive", ("It turns.",), (Section("Results", tables=tuple(TABLES.values()), figures=figures),))
    )


def without_plotly(text):
    assert text.count(plotly_source()) == 1
    return text.replace(plotly_source(), "")


def test_the_page_loads_nothing(html):
    own = without_plotly(html)
    assert not re.findall(r"https?:", own)
    assert not re.findall(r"@import|url\(", own)
    for link in re.findall(r"(?:src|href)\s*=\s*[\"']?([^\"'\s>]+)", own):
        assert link.startswith(("#", "data:image/svg+xml;base64,"))
    assert "default-src 'none'" in own


def test_texts_cannot_become_markup():
    own = without_plotly(page(nasty_report()))
    assert "<script>alert" not in own
    assert own.count("<script") == own.count("</script>") == 3  # one plot, the library, the page's own
    assert own.count("&lt;script&gt;alert") >= 12


def test_data_come_back_out_of_the_page(html):
    blocks = re.findall(r'<script type="application/json">(.*?)</script>', html, re.S)
    plots = [plot for name in ("responses, with gaps", "ranking, whole", "every mark") for plot in FIGURES[name].plots]
    assert [json.loads(block) for block in blocks] == [interactive(plot) for plot in plots]
    line = FIGURES["responses, with gaps"].plots[0].marks[0]
    packed = json.loads(blocks[0])["data"][0]
    assert np.array_equal(np.frombuffer(b64decode(packed["x"]["bdata"])), line.x)
    assert np.allclose(np.frombuffer(b64decode(packed["y"]["bdata"]), "<f4"), line.y, equal_nan=True)


def test_long_lines_are_thinned_in_page_and_print():
    x = np.linspace(0, 1, 100_000)
    figure = Figure("long", "Long.", (Plot((Line(x, np.sin(99 * x)),), Axis("Time", "s"), Axis("y", "V")),))
    (trace,) = interactive(figure.plots[0])["data"]
    assert len(b64decode(trace["x"]["bdata"])) <= 4000 * 8
    assert len(draw(figure).svg) < 200_000


def test_contents_and_figures_have_places(html):
    text = page(Report("Two parts", (), (Section("First"), Section("Second", figures=(FIGURES["every mark"],)))))
    for k in (1, 2):
        assert f'href="#section-{k}"' in text
        assert f'id="section-{k}"' in text
    assert 'id="marks"' in text


def test_a_report_without_figures_carries_no_library():
    assert len(page(Report("Words", ("Only words.",), (Section("One"),)))) < 20_000


def test_write_report(tmp_path):
    report = Report("A drive", (), (Section("Results", figures=(FIGURES["every mark"], FIGURES["ranking, whole"])),))
    told = []
    path = write_report(report, tmp_path / "new" / "folder", lambda what, fraction: told.append(fraction))
    assert path == tmp_path / "new" / "folder" / "report.html"
    assert path.read_text(encoding="utf-8") == page(report)
    files = sorted(file.name for file in (path.parent / "figures").iterdir())
    assert files == ["marks.pdf", "marks.svg", "ranking.pdf", "ranking.svg"]
    assert (path.parent / "figures" / "marks.svg").read_bytes() == draw(FIGURES["every mark"]).svg
    assert told == sorted(told)
    assert told[-1] == 1.0


# --- content that makes no sense ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", "a b", "../up", "Upper", "a--b"])
def test_figure_names_are_file_names(name):
    with pytest.raises(ValueError, match="small letters"):
        replace(FIGURES["every mark"], name=name)


def test_empty_plots_double_names_and_ragged_tables_are_refused():
    plot = FIGURES["every mark"].plots[0]
    with pytest.raises(ValueError, match="nothing to show"):
        Figure("a", "", (replace(plot, marks=()),))
    with pytest.raises(ValueError, match="columns"):
        Figure("a", "", (plot,), columns=1)
    with pytest.raises(ValueError, match="names of their own"):
        Report("", (), (Section("", figures=(FIGURES["every mark"],) * 2),))
    with pytest.raises(ValueError, match="every row needs 2 cells"):
        Table(("a", "b"), (("1",),))


def test_everything_is_frozen():
    for kind in vars(content).values():
        if isinstance(kind, type) and hasattr(kind, "__dataclass_fields__"):
            assert kind.__dataclass_params__.frozen
            assert all(field.name in kind.__doc__ for field in fields(kind))
