"""A step as a program in Python that gives the same numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from emsid.studio.data import arguments


def as_script(task: Mapping[str, Any], folder: Path) -> str:
    """The program for a task, with the files in a folder.

    Args:
        task: files, the reading of each, models and options.
        folder: of the files.
    """

    def read(name: str, files: list[str]) -> list[str]:
        lines = [f"{name} = ["]
        for file in files:
            given = arguments(task["readings"][file])
            lines += ["    emsid.read(", f"        {str(folder / file)!r},"]
            lines += [*(f"        {key}={value!r}," for key, value in given.items()), "    ),"]
        return [*lines, "]"]

    lines = ["import emsid", "", *read("records", task["files"])]
    unseen = repr(task["unseen"])
    if task["unseen_files"]:
        unseen = "unseen"
        lines += read(unseen, task["unseen_files"])
    options = {**({"models": task["models"]} if task["models"] else {}), **task["options"]}
    words = ["records", unseen, *(f"{name}={value!r}" for name, value in options.items())]
    lines += [f"result = emsid.identify({', '.join(words)})", "print(result)"]
    return "\n".join(lines) + "\n"
