r"""Effects that some motors have beside (4.1)–(4.11), each a row of a table and a term in a function.

A row of `Effects` declares a parameter: name, neutral value, symbol, unit and meaning. The plant, its handles, files
and messages have it from there. The terms are functions of the parameters by name, which `one_mass.move` calls where
the mass moves; `resistance` is that of everything that changes the resistance of the winding. With a row in
`emsid.models.plants.search.moves`, a search finds the effect. The rows of `Winding` are those of the resistance, which
a brushless motor has too.

The resistance is R = R_a·(1 + ρ). The winding is one thermal mass with the copper loss P, which is R·i², or
3/2·R·(i_d² + i_q²) of a brushless motor: its temperature rises by

    dΔϑ/dt = h·P − k·Δϑ,      ρ = α·Δϑ,

with the heating h = 1/C and the cooling k = 1/(C·R_th). Only h·α/R_a has an effect where no current is measured. A rise
that the copper loss does not explain, such as that by the heat of a machine, is a drift, dρ/dt = d, until |ρ| reaches
ρ_d. A run begins at the rise ρ₀. Both are how a record leaves the motor (`as_left`): at the start of the first segment
of a fit ρ is zero, so that R_a is the resistance there, and the drift goes on. Where the temperature ϑ of the winding
is logged, ρ = α·(ϑ − 20 °C), and no other row has an effect.

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
REFERENCE = 20.0
"""Temperature in °C at which the resistance holds where the temperature of the winding is logged (IEC 60028)."""
TEMPERATURES = ("degC", "°C")
"""Units of a temperature of the winding."""


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
class Winding:
    """The parameters of a resistance that changes; a winding whose resistance is constant has their neutral values.

    Args:
        winding: by name, see `Winding`.
    """

    heating: float = row("h", "K/J", "rise of temperature per copper loss")
    cooling: float = row("k", "1/s", "rate at which the winding cools", upper=QUICKEST, beside="heating")
    temperature_coefficient: float = row(
        "α", "1/K", "temperature coefficient of the resistance", neutral=COPPER, beside="heating"
    )
    winding_drift: float = row("d", "1/s", "drift of the resistance, as a part of it", lower=-inf)
    drift_end: float = row("ρ_d", "1", "rise at which the drift ends", neutral=inf, beside="winding_drift")
    winding_rise: float = row("ρ₀", "1", "rise of the resistance where a run begins, as a part", lower=LEAST - 1.0)


@dataclass(frozen=True, kw_only=True)
class Effects(Winding):
    """The parameters of effects; a motor that has none of them has their neutral values.

    Args:
        effects: by name, see `Effects`.
    """

    viscous_backward: float = row(
        "ΔB", "N*m*s/rad", "further viscous friction backward; below zero, forward", Measure.DAMPING, lower=-inf
    )
    voltage_drop: float = row("V_d", "V", "constant voltage drop of the bridge, against the current", Measure.COMMAND)
    quadratic_viscous: float = row("B_q", Measure.QUADRATIC.unit(), "quadratic viscous friction", Measure.QUADRATIC)


WINDING: tuple[Field[Any], ...] = fields(Winding)
ROWS: tuple[Field[Any], ...] = fields(Effects)


def with_rows(text: str | None) -> str:
    """A docstring with every row in place of its line about `Winding` or `Effects`."""
    text = text or ""
    for name, rows in (("winding", WINDING), ("effects", ROWS)):
        about = [f"        {r.name}: {r.metadata['description']}, in {r.metadata['unit']}." for r in rows]
        text = text.replace(f"        {name}: by name, see `{name.capitalize()}`.", "\n".join(about))
    return text


Winding.__doc__, Effects.__doc__ = with_rows(Winding.__doc__), with_rows(Effects.__doc__)
NAMES = tuple(each.name for each in ROWS)
ON_RESISTANCE = tuple(each.name for each in WINDING)
"""Rows whose terms are in `resistance`, or in the state that it has."""
_named: Any = namedtuple  # of names that no type checker can know
Acting = _named("Acting", ("loss", *ON_RESISTANCE))
"""The parameters of a winding by name, for kernels, and before them its copper loss in W at the resistance R_a for a
torque of 1 N·m (of a brushless motor for an amplitude of 1 A); 0 where nothing acts on the resistance."""
NEUTRAL = Acting(0.0, *astuple(Winding()))
"""Nothing acts."""
_OF_THEMSELVES = [(r.name, r.default) for r in WINDING if not r.metadata["beside"]]
OF_ONE_MASS = tuple(name for name in NAMES if name != "quadratic_viscous")
"""Rows that only one mass has."""


def _rows_of(winding: Winding) -> tuple[Field[Any], ...]:
    return ROWS if isinstance(winding, Effects) else WINDING


@cache
def effect_handles(of: type[Winding] = Effects) -> Mapping[str, Handle]:
    """The handles of the rows."""
    found: dict[str, Handle] = {}
    for each in fields(of):
        about = each.metadata
        parameter = Parameter(each.name, about["symbol"], about["unit"], about["description"])
        found |= scalar((each.name,), parameter, about["measure"], about["lower"], about["upper"])
    return found


def idle(values: Mapping[str, float]) -> frozenset[str]:
    """The rows without effect among parameters by name: those at their neutral value, and those beside one that is."""
    off = {each.name for each in ROWS if values.get(each.name, each.default) == each.default}
    return frozenset(each.name for each in ROWS if each.name in off or each.metadata["beside"] in off)


def beside_nothing(winding: Winding, logged: bool = False) -> tuple[str, ...]:
    """The rows that have no effect because the parameter that they are beside is zero, or a temperature is logged."""
    if logged:
        return tuple(name for name in ON_RESISTANCE if name != "temperature_coefficient")
    rows = _rows_of(winding)
    off = idle({each.name: getattr(winding, each.name) for each in rows})
    return tuple(each.name for each in rows if each.metadata["beside"] in off)


def check_effects(what: str, winding: Winding) -> None:
    """Refuse values outside their bounds.

    Raises:
        ModelError: naming ``what`` has it.
    """
    for each in _rows_of(winding):
        value, lower = getattr(winding, each.name), each.metadata["lower"]
        if not ((isfinite(value) or value == each.default) and value >= lower):
            allowed = "must be finite" if lower == -inf else f"must be at least {lower:g} and finite"
            raise ModelError(f"{what} with {each.name} ({each.metadata['symbol']}) {value}; it {allowed}")


def acting(winding: Winding, loss: float, logged: bool = False) -> Any:
    """The numbers for a kernel, of a motor that a voltage drives.

    Args:
        winding: the parameters.
        loss: see `Acting`.
        logged: whether its temperature is logged, so that it neither heats nor drifts by itself.
    """
    if not (logged or acts_on_resistance(winding)):
        return NEUTRAL
    rows = Winding(temperature_coefficient=winding.temperature_coefficient) if logged else winding
    return Acting(1.0 * loss, *(1.0 * getattr(rows, name) for name in ON_RESISTANCE))


def depends_on_speed(e: Any) -> bool:
    """Whether the resistance depends on the speed, so that a step needs it in its middle."""
    at_rest, moving = (resistance.py_func(e, speed, 0.0) for speed in (0.0, 1.0))  # type: ignore[attr-defined]
    return bool(e.loss > 0 and at_rest != moving)


def as_left(rise: float) -> dict[str, float]:
    """The values of a motor that a record has left with a rise ρ of its resistance: there it begins, without drift."""
    return {"winding_rise": max(rise, LEAST - 1.0), "drift_end": abs(rise)}


def acts_on_resistance(winding: Winding) -> bool:
    """Whether the resistance is another one than R_a, or becomes one."""
    return any(getattr(winding, name) != neutral for name, neutral in _OF_THEMSELVES)


def equation_of_rise(winding: Winding, loss: str, logged: bool = False) -> str:
    """The equation of ρ with a copper loss in symbols; empty where the resistance is constant."""
    if logged:
        return "ρ = α·(ϑ − 20 °C)"
    if not acts_on_resistance(winding):
        return ""
    return f"dρ/dt = {f'α·h·{loss} − k·ρ' if winding.heating > 0 else 'd, |ρ| ≤ ρ_d'}"


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
def risen(e: Any, rise: float, loss: float, h: float) -> float:
    """ρ after a time h in s.

    Args:
        e: the parameters of the effects by name.
        rise: ρ before.
        loss: the copper loss P in W.
        h: in s.
    """
    if e.heating > 0.0:
        rate = e.temperature_coefficient * e.heating * loss - e.cooling * rise
        rise += h * rate / (1.0 + 0.5 * h * e.cooling)
    if e.winding_drift != 0.0 and abs(rise) < e.drift_end:
        rise = max(min(rise + h * e.winding_drift, e.drift_end), -e.drift_end)
    return rise
