"""A plant in C: its kernel for one sample, written from its source with the numbers of the plant."""

from __future__ import annotations

import numpy as np

from emsid.errors import ModelError
from emsid.models.c_form import CForm
from emsid.models.c_source import View, Writer
from emsid.models.plants.stepping import PlantStepper

ROUNDING = {
    "_SLACK": 1e-5,
    "_FINEST": 1e-5,
    "_ROUNDING": 1e-7,
    "_BEYOND": 1.0 + 1e-5,
    "_SETTLED": 1e-5,
    "_SHORTEST": 1e-5,
}
"""The bounds of rounding errors in single precision, by the names that kernels have for those in double precision."""


def c_form(stepper: PlantStepper, *, single: bool = False) -> CForm:
    """The form in C of a plant, from where its stepper is.

    Raises:
        ModelError: for equations of a user or a friction law that is not compiled.
    """
    written = getattr(stepper.sampler, "written", None)
    name = stepper.model.name
    if written is None:
        raise ModelError(
            f"{name} has equations of a user, which have no form in C; identify another plant, or a regression or "
            "feedback model"
        )
    kernel, known, work, state = written(single)
    writer, outputs = Writer(ROUNDING if single else None), len(stepper.model.signals)  # type: ignore[attr-defined]
    arrays = [View(f"s->{each}", values.shape) for each, values in state]
    ends = [View("u", (stepper.inputs,), constant=True), View("y", (outputs,))]
    try:
        call = writer.call(kernel, *known, *arrays, *[View("work", work)] * bool(work), *ends)
    except ModelError as problem:
        raise ModelError(f"{name}: {problem}; export another model") from None
    step = f"    {call};\n"
    if work:
        step = f"    real work[{int(np.prod(work))}];\n{step}"
    kept = tuple((each, values.ravel().astype(float)) for each, values in state)
    varies = "The time that a sample takes varies: steps end where a body stops, breaks away or touches."
    notes = () if work else (varies,)
    return CForm(stepper.inputs, outputs, kept, step, tuple(writer.tables.items()), writer.functions, notes)
