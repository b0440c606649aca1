"""How often the 95 % intervals of a fitted cascade hold the truth, with white and with coloured noise.

    python tests/coverage_cascade.py [datasets]

simulates so many data sets (300 by default) of a filter, a dead zone and a filter for each kind of noise, fits each,
and prints the coverage of every parameter. The standard error of a coverage from 300 sets is 1.3 %. The test suite
runs a short form of it.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid.models.cascade import Cascade, fit_cascade, unit_gain
from emsid.models.filters import Rational
from emsid.models.static_maps import DeadZone
from emsid.record import Record

TRUTH = unit_gain(
    Cascade(
        (Rational([0.4], [-0.6]), DeadZone(-0.5, 0.4, 1.0, 1.2), Rational([0.1, 0.05], [-1.3, 0.45])),
        output_offset=0.1,
    )
)
NOISES = {"white": 0.0, "coloured, pole 0.9": 0.9}
SAMPLES = 2_000
NOISE = 0.05


def record(seed: int, pole: float) -> Record:
    """One data set: a coloured input of many levels, 5 % of noise on the output."""
    rng = np.random.default_rng(seed)
    u = lfilter([1.0], [1.0, -0.7], rng.standard_normal(SAMPLES))
    u *= 1.5 / np.std(u)
    y = TRUTH.output(u, TRUTH.resting(float(u[0])))
    noise = lfilter([1.0], [1.0, -pole], rng.standard_normal(SAMPLES + 200))[200:]
    return Record(u, y + NOISE * np.std(y) / np.std(noise) * noise, 1e-3)


def covered(seed: int, pole: float) -> tuple[tuple[str, ...], NDArray[np.bool_]]:
    """Which parameters' 95 % intervals hold the truth in one data set."""
    fit = fit_cascade(TRUTH, record(seed, pole))
    truth = np.array([TRUTH.parameters[TRUTH.names.index(name)] for name in fit.names])
    interval = fit.interval(0.95)
    return fit.names, (interval[:, 0] <= truth) & (truth <= interval[:, 1])


def coverage(datasets: int, pole: float) -> dict[str, float]:
    """The share of data sets in which each parameter's interval holds the truth."""
    results = [covered(seed, pole) for seed in range(datasets)]
    return dict(zip(results[0][0], np.mean([held for _, held in results], axis=0).tolist(), strict=True))


def main() -> int:
    """Print the coverages; the status is 1 if the mean of one kind of noise is outside 92 to 98 %."""
    datasets = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    status = 0
    for name, pole in NOISES.items():
        shares = coverage(datasets, pole)
        mean = float(np.mean(list(shares.values())))
        print(f"{name}: {100 * mean:.1f} %  " + "  ".join(f"{k} {100 * v:.0f}" for k, v in shares.items()))
        status |= not 0.92 <= mean <= 0.98
    return status


if __name__ == "__main__":
    raise SystemExit(main())
