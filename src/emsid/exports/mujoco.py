"""A motor or an axis as MJCF for MuJoCo: a joint with armature, damping and frictionloss, and its actuator.

A motor on a voltage is a ``general`` actuator with the gain K/R and the affine bias −K²/R times the speed; with
``actuator=dcmotor`` it is the actuator of that name, of MuJoCo 3.8 and later, which has an inductance and one wave of
cogging too. Only its voltage mode is written: the meaning of its other inputs changed in 3.12.

The default ``frictionloss`` of MuJoCo is soft: below break-away a joint creeps (0.16 rad/s at 87 % of it, measured).
With `SOLIMP` it creeps a thousandth of that, and ``solreffriction`` has the shortest time constant, two time steps:
with the default of 20 ms a joint that turns round is 4 mrad off. The ``dcmotor`` has friction after LuGre, whose
exponent is 2: it carries the friction law with a Gaussian excess. Its bristles are a spring σ₀ and a damper σ₁,

    σ₀ = break-away / `BENDS`,      σ₁ = 2·`DAMPING`·√(σ₀·J)

on the inertia J, and the step must resolve their frequency √(σ₀/J). MuJoCo has no dead zone:
``NAME_ctrl.py`` applies it to the command.
"""

from __future__ import annotations

from math import atan2, ceil, cos, hypot, isfinite, sin, sqrt, tau
from typing import Any

from emsid.errors import ModelError
from emsid.exports.formats import Export, Files
from emsid.exports.mechanics import Mechanics, mechanics
from emsid.models.plants.gravity import STANDARD
from emsid.plant.gaussian_stribeck import gaussian_excess

SOLIMP = "0.9999 0.9999 0.001 0.5 2"
"""Impedance of the friction constraint, close to one: 0.000175 rad/s of creep in place of 0.163."""
BODY = 1e-9
"""Mass in kg of a body that only turns, and the inertia in kg·m² of one that only slides: MuJoCo needs some. The body
has half of the inertia that moves and the armature the rest: frictionloss is scaled by the body, and does not hold an
axis whose mass is all armature (10 N moved one that 14 N held)."""
ACTUATORS = ("general", "dcmotor")
BENDS = 1e-3
"""Angle in rad by which bristles bend before they slip: a thousandth, less than a step of common encoders."""
DAMPING = 0.01
"""Of the bristles, as a part of critical damping: MuJoCo integrates its force explicitly, so that with a tenth the free
run fits 1.2 % less, and with critical damping 13 % less, at the same step. The back EMF damps besides."""
RESOLVED = 0.2
"""Largest step as a part of the time √(J/σ₀) of the bristles: with a quarter of it the free run fits 0.14 % better."""


def mujoco(export: Export) -> tuple[Files, list[str]]:
    """The MJCF file, and a function in Python that applies drive and dead zone to the command.

    Raises:
        ModelError: for a model that is no plant of one mass, an unknown actuator, or an axis as ``dcmotor``.
    """
    kind = str(export.options.get("actuator", "general"))
    if kind not in ACTUATORS:
        raise ModelError(f"there is no actuator {kind!r}; give {' or '.join(ACTUATORS)}", arguments=("option",))
    found = mechanics(export)
    plant: Any = getattr(export.model, "plant", None)
    if kind == "dcmotor" and not found.constant:
        raise ModelError(f"{export.model.name} has no motor constant, as a dcmotor needs", arguments=("option",))
    notes, bristles = list(found.notes), None
    if kind == "dcmotor":
        bristles = lugre(plant, found)
        carried = carried_by_dcmotor(bristles is not None)
        notes = [note for note in notes if not note.startswith(carried)]
    if found.friction[0] != found.friction[1]:
        notes.append(f"Friction by direction, {found.friction[0]:.4g} and {found.friction[1]:.4g}: its mean is used.")
    sample = export.dt or 1e-3
    step = whole_part(sample, 1e-3)
    if bristles is not None:
        step = whole_part(sample, min(step, RESOLVED * sqrt(found.inertia / bristles[0])))
        notes.append(f"Friction is that of LuGre: the step must not be larger than {step:.2g} s.")
    scale = found.unit if kind == "dcmotor" else 1.0
    zone = found.dead_zone * scale / found.unit
    files: Files = {
        f"{export.name}.xml": mjcf(export, found, actuator(export, found, plant, kind, bristles), step, bristles)
    }
    if zone > 0 or scale != 1.0:
        files[f"{export.name}_ctrl.py"] = control(zone, scale)
        notes.append(f"Dead zone and gain of the drive are in {export.name}_ctrl.py: give ctrl(u) to data.ctrl.")
    return files, notes


def whole_part(sample: float, longest: float) -> float:
    """The longest step up to ``longest`` of which a sample is a whole number."""
    return sample / ceil(sample / longest - 1e-9)


def carried_by_dcmotor(bristles: bool) -> tuple[str, ...]:
    """The beginnings of the notes on what a ``dcmotor`` carries beside a ``general`` actuator."""
    excess = ("rotor_friction.stribeck ", "load_friction.stribeck ") if bristles else ()
    return ("inductance ", "cogging.cosine_1 ", "cogging.sine_1 ", *excess)


def lugre(plant: Any, found: Mechanics) -> tuple[float, float, float, float, float] | None:
    """Stiffness, damping, Coulomb level, break-away and Stribeck speed; None for friction without a Gaussian excess.

    Only the friction of the rotor: that of the load must be Coulomb friction, which adds to both levels.
    """
    law = plant.motor.rotor_friction
    excess, rate = plant.value("rotor_friction.stribeck"), plant.value("rotor_friction.stribeck_rate")
    if type(law).level is not gaussian_excess or not (excess > 0 and rate > 0):
        return None
    coulomb = 0.5 * sum(found.friction)
    stiffness = (coulomb + excess) / BENDS
    return stiffness, 2 * DAMPING * sqrt(stiffness * found.inertia), coulomb, coulomb + excess, 1 / rate


def actuator(export: Export, found: Mechanics, plant: Any, kind: str, bristles: Any) -> str:
    """The actuator as MJCF."""
    head = f'<{kind} name="{export.name}" joint="{export.name}"'
    if kind == "general":
        limit = f' forcerange="{-found.limit!r} {found.limit!r}"' if isfinite(found.limit) else ""
        return (
            f'{head} gaintype="fixed" gainprm="{found.gain!r}"\n'
            f'             biastype="affine" biasprm="0 {-found.stiffness!r} {-found.braking!r}"{limit}/>'
        )
    parts = [f'motorconst="{found.constant!r}" resistance="{found.resistance!r}"']
    if (inductance := float(plant.value("inductance"))) > 0:
        parts.append(f'inductance="{inductance!r}"')
    cosine, sine = (float(plant.value(f"cogging.{what}_1")) for what in ("cosine", "sine"))
    if cosine or sine:
        waves = tau / float(plant.value("cogging.period"))
        parts.append(f'cogging="{hypot(cosine, sine)!r} {waves!r} {atan2(-cosine, -sine)!r}"')
    if bristles is not None:
        parts.append(f'lugre="{" ".join(map(repr, bristles))}"')
    return f"{head} {' '.join(parts)}/>"


def mjcf(export: Export, found: Mechanics, driven: str, step: float, bristles: Any) -> str:
    """The model as MJCF."""
    joint, units = ("hinge", "N·m, rad") if found.rotates else ("slide", "N, m")
    loss = 0.0 if bristles is not None else 0.5 * sum(found.friction)
    mass, place, body, armature, pull = _body(found)
    held = f'  <keyframe>\n    <key name="rest" qpos="{found.hangs!r}"/>\n  </keyframe>\n' if found.weight else ""
    return f"""\
<!-- Made by emsid; units: {units}, s. -->
<mujoco model="{export.name}">
  <compiler angle="radian"/>
  <option timestep="{step!r}" gravity="0 {pull!r} 0" integrator="implicitfast"/>
  <worldbody>
    <body name="{export.name}">
      <inertial pos="{place}" mass="{mass!r}" diaginertia="{body!r} {body!r} {body!r}"/>
      <joint name="{export.name}" type="{joint}" axis="0 0 1" armature="{armature!r}"
             damping="{found.damping!r}" frictionloss="{loss!r}"
             solreffriction="{2 * step!r} 1" solimpfriction="{SOLIMP}"/>
    </body>
  </worldbody>
  <actuator>
    {driven}
  </actuator>
  <sensor>
    <jointpos name="position" joint="{export.name}"/>
    <jointvel name="speed" joint="{export.name}"/>
  </sensor>
{held}</mujoco>
"""


def _body(found: Mechanics) -> tuple[float, str, float, float, float]:
    """Mass, place and inertia of the body, the armature, and the acceleration along y.

    The body has half of the inertia. That of a joint is a point mass where its arm is, so close to the axis that its
    inertia is not larger, and an inertia about itself.
    """
    half = 0.5 * found.inertia
    if not found.rotates:
        return half, "0 0 0", BODY, half, 0.0
    if not found.weight:
        return BODY, "0 0 0", half, half, 0.0
    length = min(1.0, 0.5 * found.inertia * STANDARD / found.weight)
    mass = found.weight / (STANDARD * length)
    place = f"{-length * sin(found.hangs)!r} {-length * cos(found.hangs)!r} 0"
    own = max(half - mass * length**2, BODY)
    return mass, place, own, found.inertia - own - mass * length**2, -STANDARD


def control(zone: float, scale: float) -> str:
    """A function in Python that gives the command to MuJoCo."""
    return f'''"""Made by emsid: the command of the record as the command of MuJoCo."""

GAIN = {scale!r}
DEAD_ZONE = {zone!r}


def ctrl(u: float) -> float:
    """The command beyond the dead zone, in the unit that MuJoCo takes."""
    return max(GAIN * u - DEAD_ZONE, 0.0) + min(GAIN * u + DEAD_ZONE, 0.0)
'''
