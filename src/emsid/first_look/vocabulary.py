"""Names of columns in the logs of drives, one a line: the name, the quantity, and what the numbers must be like.

A name is compared without its unit, its digits at the end and the groups before its last dot or slash, in small letters
and with `_` for blanks. An entry counts only where the numbers of the column agree with it: an accumulated count of a
VESC is whole, while a ``tachometer`` in volts is a speed.
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
erpm                    speed      any
amp_hours               other      any
amp_hours_used          other      any
amp_hours_charged       other      any
amp_hours_setup         other      any
watt_hours              other      any
watt_hours_used         other      any
watt_hours_charged      other      any
input_voltage           other      any      VESC, the battery
current_in              other      any      VESC, of the battery
current_motor           current    any
d_axis_current          other      any
q_axis_current          current    any
d_axis_voltage          other      any
q_axis_voltage          voltage    any
fault_code              other      any
ms_today                time       any
tacho_meters            position   any
tacho_abs_meters        other      any
speed_meters_per_sec    speed      any
vel_estimate            speed      any      ODrive
pos_estimate            position   any
input_vel               reference  any
input_pos               reference  any
vel_setpoint            reference  any
input_torque            torque     any
torque_setpoint         torque     any
iq_measured             current    any
iq_setpoint             current    any
vbus_voltage            other      any
ibus                    other      any
shaft_velocity          speed      any      SimpleFOC
shaft_angle             position   any
voltage.q               voltage    any
voltage_q               voltage    any
current_q               current    any
target                  reference  any
goal_pwm                duty       any      Dynamixel
goal_position           reference  any
goal_velocity           reference  any
goal_current            current    any
present_pwm             duty       any
present_position        position   any
present_velocity        speed      any
present_current         current    any
present_load            other      any
present_input_voltage   other      any
present_temperature     other      any
bus_voltage             other      any      CAN
dc_link_voltage         other      any
battery_voltage         other      any
vbat                    other      any
mcu_awake               other      any      Klipper
print_time              time       any
sysload                 other      any
statusword              other      any      CiA 402
controlword             other      any
target_torque           torque     any
target_velocity         reference  any
target_position         reference  any
torque_actual_value     current    any
velocity_actual_value   speed      any
position_actual_value   position   any
velocity_demand_value   reference  any
position_demand_value   reference  any
following_error_actual_value other any
action                  input      any      LeRobot
observation.state       output     any
state                   output     varied
frame_index             other      any
episode_index           other      any
task_index              other      any
"""
"""Name, quantity, what its numbers must be like, and where the lines of a device begin."""
_QUANTITIES = {
    **{quantity.name.lower(): quantity for quantity in ColumnQuantity},
}
_CHECKS: dict[str, Callable[[Array], bool]] = {
    "any": lambda values: True,
    "whole": lambda values: bool(np.all(values == np.rint(values))),
    "varied": lambda values: bool(np.any(values != np.rint(values))),
}


def _entries() -> dict[str, tuple[ColumnQuantity, Callable[[Array], bool]]]:
    rows = (line.split()[:3] for line in _NAMES.splitlines() if line.strip())
    return {name: (_QUANTITIES[quantity], _CHECKS[check]) for name, quantity, check in rows}


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
        return replace(said, quantity=entry[0], confidence=CONFIDENCE)
    if said.quantity is ColumnQuantity.TIME and said.unit == "us" and _are_pulses(known):
        return Meaning(ColumnQuantity.DUTY, "", CONFIDENCE, said.number)
    return said


def _are_pulses(values: Array) -> bool:
    """Whether numbers go up and down in the range of pulses, which times do not."""
    steps = np.diff(values)
    inside = len(values) > 2 and PULSE[0] <= values.min() and values.max() <= PULSE[1]
    return bool(inside and np.any(steps < 0) and np.mean(steps > 0) < 0.9)
