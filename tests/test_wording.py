"""Every sentence about a result, pinned in one file; elsewhere tests assert the code of a finding and its data.

To add a code: register its words in `emsid.wording`, add an example to `finding_examples`, and write the file of
sentences again: ``python tests/test_wording.py``. Then read its difference.
"""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import emsid
from emsid.cli.options import option
from emsid.findings import Finding
from emsid.wording import CATALOGUE, Severity, sentence, severity
from emsid.wording.catalogue import filled
from emsid.wording.claims import claim
from finding_examples import EXAMPLES
from source_tree import nodes_of

HOME = Path(emsid.__file__).parent
TESTS = Path(__file__).parent
SENTENCES = TESTS / "wording" / "sentences.txt"


def golden() -> str:
    """Every example as Python and as the command line words it, with its row in the table of claims of the paper."""
    lines = []
    for finding in sorted(EXAMPLES, key=lambda example: example.code):
        lines.append(f"{finding.code} ({severity(finding).value})")
        python, command = sentence(finding), sentence(finding, option)
        lines.append(f"  {python}")
        if command != python:
            lines.append(f"  {command}")
        about = claim(finding)
        if about is not None:
            lines += [f"  paper: {about.paper}", f"  found: {about.found}", f"  where: {about.where}"]
    return "\n".join(lines) + "\n"


def test_every_sentence_is_the_one_in_the_file() -> None:
    assert golden().splitlines() == SENTENCES.read_text("utf-8").splitlines()


def test_every_code_has_an_example() -> None:
    assert {finding.code for finding in EXAMPLES} == set(CATALOGUE)


@pytest.mark.parametrize("finding", EXAMPLES, ids=lambda finding: finding.code)
def test_a_sentence_is_one_line_with_one_full_stop_at_its_end(finding: Finding) -> None:
    said = sentence(finding)
    assert said.endswith(".")
    assert not said.endswith("..")
    assert "\n" not in said
    assert "  " not in said
    assert "None" not in said
    assert "--" not in said
    assert json.loads(json.dumps(finding.to_data(), allow_nan=False)) == finding.to_data()


MOST_WORDS = 28
"""About 25 words: numbers and units count too."""
LISTS = {"model-limited", "model-implausible"}
"""Findings that are a list, with one reason after the other."""


def test_a_finding_has_at_most_about_25_words() -> None:
    long = {example.code for example in EXAMPLES if len(sentence(example).split()) > MOST_WORDS}
    assert long <= LISTS


# Riddles and private vocabulary; the table of plain words is longer.
@pytest.mark.parametrize(
    "word",
    ["guess", "told", "tell apart", "held", "brought home", "throughout", "judge by what", "so many", "set aside"],
)
def test_sentences_are_in_plain_words(word: str) -> None:
    assert word not in golden().lower()


# --- the codes of the catalogue and those of the program -------------------------------------------------------------


def strings(path: Path) -> Iterator[str]:
    """Every text in a file of Python, but for docstrings."""
    documents = {
        id(node.body[0].value)
        for node in nodes_of(path)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in nodes_of(path):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents:
            yield node.value


def constructed(path: Path) -> Iterator[str]:
    """The codes that findings are made with, where they are written in the call."""
    for node in nodes_of(path):
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Finding":
            first: Any = node.args[0] if node.args else next((k.value for k in node.keywords if k.arg == "code"), None)
            for each in ast.walk(first) if first is not None else ():
                if isinstance(each, ast.Constant) and isinstance(each.value, str):
                    yield each.value


SOURCES = [path for path in HOME.rglob("*.py") if path.parent.name != "wording"]


def test_every_finding_in_the_program_has_words() -> None:
    assert {code for path in SOURCES for code in constructed(path)} <= set(CATALOGUE)


def test_every_code_with_words_is_used_in_the_program() -> None:
    used = {text for path in SOURCES for text in strings(path)}
    assert set(CATALOGUE) - used == set()


def test_every_code_is_triggered_by_a_test() -> None:
    not_here = (Path(__file__).name, "test_findings_absent.py")  # which name codes that they do not trigger
    tests = [path for path in TESTS.glob("test_*.py") if path.name not in not_here]
    named = {text for path in tests for text in strings(path)}
    assert set(CATALOGUE) - named == set()


# --- the catalogue itself --------------------------------------------------------------------------------------------


def test_a_code_is_in_small_letters_with_hyphens() -> None:
    with pytest.raises(ValueError, match="small letters"):
        Finding("Input_Constant")


def test_a_code_has_one_wording() -> None:
    from emsid.wording import words

    with pytest.raises(ValueError, match="two wordings for 'few-samples'"):
        words("few-samples", Severity.INFO)(lambda f, argument: "")


@pytest.mark.parametrize(
    ("template", "said"),
    [
        ("{step:.2g[unit]} in {share:.0f %}", "0.5 rad/s in 25 %"),
        ("{names} {names:step/steps}, {one} {one:step/steps}", "['a', 'b'] steps, 1 step"),
        ("{absent:?there|{side:upper=>above|below}}{unit:? {side}}", "below lower"),
        (
            "{names:list}, {names:or}, {rows:list {name} = {value:.3g[unit]}}",
            "a and b, a or b, x = 2 rad/s and y = 3 rad/s",
        ),
        ("{pairs:commas {0} = {1:.1f[2]}}", "k = 1.0 V"),
        ("{name:assign {one}}, {wait:duration}", "'Voltage (V)=1', 10.5 ms"),
    ],
)
def test_a_row_is_filled_with_the_data_of_a_finding(template: str, said: str) -> None:
    data = {
        "step": 0.5, "unit": "rad/s", "share": 0.25, "names": ["a", "b"], "one": 1, "side": "lower", "wait": 0.0105,
        "rows": [{"name": "x", "value": 2.0}, {"name": "y", "value": 3.0}], "pairs": [["k", 1.0, "V"]],
        "name": "Voltage (V)",
    }  # fmt: skip
    assert filled(template, data) == said


def test_a_row_needs_its_data() -> None:
    with pytest.raises(KeyError, match="no value for 'level'"):
        filled("at {level:.3g}", {})


def test_the_model_stands_before_the_sentence_once() -> None:
    alone = Finding("few-samples", data={"samples": 4.0, "parameters": 2})
    assert sentence(alone.about("arx")) == f"arx: {sentence(alone)}"
    text = CATALOGUE["few-samples"].wording(alone, str)
    assert sentence(alone) == f"{text}."


if __name__ == "__main__":
    SENTENCES.write_text(golden(), "utf-8")
