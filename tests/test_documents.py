"""The documents beside the README: every term that the program shows is explained, every version has its section.

`make docs` builds the site strictly and runs its commands; here is what can be seen in the sources.
"""

from __future__ import annotations

import importlib
import re
import shlex
import tomllib
from html import unescape
from pathlib import Path

import pytest
import typer

import emsid
from emsid.cli.app import app
from emsid.wording import CATALOGUE

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
    assert [link for link in links if not ((HOME / name).parent / link).exists()] == []
    assert [each for each in named if not (HOME / each).exists()] == []


# --- the site --------------------------------------------------------------------------------------------------------


GENERATED = re.compile(r"reference/(command-line|findings|api/.*)\.md$")
"""Pages that the build makes from the program."""
PAGES = {
    str(path.relative_to(HOME)): path.read_text("utf-8")
    for path in sorted((HOME / "docs").rglob("*.md"))
    if not GENERATED.search(path.as_posix())
}


def test_the_pages_of_the_plan_are_there():
    pages = {name.removeprefix("docs/").removesuffix(".md") for name in PAGES}
    assert {"index", "start", "accuracy", "coming-from", "glossary", "cite"} <= pages
    for folder, least in (("tutorials", 5), ("howto", 8), ("theory", 9), ("reference", 2)):
        assert len([name for name in pages if name.startswith(f"{folder}/") and name != f"{folder}/index"]) >= least


@pytest.mark.parametrize("name", PAGES)
def test_every_picture_says_what_it_shows(name):
    for text, _ in re.findall(r"!\[(.*?)\]\((.*?)\)", PAGES[name], re.DOTALL):
        assert len(text.split()) > 3


@pytest.mark.parametrize("name", PAGES)
def test_every_page_is_reached_from_the_first(name):
    folder, page = Path(name).parent, Path(name).stem
    contents = {str(path): re.findall(r"```{toctree}\n(.*?)```", text, re.DOTALL) for path, text in PAGES.items()}
    listed = {
        ((HOME / path).parent / re.sub(r".*<(.*)>", r"\1", line)).resolve()
        for path, blocks in contents.items()
        for block in blocks
        for line in block.splitlines()
        if line and not line.startswith(":")
    }
    assert name == "docs/index.md" or (HOME / folder / page).resolve() in listed


def commands(text: str) -> list[str]:
    """The commands of emsid in code within a line, and on lines of blocks that are not run."""
    inline = re.findall(r"(?<!`)`(emsid [^`]+)`(?!`)", text)
    return [each for each in inline if "..." not in each and "COMMAND" not in each]


@pytest.mark.parametrize("name", [*PAGES, "README.md"])
def test_options_in_the_text_exist(name):
    known = typer.main.get_command(app)
    for line in commands(PAGES.get(name) or (HOME / name).read_text("utf-8")):
        words, command = shlex.split(" ".join(line.split()))[1:], known
        while words and words[0] in getattr(command, "commands", ()):
            command = command.commands[words.pop(0)]
        spelled = {option for param in command.params for option in getattr(param, "opts", ())}
        spelled |= {"--help", "--version", "--install-completion", "--show-completion"}
        assert [word for word in words if word.startswith("-") and word != "-" and word not in spelled] == [], line


def test_the_page_for_programs_has_every_command():
    """With or without `--json`, as it is."""
    rows = re.findall(r"^\| ((?:`[a-z ]+`(?:, )?)+) \| (.*?) \|", PAGES["docs/howto/programs.md"], re.MULTILINE)
    said = {name: "no `--json`" not in what for names, what in rows for name in re.findall(r"`([a-z ]+)`", names)}
    known, found = typer.main.get_command(app), {}
    for name, command in known.commands.items():
        below = getattr(command, "commands", {})
        for full, each in {f"{name} {n}": c for n, c in below.items()}.items() or {name: command}.items():
            found[full] = any("--json" in option.opts for option in each.params)
    assert said == found


MATLAB = (
    "compare", "resid", "predict", "forecast", "step", "impulse", "bode", "present", "getpvec", "setpar", "d2c", "c2d",
    "procest", "spa", "advice", "idplot",
)  # fmt: skip


def test_every_task_of_the_toolbox_takes_at_most_two_lines():
    blocks = re.findall(r"^\*\*(.*?)```python\n(.*?)```", PAGES["docs/howto/tasks.md"], re.MULTILINE | re.DOTALL)
    lines = {verb: len(code.splitlines()) for said, code in blocks for verb in re.findall(r"`(\w+)`", said)}
    assert [verb for verb in MATLAB if not 1 <= lines.get(verb, 0) <= 2] == []


def test_every_finding_has_what_triggers_it_and_what_to_do():
    known = tomllib.loads((HOME / "docs" / "reference" / "triggers.toml").read_text("utf-8"))
    assert set(known) == set(CATALOGUE), "add it to docs/reference/triggers.toml, or remove it"
    assert [code for code, (when, action) in known.items() if min(len(when), len(action)) < 4] == []


def test_citation_has_this_version():
    assert f"version: {emsid.__version__}" in (HOME / "CITATION.cff").read_text("utf-8")


def test_pictures_of_a_page_need_no_packages_of_the_tests(tmp_path, monkeypatch):
    """`make docs` in a fresh clone has neither pytest nor a browser: the page is without its pictures."""
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(HOME / "docs" / "_extensions")
    monkeypatch.delenv("EMSID_PICTURES", raising=False)
    executed = importlib.import_module("executed")
    monkeypatch.setattr(executed, "find_spec", lambda name: None if name == "pytest" else name)
    monkeypatch.setattr(executed.subprocess, "run", lambda *_, **__: pytest.fail("tests were run"))
    executed.take_pictures(HOME / "tests" / "test_studio_in_browser.py", "x", executed.Page(tmp_path), "page")
    assert not list(tmp_path.iterdir())
