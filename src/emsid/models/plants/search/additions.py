"""The known additions to a plant: parameters that may be missing, each with the neutral value that it has without them.

A row names the parameters, and the values kept beside them that they need to have an effect: a Stribeck level has none
without a rate, so that it is one row for each of a few rates. A plant contains itself with an addition at its neutral
value, so that a score tells what an addition promises (`emsid.models.search.score`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from emsid.models.plants.driven import DrivenPlant
from emsid.models.plants.parameters import Signal, parts
from emsid.models.plants.search.refinements.cogging import FIRST
from emsid.models.plants.search.refinements.contract import level_name
from emsid.models.plants.search.refinements.gain_by_direction import SLOPE
from emsid.models.plants.search.refinements.inductance import INDUCTANCE
from emsid.models.plants.search.refinements.quadratic_viscous import QUADRATIC
from emsid.models.plants.search.refinements.sensor_offset import OFFSET
from emsid.models.plants.search.speeds import top_speed
from emsid.record import Record

RATES = (5.0, 20.0, 60.0, 200.0)
"""Rates of Stribeck friction, times the top speed: an excess that fades over a fifth of it, down to one that a few
samples around rest show."""
VISCOUS = ("rotor_viscous", "viscous_friction")
ZONES = ("voltage_dead_zone.half_width", "dead_zone.half_width")


@dataclass(frozen=True)
class Addition:
    """Parameters that a plant does not have yet.

    Attributes:
        effect: what they describe, for `emsid.wording`.
        names: of the parameters, at their neutral values in the plant.
        beside: values that are kept beside them.
        instead: the parameter that they replace, such as a level for both directions.
        probe: where their derivative begins, for one that cannot be simulated at its neutral value; 0 if it can.
    """

    effect: str
    names: tuple[str, ...]
    beside: Mapping[str, float] = field(default_factory=dict)
    instead: str = ""
    probe: float = 0.0


def additions(
    plant: DrivenPlant,
    free: Collection[str],
    known: Collection[str],
    segments: Sequence[Record],
    signals: Sequence[Signal],
) -> list[Addition]:
    """What may be added to a plant.

    Args:
        plant: with its estimates.
        free: the parameters that are estimated.
        known: parameters whose values were given; they are never added.
        segments: the records.
        signals: of their outputs.
    """
    taken = {*free, *known}
    taken |= {side for name in taken for side in parts(plant, name)}
    rows = (*_friction(plant, segments, signals), *_sampling(plant, segments[0].dt, signals), *_others(plant, signals))
    split = _by_direction(plant, free, known)
    return [each for each in rows if _is_neutral(plant, each) and taken.isdisjoint(each.names)] + list(split)


def _is_neutral(plant: DrivenPlant, row: Addition) -> bool:
    """Whether a plant has the parameters, without an effect."""
    without_effect = {SLOPE: 1.0}
    return all(
        name in plant.handles and plant.value(name) == without_effect.get(name, 0.0) and not _split(plant, name)
        for name in row.names
    )


def _split(plant: DrivenPlant, name: str) -> bool:
    """Whether a parameter for both directions has an effect in one of them."""
    return any(plant.value(side) != plant.value(name) for side in parts(plant, name) if "dead_zone" not in name)


def _friction(plant: DrivenPlant, segments: Sequence[Record], signals: Sequence[Signal]) -> Iterator[Addition]:
    excess, rate = f"{plant.friction_name}.stribeck", f"{plant.friction_name}.stribeck_rate"
    yield Addition("coulomb", (level_name(plant),))
    yield from (Addition("viscous", (name,)) for name in VISCOUS)
    yield from (Addition("dead-zone", (name,)) for name in ZONES)
    yield Addition("quadratic", (QUADRATIC,))
    if rate in plant.handles:
        fast = top_speed(segments, 0, signals[0] is Signal.POSITION)
        yield from (Addition("stribeck", (excess,), {rate: times / fast}) for times in RATES)


def _sampling(plant: DrivenPlant, dt: float, signals: Sequence[Signal]) -> Iterator[Addition]:
    yield Addition("delay", ("drive.delay",))
    if set(signals) != {Signal.CURRENT}:
        yield Addition("lag", ("sensor.lag",))
    if {Signal.SPEED, Signal.ROTOR_SPEED} & set(signals):
        yield Addition("average", ("sensor.average",))
    if plant.can_coast:
        yield Addition("inductance", (INDUCTANCE,), probe=0.5 * dt * plant.value("resistance"))


def _others(plant: DrivenPlant, signals: Sequence[Signal]) -> Iterator[Addition]:
    yield Addition("load", (plant.load_name,))
    yield Addition("gain-by-direction", (SLOPE,))
    yield Addition("cogging", FIRST[1:])
    yield Addition("backlash", ("sensor.backlash",))
    if Signal.POSITION not in signals:
        yield Addition("sensor-offset", (OFFSET,))


def _by_direction(plant: DrivenPlant, free: Collection[str], known: Collection[str]) -> Iterator[Addition]:
    """A level, or a viscous friction, that differs by direction where one for both is estimated."""
    for name, effect in (
        (level_name(plant), "coulomb-by-direction"),
        *((each, "viscous-by-direction") for each in VISCOUS),
    ):
        if name in free and len(parts(plant, name)) == 2 and plant.load_name not in {*free, *known}:
            yield Addition(effect, (parts(plant, name)[1],), instead=name)
