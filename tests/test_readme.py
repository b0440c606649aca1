"""The README shows what works: its blocks stand, line by line, on pages of the site, whose blocks `make docs` runs."""

import re
from pathlib import Path

import pytest

HOME = Path(__file__).parent.parent
README = (HOME / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, re.DOTALL)
START = (HOME / "docs" / "start.md").read_text("utf-8")


def test_there_is_something_to_run():
    assert [language for language, _ in BLOCKS] == ["bash", "python"]
    assert len([line for line in BLOCKS[1][1].splitlines() if line]) <= 10


def test_every_line_is_run_on_the_first_page_in_this_order():
    run = [
        line for _, text in re.findall(r"```(bash|python)\n(.*?)```", START, re.DOTALL) for line in text.splitlines()
    ]
    for _, text in BLOCKS:
        places = [run.index(line) for line in text.splitlines()]
        assert places == sorted(places)


def test_make_targets_that_the_readme_names_exist():
    makefile = (HOME / "Makefile").read_text()
    for target in re.findall(r"make (\w+)", README):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


@pytest.mark.parametrize("target", ["study", "docs", "test"])
def test_continuous_integration_runs_what_the_readme_tells_to_run(target):
    assert f"make {target}" in README
    assert f"make {target}" in (HOME / ".ci" / "run").read_text()


def test_pictures_are_there_and_have_alternative_text():
    pictures = re.findall(r"!\[(.*?)\]\((.*?)\)", README)
    assert pictures
    for text, name in pictures:
        assert len(text.split()) > 3
        assert (HOME / name).exists()
