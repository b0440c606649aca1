"""The static curves and the modes of a model as CSV: friction, dead zone, cogging, static maps; resonances in Hz.

Those of a fit have 95 % bands and intervals. The cogging is that against the positive direction, over one period: a
drive compensates it by adding the value at its position to the torque (force) that it makes.

The band is pointwise, y ± 1.96·√(g Cov gᵀ) with the derivatives g of the curve by the estimates.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.fit import Fit
from emsid.exports.formats import Export, Files
from emsid.models.blocks.fitting import static_band
from emsid.validation.analysis import modes

Array = NDArray[np.float64]
POINTS = 201
"""Points of a curve."""
STEP = 1e-6
"""Relative step of the differences that give the derivatives of a curve."""


def csv(export: Export) -> tuple[Files, list[str]]:
    """A file for every static curve, and one of the modes.

    Raises:
        ModelError: for a model that has neither.
    """
    files: Files = {}
    plant: Any = getattr(export.model, "plant", None)
    for what in ("friction", "dead_zone"):
        curve = getattr(plant, f"{what}_characteristic", lambda: None)()
        if curve is not None:
            reach = 3 * curve.edge if curve.edge > 0 else max(law.reach for law in plant.frictions.values())
            x = np.linspace(-reach, reach, POINTS)
            head = tuple(f"{name} [{unit}]" for name, unit in (curve.x, curve.y))

            def law(changed: Any, x: Array = x, what: str = what) -> Array:
                found: Array = getattr(changed, f"{what}_characteristic")().law(x)
                return found

            files[f"{export.name}_{what}.csv"] = _table(head, x, curve.law(x), _plant_errors(export.fit, plant, law))
    if plant is not None and len(getattr(getattr(plant, "cogging", None), "waves", ())):
        x = np.linspace(0.0, plant.cogging.period, POINTS)

        def against(changed: Any, x: Array = x) -> Array:
            phase, cosine, sine = changed.cogging.waves.T[:, :, None]
            return np.asarray(np.sum(cosine * np.cos(phase * x) + sine * np.sin(phase * x), axis=0))

        units = (plant.handles[f"cogging.{name}"].parameter.unit for name in ("period", "cosine_1"))
        head = tuple(f"{name} [{unit}]" for name, unit in zip(("Position", "Cogging"), units, strict=True))
        files[f"{export.name}_cogging.csv"] = _table(head, x, against(plant), _plant_errors(export.fit, plant, against))
    for k, block in enumerate([*getattr(export.model, "blocks", ()), *getattr(export.model, "maps", ())]):
        if hasattr(block, "marks") and hasattr(block, "value"):
            marks = np.abs(np.append(block.marks()[0], 1.0)).max()
            x = np.linspace(-2 * marks, 2 * marks, POINTS)
            known = export.fit is not None and export.fit.has_bands and hasattr(export.model, "blocks")
            error = static_band(export.fit, k, x)[:, 1] if known and export.fit is not None else None
            files[f"{export.name}_map{k + 1}.csv"] = _table(("input", "output"), x, block.value(x), error)
    oscillating = _modes(export)
    if oscillating:
        files[f"{export.name}_modes.csv"] = oscillating
    if not files:
        raise ModelError(f"{export.model.name} has no static curve or mode to write; export it as c99")
    notes = ["Only static curves and modes are written; export the model as c99 to run it."]
    if not any("low" in str(text).partition("\n")[0] for text in files.values()):
        notes.append("They have no bands or intervals, as there is no covariance of these parameters.")
    return files, notes


def _modes(export: Export) -> str:
    """The table of `emsid.modes` of the linear part; empty without any mode."""
    try:
        found = modes(export.model if export.fit is None else export.fit)
    except ModelError:  # it has no linear part
        return ""
    columns = {name: values for name, values in found.columns().items() if not _is_unknown(values)}
    units = {"kind": "", "frequency": " [Hz]", "frequency_low": " [Hz]", "frequency_high": " [Hz]"}
    head = ",".join(f"{name}{units.get(name, ' [1]')}" for name in columns)
    cells = zip(*(values.tolist() for values in columns.values()), strict=True)
    rows = (",".join(each if isinstance(each, str) else _cell(each) for each in row) for row in cells)
    return "\n".join([head, *rows]) + "\n" if len(found) else ""


def _is_unknown(values: NDArray[Any]) -> bool:
    """Whether a column has no known number."""
    return values.dtype.kind == "f" and bool(np.isnan(values).all())


def _cell(value: float) -> str:
    return "" if np.isnan(value) else repr(value)


def _plant_errors(fit: Fit[Any] | None, plant: Any, law: Callable[[Any], Array]) -> Array | None:
    """(n,) the standard errors of a curve of a plant; None for a fit without intervals."""
    if fit is None or not fit.has_bands or not set(fit.names) <= set(plant.handles):
        return None
    rows = []
    for name in fit.names:
        handle, value = plant.handles[name], plant.value(name)
        step = STEP * max(abs(value), STEP)
        low, high = max(value - step, handle.lower), min(value + step, handle.upper)
        rows.append((law(plant.with_values({name: high})) - law(plant.with_values({name: low}))) / (high - low))
    slopes = np.array(rows)
    known = np.isfinite(np.diag(fit.covariance))
    variance = np.einsum("in,ij,jn->n", slopes[known], fit.covariance[np.ix_(known, known)], slopes[known])
    unknown = np.abs(slopes[~known]).sum(axis=0) > 0
    error: Array = np.where(unknown, np.nan, np.sqrt(np.maximum(variance, 0.0)))
    return error


def _table(head: tuple[str, ...], x: Array, y: Array, error: Array | None) -> str:
    """Rows of the curve; edges of its band that are not known are left empty."""
    columns = [x, y] if error is None else [x, y, y - HALF_WIDTH * error, y + HALF_WIDTH * error]
    names = head if error is None else (*head, "low", "high")
    rows = (",".join(map(_cell, row)) for row in np.column_stack(columns).tolist())
    return "\n".join([",".join(names), *rows]) + "\n"
