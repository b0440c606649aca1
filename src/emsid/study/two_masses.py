"""The motor with its shaft, beyond the check of the estimator.

In the simulation study the motor with its shaft is fitted to noise-free data of the program's own simulator, with the
resistance, the viscous friction and the load friction fixed at their true values. Here it is fitted to records that
are less kind: of another integrator, with the noise of the bench, and with fixed values that are 10 % wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from emsid.estimation.nonlinear.control import FREE, Control
from emsid.estimation.uncertainty.intervals import HALF_WIDTH
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.result import GreyBoxFit
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record
from emsid.study.models import FIXED, two_masses
from emsid.study.setup import IDENTIFICATION, Settings, measure

WRONG = 1.1
"""Factor on the fixed values."""


@dataclass(frozen=True)
class TwoMassRow:
    """The motor with its shaft, fitted to one record.

    Attributes:
        record: what was fitted to.
        fixed: the fixed parameters, by name, as fractions of their true values.
        errors: (estimate − truth)/truth, by parameter.
        intervals: half the width of the 95 % interval divided by the truth, by parameter.
        covered: how many of the intervals contain the truth.
    """

    record: str
    fixed: Mapping[str, float]
    errors: Mapping[str, float]
    intervals: Mapping[str, float]
    covered: int


def row(name: str, fit: GreyBoxFit, truth: Motor, factor: float = 1.0) -> TwoMassRow:
    """How far a fit is from the truth, and how far its intervals reach."""
    plant = DrivenMotor(truth)
    known = {each: plant.value(each) for each in fit.names if plant.value(each) != 0.0}
    places = [fit.names.index(each) for each in known]
    true = np.array(list(known.values()))
    error, reach = fit.estimate[places] / true - 1, HALF_WIDTH * fit.standard_error[places] / true
    return TwoMassRow(
        name,
        dict.fromkeys(FIXED, factor),
        dict(zip(known, error.tolist(), strict=True)),
        dict(zip(known, reach.tolist(), strict=True)),
        int(np.count_nonzero(np.abs(error) <= reach)),
    )


def with_wrong_values(motor: Motor) -> Motor:
    """The motor with the fixed values 10 % too large."""
    load = motor.load_friction
    wrong = load.forward.coulomb * WRONG if isinstance(load, Friction) else 0.0
    return replace(
        motor,
        resistance=WRONG * motor.resistance,
        rotor_viscous=WRONG * motor.rotor_viscous,
        load_viscous=WRONG * motor.load_viscous,
        load_friction=Friction(wrong) if isinstance(load, Friction) else load,
    )


def two_mass_rows(settings: Settings, others: Mapping[str, Record], control: Control = FREE) -> tuple[TwoMassRow, ...]:
    """The motor with its shaft on records of the simulator, of the bench, and others.

    Args:
        settings: motor and bench.
        others: further records of the same motor, by a short description.
        control: when to stop.
    """
    rng = np.random.default_rng(settings.seed)
    quiet, noisy = (measure(settings, bench, IDENTIFICATION, rng) for bench in (Bench(), settings.bench))
    rows = []
    for name, record in {"own simulator, without noise": quiet, **others, "bench with noise": noisy}.items():
        control.doing(f"two masses: {name}")
        rows.append(row(name, two_masses(settings.motor, record, control), settings.motor))
    control.doing("two masses: fixed values 10 % wrong")
    fit = two_masses(with_wrong_values(settings.motor), quiet, control)
    return (*rows, row("own simulator, fixed values 10 % too large", fit, settings.motor, WRONG))
