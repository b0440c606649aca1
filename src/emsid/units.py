"""Conversion of the units of a log to SI.

Counts, samples, PWM and electrical turns are units too, when their size is given: one count is a turn divided by the
counts per revolution, one sample is the sample time, full PWM is the supply voltage, and the shaft turns once in as
many electrical turns (``erpm`` in a minute) as there are pole pairs.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from functools import cache
from math import inf, pi
from typing import TYPE_CHECKING, Any, NamedTuple
from unicodedata import normalize

from emsid.errors import DataError

if TYPE_CHECKING:
    import pint

# The SI unit of each quantity: the first unit of the right dimension.
SI = ("rad", "rad/s", "rad/s^2", "rad/s^3", "V", "A", "ohm", "H", "s", "m", "m/s", "m/s^2", "N", "N*m", "kg",
       "kg*m^2", "N*s/m", "N*m*s", "V*s", "N/V", "W", "1")  # fmt: skip


# Exponents of more than one digit are refused: pint would compute such a power exactly, which may never end.
SMALLEST, LARGEST = 1e-15, 1e12
"""Units outside this range of SI units are refused: no drive is measured in electron volts or parsecs."""
_LONG_POWER = re.compile(r"(?:\^|\*\*)(?!\s*[-+]?\d(?![\d.eE]))|\)\s*(?:\^|\*\*)|(?:\^|\*\*)[^*^/]*(?:\^|\*\*)")
MOST_LETTERS = 80
_WORDS_OF_POWERS = re.compile(r"\b(squared|cubed|square|cubic|sq)\b")


_LOGGED = (
    "s ms us ns min h Hz kHz V mV A mA W pwm % percent rad/s mrad/s deg/s rpm krpm erpm rev/s rad mrad deg rev count "
    "count/s count/sample m mm m/s mm/s rad/s^2 m/s^2 N N*m mN*m kg degC"
)
_SPELLINGS = {unit.lower(): unit for unit in (*(si for si in SI if si != "1"), *_LOGGED.split())} | {
    "-": "1",
    "ω": "ohm",
    "°": "deg",
    "°/s": "deg/s",
    "degree": "deg",
    "degrees": "deg",
    "grad": "deg",
    "dps": "deg/s",
    "1/min": "rpm",
    "u/min": "rpm",
    "r/min": "rpm",
    "tr/min": "rpm",
    "giri/min": "rpm",
    "rev/min": "rpm",
    "min^-1": "rpm",
    "min⁻¹": "rpm",
    "µs": "us",
    "sec": "s",
    "seconds": "s",
    "msec": "ms",
    "volt": "V",
    "volts": "V",
    "nm": "N*m",
    "n·m": "N*m",
    "rad/s²": "rad/s^2",
    "m/s²": "m/s^2",
    "turn": "rev",
    "turns": "rev",
    "turn/s": "rev/s",
    "turns/s": "rev/s",
    "counts": "count",
    "ticks": "count",
    "counts/s": "count/s",
    "amps": "A",
    "°c": "degC",
}


def known_unit(text: str) -> str:
    """A unit that a log gives, in the spelling that `conversion` reads; empty where it is not known.

    >>> known_unit("RPM"), known_unit("°/s"), known_unit("furlong")
    ('rpm', 'deg/s', '')
    """
    text = text.strip("()[]{}<> ")
    return text if text in _SPELLINGS.values() and text != "1" else _SPELLINGS.get(text.lower(), "")


BRACKETED = re.compile(r"\s*[(\[{<]\s*([^)\]}>]*?)\s*[)\]}>]\s*$")


def name_and_unit(name: str) -> tuple[str, str]:
    """The name of a column without a unit in brackets at its end, and the unit; empty where there is none.

    The derivative of a column has its unit per second. A single letter is a unit only as it is spelt: *N* is newton,
    but *n* in ``y(n)`` counts samples.

    >>> name_and_unit("Motor_Speed(RPM)"), name_and_unit("f(x)"), name_and_unit("[V]")
    (('Motor_Speed', 'rpm'), ('f(x)', ''), ('[V]', ''))
    >>> name_and_unit("d(angle [rad])"), name_and_unit("y(n)"), name_and_unit("speed [2]")
    (('d(angle)', 'rad/s'), ('y(n)', ''), ('speed [2]', ''))
    >>> name_and_unit("edges(A)"), name_and_unit("d(edges(A))")
    (('edges(A)', ''), ('d(edges(A))', ''))
    """
    column = column_of(name)
    bare, unit = _without_brackets(column)
    return (bare, unit) if column == name else (f"d({bare})", unit and f"{unit}/s")


def column_of(name: str, known: Container[str] = ()) -> str:
    """The column that a channel is, or is the derivative of: that of ``d(x)`` is ``x``, unless it is known itself."""
    inner = re.fullmatch(r"d\((.+)\)", name)
    return inner[1] if inner and name not in known else name


def edges_of(name: str) -> str:
    """What is in the brackets of ``edges(…)``, one or two columns of pulses; empty for other names."""
    inner = re.fullmatch(r"edges\((.+)\)", name)
    return inner[1] if inner else ""


def _without_brackets(name: str) -> tuple[str, str]:
    """The name of a column without a known unit in brackets at its end, and the unit."""
    found = None if edges_of(name) else BRACKETED.search(name)
    unit = unit_in_name(found[1]) if found else ""
    bare = name[: found.start()].rstrip(" /") if found else ""  # as in "speed / (rad/s)"
    return (bare, unit) if bare and unit else (name, "")


def unit_in_name(text: str) -> str:
    """A unit that is part of a name, as `known_unit`, but a single letter only as it is spelt.

    >>> unit_in_name("RPM"), unit_in_name("V"), unit_in_name("n")
    ('rpm', 'V', '')
    """
    unit = known_unit(text)
    return "" if len(text) == 1 and text.isalpha() and text != unit else unit


def channel_and_unit(name: str, unit: str) -> tuple[str, str]:
    """The name of a channel without a unit, and its unit, or else the one in its name: the same for the same channel.

    >>> channel_and_unit("u [V]", "V"), channel_and_unit("u", "V"), channel_and_unit("u [mV]", "")
    (('u', 'V'), ('u', 'V'), ('u', 'mV'))
    """
    bare, in_name = name_and_unit(name)
    return bare, unit or in_name


def called(name: str, units: Mapping[str, str]) -> tuple[str, ...]:
    """The names that are meant by one: itself, or else those that differ from it only by their unit in brackets.

    >>> called("speed", {"speed [rpm]": "", "Speed": ""}), called("speed (V)", {"speed [rpm]": "", "speed": ""})
    (('speed [rpm]',), ())

    Args:
        name: as it is given, with or without a unit.
        units: the unit of each name; where it is empty, the one in brackets counts.
    """
    if name in units:
        return (name,)
    wanted, unit = name_and_unit(name)
    found = ((each, *name_and_unit(each), units[each]) for each in units)
    return tuple(each for each, bare, own, stated in found if bare == wanted and unit in ("", stated or own))


def readable_unit(unit: str) -> str:
    """A unit for print: a dot for ``*``, raised powers, a dash for no unit, ``unit?`` where it is unknown.

    >>> readable_unit("kg*m^2"), readable_unit("1"), readable_unit("")
    ('kg·m²', '–', 'unit?')
    """
    if not unit:
        return "unit?"
    raised = re.sub(r"\^(-?\d+)", lambda power: power[1].translate(_RAISED), unit)
    return "–" if unit == "1" else raised.replace("*", "·").replace("ohm", "Ω")


def per_unit(above: str, below: str) -> str:
    """The unit of a ratio, with one fraction bar; empty where one of the units is not known.

    >>> per_unit("rad/s", "V"), per_unit("V", "1"), per_unit("m", "N*m"), per_unit("m", "m")
    ('rad/(s*V)', 'V', '1/N', '1')
    """
    if not (above and below):
        return ""
    powers: dict[str, int] = {}
    for unit, sign in ((above, 1), (below, -1)):
        top, *bottoms = unit.replace("·", "*").split("/")
        for text, way in ((top, sign), *((bottom, -sign) for bottom in bottoms)):
            for factor in text.strip("()").split("*"):
                name, _, power = factor.partition("^")
                if not re.fullmatch(r"[-+]?\d*", power):
                    return f"({above})/({below})"
                if name not in ("1", ""):
                    powers[name] = powers.get(name, 0) + way * int(power or 1)
    parts = {
        sign: [f"{name}^{abs(power)}" if abs(power) > 1 else name for name, power in powers.items() if power * sign > 0]
        for sign in (1, -1)
    }
    whole = "*".join(parts[1]) or "1"
    if not parts[-1]:
        return whole
    return f"{whole}/{parts[-1][0]}" if len(parts[-1]) == 1 else f"{whole}/({'*'.join(parts[-1])})"


def plain_unit(unit: str) -> str:
    """A unit for print, empty where there is none."""
    return "" if unit in ("", "1") else readable_unit(unit)


def with_unit(number: str, unit: str) -> str:
    """A number with its unit for print.

    >>> with_unit("2", "ohm"), with_unit("2", "1")
    ('2 Ω', '2')
    """
    return f"{number} {plain_unit(unit)}".rstrip()


def in_unit(name: str, unit: str) -> str:
    """The name of a quantity with its unit in brackets, for a heading, in place of another unit in the name.

    >>> in_unit("torque", "N*m"), in_unit("share", "1"), in_unit("Speed (RPM)", "rad/s")
    ('torque [N·m]', 'share', 'Speed [rad/s]')
    """
    text = plain_unit(unit)
    return f"{name_and_unit(name)[0]} [{text}]" if text else name


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LOWERED = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")


class Conversion(NamedTuple):
    """``converted = gain * value + offset``, in ``unit``."""

    gain: float
    offset: float
    unit: str


def conversion(
    unit: str,
    target: str | None = None,
    *,
    sample_time: float | None = None,
    counts_per_revolution: float | None = None,
    supply_voltage: float | None = None,
    pwm_full_scale: float = 255.0,
    pole_pairs: float | None = None,
) -> Conversion:
    """Gain and offset that convert a value in ``unit`` to ``target``, by default the SI unit of the same quantity.

    >>> conversion("rpm", "deg/s")
    Conversion(gain=6.0, offset=0.0, unit='deg/s')
    >>> conversion("count/sample", sample_time=0.01, counts_per_revolution=621).unit
    'rad/s'

    Args:
        unit: the unit of the value: ``rpm``, ``deg/s``, ``mV``, ``count/sample``, ``pwm``, …
        target: the unit wanted.
        sample_time: seconds in one ``sample``.
        counts_per_revolution: encoder ``count`` per turn.
        supply_voltage: volts at full ``pwm``.
        pwm_full_scale: the ``pwm`` value that is the full supply voltage.
        pole_pairs: electrical turns per turn of the shaft, for ``erpm``.

    Raises:
        DataError: for an unknown unit, one of another quantity, or a count, sample or PWM whose size is not given.
    """
    sizes = _sizes(
        unit,
        target or "",
        {
            "count": (counts_per_revolution, "counts_per_revolution"),
            "sample": (sample_time, "dt"),
            "pwm": (supply_voltage, "supply_voltage"),
            "erpm": (pole_pairs, "pole_pairs"),
        },
    )
    if "pwm" in sizes and not 0 < pwm_full_scale < inf:
        raise DataError(f"pwm_full_scale is {pwm_full_scale:g}; give a positive number", arguments=("pwm_full_scale",))

    for text in (unit, target or ""):
        spelt = _spelling(text)
        if max(len(text), len(spelt)) > MOST_LETTERS or _LONG_POWER.search(spelt) or _several_powers(spelt):
            raise DataError(f"unit {text[:MOST_LETTERS]!r} is not understood; write it as V, rpm, deg/s, N*m/s^2, …")
    if unit in SI and target in (None, unit):
        return Conversion(1.0, 0.0, unit)
    import pint  # takes a third of a second, with its registry

    registry = _registry(
        turn_per_count=1 / sizes["count"] if "count" in sizes else None,
        volt_per_pwm=sizes["pwm"] / pwm_full_scale if "pwm" in sizes else None,
        second_per_sample=sizes.get("sample"),
        pairs=sizes.get("erpm"),
    )
    try:
        quantity = registry.Quantity(1.0, _spelling(unit))
        if target is None:
            base = quantity.to_base_units()
            same = (si for si in SI if registry.Quantity(1.0, si).to_base_units().units == base.units)
            target = next(same, unit if base.magnitude == 1 else f"{base.units:~C}".replace("**", "^"))
        wanted = registry.Unit(_spelling(target))
        zero, one = (registry.Quantity(x, quantity.units).to(wanted).magnitude for x in (0.0, 1.0))
    except pint.DimensionalityError as problem:
        raise DataError(f"unit {unit!r} cannot become {target!r}: {problem}") from None
    except Exception as problem:
        raise DataError(
            f"unit {unit!r} is not understood ({str(problem) or type(problem).__name__}); write it as V, rpm, deg/s, "
            "count/sample, pwm, …"
        ) from None
    gain = float(one - zero)
    if not (SMALLEST <= abs(gain) <= LARGEST or registry.Unit(_spelling(unit)) == wanted):
        raise DataError(f"unit {unit!r} is {gain:.3g} {target}, which no drive is measured in; write V, rpm, deg/s, …")
    return Conversion(gain, float(zero), target)


def si_unit(unit: str, **sizes: Any) -> str:
    """The SI unit that values in ``unit`` can be converted to; empty where there is none, or a size is not known.

    >>> si_unit("rpm"), si_unit("mV"), si_unit("count"), si_unit("furlong per lamp")
    ('rad/s', 'V', '', '')

    Args:
        unit: as `conversion` reads it.
        sizes: those of counts, samples and PWM, as for `conversion`.
    """
    if unit in SI:
        return unit
    try:
        found = conversion(unit, **sizes).unit if unit else ""
    except DataError:
        return ""
    return found if found in SI else ""


def _several_powers(unit: str) -> bool:
    """Whether pint would raise a power to a power for the words of a unit: ``9 squared cubed``."""
    return len(_WORDS_OF_POWERS.findall(unit)) > 1


def _sizes(unit: str, target: str, given: Mapping[str, tuple[float | None, str]]) -> dict[str, float]:
    """The sizes of the units that depend on the hardware and occur in one of the two.

    Args:
        unit, target: the two units.
        given: the size of each such unit, or None, and the argument that gives it.

    Raises:
        DataError: for one whose size is not given, or not positive.
    """
    sizes: dict[str, float] = {}
    for word in re.findall(r"[A-Za-z]+", f"{unit} {target}"):
        key = word.lower().removesuffix("s")
        if key in given:
            value, argument = given[key]
            if value is None or not 0 < value < inf:
                raise DataError(
                    f"unit {unit!r}: the size of a {word!r} is not known; give {argument}, a positive number",
                    arguments=(argument,),
                )
            sizes[key] = value
    return sizes


def _spelling(unit: str) -> str:
    """The unit with the signs and words that pint reads; raised digits become powers."""
    unit = re.sub("[⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda power: f"^{power[0].translate(_LOWERED)}", unit)
    for sign, word in {"·": "*", "²": "^2", "Ω": "ohm", "%": "percent", "°": "deg", "PWM": "pwm", "RPM": "rpm"}.items():
        unit = unit.replace(sign, word)
    unit = re.sub(r"\bcounts?\b", "encoder_count", unit)  # pint's own count is a number without unit
    unit = re.sub(r"\brevs?\b", "revolution", unit)
    unit = re.sub(r"\b([mk]?N)m\b", r"\1*m", unit)  # a torque; pint alone would read nanometres
    return normalize("NFKC", unit)


@cache
def _registry(
    turn_per_count: float | None, volt_per_pwm: float | None, second_per_sample: float | None, pairs: float | None
) -> pint.UnitRegistry[float]:
    import pint

    registry: pint.UnitRegistry[float] = pint.UnitRegistry()
    if turn_per_count is not None:
        registry.define(f"encoder_count = {2 * pi * turn_per_count} radian")
    if volt_per_pwm is not None:
        registry.define(f"pwm = {volt_per_pwm} volt")
    if second_per_sample is not None:
        registry.define(f"sample = {second_per_sample} second")
    if pairs is not None:
        registry.define(f"erpm = {2 * pi / 60 / pairs} radian / second")
    return registry
