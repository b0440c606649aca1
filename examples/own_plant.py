"""A plant of your own: a motor that turns a fan and a pendulum, written down in a few lines and fitted.

    python own_plant.py

A voltage drives a motor whose load is a pendulum; a fan on the shaft brakes with the square of the speed:

    J·dω/dt = k·u − b·ω − c·|ω|·ω − m·sin(θ)        dθ/dt = ω        y = θ

The plant is two functions of (state, input, parameters) and a table of parameters with units; that is all emsid needs
to find the parameters, their intervals and the state in which each record began. J is known only as a scale of the
others, so the table is in units of it: all parameters are divided by the inertia. The figure is written to
own-plant.svg.
"""

from __future__ import annotations

import sys

import numpy as np
from numba import njit
from numpy.typing import NDArray

import emsid
from emsid.plants import OwnPlant, Parameter, Signal

Array = NDArray[np.float64]
DT = 0.01  # s


@njit
def derivative(x: Array, u: Array, p: Array) -> Array:
    """Change of angle and speed."""
    angle, speed = x
    gain, viscous, fan, gravity = p
    return np.array([speed, gain * u[0] - viscous * speed - fan * abs(speed) * speed - gravity * np.sin(angle)])


@njit
def output(x: Array, u: Array, p: Array) -> Array:
    """The angle."""
    return x[:1]


PLANT = OwnPlant(
    derivative,
    output,
    table=(
        Parameter("gain", "k", "rad/(V*s^2)", "acceleration per volt"),
        Parameter("viscous", "b", "1/s", "viscous friction over inertia"),
        Parameter("fan", "c", "1/rad", "braking by the fan over inertia"),
        Parameter("gravity", "m", "rad/s^2", "torque of the pendulum's weight over inertia"),
    ),
    values=(5.0, 1.0, 0.1, 20.0),  # a rough start
    states=2,
    bounds=(("gain", 0.1, 100.0), ("viscous", 0.0, 20.0), ("fan", 0.0, 10.0), ("gravity", 1.0, 200.0)),
    steps=2,
    name="fan and pendulum",
)
TRUTH = {"gain": 8.0, "viscous": 0.6, "fan": 0.25, "gravity": 32.0}


def experiment(seed: int, seconds: float = 10.0) -> emsid.Record:
    """An experiment with the true parameters and 5 mrad of noise."""
    rng = np.random.default_rng(seed)
    voltage = 3.0 * np.repeat(rng.uniform(-1.0, 1.0, int(seconds / 0.5)), round(0.5 / DT))
    clean = PLANT.with_values(TRUTH).simulate(voltage[:, None], DT, np.zeros(2), (Signal.POSITION,))
    noisy = clean + 5e-3 * rng.standard_normal(clean.shape)
    return emsid.Record(voltage, noisy, DT, "voltage", "angle", "V", "rad", name=f"experiment {seed}")


def main() -> tuple[emsid.Fit[emsid.PlantModel], emsid.Comparison]:
    """Fit one experiment, run the model on another, and print what came out."""
    fit = emsid.fit(PLANT, experiment(1))
    print(fit)
    comparison = emsid.compare(fit, experiment(2))
    print(comparison)
    step = emsid.simulate(fit, np.ones(300), dt=DT)
    print(f"A step of 1 V turns it to {step.output[-1, 0]:.3f} rad.")
    comparison.plot().savefig("own-plant.svg")
    return fit, comparison


if __name__ == "__main__":
    try:
        main()
    except emsid.EmsidError as problem:
        sys.exit(str(problem))
