"""Two tanks above one another that overflow: a plant of the library, fitted.

    python two_tanks.py

A pump fills the upper tank, which runs out into the lower one; a part of what it spills falls into the lower one, too.
Flows are powers of levels, and the reading of the level has an offset (`emsid.plants.tanks`, whose source is two
functions and a table of parameters, as in ``own_plant.py``). A level forgets its start slowly, so emsid takes as many
samples for the start of a free run as a difference of levels lasts. A linear model is fitted beside it. The figure is
written to two-tanks.svg.
"""

from __future__ import annotations

import sys

import numpy as np

import emsid
from emsid.plants import Signal

DT = 4.0  # s
TANKS = emsid.plants.tanks(full=10.0)
TRUTH = {
    "pump": 0.06,
    "pump.offset": 0.3,
    "pump.power": 0.9,
    "upper.outflow": 0.06,
    "upper.power": 0.55,
    "upper.full": 10.0,
    "overflow": 0.6,
    "lower.outflow": 0.055,
    "lower.power": 0.5,
    "lower.full": 10.0,
    "level.offset": 0.2,
}
NOISE = 0.05


def experiment(seed: int, samples: int = 1000) -> emsid.Record:
    """Pump voltages that are held for a while, and a noisy level."""
    rng = np.random.default_rng(seed)
    pump = np.repeat(rng.uniform(0.5, 5.5, samples // 20), 20)
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
