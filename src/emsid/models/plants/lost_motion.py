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
from emsid.models.plants.gravity import Gravity
from emsid.models.plants.one_mass import Sliding, move, one_of
from emsid.plant.friction import Friction

if TYPE_CHECKING:
    from emsid.record import Record

Array = NDArray[np.float64]

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


class Body(NamedTuple):
    """What `move` takes of a body."""

    mass: float
    lag: float


class Apart(NamedTuple):
    """What is between the drive and motor and load of a joint, as numbers; bodies are those of `_bodies`.

    Attributes:
        zone, before, after, braking, per_ampere, lag, drop: see `emsid.models.plants.sampling.Inside`.
        masses: (4,) in kg·m².
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
    half: float


def apart(plant: Any, inside: Any) -> tuple[Apart, Sliding]:
    """The numbers of a joint with backlash, and the friction on its bodies.

    Args:
        plant: the joint.
        inside: what is between the drive and both bodies together.
    """
    masses, friction = zip(*_bodies(plant), strict=True)
    drive = inside.zone, inside.before, inside.after, inside.braking, inside.per_ampere, 0.0, inside.drop
    return Apart(*drive, np.array(masses), _half(plant)), Sliding.of_all(friction)


def _half(plant: Any) -> float:
    """β on the side of the motor."""
    half: float = 0.5 * plant.backlash * abs(plant.sensor.ratio)
    return half


def _bodies(plant: Any) -> list[tuple[float, Sliding]]:
    """Mass and friction of the motor, of the load, and of both with the motor ahead of the load, and behind it."""
    motor, hangs = plant.motor, plant.gravity or Gravity()
    law, inertia = motor.rotor_friction, motor.rotor_inertia
    alone = replace(
        plant,
        motor=replace(motor, load_viscous=0.0, load_friction=Friction()),
        gravity=replace(hangs, torque=0.0, mass=0.0),
        load_torque=0.0,
    )
    behind = replace(
        plant,
        motor=replace(motor, rotor_viscous=0.0, rotor_friction=type(law)()),
        cogging=Cogging(),
        quadratic_viscous=0.0,
        viscous_backward=0.0,
        voltage_drop=0.0,
    )
    shift = 0.5 * plant.backlash * (1 if plant.sensor.ratio > 0 else -1)
    both = [replace(plant, gravity=replace(hangs, angle=hangs.angle + side * shift)) for side in (1, -1)]
    whole = plant.inertia_of_all
    masses = inertia, whole - inertia, whole, whole
    return [(mass, each._sliding) for mass, each in zip(masses, (alone, behind, *both), strict=True)]


@njit(nogil=True, error_model="numpy")
def _moved_alone(
    body: int, inside: Apart, friction: Sliding, force: float, drag: float, more: float, h: float, begin: Any
) -> tuple[float, float]:
    """Speed and position of a body after h seconds under the forces of now; the load has none of the drive."""
    if body == 1:
        force, drag = 0.0, 0.0
    elif body == 0:
        more = 0.0
    own = one_of(friction, body, friction.servo[0] if body != 1 else friction.servo[0][:0])
    motion, ends = np.array(begin), np.empty(2)
    pull, drags, loads, alone = np.full(2, force), np.full(2, drag), np.full(1, more), Body(inside.masses[body], 0.0)
    move(alone, own, pull, drags, loads, h, 0.0, 1, 0, motion, ends, ends, ends)
    return motion[0], motion[1]


@njit(nogil=True, error_model="numpy")
def move_apart(
    inside: Apart,
    friction: Sliding,
    force: Array,
    damping: Array,
    load: Array,
    dt: float,
    late: float,
    steps: int,
    still: int,
    motion: Array,
    speeds: Array,
    positions: Array,
    made: Array,
) -> None:
    """`move` for motor and load, but for ``motion`` (5,), see `begun`; the results are those of the motor."""
    half, mass = inside.half, inside.masses
    v, x, w, z, side = motion[0], motion[1], motion[2], motion[3], motion[4]
    for k in range(len(force) - 1):
        speeds[k], positions[k] = v, x
        for part in range(2):
            whole = late * dt if part == 0 else (1.0 - late) * dt
            if whole <= 0.0 or k < still:
                continue
            pull, drag, more = force[k + part], damping[k + part], load[k]
            for _ in range(steps):
                left = whole / steps
                for event in range(IMPACTS + 1):
                    v1, x1 = _moved_alone(0, inside, friction, pull, drag, more, left, (v, x))
                    w1, z1 = _moved_alone(1, inside, friction, pull, drag, more, left, (w, z))
                    apart = x1 - z1
                    if side != 0.0 and (side * apart >= half * (1.0 - TOUCHING) or event == IMPACTS):
                        if side > 0.0:
                            v, x = _moved_alone(2, inside, friction, pull, drag, more, left, (v, x))
                        else:
                            v, x = _moved_alone(3, inside, friction, pull, drag, more, left, (v, x))
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
                        v1, x1 = _moved_alone(0, inside, friction, pull, drag, more, middle, (v, x))
                        w1, z1 = _moved_alone(1, inside, friction, pull, drag, more, middle, (w, z))
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
    speeds[-1], positions[-1] = v, x
