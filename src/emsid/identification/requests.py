"""Checks of the requested models and options before anything is fitted.

A request that no model can meet is an error; a request that some models cannot meet is a finding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, TypeVar

import numpy as np

from emsid.arguments import as_names_with_commas, did_you_mean
from emsid.errors import ModelError
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES, Physical, left_out
from emsid.models.plants.datasheet import Given, applicable, as_datasheet, without_tolerances
from emsid.models.plants.parameters import find_handle, full_name, parts, without_overlap
from emsid.models.plants.plant import Plant
from emsid.options import Options
from emsid.plant.motor import read_number
from emsid.record import Record

T = TypeVar("T")


def model_names(models: str | Iterable[str]) -> tuple[str, ...]:
    """The names of the models, each once; a text is one name, or several with commas.

    Raises:
        ModelError: for an unknown name, or without a name.
    """
    names = tuple(dict.fromkeys(as_names_with_commas(models)))
    unknown = [str(name) for name in names if name not in CANDIDATES]
    if unknown or not names:
        what = f"no model is called {', '.join(unknown)}" if unknown else "no model is named"
        near = did_you_mean(unknown[0], CANDIDATES) if unknown else ""
        raise ModelError(f"{what}; there are {', '.join(CANDIDATES)}{near}", arguments=("models",))
    return names


def plants_of(models: Sequence[str], options: Options) -> dict[str, Plant]:
    """The plants of the physical models, before the search."""
    return {name: each.coded(options) for name in models if isinstance(each := CANDIDATES[name], Physical)}


def understood(options: Options, models: Sequence[str]) -> Options:
    """The options with full names of physical parameters and values in SI units; unknown names are unchanged.

    ``free``, ``fixed`` and ``profile`` may have symbols, ``fixed`` texts with a unit, and ``datasheet`` what
    `emsid.models.plants.datasheet.datasheet` takes.

    Raises:
        ModelError: where all the physical models refuse a value or a datasheet entry; it is the error of the first one.
    """
    plants = {name: each.plant for name in models if isinstance(each := CANDIDATES[name], Physical)}
    if not plants:
        return options

    def of_some(reading: Callable[[Plant], T]) -> T:
        problems: list[ModelError] = []
        for plant in plants.values():
            try:
                return reading(plant)
            except ModelError as problem:
                problems.append(problem)
        raise problems[0]

    def full(name: str) -> str:
        base, bracket, record = name.partition("[")  # of one record
        try:
            return of_some(lambda plant: full_name(plant, base)) + bracket + record
        except ModelError:  # `check_physics` refuses it
            return name

    def value(name: str, typed: float | str) -> float:
        name = name.partition("[")[0]
        if not any(full(name) in plant.handles for plant in plants.values()):
            return np.nan  # likewise
        return of_some(
            lambda plant: read_number(f"{plant.name} {name}", typed, find_handle(plant, name).parameter.unit)
        )

    fixed, tolerances = without_tolerances(options.fixed)
    values = {full(name): value(name, typed) for name, typed in fixed.items()}
    if len(values) < len(fixed):
        twice = next(full(a) for a, b in combinations(fixed, 2) if full(a) == full(b))
        raise ModelError(f"{twice} is given twice; leave one of them out", arguments=("fixed",))
    if wrong := [name for name, each in values.items() if np.isinf(each)]:
        raise ModelError(f"{wrong[0]}: give a finite number", arguments=("fixed",))
    sheet: Mapping[str, Any] = options.datasheet
    if not all(isinstance(each, Given) for each in sheet.values()):
        sheet = of_some(lambda plant: as_datasheet(plant, sheet))
    sheet = {**sheet, **{full(name): Given(values[full(name)], part) for name, part in tolerances.items()}}
    return replace(
        options,
        free=tuple(map(full, options.free)),
        per_record=tuple(map(full, options.per_record)),
        profile=tuple(map(full, options.profile)),
        fixed=values,
        datasheet=sheet,
    )


def check_physics(plants: Mapping[str, Plant], models: Sequence[str], options: Options) -> None:
    """Refuse options for physical parameters that none of the models has.

    Raises:
        ModelError: with the names of the parameters and the possible ones.
    """
    _check_datasheet(plants, models, options)
    _check_there_are_plants(plants, models, options)
    for name in options.profile:
        _check_profile(plants, name, options)
    for name in (*options.fixed, *options.free, *options.per_record):
        _owners(plants, name)


def _check_datasheet(plants: Mapping[str, Plant], models: Sequence[str], options: Options) -> None:
    sheet = options.datasheet
    if sheet and not any(applicable(sheet, plant) for plant in plants.values()):
        usable = [n for n, each in CANDIDATES.items() if isinstance(each, Physical) and applicable(sheet, each.plant)]
        raise ModelError(
            f"the datasheet has no parameter of {', '.join(models)}; choose a model that has some of them: "
            f"{', '.join(usable)}",
            arguments=("models",),
        )


def _check_there_are_plants(plants: Mapping[str, Plant], models: Sequence[str], options: Options) -> None:
    asked = {"fixed": options.fixed, "free": options.free, "profiled": options.profile}
    asked |= {"estimated for each record": options.per_record}
    if any(asked.values()) and not plants:
        what, names = next((what, names) for what, names in asked.items() if names)
        usable = [name for name, each in CANDIDATES.items() if isinstance(each, Physical)]
        raise ModelError(
            f"{', '.join(names)} cannot be {what}, because {', '.join(models)} has no physical parameters; models that "
            f"have are {', '.join(usable)}",
            arguments=("models",),
        )


def _check_profile(plants: Mapping[str, Plant], name: str, options: Options) -> None:
    def not_fixed(plant: Plant, names: Iterable[str]) -> tuple[str, ...]:
        return without_overlap(plant, names, [known for known in options.fixed if known in plant.handles])

    owners = _owners(plants, name)
    if not any(not_fixed(owner, [name]) for owner in owners):
        others = [other for other in owners[0].handles if not_fixed(owners[0], [other])]
        raise ModelError(
            f"{name} is fixed, so it has no profile; {owners[0].name} also has {', '.join(others)}",
            arguments=("fixed", "profile"),
        )
    if options.free and not any({name, *parts(owner, name)} & set(options.free) for owner in owners):
        raise ModelError(
            f"{name} is not estimated, so it has no profile; add it to the free parameters, or take a profile of one "
            f"of these: {', '.join(options.free)}",
            arguments=("free", "profile"),
        )


def _owners(plants: Mapping[str, Plant], name: str) -> list[Plant]:
    """The plants that have a parameter.

    Raises:
        ModelError: where none has it.
    """
    name = name.partition("[")[0]
    owners = [plant for plant in plants.values() if name in plant.handles]
    if not owners:
        find_handle(next(iter(plants.values())), name)  # raises an error that lists the known names
    return owners


def unused_requests(
    plants: Mapping[str, Plant], models: Sequence[str], options: Options, record: Record, *, quick: bool = False
) -> list[Finding]:
    """Options that some of the models do not use, and the usual models that a quick look leaves out."""
    findings = [left_out(record, models)] if quick else []
    findings += [
        Finding("datasheet-not-used", name, {"model": name})
        for name, plant in plants.items()
        if options.datasheet and not applicable(options.datasheet, plant)
    ]
    findings += [
        Finding("option-not-used", option, {"models": list(models)})
        for option in options.given
        if option != "codes"  # `_about_codes` says more
        and not any(option in CANDIDATES[name].uses for name in models)
    ]
    family = options.static
    if family is not None and not family.sizes and options.knots is not None:
        findings += [
            Finding("knots-not-used", name, {"model": name, "family": family.name})
            for name in models
            if "static" in CANDIDATES[name].uses
        ]
    return findings + _about_codes(plants, models, options, record)


def codes_of_channel(options: Options, record: Record) -> Options:
    """The options with codes as values of the channel; they are given as the numbers of the file, as in a mask."""
    channel = record.input_names[-1]
    return replace(options, codes=tuple((record.converted(channel, code), state) for code, state in options.codes))


def _about_codes(plants: Mapping[str, Plant], models: Sequence[str], options: Options, record: Record) -> list[Finding]:
    """Values given as codes that never occur, and models that have no codes."""
    if not options.codes:
        return []
    channel = record.input_names[-1]
    values = [float(value) for value, _ in options.codes]
    present = [value for value in values if record.converted(channel, value) in record.input[:, -1]]
    without = [name for name in models if name not in plants] if present else []
    return [
        *(Finding("code-never-occurs", channel, {"value": value}) for value in values if value not in present),
        *(Finding("codes-taken-as-commands", name, {"model": name, "values": present}) for name in without),
    ]
