"""Plots of the dead zones and friction of a motor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from emsid.report.document import Axis, Dash, Figure, Ink, Line, Plot, Points, Stroke
from emsid.report.numbers import prefixed
from emsid.report.views.conventions import MEASURED

if TYPE_CHECKING:
    from emsid.plant import DeadZoneLaw, FrictionLaw, Motor


def nonlinearities(motor: Motor) -> Figure:
    """Dead zones (4.9) and friction torques (4.7) of a motor, as in Figure 4.2, as far as it has them.

    A motor without any is drawn with zero friction.
    """
    frictions = ((motor.rotor_friction, "rotor"), (motor.load_friction, "load"))
    acting = [(friction, where) for friction, where in frictions if max(friction.breakaway) > 0]
    plots = [
        *(
            _dead_zone(zone, quantity, unit)
            for zone, quantity, unit in (
                (motor.voltage_dead_zone, "voltage", "V"),
                (motor.torque_dead_zone, "torque", "N*m"),
            )
            if zone is not None
        ),
        *(_friction(friction, where) for friction, where in acting),
    ] or [_friction(*frictions[0])]
    return Figure(
        "nonlinearities",
        "Dead zone and friction of the motor. The output of the dead zone is zero between its break points. Friction "
        "at standstill takes any value up to break-away.",
        tuple(plots),
        columns=len(plots) if len(plots) < 4 else 2,
    )


def _dead_zone(zone: DeadZoneLaw, quantity: str, unit: str) -> Plot:
    reach = 3 * max(-zone.b_l, zone.b_r) or 1.0
    x = np.array([-reach, zone.b_l, zone.b_r, reach])
    return Plot(
        (
            Line(x[[0, -1]], x[[0, -1]], "D(v) = v", Stroke(Ink.GREY, Dash.DASHED, 0.8)),
            Line(x, zone(x), "dead zone (4.9)", MEASURED),
        ),
        Axis(f"Applied {quantity} v", unit),
        Axis(f"Effective {quantity} D(v)", unit),
        f"Dead zone on the {quantity}",
    )


def _friction(friction: FrictionLaw, where: str) -> Plot:
    forwards = friction.reach * np.concatenate([[1e-12], np.linspace(0, 1, 200)[1:]])
    w = np.concatenate([-forwards[::-1], forwards])
    factor, unit = prefixed(max(friction.breakaway), "N*m")
    forward, backward = friction.breakaway
    return Plot(
        (
            Line(w, factor * friction.torque(w), "friction", MEASURED),
            Points(np.zeros(2), factor * np.array([-backward, forward]), "break-away", Ink.RED),
        ),
        Axis("Speed ω", "rad/s"),
        Axis("Friction torque", unit),
        f"Friction on the {where}",
    )
