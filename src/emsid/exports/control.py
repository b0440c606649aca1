"""The linear part of a model as a script for python-control."""

from __future__ import annotations

import numpy as np

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.models.linear_parts import python_control


def control(export: Export) -> tuple[Files, list[str]]:
    """A script that makes the system ``NAME`` of python-control.

    Raises:
        ModelError: for a model without a linear part, or where python-control is not installed.
    """
    convert = getattr(export.model, "to_control", None)
    if convert is None:
        raise ModelError(f"{export.model.name} has no linear part for python-control; export it as c99")
    found = convert()
    if isinstance(found, tuple | list):
        found = found[0]
    library = python_control()
    system = library.ss(found)
    both = zip("ABCD", library.ssdata(system), strict=True)
    matrices = "\n".join(f"{letter} = {np.asarray(matrix).tolist()!r}" for letter, matrix in both)
    step = f", {system.dt!r}" if system.dt not in (None, 0) else ""
    head = f"# Made by emsid: the linear part of {export.model.name}.\nimport control\n"
    text = f"{head}\n{matrices}\n{export.name} = control.ss(A, B, C, D{step})\n"
    return {f"{export.name}.py": text}, ["Dead zones, dry friction and other static maps are not in the linear part."]
