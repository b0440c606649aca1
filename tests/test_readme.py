"""Every command and every line of Python in the README works, in this order, in an empty folder."""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from emsid.identification.candidates import CANDIDATES

HOME = Path(__file__).parent.parent
README = (HOME / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"```(bash|python)\n(.*?)```", README, re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("newcomer")


def test_there_is_something_to_run():
    assert {language for language, _ in BLOCKS} == {"bash", "python"}


def test_commands_and_python_run(folder, command, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    python = ""
    for language, text in BLOCKS:
        if language == "python":  # later blocks go on where earlier ones ended
            python += text
            continue
        lines = [shlex.split(line, comments=True) for line in text.splitlines()]
        assert all(words[0] == "emsid" for words in lines if words)
        for words in filter(None, lines):
            words, target = (words[:-2], Path(words[-1])) if words[-2:-1] == [">"] else (words, None)
            status = command(*words[1:])
            if "rigid-motor" in " ".join(words):  # the refinements of a motor are searched once; the rest is run again
                plain = replace(CANDIDATES["rigid-motor"], refinements=())
                monkeypatch.setitem(CANDIDATES, "rigid-motor", plain)
            printed, complaints = capsys.readouterr()
            assert status == 0, f"{shlex.join(words)}: {complaints}"
            if target is not None:
                target.write_text(printed)
    exec(compile(python, "README.md", "exec"), {"__name__": "__main__"})
    assert (folder / "result" / "report.html").exists()


def test_make_targets_that_the_readme_names_exist():
    makefile = (HOME / "Makefile").read_text()
    for target in re.findall(r"make (\w+)", README):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_picture_is_there():
    for name in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (HOME / name).exists()
