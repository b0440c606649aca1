"""The parameters of a motor as a plant, by name: those of `Motor`, and of what is before and behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from math import inf

from emsid.models.plants.cogging import cogging_handles
from emsid.models.plants.drive import Feed, outer_handles
from emsid.models.plants.gravity import gravity_handles
from emsid.models.plants.parameters import TINY, Handle, dead_zone_handles, law_handles, scalar
from emsid.plant import FrictionLaw, Measure, Motor, Parameter

MADE = {
    Feed.VOLTAGE: ("V", "volts", Measure.COMMAND),
    Feed.CURRENT: ("A", "amperes", Measure.OTHER),
    Feed.TORQUE: ("N*m", "newton metres", Measure.FORCE),
}
ZONES = {"voltage_dead_zone": ("voltage", "V", Measure.COMMAND), "torque_dead_zone": ("torque", "N*m", Measure.FORCE)}


@cache
def motor_handles(
    rigid: bool, feed: Feed, rotor: type[FrictionLaw], load: type[FrictionLaw], hangs: bool
) -> Mapping[str, Handle]:
    """The handles of the fields of `Motor`, then load torque, drive and sensor; a rigid motor has no shaft."""
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
    if rigid:
        square = Parameter("quadratic_viscous", "B_q", Measure.QUADRATIC.unit(), "quadratic viscous friction")
        found |= scalar(("quadratic_viscous",), square, Measure.QUADRATIC)
        found |= cogging_handles("N*m", "rad")
    found |= gravity_handles() if hangs else {}
    return found | outer_handles(*MADE[feed], "rad/s", Measure.SPEED)
