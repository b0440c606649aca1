"""A motor in the form that compiled kernels use."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.plant.friction import Friction, FrictionLaw
from emsid.plant.motor import Motor

Array = NDArray[np.float64]


class Extra(NamedTuple):
    """What acts on a motor besides the equations of `emsid.plant.motor`; an energy balance does not have it.

    Attributes:
        quadratic: friction by the square of the speed on the load, in N·m·s²/rad².
        waves: (n, 4) torques that repeat with the angle of a body and act against it: the body, phase per rad of its
            angle, cosine and sine in N·m.
    """

    quadratic: float = 0.0
    waves: Array = np.empty((0, 4))


NOTHING = Extra()


class Constants(NamedTuple):
    """A motor as numbers and arrays; bodies are (rotor, load), directions (forward, backward)."""

    resistance: float
    inductance: float
    motor_constant: float
    stiffness: float
    damping: float
    gap: float  # half the backlash
    quadratic: float
    rigid: bool
    curved: bool  # whether forces are not linear, other than by the exponential of (4.7)
    holds: NDArray[np.bool_]  # (2,) by body, whether its friction may hold it; of a rigid motor, both together first
    inertia: Array  # (2,) by body
    viscous: Array  # (2,) by body
    edge: Array  # (2,) break points of the torque dead zone
    slope: Array  # (3,) of its branches: left, within, right
    corner: Array  # (3,) torque at which the branch is zero
    scale: Array  # (4,) current, speeds and twist that one volt causes
    breakaway: (
        Array  # (2, 2) by body and direction without load; of a rigid motor, both bodies together in the first row
    )
    friction: Array  # (2, 2, n) the numbers of the friction laws, by body and direction
    waves: Array  # (m, 4) see `Extra`


def flattened(m: Constants) -> Array:
    """The constants in one array, which a compiled function takes from Python in less time than all."""
    flat: Array = np.concatenate([[m.friction.shape[2]], *(np.ravel(each) for each in m)])
    return flat


@njit(nogil=True, error_model="numpy", inline="always")
def from_flat(flat: Array) -> Constants:
    """The constants of `flattened`."""
    n = int(flat[0])
    return Constants(
        flat[1],
        flat[2],
        flat[3],
        flat[4],
        flat[5],
        flat[6],
        flat[7],
        flat[8] > 0.0,
        flat[9] > 0.0,
        flat[10:12] > 0.0,
        flat[12:14],
        flat[14:16],
        flat[16:18],
        flat[18:21],
        flat[21:24],
        flat[24:28],
        flat[28:32].reshape(2, 2),
        flat[32 : 32 + 4 * n].reshape(2, 2, n),
        flat[32 + 4 * n :].reshape(-1, 4),
    )


def acting_laws(motor: Motor) -> list[FrictionLaw]:
    """The friction laws on rotor and load; one whose level does not change is that of (4.7)."""
    laws = (motor.rotor_friction, motor.load_friction)
    return [law if isinstance(law, Friction) or law.varies.any() else Friction(law.breakaway) for law in laws]


def constants(motor: Motor, extra: Extra = NOTHING) -> Constants:
    """The motor in this form."""
    laws = acting_laws(motor)
    other = not all(isinstance(law, Friction) for law in laws)
    curved = other or extra.quadratic > 0 or len(extra.waves) > 0
    breakaway = np.array([law.breakaway for law in laws])
    holds = np.array([law.varies.any() or any(law.breakaway) for law in laws])
    if motor.is_rigid:
        breakaway[0] += breakaway[1]
        holds[0] |= holds[1]
    kind = np.result_type(*(law.numbers for law in laws))
    friction = np.zeros((2, 2, max(law.numbers.shape[1] for law in laws)), kind)
    for body, law in enumerate(laws):
        friction[body, :, : law.numbers.shape[1]] = law.numbers
    zone = motor.torque_dead_zone
    stiffness = 0.0 if motor.is_rigid else motor.shaft_stiffness
    stall, idle = 1 / motor.resistance, 1 / motor.motor_constant
    twist = 1.0 if motor.is_rigid else motor.motor_constant * stall / stiffness
    return Constants(
        motor.resistance,
        motor.inductance,
        motor.motor_constant,
        stiffness,
        0.0 if motor.is_rigid else motor.shaft_damping,
        0.0 if motor.is_rigid else 0.5 * motor.shaft_backlash,
        1.0 * extra.quadratic,
        motor.is_rigid,
        curved,
        holds,
        np.array([motor.rotor_inertia, motor.load_inertia]),
        np.array([motor.rotor_viscous, motor.load_viscous]),
        np.array([zone.b_l, zone.b_r]) if zone else np.array([-inf, inf]),
        np.array([zone.m_l, 0.0, zone.m_r]) if zone else np.ones(3),
        np.array([zone.b_l, 0.0, zone.b_r]) if zone else np.zeros(3),
        np.array([stall, idle, idle, twist]),
        breakaway,
        friction,
        extra.waves,
    )


def stored(m: Constants, x: Array) -> float:
    """Magnetic, kinetic and elastic energy in J of a state (5,)."""
    weights = np.array([m.inductance, *m.inertia, m.stiffness])
    moving = np.array([*x[:3], max(abs(x[3]) - m.gap, 0.0)])
    return float(0.5 * weights @ moving**2)
