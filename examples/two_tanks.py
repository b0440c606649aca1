"""Two tanks above one another that overflow, written down in ten lines and fitted.

    python two_tanks.py

    x₁′ = p·u − k₁·√x₁        x₂′ = k₁·√x₁ − k₂·√x₂        both levels end at 10; the lower one is measured

A level forgets its start slowly, so emsid takes as many samples for the start of a free run as a difference of levels
lasts. ``first`` says where the search for the levels at the start begins: at zero a root has no slope. A linear
model is fitted beside it. The figure is written to two-tanks.svg.
"""

from __future__ import annotations

import sys

import numpy as np
from numba import njit

import emsid
from emsid.plants import OwnPlant, Parameter, Signal

DT = 4.0  # s
FULL, EDGE = 10.0, 0.2  # more and more spills over the edge of a full tank


@njit
def derivative(x, u, p):
    """Change of the upper and the lower level."""
    pump, upper, lower = p
    falls, leaves = upper * np.sqrt(max(x[0], 0.0)), lower * np.sqrt(max(x[1], 0.0))
    change = np.array([pump * u[0] - falls, falls - leaves])
    return change - np.minimum(np.maximum((x - FULL + EDGE) / EDGE, 0.0), 1.0) * np.maximum(change, 0.0)


@njit
def output(x, u, p):
    """The lower level; it cannot be above the edge."""
    return np.minimum(x[1:], FULL)


TANKS = OwnPlant(
    derivative,
    output,
    table=(
        Parameter("pump", "p", "1/s", "rise of the upper level for one volt"),
        Parameter("upper", "k₁", "1/s", "outflow of the upper tank"),
        Parameter("lower", "k₂", "1/s", "outflow of the lower tank"),
    ),
    values=(0.05, 0.05, 0.05),  # a rough start
    states=2,
    name="two tanks",
    first=(5.0, 5.0),
)
TRUTH = {"pump": 0.05, "upper": 0.06, "lower": 0.055}
NOISE = 0.05


def experiment(seed: int, samples: int = 1000) -> emsid.Record:
    """Pump voltages that are held for a while, and a noisy level."""
    rng = np.random.default_rng(seed)
    pump = np.repeat(rng.uniform(1.0, 5.5, samples // 20), 20)
    plant, start = TANKS.with_values(TRUTH), rng.uniform(3.0, 7.0, 2)
    level = plant.simulate(pump[:, None], DT, start, (Signal.POSITION,))
    return emsid.Record(pump, level + NOISE * rng.standard_normal(level.shape), DT, "pump", "level", "V", name="tanks")


def main() -> tuple[emsid.Fit[emsid.PlantModel], emsid.Comparison]:
    """Fit one experiment with two models, and judge them on another."""
    record, unseen = experiment(1), experiment(2)
    fit = emsid.fit(TANKS, record)
    print(fit)
    comparison = emsid.compare(fit, emsid.fit(emsid.arx(2, 2, constant=True), record), unseen)
    print(comparison)
    comparison.plot().savefig("two-tanks.svg")
    return fit, comparison


if __name__ == "__main__":
    try:
        main()
    except emsid.EmsidError as problem:
        sys.exit(str(problem))
