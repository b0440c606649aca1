"""What cascades of filters and static maps can do; see `emsid.models.capabilities`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.findings import Finding
from emsid.models.bands import POINTS, Band
from emsid.models.blocks import fitting
from emsid.models.blocks.c_form import c_form
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.characteristics import of_cascade
from emsid.models.blocks.linear_part import linear_part
from emsid.models.blocks.stepping import CascadeStepper
from emsid.models.c_form import CForm
from emsid.models.capabilities import Capabilities, MapInUse, Modes
from emsid.models.characteristics import Characteristic
from emsid.models.curves import BandedCurve, banded_curve
from emsid.models.linear.system import LinearSystem
from emsid.models.refit_data import Budget, Data
from emsid.models.steady_state import check_channel
from emsid.models.stepping import Stepper
from emsid.record import Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class OfCascades(Capabilities[Cascade]):
    """Cascades: Wiener, Hammerstein, and longer ones."""

    kind = "cascade"
    model = Cascade
    same_in_every_fit = True
    estimators: ClassVar = {Cascade: fitting.fit_cascade}

    def stepper(self, model: Cascade, state: Any, inputs: int) -> Stepper:
        return CascadeStepper.of(model, state)

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
        return c_form(stepper)

    def linear_part(self, model: Cascade, at: float) -> LinearSystem:
        return linear_part(model, at)

    def frequency_response(
        self, model: Cascade, f: Array, dt: float, output: int, input: int, around: float
    ) -> Complex:
        """That of the filters in a row, without the maps."""
        check_channel(model, "output", output, 1)
        check_channel(model, "input", input, 1)
        filters = list(model.filters.values())
        if not filters:
            return super().frequency_response(model, f, dt, output, input, around)
        inside, z = dt / model.oversampling, np.exp(-2j * np.pi * f * dt)
        return np.asarray(z**model.delay * np.prod([block.response(f, inside) for block in filters], axis=0))

    def modes(self, model: Cascade) -> Modes:
        filters = list(model.filters.values())
        inside = sum(block.delay for block in filters) // model.oversampling
        pairs = {k + 1: (list(block.poles), list(block.zeros)) for k, block in model.filters.items()}
        return Modes([pole for block in filters for pole in block.poles], pairs, model.delay + inside)

    def maps_in_use(self, model: Cascade, record: Record) -> tuple[MapInUse, ...]:
        """The maps with their inputs from rest at the first input of every segment."""
        with np.errstate(all="ignore"):
            signals = [model.signals_from_rest(segment.input[:, 0]) for segment in record.segments]
        return tuple(
            MapInUse(
                np.concatenate([signal[k] for signal in signals]),
                k + 1,
                block.value,
                block.marks()[0],
                partial(_at_rest_after, model, k),
            )
            for k, block in model.maps.items()
        )

    def judged_maps(self, model: Cascade, record: Record) -> tuple[MapInUse, ...]:
        return self.maps_in_use(model, record)

    def static_map(self, fit: Fit[Cascade], record: Record, map: int = 0, level: float = 0.95) -> Band:
        """One of its static maps, over the signal that enters it in the record."""
        found = list(fit.model.maps)
        if not 0 <= map < len(found):
            raise ModelError(f"{fit.model.name} has no static map {map}; it has {len(found)}, counted from 0")
        k = found[map]
        entering = np.concatenate([fit.model.signals_from_rest(segment.input[:, 0])[k] for segment in record.segments])
        x = np.linspace(float(entering.min()), float(entering.max()), POINTS)
        value, error = fitting.static_band(fit, k, x).T
        return Band(x, value, error if fit.has_bands else np.full(len(x), np.nan), level)

    def curves(self, fit: Fit[Cascade], record: Record) -> Iterator[Callable[[], list[BandedCurve]]]:
        """The maps; a cascade has no units between its blocks."""
        maps = len(fit.model.maps)
        names = [f"map {k + 1}" for k in range(maps)] if maps > 1 else ["the map"]

        def of_maps() -> list[BandedCurve]:
            bands = [self.static_map(fit, record, k) for k in range(len(names))]
            return [
                banded_curve(fit, record, "static map", band, (f"input of {name}", ""), (f"output of {name}", ""))
                for band, name in zip(bands, names, strict=True)
            ]

        yield of_maps

    def characteristics(self, fit: Fit[Cascade], record: Record) -> tuple[Characteristic, ...]:
        return of_cascade(fit, record)

    def advice(self, fit: Fit[Cascade], record: Record) -> tuple[Finding, ...]:
        from emsid.models.blocks.search.diagnostics import advice

        return advice(fit, record)

    def section(self, fit: Fit[Cascade]) -> str:
        return "blocks"

    def refitted(self, fit: Fit[Cascade], data: Data, budget: Budget) -> Fit[Cascade]:
        if budget is Budget.LAST:
            from emsid.models.blocks.search.estimation import asked, topology_of

            return asked(topology_of(fit.model), data.given).continued(fit.model, data.records, data.control)
        minimum, problem = fitting.search(
            fit.model,
            data.records,
            fixed=fitting.fixed_in(fit),
            max_iterations=budget.steps,
            least_saving=budget.saving,
            control=data.control.quietly(),
            left_out=data.by_segment,
        )
        return fit.at(problem.model(minimum.estimate))

    def specification(self, fit: Fit[Cascade]) -> tuple[Any, dict[str, Any]]:
        return fit.model, {}


def _at_rest_after(model: Cascade, k: int, value: float) -> float:
    """The output at rest where the output of block k is constant."""
    for block in model.blocks[k + 1 :]:
        _, value = block.resting(value)
    return value + model.output_offset
