"""A step as a program in Python that gives the same numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from pprint import pformat
from typing import Any

from emsid.studio.data import arguments


def as_script(task: Mapping[str, Any], folder: Path) -> str:
    """The program for a task, with the files in a folder.

    Args:
        task: files, reading, models and options.
        folder: of the files.
    """
    reading = arguments(task["reading"])
    given = "".join(f"    {name}={value!r},\n" for name, value in reading.items())

    def read(names: list[str]) -> str:
        return pformat([str(folder / name) for name in names], width=110)

    lines = ["import emsid", "", f"reading = dict(\n{given})"]
    lines.append(f"records = [emsid.read(path, **reading) for path in {read(task['files'])}]")
    unseen = repr(task["unseen"])
    if task["unseen_files"]:
        unseen = "unseen"
        lines.append(f"unseen = [emsid.read(path, **reading) for path in {read(task['unseen_files'])}]")
    options = {**({"models": task["models"]} if task["models"] else {}), **task["options"]}
    words = ["records", unseen, *(f"{name}={value!r}" for name, value in options.items())]
    lines += [f"result = emsid.identify({', '.join(words)})", "print(result)"]
    return "\n".join(lines) + "\n"
