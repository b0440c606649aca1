"""Plants as built-in types, for model files, and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isfinite
from typing import Any

from emsid.errors import ModelError
from emsid.models.plants.drive import Bridge, Feed, Sensor
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Plant
from emsid.plant import Motor


def plant_to_data(plant: Plant) -> dict[str, Any]:
    """Kind and parameters in built-in types; infinite ones are left out, as are parts that are not there.

    Raises:
        ModelError: for a plant made of functions, which no file can hold.
    """
    if not isinstance(plant, (DrivenMotor, LinearAxis)):
        raise ModelError(f"{plant.name} is made of functions and cannot be saved; save its parameters instead")
    parameters = {
        name: plant.value(name)
        for name, handle in plant.handles.items()
        if len(handle.paths) == 1 and isfinite(plant.value(name))
    }
    zones = ("motor.voltage_dead_zone", "motor.torque_dead_zone") if isinstance(plant, DrivenMotor) else ("dead_zone",)
    for zone in zones:
        if _part(plant, zone) is None:
            parameters = {n: v for n, v in parameters.items() if not n.startswith(zone.removeprefix("motor.") + ".")}
    return {
        "kind": plant.name,
        "parameters": parameters,
        "codes": [[code, bridge.value] for code, bridge in plant.drive.codes],
        "feed": plant.feed.value if isinstance(plant, DrivenMotor) else Feed.VOLTAGE.value,
        "average": plant.sensor.average,
        "steps": plant.steps,
    }


def plant_from_data(data: Mapping[str, Any]) -> Plant:
    """The plant that `plant_to_data` described.

    Raises:
        ModelError: for data that describe none.
    """
    kinds: dict[str, Callable[[], DrivenMotor | LinearAxis]] = {
        "motor": lambda: DrivenMotor(Motor(voltage_dead_zone=None)),
        "rigid-motor": lambda: DrivenMotor(Motor(inductance=0.0, voltage_dead_zone=None).rigid()),
        "linear-axis": LinearAxis,
    }
    if data["kind"] not in kinds:
        raise ModelError(f"no plant of kind {data['kind']!r}; there are {', '.join(kinds)}")
    plain = kinds[data["kind"]]()
    if isinstance(plain, DrivenMotor):
        plain = replace(plain, feed=Feed(data.get("feed", Feed.VOLTAGE.value)))
    codes = tuple((float(code), Bridge(bridge)) for code, bridge in data["codes"])
    plain = replace(
        plain,
        drive=replace(plain.drive, codes=codes),
        sensor=Sensor(average=bool(data["average"])),
        steps=data["steps"],
    )
    parameters = dict(data["parameters"])
    late = {name: parameters.pop(name) for name in ("drive.freewheel",) if name in parameters}  # needs the supply
    return plain.put(parameters).put(late)


def _part(plant: Plant, path: str) -> Any:
    part: Any = plant
    for step in path.split("."):
        part = getattr(part, step)
    return part
