"""A motor or an axis as MJCF for MuJoCo: a joint with armature, damping and frictionloss, and its actuator.

A motor on a voltage is a ``general`` actuator with the gain K/R and the affine bias −K²/R times the speed. The default
``frictionloss`` of MuJoCo is soft: below break-away a joint creeps (0.16 rad/s at 87 % of it, measured). With
`SOLIMP` it creeps a thousandth of that. MuJoCo has no dead zone: ``NAME_ctrl.py`` applies it to the command.
"""

from __future__ import annotations

from emsid.exports.formats import Export, Files
from emsid.exports.mechanics import Mechanics, mechanics

SOLIMP = "0.9999 0.9999 0.001 0.5 2"
"""Impedance of the friction constraint, close to one: 0.000175 rad/s of creep in place of 0.163."""
BODY = 1e-9
"""Inertia of the body in kg·m², and its mass in kg, beside the armature: MuJoCo needs some."""


def mujoco(export: Export) -> tuple[Files, list[str]]:
    """The MJCF file, and a function in Python that applies the dead zone to the command.

    Raises:
        ModelError: for a model that is no plant of one mass.
    """
    found = mechanics(export)
    files: Files = {f"{export.name}.xml": mjcf(export, found)}
    notes = list(found.notes)
    if found.friction[0] != found.friction[1]:
        notes.append(f"Friction by direction, {found.friction[0]:.4g} and {found.friction[1]:.4g}: its mean is used.")
    if found.dead_zone > 0:
        files[f"{export.name}_ctrl.py"] = control(found)
        notes.append(f"The dead zone is in {export.name}_ctrl.py: give ctrl(u) to data.ctrl.")
    return files, notes


def mjcf(export: Export, found: Mechanics) -> str:
    """The model as MJCF."""
    joint, units = ("hinge", "N·m, rad") if found.rotates else ("slide", "N, m")
    loss = 0.5 * sum(found.friction)
    step = min(export.dt or 1e-3, 1e-3)
    inertia = f'armature="{found.inertia!r}"'
    return f"""\
<!-- Made by emsid; units: {units}, s. -->
<mujoco model="{export.name}">
  <compiler angle="radian"/>
  <option timestep="{step!r}" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body name="{export.name}">
      <inertial pos="0 0 0" mass="{BODY!r}" diaginertia="{BODY!r} {BODY!r} {BODY!r}"/>
      <joint name="{export.name}" type="{joint}" axis="0 0 1" {inertia}
             damping="{found.damping!r}" frictionloss="{loss!r}" solimpfriction="{SOLIMP}"/>
    </body>
  </worldbody>
  <actuator>
    <general name="{export.name}" joint="{export.name}" gaintype="fixed" gainprm="{found.gain!r}"
             biastype="affine" biasprm="0 0 {-found.braking!r}"/>
  </actuator>
  <sensor>
    <jointpos name="position" joint="{export.name}"/>
    <jointvel name="speed" joint="{export.name}"/>
  </sensor>
</mujoco>
"""


def control(found: Mechanics) -> str:
    """A function in Python that gives the command to MuJoCo."""
    return f'''"""Made by emsid: the command of the record as the command of MuJoCo."""

DEAD_ZONE = {found.dead_zone!r}


def ctrl(u: float) -> float:
    """The command beyond the dead zone."""
    return max(u - DEAD_ZONE, 0.0) + min(u + DEAD_ZONE, 0.0)
'''
