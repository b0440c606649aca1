"""A fit over several records in which some parameters have a value for each of them: one search, one covariance.

The search begins where the records agree best with one value for all (`estimation.simulation_error`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean
from typing import Any

from emsid.errors import ModelError, listed
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.models.plants.by_name import by_full_name, full_names
from emsid.models.plants.by_record import PlantByRecord, in_record, names_of
from emsid.models.plants.initial_state import InitialState
from emsid.models.plants.parameters import full_name, without_overlap
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.between_samples import is_open, straight_if_better
from emsid.models.plants.search.conclusion import concluded
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.plants.search.task import prepare
from emsid.plant.motor import read_number
from emsid.record import Record


def experiments(records: Record | Iterable[Record]) -> list[Record]:
    """The segments of all records, each with the name of its experiment as its source.

    Experiments with the same name are numbered.
    """
    whole = (records,) if isinstance(records, Record) else tuple(records)
    names = [list(dict.fromkeys(record.experiments)) for record in whole]
    labels = iter(names_of([name for some in names for name in some]))
    found = []
    for record, some in zip(whole, names, strict=True):
        label = {name: next(labels) for name in some}
        found += [
            replace(segment, sources=(label[name],))
            for segment, name in zip(record.segments, record.experiments, strict=True)
        ]
    return found


def known_by_record(plant: Plant, fixed: Mapping[str, Any] | None) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Fixed values for all records, and those of one record each: by full name, then by record.

    Args:
        plant: that has the parameters.
        fixed: by name, or by name and record, ``NAME[RECORD]``.
    """
    everywhere: dict[str, Any] = {}
    own: dict[str, dict[str, Any]] = {}
    for name, value in (fixed or {}).items():
        base, bracket, record = name.partition("[")
        if bracket and record.endswith("]"):
            own.setdefault(full_name(plant, base), {})[record[:-1]] = value
        else:
            everywhere[name] = value
    return everywhere, own


def typical_values(
    plant: Plant, known: Mapping[str, Mapping[str, Any]], segments: Sequence[Record]
) -> dict[str, float]:
    """The means of values that are known by record.

    Raises:
        ModelError: where one is known for some of the records only, or for one that is not there.
    """
    records = dict.fromkeys(segment.experiments[0] for segment in segments)
    found = {}
    for name, values in known.items():
        wrong, missing = (
            [each for each in values if each not in records],
            [each for each in records if each not in values],
        )
        if wrong or missing:
            which = f"there is no record {listed(wrong)}" if wrong else f"it is missing for {listed(missing)}"
            raise ModelError(
                f"{name} is known by record, and {which}; the records are {listed(list(records))}", arguments=("fixed",)
            )
        unit = plant.handles[name].parameter.unit
        found[name] = fmean(read_number(f"{plant.name} {name}", value, unit) for value in values.values())
    return found


def own_names(
    plant: Plant, per_record: str | Sequence[str], fixed: Mapping[str, Any] | None, known: Collection[str] = ()
) -> tuple[str, ...]:
    """The full names of the parameters that differ by record and are estimated; none where all are known by record.

    Raises:
        ModelError: for none, an unknown one, or one that is fixed.
    """
    own = tuple(dict.fromkeys(full_names(plant, per_record) or ()))
    if not own and not known:
        raise ModelError("per_record names no parameter; name some, or leave it out", arguments=("per_record",))
    known = by_full_name(plant, "fixed", fixed)
    both = [name for name in own if name in known]
    if both:
        raise ModelError(
            f"{listed(both)} cannot be fixed and differ by record; choose one", arguments=("fixed", "per_record")
        )
    return tuple(name for name in own if name not in known)


def asked_together(
    plant: Plant, free: str | Sequence[str] | None, own: Sequence[str], fixed: Mapping[str, Any] | None
) -> tuple[str, ...] | None:
    """The parameters to estimate with one value for all records: those asked for, and those that differ by record."""
    names = full_names(plant, free)
    if names is None and set(own) <= set(plant.default_free):
        return None
    wanted = plant.default_free if names is None else names
    return without_overlap(plant, (*wanted, *own), by_full_name(plant, "fixed", fixed))


def separated(
    together: GreyBoxFit,
    segments: Sequence[Record],
    own: Sequence[str],
    known: Mapping[str, Mapping[str, Any]],
    *,
    hold_given: bool,
    fixed: Mapping[str, float | str] | None,
    bounds: Mapping[str, tuple[float, float]] | None,
    datasheet: Mapping[str, Any] | None,
    max_iterations: int,
    threads: int | None,
    control: Control,
) -> GreyBoxFit:
    """The fit with a value of some parameters for every record, begun at a fit with one value for all.

    Args:
        together: that fit.
        segments: see `experiments`.
        own: full names of the parameters that differ by record.
        known: those of them with known values, which were kept at their means; the others were estimated.
        hold_given: whether the user gave the hold of the input.
        fixed, bounds, datasheet, max_iterations, threads, control: as in `simulation_error`.
    """
    base = together.model.plant
    plant = PlantByRecord.of(base, own, tuple(dict.fromkeys(s.experiments[0] for s in segments)))
    ended_early = together.ending is Ending.INTERRUPTED
    task = prepare(
        plant,
        segments,
        free=plant.expanded([row.name for row in together.table if row.asked]),
        fixed={**(fixed or {}), **{in_record(name, k): v for name, some in known.items() for k, v in some.items()}},
        bounds=plant.expanded_values(by_full_name(base, "bounds", bounds)),
        datasheet=plant.expanded_values(by_full_name(base, "datasheet", datasheet)),
        signals=together.model.signals,
        weighting=together.weighting,
        from_datasheet=False,
        threads=threads,
        control=FREE if ended_early else control,
    )
    task = replace(task, hold_given=hold_given, begins=InitialState.SAMPLES)
    reached = continuation.search(task, task.plant, 0 if ended_early else max_iterations)
    if not hold_given and reached.unended and not ended_early and is_open(plant, task.segments):
        reached = straight_if_better(task, reached, max_iterations)
    fit = concluded(task, task.plant, reached)
    found = fit.model.plant
    data = {
        "parameters": list(own),
        "records": list(plant.records),
        "typical": [found.value(name) for name in own],
        "units": [base.handles[name].parameter.unit for name in own],
    }
    return replace(
        fit,
        ending=Ending.INTERRUPTED if ended_early else fit.ending,
        findings=(Finding("parameters-by-record", base.name, data), *fit.findings),
    )
