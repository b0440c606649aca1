"""What the exports of mechanics need of a plant: inertia, damping, dry friction and the gain of its command, in SI."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import inf, tau
from typing import Any

from emsid.errors import ModelError
from emsid.exports.formats import Export
from emsid.models.plants.effects import ROWS
from emsid.units import plain_unit

CARRIED = (
    *("resistance", "motor_constant", "rotor_inertia", "load_inertia", "rotor_viscous", "load_viscous"),
    *("rotor_friction.coulomb", "load_friction.coulomb", "drive.gain", "mass", "viscous_friction", "friction.coulomb"),
    *(f"gravity.{name}" for name in ("torque", "angle", "mass", "length", "acceleration", "period")),
    *("servo.proportional", "servo.derivative", "servo.limit"),
)
WINDING = ("resistance", "motor_constant", "inductance", "gravity.angle", "gravity.acceleration", "gravity.period")
"""Parameters that the configuration of a motor carries, and those of gravity that have no effect alone."""
"""Parameters that an export of mechanics carries; of the others, those with an effect are named."""
NEUTRAL = {"drive.gain": 1.0, "drive.beyond": 1.0, "sensor.ratio": 1.0} | {row.name: row.default for row in ROWS}
"""Values without an effect of parameters that have none at zero; slopes of dead zones and periods have none alone."""
SILENT = (".m_l", ".m_r", ".b_l", ".b_r", ".period", "stribeck_rate", "drive.supply", "drive.knee", "drive.beyond")


@dataclass(frozen=True)
class Mechanics:
    """One mass, driven by a command.

    Attributes:
        rotates: whether it turns; else it slides.
        inertia: in kg·m² or kg.
        damping: viscous friction, in N·m·s/rad or N·s/m.
        friction: dry friction, forward and backward, in N·m or N.
        gain: torque or force per unit of the command at rest.
        braking: torque or force per speed by the back EMF, included in no other number.
        resistance, constant: of the armature in Ω and N·m/A; zero for an axis.
        dead_zone: half its width in V, for an axis in N.
        unit: V or N per unit of the command.
        notes: what is not carried, in sentences.
        weight: gravity torque of a joint at horizontal in N·m; zero for none.
        hangs: the angle in rad at which it hangs.
        stiffness: torque of a servo per error of its position in N·m/rad; zero for none.
        limit: its largest torque in N·m.
        turns: of the motor per turn of a joint.
    """

    rotates: bool
    inertia: float
    damping: float
    friction: tuple[float, float]
    gain: float
    braking: float
    resistance: float
    constant: float
    dead_zone: float
    unit: float
    notes: tuple[str, ...]
    weight: float = 0.0
    hangs: float = 0.0
    stiffness: float = 0.0
    limit: float = inf
    turns: float = 1.0


def mechanics(export: Export, carried: Collection[str] = CARRIED, *, of_motor: bool = False) -> Mechanics:
    """The mechanics of a plant: of a joint on the side of its arm, of any other motor on its own.

    Args:
        export: the plant.
        carried: the parameters that the format carries; the notes name the others.
        of_motor: the side of the motor for a joint too.

    Raises:
        ModelError: for a model that is no plant of one mass.
    """
    plant: Any = getattr(export.model, "plant", None)
    handles = getattr(plant, "handles", {})

    def value(name: str) -> float:
        return float(plant.value(name)) if name in handles else 0.0

    def levels(name: str) -> tuple[float, float]:
        return value(f"{name}.coulomb.forward"), value(f"{name}.coulomb.backward")

    if "motor_constant" in handles and "shaft_stiffness" not in handles:
        constant, resistance = value("motor_constant"), value("resistance")
        rotor, load = levels("rotor_friction"), levels("load_friction")
        gravity = getattr(plant, "gravity", None)
        turns = 1.0 if gravity is None else value("sensor.ratio")
        ratio = 1.0 if of_motor else turns
        command = value("drive.gain") * plant.torque_per_unit
        servo = plant.servo if plant.follows else None
        braking = ratio**2 * constant**2 / resistance if plant.channels.bridge else 0.0
        return Mechanics(
            True,
            ratio**2 * plant.inertia_of_all,
            ratio**2 * (value("rotor_viscous") + value("load_viscous")),
            (abs(ratio) * (rotor[0] + load[0]), abs(ratio) * (rotor[1] + load[1])),
            ratio * command,
            braking if servo is None else servo.derivative,
            resistance,
            ratio * constant,
            value("voltage_dead_zone.half_width"),
            value("drive.gain"),
            left_out(plant, (*carried, *["sensor.ratio"] * (gravity is not None))),
            0.0 if gravity is None else gravity.whole * ratio / turns,
            0.0 if gravity is None else tau * gravity.angle / gravity.period,
            0.0 if servo is None else servo.proportional,
            inf if servo is None else servo.limit,
            turns,
        )
    if "mass" in handles:
        half = 0.5 * (value("viscous_friction.forward") + value("viscous_friction.backward"))
        gain, zone = value("drive.gain"), value("dead_zone.half_width")
        return Mechanics(
            False, value("mass"), half, levels("friction"), gain, 0.0, 0.0, 0.0, zone, gain, left_out(plant, carried)
        )
    raise ModelError(
        f"{export.model.name} has no inertia and friction to export; identify rigid-motor or linear-axis, or export it "
        "as c99"
    )


def left_out(plant: Any, carried: Collection[str]) -> tuple[str, ...]:
    """Sentences on the parameters with an effect that are not carried."""
    found = []
    for name, handle in plant.handles.items():
        whole = name.removesuffix(".forward").removesuffix(".backward")
        if whole in carried or name != whole or name.endswith(SILENT):
            continue
        value = float(plant.value(name))
        if value != NEUTRAL.get(name, 0.0):
            unit = plain_unit(handle.parameter.unit)
            found.append(f"{name} = {value:.4g}{f' {unit}' if unit else ''} is not carried.")
    return tuple(found)
