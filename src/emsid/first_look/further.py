"""What columns that are neither input nor output may be: a load, a second output, a better sensor, a lost sign."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from emsid.findings import Finding
from emsid.first_look.columns import Column
from emsid.first_look.dynamics import influence
from emsid.first_look.names import ColumnQuantity
from emsid.first_look.roles import Roles

BOTH_WAYS = 0.1
"""An output goes both ways where its larger and its smaller direction have at least this share of the largest speed."""
DERIVED = 0.999
"""The correlation of a speed with the change of a count that it was derived from, at least: rounding leaves less."""
ACTS = 0.02
"""A load removes at least this share of the error with which the past of input and output predicts the output."""


def sign_lost(columns: Sequence[Column], roles: Roles) -> Iterable[Finding]:
    """A finding where a duty or voltage is never negative although the output goes both ways.

    Args:
        columns: of the file, equally long.
        roles: which of them are input and output.
    """
    named = {column.name: column for column in columns}
    u, y = named.get(roles.input), named.get(roles.output)
    if u is None or y is None or not u.low >= 0 or u.constant:
        return
    if u.meaning.quantity not in (ColumnQuantity.DUTY, ColumnQuantity.VOLTAGE) or u.low > BOTH_WAYS * u.high:
        return  # pulses and commands about a middle have no sign
    speed = np.diff(y.signal) if y.meaning.quantity is ColumnQuantity.POSITION else y.signal
    speed = speed[np.isfinite(speed)]
    if not len(speed):
        return
    forward, backward = np.percentile(speed, 95), -np.percentile(speed, 5)
    if min(forward, backward) < BOTH_WAYS * max(forward, backward) or not min(forward, backward) > 0:
        return
    candidates = [each.name for each in columns if each.distinct == 2 and each.name not in (u.name, y.name)]
    yield Finding("sign-lost", u.name, {"output": y.name, "candidates": candidates})


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
    sensors = [each.name for each in counts if _is_derived(y, each)]
    data = {"inputs": loads, "outputs": currents, "positions": sensors}
    if loads or currents or sensors:
        yield Finding("further-channels", file, data)


def _acts(load: Column, u: Column, y: Column) -> bool:
    """Whether a torque acts on the output, and is not computed from the current that drives it."""
    return len(load.values) == len(y.values) and influence(load.signal, y.signal) > ACTS > influence(
        u.signal, load.signal
    )


def _is_derived(speed: Column, position: Column) -> bool:
    """Whether a speed is the change of a count from row to row, in any unit, and not rounded more than that."""
    if len(speed.values) != len(position.values) or len(speed.values) < 3:
        return False
    change, said = np.diff(position.signal), speed.signal[1:]
    known = np.isfinite(change) & np.isfinite(said)
    if not (known.any() and np.ptp(change[known]) and np.ptp(said[known])):
        return False
    return bool(np.corrcoef(change[known], said[known])[0, 1] > DERIVED)
