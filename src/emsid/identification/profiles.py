"""The likelihood profiles that were asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from emsid.errors import EmsidError
from emsid.estimation.borders import border
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import Control, Stopped
from emsid.findings import Finding
from emsid.identification.fitting import of_one_model
from emsid.models.plants.parameters import parts
from emsid.models.plants.search.diagnostics import Profile, likelihood_profile
from emsid.models.plants.search.result import GreyBoxFit, has_physical_parameters


@dataclass(frozen=True)
class Profiles:
    """The profiles by model, findings about failed profiles, and whether this was stopped."""

    profiles: dict[str, tuple[Profile, ...]]
    failed: tuple[Finding, ...]
    stopped: bool = False


def profiles_of(fits: Sequence[Fit[Any]], names: Sequence[str], control: Control) -> Profiles:
    """The requested profiles; a parameter that was split by direction has one for each direction."""
    profiles: dict[str, tuple[Profile, ...]] = {}
    failed: list[Finding] = []
    for fit in fits:
        if not has_physical_parameters(fit):
            continue
        model = fit.model.name
        asked = _parts_of(fit, names)
        for number, name in enumerate(asked, 1):
            try:
                own = of_one_model(control, f"{model} (profile {number} of {len(asked)})")
                own.doing(name)
                with border(name, report=partial(_failed, failed, model, name)):
                    profile = likelihood_profile(fit, name, control=own)
                    profiles[model] = (*profiles.get(model, ()), profile)
            except Stopped:
                return Profiles(profiles, tuple(failed), stopped=True)
    return Profiles(profiles, tuple(failed))


def _failed(failed: list[Finding], model: str, name: str, problem: EmsidError) -> None:
    failed.append(Finding("profile-failed", name, {"model": model, "reason": str(problem).removeprefix(f"{name}: ")}))


def _parts_of(fit: GreyBoxFit, names: Sequence[str]) -> list[str]:
    """The parameters of a model among the names; one split by direction or by record is replaced by its parts."""
    plant = fit.model.plant
    by_record = {name: [row.name for rows in fit.by_record.values() if (row := rows.get(name))] for name in names}
    names = [part for name in names for part in by_record[name] or [name]]
    asked = [name for name in names if name in plant.handles]
    split = {name: [part for part in parts(plant, name) if part in fit.names] for name in asked}
    return list(dict.fromkeys(one for whole in asked for one in split[whole] or [whole]))
