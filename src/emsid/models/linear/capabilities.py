"""What linear models of several kinds can do; see `emsid.models.capabilities`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.models.c_form import CForm
from emsid.models.capabilities import Capabilities, Modes
from emsid.models.characteristics import Characteristic, gain_unit, modes
from emsid.models.linear.c_form import c_form
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.prediction_error import PolynomialStructure, fit_polynomials
from emsid.models.linear.process_model import ProcessModel, ProcessStructure, fit_process
from emsid.models.linear.response_state_space import fit_to_response
from emsid.models.linear.state_space import StateSpaceModel
from emsid.models.linear.stepping import LinearStepper
from emsid.models.linear.subspace_fit import StateSpaceStructure, fit_state_space
from emsid.models.linear.system import LinearSystem
from emsid.models.linear.transfer_function import (
    TransferFunction,
    TransferFunctionStructure,
    fit_transfer_function,
)
from emsid.models.refit_data import Budget, Data
from emsid.models.steady_state import check_channel
from emsid.models.stepping import Stepper
from emsid.record import Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
L = TypeVar("L", StateSpaceModel, PolynomialModel, ProcessModel, TransferFunction)


class OfLinearModels(Capabilities[L]):
    """What all of them share: a response, and a state-space form that runs and is written in C."""

    same_in_every_fit = True

    def stepper(self, model: L, state: Any, inputs: int) -> Stepper:
        return LinearStepper(model, state)

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
        return c_form(stepper)

    def frequency_response(self, model: L, f: Array, dt: float, output: int, input: int, around: float) -> Complex:
        found = model.response(f)
        check_channel(model, "output", output, found.shape[1])
        check_channel(model, "input", input, found.shape[2])
        return np.asarray(found[:, output, input])

    def refitted(self, fit: Fit[L], data: Data, budget: Budget) -> Fit[L]:
        structure, options = self.specification(fit)
        return self.estimators[type(structure)](
            structure,
            data.records,
            **options,
            **self.begun(fit),
            max_iterations=budget.steps,
            control=data.control,
            left_out=data.by_segment,
        )

    def begun(self, fit: Fit[L]) -> dict[str, Any]:
        """How a fit to other data begins at this one, by the arguments of its estimator."""
        return {"start": fit.estimate}


class OfStateSpaces(OfLinearModels[StateSpaceModel]):
    """Models in state space."""

    kind = "state-space"
    model = StateSpaceModel
    estimators: ClassVar = {StateSpaceStructure: fit_state_space}
    of_responses: ClassVar = {StateSpaceStructure: fit_to_response}

    def linear_part(self, model: StateSpaceModel, at: float) -> LinearSystem:
        return model.sampled

    def modes(self, model: StateSpaceModel) -> Modes:
        from scipy.linalg import eigvals

        one = np.diag([*np.ones(model.order), 0.0])
        zeros = eigvals(np.block([[model.a, model.b[:, :1]], [model.c[:1], model.d[:1, :1]]]), one)
        return Modes(list(model.poles), {0: (list(model.poles), list(zeros[np.isfinite(zeros)]))})

    def characteristics(self, fit: Fit[StateSpaceModel], record: Record) -> tuple[Characteristic, ...]:
        return _characteristics(fit, record, fit.model, fit.model.poles)

    def begun(self, fit: Fit[StateSpaceModel]) -> dict[str, Any]:
        """By a subspace method again: its start needs no search."""
        return {"refine": fit.method != "subspace"}

    def specification(self, fit: Fit[StateSpaceModel]) -> tuple[Any, dict[str, Any]]:
        return StateSpaceStructure.of(fit.model), {"free_run": not fit.model.k.any()}


class OfPolynomials(OfLinearModels[PolynomialModel]):
    """ARMAX and Box–Jenkins models."""

    kind = "polynomials"
    model = PolynomialModel
    estimators: ClassVar = {PolynomialStructure: fit_polynomials}

    def linear_part(self, model: PolynomialModel, at: float) -> LinearSystem:
        form = model.form
        return LinearSystem(form.a, form.b, form.c, form.d, form.dt, name=form.name)

    def modes(self, model: PolynomialModel) -> Modes:
        poles = list(_poles(model))
        return Modes(poles, {0: (poles, list(np.roots(model.b[0])))}, model.delay)

    def characteristics(self, fit: Fit[PolynomialModel], record: Record) -> tuple[Characteristic, ...]:
        return _characteristics(fit, record, fit.model.form, _poles(fit.model))

    def specification(self, fit: Fit[PolynomialModel]) -> tuple[Any, dict[str, Any]]:
        return PolynomialStructure.of(fit), {}


class OfProcesses(OfLinearModels[ProcessModel]):
    """Gain, time constants and dead time."""

    kind = "process"
    model = ProcessModel
    estimators: ClassVar = {ProcessStructure: fit_process}

    def linear_part(self, model: ProcessModel, at: float) -> LinearSystem:
        return model.part

    def begun(self, fit: Fit[ProcessModel]) -> dict[str, Any]:
        return {"start": fit.model}

    def specification(self, fit: Fit[ProcessModel]) -> tuple[Any, dict[str, Any]]:
        return ProcessStructure.of(fit), {}


class OfTransferFunctions(OfLinearModels[TransferFunction]):
    """Rational functions of s or z with a dead time."""

    kind = "transfer-function"
    model = TransferFunction
    estimators: ClassVar = {TransferFunctionStructure: fit_transfer_function}
    of_responses: ClassVar = {TransferFunctionStructure: fit_transfer_function}

    def linear_part(self, model: TransferFunction, at: float) -> LinearSystem:
        return model.part

    def modes(self, model: TransferFunction) -> Modes:
        return Modes(list(model.sampled.poles), delay=round(model.sampled.delay / model.dt))

    def characteristics(self, fit: Fit[TransferFunction], record: Record) -> tuple[Characteristic, ...]:
        return _characteristics(fit, record, fit.model.form, fit.model.sampled.poles)

    def begun(self, fit: Fit[TransferFunction]) -> dict[str, Any]:
        return {"start": fit.model}

    def specification(self, fit: Fit[TransferFunction]) -> tuple[Any, dict[str, Any]]:
        return TransferFunctionStructure.of(fit), {}


def _poles(model: PolynomialModel) -> NDArray[Any]:
    """The poles from the first input, without those of the noise."""
    return np.asarray(np.roots(np.convolve(np.append(1.0, model.a), np.append(1.0, model.f[0]))))


def _characteristics(
    fit: Fit[Any], record: Record, form: StateSpaceModel, poles: NDArray[Any]
) -> tuple[Characteristic, ...]:
    """Gain and modes of a linear model, without intervals."""
    if record.input.shape[1] > 1 or record.output.shape[1] > 1:
        return ()

    def make(name: str, quantity: Callable[[Any], float], unit: str) -> Characteristic:
        return Characteristic(name, quantity(poles), None, unit, fit.model.name)

    rest = np.eye(len(form.a)) - form.a
    gain = form.d + form.c @ np.linalg.solve(rest, form.b) if np.linalg.cond(rest) < 1e12 else form.d * np.nan
    found = [Characteristic("gain", float(gain[0, 0]), None, gain_unit(record), fit.model.name)]
    found += modes(make, lambda poles: poles, poles, record.dt)
    return tuple(each for each in found if isfinite(each.value))
