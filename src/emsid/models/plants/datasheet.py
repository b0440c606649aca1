"""Datasheets: known values of a plant, their tolerances, and unknown parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from emsid.errors import ModelError
from emsid.models.plants.by_name import by_full_name
from emsid.models.plants.parameters import find_handle, refuse_overlap
from emsid.models.plants.plant import Plant
from emsid.models.plants.registry import PLANTS, described
from emsid.plant.friction import FrictionLaw, find_law
from emsid.plant.motor import read_number

UNKNOWN = "unknown"
"""The entry of a datasheet for a parameter without a known value."""


@dataclass(frozen=True)
class Given:
    """The entry of a datasheet for a parameter.

    Args:
        value: in SI units; None if unknown.
        tolerance: relative tolerance of the value; None for a value that is only a start.

    Raises:
        ModelError: for a value that is not finite, or a tolerance that is negative or has no value.
    """

    value: float | None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.value is not None and not isfinite(self.value):
            raise ModelError(f"datasheet value {self.value}; give a finite number, or say that it is unknown")
        if self.tolerance is not None and (self.value is None or not 0 <= self.tolerance < inf):
            raise ModelError(f"datasheet tolerance {self.tolerance} of {self.value}; give a value and a part of it")

    @property
    def limits(self) -> tuple[float, float] | None:
        """The limits of the tolerance, ascending; None without a tolerance."""
        if self.value is None or self.tolerance is None:
            return None
        low, high = sorted((self.value * (1 - self.tolerance), self.value * (1 + self.tolerance)))
        return low, high


def datasheet(kind: str, table: Mapping[str, Any]) -> dict[str, Given]:
    """A datasheet from a table, for example from a TOML file; parameters may be left out.

    >>> sheet = datasheet("motor", {"resistance": {"value": "2 ohm", "tolerance": "10 %"}, "rotor_inertia": "unknown"})
    >>> sheet["resistance"].limits, sheet["rotor_inertia"].value
    ((1.8, 2.2), None)

    Args:
        kind: kind of plant, a key of `registry.described()`.
        table: for every parameter by its name a number in SI units, a text with a unit, ``"unknown"``, or a table
            ``{value = …, tolerance = "10 %"}``; a list of two is [forward, backward]. Tables may be nested: the
            entry `coulomb` in the table `rotor_friction` is `rotor_friction.coulomb`.

    Raises:
        ModelError: for an unknown name, a value with a wrong unit or outside its physical bounds, a tolerance without
            a value, or a parameter given twice.
    """
    known = described()
    if kind not in known:
        raise ModelError(f"no datasheet of a {kind}; there are {', '.join(known)}")
    return _sheet(known[kind], kind, table)


def as_datasheet(plant: Plant, known: Mapping[str, Any] | None) -> dict[str, Given]:
    """The known values of a plant by the full names of its parameters.

    Args:
        plant: whose parameters they are.
        known: by name or symbol a `Given`, or what a table of `datasheet` may have.

    Raises:
        ModelError: as `datasheet` does.
    """
    if known is None or not isinstance(known, Mapping) or all(isinstance(each, Given) for each in known.values()):
        return by_full_name(plant, "datasheet", known)
    return by_full_name(plant, "datasheet", _sheet(plant, plant.name, known))


def _sheet(plant: Plant, kind: str, table: Mapping[str, Any]) -> dict[str, Given]:
    """The entries of a table, checked by the plant that they are of."""
    entries, laws = dict(_leaves(table)), dict[str, FrictionLaw]()
    for name in [name for name in entries if name.endswith(".law")]:
        laws[name.removesuffix(".law")] = find_law(entries.pop(name))()
    plant, sheet = plant.with_frictions(laws) if laws else plant, dict[str, Given]()
    for name, entry in entries.items():
        if isinstance(entry, (list, tuple)):
            if len(entry) != 2 or f"{name}.forward" not in plant.handles:
                raise ModelError(f"{kind} {name} is {entry!r}; only frictions take a pair, [forward, backward]")
            for side, one in zip(("forward", "backward"), entry, strict=True):
                sheet[f"{name}.{side}"] = _given(plant, kind, f"{name}.{side}", one)
        else:
            sheet[name] = _given(plant, kind, name, entry)
    refuse_overlap(plant, sheet)
    return sheet


def applicable(sheet: Mapping[str, Given], plant: Plant) -> dict[str, Given]:
    """The entries of a datasheet that apply to a plant.

    For example, a rigid motor has no shaft and no inductance.
    """
    kind = next((each.described for each in PLANTS.values() if each.plain.name == plant.name), plant)
    if not set(sheet) <= set(kind.handles) | set(plant.handles):
        return {}
    return {name: given for name, given in sheet.items() if name in plant.handles and name not in plant.absent}


def without_tolerances(fixed: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, float]]:
    """Fixed values, and the tolerances as fractions of those that are texts with one.

    >>> without_tolerances({"resistance": "2 ohm ± 5 %", "rotor_viscous": 0.0})
    ({'resistance': '2 ohm', 'rotor_viscous': 0.0}, {'resistance': 0.05})

    Raises:
        ModelError: for a tolerance that is not a percentage.
    """
    values, tolerances = {}, {}
    for name, value in fixed.items():
        parts = re.split(r"\s*(?:±|\+/?-)\s*", value, maxsplit=1) if isinstance(value, str) else [value]
        values[name] = parts[0]
        if len(parts) > 1:
            tolerances[name] = _part(name, parts[1])
    return values, tolerances


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every parameter with its dotted name; a table of ``value`` and ``tolerance`` is one entry."""
    for key, entry in table.items():
        if isinstance(entry, Mapping) and not {"value", "tolerance"} & set(entry):
            yield from _leaves(entry, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", entry


def _given(plant: Plant, kind: str, name: str, entry: Any) -> Given:
    if isinstance(entry, Given):
        return entry
    handle = find_handle(plant, name)
    what = f"{kind} {name}"
    value, tolerance = entry, None
    if isinstance(entry, Mapping):
        strange = sorted(set(entry) - {"value", "tolerance"})
        if strange or "value" not in entry:
            raise ModelError(f'{what} has {", ".join(entry)}; write {{ value = …, tolerance = "10 %" }}')
        value = entry["value"]
        tolerance = _part(what, entry["tolerance"]) if "tolerance" in entry else None
    if value == UNKNOWN:
        if tolerance is not None:
            raise ModelError(f"{what} is unknown and has a tolerance; give the value that it belongs to")
        return Given(None)
    number = read_number(what, value, handle.parameter.unit)
    if not (isfinite(number) and handle.lower <= number <= handle.upper):
        raise ModelError(f"{what} is {handle.with_unit(number, 6)}; {handle.allowed}")
    return Given(number, tolerance)


def _part(what: str, tolerance: Any) -> float:
    """A tolerance as a fraction: ``"10 %"`` or 0.1."""
    if isinstance(tolerance, (int, float)) and not isinstance(tolerance, bool) and 0 <= tolerance < 1:
        return float(tolerance)
    text = re.fullmatch(r"\s*[±]?\s*(\d+\.?\d*|\.\d+)\s*%\s*", tolerance) if isinstance(tolerance, str) else None
    if text is None:
        raise ModelError(f"{what} has a tolerance of {tolerance!r}; write it as '10 %' or 0.1")
    return float(text[1]) / 100
