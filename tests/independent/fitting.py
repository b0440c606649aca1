"""Fits of the motor of `settings`, begun some way off."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.estimation import simulation_error
from emsid.models.plants.search.result import GreyBoxFit
from emsid.plant import DeadZoneLaw, Friction, Motor
from independent.settings import RESISTANCE, TRUTH, Setting

START = DrivenMotor(
    Motor(
        resistance=RESISTANCE,
        inductance=0.0,
        motor_constant=0.06,
        rotor_inertia=3e-4,
        rotor_viscous=0.0,
        load_inertia=1e-15,
        load_viscous=0.0,
        rotor_friction=Friction(5e-3),
        load_friction=Friction(),
        voltage_dead_zone=DeadZoneLaw(-0.3, 0.3),
    ).rigid()
)
"""The motor with a tenth to a quarter off in every parameter."""


def fitted(setting: Setting, seed: int, *, fixed: Mapping[str, float] | None = None, **options: Any) -> GreyBoxFit:
    """All parameters of the motor from one record, the resistance given."""
    given = {"resistance": setting.resistance, **(fixed or {})}
    return simulation_error(START, setting.record(seed), free=tuple(TRUTH), fixed=given, **options)
