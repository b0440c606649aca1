"""Reports: requirements on every figure and table, and a page without other files."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import fields, replace
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import emsid
from emsid.errors import DataError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.findings import Finding
from emsid.identification.candidates import usual_for
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.fitting import fit_cascade, static_band
from emsid.models.blocks.static_maps import Abs, CoulombLinear, CubicSpline, PiecewiseLinear, Polynomial, Saturation
from emsid.models.blocks.static_maps import DeadZone as DeadZoneMap
from emsid.models.plants.datasheet import Given
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.own_plant import OwnPlant
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.diagnostics import likelihood_profile
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import Status
from emsid.models.plants.sensor import Sensor
from emsid.plant import DeadZoneLaw, Friction, Motor
from emsid.plant.motor import Parameter
from emsid.record import Record, concatenate
from emsid.report import document as content
from emsid.report import figures, tracking_page, views
from emsid.report.document import (
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
    Spans,
    Stroke,
    Table,
)
from emsid.report.figures import draw
from emsid.report.layout import layout, text_width
from emsid.report.page import page, write_report
from emsid.report.page_plots import HEIGHT, PAGE_POINTS, WIDTH, page_figure
from emsid.report.svg import svg
from emsid.report.thinning import thin
from emsid.report.views import cascade as cascade_views
from emsid.report.views import grey_box as grey_box_views
from emsid.report.views.conventions import MODELS
from emsid.report.views.physical_parameters import physical_table, units_taken
from emsid.report.views.timeline import timeline
from emsid.validation.comparison import Row, assess, assess_model, compare
from emsid.validation.correlation import autocorrelation, cross_correlation
from emsid.wording import sentence

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
              np.diag([0.1, np.inf]), 1.0, 100, 1.0, 1, Ending.RANK_DEFICIENT,
              findings=(Finding("rank-deficient", data={"rank": 1, "parameters": 2, "zero": ["u(t-1)"], "alike": []}),),
              )  # fmt: skip


def comparison(record):
    return compare([*(emsid.least_squares(structure, drive(seed=1)) for structure in STRUCTURES), RUNAWAY], record)


class Later:
    """A table or a list that is made when a test first looks into it, and not when the tests are collected.

    Only these methods make it: the collection asks every object for attributes.
    """

    def __init__(self, make):
        self._make = cache(make)

    def __getitem__(self, key):
        return self._make()[key]

    def keys(self):
        return self._make().keys()

    def values(self):
        return self._make().values()

    def items(self):
        return self._make().items()


COMPARISONS = Later(lambda: {"whole": comparison(drive()), "with gaps": comparison(with_gaps())})
RECURSIVE = Later(lambda: [emsid.recursive_least_squares(each, drive(), history=True) for each in STRUCTURES])
MOTORS = {
    "default": Motor(),
    "two dead zones": Motor(torque_dead_zone=DeadZoneLaw(-1e-3, 2e-3, 0.5, 2.0)),
    "no dead zone": Motor(voltage_dead_zone=None),
    "uneven": Motor(rotor_friction=Friction((0.1, 0.2), (0.05, 0.0), 0.4), load_friction=Friction()),
    "linear": Motor(voltage_dead_zone=None, rotor_friction=Friction(), load_friction=Friction()),
}


FIRST, SECOND = Rational([0.1, 0.2], [-0.7]), Rational([0.25, 0.25], [-0.5])
KNOTS = np.linspace(-5, 5, 9)
CASCADES = {
    "spline": Cascade((FIRST, CubicSpline(KNOTS, 4 * np.tanh(KNOTS / 3)), SECOND), name="wiener-hammerstein"),
    "dead zone": Cascade((DeadZoneMap(-1.5, 1.0, 0.5, 1.0), SECOND), input_offset=0.2, delay=2, name="hammerstein"),
    "saturation": Cascade((FIRST, Saturation(0.8, -2.0, 1.5)), oversampling=2, name="wiener"),
    "piecewise": Cascade(
        (
            PiecewiseLinear([-4.0, 0.0, 4.0], [-3.0, 0.5, 5.0]),
            SECOND,
            Polynomial.from_powers([0.0, 1.0, 0.02], -5.0, 5.0),
        ),
        name="hammerstein-wiener",
    ),
    "Coulomb": Cascade((CoulombLinear(0.5, 0.5, 1.0), FIRST), name="hammerstein"),
    "sign lost": Cascade((FIRST, Abs(), SECOND), name="wiener-hammerstein"),
    "no map": Cascade((FIRST,), name="filter"),
    "no filter": Cascade((DeadZoneMap(-1.0, 1.0, 1.0, 1.0),), name="map"),
}


def of_cascade(cascade, record=None):
    """A cascade fitted to its own output with a little noise, from where it is."""
    record = drive() if record is None else record
    rng = np.random.default_rng(5)
    y = np.concatenate([cascade.output(s.input[:, 0], cascade.resting(0.0)) for s in record.segments])
    noisy = replace(record, output=(y + 0.02 * rng.standard_normal(len(y)))[:, None])
    return fit_cascade(cascade, noisy, max_iterations=0), noisy


def driven(plant, dt=0.005, seconds=6.0, signal=Signal.SPEED, name="motor log"):
    """A record of a plant that is driven back and forth and stands still in between."""
    rng = np.random.default_rng(2)
    t = dt * np.arange(round(seconds / dt))
    u = np.where(np.sin(2.1 * t) > 0.6, 10.0, np.where(np.sin(2.1 * t) < -0.6, -8.0, 0.0)) + 2 * np.sin(0.7 * t)
    y = plant.simulate(u[:, None], dt, np.zeros(2), (signal,))[:, 0]
    noise = 1e-3 * np.max(np.abs(y)) * rng.standard_normal(len(y))
    shown, unit = ("position", "m") if isinstance(plant, LinearAxis) else ("speed", "rad/s")
    force = ("force", "N") if isinstance(plant, LinearAxis) else ("voltage", "V")
    return Record(u, y + noise, dt, (force[0],), (shown,), (force[1],), (unit,), name=name)


RIGID = DrivenMotor(
    replace(Motor(), inductance=0.0, rotor_friction=Friction(0.02), voltage_dead_zone=DeadZoneLaw(-0.5, 0.5)).rigid()
)
AXIS = LinearAxis(2.0, 3.0, Friction(2.0))
DECAY = OwnPlant(
    lambda x, u, p: [p[0] * (u[0] - x[0])],
    lambda x, u, p: [x[0]],
    (Parameter("rate", "r", "1/s", "rate of decay"),),
    (2.0,),
    1,
    name="decay",
)


def of_plants():
    rng = np.random.default_rng(1)
    log = driven(RIGID)
    yield "rigid motor", simulation_error(RIGID, log, fixed={"resistance": RIGID.motor.resistance})
    yield (
        "nothing known, with a lag",
        simulation_error(
            replace(RIGID, sensor=Sensor(lag=0.02)), [log[:500], replace(log[600:], times=(0.0,))], max_iterations=3
        ),
    )
    yield (
        "datasheet",
        simulation_error(
            RIGID,
            log,
            free=("motor_constant", "rotor_inertia"),
            datasheet={"motor_constant": Given(1.05 * RIGID.motor.motor_constant, 0.3)},
        ),
    )
    yield "no units", simulation_error(RIGID, replace(log, input_units=("",), output_units=("",)), max_iterations=2)
    yield "axis", simulation_error(AXIS, driven(AXIS, signal=Signal.POSITION), max_iterations=3)
    u = rng.standard_normal(300)
    decay = DECAY.simulate(u[:, None], 0.1, np.zeros(1), (Signal.SPEED,))
    yield "own plant", simulation_error(DECAY, Record(u, decay + 0.01 * rng.standard_normal((300, 1)), 0.1))


@cache
def two_outputs(samples=1200):
    """A motor log of speed and current, with a gap, and two motors run over it: one a little off, one far off."""
    rng = np.random.default_rng(4)
    u = driven(RIGID, seconds=0.005 * samples).input
    y = RIGID.simulate(u, 0.005, np.zeros(2), (Signal.SPEED, Signal.CURRENT))
    y = y + rng.standard_normal(y.shape) * [1.0, 0.01]
    log = Record(u, y, 0.005, ("voltage",), ("speed", "current"), ("V",), ("rad/s", "A"), name="two")
    log = log.mask((np.arange(samples) > 500) & (np.arange(samples) < 560))
    motors = [RIGID.with_values({"resistance": k * RIGID.motor.resistance}) for k in (1.02, 1.5)]
    signals = (Signal.SPEED, Signal.CURRENT)
    return log, [assess_model(GreyBox(motor, signals), log) for motor in motors]


def of_profiles():
    taken = likelihood_profile(PLANT_FITS["rigid motor"], "rotor_inertia")
    yield "taken", taken
    values, deviance = np.array([0.0, 1.0, 13.0]), np.array([3.0, 0.0, 0.9])
    unlimited = {"interval": (0.0, np.inf), "estimate": 1.0, "standard_error": 0.5}
    yield "open", replace(taken, name="rotor_friction.coulomb", values=values, deviance=deviance, **unlimited)


CASCADE_FITS = Later(lambda: {kind: of_cascade(cascade) for kind, cascade in CASCADES.items()})
PLANT_FITS = Later(lambda: dict(of_plants()))
PROFILES = Later(lambda: dict(of_profiles()))


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
    for fit in RECURSIVE[:]:
        yield (
            f"convergence of {fit.model.name}",
            views.convergence(fit, emsid.least_squares(fit.model.structure, drive())),
        )
    yield "convergence without batch", views.convergence(RECURSIVE[0])
    for kind, (fit, record) in CASCADE_FITS.items():
        for view in (cascade_views.static_maps(fit, record), cascade_views.frequency_responses(fit, record.dt)):
            if view is not None:
                yield f"{view.name}, {kind}", view
    for kind, fit in PLANT_FITS.items():
        if kind == "no units":
            continue
        for view in (grey_box_views.friction(fit), grey_box_views.dead_zone(fit), grey_box_views.sticking(fit)):
            if view is not None and kind != "own plant":
                yield f"{view.name}, {kind}", view
    for kind, profile in PROFILES.items():
        yield f"likelihood profile, {kind}", grey_box_views.likelihood(PLANT_FITS["rigid motor"], profile)
    two, runs = two_outputs()
    yield "two outputs, responses", views.responses(runs, views.critical_intervals(two, 0.5, error_of(runs[1])))
    yield "two outputs, residuals", views.residuals(runs)
    yield "two outputs, ranking", views.ranking(compare([each.fit for each in runs], two))
    yield "two outputs, free run", views.measured_and_simulated(runs[0])
    two_inputs = replace(drive(), input=np.column_stack([drive().input, drive(seed=5).input]),
                         input_names=("u1", "u2"), input_units=("V", "A"))  # fmt: skip
    linear = assess(emsid.least_squares(emsid.arx(2, 2, inputs=2), two_inputs), two_inputs)
    yield "two inputs", views.inputs([two_inputs])
    yield "two inputs, residuals", views.residuals([linear])
    yield "two inputs, nonlinear correlations", views.nonlinear_correlations([linear])
    yield "every mark", every_mark()


def test_a_band_has_gaps_where_its_limits_are_not_known():
    x, middle = np.arange(10.0), np.ones(10)
    axes = Axis("t", range=(0.0, 9.0)), Axis("y", range=(0.0, 2.0))
    for gap, areas in ((slice(0, 0), 1), (slice(4, 6), 2), (slice(0, 2), 1)):
        low = 0.5 * middle
        low[gap] = np.nan
        figure = Figure("band", "", (Plot((Band(x, low, 1.5 * middle), Line(x, middle)), *axes),))
        (area,) = re.findall(r'<path d="([^"]*z)"', svg(figure).decode())
        assert area.count("z") == areas


def error_of(assessment):
    return assessment.record.output - assessment.simulation.output


def every_mark():
    x = np.linspace(0.1, 10, 50)
    marks = (
        Histogram(np.linspace(0, 10, 21), np.arange(20.0), "data", backdrop=True),
        Band(x, x - 1, x + 1, "95 % band"),
        Line(x, x, "map", Stroke(Ink.RED, Dash.DASH_DOTTED)),
        Line(x, x**0.5, "stairs", stairs=True),
        Points(x[::10], x[::10], "points", Ink.GREEN),
        Level(5.0, "level"),
        Spans(np.array([[1.0, 2.0], [4.0, 4.5]]), "spans"),
        Histogram(np.linspace(0, 10, 11), np.ones(10), "outline"),
    )
    gain = Plot((Line(x, -20 * np.log10(x), "first filter"),), Axis("Frequency", "Hz", log=True), Axis("Gain", "dB"))
    bars = Plot((Bars(np.array([2.0, np.inf]), ("2", "none")),), Axis("RMSE", "V"), Axis("Model", names=("a", "b")))
    return Figure("marks", "All marks.", (Plot(marks, Axis("u", "V"), Axis("w", "V"), span=2), gain, bars), columns=2)


def every_table():
    return {
        "results": views.results_table(COMPARISONS["whole"].rows, unit="rad/s"),
        "results and the paper": views.results_table(
            COMPARISONS["whole"].rows, views.Reference("Paper", "another motor", {("arx", "unseen"): 0.0023})
        ),
        "parameters": views.parameter_table(RECURSIVE[2], columns=views.regressor_column(RECURSIVE[2])),
        "undetermined parameters": views.parameter_table(RUNAWAY),
        "motor": views.motor_table(MOTORS["uneven"]),
        "rigid motor": views.motor_table(Motor().rigid()),
        "blocks": views.parameter_table(
            CASCADE_FITS["spline"][0], columns=cascade_views.block_column(CASCADE_FITS["spline"][0])
        ),
    } | {
        f"physical, {kind}, {k}": table
        for kind, fit in PLANT_FITS.items()
        for k, table in enumerate(physical_table(fit))
    }


FIGURES = Later(lambda: dict(every_figure()))
TABLES = Later(every_table)
VIEWS = json.loads((Path(__file__).parent / "golden" / "report_views.json").read_text())

each_figure = pytest.mark.parametrize("figure", VIEWS["figures"], indirect=True)
each_table = pytest.mark.parametrize("table", VIEWS["tables"], indirect=True)


@pytest.fixture
def figure(request):
    return FIGURES[request.param]


@pytest.fixture
def table(request):
    return TABLES[request.param]


def test_every_result_has_its_figures_and_tables():
    """The names by which the tests below go are written down, so that a view that is lost is noticed."""
    assert sorted(FIGURES.keys()) == sorted(VIEWS["figures"])
    assert sorted(TABLES.keys()) == sorted(VIEWS["tables"])


# --- what every figure owes -----------------------------------------------------------------------------------------


@each_figure
def test_axes_name_quantity_and_unit(figure):
    for axis in chain.from_iterable((plot.x, plot.y) for plot in figure.plots):
        assert axis.names or not axis.unit or re.fullmatch(r".+ \[.+\]", axis.title)
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
            case Band(x, lower, upper):
                assert x.shape == lower.shape == upper.shape
                assert np.all(lower <= upper)
            case Spans(edges):
                assert edges.shape == (len(edges), 2)
                assert np.all(np.diff(edges.ravel()) > 0)
            case Bars(values, remarks):
                assert len(values) == len(remarks)


@pytest.mark.parametrize("name", ["every mark", "ranking, whole", "two inputs, residuals", "likelihood profile, open"])
def test_a_figure_drawn_again_is_the_same_to_the_byte(name):
    """What could differ, the time and the numbering of elements, belongs to the writers, so some figures tell."""
    first, second = (draw(FIGURES[name], ("svg", "pdf")) for _ in range(2))
    assert first == second


@each_figure
def test_drawing_is_whole_no_plot_is_empty_and_nothing_lies_outside(figure, monkeypatch):
    """Every plot on the sheet shows a mark, has room for itself, and no two overlap, with their labels."""
    from matplotlib import rc_context

    sheets, make = [], figures._sheet
    monkeypatch.setattr(figures, "_sheet", lambda each: sheets.append(make(each)) or sheets[-1])
    check_files(draw(figure, ("svg", "pdf")))
    (sheet,) = sheets
    with rc_context(figures._SETTINGS):
        width, height = sheet.bbox.size
        boxes = [*(axes.get_tightbbox() for axes in sheet.axes), *(each.get_window_extent() for each in sheet.legends)]
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


def check_files(drawn):
    """The files are complete, have no time in them and point nowhere else."""
    svg, pdf = drawn["svg"], drawn["pdf"]
    root = ElementTree.fromstring(svg)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert pdf.startswith(b"%PDF")
    assert pdf.rstrip().endswith(b"%%EOF")
    assert b"CreationDate" not in pdf
    assert b"dc:date" not in svg
    links = [value for node in root.iter() for key, value in node.items() if key.endswith("href")]
    assert all(link.startswith("#") for link in links)


def texts_of(svg):
    """Every text of an SVG file: what it says, and its box as (left, top, right, bottom)."""
    found = []

    def visit(node, x, y):
        place = re.search(r"translate\((\S+) (\S+)\)", node.get("transform", ""))
        if place:
            x, y = x + float(place[1]), y + float(place[2])
        if node.tag.endswith("text"):
            size = float(node.get("font-size"))
            width = text_width(node.text, size, bold=node.get("font-weight") == "bold")
            x, y = x + float(node.get("x", 0)), y + float(node.get("y", 0))
            before = {"start": 0.0, "middle": 0.5, "end": 1.0}[node.get("text-anchor", "start")] * width
            if "rotate" in node.get("transform", ""):
                found.append((node.text, (x - 0.75 * size, y - before, x + 0.2 * size, y + before)))
            else:
                found.append((node.text, (x - before, y - 0.75 * size, x - before + width, y + 0.2 * size)))
        for child in node:
            visit(child, x, y)

    root = ElementTree.fromstring(svg)
    visit(root, 0.0, 0.0)
    return found, [float(v) for v in root.get("viewBox").split()]


@each_figure
def test_texts_of_a_drawing_are_whole_and_lie_apart(figure):
    drawn = draw(figure)["svg"]
    found, (_, _, width, height) = texts_of(drawn)
    said = [text for text, _ in found]
    for plot in figure.plots:
        wanted = [plot.title, *plot.y.names, *(mark.label for mark in plot.marks)]
        assert {text for text in wanted if text} <= {*said}
    assert figure.plots[-1].x.title in said
    for k, (text, (left, top, right, bottom)) in enumerate(found):
        assert left >= -1, text
        assert top >= -1, text
        assert bottom <= height + 1, text
        assert right <= width + 2, text
        for other, (a, b, c, d) in found[:k]:
            assert min(right, c) - max(left, a) < 1 or min(bottom, d) - max(top, b) < 1, (text, other)


def test_widths_of_texts_are_those_of_the_font():
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    for text in ("Measured speed, 99 % band [rad/s]", "−0.0125", "wiener-hammerstein-regression", "ω² ≤ 3·σ(τ₁)"):
        for weight in ("normal", "bold"):
            font = FontProperties(family="DejaVu Sans", size=10, weight=weight)
            width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
            assert text_width(text, 10.0, bold=weight == "bold") == pytest.approx(width, rel=0.05)


def inside(shape):
    """The corners of a path of the page, (n, 2), and whether each begins a new piece."""
    corners, starts, at = [], [], np.zeros(2)
    for letter, words in re.findall(r"([MlhzHV])([^MlhzHV]*)", shape.path):
        values = np.array([float(v) for v in re.findall(r"-?\d+", words)])
        if letter == "M":
            at = values
            corners.append(at)
            starts.append(True)
        elif letter == "l":
            for step in values.reshape(-1, 2):
                at = at + step
                corners.append(at)
                starts.append(False)
    return np.array(corners), np.array(starts)


@each_figure
def test_every_plot_of_the_page_shows_its_marks_and_labels(figure):
    drawn = page_figure(figure)
    assert len(drawn.plots) == len(figure.plots)
    for plot, each in zip(figure.plots, drawn.plots, strict=True):
        assert len(each.x.ticks) >= 2
        assert all(0 <= place <= 100 for place, _ in (*each.x.ticks, *(() if each.bars else each.y.ticks)))
        labels = [mark.label for mark in plot.marks if mark.label]
        assert {entry.label for entry in each.legend or drawn.legend} >= set(labels)
        if each.bars:
            assert [bar.name for bar in each.bars] == list(plot.y.names)
            continue
        unseen = sum(isinstance(mark, Spans) or np.isnan(getattr(mark, "y", np.zeros(1))).all() for mark in plot.marks)
        assert len(each.shapes) >= len(plot.marks) - unseen
        corners = [inside(shape)[0] for shape in each.shapes]
        assert all(np.any((some[:, 0] >= 0) & (some[:, 0] <= WIDTH)) or np.ptp(some[:, 0]) > WIDTH for some in corners)
        assert any(np.any((some[:, 1] >= 0) & (some[:, 1] <= HEIGHT)) for some in corners)
        assert all(shape.stroke or shape.fill for shape in each.shapes)


def test_looks_that_mean_two_things_have_a_legend_at_their_plot():
    x = np.arange(3.0)
    first, second = (Plot((Line(x, x, label),), Axis("x"), Axis("y")) for label in ("a1", "b1"))
    apart = page_figure(Figure("apart", "Apart.", (first, second)))
    assert not apart.legend
    assert [[entry.label for entry in plot.legend] for plot in apart.plots] == [["a1"], ["b1"]]
    together = page_figure(Figure("together", "Together.", (first, first)))
    assert [entry.label for entry in together.legend] == ["a1"]
    assert not any(plot.legend for plot in together.plots)


def test_plots_that_share_a_legend_have_it_once_in_print_over_the_whole_width():
    x = np.arange(3.0)
    names = [f"a model with a name, {k}" for k in range(6)]
    lines = [Line(x, k * x, name, look) for k, (name, look) in enumerate(zip(names, MODELS, strict=False))]
    first, second = (Plot(tuple(marks), Axis("x"), Axis("y"), "Title") for marks in (lines, lines[:1]))
    other = replace(second, marks=(replace(lines[0], label="another"),))
    shared, apart = (Figure("two", "Two.", (first, each), columns=2) for each in (second, other))
    assert [svg(shared).decode().count(name) for name in names] == [1] * 6
    assert svg(apart).decode().count("another") == 1
    assert layout(shared).height < layout(apart).height
    assert not any(place.legend for place in layout(shared).places)
    assert [len(place.legend) for place in layout(apart).places] == [6, 1]
    sheets = [figures.sheet(each) for each in (shared, apart)]
    assert [len(sheet.legends) for sheet in sheets] == [1, 0]
    assert [[bool(axes.get_legend()) for axes in sheet.axes] for sheet in sheets] == [[False, False], [True, True]]


@pytest.mark.parametrize("name", ["second speed", "a <b>name</b> of a column that goes on and on and on"])
def test_long_names_have_room_beside_a_plot(name):
    from matplotlib import rc_context

    x = np.arange(3.0)
    figure = Figure("long", "Long.", (Plot((Line(x, x),), Axis("Time", "s"), Axis(name, "rad/s"), height=0.7),) * 3)
    with rc_context(figures._SETTINGS):
        sheet = figures._sheet(figure)
        sheet.draw_without_rendering()
        boxes = [axes.get_tightbbox() for axes in sheet.axes]
        (label,) = {axes.get_ylabel() for axes in sheet.axes}
    assert all(above.y0 > below.y1 for above, below in pairwise(boxes))
    assert label.endswith(" [rad/s]")
    assert ("…" in label) == (len(name) > 30)
    assert sheet.axes[0].yaxis.label.get_size() >= 6


def test_text_is_never_markup_or_mathematics():
    x = np.arange(3.0)
    figure = Figure(
        "nasty", NASTY, (Plot((Line(x, x, "<b>$\\frac{$</b>"),), Axis("$x", "<i>"), Axis(NASTY), "a $b$ c"),)
    )
    assert draw(figure)["svg"]
    text = page(Report("Nasty", (), (Section("One", figures=(figure,)),)))
    assert "&lt;b&gt;$\\frac{$&lt;/b&gt;" in text
    assert "<script>alert" not in text


def test_legends_show_every_line_in_its_own_look():
    from matplotlib import rc_context

    x = np.arange(3.0)
    same = [Line(x, k * x, "same name", Stroke(ink)) for k, ink in enumerate((Ink.RED, Ink.GREEN))]
    marks = (*same, Band(x, x, x + 1, "band"), Line(x, x, "_last", Stroke(Ink.NAVY)))
    with rc_context(figures._SETTINGS):
        (legend,) = figures._sheet(Figure("a", "A.", (Plot(marks, Axis("x", "s"), Axis("y", "V")),))).legends
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
        "heavy = {'matplotlib', 'jinja2', 'numba', 'scipy'} & set(sys.modules)\n"
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
    best = COMPARISONS["with gaps"].best
    run = views.measured_and_simulated(best).plots
    starting = np.count_nonzero(~best.simulation.counted)
    assert starting >= pieces
    measured = [*(line for plot in views.inputs([record]).plots for line in plot.marks), run[0].marks[0]]
    for line in measured:
        assert np.count_nonzero(np.isnan(line.y)) == pieces - 1
    for line in (run[0].marks[1], run[1].marks[0]):  # without the samples that start the model
        assert np.count_nonzero(np.isnan(line.y)) == pieces - 1 + starting
    for line in (*measured, run[0].marks[1], run[1].marks[0]):
        assert np.all(np.diff(line.x) > 0)
        assert len(line.x) == len(record) + pieces - 1


def test_a_gap_lies_where_the_samples_are_missing():
    record = drive(100).mask((np.arange(100) >= 40) & (np.arange(100) < 60))
    time, samples = timeline(record)
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
    assert correlation.marks[1].value == pytest.approx(2.5758 / np.sqrt(len(error)))


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
        assert [row[3:5] for row in table.rows] == [("speed", "rad/s"), ("current", "A")]
        for k, cells in enumerate(table.rows):
            rmse, fit = by_hand(assessment, k)
            assert float(cells[5]) == pytest.approx(fit, abs=0.005)
            assert float(cells[6]) == pytest.approx(rmse, rel=1e-3)
            assert float(cells[7]) == pytest.approx(rmse**2, rel=1e-3)
    table = views.results_table([each.row for each in runs])
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
        for line, each in zip(plot.marks[1:], runs, strict=True):
            assert np.array_equal(line.y, each.simulation.output[part, k], equal_nan=True)
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


def test_every_output_is_ranked_in_its_own_unit():
    two, runs = two_outputs()
    result = compare([each.fit for each in runs], two)
    figure = views.ranking(result)
    assert [plot.x.title for plot in figure.plots] == ["RMSE of speed [rad/s]", "RMSE of current [A]"]
    for k, plot in enumerate(figure.plots):
        assert plot.marks[0].values == pytest.approx([by_hand(each, k)[0] for each in result.assessments])


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


def test_published_figures_stand_beside_the_model_they_belong_to():
    table = TABLES["results and the paper"]
    assert table.header[-1] == "Paper: MSE"
    assert [row[-1] for row in table.rows if row[0] == "arx"] == ["0.0023", "0.0023"]  # two of that name
    assert "another motor" in table.note
    assert "diverged at sample" in table.note


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


# --- models of blocks -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [kind for kind in CASCADES if kind not in ("no map",)])
def test_a_static_map_is_drawn_where_its_signal_was_and_little_further(kind):
    fit, record = CASCADE_FITS[kind]
    model = fit.model
    figure = cascade_views.static_maps(fit, record)
    maps = [k for k, block in enumerate(model.blocks) if not isinstance(block, Rational)]
    assert len(figure.plots) == len(maps)
    for k, plot in zip(maps, figure.plots, strict=True):
        u, start = record.input[:, 0], slice(model.memory)
        signal = model.signals(u, model.starting(u[start], record.output[start, 0]))[k]
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


def test_ticks_have_room_at_the_left_of_a_plot():
    x = np.arange(3.0)
    few, many = (
        page_figure(Figure("a", "A.", (Plot((Line(x, factor * x),), Axis("Time", "s"), Axis("Residual", "V")),)))
        for factor in (1.0, 1.23456e-3)
    )
    assert many.plots[0].room >= few.plots[0].room + 3 * 6
    assert many.plots[0].room >= 6 * max(len(text) for _, text in many.plots[0].y.ticks)


# --- physical models ------------------------------------------------------------------------------------------------


def test_every_physical_parameter_has_its_row_and_status():
    for kind, fit in PLANT_FITS.items():
        parameters, *rest = physical_table(fit)
        assert [row[0] for row in parameters.rows] == [row.name for row in fit.table]
        assert all(cells[4].startswith(row.how) for cells, row in zip(parameters.rows, fit.table, strict=True))
        assert bool(rest) == bool(fit.combinations)
        assert ("Datasheet" in parameters.header) == (kind == "datasheet")
        for cells, row in zip(parameters.rows, fit.table, strict=True):
            assert (" ± " in cells[5]) == (row.status in (Status.ESTIMATED, Status.CONDITIONAL))
            if " ± " in cells[5]:
                value, half = (float(part) for part in cells[5].split(" ± "))
                assert value == pytest.approx(row.value, abs=0.1 * half)
                assert half == pytest.approx(1.96 * row.standard_error, rel=0.05)


def test_a_parameter_with_an_interval_that_includes_zero_is_marked():
    fit = PLANT_FITS["axis"]
    table = physical_table(fit)[0]
    for cells, row in zip(table.rows, fit.table, strict=True):
        wide = row.standard_error is not None and 1.96 * row.standard_error > abs(row.value)
        assert ("interval includes zero" in cells[4]) == (wide and row.status in (Status.ESTIMATED, Status.CONDITIONAL))
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
    assert plot.x.title == "Rotor moment of inertia [kg·m²]"
    assert tuple(spans.edges[0]) == profile.interval
    assert threshold.value == pytest.approx(3.841459)
    assert np.interp(spans.edges[0], curve.x, curve.y) == pytest.approx([threshold.value] * 2, rel=1e-3)
    (approximate,) = fit.interval()[[fit.names.index("rotor_inertia")]]
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


def test_a_section_shows_what_a_model_of_its_kind_has():
    def shown(fit, record, **options):
        section = views.model_section(fit, record, **options)
        assert section.equations
        assert section.tables
        return [figure.name for figure in section.figures]

    assert shown(*CASCADE_FITS["spline"]) == ["wiener-hammerstein-static-maps", "wiener-hammerstein-filters"]
    assert shown(*CASCADE_FITS["no map"], name="The 2nd") == ["the-2nd-filters"]
    log = PLANT_FITS["rigid motor"].segments[0]
    assert shown(PLANT_FITS["rigid motor"], log) == [
        "rigid-motor-sticking",
        "rigid-motor-friction",
        "rigid-motor-dead-zone",
    ]
    assert shown(PLANT_FITS["rigid motor"], log, profiles=PROFILES.values())[3:] == [
        "rigid-motor-profile-rotor-inertia",
        "rigid-motor-profile-rotor-friction-coulomb",
    ]
    assert shown(RECURSIVE[0], drive()) == []


def test_what_cannot_be_drawn_is_left_out_of_a_section():
    fit, record = CASCADE_FITS["spline"]
    two = replace(record, input=np.repeat(record.input, 2, axis=1), input_names=("a", "b"), input_units=("V", "V"))
    assert [figure.name for figure in views.model_section(fit, two).figures] == ["wiener-hammerstein-filters"]


def test_what_is_not_identifiable_stands_before_the_numbers():
    nothing = Finding("nothing-identifiable", NASTY, {"channels": ["voltage", "speed"]})
    fit = replace(PLANT_FITS["no units"], findings=(nothing, Finding("choice-interrupted")))
    section = views.model_section(fit, fit.segments[0])
    assert NASTY in section.remarks[0]
    own = page(Report("One", (), (section,)))
    remarks = re.search(r'<ul class="remarks">(.*?)</ul>', own, re.S)
    assert remarks[1].count("<li>") == 2
    assert "&lt;script&gt;alert" in remarks[1]
    assert remarks.start() < own.index("<table")
    assert 'class="remarks"' not in page(Report("One", (), (Section("One"),)))


def test_missing_units_are_reported():
    fit = PLANT_FITS["no units"]
    assert any("no unit for voltage and speed" in text for text in views.model_section(fit, fit.segments[0]).paragraphs)
    assert not units_taken(PLANT_FITS["rigid motor"])


def test_sections_of_all_models_make_one_page():
    fits = [*CASCADE_FITS.values(), *((fit, fit.segments[0]) for fit in PLANT_FITS.values()), (RECURSIVE[1], drive())]
    sections = [views.model_section(fit, record, name=f"Model {k}") for k, (fit, record) in enumerate(fits)]
    assert (page(Report("All", (), tuple(sections)))).count("<figure id=") > 20


def test_only_long_tables_scroll():
    def table(rows):
        return Table(("a", "b"), (("x", "1"),) * rows, "A table")

    text = page(Report("Tables", (), (Section("One", tables=(table(40), table(41))),)))
    assert text.count('class="scroll long"') == 1


# --- the page -------------------------------------------------------------------------------------------------------


def nasty_report():
    """Everything a report has, with markup in every text."""
    x = np.arange(3.0)
    plot = Plot((Line(x, x, NASTY),), Axis(NASTY, NASTY), Axis("y", "V"), NASTY)
    table = Table((NASTY, "b"), ((NASTY, "1"),), NASTY, NASTY)
    section = Section(NASTY, (NASTY,), (NASTY,), (table,), (Figure("one", NASTY, (plot,)),), (NASTY,))
    facts = (content.Fact(NASTY, NASTY),)
    return Report(NASTY, (NASTY,), (section, Section("Another")), facts, NASTY)


@pytest.fixture(scope="module")
def html():
    figures = (FIGURES["responses, with gaps"], FIGURES["ranking, whole"], FIGURES["every mark"])
    return page(
        Report("A drive", ("It turns.",), (Section("Results", tables=tuple(TABLES.values()), figures=figures),))
    )


def test_the_page_loads_nothing(html):
    own = html
    assert not re.findall(r"https?:", own)
    assert not re.findall(r"@import|url\(", own)
    for link in re.findall(r"(?:src|href)\s*=\s*[\"']?([^\"'\s>]+)", own):
        assert link.startswith("#")
    assert "default-src 'none'" in own


def test_an_option_and_a_percentage_stay_on_one_line():
    own = page(Report("A drive", (), (Section("Results", remarks=("fix <R> (--fix-all), 3 % of it",)),)))
    assert 'fix &lt;R&gt; (<span class="option">--fix-all</span>), 3\u00a0% of it' in own


def test_every_default_model_has_its_own_look():
    assert len(set(MODELS)) == len(MODELS) >= len(usual_for(Record(np.ones(9), np.ones(9), 0.1)))


def test_texts_cannot_become_markup():
    own = page(nasty_report())
    assert "<script>alert" not in own
    assert own.count("<script") == own.count("</script>") == 1  # the page's own
    assert own.count("&lt;script&gt;alert") >= 13


def test_data_come_back_out_of_the_page():
    figure = FIGURES["responses, with gaps"]
    line, plot = figure.plots[0].marks[0], page_figure(figure).plots[0]
    corners, starts = inside(plot.shapes[0])
    x = plot.x.low + corners[:, 0] / WIDTH * (plot.x.high - plot.x.low)
    y = plot.y.high - corners[:, 1] / HEIGHT * (plot.y.high - plot.y.low)
    known = np.isfinite(line.y)
    assert np.allclose(x, line.x[known], rtol=0, atol=(plot.x.high - plot.x.low) / WIDTH)
    assert np.allclose(y, line.y[known], rtol=0, atol=(plot.y.high - plot.y.low) / HEIGHT)
    assert starts.sum() == 1 + np.count_nonzero(np.diff(known.astype(int)) == 1)
    assert plot.shapes[0].path in page(Report("One", (), (Section("One", figures=(figure,)),)))


def test_long_lines_are_thinned_in_page_and_print():
    x = np.linspace(0, 1, 100_000)
    figure = Figure("long", "Long.", (Plot((Line(x, np.sin(99 * x)),), Axis("Time", "s"), Axis("y", "V")),))
    corners, _ = inside(page_figure(figure).plots[0].shapes[0])
    assert 1000 < len(corners) <= PAGE_POINTS
    assert len(draw(figure)["svg"]) < 200_000


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
    heard = []
    path = write_report(report, tmp_path / "new" / "folder", Control(report=heard.append))
    assert path == tmp_path / "new" / "folder" / "report.html"
    assert path.read_text(encoding="utf-8") == page(report)
    assert sorted(file.name for file in (path.parent / "figures").iterdir()) == ["marks.svg", "ranking.svg"]
    assert (path.parent / "figures" / "marks.svg").read_bytes() == draw(FIGURES["every mark"])["svg"]
    assert [(each.done, each.total) for each in heard[1:]] == [(0, 2), (1, 2)]


@pytest.mark.parametrize("formats", [(), ("pdf",), ("svg", "pdf")])
def test_figures_are_written_in_the_formats_asked_for(tmp_path, formats):
    report = Report("A drive", (), (Section("Results", figures=(FIGURES["every mark"],)),))
    write_report(report, tmp_path, formats=formats)
    written = {path.name for path in tmp_path.rglob("marks.*")}
    assert written == {f"marks.{suffix}" for suffix in formats}


def test_a_cancelled_report_writes_nothing(tmp_path):
    report = Report("A drive", (), (Section("Results", figures=(FIGURES["every mark"],)),))
    with pytest.raises(Stopped):
        write_report(report, tmp_path, Control(cancelled=lambda: True))
    assert not list(tmp_path.iterdir())


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


def test_lines_of_an_equation_end_between_its_words():
    equation = "x1(t) = max(u(t-1)-0.5, 0)\ny(t) = 0.9*y(t-1) + x1(t) + e(t)"
    text = page(Report("One", (), (Section("One", equations=(equation,)),)))
    (printed,) = re.findall(r"<pre>(.*?)</pre>", text, re.DOTALL)
    assert re.sub(r"</?span>", "", printed) == equation
    assert re.findall(r"<span>(.*?)</span>", printed) == equation.split()


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
    fit = SimpleNamespace(names=("b1",), model=SimpleNamespace(name="arx"))
    figure = tracking_page.convergence(SimpleNamespace(history=history, fit=fit, changes=[]))
    _, line = figure.plots[0].marks
    np.testing.assert_array_equal(line.y, estimate[:, 0])
    assert figure.plots[0].y.range[0] > 1
    assert "changes" not in figure.caption
