"""Motors and datasheets in TOML files.

A motor, for simulations::

    [motor]
    resistance = "2.1 ohm"
    inductance = 1.5e-3        # a number is in SI units

    [motor.rotor_friction]
    coulomb = "4 mN*m"

A datasheet, for an estimation, also has tolerances; for an axis, the table is ``[linear-axis]``::

    [motor]
    resistance = { value = "2.1 ohm", tolerance = "10 %" }    # within it
    motor_constant = "50 mV*s"                                # where the search starts
    rotor_inertia = "unknown"                                 # is estimated
    drive.supply = "24 V"

    [motor.rotor_friction]
    coulomb = ["4 mN*m", "5 mN*m"]                            # forward, backward
"""

from __future__ import annotations

import os
import tomllib
from typing import TYPE_CHECKING, Any

from emsid.errors import FormatError, ModelError
from emsid.io.files import read_bytes
from emsid.io.limits import check_limits

if TYPE_CHECKING:
    from emsid.models.plants.datasheet import Given
    from emsid.plant import Motor


def read_motor(path: str | os.PathLike[str]) -> Motor:
    """The motor in the table ``[motor]`` of a TOML file; what the table leaves out keeps its default.

    Raises:
        FormatError: where the file cannot be read, is not TOML or has anything but that table.
        ModelError: where a parameter is unknown or has an impossible value or unit.
    """
    from emsid.plant import Motor

    _, motor = _one_table(path, ("motor",))
    try:
        return Motor.from_dict(motor)
    except ModelError as problem:
        raise ModelError(f"{path}: {problem}") from None


def read_datasheet(path: str | os.PathLike[str]) -> dict[str, Given]:
    """Read the table ``[motor]`` or ``[linear-axis]`` of a TOML file: known values of a plant, by name of parameter.

    Raises:
        FormatError: where the file cannot be read, is not TOML or has anything but one such table.
        ModelError: for a parameter that the plant does not have, a value in another unit or beyond what is physical,
            a tolerance without value, a parameter given twice.
    """
    from emsid.models.plants.datasheet import datasheet
    from emsid.models.plants.registry import described

    kind, table = _one_table(path, tuple(described()))
    try:
        return datasheet(kind, table)
    except ModelError as problem:
        raise ModelError(f"{path}: {problem}") from None


def motor_template() -> str:
    """The built-in motor as a TOML file that `read_motor` reads, every parameter with its unit and meaning."""
    from emsid.plant import Motor

    lines = [
        "# A motor to simulate. A number is in SI units, a text has a unit, a pair of a friction is",
        "# [forward, backward]. What is left out keeps the value it has here.",
        "[motor]",
    ]
    for name, symbol, unit, description in Motor.parameters():
        value: Any = Motor()
        for part in name.split("."):
            value = getattr(value, part, None)
        if value is None:  # a part that the motor does not have
            value = 1.0 if unit == "1" else 0.0
            name = f"# {name}"
        number = value[0] if isinstance(value, tuple) else value
        entry = f"{name} = {number:g}" if unit == "1" else f'{name} = "{number:g} {unit}"'
        lines.append(f"{entry:<44} # {symbol}: {description}")
    return "\n".join(lines)


def datasheet_template(kind: str) -> str:
    """A template for `read_datasheet` with every parameter of a kind of plant, all of them unknown.

    Args:
        kind: a name of `emsid.models.plants.registry.described`.
    """
    from emsid.models.plants.datasheet import UNKNOWN
    from emsid.models.plants.registry import described

    lines = [
        f"# Datasheet of a {kind}, for an identification.",
        "# A friction has two directions, NAME.forward and NAME.backward; NAME is both.",
        "# Remove the # before a parameter that you know something about, and write",
        '#     "2.1 ohm"                                    where the search starts (a number is in SI units)',
        '#     { value = "2.1 ohm", tolerance = "10 %" }    start and tolerance',
        f'#     "{UNKNOWN}"                                    that it is to be estimated',
        f"[{kind}]",
    ]
    for name, handle in described()[kind].handles.items():
        if name.endswith((".forward", ".backward")):
            continue
        entry = f'{name} = "{UNKNOWN}"'
        unit = "no unit" if handle.parameter.unit == "1" else handle.parameter.unit
        lines.append(f"# {entry:<44} # {unit}: {handle.parameter.description}")
    return "\n".join(lines)


def _one_table(path: str | os.PathLike[str], names: tuple[str, ...]) -> tuple[str, dict[str, Any]]:
    """The only table of a TOML file, with its name."""
    content = read_bytes(path, "write the parameters into it")
    wanted = " or ".join(f"[{name}]" for name in names)
    try:
        document = tomllib.loads(content.decode())
    except (ValueError, RecursionError) as problem:
        raise FormatError(f"{path}: this is not TOML ({problem}); write {wanted} and below it name = value") from None
    try:
        check_limits(document, most={})
    except ModelError as problem:
        raise FormatError(f"{path}: {problem}") from None
    found = [name for name in names if isinstance(document.get(name), dict)]
    if not found:
        raise FormatError(f"{path}: there is no table {wanted}; put that line above the parameters")
    name = found[0]
    table = document.pop(name)
    if document:
        raise FormatError(f"{path}: {', '.join(document)} outside of [{name}]; move it into the table or delete it")
    return name, table
