"""A plant in C: its kernel for one sample, written from its source with the numbers of the plant.

Where parameters can be set, the numbers that are computed from them stand in the state, and a function computes them
anew: the plant is built from `Traced` values, so that this function is written from the code that builds it. A
parameter is left out where changed values give other numbers, or another state at rest, than that function.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np

from emsid.errors import ModelError
from emsid.models.c_form import CForm
from emsid.models.c_source import View, Writer, bare
from emsid.models.plants.grey_box import GreyBox
from emsid.models.plants.parameters import Path, read_at
from emsid.models.plants.state import NO_LOAD, PlantState
from emsid.models.plants.stepping import PlantStepper
from emsid.models.traced import Traced, at, put, text_of

ROUNDING = {
    "_SLACK": 1e-5,
    "_FINEST": 1e-5,
    "_ROUNDING": 1e-7,
    "_BEYOND": 1.0 + 1e-5,
    "_SETTLED": 1e-5,
    "_SHORTEST": 1e-5,
}
"""The bounds of rounding errors in single precision, by the names that kernels have for those in double precision."""
TRIED = (0.75, 1.5)
"""Multiples of a parameter at which the numbers that are computed in C are compared with those of the plant."""


def c_form(stepper: PlantStepper, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
    """The form in C of a plant, from where its stepper is.

    Args:
        stepper: of a plant at rest.
        single: whether it is computed in single precision.
        parameters: those that can be set, as far as the plant allows it.

    Raises:
        ModelError: for equations of a user or a friction law that is not compiled.
    """
    model: Any = stepper.model
    if getattr(stepper.sampler, "written", None) is None:
        raise ModelError(
            f"{model.name} has equations of a user, which have no form in C; identify another plant, or a regression "
            "or feedback model"
        )
    dt = stepper.state.dt
    names = _settable(model, dt, parameters, single) if parameters else ()
    values = tuple((name, float(model.plant.value(name))) for name in names)
    kernel, known, varies, state = _written(_traced(model, values), stepper.state, single)
    writer, outputs = Writer(ROUNDING if single else None, traces=bool(names)), len(model.signals)
    arrays = [View(f"s->{each}", kept.shape) for each, kept in state]
    ends = [View("u", (1, stepper.inputs), constant=True), View("y", (1, outputs))]
    try:
        call = writer.call(kernel, *known, *arrays, NO_LOAD, *ends)
    except ModelError as problem:
        raise ModelError(f"{model.name}: {problem}; export another model") from None
    step = f"    {call};\n"
    kept = tuple((each, values.ravel().astype(float)) for each, values in state)
    setting = ""
    if writer.traced:
        step = f"    const real *numbers = s->numbers;\n{step}"
        kept += (("numbers", np.array(writer.traced, dtype=float)),)
        setting = "".join(f"    s->numbers[{k}] = {bare(text_of(each))};\n" for k, each in enumerate(writer.traced))
    notes = ("The time that a sample takes varies: steps end where a body stops, breaks away or touches.",) * varies
    tables = tuple(writer.tables.items())
    return CForm(stepper.inputs, outputs, kept, step, tables, writer.functions, notes, values, setting)


def _written(model: GreyBox, state: PlantState, single: bool) -> Any:
    """The kernel of a plant in a state, with what it takes; see `DrivenSampler.written`."""
    sampler: Any = model.plant.sampler(state, model.signals)
    return sampler and sampler.written(single)


def _traced(model: GreyBox, values: Sequence[tuple[str, float]]) -> GreyBox:
    """The same model with `Traced` parameters."""
    plant: Any = model.plant
    for k, (name, value) in enumerate(values):
        for path, sign in plant.handles[name].paths:
            each = Traced.parameter(k, value)
            plant = put(plant, path, each if sign > 0 else -each)
    return replace(model, plant=plant)


def _settable(model: GreyBox, dt: float, parameters: Sequence[str], single: bool) -> tuple[str, ...]:
    """Those of the parameters with an effect from which the numbers of the kernel can be computed."""
    plant, left, taken = model.plant, list[str](), set[Path]()
    for name in sorted(set(parameters) & set(plant.handles), key=lambda name: -len(plant.handles[name].paths)):
        paths = [path for path, _ in plant.handles[name].paths]
        with suppress(ModelError, AttributeError, TypeError):  # of a part that the plant does not have
            alike = {sign * read_at(plant, path) for path, sign in plant.handles[name].paths}
            _traced(model, [(name, 1.0)])
            if len(alike) == 1 and 0 < abs(*alike) < inf and taken.isdisjoint(paths):
                taken.update(paths)
                left.append(name)
    left.sort(key=list(plant.handles).index)
    while left:
        values = [(name, float(plant.value(name))) for name in left]
        traced = _numbers(_written(_traced(model, values), model.at_rest(0.0, dt), single))
        tried: list[tuple[str, Mapping[str, float]]] = [
            (name, {name: factor * value}) for name, value in values for factor in TRIED
        ]
        together = {name: value for _, changed in tried for name, value in changed.items()}
        wrong = {name for name, changed in tried if not _holds(model, dt, single, dict(values), changed, traced)}
        if not wrong:
            return tuple(left) if _holds(model, dt, single, dict(values), together, traced) else ()
        left = [name for name in left if name not in wrong]
    return ()


def _holds(
    model: GreyBox,
    dt: float,
    single: bool,
    values: Mapping[str, float],
    changed: Mapping[str, float],
    traced: list[Any],
) -> bool:
    """Whether changed parameters have an effect that the expressions give, and the state at rest stays the same."""
    try:
        other = replace(model, plant=model.plant.with_values(changed))
        truth = at(_numbers(_written(other, other.at_rest(0.0, dt), single)), ())
    except ModelError:  # beyond a bound
        return False
    found = at(traced, [{**values, **changed}[name] for name in values])
    same = len(found) == len(truth) and np.allclose(found, truth, rtol=1e-12, atol=0.0, equal_nan=True)
    return same and not np.array_equal(found, at(traced, list(values.values())), equal_nan=True)


def _numbers(written: Any) -> list[Any]:
    """All numbers of a kernel and of its state; none where there is no kernel."""
    return [] if written is None else list(_leaves(written[1:]))


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, tuple):
        for each in value:
            yield from _leaves(each)
    elif isinstance(value, np.ndarray):
        yield from value.ravel().tolist()
    elif not isinstance(value, str):
        yield value
