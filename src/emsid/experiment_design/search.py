r"""The search for a test signal: the best sections, and then sections near them.

The information of an experiment is nearly the sum of that of its sections, as each begins and ends at rest. For a
fixed number of sections, an exchange (Fedorov, *Theory of Optimal Experiments*, 1972) puts in the place of each the one
of the library that lowers the criterion most, until no exchange does. Then sections near the chosen ones are tried.
With relative parameters the criteria of the wanted ones are

    A:  trace of their covariance,           D:  logarithm of its determinant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emsid.experiment_design.information import Sensitivities, covariance_of
from emsid.experiment_design.limits import Limits
from emsid.experiment_design.sections import Section, library

Array = NDArray[np.float64]
Criterion = Callable[[Array, Array], Array]

SECTIONS = 8
"""Sections of a signal: enough to mix three kinds in any ratio."""
TRIALS = 300
"""Sections near the chosen ones that are tried."""
SWEEPS = 20
"""The most rounds of exchanges; they end after three or four."""


def a_optimal(information: Array, wanted: Array) -> Array:
    """The mean square of the relative standard errors of the wanted parameters, of (…, p, p) information."""
    covariance = covariance_of(information)
    return np.asarray(np.mean(np.diagonal(covariance, axis1=-2, axis2=-1)[..., wanted], axis=-1))


def d_optimal(information: Array, wanted: Array) -> Array:
    """The geometric mean of the variances along the axes of the wanted parameters' region."""
    block = covariance_of(information)[..., wanted[:, None], wanted]
    _, logarithm = np.linalg.slogdet(block)
    return np.asarray(np.exp(logarithm / len(wanted)))


CRITERIA: dict[str, Criterion] = {"a": a_optimal, "d": d_optimal}


@dataclass(frozen=True, eq=False)
class _Tried:
    section: Section
    signal: Array
    information: Array


def searched(
    sensitivities: Sensitivities,
    limits: Limits,
    samples: int,
    least: float,
    wanted: Array,
    criterion: Criterion,
    rng: np.random.Generator,
) -> Array | None:
    """(samples,) the best command found; None where no section is within the limits.

    Args:
        sensitivities: of the model.
        limits: of command and motion.
        samples: how many.
        least: the smallest size of a section, near the break-away level.
        wanted: indices of the wanted parameters.
        criterion: of `CRITERIA`.
        rng: for the sections near the chosen ones.
    """
    length = samples // SECTIONS

    def tried(section: Section) -> _Tried | None:
        signal = limits.scaled(sensitivities.model, section.signal(length), sensitivities.dt)
        if signal is None:
            return None
        return _Tried(section, signal, sensitivities.information(signal, wide=True))

    cycles = length / 10  # ten samples of every cycle
    pool = [each for section in library(least, limits.command, cycles) if (each := tried(section)) is not None]
    if not pool:
        return None
    chosen = _exchanged(pool, wanted, criterion)
    total = np.sum([each.information for each in chosen], axis=0)
    best = float(criterion(total, wanted))
    for _ in range(TRIALS):
        k = int(rng.integers(len(chosen)))
        other = tried(chosen[k].section.varied(rng, limits.command))
        if other is None:
            continue
        changed = total - chosen[k].information + other.information
        value = float(criterion(changed, wanted))
        if value < best:
            chosen[k], total, best = other, changed, value
    signal = np.concatenate([each.signal for each in chosen])
    whole: Array = np.concatenate([signal, np.zeros(samples - len(signal))])
    return whole


def _exchanged(pool: Sequence[_Tried], wanted: Array, criterion: Criterion) -> list[_Tried]:
    """The sections whose sum has the best criterion, by exchange."""
    each = np.array([one.information for one in pool])
    chosen = [int(np.argmin(criterion(SECTIONS * each, wanted)))] * SECTIONS
    best = float(criterion(each[chosen].sum(axis=0), wanted))
    for _ in range(SWEEPS):
        before = best
        for k in range(SECTIONS):
            others = each[chosen].sum(axis=0) - each[chosen[k]]
            values = criterion(others + each, wanted)
            if float(values.min()) < best:
                chosen[k], best = int(np.argmin(values)), float(values.min())
        if best >= before * (1 - 1e-6):
            break
    return [pool[k] for k in chosen]
