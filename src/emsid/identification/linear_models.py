"""Linear models with a noise model as candidates: ARMAX, Box–Jenkins and state space.

Orders that are not given are chosen from one triangular factor each: those of ARMAX and of the noise of Box–Jenkins by
the criterion of Schwarz, those of the input part of Box–Jenkins as for an output-error model, and the order of a state
space from its singular values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.identification.regressions import LINEAR, OutputError
from emsid.models.linear.prediction_error import armax_orders, box_jenkins, fit_polynomials, noise_orders
from emsid.models.linear.subspace_fit import fit_state_space, state_space
from emsid.options import Options
from emsid.record import Record

NOISE_ORDERS = 3
"""The largest number of coefficients of a noise polynomial."""


def _among(given: int | None, values: Sequence[int]) -> tuple[int, ...]:
    return tuple(values) if given is None else (given,)


@dataclass(frozen=True)
class Armax:
    """ARMAX as a candidate."""

    summary: str
    uses: ClassVar[tuple[str, ...]] = ("na", "nb", "nk")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose orders that are not given, then minimise the prediction error over the whole record."""
        control.doing("choosing orders")
        nk, na, nb = (_among(getattr(options, name), LINEAR[name]) for name in ("nk", "na", "nb"))
        structure = armax_orders(record, nk, na, nb, range(NOISE_ORDERS + 1))
        control.doing("fitting")
        return fit_polynomials(structure, record, control=control)


@dataclass(frozen=True)
class BoxJenkins:
    """Box–Jenkins as a candidate: an output-error model with a model of its noise."""

    summary: str
    like: OutputError
    uses: ClassVar[tuple[str, ...]] = ("na", "nb", "nk", "held_back")

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose orders that are not given, then minimise the prediction error over the whole record."""
        found = self.like.chosen(record, options, control).model
        lags = [
            [f.lag for r in found.structure.regressors for f in r.factors if (f.channel > 0) == of_input]
            for of_input in (False, True)
        ]
        constant = "1" in found.structure.labels
        rest = [
            (segment.output - found.simulate(segment).output)[found.memory :, 0]
            for segment in record.segments
            if len(segment) > 2 * found.memory
        ]
        nc, nd = noise_orders(rest, NOISE_ORDERS)
        first, inputs = min(lags[1]), record.input.shape[1]
        structure = box_jenkins(max(lags[1]) - first + 1, nc, nd, max(lags[0], default=0), first, inputs, constant)
        control.doing("fitting")
        return fit_polynomials(structure, record, control=control)


@dataclass(frozen=True)
class StateSpace:
    """A state-space model as a candidate, fitted to the free run."""

    summary: str
    uses: ClassVar[tuple[str, ...]] = ("orders",)

    def __call__(self, record: Record, options: Options, control: Control = FREE) -> Fit[Any]:
        """Choose the order if it is not given, then minimise the error of the free run over the whole record."""
        control.doing("fitting")
        order = options.orders[0] if options.orders else None
        return fit_state_space(state_space(order, direct=True), record, free_run=True, control=control)
