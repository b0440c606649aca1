"""Sections of a report, the page that they make, and what both refuse."""

from __future__ import annotations

import re
from dataclasses import fields, replace

import numpy as np
import pytest

from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.findings import Finding
from emsid.identification.candidates import usual_for
from emsid.record import Record
from emsid.report import document as content
from emsid.report import views
from emsid.report.document import Axis, Figure, Line, Plot, Report, Section, Table
from emsid.report.figures import draw
from emsid.report.page import HEIGHT, PAGE_POINTS, WIDTH, page, page_figure, report_files, write_files
from emsid.report.views.conventions import MODELS
from emsid.report.views.grey_box import units_taken
from report_examples import CASCADE_FITS, FIGURES, NASTY, PLANT_FITS, PROFILES, RECURSIVE, TABLES, drive, inside


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
    assert shown(RECURSIVE[0], drive()) == ["arx-poles"]


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
    (text,) = views.model_section(fit, fit.segments[0]).paragraphs
    assert "no unit for voltage and speed; they are read as SI" in text
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
    assert 'fix &lt;R&gt; (<span class="whole">--fix-all</span>), 3\u00a0% of it' in own


def test_a_number_stays_on_one_line():
    sentences = "from -6.0 to 1e-05 V, p < 1e-16, lags -3, u(t-1) and arx-2"
    own = page(Report("A drive", (), (Section("Results", remarks=(sentences,)),)))
    assert re.findall(r'<span class="whole">(.*?)</span>', own) == ["-6.0", "1e-05", "1e-16", "-3"]


def test_captions_and_notes_keep_a_percentage_on_one_line():
    table = Table(("a", "b"), (("x", "1"),), "95 % intervals", "At 5 % of it")
    figure = replace(FIGURES["every mark"], caption="A fit of 72 %.")
    own = page(Report("A drive", (), (Section("Results", tables=(table,), figures=(figure,)),)))
    for text in ("95\u00a0% intervals</p>", "At 5\u00a0% of it</p>", "A fit of 72\u00a0%.</figcaption>"):
        assert text in own


def test_every_default_model_has_its_own_look():
    assert len(set(MODELS)) == len(MODELS) >= len(usual_for(Record(np.ones(9), np.ones(9), 0.1)))


def test_plots_are_enlarged_with_the_keyboard_too(html):
    assert "With the keyboard: + and −" in html
    assert "area.tabIndex = 0" in html
    for key in ("+", "-", "ArrowLeft", "ArrowRight", "Escape"):
        assert f'case "{key}"' in html
    assert ".area:focus-visible { outline" in html


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


def test_the_files_of_a_report(tmp_path):
    report = Report("A drive", (), (Section("Results", figures=(FIGURES["every mark"], FIGURES["ranking, whole"])),))
    heard = []
    path = write_files(report_files(report, Control(report=heard.append)), tmp_path / "new" / "folder")
    assert path == tmp_path / "new" / "folder" / "report.html"
    assert path.read_text(encoding="utf-8") == page(report)
    assert sorted(file.name for file in (path.parent / "figures").iterdir()) == ["marks.svg", "ranking.svg"]
    assert (path.parent / "figures" / "marks.svg").read_bytes() == draw(FIGURES["every mark"])["svg"]
    assert [(each.done, each.total) for each in heard[1:]] == [(0, 2), (1, 2)]


@pytest.mark.parametrize("formats", [(), ("pdf",), ("svg", "pdf")])
def test_figures_are_written_in_the_formats_asked_for(tmp_path, formats):
    report = Report("A drive", (), (Section("Results", figures=(FIGURES["every mark"],)),))
    write_files(report_files(report, formats=formats), tmp_path)
    written = {path.name for path in tmp_path.rglob("marks.*")}
    assert written == {f"marks.{suffix}" for suffix in formats}


def test_a_cancelled_report_has_no_files():
    report = Report("A drive", (), (Section("Results", figures=(FIGURES["every mark"],)),))
    with pytest.raises(Stopped):
        report_files(report, Control(cancelled=lambda: True))


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
