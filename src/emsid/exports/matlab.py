"""A model for MATLAB and Octave: a function of one step, and the linear parts as a MAT file.

``NAME_init`` gives the state for a zero input, ``[y, s] = NAME_step(s, u)`` passes one sample. The function is the form
in C of the model, statement by statement: `translated` knows the few kinds of statements that the forms of regressions,
linear models, cascades and feedback models have. The form of a plant has others; Simulink takes its C or its FMU.
"""

from __future__ import annotations

import re
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.models.c_form import CForm
from emsid.models.c_forms import c_form_of
from emsid.models.linear.state_space import as_state_space
from emsid.models.linear_parts import python_control

FUNCTIONS = {
    "EXP": "exp",
    "FABS": "abs",
    "FLOOR": "floor",
    "SIN": "sin",
    "COS": "cos",
    "TANH": "tanh",
    "sign_of": "sign",
}
"""The macros and functions of the form in C, as MATLAB calls them."""
MAP = """
function value = map_value(k, z)
  first = map_first(k + 1);
  last = map_first(k + 2) - 1;
  edges = map_edges(first + 1:last + 1);
  low = first + max(sum(edges <= z), 1) - 1;
  h = z - map_origins(low + 1);
  value = 0;
  for power = MAP_TERMS - 1:-1:0
    value = value * h + map_coefficients(low * MAP_TERMS + power + 1);
  end
  if map_jumps(k + 1) ~= 0
    if map_widths(k + 1) > 0
      value = value + map_jumps(k + 1) * tanh(z / map_widths(k + 1));
    else
      value = value + map_jumps(k + 1) * sign(z);
    end
  end
end
"""
"""The static map k at z, from tables of polynomials between break points."""
SHIFTED = """
function x = shifted(x, before, count)
  x(before + 1:before + count - 1) = x(before + 2:before + count);
end
"""
"""Part of a row, moved by one sample."""
RULES: tuple[tuple[str, str], ...] = (
    (r"shift\(s->(\w+), ([^,]+)\)", r"s.\1 = shifted(s.\1, 0, \2)"),
    (r"shift\(s->(\w+) \+ (\d+), ([^,]+)\)", r"s.\1 = shifted(s.\1, \2, \3)"),
    (r"for \((\w+) = 0; \w+ < (\w+); \+\+\w+\) \{", r"for \1 = 0:\2 - 1"),
    (r"if \((.*)\) \{", r"if \1"),
    (r"\}", "end"),
    (r"real (\w+)\[(\d+)\]", r"\1 = zeros(1, \2)"),
    (r"(?:real|int) \w+", ""),
    (r"([^=]+) \+= (.*)", r"\1 = \1 + (\2)"),
    (r"([^=]+ = .*)", r"\1"),
)
"""The statements of a step, as whole lines, and what they become."""


def matlab(export: Export) -> tuple[Files, list[str]]:
    """The functions of a step, and the MAT file, as far as the model has them.

    Raises:
        ModelError: for a model that has neither, or a sample time that is missing.
    """
    if export.dt is None:
        raise ModelError(f"{export.model.name} has no sample time of its own; give dt", arguments=("dt",))
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


def translated(step: str) -> list[str]:
    """The statements of a step of C as lines of MATLAB.

    Raises:
        ModelError: for a statement of another kind.
    """
    found = []
    for line in step.splitlines():
        indent, text = line[: len(line) - len(line.lstrip())], line.strip().removesuffix(";")
        for pattern, replacement in RULES:
            if re.fullmatch(pattern, text):
                made = _expression(re.sub(f"^{pattern}$", replacement, text))
                break
        else:
            raise ModelError(f"the statement {text!r} has no form in MATLAB")
        if "?" in made or "->" in made or "&" in made:
            raise ModelError(f"the statement {text!r} has no form in MATLAB")
        if made:
            ends = "" if made == "end" or made.startswith(("for ", "if ")) else ";"
            found.append(f"{indent[2:]}{made}{ends}")
    return found


def _expression(text: str) -> str:
    """An expression of C in MATLAB, where indices begin at one."""
    while (indexed := re.sub(r"(\w)\[([^\[\]]+)\]", r"\1(\2 + 1)", text)) != text:
        text = indexed
    text = re.sub(r"\bK\(([^()]+)\)", r"\1", text.replace("s->", "s."))
    text = text.replace("K_INFINITY", "Inf").replace("K_NAN", "NaN").replace("!=", "~=")
    for name, called in FUNCTIONS.items():
        text = re.sub(rf"\b{name}\(", f"{called}(", text)
    return text


def step(export: Export, form: CForm) -> str:
    """The function of a step."""
    define = dict(re.findall(r"#define (\w+) (\d+)", form.functions))
    tables = {name: _row(values) for name, values in form.constants}
    body = translated(form.step)
    text, below = "\n".join(body), ""
    for name, value in define.items():
        text = re.sub(rf"\b{name}\b", value, text)
    if "map_value(" in text:
        below = MAP.replace("MAP_TERMS", define["MAP_TERMS"])
        head = "".join(f"  {name} = {row};\n" for name, row in tables.items() if name in below)
        below = below.replace("  first =", f"{head}  first =", 1)
    if "shifted(" in text:
        below += SHIFTED
    if "above(" in text:
        below += "\nfunction y = above(x)\n  y = max(x, 0);\nend\n"
    own = "".join(f"  {name} = {row};\n" for name, row in tables.items() if f"{name}(" in text)
    return (
        f"function [y, s] = {export.name}_step(s, u)\n"
        f"% One sample of {export.dt!r} s: outputs y and state s for inputs u. Made by emsid.\n"
        f"{own}  y = zeros(1, {form.outputs});\n{text}\nend\n{below}"
    )


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
