"""Kernels written as C: the same numbers, without what is known, and refusals with their reason."""

import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.exports.c99 import helpers_of, macros_of, table
from emsid.models.c_source import INT, REAL, Text, View, Writer
from test_export_c import FLAGS

kernel = njit(nogil=True, error_model="numpy")
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
LIMIT = 1e-3


class Known(NamedTuple):
    gains: Any
    curved: bool
    order: int


@kernel
def both(a: float, b: float) -> tuple[float, int]:
    """A sum, and which is larger."""
    if a > b:
        return a + b, 1
    return a + b, -1 if a < b else 0


@kernel
def total(values: np.ndarray, scale: float) -> float:
    found = 0.0
    for k in range(len(values) - 1, -1, -1):
        found = found * scale + values[k]
    return found


@kernel
def sample(m: Known, state: np.ndarray, u: np.ndarray, y: np.ndarray) -> None:
    """Swaps, tuples, parts of arrays, loops that end early, and numbers that change their kind."""
    rows = np.zeros((2, m.order))
    first, second = rows[0], rows[1]
    for k in range(m.order):
        first[k], second[k] = u[0] / (k + 1), m.gains[k % 2] * k
    first[0], second[0] = second[0] + 1.0, first[0]
    known = other = (0.5, 2.0)
    sum_, larger = both(first[1], second[1])
    known, other = (sum_,) + (float(larger),), known  # noqa: RUF005
    rest, count = 1, 0
    while True:
        rest = rest * 0.5
        count += 1
        if rest < LIMIT or count == 7:
            break
    if m.curved:
        rest += np.expm1(u[0]) ** 2
    part = first[count - 6 : m.order]
    inside = 0.0 < abs(u[0]) < 1.5 and not larger > 5
    moved = second.copy()
    moved[:] = 1.0 if inside else min(u[0], 0.3, known[0])
    y[0] = total(part, 0.5) + rest + moved[-1]
    y[1] = known[1] + other[1] + np.sqrt(max(state[0], 0.0)) + count % 3
    state[0] += y[0]


def written(m: Known) -> tuple[str, Writer]:
    writer = Writer()
    call = writer.call(sample, m, View("state", (1,)), View("u", (1,), constant=True), View("y", (2,)))
    return call, writer


def in_c(m: Known, u: np.ndarray, folder: Path) -> np.ndarray:
    call, writer = written(m)
    tables = "".join(table(name, values) for name, values in writer.tables.items())
    text = writer.functions
    (folder / "main.c").write_text(
        "#include <math.h>\n#include <stdio.h>\ntypedef double real;\n#define K(x) x\n#define K_INFINITY INFINITY\n"
        f"{macros_of(text, single=False)}{helpers_of(text)}{tables}{text}"
        "int main(void)\n{\n    real state[1] = {0.0};\n    real u[1];\n    real y[2];\n"
        f'    while (scanf("%lf", u) == 1) {{\n        {call};\n        printf("%.17g %.17g\\n", y[0], y[1]);\n    }}\n'
        "    return 0;\n}\n"
    )
    subprocess.run(["gcc", *FLAGS, "-o", folder / "program", folder / "main.c", "-lm"], check=True)
    lines = "\n".join(map(repr, u.tolist()))
    done = subprocess.run([folder / "program"], input=lines, capture_output=True, text=True, check=True)
    return np.array([[float(value) for value in line.split()] for line in done.stdout.splitlines()])


@needs_gcc
@pytest.mark.parametrize("curved", [False, True])
def test_c_gives_the_numbers_of_a_kernel(curved: bool, tmp_path: Path) -> None:
    m, u = Known(np.array([0.7, -0.2]), curved, 4), np.random.default_rng(0).uniform(-2, 2, 50)
    state, truth = np.zeros(1), np.empty((50, 2))
    for k in range(50):
        sample.py_func(m, state, u[k : k + 1], truth[k])  # type: ignore[attr-defined]
    np.testing.assert_allclose(in_c(m, u, tmp_path), truth, rtol=1e-15, atol=1e-15)


def test_what_is_known_is_no_part_of_the_functions() -> None:
    texts = [written(Known(np.array([0.7, -0.2]), curved, 4))[1].functions for curved in (False, True)]
    assert "EXPM1" not in texts[0]
    assert "EXPM1" in texts[1]
    call, writer = written(Known(np.array([0.7, -0.2]), False, 4))
    assert call == "sample(state, u, y)"
    assert [values.tolist() for values in writer.tables.values()] == [[0.7, -0.2]]  # the index is not known
    assert writer.functions.count("static ") == 3
    assert "Swaps, tuples" in writer.functions


def test_constants_of_modules_may_have_other_values() -> None:
    writer = Writer({"LIMIT": 0.25})
    writer.call(sample, Known(np.ones(2), False, 4), View("state", (1,)), View("u", (1,)), View("y", (2,)))
    assert "K(0.25)" in writer.functions


@kernel
def with_list(x: float) -> float:
    return [x, x][0]


@kernel
def unknown_length(n: int) -> float:
    return float(np.zeros(n)[0])


def plain(x: float) -> float:
    return x


@pytest.mark.parametrize(
    ("function", "given", "words"),
    [
        (with_list, Text(REAL, "x"), r"line 3 of with_list has '\[x, x\]'"),
        (unknown_length, Text(INT, "n"), "makes an array whose length is not known"),
        (plain, Text(REAL, "x"), "plain is not compiled"),
    ],
)
def test_what_has_no_form_is_refused_with_its_place(function: Any, given: Any, words: str) -> None:
    with pytest.raises(ModelError, match=f"{words}.*no form in C"):
        Writer().call(function, given)
