"""Setup of the study: the motor, the bench, the two inputs, and the errors published in the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from emsid.errors import DataError
from emsid.excitation import sines
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record

SIMULATION, EXPERIMENT = "simulation", "experiment"
IDENTIFICATION, UNSEEN = "identification", "unseen"

# Sums of two sines (section V.B) for slow operation in both directions: amplitudes in V, frequencies in Hz.
INPUTS = {IDENTIFICATION: ((3.0, 2.0), (0.4, 1.3)), UNSEEN: ((2.5, 2.0), (0.25, 0.9))}

# MSE (5.14) from Tables 1 and 2 of the paper: (linear, nonlinear). Its motor is another one, its units are not stated.
PAPER_MSE = {
    (SIMULATION, IDENTIFICATION): (0.0005634, 2.559e-05),
    (SIMULATION, UNSEEN): (0.002264, 4.063e-06),
    (EXPERIMENT, IDENTIFICATION): (0.1105, 0.004573),
    (EXPERIMENT, UNSEEN): (0.1933, 0.06834),
}
# Section V.A: mean square difference of the outputs with and without friction on the load side.
PAPER_LOAD_FRICTION_MSE = 3.341e-6


def paper_ratio(study: str, data: str) -> float:
    """MSE of the paper's linear model divided by that of its nonlinear model.

    >>> round(paper_ratio(SIMULATION, UNSEEN)), round(paper_ratio(EXPERIMENT, UNSEEN), 1)
    (557, 2.8)
    """
    linear, nonlinear = PAPER_MSE[study, data]
    return linear / nonlinear


@dataclass(frozen=True)
class Settings:
    """Settings of the study.

    Args:
        motor: the plant.
        bench: noise, quantisation, delay and ripple of the experiment study.
        dt: sample time in seconds.
        duration: length of every record in seconds.
        seed: of the noise of the bench.
        forgetting: factor of the recursive estimates.
        knots: hinges on either side of zero in the friction regression.
        transient: samples that start a free run and are left out of every error; by default what the largest model
            needs.
    """

    motor: Motor = Motor()  # noqa: RUF009  (frozen)
    bench: Bench = Bench.typical()  # noqa: RUF009  (frozen)
    dt: float = 0.005
    duration: float = 20.0
    seed: int = 1
    forgetting: float = 1.0
    knots: int = 12
    transient: int | None = None

    def __post_init__(self) -> None:
        if not 0 < self.forgetting <= 1:
            raise DataError(
                f"forgetting factor {self.forgetting:g}; give one above 0, up to 1", arguments=("forgetting",)
            )
        for what, value, least in (("sample time", self.dt, 1e-6), ("duration", self.duration, 200 * self.dt)):
            if not isfinite(value):
                raise DataError(f"{what} of {value:g} s; give a finite number")
            if not value >= least:
                raise DataError(f"{what} of {value:g} s is too short for the study; give at least {least:g} s")


def measure(settings: Settings, bench: Bench, kind: str, rng: np.random.Generator) -> Record:
    """A record of the settings' motor on a bench, driven by one of `INPUTS`."""
    samples = round(settings.duration / settings.dt)
    voltage = sines(samples, settings.dt, *INPUTS[kind])
    return bench.run(settings.motor, voltage, settings.dt, rng, name=kind)


def load_friction_difference(settings: Settings) -> tuple[float, float]:
    """The paper's preliminary check: the effect of friction on the load side on the output.

    Returns:
        Mean square difference of the outputs with and without it, and the variance of the output with it.
    """
    rng = np.random.default_rng(settings.seed)
    without = replace(settings, motor=replace(settings.motor, load_friction=Friction()))
    outputs = [measure(each, Bench(), IDENTIFICATION, rng).output for each in (settings, without)]
    return float(np.mean((outputs[0] - outputs[1]) ** 2)), float(np.var(outputs[0]))
