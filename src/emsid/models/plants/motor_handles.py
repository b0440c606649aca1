"""The parameters of a motor as a plant, by name: those of `Motor`, and of what is before and behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from math import inf

from emsid.models.plants.cogging import cogging_handles
from emsid.models.plants.drive import Bridge, Feed, outer_handles
from emsid.models.plants.effects import effect_handles
from emsid.models.plants.gravity import gravity_handles
from emsid.models.plants.parameters import TINY, Handle, Signal, dead_zone_handles, law_handles, scalar
from emsid.models.plants.plant import Channels
from emsid.models.plants.servo import servo_handles
from emsid.plant import FrictionLaw, Measure, Motor, Parameter

RADIUS, USUAL_RADIUS = "sensor.radius", 0.05
"""The radius of a wheel, and where a search for it begins: in m, between a toy's and a cart's."""
MADE = {
    Feed.VOLTAGE: ("V", "volts", Measure.COMMAND),
    Feed.CURRENT: ("A", "amperes", Measure.OTHER),
    Feed.TORQUE: ("N*m", "newton metres", Measure.FORCE),
    Feed.POSITION: ("rad", "radians", Measure.OTHER),
}
"""By the output of the drive its unit, the unit in words, and what it measures."""
ZONES = {"voltage_dead_zone": ("voltage", "V", Measure.COMMAND), "torque_dead_zone": ("torque", "N*m", Measure.FORCE)}


def feed_in(unit: str, hangs: bool) -> Feed | None:
    """What drives a motor, or a joint that hangs, whose command has a unit; None for a voltage."""
    feeds = (Feed.CURRENT, Feed.TORQUE, *((Feed.POSITION,) if hangs else ()))
    return next((each for each in feeds if unit == MADE[each][0]), None)


def motor_channels(
    feed: Feed, wheel: bool, hangs: bool, codes: tuple[tuple[float, Bridge], ...], load: str
) -> Channels:
    """The signals of a motor, of which a wheel's are in m, and its command."""
    way = "m" if wheel else "rad"
    speed, (unit, word, _) = f"{way}/s", MADE[feed]
    units = {Signal.SPEED: speed, Signal.ROTOR_SPEED: speed, Signal.POSITION: way, Signal.CURRENT: "A"}
    usual = Signal.POSITION if hangs else Signal.SPEED
    return Channels(units, usual, (unit,), word, feed.value, codes, feed is Feed.VOLTAGE, load=load)


@cache
def motor_handles(
    rigid: bool, feed: Feed, rotor: type[FrictionLaw], load: type[FrictionLaw], hangs: bool, wheel: bool
) -> Mapping[str, Handle]:
    """The handles of the fields of `Motor`, then load torque, drive and sensor; a rigid motor has no shaft, and the
    sensor of a wheel reads in m/s."""
    laws = {"rotor_friction": rotor, "load_friction": load}
    found: dict[str, Handle] = {}
    for part in fields(Motor):
        path, about = ("motor", part.name), part.metadata
        if part.name in laws:
            found |= law_handles(path, part.name, laws[part.name], about["where"], about["index"])
        elif part.name in ZONES:
            found |= dead_zone_handles(path, part.name, *ZONES[part.name])
        elif not (rigid and part.name.startswith("shaft_")):
            parameter = Parameter(part.name, about["symbol"], about["unit"], about["description"])
            found |= scalar(path, parameter, about["measure"], TINY if about["positive"] else 0.0)
    torque = Parameter("load_torque", "T_d", "N*m", "constant torque on the load")
    found |= scalar(("load_torque",), torque, Measure.FORCE, -inf)
    found |= effect_handles()
    found |= cogging_handles("N*m", "rad")
    if hangs:
        gap = Parameter("sensor.backlash", "2β", "rad", "backlash between motor and measured load, its whole width")
        alone = Parameter("backlash", "2β", "rad", "backlash between measured motor and load, its whole width")
        found |= scalar(("backlash",), alone, Measure.OTHER)
        found |= gravity_handles() | servo_handles() | scalar(("sensor", "backlash"), gap, Measure.OTHER)
    return found | outer_handles(*MADE[feed], "m/s" if wheel else "rad/s", Measure.SPEED)
