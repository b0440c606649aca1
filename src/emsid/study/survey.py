"""The survey: other motors, other inputs and other records, and how large the ratio of the paper gets.

It takes about two minutes, so its result for the default settings is kept in ``recorded.json``, which
``python bench/study.py`` writes.

Inputs: what they excite, and what a richer one changes.

The models of the study on another motor, and the motor that its figures show.

Recursive against batch least squares: what the initial covariance P(0) does.

Recursive least squares without forgetting minimises Σε² + θᵀP(0)⁻¹θ: P(0) acts as a ridge of 1/P(0). Where the
regression is badly conditioned, the data say so little about some combinations of parameters that even the ridge of
P(0) = 1e8 decides them.

Friction on the load side: what it costs to use a linear–static–linear structure.

The paper neglects this friction because the outputs with and without it differ by a mean square of 3.3e-6 (section
V.A). That number says how small the friction is, not whether the structure suits the motor. So the structure is fitted
at several levels of friction, from none to a tenth of the rotor's, and its free-run error on unseen data is compared
with that without load friction. The structure stops being fair where the error is larger by more than noise, by the
same rule by which cascades are chosen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import inf
from typing import Any

import numpy as np

from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.excitation import SIGNALS, crest_factor, persistent_excitation_order, sines
from emsid.io.files import packaged
from emsid.models.blocks.cascade import Cascade
from emsid.models.blocks.fitting import fit_cascade
from emsid.models.free_run import mean_squared_error
from emsid.models.regression.narx import Structure
from emsid.plant import Bench, DeadZoneLaw, Friction, Motor
from emsid.record import Record
from emsid.selection.improvement import StretchErrors, better
from emsid.study.models import (
    BLOCKS,
    FRICTION,
    FULL,
    IDENTIFICATION,
    INPUTS,
    ONE_MASS,
    PAPER,
    START,
    UNSEEN,
    Settings,
    measure,
    of_the_paper,
    structures,
)
from emsid.validation.comparison import Assessment, assess

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


MODELS = (PAPER, FULL, FRICTION, BLOCKS, ONE_MASS)
"""The models whose ratio to the linear one is shown."""


@dataclass(frozen=True)
class Case:
    """A motor of the family.

    Args:
        name: in small letters with hyphens.
        meaning: its difference to the default motor.
        motor: the motor.
        scale: factor on the amplitudes of the inputs.
    """

    name: str
    meaning: str
    motor: Motor
    scale: float = 1.0


EXAMPLE = Case(
    "slopes-0.5", "slopes m_l = 0.5, m_r = 1", replace(Motor(), voltage_dead_zone=DeadZoneLaw(-0.5, 0.5, m_l=0.5))
)
"""The motor of the figures."""


def records(case: Case, settings: Settings, bench: Bench | None = None, sign: float = 1.0) -> tuple[Record, Record]:
    """Identification data and unseen data of a motor of the family; ``sign`` −1 turns the sign of the inputs."""
    rng = np.random.default_rng(settings.seed)
    samples, driven = round(settings.duration / settings.dt), bench or settings.bench
    first, second = (
        driven.run(
            case.motor, sign * case.scale * sines(samples, settings.dt, *INPUTS[kind]), settings.dt, rng, name=kind
        )
        for kind in (IDENTIFICATION, UNSEEN)
    )
    return first, second


def regressions(case: Case, settings: Settings) -> list[tuple[Assessment, Assessment]]:
    """The regressions of the study on a motor of the family, each on identification data and on unseen data."""
    first, second = records(case, settings)
    fits = [least_squares(structure, first) for structure in structures(first, settings.knots)]
    return compared(fits, first, second)


def compared(fits: Sequence[Fit[Any]], first: Record, second: Record) -> list[tuple[Assessment, Assessment]]:
    """Every model on identification data and on unseen data, all on the same samples."""
    return [(assess(fit, first, START, data=IDENTIFICATION), assess(fit, second, START)) for fit in fits]


COVARIANCES = (1e2, 1e4, 1e6, 1e8, 1e10, 1e12, 1e14)
"""P(0) as a multiple of the identity."""

USUAL = 1e8
"""P(0) of the study."""


@dataclass(frozen=True)
class PriorRow:
    """A structure, estimated recursively from several P(0).

    Attributes:
        model: its name.
        condition: condition number of its regression.
        covariances: P(0).
        recursive: free-run MSE by recursion divided by that by batch least squares, minus 1, at every P(0).
        ridge: the same for batch least squares with a ridge of 1/P(0).
    """

    model: str
    condition: float
    covariances: tuple[float, ...]
    recursive: tuple[float, ...]
    ridge: tuple[float, ...]

    @property
    def usual(self) -> float:
        """The difference at the P(0) of the study."""
        return self.recursive[self.covariances.index(USUAL)]

    @property
    def ridge_usual(self) -> float:
        """The difference of batch least squares with a ridge of 1/P(0), at the P(0) of the study."""
        return self.ridge[self.covariances.index(USUAL)]

    @property
    def vanishes_at(self) -> float | None:
        """The smallest P(0) from which on recursion and batch differ by less than 1 %; None if there is none."""
        small = [abs(difference) < 0.01 for difference in self.recursive]
        last = max((k for k, each in enumerate(small) if not each), default=-1) + 1
        return self.covariances[last] if last < len(small) else None


def priors(structures: Sequence[Structure], record: Record, unseen: Record, start: int) -> tuple[PriorRow, ...]:
    """Every structure, from every P(0).

    Args:
        structures: what is estimated.
        record: identified from.
        unseen: where the free runs are compared.
        start: samples that start the free runs.
    """
    rows = []
    for structure in structures:
        batch = least_squares(structure, record)
        exact = _free_run_mse(batch, unseen, start)
        if not 0 < exact < inf:
            continue
        recursive: list[float] = []
        ridge: list[float] = []
        for covariance in COVARIANCES:
            fits = (
                recursive_least_squares(structure, record, initial_covariance=covariance),
                least_squares(structure, record, ridge=1 / covariance),
            )
            for fit, differences in zip(fits, (recursive, ridge), strict=True):
                differences.append(_free_run_mse(fit, unseen, start) / exact - 1)
        rows.append(PriorRow(structure.name, float(batch.condition), COVARIANCES, tuple(recursive), tuple(ridge)))
    return tuple(rows)


def _free_run_mse(fit: Fit[Any], record: Record, start: int) -> float:
    run = fit.model.simulate(record, start)
    return mean_squared_error(record.output[run.counted], run.output[run.counted])


SHARES = (0.0, 0.002, 0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1)
"""Coulomb friction of the load as a fraction of the rotor's."""

FITTED = (0.0, 0.05, 0.1)
"""Where the blocks are fitted."""

# The search starts from the fitted blocks of the study.
_ITERATIONS = 5


@dataclass(frozen=True)
class LoadFriction:
    """Effect of friction on the load, from none to a tenth of the rotor's.

    Attributes:
        shares: friction of the load over that of the rotor.
        differences: mean square difference to the output without it, on unseen data.
        fitted: where the blocks were fitted, as shares.
        errors: free-run MSE of the blocks there, on unseen data.
        unfair_from: the first share where their error is larger than without load friction by more than noise; None if
            there is none.
        visible_from: the share at which the difference of the outputs is as large as the error of the blocks; None if
            it stays smaller.
    """

    shares: tuple[float, ...]
    differences: tuple[float, ...]
    fitted: tuple[float, ...]
    errors: tuple[float, ...]
    unfair_from: float | None
    visible_from: float | None


def rotor_level(motor: Motor) -> float:
    """The mean Coulomb level of the rotor in N·m; 0 for another law of friction."""
    law = motor.rotor_friction
    return (law.forward.coulomb + law.backward.coulomb) / 2 if isinstance(law, Friction) else 0.0


def load_friction(settings: Settings, blocks: Cascade, control: Control = FREE) -> LoadFriction | None:
    """The curve of a motor; None without Coulomb friction of the rotor, or where a free run diverges.

    Args:
        settings: motor and records; they have no noise here.
        blocks: the cascade of the study, which every fit starts from.
        control: when to stop.
    """
    level = rotor_level(settings.motor)
    if not level > 0 or control.ending:
        return None
    differences: list[float] = []
    errors: list[StretchErrors] = []
    without: Record | None = None
    for k, share in enumerate(SHARES):
        control.doing("friction on the load", k, len(SHARES))
        unseen = _record(settings, share * level, UNSEEN)
        without = without or unseen
        differences.append(float(np.mean((unseen.output - without.output) ** 2)))
        if share in FITTED:
            fit = fit_cascade(blocks, _record(settings, share * level, IDENTIFICATION), max_iterations=_ITERATIONS)
            squares = np.sum((unseen.output - fit.model.simulate(unseen).output) ** 2, axis=1)
            errors.append(StretchErrors.of(squares[fit.model.memory :]))
    if not all(np.isfinite(error.mean) for error in errors):
        return None
    unfair = (share for share, error in zip(FITTED, errors, strict=True) if better(errors[0], error))
    means = [error.mean for error in errors]
    return LoadFriction(
        SHARES, tuple(differences), FITTED, tuple(means), next(unfair, None), _crossing(differences, means)
    )


def _record(settings: Settings, level: float, kind: str) -> Record:
    motor = replace(settings.motor, load_friction=Friction(level))
    return measure(replace(settings, motor=motor), Bench(), kind, np.random.default_rng(settings.seed))


def _crossing(differences: list[float], errors: list[float]) -> float | None:
    """The share at which the difference reaches the error of the blocks; both grow with the square of the share."""
    reached = np.interp(SHARES, FITTED, errors)
    above = np.flatnonzero(np.array(differences) >= reached)
    if not len(above):
        return None
    k = int(above[0])
    return float(SHARES[k] * np.sqrt(reached[k] / differences[k]))
