"""A fit over several records in which some parameters have a value for each of them: one search, one covariance.

The search begins where the records agree best with one value for all (`estimation.simulation_error`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from emsid.errors import ModelError, listed
from emsid.estimation.fit import Ending
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.models.plants.beginning import InitialState
from emsid.models.plants.by_name import by_full_name, full_names
from emsid.models.plants.by_record import PlantByRecord, names_of
from emsid.models.plants.parameters import without_overlap
from emsid.models.plants.plant import Plant
from emsid.models.plants.search import continuation
from emsid.models.plants.search.between_samples import is_open, straight_if_better
from emsid.models.plants.search.conclusion import concluded
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.plants.search.task import prepare
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


def own_names(plant: Plant, per_record: str | Sequence[str], fixed: Mapping[str, Any] | None) -> tuple[str, ...]:
    """The full names of the parameters that differ by record.

    Raises:
        ModelError: for none, an unknown one, or one that is fixed.
    """
    own = tuple(dict.fromkeys(full_names(plant, per_record) or ()))
    if not own:
        raise ModelError("per_record names no parameter; name some, or leave it out", arguments=("per_record",))
    known = by_full_name(plant, "fixed", fixed)
    both = [name for name in own if name in known]
    if both:
        raise ModelError(
            f"{listed(both)} cannot be fixed and differ by record; choose one", arguments=("fixed", "per_record")
        )
    return own


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
        own: full names of the parameters that differ by record; they were estimated.
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
        fixed=fixed,
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
