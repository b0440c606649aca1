"""The static characteristics of one mass: its friction over speed, and the dead zone on its command."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from emsid.models.plants.plant import StaticCharacteristic
from emsid.plant import DeadZoneLaw, FrictionLaw

Array = NDArray[np.float64]

UNITS = {"force": "N", "torque": "N*m", "voltage": "V"}


def friction_over_speed(
    laws: Sequence[FrictionLaw],
    viscous: tuple[float, float],
    quadratic: float,
    speed: str,
    unit: str,
    quantity: str,
) -> StaticCharacteristic:
    """All friction, Σ T_f(v) + F_v·v + F_q·|v|·v.

    Args:
        laws: T_f, all that act on the mass.
        viscous: F_v (forward, backward).
        quadratic: F_q.
        speed, unit: name and unit of the speed.
        quantity: ``force`` or ``torque``.
    """

    def law(v: Array) -> Array:
        dry = sum((law.torque(v) for law in laws), np.zeros_like(v))
        return np.asarray(dry + np.where(v < 0, viscous[1], viscous[0]) * v + quadratic * v * np.abs(v))

    forward, backward = (sum(law.breakaway[k] for law in laws) for k in (0, 1))
    return StaticCharacteristic(law, (speed, unit), (f"Friction {quantity}", UNITS[quantity]), (forward, backward))


def dead_zone_over_command(zone: DeadZoneLaw | None, quantity: str) -> StaticCharacteristic | None:
    """The dead zone on a ``force`` or a ``voltage``; None without one."""
    if zone is None:
        return None
    x, y = ((f"{which} {quantity}", UNITS[quantity]) for which in ("Applied", "Effective"))
    return StaticCharacteristic(zone, x, y, edge=max(zone.b_r, -zone.b_l))
