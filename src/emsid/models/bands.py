r"""Curves of a fitted model with their confidence bands, from the covariance of the estimate.

With P = L·Lᵀ, a curve c(θ) changes by δⱼ = ½[c(θ + Lⱼ) − c(θ − Lⱼ)] over a standard error in the direction of column
Lⱼ, and its variance is Σ δⱼ². For a curve that is linear in θ this is the delta method; otherwise the finite steps
average its slope over the interval (the sigma points of Julier and Uhlmann). Where one side cannot be run, the
other one counts; where neither can, the step is shortened. A model that a step of one standard error may bend has steps
of its own, as ``band_steps``.

References:
    Julier, Uhlmann, *Unscented filtering and nonlinear estimation*, Proceedings of the IEEE 92 (2004).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import EmsidError, ModelError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.problem import Infeasible
from emsid.record import Record
from emsid.record.frames import frame

Array = NDArray[np.float64]
Curve = Callable[[Any], NDArray[Any]]

NEGLIGIBLE = 1e-12
"""Directions of the scaled covariance with a smaller share of the largest variance are rounding."""
SHORTER = (1.0, 0.125, 0.015625)
"""Steps that are tried, in standard errors."""
POINTS = 201
"""Points of a static map."""


@dataclass(frozen=True, eq=False)
class Band:
    """A curve with its confidence band.

    Attributes:
        x: (m,) time in s, frequency in Hz, or the input of a map.
        value: (m,) or (m, ny) the curve.
        standard_error: of the same shape, to first order; NaN where the fit has no intervals.
        level: of the band.
    """

    x: Array
    value: Array
    standard_error: Array
    level: float

    @property
    def known(self) -> bool:
        """Whether there is a band, or only a curve."""
        return bool(np.isfinite(self.standard_error).any())

    @property
    def half(self) -> Array:
        """Half the width of the band."""
        from scipy.special import ndtri

        return float(ndtri(0.5 + self.level / 2)) * self.standard_error

    @property
    def low(self) -> Array:
        """The lower edge."""
        return self.value - self.half

    @property
    def high(self) -> Array:
        """The upper edge."""
        return self.value + self.half

    def to_frame(self, library: str = "polars") -> Any:
        """A data frame with ``x``, ``value``, ``low`` and ``high``; of several outputs, these are numbered.

        Args:
            library: ``"polars"`` or ``"pandas"``.
        """
        columns = {"x": self.x}
        for name, values in (("value", self.value), ("low", self.low), ("high", self.high)):
            each = values[:, None] if values.ndim == 1 else values
            columns |= {name if each.shape[1] == 1 else f"{name}_{k + 1}": column for k, column in enumerate(each.T)}
        return frame(columns, library)


def banded(fit: Fit[Any], curve: Curve, x: Array, level: float) -> Band:
    """A curve over x (m,) with its band."""
    value, error = with_error(fit, curve)
    return Band(x, value, error, level)


@np.errstate(all="ignore")  # a resonance without damping, an integrator at 0 Hz: infinite, as it should be
def with_error(fit: Fit[Any], curve: Curve) -> tuple[Array, Array]:
    """A curve and its standard error; NaN where the curve is not finite."""
    here = np.asarray(curve(fit.model), dtype=float)
    if not fit.has_bands or fit.method == "file":  # a model alone has no estimates
        return here, np.full_like(here, np.nan)
    known = np.isfinite(here)
    error, directions = np.where(known, 0.0, np.nan), _directions(fit.covariance)
    if directions:
        _move_of(fit.model)(fit.names, fit.estimate)  # refuses other parameters than the model's own
    steps = getattr(fit.model, "band_steps", SHORTER)
    for direction in directions:
        for step in steps:
            change = _change(fit, curve, here, step * direction)
            if change is not None:
                error[known] = np.hypot(error[known], change / step)
                break
    return here, error


def _directions(covariance: Array) -> list[Array]:
    """The columns of L with P = L·Lᵀ, for the parameters of finite variance."""
    deviation = np.sqrt(np.diag(covariance))
    known = np.flatnonzero(np.isfinite(deviation) & (deviation > 0))
    if not len(known):
        return []
    scale = deviation[known]
    size, axes = np.linalg.eigh(covariance[np.ix_(known, known)] / np.outer(scale, scale))
    columns = []
    for k in np.flatnonzero(size > NEGLIGIBLE * size[-1]):
        column = np.zeros(len(covariance))
        column[known] = scale * np.sqrt(size[k]) * axes[:, k]
        columns.append(column)
    return columns


def _change(fit: Fit[Any], curve: Curve, here: Array, move: Array) -> Array | None:
    """The change of the finite part of a curve over a move of the estimate; None where it cannot be computed."""
    known = np.isfinite(here)
    above, below = (_moved(fit, curve, known, fit.estimate + side * move) for side in (1, -1))
    if above is not None and below is not None:
        return above / 2 - below / 2
    return above - here[known] if above is not None else here[known] - below if below is not None else None


def _moved(fit: Fit[Any], curve: Curve, known: NDArray[np.bool_], theta: Array) -> Array | None:
    """The known part of the curve with another estimate; None where that cannot be run, or diverges."""
    try:
        found = np.asarray(curve(_move_of(fit.model)(fit.names, theta)), dtype=float)[known]
    except (EmsidError, Infeasible, ValueError, ArithmeticError):
        return None
    return found if np.isfinite(found).all() else None


def _move_of(model: Any) -> Callable[[Sequence[str], Array], Any]:
    """The method of a model that gives it other estimates.

    Raises:
        ModelError: for a model without one.
    """
    move = getattr(model, "with_estimates", None)
    if move is None:
        raise ModelError(f"{model.name}: the parameters of this kind of model cannot be moved, so it has no band")
    return move  # type: ignore[no-any-return]


Quantity = tuple[str, str]
"""A name and a unit."""


@dataclass(frozen=True, eq=False)
class BandedCurve:
    """A curve of a model with its band.

    Attributes:
        model: its name.
        kind: ``step response``, ``magnitude`` or ``phase`` (of the frequency response), ``static map``, ``map in
            feedback``, ``friction`` or ``dead zone``.
        x_name, x_unit, name, unit: of the two axes; units are empty where they are not known.
        input, output: channels of the record that a response leads from and to.
        x: (m,) values on the first axis.
        value, low, high: (m,) the curve, and the edges of its band; these are NaN for a fit without intervals, and all
            are NaN for friction and dead zone beyond the speeds and commands of the record.
        level: of the band.
    """

    model: str
    kind: str
    x_name: str
    x_unit: str
    name: str
    unit: str
    input: str
    output: str
    x: Array
    value: Array
    low: Array
    high: Array
    level: float

    def to_data(self) -> dict[str, Any]:
        """By name, numbers as lists with six digits."""
        arrays = {name: getattr(self, name).tolist() for name in ("x", "value", "low", "high")}
        return vars(self) | {name: [float(f"{value:.6g}") for value in values] for name, values in arrays.items()}


def banded_curve(
    fit: Fit[Any],
    record: Record,
    kind: str,
    band: Band,
    x: Quantity,
    y: Quantity,
    *,
    input: int = 0,
    output: int = 0,
    column: int | None = None,
) -> BandedCurve:
    """A curve of a model, or one column of several, with its band.

    Args:
        fit: of the model.
        record: whose channels it leads between.
        kind, x, y: see `BandedCurve`.
        band: with the values.
        input, output: the channels.
        column: of the values, where they are those of several outputs.
    """
    value, low, high = (each if column is None else each[:, column] for each in (band.value, band.low, band.high))
    channels = record.input_names[input], record.output_names[output]
    return BandedCurve(fit.model.name, kind, *x, *y, *channels, band.x, value, low, high, band.level)


def input_of(record: Record, channel: int = 0) -> Quantity:
    """Name and unit of an input."""
    return record.input_names[channel], record.input_units[channel]


def output_of(record: Record, channel: int = 0) -> Quantity:
    """Name and unit of an output."""
    return record.output_names[channel], record.output_units[channel]
