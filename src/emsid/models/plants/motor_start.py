"""The start of a search for a motor: its parameters from a motion that a regression has found."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from emsid.errors import ModelError
from emsid.models.plants.drive import Feed
from emsid.models.plants.gravity import Gravity
from emsid.models.plants.one_mass import Motion
from emsid.models.plants.parameters import TINY
from emsid.plant import DeadZoneLaw, Motor


def check_one_mass(plant: Any) -> None:
    """Refuse a motor with a shaft that has an effect which is simulated for one mass only, or a drop with inductance.

    Raises:
        ModelError: for such a motor, or for a voltage drop or a friction by direction that is not physical.
    """
    if not plant.motor.is_rigid and (plant.feed is not Feed.VOLTAGE or plant.gravity is not None):
        what = f"motor fed with a {plant.feed.value}" if plant.gravity is None else "joint with gravity"
        raise ModelError(f"a {what} is simulated as one mass only; give Motor.rigid()")
    one_mass = plant.is_one_mass or plant.backlash
    lags = bool(plant.motor.inductance) and plant.feed is Feed.VOLTAGE
    if (plant.viscous_backward and not one_mass) or (plant.voltage_drop and (lags or not one_mass)):
        raise ModelError(
            "a motor with viscous friction by direction, or with a voltage drop and without inductance, is simulated "
            "as one mass only; give Motor.rigid() without dead zone on the torque, and inductance=0 for a voltage drop"
        )
    if plant.changes_resistance and not plant.is_one_mass:
        raise ModelError(
            "a motor whose resistance changes is simulated as one mass only; give Motor.rigid() without dead zone on "
            "the torque, and a joint without backlash"
        )


def at_motor(motion: Motion, ratio: float) -> Motion:
    """A motion that was measured behind a gear of ``ratio`` turns of the motor, on the side of the motor."""
    if ratio == 1.0:
        return motion
    cosine, sine = motion.waves
    return motion._replace(
        gain=ratio * motion.gain,
        coulomb=abs(ratio) * motion.coulomb,
        offset=ratio * motion.offset,
        waves=(ratio * cosine, ratio * sine),
    )


def by_torque(
    motor: Motor, level: str, per_unit: float, weight: float, motion: Motion, apart: bool
) -> dict[str, float]:
    """Inertia and friction of a motor that a current or a torque drives, by name.

    Args:
        motor: with the parameters of its load.
        level: the name of its friction level.
        per_unit: its torque per unit of the command.
        weight: the inertia of a known weight on the arm of a joint.
        motion: from a regression.
        apart: whether the load has an inertia of its own, with the present share; else it is kept.
    """
    inertia = max(per_unit / motion.gain, 2 * TINY)
    load = motor.load_inertia
    own = {}
    if apart:
        load *= max(inertia - weight, 2 * TINY) / (motor.rotor_inertia + load)
        own["load_inertia"] = load
    return {
        **own,
        "rotor_inertia": max(inertia - load - weight, TINY),
        "rotor_viscous": max(inertia * motion.damping - motor.load_viscous, 0.0),
        level: inertia * max(motion.coulomb, 0.0),
    }


def hung(motor: Motor, gravity: Gravity, weight: float, ratio: float, motion: Motion) -> dict[str, float]:
    """Gravity and rotor inertia of a joint, by name, whose motor has the inertia of a motion.

    Args:
        motor, weight, motion: as in `by_torque`.
        gravity: with its known weight.
        ratio: turns of the motor per turn of the joint.
    """
    total = motor.rotor_inertia + motor.load_inertia + weight
    cosine, sine = (total * each for each in motion.waves)
    return gravity.of_wave(cosine, sine, ratio)


def with_motion(motor: Motor, gain: float, motion: Motion, fixed: Collection[str]) -> Motor:
    """A motor that a voltage drives, with a motion of one mass; see `DrivenMotor.with_motion`.

    Args:
        motor: with the values of ``fixed``.
        gain: of its drive.
        motion: from a regression.
        fixed: the names of its known parameters.
    """
    zone = motion.dead_zone * abs(gain)
    constant, inertia, viscous = _constants_of(motor, motion, motion.gain / gain, fixed)
    share = motor.load_inertia / (motor.rotor_inertia + motor.load_inertia)
    load = motor.load_inertia if "load_inertia" in fixed else inertia * share
    factor = 1.0 if motor.is_rigid else inertia / (motor.rotor_inertia + motor.load_inertia)
    small = 0.02 * inertia * motion.damping
    return replace(
        motor,
        motor_constant=constant,
        rotor_inertia=motor.rotor_inertia if "rotor_inertia" in fixed else max(inertia - load, TINY),
        load_inertia=load,
        rotor_viscous=max(viscous, min(motor.rotor_viscous, small)),
        load_viscous=min(motor.load_viscous, small),
        rotor_friction=motor.rotor_friction.sliding_at(inertia * max(motion.coulomb, 0.0)),
        voltage_dead_zone=replace(motor.voltage_dead_zone or DeadZoneLaw(0.0, 0.0), b_l=-zone, b_r=zone),
        shaft_stiffness=motor.shaft_stiffness * factor,
        shaft_damping=motor.shaft_damping * factor,
    )


def _constants_of(motor: Motor, motion: Motion, gain: float, fixed: Collection[str]) -> tuple[float, float, float]:
    """K_m, J and B_m of a motion with ``gain`` rad/s² per volt; B_m is zero where K_m and J follow from the motion."""
    if {"motor_constant", "rotor_inertia"}.isdisjoint(fixed):
        constant = max(motion.damping / gain, 1e-6 * motor.motor_constant)
        return constant, constant / (motor.resistance * gain), 0.0
    constant, inertia = motor.motor_constant, motor.rotor_inertia + motor.load_inertia
    if "motor_constant" not in fixed:
        constant = inertia * motor.resistance * gain
    elif "rotor_inertia" not in fixed:
        inertia = constant / (motor.resistance * gain)
    return constant, inertia, inertia * motion.damping - constant**2 / motor.resistance - motor.load_viscous


def usual_free(motor: Motor, feed: Feed, level: str, hangs: bool) -> tuple[str, ...]:
    """The parameters that are estimated by default: what every motor has, and what else this one has.

    Args:
        motor: whose viscous friction, inductance and dead zone are estimated where they are not zero.
        feed: what drives it. Only a voltage is opposed by the speed itself; elsewhere viscous friction does that.
        level: the name of its friction level.
        hangs: whether it is a joint.
    """
    gravity = ("gravity.torque", "gravity.angle") if hangs else ()
    if feed is not Feed.VOLTAGE:
        constant = ("motor_constant",) if feed is Feed.CURRENT else ()
        return (*constant, "rotor_viscous", "rotor_inertia", level, *gravity)
    shaft = () if motor.is_rigid else ("load_inertia", "shaft_stiffness", "shaft_damping")
    zone = motor.voltage_dead_zone
    viscous = ("rotor_viscous",) if motor.rotor_viscous else ()
    inductance = ("inductance",) if motor.inductance else ()
    width = ("voltage_dead_zone.half_width",) if zone is not None and zone.b_r > zone.b_l else ()
    return ("resistance", *viscous, "motor_constant", "rotor_inertia", *shaft, *inductance, level, *gravity, *width)
