"""What a kind of model can do besides running: the one place where other parts of the program ask for it.

A kind of model has a subclass of `Capabilities`, which overrides what it can do, and a line in `emsid.models.kinds`.
What it does not override it lacks: a method then says so by a `ModelError`, or has nothing to give.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Generic, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import Estimate
from emsid.estimation.fit import Fit
from emsid.findings import Finding
from emsid.models.bands import Band, BandedCurve, banded, banded_curve, input_of, output_of
from emsid.models.c_form import CForm
from emsid.models.characteristics import Characteristic, settled
from emsid.models.linear.system import LinearSystem
from emsid.models.refit_data import Budget, Data
from emsid.models.stepping import PlainStepper, Stepper
from emsid.record import Record

M = TypeVar("M")
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Estimator = Callable[..., Fit[Any]]
"""Takes what is fitted, the records, and options by name."""

LEVELS = 41
"""Points of a static map of which each takes a run to rest."""


@dataclass(frozen=True, eq=False)
class Modes:
    """The dynamics of a model as far as they can be implausible.

    Attributes:
        poles: that may be faster than the sampling.
        pairs: poles and zeros that may cancel each other, by the number of their block; 0 is the whole model.
        delay: in samples.
    """

    poles: Sequence[complex] = ()
    pairs: Mapping[int, tuple[Sequence[complex], Sequence[complex]]] = field(default_factory=dict)
    delay: int = 0


@dataclass(frozen=True, eq=False)
class MapInUse:
    """A static map inside a model, with its input in the free run over a record.

    Attributes:
        input: (m,) of the map; not finite where the run diverges.
        number: of the block, from 1.
        value: the map itself, from (m,) to (m,).
        marks: inputs at which it bends.
        output_at_rest: the output of the model where that of the map is constant; None where the map is in a loop, so
            that its output is not given from outside.
    """

    input: Array
    number: int
    value: Callable[[Array], Array]
    marks: Array = field(default_factory=lambda: np.empty(0))
    output_at_rest: Callable[[float], float] | None = None


class Capabilities(Generic[M]):
    """A kind of model without anything but the ability to run; subclasses say what theirs can do."""

    kind: ClassVar[str] = ""
    """Its name in model files."""
    model: ClassVar[type[Any]]
    """The class of the models."""
    estimators: ClassVar[Mapping[type, Estimator]] = {}
    """What `emsid.fit` takes to make such models, by its type, and how it is fitted."""
    of_responses: ClassVar[Mapping[type, Estimator]] = {}
    """The same for measured frequency responses, alone or among records."""
    fitted_by: ClassVar[str] = ""
    """What of a model `emsid.fit` takes, where that is not the model."""
    may_run_away: ClassVar[bool] = True
    """Whether it can be stable on a record and diverge on another input; physics keeps a plant from it."""
    says_what_it_lacks: ClassVar[bool] = False
    """Whether the findings of its fits name what would lower the error, so that no test of the residual is needed."""
    physical: ClassVar[bool] = False
    """Whether its parameters are physical quantities, so that some can be estimated again by name."""
    linear_in_parameters: ClassVar[bool] = False
    """Whether it is a structure of regressors, and so linear in its parameters."""
    same_in_every_fit: ClassVar[bool] = False
    """Whether its estimates mean the same in every fit, so that a bootstrap can compare them."""
    takes_all_inputs: ClassVar[bool] = True
    """Whether every input is a command that may step; the second input of a plant is a load."""

    # --- running, export ---------------------------------------------------------------------------------------------

    def inputs(self, model: M) -> int:
        """How many inputs a model has."""
        return 1

    def stepper(self, model: M, state: Any, inputs: int) -> Stepper:
        """The model sample by sample, from a state."""
        return PlainStepper(model, state, inputs)  # type: ignore[arg-type]

    def c_form(self, stepper: Any, *, single: bool = False, parameters: Sequence[str] = ()) -> CForm:
        """The form in C of a model that is not a `PlainStepper`.

        Raises:
            ModelError: without one.
        """
        _lacks(stepper.model, "no form in C")

    # --- linear parts ------------------------------------------------------------------------------------------------

    def linear_part(self, model: M, at: float) -> LinearSystem:
        """The linear system near the rest at a constant input.

        Raises:
            ModelError: without one, or where the model does not come to rest.
        """
        _lacks(model, "no linear part")

    def frequency_response(self, model: M, f: Array, dt: float, output: int, input: int, around: float) -> Complex:
        """(m,) the response at frequencies f (m,) in Hz.

        Args:
            model: of this kind.
            f: (m,) in Hz.
            dt: sample time in s.
            output, input: from 0.
            around: the constant input about which a nonlinear model is linearised.

        Raises:
            ModelError: for a model without one, without these channels, or that does not rest there.
        """
        _lacks(model, "no frequency response: it is not linear")

    def modes(self, model: M) -> Modes:
        """Poles, zeros and delay that may be implausible."""
        return Modes()

    # --- static maps -------------------------------------------------------------------------------------------------

    def output_at_rest(self, model: M, level: float) -> float:
        """The output in the steady state at a constant input, of a model with one input and one output.

        Raises:
            ModelError: where it does not come to rest.
        """
        return settled(model, level)

    def maps_in_use(self, model: M, record: Record) -> tuple[MapInUse, ...]:
        """Its static maps with their inputs in the free run over a record.

        Raises:
            ModelError: if the run diverges.
        """
        return ()

    def judged_maps(self, model: M, record: Record) -> tuple[MapInUse, ...]:
        """Those of `maps_in_use` whose shape can be judged by the output at rest: not in a loop."""
        return ()

    def static_map(self, fit: Fit[M], record: Record, map: int = 0, level: float = 0.95) -> Band:
        """A static map over its input in a record; here the output at rest over a constant input.

        Raises:
            ModelError: for a model without it.
        """
        if record.input.shape[1] * record.output.shape[1] > 1:
            _lacks(fit.model, "several inputs or outputs, so it has no curve of a map")
        x = np.linspace(float(record.input.min()), float(record.input.max()), LEVELS)
        return banded(fit, self._at_rest(fit.model, x), x, level)

    def _at_rest(self, model: M, levels: Array) -> Callable[[Any], Array]:
        """A function from a model close to this one to its outputs (m,) at rest."""
        return lambda moved: np.array([self.output_at_rest(moved, level) for level in levels])

    def friction(self, fit: Fit[M], record: Record, level: float = 0.95) -> Band:
        """Friction over the output, as the part of the input that it takes up.

        Raises:
            ModelError: for a model without a curve of it.
        """
        _lacks(fit.model, "no curve of friction: it is no regression of one input")

    def curves(self, fit: Fit[M], record: Record) -> Iterator[Callable[[], list[BandedCurve]]]:
        """What makes the curves of its maps and of its friction with their bands; each may raise an `EmsidError`."""
        yield partial(self._static_curves, fit, record)
        yield partial(self._friction_curves, fit, record)

    def _static_curves(self, fit: Fit[M], record: Record) -> list[BandedCurve]:
        band = self.static_map(fit, record)
        return [banded_curve(fit, record, "static map", band, input_of(record), output_of(record))]

    def _friction_curves(self, fit: Fit[M], record: Record) -> list[BandedCurve]:
        band = self.friction(fit, record)
        return [banded_curve(fit, record, "friction", band, output_of(record), input_of(record))]

    # --- what is known of a fit --------------------------------------------------------------------------------------

    def physical_rows(self, fit: Fit[M]) -> Sequence[Estimate]:
        """The rows of the physical parameters that hold in every record; of a model without such parameters none."""
        return ()

    def characteristics(self, fit: Fit[M], record: Record) -> tuple[Characteristic, ...]:
        """Gain, time constants, dead zone and friction with intervals, as far as it has them."""
        return ()

    def free_run_error(self, fit: Fit[M], record: Record, transient: int | None) -> Array | None:
        """(N, 1) the standard error of the free run, where it has exact derivatives; else None."""
        return None

    def advice(self, fit: Fit[M], record: Record) -> tuple[Finding, ...]:
        """What a fit shows beyond its own findings."""
        return ()

    def as_left(self, model: M, record: Record) -> M:
        """The model as a record leaves it, with what does not go back before the next run; the same."""
        return model

    def trusted_length(self, model: M, record: Record) -> list[Finding]:
        """The time for which a free run is trusted, where its errors add up."""
        return []

    def hides_the_sign(self, model: M) -> bool:
        """Whether its output does not show the sign of what moves."""
        return False

    def equation(self, fit: Fit[M], record: Record) -> str:
        """The equation with as many digits as the data support."""
        return fit.model.equation()  # type: ignore[attr-defined, no-any-return]

    def section(self, fit: Fit[M]) -> str:
        """The name of its section in a report, a key of `emsid.report.views.sections.SECTIONS`."""
        return "equation"

    # --- other data --------------------------------------------------------------------------------------------------

    def refitted(self, fit: Fit[M], data: Data, budget: Budget) -> Fit[Any]:
        """The model with its parameters from other data, from the estimate; see `emsid.models.refitting`.

        Args:
            fit: what is known.
            data: the other data; samples are left out of them by `Budget.FEW` only.
            budget: how far; not a search for the structure.

        Raises:
            ModelError: for a kind of model that cannot be fitted again, or data that do not suit it.
        """
        _lacks(fit.model, "no way to be fitted again")

    def specification(self, fit: Fit[M]) -> tuple[Any, dict[str, Any]]:
        """What `emsid.fit` takes to estimate the same parameters from other data: subject and options.

        Raises:
            ModelError: for a kind of model that cannot be fitted again.
        """
        _lacks(fit.model, "no way to be fitted again")


def _name(model: Any) -> str:
    return str(getattr(model, "name", type(model).__name__))


def _lacks(model: Any, what: str) -> NoReturn:
    raise ModelError(f"{_name(model)} has {what}")
