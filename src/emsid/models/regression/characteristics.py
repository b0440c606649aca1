"""Gain, time constants and friction of a regression with one input and one output."""

from __future__ import annotations

from functools import partial
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from emsid.estimation.fit import Fit
from emsid.models.characteristics import Characteristic, by_estimate, gain_unit, half_of, modes
from emsid.models.regression.figures import COULOMB, of_regression
from emsid.models.regression.narx import Narx
from emsid.models.regression.transforms import Transform
from emsid.models.visited import Needs, RestsOn, Visited
from emsid.record import Record

Array = NDArray[np.float64]


def of_linear(fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
    """Gain and slowest time constant of A(q)y = B(q)u; none for a regression that is not linear."""
    regressors = [regressor for regressor in fit.model.structure.regressors if regressor.factors]
    single = [regressor.factors[0] for regressor in regressors if len(regressor.factors) == 1]
    if len(single) < len(regressors) or any(f.power > 1 or f.transform is not Transform.VALUE for f in single):
        return ()
    at = [k for k, regressor in enumerate(fit.model.structure.regressors) if regressor.factors]
    signs = np.array([-1.0 if regressor.negative else 1.0 for regressor in regressors])
    most = max((f.lag for f in single if f.channel == 0), default=0)

    def past(theta: Array) -> Array:
        """The coefficients of A."""
        a: Array = np.eye(1, most + 1)[0]
        for value, factor in zip(signs * theta[at], single, strict=True):
            if factor.channel == 0:
                a[factor.lag] -= value
        return a

    def gain(theta: Array) -> float:
        b = sum(value for value, factor in zip(signs * theta[at], single, strict=True) if factor.channel)
        return float(b / np.sum(past(theta)))

    found = [by_estimate(fit, "gain", gain, gain_unit(record))]
    found += modes(partial(by_estimate, fit), lambda theta: np.roots(past(theta)), fit.estimate, record.dt)
    return tuple(each for each in found if isfinite(each.value))


def of_nonlinear(fit: Fit[Narx], record: Record) -> tuple[Characteristic, ...]:
    """Of a regression that is not linear: gain over the range of the input, time constants, friction."""
    slides = Visited(np.empty(0), record.output[:, 0]).shows(RestsOn(Needs.SLIDING), 0.0)
    found = (
        Characteristic(each.name, each.value, half_of(each.standard_error), each.unit, fit.model.name)
        for each in of_regression(fit, record)
        if isfinite(each.value)
    )
    return tuple(each.unknown() if each.name == COULOMB and not slides else each for each in found)
