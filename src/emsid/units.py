"""Units at the door: what a log was written in, and how it becomes SI.

Counts, samples and PWM are units too, once it is said what they stand for: one count is a turn divided by the counts
per revolution, one sample is the sample time, full PWM is the supply voltage.
"""

from __future__ import annotations

import re
from functools import cache
from math import pi
from typing import TYPE_CHECKING, NamedTuple

from emsid.errors import DataError

if TYPE_CHECKING:
    import pint

# The SI unit shown for each quantity; the first with the right dimension is taken.
_SI = ("rad", "rad/s", "rad/s^2", "rad/s^3", "V", "A", "ohm", "H", "s", "m", "m/s", "m/s^2", "N", "N*m", "kg",
       "kg*m^2", "N*s/m", "N*m*s", "V*s", "N/V", "W", "1")  # fmt: skip


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
) -> Conversion:
    """How a value in ``unit`` becomes one in ``target``, by default the SI unit of the same quantity.

    >>> conversion("rpm")
    Conversion(gain=0.10471975511965978, offset=0.0, unit='rad/s')
    >>> conversion("count/sample", sample_time=0.01, counts_per_revolution=621).unit
    'rad/s'

    Args:
        unit: the unit at hand: ``rpm``, ``deg/s``, ``mV``, ``count/sample``, ``pwm``, …
        target: the unit wanted.
        sample_time: seconds in one ``sample``.
        counts_per_revolution: encoder ``count`` per turn.
        supply_voltage: volts at full ``pwm``.
        pwm_full_scale: the ``pwm`` value that is the full supply voltage.

    Raises:
        DataError: for an unknown unit, one of another quantity, or one whose meaning has not been given.
    """
    given = {
        "count": (counts_per_revolution, "--counts-per-revolution"),
        "sample": (sample_time, "--dt"),
        "pwm": (supply_voltage, "--supply-voltage"),
    }
    for word in re.findall(r"[A-Za-z]+", f"{unit} {target or ''}"):
        value, option = given.get(word.lower().rstrip("s"), (1.0, ""))
        if value is None or not value > 0:
            raise DataError(f"unit {unit!r} needs a meaning for {word!r}: give {option} (a positive number)")

    import pint

    registry = _registry(counts_per_revolution, supply_voltage, pwm_full_scale, sample_time)
    try:
        quantity = registry.Quantity(1.0, _spelling(unit))
        if target is None:
            target = next((si for si in _SI if quantity.check(registry.Unit(si).dimensionality)), None)
        if target is None:
            target = f"{quantity.to_base_units().units:~C}"
        wanted = registry.Unit(_spelling(target))
        zero, one = (registry.Quantity(x, quantity.units).to(wanted).magnitude for x in (0.0, 1.0))
    except pint.DimensionalityError as problem:
        raise DataError(f"unit {unit!r} cannot become {target!r}: {problem}") from None
    except Exception as problem:
        raise DataError(
            f"unit {unit!r} is not understood ({problem}); write it as V, rpm, deg/s, count/sample, pwm, …"
        ) from None
    return Conversion(float(one - zero), float(zero), target)


def _spelling(unit: str) -> str:
    """Signs that people put into units, as pint reads them."""
    return re.sub(r"PWM", "pwm", unit.replace("·", "*").replace("²", "^2").replace("Ω", "ohm").replace("%", "percent"))


@cache
def _registry(
    counts_per_revolution: float | None,
    supply_voltage: float | None,
    pwm_full_scale: float,
    sample_time: float | None,
) -> pint.UnitRegistry[float]:
    import pint

    registry: pint.UnitRegistry[float] = pint.UnitRegistry(on_redefinition="ignore")
    if counts_per_revolution is not None:
        registry.define(f"count = {2 * pi / counts_per_revolution} radian = _ = counts")
    if supply_voltage is not None:
        registry.define(f"pwm = {supply_voltage / pwm_full_scale} volt")
    if sample_time is not None:
        registry.define(f"sample = {sample_time} second = _ = samples")
    return registry
