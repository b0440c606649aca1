"""All refinements that a choice tries, and the values that remove each.

To add one, write a function in a file of its own and name it here; `WITHOUT` has the values at which it has no effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, isfinite

import numpy as np

from emsid.errors import ModelError
from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import parts
from emsid.models.plants.search.refinements.backlash import BACKLASH, backlash
from emsid.models.plants.search.refinements.cogging import FIRST, SECOND, cogging, cogging_of_speed
from emsid.models.plants.search.refinements.contract import Refined, Refinement
from emsid.models.plants.search.refinements.current_rise import RISE, current_rise
from emsid.models.plants.search.refinements.gain_by_direction import (
    SLOPE,
    gain_and_friction_by_direction,
    gain_by_direction,
)
from emsid.models.plants.search.refinements.inductance import INDUCTANCE, inductance
from emsid.models.plants.search.refinements.knee import knee
from emsid.models.plants.search.refinements.load_friction import LOADED, SQUARED, as_one_factor
from emsid.models.plants.search.refinements.quadratic_viscous import QUADRATIC, quadratic_viscous
from emsid.models.plants.search.refinements.sensor_offset import OFFSET, sensor_offset
from emsid.models.plants.search.refinements.stribeck_by_direction import stribeck_by_direction
from emsid.models.plants.search.refinements.stribeck_shape import gaussian_stribeck
from emsid.models.plants.search.refinements.supply_limit import supply_limit
from emsid.models.plants.search.refinements.switching_loss import switching_loss
from emsid.models.plants.search.refinements.usual import (
    averaging_sensor,
    by_direction,
    coasting_bridge,
    constant_load,
    late_command,
    slow_sensor,
    stribeck,
    viscous_by_direction,
)

REFINEMENTS: tuple[Refinement, ...] = (
    coasting_bridge, late_command, slow_sensor, averaging_sensor, stribeck, by_direction, viscous_by_direction,
    constant_load, supply_limit, knee, gain_by_direction, gain_and_friction_by_direction,
    stribeck_by_direction, gaussian_stribeck, switching_loss, current_rise, quadratic_viscous, cogging_of_speed,
    inductance, sensor_offset,
)  # fmt: skip
OF_SHAFT: tuple[Refinement, ...] = (backlash,)
"""Refinements of a motor with an elastic shaft, which is too slow to simulate for all others."""
OF_JOINT: tuple[Refinement, ...] = (
    coasting_bridge, late_command, slow_sensor, averaging_sensor, stribeck, by_direction, constant_load, *LOADED,
)  # fmt: skip
"""Refinements of a joint: what its gear adds, and not what only a search over speeds of a motor tells apart."""
EXTRAPOLATES: tuple[Refinement, ...] = (coasting_bridge, current_rise, quadratic_viscous, cogging, cogging_of_speed)
"""Refinements that cause large errors on other records if they are wrong: they are tested on kinds left out."""
BREAKS: dict[Refinement, str] = {supply_limit: "drive.supply", knee: "drive.knee"}
"""Refinements that break the range of voltages in two, each with the parameter that says where; both must be seen."""
BY_DIRECTION: tuple[Refinement, ...] = (
    by_direction, viscous_by_direction, stribeck_by_direction, gain_by_direction, gain_and_friction_by_direction,
    constant_load, sensor_offset,
)  # fmt: skip
"""Refinements that differ between the directions of motion; the record must have both."""
LOOK_ALIKE: dict[Refinement, str] = {
    late_command: "drive.delay",
    slow_sensor: "sensor.lag",
    averaging_sensor: "sensor.average",
    inductance: INDUCTANCE,
}
"""Refinements with similar effects in many records, each with its parameter, which is zero without it."""
DELAYS: tuple[Refinement, ...] = (late_command, slow_sensor, averaging_sensor)
"""Refinements that delay the output; they are tested in acceleration and in deceleration."""
ADDED: dict[Refinement, str] = {late_command: "delay", slow_sensor: "lag", averaging_sensor: "average"}
"""The same as additions, whose score tells what they promise (`search.additions`)."""
INSTEAD: tuple[Refinement, ...] = (inductance,)
"""Refinements that are slow to simulate: they are only tried in place of one with a similar effect."""
WITHOUT: tuple[Mapping[str, float], ...] = (
    {"drive.delay": 0.0},
    {"drive.loss": 0.0},
    {RISE: 0.0},
    {"sensor.lag": 0.0},
    {OFFSET: 0.0},
    {"drive.freewheel": 0.0},
    {"drive.supply": inf},
    {"drive.knee": inf, "drive.beyond": 1.0},
    {SLOPE: 1.0},
    {QUADRATIC: 0.0},
    {INDUCTANCE: 0.0},
    {BACKLASH: 0.0},
    {FIRST[0]: 1.0, **dict.fromkeys(FIRST[1:], 0.0)},
    dict.fromkeys(SECOND, 0.0),
)
"""The parameters of refinements, with the values at which they have no effect; without cogging any period will do."""


def refinements_of(plant: DrivenPlant) -> tuple[Refinement, ...]:
    """What is tried for a plant of this kind."""
    return OF_SHAFT if plant.secondary else OF_JOINT if plant.turn else REFINEMENTS


def simplified(plant: DrivenPlant, free: tuple[str, ...]) -> list[Refined]:
    """The plant without each of its refinements in turn."""
    excess, rate = f"{plant.friction_name}.stribeck", f"{plant.friction_name}.stribeck_rate"
    found: list[Refined] = []
    both = {f"{excess}.forward": 0.0, f"{excess}.backward": 0.0}
    factors = ({f"{plant.friction_name}.{name}": 0.0} for name in ("load", "load_stribeck", "motor", "outside"))
    squares = dict.fromkeys((f"{plant.friction_name}.{name}" for name in SQUARED), 0.0)
    friction = ({excess: 0.0, rate: 0.0}, {**both, rate: 0.0}, *factors, squares)
    for neutral in (*WITHOUT, {plant.load_name: 0.0}, *friction):
        if set(neutral) <= set(free):
            try:
                plain = plant.with_values(neutral)
            except ModelError:  # a bridge that coasts needs a supply
                continue
            found.append((plain, tuple(name for name in free if name not in neutral)))
    for whole in plant.handles:
        sides = parts(plant, whole)
        if len(sides) == 2 and set(sides) <= set(free):
            mean = float(np.mean([abs(plant.value(side)) for side in sides]))
            merged = tuple(whole if name == sides[0] else name for name in free if name != sides[1])
            found.append((plant.with_values({whole: mean}), merged))
    return found + as_one_factor(plant, free)


def sizes(names: Sequence[str], plain: DrivenPlant) -> list[str]:
    """The names of refinement parameters that are sizes; the others are positions or rates.

    Args:
        names: of free parameters that a plant has and a simpler one does not have.
        plain: the simpler one.
    """
    return [name for name in names if isfinite(_plain(plain, name)) and name != FIRST[0] and not name.endswith("_rate")]


def _plain(plain: DrivenPlant, name: str) -> float:
    """The value of a parameter of a plant; zero for one that its friction law does not have."""
    return plain.value(name) if name in plain.handles else 0.0


def without_effect(refined: Refined, plain: DrivenPlant, free: tuple[str, ...]) -> list[Refined]:
    """The start of a refinement with the same simulation as the plant without it.

    None if it has no size that can be zero, or replaces another parameter.

    Args:
        refined: another start.
        plain: the plant without the refinement.
        free: its free parameters.
    """
    plant, names = refined
    added = sizes([name for name in names if name not in free], plain)
    left_out = [name for name in free if name not in names and not set(parts(plain, name) or (name,)) <= set(names)]
    if left_out or not added:
        return []
    return [(plant.with_values({name: _plain(plain, name) for name in (*free, *added) if name in names}), names)]
