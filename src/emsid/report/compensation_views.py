"""The figure of a compensation on the virtual bench."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emsid.compensation.bench import Run, Trial
from emsid.report.document import Axis, Dash, Figure, Ink, Line, Mark, Plot, Stroke
from emsid.report.views.timeline import TIME


def compensation_figure(trial: Trial, speed_unit: str, command_unit: str) -> Figure:
    """Speed and command of the PI loop with and without the compensation: the slow sine, then the small steps.

    Args:
        trial: the runs.
        speed_unit: of the speed.
        command_unit: of the command.
    """
    plots = []
    for name, what in (("sine", "slow sine"), ("steps", "small steps")):
        before, after, wrong = trial.before[name], trial.after[name], trial.worst(name)
        time = np.arange(len(before.reference), dtype=np.float64) * trial.dt
        shown = slice(len(time) // 4, len(time) * 3 // 4) if name == "sine" else slice(None)

        def line(run: Run, label: str, ink: Ink, of: str, at: slice, time: NDArray[np.float64] = time) -> Line:
            return Line(time[at], getattr(run, of)[at], label, Stroke(ink), stairs=of == "command")

        marks: list[Mark] = [
            Line(time[shown], before.reference[shown], "reference", Stroke(Ink.BLACK, Dash.DASHED, 0.8)),
            line(before, "PI alone", Ink.ORANGE, "speed", shown),
            line(wrong, "compensated, parameters 20 % off (worst)", Ink.GREY, "speed", shown),
            line(after, "compensated", Ink.BLUE, "speed", shown),
        ]
        plots.append(Plot(tuple(marks), TIME, Axis(f"Speed, {what}", speed_unit)))
        plots.append(
            Plot(
                (
                    line(before, "PI alone", Ink.ORANGE, "command", shown),
                    line(after, "compensated", Ink.BLUE, "command", shown),
                ),
                TIME,
                Axis("Command", command_unit),
            )
        )
    caption = (
        f"A plain PI loop with encoder, a delay of {trial.setting.delay} samples and a limit of "
        f"{trial.setting.limit:.3g}, on the model's own plant. Error in the reversals of the sine: "
        f"{trial.before['sine'].rmse:.3g} without and {trial.after['sine'].rmse:.3g} with the compensation."
    )
    return Figure("compensation", caption, tuple(plots), shared_x=False)
