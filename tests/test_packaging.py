"""What is prepared for package indexes agrees with the package: versions, dependencies, and pages that are named."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import emsid

HOME = Path(__file__).parent.parent
CALLED = {"matplotlib": "matplotlib-base", "msgspec": "msgspec-python"}
"""Names on conda-forge that differ."""


def test_the_conda_recipe_has_the_dependencies_and_the_version_of_the_package() -> None:
    recipe = (HOME / "conda-recipe" / "meta.yaml").read_text("utf-8")
    project = tomllib.loads((HOME / "pyproject.toml").read_text("utf-8"))["project"]
    wanted = set()
    for each in project["dependencies"]:
        name, bound = re.fullmatch(r"([\w.-]+)(.*)", each).groups()  # type: ignore[union-attr]
        wanted.add(f"{CALLED.get(name, name)} {bound}")
    run = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    assert {line.strip().removeprefix("- ") for line in run.splitlines()} == {"python >=3.11", *wanted}
    assert f'version = "{emsid.__version__}"' in recipe


def test_the_citation_is_of_this_version() -> None:
    citation = (HOME / "CITATION.cff").read_text("utf-8")
    assert f"version: {emsid.__version__}\n" in citation


def test_pages_that_are_listed_for_programs_exist() -> None:
    listed = re.findall(r"\]\((docs/[^)]+)\)", (HOME / "llms.txt").read_text("utf-8"))
    assert len(listed) > 8
    assert [page for page in listed if not (HOME / page).exists()] == []


def test_the_paper_cites_what_its_bibliography_has() -> None:
    paper, works = ((HOME / "paper" / name).read_text("utf-8") for name in ("paper.md", "paper.bib"))
    cited = set(re.findall(r"@([a-z]+\d*)", paper))
    assert cited == set(re.findall(r"@\w+\{(\w+),", works))


def test_what_a_release_needs_is_there_and_names_no_address() -> None:
    """Pythons in the classifiers begin with the oldest that is supported; the recipe builds the sdist of a release."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text("utf-8"))["project"]
    recipe = (HOME / "conda-recipe" / "meta.yaml").read_text("utf-8")
    assert "urls" not in project
    assert "://" not in recipe
    versions = [each.rpartition(" ")[2] for each in project["classifiers"] if re.search(r":: 3\.\d+$", each)]
    assert project["requires-python"] == f">={min(versions, key=lambda each: int(each[2:]))}"
    assert "make release" in (HOME / ".ci" / "run").read_text("utf-8")
    for name in ("SECURITY.md", "CODE_OF_CONDUCT.md", "CITATION.cff"):
        assert "@" not in (HOME / name).read_text("utf-8")
    assert "source:\n  path: ../dist/emsid-" in recipe
