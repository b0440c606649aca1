"""Searches for cascades of each topology, and the blocks and records that several test files try them on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from emsid.estimation.fit import Fit
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.filters import Rational
from emsid.models.blocks.search.cross_validation import (
    DEFAULTS,
    HAMMERSTEIN,
    HAMMERSTEIN_WIENER,
    WIENER,
    WIENER_HAMMERSTEIN,
    CascadeSearch,
)
from emsid.models.blocks.search.estimation import CascadeStructure
from emsid.models.blocks.search.map_families import families
from emsid.models.blocks.static_maps import CubicSpline
from emsid.record import Record

Array = NDArray[np.float64]
FAST = Rational([0.5, 0.2], [-0.4])
SLOW = Rational([0.1, 0.05], [-1.3, 0.45])
FAMILIES = families()
ABS, COULOMB, DEAD_ZONE = FAMILIES["abs"], FAMILIES["coulomb"], FAMILIES["dead-zone"]
POLYNOMIAL, SPLINE = FAMILIES["polynomial"], FAMILIES["spline"]
KNOTS = np.linspace(-4, 4, 9)
BEND = CubicSpline(KNOTS, KNOTS - 0.04 * KNOTS**3 / 3 + 0.05 * KNOTS**2)
AT_RATE = CascadeSearch(oversampling=1)


def wiener_hammerstein(records: Any, orders: Any = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    """The search for filter, map and filter; `orders` is a pair."""
    pair = (None, None) if orders is None else orders
    return CascadeStructure(WIENER_HAMMERSTEIN, pair, settings).fit(records)


def hammerstein(records: Any, order: int | None = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    """The search for a map before a filter."""
    return CascadeStructure(HAMMERSTEIN, (None, order), settings).fit(records)


def wiener(records: Any, order: int | None = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    """The search for a filter before a map."""
    return CascadeStructure(WIENER, (order, None), settings).fit(records)


def hammerstein_wiener(records: Any, order: int | None = None, settings: CascadeSearch = DEFAULTS) -> Fit[Cascade]:
    """The search for a filter between two maps."""
    return CascadeStructure(HAMMERSTEIN_WIENER, (None, order), settings).fit(records)


def record_of(model: Cascade, samples: int = 1200, noise: float = 0.01, seed: int = 0) -> Record:
    """A record of the cascade from rest, driven by low-pass noise; the noise is a share of the output's spread."""
    rng = np.random.default_rng(seed)
    u = 1.5 * lfilter([0.6], [1, -0.4], rng.standard_normal(samples)) / 0.65
    y = model.output(u, model.resting(float(u[0])))
    return Record(u, y + noise * np.std(y) * rng.standard_normal(samples), 1e-3)


def held_levels(model: Cascade, samples: int, seed: int, noise: float = 0.01) -> Record:
    """A drive's command: levels held for ten samples."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1.4, samples // 10), 10)
    y = model.output(u, model.resting(float(u[0])))
    return Record(u, y + noise * np.std(y) * rng.standard_normal(samples), 1e-3)


def unexplained(fit: Fit[Cascade], record: Record) -> float:
    """Free-run error on a record over the spread of its output."""
    run = fit.model.simulate(record)
    return float(np.sqrt(np.mean((run.output - record.output)[run.counted] ** 2)) / np.std(record.output))
