"""What holds for every kind of model and every capability: each gives a value of its type, or says that it has none."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from emsid import EmsidError, Fit, ModelError
from emsid.estimation.estimates import Estimate
from emsid.findings import Finding
from emsid.models.bands import Band, BandedCurve
from emsid.models.c_form import CForm
from emsid.models.capabilities import Capabilities, MapInUse, Modes
from emsid.models.characteristics import Characteristic
from emsid.models.kinds import KINDS, capabilities_of
from emsid.models.linear.system import LinearSystem
from emsid.models.model import Model
from emsid.models.refit_data import Budget, Data
from emsid.models.stepping import PlainStepper, Stepper
from emsid.report.views.sections import SECTIONS
from model_examples import ALL, DT, measured

every_model = pytest.mark.parametrize("model", ALL.values(), ids=ALL.keys())
FREQUENCIES = np.array([0.3, 2.0, 11.0])
CAPABILITIES = {name for name, value in vars(Capabilities).items() if callable(value) and not name.startswith("_")}


class Asked:
    """Asks for capabilities, and keeps which."""

    def __init__(self, model: Any) -> None:
        self.of, self.model, self.record = capabilities_of(model), model, measured(model)
        values = np.array(list(model.parameter_values().values()))
        covariance = np.diag((0.01 * values) ** 2)
        self.fit = Fit(
            model, tuple(model.parameter_values()), values, covariance, 1e-4, len(self.record), 1.0, len(values)
        )
        self.names: set[str] = set()

    def has(self, name: str, *arguments: Any) -> Any:
        """The value of a capability; None where the model says that it lacks it."""
        self.names.add(name)
        return self.given(partial(getattr(self.of, name), *arguments))

    def given(self, make: Callable[[], Any]) -> Any:
        """What is made; None where the model says that it lacks it."""
        try:
            return make()
        except EmsidError as problem:
            said = str(problem)
        assert self.model.name in said
        return None


@every_model
def test_every_capability_gives_its_type_or_says_that_the_model_lacks_it(
    model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("emsid.models.capabilities.LEVELS", 5)  # points of a curve, whose type is the same with few
    asked = Asked(model)
    record, fit = asked.record, asked.fit
    state = model.at_rest(0.0, DT)
    stepper = asked.has("stepper", model, state, asked.has("inputs", model))
    assert isinstance(stepper, Stepper)
    form = None if isinstance(stepper, PlainStepper) else asked.has("c_form", stepper)
    asked.names.add("c_form")
    assert isinstance(form, CForm | None)
    assert isinstance(asked.has("linear_part", model, 0.0), LinearSystem | None)
    left = asked.has("as_left", model, record)
    assert type(left) is type(model)
    assert left.parameter_values().keys() >= model.parameter_values().keys()
    response = asked.has("frequency_response", model, FREQUENCIES, DT, 0, 0, 0.0)
    assert response is None or response.shape == FREQUENCIES.shape
    assert isinstance(asked.has("modes", model), Modes)
    rest = asked.has("output_at_rest", model, 0.1) if model.dt is not None else None
    asked.names.add("output_at_rest")
    assert isinstance(rest, float | None)
    for which in ("maps_in_use", "judged_maps"):
        assert all(isinstance(each, MapInUse) for each in asked.has(which, model, record))
    for which in ("static_map", "friction"):
        assert isinstance(asked.has(which, fit, record), Band | None)
    for make in asked.has("curves", fit, record):
        assert all(isinstance(each, BandedCurve) for each in asked.given(make) or ())
    assert all(isinstance(each, Characteristic) for each in asked.has("characteristics", fit, record))
    assert all(isinstance(each, Estimate) for each in asked.has("physical_rows", fit))
    assert isinstance(asked.has("free_run_error", fit, record, None), np.ndarray | None)
    assert all(isinstance(each, Finding) for each in asked.has("advice", fit, record))
    assert all(isinstance(each, Finding) for each in asked.has("trusted_length", model, record))
    assert isinstance(asked.has("hides_the_sign", model), bool)
    assert asked.has("equation", fit, record)
    assert asked.has("section", fit) in SECTIONS
    specified = asked.has("specification", fit)
    assert specified is None or isinstance(specified[1], dict)
    asked.names.add("refitted")
    slow = model is ALL["feedback, user"]  # its map runs in Python
    again = None if slow else asked.has("refitted", fit, Data((record,)), Budget.FEW)
    assert again is None or type(again.model) is type(model)
    assert asked.names == CAPABILITIES


@every_model
def test_the_linear_part_has_the_frequency_response(model: Model) -> None:
    """Of kinds without maps inside, in whole samples; the response of a cascade is that of its filters alone."""
    asked = Asked(model)
    part = asked.has("linear_part", model, 0.1)
    response = asked.has("frequency_response", model, FREQUENCIES, DT, 0, 0, 0.1)
    if part is None or response is None or hasattr(model, "blocks") or getattr(model, "oversampling", 1) > 1:
        return
    if not asked.of.physical and not np.isclose(part.delay / DT, round(part.delay / DT)):
        return
    if part.dt is None and not asked.of.physical:  # the samples of a process
        part = part.to_discrete(DT)
    known = part.response(FREQUENCIES)[:, 0, 0]
    if asked.of.physical:
        known = known * np.exp(2j * np.pi * FREQUENCIES * part.delay)
    np.testing.assert_allclose(response, known, rtol=1e-6)


def test_every_kind_has_its_line_and_a_name_of_its_own() -> None:
    assert {type(capabilities_of(model)) for model in ALL.values()} == {type(each) for each in KINDS}
    assert len({each.kind for each in KINDS}) == len(KINDS)
    assert all(each.model.__doc__ for each in KINDS)


def test_a_model_of_no_registered_kind_can_run_and_nothing_else() -> None:
    class Other:
        name = "other"

    unknown = capabilities_of(Other())
    assert type(unknown) is Capabilities
    with pytest.raises(ModelError, match="other has no linear part"):
        unknown.linear_part(Other(), 0.0)
    with pytest.raises(ModelError, match="other has no frequency response"):
        unknown.frequency_response(Other(), FREQUENCIES, DT, 0, 0, 0.0)


def test_a_subclass_can_what_its_base_can() -> None:
    model: Any = ALL["arx"]

    class Mine(type(model)):  # type: ignore[misc]
        """A regression of a user."""

    assert capabilities_of(Mine(model.structure, model.parameters, DT)) is capabilities_of(model)
