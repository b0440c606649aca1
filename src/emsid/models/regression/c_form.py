"""A regression sample by sample: in Python, and in C with one statement for each regressor."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.models.c_form import SHIFT, CForm, number
from emsid.models.regression.kernels import Recursion, advance_one, recursion
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.regressors import Factor, Regressor
from emsid.models.regression.transforms import Transform
from emsid.models.stepping import Stepper

Array = NDArray[np.float64]


class RegressionStepper(Stepper):
    """A regression: its state is its last outputs and inputs.

    A measured output takes the place of the computed one, so that the next step is the prediction one sample ahead.
    """

    __slots__ = ("_begun", "_coefficient", "_past_u", "_past_y", "_recursion")

    def __init__(self, model: Narx, state: Array) -> None:
        """
        Args:
            model: what runs.
            state: (memory, 1 + nu) where it begins; see `Narx.at_rest`.
        """
        super().__init__(model, model.structure.inputs, 1)
        memory = model.structure.memory
        self._recursion = recursion(model.structure.regressors, model.parameters)
        self._past_y, self._past_u = np.zeros(memory + 1), np.zeros((model.structure.inputs, memory + 1))
        self._past_y[1:], self._past_u[:, 1:] = state[:, 0], state[:, 1:].T
        self._coefficient = np.empty((2 + len(self._recursion.lags) + len(self._recursion.outputs.signs), 1))
        self._begun = False

    def _advance(self) -> None:
        take(self._past_y, self._past_u, self._recursion, self._coefficient, self._u, self._y)
        self._begun = True

    @property
    def state(self) -> Array:
        """(memory, 1 + nu) the last outputs and inputs, the newest last."""
        return np.column_stack([self._past_y[1:], self._past_u[:, 1:].T])

    def correct(self, y: ArrayLike) -> None:
        """Take the measured output of the last sample; see `Stepper.correct`."""
        if not self._begun:
            raise ModelError(f"{self.model.name}: correct takes the output of the last step; call step first")
        self._past_y[-1] = np.asarray(y, dtype=float).item()


@njit(nogil=True)
def take(past_y: Array, past_u: Array, model: Recursion, coefficient: Array, u: Array, y: Array) -> None:
    """Move outputs (memory + 1,) and inputs (nu, memory + 1) by one sample, and write its output into y (1,)."""
    memory = len(past_y) - 1
    for i in range(memory):
        past_y[i] = past_y[i + 1]
        for k in range(len(u)):
            past_u[k, i] = past_u[k, i + 1]
    for k in range(len(u)):
        past_u[k, memory] = u[k]
    advance_one(past_y, past_u, model, coefficient, memory)
    y[0] = past_y[memory]


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
