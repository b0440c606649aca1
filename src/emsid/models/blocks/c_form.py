"""A cascade in C: filters as statements, static maps as tables of polynomials between break points."""

from __future__ import annotations

from emsid.models.blocks.stepping import CascadeStepper
from emsid.models.c_form import SHIFT, CForm, entering, map_tables, number


def c_form(stepper: CascadeStepper) -> CForm:
    """The form in C of a cascade, from where its stepper is."""
    maps, first, above, below = stepper.blocks
    lines = []
    for k, which in enumerate(maps.tolist()):
        if which >= 0:
            lines.append(f"        x = map_value({which}, x);")
            continue
        s, c, n = int(first[k]), int(first[k]) + k, int(first[k + 1] - first[k])
        lines.append(f"        out = {number(above[c])} * x" + (f" + s->blocks[{s}];" if n else ";"))
        for j in range(n):
            following = f"s->blocks[{s + j + 1}] + " if j + 1 < n else ""
            update = f"{following}{number(above[c + j + 1])} * x - {number(below[c + j + 1])} * out"
            lines.append(f"        s->blocks[{s + j}] = {update};")
        lines.append("        x = out;")
    taps, offsets, past, blocks = stepper.numbers
    rate = len(taps)
    out = "    real out;\n" if any(which < 0 for which in maps) else ""
    step = (
        f"    real steps[{rate}];\n    real x;\n{out}    int i;\n    int k;\n"
        + entering(taps)
        + f"    for (k = 0; k < {rate}; ++k) {{\n        x = steps[k] - {number(offsets[0])};\n"
        + "\n".join(lines)
        + f"\n        if (k == 0) {{\n            y[0] = x + {number(offsets[1])};\n        }}\n    }}\n"
    )
    tables, functions = map_tables(stepper.tables) if (maps >= 0).any() else ((), "")
    define = f"#define PAST {len(past)}\n\n"
    state = (("past", past), ("blocks", blocks))
    return CForm(1, 1, state, step, (("taps", taps.ravel()), *tables), f"{define}{SHIFT}\n{functions}")
