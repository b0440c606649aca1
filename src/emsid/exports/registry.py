"""The formats of an export, by name."""

from __future__ import annotations

from emsid.arguments import did_you_mean
from emsid.errors import ModelError
from emsid.exports.arduino import arduino
from emsid.exports.c99 import c99
from emsid.exports.control import control
from emsid.exports.firmware import moteus, odrive, simplefoc, vesc, wpilib
from emsid.exports.fixed_point import fixed_point
from emsid.exports.fmu import fmu
from emsid.exports.formats import Format
from emsid.exports.matlab import matlab
from emsid.exports.modelica import modelica
from emsid.exports.mujoco import mujoco
from emsid.exports.robots import isaac_lab, mjlab
from emsid.exports.tables import csv

BRUSHLESS = ("winding", "pole_pairs", "bandwidth", "current_dt")

FORMATS: dict[str, Format] = {
    "c99": Format("C99: one header and one source, no heap", c99, ("single", "recursive")),
    "fixed-point": Format("a regression in C with whole numbers only", fixed_point, ("bits", "largest")),
    "arduino": Format("a library for Arduino and PlatformIO, with a sketch", arduino),
    "fmu": Format("co-simulation for any importer of FMI 3.0 or 2.0", fmu, ("version",), True),
    "matlab": Format("a function of a step, and the linear parts as a MAT file", matlab),
    "modelica": Format("a plant of one mass as a Modelica model", modelica, physical=True),
    "mujoco": Format("MJCF: joint and actuator for MuJoCo", mujoco, ("actuator",), True),
    "isaac-lab": Format("the actuator of a joint for Isaac Lab", isaac_lab, ("timestep", "joint"), True),
    "mjlab": Format("the actuator of a joint for mjlab", mjlab, ("timestep", "joint"), True),
    "python-control": Format("the linear part as a script for python-control", control),
    "csv": Format("friction, dead zone, cogging, static maps and modes as tables", csv, physical=True),
    "wpilib": Format("kS, kG, kV and kA for WPILib", wpilib),
    "odrive": Format("the motor of an ODrive", odrive, BRUSHLESS, True),
    "vesc": Format("the motor of a VESC", vesc, BRUSHLESS, True),
    "moteus": Format("the motor of a moteus", moteus, BRUSHLESS, True),
    "simplefoc": Format("the motor of SimpleFOC", simplefoc, BRUSHLESS, True),
}


def format_of(name: str) -> Format:
    """The format of this name.

    Raises:
        ModelError: for an unknown one, with the known ones.
    """
    if name not in FORMATS:
        raise ModelError(
            f"no format {name!r}; there are {', '.join(FORMATS)}{did_you_mean(name, FORMATS)}", arguments=("to",)
        )
    return FORMATS[name]
