"""A model for MATLAB and Octave: a function of one step, and the linear parts as a MAT file.

``NAME_init`` gives the state for a zero input, ``[y, s] = NAME_step(s, u)`` passes one sample. The function is the form
in C of the model, statement by statement, see `emsid.exports.matlab_source`.
"""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.exports.c99 import HELPERS
from emsid.exports.formats import Export, Files
from emsid.exports.matlab_source import translated
from emsid.models.c_form import CForm
from emsid.models.c_forms import c_form_of
from emsid.models.linear.state_space import as_state_space
from emsid.models.linear_parts import python_control


def matlab(export: Export) -> tuple[Files, list[str]]:
    """The functions of a step, and the MAT file, as far as the model has them.

    Raises:
        ModelError: for a model that has neither, or a sample time that is missing.
    """
    export, _ = export.sampled()
    files: Files = {}
    notes: list[str] = []
    form: CForm | None = None
    try:
        form = c_form_of(export.model, dt=export.dt)
        files[f"{export.name}_step.m"] = step(export, form)
        files[f"{export.name}_init.m"] = init(export, form)
        notes += form.notes
    except ModelError as problem:
        for name in (f"{export.name}_step.m", f"{export.name}_init.m"):
            files.pop(name, None)
        notes.append(f"There is no function of a step ({problem}); use its C or its FMU in Simulink.")
    systems = linear_parts(export)
    if systems:
        files[f"{export.name}.mat"] = mat(systems)
        notes.append("The linear parts in the MAT file have no dead zones, dry friction or other static maps.")
    if not files:
        raise ModelError(f"{export.model.name} has neither a step nor a linear part for MATLAB; export it as fmu")
    return files, notes


def step(export: Export, form: CForm) -> str:
    """The function of a step."""
    tables = {name: _row(values) for name, values in form.constants}
    whole = {name for name, values in form.constants if np.asarray(values).dtype.kind in "iub"}
    head = (
        f"function [y, s] = {export.name}_step(s, u)\n"
        f"% One sample of {export.dt!r} s: outputs y and state s for inputs u. Made by emsid.\n"
        f"  y = zeros(1, {form.outputs});"
    )
    return translated(HELPERS["above"] + form.functions, form.step, tables, whole, head)


def init(export: Export, form: CForm) -> str:
    """The function that gives the first state."""
    fields = ", ".join(f"'{name}', {_row(values)}" for name, values in form.state if len(values))
    head = f"function s = {export.name}_init()\n% The state for an input of zero. Made by emsid.\n"
    return f"{head}  s = struct({fields});\nend\n"


def _row(values: NDArray[Any]) -> str:
    """A row of numbers, with all their digits."""
    texts = (repr(value) for value in np.asarray(values).ravel().tolist())
    return "[" + " ".join(texts).replace("inf", "Inf").replace("nan", "NaN") + "]"


def linear_parts(export: Export) -> list[tuple[Any, ...]]:
    """A, B, C, D and sample time, 0 for continuous time, of every linear part; none where python-control is missing."""
    convert = getattr(export.model, "to_control", None)
    if convert is None:
        return []
    try:
        made = convert()
        library = python_control()
    except ModelError:
        return []
    every = made if isinstance(made, tuple | list) else [made]
    systems = [as_state_space(each) for each in every if hasattr(each, "dt")]
    return [(*map(np.asarray, library.ssdata(system)), float(system.dt or 0.0)) for system in systems]


def mat(systems: list[tuple[Any, ...]]) -> bytes:
    """The linear parts as variables A1, B1, C1, D1, dt1, A2 …"""
    from scipy.io import savemat

    content = {
        f"{name}{k + 1}": value
        for k, system in enumerate(systems)
        for name, value in zip(("A", "B", "C", "D", "dt"), system, strict=True)
    }
    memory = BytesIO()
    savemat(memory, content)
    return memory.getvalue()
