"""Motors of known structure: linear ones of one or two time constants, and those of `cases`, which have friction.

A linear one is the exact response of K/((Ts + 1)(τs + 1)) to a command held over every sample, after a delay of whole
samples, with an offset and white or coloured noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from emsid.record import Record
from independent.cases import levels, motor, sines

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Known:
    """A record of a motor of known structure.

    Attributes:
        record: what to identify from.
        order: the number of poles; 0 for a motor that is not linear.
        delay: from the command to the first output that it affects, in samples.
        other: another input, with the output of the motor without noise.
    """

    record: Record
    order: int
    delay: int
    other: Record

    @property
    def linear(self) -> bool:
        """Whether the motor is linear."""
        return self.order > 0


def known(seed: int, samples: int = 4000) -> Known:
    """Motor number ``seed``: an even one is linear, with one time constant or two in turn; an odd one has friction."""
    if seed % 2:
        case = motor(seed, samples)
        return Known(case.fitted, 0, 0, case.unseen)
    rng = np.random.default_rng([7, seed])
    dt, order, late = 1e-3, 1 + seed // 2 % 2, int(rng.integers(0, 3))
    slow = np.exp(rng.uniform(np.log(15), np.log(100)))
    fast = slow * rng.uniform(0.25, 0.6)
    below = np.poly([-1 / slow, -1 / fast]) if order == 2 else np.array([1.0, 1 / slow])
    b, a, _ = cont2discrete(([below[-1]], below), 1.0)
    offset, size = rng.uniform(-0.5, 0.5), rng.uniform(0.01, 0.04)
    hold = float(np.clip(2 * slow, 20, samples / 20))

    def output(u: Array) -> Array:
        return 10 * lfilter(np.r_[np.zeros(late), b.ravel()], a, u) + offset

    u, other = levels(samples, rng, hold), sines(samples, rng, 2 * hold)
    e = rng.standard_normal(samples)
    noise = lfilter([0.44], [1, -0.9], e) if rng.random() < 0.5 else e
    clean = output(u)
    y = clean + size * np.std(clean) * noise
    return Known(Record(u, y, dt, name=f"motor {seed}"), order, 1 + late, Record(other, output(other), dt))
