"""What every figure of a report owes: axes with units, marks, texts that are whole, files that stand alone."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from itertools import chain, pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from emsid.report import figures
from emsid.report.document import (
    Axis,
    Band,
    Bars,
    Figure,
    Histogram,
    Ink,
    Line,
    Plot,
    Points,
    Report,
    Section,
    Spans,
    Stroke,
)
from emsid.report.figures import draw
from emsid.report.page import HEIGHT, WIDTH, page, page_figure
from emsid.report.svg import above, below, layout, svg, text_width
from emsid.report.views.conventions import MODELS
from report_examples import FIGURES, NASTY, TABLES, VIEWS, inside

each_figure = pytest.mark.parametrize("figure", VIEWS["figures"], indirect=True)


@pytest.fixture
def figure(request):
    return FIGURES[request.param]


def test_a_band_has_gaps_where_its_limits_are_not_known():
    x, middle = np.arange(10.0), np.ones(10)
    axes = Axis("t", range=(0.0, 9.0)), Axis("y", range=(0.0, 2.0))
    for gap, areas in ((slice(0, 0), 1), (slice(4, 6), 2), (slice(0, 2), 1)):
        low = 0.5 * middle
        low[gap] = np.nan
        figure = Figure("band", "", (Plot((Band(x, low, 1.5 * middle), Line(x, middle)), *axes),))
        (area,) = re.findall(r'<path d="([^"]*z)"', svg(figure).decode())
        assert area.count("z") == areas


def test_every_result_has_its_figures_and_tables():
    """The names by which the tests below go are written down, so that a view that is lost is noticed."""
    assert sorted(FIGURES.keys()) == sorted(VIEWS["figures"])
    assert sorted(TABLES.keys()) == sorted(VIEWS["tables"])


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
        boxes = [
            *(axes.get_tightbbox() for axes in sheet.axes),
            *(legend.get_window_extent() for legend in sheet.legends),
        ]
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


@pytest.mark.parametrize("columns", [1, 2])
def test_titles_stay_above_and_below_their_plots_in_print(columns):
    x, name = np.arange(3.0), "Residual against Commanded_PWM·Motor_Speed(RPM) (simulated)"
    plots = (Plot((Line(x, x),), Axis(name * (3 - columns), "s"), Axis("y"), name * (3 - columns)),) * 2
    figure = Figure("long", "Long.", plots, columns=columns)
    for place in layout(figure).places:
        room = 520.0 / columns - 40.0
        for (text, size), bold in ((above(place), True), (below(place, 8.0), False)):
            assert text_width(text, size, bold=bold) <= room
            assert size >= 6.0
            assert text.startswith("Residual against Commanded")
    assert svg(figure).decode().count(f">{above(layout(figure).places[0])[0]}<") == 2
    short = replace(plots[0], x=Axis("Time", "s"), title="Distribution")
    (place, _) = layout(replace(figure, plots=(short, short))).places
    assert (above(place), below(place, 8.0)) == (("Distribution", 8.5), ("Time [s]", 8.0))


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


def test_ticks_have_room_at_the_left_of_a_plot():
    x = np.arange(3.0)
    few, many = (
        page_figure(Figure("a", "A.", (Plot((Line(x, factor * x),), Axis("Time", "s"), Axis("Residual", "V")),)))
        for factor in (1.0, 1.23456e-3)
    )
    assert many.plots[0].room >= few.plots[0].room + 3 * 6
    assert many.plots[0].room >= 6 * max(len(text) for _, text in many.plots[0].y.ticks)


@pytest.mark.parametrize("name", ["", "a b", "../up", "Upper", "a--b"])
def test_figure_names_are_file_names(name):
    with pytest.raises(ValueError, match="small letters"):
        replace(FIGURES["every mark"], name=name)
