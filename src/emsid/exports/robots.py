"""The actuator of a motor, a joint or an axis for Isaac Lab and mjlab, as a configuration in Python.

Both compute the effort of an actuator as stiffness·(q* − q) + damping·(v* − v) + effort*, within ± its limit, from
commands that are late by a number of physics steps, and add an armature and friction to the joint. A servo is that
controller with its own gains. A motor on a voltage u has stiffness 0, and its back EMF is the damping, K²/R at a
velocity target of 0; its effort target is the torque at rest, which the function ``effort`` gives for u. An axis, and
a motor fed with current or torque, have the effort target alone.

Fields are those of ``isaaclab.actuators`` 2.2 to 3.0, where ``friction`` is the effort that holds the joint and
``dynamic_friction`` that while it moves, and of ``mjlab.actuator``, whose delays are fields of every actuator.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.exports.mechanics import CARRIED, mechanics

TIMESTEP = 0.005
"""Of the physics in s, where none is given: the usual one of both."""
LEVELS = ("rotor_friction.stribeck", "load_friction.stribeck", "friction.stribeck")


def isaac_lab(export: Export) -> tuple[Files, list[str]]:
    """The configuration for Isaac Lab.

    Raises:
        ModelError: for a model that is no plant of one mass, or a time step that is not positive.
    """
    return _actuator(export, "isaaclab.actuators", ("DelayedPDActuatorCfg",) * 2, static=True)


def mjlab(export: Export) -> tuple[Files, list[str]]:
    """The configuration for mjlab.

    Raises:
        ModelError: as `isaac_lab`.
    """
    return _actuator(export, "mjlab.actuator", ("BuiltinPositionActuatorCfg", "IdealPdActuatorCfg"), static=False)


def _actuator(export: Export, module: str, kinds: tuple[str, str], *, static: bool) -> tuple[Files, list[str]]:
    """The file of an actuator.

    Args:
        export: the plant.
        module: of the classes.
        kinds: the class for a servo, and for others.
        static: whether friction at rest has a field of its own, as in Isaac Lab.
    """
    found = mechanics(export, (*CARRIED, "drive.delay", *LEVELS[: 3 * static]))
    plant: Any = export.model.plant  # type: ignore[attr-defined]
    try:
        step = float(str(export.options.get("timestep", TIMESTEP)))
    except ValueError:
        step = 0.0
    if not (isfinite(step) and step > 0):
        raise ModelError("timestep is that of the physics: give a positive number of s", arguments=("option",))
    servo = found.stiffness > 0
    late = round(plant.drive.delay / step)
    joint = str(export.options.get("joint", ".*"))
    level = 0.5 * sum(found.friction)
    fields: dict[str, object] = {"joint_names_expr" if static else "target_names_expr": [joint] if static else (joint,)}
    fields |= {"stiffness": found.stiffness, "damping": found.braking}
    if isfinite(found.limit):
        fields["effort_limit"] = found.limit
    fields["armature"] = found.inertia
    if static:
        holding = 0.5 * sum(sum(law.breakaway) for law in plant.frictions.values()) * abs(found.turns)
        fields |= {"friction": holding, "dynamic_friction": level, "viscous_friction": found.damping}
        fields |= {"min_delay": late, "max_delay": late}
    else:
        fields |= {"frictionloss": level, "viscous_damping": found.damping}
        fields |= {"delay_min_lag": late, "delay_max_lag": late}
    kind = kinds[0] if servo else kinds[1]
    values = "".join(f"    {name}={value!r},\n" for name, value in fields.items())
    text = f'"""Made by emsid; delays are in steps of {step!r} s; units: SI."""\n\nfrom {module} import {kind}\n\n'
    text += f"ACTUATOR = {kind}(\n{values})\n"
    zone = found.gain * found.dead_zone / found.unit
    if not servo:
        text += f'''
GAIN = {found.gain!r}
DEAD_ZONE = {zone!r}


def effort(u: float) -> float:
    """The effort target for a command of the record; the velocity target is zero."""
    return max(GAIN * u - DEAD_ZONE, 0.0) + min(GAIN * u + DEAD_ZONE, 0.0)
'''
    notes = [*found.notes, "The armature is all that moves: subtract the inertia of the link of your robot."]
    if found.weight:
        notes.append("Gravity on the arm is that of the link in your robot, and not carried.")
    if found.friction[0] != found.friction[1]:
        notes.append(f"Friction by direction, {found.friction[0]:.4g} and {found.friction[1]:.4g}: its mean is used.")
    if servo and found.unit != 1.0:
        notes.append(f"A position target is {found.unit:.6g} times the command of the record.")
    if abs(late * step - plant.drive.delay) > 1e-9:
        notes.append(f"The delay of {plant.drive.delay:.4g} s is {late} steps of {step:g} s; give the option timestep.")
    return {f"{export.name}_actuator.py": text}, notes
