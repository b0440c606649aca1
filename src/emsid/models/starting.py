"""`start`: any model as an object that runs sample by sample; see `Stepper`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from emsid.models.kinds import capabilities_of
from emsid.models.stepping import Stepper
from emsid.models.verbs import as_model, for_model
from emsid.record import Record


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
    record = record and for_model(model, record)
    subject = as_model(model, record)
    kind = capabilities_of(subject)
    if record is None:
        state = subject.at_rest(level, dt)
        inputs = max(np.size(level), kind.inputs(subject))
    else:
        subject.check_record(record)
        last = record.segments[-1]
        state, inputs = subject.initial(last, len(last)), record.input.shape[1]
    return kind.stepper(subject, state, inputs)
