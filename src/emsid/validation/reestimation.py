"""A physical model on a record of another load: what differs is estimated again, and the rest of the record judges.

A load, an offset or a friction level may differ in every experiment while the motor stays the same. Then the error of a
free run says more about the load than about the model. So the named parameters are estimated from the first part of the
record, with all others as they are in the model, and errors are computed on the rest, which no step of this uses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from emsid.errors import DataError, ModelError
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.findings import Finding
from emsid.models.kinds import capabilities_of
from emsid.models.plants.by_name import full_names
from emsid.models.verbs import as_model, fit, for_model
from emsid.validation.comparison import Assessment, Row, assess, assess_model

if TYPE_CHECKING:
    from emsid.estimation.fit import Fit
    from emsid.models.model import Model
    from emsid.record import Record


@dataclass(frozen=True, eq=False)
class Reestimation:
    """A model whose parameters were estimated again for a record, and its errors on the rest of it.

    Attributes:
        fit: the parameters that were estimated again, with intervals; all others are as in the model.
        assessment: the model with these parameters on the rest of the record.
        before: errors of the model as it was, on the same rest.
    """

    fit: Fit[Any]
    assessment: Assessment
    before: Row

    @property
    def finding(self) -> Finding:
        """What was estimated again, from how many samples, and what it changed."""
        data = {
            "parameters": list(self.fit.names),
            "samples": round(self.fit.samples),
            "rest": len(self.assessment.record),
            "before": self.before.to_data()["fit_percent"],
            "after": self.assessment.row.to_data()["fit_percent"],
        }
        return Finding("parameters-reestimated", self.assessment.record.name, data)

    def to_data(self) -> dict[str, Any]:
        """The parameters with intervals, and the errors before and after."""
        return {
            "parameters": [row for row in self.fit.to_data()["parameters"] if row["name"] in self.fit.names],
            "before": self.before.to_data(),
            "finding": self.finding.to_data(),
        }


def reestimate(
    model: Fit[Any] | Model,
    record: Record,
    free: str | Sequence[str],
    *,
    part: float = 0.3,
    transient: int | None = None,
    control: Control = FREE,
) -> Reestimation:
    """Estimate some parameters of a physical model again on the first part of a record, and judge it on the rest.

    Args:
        model: a fit of a plant, or its model.
        record: of another load, say.
        free: names or symbols of the parameters, such as ``rotor_inertia``.
        part: the fraction of the record that they are estimated from.
        transient: samples at the start of every segment of the rest that are left out of errors.
        control: when to stop.

    Raises:
        ModelError: for a model without physical parameters, an unknown parameter, or a part that is no fraction.
        DataError: for a record that does not suit the model, or a part in which nothing moves.
    """
    grey: Any = as_model(model)
    if not capabilities_of(grey).physical:
        raise ModelError(
            f"{grey.name} has no physical parameters to estimate again; give a fit of a plant", arguments=("free",)
        )
    if not 0 < part < 1:
        raise ModelError(f"a part of {part:g}; give a fraction between 0 and 1", arguments=("part",))
    record = for_model(model, record)
    grey.check_record(record)
    first, rest = record.split(part)
    plant = grey.plant.of_record(grey.plant.record_of(record.segments[0]))
    names = full_names(plant, free)
    if not names:
        raise ModelError("no parameter is named to estimate again; name one", arguments=("free",))
    try:
        found = fit(plant, first, free=names, signals=grey.signals, hold=plant.hold, find_start=False, control=control)
    except DataError as problem:
        raise DataError(
            f"the first {100 * part:g} % cannot show {', '.join(names)}: {problem}", arguments=("part",)
        ) from None
    whole = replace(grey, plant=plant)
    return Reestimation(found, assess(found, rest, transient), assess_model(whole, rest, transient).row)
