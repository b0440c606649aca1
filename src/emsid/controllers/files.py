"""The files of a controller: the cascade in C, an Arduino sketch, gains for firmware, and its margins and bench."""

from __future__ import annotations

import os
from collections.abc import Mapping
from math import pi
from pathlib import Path

from emsid.controllers.bench import ControlBench, rows_of
from emsid.controllers.c_source import sketch, sources, units_of
from emsid.controllers.cascade import Settings
from emsid.controllers.loops import INPUTS, controller_of
from emsid.controllers.verb import Controller
from emsid.exports.verb import c_name
from emsid.io.files import indented_json, write_new
from emsid.units import plain_unit

README, JSON = "CONTROL.md", "control.json"


def write(
    found: Controller,
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    force: bool = False,
    more: Mapping[str, str | bytes] | None = None,
) -> list[Path]:
    """Write a controller: ``cascade.c`` and ``.h``, ``NAME_gains.h``, ``NAME.ino``, ``NAME_control.py`` and its texts.

    Args:
        found: the controller.
        path: folder.
        name: of the gains in C; by default that of the model.
        force: whether files that exist are replaced.
        more: further files.

    Returns:
        The files that were written.

    Raises:
        ModelError: for a name that C cannot hold.
        FormatError: where files exist or cannot be written.
    """
    called = c_name(name or found.name)
    way = "m" if found.linear else "rad"
    files: dict[str, str | bytes] = {
        **sources(found.settings, called, found.unit, way),
        f"{called}.ino": sketch(found.settings, called, way, found.resolution),
        f"{called}_control.py": script(found, called),
        README: readme(found, called),
        JSON: indented_json({"schema": 1, **found.to_data()}),
        **(more or {}),
    }
    return write_new(files, path, force=force)


SCRIPT = """\
# Made by emsid: the linear part of the cascade of NAME, without limits, friction and dead zone.
import control
import numpy as np

NAME = control.ss(
    np.array(A),
    np.array(B),
    np.array([C]),
    np.array([D]),
    DT,
    inputs=INPUTS,
    outputs=["command"],
)  # command in UNIT
"""


def script(found: Controller, name: str) -> str:
    """The linear part of the cascade as a script that makes the system ``NAME`` of python-control."""
    text = SCRIPT.replace("NAME", name).replace("INPUTS", repr(list(INPUTS))).replace("DT", repr(found.settings.dt))
    for key, each in zip("ABCD", controller_of(found.settings), strict=True):
        text = text.replace(f"({key})", f"({each.tolist()!r})").replace(f"[{key}]", f"[{each.tolist()!r}]")
    return text.replace("UNIT", plain_unit(found.unit))


def readme(found: Controller, name: str) -> str:
    """What the loops are, their margins, the bench, and the gains for firmware."""
    s, way = found.settings, "m" if found.linear else "rad"
    units = units_of(plain_unit(found.unit), way)
    lines = [f"# {name}: cascade", "", *summary(found), "", "## Gains", "", "| gain | value | unit |", "|---|---|---|"]
    shown = [
        name for name in units if name not in ("friction", "waves") and (s.current_dt > 0 or "current" not in name)
    ]
    lines += [f"| {row} | {_number(getattr(s, row))} | {units[row] or '–'} |" for row in shown]
    for firmware, rows in found.firmware.items():
        lines += ["", f"## {firmware}", "", "| setting | value | unit |", "|---|---|---|"]
        lines += [f"| {row} | {value:.6g} | {unit or '–'} |" for row, value, unit in rows]
    if "ODrive" in found.firmware:
        lines += [
            "",
            "All gains are on the side of the motor, of a PI controller without a load observer. Those of ODrive and "
            "VESC command a current: they are for the motor without the braking of its back EMF, at the same sample "
            "time and delay. Resistance, constant and voltage are those of the record: of a brushless motor they must "
            "be those of the q axis.",
        ]
    lines += ["", "## Bench", "", f"RMS error of the true {found.bench.motion[0]} in {found.bench.motion[1]}.", ""]
    lines += bench_lines(found.bench)
    lines += [
        "",
        "## On the target",
        "",
        "```c",
        f'#include "{name}_gains.h"',
        "",
        "static cascade_state state;  /* cascade_reset(&state) once, with the drive at rest */",
        "",
        f"/* every {s.dt:g} s */",
        f"command = cascade_step(&{name}_gains, &state, position, wanted, speed, acceleration);",
        "```",
        "",
        "The first steps: limit the command (`limit`) to a tenth, move by hand and see that the position counts in the "
        "direction in which a positive command moves it, hold, then raise the limit. `speed` and `acceleration` are "
        "the derivatives of `wanted`; without them there is no feed-forward and no compensation of friction.",
        "",
    ]
    return "\n".join(lines)


def _number(value: float | tuple[float, ...]) -> str:
    return ", ".join(f"{each:.6g}" for each in (value if isinstance(value, tuple) else (value,)))


def bench_lines(bench: ControlBench) -> list[str]:
    """The table of a bench in Markdown."""
    header, rows = rows_of(bench)
    return [f"| {' | '.join(row)} |" for row in (header, ("---",) * len(header), *rows)]


def summary(found: Controller) -> list[str]:
    """Bandwidth, margins and how they were reached, a sentence each."""
    what = "position" if found.settings.position > 0 else "speed"
    m = found.margins
    region = f"{found.draws} points of the 95 % region of the estimates, each with " if found.draws else ""
    over = f"over {region}friction 30 % lower and higher"
    lines = [
        f"The {what} loop has a bandwidth of {found.bandwidth:.3g} Hz at a sample time of {found.settings.dt:g} s and "
        f"a delay of {found.delay:.4g} s.",
        f"The worst {over}: gain margin {m.gain:.2f}, phase margin {m.phase:.1f}°, sensitivity peak "
        f"{m.sensitivity:.2f}, overshoot of a step {100 * found.overshoot:.1f} %.",
    ]
    lines.append(
        "A load observer on the model takes the place of an integral; it learns the load of each direction by "
        "itself, so that friction that differs from the model is known at a reversal."
    )
    if found.plants.mode is not None and found.settings.notch != Settings.notch:
        frequency = found.plants.mode[0] / (2 * pi)
        lines.append(f"A notch filter is at the flexible mode of {frequency:.3g} Hz.")
    if not found.draws:
        lines.append("The model has no intervals, so that the margins do not contain errors of its estimates.")
    if found.reduced and found.wanted_bandwidth is not None:
        lines.append(
            f"{found.wanted_bandwidth:g} Hz were wanted; the bandwidth is reduced to {found.bandwidth:.3g} Hz, so that "
            "the margins hold."
        )
    elif found.reduced:
        lines.append(
            f"At the estimate alone {found.nominal_bandwidth:.3g} Hz would keep the margins; the bandwidth is reduced, "
            "so that they hold everywhere in the region."
        )
    if found.current_margins is not None:
        c = found.current_margins
        lines.append(
            f"The current loop, every {found.settings.current_dt:g} s, has a bandwidth of about "
            f"{1 / (2 * pi * found.plants.lag):.3g} Hz, a gain margin of {c.gain:.2f} and a phase margin of "
            f"{c.phase:.1f}°."
        )
    return lines
