"""The study of Kara and Abokoos, end to end: what `emsid study` does.

Two studies, each with two different inputs, one to identify and one to verify: *simulation* on the noise-free motor
(Table 1 of the paper) and *experiment* on a bench with noise, quantisation and effects that no model contains
(Table 2), or on two records of the user's own. In both, the paper's linear and nonlinear structures, its full
regression of a higher degree and a regression with friction terms are identified by least squares and by recursive
least squares; the three blocks of a Wiener–Hammerstein model, and the physical motor as one mass, by the error of their
free run. Without noise the motor is found whole, its shaft and its inductance included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from emsid.errors import DataError, EmsidError
from emsid.estimation.fit import Ending, Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.linear.recursive import recursive_least_squares
from emsid.excitation import sines
from emsid.identification.candidates import Progress, fit_or_problem, stribeck_speeds
from emsid.models.blocks.search.estimation import wiener_hammerstein
from emsid.models.blocks.search.map_families import DEAD_ZONE
from emsid.models.blocks.search.topologies import CascadeSearch
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.regression.narx import Structure
from emsid.models.regression.structures import arx, friction_narx, input_knots, wiener_hammerstein_regression
from emsid.plant import Bench, Friction, Motor
from emsid.record import Record, check_same_channels
from emsid.validation.comparison import Assessment, Row, assess

if TYPE_CHECKING:
    from emsid.report.document import Report, Section

SIMULATION, EXPERIMENT = "simulation", "experiment"
LINEAR, PAPER, FULL, FRICTION, BLOCKS, ONE_MASS, TWO_MASSES = (
    "arx",
    "wiener-hammerstein-regression",
    "wiener-hammerstein-regression-degree-3",
    "friction-narx",
    "wiener-hammerstein",
    "rigid-motor",
    "motor",
)

# The paper's MSE (5.14) of its Tables 1 and 2, of another motor and in units that it does not state:
# (linear, nonlinear).
PAPER_MSE = {
    (SIMULATION, "identification"): (0.0005634, 2.559e-05),
    (SIMULATION, "verification"): (0.002264, 4.063e-06),
    (EXPERIMENT, "identification"): (0.1105, 0.004573),
    (EXPERIMENT, "verification"): (0.1933, 0.06834),
}
# Section V.A: the mean square difference that friction on the load side makes to the output.
PAPER_LOAD_FRICTION_MSE = 3.341e-6

# Three blocks that can be seen: a filter, the dead zone (4.9), a filter. A held input needs no oversampling.
CASCADE = CascadeSearch(static=DEAD_ZONE, oversampling=1, max_iterations=30, threads=1)
STRIBECK = ("rotor_friction.stribeck", "rotor_friction.stribeck_rate")
KNOWN = ("resistance", "rotor_viscous")  # measured with an ohmmeter and neglected: voltage and speed leave both open

# Sums of two sines (section V.B) for slow operation in both directions: amplitudes in V, frequencies in Hz.
INPUTS = {"identification": ((3.0, 2.0), (0.4, 1.3)), "verification": ((2.5, 2.0), (0.25, 0.9))}


@dataclass(frozen=True)
class Settings:
    """What may be changed about the study.

    Args:
        motor: the plant.
        bench: what stands between the plant and the record in the second study.
        dt: sample time in seconds.
        duration: length of every record in seconds.
        seed: of the noise of the bench.
        forgetting: factor of the recursive estimates.
        knots: hinges on either side of zero in the friction regression.
        transient: samples that start a free run and are left out of every error; by default what the largest model
            needs.
    """

    motor: Motor = Motor()  # noqa: RUF009  (frozen)
    bench: Bench = Bench.typical()  # noqa: RUF009  (frozen)
    dt: float = 0.005
    duration: float = 20.0
    seed: int = 1
    forgetting: float = 1.0
    knots: int = 12
    transient: int | None = None

    def __post_init__(self) -> None:
        for what, value, least in (("sample time", self.dt, 1e-6), ("duration", self.duration, 200 * self.dt)):
            if not isfinite(value):
                raise DataError(f"{what} of {value:g} s; give a finite number")
            if not value >= least:
                raise DataError(f"{what} of {value:g} s is too short for the study; give at least {least:g} s")


@dataclass(frozen=True, eq=False)
class Part:
    """One of the two studies.

    Attributes:
        name: ``simulation`` or ``experiment``.
        identification, verification: the two records.
        fits: every model by every method.
        assessed: every fit on the identification and on the verification record, in the order of the fits.
        failed: for every model that could not be fitted, why.
        interrupted: whether the user stopped it before all models were done.
    """

    name: str
    identification: Record
    verification: Record
    fits: tuple[Fit[Any], ...]
    assessed: tuple[tuple[Assessment, Assessment], ...]
    failed: Mapping[str, str] = field(default_factory=dict)
    interrupted: bool = False

    @property
    def rows(self) -> list[Row]:
        """A row for every model, method and record."""
        return [each.row for pair in self.assessed for each in pair]

    def verified(self, model: str, method: str = "") -> Assessment:
        """A model on the record that it has not seen, by the first method it was fitted with or by another."""
        return next(v for _, v in self.assessed if v.row.model == model and method in ("", v.row.method))

    @property
    def models(self) -> tuple[str, ...]:
        """The names of the models, in order."""
        return tuple(dict.fromkeys(fit.model.name for fit in self.fits))


@dataclass(frozen=True, eq=False)
class Study:
    """Everything that the study found.

    Attributes:
        settings: how it was set up.
        load_friction_mse: mean square difference of the outputs with and without friction on the load side.
        output_variance: of the output with it, to compare that to.
        parts: the studies.
        own_records: whether the second study is on records of the user's.
        interrupted: whether the user stopped it before both were done.
    """

    settings: Settings
    load_friction_mse: float
    output_variance: float
    parts: tuple[Part, ...]
    own_records: bool = False
    interrupted: bool = False

    @property
    def rows(self) -> list[Row]:
        """All rows of all parts."""
        return [row for part in self.parts for row in part.rows]

    def to_data(self) -> dict[str, Any]:
        """What ``study.json`` holds."""
        return {
            "schema": 1,
            "rows": [row.to_data() for row in self.rows],
            "load_friction_mse": self.load_friction_mse,
            "findings": findings(self),
        }


def structures(record: Record, knots: int) -> tuple[Structure, ...]:
    """The structures of the study: (5.12), (5.10), (3.5) in full with degree 3, and the friction regression."""
    full = wiener_hammerstein_regression(na=4, nb=3, degree=3, taps=2)
    return (
        arx(na=4, nb=4),
        wiener_hammerstein_regression(na=4, nb=3, degree=2),
        replace(full, name=FULL),
        friction_narx(na=2, nb=2, knots=input_knots(record, knots), speeds=stribeck_speeds(record)),
    )


def one_mass(motor: Motor, record: Record) -> GreyBoxFit:
    """The motor as one mass without inductance; what that would be to it is a delay."""
    plant = DrivenMotor(replace(motor, inductance=0.0).rigid())
    names = _to_find(plant)
    start = half_off(plant, names).put({"drive.delay": 0.5 * record.dt})
    return simulation_error(start, record, free=(*names, "drive.delay"))


def two_masses(motor: Motor, record: Record) -> GreyBoxFit:
    """The motor as it is, with its shaft, from the first half of a record: without noise that tells everything."""
    plant = DrivenMotor(motor)
    names = _to_find(plant)
    return simulation_error(half_off(plant, names), record[: len(record) // 2], free=names)


def half_off(plant: DrivenMotor, names: Sequence[str]) -> DrivenMotor:
    """The plant with these parameters 50 % off: where a search begins."""
    return plant.put({name: 1.5 * plant.value(name) for name in names})


def _to_find(plant: DrivenMotor) -> tuple[str, ...]:
    return tuple(name for name in (*plant.usual, *STRIBECK) if name not in KNOWN)


def measure(settings: Settings, bench: Bench, kind: str, rng: np.random.Generator) -> Record:
    """A record of the settings' motor on a bench, driven by one of `INPUTS`."""
    samples = round(settings.duration / settings.dt)
    voltage = sines(samples, settings.dt, *INPUTS[kind])
    return bench.run(settings.motor, voltage, settings.dt, rng, name=kind)


def load_friction_difference(settings: Settings) -> tuple[float, float]:
    """The paper's preliminary check: what friction on the load side does to the output.

    Returns:
        Mean square difference of the outputs with and without it, and the variance of the output with it.
    """
    rng = np.random.default_rng(settings.seed)
    without = replace(settings, motor=replace(settings.motor, load_friction=Friction()))
    outputs = [measure(each, Bench(), "identification", rng).output for each in (settings, without)]
    return float(np.mean((outputs[0] - outputs[1]) ** 2)), float(np.var(outputs[0]))


def study(
    settings: Settings | None = None,
    records: tuple[Record, Record] | None = None,
    progress: Progress = lambda what, fraction: None,
    finished: Callable[[Part], None] = lambda part: None,
) -> Study:
    """Do the whole study.

    Args:
        settings: what to change about it.
        records: an identification and a verification record of a real drive, in place of the virtual bench.
        progress: called with what is being done and the fraction done of all.
        finished: called with either part as soon as it is done.

    Raises:
        DataError: for records whose channels differ, or whose input is the same.
    """
    settings = settings or Settings()
    rng = np.random.default_rng(settings.seed)
    progress("the plant with and without friction on the load side", 0.0)
    difference, variance = load_friction_difference(settings)
    progress("simulating the motor", 0.1)
    simulated = tuple(measure(settings, Bench(), kind, rng) for kind in INPUTS)
    measured = records or tuple(measure(settings, settings.bench, kind, rng) for kind in INPUTS)
    check_same_channels(*measured)
    if np.array_equal(measured[0].input, measured[1].input):
        raise DataError(
            f"{measured[0].name} and {measured[1].name} have the same input; the study verifies on another one"
        )
    parts: list[Part] = []
    try:
        for name, (first, second) in ((SIMULATION, simulated), (EXPERIMENT, measured)):
            parts.append(_part(name, first, second, settings, _later(progress, 0.2 + 0.4 * len(parts), 0.4)))
            if parts[-1].interrupted:
                break
            finished(parts[-1])
    except KeyboardInterrupt:
        if not parts:
            raise
    stopped = len(parts) < 2 or parts[-1].interrupted
    return Study(settings, difference, variance, tuple(parts), records is not None, stopped)


def _later(progress: Progress, begin: float, share: float) -> Progress:
    """The progress of a part of the work that begins at one fraction of the whole and is a share of it."""
    return lambda what, fraction: progress(what, begin + share * fraction)


def _part(name: str, first: Record, second: Record, settings: Settings, progress: Progress) -> Part:
    candidates = structures(first, settings.knots)
    start = max(settings.transient or 0, *(structure.memory for structure in candidates))
    fits: list[Fit[Any]] = []
    failed: dict[str, str] = {}
    for k, structure in enumerate(candidates):
        progress(f"{name}: {structure.name}", 0.4 * k / len(candidates))
        fits.append(least_squares(structure, first))
        fits.append(recursive_least_squares(structure, first, forgetting=settings.forgetting, history=True))
    searches: dict[str, Callable[[], Fit[Any]]] = {
        BLOCKS: lambda: wiener_hammerstein(first, (1, 2), CASCADE),
        ONE_MASS: lambda: one_mass(settings.motor, first),
    }
    if name == SIMULATION and not settings.motor.is_rigid:
        searches[TWO_MASSES] = lambda: two_masses(settings.motor, first)
    interrupted = False
    for k, (model, search) in enumerate(searches.items()):
        try:
            progress(f"{name}: {model}", 0.4 + 0.6 * k / len(searches))
            fits.append(fit_or_problem(search))
            interrupted = fits[-1].ending is Ending.INTERRUPTED
        except KeyboardInterrupt:  # the regressions alone make a study
            interrupted = True
        except EmsidError as problem:  # a user's records may be of anything
            failed[model] = str(problem)
        if interrupted:
            break
    assessed = tuple(
        (
            assess(fit, first, start, experiment=name, data="identification"),
            assess(fit, second, start, experiment=name, data="verification"),
        )
        for fit in fits
    )
    return Part(name, first, second, tuple(fits), assessed, failed, interrupted)


def findings(result: Study) -> list[str]:
    """What the numbers show, in sentences that follow from them."""
    sentences = [_about_load_friction(result)]
    for part in result.parts:
        linear, paper = (part.verified(model).row for model in (LINEAR, PAPER))
        known_motor = part.name == SIMULATION or not result.own_records
        reason = _why(linear, paper, result.settings.motor) if known_motor else ""
        sentences += [
            f"In the {part.name} study, in free run on the verification record, the MSE of the paper's second-degree "
            f"model is {_ratio(linear, paper)} that of the linear model{reason}.",
            *(
                f"That of {what} is {_ratio(linear, row)} it, at {row.fit_in_words}."
                for what, row in (
                    (words, part.verified(model).row)
                    for model, words in (
                        (FRICTION, "the friction regression"),
                        (BLOCKS, "the three blocks with a dead zone between them"),
                        (ONE_MASS, "the physical motor as one mass"),
                        (TWO_MASSES, "the physical motor with its shaft"),
                    )
                    if model in part.models
                )
            ),
        ]
        finite = [row for row in part.rows if row.data == "verification" and np.isfinite(row.simulation_mse)]
        if finite:
            flattered = max(finite, key=lambda row: row.simulation_mse / row.one_step_mse)
            sentences.append(
                f"One step ahead every model looks good; the MSE of {flattered.model} ({flattered.method}) is "
                f"{flattered.simulation_mse / flattered.one_step_mse:,.0f} times larger in free run."
            )
        recursive = [fit.model.name for fit in part.fits if fit.method == "rls"]
        pairs = [(part.verified(model, "ls").row, part.verified(model, "rls").row) for model in recursive]
        apart = [
            (abs(later.simulation_mse / batch.simulation_mse - 1), later.model)
            for batch, later in pairs
            if np.isfinite(batch.simulation_mse) and np.isfinite(later.simulation_mse)
        ]
        if apart:
            difference, model = max(apart)
            sentences.append(
                f"Recursive and batch estimates (forgetting factor {result.settings.forgetting:g}) differ most in "
                f"{model}, by {format(100 * difference, '.2g' if difference < 1 else ',.0f')} % of the free-run MSE."
            )
        sentences += [
            f"{fit.model.name} ({fit.method}): {fit.message}."
            for fit in part.fits
            if fit.ending is Ending.RANK_DEFICIENT
        ]
        sentences += [f"{model} could not be fitted: {why}." for model, why in part.failed.items()]
    return sentences


def _about_load_friction(result: Study) -> str:
    share = result.load_friction_mse / result.output_variance
    fair = share < 1e-3
    return (
        f"Friction on the load side changes the output by a mean square of {result.load_friction_mse:.3g} (rad/s)² "
        f"(the paper's motor: {PAPER_LOAD_FRICTION_MSE:.3g}), {100 * share:.2g} % of its variance, so a "
        f"linear–static–linear structure is {'fair' if fair else 'not fair'} for this motor as far as the load goes."
    )


def _ratio(linear: Row, other: Row) -> str:
    """How many times the one error is the other, as text that goes before "that of"."""
    if not np.isfinite(other.simulation_mse):
        return "infinitely many times"
    ratio = linear.simulation_mse / other.simulation_mse if other.simulation_mse else np.inf
    if ratio > 1e9:
        return "less than a billionth of"
    if ratio > 1.05:
        return f"1/{ratio:,.0f} of" if ratio >= 10 else f"1/{ratio:.1f} of"
    return f"{1 / ratio:.2f} times" if ratio > 0.01 else f"{1 / ratio:,.0f} times"


def _why(linear: Row, paper: Row, motor: Motor) -> str:
    """Why an even polynomial does not help on a motor that is alike in both directions."""
    zone, friction = motor.voltage_dead_zone or motor.torque_dead_zone, motor.rotor_friction
    alike = friction.symmetric and (zone is None or zone.b_l == -zone.b_r)
    if alike and paper.simulation_mse * 1.5 > linear.simulation_mse:
        return (
            ": its quadratic term is even, and dead zone and friction of this motor, alike in both directions, are odd"
        )
    return ""


def report(result: Study) -> Report:
    """The figures and tables of the paper, in its order, and what they show."""
    from emsid.report import views
    from emsid.report.document import Fact, Report
    from emsid.report.numbers import percent

    simulation = result.parts[0]
    linear, friction = (simulation.verified(model).row for model in (LINEAR, FRICTION))
    return Report(
        title="Identification of an electromechanical system",
        summary=tuple(findings(result)),
        facts=(
            Fact(percent(linear.fit_percent), "free-run fit of the linear model, simulation study"),
            Fact(percent(friction.fit_percent), "of the friction regression"),
            Fact(f"1/{linear.simulation_mse / friction.simulation_mse:,.0f}", "its free-run MSE by the linear one's"),
        ),
        sections=(
            motor_section(result.settings),
            *(part_section(part) for part in result.parts),
            *(
                views.model_section(simulation.verified(model).fit, simulation.identification)
                for model in (BLOCKS, TWO_MASSES if TWO_MASSES in simulation.models else ONE_MASS)
                if model in simulation.models
            ),
        ),
        imprint=f"emsid study, seed {result.settings.seed}, after Kara and Abokoos",
    )


def motor_section(settings: Settings) -> Section:
    """What is simulated."""
    from emsid.report import views
    from emsid.report.document import Section

    return Section(
        "The motor",
        paragraphs=(
            "A two-mass permanent-magnet DC motor with Coulomb and Stribeck friction (4.7) on both sides and a dead "
            "zone (4.9).",
        ),
        tables=(views.motor_table(settings.motor),),
        figures=(views.nonlinearities(settings.motor),),
    )


def part_section(part: Part) -> Section:
    """The results of one of the two studies and their figures."""
    from emsid.report import views
    from emsid.report.document import Section

    name = part.name
    shown = [part.verified(model) for model in part.models]
    error = part.verification.output - shown[0].simulation.output
    intervals = views.critical_intervals(part.verification, 0.1 * len(part.verification) * part.verification.dt, error)
    published = {
        (model, data): PAPER_MSE[name, data][k]
        for k, model in enumerate((LINEAR, PAPER))
        for data in ("identification", "verification")
    }
    reference = views.Reference(
        "Paper", "another motor, in units that the paper does not state; only the ratios can be compared", published
    )
    return Section(
        f"The {name}",
        tables=(views.results_table(part.rows, reference, unit=part.verification.output_units[0]),),
        figures=(
            views.inputs((part.identification, part.verification), name=f"{name}-inputs"),
            views.responses(shown, intervals, name=f"{name}-responses"),
            views.measured_and_simulated(min(shown, key=lambda each: each.row.simulation_mse), name=f"{name}-free-run"),
            views.convergence(part.verified(PAPER, "rls").fit, part.verified(PAPER).fit, name=f"{name}-convergence"),
            views.residuals(shown, name=f"{name}-residuals"),
        ),
    )
