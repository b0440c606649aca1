"""The form in C of any model, by the stepper that runs it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from emsid.errors import ModelError
from emsid.models.c_form import CForm
from emsid.models.kinds import capabilities_of
from emsid.models.starting import start
from emsid.models.stepping import PlainStepper


def c_form_of(model: Any, dt: float | None = None, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
    """The form in C of a model at rest with an input of zero.

    Args:
        model: a model or a fit.
        dt: sample time in s, for a model that has none of its own.
        single: whether it is computed in single precision.
        parameters: of a plant, those that can be set, where its form in C allows it.

    Raises:
        ModelError: for a model that has no form in C, with the reason.
    """
    stepper = start(model, 0.0, dt)
    if isinstance(stepper, PlainStepper):
        raise ModelError(f"{stepper.model.name} has functions in Python or backlash, which have no form in C")
    return capabilities_of(stepper.model).c_form(stepper, single=single, parameters=parameters)
