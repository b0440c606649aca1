"""The page of a controller: its margins, Bode plots with their bands, and the runs of the bench."""

from __future__ import annotations

import numpy as np

from emsid.controllers import Controller
from emsid.controllers.bench import AS_IS, BARE, CASCADE, REFERENCES, SIMC, ControlBench, rows_of
from emsid.controllers.files import summary
from emsid.report.document import Axis, Band, Dash, Figure, Ink, Level, Line, Mark, Plot, Report, Section, Stroke, Table
from emsid.report.views.conventions import TIME
from emsid.units import plain_unit

INKS = {SIMC: Ink.ORANGE, BARE: Ink.GREY, CASCADE: Ink.BLUE}
"""What is drawn of the bench, the cascade on top."""


def control_report(found: Controller) -> Report:
    """The page of a controller."""
    lines = summary(found)
    header, rows = rows_of(found.bench)
    quantity, unit = found.bench.motion
    return Report(
        title=f"Control of {found.name}",
        summary=tuple(lines),
        sections=(
            Section("Margins", figures=(bode_figure(found),)),
            Section(
                "Bench",
                tables=(
                    Table(header, tuple(rows), caption=f"RMS error of the true {quantity} in {unit}", text_columns=2),
                ),
            ),
            *(
                Section(f"Bench: {reference}", figures=(bench_figure(found.bench, reference),))
                for reference in REFERENCES
            ),
        ),
        imprint="emsid control",
    )


def bode_figure(found: Controller) -> Figure:
    """Gain and phase of the whole loop, its distance from −1, and the closed loop, as bands over the plants."""
    loops = found.loops
    f = loops.w / (2 * np.pi)
    axis = Axis("Frequency", "Hz", log=True)

    def plot(values: np.ndarray[tuple[int, int], np.dtype[np.float64]], y: Axis, *more: Mark) -> Plot:
        band = Band(f, values.min(axis=0), values.max(axis=0), "over the region")
        return Plot((band, Line(f, values[0], "at the estimate", Stroke(Ink.BLUE)), *more), axis, y)

    size = np.abs(loops.whole)
    phase = np.degrees(np.unwrap(np.angle(loops.whole), axis=1))
    phase -= 360 * np.ceil(phase[:, [np.argmin(np.abs(np.log(size[0])))]] / 360)  # from −360° to 0 where the gain is 1
    plots = (
        plot(20 * np.log10(size), Axis("Gain of the loop", "dB"), Level(0.0)),
        plot(phase, Axis("Phase of the loop", "°"), Level(-180.0)),
        plot(np.abs(1 + loops.whole), Axis("Distance from −1", "1", log=True), Level(0.5, "sensitivity 2")),
        plot(20 * np.log10(np.abs(loops.closed)), Axis("Closed loop", "dB"), Level(-3.0, "−3 dB")),
    )
    caption = (
        "The loop opened at the command of the plant, its distance from the critical point −1 (the least is the "
        f"inverse of the sensitivity peak), and the closed loop; bands over {len(found.plants.mass)} plants."
    )
    return Figure("bode", caption, plots, columns=2, shared_x=True)


def bench_figure(bench: ControlBench, *references: str, name: str = "") -> Figure:
    """Motion, error and command on the bench for some references.

    Args:
        bench: with its runs.
        references: of `REFERENCES`.
        name: of the figure; by default that of the reference.
    """
    quantity, unit = bench.motion
    plots = []
    for reference in references:
        runs = {(name, plant): run for (name, each, plant), run in bench.runs.items() if each == reference}
        first = runs[CASCADE, AS_IS]
        motion: list[Mark] = [Line(first.time, first.reference, "reference", Stroke(Ink.BLACK, Dash.DASHED, 0.8))]
        every = [run.reference - run.actual for (name, _), run in runs.items() if name == CASCADE]
        errors: list[Mark] = [Band(first.time, np.min(every, axis=0), np.max(every, axis=0), "cascade, all plants")]
        commands: list[Mark] = []
        for name_, ink in INKS.items():
            if (name_, AS_IS) in runs:
                run = runs[name_, AS_IS]
                motion.append(Line(run.time, run.actual, name_, Stroke(ink)))
                errors.append(Line(run.time, run.reference - run.actual, name_, Stroke(ink)))
                commands.append(Line(run.time, run.command, name_, Stroke(ink), stairs=True))
        plots += [
            Plot(tuple(motion), TIME, Axis(f"{quantity.capitalize()}, {reference}", unit)),
            Plot(tuple(errors), TIME, Axis("Error", unit)),
            Plot(tuple(commands), TIME, Axis("Command", plain_unit(bench.command_unit))),
        ]
    wrong = " and ".join(bench.wrong)
    caption = (
        f"{' and '.join(references).capitalize()} on the bench, as identified; the band is the error of the cascade "
        f"with {wrong} 30 % lower and higher{' and with backlash' if bench.backlash > 0 else ''}."
    )
    return Figure(name or f"bench-{references[0]}", caption, tuple(plots), shared_x=len(references) == 1)
