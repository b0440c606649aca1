r"""A joint whose motor crosses the backlash of its gear alone: two masses that touch, or do not.

The gap 2β is between motor (angle x, speed v) and load (z, w), both on the side of the motor. In it each moves as one
mass of its own (`one_mass`): the motor with J_m, its friction and the drive, the load with J_L + m·l²/n², its own
friction, gravity and the constant load. Where they touch, x − z = ±β, they move as one mass with the sum of both.

- Impact: where the gap closes they have one speed after it, (J_m·v + J_L·w)/(J_m + J_L), as a geared shaft without
  rebound has. The time at which it closes is found by bisection in the exact motion of both.
- Separation: contact pushes and never pulls. It lasts over a step where motor and load, each moved alone, would come
  into each other; else the step of each alone is taken. At separation the contact carries nothing, so that a separation
  found at a step's begin changes the angle by the third power of the step only.

An encoder on the motor reads x. The survey of Nordin and Gutman, Automatica 38 (2002), derives both for stiff shafts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, remainder, tau
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.models.plants.cogging import Cogging
from emsid.models.plants.drive import Acting
from emsid.models.plants.gravity import Gravity
from emsid.models.plants.one_mass import OneMass, Sliding, compiled_with_law, move, one_of
from emsid.models.plants.state import NO_LOAD
from emsid.plant.friction import Friction

if TYPE_CHECKING:
    from emsid.record import Record

Array = NDArray[np.float64]

_NO_LOAD = NO_LOAD
IMPACTS = 8
"""Impacts and separations within one step; with more, motor and load stay together until its end."""
BISECTIONS = 50
"""Halvings of the time of an impact within a step: to the last digit."""
TOUCHING = 1e-9
"""The part of the gap within which motor and load touch: rounding of large angles."""


def begun(plant: Any, speed: float, position: float) -> Array:
    """(5,) the motion of a joint whose motor and load have one speed; gravity has moved the load where it can.

    That is speed and angle of motor and load, and the side on which they touch: 1, −1, or 0 for none.
    """
    gravity, half, distance = plant.gravity or Gravity(), _half(plant), 0.0
    if gravity.whole:
        per_unit = gravity.per_unit(plant.sensor.ratio)
        distance = remainder(per_unit * position - tau * gravity.angle / gravity.period, tau) / per_unit
    behind = min(max(distance, -half), half)
    return np.array([speed, position, speed, position - behind, np.sign(behind) if abs(distance) >= half else 0.0])


def check_gap(plant: Any) -> None:
    """Refuse a backlash that is negative or not finite, or of a motor that is no joint.

    Raises:
        ModelError: for such a backlash.
    """
    if not (isfinite(plant.backlash) and plant.backlash >= 0):
        raise ModelError(f"joint with a backlash of {plant.backlash}; it cannot be negative and must be finite")
    if plant.backlash and (plant.gravity is None or plant.motor.inductance or plant.sensor.backlash):
        raise ModelError(
            "backlash with the encoder on the motor is simulated for a joint without inductance; give sensor.backlash "
            "for an encoder on the load, not both"
        )


def first_gap(segments: Sequence[Record]) -> float:
    """A backlash to begin a search with: a third of the way between two samples at top speed.

    A search that began with all of that way missed the widest of the gaps that were tried (0.01 to 0.05 rad).
    """
    differences = [
        each.output[:, 0] * each.dt if each.output_units[0].endswith("/s") else np.diff(each.output[:, 0])
        for each in segments
    ]
    return float(np.max(np.abs(np.concatenate(differences)))) / 3


def moved_apart(plant: Any, torque: Array, braking: Array, on: Acting, motion: Array) -> tuple[Array, Array, Array]:
    """Speeds and angles (M + 1,) of the motor at the ends of pieces, and the motion (5,) after them; see `begun`.

    Args:
        plant: the joint.
        torque, braking: (M + 1,) of the drive at rest, and its decrease per rad/s.
        on: what the drive applies.
        motion: (5,) before the first piece.
    """
    mass, laws, friction, force, damping, _ = zip(*_bodies(plant, torque, braking), strict=True)
    acting = (np.array(mass), Sliding.of_all(friction), np.array(force), np.array(damping), on.load)
    speeds, angles, after = np.empty(len(torque)), np.empty(len(torque)), np.array(motion, dtype=float)
    compiled_with_law(laws[0], _across)(*acting, on.dt, on.late, plant.steps, _half(plant), after, speeds, angles)
    return speeds, angles, after


class Apart(NamedTuple):
    """What is between the drive and motor and load of a joint, as numbers; bodies are those of `_bodies`.

    Attributes:
        zone, before, after, braking, per_ampere, lag, drop: see `emsid.models.plants.sampling.Inside`.
        masses: (4,) in kg·m².
        shares, offsets: (4,) the force on a body is a share of that of the drive, and an offset.
        half: β on the side of the motor.
    """

    zone: Array
    before: float
    after: float
    braking: float
    per_ampere: float
    lag: float
    drop: float
    masses: Array
    shares: Array
    offsets: Array
    half: float


def apart(plant: Any, inside: Any) -> tuple[Apart, Sliding]:
    """The numbers of a joint with backlash, and the friction on its bodies.

    Args:
        plant: the joint.
        inside: what is between the drive and both bodies together.
    """
    ends = [_bodies(plant, np.full(1, level), np.full(1, level)) for level in (0.0, 1.0)]
    zero, one = (np.array([body.force[0] for body in bodies]) for bodies in ends)
    masses, friction = np.array([body.mass for body in ends[0]]), Sliding.of_all([body.friction for body in ends[0]])
    drive = inside.zone, inside.before, inside.after, inside.braking, inside.per_ampere, 0.0, inside.drop
    return Apart(*drive, masses, one - zero, zero, _half(plant)), friction


def _half(plant: Any) -> float:
    """β on the side of the motor."""
    half: float = 0.5 * plant.backlash * abs(plant.sensor.ratio)
    return half


def _bodies(plant: Any, torque: Array, braking: Array) -> list[OneMass]:
    """Motor, load, and both together with the motor ahead of the load, and behind it."""
    motor, hangs, none = plant.motor, plant.gravity or Gravity(), np.zeros(len(torque))
    law = motor.rotor_friction
    alone = replace(
        plant,
        motor=replace(motor, load_viscous=0.0, load_friction=Friction()),
        gravity=replace(hangs, torque=0.0, mass=0.0),
        load_torque=0.0,
    )._sliding(torque, braking)
    behind = replace(
        plant,
        motor=replace(motor, rotor_viscous=0.0, rotor_friction=type(law)()),
        cogging=Cogging(),
        quadratic_viscous=0.0,
        viscous_backward=0.0,
        voltage_drop=0.0,
    )._sliding(none, none)
    load = behind._replace(mass=plant.inertia_of_all - motor.rotor_inertia, force=none - plant.load_torque)
    shift = 0.5 * plant.backlash * (1 if plant.sensor.ratio > 0 else -1)
    both = [replace(plant, gravity=replace(hangs, angle=hangs.angle + side * shift)) for side in (1, -1)]
    return [alone._replace(mass=motor.rotor_inertia), load, *(each._sliding(torque, braking) for each in both)]


@njit(nogil=True, error_model="numpy")
def _moved_alone(
    body: int, mass: Array, friction: Sliding, force: Array, damping: Array, load: Array, h: float, begin: Any
) -> tuple[float, float]:
    """Speed and position of a body after h seconds under the forces (4,) of now."""
    own = one_of(friction, body, friction.servo[0] if body != 1 else friction.servo[0][:0])
    pull, drag = np.full(2, force[body]), np.full(2, damping[body])
    speeds, positions = np.empty(2), np.empty(2)
    move(mass[body], own, pull, drag, load, h, 0.0, 1, 0.0, np.array(begin), speeds, positions, speeds[:0])
    return speeds[1], positions[1]


@njit(nogil=True, error_model="numpy")
def advance_apart(
    inside: Apart, friction: Sliding, dt: float, late: float, steps: int, work: Array, motion: Array
) -> None:
    """Move motor and load over a time; see `emsid.models.plants.sampling.advance`, but for ``motion`` (5,)."""
    force, drag = np.empty((4, 2)), np.empty((4, 2))
    for body in range(4):
        for k in range(2):
            force[body, k] = inside.shares[body] * work[0, k] + inside.offsets[body]
            drag[body, k] = inside.shares[body] * work[1, k]
    _across(inside.masses, friction, force, drag, _NO_LOAD, dt, late, steps, inside.half, motion, work[2], work[3])


@njit(nogil=True, error_model="numpy")
def _across(
    mass: Array,
    friction: Sliding,
    force: Array,
    damping: Array,
    load: Array,
    dt: float,
    late: float,
    steps: int,
    half: float,
    motion: Array,
    speeds: Array,
    angles: Array,
) -> None:
    """See `moved_apart`; ``motion`` is replaced by that after the run."""
    none = load[:0]
    v, x, w, z, side = motion[0], motion[1], motion[2], motion[3], motion[4]
    for k in range(force.shape[1] - 1):
        speeds[k], angles[k] = v, x
        more = load[k : k + 1]
        for part in range(2):
            whole = late * dt if part == 0 else (1.0 - late) * dt
            if whole <= 0.0:
                continue
            pull, drag = force[:, k + part].copy(), damping[:, k + part].copy()
            for _ in range(steps):
                left = whole / steps
                for event in range(IMPACTS + 1):
                    v1, x1 = _moved_alone(0, mass, friction, pull, drag, none, left, (v, x))
                    w1, z1 = _moved_alone(1, mass, friction, pull, drag, more, left, (w, z))
                    apart = x1 - z1
                    if side != 0.0 and (side * apart >= half * (1.0 - TOUCHING) or event == IMPACTS):
                        if side > 0.0:
                            v, x = _moved_alone(2, mass, friction, pull, drag, more, left, (v, x))
                        else:
                            v, x = _moved_alone(3, mass, friction, pull, drag, more, left, (v, x))
                        w, z = v, x - side * half
                        break
                    side = 0.0
                    if abs(apart) <= half:
                        v, x, w, z = v1, x1, w1, z1
                        break
                    towards = 1.0 if apart > 0.0 else -1.0
                    low, high = 0.0, left
                    for _ in range(BISECTIONS):
                        middle = 0.5 * (low + high)
                        v1, x1 = _moved_alone(0, mass, friction, pull, drag, none, middle, (v, x))
                        w1, z1 = _moved_alone(1, mass, friction, pull, drag, more, middle, (w, z))
                        if towards * (x1 - z1) > half:
                            high = middle
                        else:
                            low = middle
                    v = w = (mass[0] * v1 + mass[1] * w1) / (mass[0] + mass[1])
                    x, side = x1, towards
                    z = x - side * half
                    left -= high
                    if left <= 0.0:
                        break
    motion[0], motion[1], motion[2], motion[3], motion[4] = v, x, w, z, side
    speeds[-1], angles[-1] = v, x
