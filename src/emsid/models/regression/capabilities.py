"""What regressions can do; see `emsid.models.capabilities`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.models.bands import Band
from emsid.models.c_form import CForm
from emsid.models.capabilities import Capabilities, Modes
from emsid.models.characteristics import Characteristic
from emsid.models.linear.state_space import observer_form
from emsid.models.linear.system import LinearSystem
from emsid.models.model import Model
from emsid.models.refit_data import REPEATED_STEPS, SAVING, STEPS, Data
from emsid.models.regression.c_form import c_form
from emsid.models.regression.characteristics import of_linear, of_nonlinear
from emsid.models.regression.fitting import fit_structure
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.linearised import about, linearised
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.static_curves import friction, has_products, static_map
from emsid.models.regression.stepping import RegressionStepper
from emsid.models.steady_state import check_channel
from emsid.models.stepping import Stepper
from emsid.record import Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class OfRegressions(Capabilities[Narx]):
    """Regressions: linear in their parameters."""

    kind = "narx"
    model = Narx
    estimators: ClassVar = {Structure: fit_structure}
    fitted_by = "its structure: model.structure"
    linear_in_parameters = True

    def inputs(self, model: Narx) -> int:
        return model.structure.inputs

    def stepper(self, model: Narx, state: Any, inputs: int) -> Stepper:
        return RegressionStepper(model, state)

    def c_form(self, stepper: Any) -> CForm:
        return c_form(stepper)

    def linear_part(self, model: Narx, at: float) -> LinearSystem:
        below, above = about(model, at)
        a, columns = observer_form(below, list(above))
        return LinearSystem(a, columns, np.eye(1, len(a)), above[:, :1].T.copy(), model.dt, name=model.name)

    def frequency_response(self, model: Narx, f: Array, dt: float, output: int, input: int, around: float) -> Complex:
        check_channel(model, "output", output, 1)
        check_channel(model, "input", input, model.structure.inputs)
        below, above = about(model, around)
        z = np.exp(-2j * np.pi * f * dt)
        polynomial = np.polynomial.polynomial.polyval
        return np.asarray(polynomial(z, above[input]) / polynomial(z, below), dtype=complex)

    def modes(self, model: Narx) -> Modes:
        lags = [f.lag for regressor in model.structure.regressors for f in regressor.factors if f.channel]
        delay = min(lags, default=0)
        if not model.is_linear:
            return Modes(delay=delay)
        below, above = model.linear_part()
        poles = list(np.roots(below)) if len(below) > 1 else []
        return Modes(poles if model.start else (), (poles, list(np.roots(above[0]))), delay)

    def output_at_rest(self, model: Narx, level: float) -> float:
        return linearised(model, level)[2]

    def static_map(self, fit: Fit[Narx], record: Record, map: int = 0, level: float = 0.95) -> Band:
        if has_products(fit.model) or record.input.shape[1] * record.output.shape[1] > 1:
            return super().static_map(fit, record, map, level)
        return static_map(fit, record, level)

    def friction(self, fit: Fit[Narx], record: Record, level: float = 0.95) -> Band:
        return friction(fit, record, level)

    def characteristics(self, fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
        if record.input.shape[1] > 1 or record.output.shape[1] > 1:
            return ()
        return of_linear(fit, record) or of_nonlinear(fit, record)

    def refitted(self, fit: Fit[Narx], data: Data) -> Model:
        structure = fit.model.structure
        if fit.method != "gn":
            one_step: Model = data.linear(structure, data.in_pieces).model
            return one_step
        return fit_free_run(
            structure,
            data.records,
            start=fit.model.parameters,
            max_iterations=STEPS,
            least_saving=SAVING,
            control=data.control,
            covariances=False,
            left_out=data.by_segment,
        ).model

    def specification(self, fit: Fit[Narx]) -> tuple[Any, dict[str, Any]]:
        return fit.model.structure, {"free_run": True} if fit.method == "gn" else {}

    def repeated(self, fit: Fit[Narx], records: Sequence[Record]) -> Callable[[Record], Fit[Any]]:
        structure = fit.model.structure
        if fit.model.start:
            return lambda record: fit_free_run(
                structure, record, start=fit.estimate, max_iterations=REPEATED_STEPS, covariances=False
            )
        if fit.method == "ls":
            plain = least_squares(structure, records).estimate
            if np.allclose(plain, fit.estimate, rtol=1e-6, atol=1e-9 * np.abs(plain).max()):  # no ridge
                return lambda record: least_squares(structure, record)
        return super().repeated(fit, records)
