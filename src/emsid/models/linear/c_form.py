"""A linear model in C: its state-space form, without the zeros."""

from __future__ import annotations

from emsid.models.c_form import CForm, number, total
from emsid.models.linear.stepping import LinearStepper


def c_form(stepper: LinearStepper) -> CForm:
    """The form in C of a linear model, from where its stepper is; the free run, without the model of its noise."""
    form, state = stepper.form, stepper.state
    rows = [(f"y[{k}]", form.c[k], form.d[k], float(form.level[k])) for k in range(len(form.level))]
    after = [(f"after[{k}]", form.a[k], form.b[k], 0.0) for k in range(len(state))]
    lines = [f"    {name} = {_row(x, u, level)};" for name, x, u, level in (*rows, *after)]
    if len(state):
        lines.insert(0, f"    real after[{len(state)}];")
        lines += [f"    s->x[{k}] = after[{k}];" for k in range(len(state))]
    return CForm(form.b.shape[1], len(form.level), (("x", state),), "\n".join(lines) + "\n")


def _row(x: object, u: object, level: float) -> str:
    terms = [f"{number(value)} * s->x[{k}]" for k, value in enumerate(x) if value]  # type: ignore[arg-type, var-annotated]
    terms += [f"{number(value)} * u[{k}]" for k, value in enumerate(u) if value]  # type: ignore[arg-type, var-annotated]
    return total([*terms, number(level)] if level else terms)
