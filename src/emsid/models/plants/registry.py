"""The registry of plants by name: for model files, datasheets, `emsid parameters` and candidates.

To add a plant, define its class and `register` an instance, here or in your own program.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from emsid.errors import ModelError
from emsid.models.plants.brushless import Brushless
from emsid.models.plants.by_record import from_data
from emsid.models.plants.gravity import Gravity
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.plant import Plant
from emsid.plant import Friction, Motor


@dataclass(frozen=True)
class Kind:
    """A registered plant.

    Args:
        plain: an instance without optional parts; a model file has the differences from it.
        start: an instance to start a search from; a regression on the record gives its scale.
        summary: its description in a few words.
        datasheet: the name of its table in a datasheet.
        described: the plant with all parameters that this table may have.
        refined: whether refinements of it are tried.
        usual: whether it is tried where nobody asks for it.
    """

    plain: Plant
    start: Plant
    summary: str
    datasheet: str
    described: Plant
    refined: bool = True
    usual: bool = True


PLANTS: dict[str, Kind] = {}
"""Every registered plant by its name."""


def register(
    plain: Plant,
    *,
    start: Plant | None = None,
    summary: str = "",
    datasheet: str = "",
    described: Plant | None = None,
    refined: bool = True,
    usual: bool = True,
) -> None:
    """Register a plant under its name.

    Args:
        plain, summary, refined, usual: see `Kind`.
        start, described: by default ``plain``.
        datasheet: by default the name of the plant.

    Raises:
        ModelError: if another plant has this name.
    """
    known = PLANTS.get(plain.name)
    if known is not None and type(known.plain).__qualname__ != type(plain).__qualname__:
        raise ModelError(f"there is a plant {plain.name!r} already; choose another name")
    PLANTS[plain.name] = Kind(
        plain, start or plain, summary or plain.name, datasheet or plain.name, described or plain, refined, usual
    )


JOINT_STEPS = 4
"""Steps per sample of a joint: with two, the change of gravity within them made inertias wrong by half an interval."""
_BARE = Motor(voltage_dead_zone=None)
_NEUTRAL = replace(
    _BARE, inductance=0.0, rotor_viscous=0.0, load_viscous=0.0, rotor_friction=Friction(), load_friction=Friction()
)
"""What every motor has; all else is zero until a search adds it."""
_ONE_MASS = replace(_NEUTRAL, load_inertia=1e-15).rigid()

register(
    DrivenMotor(replace(_BARE, inductance=0.0).rigid()),
    start=DrivenMotor(_ONE_MASS),
    summary="a motor with its load as one mass: ohms, kg·m² and N·m with intervals",
    datasheet="motor",
    described=DrivenMotor(),
)
register(
    DrivenMotor(_BARE),
    start=DrivenMotor(_NEUTRAL),
    summary="a motor that turns its load through an elastic shaft",
    described=DrivenMotor(),
    refined=False,
)
register(
    LinearAxis(),
    start=LinearAxis(viscous_friction=0.0, friction=Friction()),
    summary="a mass on a rail: force to position, kg and N with intervals",
)
register(
    DrivenMotor(replace(_BARE, inductance=0.0).rigid(), gravity=Gravity(), steps=JOINT_STEPS),
    start=DrivenMotor(_ONE_MASS, gravity=Gravity(0.1), steps=JOINT_STEPS),
    summary="a joint of a robot: gear, arm with gravity, friction; N·m and kg·m² with intervals",
    usual=False,
)
register(
    Brushless(),
    summary="a brushless motor: resistance, inductances, flux and inertia with intervals",
    refined=False,
    usual=False,
)


def described() -> dict[str, Plant]:
    """The plants with datasheets, by the name of their table."""
    return {kind.datasheet: kind.described for kind in PLANTS.values()}


def plant_to_data(plant: Plant) -> dict[str, Any]:
    """Kind and parameters in built-in types, without infinite parameters and missing parts.

    Raises:
        ModelError: for a plant of a kind that is not registered.
    """
    if plant.name not in PLANTS:
        raise ModelError(
            f"{plant.name} is not registered and cannot be saved; call emsid.models.plants.registry.register(plant) "
            "first, where it is saved and where it is loaded"
        )
    return {"kind": plant.name, **plant.to_data()}


def plant_from_data(data: Mapping[str, Any]) -> Plant:
    """The plant described by `plant_to_data`.

    Raises:
        ModelError: for data that do not describe a plant.
    """
    if data["kind"] not in PLANTS:
        raise ModelError(f"no plant of kind {data['kind']!r}; there are {', '.join(PLANTS)}")
    return from_data(PLANTS[data["kind"]].plain, data)
