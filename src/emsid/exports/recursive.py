r"""Recursive least squares in C for the structure of a regression: ``NAME_rls.h`` and ``NAME_rls.c`` beside the model.

The state is the triangular factor of the information, as `emsid.estimation.linear.information` has it: R and z with

    [R z]  ←  the triangle of  [√λ·[R z]; φᵀ y]

by p Givens rotations for a sample, which never form the covariance, so that rounding cannot make it indefinite; this is
what single precision needs. The parameters are θ = R⁻¹z. They begin at those of the model, R = √w·I: the weight w says
how many samples with regressors of size one they are worth.
"""

from __future__ import annotations

from typing import Any

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.models.c_form import SHIFT, number
from emsid.models.regression.c_form import regressors_in_c

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
    """The two files.

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
