"""What columns that are neither input nor output may be: a load, a second output, a better sensor, a sign."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from emsid.findings import Finding
from emsid.first_look.columns import FEWEST_LEVELS, Column
from emsid.first_look.levels import PART, SAMPLES
from emsid.first_look.names import ColumnQuantity
from emsid.first_look.responses import ANSWERED, answers
from emsid.first_look.roles import Roles

DERIVED = 0.999
"""The correlation of a speed with the change of a count that it was derived from, at least: rounding leaves less."""


def sign_of_input(columns: Sequence[Column], roles: Roles) -> Finding | None:
    """A finding about an input without a sign: which column has it, or that none has it and the output goes both ways.

    Args:
        columns: of the file, equally long.
        roles: which of them are input and output.
    """
    named = {column.name: column for column in columns}
    u, y = named.get(roles.input), named.get(roles.output)
    if u is None or y is None or not u.low >= 0 or u.constant:
        return None
    two_valued = [each for each in columns if each.distinct == 2 and each not in (u, y)]
    if roles.direction:
        return Finding("direction-column", u.name, {"column": roles.direction, "output": y.name})
    if u.meaning.quantity not in (ColumnQuantity.DUTY, ColumnQuantity.VOLTAGE) or u.low > PART * u.high:
        return None  # pulses and commands about a middle have no sign
    speed = y.movement[np.isfinite(y.movement)]
    forward, backward = (np.percentile(speed, 95), -np.percentile(speed, 5)) if len(speed) else (0.0, 0.0)
    if min(forward, backward) < PART * max(forward, backward) or not min(forward, backward) > 0:
        return None
    return Finding("sign-lost", u.name, {"output": y.name, "candidates": [each.name for each in two_valued]})


def further_channels(columns: Sequence[Column], roles: Roles, file: str) -> Iterable[Finding]:
    """A finding about columns that may be channels too.

    Args:
        columns: of the file, equally long.
        roles: which of them are input and output.
        file: its name.
    """
    named = {column.name: column for column in columns}
    u, y = named.get(roles.input), named.get(roles.output)
    if u is None or y is None or roles.others:
        return
    rest = [each for each in columns if each.kind == "numbers" and not each.constant and each not in (u, y)]
    torques = [each for each in rest if each.meaning.quantity is ColumnQuantity.TORQUE]
    is_electrical = u.meaning.quantity in (ColumnQuantity.VOLTAGE, ColumnQuantity.DUTY)
    loads = [each.name for each in torques if is_electrical and _acts(each, u, y)]
    currents = [each.name for each in rest if is_electrical and each.meaning.quantity is ColumnQuantity.CURRENT]
    is_speed = y.meaning.quantity is ColumnQuantity.SPEED
    counts = [each for each in rest if is_speed and each.meaning.quantity is ColumnQuantity.POSITION]
    sensors = [each.name for each in counts if per_change(y, each)]
    data = {"inputs": loads, "outputs": currents, "positions": sensors}
    if loads or currents or sensors:
        yield Finding("further-channels", file, data)


def _acts(load: Column, u: Column, y: Column) -> bool:
    """Whether a torque acts on the output, and is not computed from the current that drives it."""
    if not len(load.values) == len(y.values) == len(u.values):
        return False
    table = np.column_stack([each.signal for each in (u, load, y)])
    found = answers(table[np.isfinite(table).all(axis=1)], inputs=[0, 1])
    clear = {pair: answer.clear for pair, answer in found.items()}
    return clear.get((1, 2), 0.0) >= ANSWERED > clear.get((0, 1), 0.0)


def per_change(speed: Column, position: Column) -> float:
    """The ratio of a speed to the change of a position from row to row; 0 where the speed is not computed from it."""
    if len(speed.values) != len(position.values) or len(speed.values) < FEWEST_LEVELS:
        return 0.0
    rows = slice(max(len(speed.values) - SAMPLES, 0) // 2, (len(speed.values) + SAMPLES) // 2)
    change, said = np.diff(position.signal[rows]), speed.signal[rows][1:]
    known = np.isfinite(change) & np.isfinite(said)
    if not (known.any() and np.ptp(change[known]) and np.ptp(said[known])):
        return 0.0
    change, said = change[known], said[known]
    return float(change @ said / (change @ change)) if np.corrcoef(change, said)[0, 1] > DERIVED else 0.0
