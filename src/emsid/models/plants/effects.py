r"""Effects that some motors have beside (4.1)–(4.11), each a row of a table and a term in a function.

A row of `Effects` declares a parameter: name, neutral value, symbol, unit and meaning. The plant, its handles, files
and messages have it from there. The terms are functions of the parameters by name, which `one_mass.move` calls where
the mass moves; `resistance` is that of everything that changes the resistance of the winding. With a row in
`emsid.models.plants.search.moves`, a search finds the effect.

The resistance is R = R_a·(1 + ρ). The winding is one thermal mass with the copper loss R·i²: its temperature rises by

    dΔϑ/dt = h·R·i² − k·Δϑ,      ρ = α·Δϑ,

with the heating h = 1/C and the cooling k = 1/(C·R_th). Only h·α/R_a has an effect where no current is measured. A rise
that the copper loss does not explain, such as that by the heat of a machine, is a drift, dρ/dt = d, until |ρ| reaches
ρ_d. A run begins at the rise ρ₀. Both are how a record leaves the motor (`as_left`): at the start of the first segment
of a fit ρ is zero, so that R_a is the resistance there, and the drift goes on.

References:
    IEC 60028, *International standard of resistance for copper* (1925), on α. Krishnan, *Permanent Magnet Synchronous
    and Brushless DC Motor Drives* (2010), sec. 9.2, on one thermal mass.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Mapping
from dataclasses import Field, astuple, dataclass, field, fields
from functools import cache
from math import inf, isfinite
from typing import Any

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.models.plants.parameters import Handle, scalar
from emsid.plant.parameter import Measure, Parameter

COPPER = 0.00393
"""Temperature coefficient of copper in 1/K, at 20 °C (IEC 60028)."""
LEAST = 0.05
"""The smallest resistance over R_a: far below that of any winding, it keeps a search from passing zero."""

QUICKEST = 1.0
"""The quickest cooling in 1/s. A winding of 8 mm diameter takes 4.2 s (data sheet of a motor of 4.5 g), any larger one
longer; below a second, a heating stands for whatever depends on the current."""


def row(
    symbol: str,
    unit: str,
    description: str,
    measure: Measure = Measure.OTHER,
    *,
    neutral: float = 0.0,
    lower: float = 0.0,
    upper: float = inf,
    beside: str = "",
) -> Any:
    """A parameter of an effect.

    Args:
        symbol, unit, description, measure: as in `emsid.plant.parameter.Parameter`.
        neutral: its value where nothing is known.
        lower: physical bound.
        upper: the most that a fit takes.
        beside: another parameter; where that is zero, this one has no effect.
    """
    about = {"symbol": symbol, "unit": unit, "description": description, "measure": measure}
    return field(default=neutral, metadata={**about, "lower": lower, "upper": upper, "beside": beside})


@dataclass(frozen=True, kw_only=True)
class Effects:
    """The parameters of effects; a motor that has none of them has their neutral values.

    Args:
        effects: by name, see `Effects`.
    """

    viscous_backward: float = row(
        "ΔB", "N*m*s/rad", "further viscous friction backward; below zero, forward", Measure.DAMPING, lower=-inf
    )
    voltage_drop: float = row("V_d", "V", "constant voltage drop of the bridge, against the current", Measure.COMMAND)
    quadratic_viscous: float = row("B_q", Measure.QUADRATIC.unit(), "quadratic viscous friction", Measure.QUADRATIC)
    heating: float = row("h", "K/J", "rise of temperature per copper loss")
    cooling: float = row("k", "1/s", "rate at which the winding cools", upper=QUICKEST, beside="heating")
    temperature_coefficient: float = row(
        "α", "1/K", "temperature coefficient of the resistance", neutral=COPPER, beside="heating"
    )
    winding_drift: float = row("d", "1/s", "drift of the resistance, as a part of it", lower=-inf)
    drift_end: float = row("ρ_d", "1", "rise at which the drift ends", neutral=inf, beside="winding_drift")
    winding_rise: float = row("ρ₀", "1", "rise of the resistance where a run begins, as a part", lower=LEAST - 1.0)


ROWS: tuple[Field[Any], ...] = fields(Effects)


def with_rows(text: str | None) -> str:
    """A docstring with every row in place of its line about `Effects`."""
    about = [f"        {r.name}: {r.metadata['description']}, in {r.metadata['unit']}." for r in ROWS]
    return (text or "").replace("        effects: by name, see `Effects`.", "\n".join(about))


Effects.__doc__ = with_rows(Effects.__doc__)
NAMES = tuple(each.name for each in ROWS)
_named: Any = namedtuple  # of names that no type checker can know
Acting = _named("Acting", ("resistance", "motor_constant", *NAMES))
"""The parameters of the effects by name, for kernels, with R_a and K_m; R_a is 0 where none acts on the resistance."""
NEUTRAL = Acting(0.0, 0.0, *astuple(Effects()))
"""Nothing acts."""
ON_FRICTION = ("viscous_backward", "voltage_drop", "quadratic_viscous")
"""Rows whose terms are in the friction and the drop of `one_mass.Sliding`; all others act on the resistance."""
ON_RESISTANCE = tuple(name for name in NAMES if name not in ON_FRICTION)
"""Rows whose terms are in `resistance`, or in the state that it has."""
_OF_THEMSELVES = [(r.name, r.default) for r in ROWS if r.name in ON_RESISTANCE and not r.metadata["beside"]]
OF_ONE_MASS = tuple(name for name in NAMES if name != "quadratic_viscous")
"""Rows that only one mass has."""


@cache
def effect_handles() -> Mapping[str, Handle]:
    """The handles of the rows."""
    found: dict[str, Handle] = {}
    for each in ROWS:
        about = each.metadata
        parameter = Parameter(each.name, about["symbol"], about["unit"], about["description"])
        found |= scalar((each.name,), parameter, about["measure"], about["lower"], about["upper"])
    return found


def idle(values: Mapping[str, float]) -> frozenset[str]:
    """The rows without effect among parameters by name: those at their neutral value, and those beside one that is."""
    off = {each.name for each in ROWS if values.get(each.name, each.default) == each.default}
    return frozenset(each.name for each in ROWS if each.name in off or each.metadata["beside"] in off)


def values_of(effects: Effects) -> dict[str, float]:
    """The value of every row by its name."""
    return {name: getattr(effects, name) for name in NAMES}


def beside_nothing(effects: Effects) -> tuple[str, ...]:
    """The rows that have no effect because the parameter that they are beside is zero."""
    off = idle(values_of(effects))
    return tuple(each.name for each in ROWS if each.metadata["beside"] in off)


def check_effects(what: str, effects: Effects) -> None:
    """Refuse values outside their bounds.

    Raises:
        ModelError: naming ``what`` has it.
    """
    for each in ROWS:
        value, lower = getattr(effects, each.name), each.metadata["lower"]
        if not ((isfinite(value) or value == each.default) and value >= lower):
            allowed = "must be finite" if lower == -inf else f"must be at least {lower:g} and finite"
            raise ModelError(f"{what} with {each.name} ({each.metadata['symbol']}) {value}; it {allowed}")


def acting(effects: Effects, resistance: float, motor_constant: float) -> Any:
    """The numbers for a kernel, of a motor that a voltage drives."""
    if not acts_on_resistance(effects):
        return NEUTRAL
    return Acting(1.0 * resistance, 1.0 * motor_constant, *(1.0 * value for value in values_of(effects).values()))


def depends_on_speed(e: Any) -> bool:
    """Whether the resistance depends on the speed, so that a step needs it in its middle."""
    at_rest, moving = (resistance.py_func(e, speed, 0.0) for speed in (0.0, 1.0))  # type: ignore[attr-defined]
    return bool(e.resistance > 0 and at_rest != moving)


def as_left(rise: float) -> dict[str, float]:
    """The values of a motor that a record has left with a rise ρ of its resistance: there it begins, without drift."""
    return {"winding_rise": max(rise, LEAST - 1.0), "drift_end": abs(rise)}


def acts_on_resistance(effects: Effects) -> bool:
    """Whether the resistance is another one than R_a, or becomes one."""
    return any(getattr(effects, name) != neutral for name, neutral in _OF_THEMSELVES)


@njit(nogil=True, error_model="numpy", inline="always")
def resistance(e: Any, speed: float, rise: float) -> float:
    """The resistance over R_a.

    Args:
        e: the parameters of the effects by name.
        speed: without its sign.
        rise: ρ, the state.
    """
    factor = 1.0 + rise
    return max(factor, _LEAST)


_LEAST = LEAST


@njit(nogil=True, error_model="numpy")
def risen(e: Any, rise: float, torque: float, over: float, h: float) -> float:
    """ρ after a time h in s.

    Args:
        e: the parameters of the effects by name.
        rise: ρ before.
        torque: of the armature.
        over: the resistance over R_a.
        h: in s.
    """
    current = torque / e.motor_constant
    loss = e.resistance * over * current * current
    rate = e.temperature_coefficient * e.heating * loss - e.cooling * rise
    if e.heating > 0.0:
        rise += h * rate / (1.0 + 0.5 * h * e.cooling)
    if e.winding_drift != 0.0 and abs(rise) < e.drift_end:
        rise = max(min(rise + h * e.winding_drift, e.drift_end), -e.drift_end)
    return rise
