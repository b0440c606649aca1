"""A model as C99: ``NAME.h`` and ``NAME.c``, without heap or globals, with ``math.h`` alone.

The state is a struct of the caller. ``NAME_init`` puts it into the steady state of a zero input, ``NAME_step`` takes
the inputs of a sample and gives its outputs: the same statements and, in double precision, the same numbers as
`emsid.start`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.exports.formats import Export, Files, switched
from emsid.exports.recursive import recursive
from emsid.models.c_form import CForm, number
from emsid.models.c_forms import c_form_of

FUNCTIONS = (
    "exp",
    "expm1",
    "fabs",
    "floor",
    "log1p",
    "sin",
    "cos",
    "tanh",
    "sqrt",
    "pow",
    "log",
    "ceil",
    "atan",
    "atanh",
)
HELPERS = {
    "sign_of": "static real sign_of(real x)\n{\n    return (real)((x > K(0.0)) - (x < K(0.0)));\n}\n",
    "above": "static real above(real x)\n{\n    return x > K(0.0) ? x : K(0.0);\n}\n",
    **{
        f"{name}_{kind}": f"static {kind} {name}_{kind}({kind} a, {kind} b)\n{{\n    return b {sign} a ? b : a;\n}}\n"
        for name, sign in (("min", "<"), ("max", ">"))
        for kind in ("real", "int")
    },
}
"""Functions that are written where they are used."""
SMALL = {
    "expm1": """\
static real small_expm1(real x)
{
    const real all = (real)exp(x);
    return all > K(1.0) || all < K(1.0) ? (all > K(0.0) ? (all - K(1.0)) * x / (real)log(all) : -K(1.0)) : x;
}
""",
    "log1p": """\
static real small_log1p(real x)
{
    const real all = K(1.0) + x;
    return all > K(1.0) || all < K(1.0) ? (real)log(all) * x / (all - K(1.0)) : x;
}
""",
    "atanh": "static real small_atanh(real x)\n{\n    return (real)log((K(1.0) + x) / (K(1.0) - x)) / K(2.0);\n}\n",
}
"""Functions that the C library of AVR does not have, by Kahan's formulas, whose errors of rounding cancel."""
WIDTH = 100
"""Characters of a line of a table."""


def c99(export: Export) -> tuple[Files, list[str]]:
    """The header and the source of a model.

    Raises:
        ModelError: for a model without a form in C, a sample time that is missing, an option that is neither yes nor
            no, or a recursion of a model that is no regression.
    """
    export, dt = export.sampled()
    single = switched(export, "single")
    form = c_form_of(export.model, dt=dt, single=single, parameters=tuple(export.options.get("settable", ())))
    latency = int(export.model.latency)
    files: Files = {
        f"{export.name}.h": header(export.name, form, dt, latency, single=single),
        f"{export.name}.c": source(export.name, form, single=single),
    }
    if switched(export, "recursive"):
        files |= recursive(
            export, single=single, macros=lambda text: macros_of(text, single=single), helpers=helpers_of
        )
    late = [f"The output is {latency} samples late, as the model interpolates its input."] if latency else []
    rounding = ["Single precision: compare it with the model before use."] if single else []
    return files, [*form.notes, *late, *rounding]


def header(name: str, form: CForm, dt: float, latency: int, *, single: bool) -> str:
    """The header: types, sizes and two functions."""
    guard = f"{name.upper()}_H"
    arrays = "\n".join(f"    {name}_real {array}[{len(values)}];" for array, values in form.state if len(values))
    setter = ""
    if form.parameters:
        names = ", ".join(each for each, _ in form.parameters)
        arguments = f"({name}_state *state, const {name}_real p[])"
        setter = f"/* Set the parameters: {names}. */\nvoid {name}_set{arguments};\n\n"
    return f"""\
/* Made by emsid. Sample time {dt!r} s. */
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

typedef {"float" if single else "double"} {name}_real;

#define {name.upper()}_INPUTS {form.inputs}
#define {name.upper()}_OUTPUTS {form.outputs}
#define {name.upper()}_LATENCY {latency} /* samples by which the output is late */

typedef struct {{
{arrays or f"    {name}_real none[1];"}
}} {name}_state;

/* The steady state for an input of zero. */
void {name}_init({name}_state *state);

{setter}/* One sample: the outputs for its inputs, and the state after it. */
void {name}_step({name}_state *state, const {name}_real u[], {name}_real y[]);

#ifdef __cplusplus
}}
#endif

#endif
"""


def source(name: str, form: CForm, *, single: bool) -> str:
    """The source: constants, helpers, and two functions."""
    text = form.functions + form.step + form.setting
    macros, helpers = macros_of(text, single=single), helpers_of(text)
    tables = "\n".join(table(array, values) for array, values in form.constants if array in text)
    initial = ", ".join(f"{{{', '.join(map(number, values.tolist()))}}}" for _, values in form.state if len(values))
    parts = [
        f'/* Made by emsid. */\n#include <math.h>\n\n#include "{name}.h"\n\ntypedef {name}_real real;\n\n'
        f"#define K(x) {'x##f' if single else 'x'}\n#define K_INFINITY ((real)INFINITY)\n#define K_NAN ((real)NAN)\n"
        f"{macros}",
        helpers,
        tables,
        form.functions,
        f"void {name}_init({name}_state *state)\n{{\n    static const {name}_state initial = "
        f"{{{initial or '{K(0.0)}'}}};\n    *state = initial;\n}}\n",
        form.setting and f"void {name}_set({name}_state *s, const real p[])\n{{\n{form.setting}}}\n",
        f"void {name}_step({name}_state *s, const real u[], real y[])\n{{\n{form.step}}}\n",
    ]
    return "\n".join(part for part in parts if part)


def macros_of(text: str, *, single: bool) -> str:
    """The macros of the functions of ``math.h`` that a text uses."""
    return "".join(_macro(function, "f" if single else "") for function in FUNCTIONS if f"{function.upper()}(" in text)


def helpers_of(text: str) -> str:
    """The functions that a text uses and that are not in ``math.h``."""
    return "\n".join(code for called, code in HELPERS.items() if f"{called}(" in text)


def _macro(name: str, suffix: str) -> str:
    """The macro of a function of ``math.h``."""
    usual = f"#define {name.upper()} {name}{suffix}\n"
    if name not in SMALL:
        return usual
    return f"#ifdef __AVR__\n{SMALL[name]}#define {name.upper()} small_{name}\n#else\n{usual}#endif\n"


def table(name: str, values: NDArray[Any]) -> str:
    """A table of constants, wrapped."""
    whole = np.issubdtype(values.dtype, np.integer)
    texts = [str(int(value)) for value in values] if whole else [number(value) for value in values.tolist()]
    lines, line = [], "   "
    for text in texts:
        if len(line) + len(text) + 2 > WIDTH:
            lines.append(line)
            line = "   "
        line += f" {text},"
    lines.append(line)
    kind = "int" if whole else "real"
    return f"static const {kind} {name}[{len(values)}] = {{\n" + "\n".join(lines) + "\n};\n"
