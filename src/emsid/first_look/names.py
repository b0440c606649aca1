"""What the name of a column says about it: the quantity, and the unit in brackets or at its end.

**Words.** Names are divided into words: ``Motor_Speed(RPM)`` has the words *motor* and *speed* and the unit *rpm*,
``mVel`` the word *vel*, ``u11`` the word *u*.

**Names of devices.** The logs of drives have names whose words do not say what they are. `_NAMES` lists them, one a
line: the name, its quantity, what the numbers must be like, and their unit. Names whose words say the same are not
listed. A name is compared without its unit, its digits at the end and the groups before its last dot or slash, in small
letters and with ``_`` for blanks. An entry counts only where the numbers of the column agree with it: an accumulated
count of a VESC is whole, while a ``tachometer`` in volts is a speed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from emsid.first_look.levels import NAMED
from emsid.record.time_axis import CLOCK_NAMES
from emsid.units import BRACKETED, edges_of, known_unit, unit_in_name


class ColumnQuantity(StrEnum):
    """What a column may hold."""

    TIME = "time"
    VOLTAGE = "voltage"
    DUTY = "duty or command"
    CURRENT = "current"
    SPEED = "speed"
    POSITION = "position"
    ACCELERATION = "acceleration"
    TORQUE = "torque"
    FORCE = "force"
    REFERENCE = "reference"
    INPUT = "input"
    OUTPUT = "output"
    OTHER = "other"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Attributes:
        quantity: the quantity, `ColumnQuantity.UNKNOWN` where the name says nothing.
        unit: as `emsid.units` reads it; empty where there is none.
        confidence: of the quantity, from 0 to 1.
        number: the digits at the end of the name, which pair ``u2`` with ``y2``; empty where there are none.
    """

    quantity: ColumnQuantity
    unit: str
    confidence: float
    number: str = ""


# The first list that has one of the words decides: a speed reference is a reference, a motor voltage a voltage.
_WORDS: tuple[tuple[ColumnQuantity, float, str], ...] = (
    (
        ColumnQuantity.TIME,
        0.9,
        "time timestamp zeit uhrzeit temps tiempo tempo seconds clock elapsed datetime date when uptime millis micros "
        "stamp",
    ),
    (
        ColumnQuantity.REFERENCE,
        0.9,
        "ref reference setpoint target desired soll sollwert consigne consigna goal sp qg qr qref demand wanted",
    ),
    (
        ColumnQuantity.OTHER,
        0.8,
        "temp temperature temperatur index idx row seq id state status statusword controlword mode fault flag crc "
        "checksum battery sysload awake",
    ),
    (ColumnQuantity.ACCELERATION, 0.9, "acc accel acceleration qdd beschleunigung"),
    (
        ColumnQuantity.SPEED,
        0.95,
        "speed vel velocity rpm erpm omega geschwindigkeit drehzahl winkelgeschwindigkeit vitesse velocidad velocità "
        "gyro spd qdot dq qd rate tacho tachometer tachogenerator",
    ),
    (ColumnQuantity.DUTY, 0.95, "pwm duty dutycycle throttle"),
    (
        ColumnQuantity.VOLTAGE,
        0.95,
        "voltage volt volts vin spannung tension tensión tensione vmot vmotor ua va um vm vir",
    ),
    (ColumnQuantity.CURRENT, 0.9, "current curr strom courant corriente corrente amps amp ampere ia im iq imot"),
    (ColumnQuantity.TORQUE, 0.9, "torque tau moment drehmoment couple coppia"),
    (ColumnQuantity.FORCE, 0.85, "force thrust kraft schub fuerza empuje forza spinta poussée"),
    (
        ColumnQuantity.POSITION,
        0.9,
        "position posición posizione pos angle ángulo angolo theta phi encoder enc ticks tick step steps winkel qm "
        "counts count",
    ),
    (
        ColumnQuantity.DUTY,
        0.8,
        "command cmd commanded control ctrl effort actuation stellgroesse stellgröße commande drive",
    ),
    (ColumnQuantity.INPUT, 0.85, "u input in stimulus excitation eingang entrée"),
    (ColumnQuantity.OUTPUT, 0.85, "y z output out response measured ausgang sortie"),
    (ColumnQuantity.TIME, 0.8, "t sec s ms us"),
    (ColumnQuantity.REFERENCE, 0.6, "r w"),
    (ColumnQuantity.POSITION, 0.5, "q deg rad"),
    (ColumnQuantity.VOLTAGE, 0.5, "v"),
    (ColumnQuantity.CURRENT, 0.4, "i"),
    (ColumnQuantity.FORCE, 0.3, "f"),
    (ColumnQuantity.SPEED, 0.3, "n"),
)
_BY_UNIT: tuple[tuple[ColumnQuantity, str], ...] = (
    (ColumnQuantity.TIME, "s ms us ns min"),
    (ColumnQuantity.VOLTAGE, "V mV"),
    (ColumnQuantity.DUTY, "pwm % percent"),
    (ColumnQuantity.CURRENT, "A mA"),
    (ColumnQuantity.SPEED, "rad/s mrad/s deg/s rpm krpm rev/s m/s mm/s count/s count/sample"),
    (ColumnQuantity.POSITION, "rad mrad deg rev m mm count"),
    (ColumnQuantity.ACCELERATION, "rad/s^2 m/s^2"),
    (ColumnQuantity.TORQUE, "N*m mN*m"),
    (ColumnQuantity.FORCE, "N"),
)
# Words of quantities and of devices that are no part of a drive; a device may have a drive, as in *pump speed*.
_OF_PROCESSES = (
    "temp temperature temperatur température temperatura level niveau füllstand fuellstand pressure druck pression "
    "presión pressione flow durchfluss débit caudal humidity feuchte concentration konzentration weight gewicht "
    "brightness light sound ph"
)
_DEVICES = "pump pumpe pompe bomba pompa valve ventil vanne heater heating heizung tank boiler lamp"
_OPEN = re.compile(r"(?:\s*/\s*|\s+in\s+|\s+(?=\S+/))(\S+)$")
"""A unit after a slash, as in *U/V*, after *in*, or one with a slash after a blank."""
_PER_SECOND = r"(?:rad|deg|rev|m|mm|l|counts?)(?:_per_|_p_|_|p)s(?:ec)?"
_SUFFIX = re.compile(
    rf"[_ ]({_PER_SECOND}|(?:rad|m)_(?:per_)?s2|rpm_s|ns|us|ms|s|V|mV|A|mA|rpm|rad|deg|rads|dps|Nm|pct)$"
)
"""The search goes from left to right, so that the longest unit is found."""
_SUFFIXES = {"rads": "rad/s", "pct": "percent"}
_UNIT_NAMES = {"rpm": "rpm", "erpm": "erpm", **CLOCK_NAMES}
"""Words of a name that say the unit."""
_WORD = re.compile(r"[A-Z]+(?![a-zà-ÿ])|[A-ZÀ-Þ]?[a-zà-ÿ]+|[A-Z]+|[α-ωΑ-Ω]+")
_COMPOUND = re.compile(
    r"(?P<first>soll)?.*?(?P<last>spannung|strom|drehzahl|geschwindigkeit|beschleunigung|moment|kraft|winkel|position|"
    r"zeit|temperatur)"
)
"""A German compound has the meaning of its last part, as *Motorspannung*; with *soll* it is a reference."""
_GREEK = {"ω": "omega", "θ": "theta", "φ": "phi", "τ": "tau"}


def meaning(name: str, unit: str = "") -> Meaning:
    """What the name of a column and its unit say.

    >>> meaning("Motor_Speed(RPM)")
    Meaning(quantity=<ColumnQuantity.SPEED: 'speed'>, unit='rpm', confidence=0.95, number='')
    >>> meaning("rpm").unit, meaning("rpm2").unit
    ('rpm', 'rpm')
    >>> meaning("t_ms").quantity, meaning("t_ms").unit, meaning("Commanded_PWM").quantity.value
    (<ColumnQuantity.TIME: 'time'>, 'ms', 'duty or command')

    Args:
        name: of the column.
        unit: from a row of units of the file; empty where there is none.
    """
    bare, written = without_unit(name)
    unit = known_unit(unit) or written
    digits = re.search(r"\d+$", bare)
    number = digits[0] if digits else ""
    words = _words(bare)
    words = [word for k, word in enumerate(words) if len(word) > 1 or k in (0, len(words) - 1)]
    unit = unit or next((_UNIT_NAMES[word] for word in words if word in _UNIT_NAMES), "")
    by_word = next(((q, sure) for q, sure, known in _WORDS if set(words) & set(known.split())), None)
    by_unit = next(((q, NAMED) for q, units in _BY_UNIT if unit in units.split()), None)
    if by_word is None or (by_unit is not None and by_word[1] < NAMED):
        quantity, confidence = by_unit or by_word or (ColumnQuantity.UNKNOWN, 0.0)
    else:
        quantity, confidence = by_word
    return Meaning(quantity, unit, confidence, number)


def is_of_a_process(name: str) -> bool:
    """Whether a name says that a column is of a process, such as a tank or an oven, and not of a drive.

    >>> [is_of_a_process(name) for name in ("level", "flow_rate", "pump", "pump_speed", "voltage level", "y")]
    [True, True, True, False, False, False]

    Args:
        name: of the column.
    """
    words, said = set(_words(without_unit(name)[0])), meaning(name).quantity
    if words & set(_OF_PROCESSES.split()):
        return said not in (ColumnQuantity.VOLTAGE, ColumnQuantity.CURRENT, ColumnQuantity.TORQUE, ColumnQuantity.DUTY)
    return bool(words & set(_DEVICES.split())) and said is ColumnQuantity.UNKNOWN


def _words(bare: str) -> list[str]:
    """The words of a name without its unit, and the last parts of German compounds."""
    words = [_GREEK.get(word, word.lower()) for word in _WORD.findall(bare)]
    return words + [part for word in words if (found := _COMPOUND.fullmatch(word)) for part in found.groups() if part]


def _spelt(suffix: str) -> str:
    """A unit at the end of a name as units are written: that of ``rad_per_s`` is ``rad/s``."""
    found = re.fullmatch(r"(rad|deg|rev|mm|m|l|counts?|rpm)(?:_per_|_p_|_|p)s(?:ec)?(2?)", suffix)
    return f"{found[1]}/s{'^2' if found[2] else ''}" if found else suffix


def without_unit(name: str) -> tuple[str, str]:
    """A name without its unit, and the unit; empty where it has none that is known.

    Any brackets at the end are left out, and so are units that are not in brackets. `emsid.read` takes a unit from
    brackets only (`emsid.units.name_and_unit`), because ``Encoder_A`` may be a name.
    """
    bracketed = BRACKETED.search(name)
    if edges_of(name):
        return "counts", "count"
    if bracketed:
        return name[: bracketed.start()], unit_in_name(bracketed[1])
    after = _OPEN.search(name)
    if after and unit_in_name(after[1]):
        return name[: after.start()], unit_in_name(after[1])
    suffix = _SUFFIX.search(name)
    if suffix:
        return name[: suffix.start()], known_unit(_SUFFIXES.get(suffix[1]) or _spelt(suffix[1]))
    return name, ""


def unknown_unit(name: str) -> str:
    """What a name has in brackets at its end, where that looks like a unit that is not known; else empty.

    >>> unknown_unit("speed [furlong/s]"), unknown_unit("speed [rpm]"), unknown_unit("speed(2)")
    ('furlong/s', '', '')
    """
    found = None if edges_of(name) else BRACKETED.search(name)
    return found[1] if found and re.search("[^\\W\\d]", found[1]) and not unit_in_name(found[1]) else ""


Array = NDArray[np.float64]

CONFIDENCE = 0.95
"""Of a name that a device writes and whose numbers agree with it."""
PULSE = (400.0, 2600.0)
"""Pulses of servos and speed controllers in µs: 500 to 2500, and a little more."""

_NAMES = """
ms_today                time       any      ms VESC
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
tacho_meters            position   any
tacho_abs_meters        other      any
phase_vel               other      any      ODrive, electrical
input_vel               reference  any      ODrive
vel_estimate            speed      varied   rev/s
pos_estimate            position   varied   rev
input_pos               reference  any
torque_setpoint         torque     any
vbus_voltage            other      any
ibus                    other      any
electrical_theta        other      any      moteus
electrical_angle        other      any
goal_pwm                duty       any      Dynamixel
goal_current            current    any
iq_setpoint             current    any      ODrive
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


_UNITS = ("rev", "rev/s", "ms")
ENTRIES = _entries()


@dataclass(frozen=True)
class AxisName:
    """The name of a voltage or a current in the frame of a rotor.

    Attributes:
        quantity: voltage or current.
        axis: ``d`` or ``q``.
        setpoint: whether it is one that is wanted.
        part: whether it is a part of the quantity, such as that of an integrator.
        motor: the group or number of the motor that it is of; empty where names have none.
    """

    quantity: ColumnQuantity
    axis: str
    setpoint: bool
    part: bool
    motor: str


_LETTERS = {"v": ColumnQuantity.VOLTAGE, "u": ColumnQuantity.VOLTAGE, "i": ColumnQuantity.CURRENT}
_OF_AXES = {"voltage": "v", "voltagedq": "v", "volt": "v", "current": "i", "curr": "i", "amps": "i"} | {
    letter: letter for letter in _LETTERS
}
_WANTED = frozenset(
    ["setpoint", "set", "sp", "ref", "reference", "target", "cmd", "command", "commanded", "desired", "wanted"]
)
_PARTS = frozenset(("integral", "integrator", "error", "err", "norm"))


_UNITS_OF_DEVICES: tuple[tuple[frozenset[str], dict[str, str]], ...] = (
    (frozenset({"voltagedq_q", "vfoc_theta", "q_a"}), {"velocity": "rev/s", "position": "rev"}),  # moteus
)
"""Names of which a device writes at least one, and the units of others that it writes without one."""


def units_of_device(names: Sequence[str]) -> dict[str, str]:
    """The units of columns that the names beside them tell.

    >>> units_of_device(["time", "VELOCITY", "VOLTAGEDQ_Q"]), units_of_device(["time", "velocity", "u"])
    ({'VELOCITY': 'rev/s'}, {})
    """
    last = {name: re.split(r"[./]", name.lower())[-1] for name in names}
    found = next((units for marks, units in _UNITS_OF_DEVICES if marks & set(last.values())), {})
    return {name: found[bare] for name, bare in last.items() if bare in found}


def is_setpoint(name: str) -> bool:
    """Whether a name says that a value is wanted, not measured."""
    return bool({*_words(without_unit(name)[0])} & _WANTED)


def axis_of(name: str, unit: str = "") -> AxisName | None:
    """What a name of a voltage or current of the d- or q-axis says; None for another name.

    Two letters, ``Iq`` or ``vd``, say both. Else one word is the axis, and the first word of a quantity, or the unit,
    says which of them it is.

    >>> [(each.quantity.value, each.axis) for each in map(axis_of, ("axis0.motor.foc.Iq_measured", "VOLTAGEDQ_D"))]
    [('current', 'q'), ('voltage', 'd')]
    >>> axis_of("q"), axis_of("dq_1"), axis_of("i_q_ref").setpoint
    (None, None, True)
    """
    bare, written = without_unit(name)
    parts = re.split(r"[./]", bare)
    words = _words(parts[-1] if len(parts[-1]) > 1 else ".".join(parts[-2:]))
    both = next((word for word in words if re.fullmatch(r"[vui][dq]", word)), "")
    axis = both[1:] or next((word for word in words if word in ("d", "q")), "")
    letter = both[:1] or next((_OF_AXES[word] for word in words if word in _OF_AXES), "")
    by_unit = next((q for q, units in _BY_UNIT if (unit or written) in units.split()), None)
    quantity = _LETTERS.get(letter) or by_unit
    if not axis or quantity is None or quantity not in _LETTERS.values() or by_unit not in (None, quantity):
        return None
    motor = re.search(r"(?:axis|motor|joint|odrv)_?\d+[._/]", bare)
    return AxisName(
        quantity, axis, bool({*words} & _WANTED), bool({*words} & _PARTS), bare[: motor.end()] if motor else ""
    )


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
    of_axis = axis_of(name, said.unit)
    if of_axis is not None:
        wanted = of_axis.setpoint and of_axis.quantity is ColumnQuantity.CURRENT
        other = ColumnQuantity.REFERENCE if wanted else ColumnQuantity.OTHER
        return replace(
            said, quantity=other if wanted or of_axis.axis == "d" else of_axis.quantity, confidence=CONFIDENCE
        )
    if said.quantity is ColumnQuantity.TIME and said.unit == "us" and _are_pulses(known):
        return Meaning(ColumnQuantity.DUTY, "", CONFIDENCE, said.number)
    return said


def _are_pulses(values: Array) -> bool:
    """Whether numbers stay or go down in the range of pulses, which times do not."""
    steps = np.diff(values)
    inside = len(values) > 2 and PULSE[0] <= values.min() and values.max() <= PULSE[1]
    return bool(inside and np.mean(steps > 0) < 0.9)
