"""How large can the paper's ratio be? Its own model on a family of motors, in every reading of its experiment.

The paper reports a linear MSE that is 22 and 557 times its nonlinear one (simulation), and 24 and 2.8 times
(experiment). It does not say whether its MSE is of a free run or of a prediction one sample ahead, and gives neither
the sample time nor the numbers of its inputs and its motor. So each of these is varied, over all motors that combine

- a dead zone of none, ±0.5 V, 0 to 0.5 V or 0 to 1.5 V,
- a left slope of 1, 0.8 or 0.5 times the right one,
- a rotor without friction, with friction alike in both directions, with 12 and 4 mN·m, or with friction forward only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.excitation import sines
from emsid.models.regression.structures import arx, wiener_hammerstein_regression
from emsid.plant import Bench, DeadZoneLaw, Friction, Motor
from emsid.study.setup import IDENTIFICATION, INPUTS, UNSEEN
from emsid.validation.comparison import assess

ZONES = {"none": (0.0, 0.0), "±0.5 V": (-0.5, 0.5), "0 to 0.5 V": (0.0, 0.5), "0 to 1.5 V": (0.0, 1.5)}
SLOPES = (1.0, 0.8, 0.5)
FRICTIONS = {
    "none": Friction(),
    "alike": Friction(8e-3, 2e-3, 0.3),
    "12 and 4 mN·m": Friction((12e-3, 4e-3), 2e-3, 0.3),
    "forward only": Friction((8e-3, 0.0)),
}
FREE_RUN, ONE_STEP = "free run", "one step ahead"


@dataclass(frozen=True)
class Reading:
    """One reading of the paper's experiment.

    Args:
        name: what differs from the simulation study.
        dt: sample time in s.
        amplitudes: factors on the two amplitudes of the inputs.
        faster: factor on their frequencies.
        loaded: whether the motor turns its load.
        bench: how it is measured; by default without noise.
    """

    name: str
    dt: float = 0.005
    amplitudes: tuple[float, float] = (1.0, 1.0)
    faster: float = 1.0
    loaded: bool = True
    bench: Bench = Bench()  # noqa: RUF009  (frozen)


READINGS = (
    Reading("as in the study, without noise"),
    Reading("with the noise of the bench", bench=Bench.typical()),
    Reading("without the load", loaded=False),
    Reading("amplitudes 0.3 times as large", amplitudes=(0.3, 0.3)),
    Reading("amplitudes 3 times as large", amplitudes=(3.0, 3.0)),
    Reading("sample time 1 ms", dt=0.001),
    Reading("sample time 20 ms", dt=0.02),
    Reading("sample time 100 ms", dt=0.1),
    Reading("frequencies 10 times as high", faster=10.0),
    Reading("nearly one sine", amplitudes=(1 / 6, 2.5)),
    Reading("nearly one sine, 10 times as high", amplitudes=(1 / 6, 2.5), faster=10.0),
)


@dataclass(frozen=True)
class Largest:
    """The largest ratio of the linear to the paper's nonlinear MSE in one reading.

    Attributes:
        reading: its name.
        error: ``free run`` or ``one step ahead``.
        motors: how many were tried.
        identification, unseen: the largest ratio on the data of the fit, and on unseen data.
        median: the median of the latter over the motors.
        motor: dead zone, slope and friction of the motor with the largest ratio on unseen data.
    """

    reading: str
    error: str
    motors: int
    identification: float
    unseen: float
    median: float
    motor: Mapping[str, Any] = field(default_factory=dict)


def motors() -> Iterator[tuple[dict[str, Any], Motor]]:
    """Every nonlinear motor of the family with its description."""
    for (zone, edges), slope, (friction, law) in product(ZONES.items(), SLOPES, FRICTIONS.items()):
        if zone == "none" and slope == 1.0 and friction == "none":
            continue
        about = {"dead_zone": zone, "slope": slope, "friction": friction}
        yield about, replace(Motor(), voltage_dead_zone=DeadZoneLaw(*edges, m_l=slope), rotor_friction=law)


def ratios(motor: Motor, reading: Reading, duration: float = 20.0, seed: int = 1) -> dict[str, tuple[float, float]]:
    """Linear divided by nonlinear MSE of the paper's models (5.12) and (5.10).

    Returns:
        By error, the ratio on identification data and on unseen data.
    """
    rng = np.random.default_rng(seed)
    tested = motor if reading.loaded else replace(motor, load_inertia=1e-9, load_viscous=0.0).rigid()
    records = []
    for kind in (IDENTIFICATION, UNSEEN):
        amplitudes, frequencies = (np.array(each) for each in INPUTS[kind])
        samples = round(duration / reading.dt)
        voltage = sines(samples, reading.dt, amplitudes * reading.amplitudes, frequencies * reading.faster)
        records.append(reading.bench.run(tested, voltage, reading.dt, rng, name=kind))
    rows = [
        [assess(least_squares(structure, records[0]), record, 4).row for record in records]
        for structure in (arx(na=4, nb=4), wiener_hammerstein_regression(na=4, nb=3, degree=2))
    ]
    pairs = list(zip(*rows, strict=True))
    return {
        FREE_RUN: tuple(linear.simulation_mse / paper.simulation_mse for linear, paper in pairs),
        ONE_STEP: tuple(linear.one_step_mse / paper.one_step_mse for linear, paper in pairs),
    }


def largest(reading: Reading, duration: float = 20.0, control: Control = FREE) -> list[Largest]:
    """The largest ratios of a reading over all motors: of the free run and one step ahead."""
    found = []
    for about, motor in motors():
        control.check()
        found.append((about, ratios(motor, reading, duration)))
    rows = []
    for error in (FREE_RUN, ONE_STEP):
        seen, unseen = (np.array([both[error][k] for _, both in found]) for k in (0, 1))
        known = np.isfinite(seen) & np.isfinite(unseen)
        best = int(np.argmax(np.where(known, unseen, -np.inf)))
        rows.append(
            Largest(
                reading.name,
                error,
                int(known.sum()),
                float(seen[known].max()),
                float(unseen[best]),
                float(np.median(unseen[known])),
                found[best][0],
            )
        )
    return rows


def largest_ratios(duration: float = 20.0, control: Control = FREE) -> tuple[Largest, ...]:
    """The largest ratios of all readings."""
    rows: list[Largest] = []
    for k, reading in enumerate(READINGS):
        control.doing(f"largest ratio, {reading.name}", k, len(READINGS))
        rows += largest(reading, duration, control)
    return tuple(rows)
