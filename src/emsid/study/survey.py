"""The survey: other motors, other inputs and other records, and how large the ratio of the paper gets.

It takes about two minutes, so its result for the default settings is kept in ``recorded.json``, which
``python bench/study.py`` writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from emsid.io.files import packaged

RECORDED = "recorded.json"
FREE_RUN, ONE_STEP = "free run", "one step ahead"


@dataclass(frozen=True)
class MotorRow:
    """A motor of the family and what its models reach.

    Attributes:
        motor, meaning: of the `Case`.
        linear_fit_percent: fit of the linear model's free run on unseen data.
        even_share: share of that model's squared error that is the same for u and −u.
        one_step: one-step MSE of the linear model divided by that of the paper's, on unseen data.
        identification: free-run MSE of the linear model divided by that of the paper's, on the data of the fit.
        unseen: the same on unseen data, by model; a model that could not be fitted is missing.
    """

    motor: str
    meaning: str
    linear_fit_percent: float
    even_share: float
    one_step: float
    identification: float
    unseen: Mapping[str, float]


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


@dataclass(frozen=True)
class TwoMassRow:
    """The motor with its shaft, fitted to one record.

    Attributes:
        record: what was fitted to.
        fixed: the fixed parameters, by name, as fractions of their true values.
        errors: (estimate − truth)/truth, by parameter.
        intervals: half the width of the 95 % interval divided by the truth, by parameter.
        covered: how many of the intervals contain the truth.
    """

    record: str
    fixed: Mapping[str, float]
    errors: Mapping[str, float]
    intervals: Mapping[str, float]
    covered: int


@dataclass(frozen=True)
class Survey:
    """The result of the survey.

    Attributes:
        motors: a row for every motor of the family.
        inputs: a row for every model, over many inputs of the experiment.
        largest: the largest ratio of the paper's own models in every reading of its experiment.
        two_masses: the motor with its shaft on records that are not the simulator's own; empty for a rigid motor.
    """

    motors: tuple[MotorRow, ...]
    inputs: tuple[InputRow, ...]
    largest: tuple[Largest, ...]
    two_masses: tuple[TwoMassRow, ...] = ()

    def to_data(self) -> dict[str, Any]:
        """Everything in built-in types."""
        return {name: [asdict(row) for row in getattr(self, name)] for name in _ROWS}


_ROWS: dict[str, Any] = {"motors": MotorRow, "inputs": InputRow, "largest": Largest, "two_masses": TwoMassRow}


def recorded() -> Survey:
    """The survey of the default settings, from the file of the package."""
    data = packaged("emsid.study", RECORDED)
    return Survey(**{name: tuple(kind(**row) for row in data[name]) for name, kind in _ROWS.items()})
