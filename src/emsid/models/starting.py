"""`start`: any model as an object that runs sample by sample; see `Stepper`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.stepping import CascadeStepper
from emsid.models.feedback.model import FeedbackModel
from emsid.models.feedback.stepping import FeedbackStepper
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.process_model import ProcessModel
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.stepping import LinearStepper
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.stepping import PlantStepper
from emsid.models.regression.narx import Narx
from emsid.models.regression.stepping import RegressionStepper
from emsid.models.stepping import PlainStepper, Stepper
from emsid.models.verbs import as_model
from emsid.record import Record

STEPPERS: dict[type, Callable[[Any, Any, int], Stepper]] = {
    Narx: lambda model, state, _: RegressionStepper(model, state),
    StateSpaceModel: lambda model, state, _: LinearStepper(model, state),
    PolynomialModel: lambda model, state, _: LinearStepper(model, state),
    ProcessModel: lambda model, state, _: LinearStepper(model, state),
    Cascade: lambda model, state, _: CascadeStepper.of(model, state),
    FeedbackModel: lambda model, state, _: FeedbackStepper.of(model, state),
    GreyBox: PlantStepper.of,
}
"""How each kind of model runs sample by sample, from the model, its state and the number of inputs."""


def start(model: Any, level: ArrayLike = 0.0, dt: float | None = None, *, record: Record | None = None) -> Stepper:
    """A model that runs sample by sample: ``step(u)`` gives the next output in a few microseconds.

    >>> import emsid
    >>> arx = emsid.RegressionModel(emsid.Structure.parse("y(t-1)", "u(t-1)"), np.array([0.5, 2.0]), dt=0.1)
    >>> running = start(arx)
    >>> [running.step(u) for u in (1.0, 0.0, 0.0)], running.predict([1.0, 1.0])
    ([0.0, 2.0, 1.0], array([0.5 , 2.25]))

    Args:
        model: a model, a fit, or a plant.
        level: the constant input of the past, at which the model is in steady state: one number, or (nu,).
        dt: sample time in s, for a model that has none of its own.
        record: begin instead where this record ends, with its measured outputs.

    Returns:
        An object with ``step``, ``state``, ``predict`` for inputs that may follow, and ``correct`` for measured
        outputs, where the model has a model of its noise.

    Raises:
        ModelError: for something that is no model, another number of inputs, or a missing sample time.
        DataError: for a record that is too short or has no outputs.
    """
    subject = as_model(model, record)
    if record is None:
        state = subject.at_rest(level, dt)
        inputs = max(np.size(level), _inputs(subject))
    else:
        subject.check_record(record)
        last = record.segments[-1]
        state, inputs = subject.initial(last, len(last)), record.input.shape[1]
    kind = next((kind for kind in type(subject).__mro__ if kind in STEPPERS), None)
    return PlainStepper(subject, state, inputs) if kind is None else STEPPERS[kind](subject, state, inputs)


def _inputs(model: Any) -> int:
    """The number of inputs of a model that has one for each row of a matrix; one for others."""
    return model.structure.inputs if isinstance(model, Narx) else 1
