r"""A regression in whole numbers: ``NAME.h`` and ``NAME.c`` without floating point.

A signal x is the word q = x/s·2^F, with F = 31 or 15 and a power of two s that is at least twice the largest size of
the signal. A regressor is a product of such words, shifted by F after every factor. With s_i of its factors and s_y
of the output, its coefficient is c = θ·∏s_i/s_y. All coefficients have one common exponent e and are words c·2^{F−e}.
The sum is kept in twice as many bits, with G bits below the last one of a word, and is rounded once. `run` computes
the same whole numbers in Python, so the error on a record is that of the C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, log2, prod
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.models.c_form import SHIFT
from emsid.models.regression.regressors import Factor, Regressor
from emsid.models.regression.transforms import Transform
from emsid.models.starting import start
from emsid.record import Record

Words = NDArray[np.int64]

HEADROOM = 2.0
"""The full scale of a signal over its largest size: a free run and a difference of two values exceed that."""
LARGEST = 1e300
"""The largest size of a signal, so that its scale is a number of double precision."""
IN_C = {
    Transform.VALUE: "{x}",
    Transform.ABOVE: "above((wide){x} - {p})",
    Transform.BELOW: "-above({p} - (wide){x})",
    Transform.ABS: "size({x})",
}
"""The transforms in C; a sign is no factor, it only turns the product."""

HEADER = """\
/* Made by emsid. Sample time ${dt} s. No floating point. */
#ifndef ${upper}_H
#define ${upper}_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef int${bits}_t ${name}_word;

#define ${upper}_INPUTS ${inputs}
/* A value in its unit is its word times this. */
#define ${upper}_OF_OUTPUT ${output_step}
static const double ${name}_of_input[${upper}_INPUTS] = {${input_steps}};

typedef struct {
    ${name}_word past_y[${length}];
    ${name}_word past_u[${inputs} * ${length}];
} ${name}_state;

/* The steady state for an input of zero. */
void ${name}_init(${name}_state *state);

/* One sample: the output for its inputs, and the state after it. */
void ${name}_step(${name}_state *state, const ${name}_word u[], ${name}_word y[]);

#ifdef __cplusplus
}
#endif

#endif
"""

SOURCE = """\
/* Made by emsid. */
#include "${name}.h"

typedef ${name}_word word;
typedef int${wide}_t wide;

#define FRACTION ${fraction}
#define ONE ((wide)1 << FRACTION)

static wide shifted(wide value, int by)
{
    const wide half = ((wide)1 << by) / 2;
    return value < 0 ? -((half - value) >> by) : (value + half) >> by;
}

static wide product(wide a, wide b)
{
    return shifted(a * b, FRACTION);
}

static word clipped(wide value)
{
    return (word)(value > ONE - 1 ? ONE - 1 : value < -ONE ? -ONE : value);
}

${helpers}${shift}
void ${name}_init(${name}_state *state)
{
    static const ${name}_state initial = {{${past_y}}, {${past_u}}};
    *state = initial;
}

void ${name}_step(${name}_state *s, const word u[], word y[])
{
    wide sum = 0;
    int k;
    shift(s->past_y, ${length});
    for (k = 0; k < ${inputs}; ++k) {
        shift(s->past_u + k * ${length}, ${length});
        s->past_u[(k + 1) * ${length} - 1] = u[k];
    }
${terms}
    y[0] = s->past_y[${length} - 1] = clipped(shifted(sum, ${rest}));
}
"""
HELPERS = {
    "above": "static wide above(wide value)\n{\n    return value > 0 ? clipped(value) : 0;\n}\n\n",
    "size": "static wide size(wide value)\n{\n    return clipped(value < 0 ? -value : value);\n}\n\n",
    "turned": "static wide turned(wide value, word by)\n{\n    return by > 0 ? value : by < 0 ? -value : 0;\n}\n\n",
}
"""Functions that are written where they are used."""


@dataclass(frozen=True, eq=False)
class FixedPoint:
    """A regression in whole numbers.

    Attributes:
        model: the regression.
        fraction: F, the bits of a word without its sign.
        scales: (1 + inputs,) s of the output and of every input.
    """

    model: Any
    fraction: int
    scales: tuple[float, ...]

    def __post_init__(self) -> None:
        for regressor in self.regressors:
            for factor in regressor.factors:
                if factor.transform not in IN_C and factor.transform is not Transform.SIGN:
                    raise ModelError(f"{factor.transform.text} has no form in whole numbers; use c99")
        fits = np.isfinite(self._coefficients).all() and -self.fraction < self.exponent <= self.guard
        if not fits or len(self.regressors) > self.terms:
            raise ModelError(
                f"the coefficients of {self.model.name} do not fit into words of {self.fraction + 1} bits; take "
                "bits=32, or c99"
            )

    @property
    def regressors(self) -> Sequence[Regressor]:
        """Of the model."""
        found: Sequence[Regressor] = self.model.structure.regressors
        return found

    @property
    def memory(self) -> int:
        """The largest lag."""
        return int(self.model.structure.memory)

    @property
    def guard(self) -> int:
        """G, the bits of the sum below the last one of a word."""
        return (self.fraction + 1) // 2

    @property
    def terms(self) -> int:
        """How many may be added."""
        return 1 << (self.fraction - self.guard)

    @property
    def _coefficients(self) -> list[float]:
        found = []
        for regressor, theta in zip(self.regressors, self.model.parameters.tolist(), strict=True):
            scales = [
                self.scales[factor.channel]
                for factor in regressor.factors
                if factor.transform is not Transform.SIGN
                for _ in range(factor.power)
            ]
            found.append((-theta if regressor.negative else theta) * prod(scales, start=1.0 / self.scales[0]))
        return found

    @property
    def exponent(self) -> int:
        """e, common to all coefficients."""
        largest = max(map(abs, self._coefficients), default=0.0)
        return int(np.floor(log2(largest))) + 1 if largest > 0 else 0

    @property
    def coefficients(self) -> list[int]:
        """Of every regressor, as words."""
        scaled = [each * 2.0 ** (self.fraction - self.exponent) for each in self._coefficients]
        return [min(round(each), (1 << self.fraction) - 1) for each in scaled]

    @property
    def initial(self) -> tuple[list[int], list[list[int]]]:
        """The words of past outputs, and of past inputs each, the newest last."""
        state = np.asarray(start(self.model).state, dtype=float)
        past_y, *past_u = (self.words(column, k).tolist() for k, column in enumerate(state.T))
        return [0, *past_y], [[0, *column] for column in past_u]

    def words(self, values: NDArray[np.float64], channel: int) -> Words:
        """A signal in whole numbers; 0 is the output, k the k-th input."""
        one = float(1 << self.fraction)
        return np.asarray(np.clip(np.rint(values / self.scales[channel] * one), -one, one - 1), dtype=np.int64)

    def run(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) the output for inputs (N, nu), as the C computes it."""
        one = 1 << self.fraction
        inputs = np.column_stack([self.words(u[:, k], k + 1) for k in range(u.shape[1])]).tolist()
        past_y, past_u = self.initial
        weights, rest = self.coefficients, self.guard - self.exponent
        found = []
        for now in inputs:
            past_y = [*past_y[1:], 0]
            past_u = [[*past[1:], value] for past, value in zip(past_u, now, strict=True)]
            total = 0
            for regressor, weight in zip(self.regressors, weights, strict=True):
                total += _shifted(self._product(regressor, past_y, past_u) * weight, self.fraction - self.guard)
            past_y[-1] = _clipped(_shifted(total, rest), one)
            found.append(past_y[-1])
        return np.array(found) * (self.scales[0] / one)

    def _product(self, regressor: Regressor, past_y: list[int], past_u: list[list[int]]) -> int:
        one = 1 << self.fraction
        value = one
        for factor in regressor.factors:
            past = past_y if factor.channel == 0 else past_u[factor.channel - 1]
            x, p = past[self.memory - factor.lag], self._edge(factor)
            for _ in range(factor.power):
                if factor.transform is Transform.SIGN:
                    value *= (x > 0) - (x < 0)
                    continue
                by = {
                    Transform.VALUE: x,
                    Transform.ABS: _clipped(abs(x), one),
                    Transform.ABOVE: _clipped(max(x - p, 0), one),
                    Transform.BELOW: -_clipped(max(p - x, 0), one),
                }[factor.transform]
                value = _shifted(value * by, self.fraction)
        return value

    def _edge(self, factor: Factor) -> int:
        return int(self.words(np.array([factor.parameter]), factor.channel)[0])

    def source(self) -> tuple[str, str]:
        """The statements of the sum, and the helpers that they use."""
        lines = []
        for regressor, weight in zip(self.regressors, self.coefficients, strict=True):
            text = "ONE"
            for factor in regressor.factors:
                for _ in range(factor.power):
                    text = self._times(text, factor)
            lines.append(f"    sum += shifted({text} * ({weight}), {self.fraction - self.guard});")
        whole = "\n".join(lines)
        return whole, "".join(code for name, code in HELPERS.items() if f"{name}(" in whole)

    def _times(self, text: str, factor: Factor) -> str:
        at, length = self.memory - factor.lag, self.memory + 1
        x = f"s->past_y[{at}]" if factor.channel == 0 else f"s->past_u[{(factor.channel - 1) * length + at}]"
        if factor.transform is Transform.SIGN:
            return f"turned({text}, {x})"
        return f"product({text}, {IN_C[factor.transform].format(x=x, p=f'({self._edge(factor)})')})"


def _shifted(value: int, by: int) -> int:
    half = (1 << by) // 2
    return -((half - value) >> by) if value < 0 else (value + half) >> by


def _clipped(value: int, one: int) -> int:
    return max(min(value, one - 1), -one)


def fixed_point(export: Export) -> tuple[Files, list[str]]:
    """The header and the source.

    Raises:
        ModelError: for a model that is no regression, or one whose transforms or coefficients have no form in whole
            numbers; without the sizes of the signals.
    """
    if not hasattr(getattr(export.model, "structure", None), "regressors"):
        raise ModelError(f"{export.model.name} is no regression; only these have a form in whole numbers")
    bits = str(export.options.get("bits", "32"))
    if bits not in ("16", "32"):
        raise ModelError(f"words of {bits} bits; give 16 or 32", arguments=("option",))
    if not export.model.structure.inputs:  # type: ignore[attr-defined]
        raise ModelError(f"{export.model.name} has no input, so it has no form in whole numbers; export it as c99")
    sizes = _sizes(export)
    made = FixedPoint(export.model, int(bits) - 1, tuple(2.0 ** ceil(log2(HEADROOM * size)) for size in sizes))
    steps = [repr(scale / (1 << made.fraction)) for scale in made.scales]
    terms, helpers = made.source()
    past_y, past_u = made.initial
    words = {
        "name": export.name,
        "upper": export.name.upper(),
        "dt": repr(export.dt),
        "bits": bits,
        "wide": 2 * int(bits),
        "fraction": made.fraction,
        "length": made.memory + 1,
        "inputs": len(sizes) - 1,
        "output_step": steps[0],
        "input_steps": ", ".join(steps[1:]),
        "past_y": ", ".join(map(str, past_y)),
        "past_u": ", ".join(str(value) for past in past_u for value in past),
        "helpers": helpers,
        "shift": SHIFT.replace("real", "word"),
        "terms": terms,
        "rest": made.guard - made.exponent,
    }
    files: Files = {
        f"{export.name}.{ending}": Template(text).substitute(words) for ending, text in (("h", HEADER), ("c", SOURCE))
    }
    return files, _notes(made, export.record)


def _sizes(export: Export) -> list[float]:
    """The largest size of the output and of every input.

    Raises:
        ModelError: without them, or for other numbers than positive ones.
    """
    count = 1 + int(export.model.structure.inputs)  # type: ignore[attr-defined]
    given = export.options.get("largest")
    if given is None and export.record is not None:
        signals = np.hstack([export.record.output[:, :1], export.record.input])
        return [max(float(each), np.finfo(float).tiny) for each in np.max(np.abs(signals), axis=0)]
    try:
        found = [float(each) for each in str(given).split(",")]
    except ValueError:
        found = []
    if len(found) != count or not all(0 < each <= LARGEST for each in found):
        raise ModelError(
            f"words need the largest size of the output and of each input: {count} positive numbers up to "
            f"{LARGEST:g}, largest=300,12",
            arguments=("option",),
        )
    return found


def _notes(made: FixedPoint, record: Record | None) -> list[str]:
    limits = ", ".join(f"{scale:g}" for scale in made.scales)
    found = [f"Words stand for values up to {limits} (the output, then the inputs); beyond, they are clipped."]
    if record is not None:
        here = made.model.run(start(made.model).state, record.input)[0][:, 0]
        error = made.run(record.input) - here
        found.append(
            f"On {record.name}, the output differs from double precision by at most {np.max(np.abs(error)):.3g} "
            f"(root mean square {np.sqrt(np.mean(error**2)):.3g}); its own deviation is {np.std(here):.3g}."
        )
    return found
