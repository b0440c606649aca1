"""The form in C of any model, by the stepper that runs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike

from emsid.errors import ModelError
from emsid.models.blocks import c_form as of_blocks
from emsid.models.blocks.stepping import CascadeStepper
from emsid.models.c_form import CForm
from emsid.models.feedback import c_form as of_feedback
from emsid.models.feedback.stepping import FeedbackStepper
from emsid.models.linear import c_form as of_linear
from emsid.models.linear.stepping import LinearStepper
from emsid.models.plants import motor_c_form as of_plants
from emsid.models.plants.stepping import PlantStepper
from emsid.models.regression import c_form as of_regression
from emsid.models.regression.stepping import RegressionStepper
from emsid.models.starting import start
from emsid.models.stepping import Stepper

C_FORMS: dict[type[Stepper], Callable[[Any], CForm]] = {
    RegressionStepper: of_regression.c_form,
    LinearStepper: of_linear.c_form,
    CascadeStepper: of_blocks.c_form,
    FeedbackStepper: of_feedback.c_form,
    PlantStepper: of_plants.c_form,
}
"""The form in C of each kind of stepper."""


def c_form_of(model: Any, level: ArrayLike = 0.0, dt: float | None = None) -> CForm:
    """The form in C of a model in steady state.

    Args:
        model: a model or a fit.
        level: the constant input of the past, one number or (nu,).
        dt: sample time in s, for a model that has none of its own.

    Raises:
        ModelError: for a model that has no form in C, with the reason.
    """
    stepper = start(model, level, dt)
    if type(stepper) not in C_FORMS:
        raise ModelError(f"{stepper.model.name} has functions of a user in Python, which have no form in C")
    return C_FORMS[type(stepper)](stepper)
