"""The linear part of a model as a script for python-control.

With the offsets ``u0`` and ``y0`` of the script, the output of a linear model is y0 plus that of its system for u − u0;
between the filters of a cascade are its static maps, which the script does not have.
"""

from __future__ import annotations

import sys
from keyword import iskeyword
from typing import Any

import numpy as np

from emsid.errors import ModelError, listed
from emsid.exports.formats import Export, Files
from emsid.models.linear.state_space import as_state_space
from emsid.models.linear_parts import python_control
from emsid.models.starting import start

TAKEN = {"A", "B", "C", "D", "u0", "y0", "control", "matplotlib", "numpy", "scipy"}
"""A system of this name is overwritten, or a script of this name is loaded in place of the library."""


def control(export: Export) -> tuple[Files, list[str]]:
    """A script that makes the system ``NAME`` of python-control; of several filters ``NAME_1``, ``NAME_2``, ….

    Raises:
        ModelError: for a model without a linear part, a name that Python or the script uses, or where python-control is
            not installed.
    """
    if iskeyword(export.name) or export.name in TAKEN or export.name in sys.stdlib_module_names:
        why = "a word of Python" if iskeyword(export.name) else "a name that the script or a library it loads uses"
        raise ModelError(f"{export.name!r} is {why}; give another name", arguments=("name",))
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
    entering, at_zero = offsets(export)
    lines += ["", f"u0 = {entering!r}  # subtracted from the input", f"y0 = {at_zero!r}  # added to the output"]
    text = "\n".join(lines) + "\n"
    return {f"{export.name}.py": text}, lost(export.model)


def lost(model: Any) -> list[str]:
    """Sentences on what is not in the linear part."""
    blocks = getattr(model, "blocks", ())
    maps = [str(k) for k, block in enumerate(blocks, start=1) if not hasattr(block, "transfer")]
    if maps:
        return [f"Static maps, block {listed(maps)} of {len(blocks)}, are not carried."]
    if blocks or (not hasattr(model, "plant") and getattr(model, "is_linear", True)):
        return []
    return ["Dead zones, dry friction, delays of a drive and other terms that are not linear are not carried."]


def offsets(export: Export) -> tuple[float, list[float]]:
    """What is subtracted from the input, and the outputs for an input of zero behind the last filter."""
    model: Any = export.model
    if hasattr(model, "blocks"):
        return float(model.input_offset), [float(model.output_offset)]
    running = start(model, dt=export.dt or 1e-3)
    return 0.0, np.atleast_1d(running.step(np.zeros(running.inputs))).tolist()
