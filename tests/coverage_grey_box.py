"""How often 95 % intervals of the grey box contain the true values: ``python tests/coverage_grey_box.py [records]``.

The sensor is a low-resolution encoder behind a drive with coloured noise, so residuals are neither white nor Gaussian.
`make coverage` runs 300 records; the test suite runs a short form of the same function.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.signal import lfilter
from scipy.stats import binom

from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.parameters import Signal
from emsid.models.plants.search.diagnostics import likelihood_profile
from emsid.models.plants.search.estimation import simulation_error
from emsid.plant import DeadZoneLaw, Friction, Motor
from emsid.record import Record

MOTOR = DrivenMotor(
    Motor(
        inductance=0.0,
        load_friction=Friction(),
        rotor_friction=Friction(6e-3),
        voltage_dead_zone=DeadZoneLaw(-0.4, 0.4),
    ).rigid()
)
FREE = ("motor_constant", "rotor_inertia", "rotor_friction.coulomb", "voltage_dead_zone.half_width")
STEP = 0.05  # rad/s, of the quantised speed


STICTION = MOTOR.with_values({"rotor_friction.stribeck": 4e-3, "rotor_friction.stribeck_rate": 0.1})
EXCESS = "rotor_friction.stribeck"


def simulated_record(
    rng: np.random.Generator,
    pole: float = 0.8,
    noise: float = 0.3,
    samples: int = 1500,
    motor: DrivenMotor = MOTOR,
) -> Record:
    """A noisy, quantised speed of a motor driven by random steps and sinusoids."""
    dt = 5e-3
    t = dt * np.arange(samples)
    voltage = 3 * np.sin(2 * np.pi * 0.4 * t) + 2 * np.repeat(rng.uniform(-1, 1, samples // 50), 50)
    speed = motor.simulate(voltage[:, None], dt, np.zeros(2), (Signal.SPEED,))[:, 0]
    coloured = lfilter([np.sqrt(1 - pole**2)], [1, -pole], noise * rng.standard_normal(samples))
    measured = STEP * np.round((speed + coloured) / STEP)
    return Record(voltage, measured, dt, input_units=("V",), output_units=("rad/s",))


def least_share(records: int, level: float = 0.95, risk: float = 0.01) -> float:
    """The least share of intervals of this level that contain the true value; fewer do with this risk by chance."""
    return float(binom.ppf(risk, records, level)) / records


def coverage(records: int, seed: int = 1, samples: int = 1500) -> dict[str, float]:
    """The share of records whose 95 % interval holds the true value, by parameter."""
    rng = np.random.default_rng(seed)
    truth = np.array([MOTOR.value(name) for name in FREE])
    hits = np.zeros(len(FREE))
    for _ in range(records):
        fit = simulation_error(MOTOR, simulated_record(rng, samples=samples), free=FREE)
        if fit.names != FREE:  # one is not identifiable in this record: counted as a miss
            continue
        interval = fit.interval()
        hits += (interval[:, 0] <= truth) & (truth <= interval[:, 1])
    return dict(zip(FREE, (hits / records).tolist(), strict=True))


def coverage_of_an_excess(records: int, noise: float = 3.0, seed: int = 1) -> dict[str, float]:
    """The same for a Stribeck excess in heavy noise, in which the estimate is often zero.

    Of the intervals that are given: those of the standard error, or of the profile where the search ends at a bound and
    has none. Also the share of profiles, and how often the record does not determine the excess.
    """
    rng = np.random.default_rng(seed)
    truth, free = STICTION.value(EXCESS), ("motor_constant", "rotor_inertia", "rotor_friction.coulomb", EXCESS)
    hits = bounds = undetermined = 0
    for _ in range(records):
        fit = simulation_error(STICTION, simulated_record(rng, noise=noise, motor=STICTION), free=free)
        if fit.names != free:
            undetermined += 1
            continue
        bound = fit.table[-1].status == "at a bound"
        low, high = likelihood_profile(fit, EXCESS).interval if bound else fit.interval()[-1]
        hits += bool(low <= truth <= high)
        bounds += bound
    given = records - undetermined
    return {"covered": hits / given, "profiles": bounds / given, "undetermined": undetermined / records}


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    for name, share in coverage(count).items():
        print(f"{name:32} {100 * share:5.1f} % of {count} intervals hold the true value")
    found = {name: 100 * share for name, share in coverage_of_an_excess(count).items()}
    print(f"{EXCESS:32} {found['covered']:5.1f} % in heavy noise; {found['profiles']:.1f} % of them are profiles")
