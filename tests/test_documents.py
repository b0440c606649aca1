"""The documents beside the README: every term that the program shows is explained, every version has its section."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import pytest

import emsid

HOME = Path(__file__).parent.parent
ENTRY = re.compile(r"^- \*\*(.+?)\*\* – (.+?)(?=^- \*\*|^#|\Z)", re.MULTILINE | re.DOTALL)
GLOSSARY = [
    (term.strip().casefold(), " ".join(meaning.split()))
    for terms, meaning in ENTRY.findall((HOME / "docs" / "glossary.md").read_text("utf-8"))
    for term in terms.split(",")
]


def plain(heading: str) -> str:
    """A heading as the glossary has it: without its unit, in small letters."""
    text = re.sub(r"<[^>]+>|\[.*?\]", "", unescape(heading)).replace("\N{NON-BREAKING HYPHEN}", "-")
    return " ".join(text.split()).casefold()


@pytest.fixture(scope="module")
def headings(tmp_path_factory, command):
    """Headings of the tables that an identification prints and writes, with every kind of model in it."""
    import rich.table

    folder = tmp_path_factory.mktemp("headings")
    printed: list[str] = []
    add_column = rich.table.Table.add_column

    def noted(self, header="", *rest, **named):
        printed.append(str(header))
        add_column(self, header, *rest, **named)

    identify = ("identify", "log.csv", "-u", "voltage", "-y", "speed", "--time", "t", "--out", "out")
    models = ("--models", "arx,hammerstein,rigid-motor", "--orders", "1", "--static", "dead-zone")
    known = ("--free", "motor_constant,rotor_inertia", "--fix", "resistance=2")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(rich.table.Table, "add_column", noted)
        assert command("simulate", "--duration", 4, "--out", "log.csv") == 0
        assert command(*identify, *models, *known) == 0
    page = (folder / "out" / "report.html").read_text("utf-8")
    written = re.findall(r"<th\b[^>]*>(.*?)</th>", page, re.DOTALL)
    assert printed
    assert written
    return {plain(each) for each in (*printed, *written)} - {""}


def test_every_heading_of_a_table_is_in_the_glossary(headings):
    terms = {term for term, _ in GLOSSARY}
    assert sorted(headings - terms) == []


def test_an_entry_is_short_and_stands_once():
    terms = [term for term, _ in GLOSSARY]
    assert len(terms) > 60
    assert len(set(terms)) == len(terms)
    assert [(term, meaning) for term, meaning in GLOSSARY if not 20 < len(meaning) < 320] == []


def test_the_changelog_has_a_section_for_this_version():
    sections = re.findall(r"^## (\S+)", (HOME / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert sections[0] == "Unreleased"
    assert emsid.__version__ in sections


@pytest.mark.parametrize("name", ["VISION.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/glossary.md", "README.md"])
def test_files_that_documents_point_to_exist(name):
    links = re.findall(r"\]\((?!https?:|#|mailto:)([^)#]+)", (HOME / name).read_text("utf-8"))
    named = re.findall(r"`((?:src|tests|docs|examples|bench)/[\w./-]+)`", (HOME / name).read_text("utf-8"))
    assert [each for each in links if not ((HOME / name).parent / each).exists()] == []
    assert [each for each in named if not (HOME / each).exists()] == []
