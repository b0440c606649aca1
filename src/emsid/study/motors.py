"""A family of motors: when the paper's method helps, when not, and what helps always.

All are the default motor with one difference. On each the models of the study are fitted to one record of the bench and
compared on another, by the free-run MSE of the linear model divided by theirs.

**What decides.** Turn the sign of the input. The output of every linear model turns its sign too, so the part of the
output that does not, e = (y(u) + y(−u))/2, is error of every linear model. The paper's quadratic terms are the same for
u and −u, and the recursion behind them is linear, so e is all that they can describe. The share of e in the error of
the linear model therefore decides whether they help.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from emsid.estimation.fit import Fit, fit_or_problem
from emsid.estimation.linear.least_squares import least_squares
from emsid.estimation.nonlinear.control import FREE, Control
from emsid.excitation import sines
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit
from emsid.plant import Bench, DeadZoneLaw, Friction, Motor
from emsid.record import Record
from emsid.study.models import BLOCKS, FRICTION, FULL, LINEAR, ONE_MASS, PAPER, START, blocks, structures
from emsid.study.setup import IDENTIFICATION, INPUTS, UNSEEN, Settings
from emsid.validation.comparison import Assessment, assess

MODELS = (PAPER, FULL, FRICTION, BLOCKS, ONE_MASS)
"""The models whose ratio to the linear one is shown."""

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
        ("slopes-0.5", "slopes m_l = 0.5, m_r = 1", {"voltage_dead_zone": zone(m_l=0.5)}, 1.0),
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

SHOWN = "slopes-0.5"
"""The motor of the figures."""


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


def regressions(case: Case, settings: Settings) -> list[tuple[Assessment, Assessment]]:
    """The regressions of the study on a motor of the family, each on identification data and on unseen data."""
    first, second = records(case, settings)
    fits = [least_squares(structure, first) for structure in structures(first, settings.knots)]
    return _assessed(fits, first, second)


def _assessed(fits: Sequence[Fit[Any]], first: Record, second: Record) -> list[tuple[Assessment, Assessment]]:
    """Every model on identification data and on unseen data, all on the same samples."""
    return [(assess(fit, first, START, data=IDENTIFICATION), assess(fit, second, START)) for fit in fits]


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
    assessed = _assessed(fits, first, second)
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
