"""The motion of a motor at the samples of a run, and that of its general form with shaft and inductance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emsid.errors import ModelError
from emsid.models.plants.drive import Acting
from emsid.plant import Motor, State, Taylor, simulate
from emsid.plant.constants import Extra

Array = NDArray[np.float64]

LONG_STEPS = Taylor(order=20, most_steps=200)
"""Sample times are long compared with electrical time constants and resonances; a high order needs fewer steps.

A motor that needs more steps is refused, so that a search stays clear of it.
"""
SHORT_STEPS = Taylor(order=8, tolerance=1e-6)
"""In single precision, in which terms of order 20 overflow: through stops and reversals the free run of motors is then
within 4·10⁻⁶ of its deviation, measured."""
STIFFEST = 60.0
"""The fastest motion of a shaft in radians per sample; a stiffer or more damped shaft is simulated as rigid."""


class MotorMotion(NamedTuple):
    """A motor at the N samples of a run.

    Attributes:
        current: computes the current (N,) in A where it is asked for.
        rotor_speeds, speeds: (N,) of rotor and load in rad/s.
        rotor_positions, positions: (N,) of rotor and load in rad.
    """

    current: Callable[[], Array]
    rotor_speeds: Array
    speeds: Array
    rotor_positions: Array
    positions: Array


def in_steady_state(motor: Motor, volts: Array, speed: float, angle: float) -> Array:
    """(5,) the state of a motor that turns at a speed with the current of a constant voltage (1,)."""
    across = volts[0] if motor.voltage_dead_zone is None else motor.voltage_dead_zone(volts)[0]
    return np.array([(across - motor.motor_constant * speed) / motor.resistance, speed, speed, 0.0, angle])


def two_masses(motor: Motor, load_torque: float, extra: Extra, on: Acting, motion: Array) -> tuple[MotorMotion, Array]:
    """The motion of the general motor (4.1)–(4.11), and its state after the run.

    Args:
        motor: with shaft, or with inductance.
        load_torque: constant torque on the load in N·m.
        extra: what else acts on it.
        on: what the drive applies.
        motion: (5,) the state before the run: current, rotor speed, load speed, twist and load angle.

    Raises:
        ModelError: for a bridge that coasts.
    """
    check_conducting(on.conducts)
    ends = motion[:, None]
    volts, durations = _pieces(on.voltage, on.dt, on.late)
    torques = load_torque + (np.repeat(on.load[:-1], len(volts) // (len(on.load) - 1)) if len(on.load) > 1 else 0.0)
    if len(volts):
        start = State(*motion.tolist())
        if is_stiff(motor, on.dt):
            start, motor = replace(start, rotor_speed=start.load_speed, twist=0.0), motor.rigid()
        whole = simulate(motor, volts, durations, disturbance=torques, initial=start, method=LONG_STEPS, extra=extra)
        motion = np.array(astuple(whole.final))
        every = slice(None, None, 2 if 0 < on.late < 1 else 1)
        rows = (whole.current, whole.rotor_speed, whole.load_speed, whole.twist, whole.load_angle)
        ends = np.column_stack([np.array(rows)[:, every], motion])
    current, rotor_speeds, speeds, twist, positions = ends[:, on.samples]
    return MotorMotion(lambda: current, rotor_speeds, speeds, positions + twist, positions), motion


def check_conducting(conducts: Array) -> None:
    """Refuse a bridge that coasts, beside a shaft or an inductance.

    Raises:
        ModelError: where it does.
    """
    if np.any(conducts != 1.0):
        raise ModelError(
            "a bridge that coasts is simulated for a rigid motor without inductance only; choose rigid-motor, "
            "or leave out these samples with a mask",
            arguments=("mask",),
        )


def without_shaft(names: Sequence[str]) -> list[str]:
    """Those of the names that one mass without inductance has; none where no name is of a shaft."""
    if not any(name.startswith("shaft_") for name in names):
        return []
    left = [name for name in names if not name.startswith("shaft_") and name != "inductance"]
    if "rotor_inertia" in left and "load_inertia" in left:  # one mass has only their sum
        left.remove("load_inertia")
    return left


def is_stiff(motor: Motor, dt: float) -> bool:
    """Whether a shaft is too stiff to be simulated over pieces of ``dt``; it is then rigid."""
    return not motor.is_rigid and not motor.shaft_backlash and _fastest(motor) * dt > STIFFEST


def _fastest(motor: Motor) -> float:
    """How fast rotor and load come together, in rad/s: their resonance without damping, or the damping alone."""
    share = 1 / motor.rotor_inertia + 1 / motor.load_inertia
    return max(float(np.sqrt(motor.shaft_stiffness * share)), motor.shaft_damping * share)


def _pieces(voltage: Array, dt: float, late: float) -> tuple[Array, Array]:
    """Voltages and their durations: two per sample if the delay ends within it."""
    if late <= 0:
        return voltage[1:], np.full(len(voltage) - 1, dt)
    if late >= 1:
        return voltage[:-1], np.full(len(voltage) - 1, dt)
    held = np.column_stack([voltage[:-1], voltage[1:]]).ravel()
    return held, np.tile([late * dt, (1 - late) * dt], len(voltage) - 1)
