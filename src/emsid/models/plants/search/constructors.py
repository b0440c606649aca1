"""Functions that build the plants of emsid."""

from __future__ import annotations

from typing import Any

from emsid.models.plants.brushless import Brushless
from emsid.models.plants.linear_axis import LinearAxis
from emsid.models.plants.motor import DrivenMotor
from emsid.models.plants.search.choice import STARTS


def rigid_motor() -> DrivenMotor:
    """A motor with its load as one mass, without inductance: J·dω/dt = (K_m/R_a)·D(v) − D·ω − T_f(ω) − T_d.

    Its values are a start for `emsid.fit`; `DrivenMotor.with_values` gives it others. To begin with a motor of your
    own, give ``emsid.Motor(…).rigid()``.
    """
    plant = STARTS["rigid-motor"]
    assert isinstance(plant, DrivenMotor)
    return plant


def motor() -> DrivenMotor:
    """A motor that turns its load through an elastic shaft, the paper's (4.1) to (4.11).

    Its values are a start for `emsid.fit`; `DrivenMotor.with_values` gives it others.
    """
    plant = STARTS["motor"]
    assert isinstance(plant, DrivenMotor)
    return plant


def joint() -> DrivenMotor:
    """A joint of a robot behind a gear: J·dω/dt = T − B·ω − T_f(ω) − (T_a + m·g·l)·sin(θ − θ₀) − T_d.

    The torque T is that of a motor on a voltage, K_m/R_a·(v − K_m·ω), or of a current or a torque. Its values are a
    start for `emsid.fit`; `DrivenMotor.with_values` gives it others.
    """
    plant = STARTS["joint"]
    assert isinstance(plant, DrivenMotor)
    return plant


def linear_axis() -> LinearAxis:
    """A mass on a guide, driven by a force: M·dv/dt = D(f) − F_v·v − T_f(v) − offset.

    Its values are a start for `emsid.fit`; `LinearAxis.with_values` gives it others.
    """
    plant = STARTS["linear-axis"]
    assert isinstance(plant, LinearAxis)
    return plant


def brushless(**options: Any) -> Brushless:
    """A brushless motor with its inverter, from voltages on d- and q-axis to currents, speed and angle.

    Its values are a start for `emsid.fit`; a regression on the records replaces those that are estimated.

    Args:
        options: of `Brushless`: values of parameters, and what its inverter does.

    Raises:
        ModelError: for a value outside its bounds.
    """
    return Brushless(**options)
