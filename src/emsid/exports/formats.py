"""The formats of an export. Each is a function in a file of its own, and a line in `FORMATS`.

A format takes an `Export` and returns the contents of its files by name. It raises `ModelError` for a model that it
cannot carry, with what is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple

from emsid.errors import ModelError
from emsid.estimation.fit import Fit
from emsid.models.model import Model

Files = dict[str, str]


@dataclass(frozen=True, eq=False)
class Export:
    """What is exported.

    Attributes:
        model: the model.
        fit: its table of parameters; None for a model alone.
        name: of files and functions.
        dt: sample time in s.
        options: of the format, by name.
    """

    model: Model
    fit: Fit[Any] | None
    name: str
    dt: float | None
    options: Mapping[str, Any] = field(default_factory=dict)


class Format(NamedTuple):
    """A format.

    Attributes:
        summary: what it is, in a few words.
        make: the module and the function that makes its files and the sentences on what it cannot carry.
        options: the options that it has.
    """

    summary: str
    make: tuple[str, str]
    options: tuple[str, ...] = ()

    @property
    def function(self) -> Callable[[Export], tuple[Files, list[str]]]:
        """The function, imported when it is used."""
        module, name = self.make
        found: Callable[[Export], tuple[Files, list[str]]] = getattr(_MODULES[module](), name)
        return found


_MODULES: dict[str, Callable[[], Any]] = {
    "c99": lambda: import_module("emsid.exports.c99"),
    "csv": lambda: import_module("emsid.exports.tables"),
    "mujoco": lambda: import_module("emsid.exports.mujoco"),
    "firmware": lambda: import_module("emsid.exports.firmware"),
    "control": lambda: import_module("emsid.exports.control"),
}

FORMATS: dict[str, Format] = {
    "c99": Format("C99: one header and one source, no heap", ("c99", "c99"), ("single",)),
    "mujoco": Format("MJCF: joint and actuator for MuJoCo", ("mujoco", "mujoco")),
    "python-control": Format("the linear part as a script for python-control", ("control", "control")),
    "csv": Format("friction, dead zone and static maps as tables", ("csv", "csv")),
    "wpilib": Format("kS, kV and kA for WPILib", ("firmware", "wpilib")),
    "odrive": Format("the motor of an ODrive", ("firmware", "odrive"), ("winding", "pole_pairs")),
    "vesc": Format("the motor of a VESC", ("firmware", "vesc"), ("winding", "pole_pairs")),
    "simplefoc": Format("the motor of SimpleFOC", ("firmware", "simplefoc"), ("winding", "pole_pairs")),
}


def format_of(name: str) -> Format:
    """The format of this name.

    Raises:
        ModelError: for an unknown one, with the known ones.
    """
    from emsid.arguments import did_you_mean

    if name not in FORMATS:
        raise ModelError(
            f"no format {name!r}; there are {', '.join(FORMATS)}{did_you_mean(name, FORMATS)}", arguments=("to",)
        )
    return FORMATS[name]
