"""The columns of a brushless drive in the frame of its rotor, and what such a record can determine.

A log of a field-oriented controller has voltages and currents of the d- and the q-axis (`names.axis_of`). With the
voltage and a current of the q-axis a brushless motor is proposed: voltages as inputs, currents and speed as outputs. A
measured value is preferred to a setpoint; a setpoint of a current is none, while one of a voltage is what acts.

Where the speed is electrical, it is that of a motor with one pole pair, whose inertia and friction are those of the
shaft over the square of the number of pole pairs; its other constants are the same.

Phases become axes where the arguments for that are given. Where they are not, three voltages and three currents whose
names differ in one letter, and an angle, are taken for phases if the currents add up to nothing.

What the record can determine comes from the derivatives of the model (`emsid.models.plants.search.missing_tests`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from emsid.errors import EmsidError
from emsid.findings import Finding
from emsid.first_look.columns import Column
from emsid.first_look.names import ColumnQuantity, axis_of, is_setpoint, unknown_unit, without_unit
from emsid.io.axes import ROTOR
from emsid.models.plants.brushless import Brushless
from emsid.models.plants.parameters import Signal
from emsid.models.verbs import Shown, determined_by
from emsid.record import Record

LONGEST = 2e-3
"""Longest sample time in s: windings have time constants of 0.1 to 5 ms, and a sample has 80 steps of the motor."""
UNITS = {ColumnQuantity.VOLTAGE: "V", ColumnQuantity.CURRENT: "A", ColumnQuantity.SPEED: "rad/s"}
_VOLTAGE, _CURRENT, _SPEED = UNITS
PHASES = ("abc", "uvw", "123")
"""What the names of three phases differ in."""
ADDS_UP = 0.1
"""The sum of the currents of a star has at most this part of the variance of one of them; that of three currents that
have nothing to do with each other has three times that variance, and noise of a tenth of a current 3 % of it."""
Axes = dict[tuple[ColumnQuantity, str], Column]
"""Columns by quantity and axis; the axis of speed and angle is ``""``."""


def axes(columns: Sequence[Column]) -> Axes:
    """Voltages and currents of the d- and q-axis, and the speed (axis ``""``), of one motor.

    Empty without the voltage and a current of the q-axis. Of several motors it is the one with the largest current.
    """
    usable = [each for each in columns if each.kind == "numbers"]
    named = [(said, each) for each in usable if (said := axis_of(each.name, each.meaning.unit)) is not None]
    other = {each.name.lower().replace("q", "d") for said, each in named if said.axis == "q"}
    named = [
        (said, each) for said, each in named if said.axis == "q" or each.name.lower().replace("q", "d") in other
    ]  # no vesc_id
    motors: dict[str, Axes] = {}
    for said, column in sorted(named, key=lambda pair: (pair[0].setpoint, pair[0].part)):
        if not (said.quantity is _CURRENT and said.setpoint):
            motors.setdefault(said.motor, {}).setdefault((said.quantity, said.axis), column)
    whole = {motor: found for motor, found in motors.items() if {(_VOLTAGE, "q"), (_CURRENT, "q")} <= {*found}}
    if not whole:
        return {}
    motor, found = max(whole.items(), key=lambda pair: float(np.ptp(pair[1][_CURRENT, "q"].signal)))
    speeds = [each for each in usable if each.meaning.quantity is _SPEED and each.name.startswith(motor)]
    if found.get((_VOLTAGE, "d")) is not None and found[_VOLTAGE, "d"].constant and not found[_VOLTAGE, "d"].high:
        del found[_VOLTAGE, "d"]
    speeds = [each for each in speeds if not (each.constant or is_setpoint(each.name))]
    found |= {(_SPEED, ""): min(speeds, key=lambda each: each.meaning.unit == "erpm")} if speeds else {}
    rotor = [each for each in usable if each.name == ROTOR]
    return found | ({(ColumnQuantity.POSITION, ""): rotor[0]} if rotor else {})


def phases_in(columns: Sequence[Column], file: str) -> list[Finding]:
    """The finding that a file has the phases of a motor and its angle."""
    usable = [each for each in columns if each.kind == "numbers" and not each.constant]
    called = {without_unit(each.name)[0].strip(): each for each in usable}
    found = dict[str, tuple[str, ...]]()
    for letter, quantity in (("v", _VOLTAGE), ("i", _CURRENT)):
        named = {name: each for name, each in called.items() if each.meaning.quantity is quantity}
        for name, at, few in ((each, at, few) for each in named for at in range(len(each)) for few in PHASES):
            marks = few.upper() if name[at].isupper() else few
            three = tuple(name[:at] + mark + name[at + 1 :] for mark in marks)
            if name == three[0] and {*three} <= {*named}:
                signals = [named[each].signal for each in three]
                small = ADDS_UP * np.mean([np.var(each) for each in signals])
                if quantity is _VOLTAGE or np.var(np.sum(signals, axis=0)) <= small:
                    found.setdefault(letter, three)
    angles = [name for name, each in called.items() if each.meaning.quantity is ColumnQuantity.POSITION]
    if len(found) < 2 or not angles:
        return []
    electrical = bool(re.search(r"elec|_e$", angles[0].lower()))
    given = [f"{letter}={','.join(names)}" for letter, names in found.items()]
    return [Finding("phases-of-motor", file, {"phases": given, "angle": angles[0], "electrical": electrical})]


def reading_of(found: Axes) -> dict[str, Any]:
    """Input, output and units, as arguments of `emsid.read`; a column in a unit that is not known has none."""
    voltages = [found[_VOLTAGE, axis] for axis in "dq" if (_VOLTAGE, axis) in found]
    rest = [found[place] for place in ((_CURRENT, "d"), (_CURRENT, "q"), (_SPEED, "")) if place in found]
    units = {
        column.name: column.meaning.unit or UNITS.get(quantity, "rad")
        for (quantity, _), column in found.items()
        if column.meaning.unit or not unknown_unit(column.name)
    }
    voltages += [column for (quantity, _), column in found.items() if quantity is ColumnQuantity.POSITION]
    return {"input": [each.name for each in voltages], "output": [each.name for each in rest], "units": units}


def fit_of(found: Axes, reading: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `emsid.identify` for a brushless motor."""
    pairs = reading.get("pole_pairs")
    fixed = {"fixed": {"pole_pairs": f"{pairs:g}"}} if pairs else {}
    return {"models": "brushless", **fixed}


def shown_by(record: Record, fit: Mapping[str, Any]) -> Shown | None:
    """What a brushless motor can determine from a record; None where it cannot be simulated."""
    try:
        return determined_by(Brushless(), record, fit.get("fixed"))
    except EmsidError:
        return None


def findings_about(file: str, found: Axes, fit: Mapping[str, Any], shown: Shown | None) -> list[Finding]:
    """Which columns are those of a brushless motor, whether its pole pairs are known, and what can be determined."""
    currents = [found[place].name for place in ((_CURRENT, "d"), (_CURRENT, "q")) if place in found]
    voltages = [found[place].name for place in ((_VOLTAGE, "d"), (_VOLTAGE, "q")) if place in found]
    speed = found[_SPEED, ""].name if (_SPEED, "") in found else ""
    rests = bool(speed) and shown is not None and not shown.moving
    data = {"voltages": voltages, "currents": currents, "speed": speed, "rests": rests}
    noticed = [Finding("brushless-columns", file, data)]
    named = [(column.name, unknown_unit(column.name)) for column in found.values() if not column.meaning.unit]
    noticed += [Finding("unit-unknown", name, {"unit": unit}) for name, unit in named if unit]
    if not fit.get("fixed"):
        noticed.append(Finding("pole-pairs-open", file, {"usual": Brushless().pole_pairs}))
    if shown is None:
        return noticed
    axis = {Signal.D_CURRENT: "d", Signal.Q_CURRENT: "q"}
    data = {
        "turns": shown.moving,
        "currents": [axis[signal] for signal in shown.flowing],
        "known": list(shown.known),
        "unknown": list(shown.unknown),
        "ratios": list(shown.ratios),
        "tests": {code: list(names) for code, names in shown.tests.items()},
    }
    return [*noticed, Finding("record-determines", file, data)]
