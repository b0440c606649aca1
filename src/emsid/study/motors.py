"""The models of the study on another motor, and the motor that its figures show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from emsid.estimation.fit import Fit
from emsid.estimation.linear.least_squares import least_squares
from emsid.excitation import sines
from emsid.plant import Bench, DeadZoneLaw, Motor
from emsid.record import Record
from emsid.study.models import BLOCKS, FRICTION, FULL, ONE_MASS, PAPER, START, structures
from emsid.study.setup import IDENTIFICATION, INPUTS, UNSEEN, Settings
from emsid.validation.comparison import Assessment, assess

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
