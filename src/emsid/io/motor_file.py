"""Motors from TOML files, as somebody types them from a datasheet::

[motor]
resistance = "2.1 ohm"
inductance = 1.5e-3        # a number is in SI units

[motor.rotor_friction]
coulomb = "4 mN*m"
"""

from __future__ import annotations

import os
import tomllib
from typing import TYPE_CHECKING

from emsid.errors import FormatError, ModelError
from emsid.io.files import read_bytes

if TYPE_CHECKING:
    from emsid.plant import Motor


def read_motor(path: str | os.PathLike[str]) -> Motor:
    """The motor in the table ``[motor]`` of a TOML file; what the table leaves out keeps its default.

    Raises:
        FormatError: where the file cannot be read, is not TOML or has anything but that table.
        ModelError: where a parameter is unknown or has an impossible value or unit.
    """
    from emsid.plant import Motor

    content = read_bytes(path)
    try:
        document = tomllib.loads(content.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise FormatError(f"{path}: this is not TOML ({problem}); write [motor] and below it name = value") from None
    motor = document.pop("motor", None)
    if not isinstance(motor, dict):
        raise FormatError(f"{path}: there is no table [motor]; put that line above the parameters")
    if document:
        raise FormatError(f"{path}: {', '.join(document)} outside of [motor]; move it into the table or delete it")
    try:
        return Motor.from_dict(motor)
    except ModelError as problem:
        raise ModelError(f"{path}: {problem}") from None
