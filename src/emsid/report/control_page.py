"""The page of a controller: its margins, Bode plots with their bands, and the runs of the bench."""

from __future__ import annotations

import numpy as np

from emsid.controllers import Controller
from emsid.controllers.bench import BARE, CASCADE, SIMC
from emsid.controllers.files import summary
from emsid.report.document import Axis, Band, Dash, Figure, Ink, Level, Line, Mark, Plot, Report, Section, Stroke, Table
from emsid.report.views.timeline import TIME

INKS = {CASCADE: Ink.BLUE, BARE: Ink.GREY, SIMC: Ink.ORANGE}
"""What is drawn of the bench."""


def control_report(found: Controller) -> Report:
    """The page of a controller."""
    lines = summary(found)
    bench = found.bench
    plants = list(dict.fromkeys(plant for _, _, plant in bench.runs))
    rows = []
    for controller, reference in dict.fromkeys((each[0], each[1]) for each in bench.runs):
        runs = [bench.runs[controller, reference, plant] for plant in plants]
        changes = max(run.changes for run in runs)
        overshoot = max(run.overshoot for run in runs)
        rows.append(
            (
                controller,
                reference,
                *(f"{run.error:.3g}" for run in runs),
                "" if np.isnan(overshoot) else f"{100 * overshoot:.1f} %",
                "" if np.isnan(changes) else f"{changes:.3g}",
            )
        )
    header = ("controller", "reference", *plants, "overshoot", "changes of sign per s")
    return Report(
        title=f"Control of {found.name}",
        summary=tuple(lines),
        sections=(
            Section("LoopResponses", figures=(bode_figure(found),)),
            Section(
                "ControlBench",
                tables=(Table(header, tuple(rows), caption="RMS error of the true motion", text_columns=2),),
            ),
            *(
                Section(f"Bench: {reference}", figures=(bench_figure(found, reference),))
                for reference in ("step", "sine", "reversal", "hold")
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
    phase -= 360 * np.round((phase[:, :1] - phase[:1, :1]) / 360)
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


def bench_figure(found: Controller, reference: str) -> Figure:
    """A reference on the bench: motion, error and command, with friction as identified and 30 % off."""
    unit = ("m" if found.linear else "rad") + ("" if found.settings.position > 0 else "/s")
    quantity = "Position" if found.settings.position > 0 else "Speed"
    runs = found.bench.runs
    first = runs[CASCADE, reference, "friction × 1"]
    motion: list[Mark] = [Line(first.time, first.reference, "reference", Stroke(Ink.BLACK, Dash.DASHED, 0.8))]
    errors: list[Mark] = []
    commands: list[Mark] = []
    others = [
        runs[CASCADE, reference, plant].reference - runs[CASCADE, reference, plant].actual
        for plant in dict.fromkeys(each[2] for each in runs)
    ]
    errors.append(Band(first.time, np.min(others, axis=0), np.max(others, axis=0), "cascade, all plants", Ink.BLUE))
    for name, ink in INKS.items():
        run = runs[name, reference, "friction × 1"]
        motion.append(Line(run.time, run.actual, name, Stroke(ink)))
        errors.append(Line(run.time, run.reference - run.actual, name, Stroke(ink)))
        commands.append(Line(run.time, run.command, name, Stroke(ink, width=0.8), stairs=True))
    plots = (
        Plot(tuple(motion), TIME, Axis(quantity, unit)),
        Plot(tuple(errors), TIME, Axis("Error", unit)),
        Plot(tuple(commands), TIME, Axis("Command")),
    )
    return Figure(
        f"bench-{reference}",
        f"{reference.capitalize()} on the bench, with friction as identified; the band is the error of the cascade "
        "with friction 30 % lower and higher and with backlash.",
        plots,
        shared_x=True,
    )
