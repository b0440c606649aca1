"""Names of columns in the logs of drives, one a line: name, quantity, what the numbers must be like, and their unit.

A name is compared without its unit, its digits at the end and the groups before its last dot or slash, in small letters
and with `_` for blanks. Names whose words say the same (`emsid.first_look.names`) are not listed. An entry counts only
where the numbers of the column agree with it: an accumulated count of a VESC is whole, while a ``tachometer`` in volts
is a speed.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.names import ColumnQuantity, Meaning, meaning, without_unit

Array = NDArray[np.float64]

CONFIDENCE = 0.95
"""Of a name that a device writes and whose numbers agree with it."""
PULSE = (400.0, 2600.0)
"""Pulses of servos and speed controllers in µs: 500 to 2500, and a little more."""

_NAMES = """
tachometer              position   whole    VESC, accumulated count
tachometer_abs          other      any
amp_hours               other      any
amp_hours_used          other      any
amp_hours_charged       other      any
amp_hours_setup         other      any
watt_hours              other      any
watt_hours_used         other      any
watt_hours_charged      other      any
input_voltage           other      any      VESC, the battery
current_in              other      any      VESC, of the battery
d_axis_current          other      any
d_axis_voltage          other      any
tacho_meters            position   any
tacho_abs_meters        other      any
vq                      voltage    any      VESC: of the q-axis, as in avg_vq and foc.vq
avg_vq                  voltage    any
vd                      other      any
avg_vd                  other      any
erpm                    speed      any      electrical: pole pairs times that of the shaft
input_vel               reference  any      ODrive
vel_estimate            speed      varied   rev/s
pos_estimate            position   varied   rev
v_current_control_integral_q voltage any
v_current_control_integral_d other any
input_pos               reference  any
torque_setpoint         torque     any
iq_setpoint             current    any
vbus_voltage            other      any
ibus                    other      any
electrical_theta        other      any      moteus
voltage.q               voltage    any      SimpleFOC
voltage.d               other      any
current.d               other      any
voltage_d               other      any
current_d               other      any
electrical_angle        other      any
goal_pwm                duty       any      Dynamixel
goal_current            current    any
present_load            other      any
present_input_voltage   other      any
bus_voltage             other      any      CAN
dc_link_voltage         other      any
vbat                    other      any
target_torque           torque     any      CiA 402
torque_actual_value     current    any
following_error_actual_value other any
action                  input      any      LeRobot
observation.state       output     any
state                   output     varied
"""
"""Name, quantity, what its numbers must be like, their unit where the device has one, and where its lines begin.

Units: ODrive, https://docs.odriverobotics.com (turns and turns/s); VESC, ERPM.
"""
_CHECKS: dict[str, Callable[[Array], bool]] = {
    "any": lambda values: True,
    "whole": lambda values: bool(np.all(values == np.rint(values))),
    "varied": lambda values: bool(np.any(values != np.rint(values))),
}


def _entries() -> dict[str, tuple[ColumnQuantity, Callable[[Array], bool], str]]:
    rows = (line.split() for line in _NAMES.splitlines() if line.strip())
    return {
        name: (ColumnQuantity[quantity.upper()], _CHECKS[check], next((each for each in more if each in _UNITS), ""))
        for name, quantity, check, *more in rows
    }


_UNITS = ("rev", "rev/s")
ENTRIES = _entries()


def meaning_of(name: str, unit: str, values: Array) -> Meaning:
    """What the name, the unit and the numbers of a column say about it.

    >>> meaning_of("tachometer", "", np.array([0.0, 3.0, 9.0])).quantity.value
    'position'
    >>> meaning_of("tachometer", "", np.array([0.0, 3.2, 2.9])).quantity.value
    'speed'
    >>> meaning_of("servo [µs]", "", np.array([1500.0, 1900.0, 1100.0])).quantity.value
    'duty or command'

    Args:
        name: of the column.
        unit: that the file gives.
        values: (N,) its numbers; NaN where there is none.
    """
    said, known = meaning(name, unit), values[np.isfinite(values)]
    bare = re.sub(r"[\s\-]+", "_", without_unit(name)[0].strip().lower())
    bare = re.sub(r"_?\d+$", "", bare)
    entry = next((ENTRIES[each] for each in (bare, re.split(r"[./]", bare)[-1]) if each in ENTRIES), None)
    if entry is not None and entry[1](known):
        return replace(said, quantity=entry[0], unit=said.unit or entry[2], confidence=CONFIDENCE)
    if said.quantity is ColumnQuantity.TIME and said.unit == "us" and _are_pulses(known):
        return Meaning(ColumnQuantity.DUTY, "", CONFIDENCE, said.number)
    return said


def _are_pulses(values: Array) -> bool:
    """Whether numbers stay or go down in the range of pulses, which times do not."""
    steps = np.diff(values)
    inside = len(values) > 2 and PULSE[0] <= values.min() and values.max() <= PULSE[1]
    return bool(inside and np.mean(steps > 0) < 0.9)
