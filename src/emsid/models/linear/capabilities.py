"""What linear models of several kinds can do; see `emsid.models.capabilities`.

Sample by sample, and in C, a model runs in its state-space form. With the innovation e = y − ŷ of the last sample,
`correct` adds K·e to the state: the prediction of the innovations form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emsid.errors import ModelError
from emsid.estimation.compiled import read_only
from emsid.estimation.fit import Fit
from emsid.models.c_form import CForm, number, total
from emsid.models.capabilities import Capabilities, Modes
from emsid.models.characteristics import Characteristic, check_channel, gain_unit, modes
from emsid.models.linear.polynomials import PolynomialModel
from emsid.models.linear.prediction_error import PolynomialStructure, fit_polynomials
from emsid.models.linear.process_model import ProcessModel, ProcessStructure, fit_process
from emsid.models.linear.response_state_space import fit_to_response
from emsid.models.linear.state_space import StateSpaceModel, run_in_place
from emsid.models.linear.subspace_fit import StateSpaceStructure, fit_state_space
from emsid.models.linear.system import LinearSystem
from emsid.models.linear.transfer_function import (
    TransferFunction,
    TransferFunctionStructure,
    fit_transfer_function,
)
from emsid.models.refit_data import Budget, Data
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


def c_form(stepper: LinearStepper) -> CForm:
    """The form in C of a linear model, from where its stepper is; the free run, without the model of its noise."""
    form, state = stepper.form, stepper.state
    rows = [(f"y[{k}]", form.c[k], form.d[k], float(form.level[k])) for k in range(len(form.level))]
    after = [(f"after[{k}]", form.a[k], form.b[k], 0.0) for k in range(len(state))]
    lines = [f"    {name} = {_row(x, u, level)};" for name, x, u, level in (*rows, *after)]
    if len(state):
        lines.insert(0, f"    real after[{len(state)}];")
        lines += [f"    s->x[{k}] = after[{k}];" for k in range(len(state))]
    return CForm(form.b.shape[1], len(form.level), (("x", state),), "\n".join(lines) + "\n")


def _row(x: object, u: object, level: float) -> str:
    terms = [f"{number(value)} * s->x[{k}]" for k, value in enumerate(x) if value]  # type: ignore[arg-type, var-annotated]
    terms += [f"{number(value)} * u[{k}]" for k, value in enumerate(u) if value]  # type: ignore[arg-type, var-annotated]
    return total([*terms, number(level)] if level else terms)


# --- sample by sample, and in C ---------------------------------------------------------------------------------------


class LinearStepper(Stepper):
    """A linear model in state space."""

    __slots__ = ("_begun", "_form", "_input", "_level", "_matrices", "_output", "_x")

    def __init__(self, model: Any, state: Array) -> None:
        """
        Args:
            model: a `StateSpaceModel`, or one with such a ``form``.
            state: (n,) where it begins.
        """
        form = model if isinstance(model, StateSpaceModel) else model.form
        super().__init__(model, form.b.shape[1], len(form.level))
        self._form = form
        self._matrices = (read_only(form.a), read_only(form.b), read_only(form.c), read_only(form.d))
        self._x, self._level, self._begun = np.array(state, dtype=float), form.level, False
        self._input, self._output = read_only(self._u[None, :]), self._y[None, :]

    def _advance(self) -> None:
        run_in_place(*self._matrices, self._x, self._input, self._output)
        self._y += self._level
        self._begun = True

    @property
    def form(self) -> StateSpaceModel:
        """The model in state space."""
        return self._form

    @property
    def state(self) -> Array:
        """(n,) the present state."""
        return self._x.copy()

    def correct(self, y: ArrayLike) -> None:
        """Take the measured output of the last sample; see `Stepper.correct`."""
        if not self._begun:
            raise ModelError(f"{self.model.name}: correct takes the output of the last step; call step first")
        if not self._form.k.any():
            super().correct(y)
        self._x += self._form.k @ (np.broadcast_to(np.asarray(y, dtype=float), self._y.shape) - self._y)
        self._begun = False  # an output is taken once
