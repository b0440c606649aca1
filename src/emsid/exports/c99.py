"""A model as C99: ``NAME.h`` and ``NAME.c``, without heap or globals, with ``math.h`` alone.

The state is a struct of the caller. ``NAME_init`` puts it into the steady state of a zero input, ``NAME_step`` takes
the inputs of a sample and gives its outputs: the same statements and, in double precision, the same numbers as
`emsid.start`.

**Recursive least squares.** For the structure of a regression, ``NAME_rls.h`` and ``NAME_rls.c`` estimate its
parameters sample by sample. Their state is the triangular factor of the information, as
`emsid.estimation.linear.information` has it: R and z with

    [R z]  ←  the triangle of  [√λ·[R z]; φᵀ y]

by p Givens rotations for a sample. The covariance is never formed, so rounding cannot make it indefinite, which is what
single precision needs. The parameters are θ = R⁻¹z. They begin at those of the model, R = √w·I: the weight w says how
many samples with regressors of size one they are worth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files, switched
from emsid.models.c_form import SHIFT, CForm, number
from emsid.models.c_forms import c_form_of
from emsid.models.regression.c_form import regressors_in_c

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


HEADER = """\
/* Made by emsid: recursive least squares for the parameters of NAME. */
#ifndef UPPER_RLS_H
#define UPPER_RLS_H

#include "NAME.h"

#ifdef __cplusplus
extern "C" {
#endif

#define UPPER_PARAMETERS COUNT

typedef struct {
    NAME_real past_y[LENGTH];
    NAME_real past_u[INPUTS * LENGTH];
    NAME_real rows[COUNT * (COUNT + 1)]; /* the triangle of the information, and beside it z */
    int samples; /* up to the longest lag */
} NAME_rls_state;

/* The parameters of the model, worth as many samples with regressors of size one as weight says. */
void NAME_rls_init(NAME_rls_state *state, NAME_real weight);

/* One sample of inputs and of the measured output; forgetting is 1, or a little less for parameters that change. */
void NAME_rls_update(NAME_rls_state *state, const NAME_real u[], NAME_real y, NAME_real forgetting);

/* The present parameters, in the order of the model. */
void NAME_rls_parameters(const NAME_rls_state *state, NAME_real theta[]);

#ifdef __cplusplus
}
#endif

#endif
"""

SOURCE = """\
/* Made by emsid. */
#include <math.h>

#include "NAME_rls.h"

typedef NAME_real real;

#define K(x) LITERAL
#define SQRT SQUARE_ROOT
MACROS#define P COUNT
#define WIDTH (COUNT + 1)
#define MEMORY LAGS

HELPERS
SHIFT
static const real theta_model[P] = {THETA};

void NAME_rls_init(NAME_rls_state *state, real weight)
{
    static const NAME_rls_state empty;
    const real root = SQRT(weight);
    int k;
    *state = empty;
    for (k = 0; k < P; ++k) {
        state->rows[k * WIDTH + k] = root;
        state->rows[k * WIDTH + P] = root * theta_model[k];
    }
}

static void rotate(real *rows, real *row)
{
    int k;
    int j;
    for (k = 0; k < P; ++k) {
        real *kept = rows + k * WIDTH;
        const real size = SQRT(kept[k] * kept[k] + row[k] * row[k]);
        real cosine;
        real sine;
        if (!(size > K(0.0))) {
            continue;
        }
        cosine = kept[k] / size;
        sine = row[k] / size;
        for (j = k; j < WIDTH; ++j) {
            const real before = kept[j];
            kept[j] = cosine * before + sine * row[j];
            row[j] = cosine * row[j] - sine * before;
        }
    }
}

void NAME_rls_update(NAME_rls_state *s, const real u[], real y, real forgetting)
{
    const real root = SQRT(forgetting);
    real row[WIDTH];
    int k;
    shift(s->past_y, MEMORY + 1);
    for (k = 0; k < INPUTS; ++k) {
        shift(s->past_u + k * (MEMORY + 1), MEMORY + 1);
        s->past_u[(k + 1) * (MEMORY + 1) - 1] = u[k];
    }
    if (s->samples >= MEMORY) {
REGRESSORS
        row[P] = y;
        for (k = 0; k < P * WIDTH; ++k) {
            s->rows[k] *= root;
        }
        rotate(s->rows, row);
    } else {
        s->samples += 1;
    }
    s->past_y[MEMORY] = y;
}

void NAME_rls_parameters(const NAME_rls_state *s, real theta[])
{
    int k;
    int j;
    for (k = P - 1; k >= 0; --k) {
        real rest = s->rows[k * WIDTH + P];
        for (j = k + 1; j < P; ++j) {
            rest -= s->rows[k * WIDTH + j] * theta[j];
        }
        theta[k] = s->rows[k * WIDTH + k] > K(0.0) ? rest / s->rows[k * WIDTH + k] : K(0.0);
    }
}
"""


def recursive(export: Export, *, single: bool, macros: Any, helpers: Any) -> Files:
    """The header and the source of recursive least squares for the structure of a regression.

    Args:
        export: the model.
        single: whether in single precision.
        macros, helpers: of a text, the macros and the functions that it uses.

    Raises:
        ModelError: for a model that is no regression.
    """
    structure: Any = getattr(export.model, "structure", None)
    if not hasattr(structure, "regressors"):
        raise ModelError(f"{export.model.name} is no regression, which recursive least squares needs; leave it out")
    rows = [f"        row[{k}] = {text};" for k, text in enumerate(regressors_in_c(structure))]
    text, memory = "\n".join(rows), structure.memory
    theta = ", ".join(map(number, getattr(export.model, "parameters").tolist()))  # noqa: B009
    words = {
        "HELPERS\n": f"{helpers(text)}\n" if helpers(text) else "",
        "MACROS": macros(text),
        "REGRESSORS": text,
        "LITERAL": "x##f" if single else "x",
        "SQUARE_ROOT": "sqrtf" if single else "sqrt",
        "THETA": theta,
        "SHIFT\n": f"{SHIFT}\n",
        "LENGTH": str(memory + 1),
        "LAGS": str(memory),
        "COUNT": str(len(rows)),
        "INPUTS": str(structure.inputs),
        "UPPER": export.name.upper(),
        "NAME": export.name,
    }
    made = {}
    for name, whole in ((f"{export.name}_rls.h", HEADER), (f"{export.name}_rls.c", SOURCE)):
        for word, meant in words.items():
            whole = whole.replace(word, meant)
        made[name] = whole
    return {**made}
