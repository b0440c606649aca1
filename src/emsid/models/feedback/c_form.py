"""A feedback model in C: its linear system as statements without zeros, its static maps as tables."""

from __future__ import annotations

from emsid.models.c_form import SHIFT, CForm, entering, map_tables, number, total
from emsid.models.feedback.stepping import FeedbackStepper


def c_form(stepper: FeedbackStepper) -> CForm:
    """The form in C of a feedback model, from where its stepper is."""
    (matrix, offsets, factors), taps, past, x = stepper.numbers
    n, m, rate = len(x), len(offsets) - 1, len(taps)

    def row(values: list[float], maps: int, constant: float = 0.0) -> str:
        names = [*(f"s->x[{j}]" for j in range(n)), "steps[k]", *(f"w[{j}]" for j in range(maps))]
        terms = [f"{number(value)} * {name}" for value, name in zip(values, names, strict=False) if value]
        return total([*terms, number(constant)] if constant else terms)

    lines = []
    for i in range(m):
        factor = row(factors[i, : n + 1].tolist(), 0, float(factors[i, n + 1]))
        lines.append(f"        z = {row(matrix[n + i, : n + 1].tolist(), 0, float(offsets[i]))};")
        lines.append(f"        w[{i}] = map_value({i}, z) * ({factor});")
    lines += [f"        after[{j}] = {row(matrix[j].tolist(), m)};" for j in range(n)]
    lines.append("        if (k == 0) {")
    lines.append(f"            y[0] = {row(matrix[n + m].tolist(), m, float(offsets[m]))};")
    lines.append("        }")
    lines += [f"        s->x[{j}] = after[{j}];" for j in range(n)]
    declared = f"    real steps[{rate}];\n    int i;\n    int k;\n"
    if n:
        declared = f"    real after[{n}];\n{declared}"
    if m:
        declared = f"    real w[{m}];\n    real z;\n{declared}"
    step = declared + entering(taps) + f"    for (k = 0; k < {rate}; ++k) {{\n" + "\n".join(lines) + "\n    }\n"
    tables, functions = map_tables(stepper.tables) if m else ((), "")
    define = f"#define PAST {len(past)}\n\n"
    state = (("past", past), ("x", x))
    return CForm(1, 1, state, step, (("taps", taps.ravel()), *tables), f"{define}{SHIFT}\n{functions}")
