"""The command that `emsid describe` proposes can be pasted: a shell divides it into the words that were meant."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emsid import load
from emsid.cli.commands.describe import proposals
from emsid.cli.reading import command_line, file_word
from emsid.cli.terminal import harmless
from emsid.first_look import describe_files, groups

WORDS = [
    "a b",
    "it's",
    'say "u"',
    "$HOME",
    "`id`",
    "a;b",
    "*",
    "~",
    "!x",
    "",
    "back\\slash",
    "-x",
    "µ·Ω",
    "a\u00a0b",
    "#",
]
CONTROL = ["line\nbreak", "tab\there", "bell\x07", "\x1b[31mred", "\u202eexe", "byte\udcff", "quote'\n\\n"]


@given(st.lists(st.text(st.characters(exclude_categories=["C", "Z"]) | st.just(" "))))
def test_printable_words_are_divided_as_any_shell_does(words):
    assert shlex.split(command_line(words)) == words


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_divides_every_command_into_the_same_words_and_a_terminal_shows_it_unchanged():
    line = command_line(WORDS + CONTROL)
    assert harmless(line) == line
    assert "\n" not in line
    done = subprocess.run(["bash", "-c", f"printf '%s\\0' {line}"], capture_output=True, check=True)
    assert done.stdout == b"".join(os.fsencode(word) + b"\0" for word in WORDS + CONTROL)


@pytest.mark.parametrize("name", ["-log.csv", "a b's.csv", "--out=x.csv", "$(id).csv", "\u00fc \u2013 1.csv"])
def test_the_proposed_command_reads_the_file_that_was_described(run, tmp_path, monkeypatch, name):
    """Columns with spaces, quotes, dashes and ``=`` in their names, in a file that could be an option."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    u, y = np.repeat(rng.choice([-5.0, 5.0], 60), 10), np.zeros(600)
    for t in range(1, 600):
        y[t] = 0.9 * y[t - 1] + 0.2 * u[t - 1]
    rows = [f"{0.01 * k:.2f};{u[k]};{y[k]}" for k in range(600)]
    (tmp_path / name).write_text("\n".join(["t [s];-u='1' [V];rotor's speed [rad/s]", *rows]) + "\n")
    looks, _ = describe_files([file_word(name)])
    (words,) = proposals(groups(looks))
    assert {"-u='1' [V]", "rotor's speed [rad/s]"} <= set(words)
    (line,) = json.loads(run("describe", file_word(name), "--json")[1])["commands"]
    assert shlex.split(line) == words
    status, *_ = run(*shlex.split(line)[1:], "--models", "arx", "--na", 1, "--nb", 1, "--nk", 1, "--out", "r")
    assert status == 0
    assert np.allclose(load("r/arx.json").estimate, [-0.9, 0.2])
