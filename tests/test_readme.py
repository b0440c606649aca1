"""Every command and every line of Python in the README works, in this order, in an empty folder."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

README = (Path(__file__).parent.parent / "README.md").read_text()
BLOCKS = re.findall(r"```(bash|python)\n(.*?)```", README, re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("newcomer")


def test_there_is_something_to_run():
    assert {language for language, _ in BLOCKS} == {"bash", "python"}


def execute(folder, *words):
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, f"{words[2:]}: {done.stderr}"
    return done.stdout


def test_commands_and_python_run(folder):
    python = ""
    for language, text in BLOCKS:
        if language == "python":  # later blocks go on where earlier ones ended
            python += text
            continue
        lines = [shlex.split(line, comments=True) for line in text.splitlines()]
        assert all(words[0] == "emsid" for words in lines if words)
        for words in filter(None, lines):
            command, target = (words[:-2], folder / words[-1]) if words[-2:-1] == [">"] else (words, None)
            printed = execute(folder, "-c", "from emsid.cli import main; main()", *command[1:])
            if target is not None:
                target.write_text(printed)
    execute(folder, "-W", "error", "-c", python)
    assert (folder / "result" / "report.html").exists()


def test_make_targets_that_the_readme_names_exist():
    makefile = (Path(__file__).parent.parent / "Makefile").read_text()
    for target in re.findall(r"make (\w+)", README):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_picture_is_there():
    for name in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (Path(__file__).parent.parent / name).exists()
