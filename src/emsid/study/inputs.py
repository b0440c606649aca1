"""Inputs: what they excite, and what a richer one changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emsid.estimation.linear.least_squares import least_squares
from emsid.excitation import SIGNALS, crest_factor, persistent_excitation_order
from emsid.record import Record
from emsid.study.models import of_the_paper, structures
from emsid.study.setup import IDENTIFICATION, UNSEEN, Settings, measure
from emsid.validation.comparison import assess

# A measured input has noise of the converter, which excites every order; it counts above this share of the largest.
_MEASURED = 1e-3
HIGHEST_ORDER = 16
"""Orders above this one are not looked for: the largest linear model of the study has 8 parameters."""


@dataclass(frozen=True)
class Excitation:
    """What an input excites.

    Attributes:
        record, input: names of the record and of the kind of its input.
        order: of persistent excitation, at most `HIGHEST_ORDER`.
        crest_factor: peak over root mean square.
        conditions: condition number of the regression of (5.12), of (5.10) and of (3.5) with degree 3.
    """

    record: str
    input: str
    order: int
    crest_factor: float
    conditions: dict[str, float]


def excitation_of(record: Record, kind: str) -> Excitation:
    """Order, crest factor and condition numbers of a record's input."""
    voltage = record.input[:, 0]
    conditions = {each.name: float(least_squares(each, record).condition) for each in of_the_paper()}
    order = persistent_excitation_order(voltage, HIGHEST_ORDER, _MEASURED)
    return Excitation(record.name, kind, order, crest_factor(voltage), conditions)


@dataclass(frozen=True)
class Richer:
    """A multisine of the same peak in place of two sines.

    Attributes:
        excitation: what it excites.
        errors: by model, the free-run MSE on the unseen record of two sines when fitted to the two sines, and when
            fitted to the multisine.
    """

    excitation: Excitation
    errors: dict[str, tuple[float, float]]


def richer_input(settings: Settings) -> Richer:
    """The regressions of the study, fitted to a multisine and compared on the unseen record of two sines."""
    rng = np.random.default_rng(settings.seed)
    first, second = (measure(settings, settings.bench, kind, rng) for kind in (IDENTIFICATION, UNSEEN))
    peak = float(np.max(np.abs(first.input)))
    voltage = SIGNALS["multisine"](len(first), settings.dt, peak, rng)
    many = settings.bench.run(settings.motor, voltage, settings.dt, rng, name="multisine")
    found = {
        structure.name: tuple(
            float(assess(least_squares(structure, record), second, structure.memory).row.simulation_mse)
            for record in (first, many)
        )
        for structure in structures(first, settings.knots)
    }
    return Richer(excitation_of(many, "multisine"), found)  # type: ignore[arg-type]
