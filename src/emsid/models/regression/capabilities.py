"""What regressions can do; see `emsid.models.capabilities`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.models.bands import Band
from emsid.models.c_form import CForm
from emsid.models.capabilities import Capabilities, Modes
from emsid.models.characteristics import Characteristic
from emsid.models.linear.state_space import observer_form
from emsid.models.linear.system import LinearSystem
from emsid.models.refit_data import Budget, Data
from emsid.models.regression.c_form import c_form
from emsid.models.regression.characteristics import of_linear, of_nonlinear
from emsid.models.regression.fitting import fit_structure
from emsid.models.regression.free_run_fit import fit_free_run
from emsid.models.regression.intervals import with_robust_intervals
from emsid.models.regression.linearised import about, linearised
from emsid.models.regression.narx import Narx, Structure
from emsid.models.regression.static_curves import friction, has_products, static_map
from emsid.models.regression.stepping import RegressionStepper
from emsid.models.steady_state import check_channel
from emsid.models.stepping import Stepper
from emsid.record import Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

CLOSE, EXACT = 0.05, 1e-3
"""Standard errors from the minimum at which a search of all samples ends, and one that only compares."""


class OfRegressions(Capabilities[Narx]):
    """Regressions: linear in their parameters."""

    kind = "narx"
    model = Narx
    estimators: ClassVar = {Structure: fit_structure}
    fitted_by = "its structure: model.structure"
    linear_in_parameters = True
    same_in_every_fit = True

    def inputs(self, model: Narx) -> int:
        return model.structure.inputs

    def stepper(self, model: Narx, state: Any, inputs: int) -> Stepper:
        return RegressionStepper(model, state)

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
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
        return Modes(poles if model.start else (), {0: (poles, list(np.roots(above[0])))}, delay)

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

    def refitted(self, fit: Fit[Narx], data: Data, budget: Budget) -> Fit[Narx]:
        structure = fit.model.structure
        if fit.method != "gn":
            last = budget is Budget.LAST
            each_block = partial(data.control.doing, "fitting to all rows") if last else None
            found: Fit[Narx] = data.linear(structure, data.in_pieces, each_block=each_block)
            plain = last and found.method == "ls" and not data.given.get("ridge")
            return with_robust_intervals(found, data.records) if plain else found
        last = budget is Budget.LAST
        found = fit_free_run(
            structure,
            data.records,
            start=fit.model.parameters,
            max_iterations=budget.steps,
            tolerance=CLOSE if last else EXACT,
            least_saving=budget.saving,
            control=data.control,
            covariances=last,
            left_out=data.by_segment,
        )
        about_terms = (each for each in fit.findings if last and each.code == "dictionary-rank-deficient")
        return replace(found, findings=(*found.findings, *about_terms))

    def specification(self, fit: Fit[Narx]) -> tuple[Any, dict[str, Any]]:
        return fit.model.structure, {"free_run": True} if fit.method == "gn" else {}
