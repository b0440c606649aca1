"""The pages of a controller and of a compensation: margins and Bode plots, the inverse, and the runs of the bench."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from emsid.compensation import Compensation, MapInverse, RippleCompensation
from emsid.controllers import Controller
from emsid.controllers.bench import AS_IS, BARE, CASCADE, REFERENCES, SIMC, ControlBench, rows_of
from emsid.controllers.files import summary
from emsid.report.document import Axis, Band, Dash, Figure, Ink, Level, Line, Mark, Plot, Report, Section, Stroke, Table
from emsid.report.views.conventions import TIME
from emsid.units import plain_unit
from emsid.wording.lists import listed
from emsid.wording.study import smaller

INKS = {SIMC: Ink.ORANGE, BARE: Ink.GREY, CASCADE: Ink.BLUE}
"""What is drawn of the bench, the cascade on top."""


def control_report(found: Controller) -> Report:
    """The page of a controller."""
    return Report(
        title=f"Control of {found.name}",
        summary=tuple(summary(found)),
        opening=Section("", figures=(bode_figure(found),)),
        sections=_bench_sections(found.bench, REFERENCES),
        imprint="emsid control",
    )


def compensation_report(found: Compensation | MapInverse | RippleCompensation, bench: ControlBench | None) -> Report:
    """The page of a compensation: what it gains at a reversal, the runs of the bench, and the inverse itself.

    Args:
        found: the inverse of a plant, of a static map or of a torque over the angle.
        bench: that of a plant of one mass.
    """
    sections = tuple[Section, ...]()
    if isinstance(found, RippleCompensation):
        gain, opening = [ripple_gain(found)], ripple_figure(found)
    elif bench is None:
        gain, opening = ["The inverse of the static map, over its values."], inverse_figure(found)
    else:
        gain, opening = gain_at_reversal(bench), bench_figure(bench, "reversal", name="compensation")
        others = [each for each in REFERENCES if each != "reversal"]
        sections = (Section("Inverse", figures=(inverse_figure(found, bench),)), *_bench_sections(bench, others))
    return Report(
        title=f"Compensation of {found.name}",
        summary=tuple(gain),
        opening=Section("", figures=(opening,)),
        sections=sections,
        imprint="emsid compensate",
    )


def ripple_gain(found: RippleCompensation) -> str:
    """What a torque over the angle has, and what cancels it, in a sentence."""
    table = found.table(TURN)
    torque, current = (float(np.ptp(table[:, k])) for k in (1, 3))
    return (
        f"A q-current of {current:.3g} A peak to peak cancels the cogging of {torque:.3g} N·m peak to peak; the ripple "
        f"by current is {100 * float(np.ptp(found.part(table[:, 0]))):.2g} % peak to peak."
    )


TURN = 3600
"""Points of a turn in the figure: ten for a period of the highest harmonic."""


def ripple_figure(found: RippleCompensation) -> Figure:
    """Cogging over the angle, and the ripple of the torque by current."""
    table, at = found.table(TURN), Axis("Angle", "rad")
    plots = [Plot((Line(table[:, 0], table[:, 1]),), at, Axis("Cogging torque", "N*m"))]
    if len(found.ripple):
        plots.append(Plot((Line(table[:, 0], 100 * found.part(table[:, 0])),), at, Axis("Ripple by current", "%")))
    return Figure("torque-ripple", f"The torque of {found.name} over the angle of its shaft.", tuple(plots))


def gain_at_reversal(bench: ControlBench) -> list[str]:
    """What the compensation makes of the error at a reversal, for every plant of the bench."""
    ratios = {
        plant: bench.runs[BARE, "reversal", plant].error / run.error
        for (name, reference, plant), run in bench.runs.items()
        if (name, reference) == (CASCADE, "reversal")
    }
    others = [f"{smaller(ratio)} with {plant}" for plant, ratio in ratios.items() if plant != AS_IS]
    known = f"On the bench, the error at a reversal is {smaller(ratios[AS_IS])} with the compensation than without it."
    if not others:  # nothing that can be off
        return [known]
    return [known, f"That is with friction and dead zone as identified. It is {listed(others)}."]


def inverse_figure(found: Compensation | MapInverse, bench: ControlBench | None = None) -> Figure:
    """The inverse of the dead zone and the friction that is fed forward, or the inverse of a static map."""
    if isinstance(found, MapInverse) or bench is None:
        outputs, inputs, _ = found.table(400)  # type: ignore[union-attr]
        plot = Plot((Line(outputs, inputs),), Axis("Wanted output of the map"), Axis("Input of the map"), height=1.4)
        return Figure("inverse", f"The inverse of the static map of {found.name}.", (plot,))
    way, unit = ("m", "N") if found.name == "linear-axis" else ("rad", "N*m")
    command = plain_unit(bench.command_unit)
    edge = max(3 * abs(float(found.dead_zone_inverse(1e-9))), 0.1 * bench.limit)
    wanted, speed = np.linspace(-edge, edge, 1001), np.linspace(-bench.speed, bench.speed, 1001)
    plots = (
        Plot(
            (Line(wanted, found.dead_zone_inverse(wanted)),),
            Axis("Wanted behind the dead zone", command),
            Axis("Before the dead zone", command),
        ),
        Plot(
            (Line(speed, found.friction_force(speed)),),
            Axis("Reference speed", f"{way}/s"),
            Axis("Friction that is compensated", unit),
        ),
    )
    return Figure("inverse", f"What the compensation of {found.name} puts before the plant.", plots, columns=2)


def _bench_sections(bench: ControlBench, references: Sequence[str]) -> tuple[Section, ...]:
    """The table of a bench, and its runs over some references."""
    header, rows = rows_of(bench)
    quantity, unit = bench.motion
    table = Table(header, tuple(rows), caption=f"RMS error of the true {quantity} in {unit}", text_columns=2)
    return (
        Section("Bench", tables=(table,)),
        *(Section(f"Bench: {each}", figures=(bench_figure(bench, each),)) for each in references),
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


def bench_figure(bench: ControlBench, reference: str, name: str = "") -> Figure:
    """Motion, error and command on the bench for a reference.

    Args:
        bench: with its runs.
        reference: of `REFERENCES`.
        name: of the figure; by default that of the reference.
    """
    quantity, unit = bench.motion
    runs = {(name, plant): run for (name, each, plant), run in bench.runs.items() if each == reference}
    first = runs[CASCADE, AS_IS]
    motion: list[Mark] = [Line(first.time, first.reference, "reference", Stroke(Ink.BLACK, Dash.DASHED, 0.8))]
    every = [run.reference - run.actual for (name, _), run in runs.items() if name == CASCADE]
    errors: list[Mark] = [Band(first.time, np.min(every, axis=0), np.max(every, axis=0), "cascade, all plants")]
    commands: list[Mark] = []
    for controller, ink in INKS.items():
        if (controller, AS_IS) in runs:
            run = runs[controller, AS_IS]
            motion.append(Line(run.time, run.actual, controller, Stroke(ink)))
            errors.append(Line(run.time, run.reference - run.actual, controller, Stroke(ink)))
            commands.append(Line(run.time, run.command, controller, Stroke(ink), stairs=True))
    plots = (
        Plot(tuple(motion), TIME, Axis(f"{quantity.capitalize()}, {reference}", unit)),
        Plot(tuple(errors), TIME, Axis("Error", unit)),
        Plot(tuple(commands), TIME, Axis("Command", plain_unit(bench.command_unit))),
    )
    caption = (
        f"{reference.capitalize()} on the bench, as identified; the band is the error of the cascade with "
        f"{' and '.join(bench.wrong)} 30 % lower and higher{' and with backlash' if bench.backlash > 0 else ''}."
    )
    return Figure(name or f"bench-{reference}", caption, plots, shared_x=True)
