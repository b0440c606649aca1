"""A regression in C: one statement for each regressor."""

from __future__ import annotations

import numpy as np

from emsid.errors import ModelError
from emsid.models.c_form import SHIFT, CForm, number
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.regressors import Factor, Regressor
from emsid.models.regression.stepping import RegressionStepper
from emsid.models.regression.transforms import Transform

IN_C = {
    Transform.VALUE: "{x}",
    Transform.SIGN: "sign_of({x})",
    Transform.TANH: "TANH({x} / {p})",
    Transform.ABOVE: "above({x} - {p})",
    Transform.BELOW: "(-above({p} - {x}))",
    Transform.ABS: "FABS({x})",
    Transform.DECAY: "EXP(-FABS({x}) / {p})",
}
"""The transforms in C."""


def c_form(stepper: RegressionStepper) -> CForm:
    """The form in C of a regression, from where its stepper is.

    Raises:
        ModelError: for a transform that has no form in C.
    """
    model = stepper.model
    assert isinstance(model, Narx)
    inputs, memory, state = model.structure.inputs, model.structure.memory, stepper.state
    lines = [f"    shift(s->past_y, {memory + 1});"]
    for k in range(inputs):
        lines += [f"    shift(s->past_u + {k * (memory + 1)}, {memory + 1});"]
        lines += [f"    s->past_u[{(k + 1) * (memory + 1) - 1}] = u[{k}];"]
    lines += ["    sum = K(0.0);"]
    for regressor, theta in zip(model.structure.regressors, model.parameters.tolist(), strict=True):
        lines.append(f"    sum += {_product(regressor, theta, memory)};")
    lines += [f"    s->past_y[{memory}] = sum;", "    y[0] = sum;"]
    past_u = np.zeros((inputs, memory + 1))
    past_u[:, 1:] = state[:, 1:].T
    return CForm(
        inputs,
        1,
        (("past_y", np.append(0.0, state[:, 0])), ("past_u", past_u.ravel())),
        "    real sum;\n" + "\n".join(lines) + "\n",
        functions=SHIFT,
    )


def regressors_in_c(structure: Structure) -> list[str]:
    """Every regressor as an expression of ``s->past_y`` and ``s->past_u``.

    Raises:
        ModelError: for a transform that has no form in C.
    """
    return [_product(regressor, 1.0, structure.memory) for regressor in structure.regressors]


def _product(regressor: Regressor, theta: float, memory: int) -> str:
    """A regressor times its parameter."""
    factors = [text for factor in regressor.factors for text in [_factor(factor, memory)] * factor.power]
    return " * ".join([number(-theta if regressor.negative else theta), *factors])


def _factor(factor: Factor, memory: int) -> str:
    if factor.transform not in IN_C:
        raise ModelError(f"the transform {factor.transform.text} has no form in C; add it to IN_C")
    at = memory - factor.lag
    x = f"s->past_y[{at}]" if factor.channel == 0 else f"s->past_u[{(factor.channel - 1) * (memory + 1) + at}]"
    return IN_C[factor.transform].format(x=x, p=number(factor.parameter))
