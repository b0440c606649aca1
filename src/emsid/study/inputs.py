"""Inputs: what they excite, and how much the result of a study depends on the one that was chosen."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from emsid.estimation.fit import Fit, fit_or_problem
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.excitation import SIGNALS, crest_factor, persistent_excitation_order, sines
from emsid.record import Record
from emsid.study.models import START, of_the_paper, searches, structures
from emsid.study.setup import IDENTIFICATION, UNSEEN, Settings, measure
from emsid.validation.comparison import assess

MANY = 30
"""How many pairs of inputs `over_inputs` draws."""

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


@dataclass(frozen=True)
class InputRow:
    """A model over many inputs.

    Attributes:
        model: its name.
        parameters: how many were estimated.
        inputs: the number of pairs of inputs.
        median, lowest, highest: free-run MSE of the linear model divided by its own, on unseen data.
    """

    model: str
    parameters: int
    inputs: int
    median: float
    lowest: float
    highest: float


def drawn(settings: Settings, rng: np.random.Generator, name: str) -> Record:
    """A record with a random sum of two sines: 1.5 to 3.5 V each, at 0.2 to 0.6 Hz and at 0.8 to 1.6 Hz."""
    amplitudes = rng.uniform(1.5, 3.5, 2)
    frequencies = rng.uniform((0.2, 0.8), (0.6, 1.6))
    voltage = sines(round(settings.duration / settings.dt), settings.dt, amplitudes, frequencies)
    return settings.bench.run(settings.motor, voltage, settings.dt, rng, name=name)


def over_inputs(
    settings: Settings, count: int = MANY, control: Control = FREE, executor: Executor | None = None
) -> tuple[InputRow, ...]:
    """Every model of the experiment on the bench, over many pairs of inputs for identification and for comparison."""
    found: dict[str, tuple[int, list[float]]] = {}
    pairs: Iterable[list[tuple[str, int, float]]] = map(partial(_of_pair, settings, control), range(count))
    if executor is not None:
        pairs = executor.map(partial(_of_pair, settings, FREE), range(count))
    for k, pair in enumerate(pairs):
        control.doing("many inputs", k + 1, count)
        for model, parameters, ratio in pair:
            found.setdefault(model, (parameters, []))[1].append(ratio)
    return tuple(
        InputRow(model, parameters, count, float(np.median(each)), float(np.min(each)), float(np.max(each)))
        for model, (parameters, each) in found.items()
    )


def _of_pair(settings: Settings, control: Control, k: int) -> list[tuple[str, int, float]]:
    """Every model with its number of parameters and its ratio, for one pair of inputs."""
    rng = np.random.default_rng([settings.seed, k])
    first, second = (drawn(settings, rng, name) for name in ("identification", "unseen"))
    fits: list[Fit[Any]] = [least_squares(structure, first) for structure in structures(first, settings.knots)]
    nonlinear = searches(settings.motor, first, shaft=False)
    fits += [fit_or_problem(partial(search, control)) for search in nonlinear.values()]
    linear = assess(fits[0], second, START).row.simulation_mse
    rows = [assess(fit, second, START).row for fit in fits[1:]]
    return [(row.model, row.parameters, linear / row.simulation_mse) for row in rows]
