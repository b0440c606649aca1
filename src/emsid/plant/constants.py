"""A motor in the form that compiled kernels use."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.compiled import njit
from emsid.errors import ModelError
from emsid.plant.friction import Friction, FrictionLaw
from emsid.plant.motor import Motor

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """A motor as numbers and arrays; bodies are (rotor, load), directions (forward, backward)."""

    resistance: float
    inductance: float
    motor_constant: float
    inertia: Array  # (2,) by body
    viscous: Array  # (2,) by body
    stiffness: float
    damping: float
    gap: float  # half the backlash
    rigid: bool
    coulomb: Array  # (2, 2) by body and direction, as the next three
    stribeck: Array
    stribeck_rate: Array
    breakaway: Array  # for a rigid motor, both bodies together in the first row
    edge: Array  # (2,) break points of the torque dead zone
    slope: Array  # (3,) of its branches: left, within, right
    corner: Array  # (3,) torque at which the branch is zero
    scale: Array  # (4,) current, speeds and twist that one volt causes


def flattened(m: Constants) -> Array:
    """(39,) the constants in one array, which a compiled function takes from Python in less time than all of them."""
    flat: Array = np.concatenate([np.ravel(each) for each in m]).astype(float)
    return flat


@njit(nogil=True, error_model="numpy", inline="always")
def from_flat(flat: Array) -> Constants:
    """The constants of `flattened`."""
    return Constants(
        flat[0],
        flat[1],
        flat[2],
        flat[3:5],
        flat[5:7],
        flat[7],
        flat[8],
        flat[9],
        flat[10] > 0.0,
        flat[11:15].reshape(2, 2),
        flat[15:19].reshape(2, 2),
        flat[19:23].reshape(2, 2),
        flat[23:27].reshape(2, 2),
        flat[27:29],
        flat[29:32],
        flat[32:35],
        flat[35:39],
    )


def _paper_law(law: FrictionLaw) -> Friction:
    """The friction (4.7), whose Taylor series the kernels know.

    Raises:
        ModelError: for any other friction law.
    """
    if not isinstance(law, Friction):
        raise ModelError(
            f"friction law {type(law).__name__}: a motor with a shaft, an inductance or a torque dead zone is "
            "simulated with coulomb-stribeck friction only; use a rigid motor with inductance 0"
        )
    return law


def constants(motor: Motor) -> Constants:
    """The motor in this form.

    Raises:
        ModelError: for a friction law whose Taylor series the kernels do not know.
    """
    frictions = (_paper_law(motor.rotor_friction), _paper_law(motor.load_friction))
    levels = np.array([[f.forward, f.backward] for f in frictions])
    breakaway = levels[:, :, 0] + levels[:, :, 1]
    if motor.is_rigid:
        breakaway[0] += breakaway[1]
    zone = motor.torque_dead_zone
    stiffness = 0.0 if motor.is_rigid else motor.shaft_stiffness
    stall, idle = 1 / motor.resistance, 1 / motor.motor_constant
    twist = 1.0 if motor.is_rigid else motor.motor_constant * stall / stiffness
    return Constants(
        motor.resistance,
        motor.inductance,
        motor.motor_constant,
        np.array([motor.rotor_inertia, motor.load_inertia]),
        np.array([motor.rotor_viscous, motor.load_viscous]),
        stiffness,
        0.0 if motor.is_rigid else motor.shaft_damping,
        0.0 if motor.is_rigid else 0.5 * motor.shaft_backlash,
        motor.is_rigid,
        np.ascontiguousarray(levels[:, :, 0]),
        np.ascontiguousarray(levels[:, :, 1]),
        np.ascontiguousarray(levels[:, :, 2]),
        breakaway,
        np.array([zone.b_l, zone.b_r]) if zone else np.array([-inf, inf]),
        np.array([zone.m_l, 0.0, zone.m_r]) if zone else np.ones(3),
        np.array([zone.b_l, 0.0, zone.b_r]) if zone else np.zeros(3),
        np.array([stall, idle, idle, twist]),
    )


def stored(m: Constants, x: Array) -> float:
    """Magnetic, kinetic and elastic energy in J of a state (5,)."""
    weights = np.array([m.inductance, *m.inertia, m.stiffness])
    moving = np.array([*x[:3], max(abs(x[3]) - m.gap, 0.0)])
    return float(0.5 * weights @ moving**2)
