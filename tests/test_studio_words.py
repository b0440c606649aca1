"""The terms of the page: no option, command or path of the terminal in anything that the studio shows."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import emsid
from emsid.errors import DataError
from emsid.findings import Finding
from emsid.options import IDENTIFY, READING
from emsid.studio.studio import catalogue
from emsid.studio.words import field_name, in_page, said
from emsid.wording import sentence
from finding_examples import EXAMPLES

ROOT = Path(emsid.__file__).parent
NAMES = sorted({each.name for each in (*IDENTIFY, *READING)})
TERMINAL = re.compile(r"(?<!\S)--[a-z]|`emsid |command line|\bterminal\b")
PYTHON = re.compile(rf"\b({'|'.join(NAMES)})=(?!=)|\b({'|'.join(name for name in NAMES if '_' in name)})\b")


def texts(node: ast.expr) -> Iterator[str]:
    """Every text in an expression, with a letter where a value is put in."""
    for part in ast.walk(node):
        if isinstance(part, ast.JoinedStr):
            yield "".join(str(each.value) if isinstance(each, ast.Constant) else "X" for each in part.values)
        elif isinstance(part, ast.Constant) and isinstance(part.value, str):
            yield part.value


def raised() -> Iterator[tuple[str, str]]:
    """Every text that the library raises with an error, and where; those of the command line are its own."""
    for path in sorted(ROOT.rglob("*.py")):
        if "cli" in path.relative_to(ROOT).parts:
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Raise) and node.exc is not None:
                yield from ((f"{path.name}:{node.lineno}", text) for text in texts(node.exc))


def test_no_error_of_the_library_speaks_of_the_terminal_or_of_arguments_in_the_page() -> None:
    found = list(raised())
    assert len(found) > 1000
    wrong = [(where, text) for where, text in found if TERMINAL.search(in_page(text)) or PYTHON.search(in_page(text))]
    assert wrong == []


@pytest.mark.parametrize("finding", EXAMPLES, ids=lambda each: each.code)
def test_no_finding_speaks_of_the_terminal_in_the_page(finding: Finding) -> None:
    assert not TERMINAL.search(sentence(finding, field_name)), sentence(finding, field_name)


@pytest.mark.parametrize("name", NAMES)
def test_every_option_of_the_command_line_becomes_a_field(name: str) -> None:
    said_by_program = f"emsid track: X cannot be used; give --{name.replace('_', '-')} 3"
    assert in_page(said_by_program) == f"X cannot be used; give {field_name(name)} 3"


def test_an_error_names_the_fields_to_change_and_no_path_of_the_session(tmp_path: Path) -> None:
    problem = DataError(f"{tmp_path}/data/log.csv: too few samples", arguments=("derivative_window", "port"))
    assert said(problem, tmp_path) == "log.csv: too few samples (“Derivative window”)"
    problem = DataError(
        "the longest segment is short; give a shorter derivative_window", arguments=("derivative_window",)
    )
    assert said(problem) == "the longest segment is short; give a shorter “Derivative window”"


def test_the_fields_are_explained_without_the_terminal() -> None:
    found = catalogue()
    for each in (*found["options"], *found["reading"], *found["models"]):
        text = each.get("meaning", "") + each.get("summary", "")
        assert not TERMINAL.search(text), text
