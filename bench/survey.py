"""A survey: other motors, other inputs and other records, and how large the ratio of the paper gets.

`survey` does it; ``python bench/study.py`` writes its result into the package. All motors of the family are the default
motor with one difference. On each the models of the study are fitted to one record of the bench and compared on
another, by the free-run MSE of the linear model divided by theirs.

**What decides.** Turn the sign of the input. The output of every linear model turns its sign too, so the part of the
output that does not, e = (y(u) + y(−u))/2, is error of every linear model. The paper's quadratic terms are the same for
u and −u, and the recursion behind them is linear, so e is all that they can describe. The share of e in the error of
the linear model therefore decides whether they help.

**How large can the ratio be?** The paper reports a linear MSE that is 22 and 557 times its nonlinear one (simulation),
and 24 and 2.8 times (experiment). It does not say whether its MSE is of a free run or of a prediction one sample ahead,
and gives neither the sample time nor the numbers of its inputs and its motor. So each of these is varied, over all
motors that combine

- a dead zone of none, ±0.5 V, 0 to 0.5 V or 0 to 1.5 V,
- a left slope of 1, 0.8 or 0.5 times the right one,
- a rotor without friction, with friction alike in both directions, with 12 and 4 mN·m, or with friction forward only.

**Two masses.** In the simulation study the motor with its shaft is fitted to noise-free data of the program's own
simulator, with resistance, viscous friction and load friction fixed at their true values. Here it is fitted to records
of another integrator, with the noise of the bench, and with fixed values that are 10 % wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from emsid.estimation.estimates import HALF_WIDTH
from emsid.estimation.fit import Fit, fit_or_problem
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.excitation import sines
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit
from emsid.models.regression.structures import arx, wiener_hammerstein_regression
from emsid.plant import Bench, DeadZoneLaw, Friction, Motor
from emsid.record import Record
from emsid.study.models import (
    FIXED,
    IDENTIFICATION,
    INPUTS,
    LINEAR,
    START,
    UNSEEN,
    Settings,
    blocks,
    measure,
    searches,
    structures,
    two_masses,
)
from emsid.study.survey import (
    EXAMPLE,
    FREE_RUN,
    ONE_STEP,
    Case,
    InputRow,
    Largest,
    MotorRow,
    Survey,
    TwoMassRow,
    compared,
    records,
)
from emsid.validation.comparison import Assessment, assess

# The parameters of a motor that may differ by direction, and a delay in place of its inductance. The resistance, the
# viscous friction, the right slope and the load are fixed.
BY_DIRECTION = (
    "motor_constant",
    "rotor_inertia",
    "rotor_friction.coulomb.forward",
    "rotor_friction.coulomb.backward",
    "rotor_friction.stribeck",
    "rotor_friction.stribeck_rate",
    "voltage_dead_zone.b_l",
    "voltage_dead_zone.b_r",
    "voltage_dead_zone.m_l",
    "drive.delay",
)


def _family() -> tuple[Case, ...]:
    usual = Motor()
    stribeck = {"stribeck": 2e-3, "stribeck_rate": 0.3}
    zone = partial(DeadZoneLaw, -0.5, 0.5)
    level = usual.rotor_friction.forward.coulomb  # type: ignore[attr-defined]
    changes: tuple[tuple[str, str, dict[str, Any], float], ...] = (
        ("alike", "dead zone and friction alike in both directions", {}, 1.0),
        ("small-input", "the same with an input near the dead zone (30 %)", {}, 0.3),
        ("dead-zone-one-side", "dead zone of 0.5 V forward only", {"voltage_dead_zone": DeadZoneLaw(0, 0.5)}, 1.0),
        ("wide-dead-zone-one-side", "dead zone of 1.5 V forward only", {"voltage_dead_zone": DeadZoneLaw(0, 1.5)}, 1.0),
        ("slopes-0.8", "slopes m_l = 0.8, m_r = 1", {"voltage_dead_zone": zone(m_l=0.8)}, 1.0),
        (EXAMPLE.name, EXAMPLE.meaning, {"voltage_dead_zone": EXAMPLE.motor.voltage_dead_zone}, 1.0),
        (
            "coulomb-by-direction",
            "Coulomb level 12 mN·m forward, 4 mN·m backward",
            {"rotor_friction": Friction((12e-3, 4e-3), **stribeck)},
            1.0,
        ),
        ("load-friction-10", "load friction 10 % of the rotor's", {"load_friction": Friction(0.1 * level)}, 1.0),
        ("load-friction-50", "load friction 50 % of the rotor's", {"load_friction": Friction(0.5 * level)}, 1.0),
        (
            "slopes-only",
            "slopes m_l = 0.8, m_r = 1; no dead zone, no friction",
            {"voltage_dead_zone": DeadZoneLaw(0, 0, m_l=0.8), "rotor_friction": Friction()},
            1.0,
        ),
    )
    return tuple(Case(name, meaning, replace(usual, **change), scale) for name, meaning, change, scale in changes)


FAMILY = _family()
"""The motors of the table."""


def by_direction(record: Record, control: Control = FREE) -> GreyBoxFit:
    """The physical motor as one mass with everything free that differs by direction.

    The search starts with values of the default motor that are 50 % too large.
    """
    plant = DrivenMotor(replace(Motor(), inductance=0.0).rigid())
    start = plant.with_values(
        {name: 1.5 * plant.value(name) for name in BY_DIRECTION if name not in ("drive.delay", "voltage_dead_zone.m_l")}
    )
    return simulation_error(
        start.with_values({"drive.delay": 0.5 * record.dt}), record, free=BY_DIRECTION, control=control
    )


def compare(case: Case, settings: Settings, control: Control = FREE, *, searched: bool = True) -> MotorRow:
    """A row of the table.

    Args:
        case: the motor.
        settings: of the records; its motor is not used.
        control: when to stop.
        searched: whether the models that need a nonlinear search are fitted too.
    """
    first, second = records(case, settings)
    fits: list[Fit[Any]] = [least_squares(structure, first) for structure in structures(first, settings.knots)]
    if searched:
        fits += [fit_or_problem(partial(search, first, control)) for search in (blocks, by_direction)]
    assessed = compared(fits, first, second)
    linear, paper = assessed[0], assessed[1]
    mse = linear[1].row.simulation_mse
    return MotorRow(
        case.name,
        case.meaning,
        linear[1].row.fit_percent,
        even_share(case, settings, linear[1]),
        linear[1].row.one_step_mse / paper[1].row.one_step_mse,
        linear[0].row.simulation_mse / paper[0].row.simulation_mse,
        {unseen.row.model: mse / unseen.row.simulation_mse for _, unseen in assessed if unseen.row.model != LINEAR},
    )


def even_share(case: Case, settings: Settings, linear: Assessment) -> float:
    """Share of the squared error of a linear model, on unseen data, that is the same for u and −u."""
    counted = linear.simulation.counted
    outputs = [records(case, settings, Bench(), sign)[1].output[counted] for sign in (1.0, -1.0)]
    even = (outputs[0] + outputs[1]) / 2
    odd_error = (outputs[0] - outputs[1]) / 2 - linear.simulation.output[counted]
    return float(np.mean(even**2) / (np.mean(even**2) + np.mean(odd_error**2)))


MANY = 30
"""How many pairs of inputs `over_inputs` draws."""


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


ZONES = {"none": (0.0, 0.0), "±0.5 V": (-0.5, 0.5), "0 to 0.5 V": (0.0, 0.5), "0 to 1.5 V": (0.0, 1.5)}


SLOPES = (1.0, 0.8, 0.5)


FRICTIONS = {
    "none": Friction(),
    "alike": Friction(8e-3, 2e-3, 0.3),
    "12 and 4 mN·m": Friction((12e-3, 4e-3), 2e-3, 0.3),
    "forward only": Friction((8e-3, 0.0)),
}


@dataclass(frozen=True)
class Reading:
    """One reading of the paper's experiment.

    Args:
        name: what differs from the simulation study.
        dt: sample time in s.
        amplitudes: factors on the two amplitudes of the inputs.
        faster: factor on their frequencies.
        loaded: whether the motor turns its load.
        bench: how it is measured; by default without noise.
    """

    name: str
    dt: float = 0.005
    amplitudes: tuple[float, float] = (1.0, 1.0)
    faster: float = 1.0
    loaded: bool = True
    bench: Bench = Bench()  # noqa: RUF009  (frozen)


READINGS = (
    Reading("as in the study, without noise"),
    Reading("with the noise of the bench", bench=Bench.typical()),
    Reading("without the load", loaded=False),
    Reading("amplitudes 0.3 times as large", amplitudes=(0.3, 0.3)),
    Reading("amplitudes 3 times as large", amplitudes=(3.0, 3.0)),
    Reading("sample time 1 ms", dt=0.001),
    Reading("sample time 20 ms", dt=0.02),
    Reading("sample time 100 ms", dt=0.1),
    Reading("frequencies 10 times as high", faster=10.0),
    Reading("nearly one sine", amplitudes=(1 / 6, 2.5)),
    Reading("nearly one sine, 10 times as high", amplitudes=(1 / 6, 2.5), faster=10.0),
)


def motors() -> Iterator[tuple[dict[str, Any], Motor]]:
    """Every nonlinear motor of the family with its description."""
    for (zone, edges), slope, (friction, law) in product(ZONES.items(), SLOPES, FRICTIONS.items()):
        if zone == "none" and slope == 1.0 and friction == "none":
            continue
        about = {"dead_zone": zone, "slope": slope, "friction": friction}
        yield about, replace(Motor(), voltage_dead_zone=DeadZoneLaw(*edges, m_l=slope), rotor_friction=law)


def ratios(motor: Motor, reading: Reading, duration: float = 20.0, seed: int = 1) -> dict[str, tuple[float, float]]:
    """Linear divided by nonlinear MSE of the paper's models (5.12) and (5.10).

    Returns:
        By error, the ratio on identification data and on unseen data.
    """
    rng = np.random.default_rng(seed)
    tested = motor if reading.loaded else replace(motor, load_inertia=1e-9, load_viscous=0.0).rigid()
    records = []
    for kind in (IDENTIFICATION, UNSEEN):
        amplitudes, frequencies = (np.array(each) for each in INPUTS[kind])
        samples = round(duration / reading.dt)
        voltage = sines(samples, reading.dt, amplitudes * reading.amplitudes, frequencies * reading.faster)
        records.append(reading.bench.run(tested, voltage, reading.dt, rng, name=kind))
    rows = [
        [assess(least_squares(structure, records[0]), record, 4).row for record in records]
        for structure in (arx(na=4, nb=4), wiener_hammerstein_regression(na=4, nb=3, degree=2))
    ]
    pairs = list(zip(*rows, strict=True))
    return {
        FREE_RUN: tuple(linear.simulation_mse / paper.simulation_mse for linear, paper in pairs),
        ONE_STEP: tuple(linear.one_step_mse / paper.one_step_mse for linear, paper in pairs),
    }


def largest(reading: Reading, duration: float = 20.0, control: Control = FREE) -> list[Largest]:
    """The largest ratios of a reading over all motors: of the free run and one step ahead."""
    found = []
    for about, motor in motors():
        control.check()
        found.append((about, ratios(motor, reading, duration)))
    rows = []
    for error in (FREE_RUN, ONE_STEP):
        seen, unseen = (np.array([both[error][k] for _, both in found]) for k in (0, 1))
        known = np.isfinite(seen) & np.isfinite(unseen)
        best = int(np.argmax(np.where(known, unseen, -np.inf)))
        rows.append(
            Largest(
                reading.name,
                error,
                int(known.sum()),
                float(seen[known].max()),
                float(unseen[best]),
                float(np.median(unseen[known])),
                found[best][0],
            )
        )
    return rows


def largest_ratios(duration: float = 20.0, control: Control = FREE) -> tuple[Largest, ...]:
    """The largest ratios of all readings."""
    rows: list[Largest] = []
    for k, reading in enumerate(READINGS):
        control.doing(f"largest ratio, {reading.name}", k, len(READINGS))
        rows += largest(reading, duration, control)
    return tuple(rows)


WRONG = 1.1
"""Factor on the fixed values."""


def row(name: str, fit: GreyBoxFit, truth: Motor, factor: float = 1.0) -> TwoMassRow:
    """How far a fit is from the truth, and how far its intervals reach."""
    plant = DrivenMotor(truth)
    known = {each: plant.value(each) for each in fit.names if plant.value(each) != 0.0}
    places = [fit.names.index(each) for each in known]
    true = np.array(list(known.values()))
    error, reach = fit.estimate[places] / true - 1, HALF_WIDTH * fit.standard_error[places] / true
    return TwoMassRow(
        name,
        dict.fromkeys(FIXED, factor),
        dict(zip(known, error.tolist(), strict=True)),
        dict(zip(known, reach.tolist(), strict=True)),
        int(np.count_nonzero(np.abs(error) <= reach)),
    )


def with_wrong_values(motor: Motor) -> Motor:
    """The motor with the fixed values 10 % too large."""
    load = motor.load_friction
    wrong = load.forward.coulomb * WRONG if isinstance(load, Friction) else 0.0
    return replace(
        motor,
        resistance=WRONG * motor.resistance,
        rotor_viscous=WRONG * motor.rotor_viscous,
        load_viscous=WRONG * motor.load_viscous,
        load_friction=Friction(wrong) if isinstance(load, Friction) else load,
    )


def two_mass_rows(settings: Settings, others: Mapping[str, Record], control: Control = FREE) -> tuple[TwoMassRow, ...]:
    """The motor with its shaft on records of the simulator, of the bench, and others.

    Args:
        settings: motor and bench.
        others: further records of the same motor, by a short description.
        control: when to stop.
    """
    rng = np.random.default_rng(settings.seed)
    quiet, noisy = (measure(settings, bench, IDENTIFICATION, rng) for bench in (Bench(), settings.bench))
    rows = []
    for name, record in {"own simulator, without noise": quiet, **others, "bench with noise": noisy}.items():
        control.doing(f"two masses: {name}")
        rows.append(row(name, two_masses(settings.motor, record, control), settings.motor))
    control.doing("two masses: fixed values 10 % wrong")
    fit = two_masses(with_wrong_values(settings.motor), quiet, control)
    return (*rows, row("own simulator, fixed values 10 % too large", fit, settings.motor, WRONG))


def survey(
    settings: Settings,
    *,
    inputs: int = MANY,
    others: Mapping[str, Record] | None = None,
    executor: Executor | None = None,
    control: Control = FREE,
) -> Survey:
    """Do the survey.

    Args:
        settings: bench, sample time, duration and seed of all records; the motor of the inputs and of the two masses.
        inputs: how many pairs of inputs.
        others: further records of the settings' motor for the two masses, by a short description.
        executor: where motors and inputs are fitted, such as a `concurrent.futures.ProcessPoolExecutor`.
        control: when to stop, and where to report progress.

    Raises:
        Stopped: if it is stopped before its end.
    """
    in_turn: Iterable[MotorRow] = map(partial(compare, settings=settings, control=control), FAMILY)
    if executor is not None:
        in_turn = executor.map(partial(compare, settings=settings), FAMILY)
    rows = []
    for k, row in enumerate(in_turn):
        rows.append(row)
        control.doing(f"survey of motors: {row.meaning}", k + 1, len(FAMILY))
    masses = () if settings.motor.is_rigid else two_mass_rows(settings, others or {}, control)
    return Survey(
        tuple(rows),
        over_inputs(settings, inputs, control, executor),
        largest_ratios(settings.duration, control),
        masses,
    )
