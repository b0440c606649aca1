"""What was asked for, checked before anything is fitted.

What no model can do is an error; what some of the models cannot do is a finding.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from emsid.arguments import as_names_with_commas, did_you_mean
from emsid.errors import ModelError
from emsid.findings import Finding
from emsid.identification.candidates import CANDIDATES, Blocks, Options, Physical
from emsid.models.plants.datasheet import applicable
from emsid.models.plants.parameters import find_handle, parts, without_overlap
from emsid.models.plants.plant import DrivenPlant
from emsid.record import Record


def model_names(models: str | Iterable[str]) -> tuple[str, ...]:
    """The names of the models, each once; a text is one name, or several with commas.

    Raises:
        ModelError: for a name that there is not, or without any.
    """
    names = tuple(dict.fromkeys(as_names_with_commas(models)))
    unknown = [str(name) for name in names if name not in CANDIDATES]
    if unknown or not names:
        what = f"no model is called {', '.join(unknown)}" if unknown else "no model is named"
        near = did_you_mean(unknown[0], CANDIDATES) if unknown else ""
        raise ModelError(f"{what}; there are {', '.join(CANDIDATES)}{near}", arguments=("models",))
    return names


def plants_of(models: Sequence[str], options: Options) -> dict[str, DrivenPlant]:
    """The physical ones among the models, as they are before the search."""
    return {name: each.coded(options) for name in models if isinstance(each := CANDIDATES[name], Physical)}


def check_physics(plants: Mapping[str, DrivenPlant], models: Sequence[str], options: Options) -> None:
    """Refuse what is asked of physical parameters that none of the models has.

    Raises:
        ModelError: naming the parameters, and what there is instead.
    """
    _check_datasheet(plants, models, options)
    _check_there_are_plants(plants, models, options)
    for name in options.profile:
        _check_profile(plants, name, options)
    for name in (*options.fixed, *options.free):
        _owners(plants, name)


def _check_datasheet(plants: Mapping[str, DrivenPlant], models: Sequence[str], options: Options) -> None:
    sheet = options.datasheet
    if sheet and not any(applicable(sheet, plant) for plant in plants.values()):
        usable = [n for n, each in CANDIDATES.items() if isinstance(each, Physical) and applicable(sheet, each.plant)]
        raise ModelError(
            f"the datasheet has no parameter of {', '.join(models)}; choose a model that has some of them: "
            f"{', '.join(usable)}",
            arguments=("models",),
        )


def _check_there_are_plants(plants: Mapping[str, DrivenPlant], models: Sequence[str], options: Options) -> None:
    asked = {"fixed": options.fixed, "free": options.free, "profiled": options.profile}
    if any(asked.values()) and not plants:
        what, names = next((what, names) for what, names in asked.items() if names)
        usable = [name for name, each in CANDIDATES.items() if isinstance(each, Physical)]
        raise ModelError(
            f"{', '.join(names)} cannot be {what}, because {', '.join(models)} has no physical parameters; models that "
            f"have are {', '.join(usable)}",
            arguments=("models",),
        )


def _check_profile(plants: Mapping[str, DrivenPlant], name: str, options: Options) -> None:
    def not_fixed(plant: DrivenPlant, names: Iterable[str]) -> tuple[str, ...]:
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


def _owners(plants: Mapping[str, DrivenPlant], name: str) -> list[DrivenPlant]:
    """The plants that have a parameter.

    Raises:
        ModelError: where none has it.
    """
    owners = [plant for plant in plants.values() if name in plant.handles]
    if not owners:
        find_handle(next(iter(plants.values())), name)  # raises an error that lists what there is
    return owners


def unused_requests(
    plants: Mapping[str, DrivenPlant], models: Sequence[str], options: Options, record: Record
) -> list[Finding]:
    """What was asked for and some of the models cannot use."""
    findings = [
        Finding("datasheet-not-used", name, {"model": name})
        for name, plant in plants.items()
        if options.datasheet and not applicable(options.datasheet, plant)
    ]
    findings += [
        Finding("option-not-used", option, {"models": list(models)})
        for option in options.given
        if not any(option in CANDIDATES[name].uses for name in models)
    ]
    family = options.static
    if family is not None and not family.sizes and options.knots is not None:
        findings += [
            Finding("knots-not-used", name, {"model": name, "family": family.name})
            for name in models
            if isinstance(CANDIDATES[name], Blocks)
        ]
    return findings + _about_codes(plants, models, options, record)


def _about_codes(
    plants: Mapping[str, DrivenPlant], models: Sequence[str], options: Options, record: Record
) -> list[Finding]:
    """Values given as codes that never occur, and models that have no codes."""
    if not options.codes:
        return []
    values = [float(value) for value, _ in options.codes]
    absent = [value for value in values if value not in record.input[:, -1]]
    return [
        *(Finding("code-never-occurs", record.input_names[-1], {"value": value}) for value in absent),
        *(
            Finding("codes-taken-as-commands", name, {"model": name, "values": values})
            for name in models
            if name not in plants
        ),
    ]
