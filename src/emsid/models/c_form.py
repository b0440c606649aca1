"""The form of a model in C: its state, its constants, and the statements of one step.

A `CForm` is text for any compiler of C99 with ``math.h``. Numbers are written by `number`, functions of ``math.h`` by
the macros of `emsid.exports.c99` (``EXP``, ``TANH`` …), so that the same text serves for ``double`` and ``float``.
The statements see the state as ``s``, the inputs as ``u`` and the outputs as ``y``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CForm:
    """A model in C.

    Attributes:
        inputs, outputs: how many.
        state: name and initial values (n,) of every array of the state.
        constants: name and values (n,) of every table; integers stay integers.
        functions: definitions that the step uses.
        step: statements of one step.
        notes: what the form does not carry, in sentences.
        parameters: name and value of those that can be set, in order.
        setting: statements that put values ``p`` of them into the state.
    """

    inputs: int
    outputs: int
    state: tuple[tuple[str, Array], ...]
    step: str
    constants: tuple[tuple[str, NDArray[Any]], ...] = ()
    functions: str = ""
    notes: tuple[str, ...] = ()
    parameters: tuple[tuple[str, float], ...] = ()
    setting: str = ""


def number(value: float) -> str:
    """A number as C: with all its digits, and the macro that gives it its type.

    >>> number(0.1), number(-2.0), number(float("inf"))
    ('K(0.1)', '(-K(2.0))', 'K_INFINITY')
    """
    value = float(value)
    if isnan(value):
        return "K_NAN"
    if abs(value) == inf:
        return "K_INFINITY" if value > 0 else "(-K_INFINITY)"
    text = f"K({abs(value)!r})"
    return f"(-{text})" if value < 0 or (value == 0 and np.signbit(value)) else text


def total(terms: Sequence[str]) -> str:
    """A sum; zero without a term."""
    return " + ".join(terms) if terms else "K(0.0)"


SHIFT = """\
static void shift(real *values, int count)
{
    int i;
    for (i = 0; i + 1 < count; ++i) {
        values[i] = values[i + 1];
    }
}
"""
"""Moves values by one sample."""

MAPS = """\
static real map_value(int k, real z)
{
    int low = map_first[k];
    int high = map_first[k + 1] - 1;
    int power;
    real h;
    real value;
    while (low < high) {
        const int middle = (low + high + 1) / 2;
        if (map_edges[middle] <= z) {
            low = middle;
        } else {
            high = middle - 1;
        }
    }
    h = z - map_origins[low];
    value = map_coefficients[low * MAP_TERMS + MAP_TERMS - 1];
    for (power = MAP_TERMS - 2; power >= 0; power -= 1) {
        value = value * h + map_coefficients[low * MAP_TERMS + power];
    }
    if (map_jumps[k] != K(0.0)) {
        value += map_jumps[k] * (map_widths[k] > K(0.0) ? TANH(z / map_widths[k]) : sign_of(z));
    }
    return value;
}
"""
"""The static map k at z, from tables of polynomials between break points."""


def map_tables(tables: Any) -> tuple[tuple[tuple[str, NDArray[Any]], ...], str]:
    """The constants of static maps and the function that reads them."""
    constants = (
        ("map_first", tables.first),
        ("map_edges", tables.edges),
        ("map_origins", tables.origins),
        ("map_coefficients", tables.coefficients.ravel()),
        ("map_jumps", tables.signs[:, 0].copy()),
        ("map_widths", tables.signs[:, 1].copy()),
    )
    return constants, f"#define MAP_TERMS {tables.coefficients.shape[1]}\n\n{MAPS}"


def entering(taps: Array) -> str:
    """Statements that put the input of a sample behind the past ones, and write the input at its steps."""
    rate, width = taps.shape
    return f"""\
    shift(s->past, PAST);
    s->past[PAST - 1] = u[0];
    for (k = 0; k < {rate}; ++k) {{
        steps[k] = K(0.0);
        for (i = 0; i < {width}; ++i) {{
            steps[k] += taps[k * {width} + i] * s->past[i];
        }}
    }}
"""
