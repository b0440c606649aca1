"""The linear part of a model as a script for python-control."""

from __future__ import annotations

from keyword import iskeyword

import numpy as np

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.models.linear.state_space import as_state_space
from emsid.models.linear_parts import python_control


def control(export: Export) -> tuple[Files, list[str]]:
    """A script that makes the system ``NAME`` of python-control; of several filters ``NAME_1``, ``NAME_2``, ….

    Raises:
        ModelError: for a model without a linear part, a name that is a word of Python, or where python-control is not
            installed.
    """
    if iskeyword(export.name):
        raise ModelError(f"{export.name!r} is a word of Python; give another name", arguments=("name",))
    convert = getattr(export.model, "to_control", None)
    found = () if convert is None else convert()
    every = found if isinstance(found, tuple | list) else (found,)
    if not every:
        raise ModelError(f"{export.model.name} has no linear part for python-control; export it as c99")
    library = python_control()
    lines = [f"# Made by emsid: the linear part of {export.model.name}.", "import control"]
    for k, each in enumerate(every, start=1):
        system = as_state_space(each)
        both = zip("ABCD", library.ssdata(system), strict=True)
        step = f", {system.dt!r}" if system.dt not in (None, 0) else ""
        name = export.name if len(every) == 1 else f"{export.name}_{k}"
        lines += ["", *(f"{letter} = {np.asarray(matrix).tolist()!r}" for letter, matrix in both)]
        lines += [f"{name} = control.ss(A, B, C, D{step})"]
    text = "\n".join(lines) + "\n"
    return {f"{export.name}.py": text}, ["Dead zones, dry friction and other static maps are not in the linear part."]
