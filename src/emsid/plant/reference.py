"""A slow and simple simulation of the plant: the reference for tests and timings of `emsid.plant.simulation`.

SciPy integrates (4.1)–(4.11) directly, with any `FrictionLaw` and `DeadZoneLaw`. It is stopped and restarted where a
sliding body comes to rest, a stuck one breaks away, or the voltage changes. Its step-size control handles the corners
of a torque dead zone. The motor must have an inductance and an elastic shaft without
backlash.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from emsid.plant.friction import FrictionLaw, sees_load
from emsid.plant.motor import Motor

Array = NDArray[np.float64]

_SLACK = 1e-12  # relative margin above break-away at which a body starts to slide; above rounding


def simulate_reference(motor: Motor, voltage: Array, dt: float, *, tolerance: float = 1e-12) -> tuple[Array, int]:
    """The motor from rest, driven by a held voltage, without disturbance.

    Args:
        motor: the motor.
        voltage: (N,) in V.
        dt: sample time in s.
        tolerance: relative tolerance of the integrator; the absolute one is a hundredth of it.

    Returns:
        The states (N + 1, 5) at every sample instant, in the order of `emsid.plant.simulation.State`, and the number
        of times a body stuck or broke away.
    """
    states, motion, transitions = [np.zeros(5)], [0, 0], 0
    for volt in voltage if motor.voltage_dead_zone is None else motor.voltage_dead_zone(voltage):
        t, x = 0.0, states[-1].copy()
        while t < dt:
            solution = solve_ivp(
                lambda _, x, volt=float(volt), motion=tuple(motion): _derivative(motor, x, volt, motion),
                (t, dt),
                x,
                method="DOP853",
                rtol=tolerance,
                atol=1e-2 * tolerance,
                events=[_event(motor, body, motion[body]) for body in range(2)],
            )
            t, x = float(solution.t[-1]), solution.y[:, -1]
            for body in range(2):
                if len(solution.t_events[body]):
                    was_held = motion[body] == 0
                    x[1 + body] = 0.0
                    motion[body] = _motion_from_rest(motor, x, body)
                    transitions += was_held or motion[body] == 0
        states.append(x)
    return np.array(states), transitions


def _torques(motor: Motor, x: Array) -> list[tuple[float, float]]:
    """For rotor and load, the torque that drives it and the one from outside, which the load of a friction law is."""
    current, rotor, load, twist, _ = x
    torque = motor.motor_constant * current
    if motor.torque_dead_zone is not None:
        torque = float(motor.torque_dead_zone(torque))
    shaft = motor.shaft_stiffness * twist + motor.shaft_damping * (rotor - load)
    return [(torque, -shaft), (shaft, 0.0)]


def _derivative(motor: Motor, x: Array, volt: float, motion: tuple[int, ...]) -> Array:
    current, rotor, load, _, _ = x
    return np.array(
        [
            (volt - motor.resistance * current - motor.motor_constant * rotor) / motor.inductance,
            _acceleration(motor, x, 0, motion[0]),
            _acceleration(motor, x, 1, motion[1]),
            rotor - load,
            load,
        ]
    )


def _acceleration(motor: Motor, x: Array, body: int, direction: int) -> float:
    """The acceleration of a stuck (direction 0) or sliding body; trial steps beyond standstill keep its direction."""
    if direction == 0:
        return 0.0
    made, outside = _torques(motor, x)[body]
    viscous, inertia = (motor.rotor_viscous, motor.load_viscous)[body], (motor.rotor_inertia, motor.load_inertia)[body]
    level = _level(motor, body, direction * float(x[1 + body]), direction, made, outside)
    return float(made + outside - viscous * x[1 + body] - direction * level) / inertia


def _level(motor: Motor, body: int, speed: float, direction: int, made: float, outside: float) -> float:
    friction = (motor.rotor_friction, motor.load_friction)[body]
    level = type(friction).level
    return float(level(speed, _numbers(friction), int(direction < 0), *(made, outside) * sees_load(level)))


@lru_cache(maxsize=8)
def _numbers(friction: FrictionLaw) -> Array:
    return friction.numbers


def _event(motor: Motor, body: int, direction: int) -> Callable[[float, Array], float]:
    """A function of time and state that falls through zero when the motion of a body ends."""

    def margin(_: float, x: Array) -> float:
        if direction != 0:
            return direction * float(x[1 + body])
        return min(_margins(motor, x, body, 1 + _SLACK))

    margin.terminal, margin.direction = True, -1  # type: ignore[attr-defined]
    return margin


def _margins(motor: Motor, x: Array, body: int, factor: float = 1.0) -> list[float]:
    """What is left, forward and backward, until the torque on a body at rest exceeds break-away."""
    made, outside = _torques(motor, x)[body]
    directions = (1, -1)
    return [factor * _level(motor, body, 0.0, way, made, outside) - way * (made + outside) for way in directions]


def _motion_from_rest(motor: Motor, x: Array, body: int) -> int:
    forward, backward = _margins(motor, x, body)
    return int(forward < 0) - int(backward < 0)
