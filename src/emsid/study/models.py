"""The study: motor, bench, inputs, the models that it compares and how each is estimated, the published errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from emsid.errors import DataError
from emsid.estimation.fit import Fit
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.excitation import sines
from emsid.identification.candidates import CANDIDATES
from emsid.identification.regressions import stribeck_speeds
from emsid.models.blocks.search.cross_validation import WIENER_HAMMERSTEIN, CascadeSearch
from emsid.models.blocks.search.estimation import estimate as estimate_cascade
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.regression.narx import Structure
from emsid.models.regression.structures import arx, friction_narx, input_knots, wiener_hammerstein_regression
from emsid.options import Options
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record

LINEAR, PAPER, FULL, FRICTION, BLOCKS, ONE_MASS, TWO_MASSES = (
    "arx",
    "wiener-hammerstein-regression",
    "wiener-hammerstein-regression-degree-3",
    "friction-narx",
    "wiener-hammerstein",
    "rigid-motor",
    "motor",
)

MEANINGS = {
    LINEAR: "the paper's linear model (5.12)",
    PAPER: "the paper's nonlinear model (5.10), of second degree",
    FULL: "the complete expansion (3.5) of third degree",
    FRICTION: "a regression with friction terms",
    BLOCKS: "filter, dead zone, filter, fitted to the free run",
    ONE_MASS: "the physical motor as one mass",
    TWO_MASSES: "the physical motor with its shaft",
}
"""A short description of every model."""

CHOSEN = {
    FRICTION: "a regression with friction terms; orders and knots chosen",
    BLOCKS: "filter, static map, filter; orders and map chosen",
    ONE_MASS: "the physical motor as one mass; refinements chosen",
}
"""The same for models whose size is chosen on the records of a user."""

# Filter, dead zone (4.9), filter. The input is constant between samples, so oversampling would change nothing.
CASCADE = CascadeSearch(static="dead-zone", oversampling=1, max_iterations=30, threads=1)
START = 24
"""Samples at the start of a record that are left out of every error: as many as the blocks need to begin."""
STRIBECK = ("rotor_friction.stribeck", "rotor_friction.stribeck_rate")
# The resistance is measured and the viscous friction neglected: voltage and speed determine neither, nor what part of
# inertia and friction is on the load of one mass.
KNOWN = ("resistance", "rotor_viscous")
FIXED = (*KNOWN, "load_viscous", "load_friction.coulomb")


def of_the_paper() -> tuple[Structure, ...]:
    """The regressions of the paper: (5.12), (5.10), and the complete (3.5) with degree 3."""
    full = wiener_hammerstein_regression(na=4, nb=3, degree=3, taps=2)
    return (
        arx(na=4, nb=4),
        wiener_hammerstein_regression(na=4, nb=3, degree=2),
        replace(full, name=FULL),
    )


def structures(record: Record, knots: int) -> tuple[Structure, ...]:
    """The regressions of the study: those of the paper, and one with friction terms."""
    return (
        *of_the_paper(),
        friction_narx(na=2, nb=2, knots=input_knots(record, knots), speeds=stribeck_speeds(record)),
    )


def searches(motor: Motor, record: Record, *, shaft: bool) -> dict[str, Callable[[Control], Fit[Any]]]:
    """The models that need a nonlinear search, by name.

    Args:
        motor: the motor of the settings, which the physical models start from.
        record: to identify from.
        shaft: whether the motor with its shaft is among them.
    """
    found: dict[str, Callable[[Control], Fit[Any]]] = {
        BLOCKS: lambda control: blocks(record, control),
        ONE_MASS: lambda control: one_mass(motor, record, control),
    }
    if shaft:
        found[TWO_MASSES] = lambda control: two_masses(motor, record, control)
    return found


def blocks(record: Record, control: Control = FREE) -> Fit[Any]:
    """Filter, dead zone, filter, of orders 1 and 2."""
    return estimate_cascade(WIENER_HAMMERSTEIN, record, (1, 2), CASCADE, control)


def one_mass(motor: Motor, record: Record, control: Control = FREE) -> GreyBoxFit:
    """The motor as one mass; a delay replaces the effect of its inductance."""
    plant = DrivenMotor(replace(motor, inductance=0.0).rigid())
    names = _unknown(plant)
    start = half_off(plant, names).with_values({"drive.delay": 0.5 * record.dt})
    fixed = {name: plant.value(name) for name in (*FIXED, "load_inertia")}
    return simulation_error(start, record, free=(*names, "drive.delay"), fixed=fixed, control=control)


def two_masses(motor: Motor, record: Record, control: Control = FREE) -> GreyBoxFit:
    """The motor with its shaft, fitted to the first half of a record, which is enough without noise."""
    plant = DrivenMotor(motor)
    names = _unknown(plant)
    fixed = {name: plant.value(name) for name in FIXED}
    half = record[: len(record) // 2]
    return simulation_error(half_off(plant, names), half, free=names, fixed=fixed, control=control)


def chosen(record: Record, known: Mapping[str, float]) -> dict[str, Callable[[Control], Fit[Any]]]:
    """The models whose orders, knots and refinements are chosen on a record, as `emsid.identify` does, by name.

    Args:
        record: to identify from.
        known: physical parameters that are known, by name, in SI units.
    """

    def candidate(name: str, options: Options) -> Callable[[Control], Fit[Any]]:
        return lambda control: CANDIDATES[name](record, options, control)

    return {name: candidate(name, Options(fixed=known if name == ONE_MASS else {})) for name in CHOSEN}


def half_off(plant: DrivenMotor, names: Sequence[str]) -> DrivenMotor:
    """The plant with these parameters 50 % too large, as the start of a search."""
    return plant.with_values({name: 1.5 * plant.value(name) for name in names})


def _unknown(plant: DrivenMotor) -> tuple[str, ...]:
    return tuple(name for name in (*plant.default_free, *STRIBECK) if name not in KNOWN)


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
