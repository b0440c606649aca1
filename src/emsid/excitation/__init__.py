"""Test signals, one pure function each, and measures of how well a signal excites a system.

A signal is an array (N,) of samples in the unit of its amplitude (volts for a drive). The generator holds each sample
until the next. The functions keep no state: random signals take a `numpy.random.Generator`, and equal arguments give
equal samples.
"""

from emsid.excitation.named import (
    SIGNALS,
    amplitude_modulated_prbs,
    chirp,
    crest_factor,
    limit,
    linear_sweep,
    logarithmic_sweep,
    prbs,
    ramp,
    staircase,
)
from emsid.excitation.persistence import largest_order, persistent_excitation_order
from emsid.excitation.sines import (
    full_harmonics,
    low_crest_phases,
    multisine,
    odd_harmonics,
    random_phases,
    schroeder_phases,
    sines,
)

__all__ = [
    "SIGNALS",
    "amplitude_modulated_prbs",
    "chirp",
    "crest_factor",
    "full_harmonics",
    "largest_order",
    "limit",
    "linear_sweep",
    "logarithmic_sweep",
    "low_crest_phases",
    "multisine",
    "odd_harmonics",
    "persistent_excitation_order",
    "prbs",
    "ramp",
    "random_phases",
    "schroeder_phases",
    "sines",
    "staircase",
]
