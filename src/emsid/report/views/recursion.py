"""Plots of recursive estimates over time."""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from emsid.errors import DataError
from emsid.report.document import Axis, Dash, Figure, Ink, Level, Line, Mark, Plot, Stroke

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit

Array = NDArray[np.float64]


_INKS = (Ink.BLUE, Ink.RED, Ink.GREEN, Ink.ORANGE, Ink.PURPLE, Ink.NAVY, Ink.GREY, Ink.BLACK)


def convergence(fit: Fit[Any], batch: Fit[Any] | None = None, *, name: str = "convergence") -> Figure:
    """Recursive estimates from the first sample to the last, with the batch estimates dashed.

    Parameters whose names have the same beginning share a plot. It shows the range of their later values.

    Args:
        fit: with its ``history``.
        batch: the same structure by batch least squares.
        name: of the figure.

    Raises:
        DataError: where the fit has no history.
    """
    if fit.history is None or not len(fit.history):
        raise DataError(f"{fit.model.name}: the fit has no history of its estimates; fit with history=True")
    steps = len(fit.history)
    shown = np.unique(np.geomspace(1, steps, min(steps, 1500)).round().astype(int)) - 1
    groups: dict[str, list[int]] = {}
    for k, parameter in enumerate(fit.names):
        groups.setdefault(parameter.rstrip("0123456789_"), []).append(k)
    plots = []
    for row, members in enumerate(groups.values()):
        drawn = members[: len(_INKS)]
        marks: list[Mark] = []
        for k, ink in zip(drawn, cycle(_INKS), strict=False):
            label = fit.names[k] if len(members) > 1 else ""
            marks.append(Line(shown + 1.0, fit.history[shown, k], label, Stroke(ink)))
            if batch is not None:
                marks.append(Level(float(batch.estimate[k]), stroke=Stroke(ink, Dash.DASHED, 0.8)))
        ends = fit.history[-1, drawn] if batch is None else np.append(fit.history[-1, drawn], batch.estimate[drawn])
        left_out = f" (and {len(members) - len(drawn)} more)" if len(members) > len(drawn) else ""
        first, last = fit.names[members[0]], fit.names[members[-1]]
        plots.append(
            Plot(
                tuple(marks),
                Axis("Sample", "1", log=True),
                Axis("Estimate", "SI", range=settled_range(fit.history[:, drawn], ends)),
                first if len(members) == 1 else f"{first} … {last}{left_out}",
                span=2 if row % 2 == 0 and row == len(groups) - 1 > 0 else 1,  # the last one, alone in its row
            )
        )
    dashed = "; dashed: batch least squares" if batch is not None else ""
    return Figure(
        name,
        f"Recursive estimates of {fit.model.name} over the samples{dashed}. The unit of each is the unit of the output "
        "divided by that of its regressor.",
        tuple(plots),
        columns=min(len(plots), 2),
        shared_x=True,
    )


def settled_range(history: Array, values: Array) -> tuple[float, float]:
    """The range of the last nine tenths of estimates (N, …) without outliers, and of further values, with a margin."""
    late = history[len(history) // 10 :]
    shown = np.append(np.quantile(late, (0.005, 0.995), axis=0), values)
    low, high = float(shown.min()), float(shown.max())
    room = 0.25 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room
